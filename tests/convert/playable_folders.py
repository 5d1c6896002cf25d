"""Datasets laid out as PlayableEnvironments writes them, by classes of ours under the names of its own."""

import pickle
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType

import cv2
import numpy as np

POSES = "utils.lib_3d.pose_parameters"
ROTATION, TRANSLATION, FOCAL = (1.3743, 0.0, 0.0), (0.0, -39.54, 8.41), 2280.0
"""A broadcast camera whose projections were worked out apart from this project."""
SIZE = (166, 94)
"""Of the pictures, px: less than what focal lengths are of, as in the tennis set."""


@contextmanager
def foreign_module(name: str, **things) -> Iterator[None]:
    """The module under that name while pickles are written; parents too."""
    parts = name.split(".")
    names = [".".join(parts[: i + 1]) for i in range(len(parts))]
    kept = {each: sys.modules.get(each) for each in names}
    try:
        for each in names:
            sys.modules[each] = ModuleType(each)
        for key, value in things.items():
            setattr(sys.modules[name], key, value)
        yield
    finally:
        for each, module in kept.items():
            if module is None:
                del sys.modules[each]
            else:
                sys.modules[each] = module


def foreign_class(name: str, module: str) -> type:
    return type(name, (), {"__module__": module, "__qualname__": name})


POSE = foreign_class("PoseParametersNumpy", POSES)


def pose(rotation=ROTATION, translation=TRANSLATION):
    made = POSE()
    made.rotation = np.array(rotation, dtype=np.float32)
    made.translation = np.array(translation, dtype=np.float32)
    return made


def pickled(value, protocol: int = 4) -> bytes:
    with foreign_module(POSES, PoseParametersNumpy=POSE):
        return pickle.dumps(value, protocol=protocol)


def write_video(folder: Path, frames: int = 4, *, size=SIZE, protocol: int = 4, **changes) -> None:
    """One camera's folder; `changes` replace the content of pickles, None leaves one out."""
    folder.mkdir(parents=True)
    for i in range(frames):
        cv2.imwrite(str(folder / f"{i:05d}.png"), np.full((size[1], size[0], 3), 40 + 10 * i, np.uint8))
    boxes = np.array([[0.3, 0.4], [0.6, 0.2], [0.4, 0.45], [0.9, 0.35]], dtype=np.float32)
    content = {
        "actions": [0] * frames,
        "rewards": [0.0] * frames,
        "dones": [False] * frames,
        "metadata": [{}] * frames,
        "cameras": [pose() for _ in range(frames)],
        "focals": [FOCAL] * frames,
        "bounding_boxes": [boxes + 0.01 * i for i in range(frames)],
        "bounding_box_validity": [np.array([True, i != 1]) for i in range(frames)],
    } | changes
    for name, value in content.items():
        if value is not None:
            (folder / f"{name}.pkl").write_bytes(pickled(value, protocol))
