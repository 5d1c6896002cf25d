"""Joints, parents and rest pose of the skeletons that scenes name."""

import math
from dataclasses import dataclass
from importlib.resources import files
from importlib.resources.abc import Traversable

import numpy as np
import yaml
from jaxtyping import Float, Int

from pgm_data.fields import FieldError, fields, names_of, numbers, sequence, word
from pgm_data.geometry.arrays import frozen
from pgm_data.geometry.rigid import rotation_from_rotvec


@dataclass(frozen=True, eq=False, kw_only=True)
class Skeleton:
    """A kinematic tree.

    Raises:
        ValueError: If a parent does not come before its child.
    """

    name: str
    joint_names: tuple[str, ...]
    """Names; joint 0 is the root."""
    parents: Int[np.ndarray, " joints"]
    """Index of each joint's parent; -1 for the root."""
    rest_translations: Float[np.ndarray, "joints 3"]
    """Each joint in its parent's frame in the rest pose, metres (x to the person's left, y up, z forward).

    The root's is its height.
    """
    limits: Float[np.ndarray, "joints 2 3"]
    """Lowest and highest x, y, z of each joint's axis-angle vector (parent_from_joint) in a healthy body, radians.

    -inf and inf where nothing limits it; the root's always.
    """
    point_names: tuple[str, ...]
    """Points of the body that detectors name; the keypoint set is some of them."""
    point_joints: Int[np.ndarray, " points"]
    """The joint that each point hangs on."""
    point_offsets: Float[np.ndarray, "points 3"]
    """Where it is in that joint's frame, metres at the size of the rest pose."""
    soles: tuple[tuple[str, ...], tuple[str, ...]]
    """Points of the left and of the right sole, which touch the ground in the rest pose."""
    keypoint_names: tuple[str, ...]
    """The 2D keypoint set of the tables."""

    def __post_init__(self) -> None:
        """Keep read-only copies and check the values."""
        object.__setattr__(self, "parents", frozen(self.parents, np.int64))
        object.__setattr__(self, "point_joints", frozen(self.point_joints, np.int64))
        for name in ("rest_translations", "limits", "point_offsets"):
            object.__setattr__(self, name, frozen(getattr(self, name)))
        if self.parents[0] != -1 or not np.all(self.parents[1:] < np.arange(1, len(self.parents))):
            raise ValueError(f"{self.name}.parents: expected -1 first and parents before children, got {self.parents}")
        if not len(self.joint_names) == len(self.parents) == len(self.rest_translations):
            raise ValueError(f"{self.name}: expected as many names, parents and rest translations as joints")
        if not np.all(self.limits[:, 0] < self.limits[:, 1]):
            raise ValueError(f"{self.name}.limits: expected lower ones below upper ones, got others")
        named = {"keypoints": self.keypoint_names, "soles": sum(self.soles, ())}
        for where, names in named.items():
            stray = [name for name in names if name not in self.point_names]
            if stray:
                expected = ", ".join(self.point_names)
                raise ValueError(f"{self.name}.{where}: expected points among {expected}, got {stray[0]!r}")

    @property
    def keypoints(self) -> Int[np.ndarray, " keypoints"]:
        """Places of the keypoint set among the points."""
        return np.array([self.point_names.index(name) for name in self.keypoint_names], dtype=np.int64)


def world_from_joints(
    parents: Int[np.ndarray, " joints"],
    rotations: Float[np.ndarray, "frames joints 3"],
    translations: Float[np.ndarray, "frames joints 3"],
) -> tuple[Float[np.ndarray, "frames joints 3 3"], Float[np.ndarray, "frames joints 3"]]:
    """World rotations and positions of joints, by forward kinematics; NaN of NaN.

    Args:
        parents: Index of each joint's parent, -1 of the root, parents before children.
        rotations: Axis-angle of parent_from_joint, radians; entry 0 is the root in the world.
        translations: Of parent_from_joint, metres; entry 0 is the root in the world.
    """
    R = rotation_from_rotvec(rotations)
    joints = np.array(translations, dtype=np.float64)
    for joint, parent in enumerate(parents):
        if parent >= 0:
            joints[:, joint] = joints[:, parent] + (R[:, parent] @ translations[:, joint, :, None])[..., 0]
            R[:, joint] = R[:, parent] @ R[:, joint]
    return R, joints


