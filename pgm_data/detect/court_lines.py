"""A guess of where the court lies, from its painted lines alone and without any trained weights.

Bright ridges are chained into straight lines (`line_segments`), every plausible way to lay the court onto them is
tried (`court_hypotheses`), and each is scored by how much of the projected court has a ridge of the same direction
under it. The best few are fitted to the ridges and scored again, strictly. It is a second opinion: whoever takes a
guess verifies it.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from pgm_data.court import Court
from pgm_data.detect.court_evidence import LineEvidence, LineMarks, line_marks, marks_beyond_ends, projected
from pgm_data.detect.court_hypotheses import (
    Frame,
    camera_position,
    court_grid,
    court_hypotheses,
    focal_and_skewness,
    plausible,
)
from pgm_data.detect.line_segments import (
    RidgePoints,
    direction_bin,
    long_lines,
    straight_ridges,
    support_maps,
)
from pgm_data.geometry.arrays import frozen


@dataclass(frozen=True, eq=False, kw_only=True)
class LineGuessOptions:
    """How the court is guessed from lines."""

    working_size: int = 960
    """Longer side of the picture that is searched, pixels; smaller pictures are not enlarged."""
    contrast: float = 1.0
    """Least brightness of a line against its surroundings, grey levels of curvature at a blur of one pixel."""
    lines: int = 40
    """Most picture lines considered."""
    hypotheses: int = 50_000
    """Most layings of the court onto picture lines scored."""
    skewness: float = 0.12
    """Most departure from square pixels that a hypothesis may show, as a share."""
    refined: int = 16
    """Hypotheses fitted to the ridges."""
    guesses: int = 5
    """Most guesses returned."""
    least_score: float = 0.4
    """Guesses below it are not returned."""


@dataclass(frozen=True, eq=False, kw_only=True)
class CourtGuesses:
    """Where the court may lie, best first; empty where nothing is convincing."""

    pixel_from_ground: Float[np.ndarray, "guesses 3 3"]
    """Homographies from (x, y, 1) on the ground, metres, to pixels of the full picture, of a camera on the near side;
    the denominator is positive in front of the camera and the bottom right entry is 1."""
    scores: Float[np.ndarray, " guesses"]
    """From 0 to 1; not a probability."""

    def __post_init__(self) -> None:
        """Keep read-only copies."""
        object.__setattr__(self, "pixel_from_ground", frozen(self.pixel_from_ground))
        object.__setattr__(self, "scores", frozen(self.scores))


def guess_homographies(
    luma: UInt8[np.ndarray, "height width"], court: Court, options: LineGuessOptions
) -> CourtGuesses:
    """The few likeliest homographies of the court's ground in a picture."""
    none = CourtGuesses(pixel_from_ground=np.zeros((0, 3, 3)), scores=np.zeros(0))
    grid = court_grid(court)
    work, pixel_from_work = _shrunk(luma, options.working_size)
    if min(work.shape) < 16 or len(grid.x) < 2 or len(grid.y) < 2:
        return none
    frame = Frame(width=work.shape[1], height=work.shape[0])
    size = max(work.shape)
    ridges = straight_ridges(work, contrast=options.contrast, chain=max(6.0, size / 80))
    lines = long_lines(ridges, shortest=max(12.0, size / 32), most=options.lines)
    H = court_hypotheses(lines, frame, court, skewness=options.skewness, most=options.hypotheses)
    if len(H) == 0:
        return none
    marks = line_marks(court, 120)
    H = _promising(H, marks, ridges, frame, options.refined)
    beyond = marks_beyond_ends(court, 8)
    evidence = LineEvidence(ridges, frame)
    H = np.stack([evidence.fitted(h, marks) for h in H])
    H = H[np.isfinite(H).all(axis=(1, 2))]
    H = H[plausible(H, court, skewness=2 * options.skewness)]
    if grid.turns_onto_itself:
        H = _from_near_side(H)
    # Many hypotheses end on the same ridges; the strict score is for what is left of them.
    H = H[_distinct(H, np.array([evidence.support(h, marks, beyond).total for h in H]), court)[: 2 * options.guesses]]
    scores = np.array([evidence.score(h, court, marks, beyond) for h in H])
    keep = [k for k in np.argsort(-scores, kind="stable") if scores[k] >= options.least_score][: options.guesses]
    H = pixel_from_work @ frame.pixel_from_unit @ H[keep]
    return CourtGuesses(pixel_from_ground=H / H[:, 2:, 2:], scores=scores[keep])


