"""Inverse kinematics: what was posed comes back, limits hold, and nothing observed is bent to suit what was not."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from pgm_data.geometry.rigid import rotation_from_rotvec, rotvec_from_rotation
from pgm_data.lift.players.ik import FitOptions, fit_rotations, outside_limits
from pgm_data.lift.players.ik_reach import between_neighbours
from pgm_data.lift.players.ik_start import descends, targets
from pgm_data.lift.players.ik_twist import inverse_right_jacobian
from pgm_data.scene import load_scene
from pgm_data.simulate.tennis.match import draw_match, plays
from pgm_data.simulate.tennis.truth import play_states
from pgm_data.skeleton import Skeleton, load_skeleton, world_joints

SMPL = load_skeleton("smpl24")
BLOCKS = load_skeleton("blocks13")
L_KNEE, L_ELBOW, L_WRIST = (SMPL.joint_names.index(name) for name in ("L_Knee", "L_Elbow", "L_Wrist"))


def posed(rotations: np.ndarray, skeleton: Skeleton = SMPL, *, scale: float = 1.0, at=(3.0, -11.0, 1.0)) -> np.ndarray:
    """World joints of rotations, on the skeleton's bones times a scale."""
    translations = np.broadcast_to(skeleton.rest_translations * scale, rotations.shape).copy()
    translations[:, 0] = at
    return world_joints(skeleton.parents, rotations, translations)


def poses(frames: int, *, seed: int = 0, share: float = 0.8, skeleton: Skeleton = SMPL) -> np.ndarray:
    """Rotations inside of the limits, each frame another, the root anyhow."""
    rng = np.random.default_rng(seed)
    bounded = np.isfinite(skeleton.limits)
    low, high = (np.where(bounded[:, i], skeleton.limits[:, i], s * 0.5) for i, s in ((0, -1), (1, 1)))
    middle, half = (low + high) / 2, (high - low) / 2
    size = (frames, len(skeleton.parents), 3)
    rotations = middle + share * half * rng.uniform(-1, 1, size=size) / np.sqrt(3)
    rotations[:, 0] = rng.normal(size=(frames, 3))
    return rotations


def smooth(frames: int, *, seed: int = 0) -> np.ndarray:
    """A motion: a few poses, blended."""
    keys = poses(4, seed=seed, share=0.6)
    at = np.linspace(0, 3, frames)
    low = np.minimum(at.astype(int), 2)
    share = (at - low)[:, None, None]
    share = share * share * (3 - 2 * share)
    return (1 - share) * keys[low] + share * keys[low + 1]


@pytest.mark.parametrize("skeleton", [SMPL, BLOCKS], ids=lambda s: s.name)
@pytest.mark.parametrize("scale", [1.0, 0.87])
def test_what_the_skeleton_can_take_is_met(skeleton, scale):
    joints = posed(poses(30, skeleton=skeleton), skeleton, scale=scale)
    fitted = fit_rotations(joints, skeleton)
    assert fitted.scale == pytest.approx(scale, abs=1e-9)
    assert np.abs(fitted.joints - joints).max() < 1e-5
    assert fitted.residual_m.max() < 1e-5
    assert not outside_limits(fitted.rotations, skeleton).any()
    assert np.linalg.norm(fitted.rotations, axis=-1).max() <= np.pi + 1e-9


def test_forward_kinematics_leads_to_the_joints_returned_whatever_came_in():
    rng = np.random.default_rng(3)
    joints = posed(poses(20)) + rng.normal(scale=0.05, size=(20, 24, 3))
    joints[rng.uniform(size=joints.shape[:2]) < 0.2] = np.nan
    for options in (FitOptions(), FitOptions(bones="own")):
        fitted = fit_rotations(joints, SMPL, options=options)
        led = world_joints(SMPL.parents, fitted.rotations, fitted.translations)
        assert np.abs(led - fitted.joints).max() < 1e-9
        assert not outside_limits(fitted.rotations, SMPL).any()


