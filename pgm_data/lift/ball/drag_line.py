"""Motion along a line under drag alone, dv/dt = -C v^2, in closed form.

`length` L is covered in `span` T from a start speed v0, with the drag constant C in 1/m. All is computed in float64,
whatever comes in, and broadcasts.

Source: the promptable game models' drag equation, whose printed form has the wrong dimension; by integration
x(t) = x0 + log1p(C v0 t) / C, and with v0 eliminated s(t) = log1p(expm1(C L) t / T) / C.
"""

import numpy as np
from jaxtyping import Bool, Float

Numbers = Float[np.ndarray, "..."] | float

STEEP = 30.0
"""C L above which exp(C L) stands alone to the last bit and the closed form is taken in logarithms."""
SLIGHT = 1e-8
"""C L or C v0 t below which the second term of the series is the last that counts."""
SERIES_BELOW = 1e-4
"""C v0 T below which log1p(u) / u is its series 1 - u / 2 + u^2 / 3 - u^3 / 4."""
NEWTON_STEPS = 12


def distance_at(time: Numbers, length: Numbers, span: Numbers, drag_per_m: Numbers) -> Float[np.ndarray, "..."]:
    """How far along the line it is at `time` after the start, metres: 0 at 0 and `length` at `span`.

    Without drag `length` time / `span`; with so much that exp(C L) overflows, length + log(time / span) / C.

    Raises:
        ValueError: If a span is not above 0, a length or drag is below 0, or a time lies before the line's singularity
            1 + C v0 t = 0.
    """
    t, L, T, C = _checked(time, length, span, drag_per_m)
    share, steepness = t / T, C * L
    with np.errstate(all="ignore"):
        growth = np.expm1(steepness)
        _after_singularity(np.where(share < 0, growth * share, 0.0), share)
        slight = L * share * (1 + 0.5 * steepness * (1 - share))
        middle = np.log1p(growth * share) / C
        steep = np.logaddexp(0.0, steepness + np.log1p(-np.exp(-steepness)) + np.log(share)) / C
    far = np.where((steepness > STEEP) & (share >= 0), steep, middle)
    return np.asarray(np.where(steepness < SLIGHT, slight, far))


def speed_at(time: Numbers, length: Numbers, span: Numbers, drag_per_m: Numbers) -> Float[np.ndarray, "..."]:
    """The speed at `time` after the start, m/s; infinite where float64 cannot hold it.

    Raises:
        ValueError: As `distance_at`.
    """
    t, L, T, C = _checked(time, length, span, drag_per_m)
    share, steepness = t / T, C * L
    with np.errstate(all="ignore"):
        growth = np.expm1(steepness)
        _after_singularity(np.where(share < 0, growth * share, 0.0), share)
        middle = start_speed(L, T, C) / (1 + growth * share)
        steep = 1 / (C * T * (1 / growth + share))
    return np.asarray(np.where(steepness > STEEP, steep, middle))


def start_speed(length: Numbers, span: Numbers, drag_per_m: Numbers) -> Float[np.ndarray, "..."]:
    """v0 = expm1(C L) / (C T), m/s: the speed at the start; infinite where float64 cannot hold it.

    Raises:
        ValueError: If a span is not above 0, or a length or drag is below 0.
    """
    _, L, T, C = _checked(0.0, length, span, drag_per_m)
    steepness = C * L
    with np.errstate(all="ignore"):
        gain = np.where(steepness < SLIGHT, 1 + 0.5 * steepness, np.expm1(steepness) / steepness)
    return np.asarray(L / T * gain)


def travelled(time: Numbers, speed: Numbers, drag_per_m: Numbers) -> Float[np.ndarray, "..."]:
    """log1p(C v0 t) / C: how far it comes in `time` from a start at `speed`, metres; negative before the start.

    Raises:
        ValueError: If 1 + C v0 t is not above 0, where no such motion was, or the drag is below 0.
    """
    t, v, C = _float64(time, speed, drag_per_m)
    _refuse("drag_per_m", C, C < 0, "0 or more, 1/m")
    with np.errstate(all="ignore"):
        loss = C * (v * t)
        _after_singularity(loss, t)
        return np.asarray(np.where(np.abs(loss) < SLIGHT, v * t * (1 - 0.5 * loss), np.log1p(loss) / C))


def speed_after(time: Numbers, speed: Numbers, drag_per_m: Numbers) -> Float[np.ndarray, "..."]:
    """v0 / (1 + C v0 t), m/s.

    Raises:
        ValueError: As `travelled`.
    """
    t, v, C = _float64(time, speed, drag_per_m)
    _refuse("drag_per_m", C, C < 0, "0 or more, 1/m")
    loss = C * (v * t)
    _after_singularity(loss, t)
    return np.asarray(v / (1 + loss))


