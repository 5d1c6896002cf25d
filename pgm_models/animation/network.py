"""The denoising transformer: what a window of states is, given noise, what is known, words, framerate and bones.

One token for each property and frame, one for each action and frame, and one a player (or one in all) for the
constants, which have no time. See the package for the vocabulary.
"""

import math
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn
from torch.nn import functional

from pgm_models.animation.attention import Attention, PairBias, ShawKeys, clipped_distances, unit_mean_square
from pgm_models.animation.modulation import Condition
from pgm_models.animation.presets import NetworkOptions
from pgm_models.modulation import DemodulatedLinear

FIRST_OUTPUT = 0.02
"""Scale of the output before training."""


@dataclass(frozen=True, kw_only=True)
class NetworkShape:
    """What goes into the network and comes out.

    Raises:
        ValueError: If there is no property, or one without channels, or another size is below 0.
    """

    widths: tuple[int, ...]
    """Channels of each property."""
    actions: int
    """Texts of a frame, A; may be 0."""
    constants: int
    """Numbers that do not change within a clip, K; may be 0."""
    text_width: int
    """Numbers of a text's embedding."""

    def __post_init__(self) -> None:
        """Check the sizes."""
        if not self.widths or min(self.widths) < 1:
            raise ValueError(f"widths: expected at least one property, each with channels, got {self.widths}")
        for name in ("actions", "constants", "text_width"):
            if getattr(self, name) < 0:
                raise ValueError(f"{name}: expected at least 0, got {getattr(self, name)}")

    @property
    def kinds(self) -> int:
        """Tokens of a frame: properties and actions."""
        return len(self.widths) + self.actions

    @property
    def timeless(self) -> int:
        """Tokens of the constants: one a player, or one where there is none; none without constants."""
        return max(self.actions, 1) if self.constants else 0


class StateTokens(nn.Module):
    """A token of each property and frame: one projection of each property for what is known, one for what is not."""

    def __init__(self, widths: tuple[int, ...], width: int) -> None:
        """For properties of those widths, padded to the widest so that one product makes all tokens."""
        super().__init__()
        channels, widest = sum(widths), max(widths)
        places = torch.full((len(widths), widest), channels)
        weight = torch.zeros(len(widths), 2, widest, width)
        start = 0
        for row, size in enumerate(widths):
            places[row, :size] = torch.arange(start, start + size)
            weight[row, :, :size] = torch.randn(2, size, width) / math.sqrt(size)
            start += size
        self.places: Tensor
        self.register_buffer("places", places, persistent=False)
        kinds = torch.randn(len(widths), 2, width) / 2
        self.weight = nn.Parameter(torch.cat([weight.flatten(1, 2), kinds], dim=1))

    def forward(self, x: Float[Tensor, "B T C"], known: Bool[Tensor, "B T P"]) -> Float[Tensor, "B T P width"]:
        """The tokens; where `known`, `x` is taken as the value, elsewhere as a noisy one."""
        values = functional.pad(x, (0, 1))[..., self.places]
        mask = known[..., None]
        given, noisy = values.masked_fill(~mask, 0.0), values.masked_fill(mask, 0.0)
        kind = torch.cat([mask, ~mask], dim=-1).to(x.dtype)
        return torch.einsum("btpw,pwd->btpd", torch.cat([given, noisy, kind], dim=-1), self.weight)


class StateOutput(nn.Module):
    """Channels from the tokens of the properties, one projection each."""

    def __init__(self, widths: tuple[int, ...], width: int) -> None:
        """For properties of those widths; small at the start."""
        super().__init__()
        widest = max(widths)
        mask = torch.arange(widest) < torch.tensor(widths)[:, None]
        self.places: Tensor
        self.register_buffer("places", mask.flatten().nonzero()[:, 0], persistent=False)
        weight = torch.randn(len(widths), width, widest) * FIRST_OUTPUT / math.sqrt(width)
        self.weight = nn.Parameter(weight * mask[:, None])
        self.bias = nn.Parameter(torch.zeros(sum(widths)))

    def forward(self, tokens: Float[Tensor, "B T P width"]) -> Float[Tensor, "B T C"]:
        """The channels of all properties, in their order."""
        padded = torch.einsum("btpd,pdw->btpw", tokens, self.weight).flatten(2)
        return padded.index_select(2, self.places) + self.bias


class TextTokens(nn.Module):
    """A token of each action and frame."""

    def __init__(self, actions: int, text_width: int, width: int) -> None:
        """One projection for all actions, and two vectors of each: that there is a text, and that there is none."""
        super().__init__()
        self.project = nn.Linear(text_width, width, bias=False)
        self.told = nn.Parameter(torch.randn(actions, width) / 2)
        self.untold = nn.Parameter(torch.randn(actions, width) / 2)

    def forward(
        self, text: Float[Tensor, "B T A text_width"], text_known: Bool[Tensor, "B T A"]
    ) -> Float[Tensor, "B T A width"]:
        """The tokens; where no text is known, what `text` holds does not matter."""
        return torch.where(text_known[..., None], self.project(text) + self.told, self.untold)


