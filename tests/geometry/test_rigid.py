import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from jaxtyping import TypeCheckError
from scipy.spatial.transform import Rotation

from pgm_data.geometry.rigid import (
    SMALL_ANGLE,
    compose,
    invert,
    is_rotation,
    rotation_from_rotvec,
    rotvec_from_rotation,
    skew,
    transform,
)
from tests.geometry.strategies import rotations, rotvecs

translations = arrays(np.float64, 3, elements=st.floats(-100, 100, allow_subnormal=False))
points = arrays(np.float64, (4, 3), elements=st.floats(-100, 100, allow_subnormal=False))


@given(translations, translations)
def test_skew_is_the_cross_product(v, w):
    np.testing.assert_allclose(skew(v) @ w, np.cross(v, w), atol=1e-10)


@given(rotvecs)
def test_rotation_of_an_axis_angle_agrees_with_scipy(rotvec):
    np.testing.assert_allclose(rotation_from_rotvec(rotvec), Rotation.from_rotvec(rotvec).as_matrix(), atol=1e-14)


@given(rotvecs)
def test_logarithm_undoes_exponential_below_pi(rotvec):
    np.testing.assert_allclose(rotvec_from_rotation(rotation_from_rotvec(rotvec)), rotvec, atol=1e-10)


@given(rotations())
def test_exponential_undoes_logarithm(R):
    np.testing.assert_allclose(rotation_from_rotvec(rotvec_from_rotation(R)), R, atol=1e-14)


@pytest.mark.parametrize("angle", [0.0, 1e-300, 1e-12, 0.99 * SMALL_ANGLE, SMALL_ANGLE, 1.01 * SMALL_ANGLE, np.pi, 7.0])
def test_small_angles_and_half_turns_and_more_are_exact_rotations(angle):
    axis = np.array([2.0, -3.0, 6.0]) / 7
    R = rotation_from_rotvec(angle * axis)
    np.testing.assert_allclose(R, Rotation.from_rotvec(angle * axis).as_matrix(), rtol=0, atol=3e-16 * 4)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-15)


def test_no_turn_is_exactly_the_identity_both_ways():
    np.testing.assert_array_equal(rotation_from_rotvec(np.zeros(3)), np.eye(3))
    np.testing.assert_array_equal(rotvec_from_rotation(np.eye(3)), np.zeros(3))


@pytest.mark.parametrize("axis", [*np.eye(3), [0.6, 0.8, 0.0], [-0.6, 0.0, 0.8]])
def test_a_half_turn_comes_back_up_to_the_sign_of_its_axis(axis):
    axis = np.array(axis)
    R = 2 * np.outer(axis, axis) - np.eye(3)  # exactly pi
    rotvec = rotvec_from_rotation(R)
    np.testing.assert_allclose(np.linalg.norm(rotvec), np.pi, rtol=1e-12)
    np.testing.assert_allclose(abs(rotvec @ axis), np.pi, rtol=1e-12)
    np.testing.assert_allclose(rotation_from_rotvec(rotvec), R, atol=1e-14)


@given(rotations(), translations, points)
def test_invert_undoes_a_transform(R, t, points_a):
    R_back, t_back = invert(R, t)
    np.testing.assert_allclose(transform(R_back, t_back, transform(R, t, points_a)), points_a, atol=1e-11)


@given(rotations(), translations, rotations(), translations, points)
def test_compose_is_one_transform_after_the_other(R_c_from_b, t_c_from_b, R_b_from_a, t_b_from_a, points_a):
    R, t = compose(R_c_from_b, t_c_from_b, R_b_from_a, t_b_from_a)
    apart = transform(R_c_from_b, t_c_from_b, transform(R_b_from_a, t_b_from_a, points_a))
    np.testing.assert_allclose(transform(R, t, points_a), apart, atol=1e-11)


@given(rotations(), translations)
def test_composing_with_the_inverse_is_the_identity(R, t):
    R_same, t_same = compose(R, t, *invert(R, t))
    np.testing.assert_allclose(R_same, np.eye(3), atol=1e-14)
    np.testing.assert_allclose(t_same, 0, atol=1e-11)


def test_leading_axes_are_a_loop_over_them():
    rng = np.random.default_rng(0)
    rotvec, t, points_a = rng.normal(size=(2, 5, 3)), rng.normal(size=(2, 5, 3)), rng.normal(size=(2, 5, 7, 3))
    R = rotation_from_rotvec(rotvec)
    batched = transform(R, t, points_a)
    for i in np.ndindex(2, 5):
        np.testing.assert_allclose(R[i], rotation_from_rotvec(rotvec[i]))
        np.testing.assert_allclose(batched[i], points_a[i] @ R[i].T + t[i])
        np.testing.assert_allclose(rotvec_from_rotation(R)[i], rotvec_from_rotation(R[i]))


def test_one_set_of_points_goes_through_a_track_of_transforms():
    rng = np.random.default_rng(0)
    R, t, points_a = rotation_from_rotvec(rng.normal(size=(5, 3))), rng.normal(size=(5, 3)), rng.normal(size=(7, 3))
    np.testing.assert_array_equal(transform(R, t, points_a), transform(R, t, np.tile(points_a, (5, 1, 1))))


def test_empty_batches_stay_empty():
    assert rotation_from_rotvec(np.zeros((0, 3))).shape == (0, 3, 3)
    assert rotvec_from_rotation(np.zeros((4, 0, 3, 3))).shape == (4, 0, 3)
    assert transform(np.eye(3), np.zeros(3), np.zeros((0, 3))).shape == (0, 3)
    assert is_rotation(np.zeros((0, 3, 3)))


def test_missing_rotations_stay_missing():
    R = np.stack([np.eye(3), np.full((3, 3), np.nan)])
    rotvec = rotvec_from_rotation(R)
    np.testing.assert_array_equal(rotvec[0], 0)
    assert np.isnan(rotvec[1]).all()
    assert np.isnan(rotation_from_rotvec(rotvec)[1]).all()


def test_float32_vectors_give_float64_rotations():
    rotvec = np.array([0.3, -1.2, 0.5], np.float32)
    R = rotation_from_rotvec(rotvec)
    assert R.dtype == np.float64
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-15)


@pytest.mark.parametrize("R", [np.diag([1.0, 1.0, -1.0]), 1.001 * np.eye(3), np.full((3, 3), np.nan), np.zeros((3, 3))])
def test_reflections_scalings_and_gaps_are_no_rotations(R):
    assert not is_rotation(R)
    assert not is_rotation(np.stack([np.eye(3), R]))


def test_wrong_shapes_are_refused():
    with pytest.raises(TypeCheckError):
        rotation_from_rotvec(np.zeros(4))
    with pytest.raises(TypeCheckError):
        transform(np.eye(3), np.zeros(3), np.zeros((5, 2)))
