"""How much noise there is: schedules, what the network tells, weights and the masked loss of diffusion.

Noise is measured by log_snr = ln(alpha^2 / sigma^2) alone: x = alpha x0 + sigma eps, variance preserving. Clean is
log_snr = +inf, where alpha is 1 and sigma 0 exactly.
"""

import math
from dataclasses import dataclass
from typing import Literal, get_args

import torch
from jaxtyping import Bool, Float, Int
from torch import Generator, Tensor
from torch.nn import functional as F

Prediction = Literal["eps", "x0", "v"]
"""What the network tells: the noise, the clean state, or v = alpha eps - sigma x0."""
Schedule = Literal["cosine", "linear"]
Weight = Literal["none", "min_snr"]
Spacing = Literal["lambda", "time"]
"""Of a sampler's steps: even in log_snr; or even in the schedule's own time."""

LOG_SNR_LIMIT = 10.0
"""The cosine schedule runs from this log_snr down to its negative."""
FIRST_BETA, LAST_BETA = 1e-4, 0.02
"""Of the linear schedule at 1000 steps."""
_FIRST_ANGLE = math.atan(math.exp(-LOG_SNR_LIMIT / 2))


@dataclass(frozen=True, kw_only=True)
class DiffusionOptions:
    """What is predicted, over which noise, and how its errors weigh.

    Raises:
        ValueError: If a name is unknown, or a number outside its range.
    """

    prediction: Prediction = "v"
    """What the network tells."""
    schedule: Schedule = "cosine"
    """How noise is spread over time: the cosine schedule in continuous time, or DDPM's linear betas."""
    weight: Weight = "min_snr"
    """Of a window's squared errors by its noise: all alike, or the signal-to-noise ratio cut at `min_snr`."""
    min_snr: float = 5.0
    """Signal-to-noise ratio above which the weight of the clean state's error no longer grows."""
    steps: int = 1000
    """Steps of the linear schedule; its betas are those of 1000 steps times 1000 / steps."""
    shift: float = 0.0
    """Added to the log_snr that the cosine schedule trains on; below 0 for more noise."""

    def __post_init__(self) -> None:
        """Check names and numbers."""
        for name, kinds in (("prediction", Prediction), ("schedule", Schedule), ("weight", Weight)):
            if (value := getattr(self, name)) not in get_args(kinds):
                raise ValueError(f"{name}: expected one of {', '.join(get_args(kinds))}, got {value!r}")
        if not (math.isfinite(self.min_snr) and self.min_snr > 0):
            raise ValueError(f"min_snr: expected a finite number above 0, got {self.min_snr}")
        if 1000 * LAST_BETA >= self.steps:
            raise ValueError(f"steps: expected more than {1000 * LAST_BETA:.0f}, got {self.steps}")
        if not math.isfinite(self.shift) or (self.shift and self.schedule != "cosine"):
            raise ValueError(f"shift: expected a finite number, 0 but for the cosine schedule, got {self.shift}")


def alpha_sigma(log_snr: Float[Tensor, "*batch"]) -> tuple[Float[Tensor, "*batch"], Float[Tensor, "*batch"]]:
    """Shares of signal and of noise, alpha^2 + sigma^2 = 1; each precise also where it is tiny, 0 or 1.

    In the type of `log_snr`, float32 at least.
    """
    log_snr = log_snr.to(_wide(log_snr.dtype))
    return log_snr.sigmoid().sqrt(), (-log_snr).sigmoid().sqrt()


def cosine_log_snr(u: Float[Tensor, "*batch"]) -> Float[Tensor, "*batch"]:
    """log_snr at times `u` of 0 (hardly any noise) to 1: alpha = cos(angle), sigma = sin(angle), angle even in `u`.

    The angle's ends are where log_snr is +-LOG_SNR_LIMIT.

    Source: Nichol and Dhariwal 2021, in continuous time as by Kingma and Gao 2023 (shift 0).
    """
    angle = _FIRST_ANGLE + u.double() * (math.pi / 2 - 2 * _FIRST_ANGLE)
    return (-2 * angle.tan().log()).to(u.dtype)


