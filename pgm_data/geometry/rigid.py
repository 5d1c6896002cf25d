"""Rotations and rigid transforms with any leading batch axes."""

import numpy as np
from jaxtyping import Float

SMALL_ANGLE = 1e-4
"""Radians below which series replace the closed forms (their error is then under 1e-17)."""


def skew(vector: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 3 3"]:
    """The matrix whose product with any w is the cross product ``vector x w``."""
    x, y, z = vector[..., 0], vector[..., 1], vector[..., 2]
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*vector.shape[:-1], 3, 3)


def rotation_from_rotvec(rotvec: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 3 3"]:
    """Rotation matrices of axis-angle vectors, radians (Rodrigues' formula, series near zero)."""
    rotvec = np.asarray(rotvec, np.float64)
    angle = np.linalg.norm(rotvec, axis=-1)[..., None, None]
    small = angle < SMALL_ANGLE
    safe = np.where(small, 1.0, angle)
    sinc = np.where(small, 1 - angle**2 / 6, np.sin(safe) / safe)
    cosc = np.where(small, 0.5 - angle**2 / 24, 2 * np.sin(safe / 2) ** 2 / safe**2)
    k = skew(rotvec)
    return np.eye(3) + sinc * k + cosc * (k @ k)


def rotvec_from_rotation(R: Float[np.ndarray, "*batch 3 3"]) -> Float[np.ndarray, "*batch 3"]:
    """Axis-angle vectors of rotation matrices, radians, angle in [0, pi]; NaN of NaN.

    At exactly pi the axis is known up to its sign; one of the two is returned.
    """
    from scipy.spatial.transform import Rotation

    flat = np.asarray(R, np.float64).reshape(-1, 3, 3)
    finite = np.isfinite(flat).all(axis=(1, 2))
    rotvec = np.full((len(flat), 3), np.nan)
    if finite.any():
        rotvec[finite] = Rotation.from_matrix(flat[finite]).as_rotvec()
    return rotvec.reshape(*R.shape[:-2], 3)


def compose(
    R_c_from_b: Float[np.ndarray, "*#batch 3 3"],
    t_c_from_b: Float[np.ndarray, "*#batch 3"],
    R_b_from_a: Float[np.ndarray, "*#batch 3 3"],
    t_b_from_a: Float[np.ndarray, "*#batch 3"],
) -> tuple[Float[np.ndarray, "... 3 3"], Float[np.ndarray, "... 3"]]:
    """Rotation and translation of c_from_a = c_from_b @ b_from_a."""
    return R_c_from_b @ R_b_from_a, (R_c_from_b @ t_b_from_a[..., None])[..., 0] + t_c_from_b


def invert(
    R_b_from_a: Float[np.ndarray, "*#batch 3 3"], t_b_from_a: Float[np.ndarray, "*#batch 3"]
) -> tuple[Float[np.ndarray, "... 3 3"], Float[np.ndarray, "... 3"]]:
    """Rotation and translation of a_from_b."""
    R_a_from_b = np.swapaxes(R_b_from_a, -1, -2)
    return R_a_from_b, -(R_a_from_b @ t_b_from_a[..., None])[..., 0]


def transform(
    R_b_from_a: Float[np.ndarray, "*#batch 3 3"],
    t_b_from_a: Float[np.ndarray, "*#batch 3"],
    points_a: Float[np.ndarray, "*#batch points 3"],
) -> Float[np.ndarray, "... points 3"]:
    """Points in frame b."""
    return points_a @ np.swapaxes(R_b_from_a, -1, -2) + t_b_from_a[..., None, :]


def is_rotation(R: Float[np.ndarray, "*#batch 3 3"], atol: float = 1e-6) -> bool:
    """Whether all matrices are orthonormal and right-handed."""
    orthonormal = np.allclose(R @ np.swapaxes(R, -1, -2), np.eye(3), atol=atol)
    return bool(orthonormal and np.all(np.linalg.det(R) > 0))
