"""Jobs of `pgm trade ball3d` on drawn cases: every method and preset on some of them, scored against the truth."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from numpy.linalg import LinAlgError

from pgm_data.ball import no_events
from pgm_data.detect.ball.track_events import find_events
from pgm_data.scene import Scene, load_scene
from pgm_data.stages.ball_lift import LiftedBall, Method, Quality, Surroundings, lift_ball
from pgm_data.stages.trade_ball_bound import bound_of
from pgm_data.stages.trade_ball_cases import BallCase, CaseOptions, draw_case
from pgm_data.stages.trade_ball_score import failed_score, score_events, score_places, score_shots

GIVEN, FOUND = "given", "found"
"""Where events come from: a person, or the search in the track."""
Report = Callable[[dict], None]


@dataclass(frozen=True, kw_only=True)
class Solver:
    """A method with its preset."""

    name: str
    method: Method
    quality: Quality = "standard"


SOLVERS = (
    Solver(name="line", method="line"),
    Solver(name="draft", method="physics", quality="draft"),
    Solver(name="standard", method="physics", quality="standard"),
    Solver(name="best", method="physics", quality="best"),
)


def solver_of(name: str) -> Solver:
    """The solver of that name.

    Raises:
        ValueError: If there is none.
    """
    for solver in SOLVERS:
        if solver.name == name:
            return solver
    raise ValueError(f"solver: expected one of {', '.join(s.name for s in SOLVERS)}, got {name!r}")


def solve_cases(arguments: dict, report: Report) -> dict:
    """Rows of figures of some cases of one setting: one for every case, solver and source of events.

    The first solve of a solver in the process is marked as cold, and its case is solved once more.
    """
    scene = load_scene(arguments["scene"])
    options = CaseOptions(**arguments["options"] | {"size": tuple(arguments["options"]["size"])})
    solvers = [solver_of(name) for name in arguments["solvers"]]
    rows: list[dict] = []
    warm: set[str] = set()
    chosen = [(kind, first + i) for kind, first, count in arguments["cases"] for i in range(count)]
    for done, (kind, number) in enumerate(chosen):
        case = draw_case(kind, number, arguments["seed"], options, scene)
        bound = bound_of(case, scene)
        for solver in solvers:
            for source in arguments["sources"]:
                row = solved_row(case, solver, source, scene, cold=solver.name not in warm)
                warm.add(solver.name)
                if source == FOUND:
                    row["found_2d"] = score_events(case, find_events(case.track, size=options.size))
                rows.append(
                    {
                        "part": "drawn",
                        "setting": arguments["setting"],
                        "kind": case.kind,
                        "number": number,
                        "fps": options.fps,
                        "seconds_long": case.path.end_s,
                        "bound_m": bound.rms_m,
                        "with_priors_m": bound.with_priors_m,
                    }
                    | row
                )
        report({"progress": done + 1, "total": len(chosen)})
    return {"rows": rows}


def solved_row(case: BallCase, solver: Solver, source: str, scene: Scene, *, cold: bool) -> dict:
    """Figures of one solve."""
    assert scene.court is not None
    row: dict = {"solver": solver.name, "events": source, "cold": cold, "again_s": None}
    began = time.perf_counter()
    try:
        lifted = lifted_case(case, solver, source, scene)
    except (ValueError, RuntimeError, ArithmeticError, LinAlgError, IndexError) as error:
        # What is measured is the solver, its faults among the rest.
        return row | {"seconds": time.perf_counter() - began} | failed_score(case, f"{type(error).__name__}: {error}")
    row["seconds"] = time.perf_counter() - began
    if cold:
        began = time.perf_counter()
        lifted_case(case, solver, source, scene)
        row["again_s"] = time.perf_counter() - began
    solution = lifted.solution
    return (
        row
        | score_places(case, solution)
        | {
            "found_events": score_events(case, solution.events),
            "shots": score_shots(case, solution, lifted.in_probability, scene.court),
            "flight_statuses": _counts(solution.flights.status),
            "reason": solution.said,
        }
    )


def lifted_case(case: BallCase, solver: Solver, source: str, scene: Scene) -> LiftedBall:
    """A case through the stage's own lift, with a person's events or without any."""
    around = Surroundings(
        camera=case.camera,
        size=case.options.size,
        doubt=case.doubt,
        players=None,
        marks=case.events if source == GIVEN else no_events(),
    )
    return lift_ball(case.track, around, scene=scene, method=solver.method, quality=solver.quality)


def _counts(words: Sequence[str]) -> dict[str, int]:
    return {word: words.count(word) for word in sorted(set(words))}
