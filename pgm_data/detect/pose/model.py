"""What every network of body points gives, whatever its layout: points, scores and standard deviations in a crop."""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, UInt8

from pgm_data.geometry.arrays import frozen

COCO_POINTS = (
    *("nose", "left_eye", "right_eye", "left_ear", "right_ear"),
    *("left_shoulder", "right_shoulder", "left_elbow", "right_elbow", "left_wrist", "right_wrist"),
    *("left_hip", "right_hip", "left_knee", "right_knee", "left_ankle", "right_ankle"),
)
"""COCO's 17 points in its order."""


@dataclass(frozen=True, eq=False, kw_only=True)
class CropPoses:
    """One person's points in each of several crops.

    Raises:
        ValueError: If shapes differ.
    """

    points_px: Float[np.ndarray, "crops points 2"]
    """x, y in the crop, px; the centre of its top-left pixel is (0, 0)."""
    score: Float[np.ndarray, "crops points"]
    """Confidence 0 to 1 that the point is there and visible."""
    sigma_px: Float[np.ndarray, "crops points"]
    """Standard deviation of each coordinate, px of the crop."""
    points_ray: Float[np.ndarray, "crops points 3"]
    """The body's shape in space, metres: x right, y down, z away; NaN where the network knows none."""
    presence: Float[np.ndarray, " crops"]
    """Probability that the crop shows a person."""

    def __post_init__(self) -> None:
        """Keep read-only copies and check the shapes."""
        shape = self.points_px.shape[:2]
        for name in ("points_px", "score", "sigma_px", "points_ray", "presence"):
            object.__setattr__(self, name, frozen(getattr(self, name)))
            got = getattr(self, name).shape
            if got[: min(2, len(got))] != shape[: len(got)]:
                raise ValueError(f"crop poses: {name}: expected {shape} first, got {got}")


@runtime_checkable
class PoseModel(Protocol):
    """A network that finds one person's points in a crop."""

    @property
    def input_size(self) -> tuple[int, int]:
        """Width and height of the crops that it takes, px."""
        ...

    @property
    def point_names(self) -> tuple[str, ...]:
        """Its points, as the skeleton's file calls them."""
        ...

    @property
    def body_share(self) -> float:
        """Share of the crop's height that a standing person should fill, as the network was trained."""
        ...

    def __call__(self, crops: UInt8[np.ndarray, "crops height width 3"]) -> CropPoses:
        """The points in crops of its input size, BGR."""
        ...


def checked_crops(
    crops: UInt8[np.ndarray, "crops height width 3"], size: tuple[int, int]
) -> UInt8[np.ndarray, "crops height width 3"]:
    """The crops themselves.

    Raises:
        ValueError: If they are not of that width and height.
    """
    if crops.shape[1:] != (size[1], size[0], 3):
        raise ValueError(f"crops: expected (n, {size[1]}, {size[0]}, 3), got {crops.shape}")
    return crops


def mirrored(names: tuple[str, ...]) -> np.ndarray:
    """Index of each point's partner on the other side of the body; its own where it has none."""
    other = {"left": "right", "right": "left"}
    sides = [name.partition("_") for name in names]
    partners = [other.get(side, side) + line + part for side, line, part in sides]
    return np.array([names.index(partner) if partner in names else index for index, partner in enumerate(partners)])
