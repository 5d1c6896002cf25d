"""Shots, transitions and repeats found in a running video."""

from collections.abc import Callable, Iterator
from itertools import islice
from pathlib import Path

import cv2
import numpy as np
import pytest

from pgm_data.shots import MarkedFrame, ShotOptions, split_shots
from pgm_data.video import DecodedFrame, PictureFrame, open_video

WIDTH, HEIGHT = 384, 216


def texture(seed: int) -> np.ndarray:
    """A large drawn world: soft patches with lines across, so that it has coarse and fine structure."""
    random = np.random.default_rng(seed)
    coarse = cv2.resize(random.integers(20, 230, (8, 14), dtype=np.uint8), (900, 560), interpolation=cv2.INTER_CUBIC)
    for _ in range(14):
        ends = random.integers(0, 900, 4).tolist()
        cv2.line(coarse, (ends[0], ends[1] % 560), (ends[2], ends[3] % 560), int(random.integers(0, 256)), 5)
    return coarse


def shot(seed: int, count: int, *, pan: float = 0.0, zoom: float = 0.0) -> np.ndarray:
    """Grey pictures (frames, height, width) of a camera over a drawn world, a player running, noise on top."""
    world = texture(seed)
    random = np.random.default_rng(seed + 1)
    pictures = []
    for number in range(count):
        scale = 1 + zoom * number
        # The zoom is about the picture's centre, which starts at (392, 258) of the world.
        left, top = WIDTH / 2 - 392 * scale - pan * number, HEIGHT / 2 - 258 * scale
        matrix = np.array([[scale, 0, left], [0, scale, top]], np.float64)
        picture = cv2.warpAffine(world, matrix, (WIDTH, HEIGHT), borderMode=cv2.BORDER_REFLECT)
        runner = 60 + 4 * number % 250
        picture[120:170, runner : runner + 18] = 40
        noise = random.normal(0, 1.5, picture.shape)
        pictures.append(np.clip(picture + noise, 0, 255).astype(np.uint8))
    return np.stack(pictures)


def frames_of(pictures: np.ndarray) -> Iterator[DecodedFrame]:
    for number, picture in enumerate(pictures):
        bgr = cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR)
        yield PictureFrame(bgr, video_frame=number, timestamp=number / 25)


