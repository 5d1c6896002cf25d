"""`pgm-ball3d`: the ball in metres, for the clips of a work folder or for a 2D track of somebody else's."""

import json
import os
import shlex
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import tyro

from .console import Progress, UsageError, option_error, print_error, table_text

if TYPE_CHECKING:
    from collections.abc import Sequence

    from pgm_data.scene import Prior
    from pgm_data.stages.ball_clips import BallOptions
    from pgm_data.stages.ball_run import ClipRow, ClipTask
    from pgm_data.stages.jobs import JobEvent

SOME_FAILED, NOTHING_USABLE = 3, 4
ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Threads of libraries whose tasks here are too small to share."""
WORK_ONLY = ("clip", "videos", "workers", "timeout", "resume")
TRACK_ONLY = ("camera", "out", "fps", "size", "sigma")


@dataclass(frozen=True, kw_only=True)
class BallCommand:
    """The ball in metres, with its uncertainty, its events and its flights.

    pgm-ball3d WORK finds the ball in the clips that pgm-calibrate made and writes ball.parquet, events.parquet and
    ball_shots.parquet beside their cameras. pgm-ball3d TRACK.csv --camera CAMERA --out DIR takes somebody else's 2D
    track and writes the same tables into DIR. Exit codes: 0 all well; 3 a clip failed; 4 no ball was placed at all.
    """

    source: tyro.conf.Positional[Path]
    """Work folder, or TRACK.csv (frame,x,y,visible and perhaps timestamp; TrackNet's forms too)."""
    method: Literal["line", "physics"] = "physics"
    """physics fits flight, spin and bounces jointly; line is the paper's method, faster and less exact."""
    quality: Literal["draft", "standard", "best"] = "standard"
    """draft browses an archive, standard is for work, best for publishing."""
    scene: str = ""
    """Name of a scene that ships with pgm, or the path of a scene file; that of the clips, else tennis."""
    events: str = ""
    """A person's events, which override what is detected: EVENTS.csv (frame,kind,x,y), or an export of CVAT or Label
    Studio; for a work folder of several clips a folder of files named after them. Of a kind that is marked none is
    looked for besides: mark all of a clip's hits, or none; with hits and bounces marked nothing is detected."""
    serve_speeds: str = ""
    """CSV of measured serve speeds (clip,frame,speed_kmh), from which the drag constant is estimated."""
    overwrite: bool = False
    """Replace what an earlier run wrote."""
    quiet: bool = False
    """Say nothing but errors."""
    json: bool = False
    """Print one JSON document instead of a table."""
    clip: tuple[str, ...] = ()
    """Of a work folder: only these clips."""
    videos: str = ""
    """Of a work folder: folder in which its videos are, where they have moved."""
    detector: Literal["auto", "network", "motion", "both"] = "auto"
    """Of a work folder: what finds the ball; motion needs no weights."""
    network: str = ""
    """Of a work folder: ONNX file of a ball network instead of the bundled one."""
    overlay: bool = True
    """Of a work folder: whether overlay.mp4 is drawn anew with the ball in it."""
    workers: int = 0
    """Of a work folder: videos at a time; 0 for one a processor core."""
    timeout: float = 0.0
    """Of a work folder: longest time for one video, seconds; 0 for any."""
    resume: bool = False
    """Of a work folder: clips that an earlier run finished stay unless what they depend on changed."""
    camera: str = ""
    """Of a track: CAMERA.json of a fixed camera, or camera.parquet."""
    out: str = ""
    """Of a track: folder to write into, new or empty."""
    fps: float = 0.0
    """Of a track without timestamps: frames per second."""
    size: str = ""
    """Of a track: width x height of the picture that its pixels are of, where that is not the camera's."""
    sigma: float = 1.0
    """Of a track: standard deviation of its pixels."""


def main(argv: list[str]) -> int:
    """Place the ball; the exit code."""
    command = tyro.cli(BallCommand, args=argv, prog="pgm-ball3d")
    line = shlex.join(["pgm-ball3d", *argv])
    if command.events and not Path(command.events).exists():
        raise option_error("--events", expected="a file or a folder", got=f"{command.events}, which is not there")
    if command.serve_speeds and not Path(command.serve_speeds).is_file():
        raise option_error("--serve-speeds", expected="a CSV file", got=f"{command.serve_speeds}, which is none")
    if command.source.is_dir():
        _refuse(command, TRACK_ONLY, "a track, and this is a folder")
        return _work(command, line)
    if not command.source.is_file():
        raise option_error("PATH", expected="a work folder or a TRACK.csv", got=f"{command.source}, which is neither")
    _refuse(command, WORK_ONLY, "a work folder, and this is a file")
    from .ball3d_track import place_track

    return place_track(command, line)


def _refuse(command: BallCommand, names: tuple[str, ...], of: str) -> None:
    for name in names:
        if getattr(command, name) != BallCommand.__dataclass_fields__[name].default:
            raise UsageError(f"--{name.replace('_', '-')}: is for {of}")


def _work(command: BallCommand, line: str) -> int:
    from pgm_data.stages.ball_run import BallManner, ball_work, has_ball, marks_by_clip, plan_clips, write_ball_run
    from pgm_data.stages.supervise import usable_cores

    from .output import hold_work

    work = command.source
    if command.workers < 0 or command.timeout < 0:
        name, value = ("--workers", command.workers) if command.workers < 0 else ("--timeout", command.timeout)
        raise option_error(name, expected="0 or more", got=value)
    if command.network and not Path(command.network).is_file():
        raise option_error("--network", expected="an ONNX file", got=f"{command.network}, which is none")
    try:
        marks = marks_by_clip(Path(command.events), work) if command.events else {}
        videos = Path(command.videos) if command.videos else None
        tasks = plan_clips(work, only=command.clip, videos=videos, marks=marks)
    except ValueError as error:
        raise UsageError(str(error)) from error
    if not tasks:
        is_work = (work / "run.json").is_file()
        why = "no court was found in its videos" if is_work else "expected a work folder that pgm-calibrate wrote"
        print_error(f"no clip in {work}: {why}")
        return NOTHING_USABLE
    there = [task.clip_id for task in tasks if has_ball(work, task.clip_id)]
    if there and not (command.resume or command.overwrite):
        hint = "--resume goes on, --overwrite begins again"
        raise UsageError(f"{work}: expected clips without a ball, got {there[0]} that has one; {hint}")
    options = _options(command, tasks)
    for name in ONE_THREAD:
        os.environ.setdefault(name, "1")
    videos_of = {task.video for task in tasks if task.video is not None}
    workers = max(min(command.workers or usable_cores(), len(videos_of)), 1)
    manner = BallManner(workers=workers, timeout_s=command.timeout or None, resume=command.resume)
    started = datetime.now(UTC)
    progress = Progress(total=len(videos_of), quiet=command.quiet)
    with hold_work(work):
        try:
            rows = ball_work(tasks, work, options=options, manner=manner, tell=_shown(progress))
        finally:
            progress.close()
        write_ball_run(work, rows, command=line, options=command, started=started)
    return _tell(command, work, rows)


def _options(command: BallCommand, tasks: "Sequence[ClipTask]") -> "BallOptions":
    from pgm_data.dataset.documents import read_document
    from pgm_data.scene import load_scene
    from pgm_data.stages.ball_clips import BallOptions

    scene = command.scene
    documents = [command.source / task.clip_id / "clip.json" for task in tasks if task.video is not None]
    named = {read_document(path, "clip")["scene"] for path in documents}
    if not scene:
        if not named:
            named = {"tennis"}  # of no consequence: no clip can be placed
        if len(named) > 1:
            raise option_error("--scene", expected="one scene for all clips", got=f"{', '.join(sorted(named))}")
        scene = named.pop()
    try:
        loaded = load_scene(scene)
    except ValueError as error:
        raise UsageError(str(error)) from error
    if loaded.ball is None or loaded.court is None:
        raise option_error("--scene", expected="a scene with a ball and a court", got=loaded.name)
    for name in named - {scene}:
        # The cameras are in metres of the court that they were found by.
        other = _court_size(name)
        if other is not None and other != loaded.court.surface_half_size:
            raise option_error("--scene", expected=f"the court that the cameras were found by, {name}", got=scene)
    drag = _serve_drag(command)
    return BallOptions(
        scene=scene,
        method=command.method,
        quality=command.quality,
        detector=command.detector,
        network=command.network,
        drag_mean=drag.mean if drag is not None else 0.0,
        drag_std=drag.std if drag is not None else 0.0,
        overlay=command.overlay,
    )


def _court_size(scene: str) -> tuple[float, float] | None:
    """Half size of the scene's court; None where the scene is not at hand."""
    from pgm_data.scene import load_scene

    try:
        court = load_scene(scene).court
    except ValueError:
        return None
    return court.surface_half_size if court is not None else None


def _serve_drag(command: BallCommand) -> "Prior | None":
    """The drag constant by measured serves of clips that have been placed before."""
    if not command.serve_speeds:
        return None
    from pgm_data.stages.ball_serves import drag_of_serves

    try:
        found = drag_of_serves(command.source, Path(command.serve_speeds), command.scene)
    except ValueError as error:
        raise UsageError(str(error)) from error
    if not command.quiet:
        print(found.text)
    return found.drag


def _shown(progress: Progress) -> "Callable[[JobEvent], None]":
    def show(event: "JobEvent") -> None:
        if event.kind == "progress":
            progress.update(event.name, event.share)
        elif event.kind == "skipped":
            progress.finish(event.name, f"{event.name}: done before")
        elif event.kind == "done":
            progress.finish(event.name)
        elif event.kind == "failed":
            progress.finish(event.name, f"{event.name}: failed: {event.message}")

    return show


def _tell(command: BallCommand, work: Path, rows: "tuple[ClipRow, ...]") -> int:
    """Print what became of the run; its exit code."""
    states = [row.outcome.state for row in rows]
    code = NOTHING_USABLE if "ok" not in states else SOME_FAILED if "failed" in states else 0
    if command.json:
        from pgm_data.provenance import plain

        print(
            json.dumps({"work": str(work), "exit_code": code, "clips": plain([row.outcome for row in rows])}, indent=2)
        )
    elif not command.quiet:
        print(table_text(HEADER, [_cells(row) for row in rows]))
        print(f"\n{work / 'report.html'}")
    for row in rows:
        if row.outcome.state == "failed":
            print_error(f"{row.outcome.clip_id}: {row.outcome.reason}")
    if code == NOTHING_USABLE:
        print_error("no ball was placed in any clip")
    return code


HEADER = (
    "clip", "state", "frames", "seen", "measured", "filled", "hits", "bounces", "px", "find s", "place s", "trouble",
)  # fmt: skip


def _cells(row: "ClipRow") -> tuple[object, ...]:
    own = row.outcome
    reason = own.reason if len(own.reason) <= 80 else own.reason[:77] + "..."
    counts = (own.frames, own.detected, own.measured, own.filled, own.hits, own.bounces)
    return own.clip_id, own.state, *counts, own.residual_px, own.detect_s, own.lift_s, reason
