"""Solved plays put together to one solution of a clip."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

from pgm_data.ball import BallEvents, BallTrack
from pgm_data.lift.ball.flight_model import air_law
from pgm_data.lift.ball.flown_on import come_down_rows
from pgm_data.lift.ball.rally_plays import APART_S, Play
from pgm_data.lift.ball.rally_rounds import PlayFit
from pgm_data.lift.ball.solution import BallSolution, Flights, FlightStatus
from pgm_data.lift.ball.world import BallWorld
from pgm_data.scene import Prior

MOST = 0.5
"""A flight that lost more than this share of its pixels as outliers rests on its neighbours."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Piece:
    """Contacts of a play that were solved together, or could not be."""

    play: Play
    solved: PlayFit | None
    """None where it could not be solved."""
    said: str


@dataclass(eq=False, kw_only=True)
class _Tables:
    """The arrays of a solution while pieces are put into them."""

    position: Float[np.ndarray, "frames 3"]
    velocity: Float[np.ndarray, "frames 3"]
    position_cov: Float[np.ndarray, "frames 3 3"]
    status: Shaped[np.ndarray, " frames"]
    event_time: Float[np.ndarray, " events"]
    event_position: Float[np.ndarray, "events 3"]
    event_cov: Float[np.ndarray, "events 3 3"]
    start_event: Int[np.ndarray, " flights"]
    end_event: Int[np.ndarray, " flights"]
    start_velocity: Float[np.ndarray, "flights 3"]
    start_velocity_cov: Float[np.ndarray, "flights 3 3"]
    spin: Float[np.ndarray, "flights 3"]
    spin_std: Float[np.ndarray, "flights 3"]
    drag: Float[np.ndarray, "flights 2"]
    landing: Float[np.ndarray, "flights 3"]
    landing_cov: Float[np.ndarray, "flights 3 3"]
    residual_px: Float[np.ndarray, " flights"]
    free: list[tuple[str, ...]]
    flight_status: list[FlightStatus]
    said: list[str]


def assemble(
    track: BallTrack, events: BallEvents, pieces: list[Piece], world: BallWorld, start: BallSolution | None
) -> BallSolution:
    """The solution that the pieces make; what they lack comes from `start`, and is marked so.

    Args:
        track: The ball in the picture.
        events: As given.
        pieces: In order of time.
        world: What the ball flies in.
        start: The line method's solution; None without one.
    """
    tables = _tables(track, events, pieces, world)
    flight = 0
    for piece in pieces:
        count = len(piece.play) - 1
        rows = np.arange(flight, flight + count)
        if piece.solved is not None:
            _put(tables, rows, piece, piece.solved, world)
        else:
            _borrow(tables, rows, piece, start, track, events)
        flight += count
    _fill_duplicates(tables, track)
    _fill_neighbours(tables, events)
    solved = [piece.solved for piece in pieces if piece.solved is not None]
    drag = _pooled([_posterior(s, s.fit.plan.layout.drag) for s in solved], world.drag_per_m)
    bounced = [s for s in solved if len(s.fit.plan.layout.bounce)]
    restitution = friction = None
    if bounced and world.restitution is not None and world.friction is not None:
        at = [(s, s.fit.plan.layout) for s in bounced]
        restitution = _pooled([_posterior(s, layout.restitution) for s, layout in at], world.restitution)
        friction = _pooled([_posterior(s, layout.friction) for s, layout in at], world.friction)
    counts = {word: tables.flight_status.count(word) for word in ("solved", "line", "fallback", "none")}
    said = ", ".join(f"{count} flights {word}" for word, count in counts.items() if count) or "no flights"
    times = np.maximum.accumulate(tables.event_time) if len(events) else tables.event_time
    return BallSolution(
        position=tables.position,
        velocity=tables.velocity,
        position_cov=tables.position_cov,
        status=tables.status,
        events=replace(events, times=times),
        event_position=tables.event_position,
        event_cov=tables.event_cov,
        flights=Flights(
            start_event=tables.start_event,
            end_event=tables.end_event,
            start_velocity=tables.start_velocity,
            start_velocity_cov=tables.start_velocity_cov,
            spin=tables.spin,
            spin_std=tables.spin_std,
            drag_per_m=tables.drag[:, 0].copy(),
            drag_std_per_m=tables.drag[:, 1].copy(),
            landing=tables.landing,
            landing_cov=tables.landing_cov,
            residual_px=tables.residual_px,
            free=tuple(tables.free),
            status=tuple(tables.flight_status),
            said=tuple(tables.said),
        ),
        drag=drag,
        restitution=restitution,
        friction=friction,
        cost=float(sum(s.fit.cost for s in solved)),
        said=said,
    )


