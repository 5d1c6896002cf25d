"""Places on the ground where feet rest while they stand."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from pgm_data.geometry.rigid import rotation_from_rotvec
from pgm_models.animation.foot_stances import averaged
from pgm_models.animation.leg_reach import Leg
from pgm_models.animation.player_motion import Body

STEADY_S = 0.05
"""Time to either side over which the pitch of a noisy foot is averaged."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Footing:
    """Where a foot is to be."""

    ankle: Float[np.ndarray, "frames 3"]
    """World metres."""
    R: Float[np.ndarray, "frames 3 3"]
    """world_from_ankle."""
    toes: Float[np.ndarray, "frames foot 3"]
    """Axis-angle of the joints beyond the ankle."""


def sole_in_ankle(
    body: Body, leg: Leg, toes: Float[np.ndarray, "frames foot 3"], rows: slice = slice(None)
) -> Float[np.ndarray, "frames points 3"]:
    """Points of a sole in the ankle's frame, metres, of the rotations of the joints beyond it."""
    bones, offsets, parents = body.bones[rows], body.offsets[rows], body.skeleton.parents
    R = {leg.ankle: np.broadcast_to(np.eye(3), (len(bones), 3, 3))}
    at = {leg.ankle: np.zeros((len(bones), 3))}
    for place, joint in enumerate(leg.foot):
        parent = int(parents[joint])
        at[joint] = at[parent] + (R[parent] @ bones[:, joint, :, None])[..., 0]
        R[joint] = R[parent] @ rotation_from_rotvec(toes[:, place])
    on = [int(body.skeleton.point_joints[point]) for point in leg.points]
    points = [
        at[joint] + (R[joint] @ offsets[:, point, :, None])[..., 0] for joint, point in zip(on, leg.points, strict=True)
    ]
    return np.stack(points, axis=1)


def planted(body: Body, leg: Leg, rows: slice, floor_z: float, level_m: float) -> Footing:
    """Where the foot rests in a stance: in one place with one heading, on heel, toes or both.

    Heel or toes are off the ground where the motion has them higher than about `level_m`. Frames in which root and
    joints are known say alone where the place is, if there are any.
    """
    motion = body.motion
    toes = body.local[rows][:, list(leg.foot)]
    told = (motion.known_position & motion.known_rotation & motion.known_joints)[rows]
    saying = told if told.any() else np.ones(len(told), dtype=bool)
    toes = np.broadcast_to(toes[saying].mean(axis=0), toes.shape)
    local = sole_in_ankle(body, leg, toes, rows)
    heel, toe = int(np.argmin(local[0, :, 2])), int(np.argmax(local[0, :, 2]))
    length = np.linalg.norm(local[:, toe] - local[:, heel], axis=1)
    world = body.soles(leg)[rows]
    ahead = world[:, toe] - world[:, heel]
    pitch = np.arctan2(-ahead[:, 2], np.linalg.norm(ahead[:, :2], axis=1))
    step = float(np.median(np.diff(motion.times))) if len(motion.times) > 1 else 1.0
    half = int(STEADY_S / step + 1e-6) if level_m > 0.02 else 0
    pitch = averaged(pitch[:, None], half)[:, 0]
    dead = level_m / length
    share = np.clip(np.abs(pitch) / dead - 1.0, 0.0, 1.0)
    pitch = pitch * share**2 * (3 - 2 * share)
    heading = ahead[:, :2] / np.maximum(np.linalg.norm(ahead[:, :2], axis=1, keepdims=True), 1e-9)
    front = np.where((pitch >= 0)[:, None], world[:, toe, :2], world[:, heel, :2] + length[:, None] * heading)
    mean = heading[saying].mean(axis=0)
    mean = mean / max(float(np.linalg.norm(mean)), 1e-9)
    place = np.array([*np.median(front[saying], axis=0), floor_z])
    R = _pitched(mean, pitch) @ np.swapaxes(_sole_frame(local, heel, toe), 1, 2)
    pivot = np.where((pitch >= 0)[:, None], local[:, toe], local[:, heel])
    at = np.where((pitch >= 0)[:, None], place, place - length[:, None] * np.array([*mean, 0.0]))
    return Footing(ankle=at - (R @ pivot[..., None])[..., 0], R=R, toes=np.array(toes))


def _pitched(heading: Float[np.ndarray, " 2"], pitch: Float[np.ndarray, " frames"]) -> Float[np.ndarray, "frames 3 3"]:
    """Left, up and forward of a foot as columns, its heel raised by the pitch, radians."""
    flat, up = np.array([*heading, 0.0]), np.array([0.0, 0.0, 1.0])
    c, s = np.cos(pitch)[:, None], np.sin(pitch)[:, None]
    forward, upward = c * flat - s * up, s * flat + c * up
    return np.stack([np.cross(upward, forward), upward, forward], axis=-1)


def _sole_frame(local: Float[np.ndarray, "frames points 3"], heel: int, toe: int) -> Float[np.ndarray, "frames 3 3"]:
    """Left, up and forward of the sole in the ankle's frame, whose y is up in the rest pose."""
    forward = local[:, toe] - local[:, heel]
    forward = forward / np.linalg.norm(forward, axis=1, keepdims=True)
    up = np.array([0.0, 1.0, 0.0]) - forward[:, 1:2] * forward
    up = up / np.linalg.norm(up, axis=1, keepdims=True)
    return np.stack([np.cross(up, forward), up, forward], axis=-1)
