"""How a pelvis moves over the court: cubic pieces of time, within limits of speed and acceleration.

Places are world x, y in metres. A track always ends at rest, so it can be read at any later time.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from pgm_data.simulate.tennis.play import Athlete

RATE = 50.0
"""Knots of a plan per second."""
SIDE_LIMIT_M = 10.0
NET_LIMIT_M = 0.3
BACK_LIMIT_M = 19.5
_LOOKS = np.linspace(0.0, 1.0, 9)
# Planned below the limits, so that rounding never passes them.
_SHARE = 0.98


@dataclass(frozen=True, eq=False, kw_only=True)
class Piece:
    """One cubic: place(t) = sum of coefficients[k] (t - start)^k."""

    start: float
    coefficients: Float[np.ndarray, "4 2"]


@dataclass(frozen=True, eq=False, kw_only=True)
class Limits:
    """What a player's legs can do, and the half of the court that is theirs."""

    speed: float
    """m/s."""
    acceleration: float
    """m/s^2."""
    player: int
    """0 near (y < 0), 1 far."""

    def eased(self, speed: float, acceleration_share: float) -> "Limits":
        """Limits of somebody who does not hurry."""
        return Limits(
            speed=min(self.speed, speed), acceleration=self.acceleration * acceleration_share, player=self.player
        )


def limits_of(athlete: Athlete, player: int) -> Limits:
    """The limits of an athlete at an end."""
    return Limits(speed=_SHARE * athlete.top_speed, acceleration=_SHARE * athlete.acceleration, player=player)


def inside(places: Float[np.ndarray, "... 2"], player: int, margin: float = 0.0) -> np.ndarray:
    """Whether places lie on a player's own part of the surface."""
    x, y = np.abs(places[..., 0]), places[..., 1] * (-1.0 if player == 0 else 1.0)
    return np.asarray((x <= SIDE_LIMIT_M - margin) & (y > NET_LIMIT_M + margin) & (y <= BACK_LIMIT_M - margin))


class Track:
    """A player's way so far and as intended; later intentions replace earlier ones from their start."""

    def __init__(self, place: Float[np.ndarray, " 2"]) -> None:
        """Stand at a place from time 0."""
        coefficients = np.zeros((4, 2))
        coefficients[0] = place
        self.pieces = [Piece(start=0.0, coefficients=coefficients)]

    def at(self, time: float) -> tuple[np.ndarray, np.ndarray]:
        """Place and velocity."""
        i = len(self.pieces) - 1
        while i > 0 and self.pieces[i].start > time:
            i -= 1
        return read(self.pieces[i], time)

    def follow(self, pieces: list[Piece]) -> None:
        """Take over new pieces from the start of the first."""
        start = pieces[0].start
        self.pieces = [p for p in self.pieces if p.start < start] + pieces

    def sampled(self, times: Float[np.ndarray, " times"]) -> np.ndarray:
        """Places (times, 2)."""
        starts = np.array([p.start for p in self.pieces])
        i = np.clip(np.searchsorted(starts, times, side="right") - 1, 0, len(starts) - 1)
        c = np.stack([p.coefficients for p in self.pieces])[i]
        s = (times - starts[i])[:, None]
        return c[:, 0] + s * (c[:, 1] + s * (c[:, 2] + s * c[:, 3]))


def read(piece: Piece, time: float) -> tuple[np.ndarray, np.ndarray]:
    """Place and velocity of one piece at a time."""
    c, s = piece.coefficients, time - piece.start
    return c[0] + s * (c[1] + s * (c[2] + s * c[3])), c[1] + s * (2 * c[2] + s * 3 * c[3])


def cubic(start: float, end: float, place: np.ndarray, velocity: np.ndarray, goal: np.ndarray, final: np.ndarray):
    """The gentlest piece from place and velocity to goal and final velocity."""
    span = end - start
    d = goal - place
    c2 = (3 * d - (2 * velocity + final) * span) / span**2
    c3 = (-2 * d + (velocity + final) * span) / span**3
    return Piece(start=start, coefficients=np.stack([place, velocity, c2, c3]))


def keeps(piece: Piece, end: float, limits: Limits) -> bool:
    """Whether a piece keeps the limits up to its end."""
    c = piece.coefficients
    span = end - piece.start
    # Acceleration is linear in time, so its size is largest at an end.
    ends = np.stack([2 * c[2], 2 * c[2] + 6 * c[3] * span])
    if (ends**2).sum(1).max() > limits.acceleration**2:
        return False
    s = (_LOOKS * span)[:, None]
    velocity = c[1] + s * (2 * c[2] + s * 3 * c[3])
    if (velocity**2).sum(1).max() > (0.995 * limits.speed) ** 2:
        return False
    places = c[0] + s * (c[1] + s * (c[2] + s * c[3]))
    return bool(inside(places, limits.player, 0.02).all())


def standing(start: float, place: np.ndarray) -> Piece:
    """To stand."""
    return Piece(start=start, coefficients=np.stack([place, np.zeros(2), np.zeros(2), np.zeros(2)]))


def braked(start: float, place: np.ndarray, velocity: np.ndarray, limits: Limits, share: float = 0.75) -> list[Piece]:
    """To come to rest straight ahead at a share of the acceleration, harder where the surface ends."""
    speed = float(np.hypot(*velocity))
    if speed < 1e-6:
        return [standing(start, place)]
    for harder in (share, 0.9, 1.0):
        slowing = harder * limits.acceleration
        stop = place + velocity * speed / (2 * slowing)
        if inside(stop, limits.player, 0.02):
            break
    first = Piece(start=start, coefficients=np.stack([place, velocity, -velocity / speed * slowing / 2, np.zeros(2)]))
    return [first, standing(start + speed / slowing, stop)]


