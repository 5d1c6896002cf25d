"""Frames of a video in any order are those of reading it in order, whatever the file is like."""

import multiprocessing
import pickle
import threading
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from pgm_data.video import VideoError, open_video, write_video
from pgm_data.video.picture_cache import PictureCache, picture_key
from pgm_data.video.random_access import VideoFrames, frame_index
from tests.video.drawn import drawn_pictures

COUNT = 40
PIXEL_FORMATS = {"mjpeg": "yuvj420p"}


def encode(
    path: Path,
    codec: str = "libx264",
    options: dict[str, str] | None = None,
    *,
    pictures: list[np.ndarray] | None = None,
    times: list[int] | None = None,
    turn: int = 0,
    aspect: Fraction | None = None,
) -> Path:
    """A video of drawn pictures, written with PyAV alone; `times` are presentation times, ms."""
    pictures = drawn_pictures(COUNT) if pictures is None else pictures
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=25, options=options or {})
        stream.height, stream.width = pictures[0].shape[:2]
        stream.pix_fmt = PIXEL_FORMATS.get(codec, "yuv420p")
        if times is not None:
            stream.codec_context.time_base = Fraction(1, 1000)
        if aspect is not None:
            stream.codec_context.sample_aspect_ratio = aspect
        if turn:
            stream.set_display_rotation(turn)
        for number, picture in enumerate(pictures):
            frame = av.VideoFrame.from_ndarray(picture, format="bgr24")
            if times is not None:
                frame.pts, frame.time_base = times[number], Fraction(1, 1000)
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path


def read_in_order(path: Path) -> list[tuple[int, float, np.ndarray]]:
    """What the slow way gives."""
    with open_video(path) as reader:
        return [(frame.video_frame, frame.timestamp, frame.bgr()) for frame in reader]


X264 = {"crf": "12", "sc_threshold": "0"}


@pytest.mark.parametrize(
    ("name", "codec", "options", "sought"),
    [
        ("a.mp4", "libx264", X264 | {"g": "12", "bf": "3", "b_strategy": "0"}, True),
        ("open_gop.mp4", "libx264", X264 | {"g": "10", "bf": "3", "x264-params": "open-gop=1:b-adapt=0"}, True),
        ("one_key.mkv", "libx264", X264 | {"g": "500", "bf": "0"}, True),
        ("refresh.ts", "libx264", X264 | {"g": "8", "x264-params": "intra-refresh=1:keyint=8"}, True),
        ("b.ts", "libx264", X264 | {"g": "9", "bf": "2"}, True),
        ("c.mkv", "mpeg4", {"g": "7", "bf": "2"}, True),
        ("d.webm", "libvpx-vp9", {"g": "9", "cpu-used": "8", "auto-alt-ref": "1", "lag-in-frames": "12"}, True),
        ("e.webm", "libvpx", {"g": "9", "cpu-used": "8", "auto-alt-ref": "1", "lag-in-frames": "12"}, False),
        ("f.avi", "mjpeg", {}, True),
        ("g.avi", "libx264", X264 | {"g": "9", "bf": "2"}, False),
        ("h.h264", "libx264", X264 | {"g": "9"}, False),
    ],
)
def test_any_order_gives_what_reading_in_order_gives(
    tmp_path: Path, name: str, codec: str, options: dict[str, str], sought: bool
) -> None:
    path = encode(tmp_path / name, codec, options)
    whole = read_in_order(path)
    video = VideoFrames(path, cache=PictureCache(0))
    assert len(video) == len(whole)
    assert video.index.sought == sought
    np.testing.assert_array_equal(video.index.time, [time for _, time, _ in whole])
    order = np.random.default_rng(0).permutation(len(whole)) if sought else [39, 3, 4, 20, 0]
    for number in [*order, *range(5, 9), 39, 0]:
        np.testing.assert_array_equal(video.picture(int(number)), whole[number][2])
        assert video.number_at(whole[number][1]) == number


