"""Bodies of BVH files, whose joints have other names and another rest pose, on our skeleton.

Each of our joints takes the place of the file's joint that means the same, and its rotation: that joint's own, after a
fixed turn from our rest pose to the file's. So no pose has to be guessed; joints that the file lacks stay as at rest.
"""

import re

import numpy as np
from jaxtyping import Float, Int

from pgm_data.convert.bvh import END, BvhMotion
from pgm_data.geometry.rigid import rotation_from_rotvec, rotvec_from_rotation
from pgm_data.skeleton import Skeleton, world_from_joints

SIDED = {
    "Hip": ("upleg", "hip", "thigh", "upperleg", "hipjoint"),
    "Knee": ("leg", "knee", "shin", "lowerleg", "calf"),
    "Ankle": ("foot", "ankle"),
    "Toe": ("toebase", "toe", "toes", "ball"),
    "Thorax": ("collar", "clavicle", "thorax"),
    "Shoulder": ("arm", "upperarm", "uparm", "shoulder"),
    "Elbow": ("forearm", "elbow", "lowerarm", "lowarm"),
    "Wrist": ("hand", "wrist"),
    "Hand": ("handmiddle1", "middle1", "handindex1", "palm"),
}
"""What files call a joint of a side; the first that is there counts."""
MIDDLE = {"Pelvis": ("hips", "pelvis", "hip", "root"), "Neck": ("neck", "neck1"), "Head": ("head",)}
TRUNK = re.compile(r"(spine|chest|torso|abdomen|upperchest|back|lowerback)[0-9]*", re.ASCII)
NEEDED = ("Pelvis", "Neck") + tuple(
    f"{side}_{limb}" for side in "LR" for limb in ("Hip", "Knee", "Ankle", "Shoulder", "Elbow", "Wrist")
)
SIDES = {"L": ("left", "l"), "R": ("right", "r")}
LEG_M = (0.3, 1.6)
"""Of anybody: from hip to ankle."""
SPINE = ("Torso", "Spine", "Chest")


def joints_by_name(motion: BvhMotion, skeleton: Skeleton) -> Int[np.ndarray, " joints"]:
    """The file's joint for each of the skeleton's; -1 where there is none.

    Raises:
        ValueError: If the names are not the skeleton's own, and not those of a body where the skeleton is SMPL's.
    """
    rows = {name: i for i, name in reversed(list(enumerate(motion.joint_names)))}
    if all(name in rows for name in skeleton.joint_names):
        return np.array([rows[name] for name in skeleton.joint_names], dtype=np.int64)
    names = ", ".join(motion.joint_names)[:300]
    if skeleton.name != "smpl24":
        raise ValueError(f"joints: expected {', '.join(skeleton.joint_names)}, got {names}")
    found = _found(motion)
    missing = [name for name in NEEDED if name not in found]
    if missing:
        raise ValueError(f"joints: expected names that tell {', '.join(missing)}, got {names}")
    return np.array([found.get(name, -1) for name in skeleton.joint_names], dtype=np.int64)


def _found(motion: BvhMotion) -> dict[str, int]:
    """The file's joint by our name."""
    plain = {_plain(name): i for i, name in reversed(list(enumerate(motion.joint_names)))}
    found = {ours: plain[n] for ours, names in MIDDLE.items() for n in reversed(names) if n in plain}
    found["Pelvis"] = found.get("Pelvis", 0)
    for side, words in SIDES.items():
        own = {n[len(word) :]: i for word in reversed(words) for n, i in plain.items() if n.startswith(word)}
        # With an arm, the shoulder is the joint before it.
        collar = ("shoulder",) if any(n in own for n in ("arm", "upperarm", "uparm")) else ()
        for limb, names in SIDED.items():
            for name in reversed((*names, *collar) if limb == "Thorax" else names):
                if name in own:
                    found[f"{side}_{limb}"] = own[name]
        wrist = found.get(f"{side}_Wrist")
        if f"{side}_Hand" not in found and wrist is not None:
            found |= _end(motion, wrist, f"{side}_Hand")
    if "Neck" not in found and "Head" in found:
        found["Neck"] = found.pop("Head")
    found |= _spine(motion, found)
    return found


