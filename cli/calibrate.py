"""`pgm-calibrate`: a camera for every frame of every video."""

import json
import os
import shlex
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import tyro

from .console import Progress, UsageError, option_error, print_error, table_text

if TYPE_CHECKING:
    from pgm_data.stages.calibrate import CalibrateOptions
    from pgm_data.stages.calibrate_plan import Plan
    from pgm_data.stages.calibrate_run import Manner, RunSummary, VideoRow
    from pgm_data.stages.jobs import JobEvent

SOME_FAILED, NOTHING_USABLE = 3, 4
ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Threads of libraries whose tasks here are too small to share."""


@dataclass(frozen=True, kw_only=True)
class CalibrateCommand:
    """A camera for every frame of every video.

    Shots are split, the court is found and measured, and each frame gets a full camera: or the reason why it has none.
    Exit codes: 0 all well (a video without a court is an answer); 3 an input failed or is damaged; 4 no clip at all.
    """

    videos: tyro.conf.Positional[tuple[Path, ...]]
    """Videos, still pictures, and folders to search for them."""
    out: Path
    """Work folder to write; it must be new or empty, or one of --resume and --overwrite be given."""
    scene: str = "tennis"
    """Name of a scene that ships with pgm, or the path of a scene file."""
    quality: Literal["draft", "standard", "best"] = "standard"
    """draft browses an archive, standard is for work, best for publishing."""
    keypoints: str = ""
    """KEYPOINTS.csv (video,frame,name,x,y): a person's court points, which override what is detected."""
    network: str = ""
    """ONNX file of a court network to use instead of the bundled one; none for lines alone."""
    overlay: bool = True
    """Whether each clip gets overlay.mp4, its video with the court drawn in."""
    clip_prefix: str = ""
    """Put before every clip's name; {parent} stands for the name of the video's folder."""
    match_id: str = ""
    """The match that all videos belong to; each is a match of its own unless given."""
    only: str = ""
    """Take only videos whose file name or path matches this pattern, such as "*_final*"."""
    limit: int = 0
    """Take so many videos at most; 0 for all."""
    workers: int = 0
    """Videos at a time; 0 for one a processor core."""
    cluster: str = ""
    """Address of a Dask scheduler, such as tcp://host:8786, whose workers see the same files."""
    timeout: float = 0.0
    """Longest time for one video, seconds; 0 for any."""
    resume: bool = False
    """Go on where an earlier run into this folder stopped: finished videos stay unless what they depend on changed."""
    overwrite: bool = False
    """Delete what an earlier run wrote into this folder, and begin again."""
    dry_run: bool = False
    """Say what would be done, and write nothing."""
    quiet: bool = False
    """Say nothing but errors."""
    json: bool = False
    """Print one JSON document instead of a table."""


def main(argv: list[str]) -> int:
    """Calibrate the videos; the exit code."""
    command = tyro.cli(CalibrateCommand, args=argv, prog="pgm-calibrate")
    _check(command)
    options, plan = _planned(command)
    if not plan.tasks:
        given = " ".join(map(str, command.videos))
        print_error(f"no video in {given} ({len(plan.ignored)} other files)")
        return NOTHING_USABLE
    if command.dry_run:
        print(_plan_text(plan, as_json=command.json))
        return 0
    for name in ONE_THREAD:
        os.environ.setdefault(name, "1")
    summary = _calibrated(command, options, plan, shlex.join(["pgm-calibrate", *argv]))
    return _tell(command, summary)


def _check(command: CalibrateCommand) -> None:
    if not command.videos:
        raise option_error("VIDEO", expected="at least one video or folder", got="none")
    for name, value in (("--limit", command.limit), ("--workers", command.workers), ("--timeout", command.timeout)):
        if not value >= 0:
            raise option_error(name, expected="0 or more", got=value)
    if command.keypoints and not Path(command.keypoints).is_file():
        raise option_error("--keypoints", expected="a CSV file", got=f"{command.keypoints}, which is none")
    if command.network not in ("", "none") and not Path(command.network).is_file():
        raise option_error("--network", expected="an ONNX file, or none", got=f"{command.network}, which is no file")


def _planned(command: CalibrateCommand) -> "tuple[CalibrateOptions, Plan]":
    from pgm_data.stages.calibrate import CalibrateOptions
    from pgm_data.stages.calibrate_plan import Choice, plan_run

    options = CalibrateOptions(
        scene=command.scene, quality=command.quality, keypoints=command.keypoints, network=command.network,
        overlay=command.overlay,
    )  # fmt: skip
    choice = Choice(clip_prefix=command.clip_prefix, match_id=command.match_id, only=command.only, limit=command.limit)
    try:
        plan = plan_run(command.videos, work=command.out, options=options, choice=choice)
        _check_network(options)
    except (FileNotFoundError, ValueError) as error:
        raise UsageError(str(error)) from error
    return options, plan


def _check_network(options: "CalibrateOptions") -> None:
    """Load a network that a person names, before hours are spent on it."""
    if options.network in ("", "none"):
        return
    from pgm_data.detect.court_network import CourtNetwork
    from pgm_data.scene import load_scene

    court = load_scene(options.scene).court
    assert court is not None
    CourtNetwork.load(Path(options.network), network_file="", names=court.all_names)


