"""A training run of a court network: clips found and prepared, the network trained and written as ONNX."""

import json
import platform
import threading
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Literal

import torch

from pgm_data.court import Court
from pgm_data.dataset.files import whole_file
from pgm_data.scene import load_scene
from pgm_models.checkpoint import CHECKPOINT_NAME, load_checkpoint
from pgm_models.detectors.augment import AugmentOptions
from pgm_models.detectors.court_frames import ClipFrames, FrameSet, divide, find_clips, find_video, prepare_clip
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


class NoFrames(ValueError):
    """A dataset without a single usable clip."""


class GrowingFrames:
    """The frames of all prepared clips; a thread beside the training prepares what appears later."""

    def __init__(self, dataset: Path, cache: Path, court: Court, *, growing: bool, show: Callable[[str], None]) -> None:
        """Prepare what is there now; in a growing dataset, what is not whole yet waits for a later look.

        Raises:
            NoFrames: If there is no clip at all.
            ValueError: If a clip is not whole in a dataset that does not grow.
        """
        self._dataset, self._cache, self._court, self._growing, self._show = dataset, cache, court, growing, show
        self._clips: dict[str, ClipFrames] = {}
        self._stop = threading.Event()
        self.look()
        if not self._clips:
            raise NoFrames(f"{dataset}: expected clip folders with clip.json, camera.parquet and their video, got none")

    def __call__(self) -> FrameSet:
        """The frames known now."""
        return self._frames

    def look(self) -> None:
        """Prepare clips that are new."""
        for folder in find_clips(self._dataset):
            if folder.name in self._clips or self._stop.is_set():
                continue
            try:
                clip = prepare_clip(folder, find_video(folder, self._dataset), self._cache, self._court)
            except ValueError as error:
                if not self._growing:
                    raise
                self._show(f"not yet usable: {error}")
                continue
            self._clips[folder.name] = clip
            self._frames = divide(list(self._clips.values()))
            self._show(f"{folder.name}: {len(clip)} frames; {len(self._frames.training)} to train on")

    def keep_looking(self, every_s: float) -> Callable[[], None]:
        """Look again and again in a thread of its own until the returned function is called."""

        def work() -> None:
            while not self._stop.wait(every_s):
                self.look()

        thread = threading.Thread(target=work, daemon=True)
        thread.start()

        def stop() -> None:
            self._stop.set()
            thread.join()

        return stop


def train_court(
    options: CourtRunOptions, *, command: list[str], show: Callable[[str], None] = lambda line: None
) -> Outcome:
    """Train a court network, or go on with the run that is there.

    Raises:
        ValueError: If the scene has no court or the dataset no clips.
    """
    court = load_scene(options.scene).court
    if court is None:
        raise ValueError(f"scene {options.scene}: expected a court, got none")
    growing = options.look_again_minutes > 0
    frames = GrowingFrames(options.dataset, options.run / "frames", court, growing=growing, show=show)
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


def provenance(command: list[str]) -> dict[str, object]:
    """What made a checkpoint: command, versions and kind of machine."""
    return {
        "command": command,
        "versions": {name: version(name) for name in ("torch", "numpy", "opencv-contrib-python-headless")},
        "machine": f"{platform.system()} {platform.machine()}, {torch.get_num_threads()} threads",
    }
