"""A Gaussian prior of the channels over time, and the best linear guess of clean states that it gives.

Channels are taken for stationary Gaussian processes whose autocorrelation is that of the data: independent ones, but
for velocities, which are tied to the positions whose derivatives they are. From known values and noisy ones this
gives, in closed form, the expected clean state and how far from it the truth is to be expected. The network tells the
rest, in units of that doubt: it need not learn to carry a known value through time, that bodies move smoothly, or that
a ball goes on as fast as it flies, and its errors shrink with the doubt. This is the preconditioning of Karras et al.
2022 (equation 7, c_skip and c_out) with a process in place of one variance.

A process is a sum of kernels: Matern 3/2, k = (1 + r) exp(-r) with r = sqrt(3) |t| / s, which has a derivative of
covariance -k'' = 3 / s^2 (1 - r) exp(-r); rough ones, exp(-|t| / s); and what does not last a frame.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn

from pgm_data.geometry.arrays import frozen
from pgm_models.animation.layout import Layout
from pgm_models.animation.noise import alpha_sigma
from pgm_models.animation.windows import Windows

SCALES_S = (0.03, 0.06, 0.12, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 32.0)
"""Length scales s of the kernels, seconds."""
KNOWN_VARIANCE = 1e-6
"""Of what is known, standardised: it keeps matrices well conditioned."""
LEAST_DOUBT = 0.25
"""Standardised; what the network's unit is at least where nothing is seen of a value, so that no rare jump outweighs
all else."""
LEAST_OF_NOISE = 0.5
"""What it is at least, as a share of the noise, where a value is seen through some: it cannot be far from there."""
LEAST_SHARE = 1e-3
"""Of all kernels together: a channel that does not vary in the windows seen may vary in others."""
FITTED_NOISE = (1e-4, 1e-2, 1.0)
"""Variances of noise through which windows are seen when the prior is fitted: little counts what is fast, much what
is slow."""
FIRST_SHARE, FIT_RATE, FIT_STEPS = 0.05, 0.1, 200
"""Of each kernel at first; and step size and number of the descent."""
_ARRAYS = ("smooth", "rough", "white", "ratio")


@dataclass(frozen=True, eq=False, kw_only=True)
class TemporalPrior:
    """Shares of the kernels in each channel, and which channels are derivatives.

    Raises:
        ValueError: If a share is below 0.
    """

    smooth: Float[np.ndarray, "channels scales"]
    """Of Matern 3/2 for each of `SCALES_S`; of a velocity, beside what its position brings."""
    rough: Float[np.ndarray, "channels scales"]
    white: Float[np.ndarray, " channels"]
    position: Int[np.ndarray, " pairs"]
    """Channels whose derivative is a channel too."""
    velocity: Int[np.ndarray, " pairs"]
    """That derivative."""
    ratio: Float[np.ndarray, " pairs"]
    """Standard deviation of the position over that of the velocity, seconds: undoes their standardising."""

    def __post_init__(self) -> None:
        """Keep read-only copies, and check that all shares are variances."""
        for name in _ARRAYS:
            object.__setattr__(self, name, frozen(getattr(self, name)))
            if not (getattr(self, name) >= 0).all():
                raise ValueError(f"prior.{name}: expected shares of 0 or more, got others")
        for name in ("position", "velocity"):
            object.__setattr__(self, name, frozen(getattr(self, name), np.int64))


def prior_to_json(prior: TemporalPrior) -> dict[str, object]:
    """The prior as JSON values."""
    return {name: getattr(prior, name).tolist() for name in prior.__dataclass_fields__}


def prior_from_json(raw: Mapping) -> TemporalPrior:
    """The prior that `prior_to_json` wrote."""
    floats = {name: np.asarray(raw[name], dtype=np.float64) for name in _ARRAYS}
    return TemporalPrior(
        **floats,
        position=np.asarray(raw["position"], dtype=np.int64),
        velocity=np.asarray(raw["velocity"], dtype=np.int64),
    )


def derivatives(
    layout: Layout,
) -> tuple[Int[np.ndarray, " pairs"], Int[np.ndarray, " pairs"], Float[np.ndarray, " pairs"]]:
    """Channels of positions, those of their velocities, and the ratios of their scales."""
    columns = [entry.column for entry in layout.properties]
    position, velocity, ratio = [], [], []
    for row, entry in enumerate(layout.properties):
        whose = entry.column.removesuffix(".velocity")
        if whose == entry.column or f"{whose}.position" not in columns:
            continue
        other = columns.index(f"{whose}.position")
        of = layout.properties[other]
        _, mine, theirs = np.intersect1d(entry.channels, of.channels, return_indices=True)
        velocity += (mine + layout.slice_of(row).start).tolist()
        position += (theirs + layout.slice_of(other).start).tolist()
        ratio += (of.std[theirs] / entry.std[mine]).tolist()
    return np.array(position, dtype=np.int64), np.array(velocity, dtype=np.int64), np.array(ratio, dtype=np.float64)


def fit_prior(batches: Iterable[Windows], layout: Layout) -> TemporalPrior:
    """The prior under which the windows are likeliest, seen through each of `FITTED_NOISE`.

    Args:
        batches: Windows of several rates, so that short and long lags are seen.
        layout: What their channels are.

    Raises:
        ValueError: If there are none.
    """
    position, velocity, ratio = derivatives(layout)
    there = torch.as_tensor(layout.property_of_channel.copy())
    scales, count = len(SCALES_S), 2 * len(SCALES_S) + 1
    alone, together = [], []
    for windows in batches:
        present = windows.valid[..., there]
        state = (windows.state.double() * present).transpose(1, 2)
        present = present.transpose(1, 2)
        for rate in torch.unique(windows.rate).tolist():
            rows = windows.rate == rate
            times = torch.arange(state.shape[2], dtype=torch.float64) / rate
            lag = times[:, None] - times
            alone.append(_seen(state[rows], present[rows], _kernels(lag)))
            both = [torch.cat([part[rows][:, position], part[rows][:, velocity]], dim=2) for part in (state, present)]
            together.append(_seen(both[0], both[1], _pair_kernels(lag, torch.as_tensor(ratio))))
    if not alone:
        raise ValueError("prior: expected windows to fit it to, got none")
    shares = _likeliest(alone, count)
    if len(position):
        found = _likeliest(together, 2 * count)
        shares[position], shares[velocity] = found[:, :count], found[:, count:]
    shares[:, -1] += np.maximum(0.0, LEAST_SHARE - shares.sum(axis=1))
    return TemporalPrior(
        smooth=shares[:, :scales],
        rough=shares[:, scales:-1],
        white=shares[:, -1],
        position=position,
        velocity=velocity,
        ratio=ratio,
    )


@dataclass(frozen=True, eq=False)
class _Seen:
    """What windows of one rate say of processes."""

    moments: Float[Tensor, "processes S S"]
    """Mean products of their values."""
    windows: Float[Tensor, " processes"]
    """Of which they are."""
    kernels: Float[Tensor, "*processes S S kernels"]


def _likeliest(seen: list[_Seen], kernels: int) -> Float[np.ndarray, "processes kernels"]:
    """Shares of the kernels under which what was seen is likeliest, by descent in their logarithms."""
    logarithm = torch.full((len(seen[0].moments), kernels), math.log(FIRST_SHARE), dtype=torch.float64)
    descent = torch.optim.Adam([logarithm], lr=FIT_RATE)
    for _ in range(FIT_STEPS):
        shares, slope = logarithm.exp(), torch.zeros_like(logarithm)
        for part in seen:
            size = part.moments.shape[-1]
            flat = part.kernels.reshape(-1, size * size, kernels)
            clean = (flat @ shares[..., None])[..., 0].unflatten(1, (size, size))
            own = torch.eye(size, dtype=torch.float64)
            for noise in FITTED_NOISE:
                precision = torch.linalg.inv(clean + noise * own)
                excess = precision - precision @ (part.moments + noise * own) @ precision
                slope += part.windows[:, None] * (excess.flatten(1)[:, None] @ flat)[:, 0]
        logarithm.grad = shares * slope
        descent.step()
    unseen = torch.stack([part.windows for part in seen]).sum(dim=0) == 0
    return torch.where(unseen[:, None], 0.0, logarithm.exp()).numpy()


def _seen(values: Float[Tensor, "N processes S"], present: Bool[Tensor, "N processes S"], kernels: Tensor) -> _Seen:
    """Of those windows in which all of a process is there: parts that are left out would pass for what is fast."""
    whole = present.all(dim=2).double()
    windows = whole.sum(dim=0)
    total = torch.einsum("nc,ncs,nct->cst", whole, values, values)
    return _Seen(moments=total / windows.clamp(min=1.0)[:, None, None], windows=windows, kernels=kernels)


def _kernels(lag: Float[Tensor, "T T"]) -> Float[Tensor, "T T kernels"]:
    scales = torch.tensor(SCALES_S, dtype=torch.float64)
    away = lag.abs()[..., None] / scales
    reach = math.sqrt(3) * away
    white = torch.eye(len(lag), dtype=torch.float64)[..., None]
    return torch.cat([(1 + reach) * torch.exp(-reach), torch.exp(-away), white], dim=-1)


def _pair_kernels(lag: Float[Tensor, "T T"], ratio: Float[Tensor, " pairs"]) -> Float[Tensor, "pairs 2*T 2*T kernels"]:
    """Of positions with velocities: first what a kernel of the position brings to both, then the velocity's own."""
    scales = torch.tensor(SCALES_S, dtype=torch.float64)
    own = _kernels(lag)
    count, smooth = own.shape[-1], len(scales)
    reach = math.sqrt(3) * lag.abs()[..., None] / scales
    steep = 3 / scales**2 * torch.exp(-reach)
    across, derived = lag[..., None] * steep, (1 - reach) * steep
    per = ratio[:, None, None, None]
    first, second = slice(0, len(lag)), slice(len(lag), None)
    kernels = torch.zeros(len(ratio), 2 * len(lag), 2 * len(lag), 2 * count, dtype=torch.float64)
    kernels[:, first, first, :count] = own
    kernels[:, first, second, :smooth] = per * across
    kernels[:, second, first, :smooth] = per * across.transpose(0, 1)
    kernels[:, second, second, :smooth] = per**2 * derived
    kernels[:, second, second, count:] = own
    return kernels


