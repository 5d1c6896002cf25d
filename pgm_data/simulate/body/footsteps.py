"""Where and when each foot stands, along a planned course of the pelvis.

The march goes through the course once, in steps of 1/100 s, and never sees the times at which a body is asked for.
A foot lifts when the pelvis has gone half a contact's way past it, and lands where the pelvis will be in the middle of
the next contact: walking, running, shuffling sideways, backing up, starting and stopping all follow from that.
"""

from dataclasses import dataclass

import numba
import numpy as np
from jaxtyping import Float

TICK_S = 0.01

# By speed, m/s: steps a second and seconds of contact, running ahead.
_SPEEDS = np.array([0.0, 0.5, 1.0, 1.4, 1.9, 2.4, 3.0, 4.5, 6.0, 7.5])
_STEP_RATE = np.array([1.5, 1.6, 1.75, 1.95, 2.4, 2.85, 3.1, 3.6, 4.0, 4.3])
_CONTACT_S = np.array([1.0, 0.85, 0.72, 0.62, 0.44, 0.30, 0.25, 0.19, 0.15, 0.13])
# The same to the side or backwards.
_SIDE_SPEEDS = np.array([0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 6.0])
_SIDE_STEP_RATE = np.array([1.8, 2.2, 2.9, 3.5, 3.9, 4.1, 4.2, 4.2, 4.3])
_SIDE_CONTACT_S = np.array([0.80, 0.50, 0.34, 0.27, 0.23, 0.20, 0.18, 0.15, 0.12])

STAND_WIDTH_M = 0.54
"""Between the toe joints at rest, of a person 1.8 m tall, as are the lengths below."""
SPLIT_WIDTH_M = 0.70
_WALK_WIDTH_M = 0.20
_BACK_WIDTH_M = 0.30
_SHUFFLE_WIDTH_M = 0.58
_APART_M = 0.15
"""Feet pass each other no closer."""
_STANDING_ERROR_M = 0.16
_TURN_ERROR = 0.61
_CROSSES_FROM = 2.4
"""m/s to the side."""
# Half axes of the ellipse, about the hip, in which a standing ankle can stay: hip before, behind, beside it.
_STAY_M = (0.52, 0.46, 0.42)
# And of the one in which it lands.
_LAND_M = (0.36, 0.46, 0.38)
_HIP_HALF_M = 0.09
_TOE_AHEAD_M = 0.13
_SPLAY = 0.16


