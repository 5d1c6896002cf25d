"""COLMAP's cameras and images files, text and binary, read with an error for every field.

pycolmap reads them too, but on a damaged file it names neither the line nor the field. Only what a camera needs is
read: points and tracks are counted and passed over, rigs and frames repeat what images say.

Source: colmap.github.io, output format.
"""

import math
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from pgm_data.convert.posed_pictures import FieldError, Problem

MODELS = (
    *("SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "OPENCV_FISHEYE", "FULL_OPENCV", "FOV"),
    *("SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE", "THIN_PRISM_FISHEYE"),
)
"""Camera models by their number in binary files."""
PARAMETERS = {
    "SIMPLE_PINHOLE": 3,
    "PINHOLE": 4,
    "SIMPLE_RADIAL": 4,
    "RADIAL": 5,
    "OPENCV": 8,
    "FULL_OPENCV": 12,
}
"""Numbers of each model whose lens we can hold."""
NO_POINT = 2**64 - 1


@dataclass(frozen=True, kw_only=True)
class ColmapCamera:
    """One line of the cameras file."""

    place: str
    """File and line or entry."""
    model: str
    width: int
    height: int
    parameters: tuple[float, ...]


@dataclass(frozen=True, kw_only=True)
class ColmapImage:
    """One entry of the images file."""

    place: str
    """File and line or entry."""
    name: str
    camera_id: int
    quaternion: tuple[float, ...]
    """w, x, y, z of cam_from_world."""
    translation: tuple[float, ...]
    """Of cam_from_world."""
    observations: int
    """Points that have a place in space."""


Cameras = dict[int, ColmapCamera]
Images = list[ColmapImage]


def read_model_files(folder: Path) -> tuple[Cameras, Images, tuple[Problem, ...], Path]:
    """Cameras by their number, images, the entries that cannot be read, and the images file.

    Raises:
        ValueError: If the folder holds no model, or a binary file ends early, so that nothing after is known.
    """
    for suffix, cameras_of, images_of in (
        (".bin", _binary_cameras, _binary_images),
        (".txt", _text_cameras, _text_images),
    ):
        cameras_path, images_path = folder / f"cameras{suffix}", folder / f"images{suffix}"
        if cameras_path.is_file() and images_path.is_file():
            problems: list[Problem] = []
            try:
                cameras = cameras_of(cameras_path, problems)
                images = images_of(images_path, problems)
            except (OSError, UnicodeDecodeError) as error:
                raise ValueError(f"{folder}: expected a COLMAP model, got: {error}") from error
            return cameras, images, tuple(problems), images_path
    raise ValueError(f"{folder}: expected cameras and images as .bin or .txt, got neither pair")


def _finite(field: str, values: tuple[float, ...]) -> tuple[float, ...]:
    if not all(map(math.isfinite, values)):
        raise FieldError(field, "finite numbers", " ".join(map(str, values)))
    return values


def _numbers(field: str, words: list[str]) -> tuple[float, ...]:
    try:
        return _finite(field, tuple(float(word) for word in words))
    except ValueError as error:
        if isinstance(error, FieldError):
            raise
        raise FieldError(field, "numbers", " ".join(words)[:100]) from error


def _whole(field: str, word: str) -> int:
    if not word.isascii() or not word.isdigit():
        raise FieldError(field, "a whole number", repr(word))
    return int(word)


def _camera(place: str, model: str, width: int, height: int, parameters: tuple[float, ...]) -> ColmapCamera:
    if model not in PARAMETERS:
        raise FieldError("MODEL", f"one of {', '.join(PARAMETERS)}", model)
    if len(parameters) != PARAMETERS[model]:
        raise FieldError("PARAMS", f"{PARAMETERS[model]} numbers for {model}", len(parameters))
    return ColmapCamera(place=place, model=model, width=width, height=height, parameters=_finite("PARAMS", parameters))


def _text_cameras(path: Path, problems: list[Problem]) -> Cameras:
    cameras: Cameras = {}
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
        words = line.split()
        if not words or words[0].startswith("#"):
            continue
        place = f"{path}: line {number}"
        try:
            if len(words) < 4:
                raise FieldError("camera", "CAMERA_ID MODEL WIDTH HEIGHT PARAMS", line.strip()[:100])
            camera_id = _whole("CAMERA_ID", words[0])
            size = _whole("WIDTH", words[2]), _whole("HEIGHT", words[3])
            if camera_id in cameras:
                raise FieldError("CAMERA_ID", "each number once", f"{camera_id} again")
            cameras[camera_id] = _camera(place, words[1], *size, _numbers("PARAMS", words[4:]))
        except FieldError as error:
            problems.append(error.at(place))
    return cameras


def _text_images(path: Path, problems: list[Problem]) -> Images:
    images: Images = []
    lines = iter(enumerate(path.read_text(encoding="utf-8").splitlines(), 1))
    for number, line in lines:
        words = line.split(maxsplit=9)
        if not words or words[0].startswith("#"):
            continue
        place = f"{path}: line {number}"
        _, points = next(lines, (0, ""))
        try:
            if len(words) < 10:
                raise FieldError("image", "IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME", line.strip()[:100])
            ids = points.split()[2::3]
            images.append(
                ColmapImage(
                    place=place,
                    name=words[9].strip(),
                    camera_id=_whole("CAMERA_ID", words[8]),
                    quaternion=_numbers("QW QX QY QZ", words[1:5]),
                    translation=_numbers("TX TY TZ", words[5:8]),
                    observations=sum(word != "-1" for word in ids),
                )
            )
        except FieldError as error:
            problems.append(error.at(place))
    return images


class _Bytes:
    """A binary file read from front to back."""

    def __init__(self, path: Path) -> None:
        self.path, self.data, self.at = path, path.read_bytes(), 0

    def take(self, layout: str, entry: str) -> tuple:
        size = struct.calcsize(layout)
        if self.at + size > len(self.data):
            raise ValueError(f"{self.path}: {entry}: expected {size} more bytes, got {len(self.data) - self.at}")
        values = struct.unpack_from(layout, self.data, self.at)
        self.at += size
        return values

    def text(self, entry: str) -> str:
        end = self.data.find(b"\0", self.at)
        if end < 0:
            raise ValueError(f"{self.path}: {entry}: NAME: expected a zero byte at its end, got the file's end")
        raw, self.at = self.data[self.at : end], end + 1
        return raw.decode("utf-8", "backslashreplace")

    def entries(self) -> Iterator[str]:
        count = self.take("<Q", "count")[0]
        # Each entry takes at least 40 bytes; a count beyond that is damage, not a large model.
        if count * 40 > len(self.data):
            raise ValueError(
                f"{self.path}: count: expected as many entries as fit, got {count} in {len(self.data)} bytes"
            )
        for i in range(count):
            yield f"entry {i}"


def _binary_cameras(path: Path, problems: list[Problem]) -> Cameras:
    cameras: Cameras = {}
    data = _Bytes(path)
    for entry in data.entries():
        camera_id, model_id, width, height = data.take("<IiQQ", entry)
        model = MODELS[model_id] if 0 <= model_id < len(MODELS) else f"number {model_id}"
        if model not in PARAMETERS:
            # How many numbers follow is unknown, so nothing after can be read.
            raise ValueError(f"{path}: {entry}: MODEL: expected one of {', '.join(PARAMETERS)}, got {model}")
        parameters = data.take(f"<{PARAMETERS[model]}d", entry)
        try:
            cameras[camera_id] = _camera(f"{path}: {entry}", model, width, height, parameters)
        except FieldError as error:
            problems.append(error.at(f"{path}: {entry}"))
    return cameras


def _binary_images(path: Path, problems: list[Problem]) -> Images:
    images: Images = []
    data = _Bytes(path)
    for entry in data.entries():
        _, *pose, camera_id = data.take("<I7dI", entry)
        name = data.text(entry)
        count = data.take("<Q", entry)[0]
        if count * 24 > len(data.data):
            raise ValueError(
                f"{path}: {entry}: POINTS2D: expected as many as fit into the file, got a count of {count}"
            )
        points = data.take(f"<{count * 24}s", entry)[0]
        ids = struct.iter_unpack("<16xQ", points)
        try:
            images.append(
                ColmapImage(
                    place=f"{path}: {entry}",
                    name=name,
                    camera_id=camera_id,
                    quaternion=_finite("QW QX QY QZ", tuple(pose[:4])),
                    translation=_finite("TX TY TZ", tuple(pose[4:])),
                    observations=sum(point != NO_POINT for (point,) in ids),
                )
            )
        except FieldError as error:
            problems.append(error.at(f"{path}: {entry}"))
    return images
