"""Marks drawn into pictures: lines, circles and words, as far as they lie in the picture."""

import cv2
import numpy as np
from jaxtyping import Float

from pgm_data.stages.court_drawing import BGR, SUBPIXEL_BITS, clipped


def lies_near(picture: np.ndarray, pixel: np.ndarray) -> bool:
    """Whether the pixel lies in the picture, or so near that a mark might."""
    height, width = picture.shape[:2]
    return bool((pixel > -50).all() and pixel[0] < width + 50 and pixel[1] < height + 50)


def draw_path(picture: np.ndarray, pixels: Float[np.ndarray, "points 2"], colour: BGR, thickness: int) -> None:
    """Draw the points joined."""
    draw_pieces(picture, np.stack([pixels[:-1], pixels[1:]], axis=1), colour, thickness)


def draw_pieces(picture: np.ndarray, pieces: Float[np.ndarray, "pieces 2 2"], colour: BGR, thickness: int) -> None:
    """Draw the straight pieces."""
    height, width = picture.shape[:2]
    inside = clipped(pieces, np.array([-2.0, -2.0]), np.array([width + 1.0, height + 1.0]))
    fixed_point = np.round(inside * (1 << SUBPIXEL_BITS)).astype(np.int32)
    cv2.polylines(picture, list(fixed_point), False, colour, thickness, cv2.LINE_AA, SUBPIXEL_BITS)


def draw_circle(picture: np.ndarray, pixel: np.ndarray, radius: float, colour: BGR, thickness: int) -> None:
    """Draw a circle."""
    if lies_near(picture, pixel):
        x, y, r = (round(float(value) * (1 << SUBPIXEL_BITS)) for value in (*pixel, radius))
        cv2.circle(picture, (x, y), r, colour, thickness, cv2.LINE_AA, SUBPIXEL_BITS)


def draw_words(picture: np.ndarray, pixel: np.ndarray, text: str, colour: BGR) -> None:
    """Write words on a darker ground, their lower left corner at the pixel."""
    if not lies_near(picture, pixel):
        return
    size = max(0.45, picture.shape[1] / 2000)
    (width, height), below = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, size, 1)
    x, y = (round(float(value)) for value in pixel)
    ground = picture[max(y - height - 3, 0) : max(y + below, 0), max(x - 3, 0) : max(x + width + 3, 0)]
    ground[:] = ground // 2
    cv2.putText(picture, text, (x, y), cv2.FONT_HERSHEY_SIMPLEX, size, colour, 1, cv2.LINE_AA)
