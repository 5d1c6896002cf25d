"""`pgm evaluate RUN DATASET`: how well a trained animation model does the paper's tasks on matches it has not seen."""

import json
import tempfile
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import tyro

from .console import Progress, UsageError, option_error, print_error
from .output import prepare_output

if TYPE_CHECKING:
    from pgm_models.animation.evaluate_run import RunEvaluationOptions

NOTHING_USABLE = 4
CACHE, PARTS = "cache", "tasks"
"""Folders in the output: what is computed once from the dataset, and the results of finished tasks."""

OPTIONS = {"dataset": "DATASET", "task": "--tasks", **{name: f"--{name}" for name in ("reference", "split", "device")}}
"""How options of the evaluation are written on the command line."""


@dataclass(frozen=True, kw_only=True)
class EvaluateCommand:
    """Score an animation model: action-conditioned and unconditioned prediction, opponent modelling, completion.

    L2 and Frechet distances of positions, root angles and joints as in the paper, with the distance between real
    windows beside them; best and mean of several samples, energy score, MMD; physics of ball and feet.
    Exit codes: 0 all well; 2 options that do not fit; 4 too few windows to compare.
    """

    run: tyro.conf.Positional[Path]
    """Run of pgm-train animation, a model file, or the name of a model that ships with pgm."""
    dataset: tyro.conf.Positional[Path]
    """Packed dataset with matches that the model has not learned from."""
    out: Path | None = None
    """Folder to write into: tables, CSV, JSON, and each finished task. Without it the tables are printed only."""
    reference: Path | None = None
    """Packed dataset of other matches, for the real-to-real distance; other matches of the same unless given."""
    split: Literal["auto", "test", "val", "train", "all"] = "auto"
    """Matches that are scored; auto takes test, else val, else all."""
    tasks: tuple[Literal["prediction", "unconditioned", "opponent", "completion"], ...] = ()
    """Which tasks; all that the scene has unless given."""
    sampler: Literal["ddpm", "ddim", "dpmpp_2m", "sde_2m"] = "sde_2m"
    """How noise is turned into states."""
    steps: int = 16
    """Evaluations of the network for a window."""
    guidance: float = 1.0
    """How far to go beyond what the text says; 1 for not."""
    temperature: float = 1.0
    """Scale of the noise."""
    windows: int = 2048
    """Windows at most, evenly spread over the matches; Frechet distances need about 2,000."""
    several_windows: int = 256
    """Windows of which several samples are drawn; 0 for none."""
    samples: int = 8
    """How many samples that is."""
    frames: int = 0
    """Length of windows; the model's unless given."""
    rate: float = 4.0
    """Frames a second of the windows."""
    physics_rate: float | None = None
    """Frames a second at which physics is judged besides; the data's own unless given, 0 for none."""
    batch: int = 64
    """Windows that are filled in at once."""
    device: str = "auto"
    """auto, cpu, cuda or cuda:N."""
    seed: int = 0
    """Of the noise."""
    threads: int = 2
    """CPU threads."""
    cache: Path | None = None
    """Folder for states and text features, to be shared between runs; inside `out` unless given."""
    json: bool = False
    """Print one JSON document instead of the tables."""
    resume: bool = False
    """Go on in `out`: tasks that are finished there are not done again."""
    overwrite: bool = False
    """Delete what an earlier run wrote into `out`, and begin again."""


def main(argv: list[str]) -> int:
    """Run the command; its exit code."""
    command = tyro.cli(EvaluateCommand, args=argv, prog="pgm evaluate")
    for option, folder in (("DATASET", command.dataset), ("--reference", command.reference)):
        if folder is not None and not (folder / "meta" / "info.json").is_file():
            raise option_error(option, expected="a folder that pgm pack wrote", got=folder)
    if command.out is None and (command.resume or command.overwrite):
        raise option_error("--out", expected="a folder, as --resume or --overwrite is given", got="none")
    import torch

    from pgm_models.animation.evaluate_run import TooFewWindows, evaluate_run
    from pgm_models.animation.evaluate_tables import evaluation_text, write_evaluation
    from pgm_models.animation.evaluation_result import result_to_json

    torch.set_num_threads(command.threads)
    with ExitStack() as stack:
        if command.out is not None:
            stack.enter_context(prepare_output(command.out, resume=command.resume, overwrite=command.overwrite))
            inside = command.out
        else:
            inside = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        cache = command.cache if command.cache is not None else inside / CACHE
        cache.mkdir(parents=True, exist_ok=True)
        progress = Progress(total=1, unit="evaluation")
        stack.callback(progress.close)
        try:
            options = _options(command, cache)
            parts = command.out / PARTS if command.out is not None else None
            result = evaluate_run(options, parts, show=lambda line: progress.update(line, float("nan")))
        except TooFewWindows as error:
            print_error(str(error))
            return NOTHING_USABLE
        except ValueError as error:
            name, _, said = str(error).partition(": ")
            raise UsageError(f"{OPTIONS.get(name, name)}: {said}" if said else str(error)) from error
        progress.close()
        if command.out is not None:
            write_evaluation(command.out, command.run.name, result)
        print(
            json.dumps(result_to_json(result), indent=1)
            if command.json
            else evaluation_text({command.run.name: [result]}),
            end="\n" if command.json else "",
        )
    return 0


def _options(command: EvaluateCommand, cache: Path) -> "RunEvaluationOptions":
    from pgm_models.animation.evaluate_run import RunEvaluationOptions
    from pgm_models.animation.filled_windows import EvaluateOptions
    from pgm_models.animation.sample import SampleOptions

    return RunEvaluationOptions(
        run=command.run,
        dataset=command.dataset,
        cache=cache,
        reference=command.reference,
        split="" if command.split == "auto" else command.split,
        frames=command.frames,
        rate=command.rate,
        physics_rate=command.physics_rate,
        sampling=SampleOptions(
            sampler=command.sampler,
            steps=command.steps,
            guidance=command.guidance,
            temperature=command.temperature,
        ),
        scoring=EvaluateOptions(
            windows=command.windows,
            several_windows=command.several_windows,
            samples=command.samples,
            tasks=command.tasks,
            batch=command.batch,
            device=command.device,
            seed=command.seed,
        ),
    )
