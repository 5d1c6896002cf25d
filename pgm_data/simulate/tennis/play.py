"""One serve and what follows it, as a plan in continuous time: who moves where, who hits what, where the ball flies.

World metres, origin on the ground under the net, x right and y away as the main camera sees it. Player 0 plays at the
near end (y < 0, looks along +y), player 1 at the far end. Times are seconds from the start of the play.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from pgm_data.simulate.body.figure import Figure
from pgm_data.simulate.flight.path import BallPath

StrokeKind = Literal["serve", "drive", "slice", "volley", "half_volley", "smash", "lob", "drop"]
Side = Literal["forehand", "backhand", "overhead"]
Result = Literal["in", "out", "net", "let"]
Outcome = Literal["ace", "service_winner", "winner", "forced_error", "unforced_error", "fault", "double_fault", "let"]


@dataclass(frozen=True, eq=False, kw_only=True)
class Athlete:
    """One player of a match."""

    identity: str
    figure: Figure
    backhand_hands: Literal[1, 2]
    top_speed: float
    """m/s."""
    acceleration: float
    """m/s^2."""
    reaction_s: float
    """From the opponent's contact to the first step."""
    power: float
    """Factor on speeds of shots, about 0.9 to 1.1."""
    topspin: float
    """Factor on topspin, about 0.7 to 1.3."""
    attacks_net: float
    """Inclination to come to the net, 0 to 1."""
    steadiness: float
    """Factor on errors; below 1 errs less."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Stroke:
    """One swing."""

    player: int
    time: float
    """Of the contact, or of its miss."""
    kind: StrokeKind
    side: Side
    hands: Literal[1, 2]
    """Hands on the racket at contact."""
    ball: Float[np.ndarray, " 3"]
    """Centre of the ball at contact, world metres; for a miss, where the racket passes."""
    swing: Float[np.ndarray, " 3"]
    """Unit direction in which the racket head moves at contact, world."""
    hit: bool
    """False where the player swings and misses."""
    stretch: float
    """0 at ease to 1 at the limit of reach."""
    toss_time: float
    """Serves: when the ball leaves the other hand; NaN otherwise."""
    toss: Float[np.ndarray, " 3"]
    """Serves: where it leaves the hand, world metres; NaN otherwise."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Plan:
    """Where one player's pelvis goes; the body follows."""

    times: Float[np.ndarray, " knots"]
    """Evenly spaced at 50 per second, from 0 to the play's end."""
    path: Float[np.ndarray, "knots 2"]
    """World x, y of the pelvis; speed and acceleration within the athlete's limits."""
    heading: Float[np.ndarray, " knots"]
    """Which way the hips look, radians as `rotations.facing`: 0 towards +y; continuous, at most 7 rad/s."""
    splits: Float[np.ndarray, " splits"]
    """Moments at which the player lands from a split step."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Shot:
    """What one hit did to the ball."""

    stroke: int
    """Index into the play's strokes."""
    player: int
    contact: int
    """Index into the ball's contacts: the hit."""
    aim: Float[np.ndarray, " 2"]
    """Where it was aimed, world x, y."""
    landing: Float[np.ndarray, " 2"]
    """Where it first met the ground, world x, y; NaN where the opponent or the net took it before, or it never did."""
    result: Result
    spin_rpm: float
    """Positive topspin, negative backspin, at the hit."""
    speed: float
    """m/s at the hit."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Score:
    """The score before a play, by identity order of the match (not by end)."""

    sets: tuple[tuple[int, int], ...]
    """Games of every set so far, the running one last."""
    points: tuple[str, str]
    """0, 15, 30, 40, AD, or the count of a tie-break."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Play:
    """One serve, the rally after it, and the seconds around."""

    number: int
    """Of the match, from 0."""
    duration_s: float
    athletes: tuple[Athlete, Athlete]
    """Near end, far end."""
    identities: tuple[int, int]
    """Which of the match's two athletes (0 or 1) plays near, far."""
    server: int
    """0 near, 1 far."""
    serve_number: Literal[1, 2]
    score: Score
    ball: BallPath
    """From the toss's release (`first`) until it is out of play (`last`); before, the server holds it."""
    strokes: tuple[Stroke, ...]
    """In order of time, misses among them."""
    shots: tuple[Shot, ...]
    """One for every stroke that hit."""
    plans: tuple[Plan, Plan]
    """Near, far."""
    outcome: Outcome
    winner: int
    """0 near, 1 far: who wins the point; -1 where it goes on (fault, let)."""
