"""`pgm trade calibrate`: every preset of the calibration on data with truth, error against time."""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pgm_data.dataset.files import whole_file
from pgm_data.scene import load_scene
from pgm_data.stages.jobs import Job, JobEvent, JobOutcome
from pgm_data.stages.supervise import run_jobs
from pgm_data.stages.trade_clips import truth_of
from pgm_data.stages.trade_pictures import REAL_SHARE, real_sources
from pgm_data.stages.trade_plot import Dot, Panel, plot_svg
from pgm_data.stages.trade_real import ReadFrame, RealScore, real_videos
from pgm_data.stages.trade_score import ClipScore
from pgm_data.stages.trade_summary import (
    PresetSummary,
    dominance_lines,
    simulated_table,
    summarise,
    summary_document,
)
from pgm_data.stages.trade_tables import (
    PicturesSummary,
    RealRun,
    RealSummary,
    pictures_table,
    real_summary_table,
    real_table,
    summarise_pictures,
    summarise_real,
)

DRAW = "pgm_data.stages.trade_clips:draw_clip"
SCORE = "pgm_data.stages.trade_clips:score_clip"
LOOK = "pgm_data.stages.trade_pictures:look_for_court"
REAL = "pgm_data.stages.trade_real:score_real"
BATCH = 25
"""Pictures without the court that one job looks at."""


@dataclass(frozen=True, eq=False, kw_only=True)
class TradeOptions:
    """What is measured on what."""

    out: Path
    """Folder of the results."""
    state_dir: Path
    """Folder of the jobs' state and of temporary files."""
    scene: str = "tennis"
    qualities: tuple[str, ...] = ("draft", "standard", "best")
    network: str = ""
    """ONNX file of a court network instead of the bundled one; `none` for lines alone."""
    data: Path | None = None
    """Folder that `pgm simulate` wrote; clips are drawn when None."""
    clips: int = 200
    """Clips to draw."""
    frames: int = 100
    """Frames of each."""
    negatives: int = 500
    """Pictures without the court."""
    real: Path | None = None
    """Folder of real clips."""
    size: tuple[int, int] = (1280, 720)
    seed: int = 0
    workers: int = 1
    resume: bool = False


@dataclass(frozen=True, eq=False, kw_only=True)
class TradeFigures:
    """Everything that was measured, per preset in the order asked for."""

    simulated: tuple[PresetSummary, ...]
    pictures: tuple[PicturesSummary, ...]
    real: tuple[RealSummary, ...]
    runs: tuple[RealRun, ...]
    """Real clips one by one."""

    def conclusions(self) -> list[str]:
        """Which presets are dominated, in words."""
        lines = dominance_lines(
            [s.preset for s in self.simulated],
            [s.frame_s for s in self.simulated],
            {
                "simulated court error": [s.court_px for s in self.simulated],
                "simulated centre error": [s.centre_m for s in self.simulated],
            },
        )
        return lines + dominance_lines(
            [s.preset for s in self.real],
            [1 / s.fps for s in self.real],
            {"error at hand-read points": [s.rms_median_px for s in self.real]},
        )

    def table(self) -> str:
        """All tables in Markdown."""
        parts = []
        if self.real:
            parts += [real_table(self.runs), real_summary_table(self.real)]
            parts.append("Points read by hand were scored and used for nothing else.")
        if self.simulated:
            parts.append(simulated_table(self.simulated))
        if self.pictures:
            parts.append(pictures_table(self.pictures))
        if self.conclusions():
            parts.append("\n".join(f"- {line}" for line in self.conclusions()))
        return "\n\n".join(parts)

    def plot(self) -> str:
        """Error against time, an SVG file."""
        panels = []
        for title, unit, name, factor in (
            ("court lines, simulated", "px, rms, median", "court_px", 1.0),
            ("camera centre, simulated", "cm, median", "centre_m", 100.0),
        ):
            dots = tuple(
                Dot(name=s.preset, time=1000 * s.frame_s, error=factor * getattr(s, name)) for s in self.simulated
            )
            if dots:
                panels.append(Panel(title=title, time_unit="ms per frame", error_unit=unit, dots=dots))
        if self.real:
            dots = tuple(Dot(name=s.preset, time=1000 / s.fps, error=s.rms_median_px) for s in self.real)
            title = "hand-read points, real clips"
            panels.append(Panel(title=title, time_unit="ms per frame", error_unit="px, rms, median", dots=dots))
        return plot_svg(panels)

    def document(self) -> dict:
        """The same as JSON."""
        return {
            "simulated": [summary_document(s) for s in self.simulated],
            "pictures": [summary_document(s) for s in self.pictures],
            "real": [summary_document(s) for s in self.real],
            "real_clips": [summary_document(r.score) | {"process_s": r.process_s, "fps": r.fps} for r in self.runs],
            "conclusions": self.conclusions(),
        }


@dataclass(frozen=True, eq=False, kw_only=True)
class TradeOutcome:
    """What was found."""

    figures: TradeFigures
    failed: tuple[JobOutcome, ...]
    """Jobs that came to nothing."""
    scored: int
    """Jobs that gave figures."""

    @property
    def table(self) -> str:
        """All tables in Markdown."""
        return self.figures.table()


