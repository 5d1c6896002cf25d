"""The measures of a body's sins find what is put before them."""

import numpy as np
import pytest

from pgm_data.simulate import rotations
from pgm_data.simulate.body import laws
from pgm_data.simulate.body.figure import BodyTrack, draw_figure, smpl24

FIGURE = draw_figure(np.random.default_rng(1), "right")
NAMES = smpl24().joint_names


def standing(times: int = 10) -> BodyTrack:
    """Upright in the rest pose, soles on the ground, arms out."""
    R = np.tile(np.eye(3), (times, 24, 1, 1))
    R[:, 0] = rotations.facing(0.3)
    scale = FIGURE.height_m / 1.8
    leg = sum(FIGURE.translations[NAMES.index("L_" + part), 1] for part in ("Hip", "Knee", "Ankle", "Toe"))
    root = np.tile([1.0, -9.0, 0.01 * scale - leg], (times, 1))
    return BodyTrack(root_position=root, rotations=R, contact=np.ones((times, 2), dtype=bool))


def bent(joint: str, axis: int, angle: float) -> BodyTrack:
    track = standing()
    track.rotations[:, NAMES.index(joint)] = rotations.about(axis, angle)
    return track


def test_who_stands_commits_none():
    track = standing()
    np.testing.assert_allclose(laws.foot_slides(FIGURE, track), [0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(laws.ground_penetration(FIGURE, track), 0.0, atol=1e-12)
    np.testing.assert_array_equal(laws.joint_violations(track), 0.0)


def test_a_slide_is_measured_within_each_stance_and_not_between():
    track = standing()
    track.root_position[:, 0] += [0, 0, 0.02, 0.05, 0.05, 0.9, 0.9, 0.9, 0.91, 0.91]
    track.contact[4:6, 0] = False
    track.contact[:, 1] = False
    np.testing.assert_allclose(laws.foot_slides(FIGURE, track), [0.05, 0.01], atol=1e-12)


def test_no_contact_gives_no_slides():
    track = standing()
    track.contact[:] = False
    assert laws.foot_slides(FIGURE, track).shape == (0,)


def test_a_sunken_body_and_a_dipped_heel_are_in_the_ground():
    track = standing(2)
    track.root_position[1, 2] -= 0.03
    np.testing.assert_allclose(laws.ground_penetration(FIGURE, track), [0.0, 0.03], atol=1e-9)
    assert laws.ground_penetration(FIGURE, bent("L_Ankle", 0, -0.5)).min() > 0.01
    assert laws.ground_penetration(FIGURE, bent("L_Toe", 0, 0.4)).min() > 0.01


@pytest.mark.parametrize(
    ("joint", "axis", "angle", "excess"),
    [
        ("L_Knee", 0, -0.3, 0.21),
        ("R_Knee", 0, 2.8, 0.18),
        ("L_Hip", 0, -2.5, 0.14),
        ("R_Hip", 0, 1.2, 0.35),
        ("L_Hip", 2, 1.33, 0.2),
        ("R_Hip", 2, -1.33, 0.2),
        ("L_Hip", 2, -1.1, 0.2),
        ("L_Hip", 1, 1.3, 0.2),
        ("R_Hip", 1, 1.3, 0.2),
        ("L_Ankle", 0, 1.0, 0.13),
        ("R_Toe", 0, -1.25, 0.2),
        ("L_Elbow", 1, 0.39, 0.3),
        ("R_Elbow", 1, -0.39, 0.3),
        ("R_Elbow", 1, 2.8, 0.1),
        ("Chest", 1, 1.0, 0.3),
    ],
)
def test_a_joint_beyond_its_limit_counts_by_how_much(joint, axis, angle, excess):
    violations = laws.joint_violations(bent(joint, axis, angle))
    assert violations[0, NAMES.index(joint)] == pytest.approx(excess, abs=1e-9)
    assert np.count_nonzero(violations[0]) == 1


@pytest.mark.parametrize(
    ("joint", "axis", "angle"),
    [("L_Knee", 0, 2.0), ("L_Elbow", 1, -2.0), ("R_Elbow", 1, 2.0), ("R_Elbow", 0, 1.0), ("L_Hip", 0, -1.8)],
)
def test_human_postures_are_within_limits(joint, axis, angle):
    np.testing.assert_array_equal(laws.joint_violations(bent(joint, axis, angle)), 0.0)
