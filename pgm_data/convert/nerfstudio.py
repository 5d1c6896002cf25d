"""nerfstudio's transforms.json from and to pictures with cameras.

It stores world_from_camera in OpenGL's axes (x right, y up, looking along -z): ours with y and z turned round. Its
pixels put the centre of the top-left pixel at (0.5, 0.5).

Source: docs.nerf.studio, data conventions.
"""

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from pgm_data.convert.posed_pictures import (
    FieldError,
    PosedPicture,
    PosedPictures,
    Problem,
    nearest_rotation,
    picture_name,
    picture_size,
    pinhole,
    stacked,
)
from pgm_data.dataset.files import whole_file
from pgm_data.geometry.camera import Camera, K_with_centre_origin, K_with_corner_origin

OPENGL_FROM_OPENCV = np.diag([1.0, -1.0, -1.0])
CAMERA_MODELS = ("OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL")
"""Models of nerfstudio that are a perspective picture with OpenCV's lens terms."""
INTRINSICS = ("w", "h", "fl_x", "fl_y", "cx", "cy", "k1", "k2", "p1", "p2")
LENS = frozenset({"k1", "k2", "p1", "p2"})
NEEDED = ("w", "h", "fl_x", "fl_y", "cx", "cy")
UNHELD = ("k3", "k4", "k5", "k6")
"""Lens terms that must be 0, since we have no place for them."""
LARGEST_FILE = 512 * 2**20
"""Bytes above which a file is not read."""


def world_from_gl_camera(camera: Camera) -> Float[np.ndarray, "*batch 4 4"]:
    """The transform_matrix that nerfstudio has for each camera."""
    R_world_from_cam = np.swapaxes(camera.R_cam_from_world, -1, -2) @ OPENGL_FROM_OPENCV
    matrix = np.zeros((*camera.K.shape[:-2], 4, 4))
    matrix[..., :3, :3] = R_world_from_cam
    matrix[..., :3, 3] = camera.position_world
    matrix[..., 3, 3] = 1.0
    return matrix


def write_nerfstudio(path: Path, pictures: PosedPictures, *, extra: dict[str, Any]) -> None:
    """Write the pictures' cameras as transforms.json; intrinsics stand at the top where all pictures share them.

    Args:
        path: The file.
        pictures: Names are relative to the file's folder.
        extra: Further keys at the top, which nerfstudio passes over.

    Raises:
        ValueError: If the intrinsics are skewed, which nerfstudio's never are.
    """
    if (pictures.camera.K[:, 0, 1] != 0).any():
        raise ValueError("K: expected no skew, since nerfstudio has none, got some")
    K = K_with_corner_origin(pictures.camera.K)
    columns = [*pictures.sizes.T, K[:, 0, 0], K[:, 1, 1], K[:, 0, 2], K[:, 1, 2], *pictures.camera.distortion.T]
    intrinsics = [
        dict(zip(INTRINSICS, (value.item() for value in row), strict=True)) for row in zip(*columns, strict=True)
    ]
    shared = {key: value for key, value in intrinsics[0].items() if all(row[key] == value for row in intrinsics)}
    if not LENS.issubset(shared):
        # One lens term at the top, and nerfstudio reads none of a frame's own.
        shared = {key: value for key, value in shared.items() if key not in LENS}
    matrices = world_from_gl_camera(pictures.camera)
    frames = [
        {"file_path": name}
        | {key: value for key, value in row.items() if key not in shared}
        | {"transform_matrix": matrix.tolist()}
        for name, row, matrix in zip(pictures.names, intrinsics, matrices, strict=True)
    ]
    content = {"camera_model": "OPENCV"} | shared | {"frames": frames} | extra
    with whole_file(path) as temporary:
        temporary.write_text(json.dumps(content, indent=1, allow_nan=False), encoding="utf-8")


