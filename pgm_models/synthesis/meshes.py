"""Watertight meshes, and how far points are from them: signed distance, negative inside.

The distance is that of each point to each triangle it could be nearest to; the sign is that of the winding number, so
that parts may run into each other. A mesh is a set of SHELLS, closed surfaces that share no vertex. A shell turned
outward bounds a SOLID; one turned inward must lie in a solid, whose cavity it is.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from pgm_data.geometry.arrays import frozen

FLAT = 1e-10
"""Area of a triangle over that of the square of its longest side, below which it has none."""
PAIRS = 400_000
"""Of points and triangles that are looked at together."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Mesh:
    """Triangles in space.

    Raises:
        ValueError: If a vertex is not finite, a triangle names one that is not there, or has no area.
    """

    vertices: Float[np.ndarray, "vertices 3"]
    """Metres."""
    triangles: Int[np.ndarray, "triangles 3"]
    """Rows of vertices, counter-clockwise seen from outside."""

    def __post_init__(self) -> None:
        """Keep read-only copies and check the values."""
        object.__setattr__(self, "vertices", frozen(self.vertices))
        object.__setattr__(self, "triangles", frozen(self.triangles, np.int64))
        if not len(self.triangles):
            raise ValueError("triangles: expected 1 or more, got none")
        lost = np.flatnonzero(~np.isfinite(self.vertices).all(axis=1))
        if len(lost):
            raise ValueError(
                f"vertices: expected finite ones, got {self.vertices[lost[0]].tolist()} (vertex {lost[0]})"
            )
        astray = np.flatnonzero(((self.triangles < 0) | (self.triangles >= len(self.vertices))).any(axis=1))
        if len(astray):
            raise ValueError(
                f"triangles: expected vertices 0 to {len(self.vertices) - 1}, got "
                f"{self.triangles[astray[0]].tolist()} (triangle {astray[0]})"
            )
        flat = np.flatnonzero(_double_areas(self.corners) <= FLAT * _longest_sides(self.corners) ** 2)
        if len(flat):
            raise ValueError(
                f"triangles: expected areas above 0, got {self.corners[flat[0]].tolist()} (triangle {flat[0]})"
            )

    @property
    def corners(self) -> Float[np.ndarray, "triangles 3 3"]:
        """Of each triangle, metres."""
        return self.vertices[self.triangles]

    @property
    def volume(self) -> float:
        """Cubic metres within; below 0 if it is inside out."""
        a, b, c = np.moveaxis(self.corners - self.vertices.mean(axis=0), 1, 0)
        return float((a * np.cross(b, c)).sum() / 6)


def _double_areas(corners: Float[np.ndarray, "triangles 3 3"]) -> Float[np.ndarray, " triangles"]:
    return np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)


def _longest_sides(corners: Float[np.ndarray, "triangles 3 3"]) -> Float[np.ndarray, " triangles"]:
    return np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)


def welded(vertices: Float[np.ndarray, "vertices 3"], triangles: Int[np.ndarray, "triangles 3"]) -> Mesh:
    """The mesh with vertices at the same place made one; those that differ in the last bit stay two."""
    # Adding 0 makes -0 of a file the same place as 0.
    places, row = np.unique(np.asarray(vertices, dtype=np.float64) + 0.0, axis=0, return_inverse=True)
    return Mesh(vertices=places, triangles=row.reshape(-1)[triangles])


def turned(mesh: Mesh) -> Mesh:
    """The mesh with its inside outside."""
    return Mesh(vertices=mesh.vertices, triangles=mesh.triangles[:, ::-1])


def joined_meshes(meshes: list[Mesh]) -> Mesh:
    """All of them as one mesh; they may run into each other."""
    before = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes[:-1]])
    return Mesh(
        vertices=np.concatenate([mesh.vertices for mesh in meshes]),
        triangles=np.concatenate([mesh.triangles + start for mesh, start in zip(meshes, before, strict=True)]),
    )


