"""Meshes inserted into a rendered scene: of one colour, fixed to a joint or to the world.

Like the ball, a mesh may be narrower than a pixel: several rays through each pixel are followed through its grid of
distances, and the pixel sees their mean. Source: Menapace et al. 2023, appendix B.2, where the joint's blending weights
are raised about the mesh; here the mesh follows the joint exactly, at its own size.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

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
    colour: Float[Tensor, "1 3"]
    """Of all of it, RGB 0 to 1."""

    @property
    def intervals(self) -> int:
        """Into how many a ray's way through the grid's box is cut: none is longer than a cell."""
        cells = torch.tensor([count - 1 for count in self.size], device=self.low.device)
        cell = ((self.high - self.low) / cells.clamp(min=1)).amax()
        return max(1, math.ceil(float((self.high - self.low).norm() / cell)))

    def to(self, device: torch.device | str) -> "InsertedMesh":
        """The same on a device."""
        moved = {name: value.to(device) for name, value in vars(self).items() if isinstance(value, Tensor)}
        return replace(self, **moved)


def inserted_mesh(grid: DistanceGrid, *, colour: tuple[float, float, float], density: float = SOLID) -> InsertedMesh:
    """The mesh of a grid of distances in one colour, RGB 0 to 1.

    Raises:
        ValueError: If the colour is not 0 to 1, or the density not above 0.
    """
    if not all(0 <= part <= 1 for part in colour):
        raise ValueError(f"colour: expected RGB 0 to 1, got {colour}")
    if not density > 0:
        raise ValueError(f"density: expected above 0 / m, got {density}")
    x, y, z = grid.distance.shape
    return InsertedMesh(
        low=torch.as_tensor(grid.low, dtype=torch.float32),
        high=torch.as_tensor(grid.high, dtype=torch.float32),
        size=(x, y, z),
        distance=torch.as_tensor(grid.distance.reshape(-1, 1), dtype=torch.float32),
        density=density,
        colour=torch.tensor([colour]),
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


@dataclass(frozen=True, eq=False, kw_only=True)
class Insertion:
    """Meshes that move together: with a joint of a player, or not at all."""

    meshes: tuple[InsertedMesh, ...]
    player: str
    """The player object that they move with; empty where they stand still."""
    joint: int
    """Of the player's skeleton; 0 where they stand still."""
    R: Float[np.ndarray, "3 3"]
    """R_joint_from_mesh, of all meshes; R_world_from_mesh where they stand still."""
    t: Float[np.ndarray, " 3"]
    """The translation with it, metres."""

    def to(self, device: torch.device | str) -> "Insertion":
        """The same on a device."""
        return replace(self, meshes=tuple(mesh.to(device) for mesh in self.meshes))

    def placement(self, poses: Mapping[str, Poses], frames: int) -> Placement | None:
        """Where the meshes are in each of some frames; None without the player.

        Raises:
            ValueError: If the player has no such joint.
        """
        if not self.player:
            return fixed_in_world(self.R, self.t, frames, device=self.meshes[0].low.device)
        if self.player not in poses:
            return None
        return fixed_to_joint(poses[self.player], self.joint, self.R, self.t)


@dataclass(frozen=True, eq=False, kw_only=True)
class Placed:
    """A mesh where it is in each frame of a batch."""

    mesh: InsertedMesh
    placement: Placement
    near: Int[Tensor, " some"] | None = None
    """The rays that may meet it; all of them where None."""

    def boxes(self) -> Boxes:
        """A box of the world about the mesh in each frame."""
        ends = torch.stack([self.mesh.low, self.mesh.high])
        corners = torch.stack([ends[list(which), [0, 1, 2]] for which in product((0, 1), repeat=3)])
        R, t = self.placement.R_mesh_from_world, self.placement.t_mesh_from_world
        world = (corners - t[:, None]) @ R
        return Boxes(low=world.amin(dim=1), high=world.amax(dim=1))


def placed_meshes(insertions: Sequence[Insertion], poses: Mapping[str, Poses], frames: int) -> list[Placed]:
    """All meshes that are there; those of players who are not there are left out.

    Raises:
        ValueError: As `Insertion.placement`.
    """
    found = [(each, each.placement(poses, frames)) for each in insertions]
    return [Placed(mesh=mesh, placement=at) for each, at in found if at is not None for mesh in each.meshes]


def march_mesh(rays: Rays, mesh: InsertedMesh, placement: Placement, *, count: int) -> Marched:
    """One sample for each ray whose pixel the mesh is seen in; its cell is the only row of `colour`.

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
