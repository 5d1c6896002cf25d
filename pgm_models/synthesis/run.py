"""A training run of the synthesis model: a dataset with videos in; checkpoint, log, pictures and one model file out."""

from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
import torch

from pgm_models.checkpoint import CHECKPOINT_NAME, provenance
from pgm_models.model_file import MODEL_NAME
from pgm_models.processes import device_of, launched_processes, leads
from pgm_models.synthesis.frames import FrameStore, held_out, read_frames
from pgm_models.synthesis.losses import eye_loss
from pgm_models.synthesis.match_styles import match_styles
from pgm_models.synthesis.model import ModelOptions, SynthesisModel, save_model
from pgm_models.synthesis.patches import PatchOptions, PatchSource
from pgm_models.synthesis.presets import PRESETS, PresetChanges, changed_preset, design_named
from pgm_models.synthesis.rays import camera_rays, picture_pixels
from pgm_models.synthesis.surfaces import Plane
from pgm_models.synthesis.task import SynthesisTask
from pgm_models.train import Outcome, TrainOptions, train

HELD_OUT_BATCHES = 8
MAP_FRAMES = 200
"""Frames whose views decide where planes have their cells."""
MAP_BINS = 512
"""Places along each axis of a plane at which pixels are counted."""
MAP_STRIDE = 4
"""Of the pixels, along each axis, that are counted."""


@dataclass(frozen=True, eq=False, kw_only=True)
class SynthesisRunOptions:
    """What is trained on what, and for how long."""

    dataset: Path
    """As `pgm pack` and `pgm simulate` write it, with videos."""
    run: Path
    """Folder of the run."""
    preset: str = "small"
    """Of `PRESETS`."""
    design: str = "ours"
    """Of `SYNTHESIS_DESIGNS`."""
    changes: PresetChanges = field(default_factory=PresetChanges)
    """What is otherwise than in the preset."""
    held_out: float = 0.1
    """Share of each match, its end, that is not trained on."""
    perceptual: Path | None = None
    """Weights of a VGG network for the perceptual loss; gradients and structure take its place without."""
    minutes: float = 0.0
    """Minutes of training; 0 where steps count."""
    steps: int = 0
    """Optimiser steps; 0 for the preset's where minutes do not count."""
    accumulate: int = 1
    """Batches whose gradients are averaged in one step."""
    learning_rate: float = 0.0
    """Highest learning rate; 0 for the preset's."""
    average: float = 0.999
    """Share the moving average of the weights keeps in a step."""
    precision: Literal["float32", "bfloat16"] = "float32"
    device: str = "auto"
    workers: int = 0
    """Processes that make batches."""
    threads: int = 2
    seed: int = 0
    checkpoint_minutes: float = 4.0


def train_synthesis(
    options: SynthesisRunOptions, *, command: list[str], show: Callable[[str], None] = lambda line: None
) -> Outcome:
    """Train the model, or go on with the run that is there; a finished run holds its model file.

    Raises:
        ValueError: If the dataset has no frame with a camera and a picture, or the run was begun with other options.
        FloatingPointError: If a loss is not finite; names the frames.
    """
    design, preset = design_named(options.design), changed_preset(PRESETS[options.preset], options.changes)
    store = read_frames(options.dataset, picture=preset.picture)
    store.check_videos()
    apart = held_out(store, share=options.held_out)
    learned, judged = store[~apart], store[apart]
    patches = PatchOptions(
        patch=preset.patch, patches=preset.patches, pairs=preset.pairs, whole=preset.picture[0], seed=options.seed
    )
    source = PatchSource(learned, patches)
    fixed = []
    if len(judged):
        judge = PatchSource(judged, PatchOptions(patch=preset.patch, pairs=2, swap=0.0, seed=1_000_000))
        fixed = [judge.batch(number) for number in range(HELD_OUT_BATCHES)]
    show(f"{len(learned)} frames to learn from, {len(judged)} held out, of {len(store.clips)} clips")
    model_options = ModelOptions(
        scene=store.scene.name,
        fields=preset.fields,
        enhancer=preset.enhancer,
        style=preset.style,
        picture=store.size,
        seed=0,
        design=design,
    )
    torch.manual_seed(options.seed)
    model = SynthesisModel(model_options)
    if not (options.run / CHECKPOINT_NAME).exists():
        fit_planes(model, learned)
    show(f"{sum(p.numel() for p in model.parameters()) / 1e6:.2f} million weights")
    device = device_of(options.device)
    task = SynthesisTask(
        model_options,
        source.batch,
        eye_loss(options.perceptual, device),
        held_out=fixed,
        data={
            "dataset": options.dataset.name,
            "preset": options.preset,
            "design": options.design,
            "changes": asdict(options.changes),
            "held_out": options.held_out,
            "frames": len(learned),
        },
        look=_look(judged if len(judged) else learned),
    )
    training = TrainOptions(
        steps=0 if options.minutes else options.steps or preset.steps,
        minutes=options.minutes,
        accumulate=max(options.accumulate, launched_processes()),
        learning_rate=options.learning_rate or preset.learning_rate,
        average=options.average,
        precision=options.precision,
        checkpoint_minutes=options.checkpoint_minutes,
        seed=options.seed,
        threads=options.threads,
        device=str(device),
        workers=options.workers,
    )
    outcome = train(model, task, training, options.run, provenance=provenance(command), show=show)
    if outcome.state == "done" and leads():
        assert isinstance(outcome.network, SynthesisModel)
        figures = task.validate(outcome.network)
        outcome.network.keep_styles(match_styles(outcome.network, learned))
        about = {"step": outcome.step, "elapsed_s": round(outcome.elapsed_s, 1), "held_out": figures, **task.describe()}
        about.pop("model")
        about |= {"seed": options.seed, **provenance(command)}
        save_model(options.run / MODEL_NAME, outcome.network, about)
        task.look(outcome.network, options.run, outcome.step)
        show("held out: " + "  ".join(f"{name} {value:.4g}" for name, value in figures.items()))
    return outcome


def _look(store: FrameStore) -> Callable[[SynthesisModel, Path, int], None]:
    """What draws a few frames of a store as the model renders them."""

    def look(model: SynthesisModel, run: Path, step: int) -> None:
        from pgm_models.synthesis.training_pictures import training_pictures

        training_pictures(store)(model, run, step)

    return look


def fit_planes(model: SynthesisModel, store: FrameStore) -> None:
    """Give the places of planes that pixels show most the most cells."""
    width, height = store.size
    pixels = picture_pixels(width, height).reshape(height, width, 2)[::MAP_STRIDE, ::MAP_STRIDE].reshape(-1, 2)
    rows = np.unique(np.linspace(0, len(store) - 1, MAP_FRAMES).astype(np.int64))
    for name in model.fields.planes:
        plane = model.fields.surface(name)
        assert isinstance(plane, Plane)
        seen = torch.zeros(2, MAP_BINS)
        for row in rows.tolist():
            rays = camera_rays(store.cameras[row], pixels)
            met = plane.meet(rays)
            share = plane.across(rays.at(torch.where(met.met, met.depth, 0.0)))[met.met]
            bins = (share * MAP_BINS).long().clamp(0, MAP_BINS - 1)
            seen += torch.stack([torch.bincount(bins[:, axis], minlength=MAP_BINS).float() for axis in range(2)])
        plane.fit_maps(seen)
