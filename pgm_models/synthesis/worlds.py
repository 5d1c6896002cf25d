"""Static worlds: one volume of density and features in a box of the world that nothing moves.

Most of such a box is air. A ray looks only where density may be: cubes between cells that all hold nothing, by the rule
of `density_of`, are passed over, in long steps where the nearest other one is far, and behind what lets nothing
through it does not look. Neither changes what is seen: the first leaves out zeros, the second less than float32 keeps.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn

from pgm_data.scene import SceneObject
from pgm_models.synthesis.bodies import DENSITY_SCALE, THIN, Marched, density_of, nothing_marched
from pgm_models.synthesis.boxes import Boxes, Spans, box_spans
from pgm_models.synthesis.grids import Grown, corners_of, finer, mixed
from pgm_models.synthesis.rays import Rays
from pgm_models.synthesis.samples import Samples, joined_samples, uniform_samples

ENOUGH = 17.0
"""Optical depth behind which a ray does not look: exp(-17) is less than float32 keeps beside 1."""
BURST = 4
"""Samples of a ray that are looked at before asking whether it sees on, and how far it is in air."""
RAYS_AT_ONCE = 16384
"""Followed together on a CPU, whose caches hold no more."""
OWN = 10.0
"""How many times faster than the network's weights what cells hold of their own is learned."""
FAINT = 2.0
"""Density below which training may take what a cell holds for air, 1/m."""
AIR = 4e-3
"""What a world all of whose cells are just too dense for air adds to the loss."""
ROUNDING = 1e-3
"""Relative to what cells hold: what interpolating between cells may add to the greatest of them, and more."""


def world_box(world: SceneObject) -> Float[np.ndarray, "2 3"]:
    """Lowest and highest corner of a static object, metres: its region; without one its box on the origin's ground.

    Raises:
        ValueError: If a side is below 0 or no number.
    """
    if world.region_m:
        box = np.array(world.region_m, dtype=np.float64)
    else:
        size = np.array(world.box_m, dtype=np.float64)
        low = np.array([-0.5 * size[0], -0.5 * size[1], 0.0])
        box = np.stack([low, low + size])
    if not (np.isfinite(box).all() and (box[1] >= box[0]).all()):
        raise ValueError(f"{world.name}: expected a box, its lower corner first, got {box.tolist()}")
    return box


def world_cells(world: SceneObject, voxels: int) -> tuple[int, int, int]:
    """Cells along x, y and z, as close to cubes as `voxels` along the longest side allow; never more than the scene's.

    A side of 0 m has one.

    Raises:
        ValueError: If `voxels` is below 2, or the scene does not say how many cells it wants along each axis.
    """
    if voxels < 2:
        raise ValueError(f"voxels: expected 2 or more, got {voxels}")
    if len(world.grid) != 3:
        raise ValueError(f"{world.name}.radiance.grid: expected the cells along x, y and z, got {world.grid}")
    sides = np.subtract(*world_box(world)[::-1])
    longest = int(sides.argmax())
    steps = max(min(voxels, world.grid[longest]) - 1, 1)
    # The first and the last cell lie on the faces of the box: there is one more of them than of steps.
    wanted = np.rint(sides / max(sides[longest] / steps, np.finfo(float).tiny)).astype(int) + 1
    x, y, z = (int(min(cells, most)) for cells, most in zip(wanted, world.grid, strict=True))
    return x, y, z


@dataclass(frozen=True, eq=False, kw_only=True)
class WorldGrids:
    """What a world's networks make, the same for all frames."""

    density: Float[Tensor, "cells 1"]
    """Before `density_of`."""
    values: Float[Tensor, "cells inputs"]
    """What is dressed."""
    room: Int[Tensor, " cells"]
    """Of the cube that begins at each cell: cubes along any axis, and all between them, in which nothing is; a lower
    bound. -1 where the cube itself holds something."""


