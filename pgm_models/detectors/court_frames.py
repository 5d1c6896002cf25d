"""Frames with a known camera, kept as JPEG so that training reads any of them in any order."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from pgm_data.court import Court
from pgm_data.dataset.clip_camera import ClipCamera, read_clip_camera
from pgm_data.dataset.files import whole_file
from pgm_data.geometry.camera import Camera, project

LINE_SAMPLES = 17
"""Points along each painted line, ends included: enough for a bent line to be drawn straight between them."""
JPEG_QUALITY = 95


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
    """The prepared frames of one clip; pictures stay on disk."""

    clip_id: str
    jpegs: Path
    """All pictures one after the other."""
    offsets: np.ndarray
    """Where each picture begins in the file, and the file's end."""
    points_px: np.ndarray
    """(frames, points, 2)"""
    lines_px: np.ndarray
    """(frames, lines, samples, 2)"""

    def __len__(self) -> int:
        """Frames of the clip."""
        return len(self.offsets) - 1

    def frame(self, index: int) -> CourtFrame:
        """That frame of the clip."""
        begin, end = int(self.offsets[index]), int(self.offsets[index + 1])
        with self.jpegs.open("rb") as file:
            file.seek(begin)
            data = np.frombuffer(file.read(end - begin), np.uint8)
        bgr = cv2.imdecode(data, cv2.IMREAD_COLOR)
        if bgr is None:
            raise ValueError(f"{self.jpegs}: picture {index}: expected a JPEG at bytes {begin} to {end}, found none")
        return CourtFrame(
            name=f"{self.clip_id}/{index}",
            bgr=bgr,
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


def find_clips(dataset: Path) -> tuple[Path, ...]:
    """Clip folders under the dataset that hold a truth camera, in order of name."""
    found = sorted(path.parent for path in dataset.rglob("camera.parquet") if (path.parent / "clip.json").is_file())
    return tuple(found)


def find_video(folder: Path, dataset: Path) -> Path:
    """The video of a clip: where its `clip.json` says, from the clip's folder, its work folder or the dataset.

    Raises:
        ValueError: If it lies in none of them.
    """
    said = Path(json.loads((folder / "clip.json").read_text())["source_path"])
    places = (
        [said] if said.is_absolute() else [folder / said, folder.parent / said, dataset / said, dataset / said.name]
    )
    for place in places:
        if place.is_file():
            return place
    raise ValueError(
        f"{folder / 'clip.json'}: source_path: expected a video, found none at {', '.join(map(str, places))}"
    )


def prepare_clip(folder: Path, video: Path, cache: Path, court: Court) -> ClipFrames:
    """The clip's frames, decoded once and kept under `cache`; read from there the next time."""
    about = cache / f"{folder.name}.npz"
    jpegs = cache / f"{folder.name}.jpegs"
    if not about.exists():
        cache.mkdir(parents=True, exist_ok=True)
        track = read_clip_camera(folder)
        offsets = [0]
        with whole_file(jpegs) as temporary, temporary.open("wb") as file:
            for bgr in _pictures(video, track):
                encoded, data = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
                if not encoded:
                    raise ValueError(f"{video}: frame {len(offsets) - 1}: expected a picture, got {bgr.shape}")
                file.write(data.tobytes())
                offsets.append(offsets[-1] + len(data))
        if len(offsets) - 1 != len(track.video_frame):
            raise ValueError(
                f"{folder}: expected a picture for {len(track.video_frame)} rows, got {len(offsets) - 1} from {video}"
            )
        points, lines = court_pixels(court, track.camera)
        with whole_file(about) as temporary, temporary.open("wb") as file:
            np.savez(file, offsets=np.array(offsets), points=points.astype(np.float32), lines=lines.astype(np.float32))
    with np.load(about) as kept:
        return ClipFrames(
            clip_id=folder.name, jpegs=jpegs, offsets=kept["offsets"], points_px=kept["points"], lines_px=kept["lines"]
        )


def _pictures(video: Path, track: ClipCamera) -> Iterator[np.ndarray]:
    from pgm_data.video import open_video

    wanted = set(track.video_frame.tolist())
    with open_video(video) as reader:
        for frame in reader:
            if frame.video_frame in wanted:
                yield frame.bgr()


@dataclass(frozen=True, eq=False, kw_only=True)
class FrameSet:
    """Frames of several clips under one numbering, divided for training and for holding out."""

    clips: Sequence[ClipFrames]
    training: np.ndarray
    """(frames, 2): clip and frame."""
    held_out: np.ndarray
    """(frames, 2): clip and frame."""


def divide(clips: Sequence[ClipFrames], every: int = 50) -> FrameSet:
    """Every fiftieth frame held out. The frames of a mixed video are worlds of their own, so clips may be divided."""
    pairs = np.array([(c, f) for c, clip in enumerate(clips) for f in range(len(clip))]).reshape(-1, 2)
    out = pairs[:, 1] % every == every - 1
    return FrameSet(clips=tuple(clips), training=pairs[~out], held_out=pairs[out])
