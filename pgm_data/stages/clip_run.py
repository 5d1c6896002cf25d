"""A whole run of a stage on the clips of a work folder: one job a video, resumed, and what it says of itself."""

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from datetime import datetime
from pathlib import Path
from typing import Any, Generic, TypeVar

from pgm_data.convert.frame_pictures import source_video
from pgm_data.convert.posed_pictures import FieldError
from pgm_data.dataset.documents import read_document, write_document
from pgm_data.dataset.files import sha256_of
from pgm_data.provenance import run_document
from pgm_data.stages.jobs import Job, JobEvent, JobLog, JobOutcome
from pgm_data.stages.report import write_work_report
from pgm_data.stages.supervise import run_jobs
from pgm_data.stages.work_folder import STATE, key_of

Outcome = TypeVar("Outcome")


@dataclass(frozen=True, eq=False, kw_only=True)
class ClipStage(Generic[Outcome]):
    """What a run must know of its stage."""

    name: str
    """In the table of stages; of its state's folder and of its document `run_<name>.json`."""
    tables: tuple[str, ...]
    """Tables that it writes for every clip that did not fail."""
    reads: tuple[str, ...]
    """Files of a clip that its result depends on, besides the video."""
    outcome: Callable[..., Outcome]
    """Makes the struct of what became of a clip, which has `clip_id`, `state`, `reason` and can do with these."""
    run_states: Mapping[str, str]
    """What the run's document says for each `state`: ok, degraded or failed."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ClipTask:
    """One clip of a run."""

    clip_id: str
    video: Path | None
    """Its video; None where it is not found."""
    files: Mapping[str, Path] = field(default_factory=dict)
    """A person's or another program's files about the clip, by the option that named them."""
    trouble: str = ""
    """Why it cannot be done; empty where it can."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ClipRow(Generic[Outcome]):
    """What became of a clip in a run."""

    outcome: Outcome
    seconds: float | None
    """Wall-clock time of its video's process; None where none ran."""
    resumed: bool
    """Whether an earlier run did it."""


@dataclass(frozen=True, eq=False, kw_only=True)
class RunManner:
    """How the jobs of a run are carried out; no result depends on it."""

    workers: int = 1
    timeout_s: float | None = None
    """Longest time for one video."""
    resume: bool = False


def clip_ids(work: Path) -> tuple[str, ...]:
    """Clips of a work folder, by name."""
    return tuple(sorted(p.name for p in work.iterdir() if (p / "clip.json").is_file()))


def plan_clips(
    work: Path,
    *,
    only: Sequence[str] = (),
    videos: Path | None = None,
    files: Mapping[str, Mapping[str, Path]] | None = None,
) -> tuple[ClipTask, ...]:
    """The clips to be done, each with its video.

    Args:
        work: The work folder.
        only: Names of clips; all where empty.
        videos: Folder in which videos are looked for, where they have moved.
        files: By option, files about clips by clip.

    Raises:
        ValueError: If a named clip is not there, or a file is about a clip that is none.
    """
    there = clip_ids(work)
    files = files or {}
    named = [("--clip", tuple(only)), *((option, tuple(own)) for option, own in files.items())]
    for option, names in named:
        stray = [name for name in names if name not in there]
        if stray:
            raise ValueError(f"{option}: expected clips of {work} ({', '.join(there) or 'none'}), got {stray[0]!r}")
    checked: dict[tuple[str, str], tuple[Path | None, str]] = {}
    tasks = []
    for clip_id in only or there:
        try:
            document = read_document(work / clip_id / "clip.json", "clip")
        except ValueError as error:
            tasks.append(ClipTask(clip_id=clip_id, video=None, trouble=str(error)))
            continue
        key = (document["source_path"], document["sha256"])
        if key not in checked:
            checked[key] = _video(work, document, videos)
        video, trouble = checked[key]
        own = {option: by_clip[clip_id] for option, by_clip in files.items() if clip_id in by_clip}
        tasks.append(ClipTask(clip_id=clip_id, video=video, files=own, trouble=trouble))
    return tuple(tasks)


def _video(work: Path, document: dict[str, Any], videos: Path | None) -> tuple[Path | None, str]:
    """A clip's video, or why there is none."""
    try:
        return source_video(work, document, videos), ""
    except FieldError as error:
        return None, str(error) + ("; --videos says where videos are" if error.field == "source_path" else "")


def files_by_clip(path: Path, work: Path, *, option: str, suffixes: Sequence[str]) -> dict[str, Path]:
    """Files about clips by clip: one file of the only clip, or a folder of files named after clips.

    Raises:
        ValueError: If a file fits no clip.
    """
    there = clip_ids(work)
    if path.is_file():
        if len(there) == 1:
            return {there[0]: path}
        if path.stem in there:
            return {path.stem: path}
        raise ValueError(f"{option}: expected a folder of files named after the {len(there)} clips, got {path}")
    files = {p.stem: p for p in sorted(path.iterdir()) if p.suffix.lower() in suffixes}
    if not files:
        kinds = ", ".join(suffixes)
        raise ValueError(
            f"{option}: expected files ({kinds}) named after clips ({', '.join(there)}), got none in {path}"
        )
    stray = sorted(set(files) - set(there))
    if stray:
        raise ValueError(f"{option}: expected files named after clips ({', '.join(there)}), got {files[stray[0]].name}")
    return files


