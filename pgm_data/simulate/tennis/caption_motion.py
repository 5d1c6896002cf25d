"""How a player moves over some time, read from the path of its pelvis, in the words' own categories.

All directions are those of the player's own frame (see `areas`). What no category fits is "unclear" and stays unsaid.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from pgm_data.simulate.tennis.areas import own_frame
from pgm_data.simulate.tennis.play import Plan

Way = Literal["left", "right", "forward", "back", "left forward", "right forward", "left back", "right back"]
Gait = Literal["sprint", "run", "jog", "walk", "sidestep", "backpedal", "step", "move"]
Kind = Literal["still", "moves", "turns", "shifts", "unclear"]
KNOTS_PER_S = 50

STILL_SPEED, STILL_M = 0.75, 0.33
"""Below this speed, m/s, and this length of its way, m, a player stays where it is."""
STRAIGHT = 0.65
"""A move is a displacement of at least this share of its length."""
DIAGONAL = 0.58
"""Smaller over larger component from which on a displacement counts as diagonal (30 degrees)."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Leg:
    """One straight move."""

    way: Way
    gait: Gait
    distance_m: float
    peak: float
    """Highest speed, m/s."""
    displacement: Float[np.ndarray, " 2"]
    """Own frame, metres."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Motion:
    """What a player's feet do from one moment to another."""

    kind: Kind
    legs: tuple[Leg, ...]
    """One where it moves, two where it turns about, otherwise none."""
    starts: bool
    """Stands at first and moves at the end."""
    stops: bool
    """Moves at first and stands at the end."""
    start: Float[np.ndarray, " 2"]
    """Position, own frame, metres."""
    end: Float[np.ndarray, " 2"]
    along_baseline: bool
    """Goes sideways, near the baseline all the time."""


def speeds(plan: Plan) -> Float[np.ndarray, " knots"]:
    """Speed of the pelvis, m/s, at every knot."""
    if len(plan.path) < 2:
        return np.zeros(len(plan.path))
    velocity = np.gradient(plan.path, axis=0) * KNOTS_PER_S
    return np.hypot(velocity[:, 0], velocity[:, 1])


def motion_of(player: int, plan: Plan, speed: Float[np.ndarray, " knots"], start_s: float, end_s: float) -> Motion:
    """The player's motion from start_s to end_s; `speed` is `speeds(plan)`."""
    first = min(round(start_s * KNOTS_PER_S), len(plan.path) - 1)
    last = min(max(round(end_s * KNOTS_PER_S), first + 1), len(plan.path) - 1)
    first = min(first, max(last - 1, 0))
    path = own_frame(player, plan.path[first : last + 1])
    speed = speed[first : last + 1]
    heading = plan.heading[first : last + 1] - (0.0 if player == 0 else np.pi)
    ends = 10 if len(speed) > 25 else max(len(speed) // 3, 1)
    peak = float(speed.max())
    calm_start, calm_end = float(speed[:ends].max()) < 0.45, float(speed[-ends // 2 :].max()) < 0.45
    kind, legs = _legs(path, speed, heading)
    return Motion(
        kind=kind,
        legs=legs,
        starts=calm_start and float(speed[-ends:].min()) > 0.9,
        stops=calm_end and not calm_start and peak > 1.0,
        start=path[0],
        end=path[-1],
        along_baseline=kind == "moves"
        and bool((np.abs(path[:, 1] + 11.885) < 1.2).all())
        and bool(abs(path[-1, 0] - path[0, 0]) > 1.5),
    )


def _legs(path: np.ndarray, speed: np.ndarray, heading: np.ndarray) -> tuple[Kind, tuple[Leg, ...]]:
    steps = np.hypot(*np.diff(path, axis=0).T)
    length = float(steps.sum())
    net = float(np.hypot(*(path[-1] - path[0])))
    if float(speed.max()) < STILL_SPEED and length < STILL_M:
        return "still", ()
    reach = np.hypot(*(path - path[0]).T) + np.hypot(*(path - path[-1]).T)
    turn = int(np.argmax(reach))
    if 2 < turn < len(path) - 3:
        one, two = path[turn] - path[0], path[-1] - path[turn]
        size = float(np.hypot(*one)), float(np.hypot(*two))
        lengths = float(steps[:turn].sum()), float(steps[turn:].sum())
        clear = min(size) > 0.6 and all(s >= STRAIGHT * n for s, n in zip(size, lengths, strict=True))
        if clear and one @ two < -0.3 * size[0] * size[1]:
            return "turns", (
                _leg(path[: turn + 1], speed[: turn + 1], heading[: turn + 1]),
                _leg(path[turn:], speed[turn:], heading[turn:]),
            )
    if net >= 0.4 and net >= STRAIGHT * length:
        return "moves", (_leg(path, speed, heading),)
    if 0.3 < length < 2.0 and net < 0.5:
        return "shifts", ()
    return "unclear", ()


def _leg(path: np.ndarray, speed: np.ndarray, heading: np.ndarray) -> Leg:
    d = path[-1] - path[0]
    distance = float(np.hypot(*d))
    peak = float(speed.max())
    return Leg(way=way_of(d), gait=_gait(path, speed, heading), distance_m=distance, peak=peak, displacement=d)


def way_of(d: Float[np.ndarray, " 2"]) -> Way:
    """The direction of a displacement in the own frame; diagonal where its smaller part is clear as well."""
    side, depth = ("right" if d[0] > 0 else "left"), ("forward" if d[1] > 0 else "back")
    small, large = sorted(np.abs(d))
    if small >= 0.35 and small >= DIAGONAL * large:
        return f"{side} {depth}"  # pyright: ignore[reportReturnType]  (each of the four is a Way)
    return side if abs(d[0]) > abs(d[1]) else depth


def _gait(path: np.ndarray, speed: np.ndarray, heading: np.ndarray) -> Gait:
    peak = float(speed.max())
    distance = float(np.hypot(*(path[-1] - path[0])))
    velocity = np.gradient(path, axis=0)
    # How much of the way goes where the hips look: 1 ahead, 0 sideways, -1 backwards.
    ahead = float((velocity * np.stack([-np.sin(heading), np.cos(heading)], axis=-1)).sum())
    ahead /= max(float(np.hypot(*velocity.T).sum()), 1e-9)
    if distance < 0.95 and peak < 2.2:
        return "step"
    if ahead > 0.5:
        if peak > 5.0:
            return "sprint"
        if peak > 3.2:
            return "run"
        if 2.2 < peak < 3.0:
            return "jog"
        return "walk" if peak < 1.9 else "move"
    if abs(ahead) < 0.5 and peak < 3.8:
        return "sidestep"
    if ahead < -0.65 and peak < 3.8:
        return "backpedal"
    return "move"
