"""`pgm-ball3d` on the clips of one video: the ball found, placed in metres, and written beside their cameras."""

import os
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from pgm_data.ball import BallEvents, BallTrack, no_events
from pgm_data.dataset.clip_ball import BALL_TABLES, write_clip_ball
from pgm_data.dataset.clip_camera import ClipCamera, read_clip_camera
from pgm_data.dataset.documents import read_document, write_document
from pgm_data.dataset.tables import read_table
from pgm_data.lift.ball.shutter import pixel_velocity, shutter_from_streaks
from pgm_data.lift.ball.solution import PlayersAt
from pgm_data.scene import Prior, Scene, load_scene
from pgm_data.stages.ball_detect import DetectOptions, Detector, detect_clips
from pgm_data.stages.ball_events import Surroundings
from pgm_data.stages.ball_lift import LiftedBall, Method, Quality, clip_ball, lift_ball
from pgm_data.stages.clip_doubt import camera_doubt

EVENTS_OPTION = "--events"
WRIST = "wrist"
"""In the names of joints at which a racket is held."""


@dataclass(frozen=True, eq=False, kw_only=True)
class BallOptions:
    """How balls are found and placed."""

    scene: str = "tennis"
    """Name of a scene that ships with pgm, or the path of a scene file."""
    method: Method = "physics"
    """physics fits flight, spin and bounces jointly; line is the paper's method, faster and less exact."""
    quality: Quality = "standard"
    """draft browses an archive, standard is for work, best for publishing."""
    detector: Literal["auto", "network", "motion", "both"] = "auto"
    """auto takes what the quality asks for."""
    network: str = ""
    """ONNX file of a ball network to use instead of the bundled one."""
    drag_mean: float = 0.0
    """Drag constant from measured serves, 1/m; 0 for the scene's."""
    drag_std: float = 0.0
    """Its standard deviation."""
    overlay: bool = True
    """Whether overlay.mp4 is drawn anew, with the ball in it."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ClipOutcome:
    """What became of one clip."""

    clip_id: str
    state: Literal["ok", "no ball", "failed"]
    reason: str
    frames: int = 0
    detected: int = 0
    """Frames with a ball in the picture."""
    measured: int = 0
    """Frames placed in metres by their own pixel."""
    filled: int = 0
    """Frames placed by the flight around them."""
    hits: int = 0
    bounces: int = 0
    residual_px: float | None = None
    """Median over flights."""
    detect_s: float = 0.0
    lift_s: float = 0.0


def detect_options(options: BallOptions, threads: int) -> DetectOptions:
    """How a quality looks for the ball, unless the detector is named."""
    by_quality: Detector = "motion" if options.quality == "draft" else "both"
    detector = by_quality if options.detector == "auto" else options.detector
    return DetectOptions(detector=detector, network=options.network, threads=threads)


def run_job(arguments: dict, report: Callable[[dict], None]) -> dict:
    """`ball_of_clips` for the stage supervisor: JSON in, JSON out."""
    threads = int(os.environ.get("OPENCV_FOR_THREADS_NUM") or 2)
    outcomes = ball_of_clips(
        Path(arguments["work"]),
        tuple(arguments["clips"]),
        video=Path(arguments["video"]),
        options=BallOptions(**arguments["options"]),
        marks={clip: Path(files[EVENTS_OPTION]) for clip, files in arguments["files"].items()},
        threads=threads,
        report=report,
    )
    return {"clips": [asdict(outcome) for outcome in outcomes]}


def ball_of_clips(
    work: Path,
    clip_ids: tuple[str, ...],
    *,
    video: Path,
    options: BallOptions,
    marks: dict[str, Path],
    threads: int = 2,
    report: Callable[[dict], None] = lambda _: None,
) -> tuple[ClipOutcome, ...]:
    """Find and place the ball in clips of one video; writes their tables, shutter, overlay and report.

    A clip that fails does not stop the others of the video.

    Args:
        work: The work folder.
        clip_ids: Clips of the video.
        video: The file.
        options: How.
        marks: File of a person's events by clip, where there is one.
        threads: Of decoder and network.
        report: Told about progress now and then.

    Raises:
        VideoError: If the file cannot be read.
        ValueError: If the scene has no ball, or a clip's camera cannot be read.
    """
    scene = load_scene(options.scene)
    outcomes: list[ClipOutcome] = []
    clips: list[ClipCamera] = []
    for clip_id in clip_ids:
        try:
            clips.append(read_clip_camera(work / clip_id))
        except ValueError as error:
            outcomes.append(ClipOutcome(clip_id=clip_id, state="failed", reason=str(error)))
    total = sum(len(clip.video_frame) for clip in clips)
    started = time.monotonic()
    for clip, track, size in detect_clips(
        video,
        clips,
        options=detect_options(options, threads),
        fast_decode=options.quality == "draft",
        report=lambda frames: report({"progress": frames, "total": round(1.25 * total)}),
    ):
        detect_s = time.monotonic() - started
        outcomes.append(_placed(work, clip, track, size, scene, options, marks.get(clip.clip_id), detect_s))
        started = time.monotonic()
    good = tuple(outcome.clip_id for outcome in outcomes if outcome.state != "failed")
    if options.overlay and good:
        from pgm_data.stages.overlay import write_overlays

        write_overlays(work, good, video=video, scene=scene)
    if good:
        from pgm_data.stages.report import write_clip_report

        for clip_id in good:
            write_clip_report(work, clip_id)
    return tuple(outcomes)


def _placed(
    work: Path,
    clip: ClipCamera,
    track: BallTrack,
    size: tuple[int, int],
    scene: Scene,
    options: BallOptions,
    marks: Path | None,
    detect_s: float,
) -> ClipOutcome:
    """One clip's ball placed and written."""
    folder, started = work / clip.clip_id, time.monotonic()
    try:
        document = read_document(folder / "clip.json", "clip")
        around = Surroundings(
            camera=clip.camera,
            size=size,
            doubt=camera_doubt(clip, document),
            players=players_at(folder, scene),
            marks=read_marks(marks, clip, size) if marks is not None else no_events(),
        )
        drag = Prior(mean=options.drag_mean, std=options.drag_std) if options.drag_mean > 0 else None
        lifted = lift_ball(track, around, scene=scene, method=options.method, quality=options.quality, drag=drag)
        ball = clip_ball(lifted, clip_id=clip.clip_id, video_frame=clip.video_frame, timestamp=clip.timestamp)
    except ValueError as error:
        return ClipOutcome(clip_id=clip.clip_id, state="failed", reason=str(error), frames=len(track.times))
    for name in BALL_TABLES:
        (folder / f"{name}.parquet").unlink(missing_ok=True)
    write_clip_ball(folder, ball, scene=scene)
    write_document(folder / "clip.json", "clip", document | {"shutter_s": _shutter(lifted, around, document)})
    return outcome_of(clip.clip_id, lifted, detect_s=detect_s, lift_s=time.monotonic() - started)