def jobs_of(
    stage: ClipStage, tasks: Sequence[ClipTask], work: Path, options: Any, *, used: Sequence[str] = ()
) -> list[Job]:
    """One job a video. Whatever its result depends on is among its arguments, so that a change of it is noticed.

    Args:
        stage: Whose jobs.
        tasks: The clips.
        work: The work folder.
        options: The stage's options, a dataclass of JSON values.
        used: Options whose values are names or paths of files that the result depends on, where they are paths.
    """
    own = asdict(options)
    contents_used = {}
    for name in used:
        path = Path(own[name])
        if own[name] and path.is_file():
            own[name] = os.path.abspath(path)
            contents_used[name] = sha256_of(path)
    by_video: dict[Path, list[ClipTask]] = {}
    for task in tasks:
        if task.video is not None and not task.trouble:
            by_video.setdefault(task.video, []).append(task)
    jobs = []
    for video, clips in by_video.items():
        about = video.stat()
        contents = {"video": [about.st_size, about.st_mtime_ns]} | contents_used
        files: dict[str, dict[str, str]] = {}
        for task in clips:
            for name in stage.reads:
                path = work / task.clip_id / name
                if path.is_file():
                    contents[f"{task.clip_id}/{name}"] = sha256_of(path)
            for option, path in task.files.items():
                files.setdefault(task.clip_id, {})[option] = os.path.abspath(path)
                contents[f"{task.clip_id} {option}"] = sha256_of(path)
        arguments = {
            "work": os.path.abspath(work),
            "video": os.path.abspath(video),
            "clips": [task.clip_id for task in clips],
            "files": files,
            "options": own,
            "contents": contents,
        }
        jobs.append(Job(name=key_of(clips[0].clip_id), stage=stage.name, arguments=arguments))
    return jobs


def run_clips(
    stage: ClipStage[Outcome],
    tasks: Sequence[ClipTask],
    jobs: Sequence[Job],
    work: Path,
    *,
    manner: RunManner,
    tell: Callable[[JobEvent], None],
) -> tuple[ClipRow[Outcome], ...]:
    """Carry out the jobs in the work folder, which the caller holds; what became of each clip.

    Raises:
        KeyboardInterrupt: After what had ended was written down.
        OSError: Where the disk is full.
    """
    state = work / STATE / stage.name
    log = JobLog(state / "jobs.jsonl")
    if manner.resume:
        _forget_lost(stage, jobs, work, log)
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
    return _rows(stage, tasks, jobs, log, resumed)


def _rows(
    stage: ClipStage[Outcome], tasks: Sequence[ClipTask], jobs: Sequence[Job], log: JobLog, resumed: set[str]
) -> tuple[ClipRow[Outcome], ...]:
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
            # JSON knows no tuples.
            values = {name: tuple(value) if isinstance(value, list) else value for name, value in found.items()}
            own, seconds = stage.outcome(**values), outcome.seconds
        else:
            why = task.trouble or (outcome.reason if outcome is not None else "the run ended before it")
            own, seconds = stage.outcome(clip_id=task.clip_id, state="failed", reason=why), None
        rows.append(ClipRow(outcome=own, seconds=seconds, resumed=job is not None and job.name in resumed))
    return tuple(rows)


def write_stage_run(
    stage: ClipStage[Outcome],
    work: Path,
    rows: Sequence[ClipRow[Outcome]],
    *,
    command: str,
    options: object,
    started: datetime,
) -> None:
    """Write the run's document beside the `run.json` of the command that made the work folder."""
    inputs = []
    for row in rows:
        own: Any = row.outcome
        inputs.append(
            {
                "path": own.clip_id,
                "state": stage.run_states[own.state],
                "reason": own.reason,
                "clips": [own.clip_id] if own.state != "failed" else [],
                "seconds": row.seconds,
            }
        )
    document = run_document(command=command, options=options, started=started, inputs=inputs)
    write_document(work / f"run_{stage.name}.json", "run", document)


def has_tables(stage: ClipStage, work: Path, clip_id: str) -> bool:
    """Whether any of the stage's tables is in the clip's folder."""
    return any((work / clip_id / f"{name}.parquet").exists() for name in stage.tables)


def _forget_lost(stage: ClipStage, jobs: Sequence[Job], work: Path, log: JobLog) -> None:
    """Note as not done what is done by the log, but has lost its files since."""
    outcomes = log.outcomes()
    for job in jobs:
        digest, outcome = outcomes.get(job.name, ("", None))
        if outcome is None or outcome.state != "done" or digest != job.digest() or outcome.result is None:
            continue
        good = [entry["clip_id"] for entry in outcome.result["clips"] if entry["state"] != "failed"]
        if not all((work / clip / f"{name}.parquet").is_file() for clip in good for name in stage.tables):
            log.append(job, replace(outcome, state="failed", reason="its files are gone", result=None))
