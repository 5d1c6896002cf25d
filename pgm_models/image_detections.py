"""How far objects in made pictures are from where they should be (ADD), and how many are not there (MDR).

A DETECTOR is told one picture, RGB 0 to 1, channels first, and gives the boxes x0, y0, x1, y1 (px) of what it finds:
any will do. Boxes are compared by their centres. Where a frame has no object its REFERENCE box is NaN and does not
count. The two figures belong together: the fewer are found, the easier the distances are. Those of boxes round the
masks that a renderer gives of its own objects are not told by any detector, and are named ADD-alpha and MDR-alpha.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.optimize import linear_sum_assignment

from pgm_models.image_metrics import check_colours

FOUND_BY = {"detector": "", "alpha": "-alpha"}
"""What is added to the names of the figures, by what told the boxes."""


Detector = Callable[[Float[np.ndarray, "3 height width"]], Float[np.ndarray, "found 4"]]
"""Anything that finds objects in a picture: their boxes x0, y0, x1, y1, px."""


@dataclass(frozen=True, kw_only=True)
class DetectionScore:
    """ADD and MDR of some frames."""

    total_px: float
    """Distances between centres of matched boxes, added up, px."""
    matched: int
    """Reference boxes that a found one was matched with."""
    valid: int
    """Reference boxes that are there."""
    radius_px: float
    """Boxes further apart are no match, px."""
    size: tuple[int, int]
    """Width and height of the pictures, px."""
    found_by: Literal["detector", "alpha"] = "detector"
    """`alpha` where boxes are those of a renderer's own masks."""

    @property
    def names(self) -> tuple[str, str]:
        """What the two figures are called."""
        suffix = FOUND_BY[self.found_by]
        return f"ADD{suffix}", f"MDR{suffix}"

    @property
    def add_px(self) -> float:
        """Average detection distance of the matched boxes, px of these pictures; NaN where none matched."""
        return self.total_px / self.matched if self.matched else float("nan")

    @property
    def add_of_diagonal(self) -> float:
        """The same as a share of the picture's diagonal."""
        return self.add_px / float(np.hypot(*self.size))

    @property
    def mdr(self) -> float:
        """Missing detection rate, 0 to 1: the share of the valid boxes that nothing matched; NaN without any."""
        return 1 - self.matched / self.valid if self.valid else float("nan")

    def add_px_at(self, width: int) -> float:
        """Average detection distance in pixels of pictures of that width."""
        return self.add_px * width / self.size[0]

    def __str__(self) -> str:
        """The pair, with all that it depends on."""
        add, mdr = self.names
        return (
            f"{add} {self.add_px:.2f} px at {self.size[0]}x{self.size[1]}, {mdr} {self.mdr:.4f} (share): "
            f"{self.matched} of {self.valid} matched within {self.radius_px:g} px"
        )


def detect(
    detector: Detector, pictures: Sequence[Float[np.ndarray, "3 height width"]], name: str = "pictures"
) -> list[Float[np.ndarray, "_ 4"]]:
    """What the detector finds in each picture, one after the other.

    Raises:
        ValueError: If a colour is not between 0 and 1, or the detector gives anything but boxes.
    """
    found = []
    for frame, picture in enumerate(pictures):
        check_colours(picture, f"{name}: frame {frame}")
        boxes = np.asarray(detector(picture), np.float64)
        if boxes.ndim != 2 or boxes.shape[1] != 4 or not np.isfinite(boxes).all():
            raise ValueError(f"{name}: frame {frame}: detector: expected boxes (found, 4), got {boxes.shape}: {boxes}")
        found.append(boxes)
    return found


def detection_score(
    reference: Float[np.ndarray, "frames objects 4"],
    found: Sequence[Float[np.ndarray, "_ 4"]],
    *,
    radius_px: float,
    size: tuple[int, int],
    found_by: Literal["detector", "alpha"] = "detector",
) -> DetectionScore:
    """ADD and MDR of frames.

    Args:
        reference: Where the objects of one kind are; NaN where an object is not there.
        found: What was found in each frame, of that kind; NaN matches nothing.
        radius_px: Boxes whose centres are further apart are no match; Euclidean distance, px.
        size: Width and height of the pictures, px.
        found_by: What told the boxes.

    Raises:
        ValueError: If there are not as many frames of both, or the radius is not above 0.
    """
    if len(reference) != len(found):
        raise ValueError(f"found boxes: expected those of {len(reference)} frames, got {len(found)}")
    if not radius_px > 0:
        raise ValueError(f"radius: expected above 0 px, got {radius_px}")
    valid = np.asarray(np.isfinite(reference).all(axis=2))
    total, matched = 0.0, 0
    for boxes, there, others in zip(reference, valid, found, strict=True):
        _, _, distances = match_centres(centres_of(boxes[there]), centres_of(others), radius_px)
        total, matched = total + float(distances.sum()), matched + len(distances)
    return DetectionScore(
        total_px=total,
        matched=matched,
        valid=int(valid.sum()),
        radius_px=radius_px,
        size=size,
        found_by=found_by,
    )


