"""How far a solved ball is from the true one: places, stated deviations, contacts, speeds, landings; as JSON keeps it.

A solve FAILS when it raised an error, when it places less than half of the frames, or when those that it places are
more than a metre off (rms). Failures count as infinitely wrong in medians.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Shaped

from pgm_data.ball import BallEvents
from pgm_data.court import Court
from pgm_data.lift.ball.solution import BallSolution
from pgm_data.stages.trade_ball_cases import BallCase
from pgm_data.stages.trade_ball_shots import TruePath

FAILED_M = 1.0
PLACED_SHARE = 0.5
WITHIN_FRAMES = 2.0
"""Events farther than this from every true one of their kind are wrong."""
SAMPLES = 12
"""Frames of a case that are kept for the coverage of stated deviations."""
SERVE_M = 2.0
"""A first hit above this height is a serve."""


@dataclass(frozen=True, kw_only=True)
class Matched:
    """Events against the true ones, for one kind or for any."""

    true: int
    found: int
    matched: int
    errors_s: tuple[float, ...]
    """Found less true time of the matched ones."""

    @property
    def f1(self) -> float:
        """Harmonic mean of precision and recall; NaN where there is nothing."""
        return f1_of(self.true, self.found, self.matched)


def f1_of(true: int, found: int, matched: int) -> float:
    """Harmonic mean of precision and recall; NaN where there is neither a true nor a found one."""
    return 2 * matched / (true + found) if true + found else float("nan")


def matched_times(
    true: Float[np.ndarray, " true"], found: Float[np.ndarray, " found"], within: float
) -> list[tuple[int, int]]:
    """Pairs (true, found) no farther apart than `within`, each used once: as many as can be, then the nearest."""
    if not len(true) or not len(found):
        return []
    from scipy.optimize import linear_sum_assignment

    apart = np.abs(true[:, None] - found[None])
    far = apart > within * (1 + 1e-9)
    rows, columns = linear_sum_assignment(np.where(far, 1e6, apart / max(within, 1e-12)))
    return [(int(i), int(j)) for i, j in zip(rows, columns, strict=True) if not far[i, j]]


def match_events(
    true_times: Float[np.ndarray, " true"],
    true_kinds: Shaped[np.ndarray, " true"],
    found_times: Float[np.ndarray, " found"],
    found_kinds: Shaped[np.ndarray, " found"],
    within: float,
) -> dict[str, Matched]:
    """Hits, bounces, both kinds together with the right kind (`kinds`), and whatever the kind (`any`)."""
    result = {}
    for name in ("hit", "bounce"):
        true, found = true_times[true_kinds == name], found_times[found_kinds == name]
        pairs = matched_times(true, found, within)
        errors = tuple(float(found[j] - true[i]) for i, j in pairs)
        result[name] = Matched(true=len(true), found=len(found), matched=len(pairs), errors_s=errors)
    both = [result["hit"], result["bounce"]]
    result["kinds"] = Matched(
        true=sum(m.true for m in both),
        found=sum(m.found for m in both),
        matched=sum(m.matched for m in both),
        errors_s=tuple(error for m in both for error in m.errors_s),
    )
    true = true_times[np.isin(true_kinds.astype(str), ("hit", "bounce"))]
    found = found_times[np.isin(found_kinds.astype(str), ("hit", "bounce"))]
    pairs = matched_times(true, found, within)
    errors = tuple(float(found[j] - true[i]) for i, j in pairs)
    result["any"] = Matched(true=len(true), found=len(found), matched=len(pairs), errors_s=errors)
    return result


def score_places(case: BallCase, solution: BallSolution) -> dict:
    """Errors of the scored frames, metres, and a few of them beside their stated deviations."""
    placed = np.asarray(case.scored & (solution.status != "none"), dtype=bool)
    scored, found = int(case.scored.sum()), int(placed.sum())
    error = solution.position[placed] - case.position[placed]
    speed = solution.velocity[placed] - case.velocity[placed]
    toss = np.asarray(case.inside & ~case.scored & ~case.track.is_duplicate & (solution.status != "none"), dtype=bool)
    rms = _rms(error)
    chosen = np.unique(np.linspace(0, found - 1, min(SAMPLES, found)).round().astype(int)) if found else []
    sigma = np.sqrt(np.maximum(np.diagonal(solution.position_cov[placed], axis1=1, axis2=2), 0.0))
    return {
        "frames": scored,
        "placed": found,
        "failed": found < PLACED_SHARE * scored or not rms <= FAILED_M,
        "rms_m": rms if found else None,
        "axes_m": [float(v) for v in np.sqrt((error**2).mean(axis=0))] if found else None,
        "mean_m": float(np.linalg.norm(error, axis=1).mean()) if found else None,
        "stated_m": float(np.sqrt((sigma**2).sum(axis=1).mean())) if found else None,
        "velocity_rms": _rms(speed) if found else None,
        "toss_rms_m": _rms(solution.position[toss] - case.position[toss]) if toss.any() else None,
        "errors_m": np.round(error[chosen], 6).tolist(),
        "sigmas_m": np.round(sigma[chosen], 6).tolist(),
        "residual_px": _median(solution.flights.residual_px),
    }


def score_events(case: BallCase, events: BallEvents) -> dict:
    """Hits and bounces against the true ones: counts, and time errors in seconds."""
    contacts = case.contacts
    within = WITHIN_FRAMES / case.options.fps
    found = match_events(contacts.times, contacts.kinds, events.times, events.kinds, within)
    return plain_matches(found)


def plain_matches(found: dict[str, Matched]) -> dict:
    """The same in JSON's types."""
    return {
        name: {"true": m.true, "found": m.found, "matched": m.matched, "errors_s": [round(e, 6) for e in m.errors_s]}
        for name, m in found.items()
    }


