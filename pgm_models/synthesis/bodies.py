"""Bodies: one volume of density and features in the rest pose of a skeleton, bent into any pose."""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn
from torch.nn import functional

from pgm_data.skeleton import Skeleton
from pgm_models.synthesis.boxes import Boxes, Spans, box_spans
from pgm_models.synthesis.deformations import PoseNetwork
from pgm_models.synthesis.grids import Grown, corners_of, first_corners, mixed, near_any
from pgm_models.synthesis.place_networks import NOTHING, PlaceNetwork, unit_rows
from pgm_models.synthesis.presets import SynthesisDesign
from pgm_models.synthesis.rays import Rays
from pgm_models.synthesis.samples import Samples, joined_samples, uniform_samples
from pgm_models.synthesis.skinning import Poses, Skinning, Weights

WAVES = 6
"""Frequencies of a place in a body that is computed: down to a 64th of its height."""
THIN = 1e-3
"""Density below which there is nothing, 1/m."""
DENSITY_SCALE = 100.0
"""Density of what a network says with 1, 1/m."""
SLACK = 1e-3
"""Added to what a network says where cells without density are skipped: more than interpolation's rounding."""
SAMPLES_AT_ONCE = 1 << 18
"""Upper bound, which keeps the memory of a picture of any size small."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Marched:
    """Samples of rays in a volume."""

    samples: Samples
    optical: Float[Tensor, " samples"]
    """Optical depth of each one's interval."""
    rows: Int[Tensor, "samples corners"]
    """Cells of the volume about it."""
    shares: Float[Tensor, "samples corners"]
    """Their weights."""
    looked_at: int
    """Samples whose density was asked for, those without any included."""


def density_of(raw: Float[Tensor, "*batch"]) -> Float[Tensor, "*batch"]:
    """Density, 1/m, of what a volume holds; nothing below `THIN`."""
    density = DENSITY_SCALE * functional.softplus(raw)
    return torch.where(density > THIN, density, 0.0)


def body_boxes(poses: Poses, skinning: Skinning | PoseNetwork) -> Boxes:
    """Boxes beyond what belongs to any joint; inside out, and never met, where nothing does."""
    corners = torch.cartesian_prod(*[torch.arange(2, device=skinning.reach.device)] * 3)
    reach = skinning.reach.transpose(0, 1)  # low and high, joints, 3
    at = torch.stack([reach[corners[:, axis], :, axis] for axis in range(3)], dim=-1)  # corners, joints, 3
    rests = torch.isfinite(at).all(dim=-1).all(dim=0)
    # T_j is a scaled rotation: its inverse is its transpose over the square of the scale.
    offset = torch.where(rests[:, None], at, 0.0) - poses.translation[:, None]
    world = torch.einsum("fjab,fcja->fcjb", poses.rotation, offset)
    world = world / poses.scale.square()[:, None, None, None]
    low, high = (torch.where(rests[:, None], world, beyond) for beyond in (torch.inf, -torch.inf))
    return Boxes(low=low.amin(dim=(1, 2)), high=high.amax(dim=(1, 2)))


@dataclass(frozen=True, eq=False, kw_only=True)
class BodyGrids:
    """What a body's networks make, the same for all frames."""

    density: Float[Tensor, "cells 1"]
    """Of the rest pose, before `density_of`; nothing where it is computed at each sample."""
    values: Float[Tensor, "cells inputs"]
    """What is dressed."""
    weights: Float[Tensor, "weight_cells joints"]
    """Of the skinning; none where a network deforms."""


