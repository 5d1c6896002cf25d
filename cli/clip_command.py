"""What the commands that work on the clips of a work folder share."""

import json
import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from .console import Progress, UsageError, option_error, print_error, table_text

if TYPE_CHECKING:
    from pgm_data.scene import Scene
    from pgm_data.stages.clip_run import ClipRow, ClipStage, ClipTask
    from pgm_data.stages.jobs import JobEvent

SOME_FAILED, NOTHING_USABLE = 3, 4
ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Threads of libraries whose tasks here are too small to share."""
LONGEST_REASON = 80


class WorkCommand(Protocol):
    """Options that all of them have."""

    @property
    def clip(self) -> tuple[str, ...]:
        """Only these clips."""
        ...

    @property
    def videos(self) -> str:
        """Folder of the videos."""
        ...

    @property
    def workers(self) -> int:
        """Videos at a time."""
        ...

    @property
    def timeout(self) -> float:
        """Longest time for one video, s."""
        ...

    @property
    def resume(self) -> bool:
        """Go on."""
        ...

    @property
    def overwrite(self) -> bool:
        """Begin again."""
        ...

    @property
    def quiet(self) -> bool:
        """Say nothing but errors."""
        ...

    @property
    def json(self) -> bool:
        """Print JSON."""
        ...


@dataclass(frozen=True, eq=False, kw_only=True)
class Telling:
    """How a command speaks of its clips."""

    header: tuple[str, ...]
    cells: Callable[[Any], tuple[object, ...]]
    """Cells of a clip's outcome under the header."""
    nothing: str
    """Said where no clip came to anything."""


def planned(
    command: WorkCommand,
    work: Path,
    stage: "ClipStage",
    *,
    files: Mapping[str, Path],
    suffixes: Mapping[str, Sequence[str]],
    for_every_clip: bool = False,
) -> "tuple[ClipTask, ...]":
    """The clips to be done; none where the folder holds none.

    Args:
        command: Its options.
        work: The work folder.
        stage: What is to be done.
        files: By option, a file or a folder of files about clips.
        suffixes: By option, how the names of such files end.
        for_every_clip: Whether every clip that is to be done needs a file of each option.

    Raises:
        UsageError: If an option is not what it must be, or clips have what the stage writes already.
    """
    from pgm_data.stages.clip_run import files_by_clip, has_tables, plan_clips

    for name, value in (("--workers", command.workers), ("--timeout", command.timeout)):
        if not 0 <= value < math.inf:
            raise option_error(name, expected="0 or more", got=value)
    for option, path in files.items():
        if not path.exists():
            raise option_error(option, expected="a file or a folder", got=f"{path}, which is not there")
    try:
        about = {
            option: files_by_clip(path, work, option=option, suffixes=suffixes[option])
            for option, path in files.items()
        }
        videos = Path(command.videos) if command.videos else None
        tasks = plan_clips(work, only=command.clip, videos=videos, files=about)
    except ValueError as error:
        raise UsageError(str(error)) from error
    if not tasks:
        is_work = (work / "run.json").is_file()
        why = "no court was found in its videos" if is_work else "expected a work folder that pgm-calibrate wrote"
        print_error(f"no clip in {work}: {why}")
        return ()
    for option in files if for_every_clip else ():
        without = [task.clip_id for task in tasks if option not in task.files]
        if without:
            raise option_error(option, expected="a file about every clip, or --clip", got=f"none about {without[0]}")
    there = [task.clip_id for task in tasks if has_tables(stage, work, task.clip_id)]
    if there and not (command.resume or command.overwrite):
        hint = "--resume goes on, --overwrite begins again"
        what = stage.tables[0]
        raise UsageError(f"{work}: expected clips without {what}.parquet, got {there[0]} that has one; {hint}")
    return tasks


