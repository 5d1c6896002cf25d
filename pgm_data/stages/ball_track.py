"""`pgm-ball3d` on somebody else's 2D track: no work folder, no video; the same tables."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from pgm_data.ball import no_events
from pgm_data.convert.foreign_track import TrackOptions, track_of_rows
from pgm_data.convert.frame_clock import clock_of_rows
from pgm_data.convert.track_camera import TrackCamera, read_track_camera
from pgm_data.convert.track_csv import read_track_csv
from pgm_data.dataset.clip_ball import ClipBall
from pgm_data.dataset.documents import read_document
from pgm_data.lift.camera_doubt import CameraDoubt
from pgm_data.scene import Prior, Scene
from pgm_data.stages.ball_clips import ClipOutcome, outcome_of
from pgm_data.stages.ball_events import Surroundings
from pgm_data.stages.ball_lift import Method, Quality, clip_ball, lift_ball

DEFAULT_SIZE = (1920, 1080)
"""Of pictures of which nobody tells the size; only scales thresholds of the search for events."""


@dataclass(frozen=True, eq=False, kw_only=True)
class TrackJob:
    """A track and what is known of it."""

    track: Path
    camera: Path
    scene: Scene
    events: Path | None = None
    fps: float | None = None
    size: tuple[int, int] | None = None
    """Of the picture that the track's pixels are of, where that is not the camera's."""
    sigma_px: float = 1.0
    method: Method = "physics"
    quality: Quality = "standard"
    drag: Prior | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class PlacedTrack:
    """A foreign track in metres."""

    ball: ClipBall
    outcome: ClipOutcome
    said: str
    """Where its times are from, and what was found of repeats."""
    state: Literal["ok", "no ball"]


def place_track(job: TrackJob, *, clip_id: str) -> PlacedTrack:
    """The track in metres, as a clip of that name.

    Raises:
        ValueError: If a file is not what it must be; names file, place, field, expected, found.
    """
    import time

    started = time.monotonic()
    rows = read_track_csv(job.track)
    seen = read_track_camera(job.camera, rows.frames)
    clock = seen.clock if seen.clock is not None else clock_of_rows(rows, fps=job.fps)
    size = seen.size or clip_size(job.camera)
    if job.size and size is None:
        raise ValueError(f"--size: expected a camera that says the size of its picture, got {job.camera}")
    options = TrackOptions(
        sigma_px=job.sigma_px,
        width=size[0] if size else None,
        height=size[1] if size else None,
        track_width=job.size[0] if job.size and size else None,
        track_height=job.size[1] if job.size and size else None,
    )
    track = track_of_rows(rows, clock, options)
    marks = no_events()
    if job.events is not None:
        from pgm_data.convert.annotation_events import read_events

        marks = read_events(job.events, track.times, first_frame=int(clock.video_frame[0]), size=size)
    around = Surroundings(
        camera=seen.camera,
        size=size or picture_size(seen),
        doubt=track_doubt(seen),
        players=None,
        marks=marks,
    )
    lifted = lift_ball(track, around, scene=job.scene, method=job.method, quality=job.quality, drag=job.drag)
    outcome = outcome_of(clip_id, lifted, detect_s=0.0, lift_s=time.monotonic() - started)
    return PlacedTrack(
        ball=clip_ball(lifted, clip_id=clip_id, video_frame=clock.video_frame, timestamp=clock.timestamp),
        outcome=outcome,
        said=clock.said,
        state="ok" if outcome.state == "ok" else "no ball",
    )


def clip_size(camera: Path) -> tuple[int, int] | None:
    """The size of the pictures of a camera.parquet by the clip.json beside it; None without one."""
    beside = camera.with_name("clip.json")
    if not beside.is_file():
        return None
    document = read_document(beside, "clip")
    return document["width"], document["height"]


def picture_size(seen: TrackCamera) -> tuple[int, int]:
    """The picture's size by its principal point, which lies near the middle."""
    middle = seen.camera.K[:, :2, 2]
    middle = middle[np.isfinite(middle).all(axis=1)]
    if not len(middle):
        return DEFAULT_SIZE
    width, height = np.round(2 * np.median(middle, axis=0) + 1).astype(int).tolist()
    return max(width, 2), max(height, 2)


def track_doubt(seen: TrackCamera) -> CameraDoubt:
    """How far off the camera may be, where its file says; exact where nobody says."""
    cov = seen.position_cov[np.isfinite(seen.position_cov).all(axis=1)]
    share = seen.focal_std_px / seen.camera.K[:, 0, 0]
    share = share[np.isfinite(share)]
    middle = np.median(cov, axis=0) if len(cov) else np.zeros(6)
    return CameraDoubt(
        position_cov=middle[np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])],
        focal_std_share=float(np.median(share)) if len(share) else 0.0,
        pixel_std=0.0,
    )
