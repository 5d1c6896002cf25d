"""Meshes inserted into a rendered scene: of one look, fixed to a joint or to the world, and kept from the enhancer.

Like the ball, a mesh may be narrower than a pixel: several rays through each pixel are followed through its grid of
distances, and the pixel sees their mean. Source: Menapace et al. 2023, appendix B.2, where the joint's blending weights
are raised about the mesh; here the mesh follows the joint exactly, at its own size.
"""

from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn import functional

from pgm_models.synthesis.balls import optical_of_share
from pgm_models.synthesis.bodies import Marched
from pgm_models.synthesis.boxes import Boxes, box_spans
from pgm_models.synthesis.grids import fetched
from pgm_models.synthesis.meshes import DistanceGrid
from pgm_models.synthesis.rays import Rays
from pgm_models.synthesis.samples import OPAQUE, Samples
from pgm_models.synthesis.skinning import Poses

SOLID = 1e4
"""Density inside a mesh that lets nothing through, 1/m."""
SUBPIXELS = 3
"""Rays through a pixel along each axis."""
PIXELS_AT_ONCE = 1 << 14
"""Upper bound, which keeps the memory of a picture that a mesh fills small."""
STEEPEST = 3**0.5 * 1.001
"""How much distances between the cells of a grid change in a metre, at most, with room for rounding."""
SEEN = 1 / 255
"""Share of a pixel below which a mesh is not seen in it."""


@dataclass(frozen=True, eq=False, kw_only=True)
class InsertedMesh:
    """A mesh to be rendered."""

    low: Float[Tensor, " 3"]
    """Where its grid begins, metres in the mesh's frame."""
    high: Float[Tensor, " 3"]
    """Where the grid ends."""
    size: tuple[int, int, int]
    """Cells of the grid along each axis."""
    distance: Float[Tensor, "cells 1"]
    """Signed distance, metres, the last axis varying fastest."""
    density: float
    """Inside, 1/m."""
    features: Float[Tensor, "1 features"]
    """What all of it looks like: three of colour, 0 to 1, and 0 for the enhancer."""

    def to(self, device: torch.device | str) -> "InsertedMesh":
        """The same on a device."""
        moved = {name: value.to(device) for name, value in vars(self).items() if isinstance(value, Tensor)}
        return replace(self, **moved)