def test_frames_of_a_variable_rate_are_found_by_their_own_times(tmp_path: Path) -> None:
    times = np.cumsum(np.random.default_rng(1).integers(3, 90, COUNT)).tolist()
    path = encode(tmp_path / "v.mkv", options=X264 | {"g": "9", "bf": "2"}, times=times)
    whole = read_in_order(path)
    video = VideoFrames(path)
    np.testing.assert_allclose(video.index.time - video.index.time[0], (np.array(times) - times[0]) / 1000, atol=1e-9)
    for number in (31, 7, 30, 0, 39):
        assert video.number_at(whole[number][1] + 5e-4) == number
        np.testing.assert_array_equal(video.picture(number), whole[number][2])
    for time in (whole[7][1] + 1.5e-3, whole[0][1] - 0.1, whole[-1][1] + 0.1, float("nan")):
        with pytest.raises(VideoError, match=r"v\.mkv: expected a frame at .* as the nearest"):
            video.number_at(time)


@pytest.mark.parametrize(("turn", "aspect"), [(90, None), (180, None), (0, Fraction(3, 2)), (90, Fraction(3, 2))])
def test_pictures_are_as_displayed(tmp_path: Path, turn: int, aspect: Fraction | None) -> None:
    path = encode(tmp_path / "v.mp4", options=X264, pictures=drawn_pictures(4), turn=turn, aspect=aspect)
    whole = read_in_order(path)
    video = VideoFrames(path, cache=PictureCache(0))
    for number in (3, 1, 2):
        np.testing.assert_array_equal(video.picture(number), whole[number][2])
    assert video.picture(0).shape == (video.info.height, video.info.width, 3)


@pytest.mark.parametrize("size", [(80, 48), (53, 32), (53, 31), (160, 40), (320, 192), (100, 120), (1, 1)])
def test_a_scaled_picture_keeps_its_borders(tmp_path: Path, size: tuple[int, int]) -> None:
    path = encode(tmp_path / "v.mp4", options=X264, pictures=drawn_pictures(3))
    video = VideoFrames(path)
    full, small = video.picture(1), video.picture(1, size)
    assert small.shape == (size[1], size[0], 3) and small.flags.c_contiguous
    shrinks = size[0] <= 160 and size[1] <= 96
    reference = cv2.resize(full, size, interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR)
    assert np.abs(small.astype(float) - reference).mean() < 3


def test_what_decoding_passed_is_kept_while_there_is_room(tmp_path: Path) -> None:
    path = encode(tmp_path / "v.mkv", options=X264 | {"g": "500", "bf": "0"})
    whole = read_in_order(path)
    size = whole[0][2].nbytes
    roomy, tight = PictureCache(COUNT * size), PictureCache(5 * size)
    VideoFrames(path, cache=roomy).picture(20)
    assert len(roomy) == 21
    video = VideoFrames(path, cache=tight)
    for number in (20, 3, 21, 2):
        np.testing.assert_array_equal(video.picture(number), whole[number][2])
        assert tight.used_bytes <= tight.limit_bytes and len(tight) <= 5
    kept = tight.find(picture_key(path, 21, (160, 96)))
    assert kept is not None and kept is video.picture(21)


def test_a_cache_drops_what_was_not_used_for_longest() -> None:
    picture = np.zeros((2, 5, 3), np.uint8)
    cache = PictureCache(3 * picture.nbytes)
    for key in range(3):
        cache.keep(key, picture)
    assert cache.find(0) is not None
    cache.keep(3, picture)
    assert [cache.find(key) is not None for key in range(4)] == [True, False, True, True]
    cache.keep_where_room(4, picture.nbytes, lambda: picture)
    assert cache.find(4) is None and len(cache) == 3
    cache.keep(5, np.zeros((100, 100, 3), np.uint8))
    assert cache.find(5) is None and cache.used_bytes == 3 * picture.nbytes
    cache.keep(3, picture)
    assert cache.used_bytes == 3 * picture.nbytes
    with pytest.raises(ValueError, match="limit_bytes: expected 0 or more, got -1"):
        PictureCache(-1)


