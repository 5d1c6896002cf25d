"""Tables and plot of a trade of the ball in metres, on drawn shots and rallies."""

from collections.abc import Callable, Sequence

import numpy as np

from pgm_data.stages.trade_ball_cases import CASE_KINDS
from pgm_data.stages.trade_ball_summary import (
    ALL,
    BARS_CM,
    BASE,
    BOUND_BAR,
    EVENTS_BAR,
    RALLY_BAR_S,
    SHOT_BAR_S,
    Group,
    pick,
)
from pgm_data.stages.trade_plot import Dot, Panel
from pgm_data.stages.trade_summary import number, percent

AXES = ("x", "y", "z")


def drawn_tables(groups: Sequence[Group], solvers: Sequence[str]) -> list[str]:
    """All tables of drawn cases, in Markdown."""
    base = [g for g in groups if g.setting == BASE]
    parts = []
    for events, said in (("given", "Contacts given by a person"), ("found", "Contacts found in the track")):
        own = [g for g in base if g.events == events]
        if own:
            parts += [f"## {said}", error_table(own, solvers), figures_table(own, solvers)]
    covered = [g for g in base if g.events == "given" and g.kind in (ALL, "rally")]
    if covered:
        parts += ["## Stated deviations", coverage_table(covered)]
    found = [g for g in base if g.events == "found" and g.kind == "rally"]
    if found:
        parts += ["## Contacts found in rallies", events_table(found)]
    swept = [g for g in groups if g.kind in (ALL, "rally") and g.events == "given"]
    if any(g.setting != BASE for g in swept):
        parts += ["## By setting", sweep_table(swept, solvers)]
    return parts


def error_table(groups: Sequence[Group], solvers: Sequence[str]) -> str:
    """Median error of every kind beside its bar and bound, cm."""
    head = ["kind", "cases", "bound, cm", "over bound with the scene's priors"]
    for solver in solvers:
        head += [f"{solver}, cm (wanted)", "p90", "failed", f"over bound ({BOUND_BAR})"]
    rows = []
    for kind in (*CASE_KINDS, ALL):
        own = [pick(groups, kind=kind, solver=solver) for solver in solvers]
        some = next((g for g in own if g is not None), None)
        if some is None:
            continue
        row = [kind.replace("_", " "), str(some.cases), cm(some.bound_m), number(some.with_priors, 2)]
        for solver, group in zip(solvers, own, strict=True):
            if group is None:
                row += ["-"] * 4
                continue
            bar = BARS_CM["line" if solver == "line" else "physics"].get(kind)
            wanted = f" ({bar:g})" if bar else ""
            row += [cm(group.error_m) + wanted, cm(group.error_p90_m), str(group.failed), number(group.over_bound, 2)]
        rows.append(row)
    return markdown(head, rows)


def figures_table(groups: Sequence[Group], solvers: Sequence[str]) -> str:
    """Speeds, landings, residuals and seconds: rows of figures, a column per solver, for shots and for rallies."""
    columns = [
        (kind, solver, group)
        for kind in (ALL, "rally")
        for solver in solvers
        if (group := pick(groups, kind=kind, solver=solver)) is not None
    ]

    def row(name: str, cell: Callable[[Group], str]) -> list[str]:
        return [name, *(cell(group) for _, _, group in columns)]

    head = ["figure (median)", *(f"{'shots' if kind == ALL else 'rallies'}, {solver}" for kind, solver, _ in columns)]
    return markdown(
        head,
        [
            row("speed at hits", lambda g: percent(g.speed_error)),
            row("speeds within one sigma", lambda g: percent(g.speed_covered)),
            row("landing, cm", lambda g: cm(g.landing_m)),
            row("Brier score of in or out", lambda g: number(g.brier, 3)),
            row("shots that were in", lambda g: percent(g.in_share)),
            row("residual, px", lambda g: number(g.residual_px, 2)),
            row(f"seconds (shot {SHOT_BAR_S:g}, rally {RALLY_BAR_S:g})", lambda g: number(g.seconds, 3)),
            row("seconds, p90", lambda g: number(g.seconds_p90, 3)),
            row("seconds of the first in a process", lambda g: number(g.cold_s, 3)),
            row("seconds of the same once more", lambda g: number(g.again_s, 3)),
        ],
    )


def coverage_table(groups: Sequence[Group]) -> str:
    """Shares of frames within one stated deviation, by axis and third of the deviation."""
    head = ["solver", "of", "cases", *(f"{axis}, thirds of sigma (55 to 80 %)" for axis in AXES), "overall x, y, z"]
    rows = []
    for group in groups:
        c = group.coverage
        thirds = [", ".join(f"{number(100 * v, 0)}" for v in axis) for axis in c.thirds]
        overall = ", ".join(number(100 * v, 0) for v in c.overall)
        rows.append([group.solver, "shots" if group.kind == ALL else "rallies", str(c.cases), *thirds, overall])
    return markdown(head, rows)


def events_table(groups: Sequence[Group]) -> str:
    """F1 of contacts within two frames, after the solver has moved and dropped some, and in 2D before."""
    head = [
        "solver",
        "both F1 in 2D",
        "hits F1",
        "bounces F1",
        f"both F1 ({EVENTS_BAR})",
        "kind apart F1",
        "time error, ms",
    ]
    return markdown(
        head,
        [
            [
                g.solver,
                number(g.found_2d.f1_kinds, 3),
                number(g.found.f1_hit, 3),
                number(g.found.f1_bounce, 3),
                number(g.found.f1_kinds, 3),
                number(g.found.f1_any, 3),
                number(1000 * g.found.time_median_s, 1),
            ]
            for g in groups
        ],
    )


def sweep_table(groups: Sequence[Group], solvers: Sequence[str]) -> str:
    """Median error, error over bound and failures by setting, cm."""
    head = ["setting", "of", "cases", "bound, cm"]
    for solver in solvers:
        head += [f"{solver}, cm", "over bound", "failed"]
    rows = []
    for setting in dict.fromkeys(g.setting for g in groups):
        for kind in (ALL, "rally"):
            own = [pick(groups, setting=setting, kind=kind, solver=solver) for solver in solvers]
            some = next((g for g in own if g is not None), None)
            if some is None:
                continue
            row = [setting, "shots" if kind == ALL else "rallies", str(some.cases), cm(some.bound_m)]
            for group in own:
                if group is None:
                    row += ["-"] * 3
                else:
                    row += [cm(group.error_m), number(group.over_bound, 2), str(group.failed)]
            rows.append(row)
    return markdown(head, rows)


def drawn_panels(groups: Sequence[Group], solvers: Sequence[str]) -> list[Panel]:
    """Error against seconds, one panel a kind, a dot a solver."""
    panels = []
    for kind in CASE_KINDS:
        own = [pick(groups, setting=BASE, events="given", kind=kind, solver=solver) for solver in solvers]
        dots = tuple(Dot(name=g.solver, time=g.seconds, error=100 * g.error_m) for g in own if g is not None)
        if dots:
            title = f"{kind.replace('_', ' ')}, contacts given"
            panels.append(Panel(title=title, time_unit="s", error_unit="cm, rms, median", dots=dots))
    return panels


def cm(metres: float) -> str:
    """Centimetres with one place; `none` where more than half failed, a dash where there is nothing."""
    return "none" if np.isposinf(metres) else number(100 * metres, 1)


def markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table."""
    lines = ["| " + " | ".join(head) + " |", "| " + " | ".join("---" for _ in head) + " |"]
    return "\n".join(lines + ["| " + " | ".join(row) + " |" for row in rows])
