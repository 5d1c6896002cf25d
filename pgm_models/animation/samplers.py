"""From noise to clean states, step by step: DDPM, DDIM, DPM-Solver++(2M) and its stochastic form.

A sampler walks down a grid of log_snr, from noise to clean. At each node it asks `denoise` for the clean states, so it
knows nothing of what the network predicts, of what is given, or of words. A step goes from node s to node t, h is how
far: h = lambda_t - lambda_s, with lambda half of log_snr. Factors are worked out in float64 on the host; the walk is in
float32 at least, whatever the type of `x`.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from types import MappingProxyType
from typing import Protocol

import torch
from jaxtyping import Float
from torch import Generator, Tensor

from pgm_models.animation.noise import alpha_sigma

Denoise = Callable[[Float[Tensor, "*shape"], Float[Tensor, ""]], Float[Tensor, "*shape"]]
"""(noisy states, log_snr) -> clean states; the log_snr of all of them, on their device, float32 at least."""
Noise = Callable[[], Tensor]
"""Standard normal numbers, fresh ones each time, in the shape of the states."""


class Sampler(Protocol):
    """What all samplers look like."""

    def __call__(
        self,
        denoise: Denoise,
        x: Float[Tensor, "*shape"],
        log_snr: Float[Tensor, " nodes"],
        noise: Noise,
        *,
        clip: float | None = None,
        temperature: float = 1.0,
    ) -> Float[Tensor, "*shape"]:
        """States at the grid's last node, in the type of `x`.

        `x` are states at its first node, there nearly standard normal; they and all noise put in on the way are
        multiplied by `temperature`. Clean states are held within +-`clip`. `denoise` is asked once a step.

        Raises:
            ValueError: If the grid has less than two nodes, does not rise, or is infinite elsewhere than at its end.
        """
        ...


def normal_like(x: Float[Tensor, "*shape"], generator: Generator) -> Noise:
    """A source of noise in the shape of `x` and on its device, float32 at least; drawn on the generator's device."""
    dtype = torch.promote_types(x.dtype, torch.float32)
    return lambda: torch.randn(x.shape, generator=generator, device=generator.device, dtype=dtype).to(x.device)


def ddpm(
    denoise: Denoise,
    x: Float[Tensor, "*shape"],
    log_snr: Float[Tensor, " nodes"],
    noise: Noise,
    *,
    clip: float | None = None,
    temperature: float = 1.0,
) -> Float[Tensor, "*shape"]:
    """States at the last node by ancestral sampling, with the posterior's own variance; see `Sampler`.

    Source: Ho et al. 2020, equation 7; between any two nodes.
    """
    return ddim(denoise, x, log_snr, noise, eta=1.0, clip=clip, temperature=temperature)


def ddim(
    denoise: Denoise,
    x: Float[Tensor, "*shape"],
    log_snr: Float[Tensor, " nodes"],
    noise: Noise,
    *,
    eta: float = 0.0,
    clip: float | None = None,
    temperature: float = 1.0,
) -> Float[Tensor, "*shape"]:
    """States at the last node by DDIM: `eta` of 0 puts in no noise, 1 is DDPM; see `Sampler`.

    Raises:
        ValueError: If `eta` is outside 0 to 1, or the grid is wrong.

    Source: Song et al. 2021, equations 12 and 16.
    """
    if not 0 <= eta <= 1:
        raise ValueError(f"eta: expected 0 to 1, got {eta}")

    def advance(step: _Step, state: Tensor, x0: Tensor, _: Tensor) -> Tensor:
        fresh = -(eta**2) * math.expm1(-2 * step.h)
        kept = math.sqrt(1 - fresh)
        state = step.sigma_ratio * kept * state + step.alpha * (1 - math.exp(-step.h) * kept) * x0
        return state + temperature * step.sigma * math.sqrt(fresh) * noise() if fresh and step.sigma else state

    return _walk(denoise, x, log_snr, advance, clip, temperature)


