"""Every plausible way to lay the two directions of a court's lines onto lines of a picture.

Two picture lines that meet in one vanishing point and two that meet in another bound a quadrangle. Taken for two
known lines along and two across the court, it gives a homography. Those that no camera above the ground with square
pixels could take are dropped in closed form, before any pixel is looked at.
"""

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from jaxtyping import Bool, Float, Int

from pgm_data.court import Court
from pgm_data.detect.line_segments import LongLines
from pgm_data.geometry.arrays import frozen


@dataclass(frozen=True, eq=False, kw_only=True)
class CourtGrid:
    """Where a court's lines lie along x and along y."""

    x: Float[np.ndarray, " columns"]
    """Positions of the lines that run along y, metres, rising."""
    y: Float[np.ndarray, " rows"]
    """Positions of the lines that run along x, metres, rising."""
    turns_onto_itself: bool
    """Whether half a turn about the origin maps the lines onto themselves."""

    def __post_init__(self) -> None:
        """Keep read-only copies."""
        object.__setattr__(self, "x", frozen(self.x))
        object.__setattr__(self, "y", frozen(self.y))


def court_grid(court: Court) -> CourtGrid:
    """The grid of the court's axis-aligned ground lines."""
    ends = court.lines_world[:, :, :2]
    run = np.abs(ends[:, 1] - ends[:, 0])
    ends_list = np.sort(np.round(ends, 6), axis=1)
    turned = np.sort(np.round(-ends, 6), axis=1)
    same = {e.tobytes() for e in ends_list + 0.0} == {e.tobytes() for e in turned + 0.0}
    return CourtGrid(
        x=np.unique(np.round(ends[run[:, 0] < 1e-6][:, 0, 0], 6)),
        y=np.unique(np.round(ends[run[:, 1] < 1e-6][:, 0, 1], 6)),
        turns_onto_itself=same,
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class Frame:
    """Size of a picture, and its coordinates centred and divided by its longer side."""

    width: int
    height: int

    @property
    def pixel_from_unit(self) -> Float[np.ndarray, "3 3"]:
        """Pixels from centred coordinates."""
        s = float(max(self.width, self.height))
        return np.array([[s, 0.0, (self.width - 1) / 2], [0.0, s, (self.height - 1) / 2], [0.0, 0.0, 1.0]])


FOCAL_RANGE = (0.4, 6.0)
"""Focal lengths taken for possible, in longer sides of the picture: about 100 to 10 degrees."""


def vanishing_families(lines: LongLines, frame: Frame, *, most: int) -> list[Int[np.ndarray, " members"]]:
    """Indices of lines that share a vanishing point, for the `most` best points, each in falling support."""
    n = len(lines.line)
    if n < 2:
        return []
    T = frame.pixel_from_unit
    line = lines.line @ T
    middle = (lines.middle - T[:2, 2]) / T[0, 0]
    i, j = np.triu_indices(n, 1)
    points = np.cross(line[i], line[j])
    points /= np.linalg.norm(points, axis=1, keepdims=True) + 1e-300
    towards = points[:, None, :2] - points[:, None, 2:] * middle
    sine = np.abs(towards[..., 0] * lines.direction[:, 1] - towards[..., 1] * lines.direction[:, 0])
    sine /= np.linalg.norm(towards, axis=2) + 1e-300
    # One long line, such as the edge of a banner, must not outvote several court lines.
    weight = np.minimum(lines.support / T[0, 0], 0.35)
    families = []
    fit = np.clip(1.0 - sine / np.sin(np.deg2rad(2.0)), 0.0, None)
    for _ in range(most):
        best = int(np.argmax(fit @ weight))
        members = np.flatnonzero(sine[best] < np.sin(np.deg2rad(2.0)))
        if len(members) < 2:
            break
        families.append(members[np.argsort(-lines.support[members], kind="stable")])
        weight[sine[best] < np.sin(np.deg2rad(1.5))] *= 0.1
    return families


def quadrangles(
    across: Float[np.ndarray, "rows 3"], along: Float[np.ndarray, "columns 3"]
) -> tuple[Float[np.ndarray, "quads 3 3"], Int[np.ndarray, "quads 4"]]:
    """Homographies from the unit square to the quadrangles of two lines `across` and two `along`.

    The square's u axis runs along the `across` lines, and v follows u anticlockwise, as on ground seen from above.
    Only quadrangles wholly in front of the camera are returned, with the indices of their lines (v = 0, v = 1,
    u = 0, u = 1).
    """
    rows = np.array(list(combinations(range(len(across)), 2))).reshape(-1, 2)
    columns = np.array(list(combinations(range(len(along)), 2))).reshape(-1, 2)
    if len(rows) == 0 or len(columns) == 0:
        return np.zeros((0, 3, 3)), np.zeros((0, 4), int)
    corner = np.cross(across[:, None], along[None])
    with np.errstate(divide="ignore", invalid="ignore"):
        corner = corner[..., :2] / corner[..., 2:]
    r, c = (v.ravel() for v in np.meshgrid(np.arange(len(rows)), np.arange(len(columns)), indexing="ij"))
    index = np.concatenate([rows[r], columns[c]], axis=1)
    corners = np.stack([corner[index[:, a], index[:, b]] for a, b in ((0, 2), (0, 3), (1, 3), (1, 2))])
    near = np.isfinite(corners).all(axis=(0, 2)) & (np.abs(np.nan_to_num(corners)).max(axis=(0, 2)) < 3.0)
    index = index[near]
    p0, p1, p2, p3 = corners[:, near]
    area = _cross(p2 - p0, p3 - p1) / 2
    # From above the square's corners run anticlockwise, which is a negative area where y points down.
    swap = area > 0
    index[swap] = index[swap][:, [1, 0, 2, 3]]
    p0, p1, p2, p3 = (np.where(swap[:, None], b, a) for a, b in ((p0, p3), (p1, p2), (p2, p1), (p3, p0)))
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        d1, d2, d3 = p1 - p2, p3 - p2, p0 - p1 + p2 - p3
        det = _cross(d1, d2)
        g, h = _cross(d3, d2) / det, _cross(d1, d3) / det
        Q = np.empty((len(index), 3, 3))
        Q[:, :2, 0], Q[:, 2, 0] = p1 - p0 + g[:, None] * p1, g
        Q[:, :2, 1], Q[:, 2, 1] = p3 - p0 + h[:, None] * p3, h
        Q[:, :2, 2], Q[:, 2, 2] = p0, 1.0
        depth = np.minimum(np.minimum(1 + g, 1 + h), 1 + g + h)
    ok = np.isfinite(Q).all(axis=(1, 2)) & (depth > 0.02) & (np.abs(area) > 5e-4)
    return Q[ok], index[ok]


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def focal_and_skewness(
    h1: Float[np.ndarray, "hypotheses 3"], h2: Float[np.ndarray, "hypotheses 3"]
) -> tuple[Float[np.ndarray, " hypotheses"], Float[np.ndarray, " hypotheses"]]:
    """Focal length that best makes the first two columns of a homography orthogonal and equally long, and what is left.

    In the columns' unit, the principal point at the origin. Both conditions are the two parts of one complex
    equation, so they are solved by least squares and a view along one axis, where orthogonality alone says nothing,
    needs no special case. A view from straight above leaves the focal length free; the range's nearest end is taken.
    """
    a1, a2 = h1[..., 0] ** 2 + h1[..., 1] ** 2, h2[..., 0] ** 2 + h2[..., 1] ** 2
    c1, c2 = h1[..., 2] ** 2, h2[..., 2] ** 2
    n0, n1 = c1 - c2, 2 * h1[..., 2] * h2[..., 2]
    m0, m1 = a2 - a1, -2 * (h1[..., 0] * h2[..., 0] + h1[..., 1] * h2[..., 1])
    squared = (n0 * m0 + n1 * m1) / (n0 * n0 + n1 * n1 + 1e-12)
    squared = np.clip(squared, FOCAL_RANGE[0] ** 2, FOCAL_RANGE[1] ** 2)
    left = np.hypot(squared * n0 - m0, squared * n1 - m1) / (a1 + a2 + squared * (c1 + c2) + 1e-300)
    return np.sqrt(squared), left


def camera_position(
    H: Float[np.ndarray, "hypotheses 3 3"], focal: Float[np.ndarray, " hypotheses"]
) -> Float[np.ndarray, "hypotheses 3"]:
    """Camera centre in the world, metres, of homographies into centred coordinates."""
    M = H.copy()
    M[..., :2, :] /= focal[..., None, None]
    scale = 2.0 / (np.linalg.norm(M[..., 0], axis=-1) + np.linalg.norm(M[..., 1], axis=-1))
    M *= scale[..., None, None]
    r3 = np.cross(M[..., 0], M[..., 1])
    R = np.stack([M[..., 0], M[..., 1], r3], axis=-1)
    return -np.einsum("...ij,...i->...j", R, M[..., 2])


def plausible(
    H: Float[np.ndarray, "hypotheses 3 3"], court: Court, *, skewness: float
) -> Bool[np.ndarray, " hypotheses"]:
    """Whether a camera with square pixels above the ground could see the court so; H into centred coordinates."""
    low, high = court.points_world[:, :2].min(axis=0), court.points_world[:, :2].max(axis=0)
    corners = np.array([[low[0], low[1], 1], [high[0], low[1], 1], [high[0], high[1], 1], [low[0], high[1], 1]])
    with np.errstate(divide="ignore", invalid="ignore"):
        x, y, w = (corners @ H[:, i].T for i in range(3))
        x, y = x / w, y / w
        reach = np.maximum(np.ptp(x, axis=0), np.ptp(y, axis=0))
        ok = (w.min(axis=0) > 0) & (reach > 0.15) & (reach < 4.0)
        ok &= np.maximum(np.abs(x).max(axis=0), np.abs(y).max(axis=0)) < 3.0
    left_over = np.flatnonzero(ok)
    focal, left = focal_and_skewness(H[left_over, :, 0], H[left_over, :, 1])
    position = camera_position(H[left_over], focal) / (high - low).max()
    distance = np.hypot(position[:, 0], position[:, 1])
    ok[left_over] = (left < skewness) & (position[:, 2] > 0.03) & (position[:, 2] < 5.0) & (distance < 8.0)
    return ok


def court_hypotheses(
    lines: LongLines, frame: Frame, court: Court, *, skewness: float, most: int
) -> Float[np.ndarray, "hypotheses 3 3"]:
    """Plausible homographies from ground metres to centred coordinates, at most about `most`.

    Where there are more, those on the longest picture lines are kept.
    """
    grid = court_grid(court)
    families = vanishing_families(lines, frame, most=4)
    T = frame.pixel_from_unit
    line = lines.line @ T
    line /= np.linalg.norm(line[:, :2], axis=1, keepdims=True)
    found, weights = [], []
    pairs = [(a, b) for a, b in combinations(range(len(families)), 2) if a + b <= 3]
    for a, b in [*pairs, *((b, a) for a, b in pairs)]:
        across, along = families[a][:14], families[b][:14]
        Q, index = quadrangles(line[across], line[along])
        support = lines.support[across][index[:, :2]].sum(axis=1) + lines.support[along][index[:, 2:]].sum(axis=1)
        H, quad = _assignments(Q, grid, skewness)
        found.append(H)
        weights.append(support[quad])
    if not found:
        return np.zeros((0, 3, 3))
    weight = np.concatenate(weights)
    H = np.concatenate(found)
    if len(H) > most:
        H = H[np.argpartition(-weight, most)[:most]]
    return H[plausible(H, court, skewness=skewness)]


def _assignments(Q: np.ndarray, grid: CourtGrid, skewness: float) -> tuple[np.ndarray, np.ndarray]:
    """Homographies of each quadrangle taken for each cell of the grid, and their quadrangles."""
    found, quads = [np.zeros((0, 3, 3))], [np.zeros(0, int)]
    columns = list(combinations(grid.x, 2))
    rows = list(combinations(grid.y, 2))
    sides = (1.0,) if grid.turns_onto_itself else (1.0, -1.0)
    spans_x = np.unique(np.round([b - a for a, b in columns], 6))
    spans_y = np.unique(np.round([b - a for a, b in rows], 6))
    for width in spans_x:
        for length in spans_y:
            _, left = focal_and_skewness(Q[:, :, 0] / width, Q[:, :, 1] / length)
            quad = np.flatnonzero(left < skewness)
            if len(quad) == 0:
                continue
            q1, q2, q3 = Q[quad, :, 0] / width, Q[quad, :, 1] / length, Q[quad, :, 2]
            for x0 in (a for a, b in columns if abs(b - a - width) < 2e-6):
                for y0 in (a for a, b in rows if abs(b - a - length) < 2e-6):
                    for side in sides:
                        # Half a turn of the court: both axes and the cell's first corner change sign.
                        x1, y1 = (x0, y0) if side > 0 else (x0 + width, y0 + length)
                        found.append(np.stack([side * q1, side * q2, q3 - side * (x1 * q1 + y1 * q2)], axis=-1))
                        quads.append(quad)
    return np.concatenate(found), np.concatenate(quads)
