"""Flights between two ends that are known: horizontal motion under drag, vertical motion under drag and gravity.

With the speed |v|(t) known, drag -C |v| v and lift across the velocity are linear in the velocity. In the vertical
plane of a flight, w = forward + i up obeys w' = -(C + i K) |v| w - i g, K by topspin, whose solution is two
quadratures; the start velocity follows from the ends. |v| starts as the speed along the ground of `drag_line` and is
taken again from the flight that came out: with no such pass this is the paper's equation, with one or more it holds for
lobs too.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from pgm_data.lift.ball.drag_line import distance_at, speed_at
from pgm_data.lift.ball.world import GRAVITY

SHORTEST_S = 1e-4
"""Flights count as no shorter than that."""
KNOT_S = 0.06
FASTEST = 150.0
"""m/s."""
KNOTS = (12, 400)
"""Fewest and most knots of the quadratures in one flight."""
MOST_LOSS = 25.0
"""Exponent of the speed lost in one flight at most: beyond it nothing is left to see."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Ends:
    """What fixes flights: any leading axes. No checks: the solver makes many of them."""

    start: Float[np.ndarray, "*flights 3"]
    """World, m."""
    stop: Float[np.ndarray, "*flights 3"]
    start_time: Float[np.ndarray, "*flights"]
    """s."""
    stop_time: Float[np.ndarray, "*flights"]
    drag: Float[np.ndarray, "*flights"]
    """C, 1/m."""
    lift: Float[np.ndarray, "*flights"]
    """1/m, see `BallWorld.lift_per_m`: the lift is that times v^2 S / (1 + 2 S), S = surface speed by spin / v."""
    topspin: Float[np.ndarray, "*flights"]
    """Speed of the ball's surface by its spin about the level axis across the flight, m/s; below 0 with backspin."""
    sidespin: Float[np.ndarray, "*flights"]
    """The same about the vertical; above 0 it bends the flight to the left."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Paths:
    """Flights at evenly spaced knots, to be read with `at`."""

    start_time: Float[np.ndarray, "*flights"]
    span: Float[np.ndarray, "*flights"]
    positions: Float[np.ndarray, "*flights knots 3"]
    velocities: Float[np.ndarray, "*flights knots 3"]


def paths_between(ends: Ends, passes: int) -> Paths:
    """The flights that meet their ends, with so many passes for |v| over the speed along the ground."""
    span = np.maximum(ends.stop_time - ends.start_time, SHORTEST_S)
    knots = int(np.clip(np.ceil(span.max(initial=0.0) / KNOT_S), *KNOTS)) + 1
    share = np.linspace(0.0, 1.0, knots)
    step = span[..., None] / (knots - 1)
    time = span[..., None] * share
    way = ends.stop[..., :2] - ends.start[..., :2]
    length = np.hypot(way[..., 0], way[..., 1])
    forward = way / np.maximum(length, 1e-12)[..., None]
    climb = ends.stop[..., 2] - ends.start[..., 2]
    drag = np.minimum(ends.drag, MOST_LOSS / np.maximum(length, 1e-12))
    flat = distance_at(time, length[..., None], span[..., None], drag[..., None])
    flat_speed = speed_at(time, length[..., None], span[..., None], drag[..., None])
    speed = flat_speed
    along, along_speed = flat, flat_speed
    up, up_speed, fade = _vertical(speed, step, climb, drag)
    for _ in range(passes):
        speed = np.hypot(along_speed, up_speed)
        place, velocity = _in_plane(speed, step, length + 1j * climb, drag, _lift_over_speed(speed, ends, ends.topspin))
        along, up, along_speed, up_speed = np.real(place), np.imag(place), np.real(velocity), np.imag(velocity)
    if passes:
        fade = np.exp(-np.minimum(drag[..., None] * _cumulative(speed, step), MOST_LOSS))
    else:
        lifted, lifted_speed = _pushed(-speed * _lift_over_speed(speed, ends, ends.topspin), fade, step)
        up, up_speed = up + lifted, up_speed + lifted_speed
    aside, aside_speed = _pushed(along_speed * _lift_over_speed(speed, ends, ends.sidespin), fade, step)
    left = np.stack([-forward[..., 1], forward[..., 0]], axis=-1)
    ground = along[..., None] * forward[..., None, :] + aside[..., None] * left[..., None, :]
    ground_speed = along_speed[..., None] * forward[..., None, :] + aside_speed[..., None] * left[..., None, :]
    return Paths(
        start_time=ends.start_time,
        span=span,
        positions=ends.start[..., None, :] + np.concatenate([ground, up[..., None]], axis=-1),
        velocities=np.concatenate([ground_speed, up_speed[..., None]], axis=-1),
    )


def flights_of(ends: Ends, which: Bool[np.ndarray, " flights"]) -> Ends:
    """Some of the flights, by the last axis."""
    return Ends(
        start=ends.start[..., which, :],
        stop=ends.stop[..., which, :],
        start_time=ends.start_time[..., which],
        stop_time=ends.stop_time[..., which],
        drag=ends.drag[..., which],
        lift=ends.lift[..., which],
        topspin=ends.topspin[..., which],
        sidespin=ends.sidespin[..., which],
    )


def at(paths: Paths, times: Float[np.ndarray, "*flights times"]) -> tuple[np.ndarray, np.ndarray]:
    """Positions and velocities (flights, times, 3) at times within each flight, by cubic Hermite interpolation."""
    knots = paths.positions.shape[-2]
    step = paths.span[..., None, None] / (knots - 1)
    place = np.clip((times - paths.start_time[..., None]) / step[..., 0], 0.0, knots - 1)
    low = np.minimum(place.astype(np.int64), knots - 2)[..., None]
    u = place[..., None] - low
    p0, p1, v0, v1 = (
        np.take_along_axis(values, low + offset, axis=-2)
        for values in (paths.positions, paths.velocities)
        for offset in (0, 1)
    )
    rest = 1 - u
    position = rest**2 * ((1 + 2 * u) * p0 + u * step * v0) + u**2 * ((3 - 2 * u) * p1 - rest * step * v1)
    velocity = 6 * u * rest * (p1 - p0) / step + rest * (1 - 3 * u) * v0 + u * (3 * u - 2) * v1
    return position, velocity


def landings(
    start: Float[np.ndarray, "*flights 3"], velocity: Float[np.ndarray, "*flights 3"], ends: Ends, level: float
) -> Float[np.ndarray, "*flights 3"]:
    """Where flights from those starts come down to the height `level`, the air and spin as in `ends`, m.

    NaN where they start below it, take longer than 30 s or are faster than any ball.
    """
    step, longest = 0.04, 30.0
    state = np.concatenate(np.broadcast_arrays(start, velocity), axis=-1)
    landed = np.full(state.shape[:-1] + (3,), np.nan)
    waiting = (state[..., 2] > level - 1e-6) & np.isfinite(state).all(axis=-1)
    waiting &= np.linalg.norm(state[..., 3:], axis=-1) < FASTEST
    state = np.where(waiting[..., None], state, 0.0)
    for _ in range(int(longest / step)):
        if not waiting.any():
            break
        k1 = _slope(state, ends)
        k2 = _slope(state + 0.5 * step * k1, ends)
        k3 = _slope(state + 0.5 * step * k2, ends)
        k4 = _slope(state + step * k3, ends)
        new = state + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        down = waiting & (new[..., 2] <= level) & (new[..., 5] < 0)
        if not down.any():
            state = new
            continue
        # Within the step the height is a parabola through both ends with the slope of the second.
        share = _crossing(state[..., 2] - level, new[..., 2] - level, new[..., 5] * step)
        here = (1 - share)[..., None] * state[..., :3] + share[..., None] * new[..., :3]
        here = here - (share * (1 - share))[..., None] * 0.5 * step**2 * k4[..., 3:]
        here[..., 2] = level
        landed = np.where(down[..., None], here, landed)
        waiting = waiting & ~down
        state = new
    return landed


def _crossing(above: np.ndarray, below: np.ndarray, slope: np.ndarray) -> np.ndarray:
    curve = above - below + slope
    middle = 2 * (below - above) - slope
    with np.errstate(all="ignore"):
        root = (-middle + np.sqrt(np.maximum(middle**2 - 4 * curve * above, 0.0))) / (2 * curve)
        other = (-middle - np.sqrt(np.maximum(middle**2 - 4 * curve * above, 0.0))) / (2 * curve)
        straight = above / (above - below)
    good = np.where((root >= 0) & (root <= 1), root, np.where((other >= 0) & (other <= 1), other, straight))
    return np.clip(np.nan_to_num(good, nan=1.0), 0.0, 1.0)


def _slope(state: np.ndarray, ends: Ends) -> np.ndarray:
    velocity = state[..., 3:]
    ground = np.hypot(velocity[..., 0], velocity[..., 1])
    speed = np.linalg.norm(velocity, axis=-1)
    forward = velocity[..., :2] / np.maximum(ground, 1e-9)[..., None]
    left = np.stack([-forward[..., 1], forward[..., 0]], axis=-1)
    push = -ends.drag[..., None] * speed[..., None] * velocity
    top, side = (_lift_over_speed(speed[..., None], ends, spin)[..., 0] for spin in (ends.topspin, ends.sidespin))
    flat = (top * velocity[..., 2])[..., None] * forward + (side * ground)[..., None] * left
    lift = np.concatenate([flat, (-top * ground - GRAVITY)[..., None]], axis=-1)
    return np.concatenate([velocity, push + lift], axis=-1)


def _in_plane(
    speed: np.ndarray, step: np.ndarray, goal: np.ndarray, drag: np.ndarray, turning: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Places and velocities (flights, knots), forward + i up, of flights of that speed that end at the goal.

    `turning`: rate at which topspin turns the velocity downwards, rad/s.
    """
    arc = np.minimum(_cumulative(speed, step), MOST_LOSS / np.maximum(drag, 1e-12)[..., None])
    fade = np.exp(-drag[..., None] * arc - 1j * _cumulative(turning, step))
    reach = _cumulative(fade, step)
    pull = fade * _cumulative(1 / fade, step)
    fall = _cumulative(pull, step)
    first = ((goal + 1j * GRAVITY * fall[..., -1]) / reach[..., -1])[..., None]
    return first * reach - 1j * GRAVITY * fall, first * fade - 1j * GRAVITY * pull


