from copy import deepcopy
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from pgm_models.animation.network import Denoiser, NetworkShape
from pgm_models.animation.presets import PRESETS, NetworkOptions

SHAPE = NetworkShape(widths=(3, 7, 1), actions=2, constants=4, text_width=5)
SHAPES = (
    SHAPE,
    NetworkShape(widths=(3, 7), actions=2, constants=0, text_width=5),
    NetworkShape(widths=(3,), actions=0, constants=6, text_width=5),
    NetworkShape(widths=(2,), actions=0, constants=0, text_width=0),
    NetworkShape(widths=(3, 24) * 10, actions=10, constants=3, text_width=5),
)
OPTIONS = NetworkOptions(width=32, layers=2, heads=2, reach=6)
ORDER = ("x", "known", "text", "text_known", "rate", "log_snr", "constants")
BOTH = pytest.mark.parametrize("positions", ["bias", "shaw"])


def awake(shape: NetworkShape = SHAPE, positions: str = "bias", **changes: object) -> Denoiser:
    """A network in which nothing is at its first, small value, so that every part of it counts."""
    generator = torch.Generator().manual_seed(0)
    options = replace(OPTIONS, positions=positions, **changes)
    network = Denoiser(shape, options).eval()
    for parameter in network.parameters():
        parameter.data += 0.2 * torch.randn(parameter.shape, generator=generator)
    return network


def given(shape: NetworkShape, batch: int, frames: int, *, seed: int = 0) -> dict[str, Tensor]:
    generator = torch.Generator().manual_seed(seed)
    return {
        "x": torch.randn(batch, frames, sum(shape.widths), generator=generator),
        "known": torch.rand(batch, frames, len(shape.widths), generator=generator) < 0.5,
        "text": torch.randn(batch, frames, shape.actions, shape.text_width, generator=generator),
        "text_known": torch.rand(batch, frames, shape.actions, generator=generator) < 0.5,
        "rate": 1 + 24 * torch.rand(batch, generator=generator),
        "log_snr": 4 * torch.randn(batch, generator=generator),
        "constants": torch.randn(batch, shape.constants, generator=generator),
    }


@torch.no_grad()
def said(network: Denoiser, inputs: dict[str, Tensor]) -> Tensor:
    return network(**inputs)


def test_a_network_starts_near_zero_and_of_the_expected_size() -> None:
    torch.manual_seed(0)
    shape = NetworkShape(widths=(3, 3, 57, 3, 3, 57, 3, 3), actions=2, constants=20, text_width=128)
    network = Denoiser(shape, PRESETS["small"].network).eval()
    assert 2_000_000 < sum(parameter.numel() for parameter in network.parameters()) < 2_700_000
    first = said(network, given(shape, 2, 16))
    assert 0.005 < float(first.std()) < 0.05


@BOTH
@pytest.mark.parametrize("shape", SHAPES)
def test_any_scene_and_any_length_gives_finite_channels(shape: NetworkShape, positions: str) -> None:
    network = awake(shape, positions)
    for batch, frames in ((1, 1), (3, 2), (1, 64)):
        inputs = given(shape, batch, frames)
        found = said(network, inputs)
        assert found.shape == inputs["x"].shape
        assert bool(torch.isfinite(found).all())


@BOTH
@pytest.mark.parametrize("shape", SHAPES)
def test_a_gradient_reaches_every_parameter(shape: NetworkShape, positions: str) -> None:
    torch.manual_seed(0)
    network = Denoiser(shape, replace(OPTIONS, positions=positions))
    network(**given(shape, 4, 9)).square().sum().backward()
    silent = [name for name, p in network.named_parameters() if p.grad is None or not p.grad.abs().max() > 0]
    assert not silent


@BOTH
def test_windows_are_told_apart_and_do_not_touch_each_other(positions: str) -> None:
    network, inputs = awake(SHAPE, positions), given(SHAPE, 4, 5)
    together = said(network, inputs)
    order = torch.tensor([2, 0, 3, 1])
    shuffled = said(network, {name: value[order] for name, value in inputs.items()})
    torch.testing.assert_close(shuffled, together[order], rtol=1e-4, atol=1e-5)
    alone = torch.cat([said(network, {n: v[i : i + 1] for n, v in inputs.items()}) for i in range(4)])
    torch.testing.assert_close(alone, together, rtol=1e-4, atol=1e-5)


@BOTH
def test_a_window_backwards_in_a_network_with_distances_backwards_is_the_same_backwards(positions: str) -> None:
    network, inputs = awake(SHAPE, positions, reach=2), given(SHAPE, 2, 7)
    found = said(network, inputs)
    torch.testing.assert_close(said(mirrored_in_time(network), flipped(inputs)).flip(1), found, rtol=1e-4, atol=1e-5)
    assert (said(network, flipped(inputs)).flip(1) - found).abs().max() > 1e-2  # and time has a direction


def flipped(inputs: dict[str, Tensor]) -> dict[str, Tensor]:
    return {name: value.flip(1) if value.ndim > 2 else value for name, value in inputs.items()}


def mirrored_in_time(network: Denoiser) -> Denoiser:
    """The network with the tables of its distances the other way round."""
    copy = deepcopy(network)
    for name, parameter in copy.named_parameters():
        if name.endswith("timed"):
            parameter.data = parameter.data.flip(0)
    return copy