def cosine_time(log_snr: Float[Tensor, "*batch"]) -> Float[Tensor, "*batch"]:
    """Times `u` of 0 to 1 of the cosine schedule: the inverse of `cosine_log_snr`; 0 or 1 beyond its ends."""
    angle = (-log_snr.double() / 2).exp().atan()
    return ((angle - _FIRST_ANGLE) / (math.pi / 2 - 2 * _FIRST_ANGLE)).clamp(0, 1).to(log_snr.dtype)


def linear_log_snr(k: Int[Tensor, "*batch"], steps: int) -> Float[Tensor, "*batch"]:
    """log_snr at steps `k` of 1 (hardly any noise) to `steps` of DDPM's linear schedule; float64.

    Source: Ho et al. 2020 for 1000 steps; betas of another number of steps are scaled as by Nichol and Dhariwal 2021.
    """
    scale = 1000 / steps
    betas = torch.linspace(FIRST_BETA * scale, LAST_BETA * scale, steps, dtype=torch.float64, device=k.device)
    log_signal = torch.log1p(-betas).cumsum(0)
    return (log_signal - torch.log(-torch.expm1(log_signal)))[k - 1]


def draw_log_snr(options: DiffusionOptions, count: int, generator: Generator) -> Float[Tensor, " count"]:
    """Amounts of noise to train on, one a window: even in the schedule's time, then shifted; on the generator's device.

    A window's frames are much alike, so together they show through noise that would hide each alone: what only words
    could tell is settled at more noise than the schedule, made for single pictures, dwells on. Source: Hoogeboom et al.
    2023, Simple diffusion, section 2.1.
    """
    if options.schedule == "cosine":
        drawn = cosine_log_snr(torch.rand(count, generator=generator, device=generator.device))
        return (drawn + options.shift).clamp(-LOG_SNR_LIMIT, LOG_SNR_LIMIT)
    k = torch.randint(1, options.steps + 1, (count,), generator=generator, device=generator.device)
    return linear_log_snr(k, options.steps).float()


def sampling_grid(options: DiffusionOptions, steps: int, *, spacing: Spacing = "lambda") -> Float[Tensor, " nodes"]:
    """log_snr of a sampler's nodes, one more than steps: from the schedule's noisiest to clean (+inf); float64, CPU.

    Nodes before the last are even in log_snr (for the solvers) or in time (for DDPM and DDIM: of the linear schedule
    every so many steps, counted from the noisiest), as if the last were the schedule's cleanest.

    Raises:
        ValueError: If there is no step, or more steps than the linear schedule has in time.
    """
    most = options.steps if (options.schedule, spacing) == ("linear", "time") else None
    if steps < 1 or (most is not None and steps > most):
        raise ValueError(f"steps: expected 1 to {most or 'any number'}, got {steps}")
    time = torch.arange(steps, 0, -1, dtype=torch.float64) / steps
    if options.schedule == "cosine":
        low, high = -LOG_SNR_LIMIT, LOG_SNR_LIMIT
        in_time = cosine_log_snr(time)
    else:
        in_time = linear_log_snr((time * options.steps).round().long(), options.steps)
        low, high = linear_log_snr(torch.tensor([options.steps, 1]), options.steps).tolist()
    nodes = in_time if spacing == "time" else high + time * (low - high)
    return torch.cat([nodes, torch.tensor([math.inf], dtype=torch.float64)])


def noisy(
    x0: Float[Tensor, "B *rest"], eps: Float[Tensor, "B *rest"], log_snr: Float[Tensor, "*batch"]
) -> Float[Tensor, "B *rest"]:
    """Clean states with that noise at that log_snr, one a window or one for all: alpha x0 + sigma eps."""
    alpha, sigma = _shares(log_snr, x0)
    return (alpha * x0 + sigma * eps).to(x0.dtype)


