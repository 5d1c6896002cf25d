import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pgm_data.convert.foreign_track import TrackOptions, track_of_rows
from pgm_data.convert.frame_clock import FrameClock, clock_of_rows
from pgm_data.convert.track_csv import read_track_csv


def rows_of(tmp_path, text, name="TRACK.csv", encoding="utf-8"):
    path = tmp_path / name
    path.write_bytes(text.encode(encoding))
    return read_track_csv(path)


WANTED = [[10.5, 20.0], [np.nan, np.nan], [12.0, 22.0]]
FORMS = {
    "ours": "frame,x,y,visible\n0,10.5,20,1\n1,,,0\n2,12,22,1\n",
    "tracknet": "Frame,Visibility,X,Y\n0,1,10.5,20\n1,0,0,0\n2,1,12,22\n",
    "first tracknet": (
        "file name,visibility,x-coordinate,y-coordinate,status\n"
        "0000.jpg,1,10.5,20,0\n0001.jpg,0,,,\n0002.jpg,2,12,22,1\n"
    ),
    "pattern": (
        "File Name,Visibility Class,X,Y,Trajectory Pattern\nf_0.png,1,10.5,20,0\nf_1.png,0,,,\nf_2.png,1,12,22,0\n"
    ),
    "num": "num,x,y\n0,10.5,20\n1,0,0\n2,12,22\n",
    "minus one": "frame_num;x_coord;y_coord\n0;10,5;20\n1;-1;-1\n2;12;22\n",
    "tabs": "y\tx\tframe\tvisible\n20\t10.5\t0.0\ttrue\nnan\tnan\t1.0\tfalse\n22\t12\t2.0\tTrue\n",
    "left out": "frame,x,y\n\n0,10.5,20\n2,12,22\n",
    "spaces": " Frame , X , Y \n 0 , 10.5 , 20 \n 1 , NaN , NaN \n 2 , 12 , 22 \n",
}


@pytest.mark.parametrize("form", FORMS)
def test_every_form_says_the_same_track(tmp_path, form):
    for encoding in ("utf-8", "utf-8-sig"):
        rows = rows_of(tmp_path, FORMS[form], encoding=encoding)
        track = track_of_rows(rows, clock_of_rows(rows, fps=25))
        np.testing.assert_array_equal(track.pixels, WANTED)
        np.testing.assert_array_equal(track.sigma_px, [1, np.nan, 1])
        np.testing.assert_array_equal(track.score, [1, np.nan, 1])
        np.testing.assert_allclose(track.times, [0, 0.04, 0.08])
        assert not track.is_duplicate.any()


def test_interpolated_and_hidden_rows_are_no_measurements(tmp_path):
    rows = rows_of(tmp_path, "frame,x,y,visible,interpolated,score\n0,1,2,1,0,15.3\n1,3,4,1,1,2\n2,5,6,3,0,9\n")
    assert rows.visible.tolist() == [True] * 3 and rows.is_interpolated.tolist() == [False, True, True]
    track = track_of_rows(rows, clock_of_rows(rows, fps=50))
    assert track.measured.tolist() == [True, False, False]
    assert track.score[0] == 1  # 15.3 is no probability
    mask = rows_of(tmp_path, "Frame,Visibility,X,Y,Inpaint_Mask\n0,1,1,2,0\n1,1,3,4,1\n")
    assert mask.is_interpolated.tolist() == [False, True]


