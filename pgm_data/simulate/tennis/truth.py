"""What is true in every frame of a play: bodies, ball, events, flights, captions."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from pgm_data.simulate.body.figure import BodyTrack, world_from_joints
from pgm_data.simulate.body.keypoints import hull, keypoints17
from pgm_data.simulate.body.move import body_track, hand_position
from pgm_data.simulate.states import BallEvent, BallFlight, BallStates, PlayerStates, ShotStates
from pgm_data.simulate.tennis.captions import captions_of
from pgm_data.simulate.tennis.play import Play

PLAYER_NAMES = ("player0", "player1")
SETTLES_S = 0.12
"""Before the toss the held ball moves from the middle of the palm to the point of its release within this time."""


def body_of(play: Play, player: int, times: Float[np.ndarray, " times"]) -> BodyTrack:
    """One player's body at these times of the play."""
    strokes = tuple(s for s in play.strokes if s.player == player)
    return body_track(play.athletes[player].figure, play.plans[player], strokes, _watched(play), times)


def _watched(play: Play) -> Callable[[np.ndarray], np.ndarray]:
    """The ball in flight as both players look at it."""
    return lambda times: play.ball.at(times)[0]


def ball_at(play: Play, times: Float[np.ndarray, " times"]) -> tuple[np.ndarray, np.ndarray]:
    """Positions and velocities of the ball: in the server's hand, then on its course; NaN once it is gone."""
    position, velocity = play.ball.at(times)
    release = play.ball.contacts[0]
    held = times < release.time
    if held.any():
        step = 1e-3
        # Both moments at once: every call plans the server's footsteps anew.
        at = times[held]
        now, before = np.split(_held(play, np.concatenate([at, at - step])), 2)
        position[held], velocity[held] = now, (now - before) / step
    return position, velocity


def _held(play: Play, times: np.ndarray) -> np.ndarray:
    release = play.ball.contacts[0]
    at = np.append(np.maximum(times, 0.0), release.time)
    hand = hand_position(body_of(play, play.server, at), play.athletes[play.server].figure)
    gap = release.position - hand[-1]
    share = np.clip(1.0 - (release.time - at[:-1]) / SETTLES_S, 0.0, 1.0)[:, None]
    return hand[:-1] + share * share * (3.0 - 2.0 * share) * gap


def play_states(play: Play, times: Float[np.ndarray, " times"], rng: np.random.Generator) -> ShotStates:
    """The states at these times; events and captions on the play's own clock, to its end."""
    position, velocity = ball_at(play, times)
    return ShotStates(
        players=tuple(_player_states(play, player, times) for player in (0, 1)),
        ball=BallStates(position=position, velocity=velocity),
        events=_events(play),
        flights=_flights(play),
        captions=captions_of(play, rng),
    )


def _player_states(play: Play, player: int, times: np.ndarray) -> PlayerStates:
    athlete = play.athletes[player]
    track = body_of(play, player, times)
    R, t = world_from_joints(athlete.figure, track.root_position, track.rotations)
    translations = np.repeat(athlete.figure.translations[None], len(times), axis=0)
    translations[:, 0] = track.root_position
    centres, radii = hull(athlete.figure, R, t)
    return PlayerStates(
        identity=athlete.identity,
        handedness=athlete.figure.hand,
        rotations=track.rotations,
        translations=translations,
        joints=t,
        contact=track.contact,
        keypoints=keypoints17(athlete.figure, R, t),
        hull_centres=centres,
        hull_radii=radii,
    )


def _events(play: Play) -> tuple[BallEvent, ...]:
    return tuple(
        BallEvent(
            time=c.time,
            kind=c.kind,
            player=PLAYER_NAMES[c.player] if c.kind == "hit" else "",
            position=c.position,
        )
        for c in play.ball.contacts
    )


def _flights(play: Play) -> tuple[BallFlight, ...]:
    contacts = play.ball.contacts
    shots = {shot.contact: shot for shot in play.shots}
    rows = []
    for i, flight in enumerate(play.ball.flights):
        start, end = contacts[i], contacts[i + 1]
        lands = end.kind == "bounce"
        landing = np.append(end.position[:2], 0.0) if lands else np.full(3, np.nan)
        shot = shots.get(i)
        rows.append(
            BallFlight(
                start_event=i,
                end_event=i + 1,
                player=PLAYER_NAMES[start.player] if start.kind == "hit" else "",
                start_speed=float(np.linalg.norm(flight.velocities[0])),
                spin=flight.spins[0],
                drag_per_m=flight.drag_per_m,
                landing=landing,
                lands_in=shot.result in ("in", "let") if shot is not None and lands else None,
            )
        )
    return tuple(rows)
