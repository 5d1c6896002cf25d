"""The camera that draws: written apart from the solver's, so that a shared mistake cannot cancel.

OpenCV axes (x right, y down, z forward); `x_cam = R_cam_from_world @ x_world + t_cam_from_world`; the centre of the
top-left pixel is (0, 0); the lens has one radial term k1 and nothing else.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True, eq=False, kw_only=True)
class CameraTrack:
    """The true camera of every frame.

    Raises:
        ValueError: If the arrays disagree in length.
    """

    K: Float[np.ndarray, "frames 3 3"]
    """Intrinsics, pixels; NaN where the frame shows no court."""
    distortion: Float[np.ndarray, "frames 4"]
    """OpenCV order (k1, k2, p1, p2); only k1 is ever other than zero."""
    R_cam_from_world: Float[np.ndarray, "frames 3 3"]
    """Rotations."""
    t_cam_from_world: Float[np.ndarray, "frames 3"]
    """Translations, metres."""

    def __post_init__(self) -> None:
        """Check the lengths."""
        lengths = {len(self.K), len(self.distortion), len(self.R_cam_from_world), len(self.t_cam_from_world)}
        if len(lengths) != 1:
            raise ValueError(f"CameraTrack: expected arrays of one length, got lengths {sorted(lengths)}")

    def __len__(self) -> int:
        """Number of frames."""
        return len(self.K)

    @property
    def shows_court(self) -> np.ndarray:
        """Whether each frame has a camera."""
        return np.isfinite(self.K[:, 0, 0])


def distorted(normalised: Float[np.ndarray, "... 2"], k1: Float[np.ndarray, "..."] | float) -> np.ndarray:
    """Pinhole coordinates (x/z, y/z) as the lens bends them."""
    radius2 = np.sum(normalised**2, axis=-1, keepdims=True)
    return normalised * (1.0 + np.asarray(k1)[..., None] * radius2)


def undistorted(bent: Float[np.ndarray, "... 2"], k1: Float[np.ndarray, "..."] | float) -> np.ndarray:
    """Pinhole coordinates whose bent image is `bent`; Newton's method on the radius."""
    radius = np.linalg.norm(bent, axis=-1)
    k1 = np.broadcast_to(np.asarray(k1, dtype=float), radius.shape)
    straight = radius.copy()
    for _ in range(8):
        straight = straight - (straight * (1.0 + k1 * straight**2) - radius) / (1.0 + 3.0 * k1 * straight**2)
    return bent * (straight / np.where(radius > 0.0, radius, 1.0))[..., None]


def seen_from(
    points_world: Float[np.ndarray, "... 3"],
    R_cam_from_world: Float[np.ndarray, "3 3"],
    t_cam_from_world: Float[np.ndarray, " 3"],
) -> np.ndarray:
    """Camera coordinates of world points, metres."""
    return points_world @ R_cam_from_world.T + t_cam_from_world


def pixels_of(
    points_world: Float[np.ndarray, "... 3"],
    K: Float[np.ndarray, "3 3"],
    k1: float,
    R_cam_from_world: Float[np.ndarray, "3 3"],
    t_cam_from_world: Float[np.ndarray, " 3"],
) -> np.ndarray:
    """Pixels of world points; NaN for points not in front of the camera."""
    cam = seen_from(points_world, R_cam_from_world, t_cam_from_world)
    depth = np.where(cam[..., 2:] > 1e-6, cam[..., 2:], np.nan)
    bent = distorted(cam[..., :2] / depth, k1)
    return np.stack([K[0, 0] * bent[..., 0] + K[0, 2], K[1, 1] * bent[..., 1] + K[1, 2]], axis=-1)


def rotation_towards(direction_world: Float[np.ndarray, " 3"], roll: float) -> np.ndarray:
    """R_cam_from_world of a camera looking along a direction; a positive roll (radians) turns it clockwise."""
    forward = direction_world / np.linalg.norm(direction_world)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    if np.linalg.norm(right) < 1e-9:
        raise ValueError(f"rotation_towards: expected a direction that is not vertical, got {direction_world}")
    right = right / np.linalg.norm(right)
    down = np.cross(forward, right)
    c, s = np.cos(roll), np.sin(roll)
    return np.stack([c * right + s * down, -s * right + c * down, forward])


def rotation_of(heading: float, tilt: float, roll: float) -> np.ndarray:
    """R_cam_from_world of a camera turned, in radians: right of the y axis, above level, clockwise; vertical too."""
    sin_h, cos_h, sin_t, cos_t = np.sin(heading), np.cos(heading), np.sin(tilt), np.cos(tilt)
    forward = np.array([sin_h * cos_t, cos_h * cos_t, sin_t])
    right = np.array([cos_h, -sin_h, 0.0])
    down = np.array([sin_h * sin_t, cos_h * sin_t, -cos_t])
    c, s = np.cos(roll), np.sin(roll)
    return np.stack([c * right + s * down, -s * right + c * down, forward])


def k1_of_half_diagonal(k: float, focal_px: float, width: int, height: int) -> float:
    """OpenCV's k1 of a lens whose radial term is k over the picture's half diagonal."""
    return k * (focal_px / (0.5 * float(np.hypot(width, height)))) ** 2