def test_own_bones_are_met_where_the_body_is_built_otherwise():
    rng = np.random.default_rng(5)
    rotations = poses(25, seed=5)
    translations = SMPL.rest_translations * rng.uniform(0.85, 1.15, size=(24, 1))
    translations = np.broadcast_to(translations, rotations.shape).copy()
    joints = world_joints(SMPL.parents, rotations, translations)
    own = fit_rotations(joints, SMPL, options=FitOptions(bones="own"))
    scaled = fit_rotations(joints, SMPL)
    assert own.residual_m.max() < 1e-5
    assert 1e-3 < scaled.residual_m.max() < 0.08
    lengths = np.linalg.norm(own.translations[:, 1:], axis=-1)
    assert np.allclose(lengths, np.linalg.norm(translations[:, 1:], axis=-1), atol=1e-9)
    ratio = np.linalg.norm(scaled.translations[:, 1:], axis=-1) / np.linalg.norm(SMPL.rest_translations[1:], axis=-1)
    assert np.allclose(ratio, scaled.scale)


def test_noise_moves_joints_by_no_more_than_noise():
    rng = np.random.default_rng(7)
    joints = posed(smooth(80))
    seen = joints + rng.normal(scale=0.01, size=joints.shape)
    fitted = fit_rotations(seen, SMPL, options=FitOptions(scale=1.0))
    before = np.sqrt(((seen - joints) ** 2).sum(-1).mean())
    after = np.sqrt(((fitted.joints - joints) ** 2).sum(-1).mean())
    assert after < before


def test_rotations_do_not_tremble_with_the_noise_of_short_bones():
    rng = np.random.default_rng(8)
    truth = smooth(60)
    seen = posed(truth) + rng.normal(scale=0.015, size=truth.shape)
    alone, steadied = (
        fit_rotations(seen, SMPL, options=FitOptions(scale=1.0, change_rad=change)) for change in (np.inf, 0.15)
    )
    shaking = [np.linalg.norm(np.diff(f.rotations[:, 1:], axis=0), axis=-1).max() for f in (alone, steadied)]
    wrong = [np.linalg.norm(f.joints - posed(truth), axis=-1).mean() for f in (alone, steadied)]
    assert shaking[1] < 0.75 * shaking[0] and wrong[1] < wrong[0]


def test_the_middle_of_neighbours_is_on_the_way_of_a_steady_turn():
    turn = np.linspace(0, 6, 30)[:, None, None] * np.array([[0.6, 0.0, 0.8]])
    middle = between_neighbours(turn, np.ones(29, dtype=bool))
    apart = rotation_from_rotvec(middle) - rotation_from_rotvec(turn)
    assert np.abs(apart).max() < 1e-9
    jolted = turn.copy()
    jolted[10] += 0.1
    gap = np.ones(29, dtype=bool)
    gap[10] = False
    assert np.abs(between_neighbours(jolted, np.ones(29, dtype=bool)) - jolted)[10].max() > 0.05
    np.testing.assert_array_equal(between_neighbours(jolted, gap)[10], jolted[10])


def test_an_elbow_and_a_knee_that_bend_backwards_are_straightened():
    rotations = np.zeros((1, 24, 3))
    rotations[0, L_KNEE] = [-0.9, 0.0, 0.0]
    fitted = fit_rotations(posed(rotations), SMPL, options=FitOptions(scale=1.0))
    assert not outside_limits(fitted.rotations, SMPL).any()
    hip, knee, ankle = (fitted.joints[0, SMPL.joint_names.index(name)] for name in ("L_Hip", "L_Knee", "L_Ankle"))
    thigh, shin = knee - hip, ankle - knee
    bend = np.arccos(thigh @ shin / np.linalg.norm(thigh) / np.linalg.norm(shin))
    assert np.degrees(bend) < 45


