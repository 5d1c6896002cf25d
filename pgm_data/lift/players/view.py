"""What a registration sees of one player: the camera, and the player's points and boxes in the pictures."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from pgm_data.geometry.arrays import frozen
from pgm_data.geometry.camera import Camera


@dataclass(frozen=True, eq=False, kw_only=True)
class PlayerView:
    """One player in the pictures of one clip, a row a frame; NaN where something is not known.

    Raises:
        ValueError: If lengths differ, times are not finite or go back, or a point that is there has no sigma above 0.
    """

    camera: Camera
    """One a frame; NaN where there is none."""
    has_camera: Bool[np.ndarray, " frames"]
    times: Float[np.ndarray, " frames"]
    """Capture times, s."""
    is_duplicate: Bool[np.ndarray, " frames"]
    """Whether the picture repeats an earlier one, so that it is no measurement of its own."""
    point_names: tuple[str, ...]
    """Points of the body, as the skeleton's file calls them."""
    points_px: Float[np.ndarray, "frames points 2"]
    """px; NaN where not found."""
    sigma_px: Float[np.ndarray, "frames points"]
    """Standard deviation of each coordinate, px; NaN where not found."""
    score: Float[np.ndarray, "frames points"]
    """Confidence 0 to 1; NaN where not found."""
    points_ray: Float[np.ndarray, "frames points 3"]
    """The body's shape as a network guesses it, metres; axes of a camera that looks at the middle of the box without
    roll against the real one. NaN where unknown.
    """
    boxes_px: Float[np.ndarray, "frames 4"]
    """x0, y0, x1, y1, px; NaN where there is none."""
    ground_world: Float[np.ndarray, "frames 2"]
    """World x and y between the feet, on the ground, metres; NaN where unknown."""

    def __post_init__(self) -> None:
        """Keep read-only copies and check the values."""
        count = len(self.times)
        points = (count, len(self.point_names))
        shapes = {"points_px": (*points, 2), "sigma_px": points, "score": points, "points_ray": (*points, 3)}
        shapes |= {"times": (count,), "boxes_px": (count, 4), "ground_world": (count, 2)}
        for name, shape in shapes.items():
            object.__setattr__(self, name, frozen(getattr(self, name)))
            if getattr(self, name).shape != shape:
                raise ValueError(f"player view: {name}: expected shape {shape}, got {getattr(self, name).shape}")
        for name in ("has_camera", "is_duplicate"):
            object.__setattr__(self, name, frozen(getattr(self, name), np.bool_))
            if len(getattr(self, name)) != count:
                raise ValueError(f"player view: {name}: expected {count} frames, got {len(getattr(self, name))}")
        if self.camera.K.shape != (count, 3, 3):
            raise ValueError(f"player view: camera: expected one a frame, {count}, got {self.camera.K.shape[:-2]}")
        blind = self.has_camera & ~np.isfinite(self.camera.K).all(axis=(1, 2))
        if blind.any():
            raise ValueError(f"player view: camera: frame {np.argmax(blind)}: expected one, as it is said, got NaN")
        back = ~(np.diff(self.times, prepend=-np.inf) >= 0) | ~np.isfinite(self.times)
        if back.any():
            frame = int(np.argmax(back))
            raise ValueError(f"player view: times: frame {frame}: expected finite and rising, got {self.times[frame]}")
        bad = np.isfinite(self.points_px).all(axis=-1) & ~(np.isfinite(self.sigma_px) & (self.sigma_px > 0))
        if bad.any():
            frame, point = np.argwhere(bad)[0]
            got = self.sigma_px[frame, point]
            raise ValueError(
                f"player view: sigma_px: frame {frame}: {self.point_names[point]}: expected above 0, got {got}"
            )
