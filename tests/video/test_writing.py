"""Videos as they are written: every frame back, at its time."""

import os
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pgm_data.video import open_video, write_video
from tests.video.drawn import drawn_pictures


def read(path: Path) -> tuple[list[np.ndarray], list[float]]:
    with open_video(path) as reader:
        frames = [(frame.bgr(), frame.timestamp) for frame in reader]
        assert reader.trouble == ""
    return [bgr for bgr, _ in frames], [time for _, time in frames]


@pytest.mark.parametrize("gop", [None, 1, 5])
@pytest.mark.parametrize("ending", [".mp4", ".mkv", ".mov"])
def test_pictures_come_back_in_order(tmp_path: Path, ending: str, gop: int | None) -> None:
    path = tmp_path / f"v{ending}"
    pictures = drawn_pictures(12)
    write_video(path, pictures, fps=25, crf=10, gop=gop)
    back, times = read(path)
    assert len(back) == 12
    for one, other in zip(pictures, back, strict=True):
        assert np.abs(one.astype(float) - other).mean() < 4
    np.testing.assert_allclose(times, np.arange(12) / 25, atol=6e-4 if ending == ".mkv" else 1e-9)
    assert os.listdir(tmp_path) == [path.name]


@settings(max_examples=12)
@given(steps=st.lists(st.integers(1, 90_000), min_size=1, max_size=12), start=st.integers(0, 900_000))
def test_given_times_come_back(tmp_path_factory: pytest.TempPathFactory, steps: list[int], start: int) -> None:
    ticks = np.cumsum([start, *steps])
    path = tmp_path_factory.mktemp("times") / "v.mp4"
    write_video(path, drawn_pictures(len(ticks), 48, 32), timestamps=(ticks / 90_000).tolist())
    np.testing.assert_allclose(read(path)[1], ticks / 90_000, atol=1e-6)


@pytest.mark.parametrize("fps", [30, 29.97, 59.94, Fraction(24000, 1001), 12.5])
def test_frame_rates_are_kept(tmp_path: Path, fps: float | Fraction) -> None:
    path = tmp_path / "v.mp4"
    write_video(path, drawn_pictures(10, 48, 32), fps=fps)
    np.testing.assert_allclose(read(path)[1], np.arange(10) / float(fps), rtol=1e-5)


@pytest.mark.parametrize(("width", "height"), [(161, 96), (160, 95), (63, 47), (1, 1)])
def test_odd_sizes_are_padded_by_one(tmp_path: Path, width: int, height: int) -> None:
    path = tmp_path / "v.mp4"
    pictures = drawn_pictures(2, width, height)
    write_video(path, pictures, fps=25, crf=8)
    back, _ = read(path)
    assert back[0].shape == (height + height % 2, width + width % 2, 3)
    assert np.abs(back[1][:height, :width].astype(float) - pictures[1]).mean() < 8


def test_grey_and_primary_colours_keep_their_values(tmp_path: Path) -> None:
    for colour in [(20, 180, 60), (200, 40, 90), (255, 255, 255), (0, 0, 0), (40, 60, 220)]:
        write_video(tmp_path / "v.mp4", [np.full((32, 32, 3), colour, np.uint8)] * 2, fps=25, crf=4)
        back, _ = read(tmp_path / "v.mp4")
        assert np.abs(back[1][16, 16].astype(int) - colour).max() <= 3


def test_every_frame_is_a_key_frame_at_gop_1(tmp_path: Path) -> None:
    for gop, expected in ((1, 8), (4, 2)):
        write_video(tmp_path / "v.mp4", drawn_pictures(8), fps=25, gop=gop)
        with av.open(str(tmp_path / "v.mp4")) as container:
            assert sum(packet.is_keyframe for packet in container.demux(video=0) if packet.size) == expected


def test_the_index_stands_before_the_pictures(tmp_path: Path) -> None:
    write_video(tmp_path / "v.mp4", drawn_pictures(8), fps=25)
    data = (tmp_path / "v.mp4").read_bytes()
    assert 0 < data.find(b"moov") < data.find(b"mdat")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({}, "expected fps or timestamps, got none"),
        ({"fps": 25, "timestamps": [0.0, 1.0]}, "got both"),
        ({"fps": 0}, "fps: expected above 0"),
        ({"timestamps": [0.0]}, "timestamps: expected one a frame"),
        ({"timestamps": [0.0, 1.0, 2.0]}, "frames: expected 3, got 2"),
        ({"timestamps": [1.0, 1.0]}, "expected rising"),
    ],
)
def test_wrong_times_are_refused_and_nothing_is_left(tmp_path: Path, options: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        write_video(tmp_path / "v.mp4", drawn_pictures(2), **options)
    assert os.listdir(tmp_path) == []


def test_bad_frames_are_refused_and_an_old_file_stays(tmp_path: Path) -> None:
    path = tmp_path / "v.mp4"
    path.write_bytes(b"old")
    with pytest.raises(ValueError, match="at least one"):
        write_video(path, [], fps=25)
    with pytest.raises(ValueError, match=r"frame 1: expected \(96, 160\)"):
        write_video(path, [*drawn_pictures(1), *drawn_pictures(1, 64, 64)], fps=25)

    def failing():
        yield from drawn_pictures(3)
        raise RuntimeError("the drawing failed")

    with pytest.raises(RuntimeError, match="the drawing failed"):
        write_video(path, failing(), fps=25)
    assert path.read_bytes() == b"old" and os.listdir(tmp_path) == [path.name]


def test_the_same_pictures_are_always_the_same_bytes(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    shape = (90, 160, 3)
    pictures = [
        np.kron(rng.integers(0, 255, (9, 16, 3), np.uint8), np.ones((10, 10, 1), np.uint8))
        + rng.integers(0, 30, shape, np.uint8)
        for _ in range(12)
    ]
    written = set()
    for _ in range(25):
        # What a process did before leaves its traces in memory that is not set.
        traces = [np.full(size, rng.integers(255), np.uint8) for size in rng.integers(1000, 400_000, 40)]
        del traces
        write_video(tmp_path / "v.mp4", pictures, fps=25)
        written.add((tmp_path / "v.mp4").read_bytes())
    assert len(written) == 1
