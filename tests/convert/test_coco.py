"""COCO keypoints out and in.

A round trip keeps boxes, keypoints and scores to 1e-4; it loses everything in metres and a box's status.
"""

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest

from pgm_data.convert.coco_people import COCO_POINTS, SPREAD, read_coco_people
from pgm_data.convert.coco_write import keypoint_edges
from pgm_data.convert.exchange import ExportOptions
from pgm_data.convert.exchange_tables import export_coco
from pgm_data.convert.foreign_people import PeopleOptions, boxes_with_centre_origin, boxes_with_corner_origin
from pgm_data.dataset.clip_camera import read_clip_camera
from pgm_data.dataset.clip_players import read_clip_players
from pgm_data.geometry.camera import Camera, project
from pgm_data.scene import load_scene
from tests.convert.coco_files import FRAMES, TENNIS, changed, exported_text, small_clip, strip, without_frames
from tests.convert.folders import cameras, numbered_video, track
from tests.simulate.store_worlds import write_truth_clip

BLOCKS = load_scene("blocks")


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    return small_clip(tmp_path_factory.mktemp("coco"))


@pytest.fixture(scope="module")
def text(made, tmp_path_factory):
    return exported_text(made[0], tmp_path_factory.mktemp("exported"))


@pytest.fixture
def exported(text, tmp_path):
    (tmp_path / "rally.json").write_text(text)
    return tmp_path / "rally.json"


def test_pictures_go_out_where_the_file_names_them(tmp_path):
    (tmp_path / "videos").mkdir()
    numbered_video(tmp_path / "videos" / "match.mp4", 5, size=(320, 180))
    write_truth_clip(tmp_path / "work" / "rally 1", TENNIS, frames=5, video=tmp_path / "videos" / "match.mp4")
    outcome = export_coco(tmp_path / "work", tmp_path / "out", ExportOptions(every=2, images=True))
    assert outcome.problems == ()
    content = json.loads((tmp_path / "out" / "rally 1.json").read_text())
    means = [cv2.imread(str(tmp_path / "out" / "images" / image["file_name"])).mean() for image in content["images"]]
    np.testing.assert_allclose(means, [40, 50, 60], atol=2.5)
    (tmp_path / "videos" / "match.mp4").unlink()
    lost = export_coco(tmp_path / "work", tmp_path / "again", ExportOptions(every=2, images=True))
    assert "source_path: expected its video" in str(lost.problems[0]) and len(lost.files) == 1


def test_what_goes_out_comes_back(made, exported):
    _, camera, clip = made
    boxes, poses = read_coco_people(exported, camera, TENNIS.players)
    assert boxes.names == poses.names == ("player0", "player1")
    assert set(poses.point_names) == set(COCO_POINTS)
    order = [poses.point_names.index(name) for name in TENNIS.players[0].skeleton.keypoint_names]
    for i, player in enumerate(clip.players):
        np.testing.assert_allclose(boxes.boxes_px[:, i], player.box_px, atol=1e-4)
        there = np.isfinite(player.box_px[:, 0])
        expected = np.where(there[:, None, None], player.keypoints_px, np.nan)
        np.testing.assert_allclose(poses.points_px[:, i][:, order], expected, atol=1e-4)
        scores = np.where(np.isfinite(expected[..., 0]), player.keypoint_score, np.nan)
        np.testing.assert_allclose(poses.score[:, i][:, order], scores, atol=1e-4)
        assert (boxes.status[:, i] == np.where(there, "measured", "none")).all()
    assert np.isnan(poses.points_ray).all()


def test_the_file_is_what_coco_says(made, exported):
    content = json.loads(exported.read_text())
    assert [image["id"] for image in content["images"]] == list(range(1, FRAMES + 1))
    (category,) = content["categories"]
    assert category["name"] == "person" and category["keypoints"] == list(COCO_POINTS)
    assert len(category["skeleton"]) == 19 and max(max(edge) for edge in category["skeleton"]) == 17
    ids = {annotation["id"] for annotation in content["annotations"]}
    assert len(ids) == len(content["annotations"]) == 2 * FRAMES - 1
    for annotation in content["annotations"]:
        x, y, w, h = annotation["bbox"]
        keypoints = np.array(annotation["keypoints"]).reshape(17, 3)
        assert w > 0 and h > 0 and annotation["area"] == pytest.approx(w * h, rel=1e-5)
        assert annotation["num_keypoints"] == (keypoints[:, 2] > 0).sum()
        assert (keypoints[keypoints[:, 2] == 0] == 0).all() and set(keypoints[:, 2]) <= {0, 1, 2}
        assert annotation["category_id"] == 1 and annotation["iscrowd"] == 0
    first = content["annotations"][0]
    assert {row[2] for row in np.array(first["keypoints"]).reshape(17, 3).tolist()} == {0, 1, 2}


