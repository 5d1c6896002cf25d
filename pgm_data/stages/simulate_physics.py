"""What a physicist would ask of simulated tennis: energy, bounces, speed losses, feet, joints, rackets."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from pgm_data.scene import Scene
from pgm_data.simulate.body.figure import smpl24, world_from_joints
from pgm_data.simulate.body.laws import foot_slides, ground_penetration, joint_violations
from pgm_data.simulate.body.racket import ball_at_contact
from pgm_data.simulate.flight.contact import SURFACES, SurfaceName
from pgm_data.simulate.flight.course import FlightWorld, follow
from pgm_data.simulate.flight.laws import energy_gains, speed_losses
from pgm_data.simulate.tennis.match import Match, draw_match, plays
from pgm_data.simulate.tennis.play import Play
from pgm_data.simulate.tennis.truth import body_of

PLAYS_A_MATCH = 100
FRAMES_A_SECOND = 50.0
DROP_M = 2.54
"""Height of the ball's underside in the ITF's drop test."""


@dataclass(frozen=True, eq=False, kw_only=True)
class PhysicsFigures:
    """Figures over many plays."""

    plays: int
    flights: int
    energy_gain: float
    """Largest rise of a flight's energy, as a share."""
    drop_ratio: dict[str, float]
    """Rebound over drop height in the ITF's test, by surface."""
    serve_loss: tuple[float, float, float]
    """Share of speed that first serves lose to the bounce: at chances 5 %, 50 %, 95 %."""
    forehand_loss: tuple[float, float, float]
    """The same for forehand drives of 28 to 34 m/s."""
    stances: int
    slide_m: tuple[float, float]
    """Slide of a planted foot per stance: at chance 99 %, and the largest, metres."""
    penetration_m: float
    """Deepest sole under the ground, metres."""
    joint_excess_deg: float
    """Largest turn of a joint beyond human limits, degrees."""
    frames: int
    racket_m: tuple[float, float]
    """Distance between the ball and the middle of the strings' contact at hits: at chance 99 %, and the largest."""
    hits: int


def match_plays(scene: Scene, seed: int, count: int) -> Iterator[tuple[Match, Play]]:
    """So many plays of several matches on all surfaces."""
    for first in range(0, count, PLAYS_A_MATCH):
        number = first // PLAYS_A_MATCH
        match = draw_match(np.random.default_rng([seed, number, 0]), scene, name=f"m{number}")
        stream = plays(match, np.random.default_rng([seed, number, 1]))
        for _ in range(min(PLAYS_A_MATCH, count - first)):
            yield match, next(stream)


def measure_physics(scene: Scene, seed: int, count: int, *, bodies: int) -> PhysicsFigures:
    """The figures of `count` plays; bodies are posed in the first `bodies` of them."""
    gains, serves, forehands = [], [], []
    slides, deep, beyond, rackets = [], [0.0], [0.0], []
    flights, frames, posed = 0, 0, 0
    for number, (match, play) in enumerate(match_plays(scene, seed, count)):
        if not match.world.air.wind.any():
            gains.append(energy_gains(play.ball, match.world.build, match.world.air.gravity).max())
        flights += len(play.ball.flights)
        lost = iter(speed_losses(play.ball))
        losses = {i: next(lost) for i, c in enumerate(play.ball.contacts[:-1]) if c.kind == "hit"}
        for shot in play.shots:
            stroke = play.strokes[shot.stroke]
            if stroke.kind == "serve" and play.serve_number == 1:
                serves.append(losses[shot.contact])
            elif (stroke.kind, stroke.side) == ("drive", "forehand") and 28.0 < shot.speed < 34.0:
                forehands.append(losses[shot.contact])
        if number < bodies:
            posed += 1
            for player in (0, 1):
                times = np.arange(0.0, play.duration_s, 1.0 / FRAMES_A_SECOND)
                track = body_of(play, player, times)
                figure = play.athletes[player].figure
                slides.append(foot_slides(figure, track))
                deep.append(float(ground_penetration(figure, track).max()))
                beyond.append(float(joint_violations(track).max()))
                rackets += _racket_errors(play, player)
                frames += len(times)
    slide = np.concatenate(slides) if slides else np.zeros(1)
    racket = np.array(rackets) if rackets else np.zeros(1)
    return PhysicsFigures(
        plays=count,
        flights=flights,
        energy_gain=float(max(gains, default=0.0)),
        drop_ratio={name: drop_ratio(scene, seed, name) for name in SURFACES},
        serve_loss=_spread(serves),
        forehand_loss=_spread(forehands),
        stances=len(slide),
        slide_m=(float(np.quantile(slide, 0.99)), float(slide.max())),
        penetration_m=max(deep),
        joint_excess_deg=float(np.degrees(max(beyond))),
        frames=frames,
        racket_m=(float(np.quantile(racket, 0.99)), float(racket.max())),
        hits=len(rackets),
    )


def _racket_errors(play: Play, player: int) -> list[float]:
    """Distance of the ball from where the strings would touch it, at every hit, metres."""
    strokes = [s for s in play.strokes if s.player == player and s.hit]
    if not strokes:
        return []
    figure = play.athletes[player].figure
    track = body_of(play, player, np.array([s.time for s in strokes]))
    R, t = world_from_joints(figure, track.root_position, track.rotations)
    hand = smpl24().joint_names.index("R_Hand" if figure.hand == "right" else "L_Hand")
    errors = []
    for i, stroke in enumerate(strokes):
        palm = stroke.side != "backhand"
        place = ball_at_contact(R[i, hand], t[i, hand], figure.hand, palm_side=palm)
        errors.append(float(np.linalg.norm(place - stroke.ball)))
    return errors


def drop_ratio(scene: Scene, seed: int, surface: SurfaceName) -> float:
    """Height of the first rebound over that of the drop, both of the ball's underside, after 2.54 m."""
    match = draw_match(np.random.default_rng(seed), scene, name="drop", surface=surface)
    build, still = match.world.build, np.zeros(3)
    world = FlightWorld(
        air=match.world.air,
        build=build,
        surface=match.world.surface,
        net=None,
        floor_z=0.0,
        bounds=match.world.bounds,
    )
    start = np.array([0.0, -5.0, DROP_M + build.radius_m])
    flights, _ = follow(start, still, still, 0.0, world, until=1.6, rng=np.random.default_rng(0))
    return float((flights[1].positions[:, 2].max() - build.radius_m) / DROP_M)


def _spread(values: list[float]) -> tuple[float, float, float]:
    known = np.array([v for v in values if np.isfinite(v)])
    if not len(known):
        return float("nan"), float("nan"), float("nan")
    low, middle, high = np.quantile(known, [0.05, 0.5, 0.95])
    return float(low), float(middle), float(high)