def test_scores_within_0_to_1_are_kept(tmp_path):
    rows = rows_of(tmp_path, "frame,x,y,confidence\n0,1,2,0.25\n1,3,4,0.75\n")
    np.testing.assert_array_equal(track_of_rows(rows, clock_of_rows(rows, fps=50)).score, [0.25, 0.75])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "line 1: expected a header .* got an empty file"),
        ("frame,x,y\n", "expected a row for each frame, got none"),
        ("0,10,20\n1,11,21\n", "line 1: frame: expected a header with the column, got 0,10,20"),
        ("frame,x,z\n0,1,2\n", "line 1: y: expected a header with the column"),
        ("frame,x,X,y\n0,1,2,3\n", "line 1: x: expected one such column, got 'x' and 'X'"),
        ("frame,x,y\n0,1\n", "line 2: expected 3 fields as in the header, got 2"),
        ("frame,x,y\n0,1,2\n1,3,4,5\n", "line 3: expected 3 fields"),
        ("frame,x,y\n0,1,2\n0,3,4\n", "line 3: frame: expected frames that rise, so above 0 .* got '0'"),
        ("frame,x,y\n5,1,2\n4,3,4\n", "line 3: frame: expected frames that rise"),
        ("frame,x,y\n-1,1,2\n", "line 2: frame: expected a frame's number from 0 .* got '-1'"),
        ("frame,x,y\n1.5,1,2\n", "line 2: frame: .* got '1.5'"),
        ("frame,x,y\n,1,2\n", "line 2: frame: .* got ''"),
        ("frame,x,y\n99999999999,1,2\n", "line 2: frame: .* got '99999999999'"),
        ("frame,x,y\n1e3x,1,2\n", "line 2: frame: .* got '1e3x'"),
        ("frame,x,y\nnan,1,2\n", "line 2: frame: .* got 'nan'"),
        ("frame,x,y\n0,twelve,2\n", "line 2: x: expected a pixel or nothing, got 'twelve'"),
        ("frame,x,y\n0,inf,2\n", "line 2: x: .* got 'inf'"),
        ("frame,x,y\n0,1_0,2\n", "line 2: x: .* got '1_0'"),
        ("frame,x,y\n0,,2\n", "line 2: x: expected a pixel, as the row has its other coordinate"),
        ("frame,x,y,visible\n0,1,2,7\n", "line 2: visible: expected 0 or 1 .* got '7'"),
        ("frame,x,y,visible\n0,1,2,maybe\n", "line 2: visible: expected 0 or 1 or nothing, got 'maybe'"),
        ("frame,x,y,timestamp\n0,1,2,0\n1,3,4,0\n", "line 3: timestamp: expected a time in seconds above"),
        ("frame,x,y,timestamp\n0,1,2,0\n1,3,4,\n", "line 3: timestamp: expected a time in seconds above .* got ''"),
        ("frame,x,y\n" + "".join(f"{i},0.{i + 1},0.5\n" for i in range(12)), "line 2: x: expected pixels, not shares"),
        ('frame,x,y\n0,"1,2\n', "expected a CSV file"),
    ],
)
def test_a_bad_file_is_refused_by_file_line_and_field(tmp_path, text, said):
    with pytest.raises(ValueError, match=f"TRACK.csv: {said}"):
        rows_of(tmp_path, text)


def test_what_is_no_text_file_is_refused(tmp_path):
    for path in (tmp_path, tmp_path / "absent.csv"):
        with pytest.raises(ValueError, match="expected a CSV file in UTF-8"):
            read_track_csv(path)
    (tmp_path / "picture.csv").write_bytes(b"\x89PNG\xff\xfe\x00")
    with pytest.raises(ValueError, match="expected a CSV file in UTF-8"):
        read_track_csv(tmp_path / "picture.csv")
    with pytest.raises(ValueError, match="expected a CSV file in UTF-8"):
        rows_of(tmp_path, FORMS["ours"], encoding="utf-16")
    long = tmp_path / "long.csv"
    with long.open("wb") as file:
        file.truncate(2**28)
    with pytest.raises(ValueError, match=r"long.csv: .* 268435456 bytes, more than"):
        read_track_csv(long)


@given(st.integers(2, 4000), st.integers(2, 4000), st.floats(0, 1), st.floats(0, 1))
def test_a_point_keeps_its_share_of_a_resized_picture(tmp_path_factory, width, height, share_x, share_y):
    # From edge to edge: the left edge is at -0.5, the right one at width - 0.5.
    x, y = share_x * 512 - 0.5, share_y * 288 - 0.5
    rows = rows_of(tmp_path_factory.mktemp("resized"), f"frame,x,y,visible\n0,{x!r},{y!r},1\n")
    options = TrackOptions(width=width, height=height, track_width=512, track_height=288)
    track = track_of_rows(rows, clock_of_rows(rows, fps=25), options)
    np.testing.assert_allclose((track.pixels[0] + 0.5) / [width, height], [share_x, share_y], atol=1e-12)


def test_a_pixel_outside_the_picture_is_refused_and_a_swap_is_named(tmp_path):
    rows = rows_of(tmp_path, "frame,x,y\n0,700,100\n1,300,1200\n")
    with pytest.raises(ValueError, match=r"frame 1: y: expected a pixel of a picture of 1280 x 720, .* swapped\?"):
        track_of_rows(rows, clock_of_rows(rows, fps=25), TrackOptions(width=1280, height=720))
    with pytest.raises(ValueError, match=r"frame 0: x: expected a pixel of a picture of 640 x 360"):
        track_of_rows(rows, clock_of_rows(rows, fps=25), TrackOptions(width=640, height=360))


@pytest.mark.parametrize(
    "wrong", [{"sigma_px": 0.0}, {"width": 0, "height": 1}, {"width": 1280}, {"track_width": 512, "track_height": 288}]
)
def test_options_that_cannot_be_are_refused(wrong):
    with pytest.raises(ValueError, match="expected"):
        TrackOptions(**wrong)


