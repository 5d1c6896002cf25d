"""The posture of an athlete who waits, from which fits start, and how far postures stray from it."""

import numpy as np
from jaxtyping import Float

from pgm_data.lift.players.linkage import Linkage
from pgm_data.skeleton import Skeleton

REST_HEIGHT_M = 1.8
"""Height of the person for whom skeleton files are drawn."""
_FREE, _SHARE, _LEAST = 0.9, 0.4, 0.08
"""Radians where nothing limits a component; share of half of the range that limits leave; the least."""

# x, y, z of the left side's joint, radians; a vector on the right side is mirrored: y and z change sign.
_WAITING = {
    "Hip": (-0.5, 0.0, 0.15),
    "Knee": (0.8, 0.0, 0.0),
    "Ankle": (-0.3, 0.0, -0.12),
    "Torso": (0.07, 0.0, 0.0),
    "Spine": (0.07, 0.0, 0.0),
    "Chest": (0.07, 0.0, 0.0),
    "Neck": (-0.1, 0.0, 0.0),
    "Head": (-0.1, 0.0, 0.0),
    "Shoulder": (0.0, -0.7, -1.1),
    "Elbow": (0.0, -1.2, 0.0),
}
# Standard deviations, radians: knees and elbows are hinges, collar bones are short.
_STRAYS = {
    "Hip": (0.5, 0.3, 0.3),
    "Knee": (0.5, 0.08, 0.06),
    "Ankle": (0.35, 0.25, 0.25),
    "Torso": (0.3, 0.45, 0.25),
    "Neck": (0.4, 0.6, 0.25),
    "Thorax": (0.08, 0.2, 0.2),
    "Shoulder": (0.8, 0.8, 0.8),
    "Elbow": (0.6, 0.7, 0.35),
}


def _part(name: str) -> tuple[str, np.ndarray]:
    """A joint's name without its side, and what mirrors its vectors."""
    if name.startswith("L_"):
        return name[2:], np.ones(3)
    if name.startswith("R_"):
        return name[2:], np.array([1.0, -1.0, -1.0])
    return name, np.ones(3)


def waiting(skeleton: Skeleton) -> Float[np.ndarray, "joints 3"]:
    """Axis-angle of parent_from_joint of one who waits, radians; the rest pose of joints with names unknown here."""
    rows = []
    for name in skeleton.joint_names:
        part, mirror = _part(name)
        rows.append(mirror * np.array(_WAITING.get(part, (0.0, 0.0, 0.0))))
    return np.clip(np.array(rows), *np.swapaxes(skeleton.limits, 0, 1))


def strays(linkage: Linkage) -> Float[np.ndarray, " unknowns"]:
    """Standard deviation of each unknown about the posture of reference, radians.

    By the joint's name, or as a share of the range that its limits leave.
    """
    low, high = bounds(linkage)
    out = np.empty(linkage.basis.shape[-1])
    for unknown in range(len(out)):
        joint, axis = np.argwhere(linkage.basis[..., unknown] != 0)[0]
        part, _ = _part(linkage.skeleton.joint_names[joint])
        half = 0.5 * (high[unknown] - low[unknown])
        by_limits = np.clip(_SHARE * half, _LEAST, _FREE) if np.isfinite(half) else _FREE
        out[unknown] = _STRAYS[part][axis] if part in _STRAYS else by_limits
    return out


def bounds(linkage: Linkage) -> tuple[Float[np.ndarray, " unknowns"], Float[np.ndarray, " unknowns"]]:
    """Lowest and highest value of each unknown that the skeleton's limits allow, radians; infinite without a limit."""
    room = linkage.skeleton.limits - linkage.reference[:, None]
    shares = np.where(linkage.basis > 0, linkage.basis, np.nan)
    with np.errstate(invalid="ignore"):
        low = np.nanmax(room[:, 0, :, None] / shares, axis=(0, 1))
        high = np.nanmin(room[:, 1, :, None] / shares, axis=(0, 1))
    return low, high
