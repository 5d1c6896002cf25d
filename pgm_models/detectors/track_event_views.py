"""Tracks as detectors give them of simulated balls: other cameras, and everything that goes wrong in a picture."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

BASELINE_M = 11.885
HALF_WIDTH_M = 5.485


@dataclass(frozen=True, eq=False, kw_only=True)
class PlayView:
    """A camera with a fixed centre that may turn after the ball."""

    size: tuple[int, int]
    """Width and height of the picture, px."""
    focal_px: float
    centre_world: Float[np.ndarray, " 3"]
    """Metres."""
    R_cam_from_world: Float[np.ndarray, "3 3"]
    follow: float
    """Share of the ball's angle from the picture's middle that the camera turns."""
    lag_s: float
    """Time over which the ball's angle is averaged."""

    def pixels(
        self, positions: Float[np.ndarray, "samples 3"], times: Float[np.ndarray, " samples"]
    ) -> Float[np.ndarray, "samples 2"]:
        """Where the points are seen; NaN where there is no point, or it is not in the picture."""
        away = positions - self.centre_world
        forward = self.R_cam_from_world[2]
        heading = np.arctan2(away[:, 0], away[:, 1]) - np.arctan2(forward[0], forward[1])
        turn = self.follow * _lagging(heading, times, self.lag_s)
        cos, sin = np.cos(turn), np.sin(turn)
        turned = np.stack(
            [cos * away[:, 0] - sin * away[:, 1], sin * away[:, 0] + cos * away[:, 1], away[:, 2]], axis=1
        )
        cam = turned @ self.R_cam_from_world.T
        depth = np.where(cam[:, 2] > 0.5, cam[:, 2], np.nan)
        pixels = self.focal_px * cam[:, :2] / depth[:, None] + (np.array(self.size) - 1) / 2
        inside = np.asarray(((pixels > -0.5) & (pixels < np.array(self.size) - 0.5)).all(axis=1))
        return np.where(inside[:, None], pixels, np.nan)


def _lagging(angles: np.ndarray, times: np.ndarray, lag_s: float) -> np.ndarray:
    """The angles averaged over that time before, holes bridged; 0 where none is known."""
    known = np.isfinite(angles)
    if known.sum() < 2:
        return np.zeros_like(angles)
    knots = np.arange(times[0] - 3 * lag_s, times[-1] + 0.1, 0.05)
    course = np.interp(knots, times[known], angles[known])
    reach = np.arange(0.0, 3 * lag_s, 0.05)
    weights = reach * np.exp(-reach / (0.5 * lag_s))
    smooth = np.convolve(np.pad(course, (len(reach), 0), mode="edge"), weights / weights.sum())
    return np.interp(times, knots, smooth[len(reach) : len(reach) + len(knots)])


def draw_view(rng: np.random.Generator) -> PlayView:
    """A camera by lot: mostly high behind one end, as broadcasts have it; else low, high or off the axis."""
    size = (1920, int(rng.choice([1080, 1080, 1080, 1080, 1440, 820])))
    centre = np.array([rng.normal(0, 0.8), -rng.uniform(22.0, 55.0), rng.uniform(5.0, 16.0)])
    aim = np.array([rng.normal(0, 1.0), rng.uniform(-5.0, 2.0), rng.uniform(-0.5, 1.5)])
    kind = rng.random()
    if kind < 0.08:
        centre = np.array([rng.uniform(-4, 4), -rng.uniform(15.0, 34.0), rng.uniform(2.0, 5.0)])
    elif kind < 0.16:
        centre[1:] = -rng.uniform(16.0, 45.0), rng.uniform(14.0, 28.0)
    elif kind < 0.24:
        centre[0] = rng.uniform(-12.0, 12.0)
    forward = aim - centre
    R = _rotation(forward / np.linalg.norm(forward), float(np.radians(rng.normal(0, 0.4))))
    near = (np.array([[-HALF_WIDTH_M, -BASELINE_M, 0.0], [HALF_WIDTH_M, -BASELINE_M, 0.0]]) - centre) @ R.T
    across = abs(near[1, 0] / near[1, 2] - near[0, 0] / near[0, 2])
    focal = float(np.clip(rng.uniform(0.5, 1.05) * size[0] / across, 0.4 * size[0], 6.0 * size[0]))
    follow = float(rng.uniform(0.1, 0.6)) if rng.random() < 0.4 else 0.0
    return PlayView(
        size=size,
        focal_px=focal,
        centre_world=centre,
        R_cam_from_world=R,
        follow=follow,
        lag_s=float(rng.uniform(0.3, 0.9)),
    )


def _rotation(forward: np.ndarray, roll: float) -> np.ndarray:
    """Axes of a camera that looks along `forward`, rolled clockwise: its x, y and z as rows."""
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    down = np.cross(forward, right)
    cos, sin = np.cos(roll), np.sin(roll)
    return np.stack([cos * right + sin * down, cos * down - sin * right, forward])


