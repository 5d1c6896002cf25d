"""Where a player looks: neck and head after the ball."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from pgm_data.simulate import rotations
from pgm_data.simulate.body.keys import rise

LOOK_TICK_S = 0.02
_SMOOTH_TICKS = 11
_UP, _DOWN = np.deg2rad([55.0, 50.0])
_EYES_ABOVE_GROUND = 0.92
"""Share of the body's height."""


def look_directions(
    watched: Callable[[Float[np.ndarray, " n"]], Float[np.ndarray, "n 3"]],
    place_of: Callable[[Float[np.ndarray, " n"]], tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, " n"]]],
    height_m: float,
    times: Float[np.ndarray, " times"],
) -> Float[np.ndarray, "times 3"]:
    """World directions from the head to what is watched, smoothed in time; straight ahead where there is nothing.

    Args:
        watched: World place of the ball at any times, NaN for none.
        place_of: The pelvis over the ground (world x, y) and the heading at any times.
        height_m: Of the player.
        times: Seconds, in any order.
    """
    # A grid that does not depend on the times asked for, and cubic B-splines on it.
    reach = _SMOOTH_TICKS + 3
    first = int(np.floor(times.min() / LOOK_TICK_S)) - reach
    count = int(np.floor(times.max() / LOOK_TICK_S)) + reach + 2 - first
    grid = (first + np.arange(count)) * LOOK_TICK_S
    place, heading = place_of(grid)
    to_ball = watched(grid) - np.column_stack([place, np.full(count, _EYES_ABOVE_GROUND * height_m)])
    ahead = np.stack([-np.sin(heading), np.cos(heading), np.full(count, -0.05)], axis=-1)
    seen = np.isfinite(to_ball).all(axis=1, keepdims=True)
    distance = np.linalg.norm(np.where(seen, to_ball, 1.0), axis=1, keepdims=True)
    # A ball at the racket passes too fast for the eyes.
    direction = np.where(seen, to_ball, ahead) / np.where(seen, np.maximum(distance, 1.4), 1.0)
    kernel = np.hanning(2 * _SMOOTH_TICKS + 3)[1:-1]
    kernel /= kernel.sum()
    smooth = np.stack([np.convolve(c, kernel, mode="same") for c in direction.T], axis=-1)
    u = times / LOOK_TICK_S - first
    i = np.floor(u).astype(np.int64)
    f = (u - i)[:, None]
    return (
        (1 - f) ** 3 * smooth[i - 1]
        + (3 * f**3 - 6 * f**2 + 4) * smooth[i]
        + (-3 * f**3 + 3 * f**2 + 3 * f + 1) * smooth[i + 1]
        + f**3 * smooth[i + 2]
    ) / 6.0


def neck_and_head(look: Float[np.ndarray, "times 3"]) -> Float[np.ndarray, "times 3 3"]:
    """The rotation that neck and head each take so that the face turns to directions in the chest's frame.

    The neck goes no further than it can; what is right behind is not looked at.
    """
    side, up, ahead = look.T
    flat = np.hypot(side, ahead)
    yaw = np.arctan2(side, ahead)
    # Like the direction itself at small angles, at most 69 degrees, and back to 0 for what is right behind.
    yaw = 1.2 * np.sin(yaw) - 0.1 * np.sin(2.0 * yaw)
    # Straight above or below there is no sideways.
    steep = rise(flat / np.maximum(0.6 * np.linalg.norm(look, axis=1), 1e-9))
    pitch = np.arctan2(up, np.maximum(flat, 1e-9))
    pitch = np.where(pitch > 0, _UP * np.tanh(pitch / _UP), _DOWN * np.tanh(pitch / _DOWN))
    whole = rotations.about(1, yaw * steep) @ rotations.about(0, -pitch)
    return rotations.from_axis_angle(0.5 * rotations.to_axis_angle(whole))
