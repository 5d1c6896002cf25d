"""Fields that are computed where they are asked for: by networks of a place, not between the cells of a grid.

As a grid's, the values of a place are a sum of a table's rows: here of the unit vectors, weighted by the values.
"""

import math

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

LAYERS = 4
"""Hidden layers."""
WIDER = 4
"""Channels of a hidden layer for one of the finest layer that grows a grid."""
NOTHING = -20.0
"""What stands for the density of a grid that is not there; `density_of` makes nothing of it."""


class PlaceNetwork(nn.Module):
    """Values at places, by layers of numbers.

    Source: Mildenhall et al. 2020, NeRF, section 5.1, with half its layers and without its view directions.
    """

    octaves: Tensor

    def __init__(self, axes: int, channels: int, *, width: int, waves: int, told: int = 0) -> None:
        """Fresh weights.

        Args:
            axes: Numbers of a place.
            channels: Numbers of a value.
            width: As of `Grown`: of hidden layers there are `WIDER` times as many channels.
            waves: Frequencies along each axis, the first of one period for the field's whole length, each double the
                one before.
            told: Numbers that it is told beside the places, the same for all of them.
        """
        super().__init__()
        self.channels = channels
        hidden = WIDER * width
        sizes = [axes * (1 + 2 * waves) + told, *[hidden] * LAYERS]
        self.layers = nn.ModuleList(nn.Linear(before, after) for before, after in zip(sizes, sizes[1:], strict=False))
        self.out = nn.Linear(hidden, channels)
        self.register_buffer("octaves", 2 * math.pi * 2.0 ** torch.arange(waves), persistent=False)

    def forward(
        self, places: Float[Tensor, "points axes"], told: Float[Tensor, " told"] | None = None
    ) -> Float[Tensor, "points channels"]:
        """The values at places, each 0 to 1 along every axis inside the field."""
        phase = (places[:, :, None] * self.octaves).flatten(1)
        here = [2 * places - 1, torch.sin(phase), torch.cos(phase)]
        here = torch.cat(here if told is None else [*here, told.expand(len(places), -1)], dim=1)
        for layer in self.layers:
            here = nn.functional.silu(layer(here))
        # Wherever networks are computed with fewer digits, values have all of them.
        return self.out(here).to(places.dtype)


def unit_rows(values: Float[Tensor, "points channels"]) -> Int[Tensor, "points channels"]:
    """Rows of a table of unit vectors, for values that are their weights."""
    return torch.arange(values.shape[1], device=values.device).expand(len(values), -1)
