"""Strokes put within reach: a ball that is sent back in the air is met by a player, and not metres away from one.

A model that fills in states frame by frame turns a ball round a little before it is at the player, or after. The flight
that comes is right more often than the moment at which it ends: it is flown on, or cut, to where the player who sends
it back can reach it, and the flight that leaves begins there.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from pgm_data.lift.ball.world import BallWorld
from pgm_models.animation.settle_breaks import States, ground_of, touches_net
from pgm_models.animation.settle_flights import Joined, Reach, states_at

SENT_BACK_M_S = 5.0
"""Change of its level velocity above which a ball was hit, m/s."""
EARLIER_S, LATER_S = 0.4, 0.4
"""How far a stroke is moved in time, s."""
MOMENTS_S = 0.01
"""Step between the moments that are looked at, s."""
FASTER_M_S = 20.0
"""By how much a flight's velocity is changed at most for it to begin elsewhere, m/s."""
HIGHEST_M = 3.2
"""Of a stroke above the ground, metres."""
NET_M = 0.3
"""Nearer to the net than this, the net may have stopped it, metres."""


@dataclass(frozen=True, kw_only=True)
class _Stroke:
    """When a contact is to be, and by whom it is a stroke."""

    moment: float
    player: int


@dataclass(frozen=True, eq=False, kw_only=True)
class Reached:
    """Flights with strokes where players reach them, and what they are to be fitted to."""

    found: Joined
    states: States
    """Those of a flight that begins elsewhere than before are moved with it, the less the nearer to its end."""
    stray: Bool[np.ndarray, " T"]
    """Frames whose states belong to no flight any more: between the moment a stroke had and the one it got."""


def reached(found: Joined, states: States, kept: Bool[np.ndarray, " T"], reach: Reach, world: BallWorld) -> Reached:
    """Strokes put within reach of the players who send the ball back.

    Args:
        found: Flights that have been fitted.
        states: That they were fitted to.
        kept: Frames that must stay in their flights, as they are.
        reach: Of the players.
        world: Of the ball.
    """
    times, stray = states.times, np.zeros(len(states.times), dtype=bool)
    for row in range(len(found.moment)):
        stroke = _stroke(found, row, times, reach, world)
        if stroke is None:
            continue
        hitter = found.hitter.copy()
        hitter[row] = stroke.player
        found = replace(found, hitter=hitter)
        ended = int(np.searchsorted(times, stroke.moment, side="right")) - 1
        # Frames that change sides, or come to a side from neither.
        between = slice(min(ended, int(found.last[row])) + 1, max(ended + 1, int(found.first[row + 1])))
        stays = found.last[row] <= ended < found.first[row + 1]
        if stays or kept[between].any() or not found.first[row] <= ended < found.last[row + 1]:
            continue
        sides = np.array([row, row + 1])
        place, _ = states_at(found, sides, stroke.moment - times[found.first[sides]], world)
        leaving = np.arange(ended + 1, found.last[row + 1] + 1)
        ends = leaving[kept[leaving]][:1] if kept[leaving].any() else leaving[-1:]
        lasts = float(times[ends[0]] - stroke.moment)
        shift = place[0] - place[1]
        if np.linalg.norm(shift) > FASTER_M_S * lasts:
            continue
        stray[between] = True
        found = _with_stroke(found, row, ended, stroke.moment, shift, lasts, times, world)
        share = np.where(leaving < ends[0], 1.0 - (times[leaving] - stroke.moment) / lasts, 0.0)
        position, velocity = states.position.copy(), states.velocity.copy()
        position[leaving] += share[:, None] * shift
        velocity[leaving] -= (share > 0)[:, None] * shift / lasts
        states = replace(states, position=position, velocity=velocity)
    return Reached(found=found, states=states, stray=stray)


def _with_stroke(
    found: Joined,
    row: int,
    ended: int,
    moment: float,
    shift: Float[np.ndarray, " 3"],
    lasts: float,
    times: Float[np.ndarray, " T"],
    world: BallWorld,
) -> Joined:
    """The flights with that contact between that frame and the next, the one that leaves moved to begin there."""
    first, last, start, when, tied = (
        getattr(found, name).copy() for name in ("first", "last", "start", "moment", "tied")
    )
    last[row], first[row + 1], when[row], tied[row] = ended, ended + 1, moment, True
    place, velocity = states_at(found, np.array([row + 1]), times[[ended + 1]] - times[found.first[row + 1]], world)
    start[row + 1, :3] = place[0] + shift * (1.0 - (times[ended + 1] - moment) / lasts)
    start[row + 1, 3:6] = velocity[0] - shift / lasts
    return replace(found, first=first, last=last, start=start, moment=when, tied=tied)


def _stroke(found: Joined, row: int, times: Float[np.ndarray, " T"], reach: Reach, world: BallWorld) -> _Stroke | None:
    """When and by whom the contact is a stroke; None where it is none, or nobody gets there."""
    both = slice(row, row + 2)
    if found.bounce[row] or found.rolls[both].any() or found.held[both].any() or not reach.roots.shape[1]:
        return None
    now = found.moment[row]
    sides = np.array([row, row + 1])
    place, velocity = states_at(found, sides, now - times[found.first[sides]], world)
    change = velocity[1] - velocity[0]
    if np.hypot(*change[:2]) < SENT_BACK_M_S or touches_net(place, world, NET_M).any():
        return None
    # Whoever faces a net sends the ball to it, and against the way it came.
    able = (reach.looks == 0) | ((velocity[1, 1] * reach.looks > 0) & (change[1] * reach.looks > 0))
    begin = max(float(times[found.first[row]]), float(now) - EARLIER_S)
    end = min(float(times[found.last[row + 1]]), float(now) + LATER_S)
    moments = np.unique(np.concatenate([[now], np.arange(begin, end, MOMENTS_S)]))
    path, _ = states_at(found, np.full(len(moments), row), moments - times[found.first[row]], world)
    away = np.linalg.norm(path[:, None, :2] - reach.roots_at(moments, times)[..., :2], axis=-1)
    high = path[:, 2] - ground_of(path, world)
    down = np.flatnonzero((high < 0) & (moments > now))
    high[down[0] if len(down) else len(high) :] = np.inf
    away[(high < 0) | (high > HIGHEST_M)] = np.inf
    away[:, ~able] = np.inf
    if not np.isfinite(away).any():
        return None
    player = int(np.unravel_index(away.argmin(), away.shape)[1])
    own = away[:, player]
    if own.min() > reach.farthest_m:
        return None
    there = np.flatnonzero(own <= max(reach.level_m, own.min()))
    return _Stroke(moment=float(moments[there[np.abs(moments[there] - now).argmin()]]), player=player)
