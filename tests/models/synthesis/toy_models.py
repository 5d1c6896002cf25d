"""A synthesis model small enough for a test, as if it had been trained: its enhancer changes colours."""

from pathlib import Path

import torch

from pgm_models.model_file import MODEL_NAME
from pgm_models.synthesis.model import ModelOptions, SynthesisModel, save_model
from pgm_models.synthesis.presets import EnhancerOptions, FieldOptions, StyleOptions

PICTURE = (64, 36)


def toy_model(scene: str = "tennis", *, seed: int = 0, widths: tuple[int, ...] = (4, 4)) -> SynthesisModel:
    """The model; matches `match0` and `match1` are kept with it, whose objects wear unlike styles."""
    torch.manual_seed(seed)
    fields = FieldOptions(
        voxels=6, voxel_features=4, texels=8, texel_features=4, samples=6, width=4, features=6, style=5, world_samples=8
    )
    model = SynthesisModel(
        ModelOptions(
            scene=scene,
            fields=fields,
            enhancer=EnhancerOptions(widths=widths),
            style=StyleOptions(widths=(4,), crop=4),
            picture=PICTURE,
            seed=seed,
        )
    )
    changed = (model.enhancer, model.encoder, model.fields.stylists, model.fields.paints)
    for module in changed:
        for parameter in () if module is None else module.parameters():
            parameter.data += 0.2 * torch.randn_like(parameter)
    objects = len(model.scene.objects)
    model.keep_styles({f"match{number}": 2 * torch.randn(objects, fields.style) for number in range(2)})
    return model.eval().requires_grad_(False)


def toy_run(folder: Path, model: SynthesisModel) -> Path:
    """A run's folder with that model."""
    save_model(folder / MODEL_NAME, model, {})
    return folder
