"""Flat shapes of the world: groups of coloured polygons, textured planes, painted lines, the net."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import pairwise

import cv2
import numpy as np
from jaxtyping import Float, Int, UInt8

from pgm_data.court import Court


@dataclass(frozen=True, eq=False, kw_only=True)
class Polygons:
    """Polygons to paint in order."""

    corners: Float[np.ndarray, "corners 3"]
    """Corners of all polygons, world metres."""
    starts: Int[np.ndarray, " polygons_plus_one"]
    """Where each polygon's corners begin, and the end."""
    colours: Float[np.ndarray, "polygons 3"]
    """BGR, 0 to 255."""
    alphas: Float[np.ndarray, " polygons"]
    """Opacity, 0 to 1."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Plane:
    """A polygon in a plane that carries a repeating texture."""

    corners: Float[np.ndarray, "corners 3"]
    """World metres."""
    origin: Float[np.ndarray, " 3"]
    """Where the texture's first pixel lies, world metres."""
    right: Float[np.ndarray, " 3"]
    """World vector of one texture pixel to the right."""
    down: Float[np.ndarray, " 3"]
    """World vector of one texture pixel down; at a right angle to `right`."""
    texture: UInt8[np.ndarray, "height width channels"]
    """BGR, or one channel for a mask."""
    base: Float[np.ndarray, " 3"]
    """Colour at texture value 0, or the mask's colour."""
    gain: Float[np.ndarray, " 3"]
    """Colour per texture value."""
    alpha: float
    by_mask: bool
    """Whether the texture is the opacity of the colour `base`."""

    @cached_property
    def smaller(self) -> UInt8[np.ndarray, "rows columns channels"]:
        """The texture at a half, a quarter and so on, one below the other, down to two pixels."""
        rows, columns, channels = self.texture.shape
        stack = np.zeros((rows - 1, max(columns // 2, 1), channels), np.uint8)
        part, top = self.texture, 0
        while min(part.shape[:2]) >= 4:
            half = cv2.resize(part, (part.shape[1] // 2, part.shape[0] // 2), interpolation=cv2.INTER_AREA)
            part = half.reshape(part.shape[0] // 2, part.shape[1] // 2, channels)
            stack[top : top + part.shape[0], : part.shape[1]] = part
            top += part.shape[0]
        return stack[:top]


def polygons(shapes: Sequence[tuple[np.ndarray, np.ndarray | Sequence[float], float]]) -> Polygons:
    """The group of (corners, colour, opacity), in order."""
    if not shapes:
        return Polygons(
            corners=np.zeros((0, 3)), starts=np.zeros(1, np.int64), colours=np.zeros((0, 3)), alphas=np.zeros(0)
        )
    counts = [len(s[0]) for s in shapes]
    return Polygons(
        corners=np.concatenate([np.asarray(s[0], dtype=float) for s in shapes]),
        starts=np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        colours=np.array([s[1] for s in shapes], dtype=float),
        alphas=np.array([s[2] for s in shapes], dtype=float),
    )


def stacked(groups: Sequence[Polygons]) -> Polygons:
    """One group of several, in order."""
    if not groups:
        return polygons([])
    offsets = np.concatenate([[0], np.cumsum([len(g.corners) for g in groups])])
    starts = [g.starts[:-1] + o for g, o in zip(groups, offsets[:-1], strict=True)]
    return Polygons(
        corners=np.concatenate([g.corners for g in groups]),
        starts=np.concatenate([*starts, offsets[-1:]]).astype(np.int64),
        colours=np.concatenate([g.colours for g in groups]),
        alphas=np.concatenate([g.alphas for g in groups]),
    )


def rectangle(x0: float, x1: float, y0: float, y1: float, z: float = 0.0) -> np.ndarray:
    """Corners of a level rectangle, metres."""
    return np.array([[x0, y0, z], [x1, y0, z], [x1, y1, z], [x0, y1, z]])


@lru_cache(maxsize=16)
def line_rectangles(court: Court) -> tuple[tuple[int, np.ndarray], ...]:
    """(line, corners) of the painted lines as rectangles that do not overlap, metres.

    A line that ends on another runs on to that one's outer edge; lines along y stop where a line along x is painted.

    Raises:
        ValueError: If a line runs neither along x nor along y.
    """
    ends, widths = court.lines_world, court.line_width
    along = np.abs(ends[:, 1] - ends[:, 0])
    if not (np.minimum(along[:, 0], along[:, 1]) < 1e-9).all():
        raise ValueError("court.lines: expected lines along x or along y, got an oblique one")
    lies_on_x = along[:, 0] > along[:, 1]
    boxes = np.array([_box(i, ends, widths, lies_on_x) for i in range(len(ends))])
    drawn: list[tuple[int, np.ndarray]] = []
    for i in np.flatnonzero(lies_on_x):
        x0, x1, y0, y1 = boxes[i]
        drawn.append((int(i), rectangle(x0, x1, y0, y1, ends[i, 0, 2])))
    for i in np.flatnonzero(~lies_on_x):
        x0, x1, y0, y1 = boxes[i]
        cuts = sorted(
            (b[2], b[3]) for b in boxes[lies_on_x] if b[0] < x1 - 1e-9 and b[1] > x0 + 1e-9 and b[2] < y1 and b[3] > y0
        )
        low = y0
        for start, stop in [*cuts, (y1, y1)]:
            if start > low + 1e-9:
                drawn.append((int(i), rectangle(x0, x1, low, start, ends[i, 0, 2])))
            low = max(low, stop)
    return tuple(drawn)


def in_pieces(group: Polygons, longest_m: float) -> Polygons:
    """The same rectangles cut into pieces no longer than this, which keeps the boxes round slanting lines small."""
    shapes = []
    for p, (start, stop) in enumerate(pairwise(group.starts)):
        a, b, c, d = group.corners[start:stop]
        if np.linalg.norm(b - a) < np.linalg.norm(d - a):
            a, b, c, d = b, c, d, a
        count = max(1, int(np.ceil(np.linalg.norm(b - a) / longest_m)))
        cuts = np.linspace(0.0, 1.0, count + 1)
        for low, high in pairwise(cuts):
            piece = np.array([a + low * (b - a), a + high * (b - a), d + high * (c - d), d + low * (c - d)])
            shapes.append((piece, group.colours[p], float(group.alphas[p])))
    return polygons(shapes)


def _box(i: int, ends: np.ndarray, widths: np.ndarray, lies_on_x: np.ndarray) -> tuple[float, float, float, float]:
    """x0, x1, y0, y1 of a line's paint, with its ends run out to the outer edges of the lines they meet."""
    axis = 0 if lies_on_x[i] else 1
    other = 1 - axis
    low, high = sorted(ends[i, :, axis])
    level = ends[i, 0, other]
    reach = [0.0, 0.0]
    for j in np.flatnonzero(lies_on_x != lies_on_x[i]):
        start, stop = sorted(ends[j, :, other])
        if not start - 1e-9 <= level <= stop + 1e-9:
            continue
        for side, value in enumerate((low, high)):
            if abs(ends[j, 0, axis] - value) < 1e-9:
                reach[side] = max(reach[side], widths[j] / 2)
    span = (low - reach[0], high + reach[1])
    edges = (level - widths[i] / 2, level + widths[i] / 2)
    return (*span, *edges) if axis == 0 else (*edges, *span)


CORD_M = 0.045
"""From one cord of a net to the next."""


@dataclass(frozen=True, eq=False, kw_only=True)
class NetLook:
    """How the net is drawn."""

    mesh: Float[np.ndarray, " 3"]
    """BGR."""
    mesh_alpha: float
    tape: Float[np.ndarray, " 3"]
    """BGR."""
    post: Float[np.ndarray, " 3"]
    """BGR."""
    strap: bool
    band: bool
    """Whether a pale band runs along the net's foot."""


def net_bottom(court: Court, x: np.ndarray, top: np.ndarray) -> np.ndarray:
    """Height of the net's lower edge, metres: on the ground, or 0.76 m below the top of a raised net."""
    return np.where(top > 1.4, top - 0.76, 0.0) * np.ones_like(x)


def net_polygons(court: Court, look: NetLook, floor_z: float) -> tuple[Polygons, Polygons]:
    """Posts and mesh; tape and centre strap, of one colour. The tape's upper edge is the scene file's net top."""
    top = court.net_world
    if len(top) < 2:
        return polygons([]), polygons([])
    x, y, z = top[:, 0], top[:, 1], top[:, 2]
    low = net_bottom(court, x, z)
    shapes = []

    def band(from_top: float, to_top: float | None, colour, alpha: float) -> None:
        for i in range(len(x) - 1):
            upper = [(x[i], y[i], z[i] - from_top), (x[i + 1], y[i + 1], z[i + 1] - from_top)]
            if to_top is None:
                lower = [(x[i + 1], y[i + 1], low[i + 1]), (x[i], y[i], low[i])]
            else:
                lower = [(x[i + 1], y[i + 1], z[i + 1] - to_top), (x[i], y[i], z[i] - to_top)]
            shapes.append((np.array(upper + lower), colour, alpha))

    height = float(z.max())
    thick = 0.04 * min(1.0, height)
    for i in (0, len(x) - 1):
        foot = 0.0 if floor_z < 0 else floor_z
        shapes.append((_upright(x[i], y[i], foot, z[i] + 0.02 * height, thick), look.post, 1.0))
    band(0.0, None, look.mesh, look.mesh_alpha)
    if look.band:
        for i in range(len(x) - 1):
            foot = [(x[i], y[i], low[i] + thick), (x[i + 1], y[i + 1], low[i + 1] + thick)]
            shapes.append((np.array([*foot, (x[i + 1], y[i + 1], low[i + 1]), (x[i], y[i], low[i])]), look.tape, 0.5))
    net, shapes = polygons(shapes), []
    middle = int(np.argmin(np.abs(x)))
    if look.strap and 0 < middle < len(x) - 1 and z[middle] < z.max() - 0.02:
        strap = _upright(x[middle], y[middle], low[middle], z[middle] - court.tape_width, 0.025)
        shapes.append((strap, look.tape, 0.95))
    band(0.0, court.tape_width, look.tape, 0.97)
    return net, polygons(shapes)


def net_mesh(court: Court, look: NetLook) -> tuple[Plane, ...]:
    """The net's cords: as dark on the whole as `look.mesh_alpha`, single cords where they are seen from near."""
    top = court.net_world
    if len(top) < 2:
        return ()
    low = net_bottom(court, top[:, 0], top[:, 2])
    cell, cords = 16, 4
    tile = np.zeros((cell, cell), np.uint8)
    tile[:3], tile[:, :3] = 255, 255
    share = float(tile.mean()) / 255.0
    # Dense nets have no holes that are quite free.
    tile = np.maximum(tile, np.uint8(255.0 * max(0.0, (look.mesh_alpha - share) / (1.0 - share))))
    mask = np.tile(tile, (cords, cords))[..., None]
    step = CORD_M / cell
    planes = []
    for i in range(len(top) - 1):
        corners = np.array([top[i], top[i + 1], [*top[i + 1, :2], low[i + 1]], [*top[i, :2], low[i]]])
        along = top[i + 1] - top[i]
        along = np.array([along[0], along[1], 0.0]) / np.hypot(along[0], along[1])
        planes.append(
            Plane(
                corners=corners,
                origin=top[i] * np.array([1.0, 1.0, 0.0]),
                right=step * along,
                down=np.array([0.0, 0.0, -step]),
                texture=mask,
                base=look.mesh,
                gain=np.zeros(3),
                alpha=min(1.0, look.mesh_alpha / share),
                by_mask=True,
            )
        )
    return tuple(planes)


def _upright(x: float, y: float, low: float, high: float, half: float) -> np.ndarray:
    return np.array([[x - half, y, low], [x + half, y, low], [x + half, y, high], [x - half, y, high]])
