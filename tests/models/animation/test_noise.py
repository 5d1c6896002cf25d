import math

import numpy as np
import pytest
import scipy.stats
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Generator, Tensor

from pgm_models.animation.noise import (
    DiffusionOptions,
    Prediction,
    alpha_sigma,
    cosine_log_snr,
    cosine_time,
    draw_log_snr,
    linear_log_snr,
    loss_weight,
    masked_loss,
    noisy,
    sampling_grid,
    target_of,
    to_x0,
)

OURS = DiffusionOptions()
PAPER = DiffusionOptions(prediction="eps", schedule="linear", weight="none")
KINDS: tuple[Prediction, ...] = ("eps", "x0", "v")
WIDE = torch.tensor([-20.0, -10, -3, 0, 3, 10, 20])


def seeded(seed: int = 0) -> Generator:
    return Generator().manual_seed(seed)


def test_signal_and_noise_make_one_and_are_exact_at_the_ends():
    level = torch.tensor([-math.inf, -700, -20, 0, 20, 700, math.inf], dtype=torch.float64)
    alpha, sigma = alpha_sigma(level)
    torch.testing.assert_close(alpha**2 + sigma**2, torch.ones_like(level))
    torch.testing.assert_close(2 * (alpha.log() - sigma.log())[1:-1], level[1:-1])
    assert (alpha[-1], sigma[-1]) == (1, 0)
    assert (alpha[0], sigma[0]) == (0, 1)
    for narrow in (torch.float32, torch.float16, torch.bfloat16):
        rough = alpha_sigma(WIDE.to(narrow))
        assert rough[0].dtype == torch.float32
        torch.testing.assert_close(rough[0], alpha_sigma(WIDE.double())[0].float(), rtol=1e-6, atol=0)
        torch.testing.assert_close(rough[1], alpha_sigma(WIDE.double())[1].float(), rtol=1e-6, atol=0)


def test_cosine_schedule_turns_its_angle_evenly_from_plus_to_minus_ten():
    u = torch.linspace(0, 1, 101, dtype=torch.float64)
    level = cosine_log_snr(u)
    torch.testing.assert_close(level[[0, 50, 100]], torch.tensor([10.0, 0, -10], dtype=torch.float64))
    alpha, sigma = alpha_sigma(level)
    turned = torch.atan2(sigma, alpha).diff()
    torch.testing.assert_close(turned, turned[:1].expand(100))
    torch.testing.assert_close(cosine_log_snr(u.float()).double(), level, rtol=1e-5, atol=1e-5)


@given(u=st.floats(0, 1))
def test_cosine_time_undoes_cosine_log_snr(u):
    there = cosine_log_snr(torch.tensor([u], dtype=torch.float64))
    assert abs(cosine_time(there).item() - u) < 1e-9


def test_cosine_time_stays_within_its_ends():
    assert cosine_time(torch.tensor([math.inf, 30, -30, -math.inf])).tolist() == [0, 0, 1, 1]


@pytest.mark.parametrize("steps", [21, 100, 1000])
def test_linear_schedule_is_the_running_product_of_its_betas(steps):
    product, expected = 1.0, []
    for k in range(steps):
        first, last = 1e-4 * 1000 / steps, 0.02 * 1000 / steps
        product *= 1 - (first + (last - first) * k / (steps - 1))
        expected.append(math.log(product / (1 - product)))
    level = linear_log_snr(torch.arange(1, steps + 1), steps)
    np.testing.assert_allclose(level.numpy(), expected, rtol=1e-9)
    if steps == 1000:
        assert product == pytest.approx(4.0e-5, rel=0.02)
        assert level[0].item() == pytest.approx(math.log((1 - 1e-4) / 1e-4))


