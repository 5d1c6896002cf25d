"""A training run of the animation model: a dataset in; checkpoint, log, pictures and one model file out."""

import hashlib
import json
import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import torch
from filelock import FileLock

from pgm_data.dataset.files import whole_file
from pgm_models.animation.aggregator import Aggregator
from pgm_models.animation.encode import decode
from pgm_models.animation.fit_layout import fit_layout
from pgm_models.animation.layout import Layout, layout_from_json, layout_to_json
from pgm_models.animation.matches import divided_matches
from pgm_models.animation.model import (
    AnimationModel,
    ModelOptions,
    options_from_json,
    save_model,
)
from pgm_models.animation.presets import DESIGNS, PRESETS
from pgm_models.animation.prior import TemporalPrior, fit_prior, prior_from_json, prior_to_json
from pgm_models.animation.sample import SampleOptions, sample
from pgm_models.animation.store import StateStore, dataset_identity, open_store
from pgm_models.animation.task import AnimationTask, MaskOptions
from pgm_models.animation.text_encoders import encoder_of
from pgm_models.animation.text_features import TextFeatures, text_features
from pgm_models.animation.text_start import TextStartOptions, span_rows, teach_texts, whitening
from pgm_models.animation.window_source import WindowOptions, WindowSource
from pgm_models.animation.windows import Windows, first_of
from pgm_models.checkpoint import CHECKPOINT_NAME, load_checkpoint, provenance
from pgm_models.model_file import MODEL_NAME
from pgm_models.processes import device_of, launched_processes, leads
from pgm_models.train import Outcome, TrainOptions, train

CACHE_NAME = "cache"
"""Folder of a run with what is computed once from its dataset, unless another one is named."""
HELD_OUT_BATCHES = 8
PRIOR_WINDOWS, PRIOR_FRAMES = 1024, 16
"""Windows of each of three rates that the prior is fitted to, and their length."""
SAMPLES = 4
"""Windows that are drawn as the training goes."""


@dataclass(frozen=True, eq=False, kw_only=True)
class AnimationRunOptions:
    """What is trained on what, and for how long."""

    dataset: Path
    """As `pgm pack` and `pgm simulate` write it."""
    run: Path
    """Folder of the run."""
    preset: str = "small"
    """Of `PRESETS`."""
    design: str = "ours"
    """Of `DESIGNS`."""
    masks: str = "all"
    """Group of masking strategies."""
    encoder: str = ""
    """Frozen text encoder; empty for the preset's."""
    share: float = 1.0
    """Of the dataset that is used."""
    rates: tuple[float, float] = (4.0, 25.0)
    """Lowest and highest rate of training windows, frames a second."""
    minutes: float = 0.0
    """Minutes of training; 0 where steps count."""
    steps: int = 0
    """Optimiser steps; 0 for the preset's where minutes do not count."""
    batch: int = 0
    """Windows a step; 0 for the preset's."""
    accumulate: int = 1
    """Parts in which a step's windows are gone through."""
    learning_rate: float = 0.0
    """Highest learning rate; 0 for the preset's."""
    average: float = 0.999
    """Share the moving average of the weights keeps in a step."""
    precision: Literal["float32", "bfloat16"] = "float32"
    device: str = "auto"
    workers: int = 0
    """Processes that make batches."""
    threads: int = 2
    seed: int = 0
    cache: Path | None = None
    """Where states and text features are kept, shared by runs on one dataset; the run's own folder by default."""
    checkpoint_minutes: float = 4.0


