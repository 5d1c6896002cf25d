"""The players as detectors, networks and other programs give them to the solver: boxes and points in the picture.

`detect` and `convert` make these values, `lift` turns them into skeletons in metres. Rows are frames of one clip, in
order; columns are the player objects of the scene, in its order. What is not known is NaN.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Shaped

from pgm_data.geometry.arrays import frozen

SEEN_STATUSES = ("measured", "filled", "none")


@dataclass(frozen=True, eq=False, kw_only=True)
class PlayerBoxes:
    """Where the scene's players are in the pictures of one clip.

    Raises:
        ValueError: If shapes differ, a status is unknown, or a box is inside out, or NaN where it is said to be there.
    """

    names: tuple[str, ...]
    """Player objects of the scene."""
    boxes_px: Float[np.ndarray, "frames players 4"]
    """x0, y0, x1, y1 around the body without its racket, px; may reach beyond the picture."""
    score: Float[np.ndarray, "frames players"]
    """Probability, 0 to 1, that this is that player."""
    ground_world: Float[np.ndarray, "frames players 2"]
    """World x and y of the point between the feet, projected on the ground, metres; NaN where unknown."""
    status: Shaped[np.ndarray, "frames players"]
    """`measured`: seen in this frame's own pixels; `filled`: bridged; `none`: no box."""

    def __post_init__(self) -> None:
        """Keep read-only copies and check the values."""
        shape = (self.boxes_px.shape[0], len(self.names))
        for name in ("boxes_px", "score", "ground_world"):
            object.__setattr__(self, name, frozen(getattr(self, name)))
        for name in ("boxes_px", "score", "ground_world", "status"):
            if getattr(self, name).shape[:2] != shape:
                raise ValueError(f"player boxes: {name}: expected {shape} first, got {getattr(self, name).shape}")
        stray = sorted(set(self.status.ravel()) - set(SEEN_STATUSES))
        if stray:
            raise ValueError(f"player boxes: status: expected one of {', '.join(SEEN_STATUSES)}, got {stray[0]!r}")
        there = self.status != "none"
        finite = np.isfinite(self.boxes_px).all(axis=-1)
        for name, bad, expected in (
            ("boxes_px", there & ~finite, "numbers, as it is said to be there"),
            ("boxes_px", ~there & ~np.isnan(self.boxes_px).all(axis=-1), "NaN, as its status is none"),
            (
                "boxes_px",
                finite & ((self.boxes_px[..., 2:] <= self.boxes_px[..., :2]).any(axis=-1)),
                "x0 < x1, y0 < y1",
            ),
        ):
            if bad.any():
                frame, player = np.argwhere(bad)[0]
                got = self.boxes_px[frame, player]
                raise ValueError(
                    f"player boxes: {name}: frame {frame}: {self.names[player]}: expected {expected}, got {got}"
                )


@dataclass(frozen=True, eq=False, kw_only=True)
class PlayerPoses:
    """Points of the players' bodies in the pictures of one clip, and their relative depths where a network knows them.

    Raises:
        ValueError: If shapes differ, or a point's standard deviation is not above 0.
    """

    names: tuple[str, ...]
    """Player objects of the scene."""
    point_names: tuple[str, ...]
    """Points of the body, as the skeleton's file calls them; more than its keypoint set, or fewer."""
    points_px: Float[np.ndarray, "frames players points 2"]
    """x, y, px; may lie outside of the picture; NaN where not found."""
    score: Float[np.ndarray, "frames players points"]
    """Confidence 0 to 1 that the point is there and visible; NaN where not found."""
    sigma_px: Float[np.ndarray, "frames players points"]
    """Standard deviation of each coordinate, px; NaN where not found."""
    points_ray: Float[np.ndarray, "frames players points 3"]
    """The body's shape in space as a network guesses it, metres, its scale and origin not to be relied on.

    Axes of a camera at the same place that looks at the middle of the player's box without roll against the real one:
    x right, y down, z away. NaN where unknown.
    """

    def __post_init__(self) -> None:
        """Keep read-only copies and check the values."""
        shape = (self.points_px.shape[0], len(self.names), len(self.point_names))
        for name in ("points_px", "score", "sigma_px", "points_ray"):
            object.__setattr__(self, name, frozen(getattr(self, name)))
            if getattr(self, name).shape[:3] != shape:
                raise ValueError(f"player poses: {name}: expected {shape} first, got {getattr(self, name).shape}")
        found = np.isfinite(self.points_px).all(axis=-1)
        bad = found & ~(np.isfinite(self.sigma_px) & (self.sigma_px > 0))
        if bad.any():
            frame, player, point = np.argwhere(bad)[0]
            place = f"frame {frame}: {self.names[player]}: {self.point_names[point]}"
            raise ValueError(
                f"player poses: sigma_px: {place}: expected above 0, got {self.sigma_px[frame, player, point]}"
            )

    @property
    def found(self) -> np.ndarray:
        """Which points were found."""
        return np.asarray(np.isfinite(self.points_px).all(axis=-1))


@dataclass(frozen=True, eq=False, kw_only=True)
class PlayerLooks:
    """What the players look like: clothes, hair, skin; compared by the distance of their descriptors."""

    names: tuple[str, ...]
    descriptors: Float[np.ndarray, "frames players numbers"]
    """NaN in frames that were not looked at."""
    weight: Float[np.ndarray, "frames players"]
    """How much of the body the descriptor saw, 0 to 1."""
