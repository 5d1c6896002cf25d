"""A tennis match without end: two players by lot, and one play after the other by the rules."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from pgm_data.scene import Scene
from pgm_data.simulate.flight.air import SEA_LEVEL_AIR, Air, ball_build
from pgm_data.simulate.flight.contact import SURFACES, SurfaceName, net_shape
from pgm_data.simulate.flight.course import FlightWorld
from pgm_data.simulate.tennis.athletes import draw_athlete
from pgm_data.simulate.tennis.play import Athlete, Play
from pgm_data.simulate.tennis.rally import Start, played
from pgm_data.simulate.tennis.score import Count, after_fault, after_point, new_match

_SURFACE_SHARES: dict[SurfaceName, float] = {"hard": 0.6, "clay": 0.28, "grass": 0.12}
_LAPSE_PER_M = 1.0 / 8400.0
"""Share of its density that the air loses per metre of altitude."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Match:
    """Two players and where they play."""

    athletes: tuple[Athlete, Athlete]
    world: FlightWorld
    """Calm or windy air, ball, surface, net."""
    lift_sd: float
    """Scatter of the ball's lift from play to play, as a share."""


def draw_match(
    rng: np.random.Generator,
    scene: Scene,
    *,
    name: str,
    surface: SurfaceName | None = None,
    wind: Float[np.ndarray, " 3"] | None = None,
) -> Match:
    """A match by lot; the players are called `name`_A and `name`_B. `wind` is the air's velocity, m/s; calm without.

    Raises:
        ValueError: If the scene has no court or no ball.
    """
    if scene.court is None or scene.ball is None:
        raise ValueError(f"draw_match.scene: expected a court and a ball, got {scene.name}")
    # Drawn in any case, so that a chosen surface changes nothing else.
    drawn = list(_SURFACE_SHARES)[int(rng.choice(len(_SURFACE_SHARES), p=list(_SURFACE_SHARES.values())))]
    celsius, altitude = float(rng.uniform(12.0, 33.0)), float(rng.exponential(120.0))
    density = SEA_LEVEL_AIR * 293.15 / (273.15 + celsius) * float(np.exp(-min(altitude, 2500.0) * _LAPSE_PER_M))
    world = FlightWorld(
        air=Air(density_kg_m3=density, wind=np.zeros(3) if wind is None else np.asarray(wind, dtype=float)),
        build=ball_build(scene.ball),
        surface=SURFACES[surface or drawn],
        net=net_shape(scene.court.net_world, scene.court.tape_width),
    )
    athletes = (draw_athlete(rng, f"{name}_A"), draw_athlete(rng, f"{name}_B"))
    return Match(athletes=athletes, world=world, lift_sd=0.1)


def plays(match: Match, rng: np.random.Generator) -> Iterator[Play]:
    """Every serve in order, without end: after a match is won the same two start another at 0-0."""
    number = 0
    while True:
        count = new_match(first_server=int(rng.integers(2)), near=int(rng.integers(2)))
        while not count.finished:
            # Each play has its own stream, so that nothing in one reaches into the next but the score.
            play = played(np.random.default_rng(int(rng.integers(2**63))), _start(match, count, number, rng))
            yield play
            number += 1
            count = _next(count, play)


def _start(match: Match, count: Count, number: int, rng: np.random.Generator) -> Start:
    order = (count.near, 1 - count.near)
    build = match.world.build
    lift = build.lift_factor * float(np.clip(1.0 + match.lift_sd * rng.normal(), 0.7, 1.3))
    return Start(
        number=number,
        athletes=(match.athletes[order[0]], match.athletes[order[1]]),
        identities=order,
        server=order.index(count.server),
        right_court=count.right_court,
        second=count.second_serve,
        score=count.score(),
        world=replace(match.world, build=replace(build, lift_factor=lift)),
    )


def _next(count: Count, play: Play) -> Count:
    if play.outcome == "let":
        return count
    if play.outcome == "fault":
        return after_fault(count)
    return after_point(count, play.identities[play.winner])
