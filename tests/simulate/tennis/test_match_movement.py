"""Laws of running: limits kept, no jumps, goals met when they are said to be met."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from pgm_data.simulate.body.figure import Hand
from pgm_data.simulate.tennis import movement
from pgm_data.simulate.tennis.heading import FASTEST_TURN, headings, turn_of
from pgm_data.simulate.tennis.movement import RATE, Limits, Track, can_stop, inside

_LIMITS = Limits(speed=7.0, acceleration=8.0, player=0)
_places = st.tuples(st.floats(-8.0, 8.0), st.floats(-17.0, -2.0)).map(np.array)
_velocities = st.tuples(st.floats(0.0, 6.5), st.floats(-np.pi, np.pi)).map(
    lambda polar: polar[0] * np.array([np.cos(polar[1]), np.sin(polar[1])])
)
_spans = st.floats(0.12, 3.0)


def _runs(track: Track, start: float) -> None:
    """Check a track from a start on by fine differences, independent of its own coefficients' meaning."""
    times = start + np.arange(0.0, 10.0, 0.004)
    places = track.sampled(times)
    velocity = np.diff(places, axis=0) / 0.004
    acceleration = np.diff(velocity, axis=0) / 0.004
    assert np.hypot(*velocity.T).max() <= _LIMITS.speed * 1.001 + 1e-6
    assert np.hypot(*acceleration.T).max() <= _LIMITS.acceleration * 1.001 + 1e-4
    assert inside(places, 0).all()
    np.testing.assert_allclose(places[-1], places[-2], atol=1e-9)


def _track(place: np.ndarray, velocity: np.ndarray) -> Track:
    track = Track(place)
    track.follow([movement.Piece(start=0.0, coefficients=np.stack([place, velocity, np.zeros(2), np.zeros(2)]))])
    return track


@given(place=_places, velocity=_velocities, goal=_places, span=_spans)
def test_a_way_is_at_its_goal_in_time_within_the_limits(
    place: np.ndarray, velocity: np.ndarray, goal: np.ndarray, span: float
) -> None:
    assume(bool(can_stop(place, velocity, _LIMITS)))
    way = movement.way_to(0.0, span, place, velocity, goal, _LIMITS, step=np.array([0.0, 0.4]))
    # Whoever could walk there in time and is at rest is never told that it is out of reach.
    if way is None:
        assert np.hypot(*velocity) > 0 or np.hypot(*(goal - place)) > 0.2 * _LIMITS.acceleration * span**2
        return
    track = _track(place, velocity)
    track.follow(way)
    np.testing.assert_allclose(track.at(span)[0], goal, atol=0.011)
    _runs(track, 0.0)


@given(place=_places, velocity=_velocities, goal=_places, span=_spans)
def test_recovering_strolling_braking_and_chasing_keep_the_limits(
    place: np.ndarray, velocity: np.ndarray, goal: np.ndarray, span: float
) -> None:
    assume(bool(can_stop(place, velocity, _LIMITS)))
    ways = (
        movement.recovered(0.0, span, place, velocity, goal, _LIMITS),
        movement.strolled(0.0, place, velocity, goal, _LIMITS),
        movement.braked(0.0, place, velocity, _LIMITS),
        movement.chased(0.0, span, place, velocity, goal, _LIMITS),
    )
    for way in ways:
        track = _track(place, velocity)
        track.follow(way)
        # A brief chase may start from a run that its limits do not foresee; all of them start where the player is.
        np.testing.assert_allclose(track.at(0.0)[0], place, atol=1e-9)
        _runs(track, 0.0)
    np.testing.assert_allclose(ways[1][-1].coefficients[0], goal, atol=1e-9)


@given(span=st.floats(0.2, 2.0), share=st.floats(1.02, 3.0))
def test_what_lies_beyond_all_acceleration_is_out_of_reach(span: float, share: float) -> None:
    place = np.array([0.0, -12.0])
    most = min(0.5 * _LIMITS.acceleration * span**2, _LIMITS.speed * span)
    goal = place + np.array([min(share * most, 9.5), 0.0])
    assume(goal[0] > 1.02 * most)
    assert movement.way_to(0.0, span, place, np.zeros(2), goal, _LIMITS, step=np.zeros(2)) is None


@pytest.mark.parametrize("player", [0, 1])
@pytest.mark.parametrize("hand", ["left", "right"])
def test_hips_look_at_the_net_at_rest_into_a_run_and_to_the_side_of_a_stroke(player: int, hand: Hand) -> None:
    forward, base = (1.0, 0.0) if player == 0 else (-1.0, np.pi)
    still = np.tile(forward * np.array([1.0, -12.0]), (200, 1))
    np.testing.assert_allclose(headings(still, player, hand, []), base)
    times = np.arange(200) / RATE
    # To the player's own right at 5 m/s after a second.
    x = np.where(times > 1.0, 5.0 * (times - 1.0), 0.0)
    run = np.stack([forward * x, np.full(200, -12.0 * forward)], axis=1)
    turned = headings(run, player, hand, []) - base
    assert np.abs(turned[:50]).max() < 0.05
    assert turned[-1] == pytest.approx(-np.pi / 2, abs=0.02), "clockwise, to the right"
    assert np.abs(np.diff(turned)).max() * RATE <= FASTEST_TURN + 1e-9
    turn = turn_of(known=1.0, time=2.0, side="forehand", hands=1, hand=hand)
    struck = headings(still, player, hand, [turn]) - base
    racket = -1.0 if hand == "right" else 1.0
    assert racket * struck[100] > 0.1 and np.abs(struck[100]) < np.radians(60)
    assert np.abs(struck[:50]).max() == 0.0, "nobody turns for a ball before setting out for it"
    assert np.abs(struck[-1]) < 0.1
