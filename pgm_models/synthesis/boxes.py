"""Boxes round objects: where rays cross them, and which rectangle of a picture they can be seen in."""

from dataclasses import dataclass
from itertools import product

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from pgm_data.geometry.camera import Camera, project
from pgm_models.synthesis.rays import Rays

NEAREST_M = 0.01
"""Nothing closer to a camera is rendered."""
EDGE_POINTS = 17
"""Points of each edge of a box that are looked at, as a lens bends edges."""
MARGIN_PX = 2.0
"""On each side of what the points of the edges span."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Boxes:
    """One box a frame, its edges along the axes of the world."""

    low: Float[Tensor, "frames 3"]
    """Lowest corner, metres; NaN where the frame has none."""
    high: Float[Tensor, "frames 3"]
    """Highest corner; a box without volume is never met."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Spans:
    """Where each of some rays is inside a box."""

    near: Float[Tensor, " rays"]
    """Metres along the ray."""
    far: Float[Tensor, " rays"]
    """Not above `near` where the ray misses."""

    @property
    def met(self) -> Tensor:
        """Whether the ray crosses the box."""
        return self.far > self.near


def box_spans(rays: Rays, boxes: Boxes) -> Spans:
    """Where each ray is inside the box of its frame, in front of its camera; a missing box is missed.

    A ray that runs in the plane of a face counts as outside.
    """
    low, high = boxes.low[rays.frame] - rays.origin, boxes.high[rays.frame] - rays.origin
    still = rays.direction == 0
    # Along an axis in which it does not move a ray is inside always or never.
    inside = (low < 0) & (high > 0)
    one, other = low / rays.direction, high / rays.direction
    endless = torch.full_like(one, torch.inf)
    near = torch.where(still, torch.where(inside, -endless, endless), torch.minimum(one, other)).amax(dim=1)
    far = torch.where(still, torch.where(inside, endless, -endless), torch.maximum(one, other)).amin(dim=1)
    near = near.clamp(min=NEAREST_M)
    solid = (boxes.high > boxes.low).all(dim=1)[rays.frame]
    met = solid & (far > near) & torch.isfinite(near) & torch.isfinite(far)
    return Spans(near=torch.where(met, near, 0.0), far=torch.where(met, far, 0.0))


def screen_rectangle(
    camera: Camera,
    low: Float[np.ndarray, " 3"],
    high: Float[np.ndarray, " 3"],
    width: int,
    height: int,
) -> tuple[int, int, int, int] | None:
    """Columns and rows (left, top, right, bottom; the last two excluded) outside which no ray meets the box.

    The whole picture where a part of the box lies behind the camera or past the fold of its lens; None where the box is
    missing, or wholly outside the picture.
    """
    if not (np.isfinite(low).all() and np.isfinite(high).all()):
        return None
    corners = np.array(list(product(*zip(low, high, strict=True))))
    edges = [(a, b) for a in range(8) for b in range(a + 1, 8) if (a ^ b).bit_count() == 1]
    along = np.linspace(0.0, 1.0, EDGE_POINTS)[:, None]
    points = np.concatenate([corners[a] + along * (corners[b] - corners[a]) for a, b in edges])
    depth = points @ camera.R_cam_from_world[2] + camera.t_cam_from_world[2]
    if depth.max() <= 0:
        return None
    pixels, seen = project(camera, points)
    if not seen.all() or depth.min() < NEAREST_M:
        return 0, 0, width, height
    first, last = np.floor(pixels.min(axis=0) - MARGIN_PX), np.ceil(pixels.max(axis=0) + MARGIN_PX) + 1
    left, top = np.clip(first, 0, [width, height]).astype(int)
    right, bottom = np.clip(last, 0, [width, height]).astype(int)
    return (int(left), int(top), int(right), int(bottom)) if right > left and bottom > top else None
