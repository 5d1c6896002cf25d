"""What the rows of a trade of the ball in metres say together, by setting, kind, solver and source of events."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from pgm_data.stages.trade_ball_score import brier, f1_of
from pgm_data.stages.trade_score import coverage, coverage_by_thirds

BASE = "base"
"""Name of the setting that the bars are for."""
ALL = "all shots"
"""Name of the single shots of every kind together."""
BARS_CM = {
    "physics": {"serve": 14.0, "forehand_near": 9.0, "forehand_far": 11.0, "slice": 12.0, "lob": 10.0, "rally": 35.0},
    "line": {"serve": 22.0, "forehand_near": 16.0, "forehand_far": 15.0, "slice": 16.0, "lob": 35.0},
}
"""Median over shots of the rms over frames that is wanted."""
BOUND_BAR = 1.3
"""Error over the bound that is reached for."""
SHOT_BAR_S, RALLY_BAR_S = 0.3, 5.0
EVENTS_BAR = 0.85


@dataclass(frozen=True, eq=False, kw_only=True)
class Coverage:
    """Shares of frames within one stated deviation, x, y, z."""

    cases: int
    overall: tuple[float, float, float]
    thirds: tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]]
    """By axis, in each third of the stated deviation, smallest first."""


@dataclass(frozen=True, eq=False, kw_only=True)
class EventFigures:
    """Hits and bounces that were found against the true ones."""

    f1_hit: float
    f1_bounce: float
    f1_kinds: float
    """Both, each of the right kind."""
    f1_any: float
    """Both, whatever the kind."""
    time_median_s: float
    """Median absolute error of the matched ones."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Group:
    """Cases of one setting and kind through one solver. Failed ones count as infinitely wrong in the medians."""

    setting: str
    kind: str
    solver: str
    events: str
    """`given` or `found`."""
    cases: int
    failed: int
    error_m: float
    """Median over cases of the rms over frames."""
    error_p90_m: float
    bound_m: float
    """Median of the bound."""
    with_priors: float
    """Root of the mean square of what the best estimate with the scene's priors has in these very cases, over the
    bound: what `over_bound` can be at best."""
    over_bound: float
    """Root of the mean square of error over bound, failed cases apart; 1 for the best there can be."""
    stated_m: float
    """Median of what the solver states."""
    speed_error: float
    """Median absolute error of the speed at hits, as a share."""
    speed_covered: float
    """Share of speeds within one stated deviation."""
    landing_m: float
    """Median error of landings."""
    brier: float
    """Of the probability to land in; 0.25 is what a coin says."""
    in_share: float
    """Of those shots that landed in."""
    residual_px: float
    seconds: float
    """Median, of cold ones the second time."""
    seconds_p90: float
    cold_s: float
    """Median of the first solve in a process."""
    again_s: float
    """Median of the same case solved once more."""
    coverage: Coverage
    found: EventFigures
    """After the solver has moved and dropped some."""
    found_2d: EventFigures
    """As the search in the track gives them, without the camera; of found ones alone."""


def groups_of(rows: Sequence[dict]) -> tuple[Group, ...]:
    """One group for every setting, kind, solver and source of events among drawn cases, in the order of the rows.

    Single shots of the base setting are also put together.
    """
    keys: dict[tuple[str, str, str, str], list[dict]] = {}
    for row in rows:
        if row["part"] != "drawn":
            continue
        own = (row["setting"], row["solver"], row["events"])
        keys.setdefault((own[0], row["kind"], *own[1:]), []).append(row)
        if row["kind"] != "rally":
            keys.setdefault((own[0], ALL, *own[1:]), []).append(row)
    return tuple(_group(key, found) for key, found in keys.items())


def pick(groups: Iterable[Group], **wanted: str) -> Group | None:
    """The group with those names; None where there is none."""
    return next((g for g in groups if all(getattr(g, name) == value for name, value in wanted.items())), None)


