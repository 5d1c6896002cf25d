"""Scoring how well a trained model keeps to its words, on a packed dataset."""

from collections.abc import Callable
from dataclasses import dataclass

from pgm_models.animation.agreement import AgreementOptions, agreement
from pgm_models.animation.agreement_result import AgreementResult
from pgm_models.animation.evaluate_run import RunEvaluationOptions, scored_matches
from pgm_models.animation.hit_windows import HitWindowOptions, clip_handedness, hit_windows
from pgm_models.animation.model import load_model
from pgm_models.animation.sample import filler
from pgm_models.animation.shards import scene_of
from pgm_models.animation.store import open_store
from pgm_models.animation.text_encoders import encoder_of
from pgm_models.animation.text_features import text_features
from pgm_models.processes import device_of


@dataclass(frozen=True, kw_only=True)
class WordsOptions:
    """How words are held against what is generated."""

    windows: int = 256
    """Windows about hits, at most."""
    rate: float = 25.0 / 3.0
    """Frames a second of what is generated first."""
    factor: int = 3
    """By how much the rate is raised after that."""


def evaluate_words(
    options: RunEvaluationOptions, words: WordsOptions, show: Callable[[str], None] = lambda line: None
) -> AgreementResult | None:
    """How often strokes and targets agree with their captions; None in scenes without a ball.

    Raises:
        ValueError: If no window about a hit is told of.
    """
    device = device_of(options.scoring.device)
    model = load_model(options.run, device)
    scene = scene_of(options.dataset)
    if scene.ball is None or scene.court is None or "ball.position" not in [p.column for p in model.layout.properties]:
        return None
    store = open_store(options.dataset, model.layout, options.cache, scene=scene)
    features = text_features(store.texts, encoder_of(model.options.encoder), options.cache, show=show, device=device)
    found = hit_windows(
        store,
        scene,
        HitWindowOptions(
            windows=words.windows,
            frames=options.frames or model.options.frames,
            rate=words.rate,
            factor=words.factor,
            seed=options.scoring.seed,
        ),
        matches=scored_matches(options),
        handedness=clip_handedness(options.dataset, scene),
    )
    asked = AgreementOptions(batch=options.scoring.batch, device=str(device), seed=options.scoring.seed)
    return agreement(filler(model, options.sampling, scene), store, features, found, asked, scene=scene, show=show)