def read_nerfstudio(path: Path) -> tuple[PosedPictures, tuple[Problem, ...], dict[str, Any]]:
    """Pictures of a transforms.json, the frames that could not be taken over, and the file's content.

    A world that was moved when the file was made (`applied_transform`, `applied_scale`) is moved back.

    Raises:
        ValueError: If the file is no such file, or its camera model is none that we can hold.
    """
    content = _content(path)
    place = str(path)
    model = content.get("camera_model", "OPENCV")
    if model not in CAMERA_MODELS:
        raise ValueError(f"{path}: camera_model: expected one of {', '.join(CAMERA_MODELS)}, got {model!r}")
    frames = content.get("frames")
    if not isinstance(frames, list):
        raise ValueError(f"{path}: frames: expected a list, got {type(frames).__name__}")
    R_moved, t_moved, scale = _moved_from_world(path, content)
    pictures: list[PosedPicture] = []
    problems: list[Problem] = []
    names: set[str] = set()
    for i, frame in enumerate(frames):
        try:
            if not isinstance(frame, dict):
                raise FieldError("frame", "an object", type(frame).__name__)
            name = picture_name("file_path", frame.get("file_path"))
            if name in names:
                raise FieldError("file_path", "each path once", f"{name!r} again")
            matrix = _matrix("transform_matrix", frame.get("transform_matrix"))
            matrix[:3, :3] = R_moved.T @ matrix[:3, :3]
            matrix[:3, 3] = R_moved.T @ (matrix[:3, 3] / scale - t_moved)
            pictures.append(_picture(name, frame, content, matrix))
            names.add(name)
        except FieldError as error:
            problems.append(error.at(f"{place}: frames[{i}]"))
    return stacked(pictures), tuple(problems), content


def _content(path: Path) -> dict[str, Any]:
    try:
        if path.stat().st_size > LARGEST_FILE:
            raise ValueError(f"expected at most {LARGEST_FILE} bytes, got {path.stat().st_size}")
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise ValueError(f"{path}: expected a JSON file, got: {error or type(error).__name__}") from error
    if not isinstance(content, dict):
        raise ValueError(f"{path}: expected an object with frames, got {type(content).__name__}")
    return content


def _number(field: str, value: object) -> float:
    if isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= sys.float_info.max:
        return float(value)
    raise FieldError(field, "a finite number", "nothing" if value is None else repr(value)[:60])


def _matrix(field: str, value: object) -> Float[np.ndarray, "4 4"]:
    """The 4x4 matrix; the last row may be left out."""
    rows = value if isinstance(value, list) else []
    if len(rows) not in (3, 4) or any(not isinstance(row, list) or len(row) != 4 for row in rows):
        raise FieldError(field, "4 rows of 4 numbers", "nothing" if value is None else repr(value)[:60])
    matrix = np.eye(4)
    for i, row in enumerate(rows):
        matrix[i] = [_number(f"{field}[{i}][{j}]", cell) for j, cell in enumerate(row)]
    if not np.allclose(matrix[3], (0, 0, 0, 1), atol=1e-9, rtol=0):
        raise FieldError(f"{field}[3]", "0, 0, 0, 1", matrix[3].tolist())
    return matrix


def _moved_from_world(path: Path, content: dict[str, Any]) -> tuple[np.ndarray, np.ndarray, float]:
    """Rotation, translation and then scale that the file's maker applied to the world."""
    try:
        matrix = (
            _matrix("applied_transform", content["applied_transform"]) if "applied_transform" in content else np.eye(4)
        )
        scale = _number("applied_scale", content.get("applied_scale", 1.0))
        if not scale > 0:
            raise FieldError("applied_scale", "above 0", scale)
        return nearest_rotation("applied_transform", matrix[:3, :3]), matrix[:3, 3], scale
    except FieldError as error:
        raise ValueError(str(error.at(str(path)))) from error


def _picture(name: str, frame: dict, content: dict, matrix: Float[np.ndarray, "4 4"]) -> PosedPicture:
    # As in nerfstudio: what stands at the top holds for every frame.
    values = {key: content.get(key, frame.get(key)) for key in (*INTRINSICS, *UNHELD)}
    numbers = {
        key: 0.0 if value is None and key not in NEEDED else _number(key, value) for key, value in values.items()
    }
    for key in UNHELD:
        if numbers[key]:
            raise FieldError(key, "0, since OpenCV's four lens terms have no such one", numbers[key])
    R_world_from_cam = nearest_rotation("transform_matrix", matrix[:3, :3]) @ OPENGL_FROM_OPENCV
    R_cam_from_world = R_world_from_cam.T
    return PosedPicture(
        name=name,
        size=picture_size("w, h", numbers["w"], numbers["h"]),
        K=K_with_centre_origin(pinhole(numbers["fl_x"], numbers["fl_y"], numbers["cx"], numbers["cy"])),
        distortion=np.array([numbers[key] for key in ("k1", "k2", "p1", "p2")]),
        R_cam_from_world=R_cam_from_world,
        t_cam_from_world=-R_cam_from_world @ matrix[:3, 3],
        observations=0,
    )
