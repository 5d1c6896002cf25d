"""The painted lines and the known points of a court, in metres."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from pgm_data.geometry.arrays import frozen


@dataclass(frozen=True, eq=False, kw_only=True)
class Court:
    """Line centres, crossing points, and the known points above the ground.

    Raises:
        ValueError: If a line has no length or no width, or a point is not finite.
    """

    point_names: tuple[str, ...]
    """Names of the crossings of line centres, on the ground."""
    points_world: Float[np.ndarray, "points 3"]
    """Their positions, metres."""
    line_names: tuple[str, ...]
    """Names of the painted lines."""
    line_ends: Int[np.ndarray, "lines 2"]
    """Indices of each line's two end points."""
    line_width: Float[np.ndarray, " lines"]
    """Painted widths, metres."""
    high_names: tuple[str, ...]
    """Names of points above the ground, such as the net's centre and posts."""
    high_world: Float[np.ndarray, "high 3"]
    """Their positions, metres."""
    net_top: tuple[str, ...]
    """Names of the points that the top edge of the net runs through, left to right; empty without a net."""
    tape_width: float
    """Height of the white band along the net's top, metres; 0 without a net."""
    surface_half_size: tuple[float, float]
    """Half width and half length of the playing surface with its run-off, metres."""
    network: str
    """File name of the network that finds this court, empty where there is none."""
    in_play: Float[np.ndarray, "areas 2 2"]
    """Lower and upper x, y, metres, of where a ball in play may land, both halves, to the outer edges of the lines; no
    row where the scene does not say."""
    in_serve: Float[np.ndarray, "boxes 2 2"]
    """The same of the areas for serves; a serve goes to that of the other half and the other side."""

    def __post_init__(self) -> None:
        """Keep read-only copies and check the values."""
        for name in ("points_world", "line_width", "high_world", "in_play", "in_serve"):
            object.__setattr__(self, name, frozen(getattr(self, name)))
        object.__setattr__(self, "line_ends", frozen(self.line_ends, np.int64))
        if not (np.isfinite(self.points_world).all() and np.isfinite(self.high_world).all()):
            raise ValueError("court: expected finite points")
        for name in ("in_play", "in_serve"):
            if not (getattr(self, name)[:, 0] < getattr(self, name)[:, 1]).all():
                raise ValueError(f"court.{name}: expected lower corners, then upper ones, got {getattr(self, name)}")
        for name, ends, width in zip(self.line_names, self.lines_world, self.line_width, strict=True):
            if not np.linalg.norm(ends[1] - ends[0]) > 0 or not width > 0:
                raise ValueError(f"court.lines.{name}: expected a length and a width above 0, got {ends}, {width} m")

    @property
    def lines_world(self) -> Float[np.ndarray, "lines 2 3"]:
        """Both ends of each line's centre, metres."""
        return self.points_world[self.line_ends]

    @property
    def all_names(self) -> tuple[str, ...]:
        """Ground points, then points above the ground."""
        return self.point_names + self.high_names

    @property
    def all_world(self) -> Float[np.ndarray, "all 3"]:
        """Positions of `all_names`, metres."""
        return np.concatenate([self.points_world, self.high_world])

    @property
    def net_world(self) -> Float[np.ndarray, "corners 3"]:
        """The corners of the net's top edge, left to right, metres."""
        return self.all_world[[self.all_names.index(name) for name in self.net_top]].reshape(-1, 3)
