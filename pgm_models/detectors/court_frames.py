"""Frames with a known camera and where the court is in them."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, UInt8

from pgm_data.court import Court
from pgm_data.dataset.clip_camera import read_clip_camera
from pgm_data.dataset.files import whole_file
from pgm_data.geometry.camera import Camera, project
from pgm_models.detectors.clip_pictures import FrameSet, Pictures, keep_pictures, video_pictures

LINE_SAMPLES = 17
"""Points along each painted line, ends included: enough for a bent line to be drawn straight between them."""


@dataclass(frozen=True, eq=False, kw_only=True)
class CourtFrame:
    """One picture and where the court is in it."""

    name: str
    """Clip and frame."""
    bgr: UInt8[np.ndarray, "height width 3"]
    points_px: Float[np.ndarray, "points 2"]
    """The court's points, in or outside the picture; NaN where there is none or it lies behind the camera."""
    lines_px: Float[np.ndarray, "lines samples 2"]
    """Points along the painted lines' centres, likewise."""

    @property
    def has_court(self) -> bool:
        """Whether any point of the court is known."""
        return bool(np.isfinite(self.points_px).any())


@dataclass(frozen=True, eq=False, kw_only=True)
class ClipFrames:
    """The prepared frames of one clip."""

    clip_id: str
    pictures: Pictures
    points_px: np.ndarray
    """(frames, points, 2)"""
    lines_px: np.ndarray
    """(frames, lines, samples, 2)"""

    def __len__(self) -> int:
        """Frames of the clip."""
        return len(self.pictures)

    def frame(self, index: int) -> CourtFrame:
        """That frame of the clip."""
        return CourtFrame(
            name=f"{self.clip_id}/{index}",
            bgr=self.pictures.read(index),
            points_px=self.points_px[index].astype(float),
            lines_px=self.lines_px[index].astype(float),
        )


def court_pixels(court: Court, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Pixels of the court's points (frames, points, 2) and along its lines (frames, lines, samples, 2).

    NaN where a frame has no camera or a point has no pixel.
    """
    ends = court.lines_world
    along = np.linspace(0, 1, LINE_SAMPLES)[:, None]
    samples = ends[:, None, 0] * (1 - along) + ends[:, None, 1] * along
    points, _ = project(camera, court.all_world)
    lines, _ = project(camera, samples.reshape(-1, 3))
    return points, lines.reshape(len(points), len(ends), LINE_SAMPLES, 2)


def prepare_clip(folder: Path, video: Path, cache: Path, court: Court) -> ClipFrames:
    """The clip's frames, decoded once and kept under `cache`; read from there the next time."""
    about = cache / f"{folder.name}.npz"
    jpegs = cache / f"{folder.name}.jpegs"
    if not about.exists():
        track = read_clip_camera(folder)
        offsets = keep_pictures(jpegs, video_pictures(video, track.video_frame))
        if len(offsets) - 1 != len(track.video_frame):
            raise ValueError(
                f"{folder}: expected a picture for {len(track.video_frame)} rows, got {len(offsets) - 1} from {video}"
            )
        points, lines = court_pixels(court, track.camera)
        with whole_file(about) as temporary, temporary.open("wb") as file:
            np.savez(file, offsets=offsets, points=points.astype(np.float32), lines=lines.astype(np.float32))
    with np.load(about) as kept:
        return ClipFrames(
            clip_id=folder.name,
            pictures=Pictures(jpegs=jpegs, offsets=kept["offsets"]),
            points_px=kept["points"],
            lines_px=kept["lines"],
        )


def divide(clips: Sequence[ClipFrames], every: int = 50) -> FrameSet[ClipFrames]:
    """Every fiftieth frame held out. The frames of a mixed video are worlds of their own, so clips may be divided."""
    pairs = np.array([(c, f) for c, clip in enumerate(clips) for f in range(len(clip))]).reshape(-1, 2)
    out = pairs[:, 1] % every == every - 1
    return FrameSet(clips=tuple(clips), training=pairs[~out], held_out=pairs[out])
