"""`pgm trade players`: every preset on drawn plays, drawn videos and real clips, error against time."""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pgm_data.stages.jobs import JobEvent
from pgm_data.stages.trade_ball_tables import cm, markdown
from pgm_data.stages.trade_players_clips import drawn_jobs, real_jobs, video_jobs
from pgm_data.stages.trade_plot import Dot, Panel, plot_svg
from pgm_data.stages.trade_run import TradeManner, TradeRun, run_parts, write_text
from pgm_data.stages.trade_summary import dominance_lines, number, percent

TIMEOUT_S = 3600.0
"""Of one job."""


@dataclass(frozen=True, eq=False, kw_only=True)
class PlayersTradeOptions:
    """What is measured on what."""

    out: Path
    """Folder of the results."""
    state_dir: Path
    """Folder of the jobs' state and of temporary files."""
    qualities: tuple[str, ...] = ("draft", "standard", "best")
    plays: int = 12
    """Drawn matches without pictures, through registration alone."""
    frames: int = 300
    """Of each of them."""
    noise_px: float = 2.0
    """Of their points, at 1920x1080."""
    data: Path | None = None
    """Folder that `pgm simulate` wrote, with pictures."""
    real: Path | None = None
    """Work folder of real clips, calibrated."""
    seed: int = 0
    workers: int = 1
    resume: bool = False


def run_players_trade(
    options: PlayersTradeOptions, *, on_event: Callable[[JobEvent], None], on_jobs: Callable[[int], None]
) -> TradeRun:
    """Run every preset; writes `trade.md`, `trade.svg`, `trade.json` and `rows.jsonl`, anew after each part of the run.

    Args:
        options: What is measured on what.
        on_event: Told what happens to jobs.
        on_jobs: Told how many jobs there are, before each part of the run.

    Raises:
        ValueError: If the data are not what they must be.
    """
    parts = [
        drawn_jobs(
            options.plays,
            options.qualities,
            seed=options.seed,
            noise_px=options.noise_px,
            frames=options.frames,
            scratch=options.state_dir / "scratch",
        )
    ]
    if options.data is not None:
        parts.append(video_jobs(options.data, options.qualities))
    if options.real is not None:
        parts.append(real_jobs(options.real, options.qualities))
    return run_parts(
        parts,
        manner=TradeManner(
            state_dir=options.state_dir, workers=options.workers, resume=options.resume, timeout_s=TIMEOUT_S
        ),
        write=lambda rows: write_figures(options.out, rows, options.qualities),
        on_event=on_event,
        on_jobs=on_jobs,
    )


def write_figures(out: Path, rows: Sequence[dict], qualities: Sequence[str]) -> str:
    """Write the figures of those rows into a folder; all tables in Markdown."""
    parts = ["# The players in metres: error against time"]
    panels: list[Panel] = []
    conclusions: list[str] = []
    for part, title in (
        ("drawn", "## Drawn plays, registration alone: true boxes, true points with noise"),
        ("videos", "## Drawn videos, from pictures to metres through the true cameras"),
    ):
        own = [row for row in rows if row["part"] == part]
        groups = _groups(own, qualities)
        if not groups:
            continue
        parts += [title, _errors_table(groups, part)]
        for player in dict.fromkeys(key[0] for key in groups):
            of = {quality: groups[player, quality] for quality in qualities if (player, quality) in groups}
            seconds = [_seconds(found) for found in of.values()]
            errors = [_pooled(found, "root_rms_m") for found in of.values()]
            dots = tuple(
                Dot(name=name, time=1000 * time, error=100 * error)
                for name, time, error in zip(of, seconds, errors, strict=True)
            )
            panels.append(
                Panel(title=f"{player}, {part}", time_unit="ms a frame, both players", error_unit="root, cm", dots=dots)
            )
            conclusions += dominance_lines(list(of), seconds, {f"root of {player}, {part}": errors})
    real = _groups([row for row in rows if row["part"] == "real"], qualities, key="clip")
    if real:
        parts += ["## Real clips", _real_table(real)]
    if conclusions:
        parts.append("\n".join(f"- {line}" for line in conclusions))
    table = "\n\n".join(parts)
    document = {"rows": len(rows), "conclusions": conclusions}
    write_text(out / "rows.jsonl", "".join(json.dumps(row, allow_nan=False) + "\n" for row in rows))
    write_text(out / "trade.json", json.dumps(document | {"table": table}, indent=1, allow_nan=False) + "\n")
    write_text(out / "trade.md", table + "\n")
    write_text(out / "trade.svg", plot_svg(panels))
    return table


