"""Videos as they are read: true times, displayed pictures, and damage that is said."""

from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from pgm_data.video import PictureFrame, VideoError, open_video, write_video
from tests.video.drawn import drawn_pictures


def encode(
    path: Path,
    pictures: list[np.ndarray],
    *,
    codec: str = "libx264",
    pixel_format: str = "yuv420p",
    aspect: Fraction | None = None,
    turn: int = 0,
    mirror: bool = False,
    options: dict[str, str] | None = None,
) -> Path:
    """A video written with PyAV alone, so that the writer under test takes no part."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=25, options=options or {"crf": "8"})
        stream.height, stream.width = pictures[0].shape[:2]
        stream.pix_fmt = pixel_format
        if aspect is not None:
            stream.codec_context.sample_aspect_ratio = aspect
        if turn or mirror:
            stream.set_display_rotation(turn, hflip=mirror)
        for picture in pictures:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="bgr24")))
        container.mux(stream.encode())
    return path


def scaled_luma(luma: np.ndarray) -> np.ndarray:
    """Luma of limited range stretched to 0..255, as OpenCV's grey has it."""
    return (luma.astype(float) - 16) * 255 / 219


@pytest.mark.parametrize(
    ("codec", "pixel_format", "is_view"),
    [
        ("libx264", "yuv420p", True),
        ("libx264", "yuvj420p", True),
        ("libx264", "yuv444p", True),
        ("libx264", "yuv420p10le", False),
        ("libx264rgb", "bgr24", False),
        ("rawvideo", "yuyv422", False),
        ("ffv1", "gray", True),
    ],
)
def test_luma_is_opencvs_grey_in_every_pixel_format(
    tmp_path: Path, codec: str, pixel_format: str, is_view: bool
) -> None:
    grey = codec == "ffv1"
    options = {} if codec in ("rawvideo", "ffv1") else {"crf": "8"}
    pictures = drawn_pictures(3)
    if grey:
        pictures = [cv2.cvtColor(cv2.cvtColor(each, cv2.COLOR_BGR2GRAY), cv2.COLOR_GRAY2BGR) for each in pictures]
    path = encode(tmp_path / "v.mkv", pictures, codec=codec, pixel_format=pixel_format, options=options)
    with open_video(path) as reader:
        frames = list(reader)
        assert len(frames) == 3
        for frame, picture in zip(frames, pictures, strict=True):
            luma = frame.luma.astype(float) if reader.info.full_range else scaled_luma(frame.luma)
            assert frame.luma.dtype == np.uint8 and not frame.luma.flags.writeable
            grey_picture = cv2.cvtColor(frame.bgr(), cv2.COLOR_BGR2GRAY)
            # Colours outside the RGB cube are clipped in BGR but not in luma, hence the mean and not the largest.
            assert np.abs(luma - grey_picture).mean() < 2.5
            assert np.abs(frame.bgr().astype(float) - picture).mean() < 6
            small = frame.small_luma(40)
            assert small.shape == (24, 40)
            area = cv2.resize(np.ascontiguousarray(frame.luma), (40, 24), interpolation=cv2.INTER_AREA)
            assert np.abs(small.astype(float) - area).mean() < 1
            area = cv2.resize(frame.bgr(), (40, 24), interpolation=cv2.INTER_AREA)
            assert np.abs(frame.small_bgr(40).astype(float) - area).mean() < 3
        assert (frames[0].luma.ctypes.data == frames[0]._frame.planes[0].buffer_ptr) == is_view
        assert reader.trouble == ""


def test_luma_stays_valid_after_later_frames_are_read(tmp_path: Path) -> None:
    pictures = drawn_pictures(40)
    path = encode(tmp_path / "v.mp4", pictures)
    with open_video(path) as reader:
        first = next(iter(reader))
        luma, before = first.luma, first.luma.copy()
        for _ in reader:
            pass
    assert (luma == before).all()