def run_trade(
    options: TradeOptions, *, on_event: Callable[[JobEvent], None], on_jobs: Callable[[int], None]
) -> TradeOutcome:
    """Run every preset and write `trade.json`, `trade.md`, `trade.svg` and `rows.jsonl` into the output.

    Args:
        options: What is measured on what.
        on_event: Told what happens to jobs.
        on_jobs: Told how many jobs there are, before each part of the run.

    Raises:
        ValueError: If the data folder holds no videos with truth.
    """
    load_scene(options.scene)
    outcomes: list[JobOutcome] = []

    def run(jobs: Sequence[Job]) -> list[JobOutcome]:
        on_jobs(len(jobs))
        done = run_jobs(
            jobs, state_dir=options.state_dir, workers=options.workers, resume=options.resume, on_event=on_event
        )
        outcomes.extend(done)
        _write_rows(options.out / "rows.jsonl", outcomes)
        return [outcome for outcome in done if outcome.result is not None]

    data = options.data
    if data is None and options.clips:
        data = options.out / "simulated"
        run(_drawing_jobs(options, data))
    clips = run(_scoring_jobs(options, data)) if data is not None else []
    pictures = run(_looking_jobs(options)) if options.negatives else []
    real = run(_real_jobs(options, options.real)) if options.real is not None else []
    figures = _figures(options, clips, pictures, real)
    _write(options.out / "trade.json", json.dumps(figures.document(), indent=1, allow_nan=False) + "\n")
    _write(options.out / "trade.md", figures.table() + "\n")
    _write(options.out / "trade.svg", figures.plot())
    failed = tuple(outcome for outcome in outcomes if outcome.state == "failed")
    return TradeOutcome(figures=figures, failed=failed, scored=len(clips) + len(pictures) + len(real))


def _drawing_jobs(options: TradeOptions, folder: Path) -> list[Job]:
    width, height = options.size
    common = {
        "out": str(folder.resolve()),
        "scene": options.scene,
        "seed": options.seed,
        "frames": options.frames,
        "width": width,
        "height": height,
    }
    return [
        Job(name=f"draw {number:03d}", stage="trade", entry=DRAW, arguments=common | {"number": number})
        for number in range(options.clips)
    ]


def _scoring_jobs(options: TradeOptions, data: Path) -> list[Job]:
    return [
        Job(
            name=f"{quality} {video.stem}",
            stage="trade",
            entry=SCORE,
            arguments=_calibration(options, quality)
            | {"video": str(video), "truth": [str(folder.resolve()) for folder in folders]},
        )
        for video, folders in sorted(truth_of(data).items())
        for quality in options.qualities
    ]


def _looking_jobs(options: TradeOptions) -> list[Job]:
    sources = [] if options.real is None else real_sources(options.real.resolve(), options.scene)
    width, height = options.size
    common = {
        "scene": options.scene,
        "network": options.network,
        "qualities": list(options.qualities),
        "seed": options.seed,
        "width": width,
        "height": height,
        "scratch": str(options.state_dir.resolve()),
        "sources": [[str(source.path), source.first_frame] for source in sources],
        "real": round(REAL_SHARE * options.negatives) if sources else 0,
        "out": str((options.out / "false").resolve()),
    }
    return [
        Job(
            name=f"pictures {first:05d}",
            stage="trade",
            entry=LOOK,
            arguments=common | {"first": first, "count": min(BATCH, options.negatives - first)},
        )
        for first in range(0, options.negatives, BATCH)
    ]


def _real_jobs(options: TradeOptions, real: Path) -> list[Job]:
    real = real.resolve()
    return [
        Job(
            name=f"{quality} real {video.name}",
            stage="trade",
            entry=REAL,
            arguments=_calibration(options, quality) | {"video": str(video), "real": str(real)},
        )
        for video in real_videos(real, options.scene)
        for quality in options.qualities
    ]


def _calibration(options: TradeOptions, quality: str) -> dict[str, str]:
    """Arguments of every job that calibrates."""
    return {
        "scene": options.scene,
        "quality": quality,
        "network": options.network,
        "scratch": str((options.state_dir / "scratch").resolve()),
    }


def _figures(
    options: TradeOptions, clips: Sequence[JobOutcome], pictures: Sequence[JobOutcome], real: Sequence[JobOutcome]
) -> TradeFigures:
    scores = [_score(o.result) for o in clips if o.result is not None]
    runs = [RealRun(score=_real_score(o.result), process_s=o.seconds) for o in real if o.result is not None]
    batches = [o.result for o in pictures if o.result is not None]
    by_score = [(q, [s for s in scores if s.preset == q]) for q in options.qualities]
    by_run = [(q, [r for r in runs if r.score.preset == q]) for q in options.qualities]
    return TradeFigures(
        simulated=tuple(summarise(quality, found) for quality, found in by_score if found),
        pictures=tuple(summarise_pictures(quality, batches) for quality in options.qualities if batches),
        real=tuple(summarise_real(quality, found) for quality, found in by_run if found),
        runs=tuple(runs),
    )


def _score(result: dict) -> ClipScore:
    triples = {name: None if result[name] is None else tuple(result[name]) for name in ("centre_m", "centre_sigma_m")}
    fields: dict[str, Any] = result | triples
    return ClipScore(**fields)


def _real_score(result: dict) -> RealScore:
    fields: dict[str, Any] = result | {"read": tuple(ReadFrame(**frame) for frame in result["read"])}
    return RealScore(**fields)


def _write_rows(path: Path, outcomes: Sequence[JobOutcome]) -> None:
    """Every job's figures, one JSON object a line."""
    rows = [
        {"job": o.name, "state": o.state, "failure": o.reason, "job_seconds": o.seconds} | (o.result or {})
        for o in outcomes
    ]
    _write(path, "".join(json.dumps(row, allow_nan=False) + "\n" for row in rows))


def _write(path: Path, text: str) -> None:
    with whole_file(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