def solids_of(mesh: Mesh) -> list[Mesh]:
    """The solids that the mesh bounds, each with its cavities. Nothing is repaired.

    Raises:
        ValueError: If it is not watertight (names the first edge that does not have as many triangles on one side as on
            the other), or a shell is turned inward and lies in no solid (see `turned`).
    """
    _check_watertight(mesh)
    shells = _shells(mesh)
    volumes = np.array([shell.volume for shell in shells])
    if not (volumes > 0).any():
        raise ValueError(
            f"triangles: expected them counter-clockwise seen from outside, got a mesh that is inside out (volume "
            f"{volumes.sum():.6g} m3)"
        )
    solids = {int(number): [shells[number]] for number in np.flatnonzero(volumes > 0)}
    for cavity in np.flatnonzero(volumes <= 0):
        corner = shells[cavity].vertices[:1]
        about = [k for k in solids if round(float(winding_numbers(shells[k], corner)[0])) > 0]
        if not about:
            raise ValueError(
                f"triangles: expected them counter-clockwise seen from outside, got a part that is inside out and in "
                f"no other part (volume {volumes[cavity]:.6g} m3, with a vertex at {corner[0].tolist()})"
            )
        solids[min(about, key=lambda k: volumes[k])].append(shells[cavity])
    return [joined_meshes(parts) for parts in solids.values()]


def _check_watertight(mesh: Mesh) -> None:
    starts, ends = mesh.triangles, np.roll(mesh.triangles, -1, axis=1)
    edges = np.stack([starts.ravel(), ends.ravel()], axis=1)
    forward = edges[:, 0] < edges[:, 1]
    pairs, row = np.unique(np.sort(edges, axis=1), axis=0, return_inverse=True)
    row = row.reshape(-1)
    one, other = (np.bincount(row[way], minlength=len(pairs)) for way in (forward, ~forward))
    wrong = np.flatnonzero(one != other)
    if not len(wrong):
        return
    first = wrong[0]
    a, b = pairs[first]
    place = f"edge from vertex {a} at {mesh.vertices[a].tolist()} to vertex {b} at {mesh.vertices[b].tolist()}"
    if (one + other)[first] % 2:
        raise ValueError(
            f"triangles: expected a watertight mesh, got an open one, with {(one + other)[first]} triangle(s) at the "
            f"{place} and {len(wrong) - 1} more such edges"
        )
    raise ValueError(
        f"triangles: expected neighbours to run opposite ways along the edge they share, got {one[first]} and "
        f"{other[first]} either way at the {place}"
    )


def _shells(mesh: Mesh) -> list[Mesh]:
    count = len(mesh.vertices)
    first = np.repeat(mesh.triangles[:, 0], 2)
    links = coo_array((np.ones(len(first)), (first, mesh.triangles[:, 1:].ravel())), shape=(count, count))
    label = connected_components(links, directed=False)[1][mesh.triangles[:, 0]]
    shells = []
    for own in np.unique(label):
        used, row = np.unique(mesh.triangles[label == own], return_inverse=True)
        shells.append(Mesh(vertices=mesh.vertices[used], triangles=row.reshape(-1, 3)))
    return shells


