import math
from functools import partial

import numpy as np
import pytest
import torch
from torch import Generator, Tensor

from pgm_models.animation.noise import DiffusionOptions, alpha_sigma, sampling_grid, to_x0
from pgm_models.animation.samplers import SAMPLERS, Sampler, ddim, ddpm, dpmpp_2m, normal_like, sde_2m

MEAN, SPREAD = 0.7, 0.5
ALL = {**SAMPLERS, "ddim_half": partial(ddim, eta=0.5)}
STOCHASTIC = ("ddpm", "ddim_half", "sde_2m")
OURS = DiffusionOptions()


def seeded(seed: int = 0) -> Generator:
    return Generator().manual_seed(seed)


def gaussian(x: Tensor, log_snr: Tensor) -> Tensor:
    """What states of N(MEAN, SPREAD^2) were on average, given their noisy form."""
    alpha, sigma = alpha_sigma(log_snr)
    return (MEAN * sigma**2 + alpha * SPREAD**2 * x) / (alpha**2 * SPREAD**2 + sigma**2)


def law_at(log_snr: Tensor) -> tuple[float, float]:
    """Mean and spread of the noisy states."""
    alpha, sigma = alpha_sigma(log_snr)
    return (alpha * MEAN).item(), (alpha**2 * SPREAD**2 + sigma**2).sqrt().item()


def even(first: float, last: float, steps: int) -> Tensor:
    return torch.linspace(first, last, steps + 1, dtype=torch.float64)


def shares_of_noises(sampler: Sampler, denoise, log_snr: Tensor, start: float) -> tuple[float, np.ndarray]:
    """Of a sampler of a linear denoiser: its constant, and by what the start and each later noise are multiplied.

    Element j of the states feels noise j alone.
    """
    count = len(log_snr)
    drawn = iter(range(1, count + 1))

    def alone(element: int) -> Tensor:
        return torch.zeros(count + 1, dtype=torch.float64).index_fill_(0, torch.tensor(element), 1.0)

    out = sampler(denoise, start * alone(0), log_snr, lambda: alone(next(drawn))).numpy()
    return float(out[-1]), out[:-1] - out[-1]


def spread_error(sampler: Sampler, steps: int) -> float:
    """By how much the spread of the sampled states is wrong, started from the exact law of the first node."""
    log_snr = even(-6.0, 6.0, steps)
    start = law_at(log_snr[0])[1]
    shares = shares_of_noises(sampler, gaussian, log_snr, start)[1]
    return abs(float(np.sqrt((shares**2).sum())) - law_at(log_snr[-1])[1])


def path_error(sampler: Sampler, steps: int) -> float:
    """By how much a noiseless sampler misses the exact path, which keeps (x - mean) / spread."""
    log_snr = even(-6.0, 6.0, steps)
    (mean, spread), (end_mean, end_spread) = law_at(log_snr[0]), law_at(log_snr[-1])
    z = torch.linspace(-2, 2, 9, dtype=torch.float64)
    out = sampler(gaussian, mean + spread * z, log_snr, normal_like(z, seeded()))
    return (out - end_mean - end_spread * z).abs().max().item()


def order(error, steps=(32, 64, 128, 256)) -> float:
    """Slope of the logarithm of the error against that of the step."""
    return -np.polyfit(np.log(steps), np.log([error(n) for n in steps]), 1)[0]


@pytest.mark.parametrize(("sampler", "expected"), [(ddim, 1), (dpmpp_2m, 2)])
def test_paths_reach_the_exact_solution_with_their_order(sampler, expected):
    assert order(partial(path_error, sampler)) == pytest.approx(expected, abs=0.15)


@pytest.mark.parametrize(("name", "expected"), [("ddpm", 1), ("ddim_half", 1), ("sde_2m", 2)])
def test_spread_of_stochastic_samplers_is_right_with_their_order(name, expected):
    assert order(partial(spread_error, ALL[name])) == pytest.approx(expected, abs=0.15)


def test_at_sixteen_steps_second_order_is_several_times_better_than_first():
    assert path_error(dpmpp_2m, 16) < path_error(ddim, 16) / 4
    assert spread_error(sde_2m, 16) < spread_error(ddpm, 16) / 4


