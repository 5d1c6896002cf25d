"""BVH files: a tree of joints with offsets, and Euler angles in degrees by frame.

Read: any order and number of channels on any joint, tabs, CRLF, prefixes of names (`mixamorig:`), several blanks. A
root's position channels add to its OFFSET, as the format says; those of another joint replace its OFFSET, as the
programs that write them mean it.
"""

import re
import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from pgm_data.geometry.arrays import frozen
from pgm_data.geometry.rigid import rotation_from_rotvec, rotvec_from_rotation

LARGEST_BYTES = 2**29
MOST_JOINTS = 2000
CHANNEL = re.compile(r"([XYZ])(position|rotation)", re.ASCII | re.IGNORECASE)
POSITION, ROTATION = "position", "rotation"
END = "_End"
"""Added to a joint's name for the end site below it."""


@dataclass(frozen=True, eq=False, kw_only=True)
class BvhMotion:
    """What a BVH file holds, in its own unit of length and axes."""

    joint_names: tuple[str, ...]
    """With the prefix left out that all share; end sites are joints of their own, named after their parent."""
    parents: Int[np.ndarray, " joints"]
    """-1 of the root, parents before children."""
    offsets: Float[np.ndarray, "joints 3"]
    """Of each joint in its parent's frame at rest."""
    rotations: Float[np.ndarray, "frames joints 3"]
    """Axis-angle of parent_from_joint, radians; entry 0 is file_from_root; 0 of end sites."""
    translations: Float[np.ndarray, "frames joints 3"]
    """Of parent_from_joint; entry 0 is the root in the file's axes."""
    frame_time: float
    """Seconds from one frame to the next."""

    def __post_init__(self) -> None:
        """Keep read-only copies."""
        object.__setattr__(self, "parents", frozen(self.parents, np.int64))
        for name in ("offsets", "rotations", "translations"):
            object.__setattr__(self, name, frozen(getattr(self, name)))


@dataclass(kw_only=True)
class _Joint:
    """A joint while its lines are being read."""

    name: str
    parent: int
    offset: list[float] | None = None
    channels: tuple[tuple[str, str], ...] | None = None
    """Axis and what of it, in the file's order."""


def read_bvh(path: Path) -> BvhMotion:
    """The motion in the file.

    Raises:
        ValueError: If it is no such file: says line or frame, what was expected and found.
    """
    try:
        if path.stat().st_size > LARGEST_BYTES:
            raise ValueError(f"expected at most {LARGEST_BYTES} bytes, got {path.stat().st_size}")
        text = path.read_bytes().decode("utf-8-sig", "replace")
        return _parsed(text)
    except (OSError, ValueError) as error:
        raise ValueError(f"{path}: {error}") from error


def _parsed(text: str) -> BvhMotion:
    start = re.search(r"^\s*MOTION\s*$", text, re.MULTILINE | re.IGNORECASE)
    if start is None or not re.match(r"\s*HIERARCHY\b", text, re.IGNORECASE):
        raise ValueError("expected HIERARCHY and MOTION, got no such parts: it is no BVH file")
    joints = _hierarchy(text[: start.start()])
    frames, frame_time, rest = _motion_header(text[start.end() :])
    width = sum(len(joint.channels or ()) for joint in joints)
    try:
        values = np.array(rest.split(), dtype=np.float64)
    except ValueError as error:
        raise ValueError(f"MOTION: expected numbers, got: {str(error)[:80]}") from error
    if values.size != frames * width:
        raise ValueError(f"MOTION: expected {frames} frames of {width} channels, got {values.size} numbers")
    values = values.reshape(frames, width)
    if not np.isfinite(values).all():
        frame = int(np.argwhere(~np.isfinite(values))[0, 0])
        raise ValueError(f"MOTION: frame {frame}: expected finite numbers, got others")
    rotations, translations = _transforms(joints, values)
    return BvhMotion(
        joint_names=_plain([joint.name for joint in joints]),
        parents=np.array([joint.parent for joint in joints], dtype=np.int64),
        offsets=np.array([joint.offset for joint in joints], dtype=np.float64),
        rotations=rotations,
        translations=translations,
        frame_time=frame_time,
    )


