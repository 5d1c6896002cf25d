"""A world of blocks: what fills every half-metre cell, the named things in it, and what a body may touch.

World metres: x east, y north, z up; ground at z = 0. Cells are cubes of half a metre, columns are squares of one metre.
A level is a height in half metres above the ground.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from pgm_data.simulate.blocks.materials import MATERIALS, material_id

CELL_M = 0.5
LOWEST_M = -2.0
COLUMNS = 16
HALF_SIZE_M = 8.0
CELLS = (32, 32, 20)
GROUND_CELL = 4
"""Index along z of the first cell above the ground."""
BODY_HALF_M = 0.3
"""Half the width of the upright box that bodies collide with."""
BODY_HEIGHT_M = 1.8

ElementKind = Literal["platform", "pillar", "block", "stairs", "bridge"]


@dataclass(frozen=True, eq=False, kw_only=True)
class Element:
    """One thing with names, on whose top a player can stand."""

    kind: ElementKind
    material: str
    """The word for what it is made of: stone, birch, red, ..."""
    columns: Int[np.ndarray, "columns 2"]
    """Column indices along x, y."""
    levels: Int[np.ndarray, " columns"]
    """Level of the top of each column."""
    names: tuple[str, ...]
    """Noun phrases after `the`, each true of no other element of its world."""

    @property
    def centre(self) -> np.ndarray:
        """Middle of its top, world metres."""
        return np.array([*(self.columns.mean(axis=0) + 0.5 - HALF_SIZE_M), self.levels.mean() * CELL_M])


@dataclass(frozen=True, eq=False, kw_only=True)
class Ladder:
    """A ladder on a wall."""

    column: tuple[int, int]
    """Where the climber is."""
    towards: tuple[int, int]
    """Step to the column of the wall."""
    bottom: int
    """Level of its foot."""
    top: int
    """Level of the wall's top."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Plant:
    """A flower or tuft: two crossed pictures, one metre wide, that nothing collides with."""

    base: Float[np.ndarray, " 3"]
    """World metres."""
    texture: str


@dataclass(frozen=True, eq=False, kw_only=True)
class BlockWorld:
    """One static world."""

    cells: UInt8[np.ndarray, "32 32 20"]
    """Material of every cell; 0 is air."""
    elements: tuple[Element, ...]
    ladders: tuple[Ladder, ...]
    plants: tuple[Plant, ...]
    posts: Float[np.ndarray, "posts 2 3"]
    """Lower and upper corners of thin boxes of wood (fences), world metres."""


def cell_of(points: Float[np.ndarray, "... 3"]) -> np.ndarray:
    """Indices of the cells that hold world points; they may lie outside of the grid."""
    return np.floor((points - [-HALF_SIZE_M, -HALF_SIZE_M, LOWEST_M]) / CELL_M).astype(np.int64)


def solid_at(world: BlockWorld, points: Float[np.ndarray, "... 3"]) -> Bool[np.ndarray, "..."]:
    """Whether world points lie inside of something a body cannot pass; nothing is solid outside of the grid."""
    index = cell_of(points)
    inside = np.asarray(((index >= 0) & (index < CELLS)).all(axis=-1))
    i, j, k = np.moveaxis(np.where(inside[..., None], index, 0), -1, 0)
    return inside & SOLID[world.cells[i, j, k]]


SOLID = np.array([m.solid for m in MATERIALS])
OPAQUE = np.array([m.opaque for m in MATERIALS])
STANDABLE = np.array([m.standable for m in MATERIALS])


def body_fits(world: BlockWorld, feet: Float[np.ndarray, "... 3"]) -> Bool[np.ndarray, "..."]:
    """Whether an upright body whose soles' middle is there overlaps nothing solid (1 mm of touch allowed)."""
    reach = BODY_HALF_M - 1e-3
    flat = np.array([-reach, 0.0, reach])
    up = np.array([1e-3, 0.45, 0.9, 1.35, BODY_HEIGHT_M - 1e-3])
    offsets = np.stack(np.meshgrid(flat, flat, up, indexing="ij"), axis=-1).reshape(-1, 3)
    points = feet[..., None, :] + offsets
    free = np.asarray(~solid_at(world, points).any(axis=-1))
    for low, high in world.posts:
        apart = (feet[..., :2] + reach <= low[:2]) | (feet[..., :2] - reach >= high[:2])
        clear = apart.any(axis=-1) | (feet[..., 2] >= high[2] - 1e-3) | (feet[..., 2] + BODY_HEIGHT_M <= low[2])
        free = free & clear
    return np.asarray(free)


def standing_levels(world: BlockWorld) -> Bool[np.ndarray, "16 16 20"]:
    """Where a body can stand: [i, j, level], the column's top at that level whole and 2 m above it free."""
    solid = SOLID[world.cells].reshape(16, 2, 16, 2, CELLS[2])
    firm = np.asarray(STANDABLE[world.cells].reshape(16, 2, 16, 2, CELLS[2]).all(axis=(1, 3)))
    blocked = np.asarray(solid.any(axis=(1, 3)))
    stands = np.zeros((16, 16, 20), dtype=bool)
    for level in range(CELLS[2] - GROUND_CELL):
        k = level + GROUND_CELL
        stands[:, :, level] = firm[:, :, k - 1] & ~blocked[:, :, k : k + 4].any(axis=2)
    for low, high in world.posts:
        i, j = np.floor((low[:2] + high[:2]) / 2 + HALF_SIZE_M).astype(int)
        stands[i, j, 0] = False
    return stands


def column_centre(column: tuple[int, int], level: float) -> np.ndarray:
    """World metres of the middle of a column at a level."""
    return np.array([column[0] + 0.5 - HALF_SIZE_M, column[1] + 0.5 - HALF_SIZE_M, level * CELL_M])


def column_of(points: Float[np.ndarray, "... 3"]) -> np.ndarray:
    """Column indices of world points, inside of the island."""
    return np.clip(np.floor(points[..., :2] + HALF_SIZE_M), 0, COLUMNS - 1).astype(np.int64)


def fill(cells: np.ndarray, column: tuple[int, int], bottom: int, top: int, material: str) -> None:
    """Put a material into a column from level to level."""
    i, j = column
    cells[2 * i : 2 * i + 2, 2 * j : 2 * j + 2, GROUND_CELL + bottom : GROUND_CELL + top] = material_id(material)
