"""Step by step against diffusers, whose schedulers are given our grid, our clean states and our noise."""

from collections.abc import Callable

import pytest
import torch
from torch import Generator, Tensor

from pgm_models.animation.noise import DiffusionOptions, linear_log_snr, noisy, sampling_grid, target_of
from pgm_models.animation.samplers import ddim, ddpm, dpmpp_2m, sde_2m

diffusers = pytest.importorskip("diffusers")
# Inside diffusers, of its own arithmetic between numpy and torch.
pytestmark = pytest.mark.filterwarnings("ignore:__array__ implementation doesn't accept a copy:DeprecationWarning")

LINEAR = DiffusionOptions(prediction="eps", schedule="linear", weight="none")
COMMON = {
    "num_train_timesteps": 1000,
    "beta_start": 1e-4,
    "beta_end": 0.02,
    "beta_schedule": "linear",
    "prediction_type": "sample",
    "timestep_spacing": "trailing",
}
SHAPE = (2, 3, 4)


def clean(x: Tensor, log_snr: Tensor) -> Tensor:
    """Clean states of no particular law."""
    return torch.tanh(1.3 * x + 0.2 * log_snr) + 0.1 * x.flip(-1)


def seeded(seed: int = 7) -> Generator:
    return Generator().manual_seed(seed)


def draws(count: int, dtype: torch.dtype = torch.float64) -> Tensor:
    """The start, and a noise for each step, one after the other from one generator."""
    generator = seeded()
    return torch.stack([torch.randn(SHAPE, generator=generator, dtype=dtype) for _ in range(count + 1)])


def our_walk(sampler: Callable, grid: Tensor, z: Tensor, **options) -> list[Tensor]:
    """States at all nodes, the first given and the last returned."""
    states = []

    def denoise(x: Tensor, log_snr: Tensor) -> Tensor:
        states.append(x)
        return clean(x, log_snr)

    later = iter(z[1:])
    out = sampler(denoise, z[0], grid, lambda: next(later), **options)
    return [*states, out]


def their_walk(scheduler, grid: Tensor, start: Tensor, options: Callable[[int], dict]) -> list[Tensor]:
    """The same of a diffusers scheduler."""
    states = [start]
    for k, t in enumerate(scheduler.timesteps):
        told = clean(states[-1], grid[k].to(start.dtype))
        states.append(scheduler.step(told, t, states[-1], **options(k)).prev_sample)
    return states


def assert_same_walk(ours: list[Tensor], theirs: list[Tensor]) -> None:
    assert len(ours) == len(theirs)
    torch.testing.assert_close(torch.stack(ours), torch.stack(theirs), rtol=1e-5, atol=1e-5)


def with_precise_table(scheduler):
    """The same scheduler with its table, a running product of float32 numbers, in float64."""
    table = linear_log_snr(torch.arange(1, 1001), 1000).sigmoid()
    torch.testing.assert_close(scheduler.alphas_cumprod.double(), table, rtol=5e-5, atol=0)
    scheduler.alphas_cumprod = table
    return scheduler


@pytest.mark.parametrize(("steps", "clip"), [(1, None), (20, None), (1000, None), (20, 0.8)])
def test_ddpm_walks_like_diffusers(steps, clip):
    scheduler = with_precise_table(
        diffusers.DDPMScheduler(
            **COMMON, variance_type="fixed_small", clip_sample=clip is not None, clip_sample_range=clip or 1.0
        )
    )
    scheduler.set_timesteps(steps)
    grid = sampling_grid(LINEAR, steps, spacing="time")
    z = draws(steps)
    generator = seeded()  # It draws its noise itself, with the type of the states: the same numbers as ours.
    torch.randn(SHAPE, generator=generator, dtype=torch.float64)
    theirs = their_walk(scheduler, grid, z[0], lambda _: {"generator": generator})
    assert_same_walk(our_walk(ddpm, grid, z, clip=clip), theirs)


@pytest.mark.parametrize("steps", [1, 20, 200])
@pytest.mark.parametrize("eta", [0.0, 0.4, 1.0])
def test_ddim_walks_like_diffusers(steps, eta):
    scheduler = with_precise_table(diffusers.DDIMScheduler(**COMMON, clip_sample=False, set_alpha_to_one=True))
    scheduler.set_timesteps(steps)
    grid = sampling_grid(LINEAR, steps, spacing="time")
    z = draws(steps)
    theirs = their_walk(scheduler, grid, z[0], lambda k: {"eta": eta, "variance_noise": z[k + 1] if eta else None})
    assert_same_walk(our_walk(ddim, grid, z, eta=eta), theirs)


def multistep(algorithm: str, grid: Tensor):
    """Diffusers' solver of second order, walking our grid; float32, as it works."""
    scheduler = diffusers.DPMSolverMultistepScheduler(
        **COMMON,
        solver_order=2,
        solver_type="midpoint",
        algorithm_type=algorithm,
        final_sigmas_type="zero",
        lower_order_final=True,
    )
    scheduler.set_timesteps(timesteps=list(range(1000, 1000 - len(grid) + 1, -1)))
    scheduler.sigmas = torch.exp(-grid / 2)
    assert scheduler.sigmas[-1] == 0
    return scheduler


@pytest.mark.parametrize(
    ("sampler", "algorithm"), [(dpmpp_2m, "dpmsolver++"), (sde_2m, "sde-dpmsolver++")], ids=["2m", "sde-2m"]
)
@pytest.mark.parametrize("spacing", ["lambda", "time"])
@pytest.mark.parametrize("options", [DiffusionOptions(), LINEAR], ids=["cosine", "linear"])
@pytest.mark.parametrize("steps", [1, 2, 16, 100])
def test_second_order_solvers_walk_like_diffusers(sampler, algorithm, spacing, options, steps):
    grid = sampling_grid(options, steps, spacing=spacing)
    z = draws(steps, torch.float32)
    scheduler = multistep(algorithm, grid)
    stochastic = sampler is sde_2m
    theirs = their_walk(scheduler, grid, z[0], lambda k: {"variance_noise": z[k + 1]} if stochastic else {})
    assert_same_walk(our_walk(sampler, grid, z), theirs)


def test_solver_nodes_in_time_are_the_trailing_ones_of_diffusers():
    scheduler = diffusers.DPMSolverMultistepScheduler(**COMMON, final_sigmas_type="zero")
    scheduler.set_timesteps(25)
    ours = torch.exp(-sampling_grid(LINEAR, 25, spacing="time") / 2)
    torch.testing.assert_close(ours, scheduler.sigmas.double(), rtol=1e-4, atol=0)


def test_noisy_states_and_v_are_those_of_diffusers():
    scheduler = with_precise_table(diffusers.DDPMScheduler(**COMMON))
    k = torch.tensor([1, 2, 300, 999, 1000])
    x0, eps = torch.randn(2, 5, 3, 4, generator=seeded(), dtype=torch.float64)
    level = linear_log_snr(k, 1000)
    torch.testing.assert_close(noisy(x0, eps, level), scheduler.add_noise(x0, eps, k - 1))
    torch.testing.assert_close(target_of("v", x0, eps, level), scheduler.get_velocity(x0, eps, k - 1))
