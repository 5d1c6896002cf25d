"""Scoring a trained model on a packed dataset: which matches, which windows, task after task."""

import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from pgm_data.dataset.files import sha256_of, whole_file
from pgm_models.animation.evaluate import evaluate, evaluate_physics
from pgm_models.animation.evaluate_tables import read_evaluation
from pgm_models.animation.evaluation_result import EvaluationResult, merged, result_to_json
from pgm_models.animation.filled_windows import EvaluateOptions
from pgm_models.animation.model import AnimationModel, load_model
from pgm_models.animation.sample import SampleOptions, filler
from pgm_models.animation.shards import read_episodes, scene_of, split_matches
from pgm_models.animation.store import StateStore, open_store
from pgm_models.animation.tasks import TaskName, task_names
from pgm_models.animation.text_encoders import encoder_of
from pgm_models.animation.text_features import text_features
from pgm_models.animation.window_source import all_windows
from pgm_models.animation.windows import Windows
from pgm_models.processes import device_of

LEAST_WINDOWS = 2
"""Fewer than this of either kind, and there is nothing to compare."""
DIGITS = 12
"""Hexadecimal digits by which a model and a dataset are told."""
PHYSICS_TASK: TaskName = "prediction"
"""The task whose motion is judged at the finer rate."""


@dataclass(frozen=True, eq=False, kw_only=True)
class RunEvaluationOptions:
    """What is scored on what."""

    run: Path
    """Run of pgm-train animation, model file, or a shipped model's name."""
    dataset: Path
    """Packed dataset with matches that the model has not learned from."""
    cache: Path
    """Folder for states and text features, made once."""
    reference: Path | None = None
    """Packed dataset of other matches; the same where None, of which all matches that are not scored are taken."""
    split: str = ""
    """Matches that are scored: `train`, `val`, `test` or `all`; empty for test, else val, else all."""
    frames: int = 0
    """Length of windows; 0 for the model's."""
    rate: float = 4.0
    """Frames a second of the windows."""
    physics_rate: float | None = None
    """Frames a second of windows whose physics is judged besides: the highest of data and model where None; 0 for
    none."""
    physics_windows: int = 512
    sampling: SampleOptions = SampleOptions()
    scoring: EvaluateOptions = EvaluateOptions()


class TooFewWindows(ValueError):
    """The dataset has too little to compare."""


def evaluate_run(
    options: RunEvaluationOptions, parts: Path | None, show: Callable[[str], None] = lambda line: None
) -> EvaluationResult:
    """Scores of the run's model; finished tasks are kept in the folder `parts`, and taken from there the next time.

    Raises:
        ValueError: If the model does not suit the dataset, an option is wrong, or parts are of other options.
        TooFewWindows: If there are fewer than two windows to score, or of other matches.
    """
    device = device_of(options.scoring.device)
    model = load_model(options.run, device)
    scene = scene_of(options.dataset)
    if scene.name != model.layout.scene:
        raise ValueError(f"dataset: expected one of the scene {model.layout.scene}, got {scene.name}")
    scored, others = _matches(options)
    encoder = encoder_of(model.options.encoder)
    store = open_store(options.dataset, model.layout, options.cache, scene=scene)
    features = text_features(store.texts, encoder, options.cache, show=show, device=device)
    elsewhere = options.dataset if options.reference is None else options.reference
    other_store = open_store(elsewhere, model.layout, options.cache, scene=scene)
    scoring = replace(options.scoring, device=str(device), tasks=options.scoring.tasks or task_names(model.layout))
    frames = options.frames or model.options.frames

    def windows(rate: float, limit: int) -> list[Windows]:
        found = all_windows(store, frames, rate, limit, matches=scored, features=features, batch=scoring.batch)
        return list(found)

    real = _enough("dataset", windows(options.rate, scoring.windows))
    reference = list(all_windows(other_store, frames, options.rate, scoring.windows, matches=others))
    reference = _enough("reference", reference)
    fill, found = filler(model, options.sampling, scene), []
    count = min(sum(len(batch.names) for batch in real), scoring.windows)
    wanted = {
        "frames": frames,
        "windows": count,
        "several_windows": min(scoring.several_windows, count),
        "samples": scoring.samples,
        "seed": scoring.seed,
    }
    about = _about(options, model, scoring)
    for name in scoring.tasks:
        one = replace(scoring, tasks=(name,))
        earlier = _earlier(parts, name, wanted, about)
        if earlier is None:
            earlier = evaluate(fill, real, reference, model.layout, one, scene=scene, about=about, show=show)
            rate = _physics_rate(options, model, store)
            if name == PHYSICS_TASK and rate > 1.5 * options.rate:
                fine = replace(one, windows=options.physics_windows)
                finer = _enough("dataset", windows(rate, options.physics_windows))
                physics = evaluate_physics(fill, finer, model.layout, fine, scene=scene, show=show)
                earlier = replace(earlier, physics=(*earlier.physics, *physics))
            _keep(parts, name, earlier)
        found.append(earlier)
    return merged(found)


