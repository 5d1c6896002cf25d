"""A clip's ball as curves to draw: its flights sampled finely between frames, and what happened where."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int, Shaped

from pgm_data.dataset.clip_ball import ClipBall, nearest_frames
from pgm_data.geometry.arrays import frozen

SAMPLES = 4
"""Straight pieces from one frame of a flight to the next."""
FLAT_RAD_S = 50.0
"""Spin below this bends a shot by less than people see, rad/s: 480 turns a minute."""


@dataclass(frozen=True, eq=False, kw_only=True)
class FlightPaths:
    """All flights of a clip as samples one after another."""

    first: Int[np.ndarray, " ends"]
    """First sample of each flight, and at last the number of samples."""
    times: Float[np.ndarray, " samples"]
    """Capture times, s; rising within a flight."""
    points_world: Float[np.ndarray, "samples 3"]
    """Metres; NaN where the ball was not placed."""
    cov: Float[np.ndarray, "samples 3 3"]
    """m^2, of the nearest frame; NaN where the ball was not placed."""
    start_time: Float[np.ndarray, " flights"]
    end_time: Float[np.ndarray, " flights"]
    hitter: Shaped[np.ndarray, " flights"]
    """Player object that hit the ball last before, else `near end` or `far end`, by where; empty where unknown."""
    rally: Int[np.ndarray, " flights"]
    """Number of the rally, from 0: flights that follow one upon the other."""

    def __post_init__(self) -> None:
        """Keep read-only copies."""
        for name in ("times", "points_world", "cov", "start_time", "end_time"):
            object.__setattr__(self, name, frozen(getattr(self, name)))
        for name in ("first", "rally"):
            object.__setattr__(self, name, frozen(getattr(self, name), np.int64))

    def __len__(self) -> int:
        """Number of flights."""
        return len(self.start_time)

    def samples(self, flight: int) -> slice:
        """The flight's samples."""
        return slice(int(self.first[flight]), int(self.first[flight + 1]))

    def at(self, time: float) -> int | None:
        """The flight that the ball is in at a time; None where it is in none."""
        inside = np.flatnonzero((self.start_time <= time) & (time <= self.end_time))
        return int(inside[-1]) if len(inside) else None


def flight_paths(ball: ClipBall) -> FlightPaths:
    """The flights of a clip, through the ball's place and velocity in each frame and its place at the events."""
    shots, events = ball.shots, ball.events
    own = np.flatnonzero(np.diff(ball.capture_time, prepend=-np.inf) > 0)  # no repeats
    times, points, covs, first = [], [], [], [0]
    for start, end in zip(shots.start_event, shots.end_event, strict=True):
        t0, t1 = events.time[start], events.time[end]
        inner = own[(ball.capture_time[own] > t0) & (ball.capture_time[own] < t1)]
        ends = np.array([start, end])
        knots = np.concatenate([[t0], ball.capture_time[inner], [t1]])
        places = np.concatenate([events.position[ends[:1]], ball.position[inner], events.position[ends[1:]]])
        velocity = _knot_velocity(knots, places, ball.velocity[inner])
        t, p = _sampled(knots, places, velocity)
        times.append(t)
        points.append(p)
        covs.append(
            np.where(np.isfinite(p[:, :1, None]), ball.position_cov[nearest_frames(t, ball.capture_time)], np.nan)
        )
        first.append(first[-1] + len(t))
    starts, ends = shots.start_event, shots.end_event
    joined = (starts[1:] == ends[:-1]) & ~np.isin(events.kind[starts[1:]], ("first", "last")) if len(starts) else []
    return FlightPaths(
        first=np.array(first),
        times=np.concatenate([*times, np.zeros(0)]),
        points_world=np.concatenate([*points, np.zeros((0, 3))]),
        cov=np.concatenate([*covs, np.zeros((0, 3, 3))]),
        start_time=events.time[starts],
        end_time=events.time[ends],
        hitter=_hitters(ball),
        rally=np.cumsum(np.concatenate([[0], ~np.asarray(joined, dtype=bool)]))[: len(starts)],
    )


