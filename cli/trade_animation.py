"""`pgm trade animation DATASET --test DATASET --out DIR`: designs, masks, data and samplers of the animation model."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from .console import check_ranges, option_error
from .trade_jobs import carried_out, check_chosen, check_packed, check_parts, threads_of


@dataclass(frozen=True, kw_only=True)
class AnimationTrade:
    """Quality of the animation model by design, masks, share of the data and sampler, all trained at one budget.

    Writes trade.md, trade.svg (quality against frames a second), trade.csv, trade.json and rows.jsonl, anew after each
    part; the trained models stay in OUT/runs. Times are those of this machine; steps are compared one job at a time.
    """

    dataset: tyro.conf.Positional[Path]
    """Packed dataset to learn from."""
    test: Path
    """Packed dataset of other matches, to be evaluated on."""
    out: Path
    """Folder to write into, new or empty."""
    preset: Literal["nano", "tiny", "small", "base", "paper"] = "tiny"
    """Size of all models."""
    parts: tuple[Literal["designs", "masks", "share", "steps"], ...] = ("designs", "masks", "share", "steps")
    """What to compare: ours, the paper's and the baselines; groups of masking strategies; 20 to 100 % of the data; each
    sampler at 1 to 250 steps."""
    designs: tuple[str, ...] = ("ours", "velocity", "paper", "transformer", "lstm", "playable")
    """Designs of the first part; those that pgm-train animation knows."""
    seeds: int = 3
    """Trainings of ours, of the paper's design and of the reconstruction transformer; one of the rest."""
    steps: int = 0
    """Optimiser steps of each training; the preset's unless given."""
    encoder: str = ""
    """Frozen text encoder: hash, minilm or t5:FOLDER; the preset's unless given."""
    rates: tuple[float, float] = (4.0, 25.0)
    """Lowest and highest rate of training windows, frames a second."""
    rate: float = 4.0
    """Of the windows that are evaluated, frames a second; the paper's is 4."""
    windows: int = 2048
    """Windows of an evaluation, at most."""
    few_windows: int = 512
    """The same with 250 and 1000 steps, and where steps are compared."""
    most_steps: int = 1000
    """Leave out comparisons of more steps than these."""
    run: Path | None = None
    """Run of pgm-train whose steps are compared, instead of the first training of ours."""
    jobs: int = 1
    """Trainings and evaluations at a time."""
    threads: int = 0
    """CPU threads of each; the usable cores shared out unless given."""
    device: str = "auto"
    """Where to compute: auto, cpu, cuda or cuda:N."""
    precision: Literal["float32", "bfloat16"] = "float32"
    """Of training's inner arithmetic."""
    known: tuple[Path, ...] = ()
    """rows.jsonl of other trades, of this machine or another; what they have is not trained or evaluated again. They
    must have been made of the same data in the same manner; times stay those of their machine."""
    resume: bool = False
    """Go on where an earlier run into this folder stopped; figures that it has are kept as they are."""
    overwrite: bool = False
    """Delete what an earlier run wrote into this folder, and begin again."""


def trade_animation(options: Annotated[AnimationTrade, tyro.conf.arg(name="")]) -> int:
    """Quality of the animation model by design, masks, share of the data and sampler, all trained at one budget."""
    check_ranges(
        ("--seeds", options.seeds, 1, 100),
        ("--steps", options.steps, 0, 10**9),
        ("--rate", options.rate, 0.1, 1000.0),
        ("--windows", options.windows, 2, 10**7),
        ("--few-windows", options.few_windows, 2, 10**7),
        ("--most-steps", options.most_steps, 1, 1000),
        ("--jobs", options.jobs, 1, 1024),
        ("--threads", options.threads, 0, 1024),
    )
    if not 0 < options.rates[0] <= options.rates[1]:
        raise option_error("--rates", expected="two numbers above 0, the lower one first", got=options.rates)
    check_parts(options.parts)
    check_packed("DATASET", options.dataset)
    check_packed("--test", options.test)
    if options.run is not None and not options.run.exists():
        raise option_error("--run", expected="a run of pgm-train animation", got=options.run)
    for path in options.known:
        if not path.is_file():
            raise option_error("--known", expected="files as trades write them, rows.jsonl", got=path)
    from pgm_models.animation.presets import DESIGNS
    from pgm_models.animation.trade import AnimationTradeOptions, run_animation_trade
    from pgm_models.animation.trade_runs import RunManner

    check_chosen("--designs", options.designs, tuple(DESIGNS))
    manner = RunManner(
        dataset=options.dataset,
        test=options.test,
        out=options.out,
        preset=options.preset,
        steps=options.steps,
        encoder=options.encoder,
        rates=options.rates,
        rate=options.rate,
        device=options.device,
        precision=options.precision,
        threads=threads_of(options.threads, options.jobs),
        given=options.run,
    )
    return carried_out(
        "animation",
        options,
        lambda folder, progress: run_animation_trade(
            AnimationTradeOptions(
                manner=manner,
                state_dir=folder.state_dir,
                parts=options.parts,
                designs=options.designs,
                seeds=options.seeds,
                windows=options.windows,
                few_windows=options.few_windows,
                most_steps=options.most_steps,
                workers=options.jobs,
                known=options.known,
                resume=options.resume,
            ),
            on_event=progress.tell,
            on_jobs=progress.begin,
        ),
    )
