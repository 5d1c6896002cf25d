"""What comes in of a Playable Environments dataset: cameras, boxes, pictures; keypoints that are said to be COCO's.

Lost: actions, rewards, metadata, object poses and flow. There is no way back, so there is no round trip.
"""

import os
import pickle
import shutil
from datetime import UTC, datetime
from pathlib import Path

import cv2
import numpy as np
import pytest

from pgm_data.convert.playable import PlayableOptions, import_playable
from pgm_data.convert.playable_files import PlayableVideo, playable_camera
from pgm_data.dataset.check import check_paths
from pgm_data.dataset.clip_camera import read_clip_camera
from pgm_data.dataset.clip_players import read_clip_players
from pgm_data.dataset.documents import read_document, write_document
from pgm_data.dataset.source_video import find_source_video
from pgm_data.geometry.camera import project
from pgm_data.provenance import run_document
from pgm_data.scene import load_scene
from pgm_data.video import open_video
from tests.convert.playable_folders import FOCAL, SIZE, pickled, pose, write_video

TENNIS, BLOCKS = load_scene("tennis"), load_scene("blocks")
W, H = SIZE
NO_PICTURES = PlayableOptions(pictures="none")
WORLD = np.array([[0, 0, 0], [-5.485, -11.885, 0], [5.485, 11.885, 0]], dtype=float)
PIXELS = np.array([[498.00, 309.82], [63.24, 505.82], [738.14, 201.55]])
"""Where an independent calculation has them."""


@pytest.fixture
def dataset(tmp_path):
    for split, sequence, frames in (("train", "00000", 4), ("train", "00007", 3), ("test", "00000", 1)):
        write_video(tmp_path / "data" / split / sequence / "00000", frames)
    return tmp_path / "data"


def taken(root, out, **options):
    return import_playable(root, out, scene=TENNIS, options=PlayableOptions(**{"pictures": "none"} | options))


def test_the_camera_is_the_one_that_was_worked_out_by_hand(tmp_path):
    write_video(tmp_path / "data" / "train" / "00000" / "00000", 4, size=(996, 560))
    taken(tmp_path / "data", tmp_path / "out")
    clip = read_clip_camera(tmp_path / "out" / "train_00000")
    pixels, seen = project(clip.camera, WORLD)
    assert seen.all()
    # Their angles have four decimals, kept in float32.
    np.testing.assert_allclose(pixels, np.tile(PIXELS, (4, 1, 1)), atol=0.02)
    np.testing.assert_allclose(clip.camera.position_world, np.tile([0, -39.54, 8.41], (4, 1)), atol=1e-5)


def test_focal_lengths_are_of_the_larger_picture(tmp_path):
    write_video(tmp_path / "data" / "val" / "00003" / "00000", 2, size=(512, 288))
    taken(tmp_path / "data", tmp_path / "out")
    K = read_clip_camera(tmp_path / "out" / "val_00003").camera.K[0]
    np.testing.assert_allclose([K[0, 0], K[1, 1]], [FOCAL * 512 / 996, FOCAL * 288 / 560], rtol=1e-12)
    np.testing.assert_allclose(K[:2, 2], [256, 144])
    pixels, _ = project(read_clip_camera(tmp_path / "out" / "val_00003").camera[0], WORLD)
    np.testing.assert_allclose(pixels, PIXELS * [512 / 996, 288 / 560], atol=0.02)


