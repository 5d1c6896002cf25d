"""`pgm trade players [DATA] --out DIR`: every preset for the players in metres, error against time."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from .console import check_ranges, option_error
from .trade_jobs import carried_out


@dataclass(frozen=True, kw_only=True)
class PlayersTrade:
    """Error, coverage and time of every preset of pgm players, where the truth is known, and on real clips.

    Drawn plays go through registration alone: true boxes, true points with noise. Writes trade.md, trade.svg,
    trade.json and rows.jsonl, anew after each part of the run. Times are those of this machine with so many workers.
    """

    data: tyro.conf.Positional[Path | None] = None
    """Folder that `pgm simulate` wrote, its videos with pictures: players are also found in them and placed."""
    out: Path
    """Folder to write into, new or empty."""
    quality: tuple[Literal["draft", "standard", "best"], ...] = ("draft", "standard", "best")
    """Presets to run."""
    plays: int = 12
    """Drawn matches without pictures; 0 for none."""
    frames: int = 300
    """Of each of them."""
    noise: float = 2.0
    """Of their points, px at 1920x1080."""
    real: Path | None = None
    """Work folder of real clips that pgm-calibrate made, scored but never learned from."""
    seed: int = 0
    """What is drawn depends on this and the options alone."""
    workers: int = 1
    """Jobs at a time."""
    resume: bool = False
    """Go on where an earlier run into this folder stopped; figures that it has are kept as they are."""
    overwrite: bool = False
    """Delete what an earlier run wrote into this folder, and begin again."""


def trade_players(options: Annotated[PlayersTrade, tyro.conf.arg(name="")]) -> int:
    """Error, coverage and time of every preset of pgm players, where the truth is known, and on real clips."""
    check_ranges(
        ("--plays", options.plays, 0, 100_000),
        ("--frames", options.frames, 5, 100_000),
        ("--noise", options.noise, 0.0, 100.0),
        ("--seed", options.seed, 0, 2**31),
        ("--workers", options.workers, 1, 1024),
    )
    if not options.quality or len(set(options.quality)) < len(options.quality):
        raise option_error("--quality", expected="presets, each once", got=" ".join(options.quality) or "none")
    for name, path in (("DATA", options.data), ("--real", options.real)):
        if path is not None and not path.is_dir():
            raise option_error(name, expected="a folder", got=path)
    from pgm_data.stages.trade_players import PlayersTradeOptions, run_players_trade

    return carried_out(
        "players",
        options,
        lambda folder, progress: run_players_trade(
            PlayersTradeOptions(
                out=options.out,
                state_dir=folder.state_dir,
                qualities=options.quality,
                plays=options.plays,
                frames=options.frames,
                noise_px=options.noise,
                data=options.data,
                real=options.real,
                seed=options.seed,
                workers=options.workers,
                resume=options.resume,
            ),
            on_event=progress.tell,
            on_jobs=progress.begin,
        ),
    )
