"""A whole run of `pgm-ball3d` on a work folder: one job a video, and what the folder says once they have ended."""

import hashlib
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from pgm_data.convert.frame_pictures import source_video
from pgm_data.convert.posed_pictures import FieldError
from pgm_data.dataset.clip_ball import BALL_TABLES
from pgm_data.dataset.documents import read_document, write_document
from pgm_data.provenance import run_document
from pgm_data.stages.ball_clips import BallOptions, ClipOutcome
from pgm_data.stages.jobs import Job, JobEvent, JobLog, JobOutcome
from pgm_data.stages.report import write_work_report
from pgm_data.stages.supervise import run_jobs
from pgm_data.stages.work_folder import STATE, key_of

RUN_DOCUMENT = "run_ball3d.json"
"""Beside the `run.json` of the command that made the work folder."""
MARK_SUFFIXES = (".csv", ".xml", ".json")


@dataclass(frozen=True, eq=False, kw_only=True)
class ClipTask:
    """One clip that a run places the ball of."""

    clip_id: str
    video: Path | None
    """Its video; None where it is not found."""
    marks: Path | None
    """A person's events, where there are any."""
    trouble: str
    """Why it cannot be done; empty where it can."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ClipRow:
    """What became of a clip in a run."""

    outcome: ClipOutcome
    seconds: float | None
    """Wall-clock time of its video's process; None where none ran."""
    resumed: bool
    """Whether an earlier run did it."""


@dataclass(frozen=True, eq=False, kw_only=True)
class BallManner:
    """How the jobs of a run are carried out; no result depends on it."""

    workers: int = 1
    timeout_s: float | None = None
    """Longest time for one video."""
    resume: bool = False


def clip_ids(work: Path) -> tuple[str, ...]:
    """Clips of a work folder, by name."""
    return tuple(sorted(p.name for p in work.iterdir() if (p / "clip.json").is_file()))


def plan_clips(
    work: Path, *, only: Sequence[str] = (), videos: Path | None = None, marks: Mapping[str, Path] | None = None
) -> tuple[ClipTask, ...]:
    """The clips to be done, each with its video.

    Args:
        work: The work folder.
        only: Names of clips; all where empty.
        videos: Folder in which videos are looked for, where they have moved.
        marks: Files of a person's events by clip.

    Raises:
        ValueError: If a named clip is not there, or marks are of a clip that is none.
    """
    there = clip_ids(work)
    for what, names in (("--clip", only), ("--events", tuple(marks or ()))):
        stray = [name for name in names if name not in there]
        if stray:
            raise ValueError(f"{what}: expected clips of {work} ({', '.join(there) or 'none'}), got {stray[0]!r}")
    checked: dict[tuple[str, str], tuple[Path | None, str]] = {}
    tasks = []
    for clip_id in only or there:
        try:
            document = read_document(work / clip_id / "clip.json", "clip")
        except ValueError as error:
            tasks.append(ClipTask(clip_id=clip_id, video=None, marks=None, trouble=str(error)))
            continue
        key = (document["source_path"], document["sha256"])
        if key not in checked:
            checked[key] = _video(work, document, videos)
        video, trouble = checked[key]
        own = (marks or {}).get(clip_id)
        tasks.append(ClipTask(clip_id=clip_id, video=video, marks=own, trouble=trouble))
    return tuple(tasks)


def _video(work: Path, document: dict[str, Any], videos: Path | None) -> tuple[Path | None, str]:
    """A clip's video, or why there is none."""
    try:
        return source_video(work, document, videos), ""
    except FieldError as error:
        return None, str(error) + ("; --videos says where videos are" if error.field == "source_path" else "")


def marks_by_clip(path: Path, work: Path) -> dict[str, Path]:
    """Files of a person's events by clip: one file of the only clip, or a folder of files named after clips.

    Raises:
        ValueError: If a file fits no clip.
    """
    there = clip_ids(work)
    if path.is_file():
        if len(there) == 1:
            return {there[0]: path}
        if path.stem in there:
            return {path.stem: path}
        raise ValueError(f"--events: expected a folder of files named after the {len(there)} clips, got {path}")
    files = {p.stem: p for p in sorted(path.iterdir()) if p.suffix.lower() in MARK_SUFFIXES}
    stray = sorted(set(files) - set(there))
    if stray:
        raise ValueError(f"--events: expected files named after clips ({', '.join(there)}), got {files[stray[0]].name}")
    return files


