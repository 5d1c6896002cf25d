"""Forward kinematics in few angles, and their derivatives."""

import numpy as np
import pytest

from pgm_data.geometry.rigid import rotation_from_rotvec, rotvec_from_rotation
from pgm_data.lift.players.linkage import Posture, left_jacobian, linked, parameters, placed, rotvecs
from pgm_data.lift.players.stance import bounds, strays, waiting
from pgm_data.skeleton import load_skeleton, world_joints


def bent(name: str, frames: int = 3):
    """A linkage in postures by lot."""
    rng = np.random.default_rng(1)
    skeleton = load_skeleton(name)
    linkage = linked(skeleton, skeleton.keypoint_names, waiting(skeleton))
    posture = Posture(
        position=rng.normal(size=(frames, 3)),
        rotation=rotation_from_rotvec(rng.normal(size=(frames, 3))),
        angles=0.4 * rng.normal(size=(frames, linkage.basis.shape[-1])),
        log_scale=0.05,
    )
    return linkage, posture


@pytest.mark.parametrize("name", ["smpl24", "blocks13"])
def test_slopes_are_those_of_small_differences(name: str) -> None:
    linkage, posture = bent(name)
    points, by_scale, slopes = placed(linkage, posture, slopes=True)
    assert slopes is not None and by_scale is not None
    small = 1e-6
    for unknown in range(slopes.shape[-1]):
        step = np.zeros(slopes.shape[-1])
        step[unknown] = small
        moved = Posture(
            position=posture.position + step[:3],
            rotation=rotation_from_rotvec(step[3:6]) @ posture.rotation,
            angles=posture.angles + step[6:],
            log_scale=posture.log_scale,
        )
        want = (placed(linkage, moved, slopes=False)[0] - points) / small
        np.testing.assert_allclose(slopes[..., unknown], want, atol=2e-5)
    grown = Posture(
        position=posture.position,
        rotation=posture.rotation,
        angles=posture.angles,
        log_scale=posture.log_scale + small,
    )
    np.testing.assert_allclose(by_scale, (placed(linkage, grown, slopes=False)[0] - points) / small, atol=2e-5)


@pytest.mark.parametrize("name", ["smpl24", "blocks13"])
def test_parameters_lead_to_the_joints(name: str) -> None:
    linkage, posture = bent(name)
    _, joints, translations = parameters(linkage, posture)
    rotations = rotvecs(linkage, posture)
    rotations[:, 0] = rotvec_from_rotation(posture.rotation)
    np.testing.assert_allclose(world_joints(linkage.skeleton.parents, rotations, translations), joints, atol=1e-9)


def test_left_jacobian_near_zero_and_beyond() -> None:
    for vector in (np.zeros(3), np.array([1e-6, 0, 0]), np.array([0.3, -2.0, 1.0])):
        small = 1e-7 * np.array([1.0, 2.0, -1.0])
        want = rotvec_from_rotation(rotation_from_rotvec(vector + small) @ rotation_from_rotvec(vector).T)
        np.testing.assert_allclose(left_jacobian(vector) @ small, want, atol=1e-12)


def test_what_no_point_shows_is_left_out() -> None:
    skeleton = load_skeleton("smpl24")
    linkage = linked(skeleton, skeleton.keypoint_names, waiting(skeleton))
    turning = {skeleton.joint_names[j] for j in np.flatnonzero(np.any(linkage.basis != 0, axis=(1, 2)))}
    # Hands have no point; toes move none that is seen; a spine's three joints bend as one.
    assert not turning & {"L_Wrist", "L_Hand", "R_Hand", "L_Toe", "R_Toe", "Pelvis"}
    assert {"L_Hip", "L_Knee", "L_Ankle", "L_Elbow", "Head"} <= turning
    spine = linkage.basis[skeleton.joint_names.index("Torso")]
    np.testing.assert_array_equal(spine, linkage.basis[skeleton.joint_names.index("Chest")])


def test_angles_of_reference_are_within_the_limits_and_mirrored() -> None:
    for name in ("smpl24", "blocks13"):
        skeleton = load_skeleton(name)
        linkage = linked(skeleton, skeleton.keypoint_names, waiting(skeleton))
        low, high = bounds(linkage)
        assert np.all(low <= 0) and np.all(high >= 0)
        assert np.all(strays(linkage) > 0)
    joints = world_joints(
        load_skeleton("smpl24").parents,
        waiting(load_skeleton("smpl24"))[None],
        load_skeleton("smpl24").rest_translations[None],
    )[0]
    names = load_skeleton("smpl24").joint_names
    left, right = joints[names.index("L_Wrist")], joints[names.index("R_Wrist")]
    np.testing.assert_allclose(left, right * [-1, 1, 1], atol=1e-12)


def test_an_unknown_point_is_named() -> None:
    skeleton = load_skeleton("smpl24")
    with pytest.raises(ValueError, match="points: expected some of nose.*got 'tail'"):
        linked(skeleton, ("nose", "tail"), waiting(skeleton))
