import cv2
import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from pgm_data.geometry.distortion import distort, fold_radius, undistort
from tests.geometry.opencv import undistorted

radial = st.floats(-2, 2, allow_subnormal=False)
directions = st.floats(0, 6.3, allow_subnormal=False)


def radial_map(r, k1, k2):
    return r * (1 + k1 * r**2 + k2 * r**4)


def first_turn(k1: float, k2: float) -> float:
    """The first turning point of the radial map: the roots of its slope, as numpy finds them."""
    roots = np.roots(np.trim_zeros(np.array([5 * k2, 3 * k1, 1.0]), "f"))
    real = roots[np.abs(roots.imag) < 1e-12 * np.abs(roots)].real
    return float(np.sqrt(min((s for s in real if s > 0), default=np.inf)))


@given(radial, radial)
@example(-0.3, 0.0)
@example(0.0, -0.3)
@example(0.0, 0.0)
@example(-0.5, 0.1)
@example(1.0, -1e-14)
@example(-1.0, 1e-14)
def test_the_fold_is_the_first_turning_point(k1, k2):
    disc = 9 * k1**2 - 20 * k2
    assume(abs(disc) > 1e-6 * (9 * k1**2 + 20 * abs(k2)) or (k1 == k2 == 0))  # a double root is ill-conditioned
    assume(k1 == 0 or abs(k1) > 1e-6)
    assume(k2 == 0 or abs(k2) > 1e-14)
    fold = fold_radius(np.float64(k1), np.float64(k2))
    np.testing.assert_allclose(fold, first_turn(k1, k2), rtol=1e-6)
    if np.isfinite(fold) and fold < 1e3:
        slope = 1 + 3 * k1 * fold**2 + 5 * k2 * fold**4
        assert abs(slope) < 1e-12 * (1 + 3 * abs(k1) * fold**2 + 5 * abs(k2) * fold**4)


def test_the_fold_follows_leading_axes():
    folds = fold_radius(np.array([0.0, -1 / 3, 1.0]), np.array([0.0, 0.0, 0.0]))
    np.testing.assert_array_equal(folds, [np.inf, 1.0, np.inf])


@given(radial, radial, st.floats(0, 0.995), directions)
def test_undistort_undoes_distort_up_to_the_fold(k1, k2, share, direction):
    fold = float(fold_radius(np.float64(k1), np.float64(k2)))
    r = share * min(fold, 3.0)
    xy = r * np.array([[np.cos(direction), np.sin(direction)]])
    k = np.array([k1, k2, 0.0, 0.0])
    slope = 1 + 3 * k1 * r**2 + 5 * k2 * r**4
    assume(slope > 1e-3)
    np.testing.assert_allclose(undistort(distort(xy, k), k), xy, atol=1e-12 / slope)


@given(radial, radial, st.floats(0, 1.0), directions)
def test_distort_undoes_undistort_on_all_that_the_lens_can_show(k1, k2, share, direction):
    fold = float(fold_radius(np.float64(k1), np.float64(k2)))
    edge = radial_map(min(fold, 3.0), k1, k2) * (1 - 1e-12)
    xy = share * edge * np.array([[np.cos(direction), np.sin(direction)]])
    k = np.array([k1, k2, 0.0, 0.0])
    np.testing.assert_allclose(distort(undistort(xy, k), k), xy, atol=1e-13 * (1 + edge))


@given(
    st.floats(-0.3, 0.3),
    st.floats(0, 0.1),
    st.floats(-0.01, 0.01),
    st.floats(-0.01, 0.01),
    arrays(np.float64, (5, 2), elements=st.floats(-0.5, 0.5)),
)
def test_tangential_terms_are_undone_too(k1, k2, p1, p2, xy):
    k = np.array([k1, k2, p1, p2])
    np.testing.assert_allclose(undistort(distort(xy, k), k), xy, atol=1e-12)


@given(
    arrays(np.float64, 4, elements=st.floats(-0.05, 0.05)),
    arrays(np.float64, (5, 2), elements=st.floats(-0.6, 0.6)),
)
def test_distort_agrees_with_opencv(k, xy):
    points = np.concatenate([xy, np.ones((5, 1))], axis=1)
    expected, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), np.eye(3), k)
    np.testing.assert_allclose(distort(xy, k), expected[:, 0], atol=1e-13)


