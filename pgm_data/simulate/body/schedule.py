"""When each stroke of a player takes hold of the body, and what it asks of the hips."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from pgm_data.simulate.body import postures
from pgm_data.simulate.body.figure import Figure
from pgm_data.simulate.body.keys import Course, calm_rates, rise
from pgm_data.simulate.body.legs import HipDemand
from pgm_data.simulate.body.strokes import GRAVITY, Swing, swing_of
from pgm_data.simulate.tennis.play import Plan, Stroke

STEP_S = 1e-3
"""Before and after a contact, to see how the pelvis moves there."""
_LONGEST_S = 9.0
_PREPARES = 0.55
"""Share of the time between two contacts that belongs to the second one."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Schedule:
    """Strokes in order, each with its span of time; all as a right-hander's."""

    plan: Plan
    swings: tuple[Swing, ...]
    hips: Course | None
    """Turn from the net, drop, lean and tilt to the left; None where there are no strokes."""
    net: Float[np.ndarray, " strokes"]
    """Heading of the net, radians, on the turn at which the plan's heading is at the contact."""
    left_handed: bool
    last_s: float
    """Last moment at which the player takes part in the point."""

    def special_times(self) -> Float[np.ndarray, " moments"]:
        """Six moments for every stroke: just before, at and just after the contact, and the same of the toss."""
        moments = [(s.stroke.time, s.stroke.toss_time if s.toss >= 0 else s.stroke.time) for s in self.swings]
        return (np.array(moments).reshape(-1, 2, 1) + STEP_S * np.array([-1.0, 0.0, 1.0])).ravel()

    def share_at(self, times: Float[np.ndarray, " times"]) -> Float[np.ndarray, " times"]:
        """How much of the body strokes have, 0 to 1."""
        share = np.zeros(len(times))
        for swing in self.swings:
            share = np.maximum(share, _span_share(swing, times))
        return share

    def place_at(self, times: Float[np.ndarray, " times"]) -> tuple[np.ndarray, np.ndarray]:
        """World x, y of the pelvis and its heading, by the plan alone."""
        plan = self.plan
        x, y = (np.interp(times, plan.times, plan.path[:, k]) for k in (0, 1))
        return np.stack([x, y], axis=-1), self.heading_at(times)

    def heading_at(self, times: Float[np.ndarray, " times"]) -> Float[np.ndarray, " times"]:
        """The plan's heading, radians, with a continuous rate."""
        heading = self.plan.heading[:, None]
        rates = np.gradient(heading, self.plan.times, axis=0) if len(heading) > 1 else np.zeros_like(heading)
        return Course(times=self.plan.times, values=heading, rates=rates).at(times)[:, 0]


def schedule_of(figure: Figure, plan: Plan, strokes: tuple[Stroke, ...]) -> Schedule:
    """The schedule of one player's strokes.

    Raises:
        ValueError: If strokes are not in order of time.
    """
    contact = np.array([s.time for s in strokes])
    if (np.diff(contact) <= 0).any():
        raise ValueError(f"strokes: expected rising times, got {contact}")
    pelvis = np.stack([np.interp(contact, plan.times, plan.path[:, k]) for k in (0, 1)], axis=-1)
    swings = []
    for i, stroke in enumerate(strokes):
        since = _PREPARES * (contact[i] - contact[i - 1]) if i else _LONGEST_S
        until = (1.0 - _PREPARES) * (contact[i + 1] - contact[i]) if i + 1 < len(strokes) else _LONGEST_S
        swings.append(swing_of(figure, stroke, pelvis[i], float(since), float(until)))
    heading = np.interp(contact, plan.times, plan.heading)
    net = np.array([0.0 if s.player == 0 else np.pi for s in strokes])
    last = max([*contact.tolist(), *plan.splits.tolist()], default=-np.inf)
    return Schedule(
        plan=plan,
        swings=tuple(swings),
        hips=_hips(swings),
        net=net + 2.0 * np.pi * np.round((heading - net) / (2.0 * np.pi)),
        left_handed=figure.hand == "left",
        last_s=float(last),
    )


def _hips(swings: list[Swing]) -> Course | None:
    if not swings:
        return None
    times, values = joined(swings, [s.values for s in swings])
    values = values[:, postures.HIPS]
    return Course(times=times, values=values, rates=calm_rates(times, values))


def joined(swings, values: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Steps of all strokes after one another; where one begins just as the last ends, that step counts once."""
    times, rows = [swings[0].times], [values[0]]
    for swing, value in zip(swings[1:], values[1:], strict=True):
        skip = 1 if swing.times[0] <= times[-1][-1] + 1e-6 else 0
        times.append(swing.times[skip:])
        rows.append(value[skip:])
    return np.concatenate(times), np.concatenate(rows)


def _span_share(swing: Swing, times: np.ndarray) -> np.ndarray:
    begin, end, contact = swing.times[0], swing.times[-1], swing.stroke.time
    early = rise((times - begin) / (0.6 * (swing.times[1] - begin) + 0.1 * (contact - begin)))
    return early * rise((end - times) / (0.7 * (end - swing.times[-2])))


def demand_at(schedule: Schedule, times: Float[np.ndarray, " times"]) -> HipDemand:
    """What the strokes ask of the hips at any times."""
    none = np.zeros(len(times))
    if schedule.hips is None:
        return HipDemand(turn=none, drop=none, lean_forward=none, lean_left=none, hop=none)
    turn, drop, lean, tilt = schedule.hips.at(times).T
    side = -1.0 if schedule.left_handed else 1.0
    heading = schedule.heading_at(times)
    share, to_net, hop = np.zeros(len(times)), np.zeros(len(times)), np.zeros(len(times))
    for swing, net in zip(schedule.swings, schedule.net, strict=True):
        mine = _span_share(swing, times)
        share = share + mine
        to_net = to_net + mine * (net - heading)
        half = np.sqrt(2.0 * swing.hop / GRAVITY) if swing.hop > 0 else 1.0
        u = np.clip((times - swing.stroke.time) / half, -1.0, 1.0)
        hop = hop + swing.hop * (1.0 - u * u)
    share = np.minimum(share, 1.0)
    return HipDemand(
        turn=to_net + share * side * turn,
        drop=share * drop,
        lean_forward=share * lean,
        lean_left=share * side * tilt,
        hop=hop,
    )
