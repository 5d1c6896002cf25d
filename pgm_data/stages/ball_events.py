"""What happens to a ball, decided: several readings of its track are placed in metres, and the one that holds is kept.

The finder that knows the picture alone tells hits from bounces well, and lists or leaves out the bounces of a ball that
is no longer in play; the search by flights needs a camera and finds contacts that the picture hides. Each reading is
solved by the line method, and judged by the frames that its flights explain.
"""

from dataclasses import dataclass, field

import numpy as np

from pgm_data.ball import BallEvents, BallTrack, no_events
from pgm_data.ball_marks import CONTACTS, merge_events
from pgm_data.geometry.camera import Camera
from pgm_data.lift.ball.line_solve import LineOptions, solve_line
from pgm_data.lift.ball.solution import BallSolution, PlayersAt
from pgm_data.lift.ball.world import BallWorld
from pgm_data.lift.camera_doubt import CameraDoubt, no_doubt

SAME_FRAMES = 2.0
"""Frames within which a detected contact and a marked one are the same."""
LONGEST_FLIGHT_S = 4.0
"""Between contacts of one play, s: that of a high lob."""
UNEXPLAINED = 4.5
"""Cost of a measured frame that lies in no flight, or far from its own: that of three standard deviations, nats."""
SURPRISES = {
    "hit": 2.0,
    "bounce": 4.0,
    "net": 5.0,
    "hit hit": 4.5,
    "first bounce": 0.5,
    "hit bounce": 0.5,
    "first last": 4.0,
    "hit last": 3.0,
}
"""Cost of a contact, nats, by what it is or by what was before it: what it must explain to be believed. A shot bounces
once as a rule: one that is hit, or ends, without a bounce needs reasons too."""
ENOUGH = 1.5
"""Cost a measured frame, nats, at which no further reading is tried."""
MODEL_PX = 1.0
"""What flights of real balls leave unexplained, px: wind, spin that decays, the racket's own blur."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Surroundings:
    """What is known around a ball's track."""

    camera: Camera
    """One camera a frame; NaN where a frame has none."""
    size: tuple[int, int]
    """Width and height of the picture, px."""
    doubt: CameraDoubt = field(default_factory=no_doubt)
    players: PlayersAt | None = None
    marks: BallEvents = field(default_factory=no_events)
    """A person's events; they override what is detected."""


def solved_by_line(track: BallTrack, events: BallEvents, around: Surroundings, world: BallWorld) -> BallSolution:
    """The events placed by the line method."""
    return solve_line(
        track, events, around.camera, world=world, doubt=around.doubt, players=around.players, options=LineOptions()
    )


def read_events(track: BallTrack, around: Surroundings, world: BallWorld) -> tuple[BallEvents, BallSolution]:
    """The reading of the track that holds best, its times as they were read, and how the line method places it.

    A person's list is complete for the kinds it holds: with hits and bounces in it nothing is looked for.
    """
    marked = set(around.marks.kinds)
    if {"hit", "bounce"} <= marked or ("hit" in marked and not world.bounces):
        return around.marks, solved_by_line(track, around.marks, around, world)
    readings = picture_readings(track, around, world)
    solutions = [solved_by_line(track, events, around, world) for events in readings]
    costs = [unexplained(track, solution) for solution in solutions]
    if min(costs) > ENOUGH * max(int(track.measured.sum()), 1):
        readings.append(flight_reading(track, readings[-1], around, world))
        solutions.append(solved_by_line(track, readings[-1], around, world))
        costs.append(unexplained(track, solutions[-1]))
    best = int(np.argmin(costs))
    return readings[best], solutions[best]