def share_of_free(length: Numbers, speed: Numbers, span: Numbers) -> Float[np.ndarray, "..."]:
    """The length over what it would be without drag, q = L / (v0 T); at 1 or more no drag explains it.

    Raises:
        ValueError: If a speed or span is not above 0.
    """
    L, v, T = _float64(length, speed, span)
    _refuse("speed", v, ~(v > 0), "above 0, m/s")
    _refuse("span", T, ~(T > 0), "above 0, s")
    return np.asarray(L / v / T)


def drag_of(length: Numbers, speed: Numbers, span: Numbers) -> Float[np.ndarray, "..."]:
    """C in 1/m at which a ball of that start speed covers `length` in `span`.

    0 where it comes as far as without drag or farther; NaN where it does not come forward.

    Raises:
        ValueError: As `share_of_free`.
    """
    q = share_of_free(length, speed, span)
    return np.asarray(loss_of(q) / (np.asarray(speed, np.float64) * np.asarray(span, np.float64)))


def drag_slopes(
    length: Numbers, speed: Numbers, span: Numbers
) -> tuple[Float[np.ndarray, "..."], Float[np.ndarray, "..."], Float[np.ndarray, "..."]]:
    """Derivatives of `drag_of` by length, speed and span; NaN where it is not above 0.

    Raises:
        ValueError: As `share_of_free`.
    """
    q = share_of_free(length, speed, span)
    L, v, T = _float64(length, speed, span)
    u = loss_of(q)
    u = np.where(u > 0, u, np.nan)
    by_q = 1 / _mean_slope(u)
    by_size = -(by_q * q + u) / (v * T)
    return np.asarray(by_q / (v * T) ** 2), np.asarray(by_size / v), np.asarray(by_size / T)


def loss_of(q: Numbers) -> Float[np.ndarray, "..."]:
    """The u = C v0 T that solves log1p(u) / u = q: 0 for q of 1 or more, NaN for q of 0 or less."""
    (q,) = _float64(q)
    inside = (q > 0) & (q < 1)
    safe = np.where(inside, q, 0.5)
    # Where little is lost, Newton's way from below the root on a falling convex function never passes it.
    e = 1 - safe
    u = 2 * e + 8 / 3 * e**2
    # Where much is, in x = log1p(u): x = log1p(x / q).
    x = np.maximum(-np.log(safe), 0.5)
    with np.errstate(all="ignore"):
        for _ in range(NEWTON_STEPS):
            u = u - (_mean(u) - safe) / _mean_slope(u)
            x = x - (x - np.log1p(x / safe)) / (1 - 1 / (safe + x))
        u = np.where(e < 0.5, u, np.expm1(x))
    return np.asarray(np.where(inside, u, np.where(q >= 1, 0.0, np.nan)))


def _mean(u: Numbers) -> Numbers:
    """log1p(u) / u."""
    with np.errstate(all="ignore"):
        return np.where(u < SERIES_BELOW, 1 - u * (1 / 2 - u * (1 / 3 - u / 4)), np.log1p(u) / u)


def _mean_slope(u: Numbers) -> Numbers:
    with np.errstate(all="ignore"):
        exact = (u / (1 + u) - np.log1p(u)) / u**2
        return np.where(u < SERIES_BELOW, -1 / 2 + u * (2 / 3 - u * 3 / 4), exact)


def _float64(*values: Numbers) -> tuple[np.ndarray, ...]:
    return tuple(np.asarray(value, np.float64) for value in values)


def _checked(time: Numbers, length: Numbers, span: Numbers, drag: Numbers) -> tuple[np.ndarray, ...]:
    t, L, T, C = _float64(time, length, span, drag)
    _refuse("span", T, ~(T > 0), "above 0, s")
    _refuse("length", L, L < 0, "0 or more, m")
    _refuse("drag_per_m", C, C < 0, "0 or more, 1/m")
    return t, L, T, C


def _after_singularity(loss: Numbers, time: Numbers) -> None:
    _refuse("time", np.broadcast_to(time, np.shape(loss)), 1 + loss <= 0, "one at which 1 + C v0 t is above 0")


def _refuse(name: str, values: Numbers, wrong: Bool[np.ndarray, "..."] | np.bool | bool, expected: str) -> None:
    wrong = np.asarray(wrong)
    if wrong.any():
        raise ValueError(
            f"drag line: {name}: expected {expected}, got {np.broadcast_to(values, wrong.shape)[wrong][0]}"
        )
