"""Rotations as tangent vectors at a reference: v = log(R_ref^T R), radians, made continuous in time.

Every v + 2 pi k v / |v| with a whole k is the same rotation: which of them is meant follows from the one before.
"""

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import Rotation

STILL = 1e-6
"""Radians below which a rotation has no axis of its own."""


def tangent_from_rotvec(
    rotvec: Float[np.ndarray, "rows rotations 3"], reference: Float[np.ndarray, "rotations 3"]
) -> Float[np.ndarray, "rows rotations 3"]:
    """Tangent vectors within pi of axis-angle vectors, radians.

    Args:
        rotvec: Axis-angle vectors, radians; of any length.
        reference: Of the references, likewise.
    """
    return _product(np.broadcast_to(-reference, rotvec.shape), rotvec)


def rotvec_from_tangent(
    tangent: Float[np.ndarray, "rows rotations 3"], reference: Float[np.ndarray, "rotations 3"]
) -> Float[np.ndarray, "rows rotations 3"]:
    """Axis-angle vectors within pi of tangent vectors, radians; the inverse of `tangent_from_rotvec`."""
    return _product(np.broadcast_to(reference, tangent.shape), tangent)


def _product(
    left: Float[np.ndarray, "*batch 3"], right: Float[np.ndarray, "*batch 3"]
) -> Float[np.ndarray, "*batch 3"]:
    """Axis-angle of the product of rotations."""
    if not right.size:
        return np.zeros(right.shape)
    # scipy takes no read-only arrays.
    first, second = (
        Rotation.from_rotvec(np.array(vectors, dtype=np.float64).reshape(-1, 3)) for vectors in (left, right)
    )
    return (first * second).as_rotvec().reshape(right.shape)


def mean_rotvec(summed: Float[np.ndarray, "rotations 3 3"]) -> Float[np.ndarray, "rotations 3"]:
    """Axis-angle of the chordal mean of rotations, of the sum of their matrices.

    Source: Moakher, "Means and averaging in the group of rotations", SIAM J. Matrix Anal. Appl. 24 (2002).
    """
    U, _, Vt = np.linalg.svd(summed)
    U[..., 2] *= np.sign(np.linalg.det(U @ Vt))[:, None]
    return Rotation.from_matrix(U @ Vt).as_rotvec()


def continuous_tangents(
    tangent: Float[np.ndarray, "windows frames rotations 3"], valid: Bool[np.ndarray, "windows frames rotations"]
) -> Float[np.ndarray, "windows frames rotations 3"]:
    """The same rotations, each by the tangent vector nearest to that of the last valid frame before.

    The first valid one stays as it is, and so does what is not valid.
    """
    frames = tangent.shape[1]
    ordinal = np.where(valid, np.arange(frames)[:, None], -1)
    last = np.maximum.accumulate(ordinal, axis=1)[:, :-1]
    earlier = np.take_along_axis(tangent, np.maximum(last, 0)[..., None], axis=1)
    later = tangent[:, 1:]
    length = np.sqrt(np.einsum("...i,...i->...", later, later))
    # Of vectors within pi, none but these have a nearer equal: without them all stays as it is.
    turns = np.einsum("...i,...i->...", later, earlier) < length * (length - np.pi)
    far = (length > np.pi).any(axis=1) | (np.einsum("...i,...i->...", tangent[:, 0], tangent[:, 0]) > np.pi**2)
    wound = (turns & valid[:, 1:] & (last >= 0)).any(axis=1) | far
    result = tangent.copy()
    if wound.any():
        window, rotation = np.nonzero(wound)
        result[window, :, rotation] = _wound(tangent[window, :, rotation], valid[window, :, rotation])
    return result


def _wound(
    tangent: Float[np.ndarray, "tracks frames 3"], valid: Bool[np.ndarray, "tracks frames"]
) -> Float[np.ndarray, "tracks frames 3"]:
    """The same rotations, frame after frame."""
    result = tangent.copy()
    last, begun = result[:, 0], valid[:, 0]
    for frame in range(1, tangent.shape[1]):
        now = valid[:, frame]
        near = nearest_equal(result[:, frame], last)
        result[:, frame] = np.where((now & begun)[:, None], near, result[:, frame])
        last = np.where(now[:, None], result[:, frame], last)
        begun = begun | now
    return result


def nearest_equal(
    tangent: Float[np.ndarray, "*#batch 3"], target: Float[np.ndarray, "*#batch 3"]
) -> Float[np.ndarray, "*batch 3"]:
    """Of all tangent vectors of the same rotation the one nearest to the target; where nothing turns, along it."""
    length = np.linalg.norm(tangent, axis=-1, keepdims=True)
    reach = np.linalg.norm(target, axis=-1, keepdims=True)
    onto = target / np.where(reach > 0, reach, 1)
    still = length < STILL
    axis = np.where(still, onto, tangent / np.where(still, 1, length))
    along = np.where(still, (tangent * onto).sum(axis=-1, keepdims=True), length)
    turns = np.round(((axis * target).sum(axis=-1, keepdims=True) - along) / (2 * np.pi))
    return np.where(turns == 0, tangent, (along + 2 * np.pi * turns) * axis).astype(tangent.dtype)
