"""What a body may not do, measured on its motion: sliding feet, soles in the ground, joints beyond human limits.

Nothing here shares code with the planning of steps; it judges any body, animated by whatever means.
"""

import numpy as np
from jaxtyping import Float

from pgm_data.simulate.body.figure import BodyTrack, Figure, smpl24, world_from_joints

_NAMES = smpl24().joint_names
_MIDDLE_HEIGHT_M = 1.8
_SOLE_BELOW_TOE_M = 0.01
_HEEL_BEHIND_ANKLE_M = 0.05
_TOES_AHEAD_M = 0.07
"""Heel and toes of a person of the middle height."""

KNEE = (-0.09, 2.62)
"""Radians of bending; a knee of the skeleton at rest is bent by 0.05."""
ELBOW = (-0.09, 2.70)
HIP_FLEXION, HIP_SIDEWAYS, HIP_TWIST = (-0.85, 2.36), (-0.90, 1.13), (-1.10, 1.10)
"""Thigh forwards, outwards, and about itself, outwards, of the pelvis' frame. Athletes': the pelvis tilts along."""
ANKLE_POINT, ANKLE_ANY = (-0.87, 0.87), 1.05
"""Toes down; and the whole turn of the ankle in any direction."""
TOE = (-1.05, 0.35)
"""Toes down: they bend up by 60 degrees."""
_ANY = {"Torso": 0.7, "Spine": 0.7, "Chest": 0.7, "Neck": 0.9, "Head": 0.9}
"""The whole turn of a joint in any direction, of the trunk and the neck."""
_PARTS_ANY = {"Thorax": 0.8, "Wrist": 1.75, "Hand": 1.05}


def foot_slides(figure: Figure, track: BodyTrack) -> Float[np.ndarray, " stances"]:
    """How far the toe joint of a planted foot gets over the ground from where the stance began, metres, per stance.

    A stance is a run of times at which the foot is in contact; left foot first, then the right one.
    """
    _, joints = world_from_joints(figure, track.root_position, track.rotations)
    slides = []
    for foot, side in enumerate(("L_", "R_")):
        toe = joints[:, _NAMES.index(side + "Toe"), :2]
        contact = track.contact[:, foot]
        begins = contact & ~np.concatenate([[False], contact[:-1]])
        stance = np.cumsum(begins) - 1
        first = toe[np.flatnonzero(begins)]
        if len(first):
            away = np.linalg.norm(toe[contact] - first[stance[contact]], axis=-1)
            slides.append(np.maximum.reduceat(away, np.searchsorted(stance[contact], np.arange(len(first)))))
    return np.concatenate([np.zeros(0), *slides])


def ground_penetration(figure: Figure, track: BodyTrack) -> Float[np.ndarray, " times"]:
    """Depth of the lowest point of the soles (heels, balls, tips of the toes) under the ground, metres; 0 above it."""
    R, joints = world_from_joints(figure, track.root_position, track.rotations)
    scale = figure.height_m / _MIDDLE_HEIGHT_M
    lowest = np.full(len(joints), np.inf)
    for side in ("L_", "R_"):
        ankle, toe = _NAMES.index(side + "Ankle"), _NAMES.index(side + "Toe")
        sole = figure.translations[toe, 1] - _SOLE_BELOW_TOE_M * scale
        heel = np.array([0.0, sole, -_HEEL_BEHIND_ANKLE_M * scale])
        ball = np.array([figure.translations[toe, 0], sole, figure.translations[toe, 2]])
        tip = np.array([0.0, -_SOLE_BELOW_TOE_M * scale, _TOES_AHEAD_M * scale])
        for joint, point in ((ankle, heel), (ankle, ball), (toe, tip)):
            lowest = np.minimum(lowest, joints[:, joint, 2] + (R[:, joint] @ point)[:, 2])
    return np.maximum(-lowest, 0.0)


def joint_violations(track: BodyTrack) -> Float[np.ndarray, "times 24"]:
    """How far each joint is turned beyond human limits, radians, 0 within; the pelvis and the shoulders have none."""
    beyond = np.zeros(track.rotations.shape[:2])

    def put(joint: str, *excesses: np.ndarray) -> None:
        beyond[:, _NAMES.index(joint)] = np.maximum.reduce(excesses)

    def turned(joint: str) -> np.ndarray:
        return track.rotations[:, _NAMES.index(joint)]

    for joint, most in _ANY.items():
        put(joint, np.maximum(_angle(turned(joint)) - most, 0.0))
    for side, left in (("L_", 1.0), ("R_", -1.0)):
        for part, most in _PARTS_ANY.items():
            put(side + part, np.maximum(_angle(turned(side + part)) - most, 0.0))
        flexion, sideways, twist = _swing_and_twist(turned(side + "Hip"), left)
        put(
            side + "Hip",
            _outside(flexion, HIP_FLEXION),
            _outside(sideways, HIP_SIDEWAYS),
            _outside(twist, HIP_TWIST),
        )
        shin = -turned(side + "Knee")[:, :, 1]
        put(side + "Knee", _outside(np.arctan2(-shin[:, 2], -shin[:, 1]), KNEE), _outside(shin[:, 0], (-0.1, 0.1)))
        forearm = left * turned(side + "Elbow")[:, :, 0]
        bend = np.arctan2(forearm[:, 2], left * forearm[:, 0])
        put(side + "Elbow", _outside(bend, ELBOW), _outside(forearm[:, 1], (-0.1, 0.1)))
        point = _pitch(turned(side + "Ankle"))
        put(side + "Ankle", _outside(point, ANKLE_POINT), np.maximum(_angle(turned(side + "Ankle")) - ANKLE_ANY, 0.0))
        put(side + "Toe", _outside(_pitch(turned(side + "Toe")), TOE))
    return beyond


def _swing_and_twist(R: np.ndarray, left: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Flexion, outward angle and outward twist of a thigh that hangs down at rest, radians."""
    thigh = -R[:, :, 1]
    flexion = np.arctan2(thigh[:, 2], -thigh[:, 1])
    sideways = np.arcsin(np.clip(left * thigh[:, 0], -1.0, 1.0))
    # The shortest turn from hanging down to the thigh carries "forward" with it; the twist is what remains.
    share = 1.0 / np.maximum(1.0 - thigh[:, 1], 1e-9)
    forward = np.stack([-thigh[:, 0] * thigh[:, 2] * share, thigh[:, 2], 1.0 - thigh[:, 2] ** 2 * share], axis=-1)
    outward = np.cross(-thigh, forward)
    twist = np.arctan2(np.sum(R[:, :, 2] * outward, axis=-1), np.sum(R[:, :, 2] * forward, axis=-1))
    return flexion, sideways, left * twist


def _outside(values: np.ndarray, limits: tuple[float, float]) -> np.ndarray:
    return np.maximum(np.maximum(limits[0] - values, values - limits[1]), 0.0)


def _pitch(R: np.ndarray) -> np.ndarray:
    """Radians that a foot's forward axis points down."""
    return np.arctan2(-R[:, 1, 2], R[:, 2, 2])


def _angle(R: np.ndarray) -> np.ndarray:
    """Radians of a rotation as a whole."""
    sine = 0.5 * np.sqrt(
        (R[:, 2, 1] - R[:, 1, 2]) ** 2 + (R[:, 0, 2] - R[:, 2, 0]) ** 2 + (R[:, 1, 0] - R[:, 0, 1]) ** 2
    )
    return np.arctan2(sine, 0.5 * (np.trace(R, axis1=1, axis2=2) - 1.0))
