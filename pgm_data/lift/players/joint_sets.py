"""Sets of body joints that programs of the field write, and the places that two of them share.

A place is the same in two sets where both mean the same joint of the body. What a set lacks is NaN after mapping: the
pelvis of SMPL lies above the middle of the hips and its neck above that of the shoulders, so neither is made of them.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from pgm_data.skeleton import load_skeleton

SMPL24 = load_skeleton("smpl24").joint_names
FACE = ("Nose", "L_Eye", "R_Eye", "L_Ear", "R_Ear", "Head_top")
"""What 3DCrowdNet adds to SMPL's joints."""
COCO17 = (
    *("nose", "left_eye", "right_eye", "left_ear", "right_ear", "left_shoulder", "right_shoulder"),
    *("left_elbow", "right_elbow", "left_wrist", "right_wrist", "left_hip", "right_hip"),
    *("left_knee", "right_knee", "left_ankle", "right_ankle"),
)
BLAZEPOSE33 = (
    *("nose", "left_eye_inner", "left_eye", "left_eye_outer", "right_eye_inner", "right_eye", "right_eye_outer"),
    *("left_ear", "right_ear", "mouth_left", "mouth_right", "left_shoulder", "right_shoulder"),
    *("left_elbow", "right_elbow", "left_wrist", "right_wrist", "left_pinky", "right_pinky"),
    *("left_index", "right_index", "left_thumb", "right_thumb", "left_hip", "right_hip"),
    *("left_knee", "right_knee", "left_ankle", "right_ankle", "left_heel", "right_heel"),
    *("left_foot_index", "right_foot_index"),
)
H36M17 = (
    *("Hip", "RHip", "RKnee", "RFoot", "LHip", "LKnee", "LFoot", "Spine", "Thorax", "Neck/Nose", "Head"),
    *("LShoulder", "LElbow", "LWrist", "RShoulder", "RElbow", "RWrist"),
)
SETS = {
    "smpl24": SMPL24,
    "3dcrowdnet30": SMPL24 + FACE,
    "coco17": COCO17,
    "blazepose33": BLAZEPOSE33,
    "h36m17": H36M17,
}
"""Joint names by set, in the order of the set's files."""

LIMBS = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
SAME = {
    "smpl24": {f"{side[0].upper()}_{limb.title()}": f"{side}_{limb}" for side in ("left", "right") for limb in LIMBS},
    "h36m17": {f"{side[0].upper()}{limb.title()}": f"{side}_{limb}" for side in ("left", "right") for limb in LIMBS}
    | {"LFoot": "left_ankle", "RFoot": "right_ankle", "Head": "head_top"},
    "blazepose33": {"left_foot_index": "left_big_toe", "right_foot_index": "right_big_toe"},
    "coco17": {},
}
SAME["3dcrowdnet30"] = SAME["smpl24"] | {
    **{"Nose": "nose", "L_Eye": "left_eye", "R_Eye": "right_eye"},
    **{"L_Ear": "left_ear", "R_Ear": "right_ear", "Head_top": "head_top"},
}
OWN = {"h36m17": ("Hip", "Spine", "Thorax", "Neck/Nose")}
"""Joints that no other set has, though they may be called alike."""


@dataclass(frozen=True, kw_only=True)
class JointSet:
    """Joints that a program writes."""

    name: str
    joint_names: tuple[str, ...]
    """As that program calls them, in its order."""
    places: tuple[str, ...]
    """The place of each: as our skeletons call their points, else a name that the sets with that joint share."""


def joint_set(name: str) -> JointSet:
    """The set of that name.

    Raises:
        ValueError: If it is unknown; names those that are known.
    """
    if name not in SETS:
        raise ValueError(f"joint set: expected one of {', '.join(SETS)}, got {name!r}")
    own = OWN.get(name, ())
    places = tuple(f"{name} {joint}" if joint in own else SAME[name].get(joint, joint) for joint in SETS[name])
    return JointSet(name=name, joint_names=SETS[name], places=places)


def joint_set_of(names: tuple[str, ...]) -> JointSet:
    """The set whose joints are called so, in that order.

    Raises:
        ValueError: If there is none.
    """
    found = [name for name, joints in SETS.items() if joints == tuple(names)]
    if not found:
        known = ", ".join(f"{name} ({len(joints)})" for name, joints in SETS.items())
        raise ValueError(f"joint names: expected those of one of {known}, got {len(names)}: {', '.join(names)[:100]}")
    return joint_set(found[0])


def mapped(
    values: Float[np.ndarray, "*batch joints n"], *, source: str, target: str
) -> Float[np.ndarray, "*batch k n"]:
    """Values of the joints of one set in the order of another; NaN for joints that the source has not.

    Raises:
        ValueError: If a set is unknown, they share no joint, or there are not as many values as the source has joints.
    """
    return at_places(values, source=source, places=joint_set(target).places, what=f"joint set {target}")


def at_places(
    values: Float[np.ndarray, "*batch joints n"],
    *,
    source: str,
    places: tuple[str, ...],
    what: str = "places",
) -> Float[np.ndarray, "*batch k n"]:
    """Values of a set's joints at the named places, such as the points of a skeleton; NaN where the set has none.

    Args:
        values: Positions in space or in the picture, or anything else of the joints.
        source: The set they are of.
        places: Points of a skeleton's file, or places of another set.
        what: These places, in a message.

    Raises:
        ValueError: If the set is unknown, has none of the places, or another number of joints.
    """
    known = joint_set(source)
    if values.shape[-2] != len(known.places):
        raise ValueError(f"{source}: expected {len(known.places)} joints, got {values.shape[-2]}")
    rows = {place: i for i, place in enumerate(known.places)}
    from_rows = np.array([rows.get(place, -1) for place in places], dtype=np.int64)
    if not (from_rows >= 0).any():
        raise ValueError(f"{what}: expected some of the places of {source} ({', '.join(known.places)}), got none")
    return np.where((from_rows >= 0)[:, None], values[..., from_rows, :], np.nan)