class Body(nn.Module):
    """The field of all players of one skeleton."""

    def __init__(
        self,
        skeleton: Skeleton,
        size: tuple[int, int, int],
        features: int,
        *,
        width: int,
        seed: int,
        design: SynthesisDesign | None = None,
    ) -> None:
        """A volume of that many cells along the rest pose's x, y and z, with that many values each.

        Of a design it is told what holds the volume, and what takes samples there.
        """
        super().__init__()
        design = design or SynthesisDesign()
        self.size = size
        self.skinning: Skinning | PoseNetwork
        if design.deformation == "skinning":
            self.skinning = Skinning(skeleton, size, width=max(width // 2, 4), seed=seed + 1)
        else:
            self.skinning = PoseNetwork(skeleton, width=width)
        self.grown: Grown | PlaceNetwork
        if design.volumes == "voxels":
            self.grown = Grown(size, features + 1, width=width, seed=seed)
        else:
            self.grown = PlaceNetwork(3, features + 1, width=width, waves=WAVES)
        bias = self.grown.out.bias
        assert bias is not None
        with torch.no_grad():
            bias[0] = -3.0  # about 5 / m: a body is seen through at first, yet seen

    def grids(self) -> BodyGrids:
        """What the networks make that hangs on no sample."""
        if isinstance(self.grown, Grown):
            cells = self.grown()
            density, values = cells[:, :1].contiguous(), cells[:, 1:].contiguous()
        else:
            values = torch.eye(self.grown.channels - 1, device=self.skinning.reach.device)
            density = torch.full_like(values[:, :1], NOTHING)
        if isinstance(self.skinning, Skinning):
            return BodyGrids(density=density, values=values, weights=self.skinning())
        return BodyGrids(density=density, values=values, weights=density.new_zeros(0, len(self.skinning.reach)))

    def march(
        self, rays: Rays, poses: Poses, grids: BodyGrids, *, count: int, jitter: Float[Tensor, "rays count"] | None
    ) -> Marched:
        """Samples of the rays in which the body of their frame has density; arguments as of `uniform_samples`.

        Exact, yet only what can have any is looked at: samples where limbs weigh, and of those, now in the rest pose,
        the ones beside a cell with density.
        """
        boxes = body_boxes(poses, self.skinning)
        weights = self.skinning.weights_of(grids.weights) if isinstance(self.skinning, Skinning) else None
        solid, corners = None, grids.values.shape[1]
        if isinstance(self.grown, Grown):
            solid, corners = near_any(density_of(grids.density.detach() + SLACK) > 0, self.size)[:, 0], 8
        parts = [nothing_marched(rays, corners=corners)]
        for number in torch.nonzero(poses.present)[:, 0].tolist():
            spans_of, which = _met(rays, torch.nonzero(rays.frame == number)[:, 0], boxes)
            at_once = max(SAMPLES_AT_ONCE // count, 1)
            for start in range(0, len(which), at_once):
                ray = which[start : start + at_once]
                spans = Spans(near=spans_of.near[start : start + at_once], far=spans_of.far[start : start + at_once])
                samples = uniform_samples(spans, count, jitter=None if jitter is None else jitter[ray])
                near, places, share = self._rested(rays[ray], spans, samples, (poses, number), weights)
                beside, raw, rows, shares = self._looked_up(places, grids, solid)
                found = density_of(raw) * share[beside]
                dense = torch.nonzero(found.detach() > THIN)[:, 0]
                own = samples[near[beside[dense]]]
                parts.append(
                    Marched(
                        samples=Samples(ray=ray[own.ray], depth=own.depth, length=own.length),
                        optical=found[dense] * own.length,
                        rows=rows[dense],
                        shares=shares[dense],
                        looked_at=len(beside),
                    )
                )
        return joined_marched(parts)

    def _rested(
        self, rays: Rays, spans: Spans, samples: Samples, body: tuple[Poses, int], weights: Weights | None
    ) -> tuple[Int[Tensor, " kept"], Float[Tensor, "kept 3"], Float[Tensor, " kept"]]:
        """Samples that may be in a frame's body, their places in the rest pose's volume, and how far they belong."""
        if isinstance(self.skinning, PoseNetwork):
            near, rest = self.skinning.rested_samples(rays, samples, *body)
            return near, self.skinning.places(rest), torch.ones_like(rest[:, 0])
        assert weights is not None
        carried = self.skinning.carried_samples(rays, spans, samples, *body, weights)
        near, rest, share = self.skinning.blended(carried, len(samples), weights)
        return near, self.skinning.places(rest), share

    def _looked_up(
        self, places: Float[Tensor, "points 3"], grids: BodyGrids, solid: Bool[Tensor, " cells"] | None
    ) -> tuple[
        Int[Tensor, " kept"], Float[Tensor, " kept"], Int[Tensor, "kept corners"], Float[Tensor, "kept corners"]
    ]:
        """Places that may have density, what the volume says of it there, and what they are dressed of."""
        if isinstance(self.grown, PlaceNetwork):
            told = self.grown(places)
            every = torch.arange(len(places), device=places.device)
            return every, told[:, 0], unit_rows(told[:, 1:]), told[:, 1:]
        assert solid is not None
        beside = torch.nonzero(solid[first_corners(places, self.size)])[:, 0]
        cells, shares = corners_of(places[beside], self.size)
        return beside, mixed(grids.density, cells, shares)[:, 0], cells, shares


def _met(rays: Rays, own: Int[Tensor, " some"], boxes: Boxes) -> tuple[Spans, Int[Tensor, " met"]]:
    """Which of some rays meet the box of their frame, and where."""
    met, near, far = [own[:0]], [rays.direction[:0, 0]], [rays.direction[:0, 0]]
    for some in own.split(SAMPLES_AT_ONCE):
        spans = box_spans(rays[some], boxes)
        kept = torch.nonzero(spans.met)[:, 0]
        met.append(some[kept])
        near.append(spans.near[kept])
        far.append(spans.far[kept])
    return Spans(near=torch.cat(near), far=torch.cat(far)), torch.cat(met)


def joined_marched(parts: Sequence[Marched]) -> Marched:
    """All of them, in order."""
    return Marched(
        samples=joined_samples([part.samples for part in parts])[0],
        optical=torch.cat([part.optical for part in parts]),
        rows=torch.cat([part.rows for part in parts]),
        shares=torch.cat([part.shares for part in parts]),
        looked_at=sum(part.looked_at for part in parts),
    )


def nothing_marched(rays: Rays, *, corners: int) -> Marched:
    """No sample."""
    none, nowhere = rays.direction.new_zeros(0), rays.frame.new_zeros(0)
    return Marched(
        samples=Samples(ray=nowhere, depth=none, length=none),
        optical=none,
        rows=nowhere[:, None].expand(0, corners),
        shares=none[:, None].expand(0, corners),
        looked_at=0,
    )
