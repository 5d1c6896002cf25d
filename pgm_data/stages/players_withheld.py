"""Bodies that nobody can have are not told of as if somebody had: such frames come back as `none`."""

from dataclasses import replace

import numpy as np

from pgm_data.dataset.play_laws import DEVIATIONS
from pgm_data.dataset.player_laws import BELOW_GROUND_M
from pgm_data.lift.players.solution import PlayerMotion


def without_buried(motion: PlayerMotion, floor_z: float) -> PlayerMotion:
    """The motion without frames in which a joint lies deeper under the ground than its uncertainty excuses.

    Args:
        motion: One player's.
        floor_z: Height of the ground, m.
    """
    std = np.sqrt(np.maximum(np.nan_to_num(motion.root_cov[:, 2, 2]), 0.0))
    lowest = np.min(motion.joints[..., 2], axis=1, initial=np.inf)
    lost = np.asarray(lowest < floor_z - BELOW_GROUND_M - DEVIATIONS * std)
    if not lost.any():
        return motion

    def blank(values: np.ndarray) -> np.ndarray:
        return np.where(lost.reshape(-1, *[1] * (values.ndim - 1)), np.nan, values)

    names = ("root_position", "joints", "joint_rotations", "joint_translations", "root_cov", "contact")
    said = f"{int(lost.sum())} frames not believed: joints under the ground"
    return replace(
        motion,
        **{name: blank(getattr(motion, name)) for name in (*names, "reprojection_px")},
        status=np.where(lost, "none", motion.status).astype(object),
        said="; ".join(part for part in (motion.said, said) if part),
    )
