"""What lies beyond the island, by direction alone: sky, blocky clouds, a square sun, and a country far below."""

import cv2
import numba
import numpy as np

MAP_CELLS = 256
CLOUD_CELLS = 128
DEPTH = 70.0
"""Height of the island over the country below, in the country's cells."""
CLOUD_DEPTH = 44.0
CLOUD_CELL = 2.6
CLOUD_HEIGHT = 60.0


def draw_sky(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The country's colours (cells, cells, 3), the same blurred, and the cover of the clouds, all to be tiled."""
    height = _hills(rng, MAP_CELLS, (48, 20, 9, 4), (1.0, 0.6, 0.35, 0.12))
    height = height - np.quantile(height, float(rng.uniform(0.35, 0.6)))
    height /= height.max()
    wet = np.clip(-height * 2.2, 0, 1)[..., None]
    sea = np.array((176, 108, 46)) * (1 - wet) + np.array((120, 62, 26)) * wet
    bands = [(0.0, sea), (0.05, (150, 202, 216)), (0.42, (64, 142, 92)), (0.66, (52, 108, 70)), (0.8, (118, 122, 124))]
    colours = np.broadcast_to(np.array((240, 242, 244.0)), (*height.shape, 3)).copy()
    for top, colour in reversed(bands):
        colours = np.where((height < top)[..., None], colour, colours)
    stepped = np.round(height * 14)
    slope = np.sign(stepped - np.roll(stepped, (1, 1), axis=(0, 1)))
    land = (height > 0)[..., None]
    shade = 1 + 0.11 * slope[..., None] * land + rng.uniform(-0.035, 0.035, height.shape)[..., None]
    colours = np.clip(colours * shade, 0, 255)
    cover = _hills(rng, CLOUD_CELLS, (10, 5, 3), (1.0, 0.7, 0.4))
    cover = (cover > np.quantile(cover, float(rng.uniform(0.86, 0.94)))).astype(float)
    blurred = cv2.blur(np.tile(colours, (3, 3, 1)), (5, 5))[MAP_CELLS : 2 * MAP_CELLS, MAP_CELLS : 2 * MAP_CELLS]
    return np.ascontiguousarray(colours), np.ascontiguousarray(blurred), cover


def _hills(rng: np.random.Generator, cells: int, sizes: tuple[int, ...], weights: tuple[float, ...]) -> np.ndarray:
    """Smooth noise that repeats every so many cells, of several sizes."""
    total = np.zeros((cells, cells))
    for size, weight in zip(sizes, weights, strict=True):
        coarse = rng.normal(size=(cells // size + 1, cells // size + 1))
        coarse = np.pad(coarse[:-1, :-1], 2, mode="wrap")
        fine = cv2.resize(coarse, None, fx=size, fy=size, interpolation=cv2.INTER_CUBIC)
        span = (cells // size) * size
        middle = fine[2 * size : 2 * size + span, 2 * size : 2 * size + span]
        total += weight * cv2.resize(middle, (cells, cells), interpolation=cv2.INTER_LINEAR)
    return total


@numba.njit(cache=True, nogil=True, error_model="numpy")
def sky_colour(direction, sun, sky, light, out):
    """Colour of a direction of any length."""
    country, blurred, cover = sky
    x, y, z = direction
    length = np.sqrt(x * x + y * y + z * z)
    x, y, z = x / length, y / length, z / length
    if z < -1e-3:
        far = DEPTH / -z
        u, v = x * far, y * far
        i, j = int(np.floor(u)) % MAP_CELLS, int(np.floor(v)) % MAP_CELLS
        mix = min(max((far - 260.0) / 600.0, 0.0), 1.0)
        haze = far / (far + 700.0)
        for c in range(3):
            ground = country[j, i, c] * (1 - mix) + blurred[j, i, c] * mix
            out[c] = ground + haze * (light[2, c] - ground)
        far = CLOUD_DEPTH / -z
        level = CLOUD_DEPTH
    else:
        up = min(max(z, 0.0) * 2.2, 1.0)
        for c in range(3):
            out[c] = light[2, c] + (light[4, c] - light[2, c]) * up
        if abs(x * sun[1] - y * sun[0]) < 0.05 and abs(z - sun[2]) < 0.04 and x * sun[0] + y * sun[1] > 0:
            for c in range(3):
                out[c] = 250.0
        far = CLOUD_HEIGHT / max(z, 1e-3)
        level = CLOUD_HEIGHT
    i = int(np.floor(x * far / CLOUD_CELL)) % CLOUD_CELLS
    j = int(np.floor(y * far / CLOUD_CELL)) % CLOUD_CELLS
    if cover[j, i] > 0:
        fade = 0.9 / (1.0 + (far / (6.0 * level)) ** 2)
        for c in range(3):
            out[c] += fade * (light[5, c] - out[c])
