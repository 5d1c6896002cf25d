"""`pgm-train synthesis DATASET --out RUN`: the model that renders states."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from .console import option_error
from .training import command_line, interrupted, make_way, show


@dataclass(frozen=True, kw_only=True)
class SynthesisTraining:
    """Train the model that renders any state from any view; several processes through torchrun."""

    dataset: tyro.conf.Positional[Path]
    """Packed dataset with its videos, as `pgm pack` and `pgm simulate` write it."""
    out: Path
    """Folder of the run: checkpoint, log, model."""
    preset: Literal["nano", "tiny", "small", "base", "paper"] = "small"
    """Size, and how it is trained unless options here say otherwise."""
    design: Literal[
        "ours", "no_enhancer", "no_deformation", "no_planes", "no_voxels", "no_style_encoder", "playable"
    ] = "ours"
    """Ours; ours without its enhancer, its skinning, its planes, its voxels or its shared style encoder, as the paper
    compares; or fields of networks at a quarter of the resolution with an upsampler, as in Playable Environments."""
    held_out: float = 0.1
    """Share of each match, its end, that is not trained on."""
    perceptual: Path | None = None
    """Weights of a VGG16 or VGG19 for the perceptual loss; without, gradients and structure are compared."""
    average: float = 0.999
    """Share the moving average of the weights keeps in a step."""
    steps: int = 0
    """Optimiser steps; the preset's unless given."""
    minutes: float = 0.0
    """Minutes of training instead of steps; the learning rate follows the clock."""
    accumulate: int = 1
    """Batches whose gradients are averaged in one step; at least the processes of torchrun."""
    learning_rate: float = 0.0
    """Highest learning rate; the preset's unless given."""
    precision: Literal["float32", "bfloat16"] = "float32"
    """Of the inner arithmetic; bfloat16 is faster on GPUs and on CPUs that know it, slower on others."""
    device: str = "auto"
    """auto, cpu, cuda or cuda:N."""
    workers: int = 0
    """Processes that read patches; 0 for a thread beside the training."""
    threads: int = 2
    """CPU threads."""
    seed: int = 0
    """Of weights, frames, patches and styles."""
    checkpoint_minutes: float = 4.0
    """Minutes between checkpoints, each with the quality of held-out patches."""
    resume: bool = False
    """Go on with the run in `out`."""
    overwrite: bool = False
    """Delete the checkpoint and log in `out` first."""


def train_synthesis_model(options: Annotated[SynthesisTraining, tyro.conf.arg(name="")]) -> int:
    """Train the model that renders any state from any view; several processes through torchrun."""
    if not (options.dataset / "meta" / "info.json").is_file():
        raise option_error("DATASET", expected="a packed dataset, with meta/info.json", got=options.dataset)
    for name, value in {"--steps": options.steps, "--minutes": options.minutes}.items():
        if value < 0:
            raise option_error(name, expected="0 or more", got=value)
    if not 0 <= options.held_out < 1:
        raise option_error("--held-out", expected="0 or more, and below 1", got=options.held_out)
    if options.accumulate < 1:
        raise option_error("--accumulate", expected="1 or more", got=options.accumulate)
    from pgm_models.model_file import MODEL_NAME
    from pgm_models.processes import leads
    from pgm_models.synthesis.run import SynthesisRunOptions, train_synthesis

    if leads():
        make_way(options.out, resume=options.resume, overwrite=options.overwrite)
    values = asdict(options)
    values["run"] = values.pop("out")
    for name in ("resume", "overwrite"):
        values.pop(name)
    outcome = train_synthesis(
        SynthesisRunOptions(**values), command=command_line(), show=show if leads() else lambda line: None
    )
    if outcome.state == "interrupted":
        return interrupted(outcome)
    if leads():
        print(f"wrote {options.out / MODEL_NAME}")
    return 0
