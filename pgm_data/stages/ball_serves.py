"""The ball's drag constant from measured serve speeds and the serves that a work folder holds."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pgm_data.convert.serve_speeds_csv import ServeSpeeds, read_serve_speeds
from pgm_data.dataset.clip_ball import ClipBall, read_clip_ball
from pgm_data.dataset.clip_camera import ClipCamera, read_clip_camera
from pgm_data.dataset.documents import read_document
from pgm_data.lift.ball.landing import SERVE_HEIGHT, serves
from pgm_data.lift.ball.serve_drag import Serves, drag_from_serves
from pgm_data.lift.ball.world import ball_world
from pgm_data.scene import Prior, load_scene
from pgm_data.stages.ball_run import BALL_STAGE
from pgm_data.stages.clip_run import clip_ids, has_tables

NEAR_S = 0.5
"""A serve begins within this time of the moment that its row names."""
RADAR_SHARE = 0.02
"""Standard deviation of a radar's speed over it: where along the first metres it measured is not known."""
TIME_FRAMES = 0.15
"""Standard deviation of a serve's duration, frames."""
SHARE_STD = 0.005
"""Of the speed along the ground over the speed."""


@dataclass(frozen=True, eq=False, kw_only=True)
class FoundDrag:
    """The drag constant, and how it was had."""

    drag: Prior
    """1/m."""
    used: int
    """Serves that count."""
    text: str
    """For a person: the constant, and why serves were left out."""


@dataclass(frozen=True, eq=False, kw_only=True)
class _Clip:
    """A clip with its ball."""

    camera: ClipCamera
    ball: ClipBall
    video: str
    """Its source path."""


def drag_of_serves(work: Path, speeds: Path, scene: str = "") -> FoundDrag:
    """The drag constant of the work folder's serves whose speeds the file gives.

    Args:
        work: Work folder in which the ball has been placed.
        speeds: CSV of clip, frame (of the video) or time, and speed.
        scene: Name or path of the scene; that of the clips where empty.

    Raises:
        ValueError: If the file is not what it must be, no clip has a ball yet, or a row names a clip that is none.
    """
    rows = read_serve_speeds(speeds)
    clips = {name: _read(work, name) for name in clip_ids(work) if has_tables(BALL_STAGE, work, name)}
    if not clips:
        raise ValueError(f"--serve-speeds: expected clips in {work} whose ball has been placed, got none; run without")
    named = scene or read_document(work / next(iter(clips)) / "clip.json", "clip")["scene"]
    loaded = load_scene(named)
    ball = loaded.ball
    if ball is None:
        raise ValueError(f"--scene: expected a scene with a ball, got {named}")
    serve_z = ball_world(loaded).floor_z + SERVE_HEIGHT * loaded.person_height_m
    values, said = [], []
    for row in range(len(rows.speed)):
        own = [clip for name, clip in clips.items() if _names(rows.clip[row], name, clip.video)]
        if rows.clip[row] and not own:
            raise ValueError(f"{speeds}: clip: expected one of {', '.join(clips)}, got {rows.clip[row]!r}")
        found = [value for clip in own if (value := _serve(rows, row, clip, serve_z)) is not None]
        if len(found) > 1:
            raise ValueError(f"{speeds}: row {row + 1}: clip: expected the clip's name, as several have such a serve")
        if found:
            values.append(found[0])
        else:
            said.append(f"row {row + 1}: no serve that a bounce follows within {NEAR_S:g} s of it")
    columns = np.array(values, dtype=float).reshape(-1, 8).T
    names = ("length_m", "length_std_m", "time_s", "time_std_s", "speed", "speed_std", "share", "share_std")
    answer = drag_from_serves(Serves(**dict(zip(names, columns, strict=True))), ball.drag_per_m)
    said += [f"{columns[4, i]:.1f} m/s: {why}" for i, why in enumerate(answer.said) if why]
    drag = answer.posterior
    head = f"drag constant {drag.mean:.5f} +- {drag.std:.5f} 1/m by {answer.count} of {len(rows.speed)} serves"
    return FoundDrag(drag=drag, used=answer.count, text="\n".join([head, *(f"left out: {line}" for line in said)]))


def _read(work: Path, clip_id: str) -> _Clip:
    camera = read_clip_camera(work / clip_id)
    document = read_document(work / clip_id / "clip.json", "clip")
    ball = read_clip_ball(work / clip_id, camera.capture_time)
    return _Clip(camera=camera, ball=ball, video=document["source_path"])


def _names(given: str, clip_id: str, video: str) -> bool:
    """Whether a row is about the clip: it names it, or its video, or nothing."""
    path = Path(video)
    return given in ("", clip_id, video, path.name, path.stem)


def _serve(rows: ServeSpeeds, row: int, clip: _Clip, serve_z: float) -> tuple[float, ...] | None:
    """The row's serve, a hit above `serve_z`, as a row of `Serves`; None where the clip has none there."""
    ball, camera = clip.ball, clip.camera
    if np.isfinite(rows.time[row]):
        index = int(np.abs(camera.timestamp - rows.time[row]).argmin())
    else:
        index = int(np.abs(camera.video_frame - rows.frame[row]).argmin())
        if abs(camera.video_frame[index] - rows.frame[row]) > 0.5 and len(camera.video_frame) > 1:
            return None
    events, shots = ball.events, ball.shots
    served = serves(events.kind, events.time, events.position, serve_z=serve_z)
    flies = served[shots.start_event] & (events.kind[shots.end_event] == "bounce")
    starts = np.where(flies, np.abs(events.time[shots.start_event] - camera.capture_time[index]), np.inf)
    if not len(starts) or starts.min() > NEAR_S:
        return None
    flight = int(starts.argmin())
    start, end = int(shots.start_event[flight]), int(shots.end_event[flight])
    way = events.position[end, :2] - events.position[start, :2]
    inside = (ball.capture_time >= events.time[start]) & (ball.capture_time <= events.time[end])
    frames = np.flatnonzero(inside & np.isfinite(ball.position).all(axis=1))
    length = float(np.hypot(*way))
    if not (np.isfinite(length) and length > 0 and len(frames)):
        return None
    along = way / length
    variance = sum(float(along @ ball.position_cov[f, :2, :2] @ along) for f in (frames[0], frames[-1]))
    velocity = ball.velocity[frames[0]]
    share = float(np.hypot(velocity[0], velocity[1]) / np.linalg.norm(velocity))
    frame_s = float(np.median(np.diff(np.unique(ball.capture_time))))
    time = float(events.time[end] - events.time[start])
    speed = float(rows.speed[row])
    spread = float(np.sqrt(variance))
    return length, spread, time, TIME_FRAMES * frame_s, speed, RADAR_SHARE * speed, share, SHARE_STD
