"""Tables of a trade on real clips and on pictures without the court, in Markdown."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pgm_data.stages.trade_real import RealScore
from pgm_data.stages.trade_summary import number


@dataclass(frozen=True, eq=False, kw_only=True)
class RealSummary:
    """One preset over all real clips."""

    preset: str
    frames_read: int
    """Frames with points read by hand."""
    unsolved: int
    """Those of them without a camera."""
    rms_median_px: float
    """Median of the rms over frames with points read by hand; infinite for those without a camera."""
    rms_worst_px: float
    net_worst_px: float
    """Largest distance at the top of the net."""
    false_frames: int
    """Frames with a camera where only close-ups are shown."""
    fps: float
    """Frames per second of whole processes, all clips together."""
    memory_mb: float


@dataclass(frozen=True, eq=False, kw_only=True)
class RealRun:
    """A real clip's score, and what its whole process took."""

    score: RealScore
    process_s: float

    @property
    def fps(self) -> float:
        """Frames per second of the whole process."""
        return self.score.frames / self.process_s


def summarise_real(preset: str, runs: Sequence[RealRun]) -> RealSummary:
    """The figures of one preset; NaN where no points were read."""
    read = [r for run in runs for r in run.score.read]
    rms = np.array([_or_infinite(r.rms_px) for r in read if r.status == "none" or r.rms_px is not None])
    net = [r.net_px for r in read if r.net_px is not None]
    return RealSummary(
        preset=preset,
        frames_read=len(read),
        unsolved=sum(r.status == "none" for r in read),
        rms_median_px=float(np.median(rms)) if len(rms) else float("nan"),
        rms_worst_px=float(rms.max()) if len(rms) else float("nan"),
        net_worst_px=max(net) if net else float("nan"),
        false_frames=sum(run.score.false_frames for run in runs),
        fps=sum(run.score.frames for run in runs) / sum(run.process_s for run in runs),
        memory_mb=max(run.score.memory_mb for run in runs),
    )


def real_table(runs: Sequence[RealRun]) -> str:
    """A row per clip and preset, in Markdown."""
    head = (
        "real clip",
        "preset",
        "frames",
        "measured",
        "interp.",
        "none",
        "rms px",
        "worst point px",
        "net top px",
        "fits px",
        "jitter px",
        "lens",
        "frames/s",
        "MB",
    )
    rows = [
        (
            run.score.video,
            run.score.preset,
            str(run.score.frames),
            str(run.score.measured),
            str(run.score.interpolated),
            str(run.score.frames - run.score.measured - run.score.interpolated),
            _each(run.score, "rms_px"),
            _each(run.score, "max_px"),
            _each(run.score, "net_px"),
            _maybe(run.score.reprojection_px, 2),
            _maybe(run.score.jitter_px, 3),
            run.score.lens_model or "-",
            f"{run.fps:.1f}",
            f"{run.score.memory_mb:.0f}",
        )
        for run in sorted(runs, key=lambda run: run.score.video)
    ]
    return _table(head, rows)


def real_summary_table(summaries: Sequence[RealSummary]) -> str:
    """The presets over all real clips, in Markdown."""
    head = (
        "preset",
        "frames read",
        "without camera",
        "rms median px (0.7 wanted)",
        "rms worst px (1.5)",
        "net worst px (3)",
        "cameras in close-ups (0)",
        "frames/s",
        "MB",
    )
    rows = [
        (
            s.preset,
            str(s.frames_read),
            str(s.unsolved),
            number(s.rms_median_px, 2),
            number(s.rms_worst_px, 2),
            number(s.net_worst_px, 2),
            str(s.false_frames),
            f"{s.fps:.1f}",
            f"{s.memory_mb:.0f}",
        )
        for s in summaries
    ]
    return _table(head, rows)


@dataclass(frozen=True, eq=False, kw_only=True)
class PicturesSummary:
    """One preset over all pictures without the court."""

    preset: str
    pictures: int
    real: int
    """Real ones among them."""
    false: int
    """Pictures in which a camera was believed."""
    picture_s: float
    """Seconds per picture."""
    which: tuple[str, ...]
    """Saved file and origin of each false one."""


def summarise_pictures(preset: str, batches: Sequence[dict]) -> PicturesSummary:
    """The figures of one preset over batches of `look_for_court`."""
    pictures = sum(b["pictures"] for b in batches)
    false = [c for b in batches for c in b["false"] if c["preset"] == preset]
    return PicturesSummary(
        preset=preset,
        pictures=pictures,
        real=sum(b["real"] for b in batches),
        false=len(false),
        picture_s=sum(b["look_s"][preset] for b in batches) / max(pictures, 1),
        which=tuple(f"{c['file']}: {c['origin']}, {c['inliers']} inliers, {c['rms_px']:.2f} px" for c in false),
    )


def pictures_table(summaries: Sequence[PicturesSummary]) -> str:
    """The presets over all pictures without the court, in Markdown, and which were taken for one."""
    head = ("pictures without the court", "preset", "real", "false cameras (0 wanted)", "ms a picture")
    rows = [(str(s.pictures), s.preset, str(s.real), str(s.false), f"{1000 * s.picture_s:.0f}") for s in summaries]
    listed = "\n".join(f"- false: {text}" for s in summaries for text in s.which)
    return _table(head, rows) + (f"\n\n{listed}" if listed else "")


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = ["| " + " | ".join(head) + " |", "| " + " | ".join("---" for _ in head) + " |"]
    return "\n".join(lines + ["| " + " | ".join(row) + " |" for row in rows])


def _each(score: RealScore, name: str) -> str:
    """The values at the hand-read frames, in order; `none` where the frame has no camera."""
    return ", ".join("none" if r.status == "none" else _maybe(getattr(r, name), 2) for r in score.read) or "-"


def _maybe(value: float | None, places: int) -> str:
    return "-" if value is None else number(value, places)


def _or_infinite(value: float | None) -> float:
    return np.inf if value is None else value
