"""Static worlds without a grid: a network is asked at every sample in their box."""

import torch
from jaxtyping import Float
from torch import Tensor, nn

from pgm_data.scene import SceneObject
from pgm_models.synthesis.bodies import THIN, Marched, density_of, joined_marched, nothing_marched
from pgm_models.synthesis.boxes import Boxes, Spans, box_spans
from pgm_models.synthesis.place_networks import NOTHING, PlaceNetwork, unit_rows
from pgm_models.synthesis.rays import Rays
from pgm_models.synthesis.samples import Samples, uniform_samples
from pgm_models.synthesis.worlds import WorldGrids, world_box

WAVES = 8
"""Frequencies of a place: down to a 256th of the world's length."""
RAYS_AT_ONCE = 4096
"""Followed together, which keeps the memory of a picture of any size small."""


class ComputedVolume(nn.Module):
    """The field of a box of the world, as `worlds.StaticVolume`; nothing is known of where it is empty."""

    low: Tensor
    high: Tensor

    def __init__(self, world: SceneObject, features: int, *, width: int) -> None:
        """A network of that many values; `width` as of `PlaceNetwork`."""
        super().__init__()
        for name, corner in zip(("low", "high"), world_box(world), strict=True):
            self.register_buffer(name, torch.as_tensor(corner, dtype=torch.float32), persistent=False)
        self.network = PlaceNetwork(3, features + 1, width=width, waves=WAVES)
        with torch.no_grad():
            self.network.out.bias[0] = -5.0  # about 0.7 / m, as a grown one's

    def grids(self) -> WorldGrids:
        """The unit vectors; there is no grid of density."""
        table = torch.eye(self.network.channels - 1, device=self.low.device)
        none = torch.full_like(table[:, :1], NOTHING)
        return WorldGrids(density=none, values=table, room=torch.zeros_like(none[:, 0], dtype=torch.int64))

    def march(
        self, rays: Rays, grids: WorldGrids, *, count: int, jitter: Float[Tensor, "rays count"] | None
    ) -> Marched:
        """Samples of the rays in which the world has density, in order; arguments as of `uniform_samples`."""
        boxes = Boxes(low=self.low[None], high=self.high[None])
        parts = [nothing_marched(rays, corners=grids.values.shape[1])]
        for own in torch.arange(len(rays), device=rays.frame.device).split(RAYS_AT_ONCE):
            some = rays[own]
            still = Rays(**{**vars(some), "frame": torch.zeros_like(some.frame)})
            found = self._marched(some, box_spans(still, boxes), count, None if jitter is None else jitter[own])
            samples = Samples(ray=own[found.samples.ray], depth=found.samples.depth, length=found.samples.length)
            parts.append(Marched(**{**vars(found), "samples": samples}))
        return joined_marched(parts)

    def _marched(self, rays: Rays, spans: Spans, count: int, jitter: Tensor | None) -> Marched:
        samples = uniform_samples(spans, count, jitter=jitter)
        points = rays.origin[samples.ray] + samples.depth[:, None] * rays.direction[samples.ray]
        told = self.network((points - self.low) / (self.high - self.low))
        density = density_of(told[:, 0])
        solid = torch.nonzero(density.detach() > THIN)[:, 0]
        values = told[solid, 1:]
        return Marched(
            samples=samples[solid],
            optical=density[solid] * samples.length[solid],
            rows=unit_rows(values),
            shares=values,
            looked_at=len(samples),
        )