def test_noise_to_train_on_is_uniform_in_time():
    count = 4000
    u = cosine_time(draw_log_snr(OURS, count, seeded()))
    assert scipy.stats.kstest(u.numpy(), "uniform").pvalue > 1e-3
    few = DiffusionOptions(schedule="linear", steps=25)
    table = linear_log_snr(torch.arange(1, 26), 25).float()
    drawn = draw_log_snr(few, count, seeded())
    k = (drawn[:, None] - table).abs().argmin(1)
    assert torch.equal(table[k], drawn)
    assert scipy.stats.chisquare(torch.bincount(k, minlength=25).numpy()).pvalue > 1e-3


@pytest.mark.parametrize("options", [OURS, PAPER])
def test_noise_to_train_on_comes_from_the_generator_alone(options):
    torch.testing.assert_close(draw_log_snr(options, 8, seeded(3)), draw_log_snr(options, 8, seeded(3)), rtol=0, atol=0)
    assert not torch.equal(draw_log_snr(options, 8, seeded(3)), draw_log_snr(options, 8, seeded(4)))
    assert draw_log_snr(options, 8, seeded()).dtype == torch.float32


@pytest.mark.parametrize("options", [OURS, PAPER])
@pytest.mark.parametrize("spacing", ["lambda", "time"])
@pytest.mark.parametrize("steps", [1, 2, 16, 333, 1000])
def test_grids_rise_from_the_noisiest_to_clean(options, spacing, steps):
    grid = sampling_grid(options, steps, spacing=spacing)
    assert grid.shape == (steps + 1,)
    assert (grid.diff() > 0).all()
    assert grid[-1] == math.inf
    noisiest = -10 if options is OURS else linear_log_snr(torch.tensor([1000]), 1000).item()
    assert grid[0].item() == pytest.approx(noisiest)


def test_grids_are_even_in_log_snr_or_in_time():
    for options in (OURS, PAPER):
        apart = sampling_grid(options, 16)[:-1].diff()
        torch.testing.assert_close(apart, apart[:1].expand(15))
    time = cosine_time(sampling_grid(OURS, 10, spacing="time"))
    torch.testing.assert_close(time, torch.linspace(1, 0, 11, dtype=torch.float64))
    table = linear_log_snr(torch.arange(1, 1001), 1000).flip(0)
    assert torch.equal(sampling_grid(PAPER, 1000, spacing="time")[:-1], table)
    assert torch.equal(sampling_grid(PAPER, 20, spacing="time")[:-1], table[::50])


@pytest.mark.parametrize(("steps", "options"), [(0, OURS), (-1, PAPER), (1001, PAPER)])
def test_grids_of_impossible_length_are_refused(steps, options):
    with pytest.raises(ValueError, match="steps: expected 1 to"):
        sampling_grid(options, steps, spacing="time")


@pytest.mark.parametrize(
    ("field", "value"),
    [("prediction", "score"), ("schedule", "sigmoid"), ("weight", "snr"), ("min_snr", 0.0), ("steps", 20)],
)
def test_impossible_options_are_refused(field, value):
    with pytest.raises((ValueError, TypeError), match=field):
        DiffusionOptions(**{field: value})


def test_options_are_equal_by_value():
    assert DiffusionOptions(prediction="x0") == DiffusionOptions(prediction="x0")
    assert len({OURS, DiffusionOptions(), PAPER}) == 2


@pytest.mark.parametrize("kind", KINDS)
def test_clean_states_come_back_from_what_the_network_should_tell(kind):
    x0, eps = torch.randn(2, 7, 5, 3, dtype=torch.float64, generator=seeded())
    level = WIDE.double()
    x = noisy(x0, eps, level)
    torch.testing.assert_close(to_x0(kind, target_of(kind, x0, eps, level), x, level), x0, rtol=0, atol=1e-11)
    alpha, _ = alpha_sigma(WIDE)
    error = (to_x0(kind, target_of(kind, x0, eps, level).float(), x.float(), WIDE) - x0).abs().amax((1, 2))
    assert (error < (1e-6 / alpha if kind == "eps" else 1e-6)).all()


