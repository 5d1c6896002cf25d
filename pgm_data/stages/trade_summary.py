"""What the clips of a trade say together, per preset: figures, a table in Markdown, and which presets are dominated."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, is_dataclass

import numpy as np
from jaxtyping import Float

from pgm_data.stages.trade_score import ClipScore, coverage, coverage_by_thirds

AXES = ("x", "y", "z")


@dataclass(frozen=True, eq=False, kw_only=True)
class PresetSummary:
    """One preset over all simulated clips. Clips without any camera count as infinitely wrong in the medians."""

    preset: str
    clips: int
    solved: float
    """Share of clips solved: nine frames in ten have a camera, and the median frame's is right."""
    wrong: int
    """Clips whose median camera is far off."""
    frames_solved: float
    """Share of all frames with a camera."""
    false_frames: int
    """Frames with a camera where the court is not shown."""
    centre_m: float
    """Median over clips."""
    centre_far_m: float
    """Median over the third of the clips that is narrowest and farthest."""
    centre_axes_m: tuple[float, float, float]
    """Median absolute error by axis."""
    focal: float
    """Median over clips, as a share."""
    court_px: float
    """Median over clips of the court's rms error."""
    covered: tuple[float, float, float]
    """Share of clips whose centre lies within one stated deviation, by axis."""
    covered_thirds: tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]]
    """The same by axis in each third of the stated deviation, smallest first."""
    focal_covered: float
    """Share of frames whose focal length is within one stated deviation, mean over clips."""
    frame_s: float
    """Seconds per frame, all clips together."""
    frame_cpu_s: float
    """Processor seconds per frame."""
    memory_mb: float
    """Largest peak."""

    @property
    def fps(self) -> float:
        """Frames per second, all clips together."""
        return 1.0 / self.frame_s


