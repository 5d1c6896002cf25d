"""Postures of tennis, as a coach would show them on a right-hander, and the angles of the joints in them.

Places are (right, up, ahead) from the pelvis in metres for a player 1.84 m tall, directions likewise; ahead is towards
the net, however the hips are turned.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
from jaxtyping import Float

from pgm_data.simulate import rotations
from pgm_data.simulate.body import arms
from pgm_data.simulate.body.figure import smpl24
from pgm_data.simulate.body.reach import MIDDLE_HEIGHT_M

Triple = tuple[float, float, float]
THROAT_M, GRIP_M = 0.25, 0.095
"""Where the other hand holds the shaft, metres from the racket hand: at the throat, on the grip."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Posture:
    """One posture; angles in degrees."""

    hand: Triple
    """Place of the racket hand's knuckles."""
    shaft: Triple
    """Direction from the racket's butt to its tip."""
    palm: Triple
    """Direction in which the racket's palm and that side of the face look."""
    turn: float = 0.0
    """Of the hips from the net to the left."""
    trunk: Triple = (0.0, 0.0, 0.0)
    """Lean forward, turn to the left, lean to the right, over the hips."""
    other: Triple | float = (-0.25, 0.10, 0.25)
    """Place of the other hand; or, where it holds the shaft, how far from the racket hand."""
    other_palm: Triple = (0.6, -0.5, 0.2)
    drop: float = 0.08
    """How much lower the pelvis is than standing, metres."""
    lean: float = 4.0
    """Of the hips, forward."""
    tilt: float = 0.0
    """Of the hips, to the left."""
    elbow: Triple | None = None
    """Place of the racket's elbow, where it matters."""
    rest: tuple[float, float] = (15.0, 5.0)
    """Twist of the racket's upper arm inward and pronation of its forearm, from which the rest is found."""


READY = Posture(
    hand=(0.10, 0.13, 0.33), shaft=(-0.45, 0.50, 0.75), palm=(-0.9, 0.1, -0.45), trunk=(14, 0, 0), other=THROAT_M,
    drop=0.09, lean=10,
)  # fmt: skip