def _groups(rows: Sequence[dict], qualities: Sequence[str], key: str = "player") -> dict[tuple[str, str], list[dict]]:
    """Rows by player or clip and preset, presets in their order."""
    names = sorted({row[key] for row in rows})
    groups = {(n, q): [row for row in rows if row[key] == n and row["quality"] == q] for n in names for q in qualities}
    return {at: found for at, found in groups.items() if found}


def _errors_table(groups: dict[tuple[str, str], list[dict]], part: str) -> str:
    head = [
        "player", "preset", "clips", "placed", "somebody else", "root rms, cm", "median", "x, y, z rms",
        "in one sigma x, y, z", "joints, cm", "pose, cm", "foot in stance rms / p95, cm", "slide, cm", "jump rms, cm",
        "contact right", "ms a frame",
    ]  # fmt: skip
    if part == "videos":
        head += ["boxes right", "boxes wrong"]
    lines = []
    for (player, quality), rows in groups.items():
        placed = sum(row["placed"] for row in rows)
        axes = [
            cm(float(np.sqrt(np.mean([row["root_axes_rms_m"][axis] ** 2 for row in rows if row["placed"]]))))
            for axis in range(3)
        ] if placed else ["-"] * 3  # fmt: skip
        covered = [
            percent(_mean([row["covered"][axis] for row in rows if row["covered"][axis] is not None]))
            for axis in range(3)
        ]
        stance = f"{cm(_pooled(rows, 'stance_rms_m'))} / {cm(_middle(rows, 'stance_p95_m'))}"
        line = [
            player, quality, str(len(rows)), percent(placed / max(sum(row["there"] for row in rows), 1)),
            str(sum(row["wrong"] for row in rows)), cm(_pooled(rows, "root_rms_m")), cm(_middle(rows, "root_median_m")),
            ", ".join(axes), ", ".join(covered), cm(_middle(rows, "joints_m")), cm(_middle(rows, "pose_m")), stance,
            cm(_middle(rows, "slide_m")), f"{cm(_pooled(rows, 'jump_rms_m'))} ({sum(row['jumps'] for row in rows)})",
            percent(_middle(rows, "contact_right")), number(1000 * _seconds(rows), 1),
        ]  # fmt: skip
        if part == "videos":
            boxes = max(sum(row["boxes"] for row in rows), 1)
            line += [percent(sum(row[name] for row in rows) / boxes) for name in ("boxes_right", "boxes_wrong")]
        lines.append(line)
    return markdown(head, lines)


def _real_table(groups: dict[tuple[str, str], list[dict]]) -> str:
    head = [
        "clip", "preset", "frames with a camera", "seen, each player", "placed", "mean distance of points, px at 1080p",
        "stated place, cm", "frames a second",
    ]  # fmt: skip
    lines = []
    for (clip, quality), rows in groups.items():
        cameras = max(rows[0]["with_camera"], 1)
        seconds = rows[0]["find_s"] + rows[0]["pose_s"] + rows[0]["lift_s"]
        lines.append(
            [
                clip, quality, str(rows[0]["with_camera"]), ", ".join(percent(row["seen"] / cameras) for row in rows),
                ", ".join(percent(row["placed"] / cameras) for row in rows),
                ", ".join(number(_or_nan(row["reprojection_1080_px"]), 1) for row in rows),
                ", ".join(cm(_or_nan(row["stated_m"])) for row in rows),
                number(rows[0]["frames"] / seconds if seconds > 0 else float("nan"), 1),
            ]
        )  # fmt: skip
    return markdown(head, lines)


def _seconds(rows: Sequence[dict]) -> float:
    """Of all players, a frame of the clip."""
    total = sum(row["lift_s"] + row.get("find_s", 0.0) + row.get("pose_s", 0.0) for row in rows)
    return total / max(sum(row["clip_frames"] for row in rows), 1)


def _pooled(rows: Sequence[dict], name: str) -> float:
    """Root of the mean square over clips."""
    values = [row[name] for row in rows if row[name] is not None]
    return float(np.sqrt(np.mean(np.square(values)))) if values else float("nan")


def _middle(rows: Sequence[dict], name: str) -> float:
    values = [row[name] for row in rows if row[name] is not None]
    return float(np.median(values)) if values else float("nan")


def _mean(values: Sequence[float]) -> float:
    return float(np.mean(values)) if values else float("nan")


def _or_nan(value: float | None) -> float:
    return float("nan") if value is None else value