def _tables(track: BallTrack, events: BallEvents, pieces: list[Piece], world: BallWorld) -> _Tables:
    frames, count = len(track.times), sum(len(piece.play) - 1 for piece in pieces)
    ends = [np.zeros((0, 2), dtype=int)]
    ends += [np.stack([piece.play.event[:-1], piece.play.event[1:]], axis=1) for piece in pieces]
    pairs = np.concatenate(ends)
    drag = np.tile([world.drag_per_m.mean, world.drag_per_m.std], (count, 1))
    return _Tables(
        position=np.full((frames, 3), np.nan),
        velocity=np.full((frames, 3), np.nan),
        position_cov=np.full((frames, 3, 3), np.nan),
        status=np.full(frames, "none", dtype=object),
        event_time=events.times.copy(),
        event_position=np.full((len(events), 3), np.nan),
        event_cov=np.full((len(events), 3, 3), np.nan),
        start_event=pairs[:, 0],
        end_event=pairs[:, 1],
        start_velocity=np.full((count, 3), np.nan),
        start_velocity_cov=np.full((count, 3, 3), np.nan),
        spin=np.full((count, 3), np.nan),
        spin_std=np.full((count, 3), world.spin_std),
        drag=drag,
        landing=np.full((count, 3), np.nan),
        landing_cov=np.full((count, 3, 3), np.nan),
        residual_px=np.full(count, np.nan),
        free=[()] * count,
        flight_status=["none"] * count,
        said=[""] * count,
    )


def _put(tables: _Tables, rows: np.ndarray, piece: Piece, solved: PlayFit, world: BallWorld) -> None:
    """Put a solved piece's frames, contacts and flights into the tables."""
    fit, known = solved.fit, solved.information
    plan, layout, y = fit.plan, fit.plan.layout, fit.unknowns
    at = plan.frames.index[plan.picture]
    tables.position[at], tables.velocity[at] = fit.states[:, :3], fit.states[:, 3:]
    tables.position_cov[at] = known.position_cov
    tables.status[at] = np.where(plan.frames.measured[plan.picture], "measured", "filled")
    event = piece.play.event
    tables.event_time[event] = fit.times
    tables.event_position[event] = y[layout.position]
    tables.event_cov[event] = known.covariance(layout.position)
    tables.start_velocity[rows] = y[layout.after]
    tables.start_velocity_cov[rows] = known.covariance(layout.after)
    tables.spin[rows] = np.where(solved.spin_free[:, None], y[layout.spin], np.nan)
    tables.spin_std[rows] = known.std(layout.spin)
    tables.drag[rows] = y[layout.drag], known.std(np.array([layout.drag]))[0]
    tables.landing[rows], tables.landing_cov[rows] = _landings(piece, solved, world)
    residual = (fit.residual_px**2).sum(axis=1)
    measured = np.isfinite(residual)
    for i, row in enumerate(rows):
        own = measured & (plan.picture_flight == i)
        if own.any():
            tables.residual_px[row] = np.sqrt(residual[own].mean())
        words = ["position", "velocity"]
        words += ["spin"] if solved.spin_free[i] else []
        words += ["drag"] if solved.drag_free else []
        words += ["restitution", "friction"] if len(layout.bounce) else []
        words += ["time"] if not plan.held[layout.time[[i, i + 1]]].all() else []
        tables.free[row] = tuple(words)
        tables.flight_status[row] = "solved"
        tables.said[row] = piece.said
        if solved.kept[i] < MOST:
            tables.flight_status[row] = "fallback"
            left = f"{1 - solved.kept[i]:.0%} of its pixels left out as outliers, placed from its neighbours"
            tables.said[row] = f"{piece.said}; {left}"


def _landings(piece: Piece, solved: PlayFit, world: BallWorld) -> tuple[np.ndarray, np.ndarray]:
    """Where each flight of a piece first meets the ground, and the covariance of that."""
    fit, known = solved.fit, solved.information
    layout, y = fit.plan.layout, fit.unknowns
    each = np.arange(layout.pattern.flights)
    grounded = np.array([kind == "bounce" for kind in piece.play.kinds])[1:]
    columns = np.concatenate(
        [layout.position[1:], layout.before, layout.spin, np.full((len(each), 1), layout.drag)], axis=1
    )
    landing, rows = come_down_rows(
        y[columns[:, :6]], y[layout.spin], np.full(len(each), y[layout.drag]), air_law(world), world.radius_m
    )
    cov = rows @ known.covariance(columns) @ np.swapaxes(rows, 1, 2)
    landing[grounded] = y[layout.position[1:]][grounded]
    cov[grounded] = known.covariance(layout.position[1:])[grounded]
    # Off a table the ball falls further: where to is not known.
    if world.floor_z < 0:
        beside = (np.abs(landing[:, :2]) > np.array(world.ground_half_size)).any(axis=1) & ~grounded
        landing[beside] = np.nan
    lost = ~np.isfinite(landing).all(axis=1) | ~np.isfinite(cov).all(axis=(1, 2))
    landing[lost], cov[lost] = np.nan, np.nan
    return landing, cov


