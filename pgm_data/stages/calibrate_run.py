"""A whole run of `pgm-calibrate`: one job each video, and what the work folder says once they have ended."""

import errno
import hashlib
import os
import re
from collections.abc import Callable, Collection, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Any, Literal

from pgm_data.dataset.documents import read_document, write_document
from pgm_data.provenance import run_document
from pgm_data.scene import load_scene
from pgm_data.stages.calibrate import CalibrateOptions, VideoOutcome
from pgm_data.stages.calibrate_plan import Plan, VideoTask
from pgm_data.stages.jobs import Job, JobEvent, JobLog, JobOutcome
from pgm_data.stages.report import write_work_report
from pgm_data.stages.supervise import run_jobs
from pgm_data.stages.work_folder import (
    STATE,
    Part,
    drop,
    is_clip_of,
    key_of,
    merge_parts,
    part_path,
    parts_of,
    read_part,
    sweep,
)

DISK_FULL = "the disk is full"
NO_SPACE = (errno.ENOSPC, errno.EDQUOT)


class NameTaken(ValueError):
    """A clip name belongs to another video of the work folder."""


State = Literal["ok", "degraded", "no court", "failed", "unfinished"]


@dataclass(frozen=True, eq=False, kw_only=True)
class Manner:
    """How the jobs of a run are carried out; no result depends on it."""

    workers: int = 1
    cluster: str = ""
    """Address of a Dask scheduler; empty for this machine."""
    timeout_s: float | None = None
    """Longest time for one video."""
    resume: bool = False


@dataclass(frozen=True, eq=False, kw_only=True)
class VideoRow:
    """What became of one video in a run."""

    path: str
    """Its source path."""
    state: State
    reason: str
    clips: tuple[str, ...]
    frames: int
    """Frames decoded."""
    measured: int
    interpolated: int
    reprojection_px: float | None
    """Median over measured frames."""
    seconds: float | None
    """Wall-clock time of its process."""
    peak_memory_mb: float | None
    resumed: bool
    """Whether an earlier run did it."""

    @property
    def frames_per_second(self) -> float | None:
        """Frames calibrated in a second, the start of the process included."""
        return self.frames / self.seconds if self.seconds and self.frames else None


@dataclass(frozen=True, eq=False, kw_only=True)
class RunSummary:
    """What became of a run."""

    videos: tuple[VideoRow, ...]
    trouble: str
    """Why the run ended before its time; empty when it did not."""

    @property
    def any_clip(self) -> bool:
        """Whether there is anything to use."""
        return any(row.clips for row in self.videos)

    @property
    def all_well(self) -> bool:
        """Whether every input was read to its end; a video without a court is an answer, and well."""
        return not self.trouble and all(row.state in ("ok", "no court") for row in self.videos)


def jobs_of(plan: Plan, work: Path, options: CalibrateOptions) -> list[Job]:
    """One job a video. Whatever its result depends on is among its arguments, so that a change of it is noticed."""
    files = {
        name: hashlib.sha256(Path(path).read_bytes()).hexdigest()
        for name, path in (("scene", options.scene), ("network", options.network))
        if Path(path).is_file()
    }
    jobs = []
    for task in plan.tasks:
        about = task.video.stat()
        own = replace(options, keypoints=os.path.abspath(options.keypoints) if task.marks else "")
        for name in files:
            own = replace(own, **{name: os.path.abspath(getattr(options, name))})
        arguments = {
            "video": str(task.video),
            "work": os.path.abspath(work),
            "stem": task.stem,
            "match_id": task.match_id,
            "source_path": task.source_path,
            "options": asdict(own),
            "contents": {"video": [about.st_size, about.st_mtime_ns], "marks": task.marks} | files,
        }
        jobs.append(Job(name=key_of(task.stem), stage="calibrate", arguments=arguments))
    return jobs


