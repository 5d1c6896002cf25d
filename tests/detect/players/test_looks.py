"""A person's look is the same near and far, and another person's is another."""

import cv2
import numpy as np
import pytest

from pgm_data.detect.players.looks import NUMBERS, PARTS, STANDING, LookOptions, describe, lab, look
from pgm_data.detect.pose.model import COCO_POINTS
from pgm_data.people import PlayerPoses
from tests.detect.pose.marked_bodies import boxes_of, clip_of

COURT = (150, 90, 40)
RED = {
    "hair": (20, 20, 30),
    "shirt": (40, 40, 200),
    "shorts": (240, 240, 240),
    "legs": (120, 150, 200),
    "shoes": (0, 220, 250),
}
GREEN = {
    "hair": (90, 200, 230),
    "shirt": (60, 180, 60),
    "shorts": (30, 30, 30),
    "legs": (70, 90, 130),
    "shoes": (255, 255, 255),
}
NEAR, FAR = np.array([60.0, 60.0, 160.0, 260.0]), np.array([300.0, 40.0, 330.0, 100.0])


def body(box: np.ndarray, turn_deg: float = 0.0) -> dict[str, np.ndarray]:
    """Points of a standing body in its box, turned about the box's middle."""
    middle, (sin, cos) = 0.5 * (box[:2] + box[2:]), (np.sin(np.radians(turn_deg)), np.cos(np.radians(turn_deg)))
    R = np.array([[cos, -sin], [sin, cos]])
    places = {name: box[:2] + np.array(share) * (box[2:] - box[:2]) for name, share in STANDING.items()}
    return {name: middle + R @ (place - middle) for name, place in places.items()}


def paint(picture: np.ndarray, points: dict[str, np.ndarray], high: float, colours: dict) -> np.ndarray:
    """The picture with a body of those colours."""

    def line(part: str, start: np.ndarray, end: np.ndarray, share: float) -> None:
        ends = [tuple(int(v) for v in np.round(place * 16)) for place in (start, end)]
        cv2.line(drawn, *ends, colours[part], max(1, round(share * high)), cv2.LINE_AA, 4)

    drawn = picture.copy()
    shoulders, hips, ears = (
        0.5 * (points[f"left_{name}"] + points[f"right_{name}"]) for name in ("shoulder", "hip", "ear")
    )
    line("shirt", shoulders, hips, 0.2)
    line("hair", ears, ears + 0.1 * (shoulders - hips), 0.11)
    for side in ("left", "right"):
        hip, knee, ankle = (points[f"{side}_{name}"] for name in ("hip", "knee", "ankle"))
        line("legs", knee, ankle, 0.06)
        line("shorts", hip, knee + 0.3 * (hip - knee), 0.12)
        line("shoes", ankle + 0.02 * (ankle - knee), ankle + 0.2 * (ankle - knee), 0.07)
    return drawn


def scene(near: dict, far: dict, brightness: float = 1.0) -> np.ndarray:
    picture = np.full((300, 400, 3), COURT, np.uint8)
    picture = paint(picture, body(NEAR), 200.0, near)
    picture = paint(picture, body(FAR), 60.0, far)
    return np.round(picture * brightness).astype(np.uint8)


def parts(values: np.ndarray) -> dict[str, np.ndarray]:
    return dict(zip(PARTS, values[:15].reshape(5, 3), strict=True))


def test_each_part_has_the_colour_that_was_painted_near_and_far() -> None:
    picture = scene(RED, GREEN)
    for box, colours in ((NEAR, RED), (FAR, GREEN)):
        values, seen = describe(picture, body(box), box)
        assert seen == 1.0 and values.shape == (len(NUMBERS),)
        for part, got in parts(values).items():
            expected = lab(np.array([colours[part]], np.uint8))[0]
            np.testing.assert_allclose(got, expected, atol=6.0, err_msg=part)


@pytest.mark.parametrize("brightness", [1.0, 0.75])
def test_persons_who_change_ends_keep_their_looks(brightness: float) -> None:
    before = [describe(scene(RED, GREEN), body(box), box)[0] for box in (NEAR, FAR)]
    after = [describe(scene(GREEN, RED, brightness), body(box), box)[0] for box in (NEAR, FAR)]
    same = [np.linalg.norm(before[index] - after[1 - index]) for index in (0, 1)]
    other = [np.linalg.norm(before[index] - after[index]) for index in (0, 1)]
    assert max(same) < 0.4 * min(other)


