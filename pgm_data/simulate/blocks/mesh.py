"""The surface of a world of blocks as rectangles in space, each with its own grid of texels."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from pgm_data.simulate.blocks.materials import MATERIALS, TEXELS, texture
from pgm_data.simulate.blocks.world import CELL_M, CELLS, HALF_SIZE_M, LOWEST_M, OPAQUE, BlockWorld

TEXEL_M = 1.0 / TEXELS
ORIGIN = np.array([-HALF_SIZE_M, -HALF_SIZE_M, LOWEST_M])


@dataclass(frozen=True, eq=False, kw_only=True)
class Rectangles:
    """Textured rectangles; texel (u, v) of one covers corner + (u..u+1) along + (v..v+1) down."""

    corner: Float[np.ndarray, "quads 3"]
    """World metres of texel (0, 0)'s outer corner."""
    along: Float[np.ndarray, "quads 3"]
    """One texel's step in u, metres."""
    down: Float[np.ndarray, "quads 3"]
    """One texel's step in v."""
    counts: Int[np.ndarray, "quads 2"]
    """Texels in u, v."""
    normal: Float[np.ndarray, "quads 3"]
    """Unit, outwards."""
    two_sided: Bool[np.ndarray, " quads"]
    offsets: Int[np.ndarray, " quads"]
    """Where each rectangle's texels begin; rows of v, u within a row."""
    texels: UInt8[np.ndarray, "texels 4"]
    """BGR and coverage (0 or 255)."""

    def __len__(self) -> int:
        """Number of rectangles."""
        return len(self.corner)


@dataclass(eq=False)
class _Heap:
    """Rectangles while they are gathered."""

    corner: list
    along: list
    down: list
    counts: list
    normal: list
    two_sided: list
    texels: list

    def add(self, corner, along, down, picture: np.ndarray, normal, two_sided: bool = False) -> None:
        self.corner.append(corner)
        self.along.append(np.asarray(along) * TEXEL_M)
        self.down.append(np.asarray(down) * TEXEL_M)
        self.counts.append((picture.shape[1], picture.shape[0]))
        self.normal.append(normal)
        self.two_sided.append(two_sided)
        self.texels.append(picture.reshape(-1, 4))


def world_rectangles(world: BlockWorld) -> Rectangles:
    """All that is to be seen of a world but from below."""
    heap = _Heap([], [], [], [], [], [], [])
    _faces(world, heap)
    _ladders(world, heap)
    _posts(world, heap)
    _plants(world, heap)
    counts = np.array(heap.counts)
    return Rectangles(
        corner=np.array(heap.corner, dtype=float),
        along=np.array(heap.along, dtype=float),
        down=np.array(heap.down, dtype=float),
        counts=counts,
        normal=np.array(heap.normal, dtype=float),
        two_sided=np.array(heap.two_sided),
        offsets=np.concatenate([[0], np.cumsum(counts.prod(axis=1))[:-1]]),
        texels=np.vstack(heap.texels),
    )


# For each face: axis, side, u axis, sign of u, v axis, sign of v (v runs down the picture).
_SIDES = (
    (0, 1, 1, 1, 2, -1),
    (0, -1, 1, -1, 2, -1),
    (1, 1, 0, -1, 2, -1),
    (1, -1, 0, 1, 2, -1),
    (2, 1, 0, 1, 1, -1),
)


def _faces(world: BlockWorld, heap: _Heap) -> None:
    tops = np.stack([texture(m.top) if m.name != "air" else np.zeros((16, 16, 4), np.uint8) for m in MATERIALS])
    sides = np.stack([texture(m.side) if m.name != "air" else np.zeros((16, 16, 4), np.uint8) for m in MATERIALS])
    half = TEXELS // 2
    padded = np.pad(world.cells, 1)
    for axis, side, u_axis, u_sign, v_axis, v_sign in _SIDES:
        beyond = np.roll(padded, -side, axis=axis)[1:-1, 1:-1, 1:-1]
        shown = (world.cells > 0) & ~OPAQUE[beyond] & (beyond != world.cells)
        for layer in range(CELLS[axis]):
            plane = np.take(shown, layer, axis=axis)
            cells = np.take(world.cells, layer, axis=axis)
            if not plane.any():
                continue
            # Plane axes in the order of the remaining ones; u along columns, v along rows.
            rest = [a for a in range(3) if a != axis]
            if rest[0] == u_axis:
                plane, cells = plane.T, cells.T
            solid = OPAQUE[cells]
            for mask in (plane & solid, plane & ~solid):
                for v0, u0, v1, u1 in _merged(mask):
                    block = cells[v0:v1, u0:u1]
                    picture = _picture(tops if axis == 2 else sides, block, u0, v0, u_sign, v_sign, half)
                    corner = np.empty(3)
                    corner[axis] = layer + (1 if side > 0 else 0)
                    corner[u_axis] = u0 if u_sign > 0 else u1
                    corner[v_axis] = v0 if v_sign > 0 else v1
                    unit = np.eye(3)
                    heap.add(
                        ORIGIN + CELL_M * corner,
                        u_sign * unit[u_axis],
                        v_sign * unit[v_axis],
                        picture,
                        side * unit[axis],
                    )