def calibrate_work(
    plan: Plan,
    work: Path,
    *,
    options: CalibrateOptions,
    manner: Manner,
    tell: Callable[[JobEvent], None],
    write_run: Callable[[Sequence[VideoRow]], None],
) -> RunSummary:
    """Calibrate the planned videos into the work folder, which the caller holds, and write its tables and report.

    Args:
        plan: The videos.
        work: The folder.
        options: How videos are calibrated.
        manner: How jobs are carried out.
        tell: Told what happens.
        write_run: Writes `run.json` from what became of the videos.

    Raises:
        KeyboardInterrupt: After what had ended was written down.
        NameTaken: If a clip name in the folder belongs to another video.
    """
    jobs = jobs_of(plan, work, options)
    log = JobLog(work / STATE / "jobs.jsonl")
    if manner.resume:
        _refuse_taken(plan, work, log)
        _forget_lost(jobs, plan, work, log)

    skipped: set[str] = set()

    def watch(event: JobEvent) -> None:
        tell(event)
        if event.kind == "skipped":
            skipped.add(event.name)
        # The videos to come would only be decoded for nothing.
        if event.kind == "failed" and _is_full(event.message):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(work))

    trouble = ""
    try:
        run_jobs(
            jobs,
            state_dir=work / STATE,
            workers=manner.workers,
            resume=manner.resume,
            timeout_s=manner.timeout_s,
            cluster=manner.cluster,
            on_event=watch,
        )
    except KeyboardInterrupt:
        close_run(plan, jobs, work, skipped=skipped, scene=options.scene, write_run=write_run)
        raise
    except OSError as error:
        if error.errno not in NO_SPACE:
            raise
        trouble = DISK_FULL
    try:
        rows = close_run(plan, jobs, work, skipped=skipped, scene=options.scene, write_run=write_run)
    except OSError as error:
        if error.errno not in NO_SPACE and not _is_full(str(error)):
            raise
        trouble = f"{DISK_FULL}: shots.parquet, run.json and the report may be those of an earlier run or absent"
        rows = _rows(plan, jobs, work, skipped)
    return RunSummary(videos=rows, trouble=trouble)


def close_run(
    plan: Plan,
    jobs: Sequence[Job],
    work: Path,
    *,
    skipped: Collection[str],
    scene: str,
    write_run: Callable[[Sequence[VideoRow]], None],
) -> tuple[VideoRow, ...]:
    """What became of each video, after `shots.parquet`, `run.json` and `report.html` were brought up to it."""
    sweep(work, [task.stem for task in plan.tasks])
    rows = _rows(plan, jobs, work, skipped)
    merge_parts(work, _ordered_parts(plan, work), scene=load_scene(scene))
    write_run(rows)
    write_work_report(work)
    return rows


def write_run_document(
    work: Path, plan: Plan, rows: Sequence[VideoRow], *, command: str, options: object, started: datetime
) -> None:
    """Write `run.json`: this run's videos, what it ignored, and what earlier runs into the folder left there."""
    inputs = [
        {"path": row.path, "state": row.state, "reason": row.reason, "clips": list(row.clips), "seconds": row.seconds}
        for row in rows
    ]
    inputs += [
        {"path": path, "state": "ignored", "reason": reason, "clips": [], "seconds": None}
        for path, reason in plan.ignored
    ]
    named = {entry["path"] for entry in inputs}
    there = {part.video for part in parts_of(work)}
    path = work / "run.json"
    earlier = read_document(path, "run")["inputs"] if path.is_file() else []
    inputs += [entry for entry in earlier if entry["path"] in there - named]
    write_document(path, "run", run_document(command=command, options=options, started=started, inputs=inputs))


def _rows(plan: Plan, jobs: Sequence[Job], work: Path, skipped: Collection[str]) -> tuple[VideoRow, ...]:
    log = JobLog(work / STATE / "jobs.jsonl").outcomes()
    rows = []
    for task, job in zip(plan.tasks, jobs, strict=True):
        digest, outcome = log.get(job.name, ("", None))
        part = read_part(part_path(work, task.stem))
        ended = None
        if outcome is not None and digest == job.digest():
            ended = replace(outcome, resumed=job.name in skipped)
        rows.append(_row(task, ended, part))
    return tuple(rows)