def jobs_of(tasks: Sequence[ClipTask], work: Path, options: BallOptions) -> list[Job]:
    """One job a video. Whatever its result depends on is among its arguments, so that a change of it is noticed."""
    scene = Path(options.scene)
    own = asdict(options) | ({"scene": os.path.abspath(scene)} if scene.is_file() else {})
    used = {name: _digest(Path(name)) for name in (options.scene, options.network) if name and Path(name).is_file()}
    by_video: dict[Path, list[ClipTask]] = {}
    for task in tasks:
        if task.video is not None and not task.trouble:
            by_video.setdefault(task.video, []).append(task)
    jobs = []
    for video, clips in by_video.items():
        names = [task.clip_id for task in clips]
        marks = {task.clip_id: os.path.abspath(task.marks) for task in clips if task.marks is not None}
        about = video.stat()
        contents = {"video": [about.st_size, about.st_mtime_ns]} | used
        for task in clips:
            for name in ("camera.parquet", "players.parquet"):
                path = work / task.clip_id / name
                if path.is_file():
                    contents[f"{task.clip_id}/{name}"] = _digest(path)
            if task.marks is not None:
                contents[f"{task.clip_id} events"] = _digest(task.marks)
        arguments = {
            "work": os.path.abspath(work),
            "video": os.path.abspath(video),
            "clips": names,
            "marks": marks,
            "options": own,
            "contents": contents,
        }
        jobs.append(Job(name=key_of(names[0]), stage="ball3d", arguments=arguments))
    return jobs


def ball_work(
    tasks: Sequence[ClipTask],
    work: Path,
    *,
    options: BallOptions,
    manner: BallManner,
    tell: Callable[[JobEvent], None],
) -> tuple[ClipRow, ...]:
    """Find and place the ball of the clips in the work folder, which the caller holds; what became of each.

    Raises:
        KeyboardInterrupt: After what had ended was written down.
        OSError: Where the disk is full.
    """
    jobs = jobs_of(tasks, work, options)
    state = work / STATE / "ball3d"
    log = JobLog(state / "jobs.jsonl")
    if manner.resume:
        _forget_lost(jobs, work, log)
    resumed: set[str] = set()

    def watch(event: JobEvent) -> None:
        tell(event)
        if event.kind == "skipped":
            resumed.add(event.name)

    try:
        run_jobs(
            jobs,
            state_dir=state,
            workers=manner.workers,
            resume=manner.resume,
            timeout_s=manner.timeout_s,
            on_event=watch,
        )
    finally:
        if (work / "run.json").is_file():
            write_work_report(work)
    return clip_rows(tasks, jobs, log, resumed)


def clip_rows(tasks: Sequence[ClipTask], jobs: Sequence[Job], log: JobLog, resumed: set[str]) -> tuple[ClipRow, ...]:
    """What became of each clip, by the log of the jobs."""
    ended: dict[str, tuple[Job, JobOutcome | None]] = {}
    outcomes = log.outcomes()
    for job in jobs:
        digest, outcome = outcomes.get(job.name, ("", None))
        for clip_id in job.arguments["clips"]:  # type: ignore[attr-defined]
            ended[clip_id] = (job, outcome if digest == job.digest() else None)
    rows = []
    for task in tasks:
        job, outcome = ended.get(task.clip_id, (None, None))
        if outcome is not None and outcome.result is not None:
            found = next(entry for entry in outcome.result["clips"] if entry["clip_id"] == task.clip_id)
            own, seconds = ClipOutcome(**found), outcome.seconds
        else:
            why = task.trouble or (outcome.reason if outcome is not None else "the run ended before it")
            own, seconds = ClipOutcome(clip_id=task.clip_id, state="failed", reason=why), None
        rows.append(ClipRow(outcome=own, seconds=seconds, resumed=job is not None and job.name in resumed))
    return tuple(rows)


def write_ball_run(work: Path, rows: Sequence[ClipRow], *, command: str, options: object, started: datetime) -> None:
    """Write the run's document beside the work folder's own."""
    states = {"ok": "ok", "no ball": "degraded", "failed": "failed"}
    inputs = [
        {
            "path": row.outcome.clip_id,
            "state": states[row.outcome.state],
            "reason": row.outcome.reason,
            "clips": [row.outcome.clip_id] if row.outcome.state != "failed" else [],
            "seconds": row.seconds,
        }
        for row in rows
    ]
    document = run_document(command=command, options=options, started=started, inputs=inputs)
    write_document(work / RUN_DOCUMENT, "run", document)


def has_ball(work: Path, clip_id: str) -> bool:
    """Whether any of the ball's tables is in the clip's folder."""
    return any((work / clip_id / f"{name}.parquet").exists() for name in BALL_TABLES)


def _forget_lost(jobs: Sequence[Job], work: Path, log: JobLog) -> None:
    """Note as not done what is done by the log, but has lost its files since."""
    from dataclasses import replace

    outcomes = log.outcomes()
    for job in jobs:
        digest, outcome = outcomes.get(job.name, ("", None))
        if outcome is None or outcome.state != "done" or digest != job.digest() or outcome.result is None:
            continue
        good = [entry["clip_id"] for entry in outcome.result["clips"] if entry["state"] != "failed"]
        if not all((work / clip / f"{name}.parquet").is_file() for clip in good for name in BALL_TABLES):
            log.append(job, replace(outcome, state="failed", reason="its files are gone", result=None))


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