def target_of(
    prediction: Prediction,
    x0: Float[Tensor, "B *rest"],
    eps: Float[Tensor, "B *rest"],
    log_snr: Float[Tensor, "*batch"],
) -> Float[Tensor, "B *rest"]:
    """What the network is to tell of clean states with that noise; log_snr is one a window, or one for all.

    Source: v of Salimans and Ho 2022.
    """
    if prediction == "eps":
        return eps
    if prediction == "x0":
        return x0
    alpha, sigma = _shares(log_snr, x0)
    return (alpha * eps - sigma * x0).to(x0.dtype)


def to_x0(
    prediction: Prediction,
    output: Float[Tensor, "B *rest"],
    x: Float[Tensor, "B *rest"],
    log_snr: Float[Tensor, "*batch"],
) -> Float[Tensor, "B *rest"]:
    """Clean states that the network's output stands for; float32 at least, since at tiny alpha they may be huge.

    Of `eps` the error grows as 1 / alpha; of `x0` and `v` it never grows. log_snr, one a window or one for all, may
    be +inf; of `eps` not -inf, where `x` says nothing.
    """
    if prediction == "x0":
        return output.to(_wide(x.dtype))
    alpha, sigma = _shares(log_snr, x)
    if prediction == "eps":
        return (x - sigma * output) / alpha
    return alpha * x - sigma * output


def loss_weight(options: DiffusionOptions, log_snr: Float[Tensor, " B"]) -> Float[Tensor, " B"]:
    """Weight of a window's squared errors of what is predicted; worked in logarithms, so finite at any noise.

    With S the signal-to-noise ratio and m = min(S, min_snr): x0 m, eps m / S, v m / (S + 1); all one weight of the
    clean state's error. 1 where the option `weight` is `none`.

    Source: Hang et al. 2023, min-SNR.
    """
    if options.weight == "none":
        return torch.ones_like(log_snr)
    cut = math.log(options.min_snr)
    if options.prediction == "eps":
        return (cut - log_snr).clamp(max=0).exp()
    log_weight = log_snr.clamp(max=cut)
    return (log_weight + F.logsigmoid(-log_snr) if options.prediction == "v" else log_weight).exp()


def masked_loss(
    prediction: Float[Tensor, "B T C"],
    target: Float[Tensor, "B T C"],
    unknown: Bool[Tensor, "B T P"],
    weight: Float[Tensor, " B"],
    property_of_channel: Int[Tensor, " C"],
    *,
    balanced: bool,
) -> tuple[Float[Tensor, ""], Float[Tensor, " P"]]:
    """Mean weighted squared error of the unknown entries, and that of each property.

    An entry is one channel of one frame. Balanced, each property with an unknown entry in the batch counts the same;
    else each unknown entry does. A property without one has loss 0; a batch without one has loss 0 with gradient 0.
    What stands at known entries has no effect, NaN included. float32 at least; nothing waits for the device.
    """
    wide = _wide(prediction.dtype)
    asked = unknown[..., property_of_channel]
    error = torch.where(asked, prediction.to(wide) - target.to(wide), 0)
    of_channel = (weight.to(wide)[:, None, None] * error.square()).sum((0, 1))
    belongs = property_of_channel == torch.arange(unknown.shape[-1], device=unknown.device)[:, None]
    total = torch.where(belongs, of_channel, 0).sum(1)
    count = torch.where(belongs, asked.sum((0, 1)), 0).sum(1)
    per_property = total / count.clamp(min=1)
    if balanced:
        return per_property.sum() / (count > 0).sum().clamp(min=1), per_property
    return total.sum() / count.sum().clamp(min=1), per_property


def _wide(dtype: torch.dtype) -> torch.dtype:
    """The type, or float32 where it is narrower."""
    return torch.promote_types(dtype, torch.float32)


def _shares(log_snr: Tensor, x: Tensor) -> tuple[Tensor, Tensor]:
    """Alpha and sigma on the device of `x`, float32 at least, shaped so that they multiply its windows."""
    shape = (*log_snr.shape, *(1 for _ in range(x.ndim - 1))) if log_snr.ndim else ()
    alpha, sigma = alpha_sigma(log_snr)
    wide = _wide(x.dtype)
    return alpha.to(x.device, wide).reshape(shape), sigma.to(x.device, wide).reshape(shape)
