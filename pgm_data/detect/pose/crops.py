"""Crops around boxes: cut out at sub-pixel places, and points carried between crop and picture."""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from pgm_data.geometry.arrays import frozen


@dataclass(frozen=True, eq=False, kw_only=True)
class Windows:
    """Upright rectangles of one picture, all of one shape, that become crops of one size.

    The centre of a window becomes the centre of the crop, (size - 1) / 2.

    Raises:
        ValueError: If a window has no size.
    """

    centre_px: Float[np.ndarray, "windows 2"]
    """x, y in the picture."""
    height_px: Float[np.ndarray, " windows"]
    size: tuple[int, int]
    """Width and height of the crops, px; the windows' proportions are theirs."""

    def __post_init__(self) -> None:
        """Keep read-only copies and check the sizes."""
        object.__setattr__(self, "centre_px", frozen(self.centre_px))
        object.__setattr__(self, "height_px", frozen(self.height_px))
        bad = np.flatnonzero(~(np.isfinite(self.height_px) & (self.height_px > 0)))
        if len(bad):
            raise ValueError(f"windows: height_px: window {bad[0]}: expected above 0, got {self.height_px[bad[0]]}")

    @property
    def scale(self) -> Float[np.ndarray, " windows"]:
        """Crop pixels per picture pixel."""
        return self.size[1] / self.height_px

    def picture_from_crop(self, points: Float[np.ndarray, "windows points 2"]) -> Float[np.ndarray, "windows points 2"]:
        """Picture pixels of points in the crops."""
        middle = (np.array(self.size) - 1) / 2
        return self.centre_px[:, None] + (points - middle) / self.scale[:, None, None]

    def crop_from_picture(self, points: Float[np.ndarray, "windows points 2"]) -> Float[np.ndarray, "windows points 2"]:
        """Crop pixels of points in the picture: the inverse of `picture_from_crop`."""
        middle = (np.array(self.size) - 1) / 2
        return middle + (points - self.centre_px[:, None]) * self.scale[:, None, None]


def windows_around(boxes: Float[np.ndarray, "windows 4"], size: tuple[int, int], *, body_share: float) -> Windows:
    """Windows centred on boxes, so large that a box fills that share of the crop's height or less.

    A box with an arm or a leg stretched out sideways is wider than high: its width then rules.
    """
    extent = boxes[:, 2:] - boxes[:, :2]
    height = np.maximum(extent[:, 1], extent[:, 0] * size[1] / size[0]) / body_share
    return Windows(centre_px=(boxes[:, :2] + boxes[:, 2:]) / 2, height_px=height, size=size)


def cut(picture: UInt8[np.ndarray, "height width 3"], windows: Windows) -> UInt8[np.ndarray, "windows high wide 3"]:
    """The crops; grey where a window reaches beyond the picture; averaged where a crop is smaller than its window."""
    wide, high = windows.size
    crops = np.empty((len(windows.height_px), high, wide, 3), dtype=np.uint8)
    for index, (centre, scale) in enumerate(zip(windows.centre_px, windows.scale, strict=True)):
        # A window much larger than its crop is drawn larger first, so that no pixel is left out.
        finer = max(1, int(np.ceil(0.75 / scale)))
        middle = (np.array([wide, high]) * finer - 1) / 2
        matrix = np.array([[scale * finer, 0.0, 0.0], [0.0, scale * finer, 0.0]])
        matrix[:, 2] = middle - scale * finer * centre
        drawn = cv2.warpAffine(
            picture,
            matrix,
            (wide * finer, high * finer),
            flags=cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_CONSTANT,
            borderValue=(114, 114, 114),
        )
        crops[index] = drawn if finer == 1 else cv2.resize(drawn, (wide, high), interpolation=cv2.INTER_AREA)
    return crops
