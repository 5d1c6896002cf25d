"""From light to the bytes of a picture: dark corners, sensor noise and the tone curve, in one pass."""

import numba
import numpy as np


@numba.njit(cache=True, nogil=True, error_model="numpy")
def exposed(picture, grain, down, right, noise, vignette, table, out):
    """Fills `out` (H, W, 3) uint8 from light (H, W, 3) float32, 0 to 255.

    `grain` is read from row `down` and column `right` on and multiplied by `noise`; `vignette` darkens the corners, 0
    to 1; `table` (256, 3) gives the output of every value by channel.
    """
    height, width = picture.shape[0], picture.shape[1]
    amount = np.float32(noise)
    for row in range(height):
        y = 2.0 * row / max(height - 1, 1) - 1.0
        for column in range(width):
            dim = np.float32(1.0)
            if vignette > 0.0:
                x = 2.0 * column / max(width - 1, 1) - 1.0
                dim = np.float32(1.0 - 0.5 * vignette * (x * x + y * y))
            for k in range(3):
                value = picture[row, column, k] * dim
                if noise > 0.0:
                    value += amount * grain[down + row, right + column, k]
                value = min(max(value + np.float32(0.5), np.float32(0.0)), np.float32(255.0))
                out[row, column, k] = table[int(value), k]