def world_joints(
    parents: Int[np.ndarray, " joints"],
    rotations: Float[np.ndarray, "frames joints 3"],
    translations: Float[np.ndarray, "frames joints 3"],
) -> Float[np.ndarray, "frames joints 3"]:
    """World positions of joints, by forward kinematics; arguments as of `world_from_joints`."""
    return world_from_joints(parents, rotations, translations)[1]


def load_skeleton(name: str) -> Skeleton:
    """The skeleton file of the given name that ships with the package.

    Raises:
        ValueError: If there is no such file or it does not say what a skeleton must; names the field.
    """
    shipped = skeleton_names()
    if name not in shipped:
        raise ValueError(f"skeleton: expected one of {', '.join(shipped)}, got {name!r}")
    # libyaml, where PyYAML has it, is ten times as fast; files that others wrote could nest deeper than it bears.
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    raw = yaml.load(_folder().joinpath(f"{name}.yaml").read_text(encoding="utf-8"), Loader=loader)
    try:
        return skeleton_from_fields(raw)
    except FieldError as error:
        raise ValueError(f"skeleton {name}: {error}") from error


def skeleton_names() -> tuple[str, ...]:
    """Skeletons that ship with the package."""
    return tuple(sorted(p.name[:-5] for p in _folder().iterdir() if p.name.endswith(".yaml")))


def _folder() -> Traversable:
    return files("pgm_data.scenes").joinpath("skeletons")


def skeleton_from_fields(raw: object) -> Skeleton:
    """The skeleton that the fields of its file describe.

    Raises:
        FieldError: If a field is not what it must be.
    """
    top = fields(raw, "", required=("name", "joints", "points", "soles", "keypoints"))
    joints = {
        name: fields(joint, f"joints.{name}", required=("parent", "rest_m"), optional=("limits_deg",))
        for name, joint in fields(top["joints"], "joints").items()
    }
    names = tuple(joints)
    parents = []
    for index, (name, joint) in enumerate(joints.items()):
        parent = joint["parent"]
        if parent not in ((None,) if index == 0 else names[:index]):
            expected = "null, since it is the root" if index == 0 else "a joint before it"
            raise FieldError(f"joints.{name}.parent: expected {expected}, got {parent!r}")
        parents.append(-1 if parent is None else names.index(parent))
    if not names:
        raise FieldError("joints: expected at least one joint, got none")
    rest = [numbers(joint["rest_m"], f"joints.{name}.rest_m", 3) for name, joint in joints.items()]
    points = {
        name: fields(point, f"points.{name}", required=("joint", "at_m"))
        for name, point in fields(top["points"], "points").items()
    }
    hung = [word(point["joint"], f"points.{name}.joint", names) for name, point in points.items()]
    offsets = [numbers(point["at_m"], f"points.{name}.at_m", 3) for name, point in points.items()]
    soles = fields(top["soles"], "soles", required=("left", "right"))
    return Skeleton(
        name=word(top["name"], "name"),
        joint_names=names,
        parents=np.array(parents, dtype=np.int64),
        rest_translations=np.array(rest, dtype=float),
        limits=np.array([_limits(joint, f"joints.{name}.limits_deg") for name, joint in joints.items()]),
        point_names=tuple(points),
        point_joints=np.array([names.index(joint) for joint in hung], dtype=np.int64),
        point_offsets=np.array(offsets, dtype=float).reshape(-1, 3),
        soles=(_among(soles["left"], "soles.left", points), _among(soles["right"], "soles.right", points)),
        keypoint_names=_among(top["keypoints"], "keypoints", points),
    )


def _among(raw: object, place: str, points: dict) -> tuple[str, ...]:
    return tuple(names_of(raw, place, tuple(points)))


def _limits(joint: dict, place: str) -> list[list[float]]:
    """Lower and upper bounds of a joint's axis-angle vector, radians."""
    if "limits_deg" not in joint:
        return [[-math.inf] * 3, [math.inf] * 3]
    rows = sequence(joint["limits_deg"], place)
    if len(rows) != 2:
        raise FieldError(f"{place}: expected a lower and an upper corner, got {rows}")
    return [[math.radians(value) for value in numbers(row, place, 3)] for row in rows]