def farthest_third(scores: Sequence[ClipScore]) -> list[ClipScore]:
    """The third of the clips whose camera is narrowest and farthest: by focal length times distance."""
    count = -(-len(scores) // 3)
    return sorted(scores, key=lambda s: s.focal_widths * s.distance_m, reverse=True)[:count]


def summarise(preset: str, scores: Sequence[ClipScore]) -> PresetSummary:
    """The figures of one preset.

    Raises:
        ValueError: If there is no clip.
    """
    if not scores:
        raise ValueError(f"preset {preset}: expected at least one clip, got none")
    frames = sum(s.frames for s in scores)
    found = [s for s in scores if s.centre_m is not None]
    focal_covered = [s.focal_covered for s in found if s.focal_covered is not None]
    error = np.array([s.centre_m for s in found]).reshape(-1, 3)
    sigma = np.array([s.centre_sigma_m for s in found]).reshape(-1, 3)
    thirds = [coverage_by_thirds(error[:, axis], sigma[:, axis]) for axis in range(3)]
    axes = np.median(np.abs(error), axis=0) if len(found) else np.full(3, np.nan)
    return PresetSummary(
        preset=preset,
        clips=len(scores),
        solved=float(np.mean([s.solved for s in scores])),
        wrong=sum(s.wrong for s in scores),
        frames_solved=sum(s.measured + s.interpolated for s in scores) / max(frames, 1),
        false_frames=sum(s.false_frames for s in scores),
        centre_m=_median([_error(s) for s in scores]),
        centre_far_m=_median([_error(s) for s in farthest_third(scores)]),
        centre_axes_m=(float(axes[0]), float(axes[1]), float(axes[2])),
        focal=_median([np.inf if s.focal is None else s.focal for s in scores]),
        court_px=_median([np.inf if s.court_px is None else s.court_px for s in scores]),
        covered=(
            coverage(error[:, 0], sigma[:, 0]),
            coverage(error[:, 1], sigma[:, 1]),
            coverage(error[:, 2], sigma[:, 2]),
        ),
        covered_thirds=(thirds[0], thirds[1], thirds[2]),
        focal_covered=float(np.mean(focal_covered)) if focal_covered else float("nan"),
        frame_s=sum(s.seconds for s in scores) / max(frames, 1),
        frame_cpu_s=sum(s.cpu_s for s in scores) / max(frames, 1),
        memory_mb=max(s.memory_mb for s in scores),
    )


def dominated(time: Float[np.ndarray, " presets"], error: Float[np.ndarray, " presets"]) -> list[tuple[int, int]]:
    """Pairs (a, b) where b is at least as good as a in both, and better in one."""
    count = len(time)
    return [
        (a, b)
        for a in range(count)
        for b in range(count)
        if time[b] <= time[a] and error[b] <= error[a] and (time[b] < time[a] or error[b] < error[a])
    ]


def dominance_lines(names: Sequence[str], time: Sequence[float], errors: dict[str, Sequence[float]]) -> list[str]:
    """For each kind of error, which presets are dominated in it and in time, in words; nothing for one preset alone."""
    lines: list[str] = []
    if len(names) < 2:
        return lines
    for kind, error in errors.items():
        pairs = dominated(np.array(time), np.array(error))
        if not pairs:
            lines.append(f"in {kind} against time no preset is dominated")
        lines += [f"in {kind} against time {names[a]} is dominated by {names[b]}" for a, b in pairs]
    return lines


def simulated_table(summaries: Sequence[PresetSummary]) -> str:
    """Rows of figures, a column per preset, in Markdown."""

    def row(name: str, wanted: str, cell) -> str:
        return f"| {name} | {wanted} | " + " | ".join(cell(s) for s in summaries) + " |"

    lines = [
        "| simulated clips | wanted | " + " | ".join(s.preset for s in summaries) + " |",
        "| --- | --- |" + " --- |" * len(summaries),
        row("clips", "", lambda s: str(s.clips)),
        row("clips solved", "99 %", lambda s: percent(s.solved)),
        row("clips with a wrong camera", "0", lambda s: str(s.wrong)),
        row("frames with a camera", "", lambda s: percent(s.frames_solved)),
        row("cameras where no court is shown", "0", lambda s: str(s.false_frames)),
        row("centre, median", "5 cm", lambda s: f"{number(100 * s.centre_m, 1)} cm"),
        row("centre, narrowest and farthest third", "25 cm", lambda s: f"{number(100 * s.centre_far_m, 1)} cm"),
        row("centre x, y, z", "", lambda s: ", ".join(number(100 * v, 1) for v in s.centre_axes_m) + " cm"),
        row("focal length, median", "0.3 %", lambda s: f"{number(100 * s.focal, 3)} %"),
        row("court lines, rms, median", "", lambda s: f"{number(s.court_px, 3)} px"),
    ]
    for axis, name in enumerate(AXES):
        lines.append(row(f"within one sigma, {name}", "55 to 80 %", lambda s, a=axis: percent(s.covered[a])))
        lines.append(
            row(
                f"the same by thirds of sigma, {name}",
                "55 to 80 %",
                lambda s, a=axis: ", ".join(percent(v) for v in s.covered_thirds[a]),
            )
        )
    lines += [
        row("focal within one sigma", "", lambda s: percent(s.focal_covered)),
        row("time per frame", "", lambda s: f"{1000 * s.frame_s:.1f} ms"),
        row("processor time per frame", "", lambda s: f"{1000 * s.frame_cpu_s:.1f} ms"),
        row("frames per second", "", lambda s: f"{s.fps:.1f}"),
        row("peak memory", "1500 MB", lambda s: f"{s.memory_mb:.0f} MB"),
    ]
    return "\n".join(lines)


def summary_document(summary: object) -> dict:
    """A dataclass of figures in JSON's types; None for what is not finite."""
    assert is_dataclass(summary) and not isinstance(summary, type)
    return {name: _plain(value) for name, value in asdict(summary).items()}


def percent(share: float) -> str:
    """A share in per cent; a dash for NaN."""
    return f"{100 * share:.1f} %" if np.isfinite(share) else "-"


def number(value: float, places: int) -> str:
    """A number with that many places; a dash for NaN or infinity."""
    return f"{value:.{places}f}" if np.isfinite(value) else "-"


def _median(values: Sequence[float]) -> float:
    # The lower middle: the mean of a number and infinity would tell nothing.
    return float(np.sort(values)[(len(values) - 1) // 2]) if len(values) else float("nan")


def _error(score: ClipScore) -> float:
    return np.inf if score.centre_m is None else score.centre_error_m


def _plain(value):
    if isinstance(value, tuple | list):
        return [_plain(v) for v in value]
    if isinstance(value, dict):
        return {name: _plain(v) for name, v in value.items()}
    return None if isinstance(value, float) and not np.isfinite(value) else value
