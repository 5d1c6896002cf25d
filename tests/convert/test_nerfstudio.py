import json
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pgm_data.convert.nerfstudio import read_nerfstudio, write_nerfstudio
from pgm_data.geometry.camera import Camera, project
from pgm_data.scene import load_scene
from tests.convert.folders import SIZE, cameras
from tests.convert.test_colmap import assert_same, one, pictures
from tests.geometry.strategies import cameras as any_camera

COURT = load_scene("tennis").court


def written(folder: Path, camera: Camera) -> tuple[Path, dict]:
    path = folder / "transforms.json"
    write_nerfstudio(path, pictures(camera), extra={"pgm": {"kept": True}})
    return path, json.loads(path.read_text())


def opengl_pixels(content: dict, frame: dict, point: np.ndarray) -> tuple[float, float]:
    """A pixel by nerfstudio's conventions, written out: y up, looking along -z, first pixel's centre at 0.5."""
    value = {**frame, **{key: content[key] for key in content if key != "frames"}}
    m = frame["transform_matrix"]
    offset = [point[i] - m[i][3] for i in range(3)]
    right, up, back = (sum(m[row][axis] * offset[row] for row in range(3)) for axis in range(3))
    depth = -back
    x, y = right / depth, -up / depth
    r2 = x * x + y * y
    radial = 1 + value["k1"] * r2 + value["k2"] * r2 * r2
    xd = x * radial + 2 * value["p1"] * x * y + value["p2"] * (r2 + 2 * x * x)
    yd = y * radial + value["p1"] * (r2 + 2 * y * y) + 2 * value["p2"] * x * y
    return value["fl_x"] * xd + value["cx"], value["fl_y"] * yd + value["cy"]


@pytest.mark.parametrize("distortion", [(0, 0, 0, 0), (-0.1, 0.02, 1e-3, -2e-3)])
def test_an_independent_opengl_projection_of_the_file_is_half_a_pixel_from_us(tmp_path, distortion):
    camera = cameras(3, distortion=distortion)
    _, content = written(tmp_path, camera)
    for i, frame in enumerate(content["frames"]):
        pixels, _ = project(camera[i], COURT.all_world)
        theirs = [opengl_pixels(content, frame, point) for point in COURT.all_world]
        np.testing.assert_allclose(theirs, pixels + 0.5, atol=1e-8)


def test_the_camera_looks_along_minus_z_with_y_up(tmp_path):
    _, content = written(tmp_path, cameras(1))
    matrix = np.array(content["frames"][0]["transform_matrix"])
    np.testing.assert_allclose(matrix[:3, 3], [0.3, -35.0, 9.0], atol=1e-9)
    assert matrix[2, 1] > 0.9  # the picture's up is mostly the world's
    assert matrix[1, 2] < -0.9  # backwards is towards the near end


@settings(max_examples=30)
@given(any_camera(tangential=True))
def test_any_camera_comes_back(camera):
    with TemporaryDirectory() as folder:
        path, _ = written(Path(folder), one(camera))
        found, problems, content = read_nerfstudio(path)
    assert problems == () and content["pgm"] == {"kept": True}
    np.testing.assert_array_equal(found.sizes, [SIZE])
    assert_same(one(camera), found.camera)


def test_all_lens_terms_stand_together_at_the_top_or_in_the_frames(tmp_path):
    still = cameras(2, zoom=False)
    changing = np.array(still.distortion)
    changing[1, 0] = -0.07
    _, same = written(tmp_path, still)
    camera = Camera(
        K=still.K, distortion=changing, R_cam_from_world=still.R_cam_from_world, t_cam_from_world=still.t_cam_from_world
    )
    path, differing = written(tmp_path, camera)
    lens = {"k1", "k2", "p1", "p2"}
    assert lens <= set(same) and not lens & set(same["frames"][0])
    assert not lens & set(differing) and lens <= set(differing["frames"][0])
    assert "fl_x" in differing
    assert_same(camera, read_nerfstudio(path)[0].camera)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=10)
def test_a_world_that_was_moved_when_the_file_was_made_is_moved_back(seed):
    rng = np.random.default_rng(seed)
    moved = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    moved *= np.sign(np.linalg.det(moved))
    shift, scale = rng.normal(size=3), float(rng.uniform(0.1, 3))
    camera = cameras(2)
    with TemporaryDirectory() as folder:
        path, content = written(Path(folder), camera)
        for frame in content["frames"]:
            matrix = np.array(frame["transform_matrix"])
            matrix[:3, 3] = scale * (moved @ matrix[:3, 3] + shift)
            matrix[:3, :3] = moved @ matrix[:3, :3]
            frame["transform_matrix"] = matrix.tolist()
        content["applied_transform"] = np.column_stack([moved, shift]).tolist()
        content["applied_scale"] = scale
        path.write_text(json.dumps(content))
        found, problems, _ = read_nerfstudio(path)
    assert problems == ()
    assert_same(camera, found.camera)


def changed(tmp_path: Path, change) -> Path:
    path, content = written(tmp_path, cameras(2))
    change(content)
    path.write_text(json.dumps(content))
    return path


