"""Sunlight and daylight on every texel of a world of blocks, once per world."""

import cv2
import numba
import numpy as np

from pgm_data.simulate.blocks.mesh import Rectangles
from pgm_data.simulate.blocks.world import CELL_M, HALF_SIZE_M, LOWEST_M, OPAQUE, BlockWorld

DAYLIGHT_REACH_M = 5.0
SUN_SPREAD = 0.012
"""How far the rays that make a shadow's edge soft differ, radians."""


@numba.njit(cache=True, nogil=True, error_model="numpy")
def free_way(opaque, x, y, z, dx, dy, dz, reach):
    """Metres from a point along a unit direction to the first opaque cell, or `reach` where there is none before."""
    px = (x + HALF_SIZE_M) / CELL_M
    py = (y + HALF_SIZE_M) / CELL_M
    pz = (z - LOWEST_M) / CELL_M
    nx, ny, nz = opaque.shape
    i, j, k = int(np.floor(px)), int(np.floor(py)), int(np.floor(pz))
    big = 1e30
    sx = 1 if dx > 0 else -1
    sy = 1 if dy > 0 else -1
    sz = 1 if dz > 0 else -1
    ix = abs(1.0 / dx) if dx != 0 else big
    iy = abs(1.0 / dy) if dy != 0 else big
    iz = abs(1.0 / dz) if dz != 0 else big
    tx = ((i + 1 - px) if dx > 0 else (px - i)) * ix if dx != 0 else big
    ty = ((j + 1 - py) if dy > 0 else (py - j)) * iy if dy != 0 else big
    tz = ((k + 1 - pz) if dz > 0 else (pz - k)) * iz if dz != 0 else big
    t = 0.0
    limit = reach / CELL_M
    while t < limit:
        if tx <= ty and tx <= tz:
            t = tx
            tx += ix
            i += sx
        elif ty <= tz:
            t = ty
            ty += iy
            j += sy
        else:
            t = tz
            tz += iz
            k += sz
        if k >= nz and dz > 0:
            return reach
        if (i < 0 and dx <= 0) or (i >= nx and dx >= 0) or (j < 0 and dy <= 0) or (j >= ny and dy >= 0):
            return reach
        if k < 0 and dz <= 0:
            return reach
        if 0 <= i < nx and 0 <= j < ny and 0 <= k < nz and opaque[i, j, k] and t < limit:
            return t * CELL_M
    return reach


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _sunlit(opaque, points, normals, suns, out):
    """Share of the sun's disc that each point sees."""
    for n in range(len(points)):
        x = points[n, 0] + 0.004 * normals[n, 0]
        y = points[n, 1] + 0.004 * normals[n, 1]
        z = points[n, 2] + 0.004 * normals[n, 2]
        seen = 0
        for m in range(len(suns)):
            if free_way(opaque, x, y, z, suns[m, 0], suns[m, 1], suns[m, 2], 60.0) >= 60.0:
                seen += 1
        out[n] = seen / len(suns)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _daylit(opaque, points, normals, directions, reach, out):
    """Share of the sky above each point's surface that it sees; near walls count more than far ones."""
    for n in range(len(points)):
        nx, ny, nz = normals[n]
        x, y, z = points[n, 0] + 0.01 * nx, points[n, 1] + 0.01 * ny, points[n, 2] + 0.01 * nz
        total = 0.0
        for m in range(len(directions)):
            # Unit vectors on the whole sphere plus the normal are spread as the cosine asks.
            dx, dy, dz = directions[m, 0] + nx, directions[m, 1] + ny, directions[m, 2] + nz
            length = np.sqrt(dx * dx + dy * dy + dz * dz)
            if length < 1e-6:
                continue
            far = free_way(opaque, x, y, z, dx / length, dy / length, dz / length, reach)
            total += min(far / reach, 1.0)
        out[n] = total / len(directions)


def texel_points(rectangles: Rectangles, quad: int, step: int) -> np.ndarray:
    """World places in the middle of every step x step texels of a rectangle, (rows, columns, 3)."""
    wide, tall = rectangles.counts[quad]
    u = np.minimum(np.arange(0, wide, step) + 0.5 * step, wide - 0.5 * min(step, wide))
    v = np.minimum(np.arange(0, tall, step) + 0.5 * step, tall - 0.5 * min(step, tall))
    return (
        rectangles.corner[quad] + u[None, :, None] * rectangles.along[quad] + v[:, None, None] * rectangles.down[quad]
    )


def sunlight(world: BlockWorld, rectangles: Rectangles, sun: np.ndarray) -> np.ndarray:
    """Share of the sun that reaches each texel, without regard to its slope."""
    rng = np.random.default_rng(7)
    suns = sun + SUN_SPREAD * np.vstack([np.zeros(3), rng.normal(size=(3, 3))])
    suns /= np.linalg.norm(suns, axis=1)[:, None]
    points = np.vstack([texel_points(rectangles, q, 1).reshape(-1, 3) for q in range(len(rectangles))])
    normals = np.repeat(np.where(rectangles.two_sided[:, None], 0.0, rectangles.normal), _areas(rectangles), axis=0)
    lit = np.empty(len(points))
    _sunlit(OPAQUE[world.cells], points, normals, suns, lit)
    return lit


def daylight(world: BlockWorld, rectangles: Rectangles, rays: int) -> np.ndarray:
    """Share of the sky that each texel sees: reckoned every four texels, smooth between."""
    rng = np.random.default_rng(11)
    directions = rng.normal(size=(rays, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    grids = [texel_points(rectangles, q, 4) for q in range(len(rectangles))]
    points = np.vstack([g.reshape(-1, 3) for g in grids])
    normals = np.repeat(rectangles.normal, [g.shape[0] * g.shape[1] for g in grids], axis=0)
    seen = np.empty(len(points))
    _daylit(OPAQUE[world.cells], points, normals, directions, DAYLIGHT_REACH_M, seen)
    out, first = [], 0
    for quad, grid in enumerate(grids):
        rows, columns = grid.shape[:2]
        coarse = seen[first : first + rows * columns].reshape(rows, columns)
        first += rows * columns
        wide, tall = (int(c) for c in rectangles.counts[quad])
        fine = cv2.resize(coarse, (columns * 4, rows * 4), interpolation=cv2.INTER_LINEAR)[:tall, :wide]
        out.append(np.ascontiguousarray(fine).ravel())
    return np.concatenate(out)


def _areas(rectangles: Rectangles) -> np.ndarray:
    return rectangles.counts.prod(axis=1)
