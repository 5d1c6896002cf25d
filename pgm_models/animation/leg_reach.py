"""Two bones of a leg bent so that the ankle gets to a place: hip and knee turn, the plane of the knee is kept."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from pgm_data.geometry.rigid import rotation_from_rotvec
from pgm_data.skeleton import Skeleton

LEAST_BEND = np.radians(2.0)
"""Of a knee."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Leg:
    """Joints of a leg."""

    hip: int
    knee: int
    ankle: int
    foot: tuple[int, ...]
    """Joints beyond the ankle that carry points of the sole."""
    hinge: Float[np.ndarray, " 3"]
    """Axis in the frame of the thigh about which the knee bends."""
    points: tuple[int, ...]
    """Points of the sole, among the skeleton's."""


def legs_of(skeleton: Skeleton) -> tuple[Leg, Leg] | None:
    """Left and right leg: hip, knee and ankle above the soles' points; None where the skeleton has no such legs."""
    found = [leg for sole in skeleton.soles if (leg := _leg(skeleton, sole)) is not None]
    return (found[0], found[1]) if len(found) == 2 else None


def _leg(skeleton: Skeleton, sole: tuple[str, ...]) -> Leg | None:
    points = tuple(skeleton.point_names.index(name) for name in sole)
    if len(points) < 2:
        return None
    chains = [_chain(skeleton, int(skeleton.point_joints[point])) for point in points]
    ankle = max(set(chains[0]).intersection(*chains), default=0)
    knee = int(skeleton.parents[ankle]) if ankle > 0 else 0
    hip = int(skeleton.parents[knee]) if knee > 0 else 0
    if hip <= 0:
        return None
    foot = tuple(sorted({joint for chain in chains for joint in chain if joint > ankle}))
    low, high = skeleton.limits[knee]
    if not np.isfinite([low, high]).all():
        return None
    axis = int(np.argmax(high - low))
    hinge = np.zeros(3)
    hinge[axis] = 1.0 if high[axis] > -low[axis] else -1.0
    return Leg(hip=hip, knee=knee, ankle=ankle, foot=foot, hinge=hinge, points=points)


def _chain(skeleton: Skeleton, joint: int) -> list[int]:
    chain = []
    while joint > 0:
        chain.append(joint)
        joint = int(skeleton.parents[joint])
    return chain


@dataclass(frozen=True, eq=False, kw_only=True)
class Hinge:
    """How the distance of hip and ankle depends on the knee: d^2 = base + 2 swing cos(turn - straight)."""

    base: Float[np.ndarray, " frames"]
    swing: Float[np.ndarray, " frames"]
    straight: Float[np.ndarray, " frames"]
    """Turn about the hinge, from the present bend, at which the leg is longest, radians; below 0 of a bent knee."""

    @property
    def longest(self) -> Float[np.ndarray, " frames"]:
        """Greatest distance at the least bend, metres."""
        return np.sqrt(self.base + 2 * self.swing * np.cos(LEAST_BEND))


def hinge_of(
    leg: Leg,
    knee: Float[np.ndarray, "frames 3 3"],
    thigh: Float[np.ndarray, "frames 3"],
    shin: Float[np.ndarray, "frames 3"],
) -> Hinge:
    """The leg's, of the knee's rotations and its bones, each in its parent's frame."""
    s = (knee @ shin[..., None])[..., 0]
    along = (s @ leg.hinge)[:, None] * leg.hinge
    across = s - along
    A = (thigh * across).sum(axis=1)
    B = (thigh * np.cross(leg.hinge, across)).sum(axis=1)
    base = (thigh**2).sum(axis=1) + (s**2).sum(axis=1) + 2 * (thigh * along).sum(axis=1)
    return Hinge(base=base, swing=np.hypot(A, B), straight=np.arctan2(B, A))


def bent(
    leg: Leg,
    hip: Float[np.ndarray, "frames 3 3"],
    knee: Float[np.ndarray, "frames 3 3"],
    thigh: Float[np.ndarray, "frames 3"],
    shin: Float[np.ndarray, "frames 3"],
    to_ankle: Float[np.ndarray, "frames 3"],
) -> tuple[Float[np.ndarray, "frames 3 3"], Float[np.ndarray, "frames 3 3"]]:
    """The thigh's rotation in the world and the knee's in the thigh's frame that bring the ankle there.

    As far as the leg reaches: beyond it the ankle lies on the line. Of all ways that bend the knee forward, that in
    which the thigh turns least.

    Args:
        leg: Which.
        hip: world_from_thigh.
        knee: thigh_from_shin.
        thigh: The knee in the thigh's frame, metres.
        shin: The ankle in the shin's frame.
        to_ankle: From the hip, world metres.
    """
    law = hinge_of(leg, knee, thigh, shin)
    wanted = np.linalg.norm(to_ankle, axis=1)
    cosine = (wanted**2 - law.base) / (2 * np.maximum(law.swing, 1e-12))
    bend = np.maximum(np.arccos(np.clip(cosine, -1.0, 1.0)), LEAST_BEND)
    knee_new = rotation_from_rotvec((law.straight + bend)[:, None] * leg.hinge) @ knee
    now = (hip @ (thigh + (knee_new @ shin[..., None])[..., 0])[..., None])[..., 0]
    return _least_turn(now, to_ankle) @ hip, knee_new


def _least_turn(a: Float[np.ndarray, "frames 3"], b: Float[np.ndarray, "frames 3"]) -> Float[np.ndarray, "frames 3 3"]:
    """Least rotations that bring the directions a to b."""
    a = a / np.maximum(np.linalg.norm(a, axis=1, keepdims=True), 1e-12)
    b = b / np.maximum(np.linalg.norm(b, axis=1, keepdims=True), 1e-12)
    normal = np.cross(a, b)
    sine = np.linalg.norm(normal, axis=1)
    angle = np.arctan2(sine, (a * b).sum(axis=1))
    return rotation_from_rotvec(normal * (angle / np.maximum(sine, 1e-12))[:, None])