def _group(key: tuple[str, str, str, str], rows: Sequence[dict]) -> Group:
    setting, kind, solver, events = key
    good = [row for row in rows if not row["failed"]]
    errors = np.array([np.inf if row["failed"] else row["rms_m"] for row in rows])
    bounds = np.array([row["bound_m"] for row in rows])
    ratios = np.array([row["rms_m"] / row["bound_m"] for row in good])
    shots = [shot for row in good for shot in row["shots"] if shot["found"]]
    speeds = _known(shots, "speed_error")
    sigmas = [shot for shot in shots if shot["speed_error"] is not None and shot["speed_sigma"] is not None]
    judged = [shot for shot in shots if shot.get("in_probability") is not None]
    later = [row["again_s"] if row["cold"] else row["seconds"] for row in rows]
    later = [seconds for seconds in later if seconds is not None]
    return Group(
        setting=setting,
        kind=kind,
        solver=solver,
        events=events,
        cases=len(rows),
        failed=len(rows) - len(good),
        error_m=lower_median(errors),
        error_p90_m=lower_quantile(errors, 0.9),
        bound_m=lower_median(bounds),
        with_priors=float(np.sqrt(((_known(rows, "with_priors_m") / bounds) ** 2).mean())),
        over_bound=float(np.sqrt((ratios**2).mean())) if len(ratios) else float("nan"),
        stated_m=lower_median(_known(good, "stated_m")),
        speed_error=lower_median(np.abs(speeds)),
        speed_covered=coverage(_known(sigmas, "speed_error"), _known(sigmas, "speed_sigma")),
        landing_m=lower_median(_known(shots, "landing_m")),
        brier=brier([shot["in_probability"] for shot in judged], [shot["in"] for shot in judged]),
        in_share=float(np.mean([shot["in"] for shot in judged])) if judged else float("nan"),
        residual_px=lower_median(_known(good, "residual_px")),
        seconds=lower_median(np.array(later)),
        seconds_p90=lower_quantile(np.array(later), 0.9),
        cold_s=lower_median(np.array([row["seconds"] for row in rows if row["cold"]])),
        again_s=lower_median(_known(rows, "again_s")),
        coverage=_coverage(good),
        found=event_figures([row["found_events"] for row in good]),
        found_2d=event_figures([row["found_2d"] for row in rows if "found_2d" in row]),
    )


def _coverage(rows: Sequence[dict]) -> Coverage:
    errors = np.array([e for row in rows for e in row["errors_m"]], dtype=float).reshape(-1, 3)
    sigmas = np.array([s for row in rows for s in row["sigmas_m"]], dtype=float).reshape(-1, 3)
    overall = [coverage(errors[:, axis], sigmas[:, axis]) for axis in range(3)]
    thirds = [coverage_by_thirds(errors[:, axis], sigmas[:, axis]) for axis in range(3)]
    return Coverage(
        cases=len(rows),
        overall=(overall[0], overall[1], overall[2]),
        thirds=(thirds[0], thirds[1], thirds[2]),
    )


def event_figures(counts: Sequence[dict]) -> EventFigures:
    """The figures of several cases together, each counted by `score_events`."""

    def f1(name: str) -> float:
        total = {part: sum(c[name][part] for c in counts) for part in ("true", "found", "matched")}
        return f1_of(total["true"], total["found"], total["matched"])

    errors = np.array([e for c in counts for e in c["kinds"]["errors_s"]], dtype=float)
    return EventFigures(
        f1_hit=f1("hit"),
        f1_bounce=f1("bounce"),
        f1_kinds=f1("kinds"),
        f1_any=f1("any"),
        time_median_s=lower_median(np.abs(errors)),
    )


def lower_median(values: np.ndarray) -> float:
    """The lower middle: the mean of a number and infinity would tell nothing; NaN where there are none."""
    return lower_quantile(values, 0.5)


def lower_quantile(values: np.ndarray, share: float) -> float:
    """The value at or below which that share lies; NaN where there are none."""
    if not len(values):
        return float("nan")
    return float(np.sort(values)[min(max(int(np.ceil(share * len(values))) - 1, 0), len(values) - 1)])


def _known(rows: Sequence[dict], name: str) -> np.ndarray:
    return np.array([row[name] for row in rows if row.get(name) is not None], dtype=float)
