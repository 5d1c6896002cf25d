"""The animation model as one thing: layout, network, trained text aggregator, and the file it is kept in."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from importlib.resources import as_file, files
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from pgm_models.animation.aggregator import Aggregator
from pgm_models.animation.layout import Layout, layout_from_json, layout_to_json
from pgm_models.animation.nearness import Nearness, offset_widths
from pgm_models.animation.network import Denoiser, NetworkShape
from pgm_models.animation.noise import DiffusionOptions, to_x0
from pgm_models.animation.presets import Design, NetworkOptions, TextOptions
from pgm_models.animation.prior import Preconditioner, TemporalPrior, prior_from_json, prior_to_json
from pgm_models.animation.text_encoders import TextEncoder, encoder_of
from pgm_models.animation.windows import Windows
from pgm_models.model_file import stored_model, write_model

SHIPPED = ("tennis_small",)
"""Names of models that come with the package."""
Step = Callable[[Tensor, Tensor, Tensor, Tensor, Tensor, Tensor, Tensor], Tensor]
"""A network's forward: x, known, text, text_known, rate, log_snr, constants."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ModelOptions:
    """What a model is, apart from its weights."""

    layout: Layout
    network: NetworkOptions
    text: TextOptions
    design: Design
    encoder: str
    """Frozen text encoder: `hash`, `minilm`, or `t5:` and a path."""
    encoder_width: int
    """Numbers of a token's features."""
    frames: int
    """Length of the training windows, T."""
    prior: TemporalPrior | None
    """Of the channels over time, where the design has one."""
    rates: tuple[float, float]
    """Lowest and highest rate of the training windows, frames a second."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Said:
    """What a network said of noisy windows."""

    output: Float[Tensor, "B T C"]
    """In the parametrisation of the design; with a prior, of its doubts how far the clean state is from its mean."""
    mean: Float[Tensor, "B T C"] | None
    """The prior's expected clean state."""
    doubt: Float[Tensor, "B T C"] | None
    """Its standard deviation."""


class AnimationModel(nn.Module):
    """Unknown states from known ones, words and noise."""

    def __init__(self, options: ModelOptions) -> None:
        super().__init__()
        self.options = options
        layout, design = options.layout, options.design
        self.preconditioner = None
        if design.prior:
            if options.prior is None:
                raise ValueError("prior: expected one, as the design has it, got none")
            self.preconditioner = Preconditioner(options.prior)
        self.nearness = Nearness(layout) if design.near else None
        offsets = offset_widths(layout) if design.near else (0,) * len(layout.widths)
        # Beside each channel the network may read a prior's guess, its own last one, and offsets; what it says of those
        # is left out.
        nothing = (0,) * len(layout.widths)
        guesses = layout.widths if design.prior else nothing
        last = layout.widths if design.self_conditioning else nothing
        read = [*zip(layout.widths, guesses, last, offsets, strict=True)]
        self.shape = NetworkShape(
            widths=tuple(sum(widths) for widths in read),
            actions=len(layout.players),
            constants=layout.constant_channels,
            text_width=options.text.width,
        )
        self.aggregator = Aggregator(options.encoder_width, options.text)
        self.denoiser: nn.Module = _network(self.shape, options)
        self.discriminator: nn.Module | None = None
        if design.adversary:
            from pgm_models.animation.adversary import SequenceDiscriminator

            self.discriminator = SequenceDiscriminator(self.shape, options.network)
        self.step: Step | None = None
        """What is run instead of the network, where that is set: an exported copy of it."""
        self.property_of_channel: Tensor
        self.register_buffer(
            "property_of_channel", torch.as_tensor(layout.property_of_channel.copy()), persistent=False
        )
        # What is read is put together as all states, all guesses, all offsets; and sorted by property.
        property_of_read = np.concatenate([np.repeat(np.arange(len(read)), part) for part in zip(*read, strict=True)])
        order = np.argsort(property_of_read, kind="stable")
        self.read_order: Tensor
        self.register_buffer("read_order", torch.as_tensor(order), persistent=False)
        self.own_places: Tensor
        self.register_buffer("own_places", torch.as_tensor(np.argsort(order)[: layout.channels]), persistent=False)
        self._encoder: TextEncoder | None = None

    @property
    def layout(self) -> Layout:
        """What a state vector is made of."""
        return self.options.layout

    @property
    def device(self) -> torch.device:
        """Where the weights lie."""
        return next(self.parameters()).device

    def embedded(self, windows: Windows) -> Float[Tensor, "B T A W"]:
        """The embedding of each frame's text; zeros where there is none."""
        rows = self.aggregator(windows.tokens, windows.token_mask)
        none = rows.new_zeros(1, rows.shape[-1])
        return torch.cat([none, rows])[windows.text + 1]

    def forward(
        self,
        x: Float[Tensor, "B T C"],
        known: Bool[Tensor, "B T P"],
        text_known: Bool[Tensor, "B T A"],
        windows: Windows,
        log_snr: Float[Tensor, " B"],
        embedded: Tensor | None = None,
        last: Float[Tensor, "B T C"] | None = None,
    ) -> Said:
        """What the network says of x, and what turns it into clean states.

        Args:
            x: Known values where known, noisy ones elsewhere; of reconstruction 0 elsewhere.
            known: Which properties are given.
            text_known: Which texts may be read.
            windows: Of which texts, rate, constants and validity are taken.
            log_snr: Of the noise.
            embedded: The texts' embeddings where they are at hand already.
            last: Clean states as the network guessed them before, with more noise; read where the design has it so.
        """
        text = self.embedded(windows) if embedded is None else embedded
        text_known = text_known & (windows.text >= 0)
        run = self.denoiser if self.step is None else self.step
        mean, doubt = None, None
        given, valid = self.over_channels(known), self.over_channels(windows.valid)
        parts, guess = [x], x
        if self.preconditioner is not None:
            mean, doubt = self.preconditioner(x, given, valid, windows.rate, log_snr)
            parts, guess = [x, mean], mean
        if self.options.design.self_conditioning:
            guess = guess if last is None else torch.where(given, x, last)
            parts.append(guess)
        if self.nearness is not None:
            parts.append(self.nearness(guess, windows.valid, windows.rate))
        if len(parts) > 1:
            x = torch.cat(parts, dim=-1)[..., self.read_order]
        output = run(x, known, text, text_known, windows.rate, log_snr, windows.constants)
        return Said(output=output if len(parts) == 1 else output[..., self.own_places], mean=mean, doubt=doubt)

    def clean(self, said: Said, x: Float[Tensor, "B T C"], log_snr: Float[Tensor, " B"]) -> Float[Tensor, "B T C"]:
        """The clean states that what was said of x stands for."""
        if said.mean is not None and said.doubt is not None:
            return said.mean + said.doubt * said.output
        if self.options.design.objective == "reconstruction":
            return said.output
        return to_x0(self.options.design.diffusion.prediction, said.output, x, log_snr)

    def over_channels(self, flags: Bool[Tensor, "B T P"]) -> Bool[Tensor, "B T C"]:
        """Each property's flag for each of its channels."""
        return flags[..., self.property_of_channel]

    def text_tokens(self, texts: Sequence[str]) -> tuple[Tensor, Tensor]:
        """Features and mask of the texts' tokens by the frozen encoder, on the model's device."""
        if self._encoder is None:
            self._encoder = encoder_of(self.options.encoder)
        tokens, mask = self._encoder.tokens(list(texts))
        return tokens.to(self.device), mask.to(self.device)