def test_the_turns_are_about_z_then_x_then_y():
    rng = np.random.default_rng(0)
    rotation, translation = rng.uniform(-1, 1, (5, 3)), rng.normal(size=(5, 3))
    video = PlayableVideo(
        folder=Path("video"),
        pictures=(),
        size=(100, 80),
        rotation=rotation,
        translation=translation,
        focal=np.full(5, 90.0),
        boxes=np.zeros((5, 1, 4)),
        keypoints=None,
    )
    camera = playable_camera(video, (100, 80), y_up=False)
    for i in range(5):
        x, y, z = rotation[i]
        Rx = np.array([[1, 0, 0], [0, np.cos(x), -np.sin(x)], [0, np.sin(x), np.cos(x)]])
        Ry = np.array([[np.cos(y), 0, np.sin(y)], [0, 1, 0], [-np.sin(y), 0, np.cos(y)]])
        Rz = np.array([[np.cos(z), -np.sin(z), 0], [np.sin(z), np.cos(z), 0], [0, 0, 1]])
        R_world_from_gl = Ry @ Rx @ Rz
        np.testing.assert_allclose(camera.R_cam_from_world[i], np.diag([1, -1, -1]) @ R_world_from_gl.T, atol=1e-12)
        np.testing.assert_allclose(camera.position_world[i], translation[i], atol=1e-12)
    turned = playable_camera(video, (100, 80), y_up=True)
    up = np.array([0.0, 1.0, 0.0])
    np.testing.assert_allclose(turned.R_cam_from_world @ [0, 0, 1], camera.R_cam_from_world @ up, atol=1e-12)
    np.testing.assert_allclose(turned.position_world[:, 2], translation[:, 1], atol=1e-12)


def test_boxes_are_pixels_and_dummies_are_not_there(dataset, tmp_path):
    taken(dataset, tmp_path / "out")
    near, far = read_clip_players(tmp_path / "out" / "train_00000", TENNIS).players
    np.testing.assert_allclose(near.box_px[0], [0.3 * W - 0.5, 0.6 * H - 0.5, 0.4 * W - 0.5, 0.9 * H - 0.5], atol=1e-3)
    np.testing.assert_allclose(far.box_px[2], np.array([0.42 * W, 0.22 * H, 0.47 * W, 0.37 * H]) - 0.5, atol=1e-3)
    assert np.isnan(far.box_px[1]).all() and np.isfinite(near.box_px).all()
    assert set(near.status) == {"none"} and np.isnan(near.root_position).all()
    assert np.isnan(near.keypoints_px).all()


def test_clips_are_called_after_their_folders_and_pass_the_check(dataset, tmp_path):
    outcome = taken(dataset, tmp_path / "out", pictures="video", fps=5)
    assert outcome.clips == ("train_00000", "train_00007", "test_00000") == outcome.nominal_times
    assert outcome.pictures == 8 and outcome.problems == ()
    documents = {name: read_document(tmp_path / "out" / name / "clip.json", "clip") for name in outcome.clips}
    assert {document["match_id"] for document in documents.values()} == {"data"}
    video = find_source_video(tmp_path / "out", documents["train_00000"], None)
    with open_video(video) as reader:
        frames = [(frame.timestamp, frame.bgr()) for frame in reader]
    np.testing.assert_allclose([time for time, _ in frames], [0, 0.2, 0.4, 0.6], atol=1e-9)
    assert [round(picture.mean() / 10) for _, picture in frames] == [4, 5, 6, 7]
    assert frames[0][1].shape == (H, W, 3)
    clip = read_clip_camera(tmp_path / "out" / "train_00000")
    np.testing.assert_allclose(clip.timestamp, [0, 0.2, 0.4, 0.6])
    write_run(tmp_path / "out")
    assert check_paths([tmp_path / "out"]) == []


def write_run(out):
    document = run_document(command="test", options=NO_PICTURES, started=datetime.now(UTC), inputs=[])
    write_document(out / "run.json", "run", document)


def test_without_pictures_a_clip_has_no_bytes(dataset, tmp_path):
    taken(dataset, tmp_path / "out")
    document = read_document(tmp_path / "out" / "test_00000" / "clip.json", "clip")
    assert (document["bytes"], document["n_frames"], document["time_base"]) == (0, 1, "1/5")
    assert not (tmp_path / "out" / "videos").exists()
    write_run(tmp_path / "out")
    assert check_paths([tmp_path / "out"]) == []


