"""The drag constant from serve speeds that a radar gave, pooled over serves with the scene's prior.

One serve tells little: 1 % of its speed is 5 % of the drag, 10 cm of its length 3 %, half a frame of its time 24 %. So
none has a constant of its own; what counts is by how much all of them miss their landing points.

Source: promptable game models, appendix on 3D ball localization (the drag equation inverted); the pooling is ours.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from pgm_data.geometry.arrays import frozen
from pgm_data.lift.ball.drag_line import drag_of, drag_slopes, share_of_free, travelled
from pgm_data.scene import Prior

HUBER = 1.5
"""Standard deviations beyond which a serve pulls no harder."""
GATE = 3.0
"""Standard deviations within which a serve must come to agree with some drag between 0 and `MOST_DRAG` times the
prior's mean."""
MOST_DRAG = 3.0
LEAST_SPEED = 20.0
"""m/s: slower ones are no serves."""
STEPS = 60


@dataclass(frozen=True, eq=False, kw_only=True)
class Serves:
    """Measured serves, from the hit to the first bounce. Standard deviations are above 0.

    Raises:
        ValueError: If lengths of arrays differ or a standard deviation is below 0.
    """

    length_m: Float[np.ndarray, " serves"]
    """Along the ground."""
    length_std_m: Float[np.ndarray, " serves"]
    time_s: Float[np.ndarray, " serves"]
    """From the hit to the bounce."""
    time_std_s: Float[np.ndarray, " serves"]
    speed: Float[np.ndarray, " serves"]
    """By radar, just after the hit, m/s."""
    speed_std: Float[np.ndarray, " serves"]
    share: Float[np.ndarray, " serves"]
    """Speed along the ground over speed, just after the hit."""
    share_std: Float[np.ndarray, " serves"]

    def __post_init__(self) -> None:
        """Keep read-only copies and check them."""
        rows = len(self.length_m)
        for name in self.__dataclass_fields__:
            values = frozen(getattr(self, name))
            object.__setattr__(self, name, values)
            if values.shape != (rows,):
                raise ValueError(f"serves: {name}: expected {rows} values, got {values.shape}")
            if name.endswith(("_std", "_std_m", "_std_s")) and (values < 0).any():
                raise ValueError(f"serves: {name}: expected 0 or more, got {values.min()}")


@dataclass(frozen=True, eq=False, kw_only=True)
class ServeDrag:
    """The drag constant as serves and prior have it."""

    posterior: Prior
    """1/m."""
    used: Bool[np.ndarray, " serves"]
    drag_per_m: Float[np.ndarray, " serves"]
    """What each serve alone would say, 1/m; 0 where it came as far as without drag, NaN where it is no serve."""
    drag_std_per_m: Float[np.ndarray, " serves"]
    """NaN where there is no such drag."""
    said: tuple[str, ...]
    """Why a serve was left out; empty where it was used."""

    @property
    def count(self) -> int:
        """Number of serves used."""
        return int(self.used.sum())


def drag_from_serves(serves: Serves, prior: Prior) -> ServeDrag:
    """The drag constant that all serves and the prior agree on best, with its standard deviation.

    Each serve misses its landing point by L - log1p(C v0 T) / C, weighed by what the errors of length, time, speed and
    share make of it; misses beyond `HUBER` standard deviations pull no harder. Where serves scatter more than they say,
    the standard deviation is widened, the prior's never surpassed.

    Raises:
        ValueError: If the prior's mean or standard deviation is not above 0.
    """
    if not (prior.mean > 0 and prior.std > 0):
        raise ValueError(f"drag_from_serves.prior: expected a mean and std above 0, got {prior.mean} +- {prior.std}")
    said = [_no_serve(*row) for row in zip(serves.length_m, serves.time_s, serves.speed, serves.share, strict=True)]
    sound = np.array([not why for why in said], dtype=bool)
    L, T, v, v_std = _sound(serves, sound)
    alone, alone_std = np.full(len(said), np.nan), np.full(len(said), np.nan)
    if sound.any():
        alone[sound] = drag_of(L, v, T)
        by_length, by_speed, by_time = drag_slopes(L, v, T)
        time_std, length_std = serves.time_std_s[sound], serves.length_std_m[sound]
        alone_std[sound] = np.sqrt((by_length * length_std) ** 2 + (by_speed * v_std) ** 2 + (by_time * time_std) ** 2)
    used = sound.copy()
    for row, (low, high) in zip(np.flatnonzero(sound), _gates(serves, sound, prior), strict=True):
        if low > GATE or high < -GATE:
            used[row] = False
            q = float(share_of_free(serves.length_m[row], serves.speed[row] * serves.share[row], serves.time_s[row]))
            much = "not slowed down" if low > GATE else f"slowed down by more than {MOST_DRAG:.0f} times the usual drag"
            said[row] = f"{much}: it came {q:.2f} of what it would without drag"
    mean, std = _pooled(serves, used, prior)
    return ServeDrag(
        posterior=Prior(mean=mean, std=std), used=used, drag_per_m=alone, drag_std_per_m=alone_std, said=tuple(said)
    )


