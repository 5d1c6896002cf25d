"""Bodies' shapes from another program beside points of the pictures."""

import numpy as np
import pytest

from pgm_data.people import PlayerPoses
from pgm_data.skeleton import load_skeleton, world_joints
from pgm_data.stages.players_shapes import with_shapes

SMPL = load_skeleton("smpl24")
FRAMES = 4


def poses(names=("left_knee", "nose", "left_big_toe"), players=("player0", "player1")) -> PlayerPoses:
    shape = (FRAMES, len(players), len(names))
    return PlayerPoses(
        names=players,
        point_names=names,
        points_px=np.zeros((*shape, 2)),
        score=np.ones(shape),
        sigma_px=np.ones(shape),
        points_ray=np.full((*shape, 3), 9.0),
    )


def rest_joints(frames: int) -> np.ndarray:
    rest = np.tile(SMPL.rest_translations, (frames, 1, 1))
    return world_joints(SMPL.parents, np.zeros_like(rest), rest)


def test_a_joint_of_the_file_stands_at_its_point_and_others_are_unknown(tmp_path):
    joints = rest_joints(2)
    np.savez(tmp_path / "a.npz", joints=joints, frame_index=np.array([1, 3]), player=np.array("player1"))
    found = with_shapes(poses(), tmp_path / "a.npz").points_ray
    np.testing.assert_allclose(found[[1, 3], 1, 0], joints[:, SMPL.joint_names.index("L_Knee")])
    assert np.isnan(found[:, 0]).all()
    assert np.isnan(found[[0, 2]]).all()
    assert np.isnan(found[:, :, 1]).all()  # SMPL's joints have no nose


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"player": np.array("player7")}, "player: expected names among player0, player1, got 'player7'"),
        ({}, "player: expected a name among player0, player1"),
        ({"player": np.array("player0"), "frame_index": np.array([0, 9])}, "frame_index: expected frames 0 to 3"),
    ],
)
def test_what_does_not_fit_the_clip_is_refused(tmp_path, changes, message):
    np.savez(tmp_path / "a.npz", joints=rest_joints(2), **changes)
    with pytest.raises(ValueError, match=message):
        with_shapes(poses(), tmp_path / "a.npz")


def test_shapes_without_points_have_nothing_to_be_registered_to(tmp_path):
    np.savez(tmp_path / "a.npz", joints=rest_joints(2), player=np.array("player0"))
    with pytest.raises(ValueError, match="expected body points"):
        with_shapes(poses(names=()), tmp_path / "a.npz")
