"""The drawing camera agrees with OpenCV's own projection, and its parts with each other."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from jaxtyping import TypeCheckError

from pgm_data.scene import load_scene
from pgm_data.simulate.camera import (
    CameraTrack,
    distorted,
    k1_of_half_diagonal,
    pixels_of,
    rotation_towards,
    undistorted,
)
from pgm_data.simulate.views import any_view, broadcast_pose, points_in_picture, track_of

SEEDS = st.integers(0, 2**32 - 1)


@settings(max_examples=40)
@given(SEEDS)
def test_projects_as_opencv_does(seed: int) -> None:
    rng = np.random.default_rng(seed)
    court = load_scene("tennis").court
    assert court is not None
    view = any_view(rng, court, (1280, 720))
    points = view.centre_world + view.R_cam_from_world.T @ [0, 0, 30.0] + rng.uniform(-8, 8, (50, 3))
    rotation, _ = cv2.Rodrigues(view.R_cam_from_world)
    lens = np.array([view.k1, 0, 0, 0])
    expected, _ = cv2.projectPoints(points, rotation, view.t_cam_from_world, view.K, lens)
    found = pixels_of(points, view.K, view.k1, view.R_cam_from_world, view.t_cam_from_world)
    np.testing.assert_allclose(found, expected[:, 0], atol=1e-6)


@given(SEEDS, st.floats(0.0, 0.3))
def test_undistorting_takes_the_distortion_back(seed: int, k1: float) -> None:
    rays = np.random.default_rng(seed).uniform(-0.8, 0.8, (20, 2))
    np.testing.assert_allclose(undistorted(distorted(rays, k1), k1), rays, atol=1e-12)


@given(SEEDS, st.floats(-0.7, 0.7))
def test_a_rotation_looks_along_its_direction_and_is_proper(seed: int, roll: float) -> None:
    direction = np.random.default_rng(seed).normal(size=3) + [0.0, 3.0, 0.0]
    R = rotation_towards(direction, roll)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(R) == pytest.approx(1.0)
    np.testing.assert_allclose(R @ direction, [0, 0, np.linalg.norm(direction)], atol=1e-9)


def test_without_roll_the_world_stands_upright() -> None:
    R = rotation_towards(np.array([0.1, 1.0, -0.2]), 0.0)
    assert (R @ [0, 0, 1])[1] < -0.9
    assert (R @ [1, 0, 0])[0] > 0.9


def test_a_positive_roll_turns_the_camera_clockwise_so_the_picture_turns_back() -> None:
    R = rotation_towards(np.array([0.0, 1.0, 0.0]), 0.1)
    up = R @ [0, 0, 1]
    assert up[0] < 0 < -up[1]


def test_looking_straight_down_is_refused() -> None:
    with pytest.raises(ValueError, match="not vertical"):
        rotation_towards(np.array([0.0, 0.0, -1.0]), 0.0)


def test_points_behind_the_camera_have_no_pixel() -> None:
    assert np.isnan(pixels_of(np.array([0.0, 0.0, -1.0]), np.eye(3), 0.0, np.eye(3), np.zeros(3))).all()


def test_the_lens_term_is_counted_over_the_half_diagonal() -> None:
    """A ray to the picture's corner is moved outwards by the share k, whatever the focal length."""
    half = np.hypot(640, 360)
    for focal in (900.0, 3000.0):
        k1 = k1_of_half_diagonal(0.04, focal, 1280, 720)
        assert distorted(np.array([half / focal, 0.0]), k1)[0] * focal == pytest.approx(1.04 * half)


def test_a_track_of_unequal_lengths_is_refused() -> None:
    with pytest.raises((ValueError, TypeCheckError)):
        CameraTrack(
            K=np.zeros((2, 3, 3)),
            distortion=np.zeros((1, 4)),
            R_cam_from_world=np.zeros((2, 3, 3)),
            t_cam_from_world=np.zeros((2, 3)),
        )


def test_frames_without_a_camera_are_nan_in_the_track() -> None:
    court = load_scene("tennis").court
    assert court is not None
    view = any_view(np.random.default_rng(0), court, (640, 360))
    track = track_of([None, view])
    assert track.shows_court.tolist() == [False, True]
    for values in (track.K, track.distortion, track.R_cam_from_world, track.t_cam_from_world):
        assert np.isnan(values[0]).all() and np.isfinite(values[1]).all()


@pytest.mark.parametrize("scene", ["tennis", "badminton", "pickleball", "tabletennis"])
def test_broadcast_cameras_stand_where_such_cameras_stand_and_see_most_of_the_court(scene: str) -> None:
    court = load_scene(scene).court
    assert court is not None
    scale = np.abs(court.points_world[:, 1]).max() / 11.835
    size = (1280, 720)
    near = court.points_world[np.isclose(court.points_world[:, 1], court.points_world[:, 1].min())]
    for seed in range(40):
        pose = broadcast_pose(np.random.default_rng(seed), court, size)
        x, y, z = pose.centre_world / scale
        assert -53 <= y <= -29 and 6 <= z <= 14 and abs(x) < 2.5
        assert abs(pose.roll) <= np.radians(0.7) and 0 <= pose.k <= 0.05
        view = pose.view(size)
        px = pixels_of(near, view.K, view.k1, view.R_cam_from_world, view.t_cam_from_world)
        assert 0.5 * size[0] < np.ptp(px[:, 0]) < 1.05 * size[0]
        assert points_in_picture(court, view, size) >= 0.6 * len(court.points_world)