def scored_matches(options: RunEvaluationOptions) -> tuple[str, ...]:
    """Matches that are scored.

    Raises:
        ValueError: If the dataset has no such split.
    """
    episodes = read_episodes(options.dataset)
    every = tuple(sorted(set(episodes.matches)))
    splits = [split for split in ("test", "val", "train") if split in episodes.splits]
    split = options.split or next((name for name in ("test", "val") if name in splits), "all")
    if split != "all" and split not in splits:
        raise ValueError(f"split: expected one of {', '.join(splits)}, all, got {split!r}")
    return every if split == "all" else split_matches(options.dataset, split)


def _matches(options: RunEvaluationOptions) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Matches that are scored, and others: those that are learned from, where there are such."""
    scored = scored_matches(options)
    elsewhere = options.dataset if options.reference is None else options.reference
    there = read_episodes(elsewhere)
    others = {match: part for match, part in zip(there.matches, there.splits, strict=True) if match not in set(scored)}
    if not others:
        raise ValueError(f"reference: expected a dataset with matches that are not scored, got none in {elsewhere}")
    train = sorted(match for match, part in others.items() if part == "train")
    return scored, tuple(train or sorted(others))


def _enough(name: str, windows: Sequence[Windows]) -> list[Windows]:
    count = sum(len(batch.names) for batch in windows)
    if count < LEAST_WINDOWS:
        raise TooFewWindows(f"{name}: expected at least {LEAST_WINDOWS} windows, got {count}")
    return list(windows)


def _physics_rate(options: RunEvaluationOptions, model: AnimationModel, store: StateStore) -> float:
    if options.physics_rate is not None:
        return options.physics_rate
    return min(float(store.segment_rate.max()), model.options.rates[1])


def _about(
    options: RunEvaluationOptions, model: AnimationModel, scoring: EvaluateOptions
) -> dict[str, str | int | float]:
    design = model.options.design
    about: dict[str, str | int | float] = {
        "run": options.run.name,
        "model": _model_sum(model),
        "dataset": _dataset_name(options.dataset),
        "reference": _dataset_name(options.dataset if options.reference is None else options.reference),
        "split": options.split or "auto",
        "network": design.network,
        "objective": design.objective,
        "prior": str(design.prior).lower(),
        "self_conditioning": str(design.self_conditioning).lower(),
        "near": str(design.near).lower(),
        "weights": sum(parameter.numel() for parameter in model.parameters()),
        "device": scoring.device.partition(":")[0],
    }
    if design.objective == "diffusion":
        sampling = options.sampling
        about |= {"sampler": sampling.sampler, "steps": sampling.steps, "prediction": design.diffusion.prediction}
        about |= {"guidance": sampling.guidance, "temperature": sampling.temperature, "tries": sampling.tries}
    return about


def _dataset_name(dataset: Path) -> str:
    return f"{dataset.name} {sha256_of(dataset / 'meta' / 'info.json')[:DIGITS]}"


def _model_sum(model: AnimationModel) -> str:
    digest = hashlib.sha256()
    for name, value in sorted(model.state_dict().items()):
        digest.update(name.encode() + value.detach().cpu().contiguous().numpy().tobytes())
    return digest.hexdigest()[:DIGITS]


def _part(parts: Path, name: TaskName) -> Path:
    return parts / f"{name}.json"


def _earlier(
    parts: Path | None,
    name: TaskName,
    wanted: dict[str, int],
    about: dict[str, str | int | float],
) -> EvaluationResult | None:
    """The task's result of an earlier run with the same options.

    Raises:
        ValueError: If it was made with other ones; names them.
    """
    if parts is None or not _part(parts, name).is_file():
        return None
    found = read_evaluation(_part(parts, name))
    had = {**{field: getattr(found, field) for field in wanted}, **found.about}
    changed = [
        f"{field} ({had.get(field, 'none')} then, {value} now)"
        for field, value in {**wanted, **about}.items()
        if had.get(field) != value
    ]
    if changed:
        raise ValueError(
            f"{_part(parts, name)}: expected the options it was begun with, got others: {', '.join(changed)}"
        )
    return found


def _keep(parts: Path | None, name: TaskName, result: EvaluationResult) -> None:
    if parts is not None:
        parts.mkdir(parents=True, exist_ok=True)
        with whole_file(_part(parts, name)) as temporary:
            temporary.write_text(json.dumps(result_to_json(result), allow_nan=False), encoding="utf-8")
