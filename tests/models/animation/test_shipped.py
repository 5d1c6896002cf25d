"""The model that ships with pgm: it loads, says how it was made, and plays a prompt that ships with it."""

import json
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors import safe_open

from pgm_models.animation.generate import GenerateOptions, generate
from pgm_models.animation.model import SHIPPED, AnimationModel, load_model
from pgm_models.animation.presets import DESIGNS, PRESETS
from pgm_models.animation.prompt import read_prompt
from pgm_models.animation.sample import SampleOptions

FOLDER = Path(str(files("pgm_models.animation")))
LARGEST_BYTES = 20_000_000


@pytest.fixture(scope="module", params=SHIPPED)
def shipped(request: pytest.FixtureRequest) -> tuple[str, AnimationModel]:
    return request.param, load_model(Path(request.param))


def test_it_says_with_which_command_it_was_made(shipped):
    name, model = shipped
    path = FOLDER / "weights" / f"{name}.safetensors"
    assert path.stat().st_size < LARGEST_BYTES
    with safe_open(path, framework="pt") as file:
        about = json.loads(file.metadata()["about"])
    words = about["command"]
    assert "animation" in words and "--seed" in words and "--steps" in words
    assert about["step"] == int(words[words.index("--steps") + 1])
    assert model.options.design == DESIGNS["ours"] and model.options.network == PRESETS["small"].network


def test_it_plays_what_a_prompt_fixes(shipped, monkeypatch):
    _, model = shipped
    prompt = read_prompt(FOLDER / "prompts" / "in_between.json", model.layout)

    def no_words(texts):
        return torch.zeros(len(texts), 1, model.options.encoder_width), torch.ones(len(texts), 1, dtype=torch.bool)

    monkeypatch.setattr(model, "text_tokens", no_words)  # the weights that read are fetched, and not needed here
    play = generate(model, prompt, GenerateOptions(sample=SampleOptions(steps=2)))
    assert all(np.isfinite(values).all() for values in play.columns.values())
    assert play.known.any()
    for value in prompt.values:
        made = play.columns[value.column][value.start : value.end]
        np.testing.assert_allclose(made, value.values, atol=1e-2)
