"""Rallies of a model are those of `generate`, told of step by step, and ended between two steps."""

from dataclasses import replace

import numpy as np
import pytest

from pgm_data.scene import load_scene
from pgm_models.animation.generate import GenerateOptions, generate
from pgm_models.animation.prompt import prompt_of
from pgm_models.animation.sample import SampleOptions
from pgm_models.synthesis.play_maker import evaluations, rally_maker
from pgm_models.synthesis.play_rallies import CancelledError
from tests.models.animation.toy_models import toy_layout, toy_model

SCENE = load_scene("tennis")
PROMPT = {
    "scene": "tennis",
    "n_frames": 24,
    "frames_per_second": 25,
    "seed": 5,
    "values": [{"column": "ball.position", "start_frame": 3, "end_frame": 4, "value": [1.0, -2.0, 3.0]}],
}
OPTIONS = GenerateOptions(sample=SampleOptions(steps=3))


@pytest.fixture(scope="module")
def model():
    return toy_model(replace(toy_layout(), constants=()))


@pytest.mark.parametrize("guidance", [1.0, 2.0])
def test_every_step_is_told_of_and_the_rally_is_that_of_generate(model, guidance):
    options = GenerateOptions(sample=SampleOptions(steps=3, guidance=guidance))
    told = []
    rally = rally_maker(model, SCENE, options)(PROMPT, lambda share, words: told.append((share, words)))
    prompt = prompt_of(PROMPT, model.layout)
    wanted = generate(model, prompt, options)
    for name, values in wanted.columns.items():
        np.testing.assert_array_equal(rally.columns[name], values)
    np.testing.assert_allclose(rally.columns["ball.position"][3], [1, -2, 3])
    assert rally.warnings == wanted.warnings and rally.prompt["seed"] == 5 and rally.rate == 25
    total = evaluations(model, prompt, options)
    steps = [words for _, words in told if words.startswith("step")]
    assert steps == [f"step {number + 1} of {total}" for number in range(total)]
    shares = [share for share, _ in told]
    assert shares == sorted(shares) and shares[0] == 0 and shares[-1] == 1
    assert told[-2][1] == "feet and ball settle"


def test_a_cancelled_rally_leaves_the_model_as_it_was(model):
    def stop(share, words):
        if words.startswith("step 2"):
            raise CancelledError

    make = rally_maker(model, SCENE, OPTIONS)
    with pytest.raises(CancelledError):
        make(PROMPT, stop)
    assert not model._forward_pre_hooks and not model._forward_hooks
    assert len(make(PROMPT, lambda share, words: None).columns["ball.position"]) == 24


def test_a_prompt_that_cannot_be_followed_says_why(model):
    make = rally_maker(model, SCENE, OPTIONS)
    with pytest.raises(ValueError, match="scene: expected tennis"):
        make(PROMPT | {"scene": "blocks"}, lambda share, words: None)
    with pytest.raises(ValueError, match=r"prompt: "):
        make("not a prompt", lambda share, words: None)
