"""A solution as it is written, play by play."""

import numpy as np

from pgm_data.ball import BallEvents, BallTrack
from pgm_data.lift.ball.line_adjust import Adjusted
from pgm_data.lift.ball.line_keyframes import TOGETHER_S
from pgm_data.lift.ball.line_path import FASTEST
from pgm_data.lift.ball.line_place import PlacedPlay
from pgm_data.lift.ball.solution import BallSolution, Flights, FlightStatus
from pgm_data.scene import Prior

FREE = ("position", "velocity", "time")


class Writing:
    """Frames, events and flights of a clip, filled in any order; what is not filled is `none`."""

    def __init__(self, track: BallTrack, events: BallEvents, drag: Prior) -> None:
        frames, count = len(track.times), len(events)
        self.events, self.drag, self.times = events, drag, track.times
        self.position, self.velocity = np.full((frames, 3), np.nan), np.full((frames, 3), np.nan)
        self.position_cov = np.full((frames, 3, 3), np.nan)
        self.status = np.full(frames, "none", dtype=object)
        self.event_times = events.times.copy()
        self.event_position = np.full((count, 3), np.nan)
        self.event_cov = np.full((count, 3, 3), np.nan)
        self.flights: list[_Flight] = []
        self.cost = 0.0

    def nothing(self, start: int, end: int, why: str) -> None:
        """A flight between two events that is not placed."""
        self.flights.append(_Flight(start, end, "none", why))

    def play(self, contacts: np.ndarray, rows: np.ndarray, solved: Adjusted, placed: PlacedPlay) -> None:
        """A run of contacts, and the frames between them."""
        fine = np.isfinite(placed.position).all(axis=1) & np.isfinite(placed.position_cov).all(axis=(1, 2))
        fine &= np.isfinite(placed.velocity).all(axis=1)
        if not np.isfinite(placed.contact_cov).all():
            for one, two in zip(contacts[:-1], contacts[1:], strict=True):
                self.nothing(int(one), int(two), "what it leaves open has no bounds")
            return
        flights = len(contacts) - 1
        speed = np.linalg.norm(placed.start_velocity, axis=1)
        flown = speed < FASTEST
        own = np.searchsorted(solved.unknowns.times, self.times[rows], side="right") - 1
        fine &= flown[np.clip(own, 0, flights - 1)]
        status = np.full(len(rows), "filled", dtype=object)
        status[placed.seen] = "measured"
        self.position[rows[fine]] = placed.position[fine]
        self.velocity[rows[fine]] = placed.velocity[fine]
        self.position_cov[rows[fine]] = placed.position_cov[fine]
        self.status[rows[fine]] = status[fine]
        self.event_times[contacts] = solved.unknowns.times
        held = np.append(flown, False) | np.append(False, flown)
        self.event_position[contacts[held]] = solved.unknowns.places[held]
        self.event_cov[contacts[held]] = placed.contact_cov[held]
        self.cost += solved.cost
        for f in range(flights):
            if not flown[f]:
                self.nothing(int(contacts[f]), int(contacts[f + 1]), f"no ball flies at {speed[f]:.0f} m/s")
                continue
            flight = _Flight(int(contacts[f]), int(contacts[f + 1]), "solved", "by the line method")
            flight.velocity, flight.velocity_cov = placed.start_velocity[f], placed.start_velocity_cov[f]
            if np.isfinite(placed.landing_cov[f]).all():
                flight.landing, flight.landing_cov = placed.landing[f], placed.landing_cov[f]
            flight.residual = float(placed.residual_px[f])
            self.flights.append(flight)

    def solution(self) -> BallSolution:
        """What was written."""
        order = sorted(self.flights, key=lambda flight: (flight.start, flight.end))
        count = len(order)
        placed = np.array([flight.status == "solved" for flight in order], dtype=bool)
        said = f"{placed.sum()} of {count} flights placed" if count else "no two contacts bound a flight"
        return BallSolution(
            position=self.position,
            velocity=self.velocity,
            position_cov=self.position_cov,
            status=self.status,
            events=self._events(),
            event_position=self.event_position,
            event_cov=self.event_cov,
            flights=Flights(
                start_event=np.array([flight.start for flight in order], dtype=np.int64),
                end_event=np.array([flight.end for flight in order], dtype=np.int64),
                start_velocity=_rows([flight.velocity for flight in order], (3,)),
                start_velocity_cov=_rows([flight.velocity_cov for flight in order], (3, 3)),
                spin=np.full((count, 3), np.nan),
                spin_std=np.full((count, 3), np.nan),
                drag_per_m=np.where(placed, self.drag.mean, np.nan),
                drag_std_per_m=np.where(placed, self.drag.std, np.nan),
                landing=_rows([flight.landing for flight in order], (3,)),
                landing_cov=_rows([flight.landing_cov for flight in order], (3, 3)),
                residual_px=np.array([flight.residual for flight in order], dtype=float),
                free=tuple(FREE if flight.status == "solved" else () for flight in order),
                status=tuple(flight.status for flight in order),
                said=tuple(flight.said for flight in order),
            ),
            drag=self.drag,
            restitution=None,
            friction=None,
            cost=float(self.cost),
            said=said,
        )

    def _events(self) -> BallEvents:
        """The events at their times as solved, those that stand at a contact with it."""
        given, times = self.events, self.event_times.copy()
        solid = np.flatnonzero(~np.isin(given.kinds, ("first", "last")))
        for row in np.flatnonzero(np.isin(given.kinds, ("first", "last"))):
            gaps = np.abs(given.times[solid] - given.times[row])
            if len(gaps) and gaps.min() < TOGETHER_S:
                beside = int(solid[np.argmin(gaps)])
                times[row] = times[beside]
                self.event_position[row], self.event_cov[row] = self.event_position[beside], self.event_cov[beside]
        return BallEvents(
            times=np.maximum.accumulate(times),
            kinds=given.kinds,
            probability=given.probability,
            time_std=given.time_std,
            sources=given.sources,
            players=given.players,
            ground_px=given.ground_px,
        )


class _Flight:
    def __init__(self, start: int, end: int, status: FlightStatus, said: str) -> None:
        self.start, self.end, self.said = start, end, said
        self.status: FlightStatus = status
        self.velocity, self.velocity_cov = np.full(3, np.nan), np.full((3, 3), np.nan)
        self.landing, self.landing_cov = np.full(3, np.nan), np.full((3, 3), np.nan)
        self.residual = float("nan")


def _rows(values: list[np.ndarray], shape: tuple[int, ...]) -> np.ndarray:
    return np.array(values, dtype=float).reshape(len(values), *shape)
