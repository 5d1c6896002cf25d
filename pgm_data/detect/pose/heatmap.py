"""ViTPose and its kin in ONNX files: a heat map a point.

Source: Xu et al., "ViTPose", 2022; places between the cells after Zhang et al., "Distribution-Aware Coordinate
Representation for Human Pose Estimation", 2020; cell to pixel after Huang et al., "The Devil is in the Details", 2020.
"""

from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from pgm_data.detect.pose.model import CropPoses
from pgm_data.detect.pose.onnx_crops import (
    BODY_SHARE,
    answers,
    input_size_of,
    layout_of,
    peak_offset,
    presence_of,
    scatter,
)

if TYPE_CHECKING:
    from onnxruntime import InferenceSession

BLUR_CELLS = 1.0
"""Standard deviation of the blur before a peak's place is read; the networks were taught blobs of 2 cells."""


class HeatmapPose:
    """The network."""

    body_share = BODY_SHARE

    def __init__(self, session: "InferenceSession", path: Path) -> None:
        """Take the session of the file at that path.

        Raises:
            ValueError: If its answer is not a heat map a point.
        """
        self._session = session
        self.input_size = input_size_of(session, path)
        outputs = session.get_outputs()
        if not gives_heat(session):
            got = ", ".join(f"{entry.name}{entry.shape}" for entry in outputs)
            raise ValueError(f"pose network {path}: answers: expected heat maps (n, points, rows, columns), got {got}")
        self.point_names, self._places = layout_of(outputs[0].shape[1], path)

    def __call__(self, crops: UInt8[np.ndarray, "crops height width 3"]) -> CropPoses:
        """The points in crops."""
        heat = answers(self._session, crops, self.input_size)[0][:, self._places].astype(np.float64)
        cells, score = heat_peaks(heat)
        # The corners' cells lie on the corners' pixels.
        pixels_per_cell = (np.array(self.input_size) - 1.0) / np.maximum(np.array(heat.shape[:1:-1]) - 1.0, 1.0)
        score = np.clip(score, 0.0, 1.0)
        return CropPoses(
            points_px=cells * pixels_per_cell,
            score=score,
            sigma_px=scatter(self.point_names, score, self.input_size[1]),
            points_ray=np.full((*score.shape, 3), np.nan),
            presence=presence_of(score),
        )


def gives_heat(session: "InferenceSession") -> bool:
    """Whether the network's answer looks like a heat map a point."""
    shapes = [entry.shape for entry in session.get_outputs()]
    return len(shapes) == 1 and len(shapes[0]) == 4


def heat_peaks(
    heat: Float[np.ndarray, "crops points rows columns"],
) -> tuple[Float[np.ndarray, "crops points 2"], Float[np.ndarray, "crops points"]]:
    """Column and row of every map's highest place, between the cells, and its height.

    The logarithm of a blob is a parabola, whose top three cells along each axis fix.
    """
    crops, points, rows, columns = heat.shape
    flat = heat.reshape(crops * points, rows, columns)
    soft = np.stack([cv2.GaussianBlur(one, (0, 0), BLUR_CELLS, borderType=cv2.BORDER_REPLICATE) for one in flat])
    best = np.argmax(flat.reshape(len(flat), -1), axis=-1)
    row, column = np.divmod(best, columns)
    log = np.log(np.maximum(soft, 1e-10))
    every = np.arange(len(flat))
    inner_row, inner_column = np.clip(row, 1, rows - 2), np.clip(column, 1, columns - 2)
    down = peak_offset(*(log[every, inner_row + step, column] for step in (-1, 0, 1)))
    right = peak_offset(*(log[every, row, inner_column + step] for step in (-1, 0, 1)))
    right = np.where(inner_column == column, right, 0.0)
    down = np.where(inner_row == row, down, 0.0)
    place = np.stack([column + right, row + down], axis=-1)
    return place.reshape(crops, points, 2), flat.reshape(len(flat), -1)[every, best].reshape(crops, points)
