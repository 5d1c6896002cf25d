"""The difference detectors in drawn worlds: a court with texture, a small ball, a player with a shadow, and noise."""

import numpy as np
import pytest
from scipy import ndimage

from pgm_models.image_detections import centres_of
from pgm_models.image_differences import (
    find_ball,
    find_change,
    find_player,
    median_background,
    median_frames,
    moved_aside,
)

HEIGHT, WIDTH = 288, 400
NOISE = 0.008


def court(seed: int = 0, height: int = HEIGHT, width: int = WIDTH) -> np.ndarray:
    """A court of uneven colour with a white line."""
    rng = np.random.default_rng(seed)
    texture = ndimage.gaussian_filter(rng.normal(0, 0.3, (height, width)), 2)
    picture = np.array([0.5, 0.32, 0.2])[:, None, None] * (1 + texture)
    picture[:, height // 2 : height // 2 + 2] = 0.85
    return np.clip(picture, 0, 1).astype(np.float32)


def disc(picture: np.ndarray, centre: tuple[float, float], radius: float, colour: float) -> np.ndarray:
    """The picture with a disc in it, its edge pixels covered in part."""
    steps = (np.arange(8) + 0.5) / 8 - 0.5
    made = picture.copy()
    top, left = (max(0, int(place - radius) - 2) for place in (centre[1], centre[0]))
    window = made[:, top : int(centre[1] + radius) + 3, left : int(centre[0] + radius) + 3]
    rows, columns = top + np.arange(window.shape[1]), left + np.arange(window.shape[2])
    inside = [
        (columns[None] + x - centre[0]) ** 2 + (rows[:, None] + y - centre[1]) ** 2 <= radius**2
        for x in steps
        for y in steps
    ]
    share = np.mean(inside, axis=0)
    window[:] = window * (1 - share) + colour * share
    return made


def noisy(picture: np.ndarray, seed: int) -> np.ndarray:
    """With the noise of a camera."""
    return np.clip(picture + np.random.default_rng(seed).normal(0, NOISE, picture.shape), 0, 1).astype(np.float32)


def with_player(picture: np.ndarray, left: int, top: int, unit: int = 1) -> np.ndarray:
    """The picture with a player 14 px wide and 50 px high, and the shadow he throws to the right."""
    made = picture.copy()
    foot = top + 50 * unit
    made[:, foot - 5 * unit : foot, left + 10 * unit : left + 60 * unit] *= 0.55
    made[:, top : top + 12 * unit, left + 4 * unit : left + 10 * unit] = np.array([0.8, 0.6, 0.5])[:, None, None]
    made[:, top + 12 * unit : foot, left : left + 14 * unit] = np.array([0.1, 0.15, 0.5])[:, None, None]
    return made


def centre(boxes: np.ndarray) -> np.ndarray:
    """Of the only box."""
    assert boxes.shape == (1, 4)
    return centres_of(boxes)[0]


@pytest.mark.parametrize("place", [(100.0, 90.0), (203.4, 60.7), (150.3, 145.2), (2.2, 3.1), (397.6, 286.0)])
def test_a_small_ball_is_found_to_parts_of_a_pixel(place):
    picture = noisy(disc(court(), place, 1.2, 0.9), 1)
    found = centre(find_ball(picture, court(), np.array(place) + [1.5, -1.0]))
    # On a line, as white as itself, less of it is seen.
    assert np.hypot(*(found - place)) < 1.0


def test_without_a_ball_there_is_none():
    places = np.random.default_rng(2).uniform([20, 20], [380, 268], (25, 2))
    picture = noisy(court(), 3)
    assert sum(len(find_ball(picture, court(), place)) for place in places) == 0


def test_a_ball_outside_the_search_radius_is_not_found():
    picture = noisy(disc(court(), (120.0, 90.0), 1.2, 0.9), 4)
    assert len(find_ball(picture, court(), np.array([127.5, 90.0]))) == 0
    assert len(find_ball(picture, court(), np.array([125.0, 90.0]))) == 1


def test_a_ball_is_told_from_a_large_bright_thing_beside_it():
    picture = court()
    picture[:, 80:130, 106:130] = 0.95
    picture = noisy(disc(picture, (100.0, 90.0), 1.2, 0.8), 5)
    assert np.hypot(*(centre(find_ball(picture, court(), np.array([101.0, 90.0]))) - [100.0, 90.0])) < 0.7
    # Without the ball the large thing's edge is not taken for one.
    empty = court()
    empty[:, 80:130, 106:130] = 0.95
    assert len(find_ball(noisy(empty, 5), court(), np.array([101.0, 100.0]))) == 0


def test_the_middle_of_a_streak_is_found():
    picture = court()
    for x in np.linspace(-3, 3, 13):
        picture = np.maximum(picture, disc(court(), (200.0 + x, 100.0 + 0.3 * x), 1.2, 0.75))
    found = find_ball(noisy(picture, 6), court(), np.array([200.0, 100.0]))
    assert np.hypot(*(centre(found) - [200.0, 100.0])) < 1.5
    width, height = (found[0, 2:] - found[0, :2]).tolist()
    assert width > height


def test_a_missing_place_or_one_outside_the_picture_has_no_ball():
    picture = noisy(disc(court(), (100.0, 90.0), 1.2, 0.9), 7)
    for place in ([np.nan, np.nan], [-500.0, 90.0], [100.0, 9_000.0]):
        assert find_ball(picture, court(), np.array(place)).shape == (0, 4)


def test_lengths_grow_with_the_picture():
    small, large = court(), court(0, 2 * HEIGHT, 2 * WIDTH)
    a = find_ball(disc(small, (100.0, 90.0), 1.5, 0.9), small, np.array([104.0, 90.0]))
    b = find_ball(disc(large, (200.5, 180.5), 3.0, 0.9), large, np.array([208.5, 180.5]))
    np.testing.assert_allclose((centre(b) + 0.5) / 2 - 0.5, centre(a), atol=0.2)


def test_a_player_is_found_without_his_shadow():
    picture = noisy(with_player(court(), 150, 160), 8)
    box = np.array([150.0, 160.0, 163.0, 209.0])
    found = find_player(picture, court(), box + [3.0, -2.0, 3.0, -2.0])
    assert found.shape == (1, 4)
    np.testing.assert_allclose(found[0], box, atol=2.0)


def test_where_nobody_is_nobody_is_found():
    box = np.array([150.0, 110.0, 164.0, 160.0])
    assert find_player(noisy(court(), 9), court(), box).shape == (0, 4)
    # Nor is one who stands in the background too.
    there = with_player(court(), 150, 110)
    assert find_player(noisy(there, 9), there, box).shape == (0, 4)


def test_a_shadow_alone_is_nobody():
    shade = court()
    shade[:, 120:150, 120:180] *= 0.6
    assert find_player(noisy(shade, 10), court(), np.array([130.0, 110.0, 150.0, 160.0])).shape == (0, 4)


def test_a_player_with_no_box_or_outside_the_picture_is_not_looked_for():
    picture = with_player(court(), 150, 110)
    for box in ([np.nan] * 4, [600.0, 10.0, 620.0, 60.0], [10.0, -90.0, 20.0, -40.0]):
        assert find_player(picture, court(), np.array(box)).shape == (0, 4)


def test_the_median_of_pictures_of_a_moving_player_is_the_court():
    pictures = [noisy(with_player(court(), 20 + 30 * k, 160), k) for k in range(11)]
    background = median_background(pictures)
    assert np.abs(background - court()).max() < 6 * NOISE
    found = find_player(pictures[4], background, np.array([140.0, 160.0, 153.0, 209.0]))
    np.testing.assert_allclose(centre(found), [146.5, 184.5], atol=2.0)


def test_a_change_is_found_where_it_is_whatever_else_the_picture_shows():
    behind = with_player(court(), 90, 60)
    made = disc(behind, (97.3, 80.6), 1.2, 0.9)
    np.testing.assert_allclose(centre(find_change(made, behind)), [97.3, 80.6], atol=0.3)
    assert find_change(behind, behind).shape == (0, 4)


def test_a_faint_change_is_none():
    behind = np.full((3, 20, 20), 0.5, np.float32)
    assert find_change(disc(behind, (10.0, 10.0), 2.0, 0.52), behind).shape == (0, 4)
    assert find_change(disc(behind, (10.0, 10.0), 2.0, 0.56), behind).shape == (1, 4)


def test_frames_for_the_background_lie_about_the_frame_and_in_the_clip():
    for frame, frames in ((0, 1), (0, 500), (499, 500), (250, 500), (5, 40)):
        chosen = median_frames(frame, frames, window=101, most=21)
        assert chosen.min() >= 0
        assert chosen.max() < frames
        assert len(chosen) == len(set(chosen.tolist())) == min(21, frames)
        assert chosen.min() <= frame <= chosen.max()
        assert np.ptp(chosen) <= 100


def test_places_moved_aside_lie_as_far_away_as_asked():
    places = np.random.default_rng(0).uniform(0, 100, (5, 2))
    aside = moved_aside(places, 14.0, np.random.default_rng(1))
    np.testing.assert_allclose(np.linalg.norm(aside - places, axis=1), 14.0)
    assert np.isnan(moved_aside(np.full((1, 2), np.nan), 14.0, np.random.default_rng(1))).all()


def test_colours_of_another_range_are_refused():
    picture = court()
    for function, place in ((find_ball, np.array([5.0, 5.0])), (find_player, np.array([5.0, 5.0, 9.0, 9.0]))):
        with pytest.raises(ValueError, match="picture: expected colours from 0 to 1"):
            function(picture * 2 - 1, picture, place)
        with pytest.raises(ValueError, match="background: expected colours from 0 to 1"):
            function(picture, picture * 255, place)
    with pytest.raises(ValueError, match="background: picture 1"):
        median_background([picture, picture * 255])
    with pytest.raises(ValueError, match="expected at least one"):
        median_background([])
