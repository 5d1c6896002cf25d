"""A Gaussian prior of each channel over time, and the best linear guess of clean states that it gives.

Channels are taken for independent stationary Gaussian processes whose autocorrelation is that of the data. From known
values and noisy ones this gives, in closed form, the expected clean state and how far from it the truth is to be
expected. The network tells the rest, in units of that doubt: it need not learn to carry a known value through time or
that bodies move smoothly, and its errors shrink with the doubt. This is the preconditioning of Karras et al. 2022
(equation 7, c_skip and c_out) with a process in place of one variance.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn

from pgm_data.geometry.arrays import frozen
from pgm_models.animation.noise import alpha_sigma
from pgm_models.animation.windows import Windows

SCALES_S = (0.03, 0.06, 0.12, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 32.0)
"""Length scales of the kernels that autocorrelations are made of, seconds."""
KNOWN_VARIANCE = 1e-6
"""Of what is known, standardised: it keeps matrices well conditioned."""
LEAST_DOUBT = 0.25
"""Standardised; the network's unit is never smaller."""
NO_LAG = 1e-9


@dataclass(frozen=True, eq=False, kw_only=True)
class TemporalPrior:
    """Autocorrelations as sums of kernels: smooth ones, rough ones, and what does not last a frame."""

    smooth: Float[np.ndarray, "channels scales"]
    """Share of (1 + r) exp(-r), r = sqrt(3) t / s, for each s of `SCALES_S` (Matern 3/2); not negative."""
    rough: Float[np.ndarray, "channels scales"]
    """Share of exp(-t / s)."""
    white: Float[np.ndarray, " channels"]
    """Share without any memory."""

    def __post_init__(self) -> None:
        """Keep read-only copies, and check that all shares are variances."""
        for name in ("smooth", "rough", "white"):
            object.__setattr__(self, name, frozen(getattr(self, name)))
            if not (getattr(self, name) >= 0).all():
                raise ValueError(f"prior.{name}: expected shares of 0 or more, got others")


def prior_to_json(prior: TemporalPrior) -> dict[str, object]:
    """The prior as JSON values."""
    return {name: getattr(prior, name).tolist() for name in ("smooth", "rough", "white")}


def prior_from_json(raw: Mapping) -> TemporalPrior:
    """The prior that `prior_to_json` wrote."""
    return TemporalPrior(**{name: np.asarray(raw[name], dtype=np.float64) for name in ("smooth", "rough", "white")})


def fit_prior(batches: Iterable[Windows], property_of_channel: Int[np.ndarray, " channels"]) -> TemporalPrior:
    """The prior whose autocorrelations are nearest to those of the windows, by non-negative least squares.

    Args:
        batches: Windows of several rates, so that short and long lags are seen.
        property_of_channel: Which flag of `valid` tells of each channel.

    Raises:
        ValueError: If there are none.
    """
    from scipy.optimize import nnls

    lags, values, weights = [], [], []
    for windows in batches:
        for rate in torch.unique(windows.rate).tolist():
            rows = windows.rate == rate
            there = windows.valid[rows][..., torch.as_tensor(property_of_channel.copy())]
            products, counts = _products(windows.state[rows], there)
            lags.append(np.arange(len(counts)) / rate)
            values.append(products)
            weights.append(counts)
    if not lags:
        raise ValueError("prior: expected windows to fit it to, got none")
    lag, product, count = np.concatenate(lags), np.concatenate(values), np.concatenate(weights)
    basis = _basis(lag)
    share = np.empty((product.shape[1], basis.shape[1]))
    for channel in range(product.shape[1]):
        seen = count[:, channel] > 0
        mean = np.where(seen, product[:, channel] / np.maximum(count[:, channel], 1), 0.0)
        weight = np.sqrt(count[:, channel])
        share[channel] = nnls(basis * weight[:, None], mean * weight)[0] if seen.any() else 0.0
        share[channel, -1] += max(0.0, 1e-3 - share[channel].sum())
    scales = len(SCALES_S)
    return TemporalPrior(smooth=share[:, :scales], rough=share[:, scales:-1], white=share[:, -1])


