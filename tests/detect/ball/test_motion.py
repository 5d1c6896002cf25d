"""The ball found by its motion, in pictures painted here: a disc that moves while the shutter is open."""

import cv2
import numpy as np
import pytest

from pgm_data.detect.ball.motion import MotionFinder, MotionOptions, evidence_of

HEIGHT, WIDTH = 400, 480
YELLOW = (90.0, 230.0, 215.0)
PATCH = 14
"""Half the side of what a ball covers, px."""


def scene(seed: int = 0) -> np.ndarray:
    """A blue court with lines and a textured stand."""
    rng = np.random.default_rng(seed)
    picture = np.full((HEIGHT, WIDTH, 3), (140.0, 90.0, 60.0))
    picture[:40] = cv2.GaussianBlur(rng.uniform(0, 255, (40, WIDTH, 3)), (5, 5), 0)
    picture[120:122], picture[:, 80:82] = 235.0, 235.0
    return picture


def painted(
    picture: np.ndarray, centre: tuple[float, float], *, radius: float = 2.5, streak: tuple[float, float] = (0.0, 0.0),
    colour: tuple[float, float, float] = YELLOW, noise: float = 0.7, seed: int = 0,
) -> np.ndarray:  # fmt: skip
    """The picture with a ball: the mean of discs along the streak, eight samples a pixel to each side."""
    left, top = round(centre[0]) - PATCH, round(centre[1]) - PATCH
    y, x = (np.mgrid[0 : 16 * PATCH, 0 : 16 * PATCH] + 0.5) / 8 - 0.5
    share = np.zeros((2 * PATCH, 2 * PATCH))
    for part in np.linspace(-0.5, 0.5, 21) if any(streak) else [0.0]:
        x0, y0 = centre[0] + part * streak[0] - left, centre[1] + part * streak[1] - top
        share += ((x - x0) ** 2 + (y - y0) ** 2 < radius**2).reshape(2 * PATCH, 8, 2 * PATCH, 8).mean(axis=(1, 3))
    share = share[..., None] / (21 if any(streak) else 1)
    noisy = picture + np.random.default_rng(seed + 1).normal(0, noise, picture.shape)
    window = np.s_[top : top + 2 * PATCH, left : left + 2 * PATCH]
    noisy[window] += share * (np.array(colour) - picture[window])
    return np.clip(np.round(noisy), 0, 255).astype(np.uint8)


def run(pictures: list[np.ndarray], *, fps: float = 25.0, repeats: tuple[int, ...] = (), turns=None, most: int = 6):
    """Everything that the finder finds."""
    finder = MotionFinder(fps=fps, options=MotionOptions(most=most))
    for number, picture in enumerate(pictures):
        turn = None if turns is None else turns[number]
        finder.add(picture, is_duplicate=number in repeats, here_from_previous=turn)
    return finder.finish()


def path(frames: int, step: tuple[float, float], start: tuple[float, float] = (60.3, 70.6)) -> np.ndarray:
    """Places of a ball that moves evenly."""
    return np.array(start) + np.arange(frames)[:, None] * np.array(step)


def clip(places: np.ndarray, streak: tuple[float, float] = (0.0, 0.0), **how) -> list[np.ndarray]:
    """The ball at each place before the still scene."""
    ground = scene()
    return [painted(ground, tuple(place), streak=streak, seed=n, **how) for n, place in enumerate(places)]


@pytest.mark.parametrize("streak", [(0.0, 0.0), (9.0, 4.0), (-3.0, 12.0)])
def test_centre_and_streak_are_found_to_fractions_of_a_pixel(streak: tuple[float, float]) -> None:
    places = path(6, (19.7, 9.1), start=(100.3, 150.6))
    found = run(clip(places, streak))
    error = found.pixels[:, 0] - places
    assert np.abs(error).max() < 0.25
    assert np.sqrt((error**2).mean()) < 0.1
    length = np.hypot(*streak)
    seen = found.streak_px[:, 0]
    if length == 0:
        assert np.hypot(*seen.T).max() < 1.5
    else:
        along = seen @ np.array(streak) / length
        across = (seen[:, 0] * streak[1] - seen[:, 1] * streak[0]) / length
        np.testing.assert_allclose(np.abs(along), length, atol=1.5)
        assert np.abs(across).max() < 1.0
    assert (found.score[:, 0] > 0.2).all()


def test_stated_deviation_is_of_the_size_of_the_error() -> None:
    places = path(8, (17.3, 6.7))
    found = run(clip(places, (6.0, 2.0)))
    ratio = np.sqrt(((found.pixels[:, 0] - places) ** 2).mean(axis=1)) / found.sigma_px[:, 0]
    assert 0.01 < np.median(ratio) < 2


def test_first_and_last_picture_have_the_ball_too() -> None:
    places = path(5, (21.0, 4.0))
    found = run(clip(places))
    assert np.hypot(*(found.pixels[[0, 4], 0] - places[[0, 4]]).T).max() < 1


def test_what_stands_still_is_nothing() -> None:
    still = [painted(scene(), (60.0, 70.0), seed=n) for n in range(6)]
    found = run(still)
    near = np.hypot(*(found.pixels - [60.0, 70.0]).transpose(2, 0, 1)) < 5
    assert not (near & (found.score > 0.3)).any()


def test_repeats_are_not_looked_at_and_hide_nothing() -> None:
    places = path(6, (16.0, 8.0))
    distinct = clip(places)
    order = [0, 1, 2, 2, 3, 4, 4, 5]
    found = run([distinct[n] for n in order], repeats=(3, 6))
    assert np.isnan(found.score[[3, 6]]).all() and np.isnan(found.pixels[[3, 6]]).all()
    once = run(distinct)
    np.testing.assert_array_equal(found.pixels[[0, 1, 2, 4, 5, 7]], once.pixels)


