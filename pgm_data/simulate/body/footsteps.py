"""Where and when each foot stands, along a planned course of the pelvis.

The march goes through the course once, in steps of 1/100 s, and never sees the times at which a body is asked for. A foot
lifts when the pelvis has gone half a contact's way past it, and lands where the pelvis will be in the middle of the
next contact: walking, running, shuffling sideways, backing up, starting and stopping all follow from that.
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
    counts, numbers = _march(
        course.xy, course.velocity, course.heading, course.airborne, course.wide, scale, np.float64(TICK_S)
    )
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
def _gait(ahead, left):
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
def _bulge(foot, ax, ay, bx, by, ox, oy, heading, scale):
    """How far, and where to, a swing from a to b must leave the straight line to pass a foot at o."""
    dx, dy = bx - ax, by - ay
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
def _time_left(foot, k, xy, heading, place, scale, longest):
    """Ticks until the pelvis strains the leg of a standing foot, at most `longest`."""
    n = len(xy)
    for j in range(longest):
        i = min(k + j, n - 1)
        if _strain(foot, xy[i, 0], xy[i, 1], heading[i], place[0], place[1], place[2], _STAY_M, scale) > 1.0:
            return j
    return longest


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _march(xy, velocity, heading, airborne, wide, scale, tick):
    n = len(xy)
    total = n + int(1.5 / tick)
    numbers = np.zeros((2, 16 + total // 4, 7))
    counts = np.zeros(2, dtype=np.int64)
    planted = np.ones(2, dtype=np.bool_)
    since = np.full(2, -1.0)
    landing = np.zeros(2)
    place = np.zeros((2, 3))
    goal = np.zeros((2, 3))
    for foot in range(2):
        place[foot] = _home(foot, xy[0, 0], xy[0, 1], heading[0], velocity[0, 0], velocity[0, 1], 0.0, scale)
        numbers[foot, 0, 0] = -np.inf
        numbers[foot, 0, 2:5] = place[foot]
        counts[foot] = 1
    leap = 0
    aloft = -1.0
    for k in range(total):
        t = k * tick
        for foot in range(2):
            if not planted[foot] and t >= landing[foot] - 1e-9:
                planted[foot] = True
                since[foot] = landing[foot]
                place[foot] = goal[foot]
                numbers[foot, counts[foot], 0] = landing[foot]
                numbers[foot, counts[foot], 2:5] = goal[foot]
                counts[foot] += 1
        if leap < len(airborne) and t >= airborne[leap, 0] - 1e-9:
            aloft = airborne[leap, 1]
            j = min(int(np.round((aloft + 0.08) / tick)), n - 1)
            for foot in range(2):
                if planted[foot]:
                    planted[foot] = False
                    numbers[foot, counts[foot] - 1, 1] = t
                landing[foot] = aloft
                goal[foot] = _home(
                    foot, xy[j, 0], xy[j, 1], heading[j], velocity[j, 0], velocity[j, 1], wide[leap], scale
                )
                d = min(int(np.round(aloft / tick)), n - 1)
                goal[foot, 0], goal[foot, 1] = _in_reach(
                    foot, xy[d, 0], xy[d, 1], heading[d], goal[foot, 0], goal[foot, 1], goal[foot, 2], scale
                )
            leap += 1
        if t < aloft - 1e-9:
            continue
        i = min(k, n - 1)
        ahead_i = min(k + 6, n - 1)
        vx, vy = velocity[ahead_i, 0], velocity[ahead_i, 1]
        c, s = np.cos(heading[i]), np.sin(heading[i])
        go_ahead, go_left = -s * vx + c * vy, -c * vx - s * vy
        speed = np.hypot(vx, vy)
        rate, contact, swing = _gait(go_ahead, go_left)
        threshold = max(0.5 * speed * contact, _STANDING_ERROR_M * scale)
        both_long = planted[0] and planted[1] and t - max(since[0], since[1]) > 0.25
        # From a stand the first foot goes before the pelvis has left.
        p = min(k + 22, n - 1) if both_long else i
        if both_long:
            vx, vy = velocity[p, 0], velocity[p, 1]
            go_ahead, go_left = -s * vx + c * vy, -c * vx - s * vy
            speed = np.hypot(vx, vy)
        best, chosen = 0.0, -1
        for foot in range(2):
            if not planted[foot]:
                continue
            other = 1 - foot
            hx, hy, hyaw = _home(foot, xy[p, 0], xy[p, 1], heading[p], vx, vy, 0.0, scale)
            dx, dy = hx - place[foot, 0], hy - place[foot, 1]
            error = np.hypot(dx, dy)
            if speed > 0.35:
                along = (dx * vx + dy * vy) / speed
                need = max(along - threshold, np.sqrt(max(error * error - along * along, 0.0)) - 0.24 * scale)
            else:
                need = error - threshold
            turn = abs(hyaw - place[foot, 2])
            if speed < 1.5:
                need = max(need, 0.3 * (turn - _TURN_ERROR))
            left_s = tick * _time_left(foot, k, xy, heading, place[foot], scale, 8)
            if planted[other]:
                rest = max(0.5 * (contact - swing), 0.0) * 0.7 if speed > 0.35 else 0.1
                allowed = t - since[foot] >= 0.1 and t - since[other] >= rest
            else:
                flight = max(0.5 * (swing - contact), 0.0)
                allowed = t - since[foot] >= 0.08 and landing[other] - t <= 1.25 * flight + 1e-9
            if left_s < 0.035 and t - since[foot] >= 0.035:
                allowed = True
                need = max(need, 0.5)
            if not allowed or need <= 0.0:
                continue
            side = 1.0 if foot == 0 else -1.0
            need += 0.04 * side * min(max(go_left, -1.0), 1.0)
            if since[foot] < since[other] - 1e-9:
                need += 0.06
            need = max(need, 1e-6)
            if need > best + 1e-9:
                best, chosen = need, foot
        if chosen < 0 or k >= n - 1 + int(0.6 / tick):
            continue
        foot = chosen
        other = 1 - foot
        down = swing
        if speed > 0.5:
            wanted = (since[other] if planted[other] else landing[other]) + 1.0 / rate - t
            down = min(max(wanted, 0.85 * swing), 1.15 * swing)
        if both_long:
            down = min(down, 0.26)
        # The other leg carries until this foot is down.
        if planted[other]:
            carries = tick * _time_left(other, k, xy, heading, place[other], scale, 60)
            down = max(min(down, carries), 0.16)
        width = 0.0
        fixed = False
        if leap < len(airborne) and t + down > airborne[leap, 0] - 0.08:
            # Either down in time to leap off again, or in the air until the leap lands.
            if airborne[leap, 0] - 0.08 - t >= 0.18:
                down = airborne[leap, 0] - 0.08 - t
            else:
                down = airborne[leap, 1] - t
                width = wide[leap]
                fixed = True
        for attempt in range(2):
            at_land = min(int(np.round((t + down) / tick)), n - 1)
            c, s = np.cos(heading[at_land]), np.sin(heading[at_land])
            wx, wy = velocity[at_land, 0], velocity[at_land, 1]
            _, next_contact, _ = _gait(-s * wx + c * wy, -c * wx - s * wy)
            middle = min(int(np.round((t + down + 0.5 * next_contact) / tick)), n - 1)
            gx, gy, gyaw = _home(
                foot,
                xy[middle, 0],
                xy[middle, 1],
                heading[middle],
                velocity[middle, 0],
                velocity[middle, 1],
                width,
                scale,
            )
            # The left foot lands to the left of the right one; only fast side steps cross, in front.
            if planted[other]:
                ox, oy = place[other, 0], place[other, 1]
            else:
                ox, oy = goal[other, 0], goal[other, 1]
            c, s = np.cos(heading[middle]), np.sin(heading[middle])
            side = 1.0 if foot == 0 else -1.0
            apart = side * (-c * (gx - ox) - s * (gy - oy))
            lacking = _APART_M * scale - apart
            if lacking > 0.0:
                to_left = -c * wx - s * wy
                crossing = -side * to_left > 2.4
                if crossing:
                    ahead = -s * (gx - ox) + c * (gy - oy)
                    more = max(0.2 * scale - ahead, 0.0)
                    gx, gy = gx - s * more, gy + c * more
                else:
                    lacking = min(lacking, 0.4 * scale)
                    gx, gy = gx - side * c * lacking, gy - side * s * lacking
            # It must be in reach at the landing and for a moment after it.
            for moment in (min(at_land + 8, n - 1), at_land):
                gx, gy = _in_reach(foot, xy[moment, 0], xy[moment, 1], heading[moment], gx, gy, gyaw, scale)
            if attempt == 0 and not fixed:
                # Short steps take less time.
                length = np.hypot(gx - place[foot, 0], gy - place[foot, 1])
                down = max(down * min(0.6 + length, 1.0), 0.18) if speed < 1.5 else down
        landing[foot] = max(np.round((t + down) / tick), k + 10) * tick
        if fixed:
            landing[foot] = airborne[leap, 1]
        planted[foot] = False
        goal[foot, 0], goal[foot, 1], goal[foot, 2] = gx, gy, gyaw
        numbers[foot, counts[foot] - 1, 1] = t
        numbers[foot, counts[foot] - 1, 5:7] = _bulge(
            foot, place[foot, 0], place[foot, 1], gx, gy, ox, oy, heading[at_land], scale
        )
    for foot in range(2):
        if not planted[foot]:
            numbers[foot, counts[foot], 0] = landing[foot]
            numbers[foot, counts[foot], 2:5] = goal[foot]
            counts[foot] += 1
        numbers[foot, counts[foot] - 1, 1] = np.inf
    return counts, numbers
