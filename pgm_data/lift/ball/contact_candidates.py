"""Moments at which a ball's track in the picture bends, so that something may have touched the ball."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from pgm_data.geometry.arrays import frozen

WINDOWS = (((2, 2, 1), (3, 2, 1), (6, 3, 2)), ((12, 3, 2), (12, 4, 3)), ((24, 4, 3),))
"""Frames on each side, degree of the smooth path, and degree of what the bend adds to it; short ones first."""
LONGEST_WINDOW = 0.33
"""Longer windows are not used, s on each side."""
WITHIN = np.array([0.1, 0.3, 0.5, 0.7, 0.9])
"""Places between two frames where a bend is tried."""
SIDES = 5
"""Frames on each side from which a bend's time is placed."""
DOUBTED = 4.0
"""Chi-squared is divided by this for the doubt of a bend's time: real paths are no parabolas."""
LEAST_GAIN = 9.0
"""A bend must lower chi-squared by this."""
LONGEST_GAP = 0.35
"""A track that is lost for longer ends and begins anew, s."""
STRAY_SIGMA = 6.0
"""A frame this many standard deviations off its neighbours' path, and a whole step of theirs, is no bend."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Bends:
    """Where a track bends, begins or ends, in order of time."""

    times: Float[np.ndarray, " bends"]
    """Capture times, s."""
    time_std: Float[np.ndarray, " bends"]
    """Standard deviation of the time, s."""
    gain: Float[np.ndarray, " bends"]
    """By how much chi-squared falls if the path may bend there; inf at the ends of a run of frames."""

    def __post_init__(self) -> None:
        """Keep read-only copies."""
        for name in ("times", "time_std", "gain"):
            object.__setattr__(self, name, frozen(getattr(self, name)))


def find_bends(
    times: Float[np.ndarray, " frames"],
    pixels: Float[np.ndarray, "frames 2"],
    sigma_px: Float[np.ndarray, " frames"],
    *,
    most_per_s: float,
) -> Bends:
    """Where the path of measured frames bends, begins or ends; times rise strictly.

    At most so many bends a second of track, the sharpest ones.
    """
    if not len(times):
        return Bends(times=np.zeros(0), time_std=np.zeros(0), gain=np.zeros(0))
    step = float(np.median(np.diff(times))) if len(times) > 1 else 1.0
    broken = np.diff(times) > max(LONGEST_GAP, 1.5 * step)
    ends = np.unique(np.concatenate([times[[0, -1]], times[:-1][broken], times[1:][broken]]))
    kept = np.flatnonzero(~_strays(times, pixels, sigma_px))
    at, spread, gain = np.zeros(0), np.zeros(0), np.zeros(0)
    for windows in WINDOWS:
        sides = windows[-1][0]
        if sides * step > LONGEST_WINDOW and windows is not WINDOWS[0]:
            continue
        apart = max(1.5, 0.4 * sides if windows is not WINDOWS[0] else 0.0) * step
        tried = [_bend_gains(times[kept], pixels[kept], sigma_px[kept], step, window) for window in windows]
        best = np.array([gains for _, _, gains in tried]).argmax(axis=0)
        place, doubt, won = (np.choose(best, values) for values in zip(*tried, strict=True))
        found = _sharpest(place, doubt, won, apart)
        # What a shorter window placed is placed better.
        new = np.abs(found[0][:, None] - at).min(axis=1, initial=np.inf) > apart
        at, spread, gain = (
            np.concatenate([old, more[new]]) for old, more in zip((at, spread, gain), found, strict=True)
        )
    allowed = max(4, int(most_per_s * (times[-1] - times[0])))
    best = np.sort(np.argsort(-gain, kind="stable")[:allowed])
    at, spread, gain = at[best], spread[best], gain[best]
    free = np.abs(at[:, None] - ends).min(axis=1, initial=np.inf) > 1.2 * step
    at = np.concatenate([at[free], ends])
    gain = np.concatenate([gain[free], np.full(len(ends), np.inf)])
    spread = np.concatenate([spread[free], np.full(len(ends), 0.3 * step)])
    order = np.argsort(at, kind="stable")
    at, gain, spread = at[order], gain[order], spread[order]
    inner = np.isfinite(gain)
    moved, doubt = _placed(times[kept], pixels[kept], sigma_px[kept], at, spread, step)
    at, spread = np.where(inner, moved, at), np.where(inner, doubt, spread)
    order = np.argsort(at, kind="stable")
    return Bends(times=at[order], time_std=spread[order], gain=gain[order])


def _placed(
    times: np.ndarray, pixels: np.ndarray, sigma_px: np.ndarray, at: np.ndarray, spread: np.ndarray, step: float
) -> tuple[np.ndarray, np.ndarray]:
    """Mean and standard deviation of each bend's time, over a grid, from the frames between its neighbours."""
    if len(times) < 4:
        return at, spread
    around = np.concatenate([[-np.inf], at, [np.inf]])
    low, high = around[:-2] + 0.3 * step, around[2:] - 0.3 * step
    middle = np.searchsorted(times, at)
    index = middle[:, None] + np.arange(-SIDES, SIDES)
    real = (index >= 0) & (index < len(times))
    index = np.clip(index, 0, len(times) - 1)
    t = times[index]
    real &= (t > low[:, None]) & (t < high[:, None]) & (np.abs(t - at[:, None]) < 2 * SIDES * step)
    reach = np.clip(2.5 * spread, 1.6 * step, 4.0 * step)
    tau = at[:, None] + np.linspace(-1, 1, 41) * reach[:, None]
    u = (t[:, None] - tau[..., None]) / (SIDES * step)
    basis = np.stack([np.ones_like(u), u, u**2, np.maximum(u, 0), np.maximum(u, 0) ** 2], axis=-1)
    weight = np.where(real, 1 / sigma_px[index], 0.0)[:, None]
    shown = np.where(real[..., None], pixels[index], np.nan)
    shown = shown - _mean(shown)[:, None]
    shown = np.where(real[..., None], shown, 0.0)
    wide = np.abs(shown).max(axis=(1, 2)) + 10.0
    # Paths are a little curved, no more: that keeps short sides from swinging.
    soft = np.stack([wide * 100, wide * 10, 0.4 * wide, wide * 10, 0.4 * wide], axis=-1)
    design = basis * weight[..., None]
    normal = np.swapaxes(design, -1, -2) @ design + np.maximum(soft**-2, 1e-9)[:, None, None, :] * np.eye(5)
    target = shown[:, None] * weight[..., None]
    right = np.swapaxes(design, -1, -2) @ target
    found = np.linalg.solve(normal, right)
    chi = np.sum(target**2, axis=(-1, -2)) - np.sum(found * right, axis=(-1, -2))
    inside = (tau > low[:, None]) & (tau < high[:, None])
    chi = np.where(inside, chi, np.inf)
    chance = np.exp(-0.5 * (chi - chi.min(axis=1, keepdims=True)) / DOUBTED)
    chance = np.where(np.isfinite(chance), chance, 0.0)
    total = chance.sum(axis=1)
    good = (total > 0) & (real.sum(axis=1) >= 4)
    total = np.where(good, total, 1.0)
    mean = np.sum(chance * tau, axis=1) / total
    spread_now = np.sqrt(np.sum(chance * (tau - mean[:, None]) ** 2, axis=1) / total)
    return np.where(good, mean, at), np.where(good, np.hypot(spread_now, 0.05 * step), spread)