def outcome_of(clip_id: str, lifted: LiftedBall, *, detect_s: float, lift_s: float) -> ClipOutcome:
    """What became of a clip that was placed."""
    solution, track = lifted.solution, lifted.track
    residual = solution.flights.residual_px[np.isfinite(solution.flights.residual_px)]
    placed = int((solution.status != "none").sum())
    detected = int(np.isfinite(track.pixels[:, 0]).sum())
    nothing = (solution.said or "not placed in any frame") if detected else "no ball in any frame"
    reason = _short_of(solution.flights.status) if placed else nothing
    return ClipOutcome(
        clip_id=clip_id,
        state="ok" if placed else "no ball",
        reason=reason,
        frames=len(track.times),
        detected=detected,
        measured=int((solution.status == "measured").sum()),
        filled=int((solution.status == "filled").sum()),
        hits=int((solution.events.kinds == "hit").sum()),
        bounces=int((solution.events.kinds == "bounce").sum()),
        residual_px=float(np.median(residual)) if len(residual) else None,
        detect_s=detect_s,
        lift_s=lift_s,
    )


def _short_of(status: tuple[str, ...]) -> str:
    """What flights lack of being solved as asked for; empty where they all are."""
    words = {"none": "not placed", "line": "by the line method", "fallback": "smoothed from their neighbours"}
    short = [f"{status.count(name)} {said}" for name, said in words.items() if name in status]
    return f"of {len(status)} flights {', '.join(short)}" if short else ""


def players_at(folder: Path, scene: Scene) -> PlayersAt | None:
    """Where the players of a clip are, by its table of players; None without one."""
    path = folder / "players.parquet"
    if not path.is_file() or not scene.players:
        return None
    columns = read_table(path)
    roots, hands = [], []
    for player in scene.players:
        assert player.skeleton is not None
        joints = columns[f"{player.name}.joints"].reshape(len(columns["frame_index"]), -1, 3).astype(np.float64)
        wrists = [i for i, name in enumerate(player.skeleton.joint_names) if WRIST in name.lower()]
        roots.append(columns[f"{player.name}.root_position"].astype(np.float64))
        hands.append(joints[:, wrists])
    return PlayersAt(
        names=tuple(player.name for player in scene.players),
        root_position=np.stack(roots, axis=1),
        hands=np.stack(hands, axis=1),
    )


def read_marks(path: Path, clip: ClipCamera, size: tuple[int, int]) -> BallEvents:
    """A person's events of a clip, by frames of its video, from EVENTS.csv or an export of an annotation tool.

    Raises:
        ValueError: If the file is none of them.
    """
    from pgm_data.convert.annotation_events import read_events

    return read_events(path, clip.capture_time, first_frame=int(clip.video_frame[0]), size=size)


def _shutter(lifted: LiftedBall, around: Surroundings, document: dict[str, Any]) -> float | None:
    """The clip's shutter time, s: from streaks where they tell, else what stood there."""
    solution, track = lifted.solution, lifted.track
    steps = np.diff(np.unique(track.times))
    if not len(steps):
        return document["shutter_s"]
    speed = pixel_velocity(around.camera, solution.position, solution.velocity)
    found = shutter_from_streaks(track.streak_px, speed, float(np.median(steps)))
    return found.mean if found is not None else document["shutter_s"]