def test_the_limit_of_an_elbow_decides_the_twist_of_the_shoulder():
    # A forearm that points straight up from an arm held out: the elbow bends about y, so the arm must have turned.
    rotations = np.zeros((1, 24, 3))
    shoulder = SMPL.joint_names.index("L_Shoulder")
    rotations[0, shoulder] = [-np.pi / 2, 0.0, 0.0]
    rotations[0, L_ELBOW] = [0.0, -np.radians(100), 0.0]
    joints = posed(rotations)
    forearm = joints[0, L_WRIST] - joints[0, L_ELBOW]
    assert forearm[1] > 0.2
    fitted = fit_rotations(joints, SMPL)
    assert np.abs(fitted.joints - joints).max() < 1e-5
    assert not outside_limits(fitted.rotations, SMPL).any()
    assert fitted.rotations[0, shoulder, 0] < -0.1


@pytest.mark.parametrize("angle", [np.pi - 1e-9, np.pi, np.pi + 1e-9])
@pytest.mark.parametrize("axis", [(1.0, 0, 0), (0, 1.0, 0), (0, 0, 1.0)])
def test_a_root_turned_by_pi_is_met(angle, axis):
    rotations = poses(3, seed=2)
    rotations[:, 0] = angle * np.array(axis)
    fitted = fit_rotations(posed(rotations), SMPL)
    assert fitted.residual_m.max() < 1e-5
    apart = rotation_from_rotvec(fitted.rotations[:, 0]) - rotation_from_rotvec(rotations[:, 0])
    assert np.abs(apart).max() < 1e-6


def test_bones_folded_right_back_are_met():
    free = Skeleton(
        name="chain",
        joint_names=("a", "b", "c"),
        parents=np.array([-1, 0, 1]),
        rest_translations=np.array([[0, 0, 0], [0, 0.5, 0], [0, 0.5, 0]], dtype=float),
        limits=np.stack([np.full((3, 3), -np.inf), np.full((3, 3), np.inf)], axis=1),
        point_names=("a",),
        point_joints=np.array([0]),
        point_offsets=np.zeros((1, 3)),
        soles=(("a",), ("a",)),
        keypoint_names=("a",),
    )
    joints = np.array([[[0, 0, 1], [0, -0.5, 1], [0, 0, 1]]], dtype=float)
    fitted = fit_rotations(joints, free)
    assert np.abs(fitted.joints - joints).max() < 1e-5


def test_a_bone_of_no_length_turns_nothing():
    rest = SMPL.rest_translations.copy()
    rest[L_WRIST] = 0.0
    fields = {name: getattr(SMPL, name) for name in SMPL.__dataclass_fields__}
    stump = Skeleton(**(fields | {"rest_translations": rest}))
    joints = posed(poses(12, seed=4), stump)
    fitted = fit_rotations(joints, stump)
    assert fitted.residual_m.max() < 1e-5
    assert fitted.scale == pytest.approx(1.0)
    collapsed = np.repeat(joints[:, :1], 24, axis=1)
    fitted = fit_rotations(collapsed, SMPL, options=FitOptions(scale=1.0))
    assert np.isfinite(fitted.rotations).all()
    assert not outside_limits(fitted.rotations, SMPL).any()


def test_joints_that_are_missing_at_the_ends_stay_at_rest():
    joints = posed(poses(10, seed=1))
    ends = [SMPL.joint_names.index(n) for n in ("L_Hand", "R_Hand", "L_Toe", "R_Toe", "Head")]
    seen = joints.copy()
    seen[:, ends] = np.nan
    fitted = fit_rotations(seen, SMPL)
    assert fitted.residual_m.max() < 1e-5
    wrists = [SMPL.parents[end] for end in ends[:2]]
    assert np.abs(fitted.rotations[:, wrists]).max() < np.radians(100)
    apart = np.linalg.norm(fitted.joints[:, ends] - fitted.joints[:, SMPL.parents[ends]], axis=-1)
    assert np.allclose(apart, np.linalg.norm(SMPL.rest_translations[ends], axis=-1))


