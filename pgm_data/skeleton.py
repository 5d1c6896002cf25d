"""Joints, parents and rest pose of the skeletons that scenes name."""

from dataclasses import dataclass
from importlib.resources import files
from importlib.resources.abc import Traversable

import numpy as np
import yaml
from jaxtyping import Float, Int

from pgm_data.fields import FieldError, fields, numbers, sequence, word
from pgm_data.geometry.arrays import frozen


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
    keypoint_names: tuple[str, ...]
    """The 2D keypoint set that detectors of this skeleton give."""

    def __post_init__(self) -> None:
        """Keep read-only copies and check the values."""
        object.__setattr__(self, "parents", frozen(self.parents, np.int64))
        object.__setattr__(self, "rest_translations", frozen(self.rest_translations))
        if self.parents[0] != -1 or not np.all(self.parents[1:] < np.arange(1, len(self.parents))):
            raise ValueError(f"{self.name}.parents: expected -1 first and parents before children, got {self.parents}")
        if not len(self.joint_names) == len(self.parents) == len(self.rest_translations):
            raise ValueError(f"{self.name}: expected as many names, parents and rest translations as joints")


def load_skeleton(name: str) -> Skeleton:
    """The skeleton file of the given name that ships with the package.

    Raises:
        ValueError: If there is no such file or it does not say what a skeleton must; names the field.
    """
    shipped = skeleton_names()
    if name not in shipped:
        raise ValueError(f"skeleton: expected one of {', '.join(shipped)}, got {name!r}")
    raw = yaml.safe_load(_folder().joinpath(f"{name}.yaml").read_text(encoding="utf-8"))
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
    top = fields(raw, "", required=("name", "joints", "keypoints"))
    joints = {
        name: fields(joint, f"joints.{name}", required=("parent", "rest_m"))
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
    return Skeleton(
        name=word(top["name"], "name"),
        joint_names=names,
        parents=np.array(parents, dtype=np.int64),
        rest_translations=np.array(rest, dtype=float),
        keypoint_names=tuple(word(k, "keypoints") for k in sequence(top["keypoints"], "keypoints")),
    )
