"""`pgm trade ball3d [DATA] --out DIR`: both methods and every preset for the ball in metres, error against time."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from .console import check_ranges, option_error
from .output import OutputFolder
from .trade_jobs import carried_out

if TYPE_CHECKING:
    from pgm_data.stages.trade_ball import BallTradeOptions


@dataclass(frozen=True, kw_only=True)
class BallTrade:
    """Error, coverage, time and failures of every method and preset of pgm-ball3d, where the truth is known.

    Shots and rallies are drawn with their truth, seen with noise by cameras by lot, and compared with the least error
    that there can be (the Cramer-Rao bound). Writes trade.md, trade.svg, trade.json and rows.jsonl, anew after each
    part of the run. Times are those of this machine with so many workers at once.
    """

    data: tyro.conf.Positional[Path | None] = None
    """Folder that `pgm simulate` wrote, its videos with pictures: the ball is also found in them and placed."""
    out: Path
    """Folder to write into, new or empty."""
    method: tuple[Literal["line", "physics"], ...] = ("line", "physics")
    """Methods to run."""
    quality: tuple[Literal["draft", "standard", "best"], ...] = ("draft", "standard", "best")
    """Presets of the physics method to run."""
    kind: tuple[Literal["serve", "forehand_near", "forehand_far", "slice", "lob"], ...] = (
        "serve",
        "forehand_near",
        "forehand_far",
        "slice",
        "lob",
    )
    """Kinds of shots to draw."""
    shots: int = 40
    """Drawn shots of each kind; 0 for none."""
    rallies: int = 12
    """Drawn rallies of 4 to 10 shots; 0 for none."""
    sweeps: int = 4
    """Shots of each kind under every other frame rate, noise, kind of marks and so on; 0 for none."""
    real: Path | None = None
    """Folder of real data with ball/ and tennis/ in it, scored but never learned from."""
    pixels: bool = False
    """Whether the ball of the real rally is also found in its video, which takes a minute and more."""
    seed: int = 0
    """What is drawn depends on this and the options alone."""
    workers: int = 1
    """Jobs at a time."""
    resume: bool = False
    """Go on where an earlier run into this folder stopped; figures that it has are kept as they are."""
    overwrite: bool = False
    """Delete what an earlier run wrote into this folder, and begin again."""


def trade_ball3d(options: Annotated[BallTrade, tyro.conf.arg(name="")]) -> int:
    """Error, coverage, time and failures of every method and preset of pgm-ball3d, where the truth is known."""
    _check(options)
    from pgm_data.stages.trade_ball import run_ball_trade

    return carried_out(
        "ball3d",
        options,
        lambda folder, progress: run_ball_trade(
            _trade(options, folder), on_event=progress.tell, on_jobs=progress.begin
        ),
    )


def _check(options: BallTrade) -> None:
    check_ranges(
        ("--shots", options.shots, 0, 100_000),
        ("--rallies", options.rallies, 0, 100_000),
        ("--sweeps", options.sweeps, 0, 10_000),
        ("--seed", options.seed, 0, 2**31),
        ("--workers", options.workers, 1, 1024),
    )
    for name, chosen in (("--method", options.method), ("--quality", options.quality), ("--kind", options.kind)):
        if not chosen or len(set(chosen)) < len(chosen):
            raise option_error(name, expected="some, each once", got=" ".join(chosen) or "none")
    for name, path in (("DATA", options.data), ("--real", options.real)):
        if path is not None and not path.is_dir():
            raise option_error(name, expected="a folder", got=path)
    if options.pixels and options.real is None:
        raise option_error("--pixels", expected="--real with it", got="it alone")


def solvers_of(options: BallTrade) -> tuple[str, ...]:
    """Names of the solvers that the options ask for."""
    physics = options.quality if "physics" in options.method else ()
    return (*(("line",) if "line" in options.method else ()), *physics)


def _trade(options: BallTrade, folder: OutputFolder) -> "BallTradeOptions":
    from pgm_data.stages.trade_ball import BallTradeOptions
    from pgm_data.stages.trade_ball_real import RealData

    real = None
    if options.real is not None:
        scratch = folder.state_dir / "scratch"
        real = RealData(folder=options.real, pixels=options.pixels, scratch=scratch)
    return BallTradeOptions(
        out=options.out,
        state_dir=folder.state_dir,
        solvers=solvers_of(options),
        kinds=options.kind,
        shots=options.shots,
        rallies=options.rallies,
        sweeps=options.sweeps,
        data=options.data,
        real=real,
        seed=options.seed,
        workers=options.workers,
        resume=options.resume,
    )