def dpmpp_2m(
    denoise: Denoise,
    x: Float[Tensor, "*shape"],
    log_snr: Float[Tensor, " nodes"],
    noise: Noise,
    *,
    clip: float | None = None,
    temperature: float = 1.0,
) -> Float[Tensor, "*shape"]:
    """States at the last node by DPM-Solver++(2M); first and last step are of first order; see `Sampler`.

    Draws no noise.

    Source: Lu et al. 2022 (DPM-Solver++), algorithm 2.
    """

    def advance(step: _Step, state: Tensor, x0: Tensor, before: Tensor) -> Tensor:
        return step.sigma_ratio * state - step.alpha * math.expm1(-step.h) * (x0 + step.slope * (x0 - before))

    return _walk(denoise, x, log_snr, advance, clip, temperature)


def sde_2m(
    denoise: Denoise,
    x: Float[Tensor, "*shape"],
    log_snr: Float[Tensor, " nodes"],
    noise: Noise,
    *,
    clip: float | None = None,
    temperature: float = 1.0,
) -> Float[Tensor, "*shape"]:
    """States at the last node by SDE-DPM-Solver++(2M); first and last step are of first order; see `Sampler`.

    Source: Lu et al. 2022 (DPM-Solver++), SDE-DPM-Solver++(2M).
    """

    def advance(step: _Step, state: Tensor, x0: Tensor, before: Tensor) -> Tensor:
        fresh = -math.expm1(-2 * step.h)
        kept = step.sigma_ratio * math.exp(-step.h)
        state = kept * state + step.alpha * fresh * (x0 + step.slope * (x0 - before))
        return state + temperature * step.sigma * math.sqrt(fresh) * noise() if step.sigma else state

    return _walk(denoise, x, log_snr, advance, clip, temperature)


SAMPLERS: Mapping[str, Sampler] = MappingProxyType({"ddpm": ddpm, "ddim": ddim, "dpmpp_2m": dpmpp_2m, "sde_2m": sde_2m})
"""By name."""


@dataclass(frozen=True, kw_only=True)
class _Step:
    """From node s to node t."""

    h: float
    """lambda_t - lambda_s; may be infinite."""
    alpha: float
    """Of node t."""
    sigma: float
    """Of node t."""
    sigma_ratio: float
    """Sigma of node t by that of node s."""
    slope: float
    """Times the last change of the clean states: how far they move on in half a step; 0 for first order."""


def _walk(
    denoise: Denoise,
    x: Tensor,
    log_snr: Tensor,
    advance: Callable[[_Step, Tensor, Tensor, Tensor], Tensor],
    clip: float | None,
    temperature: float,
) -> Tensor:
    """States at the last node, each step by `advance(step, states, clean states, clean states before)`."""
    wide = torch.promote_types(x.dtype, torch.float32)
    levels = log_snr.to(x.device, wide)
    state, before = temperature * x.to(wide), None
    for row, step in enumerate(_steps(log_snr)):
        x0 = denoise(state.to(x.dtype), levels[row]).to(wide)
        if clip is not None:
            x0 = x0.clamp(-clip, clip)
        state = advance(step, state, x0, x0 if before is None else before)
        before = x0
    return state.to(x.dtype)


def _steps(log_snr: Float[Tensor, " nodes"]) -> list[_Step]:
    """The steps between the nodes."""
    levels = log_snr.double().tolist()
    rises = all(t > s for s, t in pairwise(levels))
    if len(levels) < 2 or not rises or not all(map(math.isfinite, levels[:-1])):
        raise ValueError(f"log_snr: expected two or more rising numbers, only the last infinite, got {levels}")
    alphas, sigmas = (share.tolist() for share in alpha_sigma(log_snr.double()))
    h = [(t - s) / 2 for s, t in pairwise(levels)]
    return [
        _Step(
            h=h[k],
            alpha=alphas[k + 1],
            sigma=sigmas[k + 1],
            sigma_ratio=sigmas[k + 1] / sigmas[k],
            slope=h[k] / (2 * h[k - 1]) if 0 < k < len(h) - 1 else 0.0,
        )
        for k in range(len(h))
    ]
