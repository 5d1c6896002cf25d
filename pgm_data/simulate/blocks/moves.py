"""How fast a player of the blocks moves, and jumps and falls in closed form.

Constants as block games have them: walk 4.3 m/s, sprint 5.6 m/s, a jump 1.25 m high under a gravity of 28 m/s^2
(airborne 0.6 s), ladders 2.35 m/s up and 3 m/s down. No drag: nobody falls far enough to feel it.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

GRAVITY = 28.0
"""m/s^2."""
JUMP_M = 1.25
JUMP_SPEED = float(np.sqrt(2 * GRAVITY * JUMP_M))
"""Upward speed at take-off, m/s."""
WALK_SPEED = 4.3
SPRINT_SPEED = 5.6
STAIRS_SPEED = 3.0
CLIMB_UP_SPEED = 2.35
CLIMB_DOWN_SPEED = 3.0
QUICKER = 20.0
"""Acceleration along the path, m/s^2."""
SLOWER = 24.0
SIDEWAYS = 18.0
"""Acceleration across the path in bends, m/s^2."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Arc:
    """One jump or fall: vertical motion under gravity alone, horizontal motion in straight pieces of constant speed."""

    start: Float[np.ndarray, " 3"]
    """World metres, the middle of the soles."""
    direction: Float[np.ndarray, " 2"]
    """Unit vector."""
    vertical_speed: float
    """At the start, m/s."""
    times: Float[np.ndarray, " knots"]
    """Seconds from the start; the last is the landing."""
    distances: Float[np.ndarray, " knots"]
    """Metres along the direction at those times."""

    @property
    def duration(self) -> float:
        """Seconds."""
        return float(self.times[-1])

    def at(self, times: Float[np.ndarray, " times"]) -> Float[np.ndarray, "times 3"]:
        """Positions at times from the start."""
        along = np.interp(times, self.times, self.distances)
        height = self.start[2] + self.vertical_speed * times - 0.5 * GRAVITY * times**2
        return np.column_stack([self.start[:2] + along[:, None] * self.direction, height])

    @property
    def first_speed(self) -> float:
        """Horizontal, m/s."""
        return float((self.distances[1] - self.distances[0]) / (self.times[1] - self.times[0]))

    @property
    def last_speed(self) -> float:
        """Horizontal, m/s."""
        return float((self.distances[-1] - self.distances[-2]) / (self.times[-1] - self.times[-2]))


def airborne_s(vertical_speed: float, rise: float) -> float:
    """Seconds until the height differs by `rise` on the way down, metres.

    Raises:
        ValueError: If it never gets as high.
    """
    room = vertical_speed**2 - 2 * GRAVITY * rise
    if room < 0:
        raise ValueError(f"airborne_s.rise: expected at most {vertical_speed**2 / (2 * GRAVITY):.3f} m, got {rise}")
    return (vertical_speed + float(np.sqrt(room))) / GRAVITY


TAKE_OFF_M = 0.45
"""From the middle of the column to the take-off of a jump over a gap."""
LAND_SHORT_M = 0.35
"""From the landing to the middle of the column."""
PUSH_M = 0.19
"""How far a jumper comes before the block in front lies below the feet."""
LEAVE_M = 0.8
"""From the middle of the column to where the body's box has left it."""


def jump(start: Float[np.ndarray, " 3"], end: Float[np.ndarray, " 3"]) -> Arc:
    """A jump from the top of one column towards that of another; the way is straight along x or y.

    Onto the next column the jumper rises in front of it first; over gaps the speed is constant.
    """
    way = end[:2] - start[:2]
    far = float(np.linalg.norm(way))
    direction = way / far
    rise = float(end[2] - start[2])
    landing = airborne_s(JUMP_SPEED, rise)
    if far < 1.5:
        clear = (JUMP_SPEED - float(np.sqrt(JUMP_SPEED**2 - 2 * GRAVITY * (rise + 0.005)))) / GRAVITY
        times, distances = np.array([0.0, clear, landing]), np.array([0.0, PUSH_M, far])
        first = 0.0
    else:
        times, distances = np.array([0.0, landing]), np.array([0.0, far - LAND_SHORT_M - TAKE_OFF_M])
        first = TAKE_OFF_M
    at = start + [*(first * direction), 0.0]
    return Arc(start=at, direction=direction, vertical_speed=JUMP_SPEED, times=times, distances=distances)


