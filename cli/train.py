"""`pgm-train MODEL DATASET --out RUN`: train a network on data with truth."""

import sys
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Literal

import tyro

from .console import UsageError, option_error, print_error

EXAMPLE = "example: pgm-train court simulated --out runs/court --preset small --minutes 60"


@dataclass(frozen=True, kw_only=True)
class CourtTraining:
    """Train the network that finds a court's points in a picture, and write it as ONNX for the detector."""

    dataset: tyro.conf.Positional[Path]
    """Folder with videos and their truth, as `pgm simulate` writes it; searched for clip folders."""
    out: Path
    """Folder of the run: checkpoint, log, exported network."""
    preset: Literal["nano", "tiny", "small"] = "small"
    """Size of the network."""
    scene: str = "tennis"
    """Scene whose court is learned."""
    minutes: float = 60.0
    """Minutes of training; the learning rate follows the clock. 0 to count steps instead."""
    steps: int = 0
    """Optimiser steps, where `minutes` is 0."""
    batch: int = 16
    """Pictures per step."""
    learning_rate: float = 2e-3
    """Highest learning rate."""
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


def main(argv: list[str]) -> int:
    """Run the command; its exit code."""
    options = tyro.extras.subcommand_cli_from_dict(
        {"court": _court}, args=argv, prog="pgm-train", description="Train a network on data with truth.\n\n" + EXAMPLE
    )
    return int(options)


def _court(options: Annotated[CourtTraining, tyro.conf.arg(name="")]) -> int:
    """Train the network that finds a court's points in a picture, and write it as ONNX for the detector."""
    _check(options)
    from pgm_models.detectors.court_run import CourtRunOptions, NoFrames, export_run, train_court

    run = CourtRunOptions(
        dataset=options.dataset,
        run=options.out,
        scene=options.scene,
        preset=options.preset,
        minutes=options.minutes if not options.steps else 0.0,
        steps=options.steps,
        batch=options.batch,
        learning_rate=options.learning_rate,
        precision=options.precision,
        threads=options.threads,
        seed=options.seed,
        look_again_minutes=options.look_again_minutes,
    )
    if options.export_only:
        print(f"wrote {export_run(options.out, options.scene)}")
        return 0
    if options.overwrite:
        for name in ("checkpoint.safetensors", "log.jsonl"):
            (options.out / name).unlink(missing_ok=True)
    try:
        outcome = train_court(run, command=["pgm-train", *sys.argv[1:]], show=lambda line: print(line, flush=True))
    except NoFrames as error:
        print_error(str(error))
        return 4
    if outcome.state == "interrupted":
        print(f"interrupted after step {outcome.step}; --resume goes on from there")
        return 130
    print(f"wrote {export_run(options.out, options.scene)}")
    return 0


def _check(options: CourtTraining) -> None:
    for module in ("onnx", "onnxscript"):
        if find_spec(module) is None:
            raise UsageError(f"pgm-train court: expected the package {module}, found none: install the extra 'export'")
    if not options.export_only and not options.dataset.is_dir():
        raise option_error("DATASET", expected="a folder", got=options.dataset)
    if not options.steps and not options.minutes > 0:
        raise option_error("--minutes", expected="above 0, or --steps above 0", got=options.minutes)
    for name, value in {"--steps": options.steps, "--look-again-minutes": options.look_again_minutes}.items():
        if value < 0:
            raise option_error(name, expected="0 or more", got=value)
    if options.batch < 2:
        raise option_error("--batch", expected="at least 2, as its norms need", got=options.batch)
    begun = (options.out / "checkpoint.safetensors").exists()
    if options.export_only and not begun:
        raise option_error("--export-only", expected=f"a checkpoint in {options.out}", got="none")
    if not options.export_only and not options.resume and not options.overwrite:
        if options.out.is_dir() and any(options.out.iterdir()):
            raise UsageError(f"--out: expected an empty or new folder, or --resume or --overwrite, got {options.out}")
