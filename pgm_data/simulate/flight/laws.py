"""What a report on physics measures on the course of a ball: energy in flight, bounces, what the air takes."""

import numpy as np
from jaxtyping import Float

from pgm_data.simulate.flight.air import BallBuild
from pgm_data.simulate.flight.path import BallPath, Flight

READ_EVERY_S = 0.001


def energies(flight: Flight, build: BallBuild, gravity: float) -> Float[np.ndarray, " samples"]:
    """Kinetic, rotational and potential energy over mass at every sample, J/kg; height counts from z = 0."""
    turning = build.inertia_factor * build.radius_m**2 * (flight.spins**2).sum(axis=-1)
    return 0.5 * (flight.velocities**2).sum(axis=-1) + 0.5 * turning + gravity * flight.positions[:, 2]


def energy_gains(path: BallPath, build: BallBuild, gravity: float) -> Float[np.ndarray, " flights"]:
    """The largest rise of energy within each flight, over the flight's largest energy; still air must leave it at 0."""
    gains = np.zeros(len(path.flights))
    for i, flight in enumerate(path.flights):
        energy = energies(flight, build, gravity)
        rise = (energy - np.minimum.accumulate(energy)).max()
        gains[i] = rise / max(float(energy.max()), 1e-12)
    return gains


def bounce_height_ratios(path: BallPath, radius_m: float, floor_z: float = 0.0) -> Float[np.ndarray, " bounces"]:
    """At each bounce, peak after over peak before, both of the ball's underside above the floor.

    NaN where a flight beside the bounce does not show its peak: it started on its way down, or was cut on its way up.
    """
    ratios = []
    for before, after in _around_bounces(path):
        heights = [_peak(flight) - radius_m - floor_z for flight in (before, after)]
        ratios.append(heights[1] / heights[0])
    return np.array(ratios, dtype=float)


def speed_losses(path: BallPath) -> Float[np.ndarray, " hits"]:
    """Share of its speed that a ball loses from each hit to its first bounce; NaN where no bounce follows the hit."""
    losses = []
    for i, flight in enumerate(path.flights):
        if path.contacts[i].kind == "hit":
            start, end = (float(np.linalg.norm(flight.velocities[k])) for k in (0, -1))
            losses.append(1 - end / start if path.contacts[i + 1].kind == "bounce" else np.nan)
    return np.array(losses, dtype=float)


def _around_bounces(path: BallPath) -> list[tuple[Flight, Flight]]:
    return [
        (path.flights[i - 1], path.flights[i])
        for i in range(1, len(path.flights))
        if path.contacts[i].kind == "bounce" and not path.flights[i].rolls
    ]


def _peak(flight: Flight) -> float:
    """Height of the ball's centre at the top of a flight, metres; NaN where the top is not within it."""
    rising, falling = flight.velocities[0, 2], flight.velocities[-1, 2]
    if rising < 0 or falling >= 0:
        return np.nan
    times = np.append(np.arange(flight.times[0], flight.times[-1], READ_EVERY_S), flight.times[-1])
    return float(flight.at(times)[0][:, 2].max())
