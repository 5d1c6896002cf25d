"""A training run of the network that finds people in strips: courts and people drawn, one ONNX file out."""

import json
import warnings
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal

import torch

from pgm_data.dataset.files import whole_file
from pgm_data.detect.players.person_network import CHANNELS, PERSON_NETWORK, PersonCalibration
from pgm_data.detect.players.person_strips import ROWS
from pgm_data.scene import Scene, load_scene
from pgm_models.checkpoint import CHECKPOINT_NAME, load_checkpoint, provenance
from pgm_models.detectors.export import fold_norms, strip_sources, write_model
from pgm_models.detectors.person_backdrops import prepare_backdrops
from pgm_models.detectors.person_figures import Cast, draw_cast
from pgm_models.detectors.person_net import PersonNet
from pgm_models.detectors.person_task import PersonTask, PersonTaskOptions, calibrate, judge, score
from pgm_models.train import Outcome, TrainOptions, train

HELD_OUT_SEED = 1_000_000
"""Added to the seed of what is held out."""
HELD_OUT_PIECES = 36
"""Of each court that is held out."""
VIEWS = 6
"""Pictures of a court."""


@dataclass(frozen=True, eq=False, kw_only=True)
class PersonRunOptions:
    """What is drawn and trained on, and for how long."""

    run: Path
    """Folder of the run."""
    scene: str = "tennis"
    """Scene whose courts are drawn."""
    courts: int = 72
    """Courts to put people on, each drawn from several views; a ninth of them more are held out."""
    people: int = 240
    """Players to put on them; half as many others."""
    minutes: float = 0.0
    """Minutes of training, or 0 where steps count."""
    steps: int = 0
    """Optimiser steps, or 0 where minutes count."""
    batch: int = 48
    """Pieces of pictures per step."""
    learning_rate: float = 3e-3
    """Highest learning rate."""
    precision: Literal["float32", "bfloat16"] = "bfloat16"
    """Of the inner arithmetic."""
    threads: int = 1
    """CPU threads."""
    seed: int = 0
    """Of everything random."""


def person_task(options: PersonRunOptions, *, show: Callable[[str], None] = lambda line: None) -> PersonTask:
    """What the run learns; its courts are drawn, or read where they are there.

    Raises:
        ValueError: If the scene has no court, or the run's courts were drawn with other options.
    """
    scene = load_scene(options.scene)
    courts, held = options.courts, max(1, options.courts // 9)
    seed, other = options.seed, options.seed + HELD_OUT_SEED
    backdrops = prepare_backdrops(options.run / "backdrops", scene, worlds=courts, views=VIEWS, seed=seed, show=show)
    held_out = prepare_backdrops(options.run / "held_out", scene, worlds=held, views=4, seed=other, show=show)
    show(f"{options.people} players and {options.people // 2} others are dressed")
    casts = (_cast(seed, scene, options.people), _cast(other, scene, max(2, options.people // 6)))
    shown = PersonTaskOptions(batch=options.batch, seed=options.seed)
    return PersonTask(scene, backdrops, held_out, casts, shown, held_out_pieces=HELD_OUT_PIECES * held)


def _cast(seed: int, scene: Scene, players: int) -> Cast:
    """So many players; others, sets of officials and matches in proportion."""
    few = max(1, players // 10)
    return draw_cast(seed, scene, players=players, others=max(1, players // 2), officials=few, matches=few)


def train_people(
    options: PersonRunOptions, *, command: list[str], show: Callable[[str], None] = lambda line: None
) -> Outcome:
    """Train a person network, or go on with the run that is there; a finished run holds its ONNX file.

    Raises:
        ValueError: If the scene has no court.
    """
    task = person_task(options, show=show)
    torch.manual_seed(options.seed)
    # About 1.5 times faster on a CPU than planes.
    network = PersonNet().to(memory_format=torch.channels_last)  # pyright: ignore[reportCallIssue] torch's stubs lack it
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
    outcome = train(network, task, training, options.run, provenance=provenance(command), show=show)
    if outcome.state == "done":
        _export(options.run, task, show=show)
    return outcome


def export_people_run(options: PersonRunOptions, *, show: Callable[[str], None] = lambda line: None) -> Path:
    """Score and calibrate the run's averaged weights on what is held out and write them as ONNX; the file's path."""
    return _export(options.run, person_task(options), show=show)


def _export(run: Path, task: PersonTask, *, show: Callable[[str], None]) -> Path:
    checkpoint = load_checkpoint(run / CHECKPOINT_NAME)
    network = PersonNet()
    network.load_state_dict(dict(checkpoint.average))
    network.eval()
    judged = judge(*task.held_out_answers(network))
    figures = score(judged)
    show("held out: " + "  ".join(f"{name} {value:.4g}" for name, value in figures.items()))
    with whole_file(run / "held_out.json") as temporary:
        temporary.write_text(json.dumps(figures, indent=1) + "\n")
    about = {
        "step": checkpoint.step,
        "minutes": round(checkpoint.elapsed_s / 60, 1),
        "train": checkpoint.options["train"],
        "task": checkpoint.options["task"],
        "held_out": figures,
    }
    path = run / PERSON_NETWORK
    export_people(network, calibrate(judged), path, about=about)
    return path


def export_people(network: PersonNet, calibration: PersonCalibration, path: Path, *, about: dict[str, object]) -> None:
    """Write the network as one ONNX file with its calibration and `about`, JSON values, in its metadata.

    Input `strips` (any number, rows, columns, 3) uint8 blue, green, red, rows and columns multiples of 16; output
    `answers` (as many, channels, rows / 4, columns / 4).
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FutureWarning)  # the exporter warns of its own internals
        program = torch.onnx.export(
            fold_norms(network),
            (torch.zeros(2, ROWS, 96, 3, dtype=torch.uint8),),
            dynamo=True,
            input_names=["strips"],
            output_names=["answers"],
            verbose=False,
        )
    if program is None:
        raise RuntimeError(f"{path}: expected an ONNX program from torch.onnx.export, got none")
    model = program.model_proto
    strip_sources(model)
    del model.graph.value_info[:]  # lengths of what lies between
    for value, free in ((model.graph.input[0], (0, 1, 2)), (model.graph.output[0], (0, 2, 3))):
        for axis in free:
            value.type.tensor_type.shape.dim[axis].dim_param = f"{value.name}_{axis}"
    metadata = {"person_channels": list(CHANNELS), "calibration": asdict(calibration), "about": about}
    write_model(model, path, metadata)