def _knot_velocity(
    knots: Float[np.ndarray, " knots"], places: Float[np.ndarray, "knots 3"], inner: Float[np.ndarray, "inner 3"]
) -> Float[np.ndarray, "knots 3"]:
    """Velocities at the knots: at the two events, that of a parabola to the frame beside them."""
    if not len(inner):
        chord = (places[1] - places[0]) / max(knots[1] - knots[0], 1e-9)
        return np.stack([chord, chord])
    at_start = 2 * (places[1] - places[0]) / max(knots[1] - knots[0], 1e-9) - inner[0]
    at_end = 2 * (places[-1] - places[-2]) / max(knots[-1] - knots[-2], 1e-9) - inner[-1]
    return np.concatenate([at_start[None], inner, at_end[None]])


def _sampled(
    knots: Float[np.ndarray, " knots"], places: Float[np.ndarray, "knots 3"], velocity: Float[np.ndarray, "knots 3"]
) -> tuple[Float[np.ndarray, " samples"], Float[np.ndarray, "samples 3"]]:
    """The cubic curve through places and velocities (Hermite's), `SAMPLES` pieces from knot to knot."""
    step = np.diff(knots)[:, None, None]
    share = np.arange(SAMPLES)[:, None] / SAMPLES
    h10, h01, h11 = share * (1 - share) ** 2, share**2 * (3 - 2 * share), share**2 * (share - 1)
    a, b = places[:-1, None], places[1:, None]
    curve = (1 - h01) * a + h01 * b + step * (h10 * velocity[:-1, None] + h11 * velocity[1:, None])
    curve[:, 0] = places[:-1]  # also where the ball was not placed in the frame after
    times = (knots[:-1, None] + np.diff(knots)[:, None] * share[:, 0]).reshape(-1)
    return np.append(times, knots[-1]), np.concatenate([curve.reshape(-1, 3), places[-1:]])


def _hitters(ball: ClipBall) -> Shaped[np.ndarray, " flights"]:
    """Who hit the ball last before each flight: the player, else the end of the court, else nothing."""
    shots, events = ball.shots, ball.events
    hitter = np.full(len(shots.start_event), "", dtype=object)
    last = ""
    for flight, start in enumerate(shots.start_event):
        if flight and start != shots.end_event[flight - 1]:
            last = ""
        if events.kind[start] == "hit":
            y = events.position[start, 1]
            end = "" if not np.isfinite(y) else "near end" if y < 0 else "far end"
            last = str(shots.player[flight]) or str(events.player[start]) or end
        hitter[flight] = last
    return hitter


def spin_class(
    spin: Float[np.ndarray, " 3"], spin_std: Float[np.ndarray, " 3"], velocity: Float[np.ndarray, " 3"]
) -> str:
    """Topspin, backspin or sidespin, where it is twice its standard deviation; `flat` where it is small and known.

    Empty where the spin was not free in the fit, or says nothing.
    """
    ahead = np.hypot(velocity[0], velocity[1])
    if not (np.isfinite(spin).all() and np.isfinite(spin_std).all() and ahead > 1e-6):
        return ""
    # Topspin turns about z x v: the ball's upper side moves ahead.
    top_axis = np.array([-velocity[1], velocity[0], 0.0]) / ahead
    top, side = float(spin @ top_axis), float(spin[2])
    top_std = float(np.sqrt((top_axis**2) @ spin_std**2))
    side_std = float(spin_std[2])
    if abs(top) >= abs(side) and abs(top) > max(2 * top_std, FLAT_RAD_S):
        return "topspin" if top > 0 else "backspin"
    if abs(side) > max(2 * side_std, FLAT_RAD_S):
        return "sidespin"
    return "flat" if max(top_std, side_std) < FLAT_RAD_S else ""
