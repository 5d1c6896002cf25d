"""The ball's track out and in.

A round trip of the plain form keeps pixels and times to the last bit; it loses scores, events and everything in metres.
The form of TrackNet loses times and parts of a pixel too.
"""

import math
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pgm_data.convert.exchange_tables import export_track
from pgm_data.convert.track_csv import read_track_csv, write_track_csv
from pgm_data.dataset.clip_ball import read_clip_ball, write_clip_ball
from pgm_data.dataset.clip_camera import read_clip_camera
from pgm_data.scene import load_scene
from tests.simulate.store_worlds import write_truth_clip

TENNIS = load_scene("tennis")
PIXEL = st.none() | st.tuples(*[st.floats(-50, 4000, width=32)] * 2)


@settings(max_examples=40)
@given(st.lists(PIXEL, min_size=1, max_size=30), st.integers(0, 10_000), st.sampled_from([24, 29.97, 59.94, 60]))
def test_a_plain_track_is_what_it_was(pixels, first, rate):
    values = np.array([pixel or (math.nan, math.nan) for pixel in pixels])
    values[(values == -1).all(axis=1)] = 0.5  # means nothing there in such files
    if np.isfinite(values).all(axis=1).sum() >= 10 and np.nanmax(np.abs(values)) <= 1:
        values[np.isfinite(values)] += 2  # would be shares of the picture
    frame = np.arange(first, first + len(values))
    with TemporaryDirectory() as folder:
        path = Path(folder) / "ball.csv"
        write_track_csv(path, frame=frame, pixels=values, timestamp=frame / rate, form="plain")
        rows = read_track_csv(path)
    np.testing.assert_array_equal(rows.pixels, values)
    np.testing.assert_array_equal(rows.timestamp, frame / rate)
    np.testing.assert_array_equal(rows.frame, frame)
    assert not rows.is_interpolated.any()


@pytest.fixture
def work(tmp_path):
    write_truth_clip(tmp_path / "work" / "rally", TENNIS, frames=20)
    write_truth_clip(tmp_path / "work" / "serve", TENNIS, frames=5, seed=1)
    return tmp_path / "work"


def ball_of(work, clip="rally"):
    return read_clip_ball(work / clip, read_clip_camera(work / clip).capture_time)


def test_what_goes_out_comes_back(work, tmp_path):
    outcome = export_track(work, tmp_path / "out")
    assert [path.name for path in outcome.files] == ["rally.csv", "serve.csv"] and outcome.problems == ()
    ball, rows = ball_of(work), read_track_csv(tmp_path / "out" / "rally.csv")
    np.testing.assert_array_equal(rows.pixels, ball.pixel)
    np.testing.assert_array_equal(rows.timestamp, ball.timestamp)
    assert rows.frames == 20 and (tmp_path / "out" / "rally.csv").read_text().startswith(
        "frame,x,y,visible,timestamp\n0,,,0,0.0"
    )


def test_tracknet_takes_whole_pixels_and_zeros(work, tmp_path):
    export_track(work, tmp_path / "out", form="tracknet")
    lines = (tmp_path / "out" / "rally.csv").read_text().splitlines()
    assert lines[:2] == ["Frame,Visibility,X,Y", "0,0,0,0"] and len(lines) == 21
    assert all(cell.lstrip("-").isdigit() for line in lines[1:] for cell in line.split(","))
    ball, rows = ball_of(work), read_track_csv(tmp_path / "out" / "rally.csv")
    np.testing.assert_array_equal(np.isfinite(rows.pixels), np.isfinite(ball.pixel))
    np.testing.assert_allclose(rows.pixels, ball.pixel, atol=0.5)
    assert np.isnan(rows.timestamp).all()


def test_frames_are_those_of_the_video(work, tmp_path):
    ball = replace(ball_of(work), video_frame=np.arange(20) + 100)
    write_clip_ball(work / "rally", ball, scene=TENNIS)
    export_track(work, tmp_path / "out")
    assert read_track_csv(tmp_path / "out" / "rally.csv").frame.tolist() == list(range(100, 120))


def test_clips_without_a_ball_are_named_and_none_at_all_is_an_error(work, tmp_path):
    (work / "serve" / "ball.parquet").unlink()
    outcome = export_track(work, tmp_path / "out")
    assert "serve: ball.parquet: expected the table" in str(outcome.problems[0]) and len(outcome.files) == 1
    (work / "rally" / "ball.parquet").unlink()
    with pytest.raises(ValueError, match="ball.parquet: expected it of a clip, got none"):
        export_track(work, tmp_path / "none")
    assert not (tmp_path / "none").exists()


@pytest.mark.parametrize(
    ("frame", "pixels", "words"),
    [
        ([0, 0], [[1, 2], [3, 4]], "frame: expected frames that rise"),
        ([0, 1], [[1, math.nan], [3, 4]], "pixels: expected both coordinates finite, or both NaN"),
        ([0, 1], [[1, math.inf], [3, 4]], "pixels: expected both coordinates finite, or both NaN"),
    ],
)
def test_a_track_that_is_none_is_not_written(tmp_path, frame, pixels, words):
    with pytest.raises(ValueError, match=words):
        write_track_csv(
            tmp_path / "t.csv",
            frame=np.array(frame),
            pixels=np.array(pixels, dtype=float),
            timestamp=np.array([0.0, 1.0]),
        )
    assert not list(tmp_path.iterdir())
