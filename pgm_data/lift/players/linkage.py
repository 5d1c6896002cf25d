"""A skeleton in the few angles that its points can tell, with the derivatives of its points.

An unknown is one component of a joint's axis-angle vector (parent_from_joint), or of the sum of those of a chain of
joints between which nothing is seen, such as a spine's, which share a bend alike. Components that move no point are
left out: those joints stay in the posture of reference.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from pgm_data.geometry.arrays import frozen
from pgm_data.geometry.rigid import SMALL_ANGLE, rotation_from_rotvec, skew
from pgm_data.skeleton import Skeleton

SEEN_MOVE_M = 0.004
"""A component that moves every point less than this by a turn of 1 radian is left out."""
ROOT = 6
"""Unknowns of the root: position, then its turn about the world's axes."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Linkage:
    """Points that hang on a skeleton, and how they move with its unknowns."""

    skeleton: Skeleton
    reference: Float[np.ndarray, "joints 3"]
    """Axis-angle of parent_from_joint where all unknowns are 0, radians."""
    basis: Float[np.ndarray, "joints 3 unknowns"]
    """Axis-angle vectors of joints per unknown."""
    point_joints: Int[np.ndarray, " points"]
    point_offsets: Float[np.ndarray, "points 3"]
    """In the joint's frame, metres at the size of the skeleton file."""
    moves: Bool[np.ndarray, "points joints"]
    """Whether the joint's turn moves the point."""
    chain: Int[np.ndarray, " points"]
    """How many turning chains lie between root and point."""
    soles: tuple[slice, slice]
    """Points of the left and of the right sole among the points; those seen in pictures come before them."""
    seen: int
    """How many points are seen in pictures: the first ones."""
    ankles: tuple[int, int]
    """The seen point furthest down the left and the right leg; -1 where there is none."""

    def __post_init__(self) -> None:
        """Keep read-only copies."""
        for name in ("reference", "basis", "point_offsets"):
            object.__setattr__(self, name, frozen(getattr(self, name)))


@dataclass(frozen=True, eq=False, kw_only=True)
class Posture:
    """A linkage in some frames."""

    position: Float[np.ndarray, "frames 3"]
    """Of the root in the world, metres."""
    rotation: Float[np.ndarray, "frames 3 3"]
    """R_world_from_root."""
    angles: Float[np.ndarray, "frames unknowns"]
    """Radians, off the posture of reference."""
    log_scale: float
    """Logarithm of the size over that of the skeleton file."""


def linked(skeleton: Skeleton, point_names: tuple[str, ...], reference: Float[np.ndarray, "joints 3"]) -> Linkage:
    """The linkage of the points with the given names and of the soles' points.

    Raises:
        ValueError: If the skeleton has no such point.
    """
    stray = [name for name in point_names if name not in skeleton.point_names]
    if stray:
        raise ValueError(f"points: expected some of {', '.join(skeleton.point_names)}, got {stray[0]!r}")
    names = [*point_names, *skeleton.soles[0], *skeleton.soles[1]]
    index = np.array([skeleton.point_names.index(name) for name in names], dtype=np.int64)
    joints, offsets = skeleton.point_joints[index], skeleton.point_offsets[index]
    count = len(skeleton.parents)
    above = np.eye(count, dtype=bool)
    for joint, parent in enumerate(skeleton.parents):
        if parent >= 0:
            above[joint] |= above[parent]
    moves = above[joints].copy()
    # A joint does not move what lies in its own origin.
    at_origin = np.linalg.norm(offsets, axis=1) < 1e-9
    for point in np.flatnonzero(at_origin):
        joint = joints[point]
        while joint >= 0:
            moves[point, joint] = False
            if np.linalg.norm(skeleton.rest_translations[joint]) > 1e-9:
                break
            joint = skeleton.parents[joint]
    moves[:, 0] = True
    basis, chain = _basis(skeleton, moves, joints, offsets, len(point_names))
    left = len(point_names) + len(skeleton.soles[0])
    return Linkage(
        skeleton=skeleton,
        reference=np.asarray(reference, np.float64),
        basis=basis,
        point_joints=joints,
        point_offsets=offsets,
        moves=moves,
        chain=chain,
        soles=(slice(len(point_names), left), slice(left, len(names))),
        seen=len(point_names),
        ankles=(
            _furthest(moves[: len(point_names)], moves[len(point_names) : left]),
            _furthest(moves[: len(point_names)], moves[left:]),
        ),
    )


def _furthest(seen: np.ndarray, sole: np.ndarray) -> int:
    """The seen point that most joints above a sole move, and none beside them; -1 if none but the root does."""
    under = sole.any(axis=0)
    depth = np.where((seen & ~under).any(axis=1), 0, seen.sum(axis=1))
    return int(depth.argmax()) if len(depth) and depth.max() > 1 else -1


