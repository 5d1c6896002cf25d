"""The jobs of a trade of the animation model: trainings, and evaluations of what they made."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import torch

from pgm_data.stages.jobs import Job
from pgm_models.animation.evaluate_run import DIGITS, RunEvaluationOptions, evaluate_run
from pgm_models.animation.evaluation_result import result_to_json
from pgm_models.animation.filled_windows import EvaluateOptions
from pgm_models.animation.presets import PRESETS
from pgm_models.animation.run import AnimationRunOptions, train_animation
from pgm_models.animation.sample import SampleOptions
from pgm_models.animation.store import dataset_identity
from pgm_models.model_trade import made_by, trained, training_command
from pgm_models.train import Outcome

RUNS_NAME, EVALUATIONS_NAME, CACHE_NAME = "runs", "evaluations", "cache"
"""Folders of a trade: its trainings; finished tasks of its evaluations; and what is computed once from its datasets."""


@dataclass(frozen=True, kw_only=True)
class Training:
    """One model that is trained."""

    design: str = "ours"
    """Of `DESIGNS`."""
    masks: str = "all"
    """Group of masking strategies."""
    share: float = 1.0
    """Of the dataset."""
    seed: int = 0

    @property
    def name(self) -> str:
        """Of its folder and in tables."""
        parts = [self.design]
        if self.masks != "all":
            parts.append(self.masks)
        if self.share != 1.0:
            parts.append(f"{100 * self.share:g}percent")
        return "_".join([*parts, f"seed{self.seed}"])


@dataclass(frozen=True, kw_only=True)
class Evaluation:
    """One way to use one model."""

    model: Training | None
    """What is used; None for a run that was there before."""
    sampler: str = "sde_2m"
    """Of the samplers; counts for nothing where the model reconstructs."""
    steps: int = 16
    """Evaluations of the network; 1 where the model reconstructs."""
    windows: int = 2_048
    """Of which one sample is drawn."""
    several: int = 64
    """Of those, of which several samples are drawn; 0 for none."""
    physics: bool = True
    """Whether physics is judged also at the data's own rate."""

    @property
    def name(self) -> str:
        """Unique among the evaluations of a trade."""
        of = "given" if self.model is None else self.model.name
        return f"{of} {self.sampler}-{self.steps} on {self.windows}"


@dataclass(frozen=True, kw_only=True)
class RunManner:
    """How everything of a trade is trained and evaluated, the same for all of it."""

    dataset: Path
    """What is learned from."""
    test: Path
    """Other matches, all for evaluation; of the same dataset its test split."""
    out: Path
    """Folder of the trade."""
    preset: str = "tiny"
    steps: int = 0
    """Of training; 0 for the preset's."""
    encoder: str = ""
    """Frozen text encoder; empty for the preset's."""
    rates: tuple[float, float] = (4.0, 25.0)
    """Lowest and highest rate of training windows, frames a second."""
    rate: float = 4.0
    """Of the windows that are evaluated, frames a second."""
    device: str = "auto"
    precision: Literal["float32", "bfloat16"] = "float32"
    """Of training's inner arithmetic; evaluations are computed in float32."""
    threads: int = 1
    """CPU threads of each job."""
    given: Path | None = None
    """A run that was there before."""

    def folder(self, model: Training | None) -> Path:
        """Where the model lies.

        Raises:
            ValueError: If it is the run that was there before, and there is none.
        """
        if model is not None:
            return self.out / RUNS_NAME / model.name
        if self.given is None:
            raise ValueError("given: expected a run, got none")
        return self.given

    def conditions(self) -> dict[str, str | int | float]:
        """What figures of a model's name depend on besides the name: they are compared only where it is the same."""
        preset = PRESETS[self.preset]
        low, high = self.rates
        return {
            "preset": self.preset,
            "training_steps": self.steps or preset.steps,
            "encoder": self.encoder or preset.encoder,
            "lowest_rate": low,
            "highest_rate": high,
            "rate": self.rate,
            "precision": self.precision,
            "dataset": dataset_identity(self.dataset)[:DIGITS],
            "test": dataset_identity(self.test)[:DIGITS],
        }


