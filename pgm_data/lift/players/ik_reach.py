"""Rotations within their limits that bring the joints as near as can be to where they were observed.

For frames whose bones have other lengths than the skeleton's, miss joints, or bend further than a body does: damped
Gauss-Newton on root and rotations, bounds kept by holding what pushes against them, all frames at once.
"""

import numpy as np
from jaxtyping import Bool, Float, Int

from pgm_data.geometry.rigid import rotation_from_rotvec, rotvec_from_rotation, skew
from pgm_data.lift.players.ik_start import descends
from pgm_data.lift.players.ik_twist import inverse_right_jacobian
from pgm_data.skeleton import Skeleton, world_from_joints

AT_ONCE = 256
"""Frames in one array of derivatives."""
ENOUGH = 1e-3
"""A frame is done where a step takes less than this share off its cost."""
STUCK = 1e2
"""Damping (m^2) beyond which no step helps."""


def reached(
    skeleton: Skeleton,
    joints_world: Float[np.ndarray, "frames joints 3"],
    rotations: Float[np.ndarray, "frames joints 3"],
    translations: Float[np.ndarray, "frames joints 3"],
    *,
    near: Float[np.ndarray, "frames joints 3"],
    near_m: float,
    steps: int,
) -> tuple[Float[np.ndarray, "frames joints 3"], Float[np.ndarray, "frames joints 3"]]:
    """Rotations and translations after the adjustment.

    Args:
        skeleton: Its tree and its limits.
        joints_world: Observed, metres; NaN where not.
        rotations: To start from, within the limits.
        translations: Of parent_from_joint, metres; the root's is adjusted, the others are kept.
        near: Rotations to stay near where nothing says otherwise.
        near_m: Metres that a radian away from them weighs.
        steps: Of Gauss-Newton.
    """
    done_rotations, done_translations = rotations.copy(), translations.copy()
    for first in range(0, len(rotations), AT_ONCE):
        rows = slice(first, first + AT_ONCE)
        done_rotations[rows], done_translations[rows] = _adjusted(
            skeleton, joints_world[rows], rotations[rows], translations[rows], near[rows], near_m, steps
        )
    return done_rotations, done_translations


def _adjusted(
    skeleton: Skeleton,
    joints_world: Float[np.ndarray, "frames joints 3"],
    start: Float[np.ndarray, "frames joints 3"],
    translations: Float[np.ndarray, "frames joints 3"],
    near: Float[np.ndarray, "frames joints 3"],
    near_m: float,
    steps: int,
) -> tuple[Float[np.ndarray, "frames joints 3"], Float[np.ndarray, "frames joints 3"]]:
    parents, limits = skeleton.parents, skeleton.limits
    frames, count = start.shape[:2]
    seen = np.asarray(np.isfinite(joints_world).all(axis=-1))
    goal = np.nan_to_num(joints_world)
    lower, upper = (np.concatenate([limits[:, i].reshape(-1), np.full(3, s * np.inf)]) for i, s in ((0, -1), (1, 1)))
    rest = np.concatenate([near.reshape(frames, -1), translations[:, 0]], axis=1)
    weight = np.concatenate([np.full(3 * count, near_m**2), np.full(3, 1e-12)])
    values = np.concatenate([start.reshape(frames, -1), translations[:, 0]], axis=1)
    damping = np.full(frames, 1e-6)
    cost = _cost(_led(parents, values, translations)[1], goal, seen, values - rest, weight)
    rows = np.arange(frames)
    for _ in range(steps):
        ahead = _stepped(
            parents,
            values[rows],
            translations[rows],
            goal[rows],
            seen[rows],
            rest[rows],
            weight,
            damping[rows],
            lower,
            upper,
        )
        joints = _led(parents, ahead, translations[rows])[1]
        then = _cost(joints, goal[rows], seen[rows], ahead - rest[rows], weight)
        better = then < cost[rows]
        gained = cost[rows] - then
        small = better & (gained < ENOUGH * cost[rows])
        values[rows] = np.where(better[:, None], ahead, values[rows])
        cost[rows] = np.where(better, then, cost[rows])
        damping[rows] = np.where(better, damping[rows] / 4, damping[rows] * 20)
        rows = rows[~small & (damping[rows] < STUCK)]
        if not len(rows):
            break
    adjusted = translations.copy()
    adjusted[:, 0] = values[:, -3:]
    return values[:, :-3].reshape(frames, count, 3), adjusted


def _stepped(parents, values, translations, goal, seen, rest, weight, damping, lower, upper):
    """Values after one damped step within the bounds."""
    size = np.arange(len(weight))
    R, joints = _led(parents, values, translations)
    H, gradient = _normal(parents, values, R, joints, goal, seen)
    gradient += weight * (values - rest)
    held = ((values <= lower) & (gradient > 0)) | ((values >= upper) & (gradient < 0))
    free = np.where(held, 0.0, 1.0)
    H *= free[:, :, None]
    H *= free[:, None, :]
    H[:, size, size] += np.where(held, 1.0, weight + damping[:, None])
    step = -np.linalg.solve(H, (gradient * free)[..., None])[..., 0]
    return _allowed(values + step, lower, upper)


