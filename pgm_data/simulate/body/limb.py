"""A limb of two bones from its root to a wanted end: hip, knee, ankle, or shoulder, elbow, wrist."""

import numpy as np
from jaxtyping import Bool, Float

from pgm_data.simulate import rotations

KNEE_AT_REST = np.array([0.0, 0.0, 1.0])
"""Where a knee bends to at rest, in the frame of the figure: forwards."""
ELBOW_AT_REST = np.array([0.0, 0.0, -1.0])
"""Where an elbow bends to at rest, arms out and palms down: backwards."""
_TINY_M = 1e-9


def hinge_axis(
    upper_rest: Float[np.ndarray, " 3"], lower_rest: Float[np.ndarray, " 3"], rest_pole: Float[np.ndarray, " 3"]
) -> Float[np.ndarray, " 3"]:
    """Unit axis of the middle joint in the upper bone's frame; turning about it by a positive angle bends the limb.

    Raises:
        ValueError: If the limb at rest points along its pole, or has no length.
    """
    axis = np.cross(rest_pole, upper_rest + lower_rest)
    length = float(np.linalg.norm(axis))
    if length < 1e-6:
        raise ValueError(f"rest_pole: expected across the limb {upper_rest + lower_rest}, got {rest_pole}")
    return axis / length


def reach(
    upper_rest: Float[np.ndarray, " 3"], lower_rest: Float[np.ndarray, " 3"], rest_pole: Float[np.ndarray, " 3"]
) -> tuple[float, float]:
    """Shortest and longest distance, metres, from the limb's root to its end."""
    return _law_of_cosines(upper_rest, lower_rest, hinge_axis(upper_rest, lower_rest, rest_pole))[1]


def two_bone(
    root_world: Float[np.ndarray, "times 3"],
    R_world_from_parent: Float[np.ndarray, "times 3 3"],
    upper_rest: Float[np.ndarray, " 3"],
    lower_rest: Float[np.ndarray, " 3"],
    target: Float[np.ndarray, "times 3"],
    pole: Float[np.ndarray, "times 3"],
    rest_pole: Float[np.ndarray, " 3"],
) -> tuple[Float[np.ndarray, "times 3 3"], Float[np.ndarray, "times 3 3"], Bool[np.ndarray, " times"]]:
    """R_parent_from_upper, R_upper_from_lower and whether the limb's end is at the target.

    The middle joint is a hinge: it turns about `hinge_axis` alone, to the side of the pole. A target out of reach
    gives a straight (or wholly folded) limb towards it.

    Args:
        root_world: Hip or shoulder, world metres.
        R_world_from_parent: Of the joint that carries the root.
        upper_rest: Middle joint from the root at rest, metres: the figure's translation of knee or elbow.
        lower_rest: End from the middle joint at rest, metres.
        target: Where the end shall be, world metres.
        pole: World direction, of any length, in which the middle joint bends. Where it points along the limb, the
            parent's own hinge axis serves.
        rest_pole: The same direction at rest: KNEE_AT_REST or ELBOW_AT_REST.
    """
    axis = hinge_axis(upper_rest, lower_rest, rest_pole)
    (constant, swing, straight_angle), (folded, straight) = _law_of_cosines(upper_rest, lower_rest, axis)
    way = target - root_world
    distance = np.linalg.norm(way, axis=-1)
    length = np.clip(distance, folded, straight)
    bend = straight_angle + np.arccos(np.clip((length**2 - constant) / (2.0 * swing), -1.0, 1.0))
    R_upper_from_lower = rotations.from_axis_angle(bend[:, None] * axis)

    # A limb folded onto itself has no direction of its own; it folds away from the pole.
    limb = _unit(upper_rest + R_upper_from_lower @ lower_rest, -rest_pole)
    along = _unit(way, (R_world_from_parent @ limb[:, :, None])[:, :, 0])
    parent_axis = R_world_from_parent @ axis
    # Third choice for a limb that points along both the pole and the parent's axis.
    spare = _unit(np.cross(along, np.roll(along, 1, axis=-1) + [0.0, 0.0, 1e-3]), along)
    across = _unit(np.cross(pole, along), _unit(_rejection(parent_axis, along), spare))
    R_world_from_upper = _frame(along, across) @ np.swapaxes(_frame(limb, _rejection(axis, limb)), -1, -2)
    R_parent_from_upper = np.swapaxes(R_world_from_parent, -1, -2) @ R_world_from_upper
    return R_parent_from_upper, R_upper_from_lower, np.abs(distance - length) <= _TINY_M


def _law_of_cosines(
    upper: np.ndarray, lower: np.ndarray, axis: np.ndarray
) -> tuple[tuple[float, float, float], tuple[float, float]]:
    """(constant, swing, straight angle) of distance^2 = constant + 2 swing cos(bend - straight), and its extremes."""
    level = (upper @ axis) * (lower @ axis)
    cosine, sine = upper @ lower - level, upper @ np.cross(axis, lower)
    swing = float(np.hypot(cosine, sine))
    constant = float(upper @ upper + lower @ lower + 2.0 * level)
    folded = float(np.sqrt(max(constant - 2.0 * swing, 0.0)))
    return (constant, swing, float(np.arctan2(sine, cosine))), (folded, float(np.sqrt(constant + 2.0 * swing)))


def _unit(vectors: np.ndarray, instead: np.ndarray) -> np.ndarray:
    """Unit vectors; the second argument's where there is no direction."""
    size = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.where(size > _TINY_M, vectors / np.maximum(size, _TINY_M), instead)


def _rejection(vectors: np.ndarray, along: np.ndarray) -> np.ndarray:
    """What is left of vectors across unit vectors."""
    return vectors - np.sum(vectors * along, axis=-1, keepdims=True) * along


def _frame(along: np.ndarray, across: np.ndarray) -> np.ndarray:
    """Orthonormal columns: along, across made unit, and their cross product."""
    across = across / np.linalg.norm(across, axis=-1, keepdims=True)
    return np.stack([along, across, np.cross(along, across)], axis=-1)
