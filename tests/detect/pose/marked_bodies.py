"""A body drawn as marks of colours of their own, a network that reads the marks, and clips to run it on."""

from dataclasses import dataclass, field

import numpy as np

from pgm_data.dataset.clip_camera import ClipCamera
from pgm_data.detect.pose.model import COCO_POINTS, CropPoses
from pgm_data.geometry.camera import Camera
from pgm_data.people import PlayerBoxes

BODY = np.array(
    [
        *[[0.5, 0.1], [0.6, 0.03], [0.4, 0.03], [0.7, 0.08], [0.3, 0.08]],
        *[[0.7, 0.2], [0.3, 0.2], [0.8, 0.35], [0.2, 0.35], [0.85, 0.5], [0.15, 0.5]],
        *[[0.6, 0.5], [0.4, 0.5], [0.65, 0.75], [0.35, 0.75], [0.68, 0.97], [0.32, 0.97]],
    ]
)
"""COCO's points of a body seen from before, as shares of its box."""


SWAPPED = [0, 2, 1, 4, 3, 6, 5, 8, 7, 10, 9, 12, 11, 14, 13, 16, 15]


def body_points(box: np.ndarray) -> np.ndarray:
    """The body's points in the picture whose box that is."""
    return box[:2] + BODY * (box[2:] - box[:2])


def draw(picture: np.ndarray, points: np.ndarray, radius: float) -> np.ndarray:
    """The picture with the points as discs: green, the blue says which point."""
    y, x = np.mgrid[: picture.shape[0], : picture.shape[1]]
    drawn = picture.copy()
    for index, (px, py) in enumerate(points):
        drawn[(x - px) ** 2 + (y - py) ** 2 <= radius**2] = (10 + 14 * index, 250, 0)
    return drawn


@dataclass
class MarkReader:
    """A network that finds the marks; it takes left for right in the calls that `confused` names."""

    confused: tuple[int, ...] = ()
    calls: int = 0
    crops: list[np.ndarray] = field(default_factory=list)
    input_size = (128, 128)
    point_names = COCO_POINTS
    body_share = 0.8

    def __call__(self, crops: np.ndarray) -> CropPoses:
        """The points in the crops; a crop without marks shows nobody."""
        self.crops.extend(crops)
        points = np.full((len(crops), 17, 2), 64.0)
        seen = np.zeros((len(crops), 17))
        for row, crop in enumerate(crops):
            blue, green = crop[..., 0].astype(int), crop[..., 1]
            for index in range(17):
                y, x = np.nonzero((np.abs(blue - 10 - 14 * index) <= 4) & (green > 240) & (crop[..., 2] < 6))
                if len(x):
                    points[row, index] = x.mean(), y.mean()
                    seen[row, index] = 1.0
        # Of a body seen from before, the left is on the right, in a mirror too.
        wrong = points[..., 0] < points[:, SWAPPED, 0]
        wrong[:, 2::2] = wrong[:, 1::2]
        points = np.where(wrong[..., None], points[:, SWAPPED], points)
        seen = np.where(wrong, seen[:, SWAPPED], seen)
        if self.calls in self.confused:
            points, seen = points[:, SWAPPED], seen[:, SWAPPED]
        self.calls += 1
        score = np.where(seen > 0, 0.95, 0.05)
        ray = np.concatenate([points / 64 - 1, points[..., :1] * 0 + np.arange(17)[:, None]], axis=-1)
        return CropPoses(
            points_px=points, score=score, sigma_px=np.ones(score.shape), points_ray=ray, presence=seen.mean(axis=-1)
        )


def clip_of(frames: int, *, duplicate: tuple[int, ...] = (), rate: float = 25.0) -> ClipCamera:
    """A clip of so many frames, without a camera."""
    is_duplicate = np.isin(np.arange(frames), duplicate)
    nan = np.full(frames, np.nan)
    time_s = np.arange(frames) / rate
    return ClipCamera(
        clip_id="clip",
        video_frame=np.arange(frames),
        timestamp=time_s,
        is_duplicate=is_duplicate,
        capture_time=time_s,
        camera=Camera(
            K=np.full((frames, 3, 3), np.nan),
            distortion=np.full((frames, 4), np.nan),
            R_cam_from_world=np.full((frames, 3, 3), np.nan),
            t_cam_from_world=np.full((frames, 3), np.nan),
        ),
        status=np.full(frames, "none", dtype=object),
        reason=np.full(frames, "", dtype=object),
        inliers=np.zeros(frames, np.int64),
        reprojection_px=nan,
        position_cov=np.full((frames, 6), np.nan),
        focal_std_px=nan,
    )


def boxes_of(boxes: np.ndarray) -> PlayerBoxes:
    """Boxes (frames, players, 4) as measured ones; NaN: none."""
    there = np.isfinite(boxes).all(axis=-1)
    return PlayerBoxes(
        names=tuple(f"player{index}" for index in range(boxes.shape[1])),
        boxes_px=boxes,
        score=np.where(there, 1.0, np.nan),
        ground_world=np.full((*boxes.shape[:2], 2), np.nan),
        status=np.where(there, "measured", "none").astype(object),
    )
