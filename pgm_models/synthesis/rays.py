"""Rays through pixels, in the world."""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from pgm_data.geometry.camera import Camera
from pgm_data.geometry.camera import rays as directions_of


@dataclass(frozen=True, eq=False, kw_only=True)
class Rays:
    """Half-lines from cameras, of one frame or of several."""

    origin: Float[Tensor, "rays 3"]
    """Where they begin, world metres."""
    direction: Float[Tensor, "rays 3"]
    """Unit vectors in the world."""
    across: Float[Tensor, "rays 3"]
    """How the direction changes from a pixel to the one on its right."""
    down: Float[Tensor, "rays 3"]
    """How it changes from a pixel to the one below."""
    frame: Int[Tensor, " rays"]
    """Frame of the batch that each belongs to."""

    def __len__(self) -> int:
        """How many."""
        return len(self.frame)

    def __getitem__(self, index: Tensor) -> "Rays":
        """Some of them."""
        return Rays(**{name: values[index] for name, values in vars(self).items()})

    def at(self, depth: Float[Tensor, " rays"]) -> Float[Tensor, "rays 3"]:
        """The points at those distances along the rays, metres."""
        return self.origin + depth[:, None] * self.direction


def camera_rays(
    camera: Camera, pixels: Float[np.ndarray, "rays 2"], *, frame: int = 0, device: torch.device | str = "cpu"
) -> Rays:
    """The rays of one camera through the pixels (x, y).

    Raises:
        ValueError: If the camera is missing, or its lens has no ray for a pixel; names the first such pixel.
    """
    if not np.isfinite(camera.K).all():
        raise ValueError("camera: expected one that is there, got NaN")
    directions = directions_of(camera, pixels)
    lost = ~np.isfinite(directions).all(axis=1)
    if lost.any():
        raise ValueError(f"pixels: expected some that the lens has a ray for, got {pixels[lost][0]}")
    origin = np.broadcast_to(camera.position_world, directions.shape)
    across, down = _changes(camera, directions)
    parts = [origin, directions, across, down]
    tensors = [torch.from_numpy(np.array(part, dtype=np.float32)).to(device) for part in parts]
    return Rays(
        origin=tensors[0],
        direction=tensors[1],
        across=tensors[2],
        down=tensors[3],
        frame=torch.full((len(pixels),), frame, dtype=torch.int64, device=device),
    )


def _changes(
    camera: Camera, directions: Float[np.ndarray, "rays 3"]
) -> tuple[Float[np.ndarray, "rays 3"], Float[np.ndarray, "rays 3"]]:
    """Derivatives of the directions by the pixel's x and y, lens and all."""
    directions_cam = directions @ camera.R_cam_from_world.T
    x, y = (directions_cam[:, :2] / directions_cam[:, 2:]).T
    k1, k2, p1, p2 = camera.distortion
    s = x * x + y * y
    radial, slope = 1 + s * (k1 + s * k2), 2 * (k1 + 2 * k2 * s)
    # How the lens moves (x, y), and back.
    xx, yy = radial + slope * x * x + 2 * p1 * y + 6 * p2 * x, radial + slope * y * y + 6 * p1 * y + 2 * p2 * x
    xy = slope * x * y + 2 * p1 * x + 2 * p2 * y
    with np.errstate(divide="ignore", invalid="ignore"):  # at the fold of a lens
        back = np.stack([np.stack([yy, -xy], axis=-1), np.stack([-xy, xx], axis=-1)], axis=-2)
        back = back / (xx * yy - xy * xy)[:, None, None]
    steps = back @ np.linalg.inv(camera.K[:2, :2])  # of (x, y), by the pixel's
    moved = np.swapaxes(steps, 1, 2) @ camera.R_cam_from_world[:2]
    moved = moved - directions[:, None] * (moved @ directions[:, :, None])[..., 0][..., None]
    moved = moved * directions_cam[:, None, 2:]
    return moved[:, 0], moved[:, 1]


def picture_pixels(width: int, height: int, *, left: int = 0, top: int = 0) -> Float[np.ndarray, "pixels 2"]:
    """The pixels (x, y) of a rectangle of a picture, row by row."""
    x, y = np.meshgrid(np.arange(left, left + width), np.arange(top, top + height))
    return np.stack([x.ravel(), y.ravel()], axis=1).astype(np.float64)


def joined_rays(parts: list[Rays]) -> Rays:
    """All of them, in order."""
    return Rays(**{name: torch.cat([getattr(part, name) for part in parts]) for name in vars(parts[0])})
