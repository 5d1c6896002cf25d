"""Runs of `pgm animate`: prompts in, a work folder of generated play out; a prompt that fails stops no other."""

import shutil
import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from pgm_data import __version__
from pgm_data.convert.imported_work import WORK_FILES
from pgm_data.convert.work_pictures import plain_names
from pgm_data.dataset.check import examine
from pgm_data.dataset.documents import write_document
from pgm_data.dataset.files import sha256_of, whole_file
from pgm_data.scene import Scene, scene_names
from pgm_data.stages.jobs import Job, JobEvent, JobLog, JobOutcome
from pgm_models.animation.generate import GenerateOptions, Play, generate, given_spans
from pgm_models.animation.model import AnimationModel
from pgm_models.animation.play_camera import PlayCamera, camera_of_file, usual_camera
from pgm_models.animation.prompt import Prompt, read_prompt
from pgm_models.animation.sample_pictures import sample_sheet
from pgm_models.animation.write_play import ClipNames, write_play, write_play_shots

SHEET_NAME = "sheet.png"
"""File of a clip's folder with its paths from above, from the side, and bodies."""
STATE = ".pgm"


@dataclass(frozen=True, eq=False, kw_only=True)
class AnimateWork:
    """What a run makes."""

    out: Path
    """Folder that the caller holds."""
    prompts: tuple[Path, ...]
    plays: int
    """Of each prompt, each from another seed."""
    seed: int | None
    """Of the first play of each prompt, the next ones follow it; each prompt's own where None."""
    options: GenerateOptions
    model_sha256: str
    """Of the model's file."""
    camera: Path | None
    """CAMERA.json; None for the scene's usual view."""


class OtherPlays(ValueError):
    """The folder holds plays of an earlier run that this one would not make."""


def jobs_of(work: AnimateWork) -> list[Job]:
    """One job a play. Whatever a play depends on is among its arguments, so that a change of it is noticed."""
    stems = plain_names(tuple(path.stem for path in work.prompts), taken=WORK_FILES)
    common = {
        "options": asdict(work.options),
        "model": work.model_sha256,
        "camera": "" if work.camera is None else sha256_of(work.camera),
        "version": __version__,
    }
    jobs = []
    for path, stem in zip(work.prompts, stems, strict=True):
        content = sha256_of(path) if path.is_file() else ""
        for number in range(work.plays):
            name = stem if work.plays == 1 else f"{stem}.{number:02d}"
            own = {"prompt": str(path), "sha256": content, "match": stem, "seed": work.seed, "number": number}
            jobs.append(Job(name=name, stage="animate", arguments=common | own))
    return jobs


def animate_work(
    work: AnimateWork,
    model: AnimationModel,
    scene: Scene,
    *,
    resume: bool,
    tell: Callable[[JobEvent], None],
    run_document: Callable[[Sequence[Mapping[str, object]], Mapping[str, object]], dict],
) -> tuple[JobOutcome, ...]:
    """Generate and write every play, then `shots.parquet` and `run.json`; what became of each.

    Args:
        work: What is made.
        model: That makes it.
        scene: That it was trained on.
        resume: Whether plays stay that an earlier run finished with the same model, prompt and options.
        tell: Told what happens.
        run_document: `run.json` from what became of the prompts, and from what is to be said of each play.

    Raises:
        OtherPlays: If an earlier run left plays that are none of this run's.
        KeyboardInterrupt: After what was half written was removed, and what was finished noted.
    """
    jobs = jobs_of(work)
    state = work.out / STATE
    state.mkdir(parents=True, exist_ok=True)
    log = JobLog(state / "jobs.jsonl")
    before = log.outcomes() if resume else {}
    _refuse_others(work.out, jobs)
    outcomes: list[JobOutcome] = []
    try:
        for job in jobs:
            digest, earlier = before.get(job.name, ("", None))
            whole = (work.out / job.name / "clip.json").is_file()
            if earlier is not None and earlier.state == "done" and digest == job.digest() and whole:
                outcomes.append(replace(earlier, resumed=True))
                tell(JobEvent(name=job.name, kind="skipped"))
                continue
            outcome = _carry_out(job, work, model, scene, tell)
            log.append(job, outcome)
            outcomes.append(outcome)
            tell(JobEvent(name=job.name, kind=outcome.state, message=outcome.reason))
    finally:
        _close(work.out, jobs, outcomes, scene, run_document)
    return tuple(outcomes)