@given(
    arrays(np.float64, 4, elements=st.floats(-0.05, 0.05)),
    arrays(np.float64, (5, 2), elements=st.floats(-0.5, 0.5)),
)
def test_undistort_agrees_with_opencv(k, xy):
    np.testing.assert_allclose(undistort(xy, k), undistorted(xy, np.eye(3), k), atol=1e-9)


@pytest.mark.parametrize(("k1", "k2"), [(-0.3, 0.0), (-3.0, 0.0), (0.5, -0.4), (0.0, -1.0), (-1.0, 0.1)])
def test_past_the_fold_is_nan_and_never_a_second_image(k1, k2):
    k = np.array([k1, k2, 0.0, 0.0])
    fold = float(fold_radius(np.float64(k1), np.float64(k2)))
    beyond = fold * np.array([[1 + 1e-9, 0], [1.5, 0], [0, -3], [1e6, 1e6], [1e200, 0]])
    assert np.isnan(distort(beyond, k)).all()
    largest = radial_map(fold, k1, k2)
    assert np.isnan(undistort(largest * np.array([[1 + 1e-9, 0], [0, 2.0], [1e9, 0], [1e200, 0]]), k)).all()
    within = undistort(largest * np.array([[1 - 1e-9, 0], [0, 0.5]]), k)
    assert np.all(np.linalg.norm(within, axis=1) <= fold)


def test_no_distortion_changes_nothing_to_the_last_bit():
    xy = np.random.default_rng(0).normal(size=(50, 2)) * 10.0 ** np.arange(-25, 25)[:, None]
    np.testing.assert_array_equal(distort(xy, np.zeros(4)), xy)
    np.testing.assert_allclose(undistort(xy, np.zeros(4)), xy, rtol=1e-15)


def test_the_optical_axis_stays_where_it_is():
    for k in ([0.3, 0.1, 0.0, 0.0], [-0.3, 0.0, 0.01, -0.01]):
        np.testing.assert_array_equal(distort(np.zeros((1, 2)), np.array(k)), 0)
        np.testing.assert_array_equal(undistort(np.zeros((1, 2)), np.array(k)), 0)


def test_a_lens_per_camera_meets_one_set_of_points():
    k = np.array([[0.1, 0.0, 0.0, 0.0], [-0.1, 0.02, 0.001, 0.0], [0.0, 0.0, 0.0, 0.0]])
    xy = np.random.default_rng(1).uniform(-0.5, 0.5, (7, 2))
    together = distort(xy, k)
    assert together.shape == (3, 7, 2)
    for i in range(3):
        np.testing.assert_array_equal(together[i], distort(xy, k[i]))
        np.testing.assert_allclose(undistort(together, k)[i], xy, atol=1e-13)


def test_missing_points_and_missing_lenses_are_nan():
    xy = np.array([[np.nan, 0.1], [0.2, 0.1], [np.inf, 0.0]])
    for function in (distort, undistort):
        for k in (np.array([0.1, 0, 0, 0]), np.array([0.1, 0, 1e-3, 0])):
            result = function(xy, k)
            assert np.isnan(result[[0, 2]]).all(axis=-1).all()
            assert np.isfinite(result[1]).all()
        assert np.isnan(function(xy, np.full(4, np.nan))).all()


def test_empty_arrays_stay_empty():
    for function in (distort, undistort):
        assert function(np.zeros((0, 2)), np.array([0.1, 0, 1e-3, 0])).shape == (0, 2)
        assert function(np.zeros((0, 5, 2)), np.zeros((0, 4))).shape == (0, 5, 2)


def test_float32_points_are_worked_on_in_float64():
    xy = np.array([[0.3, -0.2]], np.float32)
    k = np.array([0.1, 0.02, 0.0, 0.0])
    assert distort(xy, k).dtype == np.float64
    np.testing.assert_array_equal(distort(xy, k), distort(xy.astype(np.float64), k))
    np.testing.assert_array_equal(undistort(xy, k), undistort(xy.astype(np.float64), k))


@pytest.mark.parametrize("p", [0.5, -2.0, 100.0])
def test_absurd_tangential_terms_give_the_inverse_or_nan(p):
    k = np.array([0.0, 0.0, p, -p])
    xy = np.random.default_rng(2).uniform(-1, 1, (200, 2))
    back = distort(undistort(xy, k), k)
    found = np.isfinite(back).all(axis=1)
    np.testing.assert_allclose(back[found], xy[found], atol=1e-8)
