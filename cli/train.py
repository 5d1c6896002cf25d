"""`pgm-train MODEL DATASET --out RUN`: train a network on data with truth."""

from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Literal

import tyro

from .console import UsageError, option_error, print_error
from .train_synthesis import train_synthesis_model
from .training import command_line, interrupted, make_way, show

EXAMPLE = (
    "examples: pgm-train court simulated --out runs/court --minutes 60\n"
    "          pgm-train ball simulated --out runs/ball --minutes 45\n"
    "          pgm-train people --out runs/people --minutes 25\n"
    "          pgm-train animation dataset --out runs/animation --preset small\n"
    "          pgm-train synthesis dataset --out runs/synthesis --preset small"
)


@dataclass(frozen=True, kw_only=True)
class RunChoices:
    """What every training has: where its run lies, how long it takes, and what becomes of an earlier one."""

    out: Path
    """Folder of the run: checkpoint, log, exported network."""
    minutes: float = 60.0
    """Minutes of training; the learning rate follows the clock. 0 to count steps instead."""
    steps: int = 0
    """Optimiser steps; above 0 they count, and not the minutes."""
    precision: Literal["float32", "bfloat16"] = "bfloat16"
    """Of the inner arithmetic; about 1.7 times faster in bfloat16 on a CPU that has it."""
    threads: int = 2
    """CPU threads."""
    seed: int = 0
    """Of weights, order and changes to pictures."""
    look_again_minutes: float = 0.0
    """Look for new clips this often while training; 0 for never, which an exactly repeatable run needs."""
    resume: bool = False
    """Go on with the run in `out`."""
    overwrite: bool = False
    """Delete the checkpoint and log in `out` first."""
    export_only: bool = False
    """Train nothing: write the ONNX file from the checkpoint in `out`."""


@dataclass(frozen=True, kw_only=True)
class CourtTraining(RunChoices):
    """Train the network that finds a court's points in a picture, and write it as ONNX for the detector."""

    dataset: tyro.conf.Positional[Path]
    """Folder with videos and their truth, as `pgm simulate` writes it; searched for clip folders."""
    preset: Literal["nano", "tiny", "small"] = "small"
    """Size of the network."""
    scene: str = "tennis"
    """Scene whose court is learned."""
    batch: int = 16
    """Pictures per step."""
    learning_rate: float = 2e-3
    """Highest learning rate."""


@dataclass(frozen=True, kw_only=True)
class BallTraining(RunChoices):
    """Train the network that finds the ball in pictures, or the one that tells what happens to it, and write it."""

    datasets: tyro.conf.Positional[tuple[Path, ...]]
    """Folders with clips and their truth, as `pgm simulate` writes them; for `events` one, which needs no pictures."""
    part: Literal["picture", "events"] = "picture"
    """The ball in three pictures that follow each other; or hits and bounces from its track."""
    preset: Literal["nano", "small"] = "small"
    """Size of the network for pictures."""
    scene: str = "tennis"
    """Scene whose ball is learned from pictures."""
    batch: int | None = None
    """Crops per step, 32 unless given; of `events` windows of about ten seconds, 16 unless given."""
    learning_rate: float | None = None
    """Highest learning rate; 2e-3 unless given, of `events` 3e-3."""


@dataclass(frozen=True, kw_only=True)
class PeopleTraining(RunChoices):
    """Train the network that finds people and tells who plays, on people and courts that it draws itself."""

    scene: str = "tennis"
    """Scene whose courts are drawn; what people do there is tennis."""
    courts: int = 72
    """Courts to put people on, a ninth of them more to hold out; about 1.5 s each to draw."""
    people: int = 240
    """Players to put on them; half as many others."""
    batch: int = 48
    """Pieces of pictures per step."""
    learning_rate: float = 3e-3
    """Highest learning rate."""


