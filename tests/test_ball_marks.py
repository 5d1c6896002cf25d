import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pgm_data.ball import EVENT_KINDS, BallEvents, no_events
from pgm_data.ball_marks import merge_events


def events(*rows, source="detected"):
    times, kinds, players = zip(*((*row, "")[:3] for row in sorted(rows)), strict=True)
    return BallEvents(
        times=np.array(times, dtype=float),
        kinds=np.array(kinds, dtype=object),
        probability=np.full(len(rows), 1.0 if source == "human" else 0.7),
        time_std=np.full(len(rows), 0.01),
        sources=np.full(len(rows), source, dtype=object),
        players=np.array(players, dtype=object),
        ground_px=np.full((len(rows), 2), np.nan),
    )


def shown(merged):
    return list(zip(merged.times.tolist(), merged.kinds, merged.sources, merged.players, strict=True))


def test_human_contacts_take_the_place_of_detected_ones_near_them():
    detected = events((1.0, "hit", "player0"), (2.0, "bounce"), (2.2, "hit", "player1"), (3.0, "net"))
    human = events((2.05, "net"), (1.06, "hit"), source="human")
    assert shown(merge_events(detected, human, within_s=0.08)) == [
        (1.06, "hit", "human", "player0"),
        (2.05, "net", "human", ""),
        (2.2, "hit", "detected", "player1"),
        (3.0, "net", "detected", ""),
    ]


def test_a_bound_takes_the_place_of_bounds_alone_and_stands_before_its_contact():
    detected = events((1.0, "first"), (1.0, "hit"), (5.0, "last"))
    merged = merge_events(detected, events((1.0, "first"), source="human"), within_s=0.08)
    assert [row[1:3] for row in shown(merged)] == [("first", "human"), ("hit", "detected"), ("last", "detected")]


def test_a_complete_list_removes_its_kinds_everywhere():
    detected = events((1.0, "hit"), (2.0, "bounce"), (3.0, "hit"))
    merged = merge_events(detected, events((1.0, "hit"), source="human"), within_s=0.08, complete_kinds=True)
    assert [row[:3] for row in shown(merged)] == [(1.0, "hit", "human"), (2.0, "bounce", "detected")]


ROWS = st.lists(st.tuples(st.floats(0, 3), st.sampled_from(EVENT_KINDS)), min_size=1, max_size=12)


@given(ROWS, ROWS, st.floats(0, 0.5))
def test_merging_keeps_all_marks_adds_nothing_and_twice_is_once(found, marked, within):
    detected, human = events(*found), events(*marked, source="human")
    merged = merge_events(detected, human, within_s=within)
    assert (merged.sources == "human").sum() == len(human)
    assert len(merged) <= len(detected) + len(human)
    assert shown(merge_events(merged, human, within_s=within)) == shown(merged)


def test_without_marks_nothing_changes_and_a_bad_window_is_refused():
    detected = events((1.0, "hit"))
    assert merge_events(detected, no_events(), within_s=0.08) is detected
    with pytest.raises(ValueError, match="within_s"):
        merge_events(detected, detected, within_s=float("nan"))
