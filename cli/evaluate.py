"""`pgm evaluate RUN DATASET`: how well a trained model does on what it has not seen.

An animation model does the paper's tasks; of a synthesis model, told by its model file, see `evaluate_synthesis`.
"""

import json
import tempfile
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import tyro

from .console import Progress, UsageError, option_error, print_error
from .output import prepare_output

if TYPE_CHECKING:
    from pgm_models.animation.evaluate_run import RunEvaluationOptions

NOTHING_USABLE = 4
CACHE, PARTS, WORDS = "cache", "tasks", "words.json"
"""Folders in the output: what is computed once from the dataset, and the results of finished tasks."""

OPTIONS = {"dataset": "DATASET", "task": "--tasks", **{name: f"--{name}" for name in ("reference", "split", "device")}}
"""How options of the evaluation are written on the command line."""


@dataclass(frozen=True, kw_only=True)
class EvaluateCommand:
    """Score an animation model: action-conditioned and unconditioned prediction, opponent modelling, completion.

    L2 and Frechet distances of positions, root angles and joints as in the paper, with the distance between real
    windows beside them; best and mean of several samples, energy score, MMD; physics of ball and feet.
    Of a run of pgm-train synthesis other things are scored: pgm evaluate RUN --help tells which.
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
    tries: int = 1
    """Samples of each window, of which the one is kept whose ball turns least in mid-air: several keep words better."""
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
    words: int = 256
    """Windows about hits in which strokes and targets are held against the captions; 0 for none."""
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
    if _renders(argv):
        from .evaluate_synthesis import main as evaluate_synthesis

        return evaluate_synthesis(argv)
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
            show = partial(_shown, progress)
            result = evaluate_run(options, parts, show=show)
            words = _words(command, options, show)
        except TooFewWindows as error:
            print_error(str(error))
            return NOTHING_USABLE
        except ValueError as error:
            name, _, said = str(error).partition(": ")
            raise UsageError(f"{OPTIONS.get(name, name)}: {said}" if said else str(error)) from error
        progress.close()
        if command.out is not None:
            write_evaluation(command.out, command.run.name, result)
        told = {} if words is None else words
        if command.json:
            print(json.dumps({**result_to_json(result), "words": told}, indent=1))
        else:
            print(evaluation_text({command.run.name: [result]}), end="")
            if told:
                print(f"\n{told['table']}")
    return 0


def _renders(argv: list[str]) -> bool:
    """Whether a word of the command line is a run of pgm-train synthesis."""
    paths = [Path(word) for word in argv if not word.startswith("-")]
    if not any(path.exists() for path in paths):
        return False
    from pgm_models.synthesis.evaluate_about import about_run

    return any(about_run(path) is not None for path in paths)


def _shown(progress: Progress, line: str) -> None:
    progress.update(line, float("nan"))


def _words(
    command: EvaluateCommand, options: "RunEvaluationOptions", show: Callable[[str], None]
) -> dict[str, object] | None:
    """How words were kept, as JSON values with a table; from an earlier run where that is gone on with."""
    from pgm_data.dataset.files import whole_file
    from pgm_models.animation.agreement_result import agreement_table, agreement_to_json
    from pgm_models.animation.evaluate_words import WordsOptions, evaluate_words

    kept = command.out / PARTS / WORDS if command.out is not None else None
    asked = {"windows": command.words} | {
        name: getattr(command, name) for name in ("steps", "guidance", "tries", "seed")
    }
    if kept is not None and command.resume and kept.is_file():
        found = json.loads(kept.read_text(encoding="utf-8"))
        if found.get("asked") == asked:
            return found
    result = evaluate_words(options, WordsOptions(windows=command.words), show) if command.words else None
    if result is None:
        return None
    tables = [
        f"{title}\n\n{agreement_table(result, kind=kind)}"
        for kind, title in (("all", "All hits: percent that agree with their captions"), ("rally", "Without serves"))
    ]
    told = {"asked": asked, **agreement_to_json(result), "table": "\n\n".join(tables) + "\n"}
    if command.out is not None and kept is not None:
        kept.parent.mkdir(parents=True, exist_ok=True)
        for path, text in ((kept, json.dumps(told, indent=1)), (command.out / "words.md", str(told["table"]))):
            with whole_file(path) as temporary:
                temporary.write_text(text, encoding="utf-8")
    return told


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
            tries=command.tries,
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