@dataclass(frozen=True, kw_only=True)
class AnimationTraining:
    """Train the model that makes play from words and wanted states; several processes through torchrun."""

    dataset: tyro.conf.Positional[Path]
    """Packed dataset, as `pgm pack` and `pgm simulate` write it."""
    out: Path
    """Folder of the run: checkpoint, log, loss curves, samples, model."""
    preset: Literal["nano", "tiny", "small", "base", "paper"] = "small"
    """Size, and how it is trained unless options here say otherwise."""
    design: Literal["ours", "velocity", "paper", "transformer", "lstm", "playable"] = "ours"
    """Ours, ours without its prior, the paper's diffusion, or a baseline that reconstructs."""
    masks: str = "all"
    """Group of masking strategies: all, or one of the paper's ablation."""
    encoder: str = ""
    """Frozen text encoder: hash, minilm (see `pgm weights text`), or t5:FOLDER; the preset's unless given."""
    share: float = 1.0
    """Of the dataset, above 0 and at most 1."""
    rates: tuple[float, float] = (4.0, 25.0)
    """Lowest and highest rate of training windows, frames a second."""
    average: float = 0.999
    """Share the moving average of the weights keeps in a step."""
    steps: int = 0
    """Optimiser steps; the preset's unless given."""
    minutes: float = 0.0
    """Minutes of training instead of steps; the learning rate follows the clock."""
    batch: int = 0
    """Windows a step; the preset's unless given."""
    accumulate: int = 1
    """Parts in which a step's windows are gone through, to save memory; at least the processes of torchrun."""
    learning_rate: float = 0.0
    """Highest learning rate; the preset's unless given."""
    precision: Literal["float32", "bfloat16"] = "float32"
    """Of the inner arithmetic; bfloat16 is faster on GPUs and on CPUs that know it, slower on others."""
    device: str = "auto"
    """auto, cpu, cuda or cuda:N."""
    workers: int = 0
    """Processes that read windows; 0 for a thread beside the training."""
    threads: int = 2
    """CPU threads."""
    seed: int = 0
    """Of weights, order, masks and noise."""
    cache: Path | None = None
    """Folder for states and text features, to be shared by runs on one dataset; inside the run unless given."""
    checkpoint_minutes: float = 4.0
    """Minutes between checkpoints, each with held-out losses and pictures."""
    resume: bool = False
    """Go on with the run in `out`."""
    overwrite: bool = False
    """Delete the checkpoint and log in `out` first."""


def main(argv: list[str]) -> int:
    """Run the command; its exit code."""
    options = tyro.extras.subcommand_cli_from_dict(
        {
            "animation": _animation,
            "synthesis": train_synthesis_model,
            "court": _court,
            "ball": _ball,
            "people": _people,
        },
        args=argv,
        prog="pgm-train",
        description="Train a network on data with truth.\n\n" + EXAMPLE,
    )
    return int(options)


def _court(options: Annotated[CourtTraining, tyro.conf.arg(name="")]) -> int:
    """Train the network that finds a court's points in a picture, and write it as ONNX for the detector."""
    _check(options, (options.dataset,), options.batch, "court")
    from pgm_models.detectors.clip_pictures import NoFrames
    from pgm_models.detectors.court_run import CourtRunOptions, export_run, train_court

    run = CourtRunOptions(
        dataset=options.dataset,
        run=options.out,
        scene=options.scene,
        preset=options.preset,
        minutes=_minutes(options),
        steps=options.steps,
        batch=options.batch,
        learning_rate=options.learning_rate,
        precision=options.precision,
        threads=options.threads,
        seed=options.seed,
        look_again_minutes=options.look_again_minutes,
    )
    if not options.export_only:
        try:
            outcome = train_court(run, command=command_line(), show=show)
        except NoFrames as error:
            print_error(str(error))
            return 4
        if outcome.state == "interrupted":
            return interrupted(outcome)
    print(f"wrote {export_run(options.out, options.scene)}")
    return 0


def _ball(options: Annotated[BallTraining, tyro.conf.arg(name="")]) -> int:
    """Train the network that finds the ball in pictures, or the one that tells what happens to it, and write it."""
    _check(options, options.datasets, 2 if options.batch is None else options.batch, "ball")
    return _ball_events(options) if options.part == "events" else _ball_picture(options)


def _ball_picture(options: BallTraining) -> int:
    from pgm_models.detectors.ball_run import BallRunOptions, export_ball_run, train_ball
    from pgm_models.detectors.clip_pictures import NoFrames

    run = BallRunOptions(
        datasets=options.datasets,
        run=options.out,
        scene=options.scene,
        preset=options.preset,
        minutes=_minutes(options),
        steps=options.steps,
        batch=32 if options.batch is None else options.batch,
        learning_rate=2e-3 if options.learning_rate is None else options.learning_rate,
        precision=options.precision,
        threads=options.threads,
        seed=options.seed,
        look_again_minutes=options.look_again_minutes,
    )
    try:
        if not options.export_only:
            outcome = train_ball(run, command=command_line(), show=show)
            if outcome.state == "interrupted":
                return interrupted(outcome)
        print(f"wrote {export_ball_run(run, show=show)}")
    except NoFrames as error:
        print_error(str(error))
        return 4
    return 0


