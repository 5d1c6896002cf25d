"""How long the shutter was open, from the ball's streaks and its speed in the picture."""

import numpy as np
from jaxtyping import Float

from pgm_data.geometry.camera import Camera, project
from pgm_data.scene import Prior

LEAST_STREAKS = 8
LEAST_STREAK_PX = 3.0
"""Shorter streaks say more about the detector than about the shutter."""
STEP_S = 1e-3


def pixel_velocity(
    camera: Camera, position: Float[np.ndarray, "frames 3"], velocity: Float[np.ndarray, "frames 3"]
) -> Float[np.ndarray, "frames 2"]:
    """How fast the ball moves in each frame's picture, px/s; NaN where it is not seen."""
    ends = np.stack([position - 0.5 * STEP_S * velocity, position + 0.5 * STEP_S * velocity], axis=1)
    pixels, _ = project(camera, ends)
    return (pixels[:, 1] - pixels[:, 0]) / STEP_S


def shutter_from_streaks(
    streak_px: Float[np.ndarray, "frames 2"],
    velocity_px: Float[np.ndarray, "frames 2"],
    frame_s: float,
) -> Prior | None:
    """Exposure time and its standard deviation, s; None where too few streaks are long enough to tell.

    Each streak over the speed beside it is one estimate; their weighted median is robust to wrong streaks. Streaks
    across the way the ball went are left out. No shutter is open longer than a frame lasts.
    """
    length, speed = np.linalg.norm(streak_px, axis=1), np.linalg.norm(velocity_px, axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        along = np.abs(np.sum(streak_px * velocity_px, axis=1)) / (length * speed)
        use = (length >= LEAST_STREAK_PX) & (along > 0.9) & (speed * frame_s > LEAST_STREAK_PX)
    if use.sum() < LEAST_STREAKS:
        return None
    estimate, weight = length[use] / speed[use], speed[use]
    order = np.argsort(estimate)
    estimate, weight = estimate[order], weight[order]
    middle = float(estimate[np.searchsorted(np.cumsum(weight), 0.5 * weight.sum())])
    spread = 1.4826 * float(np.median(np.abs(estimate - middle)))
    if middle > 1.05 * frame_s:
        return None
    return Prior(mean=min(middle, frame_s), std=1.2533 * spread / float(np.sqrt(use.sum())) + 1e-6)