@pytest.mark.parametrize("name", ALL)
def test_a_thousand_steps_give_the_gaussian_back(name):
    x = torch.randn(20_000, generator=seeded())
    out = ALL[name](gaussian, x, sampling_grid(OURS, 1000), normal_like(x, seeded(1)))
    assert out.mean().item() == pytest.approx(MEAN, abs=5 * SPREAD / math.sqrt(20_000) + 0.005)
    assert out.std().item() == pytest.approx(SPREAD, abs=5 * SPREAD / math.sqrt(40_000) + 0.005)


@pytest.mark.parametrize("name", ALL)
@pytest.mark.parametrize("steps", [2, 3, 7])
def test_around_a_known_clean_state_the_noise_is_exact_after_every_number_of_steps(name, steps):
    generator = np.random.default_rng(steps)
    log_snr = torch.tensor(np.sort(generator.uniform(-12, 12, steps + 1)))
    start = alpha_sigma(log_snr[0])[1].item()

    def certain(x: Tensor, log_snr: Tensor) -> Tensor:
        return torch.full_like(x, MEAN)

    for last in range(1, steps + 1):
        x = torch.zeros(1, dtype=torch.float64) + alpha_sigma(log_snr[0])[0] * MEAN
        path = ALL[name](certain, x, log_snr[: last + 1], lambda: torch.zeros(1, dtype=torch.float64))
        alpha, sigma = alpha_sigma(log_snr[last])
        assert path.item() == pytest.approx((alpha * MEAN).item())
        shares = shares_of_noises(ALL[name], certain, log_snr[: last + 1], start)[1]
        assert np.sqrt((shares**2).sum()) == pytest.approx(sigma.item())


@pytest.mark.parametrize("name", ALL)
@pytest.mark.parametrize("level", [-10.0, 0.0, 20.0])
def test_one_step_to_clean_is_what_the_denoiser_says(name, level):
    x = torch.randn(4, 3, generator=seeded())
    log_snr = torch.tensor([level, math.inf])
    out = ALL[name](gaussian, x, log_snr, normal_like(x, seeded()))
    assert torch.equal(out, gaussian(x, log_snr[0]))


@pytest.mark.parametrize("name", ALL)
def test_denoiser_is_asked_once_a_step_and_noise_drawn_only_where_some_is_put_in(name):
    asked, drawn = [], []

    def denoise(x: Tensor, log_snr: Tensor) -> Tensor:
        asked.append(log_snr)
        return gaussian(x, log_snr)

    def noise() -> Tensor:
        drawn.append(1)
        return torch.zeros(3)

    grid = sampling_grid(OURS, 12)
    ALL[name](denoise, torch.zeros(3), grid, noise)
    assert torch.equal(torch.stack(asked), grid[:-1].float())
    assert len(drawn) == (11 if name in STOCHASTIC else 0)


@pytest.mark.parametrize("name", ALL)
def test_temperature_scales_start_and_noise_alike(name):
    def linear(x: Tensor, log_snr: Tensor) -> Tensor:
        alpha, sigma = alpha_sigma(log_snr)
        return alpha * x / (alpha**2 + 0.3 * sigma**2)

    x = torch.randn(50, dtype=torch.float64, generator=seeded())
    grid = sampling_grid(OURS, 9)
    warm, cool = (ALL[name](linear, x, grid, normal_like(x, seeded(1)), temperature=t) for t in (1.0, 0.7))
    torch.testing.assert_close(cool, 0.7 * warm)
    cold = ALL[name](gaussian, x, grid, normal_like(x, seeded(1)), temperature=0.0)
    assert torch.equal(cold, cold[:1].expand(50))


@pytest.mark.parametrize("name", ALL)
def test_clipped_clean_states_stay_within_their_bound(name):
    x = torch.randn(200, generator=seeded())
    grid = sampling_grid(OURS, 9)
    wild = ALL[name](lambda x, level: 3 * x, x, grid, normal_like(x, seeded(1)))
    tame = ALL[name](lambda x, level: 3 * x, x, grid, normal_like(x, seeded(1)), clip=1.5)
    assert wild.abs().max() > 1.5
    assert tame.abs().max() == 1.5


