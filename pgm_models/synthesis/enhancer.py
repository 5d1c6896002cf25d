"""The network that turns a rendered picture of features into the final RGB picture, in a style.

A U of demodulated convolutions over the full picture: one that read blocks of 2 x 2 pixels as one lost the small and
far objects, and gained no time at equal error. Nothing in it looks at the picture as a whole, so a pixel depends on
those within `reach` only; what is rendered again of a picture need not be all of it (`tiles`). Channels lie last in
memory, which takes a quarter less time on a CPU and lets `torch.autocast` to bfloat16 halve what is left. Widths that
are no multiples of 8 cost as much as the next ones that are.
"""

import math

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional

from pgm_models.modulation import TINY
from pgm_models.synthesis.presets import EnhancerOptions
from pgm_models.synthesis.stylists import COLOURS

GAIN = math.sqrt(2.0)
"""Length of a convolution's weights that makes up for what a ReLU takes."""
CONTOUR_PX = 3
"""Pixels around inserted objects whose colours stay as rendered, along each axis."""


def demodulated_convolution(
    inputs: Float[Tensor, "B inputs H W"],
    scale: Float[Tensor, "B inputs"],
    weight: Float[Tensor, "outputs inputs size size"],
    gain: Float[Tensor, " outputs"],
    bias: Float[Tensor, " outputs"],
    stride: int = 1,
) -> Float[Tensor, "B outputs h w"]:
    """What a convolution gives whose weights are, for each sample, scaled by input and then brought to length `gain`.

    Beyond the border all inputs are 0. A single sample has its own weights made; several share theirs, and have their
    inputs and outputs scaled instead.

    Source: Karras et al. 2020, Analyzing and Improving the Image Quality of StyleGAN, equations 1 and 3.
    """
    padding = weight.shape[2] // 2
    # Not a matrix product, which autocast would round.
    length = (scale.square()[:, None] * weight.square().sum(dim=(2, 3))).sum(dim=2)
    shrink = torch.rsqrt(length + TINY) * gain
    if len(inputs) == 1:
        own = weight * scale[0, :, None, None] * shrink[0, :, None, None, None]
        return functional.conv2d(inputs, own, bias, stride=stride, padding=padding)
    outputs = functional.conv2d(inputs * scale[:, :, None, None], weight, stride=stride, padding=padding)
    return torch.addcmul(bias[:, None, None], outputs, shrink[:, :, None, None])


class DemodulatedConvolution(nn.Module):
    """A convolution whose inputs are weighted by the style, and whose weights keep their length."""

    def __init__(self, inputs: int, outputs: int, *, style: int, size: int = 3, stride: int = 1, gain: float) -> None:
        """Fresh weights over `size` x `size` pixels, for styles of that many numbers; outputs begin with that gain."""
        super().__init__()
        self.weight = nn.Parameter(torch.randn(outputs, inputs, size, size) / math.sqrt(inputs * size**2))
        self.gain = nn.Parameter(torch.full((outputs,), gain))
        self.bias = nn.Parameter(torch.zeros(outputs))
        self.scales = nn.Linear(style, inputs)
        nn.init.normal_(self.scales.weight, std=0.25 / math.sqrt(style))
        nn.init.zeros_(self.scales.bias)
        self.stride = stride

    def forward(
        self, inputs: Float[Tensor, "B inputs H W"], styles: Float[Tensor, "B style"]
    ) -> Float[Tensor, "B outputs h w"]:
        """The outputs; sides of the picture are divided by the stride and rounded up."""
        scale = 1 + self.scales(styles)
        return demodulated_convolution(inputs, scale, self.weight, self.gain, self.bias, self.stride)


