"""Where the objects of a scene are seen in pictures: rectangles about their boxes of the world."""

from itertools import product

import numpy as np
from jaxtyping import Bool, Float

from pgm_data.geometry.camera import Camera, project

BODY_MARGIN_M = 0.2
"""Of a body beyond its joints."""
CORNERS = np.array(list(product((0, 1), repeat=3)))
"""Of a box: which of its two ends along each axis."""


def scaled_pixels(
    pixels: Float[np.ndarray, "*batch 2"], factor: Float[np.ndarray, "... 2"]
) -> Float[np.ndarray, "*batch 2"]:
    """Where pixels lie in a picture that is scaled by those factors in x and y, its edges onto the new edges."""
    return (pixels + 0.5) * factor - 0.5


def scaled_K(K: Float[np.ndarray, "*batch 3 3"], factor: Float[np.ndarray, "... 2"]) -> Float[np.ndarray, "*batch 3 3"]:
    """Intrinsics of pictures scaled by those factors in x and y, pixel edges onto pixel edges."""
    result = np.array(K)
    result[..., :2, :2] = K[..., :2, :2] * factor[..., :, None]
    result[..., :2, 2] = scaled_pixels(K[..., :2, 2], factor)
    return result


def whole_picture(size: tuple[int, int]) -> Float[np.ndarray, " 4"]:
    """The rectangle to the outer edges of the pixels of a picture of that width and height."""
    return np.array([-0.5, -0.5, size[0] - 0.5, size[1] - 0.5])


def boxes_px(
    cameras: Camera, low: Float[np.ndarray, "frames 3"], high: Float[np.ndarray, "frames 3"], size: tuple[int, int]
) -> Float[np.ndarray, "frames 4"]:
    """The rectangles x0, y0, x1, y1 that boxes of the world fill in pictures, not cut at their borders.

    NaN of a box that is missing, behind the camera or beside the picture; the whole picture of one that the camera is
    so near to that not all its corners have a pixel.

    Args:
        cameras: One a frame.
        low: Lowest corners, metres; NaN where there is no box.
        high: Highest corners.
        size: Width and height of the pictures.
    """
    points = np.where(CORNERS[None] == 0, low[:, None], high[:, None])
    pixels, seen = project(cameras, points)
    R, t = cameras.R_cam_from_world, cameras.t_cam_from_world
    depth = points @ R[:, 2, :, None] + t[:, 2, None, None]
    there = np.asarray(np.isfinite(low + high).all(axis=1) & (depth[:, :, 0] > 0).any(axis=1))
    corner = np.where(seen[..., None], pixels, 0.0)
    found = np.concatenate([corner.min(axis=1), corner.max(axis=1)], axis=1)
    whole = whole_picture(size)
    found = np.where(np.asarray(seen.all(axis=1))[:, None], found, whole)
    return np.where((there & _overlaps(found, whole))[:, None], found, np.nan)


def _overlaps(found: Float[np.ndarray, "frames 4"], other: Float[np.ndarray, " 4"]) -> Bool[np.ndarray, " frames"]:
    return np.asarray(((found[:, :2] < other[2:]) & (found[:, 2:] > other[:2])).all(axis=1))
