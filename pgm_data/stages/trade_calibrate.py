"""`pgm trade calibrate`: every preset of the calibration on data with truth, error against time."""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from pgm_data.dataset.files import whole_file
from pgm_data.scene import load_scene
from pgm_data.stages.jobs import Job, JobEvent, JobOutcome
from pgm_data.stages.supervise import run_jobs
from pgm_data.stages.trade_clips import truth_of
from pgm_data.stages.trade_score import ClipScore
from pgm_data.stages.trade_summary import dominance_lines, simulated_table, summarise, summary_document

DRAW = "pgm_data.stages.trade_clips:draw_clip"
SCORE = "pgm_data.stages.trade_clips:score_clip"


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
    size: tuple[int, int] = (1280, 720)
    seed: int = 0
    workers: int = 1
    resume: bool = False


@dataclass(frozen=True, eq=False, kw_only=True)
class TradeOutcome:
    """What was found."""

    table: str
    """All tables in Markdown."""
    conclusions: tuple[str, ...]
    """In words: which presets are dominated."""
    failed: tuple[JobOutcome, ...]
    """Jobs that came to nothing."""
    scored: int
    """Jobs that gave figures."""


def run_trade(options: TradeOptions, *, on_event: Callable[[JobEvent], None], on_jobs: Callable[[int], None]) -> TradeOutcome:
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
        return done

    data = options.data
    if data is None and options.clips:
        data = options.out / "simulated"
        run(_drawing_jobs(options, data))
    scores: list[ClipScore] = []
    if data is not None:
        scores = [_score(o.result) for o in run(_scoring_jobs(options, data)) if o.result is not None]
    return _written(options, scores, outcomes)


def _drawing_jobs(options: TradeOptions, folder: Path) -> list[Job]:
    width, height = options.size
    common = {
        "out": str(folder.resolve()), "scene": options.scene, "seed": options.seed, "frames": options.frames, "width": width,
        "height": height,
    }
    return [
        Job(name=f"draw {number:03d}", stage="trade", entry=DRAW, arguments=common | {"number": number})
        for number in range(options.clips)
    ]


def _scoring_jobs(options: TradeOptions, data: Path) -> list[Job]:
    videos = truth_of(data)
    return [
        Job(
            name=f"{quality} {video.stem}", stage="trade", entry=SCORE,
            arguments=_calibration(options, quality) | {"video": str(video), "truth": [str(f.resolve()) for f in folders]},
        )
        for video, folders in sorted(videos.items())
        for quality in options.qualities
    ]


def _calibration(options: TradeOptions, quality: str) -> dict[str, str]:
    """Arguments of every job that calibrates."""
    return {
        "scene": options.scene, "quality": quality, "network": options.network,
        "scratch": str((options.state_dir / "scratch").resolve()),
    }


def _score(result: dict) -> ClipScore:
    triples = {name: None if result[name] is None else tuple(result[name]) for name in ("centre_m", "centre_sigma_m")}
    return ClipScore(**(result | triples))


def _written(options: TradeOptions, scores: list[ClipScore], outcomes: list[JobOutcome]) -> TradeOutcome:
    of_preset = {q: [s for s in scores if s.preset == q] for q in options.qualities}
    summaries = [summarise(quality, found) for quality, found in of_preset.items() if found]
    parts, conclusions = [], []
    if summaries:
        parts.append(simulated_table(summaries))
        conclusions = dominance_lines(
            [s.preset for s in summaries], [s.frame_s for s in summaries],
            {"court error": [s.court_px for s in summaries], "centre error": [s.centre_m for s in summaries]},
        )
        parts.append("\n".join(f"- {line}" for line in conclusions))
    table = "\n\n".join(parts)
    document = {
        "simulated": [summary_document(s) for s in summaries],
        "conclusions": conclusions,
    }
    _write(options.out / "trade.json", json.dumps(document, indent=1, allow_nan=False) + "\n")
    _write(options.out / "trade.md", table + "\n")
    failed = tuple(o for o in outcomes if o.state == "failed")
    return TradeOutcome(table=table, conclusions=tuple(conclusions), failed=failed, scored=len(scores))


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
