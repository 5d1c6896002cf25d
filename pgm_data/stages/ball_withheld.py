"""Flights that no ball can have flown are not told of as if one had: they come back as `none`, and say why."""

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float

from pgm_data.lift.ball.solution import BallSolution
from pgm_data.lift.ball.world import BallWorld

FASTEST_M_S = 160.0
"""No ball of any sport here was measured faster: a shuttlecock's smash is the fastest, at 157."""
FARTHEST = 3.0
"""Times the half size of where the game is played, beyond which no ball is placed."""
BELOW_M = 1.0
"""Depth under the floor that an uncertain place may have."""


UNDER_M, DEVIATIONS = 0.02, 4.0
"""A single place may lie this far under the floor, and so many of its standard deviations."""


def without_absurd(solution: BallSolution, times: Float[np.ndarray, " frames"], world: BallWorld) -> BallSolution:
    """The solution without its flights that are too fast, too far off or under the floor.

    Args:
        solution: What was solved.
        times: Capture time of each frame, s.
        world: What the ball flies in.
    """
    flights, events = solution.flights, solution.events
    t0, t1 = events.times[flights.start_event], events.times[flights.end_event]
    inside = (times >= t0[:, None]) & (times <= t1[:, None]) & np.asarray(solution.status != "none", dtype=bool)
    before_end = inside & (times < t1[:, None])  # at its end the ball has the next flight's velocity
    words = [_why_absurd(solution, flight, before_end[flight], world) for flight in range(len(flights))]
    bad = np.array([bool(word) for word in words], dtype=bool)
    if not bad.any():
        return without_buried(solution, world)
    lost = np.atleast_1d(inside[bad].any(axis=0) & ~inside[~bad].any(axis=0))
    ends = np.stack([flights.start_event, flights.end_event])
    gone = np.setdiff1d(ends[:, bad], ends[:, ~bad])
    out = np.zeros(len(events), dtype=bool)
    out[gone] = True

    def blank(values: np.ndarray, rows: np.ndarray) -> np.ndarray:
        shape = (len(rows), *[1] * (values.ndim - 1))
        return np.where(rows.reshape(shape), np.nan, values)

    names = ("start_velocity", "start_velocity_cov", "spin", "spin_std", "landing", "landing_cov")
    numbers = {name: blank(getattr(flights, name), bad) for name in (*names, "drag_per_m", "drag_std_per_m")}
    kept = replace(
        solution,
        position=blank(solution.position, lost),
        velocity=blank(solution.velocity, lost),
        position_cov=blank(solution.position_cov, lost),
        status=np.where(lost, "none", solution.status).astype(object),
        event_position=blank(solution.event_position, out),
        event_cov=blank(solution.event_cov, out),
        flights=replace(
            flights,
            **numbers,
            residual_px=blank(flights.residual_px, bad),
            free=tuple(() if word else names for word, names in zip(words, flights.free, strict=True)),
            status=tuple("none" if word else status for word, status in zip(words, flights.status, strict=True)),
            said=tuple(word or said for word, said in zip(words, flights.said, strict=True)),
        ),
    )
    return without_buried(kept, world)


def without_buried(solution: BallSolution, world: BallWorld) -> BallSolution:
    """The solution without places under the floor that their uncertainty does not excuse.

    Such a frame comes back as `none`; an event keeps its time and loses its place.
    """
    floor = world.floor_z - UNDER_M
    std = np.sqrt(np.maximum(np.nan_to_num(solution.position_cov[:, 2, 2]), 0.0))
    lost = np.asarray(solution.position[:, 2] < floor - DEVIATIONS * std)
    out = np.asarray(solution.event_position[:, 2] < floor)
    if not lost.any() and not out.any():
        return solution
    return replace(
        solution,
        position=np.where(lost[:, None], np.nan, solution.position),
        velocity=np.where(lost[:, None], np.nan, solution.velocity),
        position_cov=np.where(lost[:, None, None], np.nan, solution.position_cov),
        status=np.where(lost, "none", solution.status).astype(object),
        event_position=np.where(out[:, None], np.nan, solution.event_position),
        event_cov=np.where(out[:, None, None], np.nan, solution.event_cov),
    )


def _why_absurd(solution: BallSolution, flight: int, own: Bool[np.ndarray, " frames"], world: BallWorld) -> str:
    """Why the flight cannot be; empty where it can, or is not placed."""
    flights = solution.flights
    if flights.status[flight] == "none":
        return ""
    ends = [flights.start_event[flight], flights.end_event[flight]]
    places = np.concatenate([solution.position[own], solution.event_position[ends]])
    velocities = np.concatenate([solution.velocity[own], flights.start_velocity[[flight]]])
    speed = np.linalg.norm(velocities, axis=1)
    speed = np.nanmax(speed) if np.isfinite(speed).any() else 0.0
    places = places[np.isfinite(places).all(axis=1)]
    far = np.abs(places[:, :2]) > FARTHEST * np.maximum(world.reach_half_size, world.ground_half_size)
    low = places[:, 2] < world.floor_z - BELOW_M
    if speed > FASTEST_M_S:
        return f"not believed: {speed:.0f} m/s"
    if far.any() or low.any():
        x, y, z = places[np.flatnonzero(far.any(axis=1) | low)[0]]
        return f"not believed: a ball at x {x:.0f}, y {y:.0f}, z {z:.0f} m"
    return ""