class StaticVolume(nn.Module):
    """The field of a box of the world.

    Convolutions make what cells have in common with their neighbours; what each holds beside it is its own. A room has
    more to tell than the few weights of a network that grows it can say, and pictures that show it from all sides; a
    body's network has many poses to learn from. What is in common needs fewer cells: it is made coarser, and
    interpolated.
    """

    low: Tensor
    high: Tensor

    def __init__(
        self, world: SceneObject, features: int, *, voxels: int, width: int, seed: int, grown: int | None = None
    ) -> None:
        """A volume of at most that many voxels along its longest side (see `world_cells`), with that many values each.

        At most `grown` along that side are made by convolutions; all without it.

        Raises:
            ValueError: As `world_cells`.
        """
        super().__init__()
        self.size = world_cells(world, voxels)
        coarse = self.size if grown is None or grown >= voxels else world_cells(world, grown)
        low, high = world_box(world)
        self.register_buffer("low", torch.as_tensor(low, dtype=torch.float32))
        self.register_buffer("high", torch.as_tensor(high, dtype=torch.float32))
        self.grown = Grown(coarse, features + 1, width=width, seed=seed)
        self.own = nn.Parameter(torch.zeros(math.prod(self.size), features + 1))
        bias = self.grown.out.bias
        assert bias is not None
        with torch.no_grad():
            bias[0] = -5.0  # about 0.7 / m: through metres of it something is still seen

    def grids(self) -> WorldGrids:
        """What the network makes, and what cells hold of their own."""
        cells = finer(self.grown(), self.grown.size, self.size) + OWN * self.own
        return world_grids(cells[:, :1].contiguous(), cells[:, 1:].contiguous(), self.size)

    def spans(self, rays: Rays) -> Spans:
        """Where each ray is inside the box."""
        still = replace(rays, frame=torch.zeros_like(rays.frame))
        return box_spans(still, Boxes(low=self.low[None], high=self.high[None]))

    def places(self, points: Float[Tensor, "points 3"]) -> Float[Tensor, "points 3"]:
        """Points of the world as places in the grid, 0 to 1 inside."""
        return (points - self.low) / (self.high - self.low)

    def march(
        self, rays: Rays, grids: WorldGrids, *, count: int, jitter: Float[Tensor, "rays count"] | None
    ) -> Marched:
        """Samples of the rays in which the world has density, in order; arguments as of `uniform_samples`.

        They are those of `march_densely` less the ones that are hidden behind `ENOUGH`.

        Raises:
            ValueError: If the count is below 1.
        """
        if count < 1:
            raise ValueError(f"count: expected 1 or more samples a ray, got {count}")
        at_once = RAYS_AT_ONCE if rays.direction.device.type == "cpu" else max(len(rays), 1)
        parts = []
        for start in range(0, len(rays), at_once):
            own = slice(start, start + at_once)
            part = Rays(**{name: values[own] for name, values in vars(rays).items()})
            found = self._followed(part, grids, count, None if jitter is None else jitter[own])
            parts.append(replace(found, samples=replace(found.samples, ray=found.samples.ray + start)))
        return _joined_marches(parts) if parts else nothing_marched(rays, corners=8)

    def march_densely(
        self, rays: Rays, grids: WorldGrids, *, count: int, jitter: Float[Tensor, "rays count"] | None
    ) -> Marched:
        """The same with every sample in the box looked at: the reference, and what skipping is measured against."""
        samples = uniform_samples(self.spans(rays), count, jitter=jitter)
        density, rows, shares = self._looked_up(places_along(self._lines(rays), samples.ray, samples.depth), grids)
        solid = torch.nonzero(density.detach() > 0)[:, 0]
        return Marched(
            samples=samples[solid],
            optical=(density * samples.length)[solid],
            rows=rows[solid],
            shares=shares[solid],
            looked_at=len(samples),
        )

    def _followed(
        self, rays: Rays, grids: WorldGrids, count: int, jitter: Float[Tensor, "rays count"] | None
    ) -> Marched:
        """The samples of some rays: all rays go on together, each as far as it sees air, or `BURST` intervals."""
        spans, lines = self.spans(rays), self._lines(rays)
        length = (spans.far - spans.near) / count
        # Cubes that an interval passes along the axis in which it passes most.
        passed = (length * (rays.direction.abs() * self._cubes_per_metre()).amax(dim=1)).clamp(min=ROUNDING)
        burst = torch.arange(BURST, device=length.device)
        hidden, looked_at = torch.zeros_like(length), 0
        ray = torch.nonzero(spans.met)[:, 0]
        number = torch.zeros_like(ray)
        found: list[tuple[Tensor, Samples, Tensor, Tensor, Tensor]] = []
        while len(ray):
            room = grids.room[self._cube(places_along(lines, ray, spans.near[ray] + length[ray] * number))]
            # One cube of the room for where in its own cube the ray is, and a little for rounding.
            air = ((room - 1).clamp(min=0) * (1 - ROUNDING) / passed[ray]).clamp(max=count).long()
            near = torch.nonzero(air < BURST)[:, 0]
            here, which = ray[near].repeat_interleave(BURST), (number[near, None] + burst).flatten()
            inside = torch.nonzero(which < count)[:, 0]
            here, which = here[inside], which[inside]
            own = length[here]
            samples = Samples(
                ray=here,
                depth=spans.near[here] + own * (which + (0.5 if jitter is None else jitter[here, which])),
                length=own,
            )
            places = places_along(lines, here, samples.depth)
            held = torch.nonzero(grids.room[self._cube(places)] < 0)[:, 0]
            density, cells, weights = self._looked_up(places[held], grids)
            looked_at += len(held)
            solid = torch.nonzero(density.detach() > 0)[:, 0]
            optical, some = density[solid] * own[held[solid]], samples[held[solid]]
            found.append((some.ray * count + which[held[solid]], some, optical, cells[solid], weights[solid]))
            hidden = hidden.index_add(0, some.ray, optical.detach())
            number = number + air.clamp(min=BURST)
            on = torch.nonzero((number < count) & (hidden[ray] < ENOUGH))[:, 0]
            ray, number = ray[on], number[on]
        if not found:
            return nothing_marched(rays, corners=8)
        order = torch.argsort(torch.cat([key for key, *_ in found]))
        samples, _ = joined_samples([some for _, some, *_ in found])
        return Marched(
            samples=samples[order],
            optical=torch.cat([optical for _, _, optical, _, _ in found]).index_select(0, order),
            rows=torch.cat([rows for *_, rows, _ in found]).index_select(0, order),
            shares=torch.cat([shares for *_, shares in found]).index_select(0, order),
            looked_at=looked_at,
        )

    def _looked_up(
        self, places: Float[Tensor, "points 3"], grids: WorldGrids
    ) -> tuple[Float[Tensor, " points"], Int[Tensor, "points corners"], Float[Tensor, "points corners"]]:
        rows, shares = corners_of(places, self.size)
        return density_of(mixed(grids.density, rows, shares)[:, 0]), rows, shares

    def _lines(self, rays: Rays) -> tuple[Float[Tensor, "rays 3"], Float[Tensor, "rays 3"]]:
        """Where in the grid each ray begins, and what a metre of it adds."""
        side = self.high - self.low
        return (rays.origin - self.low) / side, rays.direction / side

    def _cube(self, places: Float[Tensor, "points 3"]) -> Int[Tensor, " points"]:
        """The cell at which the cube begins that holds each place, as `corners_of` has it."""
        steps = torch.as_tensor(self.size, device=places.device) - 1
        first = torch.minimum((places.clamp(0.0, 1.0) * steps).floor(), (steps - 1).clamp(min=0)).long()
        return (first[:, 0] * self.size[1] + first[:, 1]) * self.size[2] + first[:, 2]

    def _cubes_per_metre(self) -> Float[Tensor, " 3"]:
        return (torch.as_tensor(self.size, device=self.low.device) - 1) / (self.high - self.low)