@pytest.mark.parametrize("turn", [0, 90, 180, 270])
def test_rotation_is_applied_as_opencv_applies_it(tmp_path: Path, turn: int) -> None:
    path = encode(tmp_path / "v.mp4", drawn_pictures(2), turn=turn)
    found, reference = cv2.VideoCapture(str(path)).read()
    assert found
    with open_video(path) as reader:
        frame = next(iter(reader))
        assert (reader.info.height, reader.info.width) == reference.shape[:2] == frame.luma.shape
        assert (reader.info.stored_width, reader.info.stored_height) == (160, 96)
        assert np.abs(frame.bgr().astype(float) - reference).max() <= 1
        assert np.abs(scaled_luma(frame.luma) - cv2.cvtColor(reference, cv2.COLOR_BGR2GRAY)).mean() < 2.5
        small = frame.small_bgr(30)
        area = cv2.resize(reference, (30, small.shape[0]), interpolation=cv2.INTER_AREA)
        assert np.abs(small.astype(float) - area).mean() < 3
        assert frame.small_luma(30).shape == small.shape[:2]


def test_a_mirrored_video_is_shown_mirrored(tmp_path: Path) -> None:
    plain = encode(tmp_path / "p.mp4", drawn_pictures(1))
    mirrored = encode(tmp_path / "m.mp4", drawn_pictures(1), mirror=True)
    with open_video(plain) as one, open_video(mirrored) as other:
        assert other.info.mirrored and not one.info.mirrored
        assert (next(iter(other)).luma == next(iter(one)).luma[:, ::-1]).all()


def test_a_slanted_display_is_refused(tmp_path: Path) -> None:
    path = encode(tmp_path / "v.mp4", drawn_pictures(1), turn=30)
    with pytest.raises(VideoError, match="multiple of 90 degrees"):
        open_video(path)


def test_wide_pixels_are_stretched_for_display(tmp_path: Path) -> None:
    path = encode(tmp_path / "v.mp4", drawn_pictures(2, 180, 144), aspect=Fraction(64, 45))
    with open_video(path) as reader:
        frame = next(iter(reader))
        assert (reader.info.width, reader.info.height) == (256, 144)
        assert Fraction(reader.info.sample_aspect) == Fraction(64, 45)
        assert frame.luma.shape == (144, 256) and frame.bgr().shape == (144, 256, 3)
        assert frame.small_luma(64).shape == (36, 64)


def test_one_frame_and_4k(tmp_path: Path) -> None:
    path = tmp_path / "v.mp4"
    write_video(path, [np.full((2160, 3840, 3), 128, np.uint8)], fps=30, preset="ultrafast")
    with open_video(path) as reader:
        (frame,) = list(reader)
        assert (reader.info.width, reader.info.height) == (3840, 2160)
        assert frame.video_frame == 0 and frame.timestamp == 0.0
        assert frame.small_bgr(640).shape == (360, 640, 3)


