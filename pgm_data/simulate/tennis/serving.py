"""Where a server stands and how the ball is tossed."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from pgm_data.simulate.body.reach import MIDDLE_HEIGHT_M, OVERHEAD_REACH, pelvis_at_contact
from pgm_data.simulate.flight.course import FlightWorld, follow
from pgm_data.simulate.flight.path import Flight
from pgm_data.simulate.tennis import shot_tables as tables
from pgm_data.simulate.tennis.play import Athlete

_DRIVE_M = 0.42
"""How far the pelvis moves into the court from the stance to the contact."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Toss:
    """A toss and the serve's contact at its end."""

    stance: Float[np.ndarray, " 2"]
    """World x, y of the server's pelvis until the toss."""
    time: float
    """When the ball leaves the hand."""
    release: Float[np.ndarray, " 3"]
    contact_time: float
    contact: Float[np.ndarray, " 3"]
    flight: Flight


@dataclass(frozen=True, kw_only=True)
class Due:
    """From where a serve is due, and which."""

    right: bool
    """Whether it comes from the server's own right half."""
    second: bool


def toss_ball(rng: np.random.Generator, athlete: Athlete, server: int, due: Due, world: FlightWorld) -> Toss:
    """A toss of player 0 (near) or 1 (far) who serves."""
    forward = 1.0 if server == 0 else -1.0
    figure = athlete.figure
    racket = 1.0 if figure.hand == "right" else -1.0
    tall = figure.height_m
    height = tall * float(np.clip(tables.drawn(rng, tables.SERVE_HEIGHT), OVERHEAD_REACH[0], OVERHEAD_REACH[1] - 0.01))
    sideways = tables.drawn(rng, tables.SERVE_SIDEWAYS["right" if due.right else "left"])
    depth = tables.drawn(rng, tables.SERVE_DEPTH[2 if due.second else 1])
    wanted = forward * np.array([sideways if due.right else -sideways, -depth])
    pelvis = pelvis_at_contact(figure, server, wanted, "overhead", 1)
    stance = pelvis - forward * np.array([0.0, _DRIVE_M])
    scale = tall / MIDDLE_HEIGHT_M
    ahead = np.array([-racket * 0.12, rng.uniform(0.34, 0.46)]) * scale
    release = np.array([*(stance + forward * ahead), rng.uniform(0.95, 1.0) * tall])
    time = float(rng.uniform(1.0, 2.5))
    # High enough to come down to the contact some time after the top.
    lasts = float(rng.uniform(0.755, 0.88))
    rise = (height - release[2]) / lasts + 0.5 * world.air.gravity * lasts
    velocity = np.array([*((wanted - release[:2]) / lasts), rise])
    flight = follow(release, velocity, np.zeros(3), time, world, until=time + lasts)[0][0]
    for _ in range(2):
        # The air takes a little, and wind more, which a server allows for.
        velocity = velocity + (np.array([*wanted, height]) - flight.positions[-1]) / lasts
        flight = follow(release, velocity, np.zeros(3), time, world, until=time + lasts)[0][0]
    return Toss(
        stance=stance,
        time=time,
        release=release,
        contact_time=float(flight.times[-1]),
        contact=flight.positions[-1].copy(),
        flight=flight,
    )
