"""`pgm-ball3d`: the ball in metres, for the clips of a work folder or for a 2D track of somebody else's."""

import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import tyro

from .clip_command import NOTHING_USABLE, Telling, carried_out, planned, scene_of, short, told
from .console import UsageError, option_error

if TYPE_CHECKING:
    from collections.abc import Sequence

    from pgm_data.scene import Prior
    from pgm_data.stages.ball_clips import BallOptions, ClipOutcome
    from pgm_data.stages.clip_run import ClipTask

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
    from pgm_data.stages.ball_clips import EVENTS_OPTION
    from pgm_data.stages.ball_run import BALL_STAGE, MARK_SUFFIXES

    work = command.source
    if command.network and not Path(command.network).is_file():
        raise option_error("--network", expected="an ONNX file", got=f"{command.network}, which is none")
    marks = {EVENTS_OPTION: Path(command.events)} if command.events else {}
    tasks = planned(command, work, BALL_STAGE, files=marks, suffixes={EVENTS_OPTION: MARK_SUFFIXES})
    if not tasks:
        return NOTHING_USABLE
    options = _options(command, tasks)
    rows = carried_out(command, work, BALL_STAGE, tasks, options=options, used=("scene", "network"), line=line)
    return told(command, work, rows, TELLING)


def _options(command: BallCommand, tasks: "Sequence[ClipTask]") -> "BallOptions":
    from pgm_data.stages.ball_clips import BallOptions

    scene, loaded = scene_of(command.scene, command.source, tasks)
    if loaded.ball is None or loaded.court is None:
        raise option_error("--scene", expected="a scene with a ball and a court", got=loaded.name)
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


def _cells(own: "ClipOutcome") -> tuple[object, ...]:
    counts = (own.frames, own.detected, own.measured, own.filled, own.hits, own.bounces)
    return own.clip_id, own.state, *counts, own.residual_px, own.detect_s, own.lift_s, short(own.reason)


TELLING = Telling(
    header=(
        "clip", "state", "frames", "seen", "measured", "filled", "hits", "bounces", "px", "find s", "place s",
        "trouble",
    ),
    cells=_cells,
    nothing="no ball was placed in any clip",
)  # fmt: skip