def inserted_mesh(
    grid: DistanceGrid, *, colour: tuple[float, float, float], features: int, density: float = SOLID
) -> InsertedMesh:
    """The mesh of a grid of distances in one colour, RGB 0 to 1, with that many features.

    Raises:
        ValueError: If the colour is not 0 to 1, the density not above 0, or there are fewer than 3 features.
    """
    if not all(0 <= part <= 1 for part in colour):
        raise ValueError(f"colour: expected RGB 0 to 1, got {colour}")
    if not density > 0:
        raise ValueError(f"density: expected above 0 / m, got {density}")
    if features < len(colour):
        raise ValueError(f"features: expected 3 or more, got {features}")
    x, y, z = grid.distance.shape
    return InsertedMesh(
        low=torch.as_tensor(grid.low, dtype=torch.float32),
        high=torch.as_tensor(grid.high, dtype=torch.float32),
        size=(x, y, z),
        distance=torch.as_tensor(grid.distance.reshape(-1, 1), dtype=torch.float32),
        density=density,
        features=torch.tensor([[*colour, *[0.0] * (features - len(colour))]]),
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class Placement:
    """Where a mesh is in each frame: mesh_from_world, rigid; NaN where it is not there."""

    R_mesh_from_world: Float[Tensor, "frames 3 3"]
    t_mesh_from_world: Float[Tensor, "frames 3"]
    """Metres."""


def fixed_to_joint(
    poses: Poses,
    joint: int,
    R_joint_from_mesh: Float[np.ndarray, "3 3"],
    t_joint_from_mesh: Float[np.ndarray, " 3"],
) -> Placement:
    """Where a mesh is that does not move in the frame of a body's joint; it keeps its size whatever the body's.

    Raises:
        ValueError: If the body has no such joint.
    """
    joints = poses.joints.shape[1]
    if not 0 <= joint < joints:
        raise ValueError(f"joint: expected 0 to {joints - 1}, got {joint}")
    R_mesh_from_joint = torch.as_tensor(R_joint_from_mesh.T.copy(), dtype=torch.float32).to(poses.rotation.device)
    t = torch.as_tensor(t_joint_from_mesh, dtype=torch.float32).to(poses.rotation.device)
    R_joint_from_world = poses.rotation[:, joint] / poses.scale[:, None, None]
    t_joint_from_world = -(R_joint_from_world @ poses.joints[:, joint, :, None])[..., 0]
    return Placement(
        R_mesh_from_world=R_mesh_from_joint @ R_joint_from_world,
        t_mesh_from_world=(t_joint_from_world - t) @ R_mesh_from_joint.T,
    )


def fixed_in_world(
    R_world_from_mesh: Float[np.ndarray, "3 3"],
    t_world_from_mesh: Float[np.ndarray, " 3"],
    frames: int,
    *,
    device: torch.device | str = "cpu",
) -> Placement:
    """Where a mesh is that stands still."""
    R = torch.as_tensor(R_world_from_mesh.T.copy(), dtype=torch.float32).to(device)
    t = -R @ torch.as_tensor(t_world_from_mesh, dtype=torch.float32).to(device)
    return Placement(R_mesh_from_world=R.expand(frames, 3, 3), t_mesh_from_world=t.expand(frames, 3))


def march_mesh(rays: Rays, mesh: InsertedMesh, placement: Placement, *, count: int) -> Marched:
    """One sample for each ray whose pixel the mesh is seen in; its cell is the only row of `features`.

    Args:
        rays: Of any frames.
        mesh: The mesh.
        placement: Where it is in each frame.
        count: Intervals into which the box of the mesh cuts a ray.

    Raises:
        ValueError: If the count is below 1.
    """
    if count < 1:
        raise ValueError(f"count: expected 1 or more samples a ray, got {count}")
    share, depth, looked_at = _seen(rays, mesh, placement, count)
    ray = torch.nonzero(share > 0)[:, 0]
    return Marched(
        samples=Samples(ray=ray, depth=depth[ray], length=torch.zeros_like(depth[ray])),
        optical=optical_of_share(share[ray]),
        rows=torch.zeros_like(ray)[:, None],
        shares=torch.ones_like(depth[ray])[:, None],
        looked_at=looked_at,
    )


@torch.no_grad()
def _seen(
    rays: Rays, mesh: InsertedMesh, placement: Placement, count: int
) -> tuple[Float[Tensor, " rays"], Float[Tensor, " rays"], int]:
    """Share of each pixel that the mesh hides, how far away it is there (inf where not), and samples looked at."""
    share, depth = torch.zeros_like(rays.direction[:, 0]), torch.full_like(rays.direction[:, 0], torch.inf)
    looked_at = 0
    for some in torch.nonzero(_may_meet(rays, mesh, placement))[:, 0].split(PIXELS_AT_ONCE):
        finer = _through_pixels(rays[some])
        hidden, away, asked = _followed(_in_mesh(finer, placement), mesh, count)
        opacity = -torch.expm1(-hidden.unflatten(0, (len(some), SUBPIXELS**2)))
        total = opacity.sum(dim=1)
        share[some] = total / opacity.shape[1]
        mean = (opacity * away.unflatten(0, opacity.shape)).sum(dim=1) / total
        depth[some] = torch.where(total > 0, mean, torch.inf)
        looked_at += asked
    return share, depth, looked_at


def _in_mesh(rays: Rays, placement: Placement) -> Rays:
    """The rays in the frame of the mesh, but for how they change between pixels."""
    R, t = placement.R_mesh_from_world[rays.frame], placement.t_mesh_from_world[rays.frame]
    origin, direction = (torch.einsum("rab,rb->ra", R, each) for each in (rays.origin, rays.direction))
    return replace(rays, origin=origin + t, direction=direction)


def _may_meet(rays: Rays, mesh: InsertedMesh, placement: Placement) -> Bool[Tensor, " rays"]:
    """Whether any ray through the pixel of a ray may cross the mesh's box."""
    own = _in_mesh(rays, placement)
    middle, half = 0.5 * (mesh.low + mesh.high), 0.5 * (mesh.high - mesh.low).norm()
    farthest = (own.origin - middle).norm(dim=1) + half
    margin = (0.5 * (own.across.norm(dim=1) + own.down.norm(dim=1)) * farthest)[:, None]
    boxes = Boxes(low=mesh.low - margin, high=mesh.high + margin)
    return box_spans(replace(own, frame=torch.arange(len(own), device=own.frame.device)), boxes).met


def _through_pixels(rays: Rays) -> Rays:
    """Rays spread evenly over each pixel, those of a pixel together."""
    places = (torch.arange(SUBPIXELS, device=rays.frame.device) + 0.5) / SUBPIXELS - 0.5
    x, y = torch.cartesian_prod(places, places).T[:, None, :, None]
    direction = rays.direction[:, None] + x * rays.across[:, None] + y * rays.down[:, None]
    direction = (direction / direction.norm(dim=2, keepdim=True)).flatten(0, 1)
    each = SUBPIXELS**2
    return Rays(
        direction=direction,
        **{name: values.repeat_interleave(each, dim=0) for name, values in vars(rays).items() if name != "direction"},
    )


def _followed(rays: Rays, mesh: InsertedMesh, count: int) -> tuple[Float[Tensor, " rays"], Float[Tensor, " rays"], int]:
    """Optical depth of the mesh on each ray, where it is first met (0 where it is not), and samples looked at.

    All rays go on together. No sample within a ray's distance from the mesh is looked at; of what interpolates between
    distances on cubes, a metre changes no more than `STEEPEST`.
    """
    box = Boxes(low=mesh.low[None], high=mesh.high[None])
    spans = box_spans(replace(rays, frame=torch.zeros_like(rays.frame)), box)
    length = (spans.far - spans.near) / count
    hidden, first = torch.zeros_like(length), torch.full_like(length, torch.inf)
    ray = torch.nonzero(spans.met)[:, 0]
    number = torch.zeros_like(ray)
    looked_at = 0
    while len(ray):
        depth = spans.near[ray] + length[ray] * (number + 0.5)
        at = rays.origin[ray] + depth[:, None] * rays.direction[ray]
        away = fetched(mesh.distance, (at - mesh.low) / (mesh.high - mesh.low), mesh.size)[:, 0]
        looked_at += len(ray)
        inside = away < 0
        hidden = hidden.index_add(0, ray, torch.where(inside, mesh.density * length[ray], 0.0))
        first[ray] = torch.where(inside, torch.minimum(first[ray], depth), first[ray])
        clear = (away.clamp(min=0.0) / (STEEPEST * length[ray])).clamp(max=count)
        number = number + 1 + clear.long()
        on = torch.nonzero((number < count) & (hidden[ray] < OPAQUE))[:, 0]
        ray, number = ray[on], number[on]
    return hidden, torch.where(hidden > 0, first, 0.0), looked_at


def inserted_mask(
    shares: Float[Tensor, "*batch height width"], *, contour_px: int
) -> Float[Tensor, "*batch height width"]:
    """1 in pixels in which inserted meshes are seen, and within `contour_px` of them along rows and columns; else 0.

    Args:
        shares: How much of each pixel they are, 0 to 1.
        contour_px: Pixels about them on which an enhancer that has never seen such things leaves traces.

    Raises:
        ValueError: If the contour is below 0 pixels.
    """
    if contour_px < 0:
        raise ValueError(f"contour_px: expected 0 or more, got {contour_px}")
    seen = (shares > SEEN).to(shares.dtype).reshape(-1, 1, *shares.shape[-2:])
    return functional.max_pool2d(seen, 2 * contour_px + 1, stride=1, padding=contour_px).reshape(shares.shape)


def spared(
    enhanced: Float[Tensor, "*batch 3 height width"],
    rendered: Float[Tensor, "*batch 3 height width"],
    mask: Float[Tensor, "*batch height width"],
) -> Float[Tensor, "*batch 3 height width"]:
    """Enhanced pictures with the colours that were rendered where the mask is 1.

    Source: Menapace et al. 2023, appendix B.2.
    """
    return torch.lerp(enhanced, rendered, mask[..., None, :, :])