def _network(shape: NetworkShape, options: ModelOptions) -> nn.Module:
    match options.design.network:
        case "transformer":
            return Denoiser(shape, options.network)
        case "lstm":
            from pgm_models.animation.recurrent import SequenceLstm

            return SequenceLstm(shape, options.network)
        case "object_lstms":
            from pgm_models.animation.recurrent import ObjectLstms

            objects = tuple(entry.player for entry in options.layout.properties)
            return ObjectLstms(shape, options.network, objects)


def options_to_json(options: ModelOptions) -> dict[str, object]:
    """The options as JSON values."""
    return {
        "layout": layout_to_json(options.layout),
        "network": asdict(options.network),
        "text": asdict(options.text),
        "design": asdict(options.design),
        "encoder": options.encoder,
        "encoder_width": options.encoder_width,
        "frames": options.frames,
        "prior": None if options.prior is None else prior_to_json(options.prior),
        "rates": list(options.rates),
    }


def options_from_json(raw: Mapping) -> ModelOptions:
    """The options that `options_to_json` wrote.

    Raises:
        ValueError: If they are not such.
    """
    try:
        design = dict(raw["design"])
        design["diffusion"] = DiffusionOptions(**design["diffusion"])
        return ModelOptions(
            layout=layout_from_json(raw["layout"]),
            network=NetworkOptions(**raw["network"]),
            text=TextOptions(**raw["text"]),
            design=Design(**design),
            encoder=raw["encoder"],
            encoder_width=raw["encoder_width"],
            frames=raw["frames"],
            prior=None if raw["prior"] is None else prior_from_json(raw["prior"]),
            rates=(float(raw["rates"][0]), float(raw["rates"][1])),
        )
    except (KeyError, TypeError, IndexError) as error:
        raise ValueError(f"model: expected the options of an animation model, got {error!r}") from error


def save_model(path: Path, model: AnimationModel, about: Mapping[str, object]) -> None:
    """Write weights and options as one safetensors file, whole or not at all."""
    write_model(path, "animation", model, options_to_json(model.options), about)


def load_model(run: Path, device: torch.device | str = "cpu") -> AnimationModel:
    """The model of a run's folder, of a file, or of a shipped name; with averaged weights, in evaluation mode.

    Raises:
        ValueError: If there is none; says what was found.
    """
    if str(run) in SHIPPED and not run.exists():
        with as_file(files("pgm_models.animation").joinpath(f"weights/{run}.safetensors")) as path:
            stored = stored_model(path, "animation", shipped=SHIPPED)
    else:
        stored = stored_model(run, "animation", shipped=SHIPPED)
    model = AnimationModel(options_from_json(stored.options))
    stored.into(model)
    return model.to(device)
