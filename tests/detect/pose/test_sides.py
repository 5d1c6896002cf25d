"""Left and right keep to their sides over time, and a body that truly turns or crosses its legs is left alone."""

from itertools import product

import numpy as np
import pytest

from pgm_data.detect.pose.model import COCO_POINTS, mirrored
from pgm_data.detect.pose.sides import _likeliest, swapped_points
from tests.detect.pose.marked_bodies import BODY

PARTNER = mirrored(COCO_POINTS)
LEGS = np.array([name.endswith(("hip", "knee", "ankle")) for name in COCO_POINTS])
SIDED = PARTNER != np.arange(17)


def walk(frames: int, seed: int = 0) -> np.ndarray:
    """Points of a body 200 px high that runs across the picture, with 1 px of noise."""
    rng = np.random.default_rng(seed)
    points = BODY * [100, 200] + np.arange(frames)[:, None, None] * [6.0, 1.0]
    return points + rng.normal(0, 1.0, points.shape)


def swapped(points: np.ndarray, chance: float = 0.03, rate: float = 25.0) -> np.ndarray:
    frames = len(points)
    return swapped_points(points, np.full(frames, 200.0), np.arange(frames) / rate, COCO_POINTS, chance=chance)


def exchange(points: np.ndarray, frames: list[int], which: np.ndarray) -> np.ndarray:
    out = points.copy()
    for frame in frames:
        out[frame, which] = points[frame, PARTNER[which]]
    return out


@pytest.mark.parametrize(
    ("part", "frames"),
    [
        *((part, frames) for part in ("all", "legs", "upper") for frames in ([7], [4, 5, 6, 12])),
        *(("all", frames) for frames in ([0], [0, 1], [18, 19])),
    ],
)
def test_swapped_frames_are_found_whole_or_in_part(part: str, frames: list[int]) -> None:
    which = np.flatnonzero(SIDED & {"all": LEGS | True, "legs": LEGS, "upper": ~LEGS}[part])
    found = swapped(exchange(walk(20), frames, which))
    expected = np.zeros((20, 17), bool)
    expected[np.ix_(frames, which)] = True
    np.testing.assert_array_equal(found, expected)


def test_nothing_is_swapped_where_the_network_is_believed_or_nothing_is_wrong() -> None:
    assert not swapped(walk(30)).any()
    assert not swapped(exchange(walk(20), [7], np.flatnonzero(SIDED)), chance=0.0).any()
    assert not swapped(walk(1)).any()
    assert not swapped(np.full((5, 17, 2), np.nan)).any()
    assert swapped(np.zeros((0, 17, 2))).shape == (0, 17)


def test_a_body_that_turns_round_and_legs_that_cross_are_left_alone() -> None:
    turn = np.cos(np.linspace(0, np.pi, 40))[:, None]
    points = walk(40)
    middle = points[..., 0].mean(axis=1, keepdims=True)
    points[..., 0] = middle + (BODY[:, 0] - 0.5) * 100 * turn
    assert not swapped(points).any()
    points = walk(40)
    swing = 30 * np.sin(np.linspace(0, 4 * np.pi, 40))
    points[:, [13, 15], 0] = middle + swing[:, None]
    points[:, [14, 16], 0] = middle - swing[:, None]
    assert not swapped(points).any()


def test_gaps_and_missing_points_do_not_matter() -> None:
    points = exchange(walk(30), [10, 11], np.flatnonzero(SIDED))
    points[5:9] = np.nan
    points[:, 9] = np.nan
    found = swapped(points)
    assert np.flatnonzero(found.any(axis=1)).tolist() == [10, 11]


def test_the_course_agrees_with_going_through_all_of_them() -> None:
    rng = np.random.default_rng(4)
    step, first = rng.exponential(size=(5, 3, 3)), rng.exponential(size=3)
    costs = {
        way: first[way[0]] + sum(step[i, a, b] for i, (a, b) in enumerate(zip(way, way[1:], strict=False)))
        for way in product(range(3), repeat=6)
    }
    assert tuple(_likeliest(step, first)) == min(costs, key=lambda way: costs[way])
