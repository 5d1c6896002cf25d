"""Body points come back where they are in the picture, and nowhere else."""

import numpy as np
import pytest

from pgm_data.detect.pose.estimate import PoseOptions, estimate_poses
from tests.detect.pose.marked_bodies import MarkReader, body_points, boxes_of, clip_of, draw

GREY = np.full((240, 320, 3), 90, np.uint8)
BOX = np.array([100.0, 40.0, 170.0, 180.0])


def marked(boxes: np.ndarray, radius: float = 2.4, picture: np.ndarray = GREY) -> list[np.ndarray]:
    """Pictures with the bodies of those boxes (frames, players, 4)."""
    pictures = []
    for frame in boxes:
        drawn = picture
        for box in frame:
            drawn = draw(drawn, body_points(box), radius) if np.isfinite(box).all() else drawn
        pictures.append(drawn)
    return pictures


def run(model: MarkReader, pictures: list[np.ndarray], boxes: np.ndarray, duplicate=(), **options):
    """Poses in those pictures around those boxes."""
    clip = clip_of(len(pictures), duplicate=duplicate)
    return estimate_poses(model, lambda: iter(pictures), boxes_of(boxes), clip, options=PoseOptions(**options))


@pytest.mark.parametrize("looks", [1, 2])
@pytest.mark.parametrize(
    "box",
    [BOX, BOX + [0.37, -0.61, 0.37, -0.61], [200.0, 90.0, 290.0, 180.0], [10.0, 5.0, 34.0, 53.0]],
    ids=["middle", "between pixels", "as wide as high", "48 px high"],
)
def test_points_are_carried_back_into_the_picture(box: np.ndarray, looks: int) -> None:
    boxes = np.array(box, dtype=float).reshape(1, 1, 4)
    high = boxes[0, 0, 3] - boxes[0, 0, 1]
    pictures = marked(boxes, radius=max(0.9, high / 58), picture=np.full((360, 480, 3), 90, np.uint8))
    poses = run(MarkReader(), pictures, boxes, looks=looks, least_presence=0.3)
    found = poses.found[0, 0]
    assert found.mean() > 0.9
    far = np.abs(poses.points_px[0, 0] - body_points(boxes[0, 0]))[poses.score[0, 0] > 0.5]
    assert len(far) >= 8 and far.max() < max(0.8, 0.01 * high)
    assert (poses.sigma_px[0, 0][found] >= 0.6).all()


def test_a_mirrored_second_look_keeps_left_and_right_and_the_way_up() -> None:
    boxes = np.broadcast_to(BOX, (1, 1, 4))
    one, two = (run(MarkReader(), marked(boxes), boxes, looks=looks) for looks in (1, 2))
    np.testing.assert_allclose(two.points_px, one.points_px, atol=0.3)
    np.testing.assert_allclose(two.points_ray[..., 1:], one.points_ray[..., 1:], atol=1.5)
    np.testing.assert_allclose(two.points_ray[..., 0], one.points_ray[..., 0], atol=0.05)


def test_what_lies_beyond_the_picture_is_not_found() -> None:
    boxes = np.array([[[100.0, 140.0, 180.0, 300.0]]])
    poses = run(MarkReader(), marked(boxes), boxes, least_presence=0.2)
    truth = body_points(boxes[0, 0])
    inside = truth[:, 1] < 239
    assert poses.found[0, 0][inside].all()
    np.testing.assert_allclose(poses.points_px[0, 0][inside], truth[inside], atol=0.8)
    for values in (poses.points_px, poses.score, poses.sigma_px, poses.points_ray):
        beyond = np.isnan(poses.points_px[0, 0]).any(axis=-1)
        assert np.isnan(values[0, 0][beyond]).all()


def test_repeated_frames_and_frames_not_asked_for_are_not_looked_at() -> None:
    boxes = np.broadcast_to(BOX, (9, 1, 4)).copy()
    boxes[6] = np.nan
    model = MarkReader()
    poses = run(model, marked(boxes), boxes, duplicate=(1, 4), every=2)
    # Own pictures: 0, 2, 3, 5, 6, 7, 8; every second of them: 0, 3, 6, 8; in 6 there is no box.
    assert np.flatnonzero(poses.found.any(axis=(1, 2))).tolist() == [0, 3, 8]
    assert model.calls == 3


