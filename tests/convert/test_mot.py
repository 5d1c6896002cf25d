"""MOT boxes out and in. A round trip keeps boxes to 1e-4; it loses names, points, poses, times and statuses."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pgm_data.convert.exchange_tables import export_mot
from pgm_data.convert.foreign_people import PeopleOptions
from pgm_data.convert.mot_boxes import read_mot_boxes
from pgm_data.dataset.clip_camera import read_clip_camera
from pgm_data.dataset.clip_players import read_clip_players
from pgm_data.geometry.camera import project
from pgm_data.scene import load_scene
from tests.convert.folders import cameras, track
from tests.simulate.store_worlds import write_truth_clip

TENNIS = load_scene("tennis")
FRAMES = 6
CLIP = track("rally", cameras(FRAMES, size=(1280, 720)), first=10)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    root = tmp_path_factory.mktemp("mot")
    write_truth_clip(root / "work" / "rally", TENNIS, frames=FRAMES)
    export_mot(root / "work", root / "out")
    folder = root / "work" / "rally"
    return root / "out" / "rally.txt", read_clip_camera(folder), read_clip_players(folder, TENNIS)


def people(places, frame):
    """Rows for people who stand in those places, in the corner pixels of the file."""
    pixels, _ = project(CLIP.camera[frame], np.array([[x, y, 0.0] for x, y in places]))
    return [[x + 0.5 - 20, y + 0.5 - 80, 40, 80] for x, y in pixels]


def written(tmp_path, rows, *, delimiter=",", header=""):
    path = tmp_path / "boxes.txt"
    path.write_text(header + "".join(delimiter.join(str(value) for value in row) + "\n" for row in rows))
    return path


def rows_of(places, *, first=1, ids=(1, 2), tail=(1, -1, -1, -1)):
    return [
        [10 + frame + first, number, *box, *tail]
        for frame in range(FRAMES)
        for number, box in zip(ids, people(places, frame), strict=True)
    ]


PLACES = [(1.0, -12.0), (-2.0, 11.0)]


def assert_placed(boxes, places=PLACES):
    for i, place in enumerate(places):
        np.testing.assert_allclose(boxes.ground_world[:, i], np.tile(place, (FRAMES, 1)), atol=1e-6)
    assert (boxes.status == "measured").all()


def test_what_goes_out_comes_back(made):
    path, camera, clip = made
    boxes = read_mot_boxes(path, camera, TENNIS.players)
    for i, player in enumerate(clip.players):
        np.testing.assert_allclose(boxes.boxes_px[:, i], player.box_px, atol=1e-4)
    first = path.read_text().splitlines()[0].split(",")
    assert first[:2] == ["1", "1"] and first[6:] == ["1", "-1", "-1", "-1"] and len(first) == 10
    assert float(first[2]) == pytest.approx(clip.players[0].box_px[0, 0] + 0.5, abs=1e-4)


@pytest.mark.parametrize(
    ("delimiter", "header"), [(",", ""), (" ", ""), (";", ""), (",", "frame,id,left,top,width,height,conf,a,b,c\n")]
)
def test_ids_are_given_to_players_by_where_they_stand(tmp_path, delimiter, header):
    path = written(tmp_path, rows_of(PLACES[::-1]), delimiter=delimiter, header=header)
    assert_placed(read_mot_boxes(path, CLIP, TENNIS.players))


def test_frames_count_from_1_unless_there_is_a_frame_0_or_it_is_said(tmp_path):
    assert_placed(read_mot_boxes(written(tmp_path, rows_of(PLACES)), CLIP, TENNIS.players))
    said = written(tmp_path, rows_of(PLACES, first=0))
    assert_placed(read_mot_boxes(said, CLIP, TENNIS.players, PeopleOptions(first_number=0)))
    zero = written(tmp_path, [[0, 9, 1, 1, 5, 5, 1, -1, -1, -1], *rows_of(PLACES, first=0)])
    assert_placed(read_mot_boxes(zero, CLIP, TENNIS.players))
    with pytest.raises(ValueError, match="line 1: frame: expected 1 or more, got 0"):
        read_mot_boxes(zero, CLIP, TENNIS.players, PeopleOptions(first_number=1))


def test_the_corner_may_be_at_1(tmp_path):
    rows = [[frame, number, x + 1, y + 1, w, h, *tail] for frame, number, x, y, w, h, *tail in rows_of(PLACES)]
    assert_placed(read_mot_boxes(written(tmp_path, rows), CLIP, TENNIS.players, PeopleOptions(corner_px=1)))


def test_of_several_in_one_half_the_one_in_its_middle_is_taken_with_all_of_its_track(tmp_path):
    places = [*PLACES, (7.0, -0.5), (-3.0, -18.5), (30.0, 5.0)]
    path = written(tmp_path, rows_of(places, ids=(4, 8, 15, 16, 23)))
    assert_placed(read_mot_boxes(path, CLIP, TENNIS.players))
    # Where the player is not found, another track does not take the place for one frame; without ids it does.
    rows = [row for row in rows_of(places, ids=(4, 8, 15, 16, 23)) if row[:2] != [13, 4]]
    boxes = read_mot_boxes(written(tmp_path, rows), CLIP, TENNIS.players)
    assert boxes.status[:, 1].tolist() == ["measured"] * FRAMES


def test_annotations_have_a_flag_and_a_class(tmp_path):
    tail = (1, 1, 0.9)
    rows = rows_of(PLACES, tail=tail) + [[11, 7, *people([(0.0, -10.0)], 0)[0], 0, 1, 1.0]]
    rows += [[11, 8, *people([(0.0, -10.0)], 0)[0], 1, 3, 1.0]]
    assert_placed(read_mot_boxes(written(tmp_path, rows), CLIP, TENNIS.players))


def test_confidences_are_scores_where_they_can_be(tmp_path):
    shares = read_mot_boxes(written(tmp_path, rows_of(PLACES, tail=(0.25, -1, -1, -1))), CLIP, TENNIS.players)
    assert set(shares.score.ravel()) == {0.25}
    points = read_mot_boxes(written(tmp_path, rows_of(PLACES, tail=(45.2, -1, -1, -1))), CLIP, TENNIS.players)
    assert set(points.score.ravel()) == {1.0}
    none = read_mot_boxes(written(tmp_path, rows_of(PLACES, tail=())), CLIP, TENNIS.players)
    assert set(none.score.ravel()) == {1.0}


def test_detections_without_ids_are_told_frame_by_frame(tmp_path):
    assert_placed(read_mot_boxes(written(tmp_path, rows_of(PLACES, ids=(-1, -1))), CLIP, TENNIS.players))


def test_a_frame_without_a_camera_takes_the_players_of_its_tracks_alone(tmp_path):
    lost = track("rally", cameras(FRAMES, size=(1280, 720)), first=10, none=(2,))
    tracked = read_mot_boxes(written(tmp_path, rows_of(PLACES)), lost, TENNIS.players)
    assert (tracked.status == "measured").all() and np.isnan(tracked.ground_world[2]).all()
    bare = read_mot_boxes(written(tmp_path, rows_of(PLACES, ids=(-1, -1))), lost, TENNIS.players)
    assert (bare.status[2] == "none").all() and (bare.status[[0, 1, 3, 4, 5]] == "measured").all()


def test_a_track_that_goes_over_to_the_other_player_is_followed_by_place(tmp_path):
    rows = rows_of(PLACES)
    for row in rows:
        if row[0] >= 15:  # the last two frames
            row[1] = 3 - row[1]
    assert_placed(read_mot_boxes(written(tmp_path, rows), CLIP, TENNIS.players))


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        ([[11, 1, 5, 5, -3, 4, 1]], "line 1: width: expected above 0, at most 1e.06 px, got -3"),
        ([[11, 1, 5, 5, 3, 0, 1]], "line 1: height: expected above 0"),
        ([[11, 1, "nan", 5, 3, 4, 1]], "line 1: left: expected a number, got 'nan'"),
        ([[11, 1, 5, "inf", 3, 4, 1]], "line 1: top: expected a number, got 'inf'"),
        ([[11, 1, 5, 1e300, 3, 4, 1]], "line 1: top: expected at most 1e.06 px"),
        ([[11, 1, 5, 5, 3, 4, 1], [12, 1, 5, 5, 3, 4]], "line 2: expected 7 values as in the first row, got 6"),
        (
            [[11, 1, 5, 5, 3, 4, 1], [11, 1, 6, 5, 3, 4, 1]],
            "line [12]: id: expected each id once in a frame, got 1 2 times",
        ),
        ([[11, 1.5, 5, 5, 3, 4, 1]], "line 1: id: expected a whole number, or -1, got 1.5"),
        ([[11.5, 1, 5, 5, 3, 4, 1]], "line 1: frame: expected 0 to 2000000, got 11.5"),
        ([[-1, 1, 5, 5, 3, 4, 1]], "line 1: frame: expected 0 to 2000000, got -1"),
        ([[10**18, 1, 5, 5, 3, 4, 1]], "line 1: frame: expected 0 to 2000000"),
        ([[500, 1, 5, 5, 3, 4, 1]], "frame: expected frames of the clip, 10 to 15 of the video, got none of them"),
        (
            [[11, 1, 5, 5, 3, 4, 1, 0, 1]],
            "class: expected rows that count .conf not 0. of class 1, a pedestrian, got none",
        ),
        ([[11, 1, 5]], "line 1: expected 6 to 10 values, got 3"),
        ([["a", "b", "c", "d", "e", "f"]], "line 1: expected a text of rows frame,id,left"),
        ([], "expected a text of rows frame,id,left,top,width,height,conf, got none"),
    ],
)
def test_a_damaged_file_is_refused_with_its_line(tmp_path, rows, words):
    path = written(tmp_path, rows)
    with pytest.raises(ValueError, match=words) as caught:
        read_mot_boxes(path, CLIP, TENNIS.players)
    assert str(path) in str(caught.value)


def test_what_is_no_text_is_refused(tmp_path):
    (tmp_path / "boxes.txt").write_bytes(b"\xff\xfe\x00\x01")
    with pytest.raises(ValueError, match="expected a text of rows"):
        read_mot_boxes(tmp_path / "boxes.txt", CLIP, TENNIS.players)
    with pytest.raises(ValueError, match="got: a folder"):
        read_mot_boxes(tmp_path, CLIP, TENNIS.players)
    with pytest.raises(ValueError, match="players: expected a scene with player objects"):
        read_mot_boxes(written(tmp_path, rows_of(PLACES)), CLIP, ())


@settings(max_examples=60)
@given(
    st.lists(
        st.lists(st.sampled_from(["1", "11", "-1", "0", "nan", "1e9", "", "x", "3.5", '"']), min_size=1, max_size=11),
        max_size=4,
    )
)
def test_any_text_gives_boxes_or_an_error(tmp_path_factory, rows):
    path = tmp_path_factory.getbasetemp() / "any.txt"
    path.write_text("\n".join(",".join(row) for row in rows))
    try:
        read_mot_boxes(path, CLIP, TENNIS.players)
    except ValueError as error:
        assert str(path) in str(error)