def _basis(
    skeleton: Skeleton, moves: np.ndarray, joints: np.ndarray, offsets: np.ndarray, seen: int
) -> tuple[np.ndarray, np.ndarray]:
    """Basis of the unknowns, and how many chains lie above each point."""
    count = len(skeleton.parents)
    # What moves no point that is seen is free once along a limb, at its upper end: an ankle, not its toes.
    watched = np.asarray(moves[:seen].any(axis=0))
    watched[0] = True
    active = np.asarray(moves.any(axis=0)) & (watched | watched[skeleton.parents])
    chain_of = np.full(count, -1)
    chains: list[list[int]] = []
    for joint in range(1, count):
        if not active[joint]:
            continue
        parent = skeleton.parents[joint]
        # Joined to its parent's chain if they move the very same points.
        if parent > 0 and chain_of[parent] >= 0 and np.array_equal(moves[:, parent], moves[:, joint]):
            chain_of[joint] = chain_of[parent]
            chains[chain_of[joint]].append(joint)
        else:
            chain_of[joint] = len(chains)
            chains.append([joint])
    columns = []
    for members in chains:
        for axis in range(3):
            column = np.zeros((count, 3))
            column[members, axis] = 1.0 / len(members)
            columns.append(column)
    basis = np.stack(columns, axis=-1) if columns else np.zeros((count, 3, 0))
    depth = np.array([len({chain_of[j] for j in np.flatnonzero(row[1:]) + 1}) for row in moves], dtype=np.int64)
    if not columns:
        return basis, depth
    # Leave out what moves nothing while the joints below are bent, such as the twist of a forearm without a hand.
    bent = 0.4 * np.random.default_rng(0).normal(size=(count, 3))
    reach = np.empty(basis.shape[-1])
    for chain, members in enumerate(chains):
        straight = bent.copy()
        straight[members] = 0.0
        points, _, slopes = _placed(
            skeleton, straight[None], np.eye(3)[None], np.zeros((1, 3)), 1.0, basis, moves, joints, offsets
        )
        assert slopes is not None
        mine = slice(3 * chain, 3 * chain + 3)
        reach[mine] = np.linalg.norm(slopes[0, :, :, ROOT:][..., mine], axis=1).max(axis=0)
    return basis[..., reach > SEEN_MOVE_M], depth


def left_jacobian(rotvec: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 3 3"]:
    """J with exp(v + dv) = exp(J dv) exp(v) to first order."""
    angle = np.linalg.norm(rotvec, axis=-1)[..., None, None]
    small = angle < SMALL_ANGLE
    safe = np.where(small, 1.0, angle)
    first = np.where(small, 0.5 - angle**2 / 24, 2 * np.sin(safe / 2) ** 2 / safe**2)
    second = np.where(small, 1 / 6 - angle**2 / 120, (safe - np.sin(safe)) / safe**3)
    k = skew(rotvec)
    return np.eye(3) + first * k + second * (k @ k)


def rotvecs(linkage: Linkage, posture: Posture) -> Float[np.ndarray, "frames joints 3"]:
    """Axis-angle vectors of all joints but the root, whose entry is 0."""
    return linkage.reference + np.einsum("jau,fu->fja", linkage.basis, posture.angles)


def placed(
    linkage: Linkage, posture: Posture, *, slopes: bool
) -> tuple[
    Float[np.ndarray, "frames points 3"],
    Float[np.ndarray, "frames points 3"] | None,
    Float[np.ndarray, "frames points 3 unknowns"] | None,
]:
    """World positions of all points; their derivatives by the logarithm of the scale and by the unknowns, if wanted.

    Unknowns are the root's position, its turn about the world's axes, and the angles.
    """
    return _placed(
        linkage.skeleton,
        rotvecs(linkage, posture),
        posture.rotation,
        posture.position,
        float(np.exp(posture.log_scale)),
        linkage.basis if slopes else None,
        linkage.moves,
        linkage.point_joints,
        linkage.point_offsets,
    )


def _placed(skeleton, vectors, rotation, position, scale, basis, moves, point_joints, offsets):
    parents, rest = skeleton.parents, skeleton.rest_translations
    frames, count = vectors.shape[:2]
    R_joint = rotation_from_rotvec(vectors)
    R = np.empty((frames, count, 3, 3))
    origins = np.empty((frames, count, 3))
    R[:, 0], origins[:, 0] = rotation, position
    for joint in range(1, count):
        parent = parents[joint]
        origins[:, joint] = origins[:, parent] + scale * (R[:, parent] @ rest[joint])
        R[:, joint] = R[:, parent] @ R_joint[:, joint]
    points = origins[:, point_joints] + scale * np.einsum("fpab,pb->fpa", R[:, point_joints], offsets)
    if basis is None:
        return points, None, None
    unknowns = basis.shape[-1]
    slopes = np.zeros((frames, len(point_joints), 3, ROOT + unknowns))
    arm = points - position[:, None]
    slopes[..., :3] = np.eye(3)
    slopes[..., 3:ROOT] = -skew(arm)
    J = left_jacobian(vectors)
    for unknown in range(unknowns):
        for joint in np.flatnonzero(np.any(basis[:, :, unknown] != 0, axis=1)):
            mine = np.flatnonzero(moves[:, joint])
            axis = (R[:, parents[joint]] @ (J[:, joint] @ basis[joint, :, unknown])[..., None])[..., 0]
            slopes[..., ROOT + unknown][:, mine] += np.cross(axis[:, None], points[:, mine] - origins[:, joint, None])
    return points, arm, slopes


def parameters(
    linkage: Linkage, posture: Posture
) -> tuple[
    Float[np.ndarray, "frames joints 3 3"], Float[np.ndarray, "frames joints 3"], Float[np.ndarray, "frames joints 3"]
]:
    """World rotations and positions of all joints, and their translations from their parents (the root's: world)."""
    skeleton = linkage.skeleton
    R = rotation_from_rotvec(rotvecs(linkage, posture))
    R[:, 0] = posture.rotation
    translations = np.repeat(np.exp(posture.log_scale) * skeleton.rest_translations[None], len(R), axis=0)
    translations[:, 0] = posture.position
    joints = translations.copy()
    for joint, parent in enumerate(skeleton.parents):
        if parent >= 0:
            joints[:, joint] = joints[:, parent] + (R[:, parent] @ translations[:, joint, :, None])[..., 0]
            R[:, joint] = R[:, parent] @ R[:, joint]
    return R, joints, translations