@pytest.mark.parametrize("kind", KINDS)
def test_one_log_snr_for_all_windows_is_the_same_as_one_each(kind):
    x, output = torch.randn(2, 3, 4, 2, generator=seeded())
    level = torch.tensor(-1.7)
    assert torch.equal(to_x0(kind, output, x, level), to_x0(kind, output, x, level.expand(3)))
    assert torch.equal(target_of(kind, output, x, level), target_of(kind, output, x, level.expand(3)))
    assert torch.equal(noisy(output, x, level), noisy(output, x, level.expand(3)))
    each = torch.tensor([-4.0, 0, 4])
    rows = [to_x0(kind, output[k : k + 1], x[k : k + 1], each[k : k + 1]) for k in range(3)]
    assert torch.equal(to_x0(kind, output, x, each), torch.cat(rows))


@pytest.mark.parametrize("kind", ["eps", "v"])
def test_without_noise_the_states_are_the_clean_states(kind):
    x, output = torch.randn(2, 3, 4, 2, generator=seeded())
    assert torch.equal(to_x0(kind, output, x, torch.tensor(math.inf)), x)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("narrow", [torch.float16, torch.bfloat16])
def test_narrow_outputs_are_worked_in_float32(kind, narrow):
    x, output = torch.randn(2, 7, 4, 2, generator=seeded())
    told = to_x0(kind, output.to(narrow), x, WIDE)
    assert torch.equal(told, to_x0(kind, output.to(narrow).float(), x, WIDE))
    both = to_x0(kind, output.to(narrow), x.to(narrow), WIDE)
    assert told.dtype == both.dtype == torch.float32
    assert both.isfinite().all()


@pytest.mark.parametrize("kind", KINDS)
def test_weighted_errors_of_all_predictions_are_the_clean_states_cut_error(kind):
    level = torch.linspace(-9, 9, 37, dtype=torch.float64)
    x0, eps = torch.randn(2, 37, 4, 2, dtype=torch.float64, generator=seeded())
    x = noisy(x0, eps, level)
    told = target_of(kind, x0, eps, level) + 0.3 * torch.randn(x.shape, dtype=torch.float64, generator=seeded(1))
    of_told = (told - target_of(kind, x0, eps, level)).square().sum((1, 2))
    of_clean = (to_x0(kind, told, x, level) - x0).square().sum((1, 2))
    weight = loss_weight(DiffusionOptions(prediction=kind), level)
    torch.testing.assert_close(weight * of_told, level.exp().clamp(max=5) * of_clean)


@pytest.mark.parametrize("kind", KINDS)
def test_weights_are_finite_at_any_noise(kind):
    level = torch.cat([WIDE, torch.tensor([-1000.0, 1000.0])])
    weight = loss_weight(DiffusionOptions(prediction=kind), level)
    assert weight.isfinite().all()
    assert (weight >= 0).all() and (weight <= 5).all()
    precise = loss_weight(DiffusionOptions(prediction=kind), level.double())
    torch.testing.assert_close(weight.double(), precise, rtol=1e-5, atol=1e-38)
    assert torch.equal(loss_weight(DiffusionOptions(prediction=kind, weight="none"), level), torch.ones(9))


def slow_loss(prediction: Tensor, target: Tensor, unknown: Tensor, weight: Tensor, owner: list[int], balanced: bool):
    sums, counts = [0.0] * unknown.shape[-1], [0] * unknown.shape[-1]
    for b in range(unknown.shape[0]):
        for t in range(unknown.shape[1]):
            for c, p in enumerate(owner):
                if unknown[b, t, p]:
                    sums[p] += (weight[b] * (prediction[b, t, c] - target[b, t, c]) ** 2).item()
                    counts[p] += 1
    each = [s / n if n else 0.0 for s, n in zip(sums, counts, strict=True)]
    if balanced:
        asked = [e for e, n in zip(each, counts, strict=True) if n]
        return (sum(asked) / len(asked) if asked else 0.0), each
    return (sum(sums) / sum(counts) if sum(counts) else 0.0), each