def _ball_events(options: BallTraining) -> int:
    from pgm_models.detectors.track_event_run import TrackEventRunOptions, export_run, train_track_events

    if len(options.datasets) != 1:
        raise option_error("DATASETS", expected="one folder, with --part events", got=len(options.datasets))
    run = TrackEventRunOptions(
        dataset=options.datasets[0],
        run=options.out,
        minutes=_minutes(options),
        steps=options.steps,
        batch=16 if options.batch is None else options.batch,
        learning_rate=3e-3 if options.learning_rate is None else options.learning_rate,
        threads=options.threads,
        seed=options.seed,
    )
    if not options.export_only:
        outcome = train_track_events(run, command=command_line(), show=show)
        if outcome.state == "interrupted":
            return interrupted(outcome)
    print(f"wrote {export_run(options.out)}")
    return 0


def _people(options: Annotated[PeopleTraining, tyro.conf.arg(name="")]) -> int:
    """Train the network that finds people and tells who plays, on people and courts that it draws itself."""
    _check(options, (), options.batch, "people")
    for name, value in {"--courts": options.courts, "--people": options.people}.items():
        if value < 1:
            raise option_error(name, expected="1 or more", got=value)
    from pgm_data.detect.players.person_network import PERSON_NETWORK
    from pgm_models.detectors.person_run import PersonRunOptions, export_people_run, train_people

    run = PersonRunOptions(
        run=options.out,
        scene=options.scene,
        courts=options.courts,
        people=options.people,
        minutes=_minutes(options),
        steps=options.steps,
        batch=options.batch,
        learning_rate=options.learning_rate,
        precision=options.precision,
        threads=options.threads,
        seed=options.seed,
    )
    if options.export_only:
        print(f"wrote {export_people_run(run, show=show)}")
        return 0
    outcome = train_people(run, command=command_line(), show=show)
    if outcome.state == "interrupted":
        return interrupted(outcome)
    print(f"wrote {options.out / PERSON_NETWORK}")
    return 0


def _animation(options: Annotated[AnimationTraining, tyro.conf.arg(name="")]) -> int:
    """Train the model that makes play from words and wanted states; several processes through torchrun."""
    if not (options.dataset / "meta" / "info.json").is_file():
        raise option_error("DATASET", expected="a packed dataset, with meta/info.json", got=options.dataset)
    for name, value in {"--steps": options.steps, "--minutes": options.minutes, "--batch": options.batch}.items():
        if value < 0:
            raise option_error(name, expected="0 or more", got=value)
    if not 0 < options.share <= 1:
        raise option_error("--share", expected="above 0 and at most 1", got=options.share)
    if not 0 < options.rates[0] <= options.rates[1]:
        raise option_error("--rates", expected="above 0, the lower one first", got=options.rates)
    if options.accumulate < 1:
        raise option_error("--accumulate", expected="1 or more", got=options.accumulate)
    from dataclasses import asdict

    from pgm_models.animation.masks import MASKS
    from pgm_models.animation.run import AnimationRunOptions, train_animation
    from pgm_models.model_file import MODEL_NAME
    from pgm_models.processes import leads

    if leads():
        make_way(options.out, resume=options.resume, overwrite=options.overwrite)
    if options.masks not in MASKS:
        raise option_error("--masks", expected=f"one of {', '.join(MASKS)}", got=options.masks)
    values = asdict(options)
    values["run"] = values.pop("out")
    for name in ("resume", "overwrite"):
        values.pop(name)
    outcome = train_animation(
        AnimationRunOptions(**values), command=command_line(), show=show if leads() else lambda line: None
    )
    if outcome.state == "interrupted":
        return interrupted(outcome)
    if leads():
        print(f"wrote {options.out / MODEL_NAME}")
    return 0


def _minutes(options: RunChoices) -> float:
    return options.minutes if not options.steps else 0.0


def _check(options: RunChoices, datasets: tuple[Path, ...], batch: int, what: str) -> None:
    """Refuse options that cannot be, and clear an earlier run where that is asked for."""
    for module in ("onnx", "onnxscript"):
        if find_spec(module) is None:
            raise UsageError(f"pgm-train {what}: expected the package {module}, found none: install the extra 'export'")
    if not datasets and what != "people":
        raise option_error("DATASET", expected="a folder", got="none")
    for dataset in datasets:
        if not options.export_only and not dataset.is_dir():
            raise option_error("DATASET", expected="a folder", got=dataset)
    if not options.steps and not options.minutes > 0:
        raise option_error("--minutes", expected="above 0, or --steps above 0", got=options.minutes)
    for name, value in {"--steps": options.steps, "--look-again-minutes": options.look_again_minutes}.items():
        if value < 0:
            raise option_error(name, expected="0 or more", got=value)
    if batch < 2:
        raise option_error("--batch", expected="at least 2, as its norms need", got=batch)
    begun = (options.out / "checkpoint.safetensors").exists()
    if options.export_only:
        if not begun:
            raise option_error("--export-only", expected=f"a checkpoint in {options.out}", got="none")
        return
    make_way(options.out, resume=options.resume, overwrite=options.overwrite)
