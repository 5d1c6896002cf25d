"""Laws of a limb of two bones."""

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from pgm_data.simulate import rotations
from pgm_data.simulate.body import limb

LIMBS = {
    "left leg": ([0.02, -0.4, 0.0], [0.0, -0.4, -0.02], limb.KNEE_AT_REST),
    "right leg": ([-0.02, -0.4, 0.0], [0.0, -0.4, -0.02], limb.KNEE_AT_REST),
    "left arm": ([0.27, 0.0, 0.0], [0.25, 0.0, 0.0], limb.ELBOW_AT_REST),
    "right arm": ([-0.27, 0.0, 0.0], [-0.25, 0.0, 0.0], limb.ELBOW_AT_REST),
    "equal bones": ([-0.3, 0.0, 0.0], [-0.3, 0.0, 0.0], limb.ELBOW_AT_REST),
}
names = st.sampled_from(sorted(LIMBS))
numbers = st.floats(-1.0, 1.0)
vectors = st.tuples(numbers, numbers, numbers).map(np.array)


def solve(name, root, turn, target, pole):
    upper, lower, rest_pole = (np.array(v) for v in LIMBS[name])
    R_world_from_parent = rotations.from_axis_angle(np.asarray(turn, dtype=float))
    R_upper, R_lower, reached = limb.two_bone(
        np.asarray(root, dtype=float)[None],
        R_world_from_parent[None],
        upper,
        lower,
        np.asarray(target, dtype=float)[None],
        np.asarray(pole, dtype=float)[None],
        rest_pole,
    )
    R_world_from_upper = R_world_from_parent @ R_upper[0]
    middle = root + R_world_from_upper @ upper
    end = middle + R_world_from_upper @ R_lower[0] @ lower
    return middle, end, R_upper[0], R_lower[0], bool(reached[0])


def is_rotation(R) -> bool:
    return bool(np.allclose(R @ R.T, np.eye(3), atol=1e-12) and np.linalg.det(R) > 0)


@given(names, vectors, vectors, vectors, vectors)
@example("equal bones", np.zeros(3), np.zeros(3), np.zeros(3), np.array([0.0, 0.0, 1.0]))
@example("left leg", np.zeros(3), np.zeros(3), np.array([0.0, 0.0, -0.6]), np.array([0.0, 0.0, -1.0]))
@example("left arm", np.zeros(3), np.zeros(3), np.array([0.0, 0.3, 0.0]), np.array([0.0, 1.0, 0.0]))
@example("left leg", np.zeros(3), np.zeros(3), np.array([0.3, 0.0, 0.0]), np.zeros(3))
def test_the_end_is_at_every_target_within_reach_and_towards_every_other(name, root, turn, way, pole):
    upper, lower, rest_pole = (np.array(v) for v in LIMBS[name])
    _, end, R_upper, R_lower, reached = solve(name, root, turn, root + way, pole)
    assert is_rotation(R_upper)
    assert is_rotation(R_lower)
    folded, straight = limb.reach(upper, lower, rest_pole)
    distance = np.linalg.norm(way)
    if folded <= distance <= straight:
        assert reached
        # Folded onto itself, the limb is the difference of two equal lengths.
        np.testing.assert_allclose(end, root + way, atol=1e-9 if distance > 1e-3 else 3e-8)
    else:
        assert not reached or abs(distance - np.clip(distance, folded, straight)) < 1e-8
        size = np.linalg.norm(end - root)
        np.testing.assert_allclose(size, np.clip(distance, folded, straight), atol=1e-9)
        if distance > 1e-6:
            np.testing.assert_allclose((end - root) / max(size, 1e-9), way / distance, atol=1e-6)


@given(names, vectors, vectors, vectors)
def test_the_middle_joint_lies_on_the_side_of_the_pole_and_bends_one_way_only(name, turn, way, pole):
    upper, lower, rest_pole = (np.array(v) for v in LIMBS[name])
    folded, straight = limb.reach(upper, lower, rest_pole)
    distance = np.linalg.norm(way)
    across = np.linalg.norm(np.cross(way, pole))
    middle, _, _, R_lower, _ = solve(name, np.zeros(3), turn, way, pole)
    bend = rotations.to_axis_angle(R_lower)
    axis = limb.hinge_axis(upper, lower, rest_pole)
    np.testing.assert_allclose(np.cross(bend, axis), 0.0, atol=1e-7)
    # A knee at rest is bent by 3 degrees, so a straight one has turned a little the other way.
    assert -0.06 <= bend @ axis <= np.pi + 1e-9
    if distance > 1e-3 and folded + 0.01 < distance < straight - 0.01 and across > 1e-3 * distance:
        sideways = pole - way * (pole @ way) / distance**2
        assert middle @ sideways / np.linalg.norm(sideways) > 0.0


@pytest.mark.parametrize("name", sorted(LIMBS))
def test_a_limb_far_from_its_target_is_straight(name):
    upper, lower, _ = (np.array(v) for v in LIMBS[name])
    _, end, _, _, reached = solve(name, np.zeros(3), np.zeros(3), [3.0, 4.0, 5.0], [0.0, -1.0, 0.3])
    assert not reached
    assert np.linalg.norm(end) == pytest.approx(np.linalg.norm(upper) + np.linalg.norm(lower), abs=1e-3)


def test_turning_the_world_turns_the_limb_and_leaves_the_joints_alone():
    turn = rotations.from_axis_angle(np.array([0.3, -1.0, 2.0]))
    way, pole = np.array([0.2, -0.5, 0.1]), np.array([0.1, 0.2, 1.0])
    _, _, R_upper, R_lower, _ = solve("left leg", np.zeros(3), np.zeros(3), way, pole)
    _, _, turned_upper, turned_lower, _ = solve(
        "left leg", np.zeros(3), rotations.to_axis_angle(turn), turn @ way, turn @ pole
    )
    np.testing.assert_allclose(R_upper, turned_upper, atol=1e-12)
    np.testing.assert_allclose(R_lower, turned_lower, atol=1e-12)


def test_no_times_give_no_rotations():
    upper, lower, rest_pole = (np.array(v) for v in LIMBS["left leg"])
    none = np.zeros((0, 3))
    R_upper, R_lower, reached = limb.two_bone(none, np.zeros((0, 3, 3)), upper, lower, none, none, rest_pole)
    assert R_upper.shape == R_lower.shape == (0, 3, 3)
    assert reached.shape == (0,)


def test_a_pole_along_the_limb_at_rest_is_refused():
    with pytest.raises(ValueError, match="rest_pole"):
        limb.hinge_axis(np.array([0.0, -0.4, 0.0]), np.array([0.0, -0.4, 0.0]), np.array([0.0, 1.0, 0.0]))