def _allowed(
    values: Float[np.ndarray, "frames values"],
    lower: Float[np.ndarray, " values"],
    upper: Float[np.ndarray, " values"],
) -> Float[np.ndarray, "frames values"]:
    """Values within the bounds, limited rotations by pi at most: beyond it they would be others, out of bounds."""
    clipped = np.clip(values, lower, upper)
    rotations = clipped[:, :-3].reshape(len(values), -1, 3)
    limited = np.asarray(np.isfinite(lower[:-3]).reshape(-1, 3).all(axis=1))
    angle = np.linalg.norm(rotations, axis=2, keepdims=True)
    turned = np.where(limited[:, None] & (angle > np.pi), rotations * (np.pi / np.maximum(angle, np.pi)), rotations)
    clipped[:, :-3] = turned.reshape(len(values), -1)
    return clipped


def _led(
    parents: Int[np.ndarray, " joints"],
    values: Float[np.ndarray, "frames values"],
    translations: Float[np.ndarray, "frames joints 3"],
) -> tuple[Float[np.ndarray, "frames joints 3 3"], Float[np.ndarray, "frames joints 3"]]:
    placed = np.concatenate([values[:, None, -3:], translations[:, 1:]], axis=1)
    return world_from_joints(parents, values[:, :-3].reshape(*translations.shape), placed)


def _cost(
    joints: Float[np.ndarray, "frames joints 3"],
    goal: Float[np.ndarray, "frames joints 3"],
    seen: Bool[np.ndarray, "frames joints"],
    moved: Float[np.ndarray, "frames values"],
    weight: Float[np.ndarray, " values"],
) -> Float[np.ndarray, " frames"]:
    return (((joints - goal) ** 2).sum(axis=-1) * seen).sum(axis=-1) + (weight * moved**2).sum(axis=-1)


def _normal(
    parents: Int[np.ndarray, " joints"],
    values: Float[np.ndarray, "frames values"],
    R: Float[np.ndarray, "frames joints 3 3"],
    joints: Float[np.ndarray, "frames joints 3"],
    goal: Float[np.ndarray, "frames joints 3"],
    seen: Bool[np.ndarray, "frames joints"],
) -> tuple[Float[np.ndarray, "frames values values"], Float[np.ndarray, "frames values"]]:
    """Normal matrix and gradient of half the squared distances of the observed joints."""
    frames, count = joints.shape[:2]
    rotations = values[:, :-3].reshape(frames, count, 3)
    turn = R @ np.linalg.inv(inverse_right_jacobian(rotations))
    moved, by = np.nonzero(descends(parents).T)
    arms = (joints[:, moved] - joints[:, by]) * seen[:, moved, None]
    J = np.zeros((frames, count, 3, count + 1, 3))
    J[:, moved, :, by] = np.moveaxis(skew(-arms) @ turn[:, by], 1, 0)
    J[..., -1, :] = np.eye(3) * seen[..., None, None]
    flat = J.reshape(frames, 3 * count, 3 * count + 3)
    turned = np.swapaxes(flat, 1, 2)
    return turned @ flat, (turned @ (joints - goal).reshape(frames, -1, 1))[..., 0]


def between_neighbours(
    rotations: Float[np.ndarray, "frames joints 3"], follows: Bool[np.ndarray, " steps"]
) -> Float[np.ndarray, "frames joints 3"]:
    """Halfway between each rotation's neighbours in time, to first order; itself where it has one or none.

    Args:
        rotations: Axis-angle vectors.
        follows: Whether each row but the first is the frame after the row before.
    """
    R = rotation_from_rotvec(rotations)
    ahead = rotvec_from_rotation(np.swapaxes(R[:-1], -1, -2) @ R[1:])
    back = -ahead
    inner = np.zeros_like(rotations)
    both = follows[:-1] & follows[1:]
    # A step seen from its end is the same vector, as its axis is its own.
    inner[1:-1] = np.where(both[:, None, None], (ahead[1:] + back[:-1]) / 2, 0.0)
    return rotations + (inverse_right_jacobian(rotations) @ inner[..., None])[..., 0]


def bounded(
    rotations: Float[np.ndarray, "frames joints 3"], limits: Float[np.ndarray, "joints 2 3"]
) -> Float[np.ndarray, "frames joints 3"]:
    """Rotations clipped to the limits."""
    return np.clip(rotations, limits[:, 0], limits[:, 1])


def wrapped(
    rotations: Float[np.ndarray, "frames joints 3"], limits: Float[np.ndarray, "joints 2 3"]
) -> Float[np.ndarray, "frames joints 3"]:
    """The same rotations by angles of at most pi; limited ones are that already, and at pi might leave their limits."""
    free = ~np.isfinite(limits).all(axis=(1, 2))
    result = rotations.copy()
    result[:, free] = rotvec_from_rotation(rotation_from_rotvec(rotations[:, free]))
    return result