@settings(max_examples=30, deadline=None)
@given(
    seed=st.integers(0, 2**31),
    frames=st.integers(1, 4),
    widths=st.lists(st.integers(0, 3), min_size=1, max_size=4),
    share=st.sampled_from([0.0, 0.1, 0.5, 1.0]),
    balanced=st.booleans(),
)
def test_loss_is_the_mean_over_unknown_entries(seed, frames, widths, share, balanced):
    generator = seeded(seed)
    owner = [p for p, width in enumerate(widths) for _ in range(width)]
    prediction, target = torch.randn(2, 3, frames, len(owner), generator=generator)
    unknown = torch.rand(3, frames, len(widths), generator=generator) < share
    weight = torch.rand(3, generator=generator)
    rows = torch.tensor(owner, dtype=torch.long)
    loss, each = masked_loss(prediction, target, unknown, weight, rows, balanced=balanced)
    expected, expected_each = slow_loss(prediction, target, unknown, weight, owner, balanced)
    assert loss.item() == pytest.approx(expected, rel=1e-5)
    assert each.tolist() == pytest.approx(expected_each, rel=1e-5)


@pytest.mark.parametrize("balanced", [True, False])
def test_known_entries_have_no_part_in_the_loss_even_where_they_are_nan(balanced):
    prediction, target = torch.randn(2, 2, 3, 4, generator=seeded())
    rows = torch.tensor([0, 0, 1, 2])
    unknown = torch.ones(2, 3, 3, dtype=torch.bool)
    unknown[0, 1] = False
    unknown[..., 2] = False
    spoilt = prediction.masked_fill(~unknown[..., rows], math.nan).requires_grad_()
    loss, each = masked_loss(spoilt, target, unknown, torch.ones(2), rows, balanced=balanced)
    loss.backward()
    assert each[2] == 0 and (each[:2] > 0).all()
    counts = torch.tensor([10.0, 5.0])
    expected = each[:2].mean() if balanced else (each[:2] * counts).sum() / counts.sum()
    torch.testing.assert_close(loss, expected)
    assert spoilt.grad is not None
    assert torch.equal(spoilt.grad != 0, unknown[..., rows])


@pytest.mark.parametrize("balanced", [True, False])
def test_a_batch_with_nothing_unknown_has_loss_and_gradient_zero(balanced):
    prediction = torch.randn(2, 3, 4, generator=seeded()).requires_grad_()
    unknown = torch.zeros(2, 3, 1, dtype=torch.bool)
    rows = torch.zeros(4, dtype=torch.long)
    loss, each = masked_loss(prediction, torch.zeros(2, 3, 4), unknown, torch.ones(2), rows, balanced=balanced)
    loss.backward()
    assert (loss.item(), each.tolist()) == (0, [0])
    assert prediction.grad is not None and not prediction.grad.any()


def test_a_wide_property_outweighs_a_narrow_one_only_when_not_balanced():
    rows = torch.tensor([0] * 9 + [1])
    prediction = torch.tensor([1.0] * 9 + [3.0]).expand(2, 4, 10)
    unknown = torch.ones(2, 4, 2, dtype=torch.bool)
    of_each = {
        balanced: masked_loss(prediction, torch.zeros(2, 4, 10), unknown, torch.ones(2), rows, balanced=balanced)
        for balanced in (True, False)
    }
    assert of_each[True][0].item() == 5.0
    assert of_each[False][0].item() == pytest.approx(1.8)
    assert of_each[True][1].tolist() == of_each[False][1].tolist() == [1, 9]


def test_losses_of_narrow_predictions_are_summed_in_float32():
    prediction = torch.full((4, 64, 64), 3.0, dtype=torch.bfloat16)
    unknown = torch.ones(4, 64, 1, dtype=torch.bool)
    rows = torch.zeros(64, dtype=torch.long)
    loss, _ = masked_loss(prediction, torch.zeros(4, 64, 64), unknown, torch.ones(4), rows, balanced=True)
    assert loss.dtype == torch.float32
    assert loss.item() == 9.0