def scene_of(named: str, work: Path, tasks: "Sequence[ClipTask]") -> "tuple[str, Scene]":
    """The scene of a run, by name or path, and loaded: the one named, else that of the clips.

    Raises:
        UsageError: If there is no such scene, clips are of several, or their cameras are of another court.
    """
    from pgm_data.dataset.documents import read_document
    from pgm_data.scene import load_scene

    documents = [work / task.clip_id / "clip.json" for task in tasks if task.video is not None]
    of_clips = {read_document(path, "clip")["scene"] for path in documents}
    scene = named
    if not scene:
        if len(of_clips) > 1:
            raise option_error("--scene", expected="one scene for all clips", got=f"{', '.join(sorted(of_clips))}")
        scene = of_clips.pop() if of_clips else "tennis"  # of no consequence: no clip can be done
    try:
        loaded = load_scene(scene)
    except ValueError as error:
        raise UsageError(str(error)) from error
    for name in of_clips - {scene}:
        # The cameras are in metres of the court that they were found by.
        other, own = _court_size(name), loaded.court.surface_half_size if loaded.court is not None else None
        if other is not None and other != own:
            raise option_error("--scene", expected=f"the court that the cameras were found by, {name}", got=scene)
    return scene, loaded


def _court_size(scene: str) -> tuple[float, float] | None:
    """Half size of the scene's court; None where the scene is not at hand."""
    from pgm_data.scene import load_scene

    try:
        court = load_scene(scene).court
    except ValueError:
        return None
    return court.surface_half_size if court is not None else None


def carried_out(
    command: WorkCommand,
    work: Path,
    stage: "ClipStage",
    tasks: "Sequence[ClipTask]",
    *,
    options: object,
    used: Sequence[str],
    line: str,
    after: "Callable[[Sequence[ClipRow]], Sequence[ClipRow]] | None" = None,
) -> "Sequence[ClipRow]":
    """Run the stage on the clips, with progress, and write the run's document; what became of each clip.

    Args:
        command: Its options, which go into the document.
        work: The work folder.
        stage: What is done.
        tasks: The clips.
        options: Of the stage.
        used: Options that may be paths of files which the result depends on.
        line: The command as it was typed.
        after: Called with the rows once all jobs have ended, for what concerns clips together; gives the rows back.
    """
    from pgm_data.stages.clip_run import RunManner, jobs_of, run_clips, write_stage_run
    from pgm_data.stages.supervise import usable_cores

    from .output import hold_work

    for name in ONE_THREAD:
        os.environ.setdefault(name, "1")
    videos = {task.video for task in tasks if task.video is not None}
    workers = max(min(command.workers or usable_cores(), len(videos)), 1)
    manner = RunManner(workers=workers, timeout_s=command.timeout or None, resume=command.resume)
    started = datetime.now(UTC)
    progress = Progress(total=len(videos), quiet=command.quiet)
    with hold_work(work):
        try:
            jobs = jobs_of(stage, tasks, work, options, used=used)
            rows = run_clips(stage, tasks, jobs, work, manner=manner, tell=_shown(progress))
        finally:
            progress.close()
        if after is not None:
            rows = after(rows)
        write_stage_run(stage, work, rows, command=line, options=command, started=started)
    return rows


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


def told(command: WorkCommand, work: Path, rows: "Sequence[ClipRow]", telling: Telling) -> int:
    """Print what became of the run; its exit code."""
    states = [row.outcome.state for row in rows]
    code = NOTHING_USABLE if "ok" not in states else SOME_FAILED if "failed" in states else 0
    if command.json:
        from pgm_data.provenance import plain

        clips = plain([row.outcome for row in rows])
        print(json.dumps({"work": str(work), "exit_code": code, "clips": clips}, indent=2))
    elif not command.quiet:
        print(table_text(telling.header, [telling.cells(row.outcome) for row in rows]))
        print(f"\n{work / 'report.html'}")
    for row in rows:
        if row.outcome.state == "failed":
            print_error(f"{row.outcome.clip_id}: {row.outcome.reason}")
    if code == NOTHING_USABLE:
        print_error(telling.nothing)
    return code


def short(reason: str) -> str:
    """A reason that fits into a table."""
    return reason if len(reason) <= LONGEST_REASON else reason[: LONGEST_REASON - 3] + "..."
