import math

import pytest
import torch

from pgm_models.animation.modulation import (
    WAVES,
    Condition,
    DemodulatedLinear,
    demodulated_linear,
    waves,
)


def drawn(*sizes: int, seed: int = 0, dtype: torch.dtype = torch.float64) -> torch.Tensor:
    return torch.randn(*sizes, generator=torch.Generator().manual_seed(seed), dtype=dtype)


def modulated_weight_by_weight(inputs, scale, weight, gain, bias):
    """Each sample's own weights, written out."""
    outputs = []
    for sample, factors in zip(inputs, scale, strict=True):
        own = weight * factors[None, :]
        own = own / (own.square().sum(1, keepdim=True) + 1e-8).sqrt() * gain[:, None]
        outputs.append(torch.stack([own @ token + bias for token in sample]))
    return torch.stack(outputs)


def test_modulated_activations_are_modulated_weights() -> None:
    arguments = (drawn(3, 5, 7, seed=1), drawn(3, 7, seed=2), drawn(4, 7, seed=3), drawn(4, seed=4), drawn(4, seed=5))
    torch.testing.assert_close(demodulated_linear(*arguments), modulated_weight_by_weight(*arguments))


def test_neither_the_size_of_weights_nor_that_of_scales_counts() -> None:
    inputs, scale, weight = drawn(2, 3, 6), 1 + 0.3 * drawn(2, 6, seed=1), drawn(5, 6, seed=2)
    ones, zeros = torch.ones(5, dtype=torch.float64), torch.zeros(5, dtype=torch.float64)
    once = demodulated_linear(inputs, scale, weight, ones, zeros)
    torch.testing.assert_close(demodulated_linear(inputs, 7 * scale, weight / 3, ones, zeros), once, rtol=1e-6, atol=0)


def test_weights_of_nothing_give_the_bias_and_no_nan() -> None:
    zeros, bias = torch.zeros(5, 6), drawn(5, dtype=torch.float32)
    said = demodulated_linear(drawn(2, 3, 6, dtype=torch.float32), torch.ones(2, 6), zeros, torch.ones(5), bias)
    assert torch.equal(said, bias.expand(2, 3, 5))


def test_a_layer_begins_with_outputs_of_its_gain() -> None:
    torch.manual_seed(0)
    layer = DemodulatedLinear(256, 128, gain=0.25)
    said = layer(drawn(2, 200, 256, seed=7, dtype=torch.float32), torch.ones(2, 256)).detach()
    assert float(said.std()) == pytest.approx(0.25, rel=0.05)


def test_waves_are_sines_and_cosines_and_distinguish_small_steps_of_noise() -> None:
    values = torch.linspace(-20, 20, 401)
    found = waves(values)
    assert found.shape == (401, 2 * WAVES)
    torch.testing.assert_close(found[:, :WAVES].square() + found[:, WAVES:].square(), torch.ones(401, WAVES))
    apart = torch.cdist(found, found) + 10 * torch.eye(401)
    assert float(apart.min()) > 0.3  # a tenth apart
    assert int(apart[0].argmin()) == 1  # the nearest is the neighbour, the far end is not
    assert waves(values.half()).dtype == torch.float32
    slowest = 2 * math.pi / 80
    torch.testing.assert_close(found[:, 0], (values * slowest).sin())


def condition() -> Condition:
    torch.manual_seed(0)
    return Condition(shares=5, width=16, inputs=(4, 6))


@torch.no_grad()
def test_scales_are_around_one_and_hear_noise_rate_and_each_share() -> None:
    known, text_known = torch.zeros(1, 4, 3, dtype=torch.bool), torch.zeros(1, 4, 2, dtype=torch.bool)
    rate, log_snr = torch.tensor([25.0]), torch.tensor([1.0])
    module = condition()
    first, second = module(known, text_known, rate, log_snr)
    assert first.shape == (1, 4) and second.shape == (1, 6)
    assert (first - 1).abs().max() < 0.5
    others = [(known, text_known, rate, log_snr + 1), (known, text_known, rate / 5, log_snr)]
    for row in range(5):
        flags = torch.zeros(1, 4, 5, dtype=torch.bool)
        flags[0, 1, row] = True
        others.append((flags[..., :3], flags[..., 3:], rate, log_snr))
    answers = [torch.cat(module(*other), dim=-1) for other in others]
    answers.append(torch.cat([first, second], dim=-1))
    apart = torch.cdist(torch.cat(answers), torch.cat(answers)) + torch.eye(len(answers))
    assert float(apart.min()) > 1e-4


@torch.no_grad()
def test_only_how_much_is_known_counts_not_when_nor_of_how_many_frames() -> None:
    flags = torch.rand(2, 6, 5, generator=torch.Generator().manual_seed(0)) < 0.5
    rest = torch.tensor([4.0, 25.0]), torch.tensor([-3.0, 3.0])
    module = condition()
    once = torch.cat(module(flags[..., :3], flags[..., 3:], *rest), dim=-1)
    turned = flags.flip(1).repeat(1, 3, 1)
    torch.testing.assert_close(torch.cat(module(turned[..., :3], turned[..., 3:], *rest), dim=-1), once)
