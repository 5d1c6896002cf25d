"""Players placed by the pipeline against the true ones: roots, joints, feet in stance, jumps, what is stated."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from pgm_data.dataset.clip_players import PlayerTrack
from pgm_data.skeleton import Skeleton

AXES = ("x", "y", "z")
SHORTEST_STANCE = 3
SHORTEST_JUMP = 3
"""Frames in a row of a stance or a jump that is measured."""
SAME_PERSON_M = 1.5
"""A player placed farther than this from the true one, on the ground, is taken for somebody else."""


@dataclass(frozen=True, eq=False, kw_only=True)
class PlayerErrors:
    """One player of one clip, errors frame by frame over distinct frames that hold the true player and a camera."""

    there: int
    """Such frames."""
    placed: int
    wrong: int
    """Of those placed, those at somebody else's place."""
    root_m: Float[np.ndarray, "placed 3"]
    """Solved less true."""
    root_std: Float[np.ndarray, "placed 3"]
    """As stated."""
    joints_m: Float[np.ndarray, " posed"]
    """Mean distance of joints, frame by frame."""
    pose_m: Float[np.ndarray, " posed"]
    """The same with both roots laid on each other."""
    stance_m: Float[np.ndarray, " feet"]
    """Height of a foot's lowest joint that truly stands, solved less true."""
    slide_m: Float[np.ndarray, " stances"]
    """How far the same joint wanders over the ground during each true stance, less how far it truly does."""
    jump_m: Float[np.ndarray, " jumps"]
    """Greatest height of the root in each true jump, solved less true."""
    contact_right: int
    """Feet and frames whose contact is said rightly."""
    contact_said: int


def player_errors(
    truth: PlayerTrack,
    solved: PlayerTrack,
    *,
    skeleton: Skeleton,
    counted: Bool[np.ndarray, " frames"],
) -> PlayerErrors:
    """What is wrong with a player's solution.

    Args:
        truth: The true player.
        solved: The same frames as solved.
        skeleton: Of both.
        counted: Frames that count: with a camera, and no repeats.
    """
    there = counted & (truth.status != "none")
    root = solved.root_position - truth.root_position
    placed = there & np.isfinite(root).all(axis=1) & (solved.status != "none")
    apart = np.linalg.norm(root[:, :2], axis=1)
    posed = placed & np.isfinite(solved.joints).all(axis=(1, 2))
    off = solved.joints[posed] - truth.joints[posed]
    feet = [foot_joint(skeleton, side) for side in range(2)]
    stance, slide, right, said = [], [], 0, 0
    for side, joint in enumerate(feet):
        stands = posed & (truth.contact[:, side] > 0.5)
        stance.append(solved.joints[stands, joint, 2] - truth.joints[stands, joint, 2])
        for run in runs(stands, SHORTEST_STANCE):
            slide.append(_wander(solved.joints[run, joint]) - _wander(truth.joints[run, joint]))
        known = posed & np.isfinite(solved.contact[:, side])
        said += int(known.sum())
        right += int(((solved.contact[:, side] > 0.5) == (truth.contact[:, side] > 0.5))[known].sum())
    airborne = posed & (truth.contact < 0.5).all(axis=1)
    jumps = [
        float(solved.root_position[run, 2].max() - truth.root_position[run, 2].max())
        for run in runs(airborne, SHORTEST_JUMP)
    ]
    return PlayerErrors(
        there=int(there.sum()),
        placed=int(placed.sum()),
        wrong=int((placed & (apart > SAME_PERSON_M)).sum()),
        root_m=root[placed],
        root_std=np.sqrt(np.maximum(np.diagonal(solved.root_cov[placed], axis1=1, axis2=2), 0.0)),
        joints_m=np.linalg.norm(off, axis=-1).mean(axis=1),
        pose_m=np.linalg.norm(off - off[:, :1], axis=-1).mean(axis=1),
        stance_m=np.concatenate(stance) if stance else np.zeros(0),
        slide_m=np.array(slide, dtype=float),
        jump_m=np.array(jumps, dtype=float),
        contact_right=right,
        contact_said=said,
    )


def foot_joint(skeleton: Skeleton, side: int) -> int:
    """The joint that the last point of a sole hangs on: the toes' where there is one."""
    return int(skeleton.point_joints[skeleton.point_names.index(skeleton.soles[side][-1])])


def runs(mask: Bool[np.ndarray, " frames"], shortest: int) -> list[np.ndarray]:
    """Frames in a row that the mask holds, as arrays of their numbers."""
    frames = np.flatnonzero(mask)
    pieces = np.split(frames, np.flatnonzero(np.diff(frames) > 1) + 1)
    return [piece for piece in pieces if len(piece) >= shortest]


def _wander(points: Float[np.ndarray, "frames 3"]) -> float:
    """The largest distance over the ground from the middle of a stance."""
    flat = points[:, :2]
    return float(np.linalg.norm(flat - np.median(flat, axis=0), axis=1).max())


def plain_errors(errors: PlayerErrors) -> dict:
    """The figures of a row, in JSON's types; None where there is nothing to say."""
    distance = np.linalg.norm(errors.root_m, axis=1)
    inside = np.abs(errors.root_m) <= errors.root_std
    return {
        "there": errors.there,
        "placed": errors.placed,
        "wrong": errors.wrong,
        "root_rms_m": _rms(distance),
        "root_median_m": _middle(distance),
        "root_axes_rms_m": [_rms(errors.root_m[:, axis]) for axis in range(3)],
        "covered": [float(inside[:, axis].mean()) if len(inside) else None for axis in range(3)],
        "joints_m": _middle(errors.joints_m),
        "pose_m": _middle(errors.pose_m),
        "stance_rms_m": _rms(errors.stance_m),
        "stance_p95_m": float(np.quantile(np.abs(errors.stance_m), 0.95)) if len(errors.stance_m) else None,
        "slide_m": _middle(np.maximum(errors.slide_m, 0.0)),
        "jump_rms_m": _rms(errors.jump_m),
        "jumps": len(errors.jump_m),
        "contact_right": errors.contact_right / errors.contact_said if errors.contact_said else None,
    }


def _rms(values: np.ndarray) -> float | None:
    return float(np.sqrt(np.mean(values**2))) if len(values) else None


def _middle(values: np.ndarray) -> float | None:
    return float(np.median(values)) if len(values) else None
