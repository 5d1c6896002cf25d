"""The clock of a video and how its shots follow each other."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pgm_data.simulate.broadcast import REPEAT_EVERY, Clock
from pgm_data.simulate.shots import later, until
from pgm_data.simulate.states import BallEvent, BallFlight, Caption, ShotStates


@given(fps=st.floats(1.0, 240.0), frames=st.integers(1, 200), groups=st.integers(0, 20))
def test_repeats_have_their_sources_capture_time_and_the_others_are_evenly_spaced(fps, frames, groups) -> None:
    clock = Clock(fps=fps, repeats=True)
    span = clock.span(groups * REPEAT_EVERY, frames)
    for i in np.flatnonzero(span.is_duplicate):
        assert i % REPEAT_EVERY == REPEAT_EVERY - 1
        assert span.capture_times[i] == span.capture_times[i - 1]
    taken = span.capture_times[~span.is_duplicate]
    np.testing.assert_allclose(np.diff(taken), 1.2 / fps, rtol=1e-6)
    np.testing.assert_allclose(np.diff(span.timestamps), 1.0 / fps, rtol=1e-6)


@given(seconds=st.floats(0.0, 100.0), fps=st.floats(1.0, 240.0), repeats=st.booleans())
def test_a_shot_has_a_frame_at_least_and_never_begins_with_a_repeat(seconds, fps, repeats) -> None:
    clock = Clock(fps=fps, repeats=repeats)
    frames = clock.frames_of(seconds)
    assert frames >= 1
    assert not clock.span(frames, 1).is_duplicate[0]


def test_without_repeats_pictures_are_taken_when_they_are_shown() -> None:
    span = Clock(fps=50.0, repeats=False).span(7, 5)
    np.testing.assert_array_equal(span.capture_times, span.timestamps)
    assert not span.is_duplicate.any()


def _states() -> ShotStates:
    events = tuple(
        BallEvent(time=t, kind=k, player="", position=np.zeros(3))
        for t, k in ((0.5, "first"), (1.0, "bounce"), (2.0, "last"))
    )
    flights = tuple(
        BallFlight(
            start_event=i,
            end_event=i + 1,
            player="",
            start_speed=1.0,
            spin=np.zeros(3),
            drag_per_m=0.02,
            landing=np.full(3, np.nan),
            lands_in=None,
        )
        for i in (0, 1)
    )
    captions = tuple(Caption(player=0, start_s=a, end_s=b, texts=("stands",)) for a, b in ((0.0, 1.2), (1.2, 2.5)))
    return ShotStates(players=(), ball=None, events=events, flights=flights, captions=captions)


def test_what_happens_after_the_last_frame_is_not_told() -> None:
    cut = until(_states(), 1.1)
    assert [e.kind for e in cut.events] == ["first", "bounce"]
    assert [(f.start_event, f.end_event) for f in cut.flights] == [(0, 1)]
    assert cut.captions == ()
    assert [c.end_s for c in until(_states(), 1.3).captions] == [1.2]


def test_a_later_clock_moves_events_and_captions_alike() -> None:
    moved = later(_states(), 10.0)
    assert [e.time for e in moved.events] == [10.5, 11.0, 12.0]
    assert moved.captions[1].start_s == pytest.approx(11.2)