def _row(task: VideoTask, outcome: JobOutcome | None, part: Part | None) -> VideoRow:
    """What became of a video, by its job and by what stands in the work folder."""
    if outcome is not None and outcome.state == "done" and outcome.result is not None and part is not None:
        fields: dict[str, Any] = outcome.result | {"clips": tuple(outcome.result["clips"])}
        result = VideoOutcome(**fields)
        nothing = f"no camera in any frame: {part.reason}" if not result.clips else ""
        return VideoRow(
            path=task.source_path,
            state="degraded" if result.trouble else "ok" if result.clips else "no court",
            reason="; ".join(filter(None, [result.trouble, nothing])),
            clips=result.clips,
            frames=result.frames,
            measured=result.measured,
            interpolated=result.interpolated,
            reprojection_px=result.reprojection_px,
            seconds=outcome.seconds,
            peak_memory_mb=result.peak_memory_mb,
            resumed=outcome.resumed,
        )
    if outcome is not None and outcome.state == "failed":
        state, reason = "failed", _plain_reason(outcome.reason).removeprefix(f"{task.video}: ")
    else:
        state, reason = "unfinished", "the run ended before it"
    return VideoRow(
        path=task.source_path,
        state=state,
        reason=reason + ("; the clips of an earlier run stay" if part is not None and part.clips else ""),
        clips=part.clips if part is not None else (),
        frames=part.frames if part is not None else 0,
        measured=0,
        interpolated=0,
        reprojection_px=None,
        seconds=outcome.seconds if outcome is not None else None,
        peak_memory_mb=None,
        resumed=False,
    )


def _plain_reason(reason: str) -> str:
    """A failure's reason in one line, without the names of Python's exceptions."""
    if _is_full(reason):
        return DISK_FULL
    return re.sub(r"^(VideoError|ValueError|FileNotFoundError|OSError): ", "", " ".join(reason.split()))


def _is_full(reason: str) -> bool:
    return any(os.strerror(number) in reason for number in NO_SPACE)


def _ordered_parts(plan: Plan, work: Path) -> list[Part]:
    """The parts of the plan's videos in its order, then those of earlier runs; each video once."""
    parts = {part.path: part for part in parts_of(work)}
    own = [parts.pop(path) for path in (part_path(work, task.stem) for task in plan.tasks) if path in parts]
    videos = {part.video for part in own}
    rest = []
    for part in parts.values():
        # The same video under the name that an earlier --clip-prefix gave it.
        if part.video in videos:
            drop(work, part)
        else:
            rest.append(part)
    return own + rest


def _forget_lost(jobs: Sequence[Job], plan: Plan, work: Path, log: JobLog) -> None:
    """Note as not done what is done by the log, but has lost its files since."""
    outcomes = log.outcomes()
    for task, job in zip(plan.tasks, jobs, strict=True):
        digest, outcome = outcomes.get(job.name, ("", None))
        if outcome is None or outcome.state != "done" or digest != job.digest():
            continue
        part = read_part(part_path(work, task.stem))
        if part is None or not all((work / clip / "camera.parquet").is_file() for clip in part.clips):
            log.append(job, replace(outcome, state="failed", reason="its files are gone", result=None))


def _refuse_taken(plan: Plan, work: Path, log: JobLog) -> None:
    """Raise NameTaken where a clip name in the folder belongs to a video that is none of the plan's."""
    outcomes = log.outcomes()
    for task in plan.tasks:
        outcome = outcomes.get(key_of(task.stem), ("", None))[1]
        before = Path(str((outcome.result or {}).get("video", ""))) if outcome is not None else Path()
        if before.is_file() and not before.samefile(task.video):
            raise NameTaken(
                f"clip_id: {task.stem!r} of {task.video} belongs to {before} in {work};"
                " tell them apart with --clip-prefix"
            )
    own = {part_path(work, task.stem) for task in plan.tasks}
    videos = {task.source_path for task in plan.tasks}
    for part in parts_of(work):
        if part.path in own or part.video in videos:
            continue
        for task in plan.tasks:
            clash = next((clip for clip in part.clips if is_clip_of(clip, task.stem)), "")
            if clash:
                raise NameTaken(
                    f"clip_id: {clash!r} in {work} is of {part.video}, and {task.video} may give a clip of that name;"
                    " tell them apart with --clip-prefix"
                )
