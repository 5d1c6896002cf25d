"""The points of a figure that detectors look for, and balls that wrap it."""

import numpy as np
from jaxtyping import Float, Int

from pgm_data.simulate.body.figure import Figure, smpl24

CANONICAL_HEIGHT_M = 1.8
FACE_IN_HEAD = np.array(
    [
        [0.0, 0.090, 0.122],
        [0.032, 0.125, 0.094],
        [-0.032, 0.125, 0.094],
        [0.084, 0.112, -0.008],
        [-0.084, 0.112, -0.008],
    ]
)
"""Nose, left and right eye, left and right ear in the Head joint's frame, metres, of a person 1.8 m tall."""
_AT_JOINTS = ("Shoulder", "Elbow", "Wrist", "Hip", "Knee", "Ankle")

# Balls of a person 1.8 m tall: joint, place in its frame (the left side's; x is mirrored on the right), radius, whether
# it thickens with the person's girth.
_MIDDLE_BALLS = (
    ("Head", (0.0, 0.158, -0.004), 0.100, False),
    ("Head", (0.0, 0.075, 0.020), 0.080, False),
    ("Neck", (0.0, 0.02, 0.0), 0.060, True),
    ("Spine", (0.0, 0.03, 0.0), 0.125, True),
    ("Torso", (0.0, -0.03, 0.0), 0.115, True),
)
_SIDE_BALLS = (
    ("Thorax", (-0.010, -0.07, 0.0), 0.120, True),
    ("Shoulder", (0.005, 0.0, -0.005), 0.062, True),
    ("Elbow", (0.0, 0.0, 0.0), 0.042, True),
    ("Elbow", (0.07, 0.0, 0.0), 0.044, True),
    ("Wrist", (0.0, 0.0, 0.0), 0.032, False),
    ("Torso", (0.055, -0.06, 0.0), 0.105, True),
    ("Hip", (-0.010, 0.02, -0.005), 0.102, True),
    ("Hip", (0.008, -0.13, 0.0), 0.098, True),
    ("Knee", (0.0, 0.0, 0.0), 0.056, True),
    ("Knee", (0.0, -0.12, -0.008), 0.057, True),
    ("Ankle", (-0.002, -0.022, -0.060), 0.040, False),
    ("Toe", (-0.012, 0.026, -0.005), 0.045, False),
    ("Toe", (-0.012, 0.016, 0.048), 0.030, False),
)
_FREE_HAND = ((0.030, 0.0, 0.0), 0.040), ((0.062, -0.012, 0.0), 0.032)
_CLOSED_HAND = ((0.0, -0.008, 0.0), 0.044), ((0.022, -0.012, 0.0), 0.036)


def keypoints17(
    figure: Figure, R_world: Float[np.ndarray, "times 24 3 3"], t_world: Float[np.ndarray, "times 24 3"]
) -> Float[np.ndarray, "times 17 3"]:
    """World positions of COCO's 17 points, in the order of the skeleton file; limbs at their joints.

    Takes the world rotations and positions of all joints.
    """
    names = smpl24().joint_names
    scale = figure.height_m / CANONICAL_HEIGHT_M
    head = names.index("Head")
    face = t_world[:, None, head] + np.einsum("nab,kb->nka", R_world[:, head], scale * FACE_IN_HEAD)
    limbs = t_world[:, [names.index(side + part) for part in _AT_JOINTS for side in ("L_", "R_")]]
    return np.concatenate([face, limbs], axis=1)


def hull(
    figure: Figure, R_world: Float[np.ndarray, "times 24 3 3"], t_world: Float[np.ndarray, "times 24 3"]
) -> tuple[Float[np.ndarray, "times balls 3"], Float[np.ndarray, " balls"]]:
    """Centres (world) and radii, metres, of balls that wrap the body without its racket."""
    joints, places, radii = hull_at_joints(figure)
    centres = t_world[:, joints] + np.einsum("nkab,kb->nka", R_world[:, joints], places)
    return centres, radii


def hull_at_joints(
    figure: Figure,
) -> tuple[Int[np.ndarray, " balls"], Float[np.ndarray, "balls 3"], Float[np.ndarray, " balls"]]:
    """The joint that each ball of the hull hangs on, its centre in the joint's frame and its radius, metres."""
    names = smpl24().joint_names
    scale = figure.height_m / CANONICAL_HEIGHT_M
    rows = [(names.index(joint), np.array(place), radius, thick) for joint, place, radius, thick in _MIDDLE_BALLS]
    for side, hand in (("L_", "left"), ("R_", "right")):
        mirror = np.array([1.0 if side == "L_" else -1.0, 1.0, 1.0])
        grips = _CLOSED_HAND if hand == figure.hand else _FREE_HAND
        for joint, place, radius, thick in (*_SIDE_BALLS, *(("Hand", p, r, False) for p, r in grips)):
            name = joint if joint == "Torso" else side + joint
            rows.append((names.index(name), mirror * place, radius, thick))
    grown = scale * np.array([figure.girth if thick else 1.0 for *_, thick in rows])
    places = np.array([place for _, place, _, _ in rows], dtype=float)
    return (
        np.array([joint for joint, *_ in rows]),
        places * grown[:, None],
        np.array([r for _, _, r, _ in rows]) * grown,
    )
