"""Rallies by a trained animation model, told of step by step, and ended between two steps where somebody wishes so."""

import math
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from pgm_data.scene import Scene
from pgm_models.animation.generate import AT_ONCE, GenerateOptions, generate
from pgm_models.animation.keyframes import plan_of
from pgm_models.animation.model import AnimationModel
from pgm_models.animation.prompt import Prompt, given_by, prompt_of, prompt_to_json
from pgm_models.synthesis.play_rallies import MakeRally, Rally, Say
from pgm_models.synthesis.play_stage import usual_view

DREAMT = 0.9
"""Share of the progress when the network is done; settling feet and ball is the rest."""


def rally_maker(model: AnimationModel, scene: Scene, options: GenerateOptions) -> MakeRally:
    """What makes rallies of prompts by the model; one at a time."""

    def make(document: object, say: Say) -> Rally:
        prompt = prompt_of(document, model.layout)
        total = evaluations(model, prompt, options)
        with _told_of_steps(model, say, total):
            play = generate(model, prompt, options, scene=scene)
        say(1.0, "drawing")
        return Rally(
            prompt=prompt_to_json(prompt),
            rate=prompt.rate,
            columns=play.columns,
            view=usual_view(scene, np.arange(prompt.frames) / prompt.rate),
            notes=play.settled,
            warnings=play.warnings,
        )

    return make


def evaluations(model: AnimationModel, prompt: Prompt, options: GenerateOptions) -> int:
    """How often the network is asked for the prompt, at most: fewer times where windows are fixed altogether."""
    plan = plan_of(
        given_by(prompt, model.layout).known,
        rate=prompt.rate,
        window=model.options.frames,
        rates=model.options.rates,
        keyframe_hz=options.keyframe_hz,
        keep=options.keep,
    )
    calls = sum(math.ceil(len(pieces.frames) / AT_ONCE) for pieces in plan.pieces())
    if model.options.design.objective == "reconstruction":
        return calls
    return calls * options.sample.tries * options.sample.steps * (1 if options.sample.guidance == 1.0 else 2)


@contextmanager
def _told_of_steps(model: AnimationModel, say: Say, total: int) -> Iterator[None]:
    """Have each evaluation of the model told of before it begins, and end where telling raises."""
    done = 0

    def tell(*_: object) -> None:
        nonlocal done
        say(DREAMT * done / max(total, 1), f"step {done + 1} of {total}")
        done += 1

    def told(*_: object) -> None:
        if done >= total:
            say(DREAMT, "feet and ball settle")

    before, after = model.register_forward_pre_hook(tell), model.register_forward_hook(told)
    try:
        yield
    finally:
        before.remove()
        after.remove()
