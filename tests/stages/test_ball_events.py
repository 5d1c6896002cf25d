"""Detected bounds of plays give way to contacts that a person marked."""

import numpy as np
import pytest

from pgm_data.ball import BallEvents
from pgm_data.stages.ball_events import LONGEST_FLIGHT_S, within_play

HUMAN, FOUND = "human", "detected"


def events(*rows: tuple[float, str, str]) -> BallEvents:
    count = len(rows)
    return BallEvents(
        times=np.array([time for time, _, _ in rows], dtype=float),
        kinds=np.array([kind for _, kind, _ in rows], dtype=object),
        probability=np.ones(count),
        time_std=np.full(count, 0.01),
        sources=np.array([source for _, _, source in rows], dtype=object),
        players=np.full(count, "", dtype=object),
        ground_px=np.full((count, 2), np.nan),
    )


@pytest.mark.parametrize("late", [0.04, 2.5])
def test_a_play_begins_and_ends_with_the_marked_hits_beside_its_detected_bounds(late: float):
    found = within_play(
        events(
            (0.0, "hit", HUMAN),
            (late, "first", FOUND),
            (late + 0.5, "bounce", FOUND),
            (late + 0.6, "last", FOUND),
            (late + 0.7, "hit", HUMAN),
        )
    )
    assert list(found.kinds) == ["hit", "bounce", "hit"]


def test_bounds_far_from_a_marked_contact_or_on_its_other_side_stay():
    rows = events(
        (0.0, "first", FOUND),
        (0.0, "hit", HUMAN),
        (1.0, "last", FOUND),
        (1.0 + 2 * LONGEST_FLIGHT_S, "hit", HUMAN),
        (1.0 + 4 * LONGEST_FLIGHT_S, "first", FOUND),
    )
    assert list(within_play(rows).kinds) == list(rows.kinds)


def test_a_marked_contact_between_two_plays_joins_the_nearer_one():
    rows = ((0.0, "hit", HUMAN), (1.0, "last", FOUND), (1.1, "hit", HUMAN), (3.0, "first", FOUND), (4.0, "hit", FOUND))
    assert list(within_play(events(*rows)).times) == [0.0, 1.1, 3.0, 4.0]


def test_bounds_that_a_person_marked_stay():
    rows = events((0.0, "hit", HUMAN), (0.1, "first", HUMAN), (1.0, "last", HUMAN), (1.1, "hit", HUMAN))
    assert list(within_play(rows).times) == list(rows.times)


def test_no_event_and_one_event_pass():
    assert len(within_play(events())) == 0
    assert len(within_play(events((0.0, "hit", HUMAN)))) == 1
