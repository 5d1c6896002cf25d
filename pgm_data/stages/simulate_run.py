"""Runs of `pgm simulate`: one job a video; one that fails is recorded, and the others go on."""

import errno
import hashlib
import os
import shutil
import time
import traceback
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from pgm_data import __version__
from pgm_data.dataset.documents import write_document
from pgm_data.scene import load_scene
from pgm_data.simulate.clip_options import ClipOptions
from pgm_data.simulate.folders import (
    PARTS,
    MatchFiles,
    clear_video,
    match_name,
    mix_name,
    pack_truth,
    part_path,
    read_part,
    video_of,
    world_seed,
    write_match,
    write_mix_video,
    write_shots,
)
from pgm_data.simulate.mix import MixOptions
from pgm_data.stages.jobs import Job, JobEvent, JobLog, JobOutcome
from pgm_data.stages.supervise import run_jobs

ENTRY = "pgm_data.stages.simulate_run:run_job"
STATE = ".pgm"
TELL_EVERY_S = 0.5
NO_SPACE = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


@dataclass(frozen=True, eq=False, kw_only=True)
class SimulateWork:
    """What a run makes."""

    out: Path
    """Folder that the caller holds."""
    scene: str
    """Name, or path of a file."""
    videos: ClipOptions | MixOptions
    """Matches like this, or a mix."""
    count: int
    """Videos."""
    files: MatchFiles
    """What is written of a match."""
    dataset: bool
    """Whether matches are packed."""
    seed: int
    worlds: int = 0
    """Different worlds that matches among blocks take turns in; each has its own where 0."""


@dataclass(frozen=True, eq=False, kw_only=True)
class SimulateSummary:
    """What became of a run."""

    outcomes: tuple[JobOutcome, ...]
    """Of every video, in order."""

    @property
    def failed(self) -> tuple[JobOutcome, ...]:
        """Videos that could not be made."""
        return tuple(o for o in self.outcomes if o.state == "failed")


class OtherVideos(ValueError):
    """The folder holds videos of an earlier run that this one would not make."""


def jobs_of(work: SimulateWork) -> list[Job]:
    """One job a video. Whatever a video depends on is among its arguments, so that a change of it is noticed."""
    scene = load_scene(work.scene)
    path = Path(work.scene)
    own_file = path.suffix in {".yaml", ".yml"}
    common = {
        "out": os.path.abspath(work.out),
        "scene": os.path.abspath(path) if own_file else work.scene,
        "scene_sha256": hashlib.sha256(path.read_bytes()).hexdigest() if own_file else "",
        "seed": work.seed,
        "version": __version__,
    }
    if isinstance(work.videos, MixOptions):
        mixes = [replace(work.videos, pictures=work.videos.pictures_of(v)) for v in range(work.count)]
        return [
            Job(name=mix_name(work.seed, v), stage="simulate", entry=ENTRY,
                arguments=common | {"number": v, "mix": asdict(mixes[v])})
            for v in range(work.count)
        ]  # fmt: skip
    places = [world_seed(work.seed, m, work.worlds) for m in range(work.count)]
    return [
        Job(name=match_name(scene, work.seed, m), stage="simulate", entry=ENTRY,
            arguments=common | {"number": m, "files": asdict(work.files),
                                "clip": asdict(replace(work.videos, world_seed=places[m]))})
        for m in range(work.count)
    ]  # fmt: skip


def run_job(arguments: dict, report: Callable[[dict], None]) -> dict:
    """Make one video with its truth."""
    import cv2

    cv2.setNumThreads(1)
    scene, out = load_scene(arguments["scene"]), Path(arguments["out"])
    seed, number = arguments["seed"], arguments["number"]
    told = time.monotonic()

    def said(done: int, total: int) -> None:
        nonlocal told
        if time.monotonic() - told >= TELL_EVERY_S:
            told = time.monotonic()
            report({"progress": done, "total": total})

    if "mix" in arguments:
        mix = MixOptions(**arguments["mix"])
        # The number goes into the seed alone: the job's own pictures are all that it draws.
        mix = replace(mix, pictures=number * mix.per_video + mix.pictures)
        written = write_mix_video(out, scene, mix, seed=seed, video=number, said=said)
    else:
        wind = arguments["clip"]["wind_ms"]
        clip = ClipOptions(**arguments["clip"] | {"wind_ms": None if wind is None else tuple(wind)})
        files = MatchFiles(**arguments["files"])
        written = write_match(out, scene, clip, files, seed=seed, match=number, said=said)
    return {"clips": list(written.clips), "frames": len(written.clip_of)}


