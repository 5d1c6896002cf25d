"""Where flights come down when nobody hits the ball any more, and how sure that is."""

import numpy as np
from jaxtyping import Float

from pgm_data.lift.ball.flight_model import AirLaw, flown

LONGEST_S = 12.0
STEP_S = 0.02
NUDGE = np.array([1e-4] * 3 + [1e-3] * 3 + [0.1] * 3 + [1e-5])


def come_down(
    states: Float[np.ndarray, "flights 6"],
    spin: Float[np.ndarray, "flights 3"],
    drag_per_m: Float[np.ndarray, " flights"],
    law: AirLaw,
    level: float,
) -> Float[np.ndarray, "flights 3"]:
    """Positions where the flights first meet the level from above, m; NaN where they start under it or never do."""
    landed = np.full((len(states), 3), np.nan)
    now = states.copy()
    alive = np.isfinite(states).all(axis=1) & (states[:, 2] >= level - 1e-6)
    for _ in range(int(LONGEST_S / STEP_S)):
        if not alive.any():
            break
        after = flown(now, spin, drag_per_m, np.full(len(now), STEP_S), law)
        through = np.flatnonzero(alive & (after[:, 2] < level) & (after[:, 5] < 0))
        if len(through):
            span = np.zeros(len(through))
            at = now[through]
            for turn in range(4):
                if turn:
                    at = flown(now[through], spin[through], drag_per_m[through], span, law)
                # The height is nearly a parabola: its root from here on.
                fall = 4.9 * STEP_S
                speed = np.minimum(at[:, 5] - (fall if turn == 0 else 0.0), -1e-3)
                span = np.clip(span - (at[:, 2] - level) / speed, 0.0, STEP_S)
            landed[through] = flown(now[through], spin[through], drag_per_m[through], span, law)[:, :3]
            alive[through] = False
        now = after
    return landed


def come_down_rows(
    states: Float[np.ndarray, "flights 6"],
    spin: Float[np.ndarray, "flights 3"],
    drag_per_m: Float[np.ndarray, " flights"],
    law: AirLaw,
    level: float,
) -> tuple[Float[np.ndarray, "flights 3"], Float[np.ndarray, "flights 3 10"]]:
    """Those positions, and their derivatives by state, spin and drag."""
    count = len(states)
    all_ = np.concatenate([states, spin, drag_per_m[:, None]], axis=1)
    steps = NUDGE[:, None] * np.eye(10)
    tried = np.concatenate([all_[:, None], all_[:, None] + steps, all_[:, None] - steps], axis=1).reshape(-1, 10)
    # Nudged down, a flight that starts on the level still starts above it.
    landed = come_down(tried[:, :6], tried[:, 6:9], tried[:, 9], law, level).reshape(count, 21, 3)
    rows = (landed[:, 1:11] - landed[:, 11:]) / (2 * NUDGE)[None, :, None]
    return landed[:, 0], np.swapaxes(rows, 1, 2)
