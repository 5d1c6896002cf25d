"""Small copies of a clip's pictures, and the one picture that holds what all of them show: the canvas.

The clip's cameras turn and zoom about one place, so each pixel of one picture shows what one pixel of another does. The
map between them is computed at a coarse grid of pixels and interpolated.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, Int, UInt8

from pgm_data.geometry.camera import Camera, project, rays

CELL = 16
"""Small pixels between the points at which the map between two cameras is computed; the rest is interpolated."""
OUTSIDE = -1e4
"""Where a map leads to no pixel."""
LARGEST_CANVAS = 2.5
"""Widest and highest canvas, in pictures."""


@dataclass(frozen=True, eq=False, kw_only=True)
class SmallView:
    """The cameras of a clip, and its pictures in small copies."""

    size: tuple[int, int]
    """Width and height of the small copies, px."""
    scale: tuple[float, float]
    """Small pixels in one of the pictures, along x and y."""
    camera: Camera
    """Of the small copies, one a frame."""

    def shrunk(self, bgr: UInt8[np.ndarray, "height width 3"]) -> UInt8[np.ndarray, "small_height small_width 3"]:
        """The small copy."""
        if (bgr.shape[1], bgr.shape[0]) == self.size:
            return bgr
        # Halving is the same by both, and linear interpolation is the faster one.
        halves = bgr.shape[1] == 2 * self.size[0] and bgr.shape[0] == 2 * self.size[1]
        return cv2.resize(bgr, self.size, interpolation=cv2.INTER_LINEAR if halves else cv2.INTER_AREA)

    def full(self, pixels: Float[np.ndarray, "... 2"]) -> Float[np.ndarray, "... 2"]:
        """Pixels of the pictures from those of the small copies."""
        return (pixels + 0.5) / np.array(self.scale) - 0.5


def small_view(camera: Camera, size: tuple[int, int], width: int) -> SmallView:
    """Small copies of about the given width."""
    small = (min(width, size[0]), max(1, round(size[1] * min(width, size[0]) / size[0])))
    scale = (small[0] / size[0], small[1] / size[1])
    K = camera.K.copy()
    K[..., 0, :2] *= scale[0]
    K[..., 1, 1] *= scale[1]
    K[..., 0, 2] = (camera.K[..., 0, 2] + 0.5) * scale[0] - 0.5
    K[..., 1, 2] = (camera.K[..., 1, 2] + 0.5) * scale[1] - 0.5
    resized = Camera(
        K=K,
        distortion=camera.distortion,
        R_cam_from_world=camera.R_cam_from_world,
        t_cam_from_world=camera.t_cam_from_world,
    )
    return SmallView(size=small, scale=scale, camera=resized)


def largest_shift(view: SmallView, frames: Int[np.ndarray, " some"]) -> float:
    """How far the cameras move the picture of what the middle one sees, small px."""
    middle = view.camera[int(frames[len(frames) // 2])]
    x, y = np.meshgrid(np.linspace(0, view.size[0] - 1, 4), np.linspace(0, view.size[1] - 1, 4))
    pixels = np.stack([x.ravel(), y.ravel()], axis=1)
    cameras = view.camera[frames]
    far = rays(middle, pixels) @ np.swapaxes(cameras.R_cam_from_world, -1, -2)
    seen, there = project(_at_origin(cameras), far)
    shift = np.linalg.norm(seen - pixels, axis=-1)
    return float(np.inf if not there.any() else np.nanmax(np.where(there, shift, np.nan)))


def _at_origin(camera: Camera) -> Camera:
    """The camera with its own axes as those of the world: it takes directions in the camera's frame."""
    return Camera(
        K=camera.K,
        distortion=camera.distortion,
        R_cam_from_world=np.broadcast_to(np.eye(3), camera.R_cam_from_world.shape),
        t_cam_from_world=np.zeros_like(camera.t_cam_from_world),
    )


def canvas_of(view: SmallView, frames: Int[np.ndarray, " some"]) -> tuple[Camera, tuple[int, int]]:
    """A camera without lens error that holds what those of the frames see, and the size of its picture."""
    middle = int(frames[len(frames) // 2])
    focal = float(np.median(view.camera.K[frames, 0, 0]))
    width, height = view.size
    x, y = np.meshgrid(np.linspace(0, width - 1, 5), np.linspace(0, height - 1, 5))
    edge = np.stack([x.ravel(), y.ravel()], axis=1)
    R = view.camera.R_cam_from_world[middle]
    directions = np.asarray(rays(view.camera[frames], edge) @ R.T).reshape(-1, 3)
    ahead = np.asarray(directions[:, 2] > 0.2)
    tangent = directions[ahead, :2] / directions[ahead, 2:]
    spare = (np.array([LARGEST_CANVAS * width, LARGEST_CANVAS * height]) / 2) / focal
    low = np.maximum(np.nanmin(tangent, axis=0), -spare)
    high = np.minimum(np.nanmax(tangent, axis=0), spare)
    size = (int(np.ceil((high[0] - low[0]) * focal)) + 1, int(np.ceil((high[1] - low[1]) * focal)) + 1)
    K = np.array([[focal, 0.0, -low[0] * focal], [0.0, focal, -low[1] * focal], [0.0, 0.0, 1.0]])
    canvas = Camera(
        K=K, distortion=np.zeros(4), R_cam_from_world=R, t_cam_from_world=view.camera.t_cam_from_world[middle]
    )
    return canvas, size


def coarse_pixels(size: tuple[int, int]) -> tuple[Float[np.ndarray, "nodes 2"], tuple[int, int]]:
    """Pixels at the nodes of a grid that reaches one cell beyond the picture, and its columns and rows."""
    columns, rows = -(-size[0] // CELL) + 2, -(-size[1] // CELL) + 2
    x, y = np.meshgrid((np.arange(columns) - 0.5) * CELL - 0.5, (np.arange(rows) - 0.5) * CELL - 0.5)
    return np.stack([x.ravel(), y.ravel()], axis=1), (columns, rows)


def refined_map(
    values: Float[np.ndarray, " nodes"], nodes: tuple[int, int], size: tuple[int, int]
) -> Float[np.ndarray, "high wide"]:
    """Values at each pixel from those at the nodes of `coarse_pixels`."""
    columns, rows = nodes
    grid = values.reshape(rows, columns).astype(np.float32)
    fine = cv2.resize(grid, (columns * CELL, rows * CELL), interpolation=cv2.INTER_LINEAR)
    return np.ascontiguousarray(fine[CELL : CELL + size[1], CELL : CELL + size[0]])


def _dense(pixels: np.ndarray, nodes: tuple[int, int], size: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    lost = np.asarray(~np.isfinite(pixels).all(axis=1))
    pixels = np.where(lost[:, None], OUTSIDE, pixels)
    return refined_map(pixels[:, 0], nodes, size), refined_map(pixels[:, 1], nodes, size)


def view_from_canvas(camera: Camera, canvas: Camera, size: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """For each pixel of the canvas, the pixel of the view that shows it."""
    grid, nodes = coarse_pixels(size)
    pixels, _ = project(_at_origin(camera), rays(canvas, grid) @ camera.R_cam_from_world.T)
    return _dense(pixels, nodes, size)


def canvas_from_view(canvas: Camera, camera: Camera, size: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """For each pixel of the view, the pixel of the canvas that shows it."""
    grid, nodes = coarse_pixels(size)
    pixels, _ = project(_at_origin(canvas), rays(camera, grid) @ canvas.R_cam_from_world.T)
    return _dense(pixels, nodes, size)
