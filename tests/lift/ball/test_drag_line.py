import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import lambertw

from pgm_data.lift.ball.drag_line import (
    distance_at,
    drag_of,
    drag_slopes,
    loss_of,
    share_of_free,
    speed_after,
    speed_at,
    start_speed,
    travelled,
)

mpmath.mp.dps = 50
DRAGS = (0.0, 1e-300, 1e-16, 1e-12, 1e-8, 1e-5, 1e-3, 0.0203, 0.127, 1.0, 12.0, 40.0)
SHARES = (0.0, 1e-300, 1e-12, 1e-6, 0.01, 0.3, 0.5, 0.999, 1.0, 1.7)

drags = st.floats(0.0, 50.0)
lengths = st.floats(1e-3, 60.0)
spans = st.floats(1e-3, 40.0)


def exact_distance(share: float, L: float, C: float) -> mpmath.mpf:
    """50 digits, from dv/dt = -C v^2."""
    share_, L_, C_ = mpmath.mpf(share), mpmath.mpf(L), mpmath.mpf(C)
    return share_ * L_ if C == 0 else mpmath.log1p(mpmath.expm1(C_ * L_) * share_) / C_


@pytest.mark.parametrize("C", DRAGS)
def test_distance_and_speed_are_those_of_fifty_digits(C):
    for L in (1e-3, 24.0, 1000.0):
        far, fast = distance_at(2.0 * np.array(SHARES), L, 2.0, C), speed_at(2.0 * np.array(SHARES), L, 2.0, C)
        for share, distance, speed in zip(SHARES, far, fast, strict=True):
            with mpmath.workdps(350):
                exact = exact_distance(share, L, C)
                growth = mpmath.expm1(mpmath.mpf(C) * L)
                rate = mpmath.mpf(L) if C == 0 else growth / mpmath.mpf(C) / (1 + growth * mpmath.mpf(share))
            assert distance == pytest.approx(float(exact), rel=1e-13, abs=1e-300)
            assert speed == pytest.approx(float(rate / 2), rel=1e-12)


@settings(max_examples=50)
@given(C=drags, L=lengths, T=spans, share=st.floats(0, 1))
def test_a_ball_is_at_its_ends_on_time_and_never_goes_back(C, L, T, share):
    assert distance_at(0.0, L, T, C) == 0
    assert distance_at(T, L, T, C) == pytest.approx(L, rel=1e-12)
    near, far = distance_at(np.array([share, min(share + 1e-3, 1.0)]) * T, L, T, C)
    assert near <= far * (1 + 1e-12) <= L * (1 + 1e-11)


@settings(max_examples=50)
@given(C=st.floats(1e-6, 2.0), L=st.floats(0.1, 30.0), T=st.floats(0.05, 5.0), share=st.floats(0, 1))
def test_the_speed_is_the_rate_of_the_distance_and_drag_takes_its_square(C, L, T, share):
    t, h = share * T, 1e-5 * T
    rate = (distance_at(t + h, L, T, C) - distance_at(max(t - h, 0.0), L, T, C)) / (h + min(h, t))
    v = speed_at(t, L, T, C)
    tolerance = 1e-4 + 4 * C * v * h
    assert rate == pytest.approx(v, rel=tolerance)
    slower = speed_after(0.01 * T, v, C)
    assert 1 / slower - 1 / v == pytest.approx(C * 0.01 * T, rel=1e-6)


@settings(max_examples=50)
@given(C=st.floats(0.0, 2.0), L=st.floats(0.1, 30.0), T=st.floats(0.05, 5.0), share=st.floats(0, 1))
def test_the_two_forms_agree(C, L, T, share):
    v0 = start_speed(L, T, C)
    assert v0 == pytest.approx(speed_at(0.0, L, T, C), rel=1e-12)
    assert travelled(share * T, v0, C) == pytest.approx(distance_at(share * T, L, T, C), rel=1e-10, abs=1e-300)
    assert speed_after(share * T, v0, C) == pytest.approx(speed_at(share * T, L, T, C), rel=1e-10)


def test_past_overflow_only_the_end_and_the_logarithm_of_the_share_count():
    L, C = 1000.0, 50.0
    assert distance_at(0.5, L, 1.0, C) == pytest.approx(L + np.log(0.5) / C, rel=1e-15)
    assert distance_at(0.0, L, 1.0, C) == 0
    assert distance_at(1.0, L, 1.0, C) == L
    assert speed_at(1.0, L, 1.0, C) == pytest.approx(1 / C, rel=1e-12)
    assert np.isinf(start_speed(L, 1.0, C))


def test_nothing_moves_over_no_length_and_a_frame_is_long_enough():
    assert distance_at(0.3, 0.0, 1.0, 0.02) == 0
    assert speed_at(0.3, 0.0, 1.0, 0.02) == 0
    assert distance_at(1 / 240 / 2, 0.2, 1 / 240, 0.0203) == pytest.approx(0.1, rel=2e-3)


