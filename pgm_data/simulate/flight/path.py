"""The course of a ball: flights between contacts, read at any time."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from pgm_data.simulate.states import EventKind


@dataclass(frozen=True, eq=False, kw_only=True)
class Flight:
    """One flight between two contacts, sampled finely enough that cubic interpolation is exact to 0.1 mm.

    Raises:
        ValueError: If there are fewer than two samples or times do not rise.
    """

    times: Float[np.ndarray, " samples"]
    """Seconds, rising; the first is just after the contact that starts it."""
    positions: Float[np.ndarray, "samples 3"]
    """World metres."""
    velocities: Float[np.ndarray, "samples 3"]
    """m/s."""
    spins: Float[np.ndarray, "samples 3"]
    """Angular velocity, world, rad/s."""
    drag_per_m: float
    """rho Cd A / (2 m) of this flight, 1/m; 0 where it rolls."""
    rolls: bool = False
    """Whether the ball rolls or lies on the ground, or on the net's tape, instead of flying."""

    def __post_init__(self) -> None:
        """Check the times."""
        if len(self.times) < 2 or not (np.diff(self.times) > 0).all():
            raise ValueError(f"Flight.times: expected two or more, rising, got {self.times[:4]}...")

    def at(self, times: Float[np.ndarray, " times"]) -> tuple[np.ndarray, np.ndarray]:
        """Positions and velocities (times, 3) by cubic Hermite interpolation, at times within the flight."""
        return _hermite(self, times)


@dataclass(frozen=True, eq=False, kw_only=True)
class Contact:
    """What starts or ends a flight."""

    time: float
    kind: EventKind
    player: int
    """0 near, 1 far; -1 where no player hit."""
    position: Float[np.ndarray, " 3"]
    """Centre of the ball, world metres."""


@dataclass(frozen=True, eq=False, kw_only=True)
class BallPath:
    """Flights in order, `contacts[i]` starting and `contacts[i + 1]` ending `flights[i]`.

    Raises:
        ValueError: If the counts do not fit.
    """

    flights: tuple[Flight, ...]
    contacts: tuple[Contact, ...]

    def __post_init__(self) -> None:
        """Check the counts."""
        if len(self.contacts) != len(self.flights) + 1:
            raise ValueError(f"BallPath: expected one contact more than {len(self.flights)}, got {len(self.contacts)}")

    def at(self, times: Float[np.ndarray, " times"]) -> tuple[np.ndarray, np.ndarray]:
        """Positions and velocities (times, 3) by cubic Hermite interpolation; NaN outside of the course.

        At a contact the velocity is the one after it.
        """
        position = np.full((len(times), 3), np.nan)
        velocity = np.full((len(times), 3), np.nan)
        for i, flight in enumerate(self.flights):
            last = i == len(self.flights) - 1
            end = flight.times[-1]
            inside = (times >= flight.times[0]) & ((times <= end) if last else (times < end))
            if inside.any():
                position[inside], velocity[inside] = flight.at(times[inside])
        return position, velocity


def _hermite(flight: Flight, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    knots = flight.times
    i = np.clip(np.searchsorted(knots, times, side="right") - 1, 0, len(knots) - 2)
    h = (knots[i + 1] - knots[i])[:, None]
    u = (times - knots[i])[:, None] / h
    p0, p1, v0, v1 = flight.positions[i], flight.positions[i + 1], flight.velocities[i], flight.velocities[i + 1]
    position = (
        (1 + 2 * u) * (1 - u) ** 2 * p0 + u * (1 - u) ** 2 * h * v0 + u**2 * (3 - 2 * u) * p1 + u**2 * (u - 1) * h * v1
    )
    velocity = 6 * u * (1 - u) * (p1 - p0) / h + (1 - u) * (1 - 3 * u) * v0 + u * (3 * u - 2) * v1
    return position, velocity