def test_a_truncated_video_gives_what_decodes_and_says_so(tmp_path: Path) -> None:
    whole, cut = tmp_path / "whole.mp4", tmp_path / "cut.mp4"
    pictures = drawn_pictures(40)
    write_video(whole, pictures, fps=25, gop=1)
    data = whole.read_bytes()
    cut.write_bytes(data[: len(data) * 6 // 10])
    with open_video(cut) as reader:
        frames = list(reader)
        assert 15 < len(frames) < 30
        assert [frame.video_frame for frame in frames] == list(range(len(frames)))
        assert np.abs(frames[9].bgr().astype(float) - pictures[9]).mean() < 8
        assert f"{len(frames)} frames decoded" in reader.trouble and "of 40 pictures" in reader.trouble


def test_a_truncated_matroska_video_says_so(tmp_path: Path) -> None:
    whole, cut = tmp_path / "whole.mkv", tmp_path / "cut.mkv"
    write_video(whole, drawn_pictures(40), fps=25, gop=1)
    data = whole.read_bytes()
    cut.write_bytes(data[: len(data) * 6 // 10])
    with open_video(whole) as reader:
        assert len(list(reader)) == 40 and reader.trouble == ""
    with open_video(cut) as reader:
        assert 15 < len(list(reader)) < 30
        assert "ends early" in reader.trouble


def test_a_hole_in_the_file_is_said(tmp_path: Path) -> None:
    path = tmp_path / "v.mp4"
    write_video(path, drawn_pictures(40), fps=25, gop=1)
    data = bytearray(path.read_bytes())
    middle = len(data) // 2
    data[middle : middle + 600] = bytes(600)
    path.write_bytes(data)
    with open_video(path) as reader:
        assert len(list(reader)) >= 38
        assert reader.trouble


def test_a_clock_that_restarts_is_carried_on_and_said(tmp_path: Path) -> None:
    path = tmp_path / "v.ts"
    write_video(path, drawn_pictures(40), fps=25)
    path.write_bytes(path.read_bytes() * 2)
    with open_video(path) as reader:
        times = np.array([frame.timestamp for frame in reader])
    assert len(times) == 80
    np.testing.assert_allclose(np.diff(times), 0.04, atol=1e-9)
    assert "frame 40: the clock goes back" in reader.trouble


def test_a_stream_without_times_says_that_they_are_made_up(tmp_path: Path) -> None:
    path = encode(tmp_path / "v.h264", drawn_pictures(5))
    with open_video(path) as reader:
        times = [frame.timestamp for frame in reader]
    assert len(times) == 5 and (np.diff(times) > 0).all()
    assert "no time in the file" in reader.trouble


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"this is no video\n" * 40,
        b"#EXTM3U\n#EXTINF:1,\nv.mp4\n",
        b"ffconcat version 1.0\nfile v.mp4\n",
        b"1\n00:00:01,000 --> 00:00:02,000\nhello\n\n",
        b"\x1b[1mbold\x1b[0m\n" * 40,
    ],
    ids=["empty", "prose", "playlist", "script", "subtitles", "ansi"],
)
def test_text_under_a_videos_name_is_refused(tmp_path: Path, content: bytes) -> None:
    write_video(tmp_path / "v.mp4", drawn_pictures(2), fps=25)
    path = tmp_path / "text.mp4"
    path.write_bytes(content)
    with pytest.raises(VideoError, match=r"text\.mp4: expected a video.*, found") as caught:
        open_video(path)
    assert caught.value.path == path


def test_what_is_no_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(VideoError, match="no such file"):
        open_video(tmp_path / "gone.mp4")
    with pytest.raises(VideoError, match="a folder"):
        open_video(tmp_path)


def test_sound_alone_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "sound.mp4"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("aac", rate=44100)
        sound = av.AudioFrame.from_ndarray(np.zeros((1, 1024), np.float32), format="fltp", layout="mono")
        sound.sample_rate = 44100
        container.mux(stream.encode(sound))
        container.mux(stream.encode())
    with pytest.raises(VideoError, match="expected a video stream"):
        open_video(path)


@pytest.mark.parametrize("ending", [".jpg", ".PNG", ".tif", ".webp"])
def test_a_still_picture_is_a_video_of_one_frame(tmp_path: Path, ending: str) -> None:
    picture = drawn_pictures(1, 61, 45)[0]
    path = tmp_path / f"still{ending}"
    assert cv2.imwrite(str(path), picture)
    with open_video(path) as reader:
        (frame,) = list(reader)
    assert (frame.video_frame, frame.timestamp, reader.trouble) == (0, 0.0, "")
    assert (reader.info.width, reader.info.height) == (61, 45)
    assert (frame.bgr() == cv2.imread(str(path))).all()
    assert (frame.luma == cv2.cvtColor(frame.bgr(), cv2.COLOR_BGR2GRAY)).all()


def test_a_still_is_turned_by_its_exif_orientation(tmp_path: Path) -> None:
    encoded = cv2.imencode(".jpg", drawn_pictures(1, 64, 48)[0])[1].tobytes()
    # An APP1 segment holding one little-endian EXIF entry: orientation (0x0112) = 6, a quarter turn clockwise.
    tiff = b"II*\0\x08\0\0\0" + b"\x01\0" + b"\x12\x01\x03\0\x01\0\0\0\x06\0\0\0" + b"\0\0\0\0"
    segment = b"Exif\0\0" + tiff
    path = tmp_path / "turned.jpg"
    path.write_bytes(encoded[:2] + b"\xff\xe1" + (len(segment) + 2).to_bytes(2, "big") + segment + encoded[2:])
    with open_video(path) as reader:
        assert (reader.info.width, reader.info.height) == (48, 64)


def test_a_cut_still_gives_its_picture_and_says_so(tmp_path: Path) -> None:
    data = cv2.imencode(".jpg", drawn_pictures(1, 320, 240)[0])[1].tobytes()
    path = tmp_path / "cut.jpg"
    path.write_bytes(data[: len(data) * 2 // 3])
    with open_video(path) as reader:
        assert len(list(reader)) == 1
    assert "ends early" in reader.trouble
    path.write_bytes(b"no picture")
    with pytest.raises(VideoError, match="expected a picture, found 10 bytes"):
        open_video(path)


def test_small_pictures_share_the_full_ones_borders() -> None:
    ramp = np.repeat(np.arange(200, dtype=np.uint8)[None], 100, axis=0)
    frame = PictureFrame(cv2.cvtColor(ramp, cv2.COLOR_GRAY2BGR))
    x_full = (np.arange(50) + 0.5) * 200 / 50 - 0.5
    np.testing.assert_allclose(frame.small_luma(50)[0], x_full, atol=0.51)
    with pytest.raises(ValueError, match="width: expected at least 1"):
        frame.small_luma(0)


def test_the_fast_decoder_shows_nearly_the_same_pictures(tmp_path: Path) -> None:
    path = tmp_path / "v.mp4"
    write_video(path, drawn_pictures(20), fps=25, crf=30)
    with open_video(path) as exact, open_video(path, fast=True) as fast:
        for one, other in zip(exact, fast, strict=True):
            assert one.timestamp == other.timestamp
            assert np.abs(one.luma.astype(float) - other.luma).mean() < 4


@pytest.mark.real
def test_real_clips_keep_their_own_times_and_true_counts(real_data: Path) -> None:
    with open_video(real_data / "tennis/usopen_360p30_pan_cuts.mp4") as reader:
        times = [frame.timestamp for frame, _ in zip(reader, range(60), strict=False)]
        np.testing.assert_allclose(np.diff(times), 1001 / 30000, atol=2e-5)
        assert times[0] == pytest.approx(0.033)
    with open_video(real_data / "tennis/amateur_low_628p30.mp4") as reader:
        steps = np.diff([frame.timestamp for frame, _ in zip(reader, range(60), strict=False)])
        # A phone's variable rate: no step is frame / fps of the header.
        assert reader.info.claimed_fps == pytest.approx(29.57, abs=0.01)
        assert (np.abs(steps - 1 / reader.info.claimed_fps) > 1e-4).all()


@pytest.mark.real
def test_luma_of_a_real_clip_is_opencvs_grey(real_data: Path) -> None:
    path = real_data / "tennis/miami_rally_720p50.mp4"
    reference = cv2.VideoCapture(str(path))
    with open_video(path) as reader:
        for frame, _ in zip(reader, range(3), strict=False):
            found, bgr = reference.read()
            assert found and (frame.bgr() == bgr).all()
            difference = scaled_luma(frame.luma) - cv2.cvtColor(bgr, cv2.COLOR_BGR2GRAY)
            # OpenCV weighs colours by BT.601, this clip's luma by BT.709: they part on its blue court.
            assert np.abs(difference).mean() < 5


@pytest.mark.parametrize(
    ("name", "codec", "options"),
    [
        ("a.mp4", "libx264", {"crf": "8", "g": "12", "bf": "2"}),
        ("a.mkv", "libx264", {"crf": "8", "g": "500"}),
        ("a.avi", "mjpeg", {}),
    ],
)
@pytest.mark.parametrize("first", [1, 13, 39])
def test_reading_from_a_frame_on_gives_what_reading_all_gives(
    tmp_path: Path, name: str, codec: str, options: dict[str, str], first: int
) -> None:
    pixel_format = "yuvj420p" if codec == "mjpeg" else "yuv420p"
    path = encode(tmp_path / name, drawn_pictures(40), codec=codec, pixel_format=pixel_format, options=options)
    with open_video(path) as reader:
        whole = [(frame.video_frame, frame.timestamp, frame.bgr()) for frame in reader]
    with open_video(path, start=whole[first][:2]) as reader:
        part = [(frame.video_frame, frame.timestamp, frame.bgr()) for frame in reader]
    assert [row[:2] for row in part] == [row[:2] for row in whole[first:]]
    for one, other in zip(part, whole[first:], strict=True):
        np.testing.assert_array_equal(one[2], other[2])


def test_a_frame_whose_time_the_file_does_not_give_is_counted_to(tmp_path: Path) -> None:
    path = encode(tmp_path / "a.mp4", drawn_pictures(10))
    with open_video(path, start=(4, 123.0)) as reader:
        assert next(iter(reader)).video_frame == 4
    with pytest.raises(VideoError, match="a frame 12"):
        open_video(path, start=(12, 123.0))
