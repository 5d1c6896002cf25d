"""Pictures to encode: smooth, coloured, different in every frame."""

import cv2
import numpy as np


def drawn_pictures(count: int, width: int = 160, height: int = 96, seed: int = 0) -> list[np.ndarray]:
    """BGR pictures of a soft pattern that moves three pixels a frame."""
    coarse = np.random.default_rng(seed).integers(0, 255, (6, 10, 3), dtype=np.uint8)
    wide = cv2.resize(coarse, (width + 3 * count, height), interpolation=cv2.INTER_CUBIC)
    return [np.ascontiguousarray(wide[:, 3 * i : 3 * i + width]) for i in range(count)]
