"""What the ridges of a picture say for a court laid onto it."""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree

from pgm_data.court import Court
from pgm_data.detect.court_hypotheses import Frame, focal_and_skewness
from pgm_data.detect.line_segments import RidgePoints


@dataclass(frozen=True, eq=False, kw_only=True)
class LineMarks:
    """Points spread evenly over the court's lines."""

    ground: Float[np.ndarray, "marks 3"]
    """(x, y, 1), metres."""
    along: Float[np.ndarray, "marks 3"]
    """(dx, dy, 0), unit directions of their lines."""
    line: Int[np.ndarray, " marks"]
    """Index of each mark's line."""
    width: Float[np.ndarray, " marks"]
    """Painted width, metres."""


def line_marks(court: Court, count: int) -> LineMarks:
    """About `count` points over all lines, at least four on each."""
    ends = court.lines_world[:, :, :2]
    run = ends[:, 1] - ends[:, 0]
    length = np.linalg.norm(run, axis=1)
    share = np.maximum(np.rint(count * length / length.sum()).astype(int), 4)
    line = np.repeat(np.arange(len(ends)), share)
    step = np.concatenate([(np.arange(n) + 0.5) / n for n in share])
    ground = ends[line, 0] + step[:, None] * run[line]
    return LineMarks(
        ground=np.column_stack([ground, np.ones(len(line))]),
        along=np.column_stack([run[line] / length[line, None], np.zeros(len(line))]),
        line=line,
        width=court.line_width[line],
    )


def marks_beyond_ends(court: Court, count: int) -> LineMarks:
    """Points past both ends of each line, where the ground is bare if the court is laid right.

    A court laid onto a part of itself is betrayed by paint that runs on past its ends.
    """
    ends = court.lines_world[:, :, :2]
    run = ends[:, 1] - ends[:, 0]
    length = np.linalg.norm(run, axis=1)
    unit = run / length[:, None]
    step = np.linspace(0.05, 0.3, count) * np.abs(court.points_world[:, :2]).max()
    ground = np.concatenate(
        [ends[:, :1] - step[:, None] * unit[:, None], ends[:, 1:] + step[:, None] * unit[:, None]], axis=1
    ).reshape(-1, 2)
    line = np.repeat(np.arange(len(ends)), 2 * count)
    # A line that goes on under another name, such as a centre line on both sides of the net, is no such betrayal.
    offset = ground[:, None] - ends[:, 0]
    along = (offset * unit).sum(axis=2)
    across = np.abs(offset[..., 0] * unit[:, 1] - offset[..., 1] * unit[:, 0])
    parallel = np.abs(unit[line] @ unit.T) > 0.99
    bare = ~(parallel & (across < 0.02 * length) & (along > 0) & (along < length)).any(axis=1)
    return LineMarks(
        ground=np.column_stack([ground, np.ones(len(line))])[bare],
        along=np.column_stack([unit[line], np.zeros(len(line))])[bare],
        line=line[bare],
        width=court.line_width[line[bare]],
    )


def projected(H: np.ndarray, marks: LineMarks) -> tuple[np.ndarray, np.ndarray]:
    """Marks in the picture and their lines' directions there, not of unit length."""
    p, d = marks.ground @ np.swapaxes(H, -1, -2), marks.along @ np.swapaxes(H, -1, -2)
    w = np.where(p[..., 2:] > 1e-6, p[..., 2:], np.nan)
    xy = p[..., :2] / w
    return xy, (d[..., :2] - xy * d[..., 2:]) / w


@dataclass(frozen=True, eq=False, kw_only=True)
class LineSupport:
    """How well a projected court's lines lie on ridges; all values from 0 to 1."""

    mean: float
    """Mean closeness of the visible marks to a ridge of their direction."""
    chance: float
    """The same a little beside the lines: what clutter alone gives."""
    lines: float
    """Mean over the lines, each full from 0.6 on, and nothing where paint runs on past an end."""
    seen: float
    """Share of the marks that are in the picture."""

    @property
    def total(self) -> float:
        """All of it in one number."""
        # The less of the court is in the picture, the more easily something else looks like it.
        share = min(1.0, 0.4 + 0.7 * self.seen) if self.seen > 0.35 else 0.0
        return max(0.0, self.mean - self.chance) * self.lines * share


