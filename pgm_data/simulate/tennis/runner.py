"""One player on the move in a play: where, how turned, whether at the net; and the moves that need no ball."""

import numpy as np

from pgm_data.simulate.tennis.choice import Intent
from pgm_data.simulate.tennis.heading import Turn, turn_of
from pgm_data.simulate.tennis.movement import Limits, Track, braked, limits_of, recovered, strolled
from pgm_data.simulate.tennis.play import Athlete, Side
from pgm_data.simulate.tennis.umpire import Verdict

_VOLLEY_S = 0.62
"""From a shot at a player at the net to the volley, about."""
_AFTER_BOUNCE_S = 0.42
"""From a bounce to the ground stroke after it, about."""


class Runner:
    """A player's way, turns and split steps as far as they are settled."""

    def __init__(self, athlete: Athlete, player: int, place: np.ndarray) -> None:
        """Stand at a place (world x, y) as player 0 (near) or 1 (far)."""
        self.athlete, self.player = athlete, player
        self.limits: Limits = limits_of(athlete, player)
        self.track = Track(place)
        self.turns: list[Turn] = []
        self.splits: list[float] = []
        self.at_net = False
        self.forward = 1.0 if player == 0 else -1.0

    def brake(self, time: float) -> None:
        """Stop running at a time."""
        place, velocity = self.track.at(time)
        self.track.follow(braked(time, place, velocity, self.limits))

    def turn(self, known: float, time: float, side: Side, hands: int) -> None:
        """Turn for a stroke at `time`, having set out for it at `known`."""
        self.turns.append(turn_of(known=known, time=time, side=side, hands=hands, hand=self.athlete.figure.hand))


def recover(
    rng: np.random.Generator, hitter: Runner, opponent: Runner, hit: float, intent: Intent, verdict: Verdict
) -> None:
    """Send the hitter of a shot at `hit` to the net, or behind the middle of the replies to come."""
    start = hit + float(rng.uniform(0.1, 0.2))
    place, velocity = hitter.track.at(start)
    due = verdict.bounce + _AFTER_BOUNCE_S if np.isfinite(verdict.bounce) else hit + 1.0
    if opponent.at_net:
        due = min(due, hit + _VOLLEY_S)
    # Replies come from about where the shot was aimed; their middle lies a little across from there.
    across = -0.1 * float(intent.target[0])
    if intent.attacks:
        depth = float(rng.uniform(2.6, 4.0))
        across = 0.25 * float(intent.target[0])
    elif intent.kind == "serve":
        depth = float(rng.uniform(12.2, 13.2))
    else:
        depth = float(np.clip(rng.normal(13.8, 0.9), 12.3, 15.6))
    hitter.at_net = intent.attacks
    goal = hitter.forward * np.array([across, -depth])
    hitter.track.follow(recovered(start, max(due, start + 0.35), place, velocity, goal, hitter.limits))


def walk_off(rng: np.random.Generator, runner: Runner, dead: float) -> None:
    """After a ball that is dead: slow down, then walk somewhere near."""
    pause = dead + float(rng.uniform(0.1, 0.35))
    angle, distance = float(rng.uniform(0.0, 2.0 * np.pi)), float(rng.uniform(0.8, 3.0))
    wait = float(rng.uniform(0.05, 0.5))
    # A swing is finished first.
    runner.brake(max(pause, max([turn.time for turn in runner.turns], default=0.0) + 0.25))
    stop = runner.track.pieces[-1].start
    place = runner.track.pieces[-1].coefficients[0]
    goal = place + distance * np.array([np.cos(angle), np.sin(angle)])
    depth = np.clip(-runner.forward * goal[1], 1.0, 17.5)
    goal = np.array([np.clip(goal[0], -7.5, 7.5), -runner.forward * depth])
    way = strolled(stop + wait, place, np.zeros(2), goal, runner.limits.eased(1.5, 0.35))
    runner.track.follow(way)