@dataclass(frozen=True, eq=False, kw_only=True)
class Course:
    """Where the pelvis goes, every TICK_S from 0, constant at its end."""

    xy: Float[np.ndarray, "ticks 2"]
    """World metres."""
    velocity: Float[np.ndarray, "ticks 2"]
    """m/s."""
    heading: Float[np.ndarray, " ticks"]
    """Radians, which way the feet shall look."""
    airborne: Float[np.ndarray, "leaps 2"]
    """Take-off and landing of both feet, seconds, in order and apart."""
    wide: Float[np.ndarray, " leaps"]
    """Distance of the feet after each, metres."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Stances:
    """Where one foot stands, in order; between two stances it swings."""

    land: Float[np.ndarray, " stances"]
    """Seconds; the first is -inf."""
    lift: Float[np.ndarray, " stances"]
    """Seconds; the last is inf."""
    toe: Float[np.ndarray, "stances 2"]
    """World x, y of the toe joint."""
    yaw: Float[np.ndarray, " stances"]
    """Which way the foot looks, as a heading; continuous from stance to stance."""
    bulge: Float[np.ndarray, "stances 2"]
    """World x, y by which the swing after the stance leaves the straight line, so as not to meet the other foot."""


def march(course: Course, scale: float) -> tuple[Stances, Stances]:
    """Stances of the left and the right foot of a person `scale` times 1.8 m tall."""
    counts, numbers = _march(course.xy, course.velocity, course.heading, course.airborne, course.wide, scale)
    left, right = (
        Stances(
            land=numbers[foot, : counts[foot], 0].copy(),
            lift=numbers[foot, : counts[foot], 1].copy(),
            toe=numbers[foot, : counts[foot], 2:4].copy(),
            yaw=numbers[foot, : counts[foot], 4].copy(),
            bulge=numbers[foot, : counts[foot], 5:7].copy(),
        )
        for foot in (0, 1)
    )
    return left, right


def gait(ahead: np.ndarray, left: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Steps a second and seconds of contact at velocities in the frame of the hips, m/s."""
    speed = np.hypot(ahead, left)
    side = (left**2 + np.minimum(ahead, 0.0) ** 2) / np.maximum(speed**2, 1e-6)
    rate = (1 - side) * np.interp(speed, _SPEEDS, _STEP_RATE) + side * np.interp(speed, _SIDE_SPEEDS, _SIDE_STEP_RATE)
    contact = (1 - side) * np.interp(speed, _SPEEDS, _CONTACT_S) + side * np.interp(
        speed, _SIDE_SPEEDS, _SIDE_CONTACT_S
    )
    return rate, contact


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _at(value, values, results):
    """Linear interpolation, constant outside."""
    last = len(values) - 1
    if value >= values[last]:
        return results[last]
    i = 0
    while value >= values[i + 1]:
        i += 1
    share = (value - values[i]) / (values[i + 1] - values[i])
    return results[i] + share * (results[i + 1] - results[i])


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _ramp(value, start, end):
    """Smoothly from 0 to 1."""
    u = min(max((value - start) / (end - start), 0.0), 1.0)
    return u * u * (3.0 - 2.0 * u)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _tempo(ahead, left):
    """Steps a second, seconds of contact, seconds of swing."""
    speed = np.hypot(ahead, left)
    back = min(ahead, 0.0)
    side = (left * left + back * back) / max(speed * speed, 1e-6)
    rate = (1 - side) * _at(speed, _SPEEDS, _STEP_RATE) + side * _at(speed, _SIDE_SPEEDS, _SIDE_STEP_RATE)
    contact = (1 - side) * _at(speed, _SPEEDS, _CONTACT_S) + side * _at(speed, _SIDE_SPEEDS, _SIDE_CONTACT_S)
    return rate, contact, max(2.0 / rate - contact, 0.2)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _home(foot, x, y, heading, vx, vy, width, scale):
    """Toe joint and yaw of a foot at ease under a pelvis that moves; a positive width overrides the gait's."""
    c, s = np.cos(heading), np.sin(heading)
    ahead, left = -s * vx + c * vy, -c * vx - s * vy
    speed = np.hypot(ahead, left)
    sideways = left * left / (left * left + ahead * ahead + 0.09)
    if width <= 0.0:
        narrow = _WALK_WIDTH_M if ahead > 0.0 else _BACK_WIDTH_M
        width = STAND_WIDTH_M + (narrow - STAND_WIDTH_M) * _ramp(abs(ahead), 0.1, 1.3)
        width += sideways * _ramp(speed, 0.2, 1.2) * (_SHUFFLE_WIDTH_M - width)
    # Running ahead the pelvis passes over the arch; at rest it sits behind the balls of the feet.
    forward = 0.12 - 0.07 * _ramp(ahead, 0.3, 2.0)
    side = 1.0 if foot == 0 else -1.0
    across = 0.5 * side * width * scale
    forward *= scale
    # A foot looks a little along the way, forwards or backwards, and outwards at rest.
    angle = np.arctan2(left, ahead)
    moving = _ramp(speed, 0.3, 1.5)
    yaw = heading + side * _SPLAY * (1.0 - 0.7 * moving)
    yaw += moving * (0.45 * np.sin(2.0 * angle) + 0.5 * np.sin(angle) * sideways * _ramp(speed, 2.0, 4.0))
    return x - s * forward - c * across, y + c * forward - s * across, yaw


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _bulge(foot, start, end, other, heading, scale):
    """How far, and where to, a swing must leave the straight line to pass the other foot."""
    ax, ay, ox, oy = start[0], start[1], other[0], other[1]
    dx, dy = end[0] - ax, end[1] - ay
    size = np.hypot(dx, dy)
    if size < 0.05:
        return 0.0, 0.0
    dx, dy = dx / size, dy / size
    along = ((ox - ax) * dx + (oy - ay) * dy) / size
    if along <= 0.02 or along >= 0.98:
        return 0.0, 0.0
    nx, ny = -dy, dx
    side = 1.0 if foot == 0 else -1.0
    outward = side * (-np.cos(heading) * nx - np.sin(heading) * ny)
    signed = (ax - ox) * nx + (ay - oy) * ny
    if abs(outward) > 0.4:
        sign = 1.0 if outward > 0 else -1.0
    else:
        sign = 1.0 if signed >= 0 else -1.0
    missing = _APART_M * scale - sign * signed
    if missing <= 0.0:
        return 0.0, 0.0
    # The bulge is a hump over the swing; where it passes the foot it must be wide enough.
    hump = max(np.sin(np.pi * along) ** 2, 0.35)
    amount = sign * min(missing / hump, 0.35 * scale)
    return amount * nx, amount * ny


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _strain(foot, x, y, heading, toe_x, toe_y, yaw, axes, scale):
    """Squared distance of the hip from the ankle in half axes: above 1 the leg is too short."""
    side = 1.0 if foot == 0 else -1.0
    half = side * _HIP_HALF_M * scale
    hip_x, hip_y = x - half * np.cos(heading), y - half * np.sin(heading)
    c, s = np.cos(yaw), np.sin(yaw)
    dx, dy = hip_x - toe_x - s * _TOE_AHEAD_M * scale, hip_y - toe_y + c * _TOE_AHEAD_M * scale
    ahead, left = -s * dx + c * dy, -c * dx - s * dy
    ahead /= axes[0] if ahead > 0.0 else axes[1]
    left /= axes[2]
    return (ahead * ahead + left * left) / (scale * scale)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _in_reach(foot, x, y, heading, toe_x, toe_y, yaw, scale):
    """The place for a toe joint to land, drawn towards under the hip where it is too far away."""
    strain = _strain(foot, x, y, heading, toe_x, toe_y, yaw, _LAND_M, scale)
    if strain <= 1.0:
        return toe_x, toe_y
    half = (1.0 if foot == 0 else -1.0) * _HIP_HALF_M * scale
    under_x = x - half * np.cos(heading) - np.sin(yaw) * _TOE_AHEAD_M * scale
    under_y = y - half * np.sin(heading) + np.cos(yaw) * _TOE_AHEAD_M * scale
    share = 1.0 / np.sqrt(strain)
    return under_x + (toe_x - under_x) * share, under_y + (toe_y - under_y) * share


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _time_left(foot, k, ground, place, scale, longest):
    """Ticks until the pelvis strains the leg of a standing foot, at most `longest`."""
    xy, _, heading = ground
    n = len(xy)
    for j in range(longest):
        i = min(k + j, n - 1)
        if _strain(foot, xy[i, 0], xy[i, 1], heading[i], place[0], place[1], place[2], _STAY_M, scale) > 1.0:
            return j
    return longest


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _in_hips(vx, vy, heading):
    """Components ahead and to the left."""
    c, s = np.cos(heading), np.sin(heading)
    return -s * vx + c * vy, -c * vx - s * vy


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _chosen(k, ground, planted, when, place, scale):
    """The foot that lifts now (-1 for none) and how long it swings, ticks not yet rounded, seconds.

    `when` holds for each foot when it landed, or will.
    """
    xy, velocity, heading = ground
    n = len(xy)
    t = k * TICK_S
    i, soon = min(k, n - 1), min(k + 6, n - 1)
    long = planted[0] and planted[1] and t - max(when[0], when[1]) > 0.25
    ahead, left = _in_hips(velocity[soon, 0], velocity[soon, 1], heading[i])
    rate, contact, swing = _tempo(ahead, left)
    threshold = max(0.5 * np.hypot(ahead, left) * contact, _STANDING_ERROR_M * scale)
    # From a stand the first foot goes before the pelvis has left.
    p = min(k + 22, n - 1) if long else i
    if long:
        soon = p
        ahead, left = _in_hips(velocity[soon, 0], velocity[soon, 1], heading[i])
    vx, vy = velocity[soon, 0], velocity[soon, 1]
    speed = np.hypot(vx, vy)
    best, chosen = 0.0, -1
    for foot in range(2):
        if not planted[foot]:
            continue
        other = 1 - foot
        hx, hy, hyaw = _home(foot, xy[p, 0], xy[p, 1], heading[p], vx, vy, 0.0, scale)
        dx, dy = hx - place[foot, 0], hy - place[foot, 1]
        error = np.hypot(dx, dy)
        need = error - threshold
        if speed > 0.35:
            along = (dx * vx + dy * vy) / speed
            need = max(along - threshold, np.sqrt(max(error * error - along * along, 0.0)) - 0.24 * scale)
        if speed < 1.5:
            need = max(need, 0.3 * (abs(hyaw - place[foot, 2]) - _TURN_ERROR))
        if planted[other]:
            rest = max(0.5 * (contact - swing), 0.0) * 0.7 if speed > 0.35 else 0.1
            allowed = t - when[foot] >= 0.1 and t - when[other] >= rest
        else:
            flight = max(0.5 * (swing - contact), 0.0)
            allowed = t - when[foot] >= 0.08 and when[other] - t <= 1.25 * flight + 1e-9
        # A leg that is about to be too short leaves at once.
        if t - when[foot] >= 0.035 and _time_left(foot, k, ground, place[foot], scale, 4) < 4:
            allowed = True
            need = max(need, 0.5)
        if not allowed or need <= 0.0:
            continue
        # To the side the leading foot goes first, else the one that has stood for longer.
        need += 0.04 * (1.0 if foot == 0 else -1.0) * min(max(left, -1.0), 1.0)
        if when[foot] < when[other] - 1e-9:
            need += 0.06
        need = max(need, 1e-6)
        if need > best + 1e-9:
            best, chosen = need, foot
    if chosen < 0:
        return chosen, 0.0
    other = 1 - chosen
    if speed > 0.5:
        # Even steps: this foot lands one step after the other one.
        swing = min(max(when[other] + 1.0 / rate - t, 0.85 * swing), 1.15 * swing)
    if long:
        swing = min(swing, 0.26)
    if planted[other]:
        # The other leg carries until this foot is down.
        carries = TICK_S * _time_left(other, k, ground, place[other], scale, 60)
        swing = max(min(swing, carries), 0.16)
    return chosen, swing


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _target(foot, landing, width, ground, other, scale):
    """Toe joint and yaw of a foot that lands at a time: at home in the middle of its stance, in reach when it begins.

    `other` is the place of the other foot; NaN where both come down from a leap.
    """
    xy, velocity, heading = ground
    n = len(xy)
    d = min(int(np.round(landing / TICK_S)), n - 1)
    ahead, left = _in_hips(velocity[d, 0], velocity[d, 1], heading[d])
    # Both feet leave a leap's landing as soon as need be.
    contact = 0.16 if np.isnan(other[0]) else _tempo(ahead, left)[1]
    m = min(int(np.round((landing + 0.5 * contact) / TICK_S)), n - 1)
    x, y, yaw = _home(foot, xy[m, 0], xy[m, 1], heading[m], velocity[m, 0], velocity[m, 1], width, scale)
    # The left foot lands to the left of the right one; only fast side steps cross, in front.
    c, s = np.cos(heading[m]), np.sin(heading[m])
    side = 1.0 if foot == 0 else -1.0
    off_ahead, off_left = _in_hips(x - other[0], y - other[1], heading[m])
    lacking = _APART_M * scale - side * off_left
    if lacking > 0.0:
        if -side * left > _CROSSES_FROM:
            more = max(0.2 * scale - off_ahead, 0.0)
            x, y = x - s * more, y + c * more
        else:
            lacking = min(lacking, 0.4 * scale)
            x, y = x - side * c * lacking, y - side * s * lacking
    # It must be in reach at the landing and for a moment after it.
    for i in (min(d + 8, n - 1), d):
        x, y = _in_reach(foot, xy[i, 0], xy[i, 1], heading[i], x, y, yaw, scale)
    return x, y, yaw


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _march(xy, velocity, heading, airborne, wide, scale):
    """How many stances each foot has, and their numbers in the order of the fields of `Stances`."""
    ground = (xy, velocity, heading)
    n = len(xy)
    last = n - 1 + int(0.6 / TICK_S)
    numbers = np.zeros((2, 16 + last // 4, 7))
    counts = np.ones(2, dtype=np.int64)
    planted = np.ones(2, dtype=np.bool_)
    when = np.full(2, -1.0)
    place, goal = np.zeros((2, 3)), np.zeros((2, 3))
    for foot in range(2):
        place[foot] = _home(foot, xy[0, 0], xy[0, 1], heading[0], velocity[0, 0], velocity[0, 1], 0.0, scale)
        numbers[foot, 0, 0] = -np.inf
        numbers[foot, 0, 2:5] = place[foot]
    leap, aloft = 0, -1.0
    for k in range(last):
        t = k * TICK_S
        for foot in range(2):
            if not planted[foot] and t >= when[foot] - 1e-9:
                planted[foot] = True
                place[foot] = goal[foot]
                numbers[foot, counts[foot], 0] = when[foot]
                numbers[foot, counts[foot], 2:5] = goal[foot]
                counts[foot] += 1
        if leap < len(airborne) and t >= airborne[leap, 0] - 1e-9:
            aloft = airborne[leap, 1]
            for foot in range(2):
                if planted[foot]:
                    planted[foot] = False
                    numbers[foot, counts[foot] - 1, 1] = t
                when[foot] = aloft
            for foot in range(2):
                goal[foot] = _target(foot, aloft, wide[leap], ground, np.full(2, np.nan), scale)
            leap += 1
        if t < aloft - 1e-9:
            continue
        foot, swing = _chosen(k, ground, planted, when, place, scale)
        if foot < 0:
            continue
        width = 0.0
        fixed = False
        if leap < len(airborne) and t + swing > airborne[leap, 0] - 0.08:
            # Either down in time to leap off again, or in the air until the leap lands.
            fixed = airborne[leap, 0] - 0.08 - t < 0.18
            swing = airborne[leap, 1] - t if fixed else airborne[leap, 0] - 0.08 - t
            width = wide[leap] if fixed else 0.0
        other = place[1 - foot, :2] if planted[1 - foot] else goal[1 - foot, :2]
        i = min(k, n - 1)
        if not fixed and np.hypot(velocity[i, 0], velocity[i, 1]) < 1.5:
            # Short steps take less time.
            x, y, _ = _target(foot, t + swing, width, ground, other, scale)
            length = np.hypot(x - place[foot, 0], y - place[foot, 1])
            swing = max(swing * min(0.6 + length, 1.0), 0.18)
        landing = airborne[leap, 1] if fixed else max(np.round((t + swing) / TICK_S), k + 10) * TICK_S
        goal[foot] = _target(foot, landing, width, ground, other, scale)
        planted[foot] = False
        when[foot] = landing
        numbers[foot, counts[foot] - 1, 1] = t
        numbers[foot, counts[foot] - 1, 5:7] = _bulge(foot, place[foot], goal[foot], other, heading[i], scale)
    for foot in range(2):
        if not planted[foot]:
            numbers[foot, counts[foot], 0] = when[foot]
            numbers[foot, counts[foot], 2:5] = goal[foot]
            counts[foot] += 1
        numbers[foot, counts[foot] - 1, 1] = np.inf
    return counts, numbers