def test_an_empty_box_gives_nothing_and_a_body_beside_its_box_is_found_by_a_second_look() -> None:
    empty = np.broadcast_to(BOX, (1, 1, 4))
    assert not run(MarkReader(), [GREY], empty).found.any()
    truth = np.broadcast_to(BOX, (3, 1, 4))
    boxes = truth.copy()
    boxes[1] += [0.0, 62.0, 0.0, 62.0]
    poses = run(MarkReader(), marked(truth, radius=3.4), boxes, wider=1.5, least_presence=0.9)
    assert poses.found[[0, 2]].all()
    np.testing.assert_allclose(poses.points_px[1, 0], body_points(BOX), atol=1.0)


def test_a_body_in_another_box_is_not_taken_for_the_player() -> None:
    boxes = np.array([[[100.0, 40.0, 170.0, 180.0], [181.0, 40.0, 251.0, 180.0]]])
    pictures = marked(boxes[:, :1])
    poses = run(MarkReader(), pictures, boxes, least_presence=0.1)
    assert poses.found[0, 0].all()
    assert not poses.found[0, 1].any()


def test_a_body_much_smaller_than_its_box_is_looked_at_closer() -> None:
    truth = np.array([[[150.0, 90.0, 180.0, 150.0]]])
    boxes = np.array([[[110.0, 40.0, 220.0, 200.0]]])
    model = MarkReader()
    poses = run(model, marked(truth, radius=2.0), boxes, least_presence=0.3, unsure=0.3)
    assert len(model.crops) == 2
    far = np.abs(poses.points_px[0, 0] - body_points(truth[0, 0]))[poses.score[0, 0] > 0.5]
    assert len(far) >= 12 and far.max() < 0.6


def test_frames_in_which_the_network_takes_left_for_right_are_put_right() -> None:
    boxes = np.broadcast_to(BOX, (12, 1, 4)) + np.arange(12)[:, None, None] * [2.0, 0.0, 2.0, 0.0]
    pictures = marked(boxes)
    wrong = (3, 6, 7)
    trusting = run(MarkReader(confused=wrong), pictures, boxes, swap_chance=0.0)
    watching = run(MarkReader(confused=wrong), pictures, boxes)
    truth = np.stack([body_points(box[0]) for box in boxes])
    off = np.abs(trusting.points_px[:, 0] - truth).max(axis=(1, 2)) > 5
    assert np.flatnonzero(off).tolist() == list(wrong)
    np.testing.assert_allclose(watching.points_px[:, 0], truth, atol=0.8)


def test_a_clip_of_one_frame_and_one_without_boxes() -> None:
    boxes = np.broadcast_to(BOX, (1, 1, 4))
    assert run(MarkReader(), marked(boxes), boxes).found.all()
    model = MarkReader()
    poses = run(model, [GREY] * 3, np.full((3, 2, 4), np.nan))
    assert model.calls == 0 and not poses.found.any() and np.isnan(poses.score).all()
    assert run(model, [GREY] * 3, np.full((3, 0, 4), np.nan)).points_px.shape == (3, 0, 17, 2)


@pytest.mark.parametrize(("pictures", "said"), [(1, "expected 2, got 1"), (3, "expected 2, got more")])
def test_another_number_of_pictures_is_refused(pictures: int, said: str) -> None:
    boxes = boxes_of(np.broadcast_to(BOX, (2, 1, 4)))
    with pytest.raises(ValueError, match=said):
        estimate_poses(MarkReader(), lambda: iter([GREY] * pictures), boxes, clip_of(2))
    with pytest.raises(ValueError, match="expected 3 frames, got 2"):
        estimate_poses(MarkReader(), lambda: iter([GREY] * 2), boxes, clip_of(3))


@pytest.mark.parametrize("wrong", [{"every": 0}, {"looks": 3}, {"least_presence": 1.5}, {"wider": 0.5}])
def test_options_out_of_range_are_refused(wrong: dict) -> None:
    with pytest.raises(ValueError, match=next(iter(wrong))):
        PoseOptions(**wrong)