def score_shots(
    case: BallCase, solution: BallSolution, in_probability: Float[np.ndarray, " flights"], court: Court
) -> list[dict]:
    """One entry for every true hit: errors of the speed (a share), spin and landing, and how probable `in` was.

    The speed is compared with the true one at the time that the solver starts the flight: a person's whole frames may
    be half a frame late, in which a serve loses 2 % of its speed.
    """
    flights, events = solution.flights, solution.events
    begins = events.times[flights.start_event]
    is_hit = np.asarray(events.kinds[flights.start_event] == "hit", dtype=bool)
    rows = np.flatnonzero(is_hit)
    hits = hits_of(case.path)
    true = np.array([case.path.shots[k].start_s + case.start_s for k in hits])
    pairs = dict(matched_times(true, begins[rows], WITHIN_FRAMES / case.options.fps))
    entries = []
    for number, k in enumerate(hits):
        shot = case.path.shots[k]
        speed = float(np.linalg.norm(shot.velocity))
        entry: dict = {"speed": speed, "found": number in pairs}
        if number in pairs:
            row = int(rows[pairs[number]])
            at = float(np.clip(begins[row] - case.start_s, shot.start_s, shot.end_s))
            speed = float(np.linalg.norm(case.path.path.at(np.array([at]))[1]))
            stated = flights.start_velocity[row]
            along = flights.start_velocity_cov[row] @ (stated / max(float(np.linalg.norm(stated)), 1e-9))
            entry["speed_error"] = _number(float(np.linalg.norm(stated)) / speed - 1)
            entry["speed_sigma"] = _number(
                float(np.sqrt(max(along @ stated / max(float(np.linalg.norm(stated)), 1e-9), 0.0))) / speed
            )
            entry["spin_error"] = _number(float(np.linalg.norm(flights.spin[row] - shot.spin)))
            entry["landing_m"] = _number(float(np.linalg.norm(flights.landing[row, :2] - shot.landing[:2])))
            if np.isfinite(shot.landing).all():
                entry["in"] = lands_in(shot.landing, shot.position, court)
                entry["in_probability"] = _number(float(in_probability[row]))
        entries.append(entry)
    return entries


def hits_of(path: TruePath) -> list[int]:
    """Which of the path's shots begin with a hit: all but a serve's toss."""
    first = path.path.contacts[0].kind == "first"
    return list(range(1 if first else 0, len(path.shots)))


def lands_in(landing: Float[np.ndarray, " 3"], start: Float[np.ndarray, " 3"], court: Court) -> bool:
    """Whether a shot from `start` that lands there is in: serves in the box across, others in the other half."""
    x, y = float(landing[0]), float(landing[1])
    if y * start[1] >= 0:
        return False
    serve = start[2] > SERVE_M and abs(start[1]) > np.abs(court.in_play[..., 1]).max() - 1.0
    areas = court.in_serve if serve and len(court.in_serve) else court.in_play
    inside = [a[0, 0] <= x <= a[1, 0] and a[0, 1] <= y <= a[1, 1] for a in areas]
    return any(inside) and (not serve or bool(x * start[0] <= 0))


def failed_score(case: BallCase, reason: str) -> dict:
    """The score of a solve that raised an error."""
    return {"frames": int(case.scored.sum()), "placed": 0, "failed": True, "rms_m": None, "reason": reason}


def brier(probability: Sequence[float], came: Sequence[bool]) -> float:
    """Mean squared difference of probabilities from what came; NaN where there are none."""
    if not len(probability):
        return float("nan")
    return float(np.mean((np.asarray(probability, dtype=float) - np.asarray(came, dtype=float)) ** 2))


def _rms(vectors: np.ndarray) -> float:
    return float(np.sqrt((vectors**2).sum(axis=-1).mean())) if len(vectors) else float("nan")


def _median(values: np.ndarray) -> float | None:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else None


def _number(value: float) -> float | None:
    return value if np.isfinite(value) else None
