"""COLMAP models from and to pictures with cameras.

COLMAP's camera axes and its `cam_from_world` are ours; its pixels put the centre of the top-left pixel at (0.5, 0.5).
"""

import shutil
from pathlib import Path

import numpy as np
from jaxtyping import Float

from pgm_data.convert.colmap_files import ColmapCamera, ColmapImage, read_model_files
from pgm_data.convert.posed_pictures import (
    FieldError,
    PosedPicture,
    PosedPictures,
    Problem,
    picture_name,
    picture_size,
    pinhole,
    stacked,
)
from pgm_data.geometry.camera import K_with_centre_origin, K_with_corner_origin

MODEL_FOLDERS = ("", "sparse/0", "sparse", "0")
"""Where a model is looked for below the folder that is named."""
ROUNDED_QUATERNION = 1e-3
"""A quaternion whose length is this near to 1 was rounded when written, and is normalised."""


def colmap_model(
    K_corner: Float[np.ndarray, "3 3"], distortion: Float[np.ndarray, " 4"]
) -> tuple[str, tuple[float, ...]]:
    """The smallest COLMAP camera model that holds the camera exactly, and its parameters.

    Raises:
        ValueError: If the intrinsics are skewed, which no model of COLMAP is.
    """
    if K_corner[0, 1] != 0:
        raise ValueError(f"K: expected no skew, since COLMAP and nerfstudio have none, got {K_corner[0, 1]}")
    fx, fy, cx, cy = (float(K_corner[i]) for i in ((0, 0), (1, 1), (0, 2), (1, 2)))
    k1, k2, p1, p2 = (float(value) for value in distortion)
    if p1 or p2 or (fx != fy and (k1 or k2)):
        return "OPENCV", (fx, fy, cx, cy, k1, k2, p1, p2)
    if k2:
        return "RADIAL", (fx, cx, cy, k1, k2)
    if k1:
        return "SIMPLE_RADIAL", (fx, cx, cy, k1)
    return ("SIMPLE_PINHOLE", (fx, cx, cy)) if fx == fy else ("PINHOLE", (fx, fy, cx, cy))


def write_colmap(folder: Path, pictures: PosedPictures, *, text: bool) -> None:
    """Write the pictures' cameras as a COLMAP model without points, replacing one that is there.

    Pictures of exactly equal intrinsics share a camera.
    """
    import pycolmap

    reconstruction = pycolmap.Reconstruction()
    camera_ids: dict[tuple, int] = {}
    for i, name in enumerate(pictures.names):
        camera = pictures.camera[i]
        model, parameters = colmap_model(K_with_corner_origin(camera.K), camera.distortion)
        width, height = (int(side) for side in pictures.sizes[i])
        key = (model, width, height, parameters)
        if key not in camera_ids:
            camera_ids[key] = len(camera_ids) + 1
            reconstruction.add_camera_with_trivial_rig(
                pycolmap.Camera(
                    model=model, width=width, height=height, params=list(parameters), camera_id=camera_ids[key]
                )
            )
        image = pycolmap.Image(name=name, camera_id=camera_ids[key], image_id=i + 1)
        rotation = pycolmap.Rotation3d(np.array(camera.R_cam_from_world))
        cam_from_world = pycolmap.Rigid3d(rotation, np.array(camera.t_cam_from_world))
        reconstruction.add_image_with_trivial_frame(image, cam_from_world)
    fresh = folder.with_name(f".{folder.name}.tmp")
    shutil.rmtree(fresh, ignore_errors=True)
    fresh.mkdir(parents=True)
    if text:
        reconstruction.write_text(fresh)
    else:
        reconstruction.write_binary(fresh)
    if folder.exists():
        shutil.rmtree(folder)
    fresh.rename(folder)


def model_folder(folder: Path) -> Path:
    """The folder of a model's files: the given one, or the usual ones below it.

    Raises:
        ValueError: If none of them holds a model.
    """
    for below in MODEL_FOLDERS:
        place = folder / below
        if any((place / f"images{suffix}").is_file() for suffix in (".bin", ".txt")):
            return place
    looked = ", ".join(below or "itself" for below in MODEL_FOLDERS)
    raise ValueError(f"{folder}: expected a COLMAP model (images.bin or images.txt), got none in {looked}")


def read_colmap(folder: Path) -> tuple[PosedPictures, tuple[Problem, ...], Path]:
    """Pictures of a COLMAP model, the entries that could not be taken over, and its images file.

    Raises:
        ValueError: If there is no model, or its files cannot be read at all.
    """
    cameras, images, problems, path = read_model_files(model_folder(folder))
    pictures: list[PosedPicture] = []
    found = list(problems)
    names: set[str] = set()
    for image in images:
        try:
            picture = _picture(image, cameras)
            if picture.name in names:
                raise FieldError("NAME", "each name once", f"{picture.name!r} again")
            names.add(picture.name)
            pictures.append(picture)
        except FieldError as error:
            found.append(error.at(image.place))
    return stacked(pictures), tuple(found), path


def _picture(image: ColmapImage, cameras: dict[int, ColmapCamera]) -> PosedPicture:
    if image.camera_id not in cameras:
        raise FieldError("CAMERA_ID", "a camera that can be read", image.camera_id)
    camera = cameras[image.camera_id]
    K_corner, distortion = _lens(camera)
    return PosedPicture(
        name=picture_name("NAME", image.name),
        size=picture_size("WIDTH HEIGHT", camera.width, camera.height),
        K=K_with_centre_origin(K_corner),
        distortion=distortion,
        R_cam_from_world=_rotation(image.quaternion),
        t_cam_from_world=np.array(image.translation),
        observations=image.observations,
    )


def _lens(camera: ColmapCamera) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, " 4"]]:
    numbers = camera.parameters
    if camera.model.startswith(("SIMPLE", "RADIAL")):
        numbers = (numbers[0], *numbers)
    rest = numbers[4:]
    if any(rest[4:]):
        raise FieldError("PARAMS", "zeros for k3 to k6, which OpenCV's four terms do not have", rest[4:])
    distortion = np.zeros(4)
    distortion[: len(rest[:4])] = rest[:4]
    return pinhole(*numbers[:4]), distortion


def _rotation(quaternion: tuple[float, ...]) -> Float[np.ndarray, "3 3"]:
    length = float(np.linalg.norm(quaternion))
    if not abs(length - 1.0) <= ROUNDED_QUATERNION:
        raise FieldError("QW QX QY QZ", "a quaternion of length 1", f"length {length:.6g}")
    w, x, y, z = np.array(quaternion) / length
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
