"""`pgm-ball3d TRACK.csv`: a foreign 2D track in metres, into a folder of its own."""

import json
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from .ball3d import NOTHING_USABLE, BallCommand
from .console import UsageError, option_error, print_error, table_text
from .output import prepare_output

if TYPE_CHECKING:
    from pgm_data.scene import Scene
    from pgm_data.stages.ball_track import TrackJob


def place_track(command: BallCommand, line: str) -> int:
    """Place the track and write its tables; the exit code."""
    job = _job(command)
    from pgm_data.dataset.clip_ball import write_clip_ball
    from pgm_data.dataset.documents import write_document
    from pgm_data.inputs import clean_name
    from pgm_data.provenance import plain, run_document
    from pgm_data.stages.ball_track import place_track as placed_track

    started = datetime.now(UTC)
    out = Path(command.out)
    try:
        placed = placed_track(job, clip_id=clean_name(command.source.stem))
    except ValueError as error:
        raise UsageError(str(error)) from error
    own = placed.outcome
    with prepare_output(out, resume=False, overwrite=command.overwrite):
        write_clip_ball(out, placed.ball, scene=job.scene)
        inputs = [
            {
                "path": command.source.name,
                "state": "ok" if placed.state == "ok" else "degraded",
                "reason": own.reason,
                "clips": [own.clip_id],
                "seconds": own.lift_s,
            }
        ]
        document = run_document(command=line, options=command, started=started, inputs=inputs)
        write_document(out / "run.json", "run", document)
    if command.json:
        print(json.dumps({"out": str(out), "times": placed.said, "track": plain(own)}, indent=2))
    elif not command.quiet:
        print(placed.said)
        header = ("track", "frames", "seen", "measured", "filled", "hits", "bounces", "px", "seconds", "trouble")
        counts = (own.frames, own.detected, own.measured, own.filled, own.hits, own.bounces)
        print(table_text(header, [(own.clip_id, *counts, own.residual_px, own.lift_s, own.reason)]))
        print(f"\nwrote {', '.join(str(out / f'{name}.parquet') for name in ('ball', 'events', 'ball_shots'))}")
    if placed.state != "ok":
        print_error(f"{command.source}: no ball was placed: {own.reason}")
        return NOTHING_USABLE
    return 0


def _job(command: BallCommand) -> "TrackJob":
    if not command.camera or not Path(command.camera).is_file():
        got = f"{command.camera}, which is no file" if command.camera else "none"
        raise option_error("--camera", expected="CAMERA.json or camera.parquet", got=got)
    if not command.out:
        raise option_error("--out", expected="a folder to write into", got="none")
    if command.fps and not 1 <= command.fps <= 2000:
        raise option_error("--fps", expected="1 to 2000", got=command.fps)
    if not 0 < command.sigma < 1000:
        raise option_error("--sigma", expected="above 0", got=command.sigma)
    if command.serve_speeds:
        raise option_error("--serve-speeds", expected="a work folder whose clips it names", got="a track")
    if command.events and not Path(command.events).is_file():
        raise option_error("--events", expected="a file", got=command.events)
    from pgm_data.stages.ball_track import TrackJob

    return TrackJob(
        track=command.source,
        camera=Path(command.camera),
        scene=_scene(command.scene or "tennis"),
        events=Path(command.events) if command.events else None,
        fps=command.fps or None,
        size=_size(command.size),
        sigma_px=command.sigma,
        method=command.method,
        quality=command.quality,
    )


def _size(text: str) -> tuple[int, int] | None:
    """(width, height) of a text such as 512x288; None for an empty one."""
    if not text:
        return None
    words = text.lower().split("x")
    if len(words) != 2 or not all(word.isdecimal() and 0 < int(word) <= 100_000 for word in words):
        raise option_error("--size", expected="WIDTHxHEIGHT such as 512x288", got=repr(text))
    return int(words[0]), int(words[1])


def _scene(name: str) -> "Scene":
    from pgm_data.scene import load_scene

    try:
        scene = load_scene(name)
    except ValueError as error:
        raise UsageError(str(error)) from error
    if scene.ball is None or scene.court is None:
        raise option_error("--scene", expected="a scene with a ball and a court", got=scene.name)
    return scene