class Enhancer(nn.Module):
    """RGB pictures of features, each near the colours that are the first three of them.

    Source: Menapace et al. 2023, Enhancer. The size of theirs, and whether it is residual, is not told.
    """

    def __init__(self, features: int, style: int, options: EnhancerOptions) -> None:
        """A network for that many features of a pixel and numbers of a style; until trained it changes no colour.

        Raises:
            ValueError: If there are fewer features than colours.
        """
        super().__init__()
        if features < COLOURS:
            raise ValueError(f"features: expected {COLOURS} or more, as the first are colours, got {features}")
        self.widths = options.widths
        if not self.widths:
            return

        def layer(inputs: int, outputs: int, *, size: int = 3, stride: int = 1, gain: float = GAIN):
            return DemodulatedConvolution(inputs, outputs, style=style, size=size, stride=stride, gain=gain)

        finest = self.widths[0]
        pairs = list(zip(self.widths, self.widths[1:], strict=False))
        self.inward = nn.ModuleList([layer(features, finest), layer(finest, finest)])
        self.downs = nn.ModuleList(layer(fine, coarse, stride=2) for fine, coarse in pairs)
        self.mixes = nn.ModuleList(layer(coarse, coarse) for _, coarse in pairs)
        self.ups = nn.ModuleList(layer(coarse, fine, size=1, gain=1.0) for fine, coarse in pairs)
        self.joins = nn.ModuleList(layer(fine, fine) for fine, _ in pairs)
        self.outward = nn.Conv2d(finest, COLOURS, 1)
        for parameter in self.outward.parameters():
            nn.init.zeros_(parameter)

    @property
    def stride(self) -> int:
        """Pixels along each side of a cell of the coarsest scale: a part of a picture begins at multiples of it."""
        return 2 ** max(0, len(self.widths) - 1)

    @property
    def reach(self) -> int:
        """Pixels along each axis beyond which nothing counts for a pixel: the margin of a part enhanced alone."""
        if not self.widths:
            return 0
        spans = [(place, *_read(len(self.widths), 0, place, place)) for place in range(self.stride)]
        return max(max(place - low, high - place) for place, low, high in spans)

    def forward(
        self,
        features: Float[Tensor, "B features H W"],
        styles: Float[Tensor, "B style"],
        kept: Float[Tensor, "B 1 H W"] | None = None,
    ) -> Float[Tensor, "B 3 H W"]:
        """The pictures, 0 to 1, of any size.

        Args:
            features: As rendered, the three colours first.
            styles: One a picture.
            kept: Share of each pixel that belongs to objects inserted after training. It keeps its rendered colour, and
                so does what is within `CONTOUR_PX` of it.
        """
        colours = features[:, :COLOURS]
        changed = clipped(colours + self._change(features, styles)) if self.widths else clipped(colours)
        return changed if kept is None else with_kept(changed, colours, kept)

    def _change(self, features: Tensor, styles: Tensor) -> Tensor:
        """What is added to the colours."""
        height, width = features.shape[2:]
        below, right = -height % self.stride, -width % self.stride
        if below or right:
            features = functional.pad(features, (0, right, 0, below), mode="replicate")
        here = features.contiguous(memory_format=torch.channels_last)
        for layer in self.inward:
            here = functional.relu_(layer(here, styles))
        scales = [here]
        for down, mix in zip(self.downs, self.mixes, strict=True):
            here = functional.relu_(mix(functional.relu_(down(here, styles)), styles))
            scales.append(here)
        for up, join, fine in reversed(list(zip(self.ups, self.joins, scales, strict=False))):
            here = functional.interpolate(up(here, styles), scale_factor=2.0, mode="nearest").add_(fine)
            here = functional.relu_(join(here, styles))
        return self.outward(here)[:, :, :height, :width].to(features.dtype)


def _read(scales: int, scale: int, low: int, high: int) -> tuple[int, int]:
    """First and last pixel on which cells `low` to `high` of a scale depend, on the way back up."""
    spans = []
    if scale + 1 < scales:
        low, high = low - 1, high + 1
        spans.append(_read(scales, scale + 1, low // 2, high // 2))
    for _ in range(scale):
        low, high = 2 * low - 3, 2 * high + 3
    spans.append((low - 2, high + 2))
    return min(first for first, _ in spans), max(last for _, last in spans)


def clipped(colours: Float[Tensor, "*any"]) -> Float[Tensor, "*any"]:
    """The colours within 0 to 1; for gradients they were there already, so that none beyond is stuck."""
    return colours + (colours.clamp(0.0, 1.0) - colours).detach()


def with_kept(
    pictures: Float[Tensor, "B 3 H W"],
    colours: Float[Tensor, "B 3 H W"],
    kept: Float[Tensor, "B 1 H W"],
    *,
    contour_px: int = CONTOUR_PX,
) -> Float[Tensor, "B 3 H W"]:
    """The pictures with rendered colours where objects were inserted, and within that many pixels along each axis.

    Source: Menapace et al. 2023, appendix B.2: an enhancer has never seen such objects, and spoils their contours.

    Args:
        pictures: Enhanced.
        colours: Rendered.
        kept: Share of each pixel that the inserted objects cover.
        contour_px: Width of the contour around it.
    """
    share = functional.max_pool2d(kept, 2 * contour_px + 1, stride=1, padding=contour_px)
    return torch.lerp(pictures, clipped(colours), share)
