"""Movements by hand-made paths: ways are the player's own, gaits go with speed and with where the body looks."""

from dataclasses import replace

import numpy as np
import pytest

from pgm_data.caption.movement import Movement, changes_of, movement_between, path_of, runs_of
from tests.caption.rallies import BLOCKS, person, times_of

SECONDS = 3.0
TIMES = times_of(SECONDS)


def glide(start: tuple[float, float], velocity: tuple[float, float], times: np.ndarray = TIMES) -> np.ndarray:
    return np.asarray(start) + np.asarray(velocity) * times[:, None]


def moved(index: int, xy: np.ndarray, heading=None, times: np.ndarray = TIMES, noise: float = 0.0, **more) -> Movement:
    track = person(index, xy, heading)
    if noise:
        shake = np.random.default_rng(2).normal(0, noise, track.root_position.shape)
        track = replace(track, root_position=track.root_position + shake)
    path = path_of(track, times, 0, len(times), 1 if index == 0 else -1)
    assert path is not None
    return movement_between(path, times[0], times[-1], has_net=True, **more)


@pytest.mark.parametrize(
    ("velocity", "way"),
    [
        ((2.0, 0.0), "right"),
        ((-2.0, 0.0), "left"),
        ((0.0, 2.0), "forward"),
        ((0.0, -2.0), "back"),
        ((1.5, 1.5), "right forward"),
        ((-1.5, -1.5), "left back"),
    ],
)
def test_ways_are_the_players_own_at_either_end(velocity, way):
    near = moved(0, glide((0.0, -10.0), velocity))
    far = moved(1, -glide((0.0, -10.0), velocity))
    assert (near.motion, near.way) == ("moves", way)
    assert (far.motion, far.way) == ("moves", way)


@pytest.mark.parametrize(
    ("speed", "heading", "gait"),
    [
        (6.0, -np.pi / 2, "sprint"),
        (4.5, -np.pi / 2, "run"),
        (1.5, -np.pi / 2, "walk"),
        (2.5, 0.0, "sidestep"),
        (2.5, np.pi / 2, "move"),
        (0.25, 0.0, "step"),
    ],
)
def test_gaits_go_with_speed_and_with_where_the_body_looks(speed, heading, gait):
    assert moved(0, glide((-8.0, -12.0), (speed, 0.0)), heading).gait == gait


def test_backwards_with_the_eyes_on_the_net_is_backpedalling():
    assert moved(0, glide((0.0, -8.0), (0.0, -2.0)), 0.0).gait == "backpedal"
    unknown = person(0, glide((0.0, -8.0), (0.0, -2.0)))
    unknown = replace(unknown, joint_rotations=unknown.joint_rotations * np.nan)
    path = path_of(unknown, TIMES, 0, len(TIMES), 1)
    assert path is not None
    found = movement_between(path, 0.0, SECONDS, has_net=True)
    assert (found.way, found.gait) == ("back", "move"), "how it looks is not known, and not claimed"


def test_there_and_back_is_a_turn_and_standing_is_still():
    out = np.where(TIMES < 1.5, TIMES, 3.0 - TIMES) * 2.0
    found = moved(0, np.stack([out, np.full_like(out, -12.0)], -1))
    assert (found.motion, found.way, found.second_way) == ("turns", "right", "left")
    assert moved(0, glide((1.0, -12.0), (0.0, 0.0))).motion == "still"


def test_noise_of_a_solver_makes_no_movement():
    still = moved(0, glide((1.0, -12.0), (0.0, 0.0)), noise=0.02)
    assert still.motion == "still"
    assert moved(0, glide((1.0, -12.0), (2.0, 0.0)), noise=0.05).way == "right"


def test_a_place_that_is_not_known_well_moves_nowhere():
    track = person(0, glide((1.0, -12.0), (0.3, 0.0)))
    vague = replace(track, root_cov=np.broadcast_to(np.eye(3) * 2.0**2, track.root_cov.shape))
    for one, motion in ((track, "moves"), (vague, "")):
        path = path_of(one, TIMES, 0, len(TIMES), 1)
        assert path is not None
        assert movement_between(path, 0.0, SECONDS, has_net=True).motion in (motion, "shifts")
    path = path_of(vague, TIMES, 0, len(TIMES), 1)
    assert path is not None
    assert movement_between(path, 0.0, SECONDS, has_net=True).way == ""


def test_the_frame_rate_does_not_matter():
    for fps in (15.0, 25.0, 60.0):
        times = times_of(SECONDS, fps)
        found = moved(0, glide((0.0, -12.0), (2.5, 0.0), times), 0.0, times)
        assert (found.way, found.gait) == ("right", "sidestep")
        assert found.top_speed_m_s == pytest.approx(2.5, abs=0.05)


def test_repeated_frames_are_no_moments_of_their_own():
    times = np.repeat(TIMES[::2], 2)[: len(TIMES)]
    found = moved(0, glide((0.0, -12.0), (2.5, 0.0), times), 0.0, times)
    assert found.top_speed_m_s == pytest.approx(2.5, abs=0.05)


def test_without_a_net_ways_are_of_the_compass_and_jumps_are_seen():
    hop = np.maximum(0.0, 3.0 * (TIMES - 1.0) - 5.0 * (TIMES - 1.0) ** 2) * (TIMES > 1.0)
    track = person(0, glide((0.0, 0.0), (0.0, -1.5)), z=hop, scene=BLOCKS)
    path = path_of(track, TIMES, 0, len(TIMES), 0)
    assert path is not None
    found = movement_between(path, 0.0, SECONDS, has_net=False)
    assert (found.way, found.jumps) == ("south", True)
    assert movement_between(path, 2.0, SECONDS, has_net=False).jumps is False


def test_stretches_end_where_states_do():
    track = person(0, glide((0.0, -12.0), (1.0, 0.0)))
    status = track.status.copy()
    status[10:20] = "none"
    assert runs_of(replace(track, status=status), TIMES) == [(0, 10), (20, len(TIMES))]
    assert runs_of(replace(track, status=np.full(len(TIMES), "none", dtype=object)), TIMES) == []
    one = person(0, np.zeros((1, 2)))
    assert path_of(one, np.zeros(1), 0, 1, 1) is None
    gap = TIMES + np.where(TIMES > 1.0, 2.0, 0.0)
    assert len(runs_of(track, gap)) == 2


def test_changes_are_found_where_a_player_starts_and_stops():
    way = np.clip(TIMES - 1.0, 0.0, 1.0) * 3.0
    path = path_of(person(0, np.stack([way, np.full_like(way, -12.0)], -1)), TIMES, 0, len(TIMES), 1)
    assert path is not None
    found = changes_of(path)
    for moment in (1.0, 2.0):
        assert np.abs(found - moment).min() < 0.15