def picture_readings(track: BallTrack, around: Surroundings, world: BallWorld) -> list[BallEvents]:
    """What may have happened by the picture alone: in play, and with the bounces after it; marks rule each."""
    from pgm_data.detect.ball.track_events import TrackEventOptions, find_events
    from pgm_data.detect.ball.track_network import TrackEventNetwork

    network = TrackEventNetwork.load(TrackEventOptions().network)
    found: list[BallEvents] = []
    for least_live in (TrackEventOptions().least_live, 0.0):
        options = TrackEventOptions(least_live=least_live)
        events = find_events(track, size=around.size, options=options, network=network)
        if not world.bounces:
            events = events.take(np.flatnonzero(events.kinds != "bounce"))
        merged = within_play(
            merge_events(events, around.marks, within_s=SAME_FRAMES * frame_s(track), complete_kinds=True)
        )
        if not any(len(merged) == len(one) and (merged.times == one.times).all() for one in found):
            found.append(merged)
    return found


def within_play(events: BallEvents) -> BallEvents:
    """The events without detected bounds of a play inside of it: a person's contact lies right beyond them.

    The ball is first seen after a hit where it was missed or out of the picture; the play began with the hit all the
    same.
    """
    if len(events) < 2:
        return events
    detected = events.sources != "human"
    marked = np.isin(events.kinds, CONTACTS) & ~detected
    gap = np.diff(events.times)
    late = marked[:-1] & detected[1:] & (events.kinds[1:] == "first") & (gap <= LONGEST_FLIGHT_S)
    early = detected[:-1] & marked[1:] & (events.kinds[:-1] == "last") & (gap <= LONGEST_FLIGHT_S)
    # A contact between two plays is of the one that is nearer.
    both = early[:-1] & late[1:]
    nearer = gap[:-1] <= gap[1:]
    late[1:] &= ~(both & nearer)
    early[:-1] &= ~(both & ~nearer)
    return events.take(np.flatnonzero(~(np.append(False, late) | np.append(early, False))))


def flight_reading(track: BallTrack, hints: BallEvents, around: Surroundings, world: BallWorld) -> BallEvents:
    """What may have happened by the flights that fit between contacts; marks rule."""
    from pgm_data.lift.ball.contacts import ContactOptions, place_events

    placed = place_events(track, hints, around.camera, world=world, players=around.players, options=ContactOptions())
    stray = np.isin(placed.kinds, list(set(around.marks.kinds))) & (placed.sources != "human")
    return within_play(placed.take(np.flatnonzero(~stray)))


def frame_s(track: BallTrack) -> float:
    """Time between distinct pictures, s; that of 25 a second where there are no two."""
    steps = np.diff(np.unique(track.times))
    return float(np.median(steps)) if len(steps) else 0.04


def unexplained(track: BallTrack, solution: BallSolution) -> float:
    """What a reading leaves unexplained and what it claims, nats: lower is better."""
    flights, times = solution.flights, solution.events.times
    measured = track.measured
    inside = np.zeros(len(track.times), dtype=bool)
    cost = 0.0
    for flight in range(len(flights)):
        start, end = times[flights.start_event[flight]], times[flights.end_event[flight]]
        own = measured & (track.times >= start) & (track.times <= end) & ~inside
        if not own.any() or flights.status[flight] == "none" or not np.isfinite(flights.residual_px[flight]):
            continue
        inside |= own
        variance = float(np.median(track.sigma_px[own])) ** 2 + MODEL_PX**2
        # Rms of 2D distances: two coordinates a frame.
        cost += own.sum() * min(0.5 * flights.residual_px[flight] ** 2 / variance, UNEXPLAINED)
    return float(cost + UNEXPLAINED * (measured & ~inside).sum() + surprise(solution.events))


def surprise(events: BallEvents) -> float:
    """How unusual the course of play is, nats: what a person says costs nothing, and a bounce after a hit little."""
    cost, before = 0.0, ""
    for kind, probability, source in zip(events.kinds, events.probability, events.sources, strict=True):
        course = "bounce" if kind == "bounce" and before in ("bounce", "net") else f"{before} {kind}"
        before = kind if kind != "first" or before != "hit" else before
        if source != "human":
            cost += SURPRISES.get(course, SURPRISES.get(str(kind), 0.0)) - float(np.log(max(probability, 0.05)))
    return cost
