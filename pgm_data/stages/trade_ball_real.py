"""What of `pgm trade ball3d` is real: which jobs a folder of real data makes, and their tables."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pgm_data.stages.jobs import Job
from pgm_data.stages.trade_ball_summary import EventFigures, event_figures, lower_median, lower_quantile
from pgm_data.stages.trade_ball_tables import cm, markdown
from pgm_data.stages.trade_plot import Dot, Panel
from pgm_data.stages.trade_score import coverage
from pgm_data.stages.trade_summary import number, percent, summary_document

TABLE = "pgm_data.stages.trade_ball_tracks:table_tennis"
EVENTS = "pgm_data.stages.trade_ball_tracks:rally_events"
SHOTS = "pgm_data.stages.trade_ball_tracks:shot_times"
RALLY = "pgm_data.stages.trade_ball_rally:real_rally"
VIEWS = ("back", "oblique", "side")
VIEW_BARS_CM = {"back": 20.0, "oblique": 10.0, "side": 7.0}
"""Median over trajectories of the mean error that is wanted."""


@dataclass(frozen=True, eq=False, kw_only=True)
class RealData:
    """Real tracks and clips."""

    folder: Path
    """Holds ball/tabletennis_3d, ball/rolandgarros_2d_events, ball/tennis_shots_example.csv and
    tennis/miami_rally_720p50.*, or some of them."""
    pixels: bool
    """Whether the ball of the rally is also found in its video."""
    scratch: Path
    """Folder for temporary files."""


def real_jobs(data: RealData, solvers: Sequence[str]) -> list[Job]:
    """One job for each part of the data that is there.

    Raises:
        ValueError: If there is none.
    """
    ball, tennis = (data.folder / name for name in ("ball", "tennis"))
    table, labelled, shots = ball / "tabletennis_3d", ball / "rolandgarros_2d_events", ball / "tennis_shots_example.csv"
    jobs = [
        _job(f"table tennis, {view}, {solver}", TABLE, {"folder": table, "view": view, "solver": solver})
        for view in VIEWS
        if (table / view).is_dir()
        for solver in solvers
    ]
    if labelled.is_dir():
        jobs.append(_job("labelled tracks", EVENTS, {"folder": labelled}))
    if shots.is_file():
        jobs.append(_job("measured shots", SHOTS, {"file": shots}))
    rally = {
        "video": tennis / "miami_rally_720p50.mp4",
        "track": tennis / "miami_rally_720p50.ball_2d.csv",
        "events": tennis / "miami_rally_720p50.events.json",
    }
    if all(path.is_file() for path in rally.values()):
        own = {"solvers": list(solvers), "pixels": data.pixels, "scratch": data.scratch}
        jobs.append(_job("rally", RALLY, rally | own))
    if not jobs:
        raise ValueError(f"{data.folder}: expected ball/ and tennis/ with real tracks, got none")
    return jobs


def _job(name: str, entry: str, arguments: dict) -> Job:
    plain = {key: str(value.resolve()) if isinstance(value, Path) else value for key, value in arguments.items()}
    return Job(name=name, stage="trade", entry=entry, arguments=plain)


@dataclass(frozen=True, eq=False, kw_only=True)
class ViewFigures:
    """One view of the table tennis through one solver."""

    view: str
    solver: str
    trajectories: int
    failed: int
    median_m: float
    """Of the mean errors; failed ones count as infinite, here and below."""
    mean_m: float
    """Without the failed ones."""
    p90_m: float
    covered: tuple[float, float, float]
    """Share of frames within one stated deviation, x, y, z."""
    seconds: float
    """Median of all but the first."""


def view_figures(rows: Sequence[dict]) -> tuple[ViewFigures, ...]:
    """Figures by view and solver."""
    keys: dict[tuple[str, str], list[dict]] = {}
    for row in rows:
        if row["part"] == "tabletennis":
            keys.setdefault((row["view"], row["solver"]), []).append(row)
    figures = []
    for (view, solver), own in keys.items():
        means = np.array([np.inf if row["failed"] else row["mean_m"] for row in own])
        good = [row for row in own if not row["failed"]]
        errors = np.array([e for row in good for e in row["errors_m"]], dtype=float).reshape(-1, 3)
        sigmas = np.array([s for row in good for s in row["sigmas_m"]], dtype=float).reshape(-1, 3)
        x, y, z = (coverage(errors[:, axis], sigmas[:, axis]) for axis in range(3))
        figures.append(
            ViewFigures(
                view=view,
                solver=solver,
                trajectories=len(own),
                failed=len(own) - len(good),
                median_m=lower_median(means),
                mean_m=float(means[np.isfinite(means)].mean()) if good else float("nan"),
                p90_m=lower_quantile(means, 0.9),
                covered=(x, y, z),
                seconds=lower_median(np.array([row["seconds"] for row in own if not row["cold"]])),
            )
        )
    return tuple(figures)


def labelled_figures(rows: Sequence[dict]) -> dict[str, EventFigures]:
    """Figures of the labelled 2D tracks: those to tune on, and the others."""
    own = [row for row in rows if row["part"] == "rolandgarros"]
    parts = {"tuning": [r for r in own if r["tuning"]], "held out": [r for r in own if not r["tuning"]]}
    return {name: event_figures([r["found_events"] for r in part]) for name, part in parts.items() if part}


def real_tables(rows: Sequence[dict]) -> list[str]:
    """All tables of real data, in Markdown."""
    parts = []
    views = view_figures(rows)
    if views:
        parts += ["## Real table tennis, 3D truth, contacts found", view_table(views)]
    labelled = labelled_figures(rows)
    if labelled:
        parts += ["## Labelled 2D tracks, no camera", labelled_table(labelled)]
    rally = [row for row in rows if row["part"] == "rally"]
    if rally:
        parts += ["## Real rally", rally_table(rally)]
    for row in rows:
        if row["part"] == "shots" and row["time_ratio"] is not None:
            low, middle, high = row["time_ratio"]
            parts.append(
                f"Measured ground strokes: {row['shots']} that bounced in, flown with the scene's mean drag, lift and "
                f"bounce from the measured place, speed and spin to the measured bounce, take {middle:.3f} of the "
                f"measured time to the next hit (quartiles {low:.3f} and {high:.3f}), and are "
                f"{100 * row['height_m']:.0f} cm higher there (median)."
            )
    return parts


def view_table(views: Sequence[ViewFigures]) -> str:
    """Mean error per trajectory by view and solver."""
    head = ["view", "solver", "trajectories", "failed (1)", "median, cm (wanted)", "mean, cm", "p90, cm"]
    head += ["within one sigma x, y, z", "seconds"]
    return markdown(
        head,
        [
            [
                v.view,
                v.solver,
                str(v.trajectories),
                str(v.failed),
                f"{cm(v.median_m)} ({VIEW_BARS_CM[v.view]:g})",
                cm(v.mean_m),
                cm(v.p90_m),
                ", ".join(number(100 * share, 0) for share in v.covered) + " %",
                number(v.seconds, 3),
            ]
            for v in views
        ],
    )


def labelled_table(figures: dict[str, EventFigures]) -> str:
    """F1 within two frames."""
    wanted = {"tuning": "", "held out": " (0.75)"}
    return markdown(
        ["tracks", "hits F1", "bounces F1", "both F1", "kind apart F1", "time error, ms"],
        [
            [
                name,
                number(f.f1_hit, 3),
                number(f.f1_bounce, 3),
                number(f.f1_kinds, 3) + wanted[name],
                number(f.f1_any, 3),
                number(1000 * f.time_median_s, 1),
            ]
            for name, f in figures.items()
        ],
    )


def rally_table(rows: Sequence[dict]) -> str:
    """A column for every solver and source of the rally's track."""
    head = ["rally", "wanted", *(f"{row['solver']}, from {row['from']}" for row in rows)]

    def line(name: str, wanted: str, cell: Callable[[dict], str]) -> list[str]:
        return [name, wanted, *("failed" if row["failed"] else cell(row) for row in rows)]

    def f1(row: dict, name: str, where: str = "found_events") -> str:
        return number(getattr(event_figures([row[where]]), name), 3)

    def share(row: dict, name: str) -> str:
        return percent(row[name]) if name in row else "-"

    return markdown(
        head,
        [
            line("2D recall within 6 px", "85 %", lambda r: share(r, "recall")),
            line("2D precision", "90 %", lambda r: share(r, "precision")),
            line("hits and bounces F1, in 2D", "", lambda r: f1(r, "f1_kinds", "found_2d")),
            line("hits and bounces F1", "0.8", lambda r: f1(r, "f1_kinds")),
            line("hits F1", "", lambda r: f1(r, "f1_hit")),
            line("bounces F1", "", lambda r: f1(r, "f1_bounce")),
            line("kind apart F1", "", lambda r: f1(r, "f1_any")),
            line("shots that cross the net above it", "all", lambda r: f"{r['over_net']} of {r['shots']}"),
            line(
                "bounces on the ground in or near the court", "all", lambda r: f"{r['bounces_right']} of {r['bounces']}"
            ),
            line("speeds of 15 to 60 m/s", "all", lambda r: f"{r['speeds_right']} of {r['shots']}"),
            line("frames placed", "", lambda r: percent(r["placed"])),
            line("residual, px", "", lambda r: "-" if r["residual_px"] is None else number(r["residual_px"], 2)),
            line(
                "frames/s of detection",
                "",
                lambda r: number(r["frames"] / r["detect_s"], 1) if "detect_s" in r else "-",
            ),
            line("seconds to place", "5", lambda r: number(r["seconds"], 2)),
        ],
    )


def real_document(rows: Sequence[dict]) -> dict:
    """The same as JSON."""
    return {
        "table_tennis": [summary_document(v) for v in view_figures(rows)],
        "labelled_tracks": {name: summary_document(f) for name, f in labelled_figures(rows).items()},
        "rally": [row for row in rows if row["part"] == "rally"],
        "shots": [row for row in rows if row["part"] == "shots"],
    }


def real_panels(rows: Sequence[dict]) -> list[Panel]:
    """Error against seconds on table tennis, one panel a view."""
    panels = []
    for view in VIEWS:
        own = [v for v in view_figures(rows) if v.view == view]
        dots = tuple(Dot(name=v.solver, time=v.seconds, error=100 * v.median_m) for v in own)
        if dots:
            title = f"real table tennis, {view}"
            panels.append(Panel(title=title, time_unit="s", error_unit="cm, mean, median", dots=dots))
    return panels