def test_times_come_from_the_rate_else_from_the_file(tmp_path):
    rows = rows_of(tmp_path, "frame,x,y,timestamp\n1,1,2,1.00\n3,3,4,1.10\n4,5,6,1.15\n")
    np.testing.assert_allclose(clock_of_rows(rows).timestamp, [0.95, 1.0, 1.05, 1.1, 1.15])
    np.testing.assert_allclose(clock_of_rows(rows, frames=6).timestamp[-1], 1.2)
    np.testing.assert_allclose(clock_of_rows(rows, fps=10).timestamp, np.arange(5) / 10)
    words = rows_of(tmp_path, "frame,x,y,timestamp\n0,1,2,00:00:59.5\n1,3,4,00:01:00\n2,4,5,1:00:00.5\n")
    np.testing.assert_allclose(words.timestamp, [59.5, 60, 3600.5])
    bare = rows_of(tmp_path, "frame,x,y\n0,1,2\n")
    for wrong, said in (
        ({}, "--fps"),
        ({"fps": 0.0}, "fps"),
        ({"fps": float("nan")}, "fps"),
        ({"fps": 25, "frames": 0}, "frame"),
    ):
        with pytest.raises(ValueError, match=said):
            clock_of_rows(bare, **wrong)


def converted(tmp_path, *, cycle, repeats, frames=120, extra=""):
    """A ball that flies on, shown at a converted rate: pictures at those places of a cycle repeat the one before."""
    source, lines = -1, []
    for frame in range(frames):
        source += frame % cycle not in repeats
        lines.append(f"{frame},{300 + round(200 * np.sin(source / 7))},{200 + 3 * source}")
    return rows_of(tmp_path, "frame,x,y\n" + "\n".join(lines) + "\n" + extra)


@pytest.mark.parametrize(("cycle", "repeats"), [(6, {4}), (5, {0}), (2, {1}), (5, {1, 3, 4}), (12, {2, 7})])
def test_a_steady_pattern_of_repeats_is_found_and_timed(tmp_path, cycle, repeats):
    rows = converted(tmp_path, cycle=cycle, repeats=repeats)
    clock = clock_of_rows(rows, fps=30)
    expected = np.isin(np.arange(120) % cycle, list(repeats))
    inner = slice(12, -12)
    np.testing.assert_array_equal(clock.is_duplicate[inner], expected[inner])
    track = track_of_rows(rows, clock)
    assert not track.measured[clock.is_duplicate].any() and "repeats the one before" in clock.said
    if len(repeats) == 1:
        steps = np.diff(clock.capture_time[~clock.is_duplicate])[12:-12]
        np.testing.assert_allclose(steps, cycle / (cycle - 1) / 30, rtol=0.02)


def test_a_ball_that_stands_still_or_stops_by_chance_repeats_nothing(tmp_path):
    still = rows_of(tmp_path, "frame,x,y\n" + "".join(f"{i},500,300\n" for i in range(60)))
    assert not clock_of_rows(still, fps=25).is_duplicate.any()
    rng = np.random.default_rng(1)
    source = np.cumsum(rng.random(200) > 0.1)
    chance = rows_of(tmp_path, "frame,x,y\n" + "".join(f"{i},{4 * s},{900 - 3 * s}\n" for i, s in enumerate(source)))
    clock = clock_of_rows(chance, fps=25)
    assert not clock.is_duplicate.any() and "without a steady pattern" in clock.said


def test_rows_are_placed_by_the_frames_of_the_video(tmp_path):
    rows = rows_of(tmp_path, "frame,x,y\n4,1,2\n6,3,4\n9,5,6\n")
    clock = FrameClock(
        video_frame=np.arange(5, 9),
        timestamp=np.arange(5, 9) / 25,
        capture_time=np.arange(5, 9) / 25,
        is_duplicate=np.array([False, True, False, False]),
        said="",
    )
    track = track_of_rows(rows, clock)
    assert np.isfinite(track.pixels[:, 0]).tolist() == [False, True, False, False] and not track.measured.any()
    other = rows_of(tmp_path, "frame,x,y\n40,1,2\n")
    with pytest.raises(ValueError, match="expected frames of the clip, from 5 to 8, got 40 to 40"):
        track_of_rows(other, clock)


@pytest.mark.real
def test_a_real_track_of_a_video_without_repeats(real_data):
    rows = read_track_csv(real_data / "tennis" / "miami_rally_720p50.ball_2d.csv")
    assert len(rows.frame) == 767 and rows.visible.sum() == 747 and rows.is_interpolated.sum() == 161
    clock = clock_of_rows(rows, fps=50)
    track = track_of_rows(rows, clock, TrackOptions(width=1280, height=720))
    assert track.measured.sum() == 747 - 161 and not clock.is_duplicate.any()
