"""The place of a player of whom no more than a box is known."""

import numpy as np
from jaxtyping import Float

from pgm_data.geometry.camera import Camera, meet_plane
from pgm_data.lift.players.view import PlayerView

_POSTURE_STD_M = 0.08
"""Of the pelvis' height of one who stands, crouches or jumps a little."""
_FOOT_STD_M = 0.15
"""How far the pelvis is off the point between the feet, level."""


def box_roots(
    view: PlayerView, *, pelvis_height_m: float, bottom_std_share: float
) -> tuple[Float[np.ndarray, "frames 3"], Float[np.ndarray, "frames 3 3"]]:
    """Root position over each box's ground point, and its covariance, m^2; NaN without a box or a camera.

    Args:
        view: The player.
        pelvis_height_m: Of one who stands.
        bottom_std_share: Standard deviation of a box's lower edge and of its middle, as a share of the box's height.
    """
    frames = len(view.times)
    there = view.has_camera & np.isfinite(view.boxes_px).all(axis=1)
    position = np.full((frames, 3), np.nan)
    cov = np.full((frames, 3, 3), np.nan)
    rows = np.flatnonzero(there)
    if not len(rows):
        return position, cov
    camera, box = view.camera[rows], view.boxes_px[rows]
    bottom = np.stack([0.5 * (box[:, 0] + box[:, 2]), box[:, 3]], axis=-1)
    std = bottom_std_share * (box[:, 3] - box[:, 1])
    ground, J = _ground(camera, bottom)
    given = view.ground_world[rows]
    ground = np.where(np.isfinite(given).all(axis=1, keepdims=True), given, ground)
    position[rows, :2] = ground
    position[rows, 2] = pelvis_height_m
    cov[rows] = 0.0
    cov[rows, :2, :2] = std[:, None, None] ** 2 * J @ np.swapaxes(J, 1, 2) + _FOOT_STD_M**2 * np.eye(2)
    cov[rows, 2, 2] = _POSTURE_STD_M**2
    lost = ~(np.isfinite(position).all(axis=1) & np.isfinite(cov).all(axis=(1, 2)))
    position[lost], cov[lost] = np.nan, np.nan
    return position, cov


def _ground(camera: Camera, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where pixels meet the ground, and the derivative by the pixel."""
    met = meet_plane(camera, pixels[:, None])[:, 0, :2]
    step = 0.5
    moved = [meet_plane(camera, (pixels + step * axis)[:, None])[:, 0, :2] for axis in np.eye(2)]
    return met, np.stack([(other - met) / step for other in moved], axis=-1)
