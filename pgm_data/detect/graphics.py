"""Graphics laid over the picture, scoreboards and logos: what stays where it is while the scene moves behind it.

Where the camera stands still everything stays, and nothing can be said.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from pgm_data.dataset.clip_camera import ClipCamera
from pgm_data.detect.players.candidates import Pictures

WIDTH = 640
"""Pictures are looked at this wide, px."""


@dataclass(frozen=True, kw_only=True)
class GraphicsOptions:
    """What is taken for a graphic; lengths in pixels of a picture 640 wide."""

    frames: int = 40
    """Frames that are looked at, spread over the clip."""
    least_shift: float = 5.0
    """How far the scene must move between half of them and the middle one."""
    edge: float = 24.0
    """Least difference of brightness across an edge that stays."""
    scatter: float = 8.0
    """Largest scatter of a pixel's brightness over the frames."""
    reach: int = 9
    """Edges nearer to each other than this belong together."""
    least_size: tuple[int, int] = (14, 8)
    """Width and height of the smallest graphic."""
    balance: float = 0.12
    """Least share of upright among a graphic's edges, and of level ones: a court line that runs along the camera's
    motion stays too, but runs one way."""
    least_filled: float = 0.08
    """Least share of a graphic's box that edges cover."""
    largest_share: float = 0.2
    """Of the picture."""


def steady_graphics(
    pictures: Pictures, clip: ClipCamera, *, size: tuple[int, int], options: GraphicsOptions | None = None
) -> Float[np.ndarray, "graphics 4"]:
    """Boxes x0, y0, x1, y1 of graphics, px; none where the camera does not move enough to tell.

    Args:
        pictures: A pass over the clip's pictures.
        clip: Its cameras.
        size: Width and height of the pictures, px.
        options: What is taken for a graphic.
    """
    options = options or GraphicsOptions()
    chosen = spread_frames(clip, size, options)
    if not len(chosen):
        return np.zeros((0, 4))
    wanted = set(chosen.tolist())
    height = max(1, round(size[1] * WIDTH / size[0]))
    small = [
        cv2.cvtColor(cv2.resize(picture, (WIDTH, height), interpolation=cv2.INTER_AREA), cv2.COLOR_BGR2GRAY)
        for frame, picture in enumerate(pictures())
        if frame in wanted
    ]
    boxes = boxes_that_stay(np.stack(small), options)
    # The borders of the small and of the full picture agree.
    return (boxes + 0.5) * np.tile([size[0] / WIDTH, size[1] / height], 2) - 0.5


def spread_frames(clip: ClipCamera, size: tuple[int, int], options: GraphicsOptions) -> Int[np.ndarray, " frames"]:
    """Frames to look at; none where the scene does not move enough between them."""
    with_camera = np.flatnonzero(clip.has_camera & ~clip.is_duplicate)
    if len(with_camera) < options.frames // 2:
        return np.zeros(0, dtype=np.int64)
    chosen = with_camera[np.unique(np.linspace(0, len(with_camera) - 1, options.frames).round().astype(int))]
    middle = chosen[len(chosen) // 2]
    K, R = clip.camera.K, clip.camera.R_cam_from_world
    maps = K[chosen] @ R[chosen] @ R[middle].T @ np.linalg.inv(K[middle])
    width, height = size
    marks = np.array([[0.25 * width, 0.4 * height, 1], [0.75 * width, 0.4 * height, 1], [0.5 * width, 0.8 * height, 1]])
    there = marks @ np.swapaxes(maps, -1, -2)
    shift = np.linalg.norm(there[..., :2] / there[..., 2:] - marks[:, :2], axis=-1).mean(axis=1) * WIDTH / width
    return chosen if np.median(shift) >= options.least_shift else np.zeros(0, dtype=np.int64)


def boxes_that_stay(
    pictures: UInt8[np.ndarray, "frames high wide"], options: GraphicsOptions
) -> Float[np.ndarray, "graphics 4"]:
    """Boxes of what has the same edges in nearly all pictures, px of these."""
    middle = np.median(pictures, axis=0).astype(np.float32)
    scatter = np.median(np.abs(pictures.astype(np.float32) - middle), axis=0) * 1.4826
    across = cv2.Sobel(middle, cv2.CV_32F, 1, 0, ksize=3) / 4
    down = cv2.Sobel(middle, cv2.CV_32F, 0, 1, ksize=3) / 4
    stays: Bool[np.ndarray, "high wide"] = np.asarray(
        (np.hypot(across, down) > options.edge) & (cv2.dilate(scatter, np.ones((3, 3))) < options.scatter)
    )
    joined = cv2.morphologyEx(
        stays.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((options.reach, options.reach), np.uint8)
    )
    count, labels, about, _ = cv2.connectedComponentsWithStats(joined, connectivity=8)
    boxes = []
    for label in range(1, count):
        x, y, w, h, _ = about[label].tolist()
        own = (labels[y : y + h, x : x + w] == label) & stays[y : y + h, x : x + w]
        if w < options.least_size[0] or h < options.least_size[1] or w * h > options.largest_share * stays.size:
            continue
        upright = float(np.abs(across[y : y + h, x : x + w][own]).sum())
        level = float(np.abs(down[y : y + h, x : x + w][own]).sum())
        share = upright / max(upright + level, 1e-9)
        if options.balance <= share <= 1 - options.balance and own.mean() >= options.least_filled:
            boxes.append((x - 0.5, y - 0.5, x + w - 0.5, y + h - 0.5))
    return np.array(boxes, dtype=float).reshape(-1, 4)
