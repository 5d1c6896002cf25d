"""Repeated pictures and the times when pictures were taken."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pgm_data.repeats import LEAST_STEP, RepeatOptions, capture_times, is_repeat, local_change


def shown_as(source_fps: float, shown_fps: float, count: int, phase: float = 0.3) -> tuple[np.ndarray, np.ndarray]:
    """Presentation times and repeats of a converted frame rate: each slot shows the newest picture there is."""
    slots = np.arange(count)
    picture = np.floor(slots * source_fps / shown_fps + phase).astype(int)
    return slots / shown_fps, np.diff(picture, prepend=picture[0] - 1) == 0


def test_a_ball_of_two_pixels_counts_as_change_and_lone_pixels_do_not() -> None:
    picture = np.full((270, 480), 90, np.uint8)
    ball = picture.copy()
    for top in (0, 31, 32, 63, 268):
        moved = picture.copy()
        moved[top : top + 2, 200:202] = 200
        assert local_change(moved, picture) == 110
    ball[100:160:7, 100:400:11] = 200
    assert local_change(ball, picture) == 0
    assert local_change(picture, picture) == 0
    with pytest.raises(ValueError, match=r"expected the size of the frame before, \(270, 480\)"):
        local_change(picture[1:], picture)


def test_local_change_equals_the_slow_obvious_loop() -> None:
    random = np.random.default_rng(0)
    for shape in [(70, 40), (33, 5), (32, 32), (2, 2)]:
        one, other = random.integers(60, 160, (2, *shape)).astype(np.uint8)
        difference = np.abs(one.astype(int) - other)
        slow = max(difference[y : y + 2, x : x + 2].min() for y in range(shape[0] - 1) for x in range(shape[1] - 1))
        edge = max(difference[0].max(), difference[:, 0].max())
        assert slow <= local_change(one, other) <= max(slow, edge)


def test_noise_of_a_calm_scene_is_no_repeat() -> None:
    options = RepeatOptions()
    calm = np.random.default_rng(1).uniform(12, 30, 15)
    assert not any(is_repeat(calm, at, options) for at in range(15))
    repeating = np.where(np.arange(15) % 6 == 2, 14.0, 120.0)
    assert [at for at in range(15) if is_repeat(repeating, at, options)] == [2, 8, 14]
    # A long quiet stretch after a busy one is a still.
    still = np.array([120.0] * 7 + [9.0] * 8)
    assert not any(is_repeat(still, at, options) for at in range(15))
    # Coding again never changes that much.
    assert not any(is_repeat(repeating * 4, at, options) for at in range(15))


@pytest.mark.parametrize(
    ("source_fps", "shown_fps"), [(25, 30), (50, 60), (24, 60), (30, 60), (24, 30), (15, 60), (50, 59.94), (24, 25)]
)
def test_converted_frame_rates_get_their_even_capture_times_back(source_fps: float, shown_fps: float) -> None:
    times, is_duplicate = shown_as(source_fps, shown_fps, 240)
    taken = capture_times(times, is_duplicate)
    spacing = np.diff(taken[~is_duplicate])
    np.testing.assert_allclose(spacing, 1 / source_fps, rtol=2e-3)
    assert np.ptp(spacing) < 1e-9
    assert (taken[is_duplicate] == taken[np.flatnonzero(is_duplicate) - 1]).all()
    assert np.abs(taken - times).max() < 1.01 / source_fps


def test_without_repeats_pictures_are_taken_when_shown() -> None:
    times = np.cumsum(np.random.default_rng(0).uniform(0.01, 0.1, 50))
    assert (capture_times(times, np.zeros(50, bool)) == times).all()
    assert capture_times(np.array([3.0]), np.array([True])).tolist() == [3.0]
    assert capture_times(np.zeros(0), np.zeros(0, bool)).shape == (0,)


def test_stray_repeats_change_no_other_time() -> None:
    times = np.arange(200) / 50
    is_duplicate = np.zeros(200, bool)
    is_duplicate[[20, 23, 150]] = True
    taken = capture_times(times, is_duplicate)
    assert (taken[~is_duplicate] == times[~is_duplicate]).all()
    assert (taken[is_duplicate] == times[[19, 22, 149]]).all()


def test_a_missed_repeat_costs_only_its_surroundings() -> None:
    times, is_duplicate = shown_as(25, 30, 600)
    missed = is_duplicate.copy()
    missed[np.flatnonzero(is_duplicate)[50]] = False
    spacing = np.diff(capture_times(times, missed)[~missed])
    assert (np.abs(spacing * 25 - 1) < 0.01).mean() > 0.95
    assert spacing.min() >= LEAST_STEP / 30 - 1e-12


def test_a_shot_may_change_from_plain_to_converted() -> None:
    times, is_duplicate = shown_as(25, 30, 300)
    is_duplicate[:120] = False
    spacing = np.diff(capture_times(times, is_duplicate)[~is_duplicate])
    np.testing.assert_allclose(spacing[:90], 1 / 30, rtol=1e-6)
    np.testing.assert_allclose(spacing[-100:], 1 / 25, rtol=5e-3)


@given(st.lists(st.tuples(st.integers(0, 2000), st.booleans()), max_size=60))
def test_capture_times_never_go_back_and_repeats_carry_their_sources(steps: list[tuple[int, bool]]) -> None:
    times = np.cumsum([step for step, _ in steps]) / 1000.0
    is_duplicate = np.array([flag for _, flag in steps], bool)
    taken = capture_times(times, is_duplicate)
    assert taken.shape == times.shape and np.isfinite(taken).all()
    assert (np.diff(taken) >= 0).all()
    for at in range(1, len(steps)):
        if is_duplicate[at]:
            assert taken[at] == taken[at - 1]


def test_times_that_go_back_are_refused() -> None:
    for times in ([0.0, 1.0, 0.5], [0.0, np.nan, 1.0]):
        with pytest.raises(ValueError, match="timestamps: expected finite times that do not go back"):
            capture_times(np.array(times), np.zeros(3, bool))