def test_joints_missing_between_others_are_bridged():
    joints = posed(smooth(24, seed=6))
    seen = joints.copy()
    hidden = [
        SMPL.joint_names.index(n) for n in ("Pelvis", "Spine", "L_Elbow", "R_Knee", "L_Thorax", "R_Thorax", "Chest")
    ]
    seen[:, hidden] = np.nan
    fitted = fit_rotations(seen, SMPL, options=FitOptions(scale=1.0))
    assert np.median(fitted.residual_m) < 0.01
    assert np.median(np.linalg.norm(fitted.joints - joints, axis=-1)[:, hidden]) < 0.12
    assert not outside_limits(fitted.rotations, SMPL).any()


def test_frames_with_too_few_joints_have_no_pose():
    joints = posed(poses(6))
    joints[1] = np.nan
    joints[2, 2:] = np.nan
    joints[3, 5, 1] = np.nan
    fitted = fit_rotations(joints, SMPL)
    assert np.isnan(fitted.rotations[[1, 2]]).all() and np.isnan(fitted.residual_m[[1, 2]]).all()
    assert np.isfinite(fitted.rotations[[0, 3, 4, 5]]).all()
    nothing = fit_rotations(np.full((3, 24, 3), np.nan), SMPL)
    assert np.isnan(nothing.joints).all() and np.isnan(nothing.scale)
    assert fit_rotations(np.zeros((0, 24, 3)), SMPL).joints.shape == (0, 24, 3)


def test_one_frame_gives_what_it_gives_among_many():
    rotations = poses(1, seed=9)
    one = fit_rotations(posed(rotations), SMPL)
    many = fit_rotations(posed(np.repeat(rotations, 5, axis=0)), SMPL)
    assert np.allclose(one.rotations[0], many.rotations[2], atol=1e-3)
    assert one.residual_m[0] < 1e-5


def test_a_still_limb_that_leaves_its_twist_open_does_not_tremble():
    rotations = smooth(80, seed=11)
    fitted = fit_rotations(posed(rotations), SMPL)
    ours = np.linalg.norm(np.diff(fitted.rotations[:, 1:], axis=0), axis=-1)
    truth = np.linalg.norm(np.diff(rotations[:, 1:], axis=0), axis=-1)
    assert ours.max() < 2 * truth.max()
    loose = fit_rotations(posed(rotations), SMPL, options=FitOptions(steadiness=0.0))
    rough = np.linalg.norm(np.diff(loose.rotations[:, 1:], axis=0), axis=-1)
    assert (ours**2).sum() <= (rough**2).sum() + 1e-9


def test_twist_that_nothing_shows_is_small():
    rotations = smooth(30, seed=12)
    fitted = fit_rotations(posed(rotations), SMPL)
    assert (fitted.rotations[:, 1:] ** 2).sum() <= 1.05 * (rotations[:, 1:] ** 2).sum()


@settings(max_examples=3)
@given(
    turn=arrays(np.float64, 3, elements=st.floats(-3, 3)),
    shift=arrays(np.float64, 3, elements=st.floats(-30, 30)),
)
def test_turning_the_body_turns_its_root_alone(turn, shift):
    joints = posed(poses(4, seed=13))
    R = rotation_from_rotvec(turn)
    here, there = fit_rotations(joints, SMPL), fit_rotations(joints @ R.T + shift, SMPL)
    assert np.abs(there.joints - (here.joints @ R.T + shift)).max() < 1e-5
    assert np.abs(there.rotations[:, 1:] - here.rotations[:, 1:]).max() < 1e-3


def test_what_is_not_joints_of_the_skeleton_is_refused():
    with pytest.raises(ValueError, match=r"expected \(frames, 24, 3\)"):
        fit_rotations(np.zeros((2, 13, 3)), SMPL)
    with pytest.raises(ValueError, match="scale"):
        fit_rotations(np.zeros((2, 24, 3)), SMPL, options=FitOptions(scale=-1.0))


