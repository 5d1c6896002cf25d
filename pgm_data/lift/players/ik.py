"""Joint rotations from joint positions: inverse kinematics with joint limits, for any skeleton.

Positions that a body of the skeleton's proportions can take are met exactly; what they leave open (the twist of a limb,
the ends of the tree, joints that are missing) is chosen smallest, within the limits, and steady from frame to frame.
Where the bones' lengths differ, or limits forbid it, the joints come as near as can be in the least-squares sense.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Int

from pgm_data.geometry.arrays import frozen
from pgm_data.geometry.rigid import rotvec_from_rotation
from pgm_data.lift.players.ik_reach import between_neighbours, bounded, reached, wrapped
from pgm_data.lift.players.ik_start import SHORT_M, Aimed, aimed
from pgm_data.lift.players.ik_twist import beyond, untwisted
from pgm_data.skeleton import Skeleton, world_joints

EXACT_M = 5e-6
"""Frames that meet their joints this well are not adjusted."""
FREER = 30.0
"""By how much less the second round of an adjustment, from where the first ended, holds on to where it began."""
STEADYING = 2
"""Rounds in which rotations are drawn to those of their neighbours."""


@dataclass(frozen=True, eq=False, kw_only=True)
class FitOptions:
    """How joint rotations are found."""

    bones: Literal["scaled", "own"] = "scaled"
    """Lengths: the skeleton's times one scale, or each bone's median over the clip (the scale's where never seen)."""
    scale: float | None = None
    """Size over the skeleton's, where it is known; else it is estimated."""
    steadiness: float = 10.0
    """Weight of a rotation's change from one frame to the next against its size, where positions leave it open."""
    least_joints: int = 3
    """Frames that observe fewer joints (of a skeleton that has as many) get none."""
    rest_m: float = 0.01
    """Where positions cannot be met: metres of distance that weigh as much as a radian away from the first guess."""
    steps: int = 30
    """At most, of the adjustment of positions that cannot be met by directions alone."""
    change_rad: float = 0.15
    """Where positions cannot be met: how far a rotation lies from the middle of its neighbours' in time, radians.

    With it, and the distance that is left as the noise, short bones do not tremble; inf: each frame by itself.
    """


@dataclass(frozen=True, eq=False, kw_only=True)
class FittedPose:
    """A skeleton fitted to joint positions; rows of frames that observe too few joints are NaN."""

    rotations: Float[np.ndarray, "frames joints 3"]
    """Axis-angle of parent_from_joint, radians, angles up to pi; entry 0 is world_from_root."""
    translations: Float[np.ndarray, "frames joints 3"]
    """Of parent_from_joint, metres; entry 0 is the root in the world."""
    joints: Float[np.ndarray, "frames joints 3"]
    """Where rotations and translations lead, world metres."""
    residual_m: Float[np.ndarray, " frames"]
    """Rms distance of the joints to the observed ones; NaN where there is no pose."""
    scale: float
    """Size over that of the skeleton's file; NaN where no bone was observed (the file's size is then taken)."""
    scale_std: float
    """Standard deviation of the scale by the spread of the bones' own; NaN with fewer than two of them."""

    def __post_init__(self) -> None:
        """Keep read-only copies."""
        for name in ("rotations", "translations", "joints", "residual_m"):
            object.__setattr__(self, name, frozen(getattr(self, name)))


def fit_rotations(
    joints_world: Float[np.ndarray, "frames joints 3"], skeleton: Skeleton, *, options: FitOptions | None = None
) -> FittedPose:
    """The skeleton's rotations and translations at the observed joints.

    Args:
        joints_world: The skeleton's joints in its order, metres; one with a number that is not finite was not observed.
        skeleton: Parents, rest pose and limits.
        options: How.

    Raises:
        ValueError: If there are not as many joints as the skeleton has, or an option is not what it must be.
    """
    options = options or FitOptions()
    count = len(skeleton.parents)
    if joints_world.ndim != 3 or joints_world.shape[1:] != (count, 3):
        raise ValueError(
            f"joints_world: expected (frames, {count}, 3) as {skeleton.name} has, got {joints_world.shape}"
        )
    if options.scale is not None and not (np.isfinite(options.scale) and options.scale > 0):
        raise ValueError(f"options.scale: expected above 0, got {options.scale}")
    seen = np.asarray(np.isfinite(joints_world).all(axis=-1))
    joints_world = np.where(seen[..., None], joints_world, np.nan)
    used = seen.sum(axis=1) >= min(options.least_joints, count)
    scale, scale_std, lengths = _sizes(joints_world, skeleton, options)
    bones = _bones(skeleton, lengths)
    empty = np.full(joints_world.shape, np.nan)
    result = {"rotations": empty, "translations": empty.copy(), "joints": empty.copy()}
    residual = np.full(len(joints_world), np.nan)
    if used.any():
        own = joints_world[used]
        rotations, translations = _solved(own, skeleton, bones, np.flatnonzero(used), options)
        joints = world_joints(skeleton.parents, rotations, translations)
        for name, values in (("rotations", rotations), ("translations", translations), ("joints", joints)):
            result[name][used] = values
        residual[used] = _residual(joints, own)
    return FittedPose(**result, residual_m=residual, scale=scale, scale_std=scale_std)


def _sizes(
    joints_world: Float[np.ndarray, "frames joints 3"], skeleton: Skeleton, options: FitOptions
) -> tuple[float, float, Float[np.ndarray, " joints"]]:
    """The scale, its standard deviation, and each bone's length; the root's is NaN."""
    parents, rest = skeleton.parents, np.linalg.norm(skeleton.rest_translations, axis=1)
    seen = np.linalg.norm(joints_world[:, 1:] - joints_world[:, parents[1:]], axis=-1)
    own = np.full(len(parents), np.nan)
    measured = np.flatnonzero(np.isfinite(seen).any(axis=0))
    own[measured + 1] = np.nanmedian(seen[:, measured], axis=0) if len(measured) else np.nan
    ratios = own[1:] / np.where(rest[1:] > SHORT_M, rest[1:], np.nan)
    known = np.isfinite(ratios) & (ratios > 0)
    scale, scale_std = np.nan, np.nan
    if known.any():
        scale = _weighted_median(ratios[known], rest[1:][known])
    if known.sum() > 1:
        spread = 1.4826 * _weighted_median(np.abs(ratios[known] - scale), rest[1:][known])
        scale_std = float(1.2533 * spread / np.sqrt(known.sum()))
    if options.scale is not None:
        scale, scale_std = options.scale, 0.0
    scaled = rest * (scale if np.isfinite(scale) else 1.0)
    return float(scale), scale_std, np.where(np.isfinite(own) & (options.bones == "own"), own, scaled)


def _weighted_median(values: Float[np.ndarray, " n"], weights: Float[np.ndarray, " n"]) -> float:
    order = np.argsort(values)
    share = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(share, share[-1] / 2)])


