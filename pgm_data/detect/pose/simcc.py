"""RTMPose and its kin in ONNX files: each coordinate as a row of bins.

Source: Jiang et al., "RTMPose: Real-Time Multi-Person Pose Estimation based on MMPose", 2023; Li et al., "SimCC", 2022.
"""

from pathlib import Path
from typing import TYPE_CHECKING

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


class SimccPose:
    """The network."""

    body_share = BODY_SHARE

    def __init__(self, session: "InferenceSession", path: Path) -> None:
        """Take the session of the file at that path.

        Raises:
            ValueError: If its answers are not rows of bins for x and for y.
        """
        self._session = session
        self.input_size = input_size_of(session, path)
        outputs = session.get_outputs()
        if not gives_bins(session):
            got = ", ".join(f"{entry.name}{entry.shape}" for entry in outputs)
            raise ValueError(f"pose network {path}: answers: expected simcc_x and simcc_y of three axes, got {got}")
        self.point_names, self._places = layout_of(outputs[0].shape[1], path)

    def __call__(self, crops: UInt8[np.ndarray, "crops height width 3"]) -> CropPoses:
        """The points in crops."""
        along_x, along_y = answers(self._session, crops, self.input_size)
        points = [
            _tops(bins[:, self._places].astype(np.float64), side)
            for bins, side in zip((along_x, along_y), self.input_size, strict=True)
        ]
        score = np.clip(np.minimum(points[0][1], points[1][1]), 0.0, 1.0)
        return CropPoses(
            points_px=np.stack([points[0][0], points[1][0]], axis=-1),
            score=score,
            sigma_px=scatter(self.point_names, score, self.input_size[1]),
            points_ray=np.full((*score.shape, 3), np.nan),
            presence=presence_of(score),
        )


def gives_bins(session: "InferenceSession") -> bool:
    """Whether the network's answers look like rows of bins for x and for y."""
    shapes = [entry.shape for entry in session.get_outputs()]
    return len(shapes) == 2 and all(len(shape) == 3 for shape in shapes) and shapes[0][1] == shapes[1][1]


def _tops(
    bins: Float[np.ndarray, "crops points bins"], side: int
) -> tuple[Float[np.ndarray, "crops points"], Float[np.ndarray, "crops points"]]:
    """Place of the highest bin, px of the crop, and its height."""
    best = np.argmax(bins, axis=-1)
    inner = np.clip(best, 1, bins.shape[-1] - 2)
    around = [np.take_along_axis(bins, (inner + step)[..., None], axis=-1)[..., 0] for step in (-1, 0, 1)]
    place = best + np.where(inner == best, peak_offset(*around), 0.0)
    return place * side / bins.shape[-1], np.take_along_axis(bins, best[..., None], axis=-1)[..., 0]
