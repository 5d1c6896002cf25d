"""`pgm trade pipeline DATA --out DIR`: which presets for my budget."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from .console import option_error
from .trade_jobs import carried_out


@dataclass(frozen=True, kw_only=True)
class PipelineTrade:
    """What each stage's preset costs downstream: a draft camera in centimetres of ball and players, and in seconds.

    Every video goes through camera, players and ball with all presets standard, with one stage's preset changed at a
    time, and with all changed together. Writes trade.md, trade.svg, trade.json and rows.jsonl.
    """

    data: tyro.conf.Positional[Path]
    """Folder that `pgm simulate` wrote, its videos with pictures."""
    out: Path
    """Folder to write into, new or empty."""
    quality: tuple[Literal["draft", "standard", "best"], ...] = ("draft", "standard", "best")
    """Presets to compare; standard is always run."""
    workers: int = 1
    """Videos at a time."""
    resume: bool = False
    """Go on where an earlier run into this folder stopped; figures that it has are kept as they are."""
    overwrite: bool = False
    """Delete what an earlier run wrote into this folder, and begin again."""


def trade_pipeline(options: Annotated[PipelineTrade, tyro.conf.arg(name="")]) -> int:
    """What each stage's preset costs downstream: a draft camera in centimetres of ball and players, and in seconds."""
    if not options.quality or len(set(options.quality)) < len(options.quality):
        raise option_error("--quality", expected="presets, each once", got=" ".join(options.quality) or "none")
    if not 1 <= options.workers <= 1024:
        raise option_error("--workers", expected="1 to 1024", got=options.workers)
    if not options.data.is_dir():
        raise option_error("DATA", expected="a folder", got=options.data)
    from pgm_data.stages.trade_pipeline import PipelineTradeOptions, run_pipeline_trade

    return carried_out(
        "pipeline",
        options,
        lambda folder, progress: run_pipeline_trade(
            PipelineTradeOptions(
                data=options.data,
                out=options.out,
                state_dir=folder.state_dir,
                qualities=options.quality,
                workers=options.workers,
                resume=options.resume,
            ),
            on_event=progress.tell,
            on_jobs=progress.begin,
        ),
    )