def test_float32_comes_out_as_float64_would():
    t, L, T, C = (np.array([x], dtype=np.float32) for x in (0.001, 24.0, 1.0, 1e-8))
    wide = distance_at(*(x.astype(np.float64) for x in (t, L, T, C)))
    narrow = distance_at(t, L, T, C)
    assert narrow.dtype == np.float64
    np.testing.assert_array_equal(narrow, wide)


@pytest.mark.parametrize(
    "call",
    [
        lambda: distance_at(0.1, 1.0, 0.0, 0.02),
        lambda: distance_at(0.1, 1.0, -1.0, 0.02),
        lambda: distance_at(0.1, -1.0, 1.0, 0.02),
        lambda: distance_at(0.1, 1.0, 1.0, -0.02),
        lambda: distance_at(-1.0, 100.0, 1.0, 0.02),
        lambda: speed_at(-1.0, 2000.0, 1.0, 1.0),
        lambda: travelled(-2.0, 30.0, 0.02),
        lambda: speed_after(-2.0, 30.0, 0.02),
        lambda: share_of_free(10.0, 0.0, 1.0),
        lambda: share_of_free(10.0, 30.0, 0.0),
    ],
)
def test_what_cannot_be_is_refused(call):
    with pytest.raises(ValueError, match="drag line: "):
        call()


def test_a_little_before_the_start_it_comes_from_behind():
    assert travelled(-0.1, 30.0, 0.02) < -3.0
    assert distance_at(-0.1, 30.0, 1.0, 0.02) < -3.0


def exact_loss(q: float) -> mpmath.mpf:
    """u > 0 of log1p(u) = q u by Lambert's W on 60 digits: u = -1 - W_-1(-q exp(-q)) / q."""
    with mpmath.workdps(60):
        q_ = mpmath.mpf(q)
        return -1 - mpmath.lambertw(-q_ * mpmath.exp(-q_), -1).real / q_


@settings(max_examples=60)
@given(q=st.one_of(st.floats(1e-6, 1 - 1e-9), st.floats(1e-14, 1e-3).map(lambda e: 1 - e)))
def test_the_loss_is_lamberts_wherever_q_tells_it(q):
    # q itself is rounded to 1e-16, which is all that is known of 1 - q.
    assert float(loss_of(q)) == pytest.approx(float(exact_loss(q)), rel=1e-13 + 2e-15 / (1 - q))


@pytest.mark.parametrize("C", (1e-3, 0.0203, 0.127, 1.0))
def test_the_drag_of_a_serve_is_that_of_the_closed_form(C):
    L, v, T = travelled(0.5, 50.0, C), 50.0, 0.5
    r = 1 / share_of_free(L, v, T)
    closed = (-1 - r * lambertw(-np.exp(-1 / r) / r, -1).real) / (v * T)
    assert drag_of(L, v, T) == pytest.approx(closed, rel=1e-7)
    assert drag_of(L, v, T) == pytest.approx(C, rel=1e-11)


@settings(max_examples=50)
@given(C=st.floats(1e-6, 2.0), v=st.floats(5.0, 80.0), T=st.floats(0.05, 3.0))
def test_drag_is_found_again_and_its_slopes_are_its_derivatives(C, v, T):
    L = float(travelled(T, v, C))
    assert drag_of(L, v, T) == pytest.approx(C, rel=1e-8 + 1e-14 / (C * v * T) ** 2, abs=1e-14 / (v * T))
    given_, slopes = np.array([L, v, T]), np.array(drag_slopes(L, v, T))
    for i in range(3):
        h = 1e-5 * given_[i] * min(1.0, C * v * T)
        step = np.where(np.arange(3) == i, h, 0.0)
        by = (drag_of(*(given_ + step)) - drag_of(*(given_ - step))) / (2 * h)
        assert by == pytest.approx(slopes[i], rel=1e-3)


def test_one_per_cent_of_speed_is_five_of_drag():
    """The notes' figures for a serve: 1 % of v0 gives 5.0 %, 10 cm of length 3.3 %, 20 ms 24 %."""
    C, v, T = 0.0203, 55.0, 0.4
    L = float(travelled(T, v, C))
    by_length, by_speed, by_time = drag_slopes(L, v, T)
    assert abs(by_speed) * 0.01 * v / C == pytest.approx(0.05, rel=0.2)
    assert abs(by_length) * 0.1 / C == pytest.approx(0.033, rel=0.4)
    assert abs(by_time) * 0.02 / C == pytest.approx(0.24, rel=0.2)


def test_no_drag_explains_a_ball_that_was_too_fast_and_none_one_that_never_left():
    assert drag_of(20.0, 40.0, 0.5) == 0
    assert drag_of(25.0, 40.0, 0.5) == 0
    assert np.isnan(drag_of(0.0, 40.0, 0.5))
    assert np.isnan(drag_of(-1.0, 40.0, 0.5))