POSTURES: dict[str, Posture] = {
    "ready": READY,
    # Relaxed between points: arms hang, the racket's head down and ahead.
    "walk": Posture(
        hand=(0.27, -0.07, 0.08), shaft=(-0.15, -0.35, 0.90), palm=(-1.0, 0.0, -0.2), trunk=(3, 0, 0),
        other=(-0.27, -0.09, 0.06), other_palm=(1.0, 0.0, 0.0), drop=0.0, lean=1,
    ),
    "walk_ahead": Posture(
        hand=(0.25, -0.04, 0.20), shaft=(-0.15, -0.10, 0.95), palm=(-1.0, 0.0, -0.2), trunk=(3, 4, 0),
        other=(-0.27, -0.07, -0.14), other_palm=(1.0, 0.0, 0.0), drop=0.0, lean=1,
    ),
    "walk_back": Posture(
        hand=(0.28, -0.07, -0.05), shaft=(-0.10, -0.55, 0.85), palm=(-1.0, 0.0, -0.2), trunk=(3, -4, 0),
        other=(-0.25, -0.05, 0.22), other_palm=(1.0, 0.0, 0.0), drop=0.0, lean=1,
    ),
    "run_ahead": Posture(
        hand=(0.20, 0.20, 0.34), shaft=(-0.45, 0.65, 0.6), palm=(-0.9, 0.0, -0.4), trunk=(10, 5, 0),
        other=(-0.30, 0.10, -0.22), other_palm=(1.0, 0.0, 0.0), drop=0.04, lean=6,
    ),
    "run_back": Posture(
        hand=(0.33, 0.10, 0.08), shaft=(-0.25, 0.5, 0.85), palm=(-1.0, 0.2, -0.2), trunk=(10, -5, 0),
        other=(-0.16, 0.24, 0.32), other_palm=(1.0, 0.0, -0.2), drop=0.04, lean=6,
    ),
    # Forehand drive.
    "fh_turn": Posture(
        hand=(0.40, 0.30, 0.16), shaft=(-0.05, 0.95, 0.25), palm=(0.3, 0.0, 0.9), turn=-40, trunk=(8, -25, 0),
        other=(0.16, 0.34, 0.32), other_palm=(0.5, 0.0, 0.5), drop=0.10,
    ),
    "fh_back": Posture(
        hand=(0.52, 0.36, -0.28), shaft=(0.25, 0.75, -0.60), palm=(0.85, -0.35, 0.3), turn=-60, trunk=(8, -38, 4),
        other=(0.34, 0.32, 0.42), other_palm=(0.2, -0.9, 0.2), drop=0.14,
    ),
    "fh_drop": Posture(
        hand=(0.60, 0.02, -0.22), shaft=(0.30, -0.30, -0.90), palm=(0.85, -0.45, 0.35), turn=-42, trunk=(8, -28, 8),
        other=(0.12, 0.28, 0.42), other_palm=(0.4, -0.8, 0.2), drop=0.13,
    ),
    "fh_hit": Posture(
        hand=(0.42, 0.10, 0.36), shaft=(0.92, -0.05, 0.15), palm=(-0.05, 0.0, 1.0), turn=-15, trunk=(6, 0, 5),
        other=(-0.22, 0.26, 0.22), other_palm=(0.8, 0.0, -0.3), drop=0.08,
    ),
    "fh_through": Posture(
        hand=(0.10, 0.38, 0.56), shaft=(-0.35, 0.60, 0.72), palm=(-0.9, -0.25, 0.2), turn=8, trunk=(4, 20, 0),
        other=(-0.28, 0.30, 0.12), other_palm=(0.6, -0.3, 0.5), drop=0.05,
    ),
    "fh_wrap": Posture(
        hand=(-0.26, 0.47, 0.24), shaft=(-0.45, -0.10, -0.88), palm=(-0.75, -0.5, 0.4), turn=24, trunk=(4, 32, 0),
        other=(-0.36, 0.22, 0.05), other_palm=(0.6, -0.3, 0.5), drop=0.05, elbow=(0.05, 0.46, 0.42),
    ),
    # Backhand with both hands.
    "bh2_turn": Posture(
        hand=(-0.16, 0.24, 0.30), shaft=(-0.25, 0.88, 0.20), palm=(0.55, 0.1, -0.8), turn=45, trunk=(8, 22, 0),
        other=GRIP_M, drop=0.10,
    ),
    "bh2_back": Posture(
        hand=(-0.40, 0.16, 0.02), shaft=(-0.35, 0.55, -0.75), palm=(0.85, 0.35, -0.2), turn=62, trunk=(10, 34, -4),
        other=GRIP_M, drop=0.14,
    ),
    "bh2_drop": Posture(
        hand=(-0.38, -0.06, 0.08), shaft=(-0.40, -0.25, -0.88), palm=(0.85, 0.25, -0.45), turn=48, trunk=(10, 26, -8),
        other=GRIP_M, drop=0.13,
    ),
    "bh2_hit": Posture(
        hand=(-0.14, 0.06, 0.37), shaft=(-0.92, -0.05, 0.1), palm=(0.05, 0.05, -1.0), turn=5, trunk=(8, 2, -4),
        other=GRIP_M, drop=0.08,
    ),
    "bh2_through": Posture(
        hand=(0.10, 0.32, 0.48), shaft=(0.20, 0.55, 0.80), palm=(-0.9, 0.2, -0.1), turn=0, trunk=(4, -16, 0),
        other=GRIP_M, drop=0.05,
    ),
    "bh2_up": Posture(
        hand=(0.20, 0.45, 0.40), shaft=(0.20, 0.95, 0.20), palm=(-0.85, 0.15, -0.45), turn=-8, trunk=(2, -22, 0),
        other=GRIP_M, drop=0.05,
    ),
    "bh2_wrap": Posture(
        hand=(0.27, 0.52, 0.26), shaft=(0.45, 0.40, -0.80), palm=(-0.85, 0.1, -0.5), turn=-14, trunk=(2, -26, 0),
        other=GRIP_M, drop=0.05, elbow=(0.28, 0.34, 0.40),
    ),
    # Backhand with one hand.
    "bh1_turn": Posture(
        hand=(-0.14, 0.26, 0.30), shaft=(-0.30, 0.88, 0.10), palm=(0.6, 0.1, -0.8), turn=50, trunk=(8, 25, 0),
        other=THROAT_M, drop=0.10,
    ),
    "bh1_back": Posture(
        hand=(-0.36, 0.30, 0.10), shaft=(-0.30, 0.65, -0.70), palm=(0.85, 0.4, -0.1), turn=68, trunk=(8, 38, -4),
        other=THROAT_M, drop=0.13,
    ),
    "bh1_drop": Posture(
        hand=(-0.34, -0.04, 0.18), shaft=(-0.55, -0.35, -0.76), palm=(0.75, 0.1, -0.65), turn=58, trunk=(10, 30, -6),
        other=(-0.34, 0.08, 0.02), other_palm=(0.5, 0.0, 0.5), drop=0.13,
    ),
    "bh1_hit": Posture(
        hand=(-0.22, 0.10, 0.46), shaft=(-0.92, 0.0, 0.12), palm=(0.05, 0.05, -1.0), turn=42, trunk=(8, 14, -2),
        other=(-0.40, 0.08, -0.14), other_palm=(0.5, 0.0, 0.5), drop=0.08,
    ),
    "bh1_through": Posture(
        hand=(0.18, 0.48, 0.56), shaft=(0.15, 0.72, 0.68), palm=(-0.9, 0.35, -0.2), turn=32, trunk=(2, 4, 0),
        other=(-0.46, 0.12, -0.34), other_palm=(0.3, -0.4, 0.5), drop=0.05,
    ),
    "bh1_wrap": Posture(
        hand=(0.52, 0.64, 0.30), shaft=(0.55, 0.80, -0.05), palm=(-0.35, 0.3, 0.85), turn=22, trunk=(0, -8, 0),
        other=(-0.46, 0.14, -0.42), other_palm=(0.3, -0.4, 0.5), drop=0.04,
    ),
    # Slices: from high to low, the face open.
    "fs_back": Posture(
        hand=(0.48, 0.52, -0.04), shaft=(0.10, 0.85, -0.45), palm=(0.55, 0.25, 0.75), turn=-50, trunk=(6, -28, 0),
        other=(0.14, 0.40, 0.42), other_palm=(0.2, -0.8, 0.2), drop=0.12,
    ),
    "fs_hit": Posture(
        hand=(0.42, 0.14, 0.36), shaft=(0.85, 0.25, 0.1), palm=(-0.05, 0.3, 0.95), turn=-20, trunk=(10, -2, 4),
        other=(-0.24, 0.22, 0.12), other_palm=(0.6, -0.3, 0.3), drop=0.12,
    ),
    "fs_through": Posture(
        hand=(0.14, 0.02, 0.60), shaft=(0.35, 0.35, 0.80), palm=(-0.5, 0.8, 0.2), turn=0, trunk=(12, 14, 0),
        other=(-0.32, 0.20, 0.06), other_palm=(0.6, -0.3, 0.3), drop=0.10,
    ),
    "bs_back": Posture(
        hand=(-0.40, 0.38, 0.20), shaft=(-0.50, 0.75, -0.35), palm=(0.75, 0.1, -0.6), turn=60, trunk=(6, 34, 0),
        other=THROAT_M, drop=0.12,
    ),
    "bs_hit": Posture(
        hand=(-0.22, 0.14, 0.44), shaft=(-0.85, 0.25, 0.1), palm=(0.0, -0.3, -0.95), turn=45, trunk=(12, 16, -2),
        other=(-0.42, 0.14, -0.14), other_palm=(0.4, -0.4, 0.4), drop=0.12,
    ),
    "bs_through": Posture(
        hand=(0.16, 0.02, 0.62), shaft=(0.10, 0.30, 0.90), palm=(-0.5, -0.8, 0.3), turn=34, trunk=(14, 4, 0),
        other=(-0.46, 0.16, -0.34), other_palm=(0.3, -0.4, 0.4), drop=0.10,
    ),
    # Volleys: short, in front.
    "fv_back": Posture(
        hand=(0.44, 0.34, 0.24), shaft=(0.30, 0.88, -0.10), palm=(0.2, 0.15, 0.95), turn=-30, trunk=(10, -20, 0),
        other=(-0.04, 0.30, 0.42), other_palm=(0.4, -0.5, 0.3), drop=0.13, lean=8,
    ),
    "fv_hit": Posture(
        hand=(0.42, 0.20, 0.42), shaft=(0.74, 0.62, 0.15), palm=(-0.05, 0.15, 0.98), turn=-14, trunk=(12, -4, 2),
        other=(-0.18, 0.28, 0.34), other_palm=(0.4, -0.6, 0.3), drop=0.14, lean=8,
    ),
    "fv_through": Posture(
        hand=(0.30, 0.12, 0.56), shaft=(0.62, 0.58, 0.50), palm=(-0.35, 0.35, 0.85), turn=-4, trunk=(14, 4, 0),
        other=(-0.24, 0.26, 0.24), other_palm=(0.5, -0.6, 0.2), drop=0.14, lean=8,
    ),
    "bv_back": Posture(
        hand=(-0.24, 0.34, 0.28), shaft=(-0.30, 0.90, -0.10), palm=(0.25, -0.1, -0.95), turn=35, trunk=(10, 22, 0),
        other=THROAT_M, drop=0.13, lean=8,
    ),
    "bv_hit": Posture(
        hand=(-0.22, 0.20, 0.44), shaft=(-0.74, 0.62, 0.15), palm=(0.0, -0.15, -0.98), turn=26, trunk=(12, 12, -2),
        other=(-0.42, 0.18, 0.06), other_palm=(0.4, -0.4, 0.4), drop=0.14, lean=8,
    ),
    "bv_through": Posture(
        hand=(-0.06, 0.12, 0.58), shaft=(-0.52, 0.55, 0.60), palm=(0.4, -0.4, -0.8), turn=20, trunk=(14, 4, 0),
        other=(-0.48, 0.16, -0.10), other_palm=(0.4, -0.4, 0.4), drop=0.14, lean=8,
    ),
    # Serve and smash. The server stands side on.
    "stance": Posture(
        hand=(0.16, 0.22, 0.38), shaft=(-0.30, 0.35, 0.88), palm=(-0.95, 0.1, -0.3), turn=-72, trunk=(6, 10, 0),
        other=0.16, drop=0.02, lean=3,
    ),
    "wind": Posture(
        hand=(0.30, 0.00, 0.22), shaft=(-0.10, -0.35, 0.92), palm=(-1.0, 0.0, -0.1), turn=-74, trunk=(12, 8, 0),
        other=(0.06, 0.02, 0.40), other_palm=(0.0, 1.0, 0.0), drop=0.05, lean=4,
    ),
    "release": Posture(
        hand=(0.42, 0.02, -0.34), shaft=(0.20, -0.10, -0.95), palm=(0.95, -0.1, 0.2), turn=-80, trunk=(-2, -6, 10),
        other=(0.02, 0.72, 0.48), other_palm=(0.0, 1.0, -0.2), drop=0.10, lean=2, tilt=-2,
    ),
    "trophy": Posture(
        hand=(0.34, 0.66, -0.34), shaft=(-0.15, 0.95, 0.25), palm=(-0.9, -0.1, 0.3), turn=-86, trunk=(-12, -14, 16),
        other=(0.02, 0.98, 0.26), other_palm=(-0.2, 0.6, 0.7), drop=0.20, lean=-2, tilt=2,
        elbow=(0.42, 0.42, -0.36), rest=(-75, 0),
    ),
    "lag": Posture(
        hand=(0.22, 0.76, -0.34), shaft=(0.15, -0.94, -0.30), palm=(-0.70, 0.1, 0.60), turn=-45, trunk=(-12, -10, 2),
        other=(-0.12, 0.55, 0.40), other_palm=(0.2, -0.8, 0.3), drop=-0.08, lean=2, elbow=(0.36, 0.62, -0.16),
        rest=(-95, -60),
    ),
    "smite": Posture(
        hand=(0.06, 1.10, 0.26), shaft=(0.10, 0.98, 0.15), palm=(0.0, -0.12, 1.0), turn=-22, trunk=(8, 4, -26),
        other=(-0.14, 0.24, 0.20), other_palm=(0.8, -0.2, -0.2), drop=-0.09, lean=12, tilt=12, rest=(-85, -10),
    ),
    "past": Posture(
        hand=(0.12, 0.56, 0.62), shaft=(0.25, -0.35, 0.88), palm=(0.75, -0.6, -0.1), turn=6, trunk=(18, 14, -6),
        other=(-0.16, 0.18, 0.14), other_palm=(0.8, -0.2, -0.2), drop=-0.05, lean=10,
    ),
    "across": Posture(
        hand=(-0.26, 0.04, 0.34), shaft=(-0.50, -0.55, -0.60), palm=(-0.2, -0.7, 0.6), turn=20, trunk=(24, 26, -2),
        other=(-0.24, 0.20, 0.02), other_palm=(0.6, -0.3, 0.0), drop=0.04, lean=10,
    ),
    "smash_turn": Posture(
        hand=(0.40, 0.50, -0.05), shaft=(0.0, 0.95, 0.0), palm=(-0.3, 0.0, 0.9), turn=-62, trunk=(-2, -14, 4),
        other=(0.10, 0.60, 0.50), other_palm=(0.0, 0.4, 0.9), drop=0.08, lean=0,
    ),
    "point_up": Posture(
        hand=(0.34, 0.66, -0.28), shaft=(-0.05, 0.95, 0.0), palm=(-0.7, 0.0, 0.6), turn=-74, trunk=(-10, -12, 10),
        other=(-0.02, 0.96, 0.34), other_palm=(0.0, 0.4, 0.9), drop=0.14, lean=-2,
        elbow=(0.46, 0.42, -0.28), rest=(-75, 0),
    ),
    # Lobs and low balls end high in front.
    "fl_through": Posture(
        hand=(0.16, 0.68, 0.40), shaft=(0.10, 0.88, 0.30), palm=(-0.5, -0.2, 0.8), turn=6, trunk=(-2, 14, 0),
        other=(-0.28, 0.24, 0.12), other_palm=(0.6, -0.3, 0.5), drop=0.06,
    ),
    "bl_through": Posture(
        hand=(0.04, 0.64, 0.42), shaft=(0.05, 0.90, 0.30), palm=(-0.3, 0.3, -0.85), turn=24, trunk=(-2, 2, 0),
        other=(-0.40, 0.20, 0.00), other_palm=(0.5, 0.0, 0.5), drop=0.06,
    ),
    "bl2_through": Posture(
        hand=(0.04, 0.52, 0.42), shaft=(0.05, 0.90, 0.30), palm=(-0.3, 0.3, -0.85), turn=10, trunk=(-2, -6, 0),
        other=GRIP_M, drop=0.06,
    ),
}  # fmt: skip

