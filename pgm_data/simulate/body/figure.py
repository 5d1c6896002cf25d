"""One person's skeleton: proportions, joint names, forward kinematics. Joints in the order of SMPL's 24."""

from dataclasses import dataclass
from functools import cache
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float

from pgm_data.skeleton import Skeleton, load_skeleton

Hand = Literal["left", "right"]


@cache
def smpl24() -> Skeleton:
    """The skeleton file that figures follow: T-pose at rest, x to the person's left, y up, z forward."""
    return load_skeleton("smpl24")


@dataclass(frozen=True, eq=False, kw_only=True)
class Figure:
    """One person's build."""

    translations: Float[np.ndarray, "24 3"]
    """t_parent_from_joint at rest, metres; the root's is its height above the soles when standing."""
    height_m: float
    girth: float
    """Thickness of the body over that of an athlete of this height; about 0.85 to 1.2."""
    hand: Hand
    """The hand of the racket."""


@dataclass(frozen=True, eq=False, kw_only=True)
class BodyTrack:
    """A figure's posture at some times."""

    root_position: Float[np.ndarray, "times 3"]
    """World metres, of the pelvis."""
    rotations: Float[np.ndarray, "times 24 3 3"]
    """R_parent_from_joint; entry 0 is R_world_from_root."""
    contact: Bool[np.ndarray, "times 2"]
    """Whether the left, the right foot is planted."""


def draw_figure(rng: np.random.Generator, hand: Hand) -> Figure:
    """A figure by lot: 1.62 to 2.05 m tall, limbs longer or shorter by some per cent, left and right alike."""
    height = float(np.clip(rng.normal(1.84, 0.08), 1.62, 2.05))
    rest = np.array(smpl24().rest_translations) * (height / 1.8)
    names = smpl24().joint_names
    for part in ("Hip", "Knee", "Ankle", "Shoulder", "Elbow", "Wrist"):
        factor = 1.0 + 0.03 * float(np.clip(rng.normal(), -2, 2))
        for side in ("L_", "R_"):
            rest[names.index(side + part)] *= factor
    leg = sum(rest[names.index("L_" + part), 1] for part in ("Hip", "Knee", "Ankle", "Toe"))
    rest[0] = [0.0, -leg + 0.01 * height / 1.8, 0.0]
    return Figure(translations=rest, height_m=height, girth=float(np.clip(rng.normal(1.0, 0.08), 0.85, 1.2)), hand=hand)


def world_from_joints(
    figure: Figure, root_position: Float[np.ndarray, "times 3"], rotations: Float[np.ndarray, "times 24 3 3"]
) -> tuple[np.ndarray, np.ndarray]:
    """World rotations (times, 24, 3, 3) and positions (times, 24, 3) of all joints."""
    R = np.empty_like(rotations)
    t = np.empty((len(rotations), 24, 3))
    R[:, 0], t[:, 0] = rotations[:, 0], root_position
    for joint, parent in enumerate(smpl24().parents):
        if parent >= 0:
            R[:, joint] = R[:, parent] @ rotations[:, joint]
            t[:, joint] = t[:, parent] + R[:, parent] @ figure.translations[joint]
    return R, t
