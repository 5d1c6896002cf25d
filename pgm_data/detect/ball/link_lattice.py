"""Candidates laid out for linking: in one camera's picture, with how often something is seen where each lies.

The LATTICE has a row for each distinct picture and a slot for each candidate. Its pixels are those of the first
picture's camera, so that a ball's path is smooth where the camera turns.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from pgm_data.detect.ball.candidates import BallCandidates

FINE_PX = 8.0
"""Side of the squares in which what stands still is counted, for a picture 720 px high."""
COARSE_PX = 24.0
"""Side of the squares in which what moves about, such as a player, is counted, for a picture 720 px high."""
BIN_S = 0.5
"""Time over which candidates are counted together, s; each bin sees its neighbours as well."""
FURTHEST = 1e3
"""Places further outside than this many times the picture's size are taken for none."""
LEAST_SCORE = 1e-3
"""Scores are kept this far from 0 and 1."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Lattice:
    """Candidates of the distinct pictures, in the first one's pixels; empty slots have `has` false and values of 0."""

    rows: Int[np.ndarray, " pictures"]
    """Frame of each distinct picture."""
    times: Float[np.ndarray, " pictures"]
    has: Bool[np.ndarray, "pictures slots"]
    points: Float[np.ndarray, "pictures slots 2"]
    variance: Float[np.ndarray, "pictures slots"]
    """Of each coordinate, px^2."""
    streaks: Float[np.ndarray, "pictures slots 2"]
    """0 where not seen."""
    log_odds: Float[np.ndarray, "pictures slots"]
    """Of being the ball, by the finder's score."""
    log_clutter: Float[np.ndarray, "pictures slots"]
    """Logarithm of how many candidates a picture has per px^2 around this one."""
    scale: Float[np.ndarray, "pictures slots"]
    """Pixels here per pixel of the candidate's own picture."""
    frame_s: float
    """Usual time between distinct pictures, s."""


def lattice_of(
    candidates: BallCandidates,
    *,
    times: Float[np.ndarray, " frames"],
    is_duplicate: Bool[np.ndarray, " frames"],
    size: tuple[int, int],
    here_from_previous: Float[np.ndarray, "frames 3 3"] | None,
) -> Lattice:
    """The lattice of a clip's candidates; those that are not finite are left out."""
    rows = np.flatnonzero(~is_duplicate)
    far = FURTHEST * max(size)
    sigma, score, streak = candidates.sigma_px[rows], candidates.score[rows], candidates.streak_px[rows]
    has = (np.abs(candidates.pixels[rows]) < far).all(axis=-1) & (sigma > 0) & (sigma < far) & np.isfinite(score)
    pixels = np.where(has[..., None], candidates.pixels[rows], 0.0)
    streak = np.where(has[..., None] & (np.abs(streak) < far), streak, 0.0)
    points, derivative = _in_first_picture(pixels, here_from_previous, rows)
    scale = np.sqrt(np.abs(np.linalg.det(derivative)))
    has &= (np.abs(points) < far).all(axis=-1) & (scale > 1 / FURTHEST) & (scale < FURTHEST)
    points, sigma = np.where(has[..., None], points, 0.0), np.where(has, sigma, 1.0)
    scale = np.where(has, scale, 1.0)
    streaks = np.einsum("fkij,fkj->fki", np.where(has[..., None, None], derivative, 0.0), streak)
    score = np.clip(np.where(has, score, LEAST_SCORE), LEAST_SCORE, 1 - LEAST_SCORE)
    taken = times[rows]
    steps = np.diff(taken)
    steps = steps[steps > 0]
    return Lattice(
        rows=rows,
        times=taken,
        has=has,
        points=points,
        variance=np.maximum((sigma * scale) ** 2, 1e-6),
        streaks=streaks,
        log_odds=np.log(score / (1 - score)),
        log_clutter=_log_clutter(points, has, taken, size),
        scale=scale,
        frame_s=float(np.median(steps)) if len(steps) else 1.0,
    )


def _in_first_picture(
    pixels: np.ndarray, here_from_previous: np.ndarray | None, rows: np.ndarray
) -> tuple[Float[np.ndarray, "pictures slots 2"], Float[np.ndarray, "pictures slots 2 2"]]:
    """The pixels as the first picture's camera would show them, and the derivative of that by the pixel."""
    if here_from_previous is None:
        return pixels, np.broadcast_to(np.eye(2), (*pixels.shape, 2))
    first_from_here = np.empty_like(here_from_previous)
    so_far = np.eye(3)
    for frame, step in enumerate(here_from_previous):
        if frame and (np.abs(step) < 1e9).all() and np.linalg.cond(step) < 1e12:
            so_far = so_far @ np.linalg.inv(step)
            so_far = so_far / np.abs(so_far).max()
        first_from_here[frame] = so_far
    matrix = first_from_here[rows][:, None]
    depth = np.einsum("fkj,fkj->fk", matrix[..., 2, :2], pixels) + matrix[..., 2, 2]
    # A pixel that turns behind the first picture's camera has no place there.
    before = depth * np.sign(matrix[..., 2, 2]) > 1e-9
    depth = np.where(before, depth, 1.0)[..., None]
    points = (np.einsum("fkij,fkj->fki", matrix[..., :2, :2], pixels) + matrix[..., :2, 2]) / depth
    derivative = (matrix[..., :2, :2] - points[..., :, None] * matrix[..., 2, None, :2]) / depth[..., None]
    points = np.where(before[..., None], points, np.inf)
    return points, derivative


def _log_clutter(
    points: np.ndarray, has: np.ndarray, times: np.ndarray, size: tuple[int, int]
) -> Float[np.ndarray, "pictures slots"]:
    """Logarithm of the candidates per picture and px^2 around each, of two ways to count the larger."""
    least = 1.0 / (size[0] * size[1])
    density = np.full(has.shape, least)
    picture, slot = np.nonzero(has)
    if len(picture):
        places = points[picture, slot]
        bins = np.floor((times - times[0]) / BIN_S).astype(np.int64)
        pictures = np.bincount(bins, minlength=bins[-1] + 1).astype(np.float64)
        pictures = (
            np.convolve(pictures, np.ones(3), "same") if len(pictures) > 2 else np.full_like(pictures, pictures.sum())
        )
        for side in (FINE_PX, COARSE_PX):
            cell = side * size[1] / 720
            seen = _seen_around(places, bins[picture], cell)
            found = seen / (pictures[bins[picture]] * (3 * cell) ** 2)
            density[picture, slot] = np.maximum(density[picture, slot], found)
    return np.log(density)


def _seen_around(places: np.ndarray, bins: np.ndarray, cell: float) -> Float[np.ndarray, " places"]:
    """How many places lie in the 3 x 3 squares around each one's, in its time bin and the two beside it."""
    squares = np.floor(places / cell).astype(np.int64)
    keys = np.column_stack([bins, squares])
    keys -= keys.min(axis=0) - 1
    span = keys.max(axis=0) + 2
    flat = (keys[:, 0] * span[1] + keys[:, 1]) * span[2] + keys[:, 2]
    filled, count = np.unique(flat, return_counts=True)
    steps = np.stack(np.meshgrid(*[[-1, 0, 1]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    beside = flat[:, None] + ((steps[:, 0] * span[1] + steps[:, 1]) * span[2] + steps[:, 2])
    at = np.minimum(np.searchsorted(filled, beside), len(filled) - 1)
    return np.where(filled[at] == beside, count[at], 0).sum(axis=1).astype(np.float64)
