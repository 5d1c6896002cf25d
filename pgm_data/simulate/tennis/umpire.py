"""What a shot came to, read off the ball's course by the rules of singles."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from pgm_data.simulate.body.racket import BALL_RADIUS_M
from pgm_data.simulate.flight.path import Contact
from pgm_data.simulate.tennis.play import Result

HALF_WIDTH_M = 4.115
BASELINE_M = 11.885
SERVICE_LINE_M = 6.40
CENTRE_HALF_WIDTH_M = 0.025


@dataclass(frozen=True, eq=False, kw_only=True)
class Verdict:
    """One shot's fate if nobody touches the ball again."""

    result: Result
    landing: Float[np.ndarray, " 2"]
    """World x, y of the first bounce; NaN where there is none."""
    bounce: float
    """Time of the first bounce; infinite where there is none."""
    second_bounce: float
    net: float
    """When the ball touches the net before the first bounce; infinite where it does not."""
    end: float
    """When the course ends."""
    margin: float
    """How far outside of the court that counts the ball lands, metres; below 0 inside."""

    @property
    def dead(self) -> float:
        """When the point is over if nobody touches the ball again."""
        return min(self.end, self.second_bounce if self.result == "in" else self.bounce)


def outside(landing: Float[np.ndarray, " 2"], hitter: int, *, serve_from_right: bool | None) -> float:
    """Metres by which a ball misses the court across the net, or the service box; 0 or less touches a line or is in.

    Lines are measured to their outer edges and a ball is as wide as its radius.
    """
    forward = 1.0 if hitter == 0 else -1.0
    x, y = forward * float(landing[0]), forward * float(landing[1])
    if serve_from_right is None:
        gap = max(abs(x) - HALF_WIDTH_M, y - BASELINE_M, -y)
    else:
        # From the right court the serve goes to the left, as the server sees it.
        inwards = -x if serve_from_right else x
        gap = max(inwards - HALF_WIDTH_M, -inwards - CENTRE_HALF_WIDTH_M, y - SERVICE_LINE_M, -y)
    return gap - BALL_RADIUS_M


def judged(contacts: tuple[Contact, ...], hitter: int, *, serve_from_right: bool | None) -> Verdict:
    """The verdict on the course after a hit, its contact first; `serve_from_right` is None in a rally."""
    bounces = [c for c in contacts[1:] if c.kind == "bounce"]
    end = contacts[-1].time
    landing = bounces[0].position[:2].copy() if bounces else np.full(2, np.nan)
    bounce = bounces[0].time if bounces else np.inf
    net = min([c.time for c in contacts[1:] if c.kind == "net" and c.time < bounce], default=np.inf)
    margin = outside(landing, hitter, serve_from_right=serve_from_right) if bounces else np.inf
    crossed = bool(bounces) and landing[1] * (1.0 if hitter == 0 else -1.0) > 0
    if not crossed and (bounces or np.isfinite(net)):
        result: Result = "net"
    elif margin > 0:
        result = "out"
    elif serve_from_right is not None and np.isfinite(net):
        result = "let"
    else:
        result = "in"
    return Verdict(
        result=result,
        landing=landing,
        bounce=bounce,
        second_bounce=bounces[1].time if len(bounces) > 1 else np.inf,
        net=net,
        end=end,
        margin=float(margin),
    )