_REST = np.deg2rad([3, 0, -35, 5, 15, 60, 5, 0, -12, 0, -10.0])
_WEIGHTS = np.array([40.0, 5.0, 2.5, 8.0])
# Channels of a posture: 14 angles of the chain of the racket, 14 of the other one, 4 of the hips, 2 of the hold.
RACKET, OTHER, HIPS, HOLD = slice(0, 14), slice(14, 28), slice(28, 32), slice(32, 34)
"""Hips: turn to the left, drop, lean forward, tilt to the left.

Hold: how firmly (0 to 1) the other hand holds the shaft, and how far from the racket hand, metres.
"""


def shaft_points(
    angles_of_racket: Float[np.ndarray, "n 14"], along: Float[np.ndarray, " n"], bones: Float[np.ndarray, "8 3"]
) -> Float[np.ndarray, "n 3"]:
    """Points of the shaft, metres from the racket hand, in the frame of the other arm's chain: the mirror image."""
    R, p = arms.hands(angles_of_racket, bones)
    return (p + along[:, None] * (R @ arms.SHAFT)) * np.array([-1.0, 1.0, 1.0])


def side_bones(translations: Float[np.ndarray, "24 3"], hand: str) -> Float[np.ndarray, "8 3"]:
    """Trunk and arm at rest as `arms` counts them, as if the arm were the right one."""
    names = smpl24().joint_names
    mark, flip = ("L_", [-1.0, 1.0, 1.0]) if hand == "left" else ("R_", [1.0, 1.0, 1.0])
    parts = ("Torso", "Spine", "Chest", *(mark + part for part in ("Thorax", "Shoulder", "Elbow", "Wrist", "Hand")))
    return np.array([translations[names.index(part)] for part in parts]) * np.array(flip)