def _products(state: Tensor, there: Tensor) -> tuple[np.ndarray, np.ndarray]:
    """Sums over pairs of frames at each lag of the products of each channel, and their number."""
    frames, channels = state.shape[1:]
    present = there.double()
    values = state.double() * present
    products, counts = np.zeros((frames, channels)), np.zeros((frames, channels))
    for lag in range(frames):
        products[lag] = (values[:, lag:] * values[:, : frames - lag]).sum((0, 1)).numpy()
        counts[lag] = (present[:, lag:] * present[:, : frames - lag]).sum((0, 1)).numpy()
    return products, counts


def _basis(lag: Float[np.ndarray, " lags"]) -> Float[np.ndarray, "lags kernels"]:
    scale = np.asarray(SCALES_S)
    reach = np.sqrt(3) * lag[:, None] / scale
    smooth = (1 + reach) * np.exp(-reach)
    rough = np.exp(-lag[:, None] / scale)
    return np.concatenate([smooth, rough, (lag < NO_LAG)[:, None].astype(float)], axis=1)


class Preconditioner(nn.Module):
    """The prior on a device."""

    def __init__(self, prior: TemporalPrior) -> None:
        super().__init__()
        self.smooth: Tensor
        self.rough: Tensor
        self.white: Tensor
        self.scales: Tensor
        self.register_buffer("smooth", torch.as_tensor(prior.smooth.copy()), persistent=False)
        self.register_buffer("rough", torch.as_tensor(prior.rough.copy()), persistent=False)
        self.register_buffer("white", torch.as_tensor(prior.white.copy()), persistent=False)
        self.register_buffer("scales", torch.tensor(SCALES_S, dtype=torch.float64), persistent=False)

    def _apply(self, fn, recurse: bool = True):  # type: ignore[override]
        """Move to a device, but stay in double precision."""
        kept = {name: getattr(self, name) for name in ("smooth", "rough", "white", "scales")}
        super()._apply(fn, recurse)
        for name, value in kept.items():
            setattr(self, name, value.to(getattr(self, name).device))
        return self

    def covariance(self, frames: int, rate: Float[Tensor, " B"]) -> Float[Tensor, "B C T T"]:
        """Of the channels of windows of that length."""
        times = torch.arange(frames, device=rate.device, dtype=torch.float64)
        lag = (times[:, None] - times).abs()[None] / rate.double()[:, None, None]
        reach = math.sqrt(3) * lag[..., None] / self.scales
        smooth = ((1 + reach) * torch.exp(-reach)) @ self.smooth.T
        rough = torch.exp(-lag[..., None] / self.scales) @ self.rough.T
        covariance = (smooth + rough).permute(0, 3, 1, 2)
        return covariance + self.white[:, None, None] * torch.eye(frames, dtype=torch.float64, device=rate.device)

    def forward(
        self,
        x: Float[Tensor, "B T C"],
        given: Bool[Tensor, "B T C"],
        valid: Bool[Tensor, "B T C"],
        rate: Float[Tensor, " B"],
        log_snr: Float[Tensor, " B"],
    ) -> tuple[Float[Tensor, "B T C"], Float[Tensor, "B T C"]]:
        """Expected clean states and their standard deviation, given known values and noisy ones.

        Args:
            x: Known values where given, alpha x0 + sigma noise elsewhere.
            given: What is known.
            valid: Elsewhere x says nothing.
            rate: Frames a second.
            log_snr: Of the noise.
        """
        alpha, sigma = (share.double()[:, None, None] for share in alpha_sigma(log_snr))
        gain = torch.where(given, 1.0, torch.where(valid, alpha, 0.0)).transpose(1, 2)
        noise = torch.where(given, KNOWN_VARIANCE, torch.where(valid, sigma.square(), 1.0)).transpose(1, 2)
        covariance = self.covariance(x.shape[1], rate)
        seen = gain[..., None] * covariance
        total = seen * gain[..., None, :] + torch.diag_embed(noise.clamp(min=KNOWN_VARIANCE))
        factor = torch.linalg.cholesky(total)
        half = torch.linalg.solve_triangular(factor, seen, upper=False)
        told = torch.linalg.solve_triangular(factor, x.double().transpose(1, 2)[..., None], upper=False)
        mean = (half.transpose(-1, -2) @ told)[..., 0]
        variance = covariance.diagonal(dim1=-2, dim2=-1) - half.square().sum(-2)
        doubt = (variance.clamp(min=0) + LEAST_DOUBT**2).sqrt()
        return mean.transpose(1, 2).to(x.dtype), doubt.transpose(1, 2).to(x.dtype)
