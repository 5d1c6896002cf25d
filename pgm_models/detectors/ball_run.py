"""A training run of a ball network: clips found and prepared, the network trained, calibrated and written as ONNX."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import torch

from pgm_data.dataset.files import whole_file
from pgm_data.detect.ball.network import BALL_NETWORK, Calibration
from pgm_data.scene import load_scene
from pgm_models.checkpoint import CHECKPOINT_NAME, load_checkpoint, provenance
from pgm_models.detectors.ball_frames import BallClip, divide_matches, prepare_ball_clip
from pgm_models.detectors.ball_net import BALL_PRESETS, BallNet, BallPreset
from pgm_models.detectors.ball_score import calibrate, predict_frames, score_frames
from pgm_models.detectors.ball_task import BallTask, BallTaskOptions
from pgm_models.detectors.clip_pictures import FrameSet, GrowingClips
from pgm_models.detectors.export import ball_network_from_checkpoint, export_ball
from pgm_models.train import Outcome, TrainOptions, train

SCORED_FRAMES = 240
"""Held-out frames on which a finished network is scored and calibrated."""


@dataclass(frozen=True, eq=False, kw_only=True)
class BallRunOptions:
    """What is trained on what, and for how long."""

    datasets: tuple[Path, ...]
    """Folders searched for clips with a true camera and ball."""
    run: Path
    """Folder of the run."""
    scene: str = "tennis"
    """Scene whose ball is learned."""
    preset: BallPreset = "small"
    """Size of the network."""
    minutes: float = 0.0
    """Minutes of training, or 0 where steps count."""
    steps: int = 0
    """Optimiser steps, or 0 where minutes count."""
    batch: int = 32
    """Crops per step."""
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


def ball_clips(options: BallRunOptions, *, show: Callable[[str], None]) -> GrowingClips[BallClip]:
    """The clips of the datasets, prepared.

    Raises:
        NoFrames: If there are none.
    """
    scene = load_scene(options.scene)
    return GrowingClips(
        options.datasets,
        ("ball.parquet",),
        lambda folder, video: prepare_ball_clip(folder, video, options.run / "frames", scene),
        divide_matches,
        growing=options.look_again_minutes > 0,
        show=show,
    )


def train_ball(
    options: BallRunOptions, *, command: list[str], show: Callable[[str], None] = lambda line: None
) -> Outcome:
    """Train a ball network, or go on with the run that is there; then score and calibrate it.

    Raises:
        NoFrames: If the datasets have no clips.
        ValueError: If the scene has no ball.
    """
    clips = ball_clips(options, show=show)
    task = BallTask(clips, BallTaskOptions(preset=options.preset, batch=options.batch, seed=options.seed))
    torch.manual_seed(options.seed)
    network = BallNet(BALL_PRESETS[options.preset])
    # About 1.5 times faster on a CPU than planes.
    network = network.to(memory_format=torch.channels_last)  # pyright: ignore[reportCallIssue] torch's stubs lack it
    training = TrainOptions(
        steps=options.steps,
        minutes=options.minutes,
        learning_rate=options.learning_rate,
        precision=options.precision,
        seed=options.seed,
        threads=options.threads,
        average=0.998,
        clip=10.0,
        checkpoint_minutes=3.0,
    )
    growing = options.look_again_minutes > 0
    stop = clips.keep_looking(60 * options.look_again_minutes) if growing else lambda: None
    try:
        outcome = train(network, task, training, options.run, provenance=provenance(command), show=show)
    finally:
        stop()
    return outcome


def held_out_frames(frames: FrameSet[BallClip], most: int) -> list[tuple[BallClip, int]]:
    """Up to that many held-out frames, evenly chosen."""
    chosen = np.linspace(0, len(frames.held_out) - 1, min(most, len(frames.held_out))).astype(int)
    return [(frames.clips[c], int(f)) for c, f in frames.held_out[chosen]]


def export_ball_run(options: BallRunOptions, *, show: Callable[[str], None] = lambda line: None) -> Path:
    """Score and calibrate the run's averaged weights on held-out frames and write them as ONNX; the file's path.

    Frames are looked at as they are and at half their size, as the reader's faster preset does.
    """
    checkpoint = load_checkpoint(options.run / CHECKPOINT_NAME)
    network = ball_network_from_checkpoint(checkpoint)
    torch.set_num_threads(options.threads)
    frames = held_out_frames(ball_clips(options, show=lambda line: None)(), SCORED_FRAMES)
    calibration = Calibration()
    figures: dict[str, dict[str, float]] = {}
    if frames:
        whole = predict_frames(network, frames)
        half = predict_frames(network, frames, widest=640)
        calibration = calibrate((whole, half))
        figures = {"1280": score_frames(whole), "640": score_frames(half)}
        for width, said in figures.items():
            show(f"held out, {width} wide: " + "  ".join(f"{name} {value:.4g}" for name, value in said.items()))
        with whole_file(options.run / "held_out.json") as temporary:
            temporary.write_text(json.dumps(figures, indent=1) + "\n")
    path = options.run / BALL_NETWORK
    about = {
        "step": checkpoint.step,
        "minutes": round(checkpoint.elapsed_s / 60, 1),
        "train": checkpoint.options["train"],
        "options": checkpoint.options["task"]["options"],
        "held_out": figures,
    }
    export_ball(network, calibration, path, about=about)
    return path
