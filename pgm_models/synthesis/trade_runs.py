"""The jobs of a trade of the synthesis model: trainings, and evaluations of what they made."""

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Literal

import torch

from pgm_data.stages.jobs import Job
from pgm_models.model_trade import trained, training_command
from pgm_models.synthesis.evaluate_result import plain, summary_to_json
from pgm_models.synthesis.evaluate_run import SynthesisEvaluationOptions, evaluate_synthesis, open_judge
from pgm_models.synthesis.novel_view import NovelOptions
from pgm_models.synthesis.presets import PRESETS, PresetChanges
from pgm_models.synthesis.run import SynthesisRunOptions, train_synthesis
from pgm_models.train import Outcome

RUNS_NAME, EVALUATIONS_NAME = "runs", "evaluations"
"""Folders of a trade: its trainings, and finished clips of its evaluations."""


@dataclass(frozen=True, kw_only=True)
class Training:
    """One model that is trained."""

    design: str = "ours"
    """Of `SYNTHESIS_DESIGNS`."""
    changes: PresetChanges = field(default_factory=PresetChanges)
    """What is otherwise than in the preset."""
    seed: int = 0

    @property
    def name(self) -> str:
        """Of its folder."""
        return "_".join([self.design, *_said(self.changes), f"seed{self.seed}"])


def _said(changes: PresetChanges) -> list[str]:
    """Each change in letters that a folder may have."""
    said = [f"{name}{value}" for name, value in asdict(changes).items() if isinstance(value, int) and value]
    if changes.enhancer is not None:
        said.append("enhancer" + ("-".join(map(str, changes.enhancer)) or "none"))
    if changes.stylising is not None:
        said.append(changes.stylising)
    return said


@dataclass(frozen=True, kw_only=True)
class RunManner:
    """How everything of a trade is trained and evaluated, the same for all of it."""

    dataset: Path
    """What is learned from."""
    test: Path | None
    """Other matches, for evaluation; the ends of the dataset's own, which are not learned from, if None."""
    truth: Path | None
    """Work folder of the clips that are evaluated, as pgm simulate --masks writes it; the renderer's masks if None."""
    out: Path
    """Folder of the trade."""
    preset: str = "tiny"
    steps: int = 0
    """Of training; 0 for the preset's where minutes do not count."""
    minutes: float = 0.0
    """Of training; 0 where steps count."""
    held_out: float = 0.1
    """Share of each match, its end, that is not learned from."""
    perceptual: Path | None = None
    """Weights of a VGG network for the perceptual loss."""
    frames: int = 100
    """That are judged, at most; 0 for all."""
    device: str = "auto"
    precision: Literal["float32", "bfloat16"] = "float32"
    """Of training's inner arithmetic; evaluations are computed in float32."""
    threads: int = 1
    """CPU threads of each job."""

    def folder(self, model: Training) -> Path:
        """Where the model lies."""
        return self.out / RUNS_NAME / model.name


def training_job(model: Training, manner: RunManner) -> Job:
    """The job that trains the model, or goes on with it."""
    changes = {name: value for name, value in asdict(model.changes).items() if value not in (0, None)}
    arguments = {
        "name": model.name,
        "dataset": str(manner.dataset),
        "run": str(manner.folder(model)),
        "preset": manner.preset,
        "design": model.design,
        "changes": plain(changes),
        "seed": model.seed,
        "steps": manner.steps,
        "minutes": manner.minutes,
        "held_out": manner.held_out,
        "perceptual": "" if manner.perceptual is None else str(manner.perceptual),
        "device": manner.device,
        "precision": manner.precision,
        "threads": manner.threads,
    }
    return Job(
        name=f"train {model.name}",
        stage="synthesis_training",
        entry=f"{__name__}:train_model",
        arguments=arguments,
        retries=1,  # it goes on from its last checkpoint
    )


def evaluation_job(model: Training, manner: RunManner) -> Job:
    """The job that evaluates; it goes on after the last clip that is finished."""
    arguments = {
        "name": model.name,
        "run": str(manner.folder(model)),
        "parts": str(manner.out / EVALUATIONS_NAME / model.name),
        "dataset": str(manner.test or manner.dataset),
        "split": "held-out" if manner.test is None else "all",
        "truth": "" if manner.truth is None else str(manner.truth),
        "frames": manner.frames,
        "device": manner.device,
        "threads": manner.threads,
    }
    return Job(
        name=f"evaluate {model.name}",
        stage="synthesis_evaluation",
        entry=f"{__name__}:evaluate_model",
        arguments=arguments,
    )


def train_model(arguments: Mapping, report: Callable[[dict], None]) -> dict:
    """Carry out the job of `training_job`; one row of figures.

    Raises:
        InterruptedError: If it was asked to stop; what it had learned is kept.
    """
    named = ("preset", "design", "seed", "steps", "minutes", "held_out", "device", "precision", "threads")
    changes = dict(arguments["changes"])
    if "enhancer" in changes:
        changes["enhancer"] = tuple(changes["enhancer"])
    options = SynthesisRunOptions(
        dataset=Path(arguments["dataset"]),
        run=Path(arguments["run"]),
        perceptual=Path(arguments["perceptual"]) if arguments["perceptual"] else None,
        changes=PresetChanges(**changes),
        **{name: arguments[name] for name in named},
    )
    total = 0 if options.minutes else options.steps or PRESETS[options.preset].steps

    def train(show: Callable[[str], None]) -> Outcome:
        return train_synthesis(options, command=_command(arguments), show=show)

    return trained(arguments["name"], train, total, report)


def _command(arguments: Mapping) -> list[str]:
    """The command that trains the same model, its changes apart, which that has no options for."""
    names = ("design", "preset", "seed", "steps", "minutes", "held_out", "perceptual", "device", "precision", "threads")
    return training_command("synthesis", arguments, names)


def evaluate_model(arguments: Mapping, report: Callable[[dict], None]) -> dict:
    """Carry out the job of `evaluation_job`; one row with what was found."""
    torch.set_num_threads(arguments["threads"])
    options = SynthesisEvaluationOptions(
        run=Path(arguments["run"]),
        dataset=Path(arguments["dataset"]),
        truth=Path(arguments["truth"]) if arguments["truth"] else None,
        split=arguments["split"],
        frames=arguments["frames"],
        novel=NovelOptions(frames=0),
        efficiency_frames=0,
        device=arguments["device"],
    )

    def show(share: float, line: str) -> None:
        report({"progress": share, "total": 1.0})

    result = evaluate_synthesis(open_judge(options), Path(arguments["parts"]), show)
    return {"rows": [{"kind": "evaluation", "name": arguments["name"], "result": summary_to_json(result)}]}