def _plain(name: str) -> str:
    """Small letters and digits alone, a side at the end put first."""
    word = re.sub(r"^(.+)[._ -](l|r|left|right)$", r"\2\1", name.lower())
    return re.sub(r"[^a-z0-9]", "", word)


def _end(motion: BvhMotion, joint: int, ours: str) -> dict[str, int]:
    """The end site below a joint, where it is at some distance."""
    name = f"{motion.joint_names[joint]}{END}"
    row = motion.joint_names.index(name) if name in motion.joint_names else -1
    return {ours: row} if row >= 0 and np.linalg.norm(motion.offsets[row]) > 0 else {}


def _spine(motion: BvhMotion, found: dict[str, int]) -> dict[str, int]:
    """The trunk's joints from the pelvis to where the neck begins: the last is the chest."""
    if "Neck" not in found:
        return {}
    chain = []
    joint = int(motion.parents[found["Neck"]])
    while joint >= 0 and joint != found["Pelvis"]:
        if TRUNK.fullmatch(_plain(motion.joint_names[joint])):
            chain.append(joint)
        joint = int(motion.parents[joint])
    chain.reverse()
    if not chain:
        return {}
    named = {"Chest": chain[-1]}
    if len(chain) > 1:
        named["Torso"] = chain[0]
    if len(chain) > 2:
        named["Spine"] = chain[len(chain) // 2]
    return named


def on_skeleton(
    motion: BvhMotion, skeleton: Skeleton, *, unit_m: float
) -> tuple[Float[np.ndarray, "frames joints 3"], Float[np.ndarray, "frames joints 3"]]:
    """Rotations and translations (metres) of the skeleton that stand where the file's joints do, in the file's axes.

    Raises:
        ValueError: If joints that are needed cannot be told, or the unit gives legs that nobody has.
    """
    rows = joints_by_name(motion, skeleton)
    parents = skeleton.parents
    known = rows >= 0
    R_file, places = world_from_joints(motion.parents, motion.rotations, motion.translations * unit_m)
    rest_file = np.zeros_like(motion.offsets)
    for joint, parent in enumerate(motion.parents):
        if parent >= 0:
            rest_file[joint] = rest_file[parent] + motion.offsets[joint]
    if tuple(motion.joint_names[row] for row in rows) == skeleton.joint_names:
        turn, size = np.broadcast_to(np.eye(3), (len(rows), 3, 3)), 1.0
    else:
        _check_legs(rest_file * unit_m, rows, skeleton)
        turn = _turns(rest_file, rows, skeleton)
        size = _size(rest_file * unit_m, rows, skeleton)
    R = np.empty((len(motion.rotations), len(rows), 3, 3))
    joints = np.empty((len(motion.rotations), len(rows), 3))
    joints[:, known] = places[:, rows[known]]
    bridged = _bridged(joints, known, skeleton)
    for joint, parent in enumerate(parents):
        R[:, joint] = R_file[:, rows[joint]] @ turn[joint] if known[joint] else R[:, parent]
        if not (known[joint] or joint in bridged):
            joints[:, joint] = joints[:, parent] + R[:, parent] @ (skeleton.rest_translations[joint] * size)
    up = np.swapaxes(R[:, parents[1:]], -1, -2)
    rotations, translations = rotvec_from_rotation(R), joints.copy()
    rotations[:, 1:] = rotvec_from_rotation(up @ R[:, 1:])
    translations[:, 1:] = (up @ (joints[:, 1:] - joints[:, parents[1:]])[..., None])[..., 0]
    return rotations, translations


def _check_legs(rest_m: Float[np.ndarray, "n 3"], rows: Int[np.ndarray, " joints"], skeleton: Skeleton) -> None:
    hip, knee, ankle = (rest_m[rows[skeleton.joint_names.index(f"L_{limb}")]] for limb in ("Hip", "Knee", "Ankle"))
    leg = float(np.linalg.norm(knee - hip) + np.linalg.norm(ankle - knee))
    if not LEG_M[0] <= leg <= LEG_M[1]:
        expected = f"a unit of length that makes legs {LEG_M[0]} to {LEG_M[1]} m long"
        raise ValueError(f"OFFSET: expected {expected}, got {leg:.3g} m: give unit_m")


def _size(rest_m: Float[np.ndarray, "n 3"], rows: Int[np.ndarray, " joints"], skeleton: Skeleton) -> float:
    """Median of bone lengths over the skeleton's own, where joint and parent are known."""
    child = np.flatnonzero((rows >= 0) & (skeleton.parents >= 0) & (rows[skeleton.parents] >= 0))
    length = np.linalg.norm(rest_m[rows[child]] - rest_m[rows[skeleton.parents[child]]], axis=1)
    return float(np.median(length / np.linalg.norm(skeleton.rest_translations[child], axis=1)))


def _turns(
    rest: Float[np.ndarray, "n 3"], rows: Int[np.ndarray, " joints"], skeleton: Skeleton
) -> Float[np.ndarray, "joints 3 3"]:
    """File's joint frame from ours, both at rest: the whole body's, and for limbs the least turn onto their bone."""
    index = skeleton.joint_names.index
    left = rest[rows[index("L_Hip")]] - rest[rows[index("R_Hip")]]
    up = rest[rows[index("Neck")]] - (rest[rows[index("L_Hip")]] + rest[rows[index("R_Hip")]]) / 2
    left = left / np.linalg.norm(left)
    up = up - (up @ left) * left
    up = up / np.linalg.norm(up)
    body = np.stack([left, up, np.cross(left, up)], axis=1)
    turns = np.broadcast_to(body, (len(rows), 3, 3)).copy()
    for joint in range(1, len(rows)):
        children = np.flatnonzero(skeleton.parents == joint)
        if not len(children):  # a hand, a toe, a head: as what it sits on
            turns[joint] = turns[skeleton.parents[joint]]
        if len(children) != 1 or rows[joint] < 0 or rows[children[0]] < 0:
            continue
        ours = body @ skeleton.rest_translations[children[0]]
        theirs = rest[rows[children[0]]] - rest[rows[joint]]
        if min(np.linalg.norm(ours), np.linalg.norm(theirs)) > 0:
            turns[joint] = _least(ours / np.linalg.norm(ours), theirs / np.linalg.norm(theirs)) @ body
    return turns


def _least(start: Float[np.ndarray, " 3"], goal: Float[np.ndarray, " 3"]) -> Float[np.ndarray, "3 3"]:
    """The smallest rotation of one unit vector onto another."""
    axis = np.cross(start, goal)
    sine = float(np.linalg.norm(axis))
    if sine < 1e-9 and start @ goal < 0:  # about any axis across it
        across = np.cross(start, np.eye(3)[np.argmin(np.abs(start))])
        return rotation_from_rotvec(np.pi * across / np.linalg.norm(across))
    return rotation_from_rotvec(axis / max(sine, 1e-300) * np.arctan2(sine, start @ goal))


def _bridged(joints: Float[np.ndarray, "frames joints 3"], known: np.ndarray, skeleton: Skeleton) -> list[int]:
    """The missing joints of the spine, after they were put between those that are there by our bones' lengths."""
    if skeleton.name != "smpl24":
        return []
    chain = [skeleton.joint_names.index(name) for name in ("Pelvis", *SPINE, "Neck")]
    length = np.cumsum(np.linalg.norm(skeleton.rest_translations[chain], axis=1))
    there = [i for i, joint in enumerate(chain) if known[joint]]
    missing = [i for i, joint in enumerate(chain) if not known[joint]]
    for i in missing:
        low, high = max(t for t in there if t < i), min(t for t in there if t > i)
        share = (length[i] - length[low]) / (length[high] - length[low])
        joints[:, chain[i]] = (1 - share) * joints[:, chain[low]] + share * joints[:, chain[high]]
    return [chain[i] for i in missing]
