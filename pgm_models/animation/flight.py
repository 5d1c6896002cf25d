"""The flight of a ball that nothing touches."""

import numpy as np
from jaxtyping import Float

from pgm_data.lift.ball.world import GRAVITY

STEP_S = 0.04
"""Longest step of the integration, unless another is asked for, s."""
FASTEST_M_S = 200.0
"""Speeds beyond this have its drag: back in time drag speeds a ball up, and one far too fast would soon be nowhere."""


def flown(
    position: Float[np.ndarray, "*batch 3"],
    velocity: Float[np.ndarray, "*batch 3"],
    seconds: Float[np.ndarray, "*batch"],
    drag_per_m: float,
    turn: Float[np.ndarray, "*batch 3"] | None = None,
    step_s: float = STEP_S,
) -> tuple[Float[np.ndarray, "*batch 3"], Float[np.ndarray, "*batch 3"]]:
    """Position (m) and velocity (m/s) some time later, or before, under gravity, drag and spin; NaN stays NaN.

    Args:
        position: Metres.
        velocity: m/s.
        seconds: May be below 0.
        drag_per_m: Deceleration over squared speed, 1/m.
        turn: How spin turns the velocity, rad/s, by an axis; it takes and gives no energy.
        step_s: Longest step of the integration.
    """
    longest = float(np.max(np.abs(np.nan_to_num(seconds)), initial=0.0))
    steps = max(1, int(np.ceil(longest / step_s - 1e-9)))
    h = (np.asarray(seconds) / steps)[..., None]
    x, v = position, velocity
    for _ in range(steps):
        # Runge and Kutta's fourth order; places follow from the speeds at the stages.
        k1 = _pull(v, drag_per_m, turn)
        k2 = _pull(v + h / 2 * k1, drag_per_m, turn)
        k3 = _pull(v + h / 2 * k2, drag_per_m, turn)
        k4 = _pull(v + h * k3, drag_per_m, turn)
        x = x + h * v + h**2 / 6 * (k1 + k2 + k3)
        v = v + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return x, v


def _pull(velocity: np.ndarray, drag_per_m: float, turn: np.ndarray | None) -> np.ndarray:
    """Acceleration, m/s^2."""
    speed = np.sqrt(np.einsum("...i,...i->...", velocity, velocity))
    pull = -drag_per_m * np.minimum(speed, FASTEST_M_S)[..., None] * velocity
    pull[..., 2] -= GRAVITY
    if turn is not None:
        x, y, z = velocity[..., 0], velocity[..., 1], velocity[..., 2]
        pull[..., 0] += turn[..., 1] * z - turn[..., 2] * y
        pull[..., 1] += turn[..., 2] * x - turn[..., 0] * z
        pull[..., 2] += turn[..., 0] * y - turn[..., 1] * x
    return pull