def places_along(
    lines: tuple[Float[Tensor, "rays 3"], Float[Tensor, "rays 3"]],
    ray: Int[Tensor, " points"],
    depth: Float[Tensor, " points"],
) -> Float[Tensor, "points 3"]:
    """Where points at those depths of rays lie, given where each ray begins and what a metre of it adds."""
    start, step = lines
    return torch.addcmul(start.index_select(0, ray), depth[:, None], step.index_select(0, ray))


def world_grids(
    density: Float[Tensor, "cells 1"], values: Float[Tensor, "cells inputs"], size: tuple[int, int, int]
) -> WorldGrids:
    """Grids of those cells, with the room about each cube; the last axis varies fastest."""
    return WorldGrids(density=density, values=values, room=room_of(density.detach()[:, 0], size))


def faintness(grids: WorldGrids) -> Float[Tensor, ""]:
    """How far cells are above nothing, from 0 where all is air, no more than 1: what training may hold down.

    Pictures alone hardly empty air: the thinner it is the less it shows. What is thinner than `FAINT` is
    pulled to nothing evenly, however thin; what is denser, not at all.
    """
    low, high = (math.log(math.expm1(density / DENSITY_SCALE)) for density in (0.5 * THIN, FAINT))
    return ((grids.density - low) / (high - low)).clamp(0.0, 1.0).mean()


