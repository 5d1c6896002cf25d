"""Rotations and cameras drawn by hypothesis."""

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from pgm_data.geometry.camera import Camera

unit = st.floats(-1, 1, allow_subnormal=False)
rotvecs = arrays(np.float64, 3, elements=st.floats(-1.8, 1.8, allow_subnormal=False))
"""Axis-angle vectors of at most 1.8 sqrt(3) = 3.1 rad, so below pi."""


@st.composite
def rotations(draw) -> np.ndarray:
    """Rotation matrices, made by scipy and not by what is tested."""
    return Rotation.from_rotvec(draw(rotvecs)).as_matrix()


@st.composite
def cameras(draw, *, lens: bool = True, tangential: bool = False) -> Camera:
    """Cameras with focal lengths of 200 to 50,000 px and lenses that do not fold within two half diagonals."""
    width, height = draw(st.sampled_from([(640, 360), (1080, 1920), (3840, 2160)]))
    focal = draw(st.floats(200, 50_000))
    centre = np.array([width, height]) * (0.5 + 0.1 * np.array([draw(unit), draw(unit)]))
    K = np.array([[focal, 0, centre[0]], [0, focal, centre[1]], [0, 0, 1]])
    # Lenses are as they are over the half diagonal; OpenCV's terms follow from the focal length.
    per_focal = focal / np.hypot(width / 2, height / 2)
    k1 = draw(st.floats(-0.05, 0.2)) * per_focal**2
    k2 = draw(st.floats(0, 0.02)) * per_focal**4
    p = [draw(unit) * 1e-3 if tangential else 0.0 for _ in range(2)]
    return Camera(
        K=K,
        distortion=np.array([k1, k2, *p]) if lens else np.zeros(4),
        R_cam_from_world=draw(rotations()),
        t_cam_from_world=draw(arrays(np.float64, 3, elements=st.floats(-60, 60, allow_subnormal=False))),
    )


def pixels_of(camera: Camera, share: np.ndarray) -> np.ndarray:
    """Pixels of the picture: shares of -1 to 1 of it about its centre."""
    return camera.K[:2, 2] * (1 + share)
