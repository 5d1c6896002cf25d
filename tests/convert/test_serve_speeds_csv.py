import numpy as np
import pytest

from pgm_data.convert.serve_speeds_csv import read_serve_speeds


def speeds_of(tmp_path, text):
    path = tmp_path / "speeds.csv"
    path.write_text(text, encoding="utf-8")
    return read_serve_speeds(path)


@pytest.mark.parametrize(
    "text",
    [
        "clip,frame,speed_kmh\na,10,180\nb,20,198\n",
        "clip,frame,Serve Speed (km/h)\na,10,180\nb,20,198\n",
        "speed kph;frame;clip\n180,0;10;a\n198;20;b\n",
        "clip,frame,speed [m/s]\na,10,50\nb,20,55\n",
        "clip,frame,speed,unit\na,10,50,m/s\nb,20,198,KM/H\n",
        "clip,frame,speed_mph\na,10,111.8468146\nb,20,123.0314961\n",
    ],
)
def test_every_unit_becomes_metres_a_second(tmp_path, text):
    speeds = speeds_of(tmp_path, text)
    assert speeds.clip == ("a", "b") and speeds.frame.tolist() == [10, 20] and np.isnan(speeds.time).all()
    np.testing.assert_allclose(speeds.speed, [50, 55], rtol=1e-8)


def test_a_serve_may_be_given_by_its_time_and_needs_no_clip(tmp_path):
    speeds = speeds_of(tmp_path, "time,frame,speed_ms\n1.5,,50\n,30,60\n")
    assert speeds.clip == ("", "")
    np.testing.assert_array_equal(speeds.time, [1.5, np.nan])
    np.testing.assert_array_equal(speeds.frame, [np.nan, 30])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("frame,speed_kmh\n10,800\n", "line 2: speed_kmh: expected a serve's speed of 36 to 288 km/h, got '800'"),
        ("frame,speed_ms\n10,180\n", "line 2: speed_ms: expected a serve's speed of 10 to 80 m/s, got '180'"),
        ("frame,speed_kmh\n10,50\n11,20\n", "line 3: speed_kmh: expected"),
        ("frame,speed_kmh\n10,-180\n", "speed_kmh: expected"),
        ("frame,speed_kmh\n10,\n", "speed_kmh: expected a serve's speed"),
        ("frame,speed_kmh\n10,nan\n", "speed_kmh: expected a serve's speed"),
        ("frame,speed_kmh\n10,fast\n", "speed_kmh: expected a speed or nothing, got 'fast'"),
        ("frame,speed\n10,180\n", "line 1: unit: expected km/h, mph, m/s in the title of the speeds, or in a column"),
        ("frame,speed,unit\n10,180,knots\n", "line 2: unit: expected km/h or mph or m/s, got 'knots'"),
        ("frame,speed_kmh,unit\n10,180,mph\n", "line 2: unit: expected km/h, got 'mph'"),
        ("frame,velocity_kmh,speed_mph\n1,180,110\n", "line 1: speed: expected one such column"),
        ("clip,speed_kmh\na,180\n", "line 1: frame: expected the column, or time"),
        ("frame,time,speed_kmh\n,,180\n", "line 2: frame: expected where the serve is"),
        ("frame,speed_kmh\n-4,180\n", "line 2: frame: expected 0 or more, got '-4'"),
        ("frame,speed_kmh\n", "expected a row for each serve, got none"),
        ("", "line 1: expected a header"),
    ],
)
def test_a_bad_file_is_refused_by_file_line_and_field(tmp_path, text, said):
    with pytest.raises(ValueError, match=f"speeds.csv: .*{said}"):
        speeds_of(tmp_path, text)