def test_camera_that_turns_is_compensated() -> None:
    wide = np.concatenate([scene(1), scene(2)], axis=1)
    wide = cv2.GaussianBlur(wide, (3, 3), 0)
    places, pictures, turns = path(6, (3.0, 9.0), start=(160.0, 60.0)), [], []
    for number, place in enumerate(places):
        pictures.append(painted(wide[:, 9 * number : 9 * number + WIDTH], tuple(place), seed=number))
        turns.append(np.array([[1.0, 0, -9], [0, 1, 0], [0, 0, 1]]) if number else None)
    found = run(pictures, turns=turns)
    assert np.hypot(*(found.pixels[:, 0] - places).T).max() < 1
    others = np.isfinite(found.score).sum()
    assert np.isfinite(run(pictures).score).sum() > others + 6


def test_slow_ball_at_240_frames_a_second_is_seen() -> None:
    places = path(40, (1.1, 0.4))
    found = run(clip(places), fps=240)
    assert (np.hypot(*(found.pixels[:, 0] - places).T) < 1).mean() > 0.9


def test_two_balls_are_two_candidates() -> None:
    one, two = path(5, (18.0, 5.0)), path(5, (-15.0, 9.0), start=(260.0, 150.0))
    ground = scene()
    pictures = []
    for number in range(5):
        first = painted(ground, tuple(one[number]), noise=0.0).astype(float)
        pictures.append(painted(first, tuple(two[number]), seed=number))
    found = run(pictures)
    best = found.pixels[:, :2]
    for places in (one, two):
        assert np.hypot(*(best - places[:, None]).transpose(2, 0, 1)).min(axis=1).max() < 1


def test_large_things_that_move_are_no_candidates() -> None:
    ground = scene()
    pictures = []
    for number in range(5):
        picture = np.clip(ground + np.random.default_rng(number).normal(0, 0.7, ground.shape), 0, 255)
        picture[80:200, 30 + 40 * number : 110 + 40 * number] = (40, 40, 220)
        pictures.append(picture.astype(np.uint8))
    found = run(pictures)
    assert not (found.score > 0.5).any()


@pytest.mark.parametrize("frames", [0, 1, 2])
def test_too_few_pictures_have_no_candidates(frames: int) -> None:
    found = run(clip(path(frames, (9.0, 9.0)).reshape(-1, 2)))
    assert found.score.shape == (frames, 6)
    assert np.isnan(found.score).all()


def test_short_clip_of_a_high_rate_is_still_looked_at() -> None:
    places = path(5, (18.0, 5.0))
    found = run(clip(places), fps=240)
    assert (np.hypot(*(found.pixels[:, 0] - places).T) < 1).sum() >= 3


def test_clip_of_repeats_alone_has_no_candidates() -> None:
    found = run([painted(scene(), (50.0, 60.0))] * 5, repeats=tuple(range(5)))
    assert np.isnan(found.score).all()


def test_tall_pictures_give_pixels_of_the_full_picture() -> None:
    places = path(4, (18.0, 5.0))
    tall = [cv2.resize(p, (WIDTH * 4, HEIGHT * 4), interpolation=cv2.INTER_LINEAR) for p in clip(places, radius=2.0)]
    found = run(tall)
    assert np.hypot(*(found.pixels[:, 0] - ((places + 0.5) * 4 - 0.5)).T).max() < 4


def test_picture_memory_is_flat() -> None:
    finder = MotionFinder(fps=25)
    for picture in clip(path(9, (10.0, 5.0))):
        finder.add(picture, is_duplicate=False, here_from_previous=None)
        assert len(finder._pictures) <= 3


def test_evidence_is_what_both_others_lack() -> None:
    rng = np.random.default_rng(3)
    a, b, c = (rng.integers(0, 256, (70, 9, 3)).astype(np.uint8) for _ in range(3))
    x, y, z = (p.astype(int) for p in (a, b, c))
    expected = np.minimum(np.maximum(x - y, 0), np.maximum(x - z, 0)) + np.minimum(
        np.maximum(y - x, 0), np.maximum(z - x, 0)
    )
    grey = expected @ np.array([0.114, 0.587, 0.299])
    assert np.abs(evidence_of(a, b, c) - grey).max() <= 1


def test_flat_black_and_noise_raise_nothing() -> None:
    rng = np.random.default_rng(0)
    for pictures in (
        [np.zeros((HEIGHT, WIDTH, 3), np.uint8)] * 4,
        [rng.integers(0, 256, (HEIGHT, WIDTH, 3)).astype(np.uint8) for _ in range(4)],
        [rng.integers(0, 256, (5, 7, 3)).astype(np.uint8) for _ in range(4)],
    ):
        found = run(pictures)
        known = np.isfinite(found.score)
        assert ((found.score[known] >= 0) & (found.score[known] <= 1)).all()


def test_wrong_rate_and_changing_size_are_refused() -> None:
    with pytest.raises(ValueError, match="fps"):
        MotionFinder(fps=0.0)
    finder = MotionFinder(fps=25)
    finder.add(np.zeros((20, 30, 3), np.uint8), is_duplicate=False, here_from_previous=None)
    with pytest.raises(ValueError, match="one size"):
        finder.add(np.zeros((20, 31, 3), np.uint8), is_duplicate=False, here_from_previous=None)