def _shrunk(luma: np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray]:
    height, width = luma.shape
    scale = min(1.0, size / max(height, width))
    shape = (max(1, round(width * scale)), max(1, round(height * scale)))
    work = luma if scale == 1.0 else cv2.resize(luma, shape, interpolation=cv2.INTER_AREA)
    sx, sy = width / shape[0], height / shape[1]
    # Pixel centres are whole numbers, so the picture's corner is at -0.5 at either size.
    return work, np.array([[sx, 0.0, (sx - 1) / 2], [0.0, sy, (sy - 1) / 2], [0.0, 0.0, 1.0]])


def _promising(H: np.ndarray, marks: LineMarks, ridges: RidgePoints, frame: Frame, count: int) -> np.ndarray:
    """The hypotheses, nearly equal ones once, with the most ridge under their lines, on the half-size picture."""
    half = ridges.scaled(0.5)
    shape = (frame.height // 2 + 1, frame.width // 2 + 1)
    near = support_maps(half, shape, reach=1.5)
    T = np.diag([0.5, 0.5, 1.0]) @ frame.pixel_from_unit
    order = np.arange(len(H))
    # Most hypotheses are hopeless, which a few marks show.
    for step, left in ((6, 200 * count), (2, 40 * count), (1, 40 * count)):
        parts = [H[order[i : i + 4096]] for i in range(0, len(order), 4096)]
        scores = np.concatenate([_coarse_scores(T @ part, marks, near, step) for part in parts])
        order = order[np.argsort(-scores, kind="stable")[:left]]
    xy, _ = projected(T @ H[order], marks)
    chosen: list[int] = []
    for k in range(len(order)):
        if len(chosen) == count:
            break
        # Two hypotheses within a few pixels of each other are fitted to the same ridges.
        if all(np.abs(xy[k] - xy[c]).mean() > 2.5 for c in chosen):
            chosen.append(k)
    return H[order[chosen]]


def _coarse_scores(H: np.ndarray, marks: LineMarks, near: np.ndarray, step: int) -> np.ndarray:
    """Mean closeness to a ridge over the visible marks; hypotheses that show less than 60 % of the court lose."""
    first = np.concatenate([[0], np.flatnonzero(np.diff(marks.line)) + 1])
    middle = LineMarks(ground=marks.ground[first], along=marks.along[first], line=first, width=marks.width[first])
    _, d = projected(H, middle)
    bins = direction_bin(np.arctan2(d[..., 1], d[..., 0]))[:, marks.line[::step]]
    p = marks.ground[::step].astype(np.float32) @ np.swapaxes(H, -1, -2).astype(np.float32)
    height, width = near.shape[1:]
    with np.errstate(divide="ignore", invalid="ignore"):
        x, y = p[..., 0] / p[..., 2], p[..., 1] / p[..., 2]
    seen = (x > 0) & (x < width - 1) & (y > 0) & (y < height - 1)
    column, row = np.where(seen, x, 0).astype(np.int64), np.where(seen, y, 0).astype(np.int64)
    value = near.ravel()[(bins * height + row) * width + column] * seen
    return value.sum(axis=1) / 255.0 / np.maximum(seen.sum(axis=1), 0.6 * p.shape[1])


def _distinct(H: np.ndarray, scores: np.ndarray, court: Court) -> list[int]:
    """Indices in falling score, without those that nearly repeat a better one."""
    chosen: list[int] = []
    p = np.column_stack([court.points_world[:, :2], np.ones(len(court.points_world))]) @ np.swapaxes(H, -1, -2)
    xy = p[..., :2] / p[..., 2:]
    for k in np.argsort(-scores, kind="stable"):
        if all(np.abs(xy[k] - xy[c]).mean() > 0.005 for c in chosen):
            chosen.append(int(k))
    return chosen


def _from_near_side(H: np.ndarray) -> np.ndarray:
    """The homographies, turned by half a turn of the court where their camera is beyond the net."""
    focal, _ = focal_and_skewness(H[:, :, 0], H[:, :, 1])
    beyond = camera_position(H, focal)[:, 1] > 0
    return np.where(beyond[:, None, None], H * np.array([-1.0, -1.0, 1.0]), H)
