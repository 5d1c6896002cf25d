import numpy as np
import pytest

from pgm_data.convert.events_csv import read_events_csv

TIMES = np.arange(100) / 25


def events_of(tmp_path, text, times=TIMES, **more):
    path = tmp_path / "EVENTS.csv"
    path.write_bytes(text.encode("utf-8-sig"))
    return read_events_csv(path, times, **more)


def test_rows_become_human_events_in_order_of_time(tmp_path):
    text = "frame,kind,x,y\n50,Bounce,100,200\n10,hit,,\n10,first,,\n12.5,net,5.5,-3\n"
    events = events_of(tmp_path, text)
    assert events.kinds.tolist() == ["first", "hit", "net", "bounce"]
    np.testing.assert_allclose(events.times, [0.4, 0.4, 0.5, 2.0])
    np.testing.assert_allclose(events.time_std * 25, [12**-0.5, 12**-0.5, 0.1, 12**-0.5])
    assert set(events.sources) == {"human"} and set(events.players) == {""} and (events.probability == 1).all()
    np.testing.assert_array_equal(events.ground_px[2:], [[5.5, -3], [100, 200]])
    assert np.isnan(events.ground_px[:2]).all()


def test_columns_come_in_any_order_with_players_and_none_is_an_event_list_too(tmp_path):
    events = events_of(tmp_path, "y;x;player;kind;frame\n;;player1;hit;3\n")
    assert events.players.tolist() == ["player1"] and events.times.tolist() == [3 / 25]
    assert len(events_of(tmp_path, "frame,kind,x,y\n")) == 0


def test_times_are_capture_times_between_frames_of_the_video(tmp_path):
    # The third frame repeats the second; the clip begins with frame 7 of its video.
    events = events_of(tmp_path, "frame,kind,x,y\n7.5,hit,,\n9,bounce,,\n", np.array([0, 0.1, 0.1, 0.3]), first_frame=7)
    np.testing.assert_allclose(events.times, [0.05, 0.1])


@pytest.mark.parametrize(
    ("row", "said"),
    [
        ("-1,hit,,", "line 3: frame: expected a frame's number of 0 or more, got '-1'"),
        (",hit,,", "line 3: frame: expected"),
        ("abc,hit,,", "line 3: frame: expected a frame's number or nothing, got 'abc'"),
        ("1e9,hit,,", "line 3: frame: expected one of the clip's, 0 to 99, got 1e"),
        ("99.5,hit,,", "line 3: frame: expected one of the clip's, 0 to 99, got 99.5"),
        ("5,serve,,", "line 3: kind: expected one of hit, bounce, net, first, last, got 'serve'"),
        ("5,,,", "line 3: kind: expected one of"),
        ("5,hit,10,", "line 3: y: expected a pixel, as the row has its other coordinate"),
        ("5,hit,,nan,", "line 3: expected 4 fields"),
        ("5,hit,ten,20", "line 3: x: expected a pixel or nothing, got 'ten'"),
        ("2,hit,,", "line 3: kind: expected one hit a frame, got another as in line 2"),
        ("5,bounce,200,1300", r"line 3: y: expected a pixel near a picture of 1280 x 720, got 200, 1300"),
    ],
)
def test_a_bad_row_is_refused_by_file_line_and_field(tmp_path, row, said):
    with pytest.raises(ValueError, match=f"EVENTS.csv: {said}"):
        events_of(tmp_path, f"frame,kind,x,y\n2,hit,,\n{row}\n", size=(1280, 720))


@pytest.mark.parametrize("header", ["frame,what,x,y", "kind,x,y", "frame,kind,x", "frame,kind,x,y,Y", ""])
def test_a_header_without_the_columns_is_refused(tmp_path, header):
    with pytest.raises(ValueError, match="EVENTS.csv: line 1"):
        events_of(tmp_path, header)


@pytest.mark.parametrize("times", [np.array([]), np.array([0.0]), np.zeros(3)])
def test_frames_that_tell_no_time_are_refused(tmp_path, times):
    with pytest.raises(ValueError, match="times: expected"):
        events_of(tmp_path, "frame,kind,x,y\n0,hit,,\n", times)
