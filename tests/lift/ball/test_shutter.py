"""The shutter time from streaks."""

import numpy as np
import pytest

from pgm_data.geometry.camera import Camera, project
from pgm_data.lift.ball.shutter import pixel_velocity, shutter_from_streaks

FRAME_S = 0.04


def moving(frames=60, seed=0):
    rng = np.random.default_rng(seed)
    return rng.uniform(-900, 900, (frames, 2))


def test_streaks_that_fit_tell_the_shutter_whatever_their_sign():
    speed = moving()
    sign = np.where(np.arange(len(speed)) % 2, 1.0, -1.0)[:, None]
    noise = np.random.default_rng(1).normal(0, 0.3, speed.shape)
    found = shutter_from_streaks(sign * speed * 0.008 + noise, speed, FRAME_S)
    assert found is not None
    assert found.mean == pytest.approx(0.008, abs=4 * found.std + 2e-4)


def test_wrong_streaks_among_them_do_not_change_it():
    speed = moving()
    streak = 0.01 * speed
    streak[::5] = streak[::5][:, ::-1] * [1, -1] * 3
    found = shutter_from_streaks(streak, speed, FRAME_S)
    assert found is not None and found.mean == pytest.approx(0.01, rel=0.02)


@pytest.mark.parametrize("streak", [np.full((60, 2), np.nan), np.full((60, 2), 0.1)])
def test_nothing_is_said_without_streaks(streak):
    assert shutter_from_streaks(streak, moving(), FRAME_S) is None


def test_no_shutter_is_longer_than_a_frame():
    assert shutter_from_streaks(0.2 * moving(), moving(), FRAME_S) is None


def test_the_speed_in_the_picture_is_that_of_projected_positions():
    camera = Camera(
        K=np.array([[[2000.0, 0, 639.5], [0, 2000.0, 359.5], [0, 0, 1]]] * 3),
        distortion=np.zeros((3, 4)),
        R_cam_from_world=np.array([[[1.0, 0, 0], [0, -0.3, -np.sqrt(0.91)], [0, np.sqrt(0.91), -0.3]]] * 3),
        t_cam_from_world=np.array([[0.0, 1.0, 40.0]] * 3),
    )
    position = np.array([[0.0, -5, 1], [1, 0, 2], [2, 8, 0.5]])
    velocity = np.array([[3.0, 30, 2], [-4, 20, -3], [0, -35, 1]])
    step = 1e-5
    one, _ = project(camera, (position - step * velocity)[:, None])
    two, _ = project(camera, (position + step * velocity)[:, None])
    assert pixel_velocity(camera, position, velocity) == pytest.approx((two - one)[:, 0] / (2 * step), rel=1e-4)