@pytest.mark.parametrize("turn", [90.0, -60.0])
def test_a_player_who_lies_looks_as_one_who_stands_where_the_points_are_known(turn: float) -> None:
    box = np.array([100.0, 50.0, 200.0, 250.0])
    court = np.full((300, 300, 3), COURT, np.uint8)
    lying, standing = (
        describe(paint(court, body(box, angle), 200.0, RED), body(box, angle), box)[0] for angle in (turn, 0.0)
    )
    np.testing.assert_allclose(lying[:15], standing[:15], atol=4.0)


def test_parts_out_of_the_picture_are_not_seen() -> None:
    box = np.array([100.0, 150.0, 200.0, 450.0])
    picture = paint(np.full((300, 300, 3), COURT, np.uint8), body(box), 300.0, RED)
    values, seen = describe(picture, body(box), box)
    assert seen == pytest.approx(0.4)
    assert np.isfinite(parts(values)["shirt"]).all() and np.isnan(parts(values)["legs"]).all()


def test_a_clip_is_looked_at_in_frames_spread_over_each_run_between_cuts() -> None:
    frames = 100
    boxes = np.broadcast_to(np.stack([NEAR, FAR]), (frames, 2, 4)).copy()
    boxes[40:50, 1] = np.nan
    boxes[:, 1][60:62] = [300.0, 40.0, 310.0, 55.0]
    cut = np.arange(frames) == 90
    pictures = [scene(RED, GREEN)] * frames
    clip = clip_of(frames, duplicate=tuple(range(0, frames, 5)))
    options = LookOptions(frames=20, frames_a_run=4)
    looks = look(lambda: iter(pictures), boxes_of(boxes), None, clip, cut=cut, options=options)
    seen = np.isfinite(looks.descriptors).all(axis=-1)
    assert (seen[:, 0] == seen[:, 1]).all()
    rows = np.flatnonzero(seen[:, 0])
    assert (rows < 90).sum() == 18 and (rows >= 90).sum() == 4
    assert not clip.is_duplicate[rows].any()
    assert not np.isin(rows, [*range(40, 50), 60, 61]).any()
    assert np.diff(rows[rows < 90]).max() <= 16
    np.testing.assert_array_equal(looks.weight, seen * 1.0)
    assert np.ptp(looks.descriptors[rows], axis=0).max() == 0


def test_points_of_a_pose_are_used_and_a_lost_pose_falls_back_on_the_box() -> None:
    box = np.array([100.0, 50.0, 200.0, 250.0])
    turned = body(box, 90.0)
    picture = paint(np.full((300, 300, 3), COURT, np.uint8), turned, 200.0, RED)
    points = np.full((2, 1, 17, 2), np.nan)
    for index, name in enumerate(COCO_POINTS):
        points[0, 0, index] = turned.get(name, np.nan)
    score = np.where(np.isfinite(points[..., 0]), 1.0, np.nan)
    poses = PlayerPoses(
        names=("player0",),
        point_names=COCO_POINTS,
        points_px=points,
        score=score,
        sigma_px=score,
        points_ray=np.full((2, 1, 17, 3), np.nan),
    )
    boxes = boxes_of(np.broadcast_to(box, (2, 1, 4)))
    looks = look(lambda: iter([picture] * 2), boxes, poses, clip_of(2))
    np.testing.assert_allclose(looks.descriptors[0, 0], describe(picture, turned, box)[0])
    assert np.isnan(looks.descriptors[1]).all()
    # The second frame is a run of its own, in which no points were found.
    looks = look(lambda: iter([picture] * 2), boxes, poses, clip_of(2), cut=np.array([True, True]))
    np.testing.assert_allclose(looks.descriptors[1, 0], describe(picture, body(box), box)[0])


def test_nobody_to_look_at_and_another_number_of_frames() -> None:
    nothing = boxes_of(np.full((3, 2, 4), np.nan))
    looks = look(lambda: iter([]), nothing, None, clip_of(3))
    assert np.isnan(looks.descriptors).all() and (looks.weight == 0).all()
    with pytest.raises(ValueError, match="expected 3 frames, got 4"):
        look(lambda: iter([]), nothing, None, clip_of(4))
    with pytest.raises(ValueError, match="frames_a_run"):
        LookOptions(frames_a_run=0)