def train_animation(
    options: AnimationRunOptions, *, command: list[str], show: Callable[[str], None] = lambda line: None
) -> Outcome:
    """Train the model, or go on with the run that is there; a finished run holds its model file.

    Raises:
        ValueError: If the dataset holds no window, or the run was begun with other options.
        FloatingPointError: If a loss is not finite; names the batch.
    """
    preset = PRESETS[options.preset]
    cache = options.cache if options.cache is not None else options.run / CACHE_NAME
    before = _before(options.run)
    cache.mkdir(parents=True, exist_ok=True)
    with FileLock(cache / "preparing.lock"):  # the first of several processes computes, the others find it done
        store, features = _prepared(options, cache, None if before is None else before.layout, show)
    design = DESIGNS[options.design]
    accumulate = max(options.accumulate, launched_processes())
    batch = options.batch or preset.batch
    if batch % accumulate:
        raise ValueError(f"batch: expected a multiple of its {accumulate} parts, got {batch}")
    training, held_out = divided_matches(options.dataset)
    windows = WindowOptions(
        frames=preset.frames,
        batch=batch // accumulate,
        rates=options.rates,
        seed=options.seed,
        share=options.share,
        matches=training,
    )
    source = WindowSource(store, windows, features)
    model_options = ModelOptions(
        layout=store.layout,
        network=preset.network,
        text=preset.text,
        design=design,
        encoder=options.encoder or preset.encoder,
        encoder_width=features.width,
        frames=preset.frames,
        prior=_prior(store, training, options.rates, cache) if design.prior else None,
        rates=options.rates,
    )
    fixed = []
    if held_out:
        judged = WindowOptions(
            frames=preset.frames, batch=32, rates=options.rates, seed=1_000_000, share=1.0, matches=held_out
        )
        judge = WindowSource(store, judged, features)
        fixed = [judge.batch(number) for number in range(HELD_OUT_BATCHES)]
    show(
        f"{len(training)} matches to learn from, {len(held_out)} held out; {len(store.frame)} frames, "
        f"{store.layout.channels} channels, {len(store.texts)} texts"
    )
    task = AnimationTask(
        model_options,
        MaskOptions(group=options.masks, seed=options.seed),
        source.batch,
        held_out=fixed,
        data={
            "dataset": options.dataset.name,
            "identity": dataset_identity(options.dataset),
            "share": options.share,
            "preset": options.preset,
            "design": options.design,
            "batch": batch,
        },
        look=_look(fixed[0] if fixed else source.batch(0)),
    )
    torch.manual_seed(options.seed)
    model = AnimationModel(model_options)
    if before is None:
        with FileLock(cache / "preparing.lock"):
            _begin_texts(model, source, features, cache, show)
    show(f"{sum(p.numel() for p in model.parameters()) / 1e6:.2f} million weights")
    training_options = TrainOptions(
        steps=0 if options.minutes else options.steps or preset.steps,
        minutes=options.minutes,
        accumulate=accumulate,
        learning_rate=options.learning_rate or preset.learning_rate,
        average=options.average,
        precision=options.precision,
        checkpoint_minutes=options.checkpoint_minutes,
        seed=options.seed,
        threads=options.threads,
        device=str(device_of(options.device)),
        workers=options.workers,
    )
    outcome = train(model, task, training_options, options.run, provenance=provenance(command), show=show)
    if outcome.state == "done" and leads():
        assert isinstance(outcome.network, AnimationModel)
        figures = task.validate(outcome.network)
        about = {"step": outcome.step, "elapsed_s": round(outcome.elapsed_s, 1), "held_out": figures, **task.describe()}
        about.pop("model")
        about |= {"seed": options.seed, **provenance(command)}
        save_model(options.run / MODEL_NAME, outcome.network, about)
        task.look(outcome.network, options.run, outcome.step)
        show("held out: " + "  ".join(f"{name} {value:.4g}" for name, value in figures.items()))
    return outcome


def _before(run: Path) -> ModelOptions | None:
    """The options of the model that the run began with; None where it has not begun."""
    if not (run / CHECKPOINT_NAME).exists():
        return None
    found = load_checkpoint(run / CHECKPOINT_NAME).options.get("task", {}).get("model")
    if not isinstance(found, dict):
        raise ValueError(f"{run}: expected a run of pgm-train animation, got one of another model")
    return options_from_json(found)


def _prepared(
    options: AnimationRunOptions, cache: Path, layout: Layout | None, show: Callable[[str], None]
) -> tuple[StateStore, TextFeatures]:
    """The dataset's states and the features of its texts, computed once."""
    if layout is None:
        layout = _fitted(options.dataset, cache, show)
    store = open_store(options.dataset, layout, cache)
    encoder = encoder_of(options.encoder or PRESETS[options.preset].encoder)
    return store, text_features(store.texts, encoder, cache, show=show, device=str(device_of(options.device)))


