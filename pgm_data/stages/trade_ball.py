"""`pgm trade ball3d`: methods and presets for the ball in metres on drawn and real tracks, error against time."""

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from pgm_data.scene import load_scene
from pgm_data.stages.jobs import Job, JobEvent
from pgm_data.stages.trade_ball_cases import CaseOptions
from pgm_data.stages.trade_ball_clips import clip_jobs, clips_figures, clips_table
from pgm_data.stages.trade_ball_real import RealData, real_document, real_jobs, real_panels, real_tables
from pgm_data.stages.trade_ball_shots import SHOT_KINDS
from pgm_data.stages.trade_ball_solve import FOUND, GIVEN
from pgm_data.stages.trade_ball_summary import BASE, groups_of
from pgm_data.stages.trade_ball_tables import drawn_panels, drawn_tables
from pgm_data.stages.trade_plot import plot_svg
from pgm_data.stages.trade_run import TradeManner, TradeRun, run_parts, write_text
from pgm_data.stages.trade_summary import dominance_lines, summary_document

SOLVE = "pgm_data.stages.trade_ball_solve:solve_cases"
BATCH = 20
"""Shots that one job solves."""
RALLY_BATCH = 4
TIMEOUT_S = 1800.0
"""Of one job."""


def sweep_settings() -> dict[str, CaseOptions]:
    """What is varied, one thing at a time."""
    base = CaseOptions()
    settings = {f"{fps:g} frames/s": replace(base, fps=fps) for fps in (10.0, 30.0, 50.0, 60.0, 240.0)}
    settings |= {f"track {px:g} px": replace(base, noise_px=px) for px in (0.5, 2.0, 3.0)}
    settings |= {f"marks {px:g} px": replace(base, mark_px=px) for px in (1.0, 6.0)}
    settings |= {f"{100 * share:g} % false": replace(base, false_share=share) for share in (0.02, 0.05)}
    return settings | {
        "no marks": replace(base, marks=False),
        "exact contact times": replace(base, event_times="fractional"),
        "repeated frames": replace(base, fps=30.0, repeats=True),
        "1280x720, 1 px": replace(base, size=(1280, 720)),
    }


@dataclass(frozen=True, eq=False, kw_only=True)
class BallTradeOptions:
    """What is measured on what."""

    out: Path
    """Folder of the results."""
    state_dir: Path
    """Folder of the jobs' state and of temporary files."""
    scene: str = "tennis"
    solvers: tuple[str, ...] = ("line", "draft", "standard", "best")
    """Of `SOLVERS`."""
    kinds: tuple[str, ...] = SHOT_KINDS
    """Of shots that are drawn."""
    shots: int = 40
    """Drawn shots of each kind."""
    rallies: int = 12
    """Drawn rallies."""
    sweeps: int = 4
    """Shots of each kind, and rallies over four, of every other setting."""
    sweep_solvers: tuple[str, ...] = ("line", "standard")
    """Those of the solvers that other settings are solved by."""
    data: Path | None = None
    """Folder that `pgm simulate` wrote, with pictures."""
    real: RealData | None = None
    """Real tracks and clips."""
    seed: int = 0
    workers: int = 1
    resume: bool = False

    @property
    def some(self) -> tuple[str, ...]:
        """The solvers that other settings are solved by."""
        return tuple(name for name in self.sweep_solvers if name in self.solvers)


def run_ball_trade(
    options: BallTradeOptions, *, on_event: Callable[[JobEvent], None], on_jobs: Callable[[int], None]
) -> TradeRun:
    """Run every solver; writes `trade.md`, `trade.svg`, `trade.json` and `rows.jsonl`, anew after each part of the run
    and when it is interrupted.

    Args:
        options: What is measured on what.
        on_event: Told what happens to jobs.
        on_jobs: Told how many jobs there are, before each part of the run.

    Raises:
        ValueError: If the scene has no ball or court, or the real data are not what they must be.
    """
    scene = load_scene(options.scene)
    if scene.ball is None or scene.court is None:
        raise ValueError(f"scene {options.scene}: expected a ball and a court")
    parts = [drawing_jobs(options)]
    if options.data is not None:
        parts.append(clip_jobs(options.data, options.solvers))
    if options.real is not None:
        parts.append(real_jobs(options.real, options.solvers))
    if options.sweeps:
        parts.append(sweep_jobs(options))
    return run_parts(
        parts,
        manner=TradeManner(
            state_dir=options.state_dir, workers=options.workers, resume=options.resume, timeout_s=TIMEOUT_S
        ),
        write=lambda rows: write_figures(options.out, rows, options.solvers),
        on_event=on_event,
        on_jobs=on_jobs,
    )