def training_job(model: Training, manner: RunManner) -> Job:
    """The job that trains the model, or goes on with it."""
    arguments = {
        "name": model.name,
        "dataset": str(manner.dataset),
        "run": str(manner.folder(model)),
        "cache": str(manner.out / CACHE_NAME),
        "preset": manner.preset,
        "design": model.design,
        "masks": model.masks,
        "share": model.share,
        "seed": model.seed,
        "steps": manner.steps,
        "encoder": manner.encoder,
        "rates": list(manner.rates),
        "device": manner.device,
        "precision": manner.precision,
        "threads": manner.threads,
        "conditions": manner.conditions(),
    }
    return Job(
        name=f"train {model.name}",
        stage="animation_training",
        entry=f"{__name__}:train_model",
        arguments=arguments,
        retries=1,  # it goes on from its last checkpoint
    )


def evaluation_job(evaluation: Evaluation, manner: RunManner) -> Job:
    """The job that evaluates; it goes on after the last task that is finished."""
    arguments = {
        "name": evaluation.name,
        "run": str(manner.folder(evaluation.model)),
        "parts": str(manner.out / EVALUATIONS_NAME / evaluation.name.replace(" ", "_")),
        "dataset": str(manner.dataset),
        "test": str(manner.test),
        "cache": str(manner.out / CACHE_NAME),
        "sampler": evaluation.sampler,
        "steps": evaluation.steps,
        "windows": evaluation.windows,
        "several": evaluation.several,
        "physics": evaluation.physics,
        "rate": manner.rate,
        "device": manner.device,
        "threads": manner.threads,
        "conditions": manner.conditions(),
    }
    return Job(
        name=f"evaluate {evaluation.name}",
        stage="animation_evaluation",
        entry=f"{__name__}:evaluate_model",
        arguments=arguments,
    )


def train_model(arguments: Mapping, report: Callable[[dict], None]) -> dict:
    """Carry out the job of `training_job`; one row of figures.

    Raises:
        InterruptedError: If it was asked to stop; what it had learned is kept.
    """
    paths = {name: Path(arguments[name]) for name in ("dataset", "run", "cache")}
    values = {name: arguments[name] for name in arguments if name not in (*paths, "name", "rates", "conditions")}
    low, high = arguments["rates"]
    options = AnimationRunOptions(**paths, **values, rates=(low, high))
    total = options.steps or PRESETS[options.preset].steps

    def train(show: Callable[[str], None]) -> Outcome:
        return train_animation(options, command=_command(arguments), show=show)

    return trained(arguments["name"], train, total, report, conditions=arguments["conditions"])


def _command(arguments: Mapping) -> list[str]:
    """The command that trains the same model."""
    names = ("preset", "design", "masks", "share", "seed", "steps", "encoder", "device", "precision", "threads")
    return [*training_command("animation", arguments, names), "--rates", *map(str, arguments["rates"])]


def evaluate_model(arguments: Mapping, report: Callable[[dict], None]) -> dict:
    """Carry out the job of `evaluation_job`; one row with the result."""
    torch.set_num_threads(arguments["threads"])
    options = RunEvaluationOptions(
        run=Path(arguments["run"]),
        dataset=Path(arguments["test"]),
        reference=Path(arguments["dataset"]),
        cache=Path(arguments["cache"]),
        split="" if arguments["test"] == arguments["dataset"] else "all",
        rate=arguments["rate"],
        physics_rate=None if arguments["physics"] else 0.0,
        sampling=SampleOptions(sampler=arguments["sampler"], steps=arguments["steps"]),
        scoring=EvaluateOptions(
            windows=arguments["windows"], several_windows=arguments["several"], device=arguments["device"]
        ),
    )
    result = evaluate_run(options, Path(arguments["parts"]), lambda line: report({"done": line}))
    row = {name: arguments[name] for name in ("name", "sampler", "steps", "windows")}
    made = made_by(arguments["conditions"])
    return {"rows": [{"kind": "evaluation", **row, **made, "result": result_to_json(result)}]}
