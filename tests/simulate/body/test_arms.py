"""Chains of angles: forward against the skeleton's own kinematics, backward within limits."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from pgm_data.simulate.body import arms, postures, racket
from pgm_data.simulate.body.figure import draw_figure, smpl24, world_from_joints

NAMES = smpl24().joint_names
CHAIN = [NAMES.index(n) for n in ("Torso", "Spine", "Chest", "R_Thorax", "R_Shoulder", "R_Elbow", "R_Wrist", "R_Hand")]


def figure_and_angles(seed, count):
    rng = np.random.default_rng(seed)
    low, high = arms.inner_limits()
    return draw_figure(rng, "right"), rng.uniform(low, high, (count, 14)), rng


@given(st.integers(0, 10**6))
@settings(max_examples=20, deadline=None)
def test_the_hand_is_where_the_skeleton_has_it(seed):
    figure, q, _ = figure_and_angles(seed, 5)
    R, p = arms.hands(q, postures.side_bones(figure.translations, "right"))
    rotations = np.broadcast_to(np.eye(3), (5, 24, 3, 3)).copy()
    rotations[:, CHAIN] = arms.joint_rotations(q)
    R_all, t_all = world_from_joints(figure, np.zeros((5, 3)), rotations)
    np.testing.assert_allclose(R, R_all[:, CHAIN[-1]], atol=1e-12)
    np.testing.assert_allclose(p, t_all[:, CHAIN[-1]], atol=1e-12)


def test_the_racket_lies_in_the_hand_as_the_figure_has_it():
    np.testing.assert_allclose(arms.SHAFT, racket.shaft_axis("right"), atol=1e-15)


@given(st.integers(0, 10**6))
@settings(max_examples=40, deadline=None)
def test_what_can_be_reached_is_reached_within_limits(seed):
    figure, q, rng = figure_and_angles(seed, 1)
    bones = postures.side_bones(figure.translations, "right")
    aim = rng.uniform(-0.3, 0.3, 3)
    R, p = arms.hands(q, bones)
    wants = np.stack([p[0] + R[0] @ aim, R[0] @ arms.SHAFT, -R[0][:, 1], np.zeros(3)])
    low, high = arms.inner_limits()
    start = np.clip(q[0] + rng.uniform(-0.5, 0.5, 14), low, high)
    found = arms.reach_pose(start, low, high, arms.EASE, bones, aim, wants, np.array([40.0, 2.0, 2.0, 0.0]))
    R2, p2 = arms.hands(found[None], bones)
    # Nearly always exactly; some two in a thousand starts end against limits, a centimetre away.
    assert np.linalg.norm(p2[0] + R2[0] @ aim - wants[0]) < 0.02
    assert (found >= low - 1e-12).all() and (found <= high + 1e-12).all()


@given(st.integers(0, 10**6))
@settings(max_examples=20, deadline=None)
def test_a_hand_follows_near_points_and_leaves_the_trunk(seed):
    figure, q, rng = figure_and_angles(seed, 8)
    bones = postures.side_bones(figure.translations, "right")
    low, high = arms.inner_limits()
    # Points that the same trunk can reach, a little away.
    goal = np.clip(q + np.where(np.arange(14) < 3, 0.0, rng.uniform(-0.1, 0.1, (8, 14))), low, high)
    points = arms.hands(goal, bones)[1]
    before = np.linalg.norm(arms.hands(q, bones)[1] - points, axis=1)
    after = arms.follow_points(q, low, high, arms.EASE, bones, points, np.ones(8))
    miss = np.linalg.norm(arms.hands(after, bones)[1] - points, axis=1)
    assert (miss <= before + 1e-9).all()
    assert np.median(miss) < 2e-3
    np.testing.assert_array_equal(after[:, :3], q[:, :3])
    still = arms.follow_points(q, low, high, arms.EASE, bones, points, np.zeros(8))
    np.testing.assert_array_equal(still, q)


def test_rates_of_a_point_are_its_derivatives():
    figure, q, rng = figure_and_angles(4, 1)
    bones, aim = postures.side_bones(figure.translations, "right"), rng.uniform(-0.3, 0.3, 3)
    way = rng.normal(size=14)

    def place(s):
        R, p = arms.hands((q[0] + s * way)[None], bones)
        return p[0] + R[0] @ aim

    np.testing.assert_allclose(arms.point_rates(q[0], bones, aim) @ way, (place(1e-5) - place(-1e-5)) / 2e-5, atol=1e-6)


@given(st.lists(st.floats(-20.0, 20.0), min_size=14, max_size=14))
def test_eased_angles_never_pass_a_limit_and_do_not_change_inside(values):
    q = np.array(values)
    eased = arms.within_limits(q)
    assert (eased <= arms.HIGHEST + 1e-12).all() and (eased >= arms.LOWEST - 1e-12).all()
    low, high = arms.inner_limits()
    inside = (q >= low) & (q <= high)
    np.testing.assert_array_equal(eased[inside], q[inside])
    np.testing.assert_array_equal(arms.within_limits(np.clip(q, low, high)), np.clip(q, low, high))


def test_easing_is_smooth_at_the_margin():
    low, high = arms.inner_limits()
    step = 1e-6
    slope = (arms.within_limits(high + step) - arms.within_limits(high)) / step
    np.testing.assert_allclose(slope, 1.0, atol=1e-3)
