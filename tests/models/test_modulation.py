import pytest
import torch

from pgm_models.modulation import DemodulatedLinear, demodulated_linear


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


def test_rows_of_several_samples_are_scaled_as_their_own_sample() -> None:
    torch.manual_seed(0)
    layer = DemodulatedLinear(6, 5, gain=0.7)
    inputs, scale = drawn(3, 4, 6, dtype=torch.float32), 1 + 0.3 * drawn(3, 6, seed=1, dtype=torch.float32)
    frame = torch.arange(3).repeat_interleave(4)
    together = layer.of_rows(inputs.flatten(0, 1), frame, scale)
    torch.testing.assert_close(together, layer(inputs, scale).flatten(0, 1))
    alone = layer.of_rows(inputs[1], torch.zeros(4, dtype=torch.int64), scale[1:2])
    torch.testing.assert_close(alone, layer(inputs, scale)[1])
