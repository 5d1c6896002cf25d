"""BlazePose through OpenCV's reader of TFLite files.

Source: Bazarevsky et al., "BlazePose: On-device Real-time Body Pose tracking", 2020; the weights are those that
`pgm weights pose` fetches.
"""

import os
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from pgm_data.detect.pose.model import COCO_POINTS, CropPoses, checked_crops

SIDE = 256
"""Of its square crops, px."""
LANDMARKS, PRESENCE, MASK, HEAT, WORLD = "Identity", "Identity_1", "Identity_2", "Identity_3", "Identity_4"
POINTS = (*COCO_POINTS, "left_heel", "right_heel", "left_big_toe", "right_big_toe")
ROWS = np.array([0, 2, 5, 7, 8, *range(11, 17), *range(23, 29), *range(29, 33)])
"""Rows of the network's answer that hold `POINTS`."""
DOWN_THE_SHIN = {"ankle": 0.14, "heel": 0.14, "big_toe": 0.075}
"""How far below the network's points the skeleton's lie, along the line from knee to ankle, in its lengths.

The network means the bones above the shoe, the skeleton the joint and the sole. Measured on the pictures of
`pgm simulate` (0.14 and 0.16, 0.14 and 0.17, 0.07 and 0.08 at 720 and 1080 rows).
"""
SCATTER = {
    **{"nose": 0.021, "eye": 0.018, "ear": 0.021, "shoulder": 0.017, "elbow": 0.026, "wrist": 0.023},
    **{"hip": 0.016, "knee": 0.018, "ankle": 0.012, "heel": 0.016, "big_toe": 0.016},
}
"""Standard deviation of each coordinate of a point with a score of 1, as a share of the body's larger side.

68 % of the errors against the truth of `pgm simulate` (506 bodies 60 to 200 px high, seen from before and behind) are
below it, what the network puts elsewhere than the skeleton included. Real pictures have no such truth.
"""
SCORES = np.array([0.0, 0.02, 0.1, 0.2, 0.35, 0.9, 0.96, 1.0])
MORE_SCATTER = np.array([6.0, 2.5, 2.1, 2.0, 1.35, 1.3, 1.08, 1.0])
"""By how much the scatter is larger at those scores; points out of the picture make up most of the lowest."""


class BlazePose:
    """The network; safe to use by one thread at a time."""

    input_size = (SIDE, SIDE)
    point_names = POINTS
    body_share = 0.8

    def __init__(self, path: Path) -> None:
        """Open the weights at that path.

        Raises:
            ValueError: If the file is no network with BlazePose's five answers.
        """
        try:
            # OpenCV 5's own engine gives one of five answers, without an error; a file that is handed over as bytes
            # always runs on that engine. OpenCV 4 knows no other engine than the classic one.
            classic = getattr(cv2.dnn, "ENGINE_CLASSIC", None)
            file = os.fspath(path)
            self._net = cv2.dnn.readNetFromTFLite(file) if classic is None else cv2.dnn.readNetFromTFLite(file, classic)
        except cv2.error as error:
            raise ValueError(f"pose network {path}: expected a TFLite file, OpenCV says {error}") from error
        got = set(self._net.getUnconnectedOutLayersNames())
        wanted = {LANDMARKS, PRESENCE, MASK, HEAT, WORLD}
        if not wanted <= got:
            raise ValueError(f"pose network {path}: answers: expected {sorted(wanted)}, got {sorted(got)}")

    def __call__(self, crops: UInt8[np.ndarray, "crops height width 3"]) -> CropPoses:
        """The points in square crops, one network call a crop."""
        crops = checked_crops(crops, self.input_size)
        landmarks = np.empty((len(crops), 39, 5))
        world = np.empty((len(crops), 39, 3))
        presence = np.empty(len(crops))
        for index, crop in enumerate(crops):
            self._net.setInput(cv2.dnn.blobFromImage(crop, scalefactor=1 / 255, swapRB=True))
            answers = self._net.forward([LANDMARKS, PRESENCE, WORLD])
            landmarks[index] = np.asarray(answers[0]).reshape(39, 5)
            presence[index] = np.asarray(answers[1]).item()
            world[index] = np.asarray(answers[2]).reshape(39, 3)
        rows = landmarks[:, ROWS]
        score = _probability(rows[..., 3]) * _probability(rows[..., 4])
        return CropPoses(
            # The network counts from the crop's edge, we from the centre of its first pixel.
            points_px=down_the_shin(rows[..., :2]) - 0.5,
            score=score,
            sigma_px=scatter(score),
            points_ray=down_the_shin(world[:, ROWS]),
            presence=np.clip(presence, 0.0, 1.0),
        )


def down_the_shin(points: Float[np.ndarray, "crops points axes"]) -> Float[np.ndarray, "crops points axes"]:
    """The points of the feet where the skeleton has them; all others as they are."""
    moved = points.copy()
    for side in ("left", "right"):
        shin = points[:, POINTS.index(f"{side}_ankle")] - points[:, POINTS.index(f"{side}_knee")]
        for name, share in DOWN_THE_SHIN.items():
            moved[:, POINTS.index(f"{side}_{name}")] += share * shin
    return moved


def scatter(score: Float[np.ndarray, "crops points"]) -> Float[np.ndarray, "crops points"]:
    """Standard deviation of each coordinate, px of the crop."""
    of_name = np.array([next(share for part, share in SCATTER.items() if name.endswith(part)) for name in POINTS])
    return SIDE * BlazePose.body_share * of_name * np.exp(np.interp(score, SCORES, np.log(MORE_SCATTER)))


def _probability(logit: Float[np.ndarray, "*shape"]) -> Float[np.ndarray, "*shape"]:
    return 0.5 * (1.0 + np.tanh(0.5 * logit))
