"""Surfaces drawn through rings: how bodies, clothes and rackets get their shape.

Rest frame of a person 1.8 m tall: x to the person's left, y up from the soles, z forward, metres. Colours BGR 0 to 255.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int
from scipy.interpolate import PchipInterpolator

from pgm_data.simulate.body.figure import smpl24

JOINT = {name: i for i, name in enumerate(smpl24().joint_names)}
BODY, RACKET = 0, 1

# Directions and wave numbers (1/m) of small folds in cloth, and their phases: slanting, as cloth pulls.
_FOLDS = (
    (np.array([18.0, 46.0, 20.0]), 0.3),
    (np.array([-30.0, 38.0, 14.0]), 1.9),
    (np.array([25.0, 30.0, -33.0]), 4.1),
)

Paint = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Colours (..., 3) of places along a surface and angles round it."""
Weigh = Callable[[np.ndarray], np.ndarray]
"""Weights (n, 24) of joints on points (n, 3)."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Part:
    """A piece of a body at rest."""

    vertices: Float[np.ndarray, "vertices 3"]
    normals: Float[np.ndarray, "vertices 3"]
    triangles: Int[np.ndarray, "triangles 3"]
    colours: Float[np.ndarray, "vertices 3"]
    weights: Float[np.ndarray, "vertices 24"]
    label: int = BODY
    opacity: float = 1.0


@dataclass(frozen=True, eq=False, kw_only=True)
class Tube:
    """A surface round an axis, by the rings it passes."""

    axis: int
    """Along x (0), y (1) or z (2); angle 0 points along the first, a quarter along the second of `across`."""
    keys: Float[np.ndarray, "keys 7"]
    """Place along the axis, centre across (2), radii towards +first, -first, +second, -second."""
    power: float = 2.0
    """Of the rings: 2 for ellipses, more for boxes."""

    @property
    def across(self) -> tuple[int, int]:
        """The two axes of the rings."""
        return ((2, 1), (0, 2), (0, 1))[self.axis]

    def at(self, s: np.ndarray, angle: np.ndarray) -> np.ndarray:
        """Points (..., 3) of the surface."""
        order = np.argsort(self.keys[:, 0], kind="stable")
        keys = PchipInterpolator(self.keys[order, 0], self.keys[order, 1:])(s)
        c, d = np.cos(angle), np.sin(angle)
        u = np.sign(c) * np.abs(c) ** (2.0 / self.power)
        v = np.sign(d) * np.abs(d) ** (2.0 / self.power)
        points = np.empty((*np.broadcast_shapes(np.shape(s), np.shape(angle)), 3))
        points[..., self.axis] = s
        points[..., self.across[0]] = keys[..., 0] + u * np.where(u > 0, keys[..., 2], keys[..., 3])
        points[..., self.across[1]] = keys[..., 1] + v * np.where(v > 0, keys[..., 4], keys[..., 5])
        return points


def ring_keys(rows: Sequence[Sequence[float]]) -> Float[np.ndarray, "keys 7"]:
    """Keys from rows of a place, a centre (2) and four radii, or two (one for each axis), or one."""
    full = []
    for row in rows:
        place, radii = list(row[:3]), list(row[3:])
        if len(radii) == 1:
            radii = radii * 4
        elif len(radii) == 2:
            radii = [radii[0], radii[0], radii[1], radii[1]]
        full.append(place + radii)
    return np.array(full, dtype=float)


def split_range(start: float, end: float, count: int, breaks: Sequence[float]) -> tuple[np.ndarray, np.ndarray]:
    """About `count` places from start to end, twice at every break; and the same nudged to their side of the break."""
    sign = 1.0 if end > start else -1.0
    inner = sorted((b for b in breaks if min(start, end) < b < max(start, end)), key=lambda b: sign * b)
    edges = [start, *inner, end]
    places, sides = [], []
    for a, b in zip(edges[:-1], edges[1:], strict=True):
        n = max(2, int(round(count * abs(b - a) / abs(end - start))) + 1)
        part = np.linspace(a, b, n)
        inward = part.copy()
        nudge = min(1e-4, 0.1 * abs(b - a)) * sign
        inward[0] += nudge
        inward[-1] -= nudge
        places.append(part)
        sides.append(inward)
    return np.concatenate(places), np.concatenate(sides)


def surface(
    points: Callable[[np.ndarray, np.ndarray], np.ndarray],
    span: tuple[float, float],
    grid: tuple[int, int],
    paint: Paint,
    weigh: Weigh,
    *,
    breaks: tuple[Sequence[float], Sequence[float]] = ((), ()),
    angles: tuple[float, float] = (0.0, 2.0 * np.pi),
) -> Part:
    """A surface over (place, angle); `grid` counts rings and columns, colours may jump at `breaks` of either."""
    s, s_side = split_range(span[0], span[1], grid[0], breaks[0])
    a, a_side = split_range(angles[0], angles[1], grid[1], breaks[1])
    S, A = np.meshgrid(s, a, indexing="ij")
    vertices = points(S, A).reshape(-1, 3)
    colours = np.broadcast_to(paint(*np.meshgrid(s_side, a_side, indexing="ij")), (*S.shape, 3)).reshape(-1, 3)
    return part_of(vertices, _grid_triangles(len(s), len(a)), colours, weigh)


def part_of(vertices: np.ndarray, triangles: np.ndarray, colours: np.ndarray, weigh: Weigh, *, flip=None) -> Part:
    """A part from its triangles: outward by its volume, normals smooth over vertices that coincide."""
    sides = vertices[triangles[:, 1:]] - vertices[triangles[:, :1]]
    faces = np.cross(sides[:, 0], sides[:, 1])
    middle = vertices.mean(axis=0)
    if flip is None:
        flip = float(np.sum(faces * (vertices[triangles[:, 0]] - middle))) < 0.0
    if flip:
        triangles, faces = triangles[:, ::-1], -faces
    kept = np.linalg.norm(faces, axis=1) > 1e-10
    triangles, faces = triangles[kept], faces[kept]
    _, same = np.unique(np.round(vertices, 6), axis=0, return_inverse=True)
    same = same.ravel()
    sums = np.zeros((same.max() + 1, 3))
    for k in range(3):
        np.add.at(sums, same[triangles[:, k]], faces)
    length = np.linalg.norm(sums, axis=1, keepdims=True)
    normals = np.where(length > 1e-12, sums / np.maximum(length, 1e-12), [0.0, 1.0, 0.0])[same]
    return Part(
        vertices=vertices,
        normals=normals,
        triangles=np.ascontiguousarray(triangles),
        colours=np.array(colours, dtype=float),
        weights=weigh(vertices),
    )


def _grid_triangles(rows: int, columns: int) -> np.ndarray:
    index = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = index[:-1, :-1].ravel(), index[:-1, 1:].ravel(), index[1:, :-1].ravel(), index[1:, 1:].ravel()
    return np.concatenate([np.stack([a, b, c], axis=-1), np.stack([b, d, c], axis=-1)])


def mirrored(part: Part) -> Part:
    """The same part on the other side of the body."""
    swap = np.arange(24)
    for name, i in JOINT.items():
        if name.startswith("L_"):
            other = JOINT["R_" + name[2:]]
            swap[i], swap[other] = other, i
    return Part(
        vertices=part.vertices * [-1.0, 1.0, 1.0],
        normals=part.normals * [-1.0, 1.0, 1.0],
        triangles=np.ascontiguousarray(part.triangles[:, ::-1]),
        colours=part.colours,
        weights=part.weights[:, swap],
        label=part.label,
        opacity=part.opacity,
    )


def step(low: float, high: float, x: np.ndarray) -> np.ndarray:
    """0 below low to 1 above high, smoothly; low may be the greater."""
    share = np.clip((x - low) / (high - low), 0.0, 1.0)
    return share * share * (3.0 - 2.0 * share)


def plain(colour: np.ndarray) -> Paint:
    """One colour everywhere."""
    return lambda s, angle: np.broadcast_to(colour, (*np.shape(s), 3))


def bands(base: np.ndarray, rings: Sequence[tuple[float, float, np.ndarray]]) -> Paint:
    """A base colour with rings of others: (from, to, colour), later ones on top."""

    def paint(s: np.ndarray, angle: np.ndarray) -> np.ndarray:
        colour = np.broadcast_to(base, (*np.shape(s), 3)).copy()
        for start, end, other in rings:
            colour[(s > min(start, end)) & (s < max(start, end))] = other
        return colour

    return paint


def shaded(paint: Paint, dark: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> Paint:
    """A paint times a factor: for the light that does not get into folds and hollows."""
    return lambda s, angle: paint(s, angle) * np.asarray(dark(s, angle))[..., None]


def follow(joint: str) -> Weigh:
    """All points move with one joint."""

    def weigh(points: np.ndarray) -> np.ndarray:
        weights = np.zeros((len(points), 24))
        weights[:, JOINT[joint]] = 1.0
        return weights

    return weigh


def chain(axis: int, links: Sequence[tuple[str, float, float]], sign: float = 1.0) -> Weigh:
    """Points move with the last joint whose (name, place, half width of the change) they have passed along an axis."""

    def weigh(points: np.ndarray) -> np.ndarray:
        weights = np.zeros((len(points), 24))
        place = sign * points[:, axis]
        left = np.ones(len(points))
        for name, at, half in reversed(links):
            passed = left * (1.0 if not np.isfinite(at) else step(sign * at - half, sign * at + half, place))
            weights[:, JOINT[name]] += passed
            left = left - passed
        return weights

    return weigh


def crumpled(part: Part, amount: float) -> Part:
    """The part with the small folds of cloth in its shading, deeper towards the waist and the hems."""
    p = part.vertices
    waves = np.zeros_like(p)
    for k, (direction, phase) in enumerate(_FOLDS):
        value = np.sin(p @ direction + phase) * np.cos(0.6 * (p @ _FOLDS[k - 1][0]) + 2.0 * phase)
        waves += value[:, None] * direction / np.linalg.norm(direction)
    deep = amount * (0.35 + 0.65 * step(1.30, 1.02, p[:, 1]))[:, None]
    normals = part.normals + deep * waves
    return replace(part, normals=normals / np.linalg.norm(normals, axis=1, keepdims=True))
