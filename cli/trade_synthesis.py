"""`pgm trade synthesis DATASET --out DIR`: designs and sizes of the synthesis model."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from .console import check_ranges, option_error
from .trade_jobs import carried_out, check_chosen, check_packed, check_parts, threads_of


@dataclass(frozen=True, kw_only=True)
class SynthesisTrade:
    """Likeness and speed of the synthesis model by design, samples, voxels, enhancer, stylising and resolution.

    All models are trained at one budget. Writes trade.md, trade.svg (error against frames a second), trade.csv,
    trade.json and rows.jsonl as it goes; the trained models stay in OUT/runs. Evaluations are one at a time, as times
    are those of this machine.
    """

    dataset: tyro.conf.Positional[Path]
    """Packed dataset with its videos, to learn from."""
    out: Path
    """Folder to write into, new or empty."""
    test: Path | None = None
    """Packed dataset of other matches, to be evaluated on; the ends of the dataset's own matches unless given."""
    truth: Path | None = None
    """Work folder of the evaluated clips as pgm simulate --masks writes it; the renderer's own masks unless given."""
    preset: Literal["nano", "tiny", "small", "base", "paper"] = "tiny"
    """Size of the models, but for what a part changes."""
    parts: tuple[Literal["designs", "samples", "voxels", "enhancer", "stylising", "resolution"], ...] = (
        "designs",
        "samples",
        "voxels",
        "enhancer",
        "stylising",
        "resolution",
    )
    """What to compare; each of the last five changes one number of the preset."""
    designs: tuple[str, ...] = (
        "ours",
        "no_enhancer",
        "no_deformation",
        "no_planes",
        "no_voxels",
        "no_style_encoder",
        "playable",
    )
    """Designs of the first part; those that pgm-train synthesis knows."""
    seeds: int = 1
    """Trainings of each model."""
    steps: int = 0
    """Optimiser steps of each training; the preset's unless given."""
    minutes: float = 0.0
    """Minutes of each training instead of steps."""
    held_out: float = 0.1
    """Share of each match, its end, that is not learned from."""
    perceptual: Path | None = None
    """Weights of a VGG16 or VGG19 for the perceptual loss; without, gradients and structure are compared."""
    frames: int = 100
    """Frames that are judged, at most; 0 for all."""
    jobs: int = 1
    """Trainings at a time."""
    threads: int = 0
    """CPU threads of each; the usable cores shared out unless given."""
    device: str = "auto"
    """Where to compute: auto, cpu, cuda or cuda:N."""
    precision: Literal["float32", "bfloat16"] = "float32"
    """Of training's inner arithmetic."""
    resume: bool = False
    """Go on where an earlier run into this folder stopped; figures that it has are kept as they are."""
    overwrite: bool = False
    """Delete what an earlier run wrote into this folder, and begin again."""


def trade_synthesis(options: Annotated[SynthesisTrade, tyro.conf.arg(name="")]) -> int:
    """Likeness and speed of the synthesis model by design, samples, voxels, enhancer, stylising and resolution."""
    check_ranges(
        ("--seeds", options.seeds, 1, 100),
        ("--steps", options.steps, 0, 10**9),
        ("--minutes", options.minutes, 0.0, 1e6),
        ("--frames", options.frames, 0, 10**9),
        ("--jobs", options.jobs, 1, 1024),
        ("--threads", options.threads, 0, 1024),
    )
    if not 0 <= options.held_out < 1 or (options.test is None and options.held_out == 0):
        expected = "0 or more, above 0 without --test, and below 1"
        raise option_error("--held-out", expected=expected, got=options.held_out)
    check_parts(options.parts)
    check_packed("DATASET", options.dataset)
    check_packed("--test", options.test)
    for name, path in (("--truth", options.truth), ("--perceptual", options.perceptual)):
        if path is not None and not path.exists():
            raise option_error(name, expected="a path that is there", got=path)
    from pgm_models.synthesis.presets import SYNTHESIS_DESIGNS
    from pgm_models.synthesis.trade import SynthesisTradeOptions, run_synthesis_trade
    from pgm_models.synthesis.trade_runs import RunManner

    check_chosen("--designs", options.designs, tuple(SYNTHESIS_DESIGNS))
    manner = RunManner(
        dataset=options.dataset,
        test=options.test,
        truth=options.truth,
        out=options.out,
        preset=options.preset,
        steps=options.steps,
        minutes=options.minutes,
        held_out=options.held_out,
        perceptual=options.perceptual,
        frames=options.frames,
        device=options.device,
        precision=options.precision,
        threads=threads_of(options.threads, options.jobs),
    )
    return carried_out(
        "synthesis",
        options,
        lambda folder, progress: run_synthesis_trade(
            SynthesisTradeOptions(
                manner=manner,
                state_dir=folder.state_dir,
                parts=options.parts,
                designs=options.designs,
                seeds=options.seeds,
                workers=options.jobs,
                resume=options.resume,
            ),
            on_event=progress.tell,
            on_jobs=progress.begin,
        ),
    )