def _prior(store: StateStore, matches: tuple[str, ...], rates: tuple[float, float], cache: Path) -> TemporalPrior:
    """The prior of the matches that are learned from, kept in the cache: the same for every seed and share."""
    kept = _kept(cache, "prior", [store.folder.name, matches, rates])
    if not kept.is_file():
        batches = []
        for rate in (rates[1], math.sqrt(rates[0] * rates[1]), rates[0]):
            options = WindowOptions(
                frames=PRIOR_FRAMES, batch=PRIOR_WINDOWS, rates=(0.9 * rate, 1.1 * rate), seed=7, matches=matches
            )
            batches.append(WindowSource(store, options, None).batch(0))
        prior = fit_prior(batches, store.layout)
        with whole_file(kept) as temporary:
            temporary.write_text(json.dumps(prior_to_json(prior)))
    return prior_from_json(json.loads(kept.read_text()))


def _begin_texts(
    model: AnimationModel, source: WindowSource, features: TextFeatures, cache: Path, show: Callable[[str], None]
) -> None:
    """Give the model an aggregator that knows what texts go with, kept in the cache: the same for every seed."""
    from safetensors.torch import load_file, save_file

    store, text = source.store, model.options.text
    if not len(features.starts):
        return
    start = TextStartOptions(steps=text.start)
    of = [store.folder.name, features.folder.name, source.segments.tolist(), asdict(text), asdict(start)]
    kept = _kept(cache, "texts", of).with_suffix(".safetensors")
    if not kept.is_file():
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(start.seed)
            fresh = Aggregator(features.width, text)
        white = whitening(features)
        fresh.whiten(white.mean, white.map)
        fresh = fresh.to(model.device)
        told = teach_texts(fresh, store, features, span_rows(store, source.segments, start), start, show)
        with whole_file(kept) as temporary:
            tensors = {name: value.cpu().contiguous() for name, value in fresh.state_dict().items()}
            save_file(tensors, temporary, metadata={"told": str(told)})
    model.aggregator.load_state_dict(load_file(kept))


def _kept(cache: Path, what: str, of: list) -> Path:
    """Where something that is computed once from those values is kept."""
    return cache / f"{what}_{hashlib.sha256(json.dumps(of).encode()).hexdigest()[:16]}.json"


def _fitted(dataset: Path, cache: Path, show: Callable[[str], None]) -> Layout:
    """The layout of the matches that are learned from, kept in the cache."""
    training, _ = divided_matches(dataset)
    kept = _kept(cache, "layout", [dataset_identity(dataset), training])
    if not kept.is_file():
        show("reading what the states are made of")
        layout = fit_layout(dataset, matches=training)
        with whole_file(kept) as temporary:
            temporary.write_text(json.dumps(layout_to_json(layout)))
    return layout_from_json(json.loads(kept.read_text()))


def _look(windows: Windows) -> Callable[[AnimationModel, Path, int], None]:
    """What draws a few windows as the model completes them from their first frame and their words."""

    def look(model: AnimationModel, run: Path, step: int) -> None:
        from pgm_models.animation.sample_pictures import write_samples
        from pgm_models.animation.training_plots import write_loss_curves

        few = first_of(windows, SAMPLES).to(model.device)
        known = torch.zeros_like(few.valid)
        known[:, 0] = True
        text_known = torch.ones_like(few.text, dtype=torch.bool)
        generator = torch.Generator(device=model.device).manual_seed(0)
        state = sample(model, few, known, text_known, options=SampleOptions(), generator=generator).cpu().numpy()
        columns = decode(model.layout, state, few.constants.cpu().numpy())
        times = np.arange(state.shape[1])[None] / few.rate.cpu().numpy()[:, None]
        write_samples(run, columns, times, model.layout, step)
        write_loss_curves(run)

    return look