def drop(start: Float[np.ndarray, " 3"], end: Float[np.ndarray, " 3"]) -> Arc:
    """A fall off the edge of one column onto another, one or two columns on; it begins where the body has left it."""
    way = end[:2] - start[:2]
    far = float(np.linalg.norm(way))
    direction = way / far
    landing = airborne_s(0.0, float(end[2] - start[2]))
    reach = (far if far < 1.5 else far - 0.1) - LEAVE_M
    return Arc(
        start=start + [*(LEAVE_M * direction), 0.0],
        direction=direction,
        vertical_speed=0.0,
        times=np.array([0.0, landing]),
        distances=np.array([0.0, reach]),
    )


def hop(start: Float[np.ndarray, " 3"]) -> Arc:
    """A jump on the spot."""
    return Arc(
        start=start,
        direction=np.array([0.0, 1.0]),
        vertical_speed=JUMP_SPEED,
        times=np.array([0.0, airborne_s(JUMP_SPEED, 0.0)]),
        distances=np.zeros(2),
    )


def resampled(corners: Float[np.ndarray, "corners 2"], setbacks: Float[np.ndarray, " corners"], step: float):
    """Points about `step` apart on the polyline with its corners rounded, and the distance at which each corner lies.

    Setbacks: metres before and after a corner where the rounding (a parabola) begins; the ends have none.
    """
    legs = np.diff(corners, axis=0)
    lengths = np.linalg.norm(legs, axis=1)
    units = legs / lengths[:, None]
    pieces, places, total = [corners[:1]], [0.0], 0.0
    at = 0.0
    for i, length in enumerate(lengths):
        last = i == len(lengths) - 1
        back = 0.0 if last else min(setbacks[i + 1], 0.5 * length, 0.5 * lengths[i + 1])
        straight = np.arange(at + step, length - back, step)
        pieces.append(corners[i] + straight[:, None] * units[i])
        total += length - back - at
        pieces.append((corners[i] + (length - back) * units[i])[None])
        if last:
            places.append(total)
            break
        u = np.linspace(0, 1, max(int(2 * back / step), 2) + 1)[1:, None]
        p0, p1, p2 = corners[i + 1] - back * units[i], corners[i + 1], corners[i + 1] + back * units[i + 1]
        bend = (1 - u) ** 2 * p0 + 2 * u * (1 - u) * p1 + u**2 * p2
        if back > 0:
            bend_length = np.cumsum(np.linalg.norm(np.diff(np.vstack([p0[None], bend]), axis=0), axis=1))
            places.append(total + 0.5 * bend_length[-1])
            total += bend_length[-1]
            pieces.append(bend)
        else:
            places.append(total)
        at = back
    points = np.vstack(pieces)
    keep = np.concatenate([[True], np.linalg.norm(np.diff(points, axis=0), axis=1) > 1e-9])
    return points[keep], np.array(places)


def travel_times(
    points: Float[np.ndarray, "points 2"], limit: Float[np.ndarray, " points"], start_speed: float, end_speed: float
) -> Float[np.ndarray, " points"]:
    """When a runner passes each point of the way: as fast as the limits, bends and accelerations allow.

    Speeds at the ends are met as far as the accelerations allow, the start's first.
    """
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    turn = np.zeros(len(points))
    if len(points) > 2:
        headings = np.unwrap(np.arctan2(*np.diff(points, axis=0).T[::-1]))
        turn[1:-1] = np.abs(np.diff(headings)) / (0.5 * (steps[1:] + steps[:-1]))
        # The bend is felt a little before and after.
        turn = np.maximum(turn, np.convolve(turn, np.ones(3) / 3, mode="same"))
    cap = np.minimum(limit, np.sqrt(SIDEWAYS / np.maximum(turn, 1e-6)))
    cap = np.maximum(cap, 0.6)
    square = _reachable(cap**2, steps, start_speed**2, QUICKER)
    square = _reachable(square[::-1], steps[::-1], end_speed**2, SLOWER)[::-1]
    square[0] = max(square[0], 0.0)
    speeds = np.sqrt(square)
    return np.concatenate([[0.0], np.cumsum(2 * steps / np.maximum(speeds[1:] + speeds[:-1], 0.05))])


def _reachable(squares: np.ndarray, steps: np.ndarray, first: float, acceleration: float) -> np.ndarray:
    """Squared speeds capped so that they never rise faster than the acceleration, from a first one.

    v_i^2 <= v_j^2 + 2 a (s_i - s_j) for all j < i, so v_i^2 - 2 a s_i is a running minimum.
    """
    s = np.concatenate([[0.0], np.cumsum(steps)])
    limited = squares.copy()
    limited[0] = min(first, limited[0])
    return np.minimum.accumulate(limited - 2 * acceleration * s) + 2 * acceleration * s
