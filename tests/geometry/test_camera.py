import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from jaxtyping import TypeCheckError
from scipy.spatial.transform import Rotation

from pgm_data.geometry.camera import (
    Camera,
    K_with_centre_origin,
    K_with_corner_origin,
    meet_plane,
    project,
    rays,
    unproject,
)
from tests.geometry.opencv import undistorted
from tests.geometry.strategies import cameras, pixels_of

shares = arrays(np.float64, (4, 2), elements=st.floats(-1, 1, allow_subnormal=False))
depths = arrays(np.float64, 4, elements=st.floats(0.5, 200))

PLAIN = {
    "K": np.array([[1000.0, 0, 640], [0, 1000, 360], [0, 0, 1]]),
    "distortion": np.zeros(4),
    "R_cam_from_world": np.eye(3),
    "t_cam_from_world": np.zeros(3),
}


def broadcast_view(focal: float = 2750.0, k1: float = 0.1) -> Camera:
    """A camera 33 m behind the net and 9 m up, looking at the court's near half."""
    R = Rotation.from_euler("x", 90 + 14, degrees=True).as_matrix()
    return Camera(
        K=np.array([[focal, 0, 959.5], [0, focal, 539.5], [0, 0, 1]]),
        distortion=np.array([k1, 0, 0, 0]),
        R_cam_from_world=R,
        t_cam_from_world=-R @ [0.0, -33.0, 9.0],
    )


def track(n: int) -> Camera:
    """So many turning and zooming cameras."""
    one = broadcast_view()
    K = np.tile(one.K, (n, 1, 1))
    K[:, [0, 1], [0, 1]] *= np.linspace(1, 1.5, n)[:, None]
    R = Rotation.from_rotvec(np.linspace([0, 0, 0], [0.02, 0.2, 0], n)).as_matrix() @ one.R_cam_from_world
    t = -R @ one.position_world
    return Camera(K=K, distortion=np.tile(one.distortion, (n, 1)), R_cam_from_world=R, t_cam_from_world=t)


@given(cameras(tangential=True), shares, depths)
def test_project_undoes_unproject(camera, share, depth):
    pixels = pixels_of(camera, share)
    points = unproject(camera, pixels, depth)
    again, seen = project(camera, points)
    assert seen.all()
    np.testing.assert_allclose(again, pixels, atol=1e-6)


@given(cameras(lens=False), shares, depths)
def test_without_a_lens_every_pixel_has_a_ray(camera, share, depth):
    points = unproject(camera, pixels_of(camera, share), depth)
    assert np.isfinite(points).all()
    points_cam = points @ camera.R_cam_from_world.T + camera.t_cam_from_world
    np.testing.assert_allclose(points_cam[:, 2], depth, rtol=1e-9, atol=1e-9)


@given(cameras(), shares)
def test_rays_have_length_one_and_lead_through_their_pixels(camera, share):
    pixels = pixels_of(camera, share)
    directions = rays(camera, pixels)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1, atol=1e-14)
    again, _ = project(camera, camera.position_world + 37.0 * directions)
    np.testing.assert_allclose(again, pixels, atol=1e-6)


@given(cameras(tangential=True), arrays(np.float64, (6, 3), elements=st.floats(-1, 1)))
def test_projection_agrees_with_opencv(camera, offsets):
    spread = min(1.0, 300 / camera.K[0, 0])  # within the picture, and at most 45 degrees off its centre
    points_cam = np.concatenate([spread * offsets[:, :2], np.ones((6, 1))], axis=1) * (20 + 10 * offsets[:, 2:])
    points = (points_cam - camera.t_cam_from_world) @ camera.R_cam_from_world
    rotvec = Rotation.from_matrix(camera.R_cam_from_world).as_rotvec()
    expected, _ = cv2.projectPoints(points, rotvec, camera.t_cam_from_world.copy(), camera.K, camera.distortion)
    pixels, seen = project(camera, points)
    assert seen.all()
    np.testing.assert_allclose(pixels, expected[:, 0], atol=1e-5)