class Block(nn.Module):
    """Attention, then a step of each token by itself; both add to the tokens."""

    def __init__(self, options: NetworkOptions, shape: NetworkShape) -> None:
        """What it adds is scaled so that the tokens' variance doubles over all blocks."""
        super().__init__()
        width, gain = options.width, 1 / math.sqrt(2 * options.layers)
        shaw = None
        if options.positions == "shaw":
            shaw = ShawKeys(width // options.heads, shape.kinds, shape.timeless, options.reach)
        self.attention = Attention(width, options.heads, gain=gain, shaw=shaw)
        self.up = nn.Linear(width, 4 * width)
        self.down = DemodulatedLinear(4 * width, width, gain=gain)
        self.dropout = nn.Dropout(options.dropout)

    def forward(
        self,
        tokens: Float[Tensor, "B S width"],
        bias: Float[Tensor, "1 heads S S"] | None,
        scales: tuple[Float[Tensor, "B width"], Float[Tensor, "B inner"]],
        distances: Int[Tensor, "T T"],
    ) -> Float[Tensor, "B S width"]:
        """The tokens after this block."""
        gathered = self.attention(unit_mean_square(tokens), bias, scales[0], distances)
        tokens = tokens + self.dropout(gathered)
        inner = functional.gelu(self.up(unit_mean_square(tokens)))
        return tokens + self.dropout(self.down(inner, scales[1]))


class Denoiser(nn.Module):
    """What is predicted for each channel of a window: noise, state or velocity, as it is trained."""

    def __init__(self, shape: NetworkShape, options: NetworkOptions) -> None:
        """Raise ValueError if the heads do not divide the width."""
        super().__init__()
        if options.width % options.heads:
            raise ValueError(f"heads: expected a divisor of the width {options.width}, got {options.heads}")
        self.shape, self.options = shape, options
        width = options.width
        self.state_tokens = StateTokens(shape.widths, width)
        self.text_tokens = TextTokens(shape.actions, shape.text_width, width) if shape.actions else None
        self.constant_tokens = nn.Linear(shape.constants, shape.timeless * width) if shape.constants else None
        inputs = (width, 4 * width) * options.layers
        self.condition = Condition(shape.kinds, max(width // 2, 32), inputs)
        self.pair_bias = None
        if options.positions == "bias":
            self.pair_bias = PairBias(options.heads, shape.kinds, shape.timeless, options.reach)
        self.blocks = nn.ModuleList(Block(options, shape) for _ in range(options.layers))
        self.state_output = StateOutput(shape.widths, width)

    def forward(
        self,
        x: Float[Tensor, "B T C"],
        known: Bool[Tensor, "B T P"],
        text: Float[Tensor, "B T A text_width"],
        text_known: Bool[Tensor, "B T A"],
        rate: Float[Tensor, " B"],
        log_snr: Float[Tensor, " B"],
        constants: Float[Tensor, "B K"],
    ) -> Float[Tensor, "B T C"]:
        """The prediction, in the type of `x`; what it says where `known` has no meaning.

        `x` holds the known value where `known` and the noisy one elsewhere, standardised; `rate` frames a second;
        `log_snr` ln(alpha^2 / sigma^2). Numbers are computed in the type of the weights, or that of autocast.

        Raises:
            ValueError: If `x` has another number of channels.
        """
        if x.shape[2] != sum(self.shape.widths):
            raise ValueError(f"x: expected {sum(self.shape.widths)} channels, got {x.shape[2]}")
        frames = x.shape[1]
        dtype = self.state_output.weight.dtype
        scales = self.condition(known, text_known, rate, log_snr)
        tokens = self.state_tokens(x.to(dtype), known)
        if self.text_tokens is not None:
            tokens = torch.cat([tokens, self.text_tokens(text.to(dtype), text_known)], dim=2)
        tokens = tokens.flatten(1, 2)
        if self.constant_tokens is not None:
            still = self.constant_tokens(constants.to(dtype)).unflatten(1, (self.shape.timeless, -1))
            tokens = torch.cat([tokens, still], dim=1)
        distances = clipped_distances(torch.arange(frames, device=x.device), self.options.reach)
        bias = self.pair_bias(distances) if self.pair_bias is not None else None
        for layer, block in enumerate(self.blocks):
            tokens = block(tokens, bias, scales[2 * layer : 2 * layer + 2], distances)
        timed = tokens[:, : frames * self.shape.kinds].unflatten(1, (frames, self.shape.kinds))
        states = unit_mean_square(timed[:, :, : len(self.shape.widths)])
        return self.state_output(states).to(x.dtype)