def air_loss(worlds: Mapping[str, WorldGrids]) -> Float[Tensor, ""]:
    """What training adds to its loss for worlds that hold thin air, at least one: `AIR` of their `faintness`."""
    return AIR * torch.stack([faintness(grids) for grids in worlds.values()]).sum()


def room_of(raw: Float[Tensor, " cells"], size: tuple[int, int, int]) -> Int[Tensor, " cells"]:
    """Room about each cube, as `WorldGrids` has it, of what cells hold before `density_of`."""
    # Between cells there is never more than the greatest of them, rounding apart.
    filled = density_of(raw + ROUNDING * (1 + raw.abs())).unflatten(0, size) > 0
    for axis in range(3):
        nothing = torch.zeros_like(filled.narrow(axis, 0, 1))
        if size[axis] > 1:
            filled = torch.cat([_joined(filled, axis), nothing], dim=axis)
    room = torch.where(filled, -1, 0)
    reach, radius = filled, 0
    while radius < max(size):
        # What has grown by r on both sides grows by up to 2 r + 1 more where it meets itself moved both ways.
        more = max(1, radius // 2)
        radius += more
        for axis in range(3):
            reach = _moved(reach, more, axis) | reach | _moved(reach, -more, axis)
        room = torch.where(reach, room, radius)
    return room.flatten()


def _joined(filled: Bool[Tensor, "x y z"], axis: int) -> Bool[Tensor, "..."]:
    """Whether either of two neighbours is filled."""
    count = filled.shape[axis] - 1
    return filled.narrow(axis, 0, count) | filled.narrow(axis, 1, count)


def _moved(filled: Bool[Tensor, "x y z"], by: int, axis: int) -> Bool[Tensor, "x y z"]:
    """The cubes moved along an axis; those that leave are lost, and nothing comes in."""
    count = filled.shape[axis]
    moved = torch.zeros_like(filled)
    kept = count - abs(by)
    if kept > 0:
        moved.narrow(axis, max(by, 0), kept).copy_(filled.narrow(axis, max(-by, 0), kept))
    return moved


def _joined_marches(parts: list[Marched]) -> Marched:
    """All of them, in order."""
    return Marched(
        samples=joined_samples([part.samples for part in parts])[0],
        optical=torch.cat([part.optical for part in parts]),
        rows=torch.cat([part.rows for part in parts]),
        shares=torch.cat([part.shares for part in parts]),
        looked_at=sum(part.looked_at for part in parts),
    )
