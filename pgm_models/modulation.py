"""Linear layers whose weights a condition scales and that are then brought back to length: demodulation.

Written for activations instead of weights, so that all samples share one matrix product. Source: Karras et al. 2020,
Analyzing and Improving the Image Quality of StyleGAN, section 2.2.
"""

import math

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn
from torch.nn import functional

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

    def of_rows(
        self,
        inputs: Float[Tensor, "rows inputs"],
        frame: Int[Tensor, " rows"],
        scale: Float[Tensor, "frames inputs"],
    ) -> Float[Tensor, "rows outputs"]:
        """The outputs of rows that belong to different samples: `frame` says which of the scales is each row's."""
        length = functional.linear(scale.square(), self.weight.square())
        shrink = torch.rsqrt(length + TINY) * self.gain
        if len(scale) == 1:
            return torch.addcmul(self.bias, functional.linear(inputs * scale, self.weight), shrink)
        return torch.addcmul(self.bias, functional.linear(inputs * scale[frame], self.weight), shrink[frame])