def test_a_box_is_an_area_from_the_corner_and_a_point_the_number_of_a_pixel(made, exported):
    """A box around the top-left pixel alone is 0, 0, 1, 1 there and -0.5, -0.5, 0.5, 0.5 here."""
    np.testing.assert_array_equal(boxes_with_centre_origin(np.array([[0.0, 0, 1, 1]])), [[-0.5, -0.5, 0.5, 0.5]])
    np.testing.assert_array_equal(boxes_with_corner_origin(np.array([[-0.5, -0.5, 0.5, 0.5]])), [[0, 0, 1, 1]])
    clip = made[2]
    annotation = json.loads(exported.read_text())["annotations"][0]
    assert annotation["bbox"][0] == pytest.approx(clip.players[0].box_px[0, 0] + 0.5, abs=1e-4)
    assert annotation["keypoints"][0] == pytest.approx(clip.players[0].keypoints_px[0, 0, 0], abs=1e-4)


def test_without_names_players_are_told_by_their_half_of_the_court(made, exported):
    _, camera, clip = made
    boxes, poses = read_coco_people(
        changed(exported, lambda c: strip(c, keep=("frame_index",))), camera, TENNIS.players
    )
    for i, player in enumerate(clip.players):
        np.testing.assert_allclose(boxes.boxes_px[:, i], player.box_px, atol=1e-4)
    # Visible ones have a score of 1, hidden ones a low one.
    assert set(np.unique(poses.score[np.isfinite(poses.score)])) == {0.3, 1.0}
    assert abs(boxes.ground_world[0, 0] - clip.players[0].root_position[0, :2]).max() < 0.5


def test_people_beside_the_players_are_passed_over(made, exported):
    _, camera, clip = made

    def add(content):
        strip(content, keep=("frame_index",))
        places = np.array([[7.5, 0.0, 0.0], [-8.0, -19.0, 0.0], [3.0, 19.5, 0.0], [25.0, 5.0, 0.0]])
        pixels, _ = project(camera.camera[0], places)
        for number, (x, y) in enumerate(pixels):
            own = {
                "id": 900 + number,
                "image_id": 1,
                "category_id": 1,
                "bbox": [x - 10, y - 40, 20, 40.5],
                "score": 1.0,
            }
            content["annotations"].insert(0, own)

    boxes, _ = read_coco_people(changed(exported, add), camera, TENNIS.players)
    for i, player in enumerate(clip.players):
        np.testing.assert_allclose(boxes.boxes_px[:, i], player.box_px, atol=1e-4)


def test_a_track_keeps_its_player_where_the_camera_is_lost(made, exported):
    _, camera, clip = made
    status = np.array(camera.status)
    status[3:] = "none"
    parts = {
        name: np.array(getattr(camera.camera, name))
        for name in ("K", "distortion", "R_cam_from_world", "t_cam_from_world")
    }
    for values in parts.values():
        values[3:] = np.nan
    lost = replace(camera, status=status, camera=Camera(**parts))
    with_tracks = changed(exported, lambda c: strip(c, keep=("frame_index", "track_id")))
    boxes, _ = read_coco_people(with_tracks, lost, TENNIS.players)
    np.testing.assert_allclose(boxes.boxes_px[:, 0], clip.players[0].box_px, atol=1e-4)
    assert np.isnan(boxes.ground_world[3:]).all() and (boxes.status[3:] == "measured").all()
    without = changed(exported, lambda c: strip(c, keep=("frame_index",)))
    assert (read_coco_people(without, lost, TENNIS.players)[0].status[3:] == "none").all()


