"""A ball's track, its camera and what people marked, put into metres by the solvers of `lift`."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Float, Int

from pgm_data.ball import BallTrack
from pgm_data.dataset.clip_ball import ClipBall, EventRows, ShotRows
from pgm_data.lift.ball.landing import SERVE_HEIGHT, in_probability, serves
from pgm_data.lift.ball.solution import BallSolution
from pgm_data.lift.ball.world import ball_world
from pgm_data.scene import Prior, Scene
from pgm_data.stages.ball_events import Surroundings, read_events
from pgm_data.stages.ball_withheld import without_absurd

Method = Literal["line", "physics"]
Quality = Literal["draft", "standard", "best"]
METHODS: tuple[Method, ...] = ("line", "physics")


@dataclass(frozen=True, eq=False, kw_only=True)
class LiftedBall:
    """A ball in metres, with what is told of its landings."""

    track: BallTrack
    solution: BallSolution
    is_serve: np.ndarray
    """Of each event."""
    in_probability: Float[np.ndarray, " flights"]


def lift_ball(
    track: BallTrack,
    around: Surroundings,
    *,
    scene: Scene,
    method: Method = "physics",
    quality: Quality = "standard",
    drag: Prior | None = None,
) -> LiftedBall:
    """The track in metres: events found where nobody marked them, then solved by the method.

    Args:
        track: The ball in the picture.
        around: Camera, players and marks.
        scene: Its ball and court.
        method: The paper's line method, or the physics fit that starts from it.
        quality: Effort of the physics fit.
        drag: A better prior of the drag constant than the scene's, from measured serves.

    Raises:
        ValueError: If the scene has no ball or no court.
    """
    world = ball_world(scene)
    if drag is not None:
        world = replace(world, drag_per_m=drag)
    events, solution = read_events(track, around, world)
    if method == "physics":
        from pgm_data.lift.ball.physics_solve import physics_preset, solve_physics

        solution = solve_physics(
            track, events, around.camera, world=world, doubt=around.doubt, players=around.players,
            options=physics_preset(quality), start=solution,
        )  # fmt: skip
    solution = without_absurd(solution, track.times, world)
    return judged(track, with_players(solution, scene), scene)


def with_players(solution: BallSolution, scene: Scene) -> BallSolution:
    """The solution with hits that nobody is named for given to the player of the half they happen in.

    Scenes of two players have the near one first.
    """
    events = solution.events
    if len(scene.players) != 2:
        return solution
    y = solution.event_position[:, 1]
    open_hits = (events.kinds == "hit") & (events.players == "") & np.isfinite(y)
    names = np.array(events.players, dtype=object)
    names[open_hits & (y < 0)] = scene.players[0].name
    names[open_hits & (y >= 0)] = scene.players[1].name
    return replace(solution, events=replace(events, players=names))


def judged(track: BallTrack, solution: BallSolution, scene: Scene) -> LiftedBall:
    """The solution with its serves and how probably each hit lands in."""
    court = scene.court
    assert court is not None
    events, flights = solution.events, solution.flights
    world = ball_world(scene)
    served = serves(
        events.kinds,
        events.times,
        solution.event_position,
        serve_z=world.floor_z + SERVE_HEIGHT * scene.person_height_m,
    )
    probability = np.full(len(flights), np.nan)
    for i, start in enumerate(flights.start_event):
        if events.kinds[start] == "hit":
            probability[i] = in_probability(
                flights.landing[i],
                flights.landing_cov[i],
                start=solution.event_position[start],
                is_serve=bool(served[start]),
                in_play=court.in_play,
                in_serve=court.in_serve,
            )
    return LiftedBall(track=track, solution=solution, is_serve=served, in_probability=probability)


def clip_ball(
    lifted: LiftedBall,
    *,
    clip_id: str,
    video_frame: Int[np.ndarray, " frames"],
    timestamp: Float[np.ndarray, " frames"],
) -> ClipBall:
    """The tables' rows of a lifted ball."""
    solution, track = lifted.solution, lifted.track
    events, flights = solution.events, solution.flights
    start_kind = events.kinds[flights.start_event]
    score = np.where(np.isfinite(track.pixels[:, 0]), track.score, np.nan)
    return ClipBall(
        clip_id=clip_id,
        video_frame=video_frame,
        timestamp=timestamp,
        capture_time=track.times,
        pixel=track.pixels,
        score=score,
        position=solution.position,
        velocity=solution.velocity,
        position_cov=solution.position_cov,
        status=solution.status,
        events=EventRows(
            time=events.times,
            kind=events.kinds,
            player=events.players,
            probability=events.probability,
            source=events.sources,
            position=solution.event_position,
        ),
        shots=ShotRows(
            start_event=flights.start_event,
            end_event=flights.end_event,
            player=np.where(start_kind == "hit", events.players[flights.start_event], ""),
            start_speed=np.linalg.norm(flights.start_velocity, axis=1),
            spin=flights.spin,
            spin_std=flights.spin_std,
            drag_per_m=flights.drag_per_m,
            drag_std_per_m=flights.drag_std_per_m,
            landing_position=flights.landing,
            in_probability=lifted.in_probability,
            free_parameters=np.array([" ".join(names) for names in flights.free], dtype=object),
            residual_px=flights.residual_px,
            status=np.array(
                [
                    f"{status}: {said}" if said else status
                    for status, said in zip(flights.status, flights.said, strict=True)
                ],
                dtype=object,
            ),
        ),
    )
