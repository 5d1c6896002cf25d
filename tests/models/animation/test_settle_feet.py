from dataclasses import replace
from typing import cast

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pgm_data.scene import load_scene
from pgm_data.skeleton import Skeleton, load_skeleton
from pgm_models.animation.leg_reach import LEAST_BEND, Leg, bent, hinge_of, legs_of
from pgm_models.animation.physics_score import SOLE_M, foot_slides, sole_points
from pgm_models.animation.player_motion import PlayerMotion, body_of
from pgm_models.animation.settle_feet import SettleOptions, settled_feet

SKELETON = cast(Skeleton, load_scene("tennis").players[0].skeleton)
LEGS = cast(tuple[Leg, Leg], legs_of(SKELETON))
JOINTS = len(SKELETON.parents)
FORWARD = Rotation.from_matrix([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
"""world_from_root of a body that looks along the world's x."""
KNEES = 0.5
"""Radians by which a standing body's knees are bent."""


def motion_of(position: np.ndarray, rotations: np.ndarray, rate: float, size: float = 1.0) -> PlayerMotion:
    frames = len(position)
    translations = np.tile(size * SKELETON.rest_translations, (frames, 1, 1))
    translations[:, 0] = position
    none = np.zeros(frames, dtype=bool)
    return PlayerMotion(
        times=np.arange(frames) / rate,
        root_position=position,
        root_rotation=rotations[:, 0].copy(),
        joint_rotations=rotations,
        joint_translations=translations,
        known_position=none,
        known_rotation=none,
        known_joints=none,
    )


def posed(frames: int, knees: float = KNEES) -> np.ndarray:
    """Rotations of a body upright with bent knees and level soles."""
    rotations = np.zeros((frames, JOINTS, 3))
    rotations[:, 0] = FORWARD.as_rotvec()
    for leg in LEGS:
        rotations[:, leg.hip, 0], rotations[:, leg.knee, 0] = -knees / 2, knees
        rotations[:, leg.ankle, 0] = -knees / 2
    return rotations


def soles_of(motion: PlayerMotion) -> np.ndarray:
    """Frames, feet, points: by the code that scores them."""
    frames = len(motion.times)
    rotations, translations = motion.joint_rotations.copy(), np.array(motion.joint_translations)
    rotations[:, 0], translations[:, 0] = motion.root_rotation, motion.root_position
    found = sole_points(SKELETON, rotations.reshape(1, frames, -1), translations.reshape(1, frames, -1))
    return found[0].reshape(frames, 2, 2, 3)


def standing(frames: int, rate: float = 25.0, size: float = 1.0) -> PlayerMotion:
    motion = motion_of(np.zeros((frames, 3)), posed(frames), rate, size)
    low = soles_of(motion)[..., 2].min()
    return moved(motion, np.array([2.0, -8.0, -low]))


def moved(motion: PlayerMotion, by: np.ndarray) -> PlayerMotion:
    position = motion.root_position + by
    bones = np.array(motion.joint_translations)
    bones[:, 0] = position
    return replace(motion, root_position=position, joint_translations=bones)


def walking(rate: float = 25.0, seconds: float = 3.2, pace: float = 1.5) -> PlayerMotion:
    """One who walks along x: feet stand and swing in turn, by the legs' own inverse kinematics."""
    times = np.arange(int(seconds * rate)) / rate
    motion = standing(len(times), rate)
    motion = moved(motion, np.stack([pace * times, 0 * times, 0 * times], axis=1))
    body = body_of(motion, SKELETON)
    rotations = motion.joint_rotations.copy()
    for foot, leg in enumerate(LEGS):
        phase = (times / 0.8 + 0.5 * foot) % 1.0
        swing = np.clip((phase - 0.6) / 0.4, 0.0, 1.0)
        start = body.joints[:, leg.ankle] - np.stack([pace * 0.8 * (phase - 0.3), 0 * phase, 0 * phase], axis=1)
        way = pace * 0.8 * (3 * swing**2 - 2 * swing**3)
        goal = start + np.stack([way, 0 * way, 0.09 * np.sin(np.pi * swing) ** 2], axis=1)
        hip, knee = body.R[:, leg.hip], Rotation.from_rotvec(body.local[:, leg.knee]).as_matrix()
        bones = body.bones[:, leg.knee], body.bones[:, leg.ankle]
        hip_new, knee_new = bent(leg, hip, knee, *bones, goal - body.joints[:, leg.hip])
        above = body.R[:, SKELETON.parents[leg.hip]]
        rotations[:, leg.hip] = Rotation.from_matrix(np.swapaxes(above, 1, 2) @ hip_new).as_rotvec()
        rotations[:, leg.knee] = Rotation.from_matrix(knee_new).as_rotvec()
        level = np.swapaxes(hip_new @ knee_new, 1, 2) @ body.R[:, leg.ankle]
        rotations[:, leg.ankle] = Rotation.from_matrix(level).as_rotvec()
    return replace(motion, joint_rotations=rotations)


def noisy(motion: PlayerMotion, seed: int = 0) -> PlayerMotion:
    rng = np.random.default_rng(seed)
    shaken = motion.joint_rotations + np.radians(3.0) * rng.standard_normal(motion.joint_rotations.shape)
    shaken[:, 0] = motion.root_rotation
    return moved(replace(motion, joint_rotations=shaken), 0.03 * rng.standard_normal(motion.root_position.shape))


def slide(motion: PlayerMotion) -> tuple[float, float]:
    """Mean speed of soles on the ground, m/s, and their share."""
    soles = soles_of(motion).reshape(1, len(motion.times), -1, 3)
    speeds, down = foot_slides(soles, np.diff(motion.times)[:1], 0.0)
    return float(speeds[down].mean()), float(down.mean())


def skating(motion: PlayerMotion, speed: float = 0.3) -> PlayerMotion:
    return moved(motion, np.stack([0 * motion.times, speed * motion.times, 0 * motion.times], axis=1))


@pytest.mark.parametrize("rate", [4.0, 25.0, 50.0])
@pytest.mark.parametrize("size", [0.85, 1.1])
def test_one_who_stands_well_is_left_standing(rate, size):
    motion = standing(30, rate, size)
    settled, report = settled_feet(motion, SKELETON, 0.0)
    np.testing.assert_allclose(soles_of(settled), soles_of(motion), atol=1e-6)
    assert [(stance.foot, stance.first, stance.last) for stance in report.stances] == [(0, 0, 29), (1, 0, 29)]
    assert report.root_moved_m.max() < 1e-6 and not report.given_up and not report.left_because


def test_one_who_sinks_and_skates_stands_still_on_the_ground():
    motion = moved(skating(standing(25), 0.1), np.array([0.0, 0.0, -0.05]))
    settled, _ = settled_feet(motion, SKELETON, 0.0)
    soles = soles_of(settled)
    np.testing.assert_allclose(soles[..., 2], 0.0, atol=1e-6)
    assert slide(motion)[0] > 0.09 and slide(settled)[0] < 1e-6


@pytest.mark.parametrize("rate", [12.5, 25.0, 50.0])
def test_one_who_walks_well_keeps_stances_and_swings(rate):
    motion = walking(rate)
    settled, report = settled_feet(motion, SKELETON, 0.0)
    assert slide(motion)[0] < 0.1
    assert np.median(np.linalg.norm(soles_of(settled) - soles_of(motion), axis=-1)) < 0.01
    assert np.median(report.root_moved_m) < 0.01
    high = soles_of(motion)[..., 2].min(axis=-1) > 0.06
    assert (soles_of(settled)[..., 2].min(axis=-1)[high] > SOLE_M).all()
    steps = sum(stance.foot == 0 for stance in report.stances)
    assert 4 <= steps <= 6


@pytest.mark.parametrize("seed", [0, 1])
def test_feet_of_a_noisy_walk_hardly_slide_and_come_nearer_to_where_they_were(seed):
    truth = walking()
    motion = noisy(truth, seed)
    settled, report = settled_feet(motion, SKELETON, 0.0)
    assert slide(motion)[0] > 1.0 and slide(settled)[0] < 0.5
    assert slide(settled)[1] > 0.75 * slide(truth)[1]
    assert soles_of(settled)[..., 2].min() > -1e-6 and report.below_m < 1e-6
    off, before = (
        np.linalg.norm(body_of(m, SKELETON).joints - body_of(truth, SKELETON).joints, axis=-1)
        for m in (settled, motion)
    )
    feet = [joint for leg in LEGS for joint in (leg.ankle, *leg.foot)]
    assert off[:, feet].mean() < 0.8 * before[:, feet].mean()
    assert off.mean() < 1.1 * before.mean()
    assert report.joints_moved_m.shape == before.shape and report.joints_moved_m.max() < 0.5


def test_settling_again_changes_little():
    once, _ = settled_feet(noisy(walking()), SKELETON, 0.0)
    twice, report = settled_feet(once, SKELETON, 0.0)
    off = np.linalg.norm(soles_of(twice) - soles_of(once), axis=-1)
    assert np.median(off) < 2e-3 and np.quantile(off, 0.95) < 0.05
    assert np.median(report.root_moved_m) < 0.01


def test_bones_trunk_and_arms_stay_and_entries_of_the_root_repeat_it():
    motion = noisy(walking())
    settled, report = settled_feet(motion, SKELETON, 0.0)
    legs = sorted({joint for leg in LEGS for joint in (leg.hip, leg.knee, leg.ankle, *leg.foot)})
    rest = [joint for joint in range(JOINTS) if joint not in legs]
    np.testing.assert_array_equal(settled.joint_rotations[:, rest], motion.joint_rotations[:, rest])
    np.testing.assert_array_equal(settled.root_rotation, motion.root_rotation)
    bones = np.asarray(settled.joint_translations)
    np.testing.assert_array_equal(bones[:, 1:], np.asarray(motion.joint_translations)[:, 1:])
    np.testing.assert_array_equal(bones[:, 0], settled.root_position)
    assert not report.kept.all()
    alone = replace(motion, joint_translations=np.asarray(motion.joint_translations)[0])
    same, _ = settled_feet(alone, SKELETON, 0.0)
    np.testing.assert_allclose(same.joint_rotations, settled.joint_rotations, atol=1e-9)
    np.testing.assert_array_equal(same.joint_translations, alone.joint_translations)


@pytest.mark.parametrize("names", [("known_position",), ("known_joints",), ("known_position", "known_joints")])
def test_known_values_come_back_to_the_bit(names):
    motion = noisy(walking())
    flags = np.zeros(len(motion.times), dtype=bool)
    flags[[0, 1, 2, 40, 41, 77]] = True
    motion = replace(motion, **dict.fromkeys(names, flags))
    settled, report = settled_feet(motion, SKELETON, 0.0)
    if "known_position" in names:
        np.testing.assert_array_equal(settled.root_position[flags], motion.root_position[flags])
    if "known_joints" in names:
        np.testing.assert_array_equal(settled.joint_rotations[flags], motion.joint_rotations[flags])
    assert report.kept[flags].all() == (len(names) == 2)
    assert not report.kept[~flags].any()
    assert soles_of(settled)[~flags][..., 2].min() > -1e-6


def test_corrections_fade_towards_known_frames_and_stances_rest_where_those_stand():
    motion = skating(standing(50), 0.03)
    flags = np.zeros(50, dtype=bool)
    flags[[24, 25, 26]] = True
    motion = replace(motion, known_position=flags, known_joints=flags, known_rotation=flags)
    settled, _ = settled_feet(motion, SKELETON, 0.0)
    root = np.linalg.norm(settled.root_position - motion.root_position, axis=1)
    assert root[flags].max() == 0.0 and root[22] < 0.01 and root[28] < 0.01
    at = soles_of(motion)[25, ..., :2]
    assert np.abs(soles_of(settled)[20:31, ..., :2] - at).max() < 0.02


def test_all_known_is_left_to_the_bit_and_what_is_in_the_ground_is_said():
    motion = moved(standing(10), np.array([0.0, 0.0, -0.02]))
    flags = np.ones(10, dtype=bool)
    motion = replace(motion, known_position=flags, known_rotation=flags, known_joints=flags)
    settled, report = settled_feet(motion, SKELETON, 0.0)
    np.testing.assert_array_equal(settled.root_position, motion.root_position)
    np.testing.assert_array_equal(settled.joint_rotations, motion.joint_rotations)
    assert report.kept.all() and report.below_m == pytest.approx(0.02, abs=1e-6)


@pytest.mark.parametrize("rate", [12.5, 25.0, 50.0])
def test_a_jump_stays_a_jump(rate):
    times = np.arange(int(2.0 * rate)) / rate
    up = np.where((times > 0.7) & (times < 1.3), 4.9 * (times - 0.7) * (1.3 - times), 0.0)
    motion = moved(standing(len(times), rate), np.stack([0 * up, 0.5 * (times - 0.7).clip(0, 0.6), up], axis=1))
    settled, report = settled_feet(motion, SKELETON, 0.0)
    air = up > 0.1
    assert not any(air[stance.frames].any() for stance in report.stances)
    np.testing.assert_allclose(soles_of(settled)[air][..., 2], soles_of(motion)[air][..., 2], atol=0.06)
    assert soles_of(settled)[air][..., 2].min() > SOLE_M


def test_knees_are_never_bent_backwards():
    motion = noisy(moved(motion_of(np.zeros((50, 3)), posed(50, 0.0), 25.0), np.array([0.0, 0.0, 0.96])))
    settled, _ = settled_feet(motion, SKELETON, 0.0)
    body = body_of(settled, SKELETON)
    for leg in LEGS:
        knees = Rotation.from_rotvec(body.local[:, leg.knee]).as_matrix()
        law = hinge_of(leg, knees, body.bones[:, leg.knee], body.bones[:, leg.ankle])
        assert (-law.straight).min() > LEAST_BEND - 1e-6


def test_stances_out_of_reach_are_given_up_and_said():
    """Straight legs under a known root cannot bend without leaving the ground by a hair."""
    straight = motion_of(np.zeros((20, 3)), posed(20, 0.0), 25.0)
    straight = moved(straight, np.array([0.0, 0.0, -soles_of(straight)[..., 2].min()]))
    straight = replace(skating(straight, 0.05), known_position=np.ones(20, dtype=bool))
    settled, report = settled_feet(straight, SKELETON, 0.0)
    np.testing.assert_array_equal(settled.root_position, straight.root_position)
    assert report.stances and not report.given_up
    settled, report = settled_feet(straight, SKELETON, 0.0, SettleOptions(given_up_m=1e-5))
    assert {stance.foot for stance in report.given_up} == {0, 1}
    frames = [(s.foot, k) for s in (*report.stances, *report.given_up) for k in range(s.first, s.last + 1)]
    assert sorted(frames) == [(foot, k) for foot in (0, 1) for k in range(20)]
    assert soles_of(settled)[..., 2].min() > -1e-6


@pytest.mark.parametrize("frames", [1, 2, 3, 4])
@pytest.mark.parametrize("rate", [4.0, 50.0])
def test_few_frames_are_settled(frames, rate):
    motion = moved(noisy(standing(frames, rate)), np.array([0.0, 0.0, -0.03]))
    settled, report = settled_feet(motion, SKELETON, 0.0)
    assert np.isfinite(settled.joint_rotations).all() and np.isfinite(settled.root_position).all()
    assert soles_of(settled)[..., 2].min() > -1e-6 and report.below_m < 1e-6


def test_uneven_times_and_another_floor_are_fine():
    motion = noisy(walking())
    rows = np.flatnonzero(np.random.default_rng(0).random(len(motion.times)) < 0.7)
    some = {name: np.asarray(getattr(motion, name))[rows] for name in motion.__dataclass_fields__}
    motion = PlayerMotion(**some)
    settled, _ = settled_feet(motion, SKELETON, 0.0)
    lifted, _ = settled_feet(moved(motion, np.array([0.0, 0.0, 1.5])), SKELETON, 1.5)
    np.testing.assert_allclose(lifted.root_position - settled.root_position, [[0, 0, 1.5]] * len(rows), atol=1e-6)
    assert soles_of(settled)[..., 2].min() > -1e-6


def test_what_settling_does_turns_and_moves_along_with_the_world():
    motion = noisy(walking())
    turn = Rotation.from_euler("z", 1.1)
    at = turn.apply(motion.root_position) + [3.0, -2.0, 0.0]
    facing = (turn * Rotation.from_rotvec(motion.root_rotation)).as_rotvec()
    turned = replace(moved(motion, at - motion.root_position), root_rotation=facing)
    here, there = (settled_feet(m, SKELETON, 0.0)[0] for m in (motion, turned))
    # Places are medians of each coordinate, which do not turn along to the last millimetre.
    np.testing.assert_allclose(there.root_position, turn.apply(here.root_position) + [3.0, -2.0, 0.0], atol=0.03)


def test_skeletons_without_legs_and_ground_that_is_not_flat_are_left_with_a_word():
    blocks = load_skeleton("blocks13")
    zeros = np.zeros((5, 13, 3))
    flags = np.zeros(5, dtype=bool)
    motion = PlayerMotion(
        times=np.arange(5.0),
        root_position=zeros[:, 0],
        root_rotation=zeros[:, 0],
        joint_rotations=zeros,
        joint_translations=blocks.rest_translations,
        known_position=flags,
        known_rotation=flags,
        known_joints=flags,
    )
    settled, report = settled_feet(motion, blocks, 0.0)
    assert settled is motion and "blocks13" in report.left_because and report.kept.all()
    motion = standing(5)
    settled, report = settled_feet(motion, SKELETON, None)
    assert settled is motion and "not flat" in report.left_because
    with pytest.raises(ValueError, match="24 joints of smpl24, got 13"):
        settled_feet(replace(motion, joint_rotations=zeros, joint_translations=zeros), SKELETON, 0.0)


def test_wrong_motion_is_refused_with_its_place():
    motion = standing(5)
    bad = motion.root_position.copy()
    bad[3, 1] = np.nan
    with pytest.raises(ValueError, match=r"root_position: .*got nan at \[3, 1\]"):
        replace(motion, root_position=bad)
    with pytest.raises(ValueError, match="times: expected rising ones, got others at frame 2"):
        replace(motion, times=np.array([0.0, 1.0, 1.0, 2.0, 3.0]))
    with pytest.raises(ValueError, match=r"SettleOptions.root_hz: expected more than 0, got 0"):
        SettleOptions(root_hz=0)


@pytest.mark.parametrize("share", [0.3, 0.7, 0.95])
def test_legs_reach_by_bending_the_knee_forward(share):
    leg = LEGS[1]
    rng = np.random.default_rng(3)
    hip = Rotation.from_rotvec(rng.normal(size=(20, 3))).as_matrix()
    knee = Rotation.from_rotvec(rng.normal([0.6, 0, 0], 0.1, (20, 3))).as_matrix()
    thigh, shin = (np.tile(SKELETON.rest_translations[joint], (20, 1)) for joint in (leg.knee, leg.ankle))
    law = hinge_of(leg, knee, thigh, shin)
    goal = (share * law.longest)[:, None] * Rotation.from_rotvec(rng.normal(size=(20, 3))).apply([0.0, 0.0, 1.0])
    hip_new, knee_new = bent(leg, hip, knee, thigh, shin, goal)
    ankle = (hip_new @ (thigh + (knee_new @ shin[..., None])[..., 0])[..., None])[..., 0]
    np.testing.assert_allclose(ankle, goal, atol=1e-9)
    assert (-hinge_of(leg, knee_new, thigh, shin).straight > 0).all()
    far, _ = bent(leg, hip, knee, thigh, shin, 3 * goal / share)
    assert np.isfinite(far).all()
