"""The ball in metres as solvers give it back, with its uncertainty and how it was had."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float, Int, Shaped

from pgm_data.ball import BallEvents
from pgm_data.geometry.arrays import frozen
from pgm_data.scene import Prior


@dataclass(frozen=True, eq=False, kw_only=True)
class PlayersAt:
    """Where the players of a scene are, when their tables are there."""

    names: tuple[str, ...]
    """Player objects, such as player0."""
    root_position: Float[np.ndarray, "frames players 3"]
    """World metres; NaN where not known."""
    hands: Float[np.ndarray, "frames players hands 3"]
    """World positions of the wrists, metres; NaN where not known."""


FlightStatus = Literal["solved", "line", "fallback", "none"]
"""`solved`: by the method asked for; `line`: the line method in its place; `fallback`: smoother than the data support,
from its neighbours; `none`: not placed."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Flights:
    """One row a flight between two events; arrays in order of time."""

    start_event: Int[np.ndarray, " flights"]
    """Index into the solution's events."""
    end_event: Int[np.ndarray, " flights"]
    start_velocity: Float[np.ndarray, "flights 3"]
    """World m/s, just after the start; NaN where not placed."""
    start_velocity_cov: Float[np.ndarray, "flights 3 3"]
    spin: Float[np.ndarray, "flights 3"]
    """Angular velocity, world, rad/s; NaN where it was not free."""
    spin_std: Float[np.ndarray, "flights 3"]
    drag_per_m: Float[np.ndarray, " flights"]
    drag_std_per_m: Float[np.ndarray, " flights"]
    landing: Float[np.ndarray, "flights 3"]
    """Where the ball first meets the ground after the start, in this flight or flown on; NaN where unknown."""
    landing_cov: Float[np.ndarray, "flights 3 3"]
    residual_px: Float[np.ndarray, " flights"]
    """Rms of 2D distances of the flight's measured frames; NaN where there are none."""
    free: tuple[tuple[str, ...], ...]
    """Parameters that were free: of position, velocity, spin, drag, restitution, friction, time."""
    status: tuple[FlightStatus, ...]
    said: tuple[str, ...]
    """The solver's words."""

    def __len__(self) -> int:
        """Number of flights."""
        return len(self.start_event)


@dataclass(frozen=True, eq=False, kw_only=True)
class BallSolution:
    """A ball in metres in every frame.

    Raises:
        ValueError: If lengths differ, or a frame with a position has no finite covariance.
    """

    position: Float[np.ndarray, "frames 3"]
    """World metres, centre of the ball; NaN where the status is `none`."""
    velocity: Float[np.ndarray, "frames 3"]
    """m/s; NaN where the status is `none`."""
    position_cov: Float[np.ndarray, "frames 3 3"]
    """m^2."""
    status: Shaped[np.ndarray, " frames"]
    """`measured`: this frame's own pixel took part; `filled`: from the flight around it; `none`: no ball."""
    events: BallEvents
    """The events that were given, their times as solved."""
    event_position: Float[np.ndarray, "events 3"]
    """World metres; NaN where not placed."""
    event_cov: Float[np.ndarray, "events 3 3"]
    flights: Flights
    drag: Prior
    """Posterior of the drag constant shared by all flights, 1/m."""
    restitution: Prior | None
    """Posterior of the vertical speed kept at a bounce; None where it was not free."""
    friction: Prior | None
    cost: float
    """Half the sum of squared weighted residuals, priors among them; compares solutions of the same track."""
    said: str
    """What the solver said of the whole."""

    def __post_init__(self) -> None:
        """Keep read-only copies and check the values."""
        for name in ("position", "velocity", "position_cov", "event_position", "event_cov"):
            object.__setattr__(self, name, frozen(getattr(self, name)))
        rows = len(self.position)
        for name in ("velocity", "position_cov", "status"):
            if len(getattr(self, name)) != rows:
                raise ValueError(f"ball solution: {name}: expected {rows} rows, got {len(getattr(self, name))}")
        placed = np.asarray(self.status != "none", dtype=bool)
        for name in ("position", "velocity", "position_cov"):
            values = getattr(self, name)
            finite = np.isfinite(values).reshape(rows, values[0].size if rows else 1)
            wrong = np.flatnonzero(np.where(placed, ~finite.all(axis=1), finite.any(axis=1)))
            if len(wrong):
                expected = "numbers" if placed[wrong[0]] else "NaN"
                raise ValueError(
                    f"ball solution: {name}: frame {wrong[0]}: expected {expected}, as its status is "
                    f"{self.status[wrong[0]]}, got {getattr(self, name)[wrong[0]]}"
                )