def simulate_work(
    work: SimulateWork,
    *,
    workers: int,
    resume: bool,
    tell: Callable[[JobEvent], None],
    run_document: Callable[[list[dict]], dict],
) -> SimulateSummary:
    """Make the videos, their tables and the dataset; with one worker in this process, else in one a video.

    Args:
        work: What is made.
        workers: Videos at a time.
        resume: Whether videos stay that an earlier run finished with the same options.
        tell: Told what happens.
        run_document: `run.json` from what became of the videos.

    Raises:
        KeyboardInterrupt: After what was half written was removed, and what was finished noted.
        OtherVideos: If an earlier run left videos that are none of this run's.
        OSError: If the disk is full, likewise.
    """
    out, jobs = work.out, jobs_of(work)
    (out / STATE).mkdir(parents=True, exist_ok=True)
    if resume:
        _refuse_others(out, jobs)
        _forget_lost(work, jobs)

    def watch(event: JobEvent) -> None:
        if event.kind == "started":
            # They tell of videos that are about to change.
            shutil.rmtree(out / "dataset", ignore_errors=True)
            for name in ("shots.parquet", "run.json"):
                (out / "work" / name).unlink(missing_ok=True)
        tell(event)
        # The videos to come would only be drawn for nothing.
        if event.kind == "failed" and any(os.strerror(number) in event.message for number in NO_SPACE):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(out))

    try:
        if workers == 1:
            _run_in_turn(jobs, state_dir=out / STATE, resume=resume, tell=watch)
        else:
            run_jobs(jobs, state_dir=out / STATE, workers=workers, resume=resume, on_event=watch)
    finally:
        outcomes = _close(work, jobs, run_document)
    if work.dataset and any(outcome.state == "done" for outcome in outcomes):
        pack_truth(out, load_scene(work.scene), videos=work.files.pictures != "none")
    return SimulateSummary(outcomes=outcomes)


def _run_in_turn(jobs: Sequence[Job], *, state_dir: Path, resume: bool, tell: Callable[[JobEvent], None]) -> None:
    """Like `run_jobs`, in this process."""
    log = JobLog(state_dir / "jobs.jsonl")
    before = log.outcomes() if resume else {}
    for job in jobs:
        digest, earlier = before.get(job.name, ("", None))
        if earlier is not None and earlier.state == "done" and digest == job.digest():
            tell(JobEvent(name=job.name, kind="skipped"))
            continue

        def report(progress: dict, name: str = job.name) -> None:
            share = progress["progress"] / progress["total"]
            tell(JobEvent(name=name, kind="progress", share=share, detail=progress))

        tell(JobEvent(name=job.name, kind="started"))
        begun = time.monotonic()
        try:
            result, reason = run_job(dict(job.arguments), report), ""
        except Exception as error:
            result, reason = None, f"{type(error).__name__}: {error}"
            (state_dir / "logs").mkdir(exist_ok=True)
            (state_dir / "logs" / f"{job.name}.log").write_text(traceback.format_exc(), encoding="utf-8")
        outcome = JobOutcome(
            name=job.name,
            state="failed" if result is None else "done",
            reason=reason,
            seconds=time.monotonic() - begun,
            result=result,
        )
        log.append(job, outcome)
        tell(JobEvent(name=job.name, kind=outcome.state, message=reason))


def _close(
    work: SimulateWork, jobs: Sequence[Job], run_document: Callable[[list[dict]], dict]
) -> tuple[JobOutcome, ...]:
    """Remove what is not whole, and write `shots.parquet` and `run.json` of what is; the outcomes of what ended."""
    log = JobLog(work.out / STATE / "jobs.jsonl").outcomes()
    ended, inputs, done = [], [], []
    for job in jobs:
        digest, outcome = log.get(job.name, ("", None))
        if outcome is None or digest != job.digest():
            clear_video(work.out, job.name)
            inputs.append(_input(job, "unfinished", "the run ended before it", [], None))
            continue
        ended.append(outcome)
        if outcome.state == "done" and outcome.result is not None:
            done.append(job.name)
            inputs.append(_input(job, "done", "", outcome.result["clips"], outcome.seconds))
        else:
            clear_video(work.out, job.name)
            inputs.append(_input(job, "failed", outcome.reason, [], outcome.seconds))
    if done:
        write_shots(work.out, load_scene(work.scene), (read_part(work.out, name) for name in done))
        write_document(work.out / "work" / "run.json", "run", run_document(inputs))
    return tuple(ended)


def _input(job: Job, state: str, reason: str, clips: Sequence[str], seconds: float | None) -> dict:
    path = f"../videos/{job.name}.mp4"
    return {"path": path, "state": state, "reason": reason, "clips": list(clips), "seconds": seconds}


def _refuse_others(out: Path, jobs: Sequence[Job]) -> None:
    """Raise OtherVideos where the folder holds a video that is none of the jobs'."""
    own = {job.name for job in jobs}
    paths = [path for folder in (out / PARTS, out / "videos") if folder.is_dir() for path in folder.iterdir()]
    paths += [path for path in (out / "work").iterdir() if path.is_dir()] if (out / "work").is_dir() else []
    others = {video_of(path.name) for path in paths} - own
    if others:
        among = f"{jobs[0].name} to {jobs[-1].name}" if len(jobs) > 1 else jobs[0].name
        raise OtherVideos(
            f"--resume: expected the scene and seed of the earlier run, and no fewer videos: {among}, "
            f"got {min(others)} in {out}"
        )


def _forget_lost(work: SimulateWork, jobs: Sequence[Job]) -> None:
    """Note as not done what is done by the log, but has lost its files since."""
    log = JobLog(work.out / STATE / "jobs.jsonl")
    outcomes = log.outcomes()
    for job in jobs:
        digest, outcome = outcomes.get(job.name, ("", None))
        if outcome is None or outcome.state != "done" or outcome.result is None or digest != job.digest():
            continue
        files = [part_path(work.out, job.name)]
        files += [work.out / "work" / clip / "clip.json" for clip in outcome.result["clips"]]
        if work.files.pictures != "none":
            files.append(work.out / "videos" / f"{job.name}.mp4")
        if not all(path.is_file() for path in files):
            log.append(job, replace(outcome, state="failed", reason="its files are gone", result=None))