def test_whatever_comes_in_a_body_comes_out():
    rng = np.random.default_rng(21)
    junk = rng.normal(size=(6, 24, 3))
    sparse = junk.copy()
    for frame in range(6):
        sparse[frame, rng.permutation(24)[:21]] = np.nan
    line = np.linspace(0, 1, 24)[None, :, None] * np.array([0, 0, 1.0])
    infinite = np.where(rng.uniform(size=(6, 24, 1)) < 0.5, np.inf, junk)
    for joints in (1e6 * junk, sparse[:3], line, infinite[:3], np.zeros((1, 24, 3))):
        fitted = fit_rotations(joints, SMPL)
        used = np.isfinite(joints).all(axis=-1).sum(axis=1) >= 3
        assert np.isfinite(fitted.rotations[used]).all() and np.isnan(fitted.rotations[~used]).all()
        assert not outside_limits(fitted.rotations, SMPL).any()


@pytest.mark.parametrize("joints", [1, 2])
def test_a_tree_of_a_joint_or_two_is_met_without_any_turn_that_nothing_asks_for(joints):
    rest = np.array([[0, 0, 0], [0, 0.5, 0]], dtype=float)[:joints]
    fields = {name: getattr(SMPL, name) for name in SMPL.__dataclass_fields__}
    unlimited = np.stack([np.full((joints, 3), -np.inf), np.full((joints, 3), np.inf)], axis=1)
    small = Skeleton(
        **fields
        | {
            "joint_names": ("a", "b")[:joints],
            "parents": np.arange(joints) - 1,
            "rest_translations": rest,
            "limits": unlimited,
            "point_joints": np.zeros(len(SMPL.point_names), dtype=np.int64),
        }
    )
    seen = rest[None] + [[[1.0, 2.0, 3.0]]]
    fitted = fit_rotations(seen, small)
    np.testing.assert_allclose(fitted.joints, seen, atol=1e-9)
    np.testing.assert_allclose(fitted.rotations, 0.0, atol=1e-5)


def test_no_frame_of_simulated_play_leaves_the_limits_and_backward_knees_and_elbows_do():
    rng = np.random.default_rng(1)
    match = draw_match(rng, load_scene("tennis"), name="limits", surface=None, wind=None)
    for play in itertools.islice(plays(match, rng), 2):
        for states in play_states(play, np.arange(0, play.duration_s, 0.1), rng).players:
            assert not outside_limits(rotvec_from_rotation(states.rotations), SMPL, tolerance_rad=0.0).any()
    backward = {"L_Knee": [-0.3, 0, 0], "R_Knee": [-0.3, 0, 0], "L_Elbow": [0, 0.4, 0], "R_Elbow": [0, -0.4, 0]}
    for joint, bend in backward.items():
        rotations = np.zeros((1, 24, 3))
        rotations[0, SMPL.joint_names.index(joint)] = bend
        assert outside_limits(rotations, SMPL).sum() == 1
        assert not outside_limits(-rotations, SMPL).any()


def test_targets_are_the_nearest_descendants_seen():
    seen = np.ones((1, 24), dtype=bool)
    seen[0, L_ELBOW] = False
    found = targets(SMPL.parents, seen, np.zeros(24, dtype=bool))[0]
    shoulder = SMPL.joint_names.index("L_Shoulder")
    assert np.flatnonzero(found[shoulder]).tolist() == [L_WRIST]
    assert np.flatnonzero(found[L_ELBOW]).tolist() == [L_WRIST]
    below = descends(SMPL.parents)
    assert below[0, 1:].all() and not below[:, 0].any() and below[shoulder].sum() == 3


@settings(max_examples=30)
@given(arrays(np.float64, 3, elements=st.floats(-1.7, 1.7)))
def test_the_inverse_jacobian_is_the_derivative_of_the_logarithm(rotvec):
    step = 1e-6
    R = rotation_from_rotvec(rotvec)
    turned = np.stack([R @ rotation_from_rotvec(step * e) for e in np.eye(3)])
    backed = np.stack([R @ rotation_from_rotvec(-step * e) for e in np.eye(3)])
    slope = (rotvec_from_rotation(turned) - rotvec_from_rotation(backed)).T / (2 * step)
    assert np.abs(inverse_right_jacobian(rotvec) - slope).max() < 1e-6
