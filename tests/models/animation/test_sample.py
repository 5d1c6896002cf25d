import math
from dataclasses import replace

import pytest
import torch

from pgm_models.animation.sample import SampleOptions, sample
from tests.models.animation.toy_models import toy_layout, toy_model, toy_windows

SAMPLERS = ("ddpm", "ddim", "dpmpp_2m", "sde_2m")


def filled(model, windows, known, *, text_known=None, seed=0, **options):
    if text_known is None:
        text_known = torch.ones(windows.text.shape, dtype=torch.bool)
    generator = torch.Generator().manual_seed(seed)
    return sample(model, windows, known, text_known, options=SampleOptions(**options), generator=generator)


def masks(windows, share):
    return torch.rand(windows.valid.shape, generator=torch.Generator().manual_seed(3)) < share


@pytest.mark.parametrize("sampler", SAMPLERS)
@pytest.mark.parametrize("share", [0.0, 0.4, 1.0])
def test_known_values_come_back_bit_by_bit_and_nothing_else_does(sampler, share):
    model = toy_model()
    windows = toy_windows(model.layout)
    known = masks(windows, share)
    state = filled(model, windows, known, sampler=sampler, steps=4)
    given = model.over_channels(known)
    assert torch.equal(state[given], windows.state[given])
    assert torch.isfinite(state).all()
    assert not bool((state == windows.state)[~given].any())


@pytest.mark.parametrize("design", ["ours", "velocity", "paper"])
@pytest.mark.parametrize("sampler", SAMPLERS)
@pytest.mark.parametrize("steps", [1, 1000])
def test_one_step_and_a_thousand(design, sampler, steps):
    model = toy_model(toy_layout(players=1), design=design)
    model.step = lambda x, *rest: x / 2  # a thousand evaluations of the network itself would take a while
    windows = toy_windows(model.layout, count=1, frames=2)
    state = filled(model, windows, masks(windows, 0.3), sampler=sampler, steps=steps)
    assert torch.isfinite(state).all()


@pytest.mark.parametrize("frames", [1, 64])
@pytest.mark.parametrize("rate", [1.0, 50.0])
def test_lengths_and_rates_far_from_training(frames, rate):
    model = toy_model(frames=16)
    windows = replace(toy_windows(model.layout, frames=frames), rate=torch.full((3,), rate))
    state = filled(model, windows, masks(windows, 0.2), steps=2)
    assert state.shape == windows.state.shape and torch.isfinite(state).all()


def test_the_same_seed_gives_the_same_and_another_does_not():
    model = toy_model()
    windows = toy_windows(model.layout)
    known = masks(windows, 0.3)
    first, again, other = (filled(model, windows, known, seed=seed, steps=3) for seed in (5, 5, 6))
    assert torch.equal(first, again)
    assert not torch.equal(first, other)


def test_what_is_not_valid_is_never_taken_as_known():
    model = toy_model()
    windows = toy_windows(model.layout)
    valid = windows.valid.clone()
    valid[0, 2, 1] = False
    state = windows.state * model.over_channels(valid)
    windows = replace(windows, valid=valid, state=state)
    made = filled(model, windows, torch.ones_like(valid), steps=2)
    assert torch.equal(made[1:], state[1:])
    assert bool((made[0, 2] != state[0, 2])[model.property_of_channel == 1].all())


def test_texts_matter_only_where_they_are_known():
    model = toy_model()
    windows = toy_windows(model.layout)
    other = replace(windows, tokens=windows.tokens.flip(0) + 1)
    known = masks(windows, 0.3)
    silent = torch.zeros(windows.text.shape, dtype=torch.bool)
    assert torch.equal(
        filled(model, windows, known, text_known=silent, steps=2),
        filled(model, other, known, text_known=silent, steps=2),
    )
    assert not torch.equal(filled(model, windows, known, steps=2), filled(model, other, known, steps=2))


def test_guidance_of_nothing_is_the_model_without_text():
    model = toy_model()
    windows = toy_windows(model.layout)
    known = masks(windows, 0.3)
    silent = torch.zeros(windows.text.shape, dtype=torch.bool)
    torch.testing.assert_close(
        filled(model, windows, known, guidance=0.0, steps=3),
        filled(model, windows, known, text_known=silent, steps=3),
    )
    assert not torch.allclose(
        filled(model, windows, known, guidance=3.0, steps=3), filled(model, windows, known, steps=3)
    )


def test_no_text_at_all_no_player_and_no_ball():
    model = toy_model(toy_layout(players=0))
    windows = toy_windows(model.layout, texts=0)
    assert torch.isfinite(filled(model, windows, masks(windows, 0.5), steps=2)).all()
    model = toy_model(toy_layout(players=3, ball=False))
    windows = toy_windows(model.layout, texts=0)
    assert torch.isfinite(filled(model, windows, masks(windows, 0.5), steps=2)).all()


@pytest.mark.parametrize("design", ["transformer", "lstm", "playable"])
def test_a_model_that_reconstructs_is_asked_once_and_hears_no_noise(design):
    model = toy_model(design=design)
    windows = toy_windows(model.layout)
    known = masks(windows, 0.4)
    state = filled(model, windows, known, steps=1, seed=0)
    assert torch.equal(state, filled(model, windows, known, steps=9, seed=1))
    given = model.over_channels(known)
    assert torch.equal(state[given], windows.state[given])


@pytest.mark.parametrize("dtype", [torch.float16, torch.bfloat16])
def test_half_precision_is_near_single(dtype):
    model = toy_model()
    windows = toy_windows(model.layout)
    known = masks(windows, 0.5)
    single = filled(model, windows, known, steps=4, sampler="ddim")
    halved = {name: getattr(windows, name).to(dtype) for name in ("state", "rate", "constants", "tokens")}
    half = filled(model.to(dtype), replace(windows, **halved), known, steps=4, sampler="ddim")
    assert half.dtype == dtype and torch.isfinite(half).all()
    assert float((half.float() - single).abs().mean()) < 0.1 * float(single.abs().mean())


@pytest.mark.parametrize("steps, temperature", [(0, 1.0), (1, -1.0), (1, math.nan)])
def test_impossible_options_are_refused(steps, temperature):
    with pytest.raises(ValueError, match="steps|temperature"):
        SampleOptions(steps=steps, temperature=temperature)


def test_a_state_that_is_not_a_number_is_refused_with_its_window():
    windows = toy_windows(toy_layout())
    state = windows.state.clone()
    state[1, 2, 0] = math.nan
    with pytest.raises(ValueError, match="window1: state: expected finite"):
        replace(windows, state=state)


@pytest.mark.parametrize("sampler", SAMPLERS)
def test_each_step_is_told_what_the_one_before_guessed(sampler, monkeypatch):
    model = toy_model()
    windows = toy_windows(model.layout)
    told, guessed, forward = [], [], model.forward

    def listening(x, known, text_known, windows, log_snr, embedded, last):
        said = forward(x, known, text_known, windows, log_snr, embedded, last)
        told.append(last)
        guessed.append(model.clean(said, x, log_snr))
        return said

    monkeypatch.setattr(model, "forward", listening)
    filled(model, windows, masks(windows, 0.2), sampler=sampler, steps=4)
    assert told[0] is None
    assert len(told) >= 4
    assert all(torch.equal(one, other) for one, other in zip(told[1:], guessed, strict=False))