def test_back_projection_agrees_with_opencv():
    camera = broadcast_view()
    pixels = np.random.default_rng(0).uniform([0, 0], [1919, 1079], (40, 2))
    xy = undistorted(pixels, camera.K, camera.distortion)
    expected = np.concatenate([xy, np.ones((40, 1))], axis=1) @ camera.R_cam_from_world
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    np.testing.assert_allclose(rays(camera, pixels), expected, atol=1e-10)


def test_the_centre_of_the_top_left_pixel_is_the_origin():
    camera = Camera(**PLAIN | {"K": np.array([[500.0, 0, 0], [0, 500, 0], [0, 0, 1]])})
    pixels, _ = project(camera, np.array([[0.0, 0.0, 3.0]]))
    np.testing.assert_array_equal(pixels, [[0, 0]])


def test_right_is_right_down_is_down_and_the_world_is_upright():
    pixels, _ = project(broadcast_view(k1=0.0), np.array([[0.0, -5, 0], [3, -5, 0], [0, -5, 2], [0, 5, 0]]))
    middle, right, up, away = pixels
    assert right[0] > middle[0] + 100
    assert up[1] < middle[1] - 100
    assert away[1] < middle[1] - 50


def test_the_position_is_where_every_ray_starts():
    camera = broadcast_view()
    np.testing.assert_allclose(camera.position_world, [0, -33, 9], atol=1e-12)
    np.testing.assert_allclose(track(4).position_world, np.tile([0, -33, 9], (4, 1)), atol=1e-12)


def test_points_behind_or_beside_the_camera_are_nan():
    pixels, seen = project(Camera(**PLAIN), np.array([[0.0, 0, -1], [0, 0, 0], [1, 0, 0], [1, 1, -1e-300], [0, 0, 1]]))
    np.testing.assert_array_equal(seen, [False, False, False, False, True])
    assert np.isnan(pixels[:4]).all()
    np.testing.assert_array_equal(pixels[4], [640, 360])


def test_points_very_far_and_very_near_are_a_pixel_or_nan_without_a_warning():
    camera = Camera(**PLAIN)
    far = np.array([[1e150, 1e150, 1e150], [1e-150, 0, 1e-150], [1e300, 0, 1e-300], [np.inf, 0, 1], [np.nan, 0, 1]])
    pixels, seen = project(camera, far)
    np.testing.assert_array_equal(seen, [True, True, False, False, False])
    np.testing.assert_allclose(pixels[:2], [[1640, 1360], [1640, 360]])
    assert np.isnan(pixels[2:]).all()


@pytest.mark.parametrize("focal", [200.0, 1000.0, 50_000.0])
@pytest.mark.parametrize("k", [-0.2, -0.05, 0.05, 0.3])
def test_lenses_of_both_signs_work_at_every_focal_length(focal, k):
    # k is over the half diagonal of a 1080p picture, so that OpenCV's k1 spans five orders of magnitude.
    half_diagonal = np.hypot(959.5, 539.5)
    camera = Camera(
        **PLAIN
        | {
            "K": np.array([[focal, 0, 959.5], [0, focal, 539.5], [0, 0, 1]]),
            "distortion": np.array([k * (focal / half_diagonal) ** 2, 0, 0, 0]),
        }
    )
    corners = np.array([[0.0, 0], [1919, 0], [0, 1079], [1919, 1079], [959.5, 539.5]])
    points = unproject(camera, corners, np.full(5, 40.0))
    edge = 2 / (3 * np.sqrt(-3 * k)) if k < 0 else np.inf  # r (1 + k r^2) at its turn, over the half diagonal
    if edge > 1:
        again, seen = project(camera, points)
        assert seen.all()
        np.testing.assert_allclose(again, corners, atol=1e-7)
    else:
        assert np.isnan(points[:4]).all()
        assert np.isfinite(points[4]).all()