def matrix_value(row: int, column: int, value):
    def change(content):
        content["frames"][0]["transform_matrix"][row][column] = value

    return change


@pytest.mark.parametrize(
    ("change", "field"),
    [
        (lambda c: c["frames"][0].pop("file_path"), "file_path"),
        (lambda c: c["frames"][0].pop("transform_matrix"), "transform_matrix"),
        (lambda c: c["frames"][0].pop("fl_x"), "fl_x"),
        (lambda c: c["frames"][0].update(fl_y=-1.0), "focal length"),
        (lambda c: c["frames"][0].update(fl_y="wide"), "fl_y"),
        (lambda c: c["frames"][0].update(fl_y=True), "fl_y"),
        (lambda c: c["frames"][0].update(fl_y=10**400), "fl_y"),
        (lambda c: (c.pop("w"), c["frames"][0].update(w=320.5), c["frames"][1].update(w=320)), "w, h"),
        (lambda c: (c.pop("h"), c["frames"][0].update(h=0), c["frames"][1].update(h=180)), "w, h"),
        (lambda c: c["frames"][0].update(k3=0.1), "k3"),
        (lambda c: c["frames"][0].update(file_path="../../secret.png"), "file_path"),
        (lambda c: c["frames"][0].update(file_path="/etc/passwd"), "file_path"),
        (lambda c: c["frames"][0].update(file_path="file:///etc/passwd"), "file_path"),
        (lambda c: c["frames"][0].update(file_path="a\\..\\b.png"), "file_path"),
        (lambda c: c["frames"][0].update(file_path="a\x00.png"), "file_path"),
        (lambda c: c["frames"][0].update(file_path=7), "file_path"),
        (lambda c: c["frames"][0].update(file_path="./."), "file_path"),
        (matrix_value(0, 0, float("nan")), "transform_matrix[0][0]"),
        (matrix_value(1, 3, float("inf")), "transform_matrix[1][3]"),
        (matrix_value(3, 0, 0.5), "transform_matrix[3]"),
        (matrix_value(0, 0, 1.01), "transform_matrix"),
        (lambda c: c["frames"][0].update(transform_matrix=[[1, 2], [3, 4]]), "transform_matrix"),
    ],
)
def test_a_bad_frame_is_named_and_the_others_are_kept(tmp_path, change, field):
    path = changed(tmp_path, change)
    found, problems, _ = read_nerfstudio(path)
    assert found.names == ("clip/000001.jpg",)
    assert [(problem.place, problem.field) for problem in problems] == [(f"{path}: frames[0]", field)]


def test_a_path_named_twice_is_refused_the_second_time(tmp_path):
    path = changed(tmp_path, lambda c: c["frames"][1].update(file_path="./clip//000000.jpg"))
    found, problems, _ = read_nerfstudio(path)
    assert found.names == ("clip/000000.jpg",) and "again" in problems[0].found


def test_a_mirror_is_no_rotation(tmp_path):
    def change(content):
        for row in content["frames"][0]["transform_matrix"][:3]:
            row[0] = -row[0]

    assert "rotation" in read_nerfstudio(changed(tmp_path, change))[1][0].expected


def test_a_matrix_scaled_by_a_millionth_is_made_a_rotation_again(tmp_path):
    def change(content):
        for frame in content["frames"]:
            frame["transform_matrix"][:3] = (np.array(frame["transform_matrix"][:3]) * (1 + 1e-6)).tolist()

    R = read_nerfstudio(changed(tmp_path, change))[0].camera.R_cam_from_world
    np.testing.assert_allclose(R @ np.swapaxes(R, 1, 2), np.tile(np.eye(3), (2, 1, 1)), atol=1e-12)


def test_a_matrix_rounded_to_six_places_is_taken_as_the_nearest_rotation(tmp_path):
    def change(content):
        for frame in content["frames"]:
            frame["transform_matrix"] = np.round(frame["transform_matrix"], 6).tolist()

    found, problems, _ = read_nerfstudio(changed(tmp_path, change))
    assert problems == ()
    np.testing.assert_allclose(found.camera.R_cam_from_world, cameras(2).R_cam_from_world, atol=2e-6)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda c: c.update(camera_model="OPENCV_FISHEYE"), "camera_model: expected one of OPENCV"),
        (lambda c: c.update(camera_model=["OPENCV"]), "camera_model: expected one of OPENCV"),
        (lambda c: c.pop("frames"), "frames: expected a list"),
        (lambda c: c.update(applied_transform=[[1, 0], [0, 1]]), "applied_transform: expected"),
        (lambda c: c.update(applied_scale=0), "applied_scale: expected above 0"),
    ],
)
def test_a_file_that_makes_no_sense_as_a_whole_is_refused(tmp_path, change, words):
    with pytest.raises(ValueError, match=words):
        read_nerfstudio(changed(tmp_path, change))


@pytest.mark.parametrize("content", ["", "[1, 2]", "{", "[" * 100_000, "\x00"])
def test_what_is_no_json_object_is_refused(tmp_path, content):
    path = tmp_path / "transforms.json"
    path.write_text(content)
    with pytest.raises(ValueError, match="transforms.json: expected"):
        read_nerfstudio(path)
