"""The flight of a ball through air, by Runge and Kutta's fourth order, up to what stops it.

A state is (x, y, z, vx, vy, vz), metres and m/s in the world. The spin keeps its axis and decays exponentially, so it
is no part of the state. Force constants: see `air.force_constants`.
"""

import math
from dataclasses import dataclass
from enum import IntEnum

import numba
import numpy as np

from pgm_data.simulate.flight.air import Air, BallBuild, force_constants
from pgm_data.simulate.flight.contact import NetShape

STEP_S = 0.01
"""Time step, and the spacing of the samples: the error of a serve is below a micrometre."""
SHARE = 0.05
"""Of the velocity that drag or lift may turn over in a step: shortens steps only beyond a tennis ball's speeds."""
TOUCH_M = 1e-9
"""A gap to the net that counts as touching."""
compiled = numba.njit(cache=True, nogil=True, error_model="numpy")


class Stop(IntEnum):
    """What ended a flight."""

    TIME = 0
    GROUND = 1
    NET = 2
    BOUNDS = 3


@dataclass(frozen=True, eq=False, kw_only=True)
class Flown:
    """Samples of one flight; a single one where it ended as it began."""

    times: np.ndarray
    positions: np.ndarray
    velocities: np.ndarray
    spins: np.ndarray
    stop: Stop


@compiled
def slope(state, spin, k, out):
    """Time derivative of a state, into `out`."""
    rx, ry, rz = state[3] - k[4], state[4] - k[5], state[5] - k[6]
    speed = math.sqrt(rx * rx + ry * ry + rz * rz)
    # Cl |v|^2 along the unit of spin x v, with Cl = factor S / (1 + 2 S) and S = R |spin| / |v|.
    turning = speed + 2.0 * k[2] * math.sqrt(spin[0] ** 2 + spin[1] ** 2 + spin[2] ** 2)
    lift = k[1] * speed / turning if turning > 0.0 else 0.0
    drag = k[0] * speed
    out[0], out[1], out[2] = state[3], state[4], state[5]
    out[3] = -drag * rx + lift * (spin[1] * rz - spin[2] * ry)
    out[4] = -drag * ry + lift * (spin[2] * rx - spin[0] * rz)
    out[5] = -drag * rz + lift * (spin[0] * ry - spin[1] * rx) - k[3]


@compiled
def step_for(state, spin, k, longest):
    """Seconds of a step that follows a state."""
    rate = k[0] * math.sqrt((state[3] - k[4]) ** 2 + (state[4] - k[5]) ** 2 + (state[5] - k[6]) ** 2)
    rate += abs(k[1]) * math.sqrt(spin[0] ** 2 + spin[1] ** 2 + spin[2] ** 2)
    return min(longest, SHARE / rate) if rate > 0.0 else longest


@compiled
def advance(state, spin, h, k, out, work):
    """The state after a step of h seconds, into `out`; `spin` is the one at the step's start. `work` is (6, 6)."""
    slopes, trial, turned = work[:4], work[4], work[5]
    half = math.exp(-0.5 * h * k[7])
    slope(state, spin, k, slopes[0])
    for i in range(6):
        trial[i] = state[i] + 0.5 * h * slopes[0, i]
    for i in range(3):
        turned[i] = half * spin[i]
    slope(trial, turned, k, slopes[1])
    for i in range(6):
        trial[i] = state[i] + 0.5 * h * slopes[1, i]
    slope(trial, turned, k, slopes[2])
    for i in range(6):
        trial[i] = state[i] + h * slopes[2, i]
    for i in range(3):
        turned[i] = half * turned[i]
    slope(trial, turned, k, slopes[3])
    for i in range(6):
        out[i] = state[i] + h / 6.0 * (slopes[0, i] + 2.0 * slopes[1, i] + 2.0 * slopes[2, i] + slopes[3, i])


@compiled
def _time_of(component, level, low, high, start, spin, k, out, work):
    """When, between two times of which only one lies past it, a component of the state crosses a level."""
    advance(start, spin, low, k, out, work)
    before = out[component] - level
    t = 0.5 * (low + high)
    for _ in range(60):
        advance(start, spin, t, k, out, work)
        value = out[component] - level
        if (value > 0.0) == (before > 0.0):
            low = t
        else:
            high = t
        slope(out, spin, k, work[0])
        rate = work[0, component]
        better = t - value / rate if rate != 0.0 else low
        if not (low < better < high):
            better = 0.5 * (low + high)
        if abs(better - t) < 1e-13:
            break
        t = better
    return t


@compiled
def landing_time(start, end, spin, h, level, k, out, work):
    """When within a step the ball comes down to a level; inf where it does not."""
    low, high = 0.0, h
    if start[5] < 0.0 < end[5]:
        # It may dip below between the two ends.
        high = _time_of(5, 0.0, 0.0, h, start, spin, k, out, work)
        advance(start, spin, high, k, out, work)
        if out[2] > level:
            return math.inf
    elif end[2] > level or (end[5] >= 0.0 and start[2] >= level):
        return math.inf
    if start[5] > 0.0 > end[5]:
        low = _time_of(5, 0.0, 0.0, h, start, spin, k, out, work)
        advance(start, spin, low, k, out, work)
        if out[2] <= level:
            return low
    elif start[2] <= level:
        return 0.0
    return _time_of(2, level, low, high, start, spin, k, out, work)