def test_pictures_that_the_cache_shares_cannot_be_changed(tmp_path: Path) -> None:
    video = VideoFrames(encode(tmp_path / "v.mp4", pictures=drawn_pictures(2)))
    for size in (None, (80, 48), (53, 31)):
        with pytest.raises(ValueError, match="read-only"):
            video.picture(0, size)[:] = 0


def test_videos_of_one_cache_are_kept_apart(tmp_path: Path) -> None:
    cache = PictureCache()
    one = VideoFrames(encode(tmp_path / "a.mp4", pictures=drawn_pictures(2)), cache=cache)
    other = VideoFrames(encode(tmp_path / "b.mp4", pictures=drawn_pictures(2, seed=5)), cache=cache)
    assert (one.picture(1) != other.picture(1)).any()
    assert one.picture(1).shape != one.picture(1, (80, 48)).shape


def test_a_truncated_video_has_the_frames_that_are_there(tmp_path: Path) -> None:
    whole, cut = tmp_path / "whole.mp4", tmp_path / "cut.mp4"
    write_video(whole, drawn_pictures(COUNT), fps=25, gop=4)
    data = whole.read_bytes()
    cut.write_bytes(data[: len(data) * 6 // 10])
    there = read_in_order(cut)
    video = VideoFrames(cut)
    assert 10 < len(video) == len(there) < 35
    for number in (len(video) - 1, 2, len(video) - 2):
        np.testing.assert_array_equal(video.picture(number), there[number][2])
    for number in (len(video), -1, COUNT - 1):
        with pytest.raises(VideoError, match=rf"cut\.mp4: expected a frame {number}, found {len(video)} frames"):
            video.picture(number)


def test_a_file_that_shrinks_after_it_was_opened_is_said(tmp_path: Path) -> None:
    path = tmp_path / "v.mp4"
    write_video(path, drawn_pictures(COUNT), fps=25, gop=4)
    video = VideoFrames(path, cache=PictureCache(0))
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])
    with pytest.raises(VideoError, match="expected a frame 39 that decodes"):
        video.picture(39)
    assert video.picture(1).shape == (96, 160, 3)
    path.unlink()
    video.close()
    with pytest.raises(VideoError, match=r"v\.mp4: expected a video, as before"):
        video.picture(13)


def test_frames_round_a_hole_are_found_by_their_times(tmp_path: Path) -> None:
    path = tmp_path / "v.mkv"
    write_video(path, drawn_pictures(COUNT), fps=25, gop=1)
    data = bytearray(path.read_bytes())
    middle = len(data) // 2
    data[middle : middle + 600] = bytes(600)
    path.write_bytes(data)
    there = read_in_order(path)
    video = VideoFrames(path)
    for _, time, picture in (there[0], there[5], there[-3], there[-1]):
        np.testing.assert_array_equal(video.picture(video.number_at(time)), picture)


def test_a_picture_of_another_size_is_refused_by_number(tmp_path: Path) -> None:
    one = encode(tmp_path / "a.ts", options=X264 | {"g": "5", "bf": "0"}, pictures=drawn_pictures(10))
    times = [40 * (10 + k) for k in range(10)]
    other = encode(
        tmp_path / "b.ts", options=X264 | {"g": "5", "bf": "0"}, pictures=drawn_pictures(10, 128, 64), times=times
    )
    path = tmp_path / "both.ts"
    path.write_bytes(one.read_bytes() + other.read_bytes())
    video = VideoFrames(path)
    whole = read_in_order(path)
    np.testing.assert_array_equal(video.picture(9), whole[9][2])
    with pytest.raises(VideoError, match=r"expected (frame 12 of 160x96 as the first|a frame 12)"):
        video.picture(12)
    np.testing.assert_array_equal(video.picture(2), whole[2][2])


