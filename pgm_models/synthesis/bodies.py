"""Bodies: one volume of density and features in the rest pose of a skeleton, bent into any pose."""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn
from torch.nn import functional

from pgm_data.skeleton import Skeleton
from pgm_models.synthesis.boxes import Boxes, Spans, box_spans
from pgm_models.synthesis.grids import Grown, corners_of, first_corners, mixed, near_any
from pgm_models.synthesis.rays import Rays
from pgm_models.synthesis.samples import Samples, joined_samples, uniform_samples
from pgm_models.synthesis.skinning import Poses, Skinning

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


def body_boxes(poses: Poses, skinning: Skinning) -> Boxes:
    """Boxes outside which the skinning has no weight; inside out, and never met, where it has none at all."""
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
    """Of the rest pose, before `density_of`."""
    values: Float[Tensor, "cells inputs"]
    """What is dressed."""
    weights: Float[Tensor, "weight_cells joints"]
    """Of the skinning."""


class Body(nn.Module):
    """The field of all players of one skeleton."""

    def __init__(self, skeleton: Skeleton, size: tuple[int, int, int], features: int, *, width: int, seed: int) -> None:
        """A volume of that many cells along the rest pose's x, y and z, with that many values each."""
        super().__init__()
        self.size = size
        self.skinning = Skinning(skeleton, size, width=max(width // 2, 4), seed=seed + 1)
        self.grown = Grown(size, features + 1, width=width, seed=seed)
        bias = self.grown.out.bias
        assert bias is not None
        with torch.no_grad():
            bias[0] = -3.0  # about 5 / m: a body is seen through at first, yet seen

    def grids(self) -> BodyGrids:
        """What the networks make."""
        cells = self.grown()
        return BodyGrids(density=cells[:, :1].contiguous(), values=cells[:, 1:].contiguous(), weights=self.skinning())

    def march(
        self, rays: Rays, poses: Poses, grids: BodyGrids, *, count: int, jitter: Float[Tensor, "rays count"] | None
    ) -> Marched:
        """Samples of the rays in which the body of their frame has density; arguments as of `uniform_samples`.

        Exact, yet only what can have any is looked at: samples where limbs weigh, and of those, now in the rest pose,
        the ones beside a cell with density.
        """
        boxes = body_boxes(poses, self.skinning)
        weights = self.skinning.weights_of(grids.weights)
        solid = near_any(density_of(grids.density.detach() + SLACK) > 0, self.size)[:, 0]
        parts = [nothing_marched(rays, corners=8)]
        for number in torch.nonzero(poses.present)[:, 0].tolist():
            spans_of, which = _met(rays, torch.nonzero(rays.frame == number)[:, 0], boxes)
            at_once = max(SAMPLES_AT_ONCE // count, 1)
            for start in range(0, len(which), at_once):
                ray = which[start : start + at_once]
                spans = Spans(near=spans_of.near[start : start + at_once], far=spans_of.far[start : start + at_once])
                samples = uniform_samples(spans, count, jitter=None if jitter is None else jitter[ray])
                carried = self.skinning.carried_samples(rays[ray], spans, samples, poses, number, weights)
                near, rest, share = self.skinning.blended(carried, len(samples), weights)
                places = self.skinning.places(rest)
                beside = torch.nonzero(solid[first_corners(places, self.size)])[:, 0]
                cells, shares = corners_of(places[beside], self.size)
                found = density_of(mixed(grids.density, cells, shares)[:, 0]) * share[beside]
                dense = torch.nonzero(found.detach() > THIN)[:, 0]
                own = samples[near[beside[dense]]]
                parts.append(
                    Marched(
                        samples=Samples(ray=ray[own.ray], depth=own.depth, length=own.length),
                        optical=found[dense] * own.length,
                        rows=cells[dense],
                        shares=shares[dense],
                        looked_at=len(beside),
                    )
                )
        return joined_marched(parts)


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