def _no_serve(length: float, time: float, speed: float, share: float) -> str:
    """Why a row is no serve; empty where it is one."""
    if not np.isfinite([length, time, speed, share]).all():
        return "a value is missing"
    if not (length > 0 and time > 0 and 0 < share <= 1):
        return f"no serve: {length:.2f} m along the ground in {time:.2f} s, share {share:.2f}"
    return "" if speed >= LEAST_SPEED else f"too slow for a serve: {speed:.1f} m/s"


def _sound(serves: Serves, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Length, time, speed along the ground and its standard deviation."""
    speed, share = serves.speed[rows], serves.share[rows]
    std = np.hypot(serves.speed_std[rows] * share, serves.share_std[rows] * speed)
    return serves.length_m[rows], serves.time_s[rows], speed * share, std


def _misses(serves: Serves, rows: np.ndarray, drag: float) -> tuple[np.ndarray, np.ndarray]:
    """By how many standard deviations serves land beyond where that drag has them, and the slope by the drag."""
    L, T, v, v_std = _sound(serves, rows)
    expected = travelled(T, v, drag)
    # Derivatives of log1p(C v T) / C: 1 / (1 + C v T) by v T.
    left = 1 / (1 + drag * v * T)
    std = np.sqrt(serves.length_std_m[rows] ** 2 + (left * T * v_std) ** 2 + (left * v * serves.time_std_s[rows]) ** 2)
    std = np.maximum(std, 1e-6)
    loss = drag * v * T
    with np.errstate(all="ignore"):
        exact = (loss * left - np.log1p(loss)) / drag**2
    by_drag = np.where(loss < 1e-3, -0.5 * (v * T) ** 2 * (1 - 4 / 3 * loss), exact)
    return (L - expected) / std, -by_drag / std


def _gates(serves: Serves, rows: np.ndarray, prior: Prior) -> list[tuple[float, float]]:
    """Misses without drag and with the most."""
    low, high = (_misses(serves, rows, drag)[0] for drag in (0.0, MOST_DRAG * prior.mean))
    return list(zip(low.tolist(), high.tolist(), strict=True))


def _pooled(serves: Serves, used: np.ndarray, prior: Prior) -> tuple[float, float]:
    drag = prior.mean
    information, scatter = 0.0, 1.0
    for _ in range(STEPS if used.any() else 0):
        miss, slope = _misses(serves, used, drag)
        weight = np.minimum(1.0, HUBER / np.maximum(np.abs(miss), 1e-12))
        scatter = max(1.0, float((weight * miss**2).sum() / max(used.sum() - 1, 1)))
        information = float((weight * slope**2).sum()) / scatter
        pull = float((weight * slope * miss).sum()) / scatter + (drag - prior.mean) / prior.std**2
        step = -pull / (information + 1 / prior.std**2)
        drag = max(drag + step, 0.05 * prior.mean)
        if abs(step) < 1e-9 * prior.mean:
            break
    return float(drag), float(1 / np.sqrt(information + 1 / prior.std**2))
