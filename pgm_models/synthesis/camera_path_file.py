"""Camera paths as JSON files: a person writes where the camera stands and looks at a few times."""

import math
from pathlib import Path

import numpy as np

from pgm_data.dataset.documents import parse_document
from pgm_data.fields import FieldError, count, fields, number, numbers, sequence
from pgm_data.geometry.camera import Camera
from pgm_models.synthesis.camera_paths import FOV_DEG, CameraPath, intrinsics, looking_at, refuse_unordered

PARTS = {"K": (3, 3), "distortion": (4,), "R_cam_from_world": (3, 3), "t_cam_from_world": (3,)}
"""What a camera consists of, and the shapes."""


def read_camera_path(path: Path) -> CameraPath:
    """The camera path in a JSON file: `width`, `height` and `keys`, each with a `time`, s, and a camera.

    A key's camera is `position` and `look_at`, world metres, with `fov_deg`, how wide the picture is (40 unless said),
    and `roll_deg`; or the `K`, `distortion`, `R_cam_from_world` and `t_cam_from_world` of a CAMERA.json. The schema
    `camera_path` says the same to other programs.

    Raises:
        ValueError: If the file does not hold such a path; names file and field, what was expected and what was found.
    """
    if path.suffix.lower() != ".json":
        raise ValueError(f"{path}: expected a camera path in a .json file, got {path.suffix or 'no suffix'}")
    raw = parse_document(path)
    try:
        return camera_path_of(raw, reason=f"as in {path.name}")
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def camera_path_of(document: object, *, reason: str = "camera path") -> CameraPath:
    """The camera path that a document as of `read_camera_path` says.

    Raises:
        ValueError: As of `read_camera_path`.
    """
    top = fields(document, "", required=("width", "height", "keys"))
    size = (count(top["width"], "width"), count(top["height"], "height"))
    intrinsics(FOV_DEG, size)
    keys = sequence(top["keys"], "keys")
    if not keys:
        raise FieldError("keys: expected one or more, got none")
    read = [_key(raw, f"keys[{place}]", size) for place, raw in enumerate(keys)]
    times = np.array([time for time, _ in read])
    refuse_unordered(times)
    cameras = Camera(**{name: np.stack([getattr(camera, name) for _, camera in read]) for name in PARTS})
    return CameraPath(times=times, cameras=cameras, size=size, reason=reason)


def camera_path_to_json(path: CameraPath) -> dict[str, object]:
    """The document that says the same path, with the matrices of its keys."""
    keys = []
    for place, time in enumerate(path.times.tolist()):
        camera = path.cameras[place]
        keys.append(
            {
                "time": time,
                "K": camera.K.reshape(-1).tolist(),
                "distortion": camera.distortion.tolist(),
                "R_cam_from_world": camera.R_cam_from_world.reshape(-1).tolist(),
                "t_cam_from_world": camera.t_cam_from_world.tolist(),
            }
        )
    return {"width": path.size[0], "height": path.size[1], "keys": keys}


def _key(raw: object, place: str, size: tuple[int, int]) -> tuple[float, Camera]:
    """Time and camera of one key."""
    entry = fields(raw, place)
    if "K" in entry:
        entry = fields(raw, place, required=("time", *PARTS))
        parts = {
            name: np.array(numbers(entry[name], f"{place}.{name}", math.prod(shape))).reshape(shape)
            for name, shape in PARTS.items()
        }
    else:
        entry = fields(raw, place, required=("time", "position", "look_at"), optional=("fov_deg", "roll_deg"))
        position = np.array(numbers(entry["position"], f"{place}.position", 3))
        aim = np.array(numbers(entry["look_at"], f"{place}.look_at", 3))
        fov = number(entry.get("fov_deg", FOV_DEG), f"{place}.fov_deg")
        roll = number(entry.get("roll_deg", 0.0), f"{place}.roll_deg")
        try:
            R, K = looking_at(position, aim, roll), intrinsics(fov, size)
        except ValueError as error:
            raise FieldError(f"{place}.{error}") from error
        parts = {"K": K, "distortion": np.zeros(4), "R_cam_from_world": R, "t_cam_from_world": -R @ position}
    time = number(entry["time"], f"{place}.time")
    try:
        with np.errstate(over="ignore", invalid="ignore"):  # absurd numbers are no rotation, and are refused as such
            return time, Camera(**parts)
    except ValueError as error:
        raise FieldError(f"{place}: {error}") from error