def winding_numbers(mesh: Mesh, points: Float[np.ndarray, "points 3"]) -> Float[np.ndarray, " points"]:
    """How many times the mesh goes round each point: 1 inside and 0 outside of a closed one.

    Source: Van Oosterom and Strackee 1983, the solid angle of a plane triangle, equation 8.
    """
    total = np.empty(len(points))
    step = max(1, PAIRS // len(mesh.triangles))
    for start in range(0, len(points), step):
        a, b, c = np.moveaxis(mesh.corners - points[start : start + step, None, None], 2, 0)
        la, lb, lc = (np.linalg.norm(side, axis=-1) for side in (a, b, c))
        turn = (a * np.cross(b, c)).sum(axis=-1)
        rest = la * lb * lc + (a * b).sum(-1) * lc + (b * c).sum(-1) * la + (c * a).sum(-1) * lb
        total[start : start + step] = np.arctan2(turn, rest).sum(axis=1) / (2 * np.pi)
    return total


@dataclass(frozen=True, eq=False, kw_only=True)
class _Faces:
    """What distances to triangles are reckoned from, one row a triangle."""

    corners: Float[np.ndarray, "triangles 3 3"]
    sides: Float[np.ndarray, "triangles 3 3"]
    """From each corner to the next."""
    normal: Float[np.ndarray, "triangles 3"]
    """Unit vectors."""
    inward: Float[np.ndarray, "triangles 3 3"]
    """At right angles to each side, towards the triangle."""

    def __getitem__(self, index: np.ndarray) -> "_Faces":
        """Some of them."""
        return _Faces(**{name: values[index] for name, values in vars(self).items()})


def _faces(corners: Float[np.ndarray, "triangles 3 3"]) -> _Faces:
    sides = np.roll(corners, -1, axis=1) - corners
    normal = np.cross(sides[:, 0], sides[:, 1])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return _Faces(corners=corners, sides=sides, normal=normal, inward=np.cross(normal[:, None], sides))


def _distances(points: Float[np.ndarray, "pairs 3"], faces: _Faces) -> Float[np.ndarray, " pairs"]:
    """Of each point to its own triangle, metres: to the plane where it stands over the triangle, else to a side."""
    offset = points[:, None] - faces.corners
    over = (np.einsum("psi,psi->ps", offset, faces.inward) >= 0).all(axis=1)
    height = np.abs(np.einsum("pi,pi->p", offset[:, 0], faces.normal))
    square = np.einsum("psi,psi->ps", faces.sides, faces.sides)
    share = np.clip(np.einsum("psi,psi->ps", offset, faces.sides) / square, 0.0, 1.0)
    aside = offset - share[..., None] * faces.sides
    return np.where(over, height, np.sqrt(np.einsum("psi,psi->ps", aside, aside).min(axis=1)))


def surface_distances(mesh: Mesh, points: Float[np.ndarray, "points 3"]) -> Float[np.ndarray, " points"]:
    """Of each point to the mesh's surface, metres: the least over all triangles.

    Points close together are asked together: a triangle farther from the middle of a group than the nearest one, by
    more than the group is wide, is nearest to none of it. Groups are those of an octree, each level narrower.
    """
    faces = _faces(mesh.corners)
    order, code, levels = _curve(points)
    found = np.empty(len(points))
    at_once = max(1, PAIRS // len(mesh.triangles) * 8, 4096)
    for start in range(0, len(points), at_once):
        own = order[start : start + at_once]
        found[own] = _nearest(points[own], code[start : start + at_once], levels, faces)
    return found


def _curve(points: Float[np.ndarray, "points 3"]) -> tuple[np.ndarray, Int[np.ndarray, " points"], int]:
    """The order of points along Morton's curve, their codes in that order, and the levels of those."""
    levels = int(np.clip(np.ceil(np.log2(max(len(points), 2)) / 3), 1, 20))
    low = points.min(axis=0, initial=np.inf)
    side = max(float((points.max(axis=0, initial=-np.inf) - low).max()), np.finfo(float).tiny) if len(points) else 1.0
    place = np.minimum((points - low) / side * 2**levels, 2**levels - 1).astype(np.int64)
    code = np.zeros(len(points), dtype=np.int64)
    for level in range(levels):
        for axis in range(3):
            code |= ((place[:, axis] >> level) & 1) << (3 * level + axis)
    order = np.argsort(code, kind="stable")
    return order, code[order], levels


def _nearest(
    points: Float[np.ndarray, "points 3"], code: Int[np.ndarray, " points"], levels: int, faces: _Faces
) -> Float[np.ndarray, " points"]:
    """Distance of points, ordered by code, to the nearest of the triangles."""
    starts, best = np.zeros(1, dtype=np.int64), np.empty(0)
    group, triangle = np.zeros(len(faces.normal), dtype=np.int64), np.arange(len(faces.normal))
    for level in range(levels, -1, -1):
        # The last groups are single points.
        own = code >> (3 * level) if level else np.arange(len(points))
        begin = np.flatnonzero(np.append(True, own[1:] != own[:-1]))
        if len(begin) == len(starts) and level:
            continue
        parent = np.searchsorted(starts, begin, side="right") - 1
        low, high = np.minimum.reduceat(points, begin), np.maximum.reduceat(points, begin)
        group, triangle = _handed_down(group, triangle, parent)
        distance = np.concatenate(
            [
                _distances(0.5 * (low + high)[group[k : k + PAIRS]], faces[triangle[k : k + PAIRS]])
                for k in range(0, len(group), PAIRS)
            ]
        )
        first = np.flatnonzero(np.append(True, group[1:] != group[:-1]))
        best = np.minimum.reduceat(distance, first)
        wide = np.linalg.norm(high - low, axis=1) * (1 + 1e-9)
        kept = distance <= (best + wide)[group]
        group, triangle, starts = group[kept], triangle[kept], begin
    return best


def _handed_down(
    group: Int[np.ndarray, " pairs"], triangle: Int[np.ndarray, " pairs"], parent: Int[np.ndarray, " groups"]
) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of groups and triangles, from the triangles of each group's parent; ordered by group."""
    first = np.searchsorted(group, parent)
    count = np.searchsorted(group, parent, side="right") - first
    own = np.repeat(np.arange(len(parent)), count)
    rank = np.arange(len(own)) - np.repeat(np.cumsum(count) - count, count)
    return own, triangle[first[own] + rank]


def signed_distances(mesh: Mesh, points: Float[np.ndarray, "points 3"]) -> Float[np.ndarray, " points"]:
    """Of each point to the mesh, metres, below 0 inside.

    Where solids run into each other it is the least of theirs: right outside, and inside no deeper than the truth.

    Raises:
        ValueError: As `solids_of`.
    """
    solids = solids_of(mesh)
    inside = np.array([np.rint(winding_numbers(solid, points)) > 0 for solid in solids])
    return _signed(solids, inside, points, surface_distances(mesh, points))


def _signed(
    solids: list[Mesh],
    inside: Bool[np.ndarray, "solids points"],
    points: Float[np.ndarray, "points 3"],
    distance: Float[np.ndarray, " points"],
) -> Float[np.ndarray, " points"]:
    """Distances to all solids together, with depths below the surface of each in place of those inside it."""
    signed = np.where(inside.any(axis=0), 0.0, distance)
    for solid, own in zip(solids, inside, strict=True):
        signed[own] = np.minimum(signed[own], -surface_distances(solid, points[own]))
    return signed


@dataclass(frozen=True, eq=False, kw_only=True)
class DistanceGrid:
    """Signed distance on a grid of cubes round a mesh."""

    low: Float[np.ndarray, " 3"]
    """Place of the first cell, metres."""
    cell: float
    """Metres from one to the next."""
    distance: Float[np.ndarray, "x y z"]
    """Metres, below 0 inside."""

    @property
    def high(self) -> Float[np.ndarray, " 3"]:
        """Place of the last cell, metres."""
        return self.low + self.cell * (np.array(self.distance.shape) - 1)


def distance_grid(mesh: Mesh, cell: float, *, margin: int = 2, most: int = 4_000_000) -> DistanceGrid:
    """Signed distance to a mesh on a grid of cubes that reaches `margin` cells beyond it.

    As `signed_distances` of all cells, in less time: two neighbours that are together farther from the surface than
    from each other have the same sign.

    Raises:
        ValueError: As `solids_of`; if the cell is not above 0, or there are more than `most`.
    """
    if not cell > 0:
        raise ValueError(f"cell: expected above 0 m, got {cell}")
    solids = solids_of(mesh)
    low, high = mesh.vertices.min(axis=0) - margin * cell, mesh.vertices.max(axis=0) + margin * cell
    wanted = np.ceil((high - low) / cell) + 1
    if wanted.prod() > most:
        raise ValueError(
            f"cell: expected at most {most} cells of {cell} m, got {wanted.prod():.0f} in a box of {high - low} m"
        )
    size = wanted.astype(int)
    axes = [start + cell * np.arange(count) for start, count in zip(low, size, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    distance = surface_distances(mesh, points)
    region, first = _one_sided(distance.reshape(tuple(size)), cell)
    inside = np.array([np.rint(winding_numbers(solid, points[first])) > 0 for solid in solids])
    signed = _signed(solids, inside[:, region], points, distance)
    return DistanceGrid(low=low, cell=cell, distance=signed.reshape(tuple(size)))


def _one_sided(
    distance: Float[np.ndarray, "x y z"], cell: float
) -> tuple[Int[np.ndarray, " cells"], Int[np.ndarray, " regions"]]:
    """The region of each cell, within which no surface is crossed, and the cell of each that is farthest from it."""
    number = np.arange(distance.size).reshape(distance.shape)
    links = []
    for axis in range(3):
        ones, others = (np.moveaxis(grid, axis, 0) for grid in (number, distance))
        clear = others[:-1] + others[1:] > cell * (1 + 1e-9)
        links.append(np.stack([ones[:-1][clear], ones[1:][clear]], axis=1))
    a, b = np.concatenate(links).T
    graph = coo_array((np.ones(len(a)), (a, b)), shape=(distance.size, distance.size))
    region = connected_components(graph, directed=False)[1]
    by_distance = np.argsort(-distance.ravel(), kind="stable")
    return region, by_distance[np.unique(region[by_distance], return_index=True)[1]]