class LineEvidence:
    """The ridges of a picture, asked for the nearest one of a direction."""

    _TURN = 40.0
    """Pixels that a radian of doubled direction counts for."""

    def __init__(self, ridges: RidgePoints, frame: Frame) -> None:
        self.ridges, self.frame = ridges, frame
        self.T = frame.pixel_from_unit
        self.tree = KDTree(self._keys(ridges.xy, ridges.angle))

    def _keys(self, xy: np.ndarray, angle: np.ndarray) -> np.ndarray:
        turn = self._TURN / 2 * np.stack([np.cos(2 * angle), np.sin(2 * angle)], axis=-1)
        return np.concatenate([xy, turn], axis=-1)

    def _seen(self, xy: np.ndarray) -> np.ndarray:
        edge = np.array([self.frame.width - 2.5, self.frame.height - 2.5])
        return np.asarray(((xy > 1.5) & (xy < edge)).all(axis=-1))

    def _distance(self, xy: np.ndarray, direction: np.ndarray, reach: float) -> tuple[np.ndarray, np.ndarray]:
        """Signed distance across the line to the nearest ridge, NaN where there is none, and the line's normal."""
        angle = np.arctan2(direction[:, 1], direction[:, 0])
        _, index = self.tree.query(self._keys(xy, angle), distance_upper_bound=1.5 * reach + 2.0)
        normal = np.stack([-np.sin(angle), np.cos(angle)], axis=1)
        found = np.asarray(index) < len(self.ridges.xy)
        offset = np.where(found[:, None], self.ridges.xy[np.where(found, index, 0)] - xy, np.nan)
        across = (offset * normal).sum(axis=1)
        return np.where(np.abs(across) <= reach, across, np.nan), normal

    def fitted(self, H: np.ndarray, marks: LineMarks) -> np.ndarray:
        """The homography moved onto the nearest ridges by damped Gauss-Newton steps; NaN where too few are near."""
        S = np.diag(1 / np.array([*np.abs(marks.ground[:, :2]).max(axis=0), 1.0]))
        H = H @ np.linalg.inv(S)
        ground, along = marks.ground @ S, marks.along @ S
        scaled = LineMarks(ground=ground, along=along, line=marks.line, width=marks.width)
        for reach in (6.0, 5.0, 4.0, 4.0, 3.0, 3.0, 3.0):
            H = H / H[2, 2]
            xy, direction = projected(self.T @ H, scaled)
            ok = np.isfinite(xy).all(axis=1) & self._seen(np.nan_to_num(xy, nan=-1.0))
            if ok.sum() < 16:
                return np.full((3, 3), np.nan)
            across, normal = self._distance(xy[ok], direction[ok], reach)
            near = np.isfinite(across)
            if near.sum() < 16:
                return np.full((3, 3), np.nan)
            g, n = ground[ok][near], normal[near] * self.T[0, 0]
            q = g @ H.T
            u = q[:, :2] / q[:, 2:]
            # d(n . u) / dH: n_x g / w, n_y g / w, -(n . u) g / w; the last entry is held at 1.
            rows = np.stack([n[:, 0], n[:, 1], -(n * u).sum(axis=1)], axis=1) / q[:, 2:]
            J = (rows[:, :, None] * g[:, None, :]).reshape(-1, 9)[:, :8]
            weight = 1.0 / (1.0 + (across[near] / (0.5 * reach)) ** 2)
            A = (J * weight[:, None]).T @ J
            b = (J * weight[:, None]).T @ across[near]
            step = np.linalg.solve(A + 1e-6 * np.diag(np.diag(A)) + 1e-9 * np.eye(8), b)
            H = H + np.append(step, 0.0).reshape(3, 3)
        return H @ S

    def _closeness(self, xy: np.ndarray, direction: np.ndarray) -> np.ndarray:
        across, _ = self._distance(xy, direction, 3.0)
        return np.where(np.isfinite(across), np.exp(-0.5 * (np.nan_to_num(across) / 1.5) ** 2), 0.0)

    def _overrun(self, H: np.ndarray, beyond: LineMarks, lines: int) -> np.ndarray:
        """Share of each line's marks past its ends that have a ridge of its direction under them."""
        xy, direction = projected(H, beyond)
        seen = np.array(np.isfinite(xy).all(axis=1))
        seen[seen] = self._seen(xy[seen])
        near = np.zeros(len(xy))
        if seen.any():
            near[seen] = self._closeness(xy[seen], direction[seen])
        total = np.bincount(beyond.line, seen, lines)
        return np.bincount(beyond.line, near, lines) / np.maximum(total, 4.0)

    def support(self, H: np.ndarray, marks: LineMarks, beyond: LineMarks) -> LineSupport:
        """How much of the court's lines has a ridge of their direction under it."""
        H = self.T @ H
        xy, direction = projected(H, marks)
        seen = np.array(np.isfinite(xy).all(axis=1))
        seen[seen] = self._seen(xy[seen])
        closeness, beside = np.zeros(len(xy)), np.zeros(len(xy))
        if seen.any():
            xy, direction = xy[seen], direction[seen]
            closeness[seen] = self._closeness(xy, direction)
            normal = np.stack([-direction[:, 1], direction[:, 0]], axis=1)
            normal /= np.linalg.norm(normal, axis=1, keepdims=True)
            beside[seen] = np.mean([self._closeness(xy + s * normal, direction) for s in (-9.0, 9.0)], axis=0)
        # Lines thinner than a third of a pixel cannot be asked for.
        weight = seen * np.clip(_painted_pixels(H, marks) / 0.35, 0.0, 1.0)
        total = np.bincount(marks.line, weight)
        each = np.bincount(marks.line, closeness * weight) / np.maximum(total, 1e-9)
        asked = total >= 2.0
        # Paint past one of two ends is a half of the marks there.
        ended = 1.0 - np.clip((self._overrun(H, beyond, len(each)) - 0.2) / 0.25, 0.0, 1.0)
        full = np.minimum(each / 0.6, 1.0) * ended
        whole = max(float(weight.sum()), 1e-9)
        return LineSupport(
            mean=float((closeness * weight).sum()) / whole,
            chance=float((beside * weight).sum()) / whole,
            lines=float(full[asked].mean()) if asked.any() else 0.0,
            seen=float(seen.mean()),
        )

    def score(self, H: np.ndarray, court: Court, marks: LineMarks, beyond: LineMarks) -> float:
        """How well the picture's lines and the court's agree, 0 to 1."""
        total = self.support(H, marks, beyond).total
        return total * self._coverage(H, court, marks) if total > 0 else 0.0

    def _coverage(self, H: np.ndarray, court: Court, marks: LineMarks) -> float:
        """Share of the ridges on and around the court, along its two directions, that its lines explain."""
        H = self.T @ H
        ground = np.column_stack([self.ridges.xy, np.ones(len(self.ridges.xy))]) @ np.linalg.inv(H).T
        with np.errstate(divide="ignore", invalid="ignore"):
            ground = ground / ground[:, 2:]
        half = np.abs(court.points_world[:, :2]).max(axis=0)
        # What is painted beside a court keeps away from it by more than this in every sport played on one.
        margin = 0.08 * half.max()
        inside = (np.abs(ground[:, :2]) < half + margin).all(axis=1)
        p = ground[inside] @ H.T
        aligned = np.zeros(len(p), dtype=bool)
        angle = self.ridges.angle[inside]
        for axis in (0, 1):
            d = H[:2, axis] - p[:, :2] / p[:, 2:] * H[2, axis]
            turned = np.arctan2(d[:, 1], d[:, 0]) - angle
            aligned |= np.abs((turned + np.pi / 2) % np.pi - np.pi / 2) < np.deg2rad(5.0)
        index = np.flatnonzero(inside)[aligned & ~self._on_net(H, court, self.ridges.xy[inside])]
        if len(index) == 0:
            return 0.0
        ends = np.concatenate([court.lines_world[:, :, :2], np.ones((len(court.line_names), 2, 1))], axis=2) @ H.T
        ends = ends[..., :2] / ends[..., 2:]
        run = ends[:, 1] - ends[:, 0]
        length = np.linalg.norm(run, axis=1)
        offset = self.ridges.xy[index][:, None] - ends[:, 0]
        along = (offset * (run / length[:, None])).sum(axis=2)
        across = (offset[..., 1] * run[:, 0] - offset[..., 0] * run[:, 1]) / length
        # A wide line has ridges off its centre too.
        wide = np.zeros(len(length))
        np.maximum.at(wide, marks.line, _painted_pixels(H, marks) / 2)
        explained = ((np.abs(across) < 3.0 + wide) & (along > -4.0) & (along < length + 4.0)).any(axis=1)
        if not explained.any():
            return 0.0
        # Paint is strong; the texture of clay and the halo that sharpening leaves beside a line are not.
        typical = np.median(self.ridges.strength[index][explained])
        weight = self.ridges.length[index] * np.minimum(self.ridges.strength[index] / typical, 1.0) ** 2
        return float((weight * explained).sum() / weight.sum())

    def _on_net(self, H: np.ndarray, court: Court, xy: np.ndarray) -> np.ndarray:
        """Which points of the picture the net may cover."""
        net = court.net_world
        if len(net) == 0:
            return np.zeros(len(xy), dtype=bool)
        U = np.linalg.inv(self.T) @ H
        focal = float(focal_and_skewness(U[None, :, 0], U[None, :, 1])[0][0])
        M = U / np.array([[focal], [focal], [1.0]])
        M *= 2.0 / (np.linalg.norm(M[:, 0]) + np.linalg.norm(M[:, 1]))
        up = np.cross(M[:, 0], M[:, 1]) * np.array([focal, focal, 1.0])
        H_unit = M * np.array([[focal], [focal], [1.0]])
        foot = np.column_stack([net[:, :2], np.ones(len(net))]) @ H_unit.T
        top = foot + (net[:, 2] + court.tape_width)[:, None] * up
        band = np.concatenate([foot, top[::-1]]) @ self.T.T
        if (band[:, 2] <= 0).any():
            return np.zeros(len(xy), dtype=bool)
        hull = cv2.convexHull((band[:, :2] / band[:, 2:]).astype(np.float32))
        mask = np.zeros((self.frame.height, self.frame.width), np.uint8)
        cv2.fillConvexPoly(mask, np.rint(hull).astype(np.int32), 1)
        mask = cv2.dilate(mask, np.ones((9, 9), np.uint8))
        column = np.clip(np.rint(xy[:, 0]).astype(int), 0, self.frame.width - 1)
        row = np.clip(np.rint(xy[:, 1]).astype(int), 0, self.frame.height - 1)
        return mask[row, column] > 0


def _painted_pixels(H: np.ndarray, marks: LineMarks) -> np.ndarray:
    """Width of the painted line in the picture at each mark, pixels."""
    p = marks.ground @ H.T
    a, b = H[:2, :2] - (p[:, :2] / p[:, 2:])[:, :, None] * H[2, :2], marks.along[:, :2]
    area = np.abs(a[:, 0, 0] * a[:, 1, 1] - a[:, 0, 1] * a[:, 1, 0]) / p[:, 2] ** 2
    run = np.linalg.norm(np.einsum("mij,mj->mi", a, b), axis=1) / np.abs(p[:, 2])
    return marks.width * area / np.maximum(run, 1e-12)
