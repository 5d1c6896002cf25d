"""Values at key times and the smooth course between them."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True, eq=False, kw_only=True)
class Course:
    """Cubic pieces through keys, with continuous rates; constant before the first key and after the last.

    Raises:
        ValueError: If key times do not rise.
    """

    times: Float[np.ndarray, " keys"]
    """Seconds, rising."""
    values: Float[np.ndarray, "keys channels"]
    rates: Float[np.ndarray, "keys channels"]
    """Per second."""

    def __post_init__(self) -> None:
        """Check the times."""
        if len(self.times) < 1 or not (np.diff(self.times) > 0).all():
            raise ValueError(f"Course.times: expected one or more, rising, got {self.times}")

    def at(self, times: Float[np.ndarray, " times"]) -> Float[np.ndarray, "times channels"]:
        """The values at any times."""
        if len(self.times) == 1:
            return np.repeat(self.values, len(times), axis=0)
        t = np.clip(times, self.times[0], self.times[-1])
        i = np.clip(np.searchsorted(self.times, t, side="right") - 1, 0, len(self.times) - 2)
        h = self.times[i + 1] - self.times[i]
        u = (t - self.times[i]) / h
        v = 1.0 - u
        a, b = (1.0 + 2.0 * u) * v * v, u * u * (3.0 - 2.0 * u)
        c, d = u * v * v * h, -u * u * v * h
        value, rate = self.values, self.rates
        return a[:, None] * value[i] + b[:, None] * value[i + 1] + c[:, None] * rate[i] + d[:, None] * rate[i + 1]


def calm_rates(
    times: Float[np.ndarray, " keys"], values: Float[np.ndarray, "keys channels"]
) -> Float[np.ndarray, "keys channels"]:
    """Rates at keys with which no channel leaves the range of its neighbouring keys; 0 at turning points and ends.

    Source: Fritsch and Butland, SIAM J. Sci. Stat. Comput. 5 (1984), the weighted harmonic mean.
    """
    rates = np.zeros_like(values)
    if len(times) > 2:
        h = np.diff(times)[:, None]
        slope = np.diff(values, axis=0) / h
        before, after = slope[:-1], slope[1:]
        w1, w2 = 2.0 * h[1:] + h[:-1], h[1:] + 2.0 * h[:-1]
        same = before * after > 0
        mean = (w1 + w2) / (w1 / np.where(same, before, 1.0) + w2 / np.where(same, after, 1.0))
        rates[1:-1] = np.where(same, mean, 0.0)
    return rates


def rise(share: Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
    """0 to 1 while share goes from 0 to 1, with smooth ends and constant beyond."""
    u = np.clip(share, 0.0, 1.0)
    return u * u * (3.0 - 2.0 * u)
