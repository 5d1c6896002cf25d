"""How the animation network is told its noise, its framerate and what is known: by the scales of its weights.

The condition becomes one vector a sample; from it each modulated layer gets a scale for each of its inputs, by which
its weights are multiplied and then brought back to unit length (`pgm_models.modulation`).
"""

import math

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn
from torch.nn import functional

LONGEST_WAVE = 80.0
"""Wave length of the slowest sine; log-SNRs lie in -20..20, logarithms of framerates in 0..4."""
SHORTEST_WAVE = 0.5
"""Wave length of the fastest sine."""
WAVES = 32
"""Sines of one number, and as many cosines."""


def waves(values: Float[Tensor, " B"]) -> Float[Tensor, "B waves"]:
    """Sines and cosines of the values at wave lengths from `SHORTEST_WAVE` to `LONGEST_WAVE`; at least float32.

    Source: Vaswani et al. 2017, section 3.5.
    """
    dtype = torch.promote_types(values.dtype, torch.float32)
    spans = torch.linspace(
        math.log(2 * math.pi / LONGEST_WAVE),
        math.log(2 * math.pi / SHORTEST_WAVE),
        WAVES,
        dtype=dtype,
        device=values.device,
    )
    angles = values.to(dtype)[:, None] * spans.exp()
    return torch.cat([angles.sin(), angles.cos()], dim=-1)


class Condition(nn.Module):
    """Noise, framerate and the shares of what is known, as the scales of all modulated layers."""

    def __init__(self, shares: int, width: int, inputs: tuple[int, ...]) -> None:
        """For that many shares; `inputs` are those of each modulated layer, `width` the condition vector's."""
        super().__init__()
        self.inputs = inputs
        self.waves = nn.Linear(4 * WAVES, width)
        self.shares = nn.Linear(shares, width, bias=False)
        self.hidden = nn.Linear(width, width)
        self.scales = nn.Linear(width, sum(inputs))
        nn.init.normal_(self.scales.weight, std=0.1 / math.sqrt(width))
        nn.init.zeros_(self.scales.bias)

    def forward(
        self,
        known: Bool[Tensor, "B T P"],
        text_known: Bool[Tensor, "B T A"],
        rate: Float[Tensor, " B"],
        log_snr: Float[Tensor, " B"],
    ) -> tuple[Float[Tensor, "B inputs"], ...]:
        """Scales around 1, one a sample and input of each layer; of the masks only their means over time count."""
        dtype = self.hidden.weight.dtype
        told = torch.cat([waves(log_snr), waves(rate.log())], dim=-1).to(dtype)
        shares = torch.cat([known, text_known], dim=-1).to(dtype).mean(dim=1)
        vector = functional.silu(self.waves(told) + self.shares(shares))
        vector = functional.silu(self.hidden(vector))
        return (1 + self.scales(vector)).split(self.inputs, dim=-1)
