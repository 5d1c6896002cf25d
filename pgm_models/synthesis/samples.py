"""Samples along rays, packed: cut from spans, and composed into what each ray sees."""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from pgm_models.synthesis.boxes import Spans

OPAQUE = 40.0
"""Optical depth of what lets nothing through; exp(-40) is far below what float32 keeps beside 1."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Samples:
    """Intervals of rays, one row each."""

    ray: Int[Tensor, " samples"]
    """Ray that each is on."""
    depth: Float[Tensor, " samples"]
    """Of the interval's middle, metres along the ray."""
    length: Float[Tensor, " samples"]
    """Of the interval, metres."""

    def __getitem__(self, index: Tensor) -> "Samples":
        """Some of them."""
        return Samples(ray=self.ray[index], depth=self.depth[index], length=self.length[index])

    def __len__(self) -> int:
        """How many."""
        return len(self.ray)


def uniform_samples(spans: Spans, count: int, *, jitter: Float[Tensor, "rays count"] | None = None) -> Samples:
    """Each span that is met cut into `count` intervals, ordered by ray and depth.

    Args:
        spans: One a ray.
        count: Intervals of a span.
        jitter: Where in its interval each sample lies, 0 to 1; the middle without.

    Raises:
        ValueError: If the count is below 1.
    """
    if count < 1:
        raise ValueError(f"count: expected 1 or more samples a ray, got {count}")
    ray = torch.nonzero(spans.met)[:, 0]
    near, length = spans.near[ray], (spans.far - spans.near)[ray] / count
    place = torch.arange(count, device=ray.device) + (0.5 if jitter is None else jitter[ray])
    depth = near[:, None] + length[:, None] * place
    return Samples(ray=ray.repeat_interleave(count), depth=depth.flatten(), length=length.repeat_interleave(count))


def passed_before(ray: Int[Tensor, " samples"], optical: Float[Tensor, " samples"]) -> Float[Tensor, " samples"]:
    """Optical depth in front of each sample; samples ordered by ray, then depth.

    Sums run over all rays and are taken apart again, in float64: of millions of opaque samples 1e-8 is kept.
    """
    before = torch.cumsum(optical.double(), dim=0) - optical.double()
    first = torch.ones_like(ray, dtype=torch.bool)
    first[1:] = ray[1:] != ray[:-1]
    start = torch.cummax(torch.where(first, torch.arange(len(ray), device=ray.device), 0), dim=0).values
    return (before - before[start]).to(optical.dtype)


def weights_of(ray: Int[Tensor, " samples"], optical: Float[Tensor, " samples"]) -> Float[Tensor, " samples"]:
    """Share of what the ray sees that each sample is; samples ordered by ray, then depth.

    Source: Max 1995, Optical Models for Direct Volume Rendering, with each sample's own interval.
    """
    optical = optical.clamp(max=OPAQUE)
    return torch.exp(-passed_before(ray, optical)) * -torch.expm1(-optical)


def along_rays(samples: Samples) -> Int[Tensor, " samples"]:
    """The order of samples by ray, then by depth; of equal depths the earlier one comes first."""
    by_depth = torch.argsort(samples.depth, stable=True)
    return by_depth[torch.argsort(samples.ray[by_depth], stable=True)]


def summed(
    ray: Int[Tensor, " samples"], values: Float[Tensor, "samples *channels"], rays: int
) -> Float[Tensor, "rays *channels"]:
    """Sum of the values of each ray's samples."""
    return values.new_zeros(rays, *values.shape[1:]).index_add(0, ray, values)


def joined_samples(parts: Sequence[Samples]) -> tuple[Samples, Int[Tensor, " samples"]]:
    """All samples, and which of the parts each is from."""
    part = torch.cat([torch.full_like(samples.ray, number) for number, samples in enumerate(parts)])
    return Samples(
        ray=torch.cat([samples.ray for samples in parts]),
        depth=torch.cat([samples.depth for samples in parts]),
        length=torch.cat([samples.length for samples in parts]),
    ), part


def overlapping(first: Spans, second: Spans) -> Bool[Tensor, " rays"]:
    """Whether a ray is inside both at once somewhere."""
    return first.met & second.met & (torch.minimum(first.far, second.far) > torch.maximum(first.near, second.near))
