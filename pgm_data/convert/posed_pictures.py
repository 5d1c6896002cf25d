"""Pictures with their cameras: what the formats of other programs hold, in our conventions.

Pixels put the CENTRE of the top-left pixel at (0, 0) here; the formats put it at (0.5, 0.5), and their readers and
writers cross that border by `K_with_corner_origin` and `K_with_centre_origin`.
"""

import re
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from pgm_data.geometry.arrays import frozen
from pgm_data.geometry.camera import Camera

ROUNDED_ROTATION = 1e-3
"""A matrix this near to a rotation is one that was rounded when written."""
LONGEST_NAME = 1000
LARGEST_SIDE = 65536


@dataclass(frozen=True, eq=False, kw_only=True)
class PosedPictures:
    """Pictures and the camera of each.

    Raises:
        ValueError: If names repeat, lengths differ, or a camera is not finite.
    """

    names: tuple[str, ...]
    """Relative paths with forward slashes."""
    sizes: Int[np.ndarray, "pictures 2"]
    """Width and height, pixels."""
    camera: Camera
    """One camera per picture, finite."""
    observations: Int[np.ndarray, " pictures"]
    """Points of the reconstruction that each picture sees; 0 where the format has none."""

    def __post_init__(self) -> None:
        """Keep read-only copies and check the values."""
        for name in ("sizes", "observations"):
            object.__setattr__(self, name, frozen(getattr(self, name), np.int64))
        if len(set(self.names)) != len(self.names):
            repeated = next(name for name in self.names if self.names.count(name) > 1)
            raise ValueError(f"pictures: expected each name once, got {repeated!r} again")
        if self.sizes.shape != (len(self.names), 2) or self.camera.K.shape != (len(self.names), 3, 3):
            shapes = f"{self.sizes.shape}, {self.camera.K.shape}"
            raise ValueError(f"pictures: expected a size and a camera for each of {len(self.names)}, got {shapes}")
        for name in ("K", "distortion", "R_cam_from_world", "t_cam_from_world"):
            if not np.isfinite(getattr(self.camera, name)).all():
                raise ValueError(f"pictures: camera.{name}: expected finite values, got NaN or infinity")


@dataclass(frozen=True, kw_only=True)
class Problem:
    """One place of a foreign file that cannot be taken over."""

    place: str
    """File, and where in it."""
    field: str
    expected: str
    found: str

    def __str__(self) -> str:
        """One line for a person."""
        return f"{self.place}: {self.field}: expected {self.expected}, got {self.found}"


@dataclass(frozen=True, eq=False, kw_only=True)
class PosedPicture:
    """One picture while a file is being read."""

    name: str
    size: tuple[int, int]
    """Width and height, pixels."""
    K: Float[np.ndarray, "3 3"]
    """With the centre of the top-left pixel at (0, 0)."""
    distortion: Float[np.ndarray, " 4"]
    R_cam_from_world: Float[np.ndarray, "3 3"]
    t_cam_from_world: Float[np.ndarray, " 3"]
    observations: int


def stacked(pictures: list[PosedPicture]) -> PosedPictures:
    """The pictures as one struct of arrays."""

    def values(name: str, shape: tuple[int, ...]) -> np.ndarray:
        return np.array([getattr(picture, name) for picture in pictures], dtype=np.float64).reshape(-1, *shape)

    return PosedPictures(
        names=tuple(picture.name for picture in pictures),
        sizes=np.array([picture.size for picture in pictures], dtype=np.int64).reshape(-1, 2),
        camera=Camera(
            K=values("K", (3, 3)),
            distortion=values("distortion", (4,)),
            R_cam_from_world=values("R_cam_from_world", (3, 3)),
            t_cam_from_world=values("t_cam_from_world", (3,)),
        ),
        observations=np.array([picture.observations for picture in pictures], dtype=np.int64),
    )


class FieldError(ValueError):
    """A field of a foreign file does not hold what it must."""

    def __init__(self, field: str, expected: str, found: object) -> None:
        """Say which field, and what it should be."""
        super().__init__(f"{field}: expected {expected}, got {found}")
        self.field, self.expected, self.found = field, expected, str(found)

    def at(self, place: str) -> Problem:
        """The problem, in its place."""
        return Problem(place=place, field=self.field, expected=self.expected, found=self.found)


def picture_name(field: str, raw: object) -> str:
    """A picture's path made plain: relative, forward slashes, without `.` parts.

    Raises:
        FieldError: If it could point outside of the folder it is relative to, or is no path.
    """
    expected = "a relative path below the file's own folder"
    if not isinstance(raw, str) or not raw or len(raw) > LONGEST_NAME:
        raise FieldError(field, expected, repr(raw)[:100])
    if re.search(r"[\x00-\x1f\\]", raw) or re.match(r"[A-Za-z][A-Za-z0-9+.-]*:", raw) or raw.startswith("/"):
        raise FieldError(field, expected, repr(raw)[:100])
    parts = [part for part in raw.split("/") if part not in ("", ".")]
    if not parts or ".." in parts:
        raise FieldError(field, expected, repr(raw)[:100])
    return "/".join(parts)


def picture_size(field: str, width: float, height: float) -> tuple[int, int]:
    """Width and height.

    Raises:
        FieldError: If they are not whole numbers of a picture's size.
    """
    for side in (width, height):
        if not (1 <= side <= LARGEST_SIDE and side == int(side)):
            raise FieldError(field, f"a whole width and height from 1 to {LARGEST_SIDE}", f"{width} x {height}")
    return int(width), int(height)


def pinhole(fx: float, fy: float, cx: float, cy: float) -> Float[np.ndarray, "3 3"]:
    """Intrinsics of the four numbers.

    Raises:
        FieldError: If a focal length is not above 0, or a number is not finite.
    """
    if not np.isfinite([fx, fy, cx, cy]).all():
        raise FieldError("intrinsics", "finite numbers", f"{fx}, {fy}, {cx}, {cy}")
    if not (fx > 0 and fy > 0):
        raise FieldError("focal length", "above 0 px", f"{fx}, {fy}")
    return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])


def nearest_rotation(field: str, matrix: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "3 3"]:
    """The matrix itself where it is a rotation to 1e-9, else the rotation nearest to a rounded one.

    Raises:
        FieldError: If it is not within `ROUNDED_ROTATION` of a rotation.
    """
    if not np.isfinite(matrix).all():
        raise FieldError(field, "finite numbers", "NaN or infinity")
    gram_error = float(np.abs(matrix @ matrix.T - np.eye(3)).max())
    determinant = float(np.linalg.det(matrix))
    if not gram_error <= ROUNDED_ROTATION or determinant < 0:
        raise FieldError(field, "a rotation", f"a matrix of determinant {determinant:.6g} that is none")
    if gram_error <= 1e-9:
        return matrix
    left, _, right = np.linalg.svd(matrix)
    return left @ right
