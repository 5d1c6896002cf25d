"""Thin bright lines of a picture: sub-pixel ridge points, the straight ones among them, and the lines they form.

A painted line is a RIDGE: brighter than the ground on both sides. Its centre is found where the second derivative
across it is most negative (Steger 1998, "An unbiased detector of curvilinear structures", section 3), on the picture
and on copies of half and quarter size, so that lines of one to twelve pixels are found. Texture gives ridge points
too, but no long straight chains of them, so only chains are kept.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, Int, Shaped, UInt8

from pgm_data.geometry.arrays import frozen

_BINS = 12
"""Orientation classes over half a turn; neighbouring classes overlap by half."""


@dataclass(frozen=True, eq=False, kw_only=True)
class RidgePoints:
    """Points on the centres of thin bright lines."""

    xy: Float[np.ndarray, "points 2"]
    """Pixels; the centre of the top-left pixel is (0, 0)."""
    angle: Float[np.ndarray, " points"]
    """Direction ALONG the line, radians in [0, pi), from x towards y (down)."""
    length: Float[np.ndarray, " points"]
    """Length of line a point stands for, pixels."""
    strength: Float[np.ndarray, " points"]
    """Curvature across the line, grey levels."""

    def __post_init__(self) -> None:
        """Keep read-only copies."""
        for name in ("xy", "angle", "length", "strength"):
            object.__setattr__(self, name, frozen(getattr(self, name)))

    def __getitem__(self, index) -> "RidgePoints":
        """The points at the given index."""
        return RidgePoints(
            xy=self.xy[index], angle=self.angle[index], length=self.length[index], strength=self.strength[index]
        )

    def scaled(self, factor: float) -> "RidgePoints":
        """The points in a picture `factor` times as large."""
        return RidgePoints(xy=factor * self.xy, angle=self.angle, length=factor * self.length, strength=self.strength)


@dataclass(frozen=True, eq=False, kw_only=True)
class LongLines:
    """Straight lines with enough ridge points on them, most supported first."""

    line: Float[np.ndarray, "lines 3"]
    """(a, b, c) with a x + b y + c = 0 and a^2 + b^2 = 1, pixels."""
    middle: Float[np.ndarray, "lines 2"]
    """Mean of the supporting points, pixels."""
    support: Float[np.ndarray, " lines"]
    """Length of line seen, gaps left out, pixels."""

    def __post_init__(self) -> None:
        """Keep read-only copies."""
        for name in ("line", "middle", "support"):
            object.__setattr__(self, name, frozen(getattr(self, name)))

    @property
    def direction(self) -> Float[np.ndarray, "lines 2"]:
        """Unit vectors along the lines."""
        return np.stack([-self.line[:, 1], self.line[:, 0]], axis=1)


def straight_ridges(luma: UInt8[np.ndarray, "height width"], *, contrast: float, chain: float) -> RidgePoints:
    """Ridge points that stand in straight chains of at least `chain` pixels.

    `contrast` is the least curvature across a line, grey levels, at a blur of one pixel; noise raises it.
    """
    picture = luma.astype(np.float32)
    found = []
    factor = 1.0
    while factor <= 4.0 and min(picture.shape) >= 8:
        found.append(_chained(picture, contrast, max(chain / factor, 5.0)).scaled(factor))
        # `pyrDown` keeps pixels 0, 2, 4 ... as centres, so positions double without a shift.
        picture, factor = cv2.pyrDown(picture), 2.0 * factor
    return RidgePoints(
        **{name: np.concatenate([getattr(f, name) for f in found]) for name in ("xy", "angle", "length", "strength")}
    )


def _chained(picture: np.ndarray, contrast: float, chain: float) -> RidgePoints:
    rows, columns, points = _ridge_points(picture, contrast)
    keep = np.zeros(len(rows), dtype=bool)
    if len(rows):
        width = np.pi / _BINS
        for k in range(_BINS):
            near = np.abs((points.angle - k * width + np.pi / 2) % np.pi - np.pi / 2) <= width
            index = np.flatnonzero(near & ~keep)
            if len(index):
                keep[index[_in_straight_chain(picture.shape, rows[index], columns[index], points.xy[index], chain)]] = 1
    return points[keep]


def _ridge_points(picture: np.ndarray, contrast: float) -> tuple[np.ndarray, np.ndarray, RidgePoints]:
    smooth = cv2.GaussianBlur(picture, (0, 0), 1.0)
    xx = cv2.filter2D(smooth, -1, np.array([[1.0, -2.0, 1.0]], np.float32))
    yy = cv2.filter2D(smooth, -1, np.array([[1.0], [-2.0], [1.0]], np.float32))
    xy = cv2.filter2D(smooth, -1, np.array([[1, 0, -1], [0, 0, 0], [-1, 0, 1]], np.float32) / 4)
    strength = 0.5 * (cv2.magnitude(xx - yy, 2 * xy) - xx - yy)
    # A quarter of the picture at least is plain ground or wall, where only noise bends the picture; 0.32 is the
    # quarter point of the absolute value of a unit normal variable.
    noise = float(np.percentile(np.abs(xx[::4, ::4]), 25)) / 0.32
    rows, columns = np.nonzero(strength > max(contrast, 3.0 * noise))
    inner = (rows > 1) & (columns > 1) & (rows < picture.shape[0] - 2) & (columns < picture.shape[1] - 2)
    rows, columns = rows[inner], columns[inner]
    a, b, c = (m[rows, columns].astype(np.float64) for m in (xx, yy, xy))
    along = 0.5 * np.arctan2(2 * c, a - b)
    normal = np.stack([-np.sin(along), np.cos(along)], axis=1)
    across = -strength[rows, columns].astype(np.float64)
    gx = 0.5 * (smooth[rows, columns + 1] - smooth[rows, columns - 1]).astype(np.float64)
    gy = 0.5 * (smooth[rows + 1, columns] - smooth[rows - 1, columns]).astype(np.float64)
    offset = (-(gx * normal[:, 0] + gy * normal[:, 1]) / across)[:, None] * normal
    # A spot bends in both directions, a line in one.
    keep = (np.abs(offset).max(axis=1, initial=0.0) <= 0.6) & (np.abs(a + b - across) < 0.6 * np.abs(across))
    xy_px = np.stack([columns, rows], axis=1) + offset
    # A line's pixels are counted once per column or row, whichever it crosses more of.
    length = 1.0 / np.maximum(np.abs(np.cos(along)), np.abs(np.sin(along)))
    points = RidgePoints(xy=xy_px[keep], angle=along[keep] % np.pi, length=length[keep], strength=-across[keep])
    return rows[keep], columns[keep], points


def _in_straight_chain(
    shape: tuple[int, ...], rows: np.ndarray, columns: np.ndarray, xy: np.ndarray, chain: float
) -> np.ndarray:
    mask = np.zeros(shape, np.uint8)
    mask[rows, columns] = 1
    count, labels = cv2.connectedComponents(mask, connectivity=8)
    label = labels[rows, columns].astype(np.int64)
    n = np.maximum(np.bincount(label, minlength=count), 1)
    mean = [np.bincount(label, xy[:, i], count) / n for i in (0, 1)]
    d = [xy[:, i] - mean[i][label] for i in (0, 1)]
    vxx, vyy, vxy = (np.bincount(label, u * v, count) / n for u, v in ((d[0], d[0]), (d[1], d[1]), (d[0], d[1])))
    root = np.hypot((vxx - vyy) / 2, vxy)
    major, minor = (vxx + vyy) / 2 + root, np.maximum((vxx + vyy) / 2 - root, 0.0)
    # Evenly spread points over a length s have a variance of s^2 / 12.
    straight = (np.sqrt(12 * major) >= chain) & (minor <= 0.6 + (0.02**2) * major)
    return straight[label]


def long_lines(points: RidgePoints, *, shortest: float, most: int) -> LongLines:
    """The straight lines with at least `shortest` pixels of ridge on them, up to `most`.

    Each round takes the fullest cell of a Hough table in which a point votes for its own direction only, fits the
    line, and takes its points out of the table.
    """
    lines, middles, supports = [], [], []
    if len(points.xy):
        table = _HoughTable(points)
        for _ in range(2 * most):
            found = table.take(shortest)
            if found is None or len(lines) == most:
                break
            line, middle, support = found
            if support >= shortest:
                lines.append(line)
                middles.append(middle)
                supports.append(support)
    order = np.argsort(supports, kind="stable")[::-1]
    return LongLines(
        line=np.array(lines).reshape(-1, 3)[order],
        middle=np.array(middles).reshape(-1, 2)[order],
        support=np.array(supports, dtype=float)[order],
    )


class _HoughTable:
    """Votes of ridge points for (direction, distance) of the line through them."""

    _STEP = np.deg2rad(1.0)
    _CELL = 1.5
    _SPREAD = np.arange(-3, 4)

    def __init__(self, points: RidgePoints) -> None:
        self.points = points
        self.origin = points.xy.mean(axis=0)
        self.free = np.ones(len(points.xy), dtype=bool)
        self.xy = points.xy - self.origin
        self.reach = float(np.abs(self.xy).sum(axis=1).max()) + 2 * self._CELL
        self.columns = int(2 * self.reach / self._CELL) + 3
        turns = (np.rint(points.angle / self._STEP).astype(int)[:, None] + self._SPREAD) % 180
        normal = turns * self._STEP + np.pi / 2
        rho = self.xy[:, :1] * np.cos(normal) + self.xy[:, 1:] * np.sin(normal)
        self.cells = turns * self.columns + np.rint((rho + self.reach) / self._CELL).astype(int)
        self.votes = np.zeros(180 * self.columns)
        self._add(np.arange(len(self.xy)), 1.0)

    def _add(self, index: np.ndarray, sign: float) -> None:
        cells = self.cells[index].ravel()
        weight = np.repeat(self.points.length[index], len(self._SPREAD))
        self.votes += sign * np.bincount(cells, weight, len(self.votes))

    def take(self, shortest: float) -> tuple[np.ndarray, np.ndarray, float] | None:
        """The next line, its middle and its support, or None where no cell is full enough."""
        best = int(np.argmax(self.votes))
        if self.votes[best] < 0.4 * shortest:
            return None
        turn, column = divmod(best, self.columns)
        angle, rho = turn * self._STEP, column * self._CELL - self.reach
        normal = np.array([-np.sin(angle), np.cos(angle)])
        beside = np.abs(self.xy @ normal - rho) < 12.0
        index = np.flatnonzero(beside & self.free)
        for reach, swing in ((2.5, 0.15), (1.5, 0.12)):
            on = self._near(index, normal, rho, reach, swing)
            if len(on) < 3:
                break
            weight = self.points.length[on]
            middle = np.average(self.xy[on], axis=0, weights=weight)
            d = (self.xy[on] - middle) * np.sqrt(weight)[:, None]
            _, axes = np.linalg.eigh(d.T @ d)
            normal = axes[:, 0]
            rho = float(normal @ middle)
        on = self._near(index, normal, rho, 1.5, 0.15)
        # What lies beside the line is its echo, or it would come back as a second line.
        echo = self._near(index, normal, rho, 3.0, 0.15)
        gone = np.union1d(np.union1d(on, echo), index[(self.cells[index] == best).any(axis=1)])
        self._add(gone, -1.0)
        self.free[gone] = False
        if len(on) < 3:
            return np.zeros(3), np.zeros(2), 0.0
        along = self.xy[on] @ np.array([-normal[1], normal[0]])
        half = np.rint(along / 2.0).astype(int)
        support = 2.0 * len(np.unique(half))
        middle = self.xy[on].mean(axis=0) + self.origin
        return np.array([*normal, -rho - normal @ self.origin]), middle, support

    def _near(self, index: np.ndarray, normal: np.ndarray, rho: float, reach: float, swing: float) -> np.ndarray:
        angle = np.arctan2(-normal[0], normal[1])
        turned = np.abs((self.points.angle[index] - angle + np.pi / 2) % np.pi - np.pi / 2)
        return index[(np.abs(self.xy[index] @ normal - rho) < reach) & (turned < swing)]


def support_maps(
    points: RidgePoints, shape: tuple[int, int], *, reach: float
) -> UInt8[np.ndarray, "bins height width"]:
    """How near each pixel is to a ridge point of each direction: 255 on it.

    The closeness falls as a Gaussian of standard deviation `reach` pixels.
    """
    height, width = shape
    near = np.zeros((_BINS, height, width), np.uint8)
    column = np.clip(np.rint(points.xy[:, 0]).astype(int), 0, width - 1)
    row = np.clip(np.rint(points.xy[:, 1]).astype(int), 0, height - 1)
    fall = (255 * np.exp(-0.5 * (np.arange(256) / 16.0 / reach) ** 2)).astype(np.uint8)
    for k in range(_BINS):
        turned = np.abs((points.angle - k * np.pi / _BINS + np.pi / 2) % np.pi - np.pi / 2)
        on = turned <= np.pi / _BINS
        if on.any():
            holes = np.ones(shape, np.uint8)
            holes[row[on], column[on]] = 0
            distance = cv2.distanceTransform(holes, cv2.DIST_L2, 3)
            near[k] = fall[np.minimum(distance * 16.0, 255.0).astype(np.uint8)]
    return near


def direction_bin(angle: Shaped[np.ndarray, "*batch"]) -> Int[np.ndarray, "*batch"]:
    """The class of `support_maps` a direction along a line falls in, radians."""
    return np.rint(angle / (np.pi / _BINS)).astype(np.int64) % _BINS