class Preconditioner(nn.Module):
    """The prior on a device; in double precision, whatever the model's."""

    def __init__(self, prior: TemporalPrior) -> None:
        super().__init__()
        self.paired = len(prior.position) > 0
        single = np.setdiff1d(np.arange(len(prior.white)), np.concatenate([prior.position, prior.velocity]))
        # Channels in the order: those alone, positions, velocities; and back.
        order = np.concatenate([single, prior.position, prior.velocity])
        self.singles = len(single)
        values = {
            **{name: getattr(prior, name) for name in _ARRAYS},
            "scales": np.asarray(SCALES_S),
            "order": order,
            "back": np.argsort(order),
        }
        self.kept = tuple(values)
        self.smooth: Tensor
        self.rough: Tensor
        self.white: Tensor
        self.ratio: Tensor
        self.scales: Tensor
        self.order: Tensor
        self.back: Tensor
        for name, value in values.items():
            self.register_buffer(name, torch.as_tensor(np.array(value)), persistent=False)

    def _apply(self, fn, recurse: bool = True):
        kept = {name: getattr(self, name) for name in self.kept}
        super()._apply(fn, recurse)
        for name, value in kept.items():
            setattr(self, name, value.to(getattr(self, name).device))
        return self

    def covariance(
        self, frames: int, rate: Float[Tensor, " B"]
    ) -> tuple[Float[Tensor, "B singles T T"], Float[Tensor, "B pairs 2*T 2*T"]]:
        """Of the channels alone, and of positions with their velocities (first all frames of the position)."""
        times = torch.arange(frames, device=rate.device, dtype=torch.float64)
        lag = (times[:, None] - times)[None] / rate.double()[:, None, None]
        reach = math.sqrt(3) * lag.abs()[..., None] / self.scales
        fall = torch.exp(-reach)
        smooth, rough = self.smooth[self.order].T, self.rough[self.order].T
        own = ((1 + reach) * fall) @ smooth + torch.exp(-lag.abs()[..., None] / self.scales) @ rough
        own = own.permute(0, 3, 1, 2)
        own = own + self.white[self.order][:, None, None] * torch.eye(frames, dtype=own.dtype, device=own.device)
        pairs = (own.shape[1] - self.singles) // 2
        alone, position, velocity = own.split((self.singles, pairs, pairs), dim=1)
        of = smooth[:, self.singles : self.singles + pairs]
        derived = ((1 - reach) * fall) @ (3 / self.scales[:, None] ** 2 * of * self.ratio**2)
        across = (lag[..., None] * fall) @ (3 / self.scales[:, None] ** 2 * of * self.ratio)
        velocity = velocity + derived.permute(0, 3, 1, 2)
        across = across.permute(0, 3, 1, 2)
        upper = torch.cat([position, across], dim=-1)
        lower = torch.cat([across.transpose(-1, -2), velocity], dim=-1)
        return alone, torch.cat([upper, lower], dim=-2)

    def forward(
        self,
        x: Float[Tensor, "B T C"],
        given: Bool[Tensor, "B T C"],
        valid: Bool[Tensor, "B T C"],
        rate: Float[Tensor, " B"],
        log_snr: Float[Tensor, " B"],
    ) -> tuple[Float[Tensor, "B T C"], Float[Tensor, "B T C"]]:
        """Expected clean states and the standard deviation of the truth from them, given known values and noisy ones.

        Args:
            x: Known values where given, alpha x0 + sigma noise elsewhere.
            given: What is known.
            valid: Elsewhere x says nothing.
            rate: Frames a second.
            log_snr: Of the noise.
        """
        alpha, sigma = (share.double()[:, None, None] for share in alpha_sigma(log_snr))
        gain = torch.where(given, 1.0, torch.where(valid, alpha, 0.0))
        noise = torch.where(given, KNOWN_VARIANCE, torch.where(valid, sigma.square(), 1.0)).clamp(min=KNOWN_VARIANCE)
        values, gain, noise = (part.transpose(1, 2)[:, self.order] for part in (x.double(), gain, noise))
        alone, together = self.covariance(x.shape[1], rate)
        mean, variance = _posterior(alone, *(part[:, : self.singles] for part in (values, gain, noise)))
        if self.paired:
            # Of each pair the frames of the position, then those of the velocity.
            joint = [
                part[:, self.singles :].unflatten(1, (2, -1)).transpose(1, 2).flatten(2)
                for part in (values, gain, noise)
            ]
            both = [part.unflatten(2, (2, -1)).transpose(1, 2).flatten(1, 2) for part in _posterior(together, *joint)]
            mean, variance = torch.cat([mean, both[0]], dim=1), torch.cat([variance, both[1]], dim=1)
        least = 1 / (LEAST_DOUBT**-2 + LEAST_OF_NOISE**-2 * gain.square() / noise)
        doubt = (variance.clamp(min=0) + least).sqrt()
        mean, doubt = mean[:, self.back].transpose(1, 2), doubt[:, self.back].transpose(1, 2)
        return mean.to(x.dtype), doubt.to(x.dtype)


def _posterior(
    covariance: Float[Tensor, "B G S S"],
    values: Float[Tensor, "B G S"],
    gain: Float[Tensor, "B G S"],
    noise: Float[Tensor, "B G S"],
) -> tuple[Float[Tensor, "B G S"], Float[Tensor, "B G S"]]:
    """Mean and variance of processes of which `gain` times themselves, with that variance of noise, was seen."""
    seen = gain[..., None] * covariance
    total = seen * gain[..., None, :] + torch.diag_embed(noise)
    factor = torch.linalg.cholesky(total)
    half = torch.linalg.solve_triangular(factor, seen, upper=False)
    told = torch.linalg.solve_triangular(factor, values[..., None], upper=False)
    mean = (half.transpose(-1, -2) @ told)[..., 0]
    return mean, covariance.diagonal(dim1=-2, dim2=-1) - half.square().sum(-2)