@pytest.mark.parametrize("name", ALL)
def test_samples_come_from_start_and_generator_alone_and_leave_the_start_as_it_was(name):
    x = torch.randn(6, generator=seeded())
    before = x.clone()
    grid = sampling_grid(OURS, 5)
    first, again = (ALL[name](gaussian, x, grid, normal_like(x, seeded(2))) for _ in range(2))
    other = ALL[name](gaussian, x, grid, normal_like(x, seeded(3)))
    assert torch.equal(first, again)
    assert torch.equal(first, other) == (name not in STOCHASTIC)
    assert torch.equal(x, before)


@pytest.mark.parametrize("name", ALL)
@pytest.mark.parametrize(("narrow", "steps"), [(torch.float16, 1), (torch.float16, 250), (torch.bfloat16, 16)])
def test_narrow_states_stay_finite_and_near_the_precise_ones(name, narrow, steps):
    x = torch.randn(64, generator=seeded())

    def denoise(states: Tensor, log_snr: Tensor) -> Tensor:
        assert states.dtype == narrow and log_snr.dtype == torch.float32
        return gaussian(states.float(), log_snr).to(narrow)

    grid = sampling_grid(OURS, steps)
    out = ALL[name](denoise, x.to(narrow), grid, normal_like(x.to(narrow), seeded(1)))
    precise = ALL[name](gaussian, x, grid, normal_like(x, seeded(1)))
    assert out.dtype == narrow
    assert (out.float() - precise).abs().max() < (0.01 if narrow == torch.float16 else 0.08)


@pytest.mark.parametrize("name", ALL)
def test_extreme_grids_stay_finite_and_float32_agrees_with_float64(name):
    x = torch.randn(64, generator=seeded())
    draws = torch.randn(40, 64, dtype=torch.float64, generator=seeded(1))
    for grid in (even(-20, 20, 20), torch.tensor([-20.0, 20.0, math.inf]), torch.tensor([-20.0, -19.9999, 20.0])):
        outs = []
        for dtype in (torch.float32, torch.float64):
            rows = iter(draws.to(dtype))
            outs.append(ALL[name](gaussian, x.to(dtype), grid, lambda rows=rows: next(rows)).double())
        torch.testing.assert_close(*outs, rtol=1e-4, atol=1e-4)


def test_a_network_that_tells_noise_is_sampled_as_its_clean_states_are():
    def by_noise(x: Tensor, log_snr: Tensor) -> Tensor:
        alpha, sigma = alpha_sigma(log_snr)
        return to_x0("eps", (x - alpha * gaussian(x, log_snr)) / sigma, x, log_snr)

    x = torch.randn(32, dtype=torch.float64, generator=seeded())
    for sampler in ALL.values():
        outs = [sampler(d, x, sampling_grid(OURS, 16), normal_like(x, seeded(1))) for d in (gaussian, by_noise)]
        torch.testing.assert_close(*outs)


@pytest.mark.parametrize(
    "levels", [[0.0], [], [1.0, 0.0], [0.0, 0.0], [-math.inf, 0.0], [0.0, math.inf, math.inf], [0.0, math.nan]]
)
def test_impossible_grids_are_refused(levels):
    for sampler in (ddpm, ddim, dpmpp_2m, sde_2m):
        with pytest.raises(ValueError, match="log_snr: expected two or more rising numbers"):
            sampler(gaussian, torch.zeros(2), torch.tensor(levels), lambda: torch.zeros(2))


@pytest.mark.parametrize("eta", [-0.1, 1.1, math.nan])
def test_impossible_shares_of_noise_are_refused(eta):
    with pytest.raises(ValueError, match="eta: expected 0 to 1"):
        ddim(gaussian, torch.zeros(2), even(-1, 1, 2), lambda: torch.zeros(2), eta=eta)


def test_noise_has_the_shape_of_the_states_and_is_new_each_time():
    for dtype, expected in ((torch.float16, torch.float32), (torch.float64, torch.float64)):
        noise = normal_like(torch.zeros(2, 3, dtype=dtype), seeded())
        first, second = noise(), noise()
        assert first.shape == (2, 3) and first.dtype == expected
        assert not torch.equal(first, second)