def _carry_out(
    job: Job, work: AnimateWork, model: AnimationModel, scene: Scene, tell: Callable[[JobEvent], None]
) -> JobOutcome:
    tell(JobEvent(name=job.name, kind="started"))
    begun, folder = time.monotonic(), work.out / job.name
    shutil.rmtree(folder, ignore_errors=True)
    result, reason = None, ""
    try:
        result = _make(job, work, model, scene, tell)
    except (ValueError, RuntimeError) as error:
        reason = str(error) if isinstance(error, ValueError) else f"{type(error).__name__}: {error}"
        (work.out / STATE / "logs").mkdir(exist_ok=True)
        (work.out / STATE / "logs" / f"{job.name}.log").write_text(traceback.format_exc(), encoding="utf-8")
    finally:
        if result is None:
            shutil.rmtree(folder, ignore_errors=True)
    state = "failed" if result is None else "done"
    return JobOutcome(name=job.name, state=state, reason=reason, seconds=time.monotonic() - begun, result=result)


def _make(
    job: Job, work: AnimateWork, model: AnimationModel, scene: Scene, tell: Callable[[JobEvent], None]
) -> dict[str, object]:
    """Generate and write one play; what is to be said of it."""
    arguments, folder = job.arguments, work.out / job.name
    prompt = read_prompt(Path(str(arguments["prompt"])), model.layout)
    first = prompt.seed if work.seed is None else work.seed
    prompt = replace(prompt, seed=first + int(str(arguments["number"])))

    def said(done: int, total: int) -> None:
        tell(JobEvent(name=job.name, kind="progress", share=done / total, detail={"progress": done, "total": total}))

    begun = time.monotonic()
    play = generate(model, prompt, work.options, scene=scene, said=said)
    seconds = time.monotonic() - begun
    view = _view(work.camera, prompt, scene)
    names = ClipNames(clip_id=job.name, match_id=str(arguments["match"]))
    known = {entry.column: play.known[:, row] for row, entry in enumerate(model.layout.properties)}
    folder.mkdir(parents=True)
    write_sheet(folder / SHEET_NAME, play, model)
    write_play(folder, names, prompt, play.columns, known, scene=scene, view=view)
    return {
        "seed": prompt.seed,
        "frames": prompt.frames,
        "given": given_spans(play, model.layout),
        "first_stage_frames": len(play.plan.levels[0]),
        "first_stage_hz": play.plan.keyframe_rate,
        "generation_s": seconds,
        "settled": list(play.settled),
        "warnings": [*play.warnings, *implausible(folder, scene)],
    }


def implausible(folder: Path, scene: Scene) -> list[str]:
    """What of a clip's tables cannot be by the laws of the contract, such as a foot below the ground."""
    violations = examine([folder], scene=scene).violations
    return [
        f"{violation.path.stem}: {violation.field}: expected {violation.expected}, got {violation.found}"
        for violation in violations
    ]


def _view(camera: Path | None, prompt: Prompt, scene: Scene) -> PlayCamera | None:
    if camera is not None:
        return camera_of_file(camera, prompt.frames)
    return usual_camera(scene, np.arange(prompt.frames) / prompt.rate)


def write_sheet(path: Path, play: Play, model: AnimationModel) -> None:
    """Write a picture of the play; none for a scene that does not ship with the package."""
    if model.layout.scene not in scene_names():
        return
    times = np.arange(play.prompt.frames) / play.prompt.rate
    columns = {name: values[None] for name, values in play.columns.items()}
    done, encoded = cv2.imencode(".png", sample_sheet(columns, times[None], model.layout))
    if not done:
        raise ValueError(f"{path}: expected a picture that can be written, got none")
    with whole_file(path) as temporary:
        temporary.write_bytes(encoded.tobytes())


def _refuse_others(out: Path, jobs: Sequence[Job]) -> None:
    """Raise OtherPlays where the folder holds a play that is none of the jobs'."""
    own = {job.name for job in jobs}
    others = sorted(path.parent.name for path in out.glob("*/clip.json") if path.parent.name not in own)
    if others:
        raise OtherPlays(
            f"--resume: expected the prompts and plays of the earlier run, got none for {others[0]} in {out}"
        )


def _close(
    out: Path,
    jobs: Sequence[Job],
    outcomes: Sequence[JobOutcome],
    scene: Scene,
    run_document: Callable[[Sequence[Mapping[str, object]], Mapping[str, object]], dict],
) -> None:
    """Write `shots.parquet` and `run.json` of what is there."""
    ended = {outcome.name: outcome for outcome in outcomes}
    inputs, plays = [], {}
    for job in jobs:
        outcome = ended.get(job.name)
        state = "unfinished" if outcome is None else outcome.state
        reason = "the run ended before it" if outcome is None else outcome.reason
        done = outcome is not None and outcome.result is not None
        if outcome is not None and outcome.result is not None:
            plays[job.name] = outcome.result
            reason = "; ".join(outcome.result["warnings"])
        inputs.append(
            {
                "path": job.arguments["prompt"],
                "state": state,
                "reason": reason,
                "clips": [job.name] if done else [],
                "seconds": None if outcome is None else outcome.seconds,
            }
        )
    if plays:
        write_play_shots(out, list(plays), scene=scene)
        write_document(out / "run.json", "run", run_document(inputs, plays))
