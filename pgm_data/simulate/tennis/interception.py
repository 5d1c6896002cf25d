"""Where a player meets a ball: the best of all moments and stances that the legs allow."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from pgm_data.simulate.body.reach import GROUND_REACH, LOWEST_BALL_M, OVERHEAD_REACH, contact_offset
from pgm_data.simulate.flight.path import BallPath
from pgm_data.simulate.tennis.movement import Limits, Piece, can_stop, hurried_velocity, inside, way_to
from pgm_data.simulate.tennis.play import Athlete, Side

_STEP_S = 0.02
_STRETCHES = np.array([0.0, 0.25, 0.5, 0.75, 1.0])
_SOONEST_S = 0.16
# Both hands on the racket reach less far out.
_TWO_HANDED_STRETCH = 0.45


@dataclass(frozen=True, eq=False, kw_only=True)
class Readiness:
    """A player who sets out for a ball."""

    athlete: Athlete
    limits: Limits
    time: float
    place: Float[np.ndarray, " 2"]
    velocity: Float[np.ndarray, " 2"]
    at_net: bool
    """Whether the player has come to volley."""
    depth: float
    """Distance from the net at which this player likes to meet ground strokes now, metres."""
    height: float
    """Contact of ground strokes that this player likes now, metres."""
    one_hand: bool
    """Whether a two-handed player would rather use one hand on the backhand."""
    returns: bool
    """Whether a serve comes, which may not be volleyed."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Approach:
    """The ball's course as far as it may be played."""

    path: BallPath
    bounce: float
    """Time of the first bounce; infinite where there is none."""
    end: float
    """Time of the second bounce, or the end of the course."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Meeting:
    """A planned contact."""

    time: float
    ball: Float[np.ndarray, " 3"]
    incoming: Float[np.ndarray, " 3"]
    """Velocity of the ball just before, m/s."""
    side: Side
    hands: Literal[1, 2]
    stretch: float
    effort: float
    """0 at rest to 1 at the limits of the legs."""
    volley: bool
    since_bounce: float
    """Seconds; 0 for a volley."""
    way: list[Piece]
    """How the player gets there."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Chase:
    """A ball out of reach, and the run after it."""

    time: float
    ball: Float[np.ndarray, " 3"]
    """Where the racket would have had to be."""
    side: Side
    hands: Literal[1, 2]
    goal: Float[np.ndarray, " 2"]
    """Where the pelvis would have had to be."""
    lateness: float
    """Speed or acceleration needed over what is possible."""


@dataclass(frozen=True, eq=False, kw_only=True)
class _Choices:
    """All ways to meet a ball: times x stances x stretches."""

    times: Float[np.ndarray, " times"]
    balls: Float[np.ndarray, "times 3"]
    velocities: Float[np.ndarray, "times 3"]
    stances: list[tuple[Side, Literal[1, 2]]]
    goals: Float[np.ndarray, "times stances stretches 2"]
    effort: Float[np.ndarray, "times stances stretches"]
    needed: Float[np.ndarray, "times stances stretches"]
    """Speed or acceleration needed over its limit, the larger one."""
    allowed: np.ndarray
    """Whether height, hands and the surface allow it."""
    possible: np.ndarray
    """Whether the legs allow it as well."""
    cost: Float[np.ndarray, "times stances stretches"]


def meet(ready: Readiness, course: Approach) -> Meeting | Chase | None:
    """The contact that suits best; a chase where none is in reach; None where there is nothing to run for."""
    choices = _choices(ready, course)
    if choices is None:
        return None
    cost = np.where(choices.possible, choices.cost, np.inf).ravel()
    for flat in np.argsort(cost, kind="stable")[:40:3]:
        if not np.isfinite(cost[flat]):
            break
        meeting = _meeting(ready, course, choices, int(flat))
        if meeting is not None:
            return meeting
    return _chase(ready, choices)


def _meeting(ready: Readiness, course: Approach, choices: _Choices, flat: int) -> Meeting | None:
    i, j, k = np.unravel_index(flat, choices.cost.shape)
    time, goal = float(choices.times[i]), choices.goals[i, j, k]
    towards_net = 1.0 if ready.limits.player == 0 else -1.0
    side, hands = choices.stances[j]
    # Into the ball, where there is time for it.
    step = np.array([0.0, towards_net * (0.5 if side != "overhead" else 0.2)])
    way = way_to(ready.time, time, ready.place, ready.velocity, goal, ready.limits, step=step)
    if way is None:
        return None
    return Meeting(
        time=time,
        ball=choices.balls[i],
        incoming=choices.velocities[i],
        side=side,
        hands=hands,
        stretch=float(_STRETCHES[k]),
        effort=float(choices.effort[i, j, k]),
        volley=time < course.bounce,
        since_bounce=max(0.0, time - course.bounce),
        way=way,
    )


def _stances(athlete: Athlete) -> list[tuple[Side, Literal[1, 2]]]:
    stances: list[tuple[Side, Literal[1, 2]]] = [("forehand", 1), ("backhand", 1), ("overhead", 1)]
    return [*stances, ("backhand", 2)] if athlete.backhand_hands == 2 else stances