def test_a_split_or_a_folder_of_sequences_is_taken_too(dataset, tmp_path):
    assert taken(dataset / "train", tmp_path / "a").clips == ("train_00000", "train_00007")
    shutil.move(dataset / "train", tmp_path / "some sequences")
    assert taken(tmp_path / "some sequences", tmp_path / "b").clips == (
        "some_sequences_00000",
        "some_sequences_00007",
    )


def test_several_cameras_are_several_clips_of_one_length(dataset, tmp_path):
    write_video(dataset / "train" / "00000" / "00001", 4)
    write_video(dataset / "train" / "00007" / "00001", 2)
    outcome = taken(dataset, tmp_path / "out")
    assert outcome.clips == ("train_00000_00000", "train_00000_00001", "test_00000")
    assert all("as many as camera" in str(problem) for problem in outcome.problems) and len(outcome.problems) == 2


@pytest.mark.parametrize("focal", [0.0, 1.0, None])
def test_a_camera_that_the_loader_made_up_is_none(dataset, tmp_path, focal):
    folder = dataset / "train" / "00000" / "00000"
    (folder / "cameras.pkl").write_bytes(pickled([pose((0, 0, 0), (0, 0, 0))] * 4))
    (folder / "focals.pkl").write_bytes(pickled([focal] * 4))
    taken(dataset, tmp_path / "out")
    clip = read_clip_camera(tmp_path / "out" / "train_00000")
    assert set(clip.status) == {"none"} and np.isnan(clip.camera.K).all() and "made-up" in clip.reason[0]


def test_keypoints_are_taken_only_when_their_order_is_said(tmp_path):
    points = np.stack([np.linspace(0.6, 0.9, 17), np.linspace(0.3, 0.4, 17), np.linspace(0, 1, 17)], axis=1)
    both = np.stack([points, points], axis=2)
    content = {"keypoints": [both] * 4, "keypoints_validity": [np.array([True, False])] * 4}
    write_video(tmp_path / "data" / "train" / "00000" / "00000", 4, **content)
    taken(tmp_path / "data", tmp_path / "a")
    assert np.isnan(read_clip_players(tmp_path / "a" / "train_00000", TENNIS).players[0].keypoints_px).all()
    taken(tmp_path / "data", tmp_path / "b", keypoints="coco")
    near, far = read_clip_players(tmp_path / "b" / "train_00000", TENNIS).players
    # Height comes first in the file.
    np.testing.assert_allclose(near.keypoints_px[0, 0], [0.3 * W - 0.5, 0.6 * H - 0.5], atol=1e-3)
    np.testing.assert_allclose(near.keypoint_score[0], np.linspace(0, 1, 17), atol=1e-6)
    assert np.isnan(far.keypoints_px).all()