def _calibrated(command: CalibrateCommand, options: "CalibrateOptions", plan: "Plan", line: str) -> "RunSummary":
    from pgm_data.stages.calibrate_run import (
        DISK_FULL,
        NO_SPACE,
        NameTaken,
        VideoRow,
        calibrate_work,
        write_run_document,
    )

    from .output import prepare_output

    started = datetime.now(UTC)
    summary: RunSummary | None = None
    progress = Progress(total=len(plan.tasks), quiet=command.quiet)

    def write_run(rows: Sequence[VideoRow]) -> None:
        write_run_document(command.out, plan, rows, command=line, options=command, started=started)

    try:
        with prepare_output(command.out, resume=command.resume, overwrite=command.overwrite):
            summary = calibrate_work(
                plan, command.out, options=options, manner=_manner(command, len(plan.tasks)),
                tell=_shown(progress, plan), write_run=write_run,
            )  # fmt: skip
        return summary
    except (NameTaken, ModuleNotFoundError) as error:
        raise UsageError(str(error)) from error
    except OSError as error:
        if summary is not None and error.errno in NO_SPACE:
            # Only the note of what was written found no room; the next run with --resume makes up for it.
            return replace(summary, trouble=summary.trouble or DISK_FULL)
        if command.cluster and error.errno is None:
            got = f"{command.cluster}: {error}"
            raise option_error("--cluster", expected="a Dask scheduler that answers", got=got) from error
        raise
    finally:
        progress.close()


def _manner(command: CalibrateCommand, videos: int) -> "Manner":
    from pgm_data.stages.calibrate_run import Manner
    from pgm_data.stages.supervise import usable_cores

    workers = min(command.workers or usable_cores(), videos)
    return Manner(workers=workers, cluster=command.cluster, timeout_s=command.timeout or None, resume=command.resume)


def _shown(progress: Progress, plan: "Plan") -> "Callable[[JobEvent], None]":
    """What is said of each event of a job."""
    from pgm_data.stages.work_folder import key_of

    names = {key_of(task.stem): task.video.name for task in plan.tasks}

    def show(event: "JobEvent") -> None:
        name = names[event.name]
        if event.kind == "progress":
            progress.update(name, event.share)
        elif event.kind == "skipped":
            progress.finish(name, f"{name}: done before")
        elif event.kind == "done":
            progress.finish(name)
        elif event.kind == "failed":
            progress.finish(name, f"{name}: failed: {event.message}")

    return show


def _tell(command: CalibrateCommand, summary: "RunSummary") -> int:
    """Print what became of the run; its exit code."""
    code = NOTHING_USABLE if not summary.any_clip else 0 if summary.all_well else SOME_FAILED
    if command.json:
        print(json.dumps(_document(command, summary, code), indent=2))
    elif not command.quiet:
        print(_table(summary))
        print(f"\n{command.out / 'report.html'}")
    if summary.trouble:
        print_error(summary.trouble)
    elif not summary.any_clip:
        print_error("no video gave a clip: there is no frame with a camera")
    return code


def _plan_text(plan: "Plan", *, as_json: bool) -> str:
    if as_json:
        videos = [{"path": task.source_path, "clip_id": task.stem, "match_id": task.match_id} for task in plan.tasks]
        ignored = [{"path": path, "reason": reason} for path, reason in plan.ignored]
        return json.dumps({"videos": videos, "ignored": ignored}, indent=2)
    rows = [(str(task.video), task.stem, task.match_id, "marked" if task.marks else "") for task in plan.tasks]
    lines = [table_text(("video", "clips", "match", "keypoints"), rows)]
    lines += [f"ignored {path}: {reason}" for path, reason in plan.ignored]
    return "\n".join(lines)


def _document(command: CalibrateCommand, summary: "RunSummary", code: int) -> dict[str, object]:
    return {
        "work": str(command.out),
        "exit_code": code,
        "trouble": summary.trouble,
        "videos": [
            {
                "path": row.path,
                "state": row.state,
                "reason": row.reason,
                "clips": list(row.clips),
                "frames": row.frames,
                "measured": row.measured,
                "interpolated": row.interpolated,
                "none": row.frames - row.measured - row.interpolated,
                "reprojection_px": row.reprojection_px,
                "seconds": row.seconds,
                "frames_per_second": row.frames_per_second,
                "peak_memory_mb": row.peak_memory_mb,
                "resumed": row.resumed,
            }
            for row in summary.videos
        ],
    }


def _table(summary: "RunSummary") -> str:
    header = ("video", "state", "frames", "clips", "measured", "interp.", "none", "px", "frames/s", "MB", "trouble")
    return table_text(header, [_cells(row) for row in summary.videos])


def _cells(row: "VideoRow") -> tuple[object, ...]:
    known = row.peak_memory_mb is not None and row.frames > 0
    rest = row.frames - row.measured - row.interpolated
    shares = [_percent(part, row.frames) if known else "-" for part in (row.measured, row.interpolated, rest)]
    reason = row.reason if len(row.reason) <= 100 else row.reason[:97] + "..."
    measures = (row.reprojection_px, row.frames_per_second, row.peak_memory_mb)
    numbers = [float("nan") if value is None else value for value in measures]
    return row.path, row.state, row.frames, len(row.clips), *shares, *numbers, reason


def _percent(part: int, whole: int) -> str:
    """A share; 100 % and 0 % only where it is all or nothing."""
    percent = 100 * part / whole
    return f"{percent:.0f} %" if part in (0, whole) else f"{min(max(percent, 0.1), 99.9):.1f} %"