@pytest.mark.parametrize("where", ["attributes", "category", "some"])
def test_a_player_may_be_named_in_other_places(made, exported, where):
    _, camera, clip = made

    def change(content):
        names = [annotation["player"] for annotation in content["annotations"]]
        strip(content, keep=("frame_index", "track_id"))
        for annotation, name in zip(content["annotations"], names, strict=True):
            # Against what their places say, so that only the name can have told.
            other = {"player0": "player1", "player1": "player0"}[name]
            if where == "attributes":
                annotation["attributes"] = {"player": other}
            elif where == "category":
                annotation["category_id"] = 2 + int(other[-1])
            elif annotation["image_id"] == 2:
                annotation["player"] = other
        points = content["categories"][0]["keypoints"]
        content["categories"] += [{"id": 2 + i, "name": f"player{i}", "keypoints": points} for i in range(2)]

    boxes, _ = read_coco_people(changed(exported, change), camera, TENNIS.players)
    np.testing.assert_allclose(boxes.boxes_px[:, 0], clip.players[1].box_px, atol=1e-4)


@pytest.mark.parametrize(
    "names",
    [
        [f"frame_{i:04d}.jpg" for i in range(FRAMES)],
        [f"take2/{i}.png" for i in range(FRAMES)],
        ["a.jpg", "b.jpg", "c.jpg", "d.jpg", "e.jpg", "f.jpg"],
        [""] * FRAMES,
    ],
)
def test_frames_follow_from_names_or_from_their_order(made, exported, names):
    _, camera, clip = made
    boxes, _ = read_coco_people(changed(exported, lambda c: without_frames(c, names)), camera, TENNIS.players)
    np.testing.assert_allclose(boxes.boxes_px[:, 0], clip.players[0].box_px, atol=1e-4)


def test_numbers_from_1_are_refused_unless_it_is_said_where_they_begin(made, exported):
    _, camera, clip = made
    path = changed(exported, lambda c: without_frames(c, [f"{i + 1:06d}.jpg" for i in range(FRAMES)]))
    with pytest.raises(ValueError, match="whether the video's first frame is 0 or 1, got 1 to 6"):
        read_coco_people(path, camera, TENNIS.players)
    boxes, _ = read_coco_people(path, camera, TENNIS.players, PeopleOptions(first_number=1))
    np.testing.assert_allclose(boxes.boxes_px[:, 0], clip.players[0].box_px, atol=1e-4)
    boxes, _ = read_coco_people(path, camera, TENNIS.players, PeopleOptions(first_number=0))
    np.testing.assert_allclose(boxes.boxes_px[1:, 0], clip.players[0].box_px[:-1], atol=1e-4)
    assert boxes.status[0, 0] == "none"


def test_numbers_are_frames_of_the_video_and_others_are_passed_over(made, exported):
    _, _, clip = made
    later = track("rally", cameras(3, size=(1280, 720)), first=2)
    path = changed(exported, lambda c: without_frames(c, [f"{i}.jpg" for i in range(FRAMES)]))
    boxes, _ = read_coco_people(
        changed(path, lambda c: [a.update(player="player0") for a in c["annotations"][:FRAMES]]), later, TENNIS.players
    )
    np.testing.assert_allclose(boxes.boxes_px[:, 0], clip.players[0].box_px[2:5], atol=1e-4)


def test_a_list_of_results_has_scores(made, exported):
    _, camera, clip = made
    content = json.loads(exported.read_text())
    results = [
        {
            "image_id": a["image_id"] - 1,
            "category_id": 1,
            "score": 0.75,
            "bbox": a["bbox"],
            "keypoints": [v if i % 3 < 2 else (0.5 if v else 0) for i, v in enumerate(a["keypoints"])],
        }
        for a in content["annotations"]
    ]
    exported.write_text(json.dumps(results))
    boxes, poses = read_coco_people(exported, camera, TENNIS.players)
    np.testing.assert_allclose(boxes.boxes_px[:, 0], clip.players[0].box_px, atol=1e-4)
    assert set(boxes.score[np.isfinite(boxes.score)]) == {0.75}
    assert set(poses.score[np.isfinite(poses.score)]) == {0.5}


