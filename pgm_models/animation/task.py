"""What the animation model is trained on: windows under masks, with noise or without."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor, nn

from pgm_models.animation.layout import Layout
from pgm_models.animation.masks import draw_masks, drop_text
from pgm_models.animation.model import AnimationModel, ModelOptions, options_to_json
from pgm_models.animation.noise import (
    draw_log_snr,
    loss_weight,
    masked_loss,
    noisy,
    target_of,
)
from pgm_models.animation.windows import Windows
from pgm_models.train import Batch, Task

ADVERSARY_SHARE = 0.05
"""Weight of the adversary's loss beside the reconstruction's."""
SELF_CONDITIONED = 0.5
"""Share of the steps in which the network reads its own guess, where the design has it so."""
DRAWN = ("known", "text_known", "log_snr")
"""Tensors of a batch beside those of its windows."""


@dataclass(frozen=True, kw_only=True)
class MaskOptions:
    """What is hidden in training."""

    group: str = "all"
    """Name of the strategies that are mixed."""
    text_drop: float = 0.1
    """Share of windows without any text, on top of the masks, for guidance."""
    seed: int = 0


def objects_of(layout: Layout) -> tuple[int, ...]:
    """The object that each property belongs to: players by index, then the ball."""
    return tuple(entry.player if entry.player >= 0 else len(layout.players) for entry in layout.properties)


class AnimationTask(Task):
    """Batches of windows with masks and noise levels, all drawn from the batch's number."""

    def __init__(
        self,
        options: ModelOptions,
        masks: MaskOptions,
        batch: Callable[[int], Windows],
        *,
        held_out: Sequence[Windows],
        data: Mapping[str, object],
        look: Callable[[AnimationModel, Path, int], None] = lambda model, run, step: None,
    ) -> None:
        """A task.

        Args:
            options: Of the model that is trained.
            masks: What is hidden.
            batch: The windows of the batch with a number.
            held_out: Windows of other matches for validation; may be none.
            data: What they come from, as JSON values.
            look: Draws samples into the run.
        """
        self._options, self._masks, self._windows = options, masks, batch
        self._held_out, self._data, self._look = held_out, data, look
        self._objects = objects_of(options.layout)

    def batch(self, index: int) -> Batch:
        """Windows, masks and noise levels of that number."""
        return self._masked(self._windows(index), index)

    def _masked(self, windows: Windows, index: int) -> Batch:
        count, frames, _ = windows.state.shape
        generator = torch.Generator().manual_seed((self._masks.seed << 32) + index)
        known, text_known = draw_masks(
            count, frames, self._objects, len(self._options.layout.players), generator, group=self._masks.group
        )
        text_known = drop_text(text_known, self._masks.text_drop, generator)
        design = self._options.design
        levels = draw_log_snr(design.diffusion, count, generator)
        tensors = {name: value for name, value in vars(windows).items() if isinstance(value, Tensor)}
        drawn = (known & windows.valid, text_known, levels)
        return Batch(tensors={**tensors, **dict(zip(DRAWN, drawn, strict=True))}, names=windows.names)

    def loss(self, network: nn.Module, batch: Batch) -> tuple[Tensor, dict[str, Tensor]]:
        """The mean loss over unknown entries, and that of each property."""
        assert isinstance(network, AnimationModel)
        parts = dict(batch.tensors)
        known, text_known, log_snr = (parts.pop(name) for name in DRAWN)
        windows = Windows(**parts, names=batch.names)
        design = self._options.design
        given, unknown = network.over_channels(known), ~known & windows.valid
        state = windows.state
        if design.objective == "reconstruction":
            said = network(state * given, known, text_known, windows, torch.zeros_like(log_snr))
            weight = torch.ones_like(log_snr)
            loss, each = masked_loss(
                said.output, state, unknown, weight, network.property_of_channel, balanced=design.balanced
            )
            terms = self._named(each)
            if network.discriminator is not None:
                from pgm_models.animation.adversary import adversarial_loss

                embedded = network.embedded(windows)
                made = torch.where(given, state, said.output)
                against, told = adversarial_loss(
                    network.discriminator, state, made, embedded, network.over_channels(windows.valid)
                )
                loss, terms = loss + ADVERSARY_SHARE * against, {**terms, **told}
            return loss, terms
        noise = torch.randn_like(state)
        x = torch.where(given, state, noisy(state, noise, log_snr))
        embedded, last = network.embedded(windows), None
        if design.self_conditioning and torch.rand(()) < SELF_CONDITIONED:
            with torch.no_grad():
                last = network.clean(network(x, known, text_known, windows, log_snr, embedded), x, log_snr)
        said = network(x, known, text_known, windows, log_snr, embedded, last)
        if said.mean is not None and said.doubt is not None:
            target, weight = (state - said.mean) / said.doubt, torch.ones_like(log_snr)
        else:
            target = target_of(design.diffusion.prediction, state, noise, log_snr)
            weight = loss_weight(design.diffusion, log_snr)
        loss, each = masked_loss(
            said.output, target, unknown, weight, network.property_of_channel, balanced=design.balanced
        )
        return loss, self._named(each)

    def _named(self, each: Tensor) -> dict[str, Tensor]:
        columns = [entry.column for entry in self._options.layout.properties]
        return dict(zip(columns, each.detach(), strict=True))

    @torch.no_grad()
    def validate(self, network: nn.Module) -> dict[str, float]:
        """The loss of held-out windows, under masks and noise that are the same each time."""
        if not self._held_out:
            return {}
        assert isinstance(network, AnimationModel)
        device = network.device
        sums: dict[str, float] = {}
        devices = [device] if device.type == "cuda" else []
        with torch.random.fork_rng(devices):
            for number, windows in enumerate(self._held_out):
                torch.manual_seed(number)
                loss, terms = self.loss(network, self._masked(windows, number).to(device))
                for name, value in {"loss": loss, **terms}.items():
                    sums[name] = sums.get(name, 0.0) + float(value) / len(self._held_out)
        return sums

    def describe(self) -> dict[str, object]:
        """The model's options, the masks and the data."""
        return {
            "model": options_to_json(self._options),
            "masks": {name: getattr(self._masks, name) for name in self._masks.__dataclass_fields__},
            "data": dict(self._data),
        }

    def look(self, network: nn.Module, run: Path, step: int) -> None:
        """Draw what the model makes of held-out windows, and its losses so far."""
        assert isinstance(network, AnimationModel)
        self._look(network, run, step)