def can_stop(places: np.ndarray, velocities: np.ndarray, limits: Limits) -> np.ndarray:
    """Whether somebody running through places at velocities can stop on the surface."""
    speed = np.linalg.norm(velocities, axis=-1, keepdims=True)
    return inside(places + velocities * speed / (2 * 0.9 * limits.acceleration), limits.player, 0.05)


def hurried_velocity(
    place: np.ndarray, velocity: np.ndarray, goals: Float[np.ndarray, "... 2"], spans: np.ndarray, limits: Limits
) -> tuple[np.ndarray, np.ndarray]:
    """Velocities (..., 2) with which goals are passed by accelerating at once and then running evenly; and if possible.

    `spans` are the times to the goals, broadcast to the leading axes of `goals`.
    """
    spans = np.maximum(spans, 1e-3)[..., None]
    d = goals - place
    V = d / spans
    for _ in range(12):
        first = np.minimum(np.linalg.norm(V - velocity, axis=-1, keepdims=True) / limits.acceleration, spans)
        V = (d - velocity * first / 2) / (spans - first / 2)
    first = np.linalg.norm(V - velocity, axis=-1, keepdims=True) / limits.acceleration
    missed = np.linalg.norm((V + velocity) / 2 * first + V * (spans - first) - d, axis=-1)
    possible = (first[..., 0] <= spans[..., 0]) & (np.linalg.norm(V, axis=-1) <= limits.speed) & (missed < 0.01)
    return V, np.asarray(possible)


def hurried(start: float, end: float, place: np.ndarray, velocity: np.ndarray, V: np.ndarray, limits: Limits):
    """To take on velocity V at full acceleration, run on evenly until the end, then stop."""
    change = V - velocity
    size = float(np.hypot(*change))
    first = size / limits.acceleration
    pieces = []
    if size > 1e-9:
        half = change / size * limits.acceleration / 2
        pieces.append(Piece(start=start, coefficients=np.stack([place, velocity, half, np.zeros(2)])))
    middle = place + (V + velocity) / 2 * first
    pieces.append(Piece(start=start + first, coefficients=np.stack([middle, V, np.zeros(2), np.zeros(2)])))
    goal = middle + V * (end - start - first)
    return [*pieces, *braked(end, goal, V, limits)]


def chased(start: float, end: float, place: np.ndarray, velocity: np.ndarray, goal: np.ndarray, limits: Limits):
    """To run at a goal out of reach with all one has until `end`, then stop."""
    way = goal - place
    way = way / max(float(np.hypot(*way)), 1e-9)
    for share in (1.0, 0.85, 0.7, 0.5, 0.3, 0.15):
        change = share * limits.speed * way - velocity
        size = max(float(np.hypot(*change)), 1e-9)
        first = min(size / limits.acceleration, end - start)
        V = velocity + change / size * limits.acceleration * first
        gone = place + (V + velocity) / 2 * first + V * (end - start - first)
        if bool(inside(gone, limits.player, 0.05)) and bool(can_stop(gone, V, limits)):
            return hurried(start, end, place, velocity, V, limits)
    return braked(start, place, velocity, limits)


def way_to(
    start: float,
    end: float,
    place: np.ndarray,
    velocity: np.ndarray,
    goal: np.ndarray,
    limits: Limits,
    *,
    step: np.ndarray,
) -> list[Piece] | None:
    """The gentlest way to be at a goal at `end`, moving with `step` where there is time; None where out of reach."""
    d = goal - place
    span = end - start
    free = 1.5 * d / span - 0.5 * velocity
    for through in (0.0, 0.25, 0.5, 0.75, 1.0):
        final = step + through * (free - step)
        piece = cubic(start, end, place, velocity, goal, final)
        if keeps(piece, end, limits) and bool(can_stop(goal, final, limits)):
            return [piece, *braked(end, goal, final, limits)]
    V, possible = hurried_velocity(place, velocity, goal, np.asarray(span), limits)
    if possible and bool(can_stop(goal, V, limits)):
        return hurried(start, end, place, velocity, V, limits)
    return None


def strolled(start: float, place: np.ndarray, velocity: np.ndarray, goal: np.ndarray, limits: Limits) -> list[Piece]:
    """To go to a goal without hurry and stop there, the time as it needs."""
    span = max(0.4, 1.5 * float(np.hypot(*(goal - place))) / limits.speed)
    for _ in range(10):
        piece = cubic(start, start + span, place, velocity, goal, np.zeros(2))
        if keeps(piece, start + span, limits):
            return [piece, standing(start + span, goal)]
        span *= 1.25
    stop = braked(start, place, velocity, limits)
    after, rest = stop[-1].start, stop[-1].coefficients[0]
    span = max(0.4, 1.6 * float(np.hypot(*(goal - rest))) / limits.speed)
    span = max(span, 1.02 * float(np.sqrt(6 * np.hypot(*(goal - rest)) / limits.acceleration)))
    piece = cubic(after, after + span, rest, np.zeros(2), goal, np.zeros(2))
    return [*stop[:-1], piece, standing(after + span, goal)]


def recovered(
    start: float, end: float, place: np.ndarray, velocity: np.ndarray, goal: np.ndarray, limits: Limits
) -> list[Piece]:
    """To come to rest by `end` at a goal, or as far towards it as the limits let."""
    for share in (1.0, 0.85, 0.7, 0.55, 0.4, 0.25, 0.1):
        aim = place + share * (goal - place)
        if end - start > 0.15:
            piece = cubic(start, end, place, velocity, aim, np.zeros(2))
            if keeps(piece, end, limits):
                return [piece, standing(end, aim)]
    return strolled(start, place, velocity, goal, limits)
