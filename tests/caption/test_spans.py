"""Spans tile the time that is known, are of lengths that people write about, and keep a stroke whole."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from pgm_data.caption.spans import Cuts, SpanOptions, cut

OPTIONS = SpanOptions()


@given(
    seconds=st.floats(0.2, 30.0),
    moments=st.lists(st.tuples(st.floats(0.0, 30.0), st.floats(0.0, 3.0)), max_size=25),
    hits=st.lists(st.floats(0.0, 30.0), max_size=5),
)
def test_spans_tile_the_time_and_are_neither_too_short_nor_too_long(seconds, moments, hits):
    times = np.array([time for time, _ in moments])
    worth = np.array([value for _, value in moments])
    spans = cut(0.0, seconds, Cuts(times=times, worth=worth), np.sort(np.array(hits)), OPTIONS)
    assert spans[0][0] == 0.0 and spans[-1][1] == seconds
    assert all(one[1] == two[0] for one, two in zip(spans[:-1], spans[1:], strict=True))
    lengths = np.array([end - start for start, end in spans])
    if seconds >= 2 * OPTIONS.shortest_s:
        assert lengths.min() >= OPTIONS.shortest_s - 1e-9 and lengths.max() <= OPTIONS.longest_s + 1e-9


def test_a_cut_is_where_something_happens_and_not_within_a_stroke():
    cuts = Cuts(times=np.array([1.3, 2.0, 2.25]), worth=np.array([1.0, 0.7, 2.5]))
    ends = {end for _, end in cut(0.0, 4.0, cuts, np.array([2.0]), OPTIONS)}
    assert 2.25 in ends
    assert not any(1.5 < end < 2.2 for end in ends)


def test_two_own_hits_are_told_apart():
    spans = cut(0.0, 4.0, Cuts(times=np.zeros(0), worth=np.zeros(0)), np.array([1.0, 2.4]), OPTIONS)
    assert not any(start <= 1.0 and 2.4 < end for start, end in spans)
