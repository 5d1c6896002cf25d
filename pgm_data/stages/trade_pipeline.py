"""`pgm trade pipeline`: what each stage's preset costs downstream, as one table and one plot."""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pgm_data.stages.jobs import JobEvent
from pgm_data.stages.players_options import Quality
from pgm_data.stages.trade_ball_tables import cm, markdown
from pgm_data.stages.trade_pipeline_clips import STAGES, pipeline_jobs
from pgm_data.stages.trade_plot import Dot, Panel, plot_svg
from pgm_data.stages.trade_run import TradeManner, TradeRun, run_parts, write_text
from pgm_data.stages.trade_summary import number, percent

TIMEOUT_S = 7200.0
"""Of one job."""
ERRORS = {"ball_m": "ball", "player0_m": "near player", "player1_m": "far player", "camera_m": "camera"}
"""Columns of errors and what they are of."""


@dataclass(frozen=True, eq=False, kw_only=True)
class PipelineTradeOptions:
    """What is measured on what."""

    data: Path
    """Folder that `pgm simulate` wrote, with pictures."""
    out: Path
    state_dir: Path
    qualities: tuple[Quality, ...] = ("draft", "standard", "best")
    workers: int = 1
    resume: bool = False


def run_pipeline_trade(
    options: PipelineTradeOptions, *, on_event: Callable[[JobEvent], None], on_jobs: Callable[[int], None]
) -> TradeRun:
    """Run every variant of presets on every video; writes `trade.md`, `trade.svg`, `trade.json` and `rows.jsonl`.

    Raises:
        ValueError: If the folder holds no video with its truth.
    """
    jobs = pipeline_jobs(options.data, options.qualities, scratch=options.state_dir / "scratch")
    return run_parts(
        [jobs],
        manner=TradeManner(
            state_dir=options.state_dir, workers=options.workers, resume=options.resume, timeout_s=TIMEOUT_S
        ),
        write=lambda rows: write_figures(options.out, rows),
        on_event=on_event,
        on_jobs=on_jobs,
    )


def write_figures(out: Path, rows: Sequence[dict]) -> str:
    """Write the figures of those rows into a folder; the table in Markdown."""
    names = list(dict.fromkeys(row["variant"] for row in rows))
    groups = {name: [row for row in rows if row["variant"] == name] for name in names}
    errors = {key: [_middle(groups[name], key) for name in names] for key in ERRORS}
    times = [_seconds(groups[name], STAGES) for name in names]
    head = ["presets", *(f"{what}, cm" for what in ERRORS.values()), "court's lines, px", "ball placed", "far placed"]
    head += [f"{stage}, s a minute of video at 25 frames/s" for stage in STAGES] + ["together"]
    lines = [
        [
            name,
            *(cm(errors[key][i]) for key in ERRORS),
            number(_middle(groups[name], "court_px"), 3),
            percent(_middle(groups[name], "ball_placed")),
            percent(_middle(groups[name], "player1_placed")),
            *(number(_seconds(groups[name], (stage,)), 0) for stage in STAGES),
            number(times[i], 0),
        ]
        for i, name in enumerate(names)
    ]
    told: dict[str, Sequence[float]] = {ERRORS[key]: values for key, values in errors.items()}
    parts = ["# The whole pipeline: what a preset costs downstream", markdown(head, lines)]
    budget = [_within(names, times, what, values) for what, values in told.items()]
    parts.append("\n".join(f"- {line}" for line in budget if line))
    panels = [
        Panel(
            title=f"error of the {what}",
            time_unit="s a minute of video, all stages",
            error_unit="median, cm",
            dots=tuple(Dot(name=n, time=t, error=100 * e) for n, t, e in zip(names, times, values, strict=True)),
        )
        for what, values in told.items()
        if what != "camera"
    ]
    table = "\n\n".join(part for part in parts if part)
    write_text(out / "rows.jsonl", "".join(json.dumps(row, allow_nan=False) + "\n" for row in rows))
    write_text(out / "trade.json", json.dumps({"table": table, "rows": len(rows)}, indent=1) + "\n")
    write_text(out / "trade.md", table + "\n")
    write_text(out / "trade.svg", plot_svg(panels))
    return table


def _within(names: Sequence[str], times: Sequence[float], what: str, errors: Sequence[float]) -> str:
    """The cheapest presets whose error is within a tenth of the best, in words; nothing where nothing was measured."""
    finite = [i for i, error in enumerate(errors) if np.isfinite(error)]
    if not finite:
        return ""
    best = min(errors[i] for i in finite)
    cheap = min((i for i in finite if errors[i] <= 1.1 * best), key=lambda i: times[i])
    return f"{what}: the cheapest within a tenth of the best is `{names[cheap]}`, {cm(errors[cheap])} cm"


def _seconds(rows: Sequence[dict], stages: Sequence[str]) -> float:
    """Seconds for a minute of video at 25 frames a second."""
    total = sum(row[f"{stage}_s"] for row in rows for stage in stages)
    return 1500 * total / max(sum(row["frames"] for row in rows), 1)


def _middle(rows: Sequence[dict], name: str) -> float:
    """Median over videos; one without a figure counts as infinitely wrong."""
    values = sorted(np.inf if row[name] is None else row[name] for row in rows)
    return float(values[(len(values) - 1) // 2]) if values else float("nan")
