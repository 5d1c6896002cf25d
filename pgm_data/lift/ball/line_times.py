"""Where in the picture, and when to a fraction of a frame, the ball's way before a contact meets its way after it."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

WINDOW_S = 0.26
LEAST_FRAMES = 4
"""On each side of a contact; the window grows with the time between frames to hold them."""
GRID = 41
SEARCH_S = (0.02, 0.12)
"""Least and most that a time is moved."""
REACH_S = 0.35
"""So far beyond its last pixel a way is drawn on."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Meetings:
    """Contacts in the picture."""

    times: Float[np.ndarray, " contacts"]
    """s; those that came in where there is nothing to tell better."""
    pixels: Float[np.ndarray, "contacts 2"]
    """NaN where no pixel is near enough."""


def meetings(
    times: Float[np.ndarray, " contacts"],
    time_std: Float[np.ndarray, " contacts"],
    seen_times: Float[np.ndarray, " pixels"],
    pixels: Float[np.ndarray, "pixels 2"],
    sigma_px: Float[np.ndarray, " pixels"],
) -> Meetings:
    """When and where the ways meet: the parabolas before and after a contact that share a point fit best.

    Each contact looks no farther than the contacts beside it; the time that comes in counts by its standard deviation.
    """
    out_times, out_pixels = times.copy(), np.full((len(times), 2), np.nan)
    if not len(seen_times):
        return Meetings(times=out_times, pixels=out_pixels)
    frame_s = float(np.median(np.diff(seen_times))) if len(seen_times) > 1 else 0.04
    window = max(WINDOW_S, LEAST_FRAMES * frame_s)
    for k, (time, std) in enumerate(zip(times, time_std, strict=True)):
        low = max(time - window, times[k - 1] if k else -np.inf)
        high = min(time + window, times[k + 1] if k + 1 < len(times) else np.inf)
        near = (seen_times >= low) & (seen_times <= high)
        t, p, s = seen_times[near], pixels[near], sigma_px[near]
        if min((t < time).sum(), (t > time).sum()) >= LEAST_FRAMES - 1:
            reach = float(np.clip(3 * std, *SEARCH_S))
            trial = time + np.linspace(-reach, reach, GRID)
            trial = trial[(trial > t[1]) & (trial < t[-2])]
            if len(trial) > 2:
                out_times[k], out_pixels[k] = _meeting(trial, t - time, p, s, time, max(std, 1e-3))
                continue
        out_pixels[k] = _drawn_on(time, seen_times, pixels, low, high)
    return Meetings(times=out_times, pixels=out_pixels)


def _meeting(
    trial: np.ndarray, t: np.ndarray, p: np.ndarray, s: np.ndarray, time: float, std: float
) -> tuple[float, np.ndarray]:
    since = t - (trial - time)[:, None]
    before, after = np.minimum(since, 0.0), np.maximum(since, 0.0)
    design = np.stack([np.ones_like(since), before, before**2, after, after**2], axis=-1) / s[:, None]
    # A faint pull on the curvatures (px/s^2) keeps sides with three pixels solvable.
    normal = np.swapaxes(design, 1, 2) @ design + np.diag([0, 0, 1e-10, 0, 1e-10])
    scaled = p / s[:, None]
    solved = np.linalg.solve(normal + 1e-12 * np.eye(5), np.swapaxes(design, 1, 2) @ scaled)
    cost = ((scaled - design @ solved) ** 2).sum(axis=(1, 2)) + ((trial - time) / std) ** 2
    best = int(np.argmin(cost))
    return float(trial[best]), solved[best, 0]


def _drawn_on(time: float, seen_times: np.ndarray, pixels: np.ndarray, low: float, high: float) -> np.ndarray:
    """The pixel at a contact with the way of one side only."""
    sides = [
        np.flatnonzero((seen_times <= time) & (seen_times >= low - REACH_S))[-5:],
        np.flatnonzero((seen_times >= time) & (seen_times <= high + REACH_S))[:5],
    ]
    sides = [side for side in sides if len(side) and np.abs(seen_times[side] - time).min() <= REACH_S]
    if not sides:
        return np.full(2, np.nan)
    side = min(sides, key=lambda rows: (len(rows) < 3, np.abs(seen_times[rows] - time).min()))
    degree = min(len(side) - 1, 2 if np.abs(seen_times[side] - time).min() < 0.1 else 1)
    away = seen_times[side] - time
    design = away[:, None] ** np.arange(degree + 1)
    return np.linalg.lstsq(design, pixels[side], rcond=None)[0][0]