def test_a_world_point_past_the_fold_has_no_pixel():
    camera = Camera(**PLAIN | {"distortion": np.array([-1 / 3, 0, 0, 0])})  # folds at one focal length, 45 degrees
    pixels, seen = project(camera, np.array([[0.99, 0, 1], [1.01, 0, 1], [1.6, 0, 1], [100, 0, 1]]))
    np.testing.assert_array_equal(seen, [True, False, False, False])
    assert np.isnan(pixels[1:]).all()


def test_ground_points_are_met_by_the_rays_of_their_own_pixels():
    camera = broadcast_view()
    ground = np.random.default_rng(0).uniform([-6, -12, 0], [6, 12, 0], (30, 3))
    pixels, seen = project(camera, ground)
    assert seen.all()
    np.testing.assert_allclose(meet_plane(camera, pixels), ground, atol=1e-9)
    lifted = ground + [0, 0, 1.07]
    np.testing.assert_allclose(meet_plane(camera, project(camera, lifted)[0], 1.07), lifted, atol=1e-9)


def test_rays_that_never_meet_the_plane_are_nan():
    level = Camera(
        **PLAIN
        | {
            "R_cam_from_world": np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]),
            "t_cam_from_world": np.array([0.0, 2.0, 0.0]),
        }
    )
    np.testing.assert_allclose(level.position_world, [0, 0, 2])
    horizon, sky, ground = np.array([[640.0, 360]]), np.array([[640.0, 100]]), np.array([[640.0, 460]])
    assert np.isnan(meet_plane(level, horizon)).all()
    assert np.isnan(meet_plane(level, sky)).all()
    np.testing.assert_allclose(meet_plane(level, ground), [[0, 20, 0]], atol=1e-12)
    assert np.isnan(meet_plane(level, ground, 5.0)).all()  # the plane lies above the camera


def test_a_track_meets_one_set_of_points_as_its_cameras_do_one_by_one():
    cameras_of_track = track(6)
    points = np.random.default_rng(0).uniform([-6, -12, 0], [6, 12, 2], (9, 3))
    pixels, seen = project(cameras_of_track, points)
    assert pixels.shape == (6, 9, 2)
    assert seen.shape == (6, 9)
    on_ground = meet_plane(cameras_of_track, pixels)
    directions = rays(cameras_of_track, pixels[0])
    for i in range(6):
        np.testing.assert_allclose(project(cameras_of_track[i], points)[0], pixels[i], atol=1e-9)
        np.testing.assert_allclose(meet_plane(cameras_of_track[i], pixels[i]), on_ground[i], atol=1e-9)
        np.testing.assert_allclose(rays(cameras_of_track[i], pixels[0]), directions[i], atol=1e-12)


def test_one_camera_meets_a_track_of_points():
    points = np.random.default_rng(0).uniform([-6, -12, 0], [6, 12, 2], (4, 9, 3))
    pixels, _ = project(broadcast_view(), points)
    for i in range(4):
        np.testing.assert_allclose(pixels[i], project(broadcast_view(), points[i])[0], atol=1e-10)
        np.testing.assert_allclose(
            unproject(broadcast_view(), pixels, np.full((4, 9), 30.0))[i],
            unproject(broadcast_view(), pixels[i], np.full(9, 30.0)),
        )


def test_a_track_is_cut_by_index_and_slice():
    assert track(6)[2:5].K.shape == (3, 3, 3)
    np.testing.assert_array_equal(track(6)[4].R_cam_from_world, track(6).R_cam_from_world[4])


def test_empty_tracks_and_empty_point_sets_stay_empty():
    empty = track(4)[:0]
    assert project(empty, np.zeros((5, 3)))[0].shape == (0, 5, 2)
    assert rays(empty, np.zeros((5, 2))).shape == (0, 5, 3)
    assert project(broadcast_view(), np.zeros((0, 3)))[0].shape == (0, 2)
    assert meet_plane(track(4), np.zeros((0, 2))).shape == (4, 0, 3)