@cache
def angles(name: str) -> np.ndarray:
    """The channels of a posture."""
    posture = POSTURES[name]
    bones = side_bones(np.array(smpl24().rest_translations) * (MIDDLE_HEIGHT_M / 1.8), "right")
    from_net = rotations.about(1, -np.deg2rad(posture.turn))
    trunk = np.deg2rad(posture.trunk)
    elbow = np.zeros(3) if posture.elbow is None else _ahead(posture.elbow, from_net)
    wants = [
        _ahead(posture.hand, from_net),
        _unit(_ahead(posture.shaft, from_net)),
        _unit(_ahead(posture.palm, from_net)),
    ]
    racket = _arm(trunk, bones, np.stack([*wants, elbow]), posture.rest)
    mirror = np.array([-1.0, 1.0, 1.0])
    R, p = arms.hands(racket[None], bones)
    held = posture.other
    if isinstance(held, tuple):
        place, along, palm = _ahead(held, from_net), np.zeros(3), _unit(_ahead(posture.other_palm, from_net))
    else:
        place, along = p[0] + held * (R[0] @ arms.SHAFT), R[0] @ arms.SHAFT
        # Both palms face each other around the shaft.
        palm = R[0] @ np.array([0.0, 1.0, 0.0])
    pose = np.stack([mirror * place, mirror * along, mirror * palm, np.zeros(3)])
    other = _arm(trunk * np.array([1.0, -1.0, -1.0]), bones, pose, Posture.rest)
    hips = [np.deg2rad(posture.turn), posture.drop, np.deg2rad(posture.lean), np.deg2rad(posture.tilt)]
    hold = [0.0, THROAT_M] if isinstance(held, tuple) else [1.0, held]
    return np.concatenate([racket, other, hips, hold])


def _arm(trunk, bones, wants, rest) -> np.ndarray:
    low, high = arms.inner_limits()
    low[:3] = high[:3] = trunk
    # What is nowhere is not wanted.
    weights = np.where(wants.any(axis=1), _WEIGHTS, 0.0)
    start = np.concatenate([trunk, _REST])
    start[[7, 9]] = np.deg2rad(rest)
    return arms.settle_pose(start, low, high, 2.0 * arms.EASE, bones, np.zeros(3), wants, weights)


def _ahead(triple: Triple, R: np.ndarray) -> np.ndarray:
    return R @ (np.array(triple) * np.array([-1.0, 1.0, 1.0]))


def _unit(v: np.ndarray) -> np.ndarray:
    return v / np.linalg.norm(v)
