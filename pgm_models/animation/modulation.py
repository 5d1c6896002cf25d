"""How the animation network is told its noise, its framerate and what is known: by the scales of its weights.

The condition becomes one vector a sample; from it each modulated layer gets a scale for each of its inputs, by which
its weights are multiplied and then brought back to unit length (demodulation). Written for activations, so that all
samples share one matrix product.
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
TINY = 1e-8
"""Added to squared lengths."""


def demodulated_linear(
    inputs: Float[Tensor, "B S inputs"],
    scale: Float[Tensor, "B inputs"],
    weight: Float[Tensor, "outputs inputs"],
    gain: Float[Tensor, " outputs"],
    bias: Float[Tensor, " outputs"],
) -> Float[Tensor, "B S outputs"]:
    """What W' x + b gives, where W' of a sample is W with its columns scaled and its rows brought to length `gain`.

    Source: Karras et al. 2020, Analyzing and Improving the Image Quality of StyleGAN, equations 1 and 3, with the
    scales moved from the weights to inputs and outputs.
    """
    length = functional.linear(scale.square(), weight.square())
    shrink = torch.rsqrt(length + TINY) * gain
    return torch.addcmul(bias, functional.linear(inputs * scale[:, None], weight), shrink[:, None])


class DemodulatedLinear(nn.Module):
    """A linear layer whose inputs are weighted by the condition, and whose rows keep their length."""

    def __init__(self, inputs: int, outputs: int, *, gain: float) -> None:
        """Rows begin with that length: the scale of the outputs, as demodulation takes out that of the weights."""
        super().__init__()
        self.weight = nn.Parameter(torch.randn(outputs, inputs) / math.sqrt(inputs))
        self.gain = nn.Parameter(torch.full((outputs,), gain))
        self.bias = nn.Parameter(torch.zeros(outputs))

    def forward(
        self, inputs: Float[Tensor, "B S inputs"], scale: Float[Tensor, "B inputs"]
    ) -> Float[Tensor, "B S outputs"]:
        """The outputs; `scale` multiplies the inputs and is the same for all tokens of a sample."""
        return demodulated_linear(inputs, scale, self.weight, self.gain, self.bias)


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
