"""What the synthesis model is trained on: patches of pictures, rendered again in their own or each other's styles."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor, nn

from pgm_models.image_metrics import psnr_of_error
from pgm_models.synthesis.fields import Grids, Wardrobe
from pgm_models.synthesis.losses import EyeLoss, reconstruction_losses
from pgm_models.synthesis.model import ModelOptions, SynthesisModel, options_to_json
from pgm_models.synthesis.patches import rays_in, states_in
from pgm_models.synthesis.renderer import render
from pgm_models.synthesis.sparse_pictures import cell_of_pixels, followed_pixels, spread
from pgm_models.synthesis.worlds import air_loss
from pgm_models.train import Batch, Task


class SynthesisTask(Task):
    """Batches of patches, and how far what is made of them is from the pictures."""

    def __init__(
        self,
        options: ModelOptions,
        batch: Callable[[int], Batch],
        eye: EyeLoss,
        *,
        held_out: Sequence[Batch],
        data: Mapping[str, object],
        look: Callable[[SynthesisModel, Path, int], None] = lambda model, run, step: None,
    ) -> None:
        """A task.

        Args:
            options: Of the model that is trained.
            batch: The patches of the batch with a number.
            eye: What an eye looks at, beside the squared difference.
            held_out: Patches of frames that are not trained on; may be none.
            data: What they come from, as JSON values.
            look: Draws pictures into the run.
        """
        self._options, self._batch, self._eye = options, batch, eye
        self._held_out, self._data, self._look = held_out, data, look

    def batch(self, index: int) -> Batch:
        """Patches, rays, states and whole pictures of that number."""
        return self._batch(index)

    def loss(self, network: nn.Module, batch: Batch) -> tuple[Tensor, dict[str, Tensor]]:
        """The sum, without weights, of what differs before the enhancer and after it, and what thin air costs."""
        assert isinstance(network, SynthesisModel)
        grids = network.fields.grids()
        raw, made = rendered_patches(network, grids, batch, jitter=_jitter(batch))
        targets = batch.tensors["targets"]
        terms = {f"raw_{name}": value for name, value in reconstruction_losses(raw, targets, self._eye).items()}
        if network.upsampler is not None:
            terms = reconstruction_losses(made, targets, self._eye)
        elif network.enhancer is not None:
            terms |= reconstruction_losses(made, targets, self._eye)
        if grids.worlds:
            terms["air"] = air_loss(grids.worlds)
        return torch.stack(list(terms.values())).sum(), {name: value.detach() for name, value in terms.items()}

    @torch.no_grad()
    def validate(self, network: nn.Module) -> dict[str, float]:
        """Peak signal-to-noise ratio of held-out patches before and after the enhancer, dB, and their loss."""
        if not self._held_out:
            return {}
        assert isinstance(network, SynthesisModel)
        errors, losses = [], []
        grids = network.fields.grids()
        for each in self._held_out:
            batch = each.to(network.device)
            raw, made = rendered_patches(network, grids, batch, jitter=None)
            errors.append([_error(part, batch.tensors["targets"]) for part in (raw, made)])
            losses.append(float(self.loss(network, batch)[0]))
        before, after = (sum(values) / len(values) for values in zip(*errors, strict=True))
        return {"loss": sum(losses) / len(losses), "raw_psnr": _decibels(before), "psnr": _decibels(after)}

    def describe(self) -> dict[str, object]:
        """The model's options and the data."""
        return {"model": options_to_json(self._options), "data": dict(self._data), "eye": self._eye.name}

    def look(self, network: nn.Module, run: Path, step: int) -> None:
        """Draw held-out pictures beside the real ones."""
        assert isinstance(network, SynthesisModel)
        self._look(network, run, step)


def rendered_patches(
    model: SynthesisModel, grids: Grids, batch: Batch, *, jitter: torch.Generator | None
) -> tuple[Float[Tensor, "patches 3 size size"], Float[Tensor, "patches 3 size size"]]:
    """The colours of a batch's patches before the enhancer and after it, RGB 0 to 1."""
    tensors = batch.tensors
    read = model.encoder(tensors["pictures"], tensors["boxes_px"])
    objects = torch.arange(read.shape[1], device=read.device)
    styles = read[tensors["wears"], objects]
    wardrobe = Wardrobe(model.fields, grids, styles)
    patches, _, size, _ = tensors["targets"].shape
    rays, states = rays_in(batch), states_in(batch, model.scene)
    if model.upsampler is None:
        seen = render(rays, model.fields, grids, states, wardrobe, jitter=jitter)
    else:
        start = torch.arange(0, len(rays), size**2, device=read.device)[:, None]
        followed = (start + followed_pixels(size, size, read.device)).flatten()
        seen = render(rays[followed], model.fields, grids, states, wardrobe, jitter=jitter)
        cell = cell_of_pixels(size, size, read.device)
        cells = len(followed) // patches
        seen = spread(seen, (torch.arange(patches, device=read.device)[:, None] * cells + cell).flatten())
    features = seen.features.unflatten(0, (patches, size, size)).permute(0, 3, 1, 2)
    return features[:, :3], model.enhanced(features, styles[tensors["patch_frame"]])


def _jitter(batch: Batch) -> torch.Generator:
    """Drawn from the batch alone, so that resumed runs and processes agree."""
    rows = batch.tensors["rows"]
    seed = int((rows * torch.arange(1, len(rows) + 1, device=rows.device)).sum()) + int(batch.tensors["wears"].sum())
    return torch.Generator().manual_seed(seed)


def _error(made: Tensor, real: Tensor) -> float:
    return float((made.clamp(0, 1) - real).square().mean())


def _decibels(error: float) -> float:
    return float(psnr_of_error(np.array(max(error, 1e-10))))
