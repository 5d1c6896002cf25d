"""A training run of the network that tells contacts from a ball's track: simulated plays in, one ONNX file out."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import torch

from pgm_data.detect.ball.track_network import NETWORK_FILE
from pgm_models.checkpoint import CHECKPOINT_NAME, load_checkpoint, provenance
from pgm_models.detectors.track_event_net import TrackEventNet, export_track_events
from pgm_models.detectors.track_event_plays import find_plays
from pgm_models.detectors.track_event_task import TrackEventTask, TrackEventTaskOptions
from pgm_models.train import Outcome, TrainOptions, train


@dataclass(frozen=True, eq=False, kw_only=True)
class TrackEventRunOptions:
    """What is trained on what, and for how long."""

    dataset: Path
    """Folder searched for clips with the truth of a play: `pgm simulate --pictures none` is enough."""
    run: Path
    """Folder of the run."""
    minutes: float = 0.0
    """Minutes of training, or 0 where steps count."""
    steps: int = 0
    """Optimiser steps, or 0 where minutes count."""
    batch: int = 16
    """Windows of about ten seconds per step."""
    learning_rate: float = 3e-3
    """Highest learning rate."""
    threads: int = 1
    """CPU threads."""
    seed: int = 0
    """Of everything random."""


def train_track_events(
    options: TrackEventRunOptions, *, command: list[str], show: Callable[[str], None] = lambda line: None
) -> Outcome:
    """Train the network, or go on with the run that is there; a finished run holds its ONNX file.

    Raises:
        ValueError: If the dataset has no play.
    """
    plays = find_plays(options.dataset)
    show(f"{len(plays)} plays, {sum(len(play.event_times) for play in plays)} events")
    task = TrackEventTask(plays, TrackEventTaskOptions(batch=options.batch, seed=options.seed))
    torch.manual_seed(options.seed)
    training = TrainOptions(
        steps=options.steps,
        minutes=options.minutes,
        learning_rate=options.learning_rate,
        seed=options.seed,
        threads=options.threads,
    )
    outcome = train(TrackEventNet(), task, training, options.run, provenance=provenance(command), show=show)
    if outcome.state == "done":
        export_run(options.run)
        show("held out: " + "  ".join(f"{name} {value:.4g}" for name, value in task.validate(outcome.network).items()))
    return outcome


def export_run(run: Path) -> Path:
    """Write the run's averaged weights as an ONNX file into the run; its path."""
    checkpoint = load_checkpoint(run / CHECKPOINT_NAME)
    network = TrackEventNet()
    network.load_state_dict(dict(checkpoint.average))
    path = run / NETWORK_FILE
    about = {"step": checkpoint.step, "minutes": round(checkpoint.elapsed_s / 60, 1), "options": checkpoint.options}
    export_track_events(network, path, about=about)
    return path