def _mean(values: np.ndarray) -> np.ndarray:
    known = np.isfinite(values)
    return np.where(known, values, 0.0).sum(axis=1) / np.maximum(known.sum(axis=1), 1)


def _strays(times: np.ndarray, pixels: np.ndarray, sigma_px: np.ndarray) -> np.ndarray:
    """Frames far off the straight line between their neighbours, seen against the neighbours' own steps."""
    stray = np.zeros(len(times), dtype=bool)
    if len(times) < 5:
        return stray
    before, here, after = pixels[:-2], pixels[1:-1], pixels[2:]
    share = ((times[1:-1] - times[:-2]) / (times[2:] - times[:-2]))[:, None]
    off = np.linalg.norm(here - before - share * (after - before), axis=1)
    chord = np.linalg.norm(after - before, axis=1)
    stray[1:-1] = (off > STRAY_SIGMA * sigma_px[1:-1]) & (off > 1.2 * chord) & (off > 20 * sigma_px[1:-1])
    return stray


def _bend_gains(
    times: np.ndarray, pixels: np.ndarray, sigma_px: np.ndarray, step: float, window: tuple[int, int, int]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Best place of a bend in every gap between two frames, its standard deviation, and what chi-squared gains."""
    sides, smooth, added = window
    gaps = len(times) - 1
    if gaps < 3:
        return np.zeros(0), np.zeros(0), np.zeros(0)
    length = np.diff(times)
    tau = (times[:-1, None] + WITHIN * length[:, None]).ravel()
    gap = np.repeat(np.arange(gaps), len(WITHIN))
    index = gap[:, None] + np.arange(1 - sides, sides + 1)
    inside = (index >= 0) & (index < len(times))
    index = np.clip(index, 0, len(times) - 1)
    from_tau = times[index] - tau[:, None]
    inside &= np.abs(from_tau) < (sides + 2) * step + 0.5 * length[gap, None]
    weight = inside / sigma_px[index]
    enough = (inside[:, :sides].sum(axis=1) >= 2) & (inside[:, sides:].sum(axis=1) >= 2)
    enough &= inside.sum(axis=1) >= smooth + added
    u = from_tau / (sides * step)
    basis = np.stack([u**k for k in range(smooth + 1)] + [np.maximum(u, 0.0) ** (k + 1) for k in range(added)], axis=-1)
    wanted = (pixels[index] - pixels[gap][:, None]) * weight[..., None]
    design = basis * weight[..., None]
    without, _ = _left_over(design[..., : smooth + 1], wanted)
    with_bend, found = _left_over(design, wanted)
    # Each further parameter of two coordinates is expected to gain 2.
    gain = np.where(enough, without - with_bend - 2 * (added - 1), 0.0)
    jump = np.linalg.norm(found[:, smooth + 1], axis=-1) / (sides * step)
    best = gain.reshape(gaps, len(WITHIN)).argmax(axis=1)
    pick = np.arange(gaps) * len(WITHIN) + best
    with np.errstate(divide="ignore", invalid="ignore"):
        spread = 1.5 * sigma_px[:-1] / jump[pick]
    spread = np.clip(np.nan_to_num(spread, nan=np.inf), 0.1 * step, max(0.5, 0.08 * sides) * np.maximum(length, step))
    return tau[pick], spread, gain[pick]


def _left_over(design: np.ndarray, wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Chi-squared that a least-squares fit leaves, and its coefficients."""
    normal = np.swapaxes(design, -1, -2) @ design
    normal = normal + 1e-9 * np.eye(design.shape[-1])
    found = np.linalg.solve(normal, np.swapaxes(design, -1, -2) @ wanted)
    return np.sum((wanted - design @ found) ** 2, axis=(-1, -2)), found


def _sharpest(
    at: np.ndarray, spread: np.ndarray, gain: np.ndarray, apart: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Bends that gain enough and more than any other so near."""
    near = np.abs(at[:, None] - at) < apart
    peak = gain >= np.where(near, gain, -np.inf).max(axis=1, initial=-np.inf)
    keep = peak & (gain > LEAST_GAIN)
    return at[keep], spread[keep], gain[keep]
