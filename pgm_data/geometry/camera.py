"""Pinhole cameras with a lens: world points to pixels, and pixels to rays."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from pgm_data.geometry.arrays import frozen
from pgm_data.geometry.distortion import distort, undistort
from pgm_data.geometry.rigid import is_rotation


@dataclass(frozen=True, eq=False, kw_only=True)
class Camera:
    """One camera, or a track of them along leading axes.

    ``x_cam = R_cam_from_world @ x_world + t_cam_from_world``. A frame without a camera is NaN in
    every array.

    Raises:
        ValueError: If a rotation is not orthonormal and right-handed, a focal length is not positive, the rest of
            K is not that of a camera, or a frame is NaN in part.
    """

    K: Float[np.ndarray, "*batch 3 3"]
    """Intrinsics, pixels. The centre of the top-left pixel is (0, 0), as in OpenCV."""
    distortion: Float[np.ndarray, "*batch 4"]
    """OpenCV's k1, k2, p1, p2, dimensionless."""
    R_cam_from_world: Float[np.ndarray, "*batch 3 3"]
    """Rotation. Camera axes: x right, y down, z forward."""
    t_cam_from_world: Float[np.ndarray, "*batch 3"]
    """World origin in the camera frame, metres."""

    def __post_init__(self) -> None:
        """Keep read-only copies and check the values."""
        for name in ("K", "distortion", "R_cam_from_world", "t_cam_from_world"):
            object.__setattr__(self, name, frozen(getattr(self, name)))
        finite = self._finite_frames()
        R = self.R_cam_from_world.reshape(-1, 3, 3)[finite]
        if not is_rotation(R):
            wrong = next(i for i in range(len(R)) if not is_rotation(R[i]))
            raise ValueError(
                f"R_cam_from_world: expected rotations, got (camera {np.flatnonzero(finite)[wrong]})\n{R[wrong]}"
            )
        K = self.K.reshape(-1, 3, 3)[finite]
        focal = K[:, [0, 1], [0, 1]]
        if not np.all(focal > 0):
            raise ValueError(f"K: expected positive focal lengths, got a minimum of {focal.min()}")
        if np.any(K[:, 1, 0]) or np.any(K[:, 2] != [0, 0, 1]):
            raise ValueError(f"K: expected zeros below its diagonal and 1 at its end, got for example\n{K[0]}")

    def _finite_frames(self) -> np.ndarray:
        parts = [
            getattr(self, name).reshape(-1, size)
            for name, size in (("K", 9), ("distortion", 4), ("R_cam_from_world", 9), ("t_cam_from_world", 3))
        ]
        values = np.concatenate(parts, axis=1)
        finite = np.asarray(np.isfinite(values).all(axis=1))
        partly = np.flatnonzero(~finite & ~np.isnan(values).all(axis=1))
        if len(partly):
            raise ValueError(
                f"camera {partly[0]}: expected finite values, or NaN in every array, got {values[partly[0]]}"
            )
        return finite

    def __getitem__(self, index) -> "Camera":
        """The camera or cameras at the given leading index."""
        return Camera(
            K=self.K[index],
            distortion=self.distortion[index],
            R_cam_from_world=self.R_cam_from_world[index],
            t_cam_from_world=self.t_cam_from_world[index],
        )

    @property
    def position_world(self) -> Float[np.ndarray, "*batch 3"]:
        """Camera centre in the world, metres."""
        return -(np.swapaxes(self.R_cam_from_world, -1, -2) @ self.t_cam_from_world[..., None])[..., 0]


def same_camera(one: Camera, other: Camera) -> bool:
    """Whether they are the same to the last digit."""
    return all(np.array_equal(values, getattr(other, name)) for name, values in vars(one).items())


def _pixels(K: np.ndarray, xy: np.ndarray) -> np.ndarray:
    return xy @ np.swapaxes(K[..., :2, :2], -1, -2) + K[..., None, :2, 2]


def project(
    camera: Camera, points_world: Float[np.ndarray, "... points 3"]
) -> tuple[Float[np.ndarray, "*batch points 2"], Bool[np.ndarray, "*batch points"]]:
    """Pixels of world points, and which points have one; leading axes of cameras and points broadcast.

    Points that do not lie in front of the camera, or lie past the fold of its lens, are NaN.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        R_world_from_cam = np.swapaxes(camera.R_cam_from_world, -1, -2)
        points_cam = points_world @ R_world_from_cam + camera.t_cam_from_world[..., None, :]
        depth = np.where(points_cam[..., 2] > 0, points_cam[..., 2], np.nan)
        pixels = _pixels(camera.K, distort(points_cam[..., :2] / depth[..., None], camera.distortion))
    seen = np.asarray(np.isfinite(pixels).all(axis=-1))
    return np.where(seen[..., None], pixels, np.nan), seen


def rays(camera: Camera, pixels: Float[np.ndarray, "... points 2"]) -> Float[np.ndarray, "... points 3"]:
    """Unit directions in the world of the rays through the pixels; NaN where the lens has no such ray."""
    offset = pixels - camera.K[..., None, :2, 2]
    xy = undistort(offset @ np.linalg.inv(np.swapaxes(camera.K[..., :2, :2], -1, -2)), camera.distortion)
    directions_cam = np.concatenate([xy, np.ones_like(xy[..., :1])], axis=-1)
    directions_cam = directions_cam / np.linalg.norm(directions_cam, axis=-1, keepdims=True)
    return directions_cam @ camera.R_cam_from_world


def unproject(
    camera: Camera, pixels: Float[np.ndarray, "... points 2"], depth: Float[np.ndarray, "... points"]
) -> Float[np.ndarray, "... points 3"]:
    """World points seen at the pixels, at the given depth along the camera's z axis, metres."""
    directions = rays(camera, pixels)
    along = directions @ camera.R_cam_from_world[..., 2, :, None]
    return camera.position_world[..., None, :] + directions / along * depth[..., None]


def meet_plane(
    camera: Camera, pixels: Float[np.ndarray, "... points 2"], height: float = 0.0
) -> Float[np.ndarray, "... points 3"]:
    """World points where the pixels' rays meet the horizontal plane z = height; NaN where they never do."""
    directions = rays(camera, pixels)
    origin = camera.position_world[..., None, :]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        distance = (height - origin[..., 2]) / directions[..., 2]
        met = (distance > 0) & np.isfinite(distance)
    points = origin + np.where(met, distance, np.nan)[..., None] * directions
    # On the plane to the last bit, which the product need not be.
    points[..., 2] = np.where(met, height, np.nan)
    return points


def K_with_corner_origin(K: Float[np.ndarray, "*batch 3 3"]) -> Float[np.ndarray, "*batch 3 3"]:
    """Intrinsics for COLMAP and nerfstudio, where the centre of the top-left pixel is (0.5, 0.5)."""
    shift = np.zeros((3, 3))
    shift[:2, 2] = 0.5
    return K + shift


def K_with_centre_origin(K: Float[np.ndarray, "*batch 3 3"]) -> Float[np.ndarray, "*batch 3 3"]:
    """Our intrinsics from COLMAP's or nerfstudio's: the inverse of `K_with_corner_origin`."""
    shift = np.zeros((3, 3))
    shift[:2, 2] = 0.5
    return K - shift