def test_a_still_is_a_video_of_one_frame(tmp_path: Path) -> None:
    path = tmp_path / "still.png"
    cv2.imwrite(str(path), drawn_pictures(1)[0])
    video = VideoFrames(path)
    assert len(video) == 1 and video.number_at(0.0) == 0
    np.testing.assert_array_equal(video.picture(0), drawn_pictures(1)[0])
    np.testing.assert_array_equal(video.picture(0), drawn_pictures(1)[0])


def test_one_frame_is_enough(tmp_path: Path) -> None:
    path = encode(tmp_path / "v.mp4", pictures=drawn_pictures(1))
    video = VideoFrames(path)
    assert len(video) == 1
    np.testing.assert_array_equal(video.picture(0), read_in_order(path)[0][2])


def test_what_is_no_video_is_refused(tmp_path: Path) -> None:
    with pytest.raises(VideoError, match="no such file"):
        VideoFrames(tmp_path / "gone.mp4")
    with pytest.raises(VideoError, match="no such file"):
        frame_index(tmp_path / "gone.mp4")
    (tmp_path / "text.mp4").write_bytes(b"no video\n" * 50)
    with pytest.raises(VideoError, match=r"text\.mp4: expected a video"):
        VideoFrames(tmp_path / "text.mp4")
    video = VideoFrames(encode(tmp_path / "v.mp4", pictures=drawn_pictures(2)))
    with pytest.raises(ValueError, match=r"v\.mp4: size: expected 1 pixel or more, got 0x48"):
        video.picture(0, (0, 48))


def test_threads_share_a_video(tmp_path: Path) -> None:
    path = encode(tmp_path / "v.mp4", options=X264 | {"g": "9"})
    whole = read_in_order(path)
    video = VideoFrames(path, cache=PictureCache(6 * whole[0][2].nbytes))
    wrong: list[int] = []

    def look(seed: int) -> None:
        for number in np.random.default_rng(seed).integers(0, COUNT, 30).tolist():
            if (video.picture(number) != whole[number][2]).any():
                wrong.append(number)

    threads = [threading.Thread(target=look, args=(seed,)) for seed in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert wrong == []


def test_an_unpickled_video_is_the_same(tmp_path: Path) -> None:
    path = encode(tmp_path / "v.mp4", options=X264 | {"g": "9"})
    video = VideoFrames(path, cache=PictureCache(10**6))
    video.picture(17)
    again = pickle.loads(pickle.dumps(video))
    assert again.cache.limit_bytes == 10**6 and len(again.cache) == 0
    np.testing.assert_array_equal(again.picture(17), video.picture(17))


def _sums(video: VideoFrames, numbers: list[int], answers) -> None:
    answers.put([int(video.picture(number).sum()) for number in numbers])


@pytest.mark.filterwarnings("ignore:.*multi-threaded.*fork.*:DeprecationWarning")
def test_a_forked_process_reads_on_its_own(tmp_path: Path) -> None:
    path = encode(tmp_path / "v.mp4", options=X264 | {"g": "9"})
    whole = read_in_order(path)
    video = VideoFrames(path, cache=PictureCache(0))
    video.picture(20)
    context = multiprocessing.get_context("fork")
    answers = context.Queue()
    order = [np.random.default_rng(seed).permutation(COUNT).tolist() for seed in range(3)]
    processes = [context.Process(target=_sums, args=(video, order[k], answers)) for k in range(2)]
    for process in processes:
        process.start()
    for number in order[2]:
        np.testing.assert_array_equal(video.picture(number), whole[number][2])
    sums = [answers.get(timeout=60) for _ in processes]
    for process in processes:
        process.join()
    expected = [[int(whole[number][2].sum()) for number in numbers] for numbers in order[:2]]
    assert sorted(sums) == sorted(expected)