def _hierarchy(text: str) -> list[_Joint]:
    joints: list[_Joint] = []
    open_joints: list[int] = []
    waiting = False
    lines = re.sub(r"([{}])", r"\n\1\n", text).splitlines()
    for line in lines[1:] if lines and lines[0].strip().upper() == "HIERARCHY" else lines:
        words = line.split()
        if not words or words[0].upper() == "HIERARCHY":
            continue
        key = words[0].upper()
        if key in ("ROOT", "JOINT") or (key == "END" and len(words) > 1):
            parent = open_joints[-1] if open_joints else -1
            if (key == "ROOT") != (parent < 0) or (key == "ROOT" and joints):
                raise ValueError(f"HIERARCHY: {line.strip()[:60]!r}: expected one ROOT and all else inside it")
            name = f"{joints[parent].name}{END}" if key == "END" else " ".join(words[1:])
            joints.append(_Joint(name=name, parent=parent, channels=() if key == "END" else None))
            waiting = True
            if not name or len(joints) > MOST_JOINTS:
                raise ValueError(f"HIERARCHY: expected a name for each of at most {MOST_JOINTS} joints, got {line!r}")
        elif key == "{":
            if not waiting:
                raise ValueError("HIERARCHY: expected a joint before each {, got none")
            open_joints.append(len(joints) - 1)
            waiting = False
        elif key == "}" and open_joints:
            open_joints.pop()
        elif key == "OFFSET" and open_joints:
            joints[open_joints[-1]].offset = _numbers(line, words[1:], 3)
        elif key == "CHANNELS" and open_joints:
            joints[open_joints[-1]].channels = _channels(line, words[1:])
        else:
            raise ValueError(
                f"HIERARCHY: expected ROOT, JOINT, End Site, OFFSET or CHANNELS, got {line.strip()[:60]!r}"
            )
    if open_joints or not joints:
        raise ValueError(f"HIERARCHY: expected every {{ closed, got {len(open_joints)} open")
    for joint in joints:
        if joint.offset is None or joint.channels is None:
            raise ValueError(f"HIERARCHY: {joint.name}: expected OFFSET and CHANNELS, got no such line")
    return joints


def _numbers(line: str, words: list[str], count: int) -> list[float]:
    try:
        values = [float(word) for word in words]
    except ValueError:
        values = []
    if len(values) != count or not np.isfinite(values).all():
        raise ValueError(f"HIERARCHY: expected {count} numbers, got {line.strip()[:60]!r}")
    return values


def _channels(line: str, words: list[str]) -> tuple[tuple[str, str], ...]:
    found = [CHANNEL.fullmatch(word) for word in words[1:]]
    channels = tuple((match[1].upper(), match[2].lower()) for match in found if match is not None)
    if not words or words[0] != str(len(channels)) or None in found or len(set(channels)) != len(channels):
        raise ValueError(f"HIERARCHY: expected a count and as many different channels, got {line.strip()[:80]!r}")
    return channels


def _motion_header(text: str) -> tuple[int, float, str]:
    match = re.match(r"\s*Frames\s*:\s*(\d{1,9})\s+Frame\s+Time\s*:\s*(\S+)", text, re.IGNORECASE)
    if match is None:
        raise ValueError("MOTION: expected Frames: and Frame Time:, got no such lines")
    try:
        frame_time = float(match[2])
    except ValueError:
        frame_time = np.nan
    if not (np.isfinite(frame_time) and frame_time > 0):
        raise ValueError(f"MOTION: Frame Time: expected seconds above 0, got {match[2]!r}")
    if int(match[1]) < 1:
        raise ValueError("MOTION: Frames: expected one at least, got 0")
    return int(match[1]), frame_time, text[match.end() :]


def _transforms(
    joints: list[_Joint], values: Float[np.ndarray, "frames channels"]
) -> tuple[Float[np.ndarray, "frames joints 3"], Float[np.ndarray, "frames joints 3"]]:
    """Axis-angle vectors and translations to the parents."""
    rotations = np.zeros((len(values), len(joints), 3))
    translations = np.empty_like(rotations)
    column = 0
    for i, joint in enumerate(joints):
        translations[:, i] = joint.offset
        R = np.broadcast_to(np.eye(3), (len(values), 3, 3))
        for axis, what in joint.channels or ():
            given, at = values[:, column], "XYZ".index(axis)
            if what == POSITION:
                translations[:, i, at] = given + (translations[:, i, at] if i == 0 else 0.0)
            else:
                R = R @ rotation_from_rotvec(np.radians(given)[:, None] * np.eye(3)[at])
            column += 1
        rotations[:, i] = rotvec_from_rotation(R)
    return rotations, translations


