"""Where hips look: at the net while waiting, into a run, to the side of a stroke."""

from dataclasses import dataclass

import numba
import numpy as np
from jaxtyping import Float

from pgm_data.simulate.body.figure import Hand
from pgm_data.simulate.tennis.movement import RATE

FASTEST_TURN = 6.6
"""rad/s."""
_QUICKNESS = 13.0
# A run is looked into between these speeds, m/s.
_WALKS, _RUNS = 2.6, 3.8
_MOST_TURNED = 2.3


@dataclass(frozen=True, eq=False, kw_only=True)
class Turn:
    """A stroke for which the hips turn; angles from the net, radians, positive to the player's left."""

    known: float
    """When the player sets out for it, seconds."""
    time: float
    ready: float
    """Angle of the backswing."""
    contact: float
    """Angle when the ball is met."""


def turn_of(*, known: float, time: float, side: str, hands: int, hand: Hand) -> Turn:
    """How a player turns for a stroke on a side."""
    racket = 1.0 if hand == "left" else -1.0
    ready, contact = {
        ("forehand", 1): (1.1, 0.4),
        ("backhand", 2): (-1.2, -0.7),
        ("backhand", 1): (-1.3, -0.95),
        ("overhead", 1): (1.2, 0.35),
    }[side, hands]
    return Turn(known=known, time=time, ready=racket * ready, contact=racket * contact)


def headings(
    path: Float[np.ndarray, "knots 2"], player: int, hand: Hand, turns: list[Turn]
) -> Float[np.ndarray, " knots"]:
    """Heading at every knot of a path, as `rotations.facing` counts it."""
    times = np.arange(len(path)) / RATE
    velocity = np.gradient(path, 1.0 / RATE, axis=0) if len(path) > 1 else np.zeros_like(path)
    base = 0.0 if player == 0 else np.pi
    # Who runs straight back turns to the racket's side.
    racket = 1.0 if hand == "left" else -1.0
    low = -np.pi + 0.6 * racket
    run = np.mod(np.arctan2(-velocity[:, 0], velocity[:, 1]) - base - low, 2 * np.pi) + low
    share = np.clip((np.hypot(*velocity.T) - _WALKS) / (_RUNS - _WALKS), 0.0, 1.0)
    goal = share**2 * (3 - 2 * share) * np.clip(run, -_MOST_TURNED, _MOST_TURNED)
    for turn in turns:
        goal = _turned(times, goal, turn)
    return base + _smoothed(goal, _QUICKNESS, FASTEST_TURN, 1.0 / RATE)


def _turned(times: np.ndarray, goal: np.ndarray, turn: Turn) -> np.ndarray:
    # The hips lag behind what they are meant to do by about 0.15 s, hence all is meant earlier.
    start = max(turn.known, turn.time - 0.75)
    end = max(turn.time - 0.3, start + 0.05)
    share = np.clip((times - start) / (end - start), 0.0, 1.0) * np.clip((turn.time + 0.25 - times) / 0.3, 0.0, 1.0)
    opened = np.clip((times - (turn.time - 0.3)) / 0.15, 0.0, 1.0)
    return goal + share * (turn.ready + opened * (turn.contact - turn.ready) - goal)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _smoothed(goal, quickness, fastest, step):
    """A critically damped pursuit of goal that turns no faster than it may."""
    out = np.empty_like(goal)
    h, rate = goal[0], 0.0
    for i in range(len(goal)):
        out[i] = h
        rate += step * (quickness * quickness * (goal[i] - h) - 2.0 * quickness * rate)
        rate = min(max(rate, -fastest), fastest)
        h += step * rate
    return out