def _picture(
    textures: np.ndarray, block: np.ndarray, u0: int, v0: int, u_sign: int, v_sign: int, half: int
) -> np.ndarray:
    """Texels of a rectangle of cells; textures keep to the metres of the world, upright."""
    rows, columns = block.shape
    u = np.arange(columns * half)
    v = np.arange(rows * half)
    cell_u = u0 * half + (u if u_sign > 0 else columns * half - 1 - u)
    cell_v = v0 * half + (v if v_sign > 0 else rows * half - 1 - v)
    tex_u = cell_u % TEXELS if u_sign > 0 else TEXELS - 1 - cell_u % TEXELS
    tex_v = cell_v % TEXELS if v_sign > 0 else TEXELS - 1 - cell_v % TEXELS
    kind = block[(cell_v // half - v0)[:, None], (cell_u // half - u0)[None, :]]
    return textures[kind, tex_v[:, None], tex_u[None, :]]


def _merged(mask: np.ndarray) -> list[tuple[int, int, int, int]]:
    """Rectangles (first row, first column, row after, column after) that cover a mask once, widest rows first."""
    left = mask.copy()
    found = []
    for row in range(mask.shape[0]):
        for column in np.flatnonzero(left[row]).tolist():
            if not left[row, column]:
                continue
            run = left[row, column:]
            wide = int(np.argmin(run)) if not run.all() else len(run)
            end = row + 1
            while end < mask.shape[0] and left[end, column : column + wide].all():
                end += 1
            left[row:end, column : column + wide] = False
            found.append((row, column, end, column + wide))
    return found


def _ladders(world: BlockWorld, heap: _Heap) -> None:
    rungs = texture("ladder")
    for ladder in world.ladders:
        toward = np.array([*ladder.towards, 0.0])
        right = np.array([ladder.towards[1], -ladder.towards[0], 0.0])
        middle = np.array([ladder.column[0] + 0.5, ladder.column[1] + 0.5, 0.0]) - [HALF_SIZE_M, HALF_SIZE_M, 0.0]
        texels = (ladder.top - ladder.bottom) * TEXELS // 2
        picture = np.tile(rungs, (texels // TEXELS + 1, 1, 1))[-texels:]
        corner = middle + (0.5 - TEXEL_M) * toward - 0.5 * right + [0, 0, ladder.top * CELL_M]
        heap.add(corner, right, (0.0, 0.0, -1.0), picture, -toward, two_sided=True)


def _posts(world: BlockWorld, heap: _Heap) -> None:
    wood = texture("planks")
    for low, high in world.posts:
        _box(heap, low, high, wood)


def _box(heap: _Heap, low: np.ndarray, high: np.ndarray, picture: np.ndarray) -> None:
    unit = np.eye(3)
    for axis, side, u_axis, u_sign, v_axis, v_sign in _SIDES:
        corner = np.empty(3)
        corner[axis] = high[axis] if side > 0 else low[axis]
        corner[u_axis] = low[u_axis] if u_sign > 0 else high[u_axis]
        corner[v_axis] = low[v_axis] if v_sign > 0 else high[v_axis]
        size = np.round((high - low) / TEXEL_M).astype(int)
        heap.add(
            corner,
            u_sign * unit[u_axis],
            v_sign * unit[v_axis],
            picture[: size[v_axis], : size[u_axis]],
            side * unit[axis],
        )


def _plants(world: BlockWorld, heap: _Heap) -> None:
    for plant in world.plants:
        for across in (np.array([0.6, 0.6, 0.0]), np.array([0.6, -0.6, 0.0])):
            picture = texture(plant.texture)
            corner = plant.base - 0.5 * across + [0.0, 0.0, 0.85]
            normal = np.array([across[1], -across[0], 0.0]) / float(np.linalg.norm(across))
            heap.add(corner, across, (0.0, 0.0, -0.85), picture, normal, two_sided=True)