def _choices(ready: Readiness, course: Approach) -> _Choices | None:
    first = ready.time + _SOONEST_S
    if course.end - 0.01 <= first:
        return None
    times = np.arange(first, course.end - 0.01, _STEP_S)
    balls, velocities = course.path.at(times)
    player, figure = ready.limits.player, ready.athlete.figure
    towards_net = 1.0 if player == 0 else -1.0
    depth = -towards_net * balls[:, 1]
    # Only balls on the player's own half, and none in the instant of the bounce.
    keep = (depth > 0.25) & (np.abs(times - course.bounce) > 0.035) & np.isfinite(balls).all(1)
    if ready.returns:
        keep &= times > course.bounce
    if not keep.any():
        return None
    times, balls, velocities, depth = times[keep], balls[keep], velocities[keep], depth[keep]
    stances = _stances(ready.athlete)
    # Stances x stretches; the offset grows evenly with the stretch.
    ease, far = (np.array([contact_offset(figure, s, h, k) for s, h in stances])[:, None] for k in (0.0, 1.0))
    offsets = ease + _STRETCHES[:, None] * (far - ease)
    goals = balls[:, None, None, :2] - towards_net * offsets
    spans = (times - ready.time)[:, None, None]
    V, possible = hurried_velocity(ready.place, ready.velocity, goals, spans, ready.limits)
    turning = np.linalg.norm(V - ready.velocity, axis=-1) / (ready.limits.acceleration * spans)
    needed = np.maximum(np.linalg.norm(V, axis=-1) / ready.limits.speed, turning)
    allowed = _allowed(ready, stances, balls[:, 2]) & inside(goals, player, 0.05)
    # A two-handed player's one-handed backhand is a slice or a volley; the other way round nobody volleys with two.
    return _Choices(
        times=times,
        balls=balls,
        velocities=velocities,
        stances=stances,
        goals=goals,
        effort=np.clip(needed, 0.0, 1.0),
        needed=needed,
        allowed=allowed,
        possible=allowed & possible & can_stop(goals, V, ready.limits),
        cost=_cost(ready, course, stances, times, balls, velocities)
        + 3.0 * np.clip(needed, 0.0, 1.0) ** 2
        + 1.3 * _STRETCHES**1.5,
    )


def _allowed(ready: Readiness, stances: list, heights: np.ndarray) -> np.ndarray:
    tall = ready.athlete.figure.height_m
    overhead = np.array([side == "overhead" for side, _ in stances])
    low = np.where(overhead, (OVERHEAD_REACH[0] + 0.04) * tall, LOWEST_BALL_M + 0.03)
    high = np.where(overhead, (OVERHEAD_REACH[1] - 0.06) * tall, GROUND_REACH * tall - 0.02)
    fits = (heights[:, None] >= low) & (heights[:, None] <= high)
    most = np.where(overhead, 0.5, [_TWO_HANDED_STRETCH if hands == 2 else 1.0 for _, hands in stances])
    return fits[:, :, None] & (most[None, :] >= _STRETCHES[:, None]).T[None]


def _cost(ready, course, stances, times, balls, velocities) -> np.ndarray:
    """How little a player likes each moment and stance, apart from the run and the stretch."""
    depth, height = np.abs(balls[:, 1]), balls[:, 2]
    volley = times < course.bounce
    after = np.where(volley, np.inf, times - course.bounce)
    ground = (
        ((height - ready.height) / np.where(height > ready.height, 0.45, 0.38)) ** 2
        + 0.3 * ((depth - ready.depth) / 1.2) ** 2 * (depth > 9.5)
        # Taken just after the bounce a ball is hard to time.
        + (0.6 if ready.returns else 1.5) * np.clip((0.26 - after) / 0.2, 0.0, 1.0)
        + (1.2 if ready.at_net else 0.0)
    )
    air = ((height - 1.25) / 0.55) ** 2 + (-0.8 if ready.at_net else 1.8) + 0.6 * np.clip(depth - 6.0, 0.0, 6.0)
    cost = np.where(volley, air, ground)[:, None] + np.zeros(len(stances))
    falling = (velocities[:, 2] < -2.5) & (depth < 8.5)
    for j, (side, hands) in enumerate(stances):
        if side == "overhead":
            cost[:, j] = np.where(
                falling, -1.0 + 0.4 * np.abs(height / ready.athlete.figure.height_m - 1.44) / 0.1, 9.0
            )
        elif side == "backhand":
            cost[:, j] += 0.1
            if ready.athlete.backhand_hands == 2:
                cost[:, j] += np.where(
                    volley, 0.0 if hands == 1 else 4.0, 0.0 if (hands == 1) == ready.one_hand else 1.3
                )
    return cost[:, :, None]


def _chase(ready: Readiness, choices: _Choices) -> Chase | None:
    lateness = np.where(choices.allowed[:, :, -1] | choices.allowed[:, :, 0], choices.needed[:, :, -1], np.inf)
    overhead = np.array([side == "overhead" or hands == 2 for side, hands in choices.stances])
    lateness[:, overhead] = np.inf
    if not np.isfinite(lateness).any():
        return None
    # Nobody runs far back after a ball that is past.
    back = np.abs(choices.goals[:, :, -1, 1]) - abs(float(ready.place[1]))
    i, j = np.unravel_index(int(np.argmin(lateness + 0.4 * np.maximum(back, 0.0))), lateness.shape)
    side, hands = choices.stances[j]
    return Chase(
        time=float(choices.times[i]),
        ball=choices.balls[i],
        side=side,
        hands=hands,
        goal=choices.goals[i, j, -1],
        lateness=float(lateness[i, j]),
    )