def boxes(*, at=0, value=None, frames=4):
    rows = [np.tile(np.array([[0.1], [0.1], [0.2], [0.3]]), (1, 2)) for _ in range(frames)]
    rows[at] = value if value is not None else rows[at]
    return rows


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ({"cameras": None}, "cameras.pkl: file: expected a pickle of plain data, got nothing there"),
        ({"focals": None}, "focals.pkl: file: expected"),
        ({"bounding_boxes": None}, "bounding_boxes.pkl: file: expected"),
        ({"bounding_box_validity": None}, "bounding_box_validity.pkl: file: expected"),
        ({"cameras": [pose()] * 3}, "cameras.pkl: expected a list of 4 values, one a picture, got 3 values"),
        ({"focals": [FOCAL] * 5}, "focals.pkl: expected a list of 4 values"),
        ({"focals": (FOCAL,) * 4}, "focals.pkl: expected a list of 4 values"),
        ({"focals": [float("nan")] * 4}, r"focals.pkl\[0\]: expected a focal length"),
        ({"focals": [FOCAL, -2.0, FOCAL, FOCAL]}, r"focals.pkl\[1\]: expected a focal length"),
        ({"focals": [FOCAL, True, FOCAL, FOCAL]}, r"focals.pkl\[1\]: expected a focal length"),
        ({"cameras": [pose(), pose(translation=(np.nan, 0, 0)), pose(), pose()]}, r"cameras.pkl\[1\].translation"),
        ({"cameras": [pose(rotation=(np.inf, 0, 0))] * 4}, r"cameras.pkl\[0\].rotation: expected at most 100"),
        ({"cameras": [[1, 2, 3]] * 4}, r"cameras.pkl\[0\]: expected a pose, got list"),
        (
            {"bounding_boxes": boxes(at=2, value=np.zeros((4, 3)))},
            r"bounding_boxes.pkl\[2\]: expected an array of shape",
        ),
        (
            {"bounding_boxes": boxes(at=2, value=np.full((4, 2), np.nan))},
            r"bounding_boxes.pkl\[2\]: object 0: expected",
        ),
        ({"bounding_boxes": boxes(at=3, value=np.zeros((4, 2)))}, r"bounding_boxes.pkl\[3\]: object 0: expected left"),
        ({"bounding_boxes": boxes(at=0, value=np.full((4, 2), "x"))}, "dtype: expected a type of plain numbers"),
        ({"bounding_box_validity": [np.array([True, 2])] * 4}, "bounding_box_validity.pkl: expected true and false"),
        ({"bounding_box_validity": [np.zeros(0)] * 4}, "1 to 64 objects"),
        ({"crop_region": [0.1, 0.0, 1.0, 1.0]}, "crop_region.pkl: expected the whole picture"),
        ({"crop_region": [0.9, 0.0, 0.1, 1.0]}, "crop_region.pkl: expected left < right"),
        ({"crop_region": [0, 0, 2, 1]}, "crop_region.pkl: expected left, top, right, bottom"),
        ({"keypoints": [np.zeros((17, 3, 2))] * 4}, "keypoints_validity.pkl: file: expected"),
    ],
)
def test_a_damaged_sequence_is_named_and_the_others_are_taken(dataset, tmp_path, content, words):
    write_video(dataset / "train" / "00001" / "00000", 4, **content)
    outcome = taken(dataset, tmp_path / "out")
    assert outcome.clips == ("train_00000", "train_00007", "test_00000")
    with pytest.raises(ValueError, match=words):
        raise ValueError(str(outcome.problems[0]))
    assert len(outcome.problems) == 1 and "00001" in outcome.problems[0].place
    assert not (tmp_path / "out" / "train_00001").exists()


def test_a_crop_region_that_is_the_whole_picture_says_nothing(dataset, tmp_path):
    (dataset / "train" / "00000" / "00000" / "crop_region.pkl").write_bytes(pickled([0.0, 0.0, 1.0, 1.0]))
    assert taken(dataset, tmp_path / "out").problems == ()


def break_pictures(folder, kind):
    if kind == "a gap":
        (folder / "00002.png").unlink()
    elif kind == "no first":
        (folder / "00000.png").unlink()
    elif kind == "two first":
        shutil.copy(folder / "00000.png", folder / "00000.jpg")
    elif kind == "no picture":
        (folder / "00000.png").write_bytes(b"no picture")
    elif kind == "another size":
        cv2.imwrite(str(folder / "00003.png"), np.zeros((8, 8, 3), np.uint8))
    elif kind == "marked":
        (folder / "failure.txt").touch()


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ("a gap", "00002.png: expected pictures without a gap, got 00003.png"),
        ("no first", "00000.png: expected one first picture, got 0"),
        ("two first", "00000.png: expected one first picture, got 2"),
        ("no picture", "00000.png: expected a picture that can be read"),
        ("another size", "00003.png: expected a picture of 166 x 94, as the first, got 8 x 8"),
        ("marked", "failure.txt: expected a sequence that was solved"),
    ],
)
def test_damaged_pictures_leave_nothing_of_their_sequence(dataset, tmp_path, kind, words):
    break_pictures(dataset / "train" / "00000" / "00000", kind)
    outcome = taken(dataset, tmp_path / "out", pictures="video")
    assert outcome.clips == ("train_00007", "test_00000") and words in str(outcome.problems[0])
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == [
        "shots.parquet",
        "test_00000",
        "train_00007",
        "videos",
    ]
    assert sorted(path.name for path in (tmp_path / "out" / "videos").iterdir()) == [
        "test_00000.mp4",
        "train_00007.mp4",
    ]