def _bones(skeleton: Skeleton, lengths: Float[np.ndarray, " joints"]) -> Float[np.ndarray, "joints 3"]:
    """Translations of parent_from_joint, metres; the root's is 0."""
    rest = np.linalg.norm(skeleton.rest_translations, axis=1)
    direction = skeleton.rest_translations / np.where(rest > SHORT_M, rest, 1.0)[:, None]
    bones = direction * np.where(rest > SHORT_M, lengths, 0.0)[:, None]
    bones[0] = 0.0
    return bones


def _solved(
    joints_world: Float[np.ndarray, "frames joints 3"],
    skeleton: Skeleton,
    bones: Float[np.ndarray, "joints 3"],
    frames: Int[np.ndarray, " frames"],
    options: FitOptions,
) -> tuple[Float[np.ndarray, "frames joints 3"], Float[np.ndarray, "frames joints 3"]]:
    """Rotations and translations of frames that observe enough."""
    parents = skeleton.parents
    start = aimed(parents, bones, skeleton.limits, joints_world)
    R = np.empty_like(start.R_world_from_joint)
    for run in _runs(frames):
        R[run] = untwisted(parents, skeleton.limits, _cut(start, run), steadiness=options.steadiness)
    to_parent = R.copy()
    to_parent[:, 1:] = np.swapaxes(R[:, parents[1:]], -1, -2) @ R[:, 1:]
    rotations = rotvec_from_rotation(to_parent)
    translations = np.broadcast_to(bones, rotations.shape).copy()
    translations[:, 0] = start.root_world
    allowed = bounded(rotations, skeleton.limits)
    joints = world_joints(parents, allowed, translations)
    off = _furthest(joints, joints_world) > EXACT_M
    if off.any():
        allowed, translations = _adjusted(joints_world, skeleton, allowed, translations, off, frames, options)
    return wrapped(allowed, skeleton.limits), translations