def pooled_score(scores: Sequence[DetectionScore]) -> DetectionScore:
    """The score of all frames of several scores together.

    Raises:
        ValueError: If there are none, or they differ in radius, size, or in what told the boxes.
    """
    kinds = {(score.radius_px, score.size, score.found_by) for score in scores}
    if len(kinds) != 1:
        raise ValueError(f"scores: expected one radius, size and way of finding, got {sorted(kinds, key=str)}")
    first = scores[0]
    return DetectionScore(
        total_px=sum(score.total_px for score in scores),
        matched=sum(score.matched for score in scores),
        valid=sum(score.valid for score in scores),
        radius_px=first.radius_px,
        size=first.size,
        found_by=first.found_by,
    )


def match_centres(
    reference: Float[np.ndarray, "objects 2"], found: Float[np.ndarray, "found 2"], radius_px: float
) -> tuple[Int[np.ndarray, " matches"], Int[np.ndarray, " matches"], Float[np.ndarray, " matches"]]:
    """Which reference is matched with which found place, and how far apart they are, px.

    One to one, no further apart than the radius; of all ways, one with most matches, and the shortest of those.
    """
    distance = np.linalg.norm(reference[:, None] - found[None], axis=2)
    near = distance <= radius_px
    # A pair that is no match costs more than all matches together.
    cost = np.where(near, distance, (radius_px + 1.0) * (min(distance.shape) + 1))
    rows, columns = linear_sum_assignment(cost)
    kept = near[rows, columns]
    rows, columns = rows[kept], columns[kept]
    return rows, columns, distance[rows, columns]


def centres_of(boxes: Float[np.ndarray, "*batch 4"]) -> Float[np.ndarray, "*batch 2"]:
    """Middles of boxes x0, y0, x1, y1."""
    return (boxes[..., :2] + boxes[..., 2:]) / 2


def boxes_about(points: Float[np.ndarray, "*batch 2"], half_px: float) -> Float[np.ndarray, "*batch 4"]:
    """Squares about points; NaN about missing ones."""
    return np.concatenate([points - half_px, points + half_px], axis=-1)


def seen_reference(
    reference: Float[np.ndarray, "frames objects 4"],
    found: Sequence[Float[np.ndarray, "_ 4"]],
    radius_px: float,
) -> Float[np.ndarray, "frames objects 4"]:
    """The reference boxes that a detector finds in the REAL pictures, NaN in place of the others.

    What a detector misses in real pictures too, as a ball in a hand, tells nothing of made ones. Figures against these
    boxes must say so, beside the share that was left out.
    """
    kept = np.full(reference.shape, np.nan)
    for frame, (boxes, others) in enumerate(zip(reference, found, strict=True)):
        there = np.flatnonzero(np.isfinite(boxes).all(axis=1))
        rows, _, _ = match_centres(centres_of(boxes[there]), centres_of(others), radius_px)
        kept[frame, there[rows]] = boxes[there[rows]]
    return kept


def boxes_of_masks(
    masks: Bool[np.ndarray, "*batch height width"], least_pixels: int = 1
) -> Float[np.ndarray, "*batch 4"]:
    """Boxes round masks, from the middle of their first to that of their last pixels; NaN where fewer are marked."""
    columns, rows = np.asarray(masks.any(axis=-2)), np.asarray(masks.any(axis=-1))
    height, width = masks.shape[-2:]
    boxes = np.stack(
        [
            columns.argmax(axis=-1),
            rows.argmax(axis=-1),
            width - 1 - np.flip(columns, axis=-1).argmax(axis=-1),
            height - 1 - np.flip(rows, axis=-1).argmax(axis=-1),
        ],
        axis=-1,
    ).astype(np.float64)
    enough = masks.sum(axis=(-2, -1)) >= max(least_pixels, 1)
    return np.where(enough[..., None], boxes, np.nan)


def centroids_of_masks(masks: Bool[np.ndarray, "*batch height width"]) -> Float[np.ndarray, "*batch 2"]:
    """Mean column and row of each mask's pixels; NaN where it is empty."""
    height, width = masks.shape[-2:]
    count = masks.sum(axis=(-2, -1))
    x = (masks.sum(axis=-2) * np.arange(width)).sum(axis=-1)
    y = (masks.sum(axis=-1) * np.arange(height)).sum(axis=-1)
    return np.where(count[..., None] > 0, np.stack([x, y], axis=-1) / np.maximum(count, 1)[..., None], np.nan)


def mask_iou(
    made: Bool[np.ndarray, "*batch height width"], real: Bool[np.ndarray, "*batch height width"]
) -> Float[np.ndarray, "*batch"]:
    """Intersection over union of silhouettes; NaN where both are empty."""
    both, either = (made & real).sum(axis=(-2, -1)), (made | real).sum(axis=(-2, -1))
    return np.asarray(np.where(either > 0, both / np.maximum(either, 1), np.nan))
