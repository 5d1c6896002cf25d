"""Which feet stand on the ground: two states a foot, planted and free, in time."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True, eq=False, kw_only=True)
class ContactLaw:
    """How planted and free feet differ."""

    planted_height_m: float = 0.012
    """Standard deviation of the lowest point of a planted sole."""
    free_height_m: float = 0.15
    planted_speed: float = 0.25
    """Standard deviation of each component of the velocity of that point, m/s."""
    free_speed: float = 1.5
    stays_s: float = 0.25
    """Mean time that a foot stays planted, or free."""
    planted: float = 0.6
    """Share of the time that feet are planted."""


def contact_probability(
    law: ContactLaw,
    *,
    height: Float[np.ndarray, " frames"],
    height_var: Float[np.ndarray, " frames"],
    velocity: Float[np.ndarray, "intervals axes"],
    velocity_cov: Float[np.ndarray, "intervals axes axes"],
    times: Float[np.ndarray, " frames"],
) -> Float[np.ndarray, " frames"]:
    """Probability that a foot is planted, by a hidden Markov model's forward and backward pass.

    A frame is judged by its height and by the slower of the two intervals beside it: a foot that lands or leaves
    stands still on one side only.

    Args:
        law: The two states.
        height: Of the sole's lowest point over the ground, metres; NaN says nothing.
        height_var: m^2.
        velocity: Between frames along two or three axes, m/s; NaN says nothing.
        velocity_cov: (m/s)^2.
        times: s, rising.
    """
    gain = _height_gain(law, height, height_var)
    if len(velocity):
        still = _speed_gain(law, velocity, velocity_cov)
        sides = np.full((2, len(times)), -np.inf)
        sides[0, 1:], sides[1, :-1] = still, still
        gain = gain + sides.max(axis=0)
    return smoothed_states(np.clip(gain, -25.0, 25.0), times, stays_s=law.stays_s, share=law.planted)


def _height_gain(law: ContactLaw, height: np.ndarray, var: np.ndarray) -> np.ndarray:
    """Logarithm of how much likelier a planted foot shows the height; 0 where it is NaN."""
    planted, free = law.planted_height_m**2 + var, law.free_height_m**2 + var
    gain = 0.5 * np.log(free / planted) - 0.5 * height**2 * (1.0 / planted - 1.0 / free)
    return np.where(np.isfinite(gain), gain, 0.0)


def _speed_gain(law: ContactLaw, velocity: np.ndarray, cov: np.ndarray) -> np.ndarray:
    """The same of the velocity."""
    known = np.asarray(np.isfinite(velocity).all(axis=1) & np.isfinite(cov).all(axis=(1, 2)))
    v, C = np.where(known[:, None], velocity, 0.0), np.where(known[:, None, None], cov, 0.0)
    planted, free = C + law.planted_speed**2 * np.eye(v.shape[1]), C + law.free_speed**2 * np.eye(v.shape[1])
    distance = [np.einsum("fa,fab,fb->f", v, np.linalg.inv(M), v) for M in (planted, free)]
    gain = 0.5 * np.log(np.linalg.det(free) / np.linalg.det(planted)) - 0.5 * (distance[0] - distance[1])
    return np.where(known, gain, 0.0)


def smoothed_states(
    gain: Float[np.ndarray, " frames"], times: Float[np.ndarray, " frames"], *, stays_s: float, share: float
) -> Float[np.ndarray, " frames"]:
    """Probability of the first of two states.

    Args:
        gain: Logarithm of how much likelier the first state shows what a frame shows.
        times: s, rising.
        stays_s: Time constant with which a state is forgotten.
        share: Of the first state in the long run.
    """
    base = np.array([share, 1.0 - share])
    keep = np.exp(-np.diff(times) / stays_s)
    likely = np.exp(np.stack([0.5 * gain, -0.5 * gain], axis=-1))
    forth = np.empty((len(gain), 2))
    back = np.ones((len(gain), 2))
    forth[0] = base * likely[0]
    forth[0] /= forth[0].sum()
    for k in range(1, len(gain)):
        now = (keep[k - 1] * forth[k - 1] + (1.0 - keep[k - 1]) * base * forth[k - 1].sum()) * likely[k]
        forth[k] = now / now.sum()
    for k in range(len(gain) - 2, -1, -1):
        seen = likely[k + 1] * back[k + 1]
        now = keep[k] * seen + (1.0 - keep[k]) * (base * seen).sum()
        back[k] = now / now.sum()
    both = forth * back
    return both[:, 0] / both.sum(axis=1)