def _adjusted(
    joints_world: Float[np.ndarray, "frames joints 3"],
    skeleton: Skeleton,
    rotations: Float[np.ndarray, "frames joints 3"],
    translations: Float[np.ndarray, "frames joints 3"],
    off: Bool[np.ndarray, " frames"],
    frames: Int[np.ndarray, " frames"],
    options: FitOptions,
) -> tuple[Float[np.ndarray, "frames joints 3"], Float[np.ndarray, "frames joints 3"]]:
    """Rotations and translations after those that are off were brought near, then steadied by their neighbours."""
    rotations, translations = rotations.copy(), translations.copy()

    def reach(near: np.ndarray, near_m: float) -> None:
        rotations[off], translations[off] = reached(
            skeleton,
            joints_world[off],
            rotations[off],
            translations[off],
            near=near[off],
            near_m=near_m,
            steps=options.steps,
        )

    reach(rotations.copy(), options.rest_m)
    reach(rotations.copy(), options.rest_m / FREER)
    if np.isfinite(options.change_rad) and len(rotations) > 2:
        follows = np.diff(frames) == 1
        for _ in range(STEADYING):
            joints = world_joints(skeleton.parents, rotations, translations)
            noise = float(np.sqrt(np.mean(_residual(joints[off], joints_world[off]) ** 2)))
            near = bounded(between_neighbours(rotations, follows), skeleton.limits)
            reach(near, noise / options.change_rad)
    return rotations, translations


def _runs(frames: Int[np.ndarray, " frames"]) -> list[slice]:
    """Rows of frames that follow each other."""
    cuts = [0, *(np.flatnonzero(np.diff(frames) > 1) + 1).tolist(), len(frames)]
    return [slice(first, last) for first, last in zip(cuts[:-1], cuts[1:], strict=True)]


def _cut(start: Aimed, rows: slice) -> Aimed:
    return Aimed(
        R_world_from_joint=start.R_world_from_joint[rows],
        axis=start.axis[rows],
        loose=start.loose[rows],
        root_world=start.root_world[rows],
    )


def _furthest(
    joints: Float[np.ndarray, "frames joints 3"], observed: Float[np.ndarray, "frames joints 3"]
) -> Float[np.ndarray, " frames"]:
    return np.nan_to_num(np.linalg.norm(joints - observed, axis=-1)).max(axis=1)


def _residual(
    joints: Float[np.ndarray, "frames joints 3"], observed: Float[np.ndarray, "frames joints 3"]
) -> Float[np.ndarray, " frames"]:
    return np.sqrt(np.nanmean(((joints - observed) ** 2).sum(axis=-1), axis=1))


def outside_limits(
    rotations: Float[np.ndarray, "frames joints 3"], skeleton: Skeleton, *, tolerance_rad: float = 1e-3
) -> Bool[np.ndarray, "frames joints"]:
    """Which joints bend further than the skeleton's limits allow; False of NaN."""
    return np.asarray((np.abs(np.nan_to_num(beyond(rotations, skeleton.limits))) > tolerance_rad).any(axis=-1))