@BOTH
def test_nothing_but_distances_tells_the_frames_of_an_unchanging_window_apart(positions: str) -> None:
    network, inputs = awake(SHAPE, positions, reach=1), given(SHAPE, 1, 1)
    window = {n: v.repeat(1, 8, *[1] * (v.ndim - 2)) if v.ndim > 2 else v for n, v in inputs.items()}
    apart = said(network, window)[0]
    assert (apart[0] - apart[7]).abs().max() > 1e-3
    for name, table in network.named_parameters():
        if name.endswith("timed"):
            table.data[0] = table.data[2]  # before and after, the only distances beside 0, count alike
    alike = said(network, window)[0]
    torch.testing.assert_close(alike, alike[:1].expand(8, -1), rtol=1e-4, atol=1e-5)


def test_what_is_known_is_read_otherwise_and_what_no_text_says_is_not_read() -> None:
    network, inputs = awake(), given(SHAPE, 2, 4)
    found = said(network, inputs)
    for name in ("known", "text_known"):
        assert (said(network, dict(inputs, **{name: ~inputs[name]})) - found).abs().max() > 1e-2
    unread = torch.where(inputs["text_known"][..., None], inputs["text"], float("nan"))
    assert torch.equal(said(network, dict(inputs, text=unread)), found)
    assert (said(network, dict(inputs, text=inputs["text"] + 1)) - found).abs().max() > 1e-2


@pytest.mark.parametrize("name", ["rate", "log_snr", "constants", "x"])
def test_each_other_input_counts(name: str) -> None:
    network, inputs = awake(), given(SHAPE, 1, 4)
    assert (said(network, dict(inputs, **{name: inputs[name] + 1})) - said(network, inputs)).abs().max() > 1e-3


def test_each_channel_reaches_its_own_token_and_comes_from_it() -> None:
    torch.manual_seed(0)
    network = Denoiser(SHAPE, OPTIONS)
    x = torch.zeros(1, 1, 11, requires_grad=True)
    flags = torch.tensor([[[True, False, True]]])
    tokens = network.state_tokens(x, flags)
    owners = torch.tensor([0] * 3 + [1] * 7 + [2])
    for row in range(3):
        (gradient,) = torch.autograd.grad(tokens[0, 0, row].sum(), x, retain_graph=True)
        assert torch.equal(gradient[0, 0] != 0, owners == row)
        one = torch.zeros(1, 1, 3, 32)
        one[0, 0, row] = 1.0
        assert torch.equal(network.state_output(one)[0, 0] != 0, owners == row)


@pytest.mark.parametrize("log_snr", [-20.0, 20.0])
@pytest.mark.parametrize("rate", [1.0, 50.0])
def test_the_ends_of_noise_and_rate_are_finite(log_snr: float, rate: float) -> None:
    inputs = given(SHAPE, 2, 3)
    inputs |= {"log_snr": torch.full((2,), log_snr), "rate": torch.full((2,), rate)}
    for share in (True, False):
        masks = {name: torch.full_like(inputs[name], share) for name in ("known", "text_known")}
        assert bool(torch.isfinite(said(awake(), inputs | masks)).all())


@BOTH
def test_float64_and_half_precision_say_the_same(positions: str) -> None:
    network, inputs = awake(SHAPE, positions), given(SHAPE, 2, 5)
    found = said(network, inputs)
    double = {name: value.double() if value.is_floating_point() else value for name, value in inputs.items()}
    torch.testing.assert_close(said(deepcopy(network).double(), double).float(), found, rtol=1e-4, atol=1e-5)
    for dtype, bound in ((torch.bfloat16, 0.05), (torch.float16, 0.01)):
        cast = said(deepcopy(network).to(dtype), inputs)
        with torch.autocast("cpu", dtype=dtype):
            mixed = said(network, inputs)
        for other in (cast, mixed):
            assert other.dtype == torch.float32
            assert float((other - found).norm() / found.norm()) < bound
    large = dict(inputs, x=100 * inputs["x"])
    assert bool(torch.isfinite(said(deepcopy(network).half(), large)).all())


def test_a_network_learns_to_copy_a_neighbour_in_time() -> None:
    """Known world: each frame's unknown property is the known one of the frame before."""
    torch.manual_seed(0)
    shape = NetworkShape(widths=(1, 1), actions=0, constants=0, text_width=0)
    network = Denoiser(shape, replace(OPTIONS, dropout=0.0))
    optimiser = torch.optim.AdamW(network.parameters(), lr=2e-2)
    generator = torch.Generator().manual_seed(1)
    losses = []
    for _ in range(90):
        truth = torch.randn(16, 4, 1, generator=generator)
        x = torch.cat([truth, torch.zeros_like(truth)], dim=-1)
        inputs = given(shape, 16, 4) | {"x": x, "known": (torch.arange(2) == 0).expand(16, 4, 2)}
        loss = (network(**inputs)[:, 1:, 1:] - truth[:, :-1]).square().mean()
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        losses.append(float(loss.detach()))
    assert losses[0] > 0.8
    assert losses[-1] < 0.1


def test_what_cannot_be_is_refused() -> None:
    with pytest.raises(ValueError, match="heads: expected a divisor of the width 32, got 5"):
        Denoiser(SHAPE, replace(OPTIONS, heads=5))
    with pytest.raises(ValueError, match="widths: expected"):
        replace(SHAPE, widths=(3, 0))
    with pytest.raises(ValueError, match="constants: expected at least 0, got -1"):
        replace(SHAPE, constants=-1)
    inputs = given(SHAPE, 1, 2)
    with pytest.raises(ValueError, match="x: expected 11 channels, got 10"):
        said(awake(), dict(inputs, x=inputs["x"][..., :10]))
