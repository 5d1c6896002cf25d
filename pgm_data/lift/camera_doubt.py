"""How far off a calibrated camera may be, as the solvers that build on it take it into account."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True, eq=False, kw_only=True)
class CameraDoubt:
    """How far off a clip's camera may be: one error that all its frames share."""

    position_cov: Float[np.ndarray, "3 3"]
    """Of the camera's centre, m^2; zeros where it is exact."""
    focal_std_share: float
    """Standard deviation of the focal length over it; 0 where it is exact."""
    pixel_std: float
    """What the pixels of fixed points scatter about it from frame to frame, px; 0 where it is exact."""


def no_doubt() -> CameraDoubt:
    """An exact camera."""
    return CameraDoubt(position_cov=np.zeros((3, 3)), focal_std_share=0.0, pixel_std=0.0)
