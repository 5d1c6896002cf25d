import struct
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pycolmap
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pgm_data.convert.colmap import colmap_model, read_colmap, write_colmap
from pgm_data.convert.posed_pictures import PosedPictures
from pgm_data.geometry.camera import Camera, project
from pgm_data.scene import load_scene
from tests.convert.folders import SIZE, cameras
from tests.geometry.strategies import cameras as any_camera

COURT = load_scene("tennis").court
ARRAYS = ("K", "distortion", "R_cam_from_world", "t_cam_from_world")


def pictures(camera: Camera) -> PosedPictures:
    count = len(camera.K)
    return PosedPictures(
        names=tuple(f"clip/{i:06d}.jpg" for i in range(count)),
        sizes=np.tile(SIZE, (count, 1)),
        camera=camera,
        observations=np.zeros(count, dtype=int),
    )


def one(camera: Camera) -> Camera:
    return Camera(**{name: getattr(camera, name)[None] for name in ARRAYS})


def assert_same(camera: Camera, other: Camera) -> None:
    for name in ARRAYS:
        a, b = getattr(camera, name), getattr(other, name)
        scale = np.abs(a).max(axis=tuple(range(1, a.ndim)), keepdims=True)
        assert (np.abs(a - b) <= 1e-9 * scale + 1e-300).all(), name


@settings(max_examples=25)
@given(any_camera(tangential=True), st.booleans())
def test_any_camera_comes_back_from_text_and_binary(camera, text):
    with TemporaryDirectory() as folder:
        write_colmap(Path(folder) / "0", pictures(one(camera)), text=text)
        found, problems, _ = read_colmap(Path(folder))
    assert problems == ()
    assert_same(one(camera), found.camera)


@pytest.mark.parametrize("text", [True, False])
@pytest.mark.parametrize(
    ("distortion", "fy", "model"),
    [
        ((0, 0, 0, 0), 1.0, "SIMPLE_PINHOLE"),
        ((0, 0, 0, 0), 1.1, "PINHOLE"),
        ((-0.1, 0, 0, 0), 1.0, "SIMPLE_RADIAL"),
        ((-0.1, 0.02, 0, 0), 1.0, "RADIAL"),
        ((-0.1, 0, 0, 0), 1.1, "OPENCV"),
        ((-0.1, 0.02, 1e-3, -2e-3), 1.0, "OPENCV"),
    ],
)
def test_pycolmap_reads_the_model_and_projects_half_a_pixel_from_us(tmp_path, text, distortion, fy, model):
    ours = cameras(3, distortion=distortion)
    K = np.array(ours.K)
    K[:, 1, 1] *= fy
    ours = Camera(
        K=K, distortion=ours.distortion, R_cam_from_world=ours.R_cam_from_world, t_cam_from_world=ours.t_cam_from_world
    )
    write_colmap(tmp_path / "0", pictures(ours), text=text)
    theirs = pycolmap.Reconstruction(tmp_path / "0")
    assert theirs.num_reg_images() == 3
    for image in theirs.images.values():
        camera = theirs.cameras[image.camera_id]
        assert camera.model_name == model
        assert (camera.width, camera.height) == SIZE
        i = int(image.name[-10:-4])
        pixels, seen = project(ours[i], COURT.all_world)
        assert seen.all()
        points_cam = np.array([image.cam_from_world() * point for point in COURT.all_world])
        np.testing.assert_allclose(camera.img_from_cam(points_cam), pixels + 0.5, atol=1e-6, rtol=0)
    found, _, _ = read_colmap(tmp_path)
    assert_same(ours, found.camera)


def test_pictures_of_equal_intrinsics_share_a_camera(tmp_path):
    write_colmap(tmp_path / "0", pictures(cameras(5, zoom=False)), text=False)
    assert pycolmap.Reconstruction(tmp_path / "0").num_cameras() == 1


def test_a_model_that_pycolmap_made_with_points_and_shared_rigs_is_read(tmp_path):
    theirs = pycolmap.Reconstruction()
    camera = pycolmap.Camera(
        model="FULL_OPENCV", width=640, height=480, params=[500, 510, 320.5, 240.5, *[0.01] * 4, *[0] * 4], camera_id=7
    )
    theirs.add_camera_with_trivial_rig(camera)
    for i in (3, 5):
        image = pycolmap.Image(name=f"b/{i}.png", camera_id=7, image_id=i)
        image.points2D = pycolmap.Point2DList([pycolmap.Point2D(np.array([10.0 * i, 20.0]), 2**64 - 1)] * 4)
        pose = pycolmap.Rigid3d(pycolmap.Rotation3d(np.array([0, 0, 0, 1.0])), np.array([1.0, 2.0, float(i)]))
        theirs.add_image_with_trivial_frame(image, pose)
    track = pycolmap.Track()
    for i in (3, 5):
        track.add_element(i, 0)
    theirs.add_point3D(np.array([0.0, 0.0, 1.0]), track, np.zeros(3, np.uint8))
    for folder, write in (("text", theirs.write_text), ("binary", theirs.write_binary)):
        (tmp_path / folder).mkdir()
        write(tmp_path / folder)
        found, problems, _ = read_colmap(tmp_path / folder)
        assert problems == () and found.names == ("b/3.png", "b/5.png")
        np.testing.assert_array_equal(found.observations, [1, 1])
        np.testing.assert_allclose(found.camera.K[0], [[500, 0, 320], [0, 510, 240], [0, 0, 1]])
        np.testing.assert_allclose(found.camera.t_cam_from_world[:, 2], [3, 5])