def _borrow(
    tables: _Tables, rows: np.ndarray, piece: Piece, start: BallSolution | None, track: BallTrack, events: BallEvents
) -> None:
    """Put what the line method says of a piece's flights into the tables."""
    for row in rows:
        tables.said[row] = piece.said
        if start is None:
            continue
        flights = start.flights
        same = (flights.start_event == tables.start_event[row]) & (flights.end_event == tables.end_event[row])
        found = np.flatnonzero(same)
        if not len(found) or flights.status[found[0]] == "none":
            continue
        i = int(found[0])
        first, last = int(tables.start_event[row]), int(tables.end_event[row])
        span = (track.times >= start.events.times[first]) & (track.times <= start.events.times[last])
        here = span & np.asarray(start.status != "none", dtype=bool) & (tables.status == "none")
        tables.position[here], tables.velocity[here] = start.position[here], start.velocity[here]
        tables.position_cov[here] = start.position_cov[here]
        tables.status[here] = start.status[here]
        for k in (first, last):
            if not np.isfinite(tables.event_position[k]).all():
                tables.event_position[k], tables.event_cov[k] = start.event_position[k], start.event_cov[k]
                tables.event_time[k] = start.events.times[k]
        tables.start_velocity[row] = flights.start_velocity[i]
        tables.start_velocity_cov[row] = flights.start_velocity_cov[i]
        tables.drag[row] = flights.drag_per_m[i], flights.drag_std_per_m[i]
        tables.landing[row], tables.landing_cov[row] = flights.landing[i], flights.landing_cov[i]
        tables.residual_px[row] = flights.residual_px[i]
        tables.free[row] = flights.free[i]
        tables.flight_status[row] = "fallback" if flights.status[i] == "fallback" else "line"
        tables.said[row] = f"{piece.said}; {flights.said[i]}".rstrip("; ")


def _fill_duplicates(tables: _Tables, track: BallTrack) -> None:
    """Give repeated pictures the ball of the picture that they repeat."""
    repeats: Bool[np.ndarray, " frames"] = track.is_duplicate | np.append(False, np.diff(track.times) <= 1e-6)
    for frame in np.flatnonzero(repeats):
        source = frame - 1
        if source >= 0 and tables.status[source] != "none" and tables.status[frame] == "none":
            if track.times[frame] - track.times[source] > 1e-6:
                continue
            tables.position[frame], tables.velocity[frame] = tables.position[source], tables.velocity[source]
            tables.position_cov[frame] = tables.position_cov[source]
            tables.status[frame] = "filled"


def _fill_neighbours(tables: _Tables, events: BallEvents) -> None:
    """Give an event that stood beside a contact, such as `first` beside a hit, the contact's place."""
    for k in range(len(events)):
        if np.isfinite(tables.event_position[k]).all():
            continue
        for other in (k - 1, k + 1):
            if 0 <= other < len(events) and abs(events.times[k] - events.times[other]) < APART_S:
                tables.event_position[k], tables.event_cov[k] = tables.event_position[other], tables.event_cov[other]
                tables.event_time[k] = tables.event_time[other]


def _posterior(solved: PlayFit, place: int) -> Prior:
    return Prior(mean=float(solved.fit.unknowns[place]), std=float(solved.information.std(np.array([place]))[0]))


def _pooled(posteriors: list[Prior], prior: Prior) -> Prior:
    """One posterior of plays that each started from the same prior."""
    precision = 1 / prior.std**2
    pull = prior.mean * precision
    for found in posteriors:
        gained = max(1 / found.std**2 - 1 / prior.std**2, 0.0)
        if gained > 0:
            # What the play's own data said: its posterior with the prior taken out.
            pull += found.mean / found.std**2 - prior.mean / prior.std**2
            precision += gained
    return Prior(mean=float(pull / precision), std=float(1 / np.sqrt(precision)))
