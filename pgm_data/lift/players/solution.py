"""What comes out of registering a player's skeleton to the calibrated camera."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Shaped


@dataclass(frozen=True, eq=False, kw_only=True)
class PlayerMotion:
    """One player in the world, one row a frame; NaN where the status is `none`.

    Where a box but no pose is known, root and its covariance are there and everything of joints is NaN.
    """

    name: str
    """Player object of the scene."""
    root_position: Float[np.ndarray, "frames 3"]
    """World metres."""
    joints: Float[np.ndarray, "frames joints 3"]
    """World metres; what the rotations and translations lead to, to 1e-5."""
    joint_rotations: Float[np.ndarray, "frames joints 3"]
    """Axis-angle of parent_from_joint, radians; entry 0 is world_from_root."""
    joint_translations: Float[np.ndarray, "frames joints 3"]
    """Of parent_from_joint, metres; entry 0 is the root in the world."""
    root_cov: Float[np.ndarray, "frames 3 3"]
    """m^2, the camera's own doubt included."""
    contact: Float[np.ndarray, "frames 2"]
    """Probability that the left, the right foot is on the ground."""
    reprojection_px: Float[np.ndarray, " frames"]
    """Rms of 2D distances of the points found; NaN without any."""
    status: Shaped[np.ndarray, " frames"]
    """`measured`: by this frame's own points; `filled`: by its neighbours; `none`."""
    scale: float
    """Size over that of the skeleton file; NaN where nothing was solved."""
    scale_std: float
    said: str
    """Why there is nothing, or what was found odd; else empty."""