def _plain(names: list[str]) -> tuple[str, ...]:
    """Names without the prefix up to a colon that all of them share."""
    prefixes = {name.rpartition(":")[0] for name in names}
    return tuple(name.rpartition(":")[2] if len(prefixes) == 1 else name for name in names)


def bvh_text(motion: BvhMotion, *, order: str = "ZXY") -> str:
    """The motion as the text of a BVH file.

    Joints whose translations change from frame to frame by more than a millionth of a unit get position channels, as
    the root always does; its OFFSET is 0. Leaves close with an End Site at their own place. Angles run on beyond 180
    degrees rather than jump.

    Args:
        motion: Frames without NaN.
        order: Rotation channels, in the order in which they are multiplied.

    Raises:
        ValueError: If the order is none, or a value is not finite.
    """
    if sorted(order) != ["X", "Y", "Z"]:
        raise ValueError(f"order: expected X, Y and Z in some order, got {order!r}")
    if not (np.isfinite(motion.rotations).all() and np.isfinite(motion.translations).all()):
        raise ValueError("motion: expected finite rotations and translations, got others")
    moving = np.ptp(motion.translations, axis=0).max(axis=1) > 1e-6
    moving[0] = True
    children: list[list[int]] = [[] for _ in motion.parents]
    for joint, parent in enumerate(motion.parents):
        if parent >= 0:
            children[parent].append(joint)
    lines = ["HIERARCHY"]
    written: list[int] = []
    todo: list[tuple[int, int]] = [(0, 0)]
    while todo:
        joint, depth = todo.pop()
        pad = "\t" * depth
        if joint < 0:
            lines.append(f"{pad}}}")
            continue
        written.append(joint)
        offset = (
            np.zeros(3) if joint == 0 else motion.offsets[joint] if moving[joint] else motion.translations[0, joint]
        )
        positions = " Xposition Yposition Zposition" if moving[joint] else ""
        turns = " ".join(f"{axis}rotation" for axis in order)
        lines += [
            f"{pad}{'JOINT' if depth else 'ROOT'} {motion.joint_names[joint]}",
            f"{pad}{{",
            f"{pad}\tOFFSET {_row(offset)}",
            f"{pad}\tCHANNELS {6 if moving[joint] else 3}{positions} {turns}",
        ]
        if not children[joint]:
            lines += [f"{pad}\tEnd Site", f"{pad}\t{{", f"{pad}\t\tOFFSET 0 0 0", f"{pad}\t}}"]
        todo.append((-1, depth))
        todo += [(child, depth + 1) for child in reversed(children[joint])]
    angles = _angles(motion.rotations, order)
    columns = []
    for joint in written:
        columns += [motion.translations[:, joint]] if moving[joint] else []
        columns.append(angles[:, joint])
    lines += ["MOTION", f"Frames: {len(motion.rotations)}", f"Frame Time: {motion.frame_time:.9g}"]
    lines += [_row(row) for row in np.concatenate(columns, axis=1)]
    return "\n".join(lines) + "\n"


def _row(values: np.ndarray) -> str:
    return " ".join(f"{value:.7f}".rstrip("0").rstrip(".") for value in values.tolist())


def _angles(rotations: Float[np.ndarray, "frames joints 3"], order: str) -> Float[np.ndarray, "frames joints 3"]:
    from scipy.spatial.transform import Rotation

    with warnings.catch_warnings():
        # Where the middle angle is 90 degrees one of the others is free, and scipy takes 0.
        warnings.simplefilter("ignore", UserWarning)
        flat = Rotation.from_rotvec(rotations.reshape(-1, 3).copy()).as_euler(order, degrees=True)
    return np.unwrap(flat.reshape(rotations.shape), axis=0, period=360.0)
