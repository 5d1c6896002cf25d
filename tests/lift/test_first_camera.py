"""First cameras from points: the known degeneracies of a plane must not come back as cameras."""

import numpy as np
import pytest

from pgm_data.lift.court_camera import project
from pgm_data.lift.first_camera import FirstOptions, camera_of_homography, camera_of_points, focal_of_homography
from pgm_data.scene import load_scene
from tests.lift.test_court_camera import looking_at_court

court = load_scene("tennis").court
assert court is not None
SIZE = (1920, 1080)


def homography_of(camera):
    """Pixel from ground of an undistorted camera."""
    as_camera = camera.as_camera()
    return as_camera.K @ np.column_stack([as_camera.R_cam_from_world[:, :2], as_camera.t_cam_from_world])


def test_focal_comes_back_on_the_courts_long_axis_where_orthogonality_says_nothing():
    camera = looking_at_court((0.0, -40.0, 11.0), focal=4330.0, radial=0.0)
    found = focal_of_homography(homography_of(camera), camera.principal_px)
    assert found == pytest.approx(4330.0, rel=1e-9)


def test_focal_is_well_posed_under_noise_on_the_long_axis():
    rng = np.random.default_rng(3)
    camera = looking_at_court((0.0, -40.0, 11.0), focal=4330.0, radial=0.0)
    found = []
    for _ in range(40):
        import cv2

        pixels = project(camera, court.points_world) + rng.normal(size=(14, 2))
        H, _ = cv2.findHomography(court.points_world[:, :2], pixels)
        found.append(focal_of_homography(H, camera.principal_px))
    assert np.isfinite(found).all()
    assert np.median(found) == pytest.approx(4330, rel=0.02)


def test_the_camera_behind_an_exact_homography_is_exact():
    camera = looking_at_court((2.0, -33.0, 9.0), focal=2100.0, radial=0.0, pan=0.05, roll=0.01)
    found = camera_of_homography(homography_of(camera), size=SIZE, options=FirstOptions())
    assert found is not None
    np.testing.assert_allclose(found.position_world, camera.position_world, atol=1e-6)
    np.testing.assert_allclose(found.R_cam_from_world, camera.R_cam_from_world, atol=1e-9)


def test_a_homography_that_no_camera_makes_gives_none():
    assert camera_of_homography(np.diag([20.0, -20.0, 1.0]), size=SIZE, options=FirstOptions()) is None


@pytest.mark.parametrize("seed", range(8))
def test_coplanar_points_alone_give_the_right_focal(seed):
    rng = np.random.default_rng(seed)
    camera = looking_at_court((0.3, -40.0, 11.0), focal=4330.0, radial=0.0)
    pixels = project(camera, court.points_world) + rng.normal(size=(14, 2))
    found = camera_of_points(court.points_world, pixels, size=SIZE, options=FirstOptions())
    assert found is not None
    assert float(found[0].focal_px) == pytest.approx(4330, rel=0.02)
    assert np.linalg.norm(found[0].position_world - camera.position_world) < 0.8


@pytest.mark.parametrize("seed", range(6))
def test_wrong_and_swapped_points_are_left_out(seed):
    rng = np.random.default_rng(seed)
    camera = looking_at_court((0.3, -32.0, 9.0), focal=2100.0, radial=0.02)
    pixels = project(camera, court.all_world) + rng.normal(size=(17, 2))
    a, b, c = rng.choice(14, 3, replace=False)
    pixels[[a, b]] = pixels[[b, a]]
    pixels[c] += 300
    found = camera_of_points(court.all_world, pixels, size=SIZE, options=FirstOptions())
    assert found is not None
    camera_found, inlier = found
    assert not inlier[[a, b, c]].any()
    assert inlier.sum() >= 12
    assert np.linalg.norm(camera_found.position_world - camera.position_world) < 1.5


def test_random_points_give_no_camera_that_most_of_them_support():
    rng = np.random.default_rng(0)
    for _ in range(20):
        found = camera_of_points(court.all_world, rng.uniform(0, 1000, (17, 2)), size=SIZE, options=FirstOptions())
        assert found is None or found[1].sum() < 9


@pytest.mark.parametrize("count", [0, 1, 4])
def test_too_few_points_give_none(count):
    pixels = np.full((17, 2), np.nan)
    camera = looking_at_court((0.3, -32.0, 9.0))
    pixels[:count] = project(camera, court.all_world)[:count]
    assert camera_of_points(court.all_world, pixels, size=SIZE, options=FirstOptions()) is None