def test_a_malicious_camera_file_is_refused_and_does_nothing(dataset, tmp_path):
    class Evil:
        def __reduce__(self):
            return os.system, (f"touch {tmp_path / 'mark'}",)

    (dataset / "train" / "00000" / "00000" / "cameras.pkl").write_bytes(pickle.dumps([Evil()]))
    outcome = taken(dataset, tmp_path / "out")
    assert "posix.system" in str(outcome.problems[0]) and not (tmp_path / "mark").exists()
    assert outcome.clips == ("train_00007", "test_00000")


def test_failed_boxes_and_another_number_of_objects_without_any_are_no_boxes(dataset, tmp_path):
    (dataset / "train" / "00000" / "00000" / "boxes_failure.txt").touch()
    one = {"bounding_boxes": [np.zeros((4, 1))] * 2, "bounding_box_validity": [np.array([False])] * 2}
    write_video(dataset / "val" / "00000" / "00000", 2, **one)
    three = {
        "bounding_boxes": [np.tile([[0.1], [0.1], [0.2], [0.2]], (1, 3))] * 2,
        "bounding_box_validity": [np.ones(3, dtype=bool)] * 2,
    }
    write_video(dataset / "val" / "00001" / "00000", 2, **three)
    outcome = taken(dataset, tmp_path / "out")
    for name in ("train_00000", "val_00000"):
        assert all(np.isnan(track.box_px).all() for track in read_clip_players(tmp_path / "out" / name, TENNIS).players)
    assert "expected 2 objects, the players of scene tennis, got 3" in str(outcome.problems[0])


def test_blocks_have_y_up_and_their_own_picture_size(tmp_path):
    one = {
        "bounding_boxes": [np.array([[0.2], [0.2], [0.4], [0.8]])] * 2,
        "bounding_box_validity": [np.array([True])] * 2,
    }
    camera = [pose((-0.3, 0, 0), (0, 5, 10))] * 2
    write_video(tmp_path / "data" / "train" / "00000" / "00000", 2, size=(512, 288), cameras=camera, **one)
    outcome = import_playable(tmp_path / "data", tmp_path / "out", scene=BLOCKS, options=NO_PICTURES)
    clip = read_clip_camera(tmp_path / "out" / outcome.clips[0])
    np.testing.assert_allclose(clip.camera.position_world[0], [0, -10, 5], atol=1e-6)
    np.testing.assert_allclose(clip.camera.K[0, 0, 0], FOCAL / 2)
    pixel, _ = project(clip.camera[0], np.array([[0.0, 0.0, 5 - 10 * np.tan(0.3)]]))
    np.testing.assert_allclose(pixel[0], [256, 144], atol=1e-4)


def test_what_is_no_dataset_or_has_no_known_focal_size_is_refused(tmp_path):
    (tmp_path / "data" / "notes").mkdir(parents=True)
    with pytest.raises(ValueError, match="expected train/00000/00000 or the like"):
        taken(tmp_path / "data", tmp_path / "out")
    with pytest.raises(ValueError, match="focal_size: expected"):
        import_playable(tmp_path, tmp_path / "out", scene=load_scene("badminton"))
    with pytest.raises(ValueError, match="fps: expected"):
        PlayableOptions(fps=float("nan"))
