"""Frames in which a body would lie under the ground come back as none."""

import numpy as np

from pgm_data.lift.players.solution import PlayerMotion
from pgm_data.stages.players_withheld import without_buried


def test_a_buried_body_is_withheld_and_its_neighbours_stay():
    joints = np.zeros((4, 3, 3))
    joints[1, 2, 2] = -0.3
    joints[2, 2, 2] = -0.3
    cov = np.tile(1e-6 * np.eye(3), (4, 1, 1))
    cov[2] = 0.01 * np.eye(3)
    motion = PlayerMotion(
        name="player0",
        root_position=np.zeros((4, 3)),
        joints=joints,
        joint_rotations=np.zeros((4, 3, 3)),
        joint_translations=np.zeros((4, 3, 3)),
        root_cov=cov,
        contact=np.ones((4, 2)),
        reprojection_px=np.ones(4),
        status=np.full(4, "measured", dtype=object),
        scale=1.0,
        scale_std=0.01,
        said="",
    )
    kept = without_buried(motion, 0.0)
    assert kept.status.tolist() == ["measured", "none", "measured", "measured"]
    assert np.isnan(kept.joints[1]).all() and np.isfinite(kept.joints[[0, 2, 3]]).all()
    assert "1 frames not believed" in kept.said
    assert without_buried(kept, 0.0) is kept
