"""Sizes of the animation model, from what a test trains in a minute to what the paper trained."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

from pgm_models.animation.noise import DiffusionOptions

Positions = Literal["bias", "shaw"]
Encoder = Literal["hash", "minilm", "t5"]


@dataclass(frozen=True, kw_only=True)
class NetworkOptions:
    """The denoising transformer."""

    width: int
    """Numbers of a token, D."""
    layers: int
    heads: int
    dropout: float = 0.0
    positions: Positions = "bias"
    """How tokens know their distance in time: a bias of the attention for each pair of kinds; or Shaw's vectors."""
    reach: int = 16
    """Distances in frames beyond this count as this."""


@dataclass(frozen=True, kw_only=True)
class TextOptions:
    """The trained part of the text encoder."""

    width: int
    layers: int
    heads: int
    start: int = 0
    """Steps in which it learns what states its texts go with, before all else (see `text_start`)."""


@dataclass(frozen=True, kw_only=True)
class Preset:
    """A size, and how it is trained."""

    network: NetworkOptions
    text: TextOptions
    encoder: Encoder
    """Frozen encoder that it is trained with unless another is asked for."""
    frames: int
    """Length of training windows, T."""
    batch: int
    """Windows a step."""
    steps: int
    learning_rate: float


PRESETS: Mapping[str, Preset] = MappingProxyType(
    {
        "nano": Preset(
            network=NetworkOptions(width=64, layers=2, heads=2),
            text=TextOptions(width=32, layers=1, heads=2),
            encoder="hash",
            frames=8,
            batch=16,
            steps=1_500,
            learning_rate=2e-3,
        ),
        "tiny": Preset(
            network=NetworkOptions(width=128, layers=4, heads=4),
            text=TextOptions(width=96, layers=1, heads=4, start=2_000),
            encoder="minilm",
            frames=16,
            batch=16,
            steps=6_000,
            learning_rate=1e-3,
        ),
        "small": Preset(
            network=NetworkOptions(width=192, layers=4, heads=6),
            text=TextOptions(width=128, layers=1, heads=4, start=3_000),
            encoder="minilm",
            frames=16,
            batch=16,
            steps=18_000,
            learning_rate=1e-3,
        ),
        "base": Preset(
            network=NetworkOptions(width=512, layers=8, heads=8, dropout=0.1),
            text=TextOptions(width=256, layers=2, heads=8, start=3_000),
            encoder="minilm",
            frames=16,
            batch=32,
            steps=100_000,
            learning_rate=3e-4,
        ),
        "paper": Preset(
            network=NetworkOptions(width=768, layers=12, heads=12, positions="shaw"),
            text=TextOptions(width=1024, layers=4, heads=8),
            encoder="t5",
            frames=16,
            batch=32,
            steps=2_500_000,
            learning_rate=1e-4,
        ),
    }
)
"""By name; `small` is what is shipped."""


@dataclass(frozen=True, kw_only=True)
class Design:
    """What is learned and how: the network's kind and its objective."""

    network: Literal["transformer", "lstm", "object_lstms"] = "transformer"
    """Attention over all tokens; one LSTM over all objects; one LSTM an object."""
    objective: Literal["diffusion", "reconstruction"] = "diffusion"
    """Noise is taken away step by step; or unknown values are told at once."""
    adversary: bool = False
    """Whether a discriminator of sequences is trained beside it."""
    diffusion: DiffusionOptions = DiffusionOptions()
    """Of the objective `diffusion`."""
    balanced: bool = True
    """Whether each property weighs the same in the loss, however many channels it has; else each channel does."""
    prior: bool = False
    """Whether the network tells what a Gaussian prior of each channel over time does not (see `prior`)."""
    self_conditioning: bool = False
    """Whether the network reads its own last guess. Source: Chen et al. 2022, Analog Bits, section 3.2."""
    near: bool = False
    """Whether the network reads offsets of players and ball from each other (see `nearness`)."""


DESIGNS: Mapping[str, Design] = MappingProxyType(
    {
        "ours": Design(prior=True, self_conditioning=True, near=True, diffusion=DiffusionOptions(shift=-1.5)),
        "velocity": Design(diffusion=DiffusionOptions(shift=-1.5)),
        "paper": Design(
            diffusion=DiffusionOptions(prediction="eps", schedule="linear", weight="none"),
            balanced=False,
        ),
        "transformer": Design(objective="reconstruction"),
        "lstm": Design(network="lstm", objective="reconstruction"),
        "playable": Design(network="object_lstms", objective="reconstruction", adversary=True),
    }
)
"""By name: ours; without what it reads beside states; the paper's; and the baselines that the paper compares with."""