def draw_rate(rng: np.random.Generator) -> float:
    """Frames per second by lot: the usual ones mostly, some between, few very low or high."""
    kind = rng.random()
    if kind < 0.7:
        return float(rng.choice([24.0, 25.0, 25.0, 30.0, 50.0, 50.0, 60.0]))
    if kind < 0.85:
        return float(rng.uniform(20.0, 60.0))
    return float(rng.uniform(10.0, 20.0)) if kind < 0.92 else float(rng.uniform(60.0, 240.0))


def hide_spells(rng: np.random.Generator, times: Float[np.ndarray, " samples"]) -> Bool[np.ndarray, " samples"]:
    """Samples that a detector misses: single ones and bursts, more or less by lot."""
    hidden = np.zeros(len(times), dtype=bool)
    if rng.random() < 0.8:
        hidden |= rng.random(len(times)) < rng.uniform(0.0, 0.25)
    length = times[-1] - times[0]
    starts = times[0] + length * rng.random(rng.poisson(rng.uniform(0.0, 0.6) * length))
    for start in starts:
        hidden |= (times >= start) & (times < start + rng.uniform(0.04, 0.45))
    return hidden


def hide_contacts(
    rng: np.random.Generator, times: Float[np.ndarray, " samples"], hits: Float[np.ndarray, " hits"]
) -> Bool[np.ndarray, " samples"]:
    """Samples in which a body or racket hides the ball round some of these times."""
    share, longest = rng.uniform(0.0, 0.8), rng.uniform(0.05, 0.4)
    chosen = hits[rng.random(len(hits)) < share]
    before, after = longest * rng.random((2, len(chosen)))
    return ((times[:, None] > chosen - before) & (times[:, None] < chosen + after)).any(axis=1)


def detected(
    rng: np.random.Generator,
    times: Float[np.ndarray, " samples"],
    pixels: Float[np.ndarray, "samples 2"],
    size: tuple[int, int],
) -> Float[np.ndarray, "samples 2"]:
    """Pixels as a detector gives them: noise, false places, and at times holes drawn over, smoothed, whole pixels."""
    unit = size[0] / 1920
    sigma = unit * np.exp(rng.uniform(np.log(0.3), np.log(3.0)))
    seen = pixels + sigma * rng.standard_normal(pixels.shape)
    if rng.random() < 0.2:
        seen = _drawn_over(times, seen, rng.uniform(0.08, 0.5))
    if rng.random() < 0.15:
        padded = np.pad(seen, ((1, 1), (0, 0)), mode="edge")
        mean = (padded[:-2] + padded[1:-1] + padded[2:]) / 3
        seen = np.where(np.isfinite(mean), mean, seen)
    if rng.random() < 0.7:
        seen = _with_false_places(rng, times, seen, size)
    return np.round(seen) if rng.random() < 0.4 else seen


def _drawn_over(times: np.ndarray, pixels: np.ndarray, longest_s: float) -> np.ndarray:
    """Holes up to that length filled straight, as some trackers do."""
    known = np.flatnonzero(np.isfinite(pixels[:, 0]))
    if len(known) < 2:
        return pixels
    after = np.clip(np.searchsorted(known, np.arange(len(times))), 1, len(known) - 1)
    short = (times[known[after]] - times[known[after - 1]]) <= longest_s
    short &= (np.arange(len(times)) >= known[0]) & (np.arange(len(times)) <= known[-1])
    filled = np.stack([np.interp(times, times[known], pixels[known, i]) for i in (0, 1)], axis=1)
    return np.where(short[:, None], filled, pixels)


def _with_false_places(
    rng: np.random.Generator, times: np.ndarray, pixels: np.ndarray, size: tuple[int, int]
) -> np.ndarray:
    """Some places exchanged: single ones anywhere, and spells of something else that stands or moves a little."""
    seen = pixels.copy()
    bounds = np.array(size) - 1.0
    single = rng.random(len(times)) < rng.choice([0.0, 0.005, 0.03])
    seen[single] = rng.random((int(single.sum()), 2)) * bounds
    length = times[-1] - times[0]
    for _ in range(rng.poisson(rng.uniform(0.0, 0.5) * length)):
        start, lasts = times[0] + length * rng.random(), rng.uniform(0.04, 1.0)
        spell = (times >= start) & (times < start + lasts)
        only_holes = rng.random() < 0.75
        if only_holes:
            spell &= ~np.isfinite(seen[:, 0])
        drift = rng.normal(0, 40.0, 2) * rng.choice([0.0, 1.0, 4.0])
        other = rng.random(2) * bounds + drift * (times[:, None] - start)
        seen[spell] = (other + rng.normal(0, 1.0, (len(times), 2)))[spell]
    return seen
