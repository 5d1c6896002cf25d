"""What RTMPose and ViTPose files have in common: the normalised input, the order of their points, their scatter."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Float32, UInt8

from pgm_data.detect.pose.model import COCO_POINTS, checked_crops

if TYPE_CHECKING:
    from onnxruntime import InferenceSession

MEAN = np.array([123.675, 116.28, 103.53], dtype=np.float32)
DEVIATION = np.array([58.395, 57.12, 57.375], dtype=np.float32)
"""Of the red, green and blue that the networks were trained on (ImageNet's)."""
BODY_SHARE = 0.8
"""A person's box is widened by 1.25 before it is cut out (OpenMMLab's `padding`)."""
SEEN_SCORE = 0.3
"""From which score on OpenMMLab draws a point: here, as likely there as not."""
LAYOUTS = {
    17: (COCO_POINTS, tuple(range(17))),
    26: (
        (*COCO_POINTS, "left_big_toe", "right_big_toe", "left_heel", "right_heel"),
        (*range(17), 20, 21, 24, 25),
    ),
    133: (
        (*COCO_POINTS, "left_big_toe", "left_heel", "right_big_toe", "right_heel"),
        (*range(17), 17, 19, 20, 22),
    ),
}
"""By number of points (COCO, Halpe, COCO-WholeBody): names of those that the skeleton has, and their places."""
COCO_SIGMA = {
    **{"nose": 0.026, "eye": 0.025, "ear": 0.035, "shoulder": 0.079, "elbow": 0.072, "wrist": 0.062},
    **{"hip": 0.107, "knee": 0.087, "ankle": 0.089, "heel": 0.089, "big_toe": 0.089},
}
"""How far people who mark COCO's pictures differ, in each coordinate, as a share of the root of the body's area."""
AREA_ROOT = 0.46
"""Root of a standing body's area as a share of its height: about half of a box 0.4 times as wide as high."""
AS_GOOD_AS_PEOPLE = 0.65
"""Scatter of a good network as a share of `COCO_SIGMA`: so large where its mean OKS is 0.9. Not measured here."""


def rgb_planes(crops: UInt8[np.ndarray, "crops height width 3"]) -> Float32[np.ndarray, "crops 3 height width"]:
    """The crops as the networks want them."""
    planes = (crops[..., ::-1].astype(np.float32) - MEAN) / DEVIATION
    return np.ascontiguousarray(planes.transpose(0, 3, 1, 2))


def input_size_of(session: "InferenceSession", path: Path) -> tuple[int, int]:
    """Width and height that the network takes.

    Raises:
        ValueError: If it takes not one picture of three planes of a fixed size.
    """
    inputs = session.get_inputs()
    shape = list(inputs[0].shape)
    if len(inputs) != 1 or len(shape) != 4 or shape[1] != 3 or not all(isinstance(side, int) for side in shape[2:]):
        got = ", ".join(f"{entry.name}{entry.shape}" for entry in inputs)
        raise ValueError(f"pose network {path}: input: expected one of shape (n, 3, height, width), got {got}")
    return int(shape[3]), int(shape[2])


def layout_of(points: object, path: Path) -> tuple[tuple[str, ...], np.ndarray]:
    """Names of the points that the skeleton has, and where they are among the network's.

    Raises:
        ValueError: If the network has another number of points than those known.
    """
    if not isinstance(points, int) or points not in LAYOUTS:
        expected = ", ".join(map(str, LAYOUTS))
        raise ValueError(f"pose network {path}: points: expected one of {expected}, got {points}")
    names, places = LAYOUTS[points]
    return names, np.array(places)


def answers(
    session: "InferenceSession", crops: UInt8[np.ndarray, "crops height width 3"], size: tuple[int, int]
) -> list[np.ndarray]:
    """All answers for the crops, one crop a call where the file takes no more."""
    planes = rgb_planes(checked_crops(crops, size))
    entry = session.get_inputs()[0]
    if isinstance(entry.shape[0], int) and len(planes) != entry.shape[0]:
        calls = [session.run(None, {entry.name: planes[i : i + 1]}) for i in range(len(planes))]
        return [np.concatenate([np.asarray(call[i]) for call in calls]) for i in range(len(calls[0]))]
    return [np.asarray(answer) for answer in session.run(None, {entry.name: planes})]


def scatter(
    names: tuple[str, ...], score: Float[np.ndarray, "crops points"], crop_height: int
) -> Float[np.ndarray, "crops points"]:
    """Standard deviation of each coordinate, px of the crop: larger where the network is less sure."""
    of_name = np.array([next(sigma for part, sigma in COCO_SIGMA.items() if name.endswith(part)) for name in names])
    height = crop_height * BODY_SHARE
    return AS_GOOD_AS_PEOPLE * AREA_ROOT * height * of_name / np.clip(score, 0.1, 1.0)


def presence_of(score: Float[np.ndarray, "crops points"]) -> Float[np.ndarray, " crops"]:
    """Whether there is a person, for networks that do not say: the score that a quarter of the points reach.

    Measured by twice `SEEN_SCORE`.
    """
    return np.clip(np.quantile(score, 0.75, axis=-1) / (2 * SEEN_SCORE), 0.0, 1.0)


def peak_offset(
    before: Float[np.ndarray, "*shape"], at: Float[np.ndarray, "*shape"], after: Float[np.ndarray, "*shape"]
) -> Float[np.ndarray, "*shape"]:
    """Where between -0.5 and 0.5 the parabola through three neighbouring values has its top; 0 where it has none."""
    bend = before - 2 * at + after
    with np.errstate(divide="ignore", invalid="ignore"):
        offset = np.where(bend < 0, 0.5 * (before - after) / bend, 0.0)
    return np.clip(offset, -0.5, 0.5)