def test_images_of_another_size_are_scaled_corner_on_corner(made, exported):
    _, camera, clip = made

    def halve(content):
        for image in content["images"]:
            image.update(width=640, height=360)
        for annotation in content["annotations"]:
            annotation["bbox"] = [value / 2 for value in annotation["bbox"]]
            annotation["keypoints"] = [
                value if i % 3 == 2 or not annotation["keypoints"][i - i % 3 + 2] else (value + 0.5) / 2 - 0.5
                for i, value in enumerate(annotation["keypoints"])
            ]

    path = changed(exported, halve)
    boxes, poses = read_coco_people(path, camera, TENNIS.players, PeopleOptions(width=1280, height=720))
    np.testing.assert_allclose(boxes.boxes_px[:, 0], clip.players[0].box_px, atol=1e-3)
    order = [poses.point_names.index(name) for name in COCO_POINTS]
    np.testing.assert_allclose(poses.points_px[:, 0][:, order], clip.players[0].keypoints_px, atol=1e-3)
    with pytest.raises(ValueError, match="width, height: expected the shape of 1280 x 960"):
        read_coco_people(path, camera, TENNIS.players, PeopleOptions(width=1280, height=960))


def test_doubt_grows_with_the_box_and_is_cocos_own(made, exported):
    _, camera, _ = made
    boxes, poses = read_coco_people(exported, camera, TENNIS.players)
    hip, nose = poses.point_names.index("left_hip"), poses.point_names.index("nose")
    side = boxes.boxes_px[0, 0, 2:] - boxes.boxes_px[0, 0, :2]
    expected = SPREAD["hip"] * np.sqrt(0.53 * side.prod()) / np.sqrt(2)
    assert poses.sigma_px[0, 0, hip] == pytest.approx(expected)
    assert poses.sigma_px[0, 0, hip] > poses.sigma_px[0, 0, nose]
    assert poses.sigma_px[0, 0, hip] > poses.sigma_px[0, 1, hip]
    stated = read_coco_people(exported, camera, TENNIS.players, PeopleOptions(sigma_px=2.0))[1].sigma_px
    assert set(stated[np.isfinite(stated)]) == {2.0}


def test_a_person_without_a_box_has_that_of_its_points(made, exported):
    _, camera, clip = made
    boxes, poses = read_coco_people(
        changed(exported, lambda c: [a.pop("bbox") for a in c["annotations"]]), camera, TENNIS.players
    )
    np.testing.assert_allclose(boxes.boxes_px[0, 0, :2], np.nanmin(clip.players[0].keypoints_px[0], axis=0), atol=1e-4)
    assert poses.found[0].any()


def test_points_are_known_by_their_names_in_any_order_and_others_are_passed_over(made, exported):
    _, camera, clip = made

    def change(content):
        strip(content, keep=("frame_index", "player"))
        content["categories"][0]["keypoints"] = ["Left-Big Toe", "third_ear", "NOSE"]
        for annotation in content["annotations"]:
            annotation["keypoints"] = [1.0, 2.0, 2, 3.0, 4.0, 2, *annotation["keypoints"][:3]]

    _, poses = read_coco_people(changed(exported, change), camera, TENNIS.players)
    assert poses.point_names == ("nose", "left_big_toe")
    np.testing.assert_allclose(poses.points_px[:, 0, 0], clip.players[0].keypoints_px[:, 0], atol=1e-4)
    np.testing.assert_allclose(poses.points_px[0, 0, 1], [1, 2])


def test_blocks_have_edges_along_their_tree_and_one_player_needs_no_half(tmp_path):
    edges = keypoint_edges(BLOCKS.players[0].skeleton)
    names = BLOCKS.players[0].skeleton.keypoint_names
    assert {(names[a - 1], names[b - 1]) for a, b in edges} >= {
        ("root", "head"),
        ("head", "head_end"),
        ("L_leg", "L_leg_end"),
    }
    assert len(edges) == len(names) - 1
    write_truth_clip(tmp_path / "work" / "walk", BLOCKS, frames=3)
    export_coco(tmp_path / "work", tmp_path / "out", ExportOptions(every=1))
    camera = read_clip_camera(tmp_path / "work" / "walk")
    boxes, poses = read_coco_people(tmp_path / "out" / "walk.json", camera, BLOCKS.players)
    player = read_clip_players(tmp_path / "work" / "walk", BLOCKS).players[0]
    np.testing.assert_allclose(boxes.boxes_px[:, 0], player.box_px, atol=1e-4)
    seen = np.isfinite(player.keypoints_px[..., 0]).any(axis=0)
    assert set(poses.point_names) == {name for name, is_seen in zip(names, seen, strict=True) if is_seen}
