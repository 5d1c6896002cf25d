import json

import pytest
import torch
from safetensors.torch import save_file

from pgm_models.animation.layout import layout_from_json, layout_to_json
from pgm_models.animation.model import (
    load_model,
    options_from_json,
    options_to_json,
    save_model,
)
from pgm_models.model_file import MODEL_NAME
from tests.models.animation.toy_models import toy_layout, toy_model, toy_windows


@pytest.mark.parametrize("design", ["ours", "paper", "transformer", "lstm", "playable"])
def test_a_model_comes_back_from_its_file_whole(tmp_path, design):
    model = toy_model(design=design)
    save_model(tmp_path / MODEL_NAME, model, {"seed": 3})
    for place in (tmp_path, tmp_path / MODEL_NAME):
        again = load_model(place)
        assert options_to_json(again.options) == options_to_json(model.options)
        for name, value in model.state_dict().items():
            assert torch.equal(again.state_dict()[name], value), name
        assert not again.training and not any(p.requires_grad for p in again.parameters())


def test_options_are_json_and_back():
    options = toy_model().options
    raw = json.loads(json.dumps(options_to_json(options)))
    assert options_to_json(options_from_json(raw)) == raw
    assert layout_to_json(layout_from_json(raw["layout"])) == raw["layout"]
    raw["design"]["network"] = "transformer"
    del raw["frames"]
    with pytest.raises(ValueError, match="expected the options of an animation model"):
        options_from_json(raw)


def test_what_is_no_model_is_told_so(tmp_path):
    with pytest.raises(ValueError, match="nothing there"):
        load_model(tmp_path / "absent")
    (tmp_path / "empty").mkdir()
    with pytest.raises(ValueError, match="empty or foreign folder"):
        load_model(tmp_path / "empty")
    save_file({"a": torch.zeros(1)}, tmp_path / "other.safetensors")
    with pytest.raises(ValueError, match="something else"):
        load_model(tmp_path / "other.safetensors")
    (tmp_path / "broken.safetensors").write_bytes(b"\x80\x04pickle")
    with pytest.raises(ValueError, match="expected a model of pgm-train animation"):
        load_model(tmp_path / "broken.safetensors")


def test_a_step_that_stands_in_for_the_network_is_asked_instead():
    model = toy_model(design="velocity")
    windows = toy_windows(model.layout)
    model.step = lambda x, *rest: x + 1
    known = torch.zeros_like(windows.valid)
    said = model(windows.state, known, torch.ones_like(windows.text).bool(), windows, torch.zeros(3))
    assert torch.equal(said.output, windows.state + 1)


def test_frames_without_text_are_embedded_as_zeros():
    model = toy_model()
    windows = toy_windows(toy_layout())
    embedded = model.embedded(windows)
    assert bool((embedded[windows.text < 0] == 0).all())
    rows = model.aggregator(windows.tokens, windows.token_mask)
    torch.testing.assert_close(embedded[windows.text == 1], rows[1].expand(int((windows.text == 1).sum()), -1))


def asked(model, windows, known, last):
    """What the network would be given to read."""
    read = []
    model.step = lambda x, *rest: read.append(x) or x
    model(windows.state, known, torch.ones_like(windows.text).bool(), windows, torch.zeros(3), last=last)
    return read[0]


def test_a_last_guess_is_read_where_nothing_is_known():
    model = toy_model()
    windows = toy_windows(model.layout)
    known = torch.zeros_like(windows.valid)
    known[:, :2] = True
    guess = torch.randn(windows.state.shape, generator=torch.Generator().manual_seed(0))
    read, other = asked(model, windows, known, guess), asked(model, windows, known, guess + 1)
    assert torch.equal(read[:, :2], other[:, :2])
    assert ((read != other).sum(-1)[:, 2:] >= model.layout.channels).all()
    assert ((read == other).sum(-1) >= 2 * model.layout.channels).all()


def test_without_a_last_guess_the_priors_is_read():
    model = toy_model()
    windows = toy_windows(model.layout)
    known = torch.zeros_like(windows.valid)
    given, valid = model.over_channels(known), model.over_channels(windows.valid)
    mean, _ = model.preconditioner(windows.state, given, valid, windows.rate, torch.zeros(3))
    assert torch.equal(asked(model, windows, known, None), asked(model, windows, known, mean))


def test_designs_that_do_not_read_a_last_guess_are_as_they_were():
    model = toy_model(design="velocity")
    windows = toy_windows(model.layout)
    known = torch.zeros_like(windows.valid)
    assert torch.equal(asked(model, windows, known, windows.state + 1), windows.state)
