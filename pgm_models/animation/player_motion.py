"""One player's motion, and where its joints and soles are."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from pgm_data.skeleton import Skeleton, world_from_joints
from pgm_models.animation.leg_reach import Leg


@dataclass(frozen=True, eq=False, kw_only=True)
class PlayerMotion:
    """One player's motion.

    Raises:
        ValueError: If a number is not finite, a shape does not fit, or times do not rise; names field and frame.
    """

    times: Float[np.ndarray, " frames"]
    """s, rising."""
    root_position: Float[np.ndarray, "frames 3"]
    """World metres."""
    root_rotation: Float[np.ndarray, "frames 3"]
    """Axis-angle of world_from_root, radians."""
    joint_rotations: Float[np.ndarray, "frames joints 3"]
    """Axis-angle of parent_from_joint, radians; entry 0 repeats the root's and is not read."""
    joint_translations: Float[np.ndarray, "frames joints 3"] | Float[np.ndarray, "joints 3"]
    """Of parent_from_joint, metres; entry 0 of frames repeats the root's."""
    known_position: Bool[np.ndarray, " frames"]
    """Whether the root's position is given and must stay."""
    known_rotation: Bool[np.ndarray, " frames"]
    known_joints: Bool[np.ndarray, " frames"]

    def __post_init__(self) -> None:
        """Check the values."""
        frames = len(self.times)
        for name in ("times", "root_position", "root_rotation", "joint_rotations", "joint_translations"):
            values = getattr(self, name)
            bad = np.argwhere(~np.isfinite(values))
            if len(bad):
                raise ValueError(f"{name}: expected finite numbers, got {values[tuple(bad[0])]} at {bad[0].tolist()}")
        for name in self.__dataclass_fields__:
            got = len(getattr(self, name))
            if got != frames and not (name == "joint_translations" and self.joint_translations.ndim == 2):
                raise ValueError(f"{name}: expected {frames} frames, got {got}")
        if self.joint_translations.shape[-2] != self.joint_rotations.shape[1]:
            joints = self.joint_rotations.shape[1]
            raise ValueError(f"joint_translations: expected {joints} joints, got {self.joint_translations.shape[-2]}")
        late = np.flatnonzero(np.diff(self.times) <= 0)
        if len(late):
            raise ValueError(f"times: expected rising ones, got others at frame {late[0] + 1}")


@dataclass(frozen=True, eq=False, kw_only=True)
class Body:
    """A motion with what follows from it."""

    motion: PlayerMotion
    skeleton: Skeleton
    local: Float[np.ndarray, "frames joints 3"]
    """Axis-angle, the root's at 0."""
    bones: Float[np.ndarray, "frames joints 3"]
    R: Float[np.ndarray, "frames joints 3 3"]
    joints: Float[np.ndarray, "frames joints 3"]
    offsets: Float[np.ndarray, "frames points 3"]
    """All points of the skeleton in their joints' frames."""

    def soles(self, leg: Leg) -> Float[np.ndarray, "frames points 3"]:
        """Points of a sole in the world."""
        points = list(leg.points)
        on = self.skeleton.point_joints[points]
        return self.joints[:, on] + (self.R[:, on] @ self.offsets[:, points, :, None])[..., 0]


def body_of(motion: PlayerMotion, skeleton: Skeleton) -> Body:
    """The motion with what follows from it, by forward kinematics; points grow with the bones."""
    frames = len(motion.times)
    local = motion.joint_rotations.astype(np.float64)
    local[:, 0] = motion.root_rotation
    bones = np.broadcast_to(motion.joint_translations, (frames, *motion.joint_translations.shape[-2:])).astype(float)
    sizes = np.linalg.norm(bones[:, 1:], axis=-1).sum(axis=1)
    sizes = sizes / np.linalg.norm(skeleton.rest_translations[1:], axis=-1).sum()
    bones[:, 0] = motion.root_position
    R, joints = world_from_joints(skeleton.parents, local, bones)
    offsets = sizes[:, None, None] * skeleton.point_offsets
    return Body(motion=motion, skeleton=skeleton, local=local, bones=bones, R=R, joints=joints, offsets=offsets)
