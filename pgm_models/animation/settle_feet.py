"""Feet that stand: a projection of one player's motion to one whose standing feet rest and stay above the ground.

Stances are found in the motion as it is (`foot_stances`), each gets one place on the ground, a smooth correction of
the root goes half of the way to meet them, and the legs bend to do the rest (`leg_reach`). Arms and trunk stay as they
are, and so does to the bit what is known. The ground is flat.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Bool, Float
from scipy.linalg import solveh_banded

from pgm_data.geometry.rigid import rotation_from_rotvec, rotvec_from_rotation
from pgm_data.skeleton import Skeleton, world_from_joints
from pgm_models.animation.foot_stances import Stance, StanceOptions, averaged, noisy_floor, stances
from pgm_models.animation.leg_reach import LEAST_BEND, Leg, bent, hinge_of, legs_of

HELD = 1e8
"""Weight of a correction that must be none."""
SAME = 1e-9
"""Metres or radians under which a pose is left as it is."""


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


@dataclass(frozen=True, kw_only=True)
class SettleOptions:
    """How feet are settled.

    Raises:
        ValueError: If a number is out of range.
    """

    stance: StanceOptions = field(default_factory=StanceOptions)
    root_hz: float = 1.5
    """Corrections of the root are slower than this."""
    root_pull: float = 0.5
    """Weight of no correction of the root in the plane, against 1 of each standing foot: the legs take the rest."""
    leg_hz: float = 3.0
    """Corrections of a swinging foot are slower than this."""
    leg_pull: float = 0.05
    """Weight of no correction of a swinging foot."""
    level_m: float = 0.01
    """Heels or toes of a standing foot lower than this, and what the heights err, are put on the ground."""
    clearance_m: float = 0.035
    """Height of a sole in the middle of a swing at least."""
    given_up_m: float = 0.03
    """Frames of a stance whose place the leg misses by more are given up."""

    def __post_init__(self) -> None:
        """Check the ranges."""
        for name in ("root_hz", "leg_hz", "root_pull", "leg_pull", "level_m", "given_up_m"):
            if not getattr(self, name) > 0:
                raise ValueError(f"SettleOptions.{name}: expected more than 0, got {getattr(self, name)}")
        if not self.clearance_m >= 0:
            raise ValueError(f"SettleOptions.clearance_m: expected at least 0, got {self.clearance_m}")


@dataclass(frozen=True, eq=False, kw_only=True)
class SettleReport:
    """What was done to a motion."""

    stances: tuple[Stance, ...]
    """In which feet rest now."""
    given_up: tuple[Stance, ...]
    """Stances, or ends of some, that the legs could not keep."""
    root_moved_m: Float[np.ndarray, " frames"]
    joints_moved_m: Float[np.ndarray, "frames joints"]
    """In the world."""
    kept: Bool[np.ndarray, " frames"]
    """Frames left as they were, to the bit."""
    below_m: float
    """How deep the lowest point of a sole is below the ground now; 0 where none is."""
    left_because: str
    """Why nothing was done; empty where something was."""


@dataclass(frozen=True, eq=False, kw_only=True)
class _Body:
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


@dataclass(frozen=True, eq=False, kw_only=True)
class _Footing:
    """Where a foot is to be."""

    ankle: Float[np.ndarray, "frames 3"]
    """World metres."""
    R: Float[np.ndarray, "frames 3 3"]
    """world_from_ankle."""
    toes: Float[np.ndarray, "frames foot 3"]
    """Axis-angle of the joints beyond the ankle."""


def settled_feet(
    motion: PlayerMotion, skeleton: Skeleton, floor_z: float | None, options: SettleOptions | None = None
) -> tuple[PlayerMotion, SettleReport]:
    """The motion with feet that rest where they stand and are nowhere in the ground, and what was done.

    Where joints are known, only the root moves; where the root is known, only legs; where both are, nothing does, and
    feet that stand then say where the stance rests. Bones and rotations of root, trunk and arms are kept. Soles stay
    below the ground only where known values put them there.

    Args:
        motion: Of one player.
        skeleton: Its skeleton.
        floor_z: Height of the flat ground, world metres; None where it is uneven or not known: nothing is done.
        options: How.

    Raises:
        ValueError: If the motion's joints are not the skeleton's.
    """
    options = SettleOptions() if options is None else options
    if motion.joint_rotations.shape[1] != len(skeleton.parents):
        got = motion.joint_rotations.shape[1]
        raise ValueError(f"joint_rotations: expected {len(skeleton.parents)} joints of {skeleton.name}, got {got}")
    legs = legs_of(skeleton)
    if legs is None or floor_z is None or not len(motion.times):
        why = f"{skeleton.name} has no legs of hip, knee and ankle with soles of two points or more"
        why = why if legs is None else "the ground is not flat" if floor_z is None else "there are no frames"
        return motion, _nothing_done(motion, why)
    body = _body_of(motion, skeleton)
    heights = np.stack([body.soles(leg)[..., 2].min(axis=1) - floor_z for leg in legs], axis=1)
    error = noisy_floor(heights)
    standing = [
        stance
        for foot, leg in enumerate(legs)
        for stance in stances(body.soles(leg), motion.times, floor_z, error, options.stance, foot)
    ]
    given_up: list[Stance] = []
    settler = _Settler(body=body, legs=legs, floor_z=floor_z, error_m=error, options=options)
    for _ in range(3):
        moved, missed = settler.settled(standing)
        kept_up, dropped = _kept_up(standing, missed > options.given_up_m)
        if not dropped:
            break
        given_up += dropped
        standing = kept_up
    else:
        moved, _ = settler.settled(standing)
    return moved, _report(body, moved, legs, floor_z, standing, given_up)


def _nothing_done(motion: PlayerMotion, why: str) -> SettleReport:
    frames, joints = motion.joint_rotations.shape[:2]
    return SettleReport(
        stances=(),
        given_up=(),
        root_moved_m=np.zeros(frames),
        joints_moved_m=np.zeros((frames, joints)),
        kept=np.ones(frames, dtype=bool),
        below_m=0.0,
        left_because=why,
    )


def _body_of(motion: PlayerMotion, skeleton: Skeleton) -> _Body:
    frames = len(motion.times)
    local = motion.joint_rotations.astype(np.float64)
    local[:, 0] = motion.root_rotation
    bones = np.broadcast_to(motion.joint_translations, (frames, *motion.joint_translations.shape[-2:])).astype(float)
    sizes = np.linalg.norm(bones[:, 1:], axis=-1).sum(axis=1)
    sizes = sizes / np.linalg.norm(skeleton.rest_translations[1:], axis=-1).sum()
    bones[:, 0] = motion.root_position
    R, joints = world_from_joints(skeleton.parents, local, bones)
    offsets = sizes[:, None, None] * skeleton.point_offsets
    return _Body(motion=motion, skeleton=skeleton, local=local, bones=bones, R=R, joints=joints, offsets=offsets)


def _kept_up(
    standing: Sequence[Stance], lost: Bool[np.ndarray, "frames feet"]
) -> tuple[list[Stance], list[Stance]]:
    """Stances without their lost frames, the longest stretch of each; and what of them is given up."""
    kept, dropped = [], []
    for stance in standing:
        bad = np.flatnonzero(lost[stance.frames, stance.foot]) + stance.first
        if not len(bad):
            kept.append(stance)
            continue
        edges = np.concatenate([[stance.first - 1], bad, [stance.last + 1]])
        longest = int(np.argmax(np.diff(edges)))
        first, last = int(edges[longest]) + 1, int(edges[longest + 1]) - 1
        if first <= last:
            kept.append(replace(stance, first=first, last=last))
        ends = [(stance.first, first - 1), (last + 1, stance.last)] if first <= last else [(stance.first, stance.last)]
        dropped += [replace(stance, first=a, last=b) for a, b in ends if a <= b]
    return kept, dropped


def _report(
    body: _Body,
    moved: PlayerMotion,
    legs: Sequence[Leg],
    floor_z: float,
    standing: Sequence[Stance],
    given_up: Sequence[Stance],
) -> SettleReport:
    after = _body_of(moved, body.skeleton)
    lowest = min(float(after.soles(leg)[..., 2].min()) for leg in legs)
    same = (moved.root_position == body.motion.root_position).all(axis=1)
    same &= (moved.joint_rotations == body.motion.joint_rotations).all(axis=(1, 2))
    return SettleReport(
        stances=tuple(standing),
        given_up=tuple(given_up),
        root_moved_m=np.linalg.norm(moved.root_position - body.motion.root_position, axis=1),
        joints_moved_m=np.linalg.norm(after.joints - body.joints, axis=-1),
        kept=np.asarray(same),
        below_m=max(0.0, floor_z - lowest),
        left_because="",
    )