def test_skewed_intrinsics_are_refused():
    K = np.array([[500.0, 1.0, 320.0], [0, 500.0, 240.0], [0, 0, 1]])
    with pytest.raises(ValueError, match="expected no skew"):
        colmap_model(K, np.zeros(4))


def text_model(folder: Path, camera="1 PINHOLE 320 180 500 500 160 90", image="1 1 0 0 0 0.5 1 2 1 a.jpg\n\n") -> Path:
    folder.mkdir(exist_ok=True)
    (folder / "cameras.txt").write_text(f"# cameras\n{camera}\n")
    (folder / "images.txt").write_text("# images\n2 1 0 0 0 0 0 3 1 good.jpg\n1 2 -1 3 4 7\n" + image)
    return folder


def test_a_plain_text_model_without_rigs_is_read(tmp_path):
    found, problems, _ = read_colmap(text_model(tmp_path / "m", image=""))
    assert problems == () and found.names == ("good.jpg",)
    np.testing.assert_array_equal(found.observations, [1])
    np.testing.assert_array_equal(found.camera.K[0, :2, 2], [159.5, 89.5])


@pytest.mark.parametrize(
    ("image", "field"),
    [
        ("1 1 0 0 0 0.5 1 2 1\n\n", "image"),
        ("1 1 0 0 0 0.5 1 2 9 a.jpg\n\n", "CAMERA_ID"),
        ("1 1 0 0 0 0.5 1 2 x a.jpg\n\n", "CAMERA_ID"),
        ("1 nan 0 0 0 0.5 1 2 1 a.jpg\n\n", "QW QX QY QZ"),
        ("1 2 0 0 0 0.5 1 2 1 a.jpg\n\n", "QW QX QY QZ"),
        ("1 1 0 0 0 inf 1 2 1 a.jpg\n\n", "TX TY TZ"),
        ("1 1 0 0 0 one 1 2 1 a.jpg\n\n", "TX TY TZ"),
        ("1 1 0 0 0 0.5 1 2 1 ../../a.jpg\n\n", "NAME"),
        ("1 1 0 0 0 0.5 1 2 1 /etc/a.jpg\n\n", "NAME"),
        ("1 1 0 0 0 0.5 1 2 1 c:\\a.jpg\n\n", "NAME"),
        ("1 1 0 0 0 0.5 1 2 1 good.jpg\n\n", "NAME"),
    ],
)
def test_a_bad_image_is_named_by_line_and_the_others_are_kept(tmp_path, image, field):
    found, problems, path = read_colmap(text_model(tmp_path / "m", image=image))
    assert found.names == ("good.jpg",)
    assert [(problem.place, problem.field) for problem in problems] == [(f"{path}: line 4", field)]


@pytest.mark.parametrize(
    ("camera", "field"),
    [
        ("1 PINHOLE 320 180 500 500 160", "PARAMS"),
        ("1 PINHOLE 320 180 500 nan 160 90", "PARAMS"),
        ("1 FOV 320 180 500 500 160 90 0.1", "MODEL"),
        ("1 NEW_MODEL 320 180 500", "MODEL"),
        ("1 PINHOLE wide 180 500 500 160 90", "WIDTH"),
        ("1 PINHOLE 320", "camera"),
    ],
)
def test_a_bad_camera_is_named_and_its_images_are_not_taken(tmp_path, camera, field):
    found, problems, _ = read_colmap(text_model(tmp_path / "m", camera=camera, image=""))
    assert found.names == ()
    assert [problem.field for problem in problems] == [field, "CAMERA_ID"]
    assert problems[0].place.endswith("cameras.txt: line 2")


@pytest.mark.parametrize("camera", ["1 PINHOLE 320 180 0 500 160 90", "1 PINHOLE 0 180 500 500 160 90"])
def test_impossible_intrinsics_are_refused(tmp_path, camera):
    found, problems, _ = read_colmap(text_model(tmp_path / "m", camera=camera, image=""))
    assert found.names == () and len(problems) == 1


def test_terms_beyond_ours_are_refused(tmp_path):
    camera = "1 FULL_OPENCV 320 180 500 500 160 90 0.1 0 0 0 0.01 0 0 0"
    found, problems, _ = read_colmap(text_model(tmp_path / "m", camera=camera, image=""))
    assert found.names == () and "k3" in problems[0].expected


@pytest.mark.parametrize("name", ["cameras.bin", "images.bin"])
def test_a_binary_file_cut_anywhere_is_refused_in_words(tmp_path, name):
    write_colmap(tmp_path / "0", pictures(cameras(2)), text=False)
    whole = (tmp_path / "0" / name).read_bytes()
    for length in range(0, len(whole), 7):
        (tmp_path / "0" / name).write_bytes(whole[:length])
        with pytest.raises(ValueError, match=f"{name}: .*expected"):
            read_colmap(tmp_path)


def test_a_binary_count_beyond_the_file_is_refused(tmp_path):
    write_colmap(tmp_path / "0", pictures(cameras(2)), text=False)
    path = tmp_path / "0" / "images.bin"
    path.write_bytes(struct.pack("<Q", 2**40) + path.read_bytes()[8:])
    with pytest.raises(ValueError, match="count: expected as many entries as fit"):
        read_colmap(tmp_path)


def test_a_folder_without_a_model_is_refused(tmp_path):
    with pytest.raises(ValueError, match="expected a COLMAP model"):
        read_colmap(tmp_path)