def marks(frames: Iterator[DecodedFrame]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Shot numbers, transition flags and repeat flags."""
    found = list(split_shots(frames))
    columns = ([m.shot for m in found], [m.is_transition for m in found], [m.is_duplicate for m in found])
    return tuple(np.array(column) for column in columns)


def mixed(before: np.ndarray, after: np.ndarray, start: int, count: int) -> np.ndarray:
    """A cross-fade over `count` frames from frame `start` on."""
    share = np.clip((np.arange(len(before)) - start + 1) / (count + 1), 0, 1)[:, None, None]
    return np.round((1 - share) * before + share * after).astype(np.uint8)


def wiped(before: np.ndarray, after: np.ndarray, start: int, count: int) -> np.ndarray:
    """A wipe from left to right over `count` frames from frame `start` on."""
    share = np.clip((np.arange(len(before)) - start + 1) / (count + 1), 0, 1)[:, None, None]
    return np.where(np.arange(WIDTH) < share * WIDTH, after, before)


def through_black(before: np.ndarray, after: np.ndarray, start: int, count: int) -> np.ndarray:
    """A fade to black and up again over `count` frames from frame `start` on."""
    share = np.clip((np.arange(len(before)) - start + 1) / (count + 1), 0, 1)[:, None, None]
    return (np.where(share < 0.5, before, after) * np.abs(1 - 2 * share)).astype(np.uint8)


@pytest.mark.parametrize(("pan", "zoom"), [(0, 0), (6, 0), (0, 0.02)])
def test_a_hard_cut_splits_exactly(pan: float, zoom: float) -> None:
    pictures = np.concatenate([shot(1, 30, pan=pan, zoom=zoom), shot(2, 30, pan=-pan, zoom=-zoom / 2)])
    shots, is_transition, is_duplicate = marks(frames_of(pictures))
    assert shots.tolist() == [0] * 30 + [1] * 30
    assert not is_transition.any() and not is_duplicate.any()


def test_a_jump_within_one_scene_is_a_cut() -> None:
    world = shot(3, 60, pan=1)
    shots, *_ = marks(frames_of(np.concatenate([world[:25], shot(3, 60, pan=5)[35:]])))
    assert shots.tolist() == [0] * 25 + [1] * 25


@pytest.mark.parametrize("count", [1, 2, 5, 10, 16, 30])
@pytest.mark.parametrize("pan", [0, 3])
def test_a_cross_fade_belongs_to_neither_shot(count: int, pan: float) -> None:
    before, after = shot(4, 50 + count, pan=pan), shot(5, 50 + count)
    shots, is_transition, _ = marks(frames_of(mixed(before, after, 25, count)))
    inside = slice(25, 25 + count)
    # In a pan, the first fifth of a slow fade cannot be told from the pan within the look-ahead.
    assert is_transition[inside].mean() >= (0.75 if pan and count > 16 else 0.9)
    assert is_transition[:22].sum() == 0 and is_transition[28 + count :].sum() == 0
    assert (shots[:22] == 0).all() and (shots[28 + count :] == 1).all()


@pytest.mark.parametrize("change", [wiped, through_black])
@pytest.mark.parametrize("count", [8, 15])
def test_wipes_and_fades_through_black_belong_to_neither_shot(change: Callable, count: int) -> None:
    pictures = change(shot(6, 50 + count), shot(7, 50 + count), 25, count)
    shots, is_transition, _ = marks(frames_of(pictures))
    assert is_transition[26 : 24 + count].mean() >= 0.9
    assert is_transition[:22].sum() == 0 and is_transition[28 + count :].sum() == 0
    assert (shots[:22] == 0).all() and (shots[28 + count :] == 1).all()


def test_a_short_insert_belongs_to_neither_shot() -> None:
    pictures = np.concatenate([shot(8, 25), shot(9, 5), shot(10, 25)])
    shots, is_transition, _ = marks(frames_of(pictures))
    assert np.flatnonzero(is_transition).tolist() == list(range(25, 30))
    assert shots[-1] == 1


def test_pans_zooms_flashes_and_overlays_are_no_cuts() -> None:
    pan, zoom, flash, overlay = (shot(11, 50, pan=9), shot(12, 50, zoom=0.02), shot(13, 50), shot(14, 50))
    flash[20:22] = np.minimum(255, flash[20:22] * 1.4 + 80).astype(np.uint8)
    overlay[25:, 150:, 40:300] = 250
    brighter = np.clip(shot(15, 50) * np.linspace(0.6, 1.1, 50)[:, None, None], 0, 255).astype(np.uint8)
    for pictures in (pan, zoom, flash, overlay, brighter):
        shots, is_transition, _ = marks(frames_of(pictures))
        assert shots.max() == 0 and not is_transition.any()


def test_one_frame_blank_frames_and_tiny_pictures() -> None:
    shots, is_transition, is_duplicate = marks(frames_of(shot(16, 1)))
    assert (shots.tolist(), is_transition.tolist(), is_duplicate.tolist()) == ([0], [False], [False])
    blank = np.zeros((10, HEIGHT, WIDTH), np.uint8)
    shots, is_transition, _ = marks(frames_of(np.concatenate([blank, shot(16, 20), blank, shot(17, 20)])))
    assert (is_transition[:10].all(), is_transition[30:40].all(), is_transition.sum()) == (True, True, 20)
    assert (shots[10:30] == 0).all() and (shots[40:] == 1).all()
    assert marks(frames_of(np.zeros((3, 2, 1), np.uint8)))[1].all()
    assert list(split_shots(iter([]))) == []


def test_repeats_of_a_converted_frame_rate_are_marked() -> None:
    pictures = shot(18, 50)
    picture = np.floor(np.arange(60) * 25 / 30 + 0.3).astype(int)
    random = np.random.default_rng(0)
    coded_again = np.clip(pictures[picture] + random.normal(0, 1.5, (60, HEIGHT, WIDTH)), 0, 255).astype(np.uint8)
    _, _, is_duplicate = marks(frames_of(coded_again))
    assert is_duplicate.tolist() == (np.diff(picture, prepend=-1) == 0).tolist()


def test_a_still_is_no_row_of_repeats() -> None:
    still = np.repeat(shot(19, 1), 40, axis=0)
    _, _, is_duplicate = marks(frames_of(np.concatenate([shot(20, 30, pan=3), still])))
    assert not is_duplicate.any()


def test_the_look_ahead_is_bounded_and_kept() -> None:
    given: list[int] = []

    def watched() -> Iterator[DecodedFrame]:
        for frame in frames_of(shot(21, 60)):
            # Frames read but not yet given out are what is held.
            assert frame.video_frame - len(given) <= 17
            yield frame

    for marked in split_shots(watched(), ShotOptions(look_ahead=16)):
        given.append(marked.frame.video_frame)
    assert given == list(range(60))
    with pytest.raises(ValueError, match="look_ahead: expected at least 16 frames, got 8"):
        ShotOptions(look_ahead=8)


def test_a_change_of_size_is_refused() -> None:
    frames = [*frames_of(shot(22, 3)), *frames_of(shot(22, 3)[:, :100])]
    with pytest.raises(ValueError, match="luma: expected the size of the frame before"):
        list(split_shots(frames))


def part(path: Path, start: int, count: int) -> Iterator[DecodedFrame]:
    """Frames of a real clip from `start` on; those before are decoded only."""
    with open_video(path) as reader:
        yield from islice(reader, start, start + count)


@pytest.mark.real
@pytest.mark.parametrize(
    ("name", "first", "count"),
    [
        ("shanghai_1080p30", 3, 60),
        ("paris_1080p30", 6, 60),
        ("rome_1080p30", 2, 60),
        ("vienna_1080p60", 4, 60),
        ("miami_1080p30", None, 40),
    ],
)
def test_real_repeats_are_every_sixth_frame(real_data: Path, name: str, first: int | None, count: int) -> None:
    shots, is_transition, is_duplicate = marks(part(real_data / f"tennis/{name}.mp4", 0, count))
    expected = [] if first is None else list(range(first, count, 6))
    assert np.flatnonzero(is_duplicate).tolist() == expected
    assert shots.max() == 0 and not is_transition.any()


@pytest.mark.real
def test_real_cuts_are_found_to_the_frame(real_data: Path) -> None:
    found: list[MarkedFrame] = list(split_shots(part(real_data / "tennis/usopen_360p30_pan_cuts.mp4", 2315, 60)))
    starts = [b.frame.video_frame for a, b in zip(found, found[1:], strict=False) if b.shot != a.shot]
    assert starts == [2335]
    assert not any(marked.is_transition for marked in found)
    found = list(split_shots(part(real_data / "tennis/usopen_360p30_pan_cuts.mp4", 2360, 60)))
    starts = [b.frame.video_frame for a, b in zip(found, found[1:], strict=False) if b.shot != a.shot]
    assert starts == [2387]


@pytest.mark.real
def test_a_cross_fade_of_two_real_clips_belongs_to_neither(real_data: Path) -> None:
    def grey(name: str, start: int) -> np.ndarray:
        frames = part(real_data / f"tennis/{name}.mp4", start, 56)
        return np.stack([cv2.resize(frame.luma, (WIDTH, HEIGHT)) for frame in frames])

    pictures = mixed(grey("usopen_360p30_pan_cuts", 100), grey("miami_rally_720p50", 0), 22, 12)
    shots, is_transition, _ = marks(frames_of(pictures))
    assert is_transition[22:34].all() and is_transition.sum() <= 15
    assert shots[0] == 0 and shots[-1] == 1