def _vertical(
    speed: np.ndarray, step: np.ndarray, climb: np.ndarray, drag: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Heights, their rates and the share of speed kept, without lift, drag going with the speed along the ground."""
    fade = np.exp(-np.minimum(drag[..., None] * _cumulative(speed, step), MOST_LOSS))
    reach = _cumulative(fade, step)
    pull = fade * _cumulative(1 / fade, step)
    fall = _cumulative(pull, step)
    first = ((climb + GRAVITY * fall[..., -1]) / reach[..., -1])[..., None]
    return first * reach - GRAVITY * fall, first * fade - GRAVITY * pull, fade


def _lift_over_speed(speed: np.ndarray, ends: Ends, spin: np.ndarray) -> np.ndarray:
    """Lift by one component of the spin over the speed, 1/s; speeds have one axis more than the ends."""
    surface = np.hypot(ends.topspin, ends.sidespin)[..., None]
    return (ends.lift * spin)[..., None] * speed / np.maximum(speed + 2 * surface, 1e-9)


def _pushed(push: np.ndarray, fade: np.ndarray, step: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Offsets that an acceleration makes and their rates: none at both ends."""
    reach = _cumulative(fade, step)
    pulled = fade * _cumulative(push / fade, step)
    drift = _cumulative(pulled, step)
    first = (drift[..., -1] / reach[..., -1])[..., None]
    return drift - first * reach, pulled - first * fade


def _cumulative(values: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Integrals from the first knot to each, by cubics through four knots; `step` broadcasts."""
    inner = (13 * (values[..., 1:-2] + values[..., 2:-1]) - values[..., :-3] - values[..., 3:]) / 24
    first = (5 * values[..., :1] + 8 * values[..., 1:2] - values[..., 2:3]) / 12
    last = (5 * values[..., -1:] + 8 * values[..., -2:-1] - values[..., -3:-2]) / 12
    pieces = np.concatenate([np.zeros_like(first), first, inner, last], axis=-1)
    return np.cumsum(pieces, axis=-1) * step