@compiled
def net_gap(state, radius, xs, tops, tape_radius):
    """From the ball's surface to the net's, metres, and the unit vector (y, z) away from the net; inf beside it."""
    if state[0] < xs[0] or state[0] > xs[-1]:
        return math.inf, 0.0, 0.0
    middle = np.interp(state[0], xs, tops) - tape_radius
    y, z = state[1], max(state[2] - middle, 0.0)
    distance = math.sqrt(y * y + z * z)
    if distance == 0.0:
        return -radius - tape_radius, -1.0 if state[4] > 0.0 else 1.0, 0.0
    return distance - radius - tape_radius, y / distance, z / distance


@compiled
def _net_time(start, end, spin, h, k, xs, tops, tape_radius, out, work):
    """When within a step the ball runs into the net; inf where it does not."""
    speed = 0.0
    for state in (start, end):
        speed = max(speed, math.sqrt(state[3] ** 2 + state[4] ** 2 + state[5] ** 2))
    reach = k[2] + tape_radius + speed * h
    if min(abs(start[1]), abs(end[1])) > reach and start[1] * end[1] > 0.0:
        return math.inf
    # No surface is nearer than the gap, and none is reached sooner than the gap over the speed (and a little more).
    t = 0.0
    while t < h:
        advance(start, spin, t, k, out, work)
        gap, ny, nz = net_gap(out, k[2], xs, tops, tape_radius)
        closing = ny * out[4] + nz * out[5]
        if gap <= TOUCH_M and closing < 0.0:
            return t
        if gap == math.inf:
            gap = 0.01
        t += max(gap, 1e-9 if closing < 0.0 else 1e-4) / (1.05 * speed + 0.05)
    return math.inf


@compiled
def _bounds_time(start, end, spin, h, k, bounds, out, work):
    """When within a step the ball leaves the bounds; inf where it does not."""
    first = math.inf
    for axis in range(2):
        for side in (-1.0, 1.0):
            level = side * bounds[axis]
            if side * (end[axis] - level) > 0.0:
                first = min(first, _time_of(axis, level, 0.0, h, start, spin, k, out, work))
    return first


@compiled
def _fly(state, spin, duration, level, k, bounds, xs, tops, tape_radius):
    """Samples (time since the start, state) and what ended the flight."""
    times, states = np.empty(256), np.empty((256, 6))
    work, out = np.empty((6, 6)), np.empty(6)
    times[0], states[0] = 0.0, state
    now = np.empty(3)
    n, stop = 1, 0
    while stop == 0 and duration - times[n - 1] > 1e-10:
        if n + 1 >= len(times):
            room = 2 * len(times)
            longer_times, longer_states = np.empty(room), np.empty((room, 6))
            longer_times[:n], longer_states[:n] = times[:n], states[:n]
            times, states = longer_times, longer_states
        shrink = math.exp(-k[7] * times[n - 1])
        for i in range(3):
            now[i] = shrink * spin[i]
        h = min(step_for(states[n - 1], now, k, STEP_S), duration - times[n - 1])
        start, end = states[n - 1], states[n]
        advance(start, now, h, k, end, work)
        first = landing_time(start, end, now, h, level, k, out, work)
        if first < math.inf:
            stop = 1
        if xs.size > 0:
            t = _net_time(start, end, now, h, k, xs, tops, tape_radius, out, work)
            if t < first:
                first, stop = t, 2
        t = _bounds_time(start, end, now, h, k, bounds, out, work)
        if t < first:
            first, stop = t, 3
        if stop > 0:
            h = first
            advance(start, now, h, k, out, work)
            for i in range(6):
                end[i] = out[i]
            if stop == 1:
                end[2] = level
        times[n] = times[n - 1] + h
        if h < 1e-10 and n > 1:
            # An event at the very step: it takes the sample's place.
            states[n - 1] = end
        elif h >= 1e-10:
            n += 1
    return times[:n], states[:n], stop


def fly(
    position: np.ndarray,
    velocity: np.ndarray,
    spin: np.ndarray,
    air: Air,
    build: BallBuild,
    *,
    time: float = 0.0,
    until: float,
    floor_z: float = 0.0,
    net: NetShape | None = None,
    bounds: tuple[float, float] = (math.inf, math.inf),
) -> Flown:
    """One flight, from a time (seconds) on to another, to the ground, the net or the bounds, whichever comes first.

    Position: world metres, the ball's centre; velocity m/s; spin rad/s. It is on the ground when its centre comes down
    to floor + radius. Bounds: half width and half length about the origin, metres.

    Raises:
        ValueError: If a value is not finite, the ball is in the ground, or `until` does not lie after `time`.
    """
    state = np.concatenate([position, velocity]).astype(float)
    if not (np.isfinite(state).all() and np.isfinite(spin).all()):
        raise ValueError(f"fly: expected a finite position, velocity and spin, got {position}, {velocity}, {spin}")
    if position[2] < floor_z + build.radius_m - 1e-6:
        raise ValueError(f"fly.position: expected a centre of {floor_z + build.radius_m} m or more, got {position}")
    if not (math.isfinite(until) and until > time):
        raise ValueError(f"fly.until: expected a finite time after {time} s, got {until}")
    xs, tops, tape_radius = (np.empty(0), np.empty(0), 0.0) if net is None else (net.xs, net.tops, net.tape_radius_m)
    since, states, stop = _fly(
        state,
        np.asarray(spin, dtype=float),
        until - time,
        floor_z + build.radius_m,
        force_constants(air, build),
        np.array(bounds, dtype=float),
        xs,
        tops,
        tape_radius,
    )
    times = time + since
    if stop == Stop.TIME:
        times[-1] = until
    return Flown(
        times=times,
        positions=states[:, :3].copy(),
        velocities=states[:, 3:].copy(),
        spins=np.exp(-build.spin_decay_per_s * since)[:, None] * spin,
        stop=Stop(stop),
    )
