"""A training run of a court network: clips found and prepared, the network trained and written as ONNX."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import torch

from pgm_data.dataset.files import whole_file
from pgm_data.scene import load_scene
from pgm_models.checkpoint import CHECKPOINT_NAME, load_checkpoint, provenance
from pgm_models.detectors.augment import AugmentOptions
from pgm_models.detectors.clip_pictures import GrowingClips
from pgm_models.detectors.court_frames import divide, prepare_clip
from pgm_models.detectors.court_task import CourtTask, CourtTaskOptions
from pgm_models.detectors.export import export_court, network_from_checkpoint
from pgm_models.detectors.heatmap_net import PRESETS, HeatmapNet, Preset
from pgm_models.train import Outcome, TrainOptions, train


@dataclass(frozen=True, eq=False, kw_only=True)
class CourtRunOptions:
    """What is trained on what, and for how long."""

    dataset: Path
    """Folder searched for clips with a truth camera."""
    run: Path
    """Folder of the run."""
    scene: str = "tennis"
    """Scene whose court is learned."""
    preset: Preset = "small"
    """Size of the network."""
    minutes: float = 0.0
    """Minutes of training, or 0 where steps count."""
    steps: int = 0
    """Optimiser steps, or 0 where minutes count."""
    batch: int = 16
    """Pictures per step."""
    learning_rate: float = 2e-3
    """Highest learning rate."""
    precision: Literal["float32", "bfloat16"] = "bfloat16"
    """Of the inner arithmetic."""
    threads: int = 2
    """CPU threads."""
    seed: int = 0
    """Of everything random."""
    look_again_minutes: float = 0.0
    """Time between looks for new clips; 0 for none."""


def train_court(
    options: CourtRunOptions, *, command: list[str], show: Callable[[str], None] = lambda line: None
) -> Outcome:
    """Train a court network, or go on with the run that is there.

    Raises:
        NoFrames: If the dataset has no clips.
        ValueError: If the scene has no court.
    """
    court = load_scene(options.scene).court
    if court is None:
        raise ValueError(f"scene {options.scene}: expected a court, got none")
    growing = options.look_again_minutes > 0
    frames = GrowingClips(
        (options.dataset,),
        (),
        lambda folder, video: prepare_clip(folder, video, options.run / "frames", court),
        divide,
        growing=growing,
        show=show,
    )
    shown = CourtTaskOptions(preset=options.preset, batch=options.batch, seed=options.seed)
    task = CourtTask(court, frames, shown, AugmentOptions())
    torch.manual_seed(options.seed)
    network = HeatmapNet(len(court.all_names), PRESETS[options.preset])
    # About 1.5 times faster on a CPU than planes.
    network = network.to(memory_format=torch.channels_last)  # pyright: ignore[reportCallIssue] torch's stubs lack it
    training = TrainOptions(
        steps=options.steps,
        minutes=options.minutes,
        learning_rate=options.learning_rate,
        precision=options.precision,
        seed=options.seed,
        threads=options.threads,
    )
    stop = frames.keep_looking(60 * options.look_again_minutes) if growing else lambda: None
    try:
        outcome = train(network, task, training, options.run, provenance=provenance(command), show=show)
    finally:
        stop()
    if outcome.state == "done":
        figures = task.validate(outcome.network)
        show("held out: " + "  ".join(f"{name} {value:.4g}" for name, value in figures.items()))
        with whole_file(options.run / "held_out.json") as temporary:
            temporary.write_text(json.dumps(figures, indent=1) + "\n")
    return outcome


def export_run(run: Path, scene: str) -> Path:
    """Write the run's averaged weights as the scene's ONNX file into the run; its path."""
    court = load_scene(scene).court
    if court is None or not court.network:
        raise ValueError(f"scene {scene}: expected a court with a network's file name, got none")
    checkpoint = load_checkpoint(run / CHECKPOINT_NAME)
    path = run / court.network
    about = {"step": checkpoint.step, "minutes": round(checkpoint.elapsed_s / 60, 1), "options": checkpoint.options}
    export_court(network_from_checkpoint(checkpoint), court.all_names, path, about=about)
    return path
