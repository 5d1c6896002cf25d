"""What documents hold to beyond their schemas."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from pgm_data.dataset.camera_laws import POSE, geometry_faults
from pgm_data.dataset.documents import Fault
from pgm_data.dataset.laws import Context
from pgm_data.fields import FieldError
from pgm_data.scene import Scene, scene_from_fields, scene_names
from pgm_data.skeleton import skeleton_from_fields


def law_faults(kind: str, value: dict[str, Any], scene: Scene | None = None) -> Iterator[Fault]:
    """Faults of a document that holds to the schema of its kind; `scene` stands in for the one it names."""
    if kind == "scene":
        yield from _refused(scene_from_fields, value)
    elif kind == "skeleton":
        yield from _refused(skeleton_from_fields, value)
    elif kind == "camera":
        yield from _camera_faults(value, scene)
    elif kind == "clip":
        yield from _clip_faults(value, scene)
    elif kind == "prompt":
        yield from _prompt_faults(value)


def _refused(build, value: dict[str, Any]) -> Iterator[Fault]:
    try:
        build(value)
    except FieldError as error:
        place, _, said = str(error).partition(": expected ")
        expected, _, found = said.rpartition(", got ")
        yield Fault(field=place, expected=expected, found=found)


def _camera_faults(value: dict[str, Any], scene: Scene | None) -> Iterator[Fault]:
    columns = {name: np.array([value[name.removeprefix("camera.")]], dtype=np.float64) for name in POSE}
    context = Context(scene=scene, size=(int(value["width"]), int(value["height"])))
    for fault in geometry_faults(columns, np.array([True]), context):
        found = fault.found.removesuffix(" in row 0")
        yield Fault(field=fault.field.removeprefix("camera."), expected=fault.expected, found=found)


def _clip_faults(value: dict[str, Any], scene: Scene | None) -> Iterator[Fault]:
    if scene is None and value["scene"] not in scene_names():
        expected = f"one of {', '.join(scene_names())}, or --scene"
        yield Fault(field="scene", expected=expected, found=repr(value["scene"]))
    for index, (x0, y0, x1, y1) in enumerate(value["ui_boxes_px"]):
        if not (x0 < x1 and y0 < y1):
            yield Fault(field=f"ui_boxes_px[{index}]", expected="x0 < x1 and y0 < y1", found=repr([x0, y0, x1, y1]))
    camera = value.get("camera", {})
    focal = camera.get("focal_px_range")
    if focal is not None and not 0 < focal[0] <= focal[1]:
        yield Fault(field="camera.focal_px_range", expected="0 < shortest <= longest", found=repr(focal))
    std = camera.get("position_std")
    if std is not None and min(std) < 0:
        yield Fault(field="camera.position_std", expected="at least 0", found=repr(std))


def _prompt_faults(value: dict[str, Any]) -> Iterator[Fault]:
    for part in ("texts", "values"):
        for index, span in enumerate(value.get(part, [])):
            if not span["start_frame"] < span["end_frame"] <= value["n_frames"]:
                expected = f"start_frame < end_frame <= {value['n_frames']}"
                found = f"{span['start_frame']} to {span['end_frame']}"
                yield Fault(field=f"{part}[{index}]", expected=expected, found=found)
