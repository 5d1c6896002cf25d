"""World rotations of a skeleton's joints that aim every bone at what was observed, up to the twist about single bones.

The targets of a joint are its nearest observed descendants. Two of them in different directions fix its rotation; one
fixes all but the twist about the line to it, which is then chosen smallest; none leaves it as in the rest pose.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from pgm_data.geometry.rigid import rotation_from_rotvec

FLAT = 1e-3
"""Second singular value over the first below which targets lie on a line."""
SHORT_M = 1e-7
"""Bones shorter than this have no direction."""
BENT = 0.25
"""Share of the middle of its limits to which a joint that is missing between others is bent at first."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Aimed:
    """A skeleton aimed at what was observed."""

    R_world_from_joint: Float[np.ndarray, "frames joints 3 3"]
    axis: Float[np.ndarray, "frames joints 3"]
    """Unit vector in the joint's frame about which it may twist; 0 where it may not."""
    loose: Bool[np.ndarray, "frames joints"]
    """Whether nothing observed turns the joint: it keeps its rotation to its parent."""
    root_world: Float[np.ndarray, "frames 3"]


def descends(parents: Int[np.ndarray, " joints"]) -> Bool[np.ndarray, "joints joints"]:
    """Whether the second joint hangs, at any distance, below the first."""
    below = np.zeros((len(parents), len(parents)), dtype=bool)
    for joint, parent in enumerate(parents):
        if parent >= 0:
            below[:, joint] = below[:, parent]
            below[parent, joint] = True
    return below


def targets(
    parents: Int[np.ndarray, " joints"],
    seen: Bool[np.ndarray, "frames joints"],
    short: Bool[np.ndarray, " joints"],
) -> Bool[np.ndarray, "frames joints joints"]:
    """The nearest observed descendants of each joint, those on top of their parents (`short`) passed over."""
    found = np.zeros((*seen.shape, seen.shape[1]), dtype=bool)
    for joint in range(len(parents) - 1, 0, -1):
        aimed_at = seen[:, joint] & ~short[joint]
        own = found[:, joint] & ~aimed_at[:, None]
        own[:, joint] = aimed_at
        found[:, parents[joint]] |= own
    return found


def rest_pose(
    parents: Int[np.ndarray, " joints"], translations: Float[np.ndarray, "joints 3"]
) -> Float[np.ndarray, "joints 3"]:
    """Joints of the skeleton whose rotations are all 0, the root at the origin, metres."""
    rest = np.zeros_like(translations)
    for joint, parent in enumerate(parents):
        if parent >= 0:
            rest[joint] = rest[parent] + translations[joint]
    return rest


def aimed(
    parents: Int[np.ndarray, " joints"],
    translations: Float[np.ndarray, "joints 3"],
    limits: Float[np.ndarray, "joints 2 3"],
    joints_world: Float[np.ndarray, "frames joints 3"],
) -> Aimed:
    """The skeleton aimed at the joints, from the root outwards.

    Args:
        parents: Index of each joint's parent.
        translations: Of parent_from_joint, metres, in the bones' right lengths.
        limits: Lowest and highest axis-angle vectors, radians.
        joints_world: NaN where not observed; every frame observes one at least.
    """
    frames, count = joints_world.shape[:2]
    seen = np.asarray(np.isfinite(joints_world).all(axis=-1))
    rest = rest_pose(parents, translations)
    aims = targets(parents, seen, np.linalg.norm(translations, axis=1) <= SHORT_M)
    bend = _bend(limits)
    R = np.broadcast_to(np.eye(3), (frames, count, 3, 3)).copy()
    axis = np.zeros((frames, count, 3))
    loose = np.zeros((frames, count), dtype=bool)
    place = np.where(seen[..., None], joints_world, 0.0)
    for joint, parent in enumerate(parents):
        before = R[:, parent].copy() if parent >= 0 else R[:, 0].copy()
        if parent >= 0:
            led = place[:, parent] + before @ translations[joint]
            place[:, joint] = np.where(seen[:, joint, None], place[:, joint], led)
        arms = rest - rest[joint]
        weight = aims[:, joint] & (np.linalg.norm(arms, axis=-1) > SHORT_M)
        floating = parent < 0 and ~seen[:, 0]
        reach = np.nan_to_num(joints_world - place[:, joint, None])
        if np.any(floating):
            place[:, 0], reach, arms = _floated(joints_world, rest, weight, floating, place[:, 0])
        weight &= np.linalg.norm(reach, axis=-1) > SHORT_M
        R[:, joint], axis[:, joint] = _turned(weight, reach, np.broadcast_to(arms, reach.shape), before)
        loose[:, joint] = ~weight.any(axis=1)
        if parent >= 0:
            # A joint missing between its neighbours starts bent, as a straight limb cannot tell which way to go.
            hidden = ~seen[:, joint] & axis[:, joint].any(axis=1)
            R[hidden, joint] = before[hidden] @ bend[joint]
            axis[hidden, joint] = 0.0
            loose[hidden, joint] = True
        if np.any(floating):
            middle = _mean(weight, np.broadcast_to(rest, reach.shape))
            centre = _mean(weight, np.nan_to_num(joints_world))
            placed = centre - (R[:, 0] @ middle[..., None])[..., 0]
            place[:, 0] = np.where(seen[:, 0, None], place[:, 0], placed)
    return Aimed(R_world_from_joint=R, axis=axis, loose=loose, root_world=place[:, 0])


