"""Orbit, dolly and paths of key cameras: where they stand, what they look at, and that nothing jumps."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation, Slerp

from pgm_data.fields import FieldError
from pgm_data.geometry.camera import Camera, project, rays
from pgm_data.geometry.rigid import is_rotation, rotation_from_rotvec
from pgm_data.scene import load_scene
from pgm_models.synthesis.camera_path_file import camera_path_of, camera_path_to_json, read_camera_path
from pgm_models.synthesis.camera_paths import (
    CameraPath,
    Dolly,
    Orbit,
    cameras_at,
    dolly,
    intrinsics,
    looking_at,
    orbit,
    usual_orbit,
)

SIZE = (64, 36)
POINTS = arrays(np.float64, 3, elements=st.floats(-30, 30))
KEYS = {
    "width": 64,
    "height": 36,
    "keys": [
        {"time": 0, "position": [0, -30, 8], "look_at": [0, 0, 0], "fov_deg": 40},
        {"time": 2, "position": [20, -20, 8], "look_at": [0, 0, 1], "fov_deg": 30, "roll_deg": 5},
        {"time": 3, "position": [25, 10, 4], "look_at": [0, 0, 1]},
    ],
}


def path_of(rotvecs, times, focals=None, centres=None):
    keys = len(times)
    R = rotation_from_rotvec(np.asarray(rotvecs, dtype=np.float64))
    K = np.tile(intrinsics(40.0, SIZE), (keys, 1, 1))
    if focals is not None:
        K[:, [0, 1], [0, 1]] = np.asarray(focals)[:, None]
    centres = np.zeros((keys, 3)) if centres is None else np.asarray(centres, dtype=np.float64)
    camera = Camera(
        K=K, distortion=np.zeros((keys, 4)), R_cam_from_world=R, t_cam_from_world=-(R @ centres[..., None])[..., 0]
    )
    return CameraPath(times=np.asarray(times, dtype=np.float64), cameras=camera, size=SIZE, reason="test")


@settings(max_examples=40)
@given(POINTS, POINTS, st.floats(-170, 170))
def test_a_camera_sees_its_aim_in_the_middle_and_stands_upright(position, aim, roll):
    if np.linalg.norm(aim - position) < 1e-3:
        return
    R = looking_at(position, aim)
    assert is_rotation(R)
    camera = Camera(
        K=intrinsics(40.0, SIZE), distortion=np.zeros(4), R_cam_from_world=R, t_cam_from_world=-R @ position
    )
    pixel, seen = project(camera, aim[None])
    assert seen.all()
    np.testing.assert_allclose(pixel[0], [31.5, 17.5], atol=1e-4)
    assert abs(R[0, 2]) < 1e-6 and R[1, 2] <= 1e-9  # right is level, down is not up
    turned = looking_at(position, aim, roll)
    np.testing.assert_allclose(turned[2], R[2], atol=1e-12)
    assert np.degrees(np.arccos(np.clip(turned[0] @ R[0], -1, 1))) == pytest.approx(abs(roll), abs=1e-4)


def test_a_roll_turns_the_camera_clockwise_as_seen_from_behind():
    R = looking_at(np.array([0.0, -10.0, 0.0]), np.zeros(3), 90.0)
    np.testing.assert_allclose(R[0], [0, 0, -1], atol=1e-12)  # its right hand has gone down


@pytest.mark.parametrize(("up", "down_the_picture"), [(-1.0, [0, -1, 0]), (1.0, [0, 1, 0])])
def test_straight_down_and_straight_up_have_x_to_the_right(up, down_the_picture):
    R = looking_at(np.zeros(3), np.array([0.0, 0.0, up]))
    np.testing.assert_allclose(R, [[1, 0, 0], down_the_picture, [0, 0, up]], atol=1e-12)


def test_a_lens_is_as_wide_as_it_is_said_between_the_edges_of_the_picture():
    camera = Camera(
        K=intrinsics(70.0, SIZE), distortion=np.zeros(4), R_cam_from_world=np.eye(3), t_cam_from_world=np.zeros(3)
    )
    left, right = rays(camera, np.array([[-0.5, 17.5], [63.5, 17.5]]))
    assert np.degrees(np.arccos(left @ right)) == pytest.approx(70.0)


def test_an_orbit_keeps_distance_and_aim_and_turns_as_fast_as_it_is_said():
    options = Orbit(aim_world=(1.0, 2.0, 1.0), radius_m=10.0, elevation_deg=30.0, turn_deg_s=45.0, size=SIZE)
    view = orbit(options, np.array([0.0, 1.0, 2.0, 8.0]))
    away = view.camera.position_world - [1, 2, 1]
    np.testing.assert_allclose(np.linalg.norm(away, axis=1), 10.0)
    np.testing.assert_allclose(away[:, 2], 5.0)
    np.testing.assert_allclose(away[0, :2], [0, -10 * np.cos(np.pi / 6)], atol=1e-9)
    np.testing.assert_allclose(away[2, :2], [10 * np.cos(np.pi / 6), 0], atol=1e-9)  # counter-clockwise
    np.testing.assert_allclose(away[3], away[0], atol=1e-9)
    pixels, _ = project(view.camera, np.tile([[1.0, 2.0, 1.0]], (4, 1, 1)))
    np.testing.assert_allclose(pixels[:, 0], np.tile([31.5, 17.5], (4, 1)), atol=1e-9)


def test_a_dolly_rides_softly_from_its_start_to_its_end_and_stays_there():
    options = Dolly(
        start_world=(-5.0, -20.0, 3.0),
        end_world=(5.0, -20.0, 3.0),
        aim_world=(0.0, 0.0, 1.0),
        duration_s=4.0,
        size=SIZE,
    )
    view = dolly(options, np.array([-1.0, 0.0, 1e-3, 2.0, 4.0, 9.0]))
    x = view.camera.position_world[:, 0]
    np.testing.assert_allclose(x[[0, 1, 3, 4, 5]], [-5, -5, 0, 5, 5], atol=1e-12)
    assert 0 < x[2] - x[1] < 1e-5
    pixels, _ = project(view.camera, np.tile([[0.0, 0.0, 1.0]], (6, 1, 1)))
    np.testing.assert_allclose(pixels[:, 0], np.tile([31.5, 17.5], (6, 1)), atol=1e-9)
    with pytest.raises(ValueError, match="look_at: expected a point away"):
        dolly(replace(options, aim_world=(0.0, -20.0, 3.0)), np.array([2.0]))


@pytest.mark.parametrize("name", ["tennis", "tabletennis", "blocks"])
def test_the_usual_orbit_sees_all_of_where_play_is(name):
    scene = load_scene(name)
    view = orbit(usual_orbit(scene, SIZE), np.linspace(0, 30, 13))
    corners = np.array([player.region_m for player in scene.players]).reshape(-1, 3)
    where = np.array([[x, y, 0.0] for x in corners[:, 0] for y in corners[:, 1]]) * 0.6
    pixels, seen = project(view.camera, np.tile(where, (13, 1, 1)))
    assert seen.all() and (pixels >= -0.5).all() and (pixels < np.array(SIZE) - 0.5).all()


@settings(max_examples=30)
@given(
    arrays(np.float64, (4, 3), elements=st.floats(-1, 1)),
    arrays(np.float64, (4, 3), elements=st.floats(-20, 20)),
    arrays(np.float64, 4, elements=st.floats(50, 3000)),
)
def test_a_path_goes_through_its_keys_overshoots_none_and_turns_along_great_arcs(rotvecs, centres, focals):
    path = path_of(rotvecs, [0.0, 1.0, 1.5, 4.0], focals, centres)
    at_keys = cameras_at(path, path.times).camera
    np.testing.assert_allclose(at_keys.K, path.cameras.K, rtol=1e-12)
    np.testing.assert_allclose(at_keys.R_cam_from_world, path.cameras.R_cam_from_world, atol=1e-12)
    np.testing.assert_allclose(at_keys.position_world, centres, atol=1e-9)
    between = cameras_at(path, np.linspace(1.0, 1.5, 7)).camera
    assert (between.K[:, 0, 0] >= min(focals[1:3]) * (1 - 1e-9)).all()
    assert (between.K[:, 0, 0] <= max(focals[1:3]) * (1 + 1e-9)).all()
    low, high = np.sort(centres[1:3], axis=0)
    assert (between.position_world >= low - 1e-6).all() and (between.position_world <= high + 1e-6).all()
    # On the great arc: what is turned since one key and what is left to the next add up.
    first, last = (path.cameras.R_cam_from_world[k] for k in (1, 2))
    whole = Rotation.from_matrix(last @ first.T).magnitude()
    since = Rotation.from_matrix(between.R_cam_from_world @ first.T).magnitude()
    left = Rotation.from_matrix(last @ between.R_cam_from_world.swapaxes(1, 2)).magnitude()
    np.testing.assert_allclose(since + left, whole, atol=1e-6)


def test_two_keys_are_joined_as_scipy_joins_them():
    path = path_of([[0, 0, 0], [0.3, -1.2, 0.4]], [1.0, 3.0], focals=[100, 400], centres=[[0, 0, 0], [4, 0, 0]])
    times = np.array([0.0, 1.0, 1.7, 2.0, 3.0, 5.0])
    made = cameras_at(path, times).camera
    R = np.swapaxes(path.cameras.R_cam_from_world, 1, 2)
    wanted = Slerp(path.times, Rotation.from_matrix(R))(np.clip(times, 1, 3)).as_matrix()
    np.testing.assert_allclose(made.R_cam_from_world, np.swapaxes(wanted, 1, 2), atol=1e-12)
    np.testing.assert_allclose(made.K[3, 0, 0], 200.0)  # half way by factors
    np.testing.assert_allclose(made.position_world[:, 0], [0, 0, 1.4, 2, 4, 4], atol=1e-12)


def test_no_speed_jumps_at_a_key():
    path = path_of(
        [[0, 0, 0], [0, 0.2, 0], [0, 1.0, 0], [0, 1.1, 0]],
        [0.0, 1.0, 2.0, 5.0],
        focals=[100, 120, 300, 310],
        centres=[[0, 0, 0], [1, 0, 0], [5, 0, 0], [6, 0, 0]],
    )
    step = 1e-5
    for time in (1.0, 2.0):
        before, at, after = (cameras_at(path, np.array([time + d])).camera for d in (-step, 0.0, step))
        for value in (
            lambda c: c.position_world[0, 0],
            lambda c: np.log(c.K[0, 0, 0]),
            lambda c: Rotation.from_matrix(c.R_cam_from_world[0]).as_rotvec()[1],
        ):
            first, second = (value(at) - value(before)) / step, (value(after) - value(at)) / step
            assert first > 1e-3 and second == pytest.approx(first, abs=2e-3)


def test_one_key_is_a_camera_that_stands_still_and_equal_keys_make_no_trouble():
    path = path_of([[0.1, 0.2, 0.3]], [2.0])
    made = cameras_at(path, np.array([-1.0, 2.0, 7.0])).camera
    np.testing.assert_array_equal(made.R_cam_from_world, np.tile(path.cameras.R_cam_from_world, (3, 1, 1)))
    same = path_of([[0.1, 0.2, 0.3]] * 3, [0.0, 1.0, 2.0])
    made = cameras_at(same, np.linspace(0, 2, 9)).camera
    np.testing.assert_allclose(made.R_cam_from_world, np.tile(same.cameras.R_cam_from_world[0], (9, 1, 1)), atol=1e-7)
    assert cameras_at(path, np.zeros(0)).camera.K.shape == (0, 3, 3)


def test_a_file_of_positions_becomes_a_path_and_its_matrices_say_the_same(tmp_path):
    file = tmp_path / "ride.json"
    file.write_text(json.dumps(KEYS))
    path = read_camera_path(file)
    assert path.size == (64, 36) and path.reason == "as in ride.json"
    made = cameras_at(path, np.array([0.0, 3.0])).camera
    np.testing.assert_allclose(made.position_world, [[0, -30, 8], [25, 10, 4]], atol=1e-9)
    pixels, _ = project(made, np.array([[[0.0, 0, 0]], [[0.0, 0, 1]]]))
    np.testing.assert_allclose(pixels[:, 0], [[31.5, 17.5]] * 2, atol=1e-9)
    np.testing.assert_allclose(made.K[:, 0, 0], 32 / np.tan(np.radians([20, 20])))
    again = camera_path_of(json.loads(json.dumps(camera_path_to_json(path))))
    for name in ("K", "distortion", "R_cam_from_world", "t_cam_from_world"):
        np.testing.assert_array_equal(getattr(again.cameras, name), getattr(path.cameras, name))


def changed(place, **values):
    raw = json.loads(json.dumps(KEYS))
    raw["keys"][place] |= values
    return raw


@pytest.mark.parametrize(
    ("raw", "said"),
    [
        ([], "file: expected named fields"),
        ({"width": 64, "height": 36}, "keys: expected the field, got none"),
        ({"width": 64, "height": 36, "keys": []}, "keys: expected one or more, got none"),
        ({**KEYS, "width": 0}, "width: expected a whole number"),
        ({**KEYS, "width": 10**6}, "width, height: expected 1 to 65536"),
        (changed(1, time=0), r"keys\[1\].time: expected above 0, that of the key before, got 0"),
        (changed(2, time="late"), r"keys\[2\].time: expected a finite number"),
        (changed(1, position=[0, 0]), r"keys\[1\].position: expected 3 numbers"),
        (changed(1, look_at=[20, -20, 8]), r"keys\[1\].look_at: expected a point away from the camera's position"),
        (changed(1, fov_deg=180), r"keys\[1\].fov_deg: expected above 0 and below 180, got 180"),
        (changed(0, zoom=2), r"keys\[0\].zoom: expected one of"),
        (changed(0, K=[1] * 9), r"keys\[0\].distortion: expected the field"),
        (
            {
                **KEYS,
                "keys": [
                    {"time": 0, "K": [1] * 9, "distortion": [0] * 4, "R_cam_from_world": [1] * 9}
                    | {"t_cam_from_world": [0] * 3}
                ],
            },
            r"keys\[0\]: R_cam_from_world: expected rotations",
        ),
        (
            {
                **KEYS,
                "keys": [
                    {"time": 0, "position": [0, 0, 1], "look_at": [0, 9, 1]},
                    {"time": 1, "position": [0, 0, 1], "look_at": [0, -9, 1]},
                ],
            },
            r"keys\[1\]: expected a camera turned by less than 180 degrees from that of keys\[0\], got 180",
        ),
    ],
)
def test_what_is_no_path_is_refused_with_the_field_that_is_wrong(raw, said, tmp_path):
    with pytest.raises(ValueError, match=said):
        camera_path_of(raw)
    file = tmp_path / "path.json"
    file.write_text(json.dumps(raw))
    with pytest.raises(ValueError, match=r"path\.json: .*" + said):
        read_camera_path(file)


def test_other_files_are_no_paths(tmp_path):
    with pytest.raises(ValueError, match="expected a camera path in a .json file, got .csv"):
        read_camera_path(tmp_path / "path.csv")
    (tmp_path / "path.json").write_text("{")
    with pytest.raises(ValueError, match=r"path\.json: expected"):
        read_camera_path(tmp_path / "path.json")


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: Orbit(aim_world=(0, 0, 0), radius_m=0.0), "radius_m: expected above 0"),
        (lambda: Orbit(aim_world=(0, 0, 0), radius_m=1.0, elevation_deg=90.0), "elevation_deg: expected above -90"),
        (lambda: Orbit(aim_world=(0, 0, 0), radius_m=1.0, turn_deg_s=float("nan")), "turn_deg_s: expected numbers"),
        (lambda: Orbit(aim_world=(0, 0, 0), radius_m=1.0, fov_deg=0.0), "fov_deg: expected above 0"),
        (
            lambda: Dolly(start_world=(0, 0, 0), end_world=(1, 0, 0), aim_world=(0, 1, 0), duration_s=0.0),
            "duration_s: expected above 0",
        ),
    ],
)
def test_options_that_cannot_be_are_refused(make, said):
    with pytest.raises(ValueError, match=said):
        make()


def test_keys_without_a_camera_are_refused():
    path = path_of([[0, 0, 0]] * 2, [0.0, 1.0])
    nothing = {name: np.full_like(values[:1], np.nan) for name, values in vars(path.cameras).items()}
    some = {name: np.concatenate([values[:1], nothing[name]]) for name, values in vars(path.cameras).items()}
    with pytest.raises(ValueError, match=r"keys\[1\]: expected a camera, got NaN"):
        replace(path, cameras=Camera(**some))
    with pytest.raises(ValueError, match="expected as many cameras as times"):
        replace(path, times=np.zeros(3))
    assert issubclass(FieldError, ValueError)