def drawing_jobs(options: BallTradeOptions) -> list[Job]:
    """Jobs of the setting that the bars are for."""
    base = CaseOptions()
    jobs = []
    for kind in options.kinds:
        for first in range(0, options.shots, BATCH):
            cases = [(kind, first, min(BATCH, options.shots - first))]
            jobs.append(_job(options, BASE, base, cases, options.solvers, [GIVEN]))
    for first in range(0, options.rallies, RALLY_BATCH):
        cases = [("rally", first, min(RALLY_BATCH, options.rallies - first))]
        jobs.append(_job(options, BASE, base, cases, options.solvers, [GIVEN, FOUND]))
    # Of a single shot the track ends at its contacts, which then are hard to find: some tell what it costs.
    few = [(kind, 0, options.shots // 4) for kind in options.kinds if options.shots >= 4]
    if few and options.some:
        jobs.append(_job(options, BASE, base, few, options.some, [FOUND]))
    return jobs


def sweep_jobs(options: BallTradeOptions) -> list[Job]:
    """Jobs of the other settings."""
    shots = [(kind, 0, options.sweeps) for kind in options.kinds]
    rallies = [("rally", 0, options.sweeps // 4)] if options.sweeps >= 4 else []
    jobs, base = [], CaseOptions()
    for name, case in sweep_settings().items():
        # Rallies have no marks that could be other ones.
        unmarked = rallies if (case.marks, case.mark_px) == (base.marks, base.mark_px) else []
        if options.some and shots + unmarked:
            jobs.append(_job(options, name, case, [*shots, *unmarked], options.some, [GIVEN]))
    return jobs


def _job(
    options: BallTradeOptions,
    setting: str,
    case: CaseOptions,
    cases: Sequence[tuple[str, int, int]],
    solvers: Sequence[str],
    sources: Sequence[str],
) -> Job:
    """A job that solves cases, each given by kind, first number and count."""
    kind, first, _ = cases[0]
    what = f"{kind} {first:03d}" if len(cases) == 1 else "shots"
    return Job(
        name=f"{setting}, {what}, contacts {' and '.join(sources)}",
        stage="trade",
        entry=SOLVE,
        arguments={
            "scene": options.scene,
            "setting": setting,
            "options": asdict(case) | {"size": list(case.size)},
            "cases": [list(entry) for entry in cases],
            "seed": options.seed,
            "solvers": list(solvers),
            "sources": list(sources),
        },
    )


def write_figures(out: Path, rows: Sequence[dict], solvers: Sequence[str]) -> str:
    """Write the figures of those rows into a folder; all tables in Markdown."""
    groups = groups_of(rows)
    parts = ["# The ball in metres: error against time"]
    parts += drawn_tables(groups, solvers)
    clips = clips_figures(rows)
    if clips:
        parts += ["## Drawn videos, from pictures to metres", clips_table(clips)]
    parts += real_tables(rows)
    base = [g for g in groups if g.setting == BASE and g.events == GIVEN]
    conclusions = []
    for kind in dict.fromkeys(g.kind for g in base):
        own = [g for g in base if g.kind == kind]
        errors: dict[str, Sequence[float]] = {f"error of {kind.replace('_', ' ')}": [g.error_m for g in own]}
        conclusions += dominance_lines([g.solver for g in own], [g.seconds for g in own], errors)
    if conclusions:
        parts.append("\n".join(f"- {line}" for line in conclusions))
    document = {
        "drawn": [summary_document(g) for g in groups],
        "clips": [summary_document(c) for c in clips],
        "conclusions": conclusions,
    } | real_document(rows)
    table = "\n\n".join(parts)
    write_text(out / "rows.jsonl", "".join(json.dumps(row, allow_nan=False) + "\n" for row in rows))
    write_text(out / "trade.json", json.dumps(document, indent=1, allow_nan=False) + "\n")
    write_text(out / "trade.md", table + "\n")
    write_text(out / "trade.svg", plot_svg([*drawn_panels(groups, solvers), *real_panels(rows)]))
    return table
