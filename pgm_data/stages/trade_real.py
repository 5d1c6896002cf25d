"""Jobs of `pgm trade calibrate` on real clips: cameras against points read by hand, which nothing learns from."""

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from pgm_data.court import Court
from pgm_data.dataset.clip_camera import ClipCamera
from pgm_data.geometry.camera import Camera, project
from pgm_data.inputs import find_inputs
from pgm_data.scene import load_scene
from pgm_data.stages.trade_clips import calibrated
from pgm_data.stages.trade_pictures import CLOSE_UPS

KEYPOINTS, NET_TOP = "court_keypoints.json", "net_center_top.json"
NET_POINT = "net_centre_top"
SCORED_WIDTH = 1920
"""Errors in wider pictures are scaled down to this width."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ReadFrame:
    """One frame with points read by hand; errors are None where the frame has no camera."""

    frame: int
    status: str
    rms_px: float | None
    """Rms of 2D distances to the hand-read court points, native pixels (of 1920 where the picture is wider)."""
    max_px: float | None
    net_px: float | None
    """Distance at the top of the net's centre; None where it was not read."""


@dataclass(frozen=True, eq=False, kw_only=True)
class RealScore:
    """One real video under one preset."""

    video: str
    preset: str
    frames: int
    """Frames decoded."""
    measured: int
    interpolated: int
    clips: int
    false_frames: int
    """Frames with a camera where only close-ups are shown."""
    read: tuple[ReadFrame, ...]
    jitter_px: float | None
    lens_model: str
    reprojection_px: float | None
    seconds: float
    """Wall clock of the calibration; that of the whole process stands in the job's outcome."""
    cpu_s: float
    memory_mb: float


def real_videos(real: Path, scene: str) -> list[Path]:
    """The scene's videos in a folder of real clips: in the folder of its name, and those with hand-read points."""
    named = [real / name for name in _frames_of(real / KEYPOINTS)]
    there = find_inputs([real / scene]).videos if (real / scene).is_dir() else ()
    return sorted({path for path in [*there, *named] if path.is_file()})


def score_real(arguments: dict, report: Callable[[dict], None]) -> dict:
    """Calibrate one real video in a folder of its own and compare it with the points read in it."""
    video, real = Path(arguments["video"]), Path(arguments["real"])
    court = load_scene(arguments["scene"]).court
    assert court is not None
    solved, documents, outcome, cpu_s = calibrated(video, arguments, report)
    name = video.relative_to(real).as_posix()
    points = _frames_of(real / KEYPOINTS).get(name, {})
    net = _frames_of(real / NET_TOP).get(name, {})
    read = [
        read_frame(int(frame), solved, court, points.get(frame, {}), net.get(frame))
        for frame in sorted(points.keys() | net.keys(), key=int)
    ]
    width = documents[0]["width"] if documents else 0
    jitter = [d["camera"]["jitter_px"] for d in documents if d.get("camera", {}).get("jitter_px") is not None]
    close_up = CLOSE_UPS.get(video.name)
    false = 0 if close_up is None else sum(int((c.has_camera & (c.video_frame >= close_up)).sum()) for c in solved)
    score = RealScore(
        video=video.name,
        preset=arguments["quality"],
        frames=outcome.frames,
        measured=outcome.measured,
        interpolated=outcome.interpolated,
        clips=len(outcome.clips),
        false_frames=false,
        read=tuple(scaled(r, width) for r in read),
        jitter_px=max(jitter) if jitter else None,
        lens_model=documents[0]["lens_model"]["model"] if documents else "",
        reprojection_px=outcome.reprojection_px,
        seconds=outcome.seconds,
        cpu_s=cpu_s,
        memory_mb=outcome.peak_memory_mb,
    )
    return asdict(score)


def read_frame(
    frame: int, solved: list[ClipCamera], court: Court, points: dict[str, list[float]], net: list[float] | None
) -> ReadFrame:
    """How far the camera of a video frame is from points read in it, pixels of that video."""
    for clip in solved:
        at = np.flatnonzero(clip.video_frame == frame)
        if len(at) and clip.has_camera[at[0]]:
            camera = clip.camera[int(at[0])]
            off = point_errors(camera, court, points)
            net_off = None if net is None else float(point_errors(camera, court, {NET_POINT: net})[0])
            return ReadFrame(
                frame=frame,
                status=str(clip.status[at[0]]),
                rms_px=float(np.sqrt(np.mean(off**2))) if len(off) else None,
                max_px=float(off.max()) if len(off) else None,
                net_px=net_off,
            )
    return ReadFrame(frame=frame, status="none", rms_px=None, max_px=None, net_px=None)


def point_errors(camera: Camera, court: Court, points: dict[str, list[float]]) -> Float[np.ndarray, " points"]:
    """Distances between named court points as projected and as read, pixels; infinite for a point out of sight.

    Raises:
        ValueError: If the court has no point of a name.
    """
    unknown = sorted(set(points) - set(court.all_names))
    if unknown:
        raise ValueError(f"hand-read point: expected one of {', '.join(court.all_names)}, got {unknown[0]!r}")
    if not points:
        return np.zeros(0)
    world = np.stack([court.all_world[court.all_names.index(name)] for name in points])
    pixels, seen = project(camera, world)
    return np.where(seen, np.linalg.norm(pixels - np.array(list(points.values())), axis=1), np.inf)


def scaled(read: ReadFrame, width: int) -> ReadFrame:
    """The errors in pixels of a picture at most `SCORED_WIDTH` wide."""
    factor = SCORED_WIDTH / width if width > SCORED_WIDTH else 1.0
    values = {
        name: None if value is None else value * factor
        for name, value in (("rms_px", read.rms_px), ("max_px", read.max_px), ("net_px", read.net_px))
    }
    return ReadFrame(frame=read.frame, status=read.status, **values)


def _frames_of(path: Path) -> dict[str, dict[str, Any]]:
    """By video and frame, what was read there."""
    return json.loads(path.read_text(encoding="utf-8"))["frames"] if path.is_file() else {}