def test_frames_without_a_camera_show_nothing():
    whole = track(3)
    arrays_of = {
        name: getattr(whole, name).copy() for name in ("K", "distortion", "R_cam_from_world", "t_cam_from_world")
    }
    for value in arrays_of.values():
        value[1] = np.nan
    gap = Camera(**arrays_of)
    points = np.array([[0.0, -5, 0], [1, 5, 0]])
    pixels, seen = project(gap, points)
    np.testing.assert_array_equal(seen.all(axis=1), [True, False, True])
    assert np.isnan(pixels[1]).all()
    assert np.isnan(rays(gap, pixels[0])[1]).all()
    np.testing.assert_allclose(meet_plane(gap, pixels[0])[0], points, atol=1e-9)


def test_float32_points_lose_only_their_own_precision():
    points = np.random.default_rng(0).uniform([-6, -12, 0], [6, 12, 2], (30, 3)).astype(np.float32)
    pixels, _ = project(broadcast_view(), points)
    assert pixels.dtype == np.float64
    np.testing.assert_allclose(pixels, project(broadcast_view(), points.astype(np.float64))[0], atol=1e-9)
    narrow = Camera(**{name: value.astype(np.float32) for name, value in PLAIN.items()})
    assert narrow.K.dtype == np.float64


def test_colmap_puts_the_same_point_half_a_pixel_further():
    camera = broadcast_view()
    point = np.array([[1.0, 2.0, 0.5]])
    corner = Camera(
        K=K_with_corner_origin(camera.K),
        distortion=camera.distortion,
        R_cam_from_world=camera.R_cam_from_world,
        t_cam_from_world=camera.t_cam_from_world,
    )
    np.testing.assert_allclose(project(corner, point)[0] - project(camera, point)[0], [[0.5, 0.5]], atol=1e-9)
    np.testing.assert_array_equal(K_with_centre_origin(K_with_corner_origin(track(3).K)), track(3).K)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"R_cam_from_world": np.diag([1.0, 1.0, -1.0])}, "expected rotations"),
        ({"R_cam_from_world": 1.01 * np.eye(3)}, "expected rotations"),
        ({"K": np.diag([-1000.0, 1000.0, 1.0])}, "positive focal"),
        ({"K": np.diag([0.0, 1000.0, 1.0])}, "positive focal"),
        ({"K": np.diag([1000.0, 1000.0, 2.0])}, "1 at its end"),
        ({"K": PLAIN["K"].T}, "zeros below"),
        ({"t_cam_from_world": np.array([0.0, np.nan, 0.0])}, "camera 0: expected finite"),
        ({"distortion": np.array([np.inf, 0, 0, 0])}, "camera 0: expected finite"),
        ({"R_cam_from_world": np.full((3, 3), np.nan)}, "camera 0: expected finite"),
    ],
)
def test_what_is_no_camera_is_refused(change, message):
    with pytest.raises(ValueError, match=message):
        Camera(**PLAIN | change)


def test_the_camera_at_fault_in_a_track_is_named():
    R = np.tile(np.eye(3), (5, 1, 1))
    R[3] *= 2
    with pytest.raises(ValueError, match="camera 3"):
        Camera(
            K=np.tile(PLAIN["K"], (5, 1, 1)),
            distortion=np.zeros((5, 4)),
            R_cam_from_world=R,
            t_cam_from_world=np.zeros((5, 3)),
        )


def test_arrays_are_read_only_copies():
    t = np.zeros(3)
    camera = Camera(**PLAIN | {"t_cam_from_world": t})
    t[0] = 1.0
    assert camera.t_cam_from_world[0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        camera.K[0, 0] = 2.0


def test_wrong_shapes_are_refused():
    with pytest.raises(TypeCheckError):
        Camera(**PLAIN | {"t_cam_from_world": np.zeros(4)})
    with pytest.raises(TypeCheckError):
        project(Camera(**PLAIN), np.zeros((5, 2)))
