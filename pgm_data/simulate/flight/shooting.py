"""The search for the angles of a launch, compiled: plain numbers in and out."""

import math

import numba
import numpy as np

from pgm_data.simulate.flight.integrate import advance, landing_time, step_for

STEP_S = 0.02
"""Twice the flights' own; still exact to some micrometres."""
LONGEST_S = 30.0
MISS_M = 1e-3
TILT = 1e-5
"""Of the differences that stand for derivatives, radians."""
LOWEST, HIGHEST = -1.5, 1.56
"""Elevations searched, radians."""
GOLDEN = 0.6180339887498949
compiled = numba.njit(cache=True, nogil=True, error_model="numpy")


@compiled
def landing(start, strike, elevation, azimuth, level, k, work):
    """Where a launch (speed, topspin, sidespin) first meets the ground, x and y; NaN if it takes too long.

    `work` is (9, 6).
    """
    c, s = math.cos(azimuth), math.sin(azimuth)
    state, end = work[7], work[8]
    flat = strike[0] * math.cos(elevation)
    for i in range(3):
        state[i] = start[i]
    state[3], state[4], state[5] = flat * c, flat * s, strike[0] * math.sin(elevation)
    spin = (-strike[1] * s, strike[1] * c, strike[2])
    t = 0.0
    while t < LONGEST_S:
        h = step_for(state, spin, k, STEP_S)
        advance(state, spin, h, k, end, work)
        first = landing_time(state, end, spin, h, level, k, work[6], work)
        if first < math.inf:
            advance(state, spin, first, k, end, work)
            return end[0], end[1]
        for i in range(6):
            state[i] = end[i]
        t += h
        shrink = math.exp(-k[7] * h)
        spin = (shrink * spin[0], shrink * spin[1], shrink * spin[2])
    return math.nan, math.nan


@compiled
def _reach(start, strike, elevation, azimuth, level, k, work):
    """How far from the start it lands, and by what angle beside the azimuth."""
    x, y = landing(start, strike, elevation, azimuth, level, k, work)
    x, y = x - start[0], y - start[1]
    c, s = math.cos(azimuth), math.sin(azimuth)
    return math.hypot(x, y), math.atan2(-s * x + c * y, c * x + s * y)


@compiled
def _newton(start, target, strike, elevation, azimuth, level, k, sign, work):
    """Newton's way from a guess: whether it ends at a root of that side (1 low, -1 high), elevation, azimuth."""
    dx, dy = target[0] - start[0], target[1] - start[1]
    want = math.hypot(dx, dy)
    for _ in range(14):
        x, y = landing(start, strike, elevation, azimuth, level, k, work)
        ex, ey = x - target[0], y - target[1]
        xe, ye = landing(start, strike, elevation + TILT, azimuth, level, k, work)
        xa, ya = landing(start, strike, elevation, azimuth + TILT, level, k, work)
        a, b, c, d = (xe - x) / TILT, (xa - x) / TILT, (ye - y) / TILT, (ya - y) / TILT
        away = sign * (a * dx + c * dy) / want
        det = a * d - b * c
        if not (away > 0.0 and abs(det) > 1e-9):
            return False, elevation, azimuth
        if math.hypot(ex, ey) < MISS_M:
            # One step more, since its derivatives are at hand: the miss shrinks to micrometres.
            return True, elevation - (d * ex - b * ey) / det, azimuth - (a * ey - c * ex) / det
        turn = max(min(-(d * ex - b * ey) / det, 0.15), -0.15)
        elevation = max(min(elevation + turn, HIGHEST), LOWEST)
        azimuth += max(min(-(a * ey - c * ex) / det, 0.4), -0.4)
    return False, elevation, azimuth


@compiled
def _bracketed(start, target, strike, level, k, sign, work):
    """The slow sure way: the elevation that reaches farthest divides the roots, then bisection, azimuth in turns."""
    dx, dy = target[0] - start[0], target[1] - start[1]
    want, bearing = math.hypot(dx, dy), math.atan2(dy, dx)
    azimuth, middle = bearing, 0.0
    for _ in range(3):
        low, high = LOWEST, HIGHEST
        p, q = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
        fp, _ = _reach(start, strike, p, azimuth, level, k, work)
        fq, _ = _reach(start, strike, q, azimuth, level, k, work)
        while high - low > 2e-3 and max(fp, fq) < want:
            if fp > fq:
                high, q, fq = q, p, fp
                p = high - GOLDEN * (high - low)
                fp, _ = _reach(start, strike, p, azimuth, level, k, work)
            else:
                low, p, fp = p, q, fq
                q = low + GOLDEN * (high - low)
                fq, _ = _reach(start, strike, q, azimuth, level, k, work)
        beyond, far = (p, fp) if fp > fq else (q, fq)
        if not far >= want:
            return False, 0.0, azimuth
        short = LOWEST if sign > 0 else HIGHEST
        offset = 0.0
        for _ in range(12):
            middle = 0.5 * (short + beyond)
            distance, offset = _reach(start, strike, middle, azimuth, level, k, work)
            if distance < want:
                short = middle
            else:
                beyond = middle
        azimuth = bearing - offset
    return _newton(start, target, strike, middle, azimuth, level, k, sign, work)


@compiled
def elevation_for(start, target, strike, level, k, high):
    """Whether a launch (speed, topspin, sidespin) reaches a target on the ground, its elevation and azimuth."""
    work = np.empty((9, 6))
    dx, dy = target[0] - start[0], target[1] - start[1]
    want, bearing = math.hypot(dx, dy), math.atan2(dy, dx)
    sign = -1.0 if high else 1.0
    # In a vacuum from the ground; drag and lift shift both roots by less than the reach of Newton's way.
    bend = 0.5 * math.asin(min(k[3] * want / strike[0] ** 2, 1.0))
    guess = 0.5 * math.pi - bend - 0.02 if high else math.atan2(level - start[2], want) + bend
    found, elevation, azimuth = _newton(start, target, strike, guess, bearing, level, k, sign, work)
    if not found:
        found, elevation, azimuth = _bracketed(start, target, strike, level, k, sign, work)
    return found, elevation, azimuth


@compiled
def at_net(state, spin, level, k):
    """Where a flight first passes y = 0: x and z; NaN if it meets the ground before."""
    work, now, end, out, turning = np.empty((6, 6)), state.copy(), np.empty(6), np.empty(6), spin.copy()
    since = 0.0
    while since < LONGEST_S:
        h = step_for(now, turning, k, STEP_S)
        advance(now, turning, h, k, end, work)
        first = landing_time(now, end, turning, h, level, k, out, work)
        if (now[1] < 0.0) != (end[1] < 0.0):
            # Regula falsi has no trouble with a path that is all but straight.
            low, high, a, b = 0.0, h, now[1], end[1]
            t = 0.0
            for _ in range(20):
                t = low - a * (high - low) / (b - a)
                advance(now, turning, t, k, out, work)
                if abs(out[1]) < 1e-10:
                    break
                if (out[1] < 0.0) == (a < 0.0):
                    low, a = t, out[1]
                else:
                    high, b = t, out[1]
            return (out[0], out[2]) if t <= first else (math.nan, math.nan)
        if first < math.inf:
            return math.nan, math.nan
        for i in range(6):
            now[i] = end[i]
        since += h
        for i in range(3):
            turning[i] *= math.exp(-k[7] * h)
    return math.nan, math.nan