def _bend(limits: Float[np.ndarray, "joints 2 3"]) -> Float[np.ndarray, "joints 3 3"]:
    bounded = np.isfinite(limits).all(axis=1)
    with np.errstate(invalid="ignore"):
        middle = np.where(bounded, limits.sum(axis=1) / 2, 0.0)
    return rotation_from_rotvec(BENT * middle)


def _mean(
    weight: Bool[np.ndarray, "frames joints"], points: Float[np.ndarray, "frames joints 3"]
) -> Float[np.ndarray, "frames 3"]:
    return (weight[..., None] * points).sum(axis=1) / np.maximum(weight.sum(axis=1), 1)[:, None]


def _floated(
    joints_world: Float[np.ndarray, "frames joints 3"],
    rest: Float[np.ndarray, "joints 3"],
    weight: Bool[np.ndarray, "frames joints"],
    floating: Bool[np.ndarray, " frames"],
    root_world: Float[np.ndarray, "frames 3"],
) -> tuple[Float[np.ndarray, "frames 3"], Float[np.ndarray, "frames joints 3"], Float[np.ndarray, "frames joints 3"]]:
    """The root, and both sets of arms, about the targets' middle in frames that do not observe the root."""
    filled = np.nan_to_num(joints_world)
    origin = np.where(floating[:, None], _mean(weight, filled), root_world)
    middle = np.where(floating[:, None], _mean(weight, np.broadcast_to(rest, filled.shape)), 0.0)
    return origin, np.where(weight[..., None], filled - origin[:, None], 0.0), rest - middle[:, None]


def _turned(
    weight: Bool[np.ndarray, "frames joints"],
    reach: Float[np.ndarray, "frames joints 3"],
    arms: Float[np.ndarray, "frames joints 3"],
    before: Float[np.ndarray, "frames 3 3"],
) -> tuple[Float[np.ndarray, "frames 3 3"], Float[np.ndarray, "frames 3"]]:
    """Rotations that turn the arms onto the reach, nearest to `before` where that leaves a choice; axes left free."""
    H = np.einsum("fj,fja,fjb->fab", weight.astype(np.float64), reach, arms)
    size = np.linalg.norm(H, axis=(1, 2))
    scale = np.where(size > 0, size, 1.0)
    H = H / scale[:, None, None]
    values = np.linalg.svd(H, compute_uv=False)
    fixed = values[:, 1] > FLAT * np.maximum(values[:, 0], 1e-300)
    R = _nearest(np.where(fixed[:, None, None], H, H + 1e-6 * before))
    R[size == 0] = before[size == 0]
    single = ~fixed & (size > 0)
    longest = np.argmax(np.where(weight, np.linalg.norm(arms, axis=-1), -1.0), axis=1)
    rows = np.arange(len(H))
    arm = _unit(arms[rows, longest])
    goal = _unit(reach[rows, longest])
    swing = _swing((R @ arm[..., None])[..., 0], goal)
    R[single] = swing[single] @ R[single]
    return R, np.where(single[:, None], arm, 0.0)


def _nearest(H: Float[np.ndarray, "frames 3 3"]) -> Float[np.ndarray, "frames 3 3"]:
    """The rotation R that maximises trace(R^T H)."""
    left, _, right = np.linalg.svd(H)
    left[:, :, 2] *= np.sign(np.linalg.det(left) * np.linalg.det(right))[:, None]
    return left @ right


def _unit(vector: Float[np.ndarray, "frames 3"]) -> Float[np.ndarray, "frames 3"]:
    length = np.linalg.norm(vector, axis=-1, keepdims=True)
    return vector / np.where(length > 0, length, 1.0)


def _swing(
    start: Float[np.ndarray, "frames 3"], goal: Float[np.ndarray, "frames 3"]
) -> Float[np.ndarray, "frames 3 3"]:
    """The smallest rotations of unit vectors onto others that lie near."""
    cross = np.cross(start, goal)
    sine = np.linalg.norm(cross, axis=-1, keepdims=True)
    angle = np.arctan2(sine, (start * goal).sum(axis=-1, keepdims=True))
    return rotation_from_rotvec(cross * np.where(sine > 0, angle / np.where(sine > 0, sine, 1.0), 1.0))
