"""One play in time: serve, reactions, runs, strokes, until the ball is dead and the players walk off."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from pgm_data.simulate.body.reach import GROUND_REACH, LOWEST_BALL_M, contact_offset, pelvis_at_contact
from pgm_data.simulate.flight.course import FlightWorld, follow, truncated
from pgm_data.simulate.flight.path import BallPath, Contact, Flight
from pgm_data.simulate.tennis import shot_tables as tables
from pgm_data.simulate.tennis.choice import Intent, Situation, choose, choose_serve, prefers_one_hand
from pgm_data.simulate.tennis.execution import struck
from pgm_data.simulate.tennis.heading import headings
from pgm_data.simulate.tennis.interception import Approach, Chase, Meeting, Readiness, meet
from pgm_data.simulate.tennis.movement import RATE, braked, chased, cubic, recovered
from pgm_data.simulate.tennis.play import Athlete, Outcome, Plan, Play, Score, Shot, Stroke, StrokeKind
from pgm_data.simulate.tennis.runner import Runner, recover, walk_off
from pgm_data.simulate.tennis.serving import Due, Toss, toss_ball
from pgm_data.simulate.tennis.umpire import Verdict, judged

_FOLLOWED_S = 9.0
"""A shot is followed so far at most; the ball rolls by then."""
_CALL_S = 0.2
"""From a ball that lands out to the moment in which the players stop."""
_READ_SHARE = 0.6
"""How often a player reads a shot before it is hit."""
_NO_TIME = float("nan")
_NOWHERE = np.full(3, np.nan)
# How the racket head moves besides where the ball goes: upwards over forwards.
_RISE: dict[StrokeKind, float] = {
    "serve": 0.25, "drive": 0.55, "slice": -0.35, "volley": -0.25, "half_volley": 0.2, "smash": -0.15, "lob": 0.9,
    "drop": -0.6,
}  # fmt: skip


@dataclass(frozen=True, eq=False, kw_only=True)
class Start:
    """All that is settled before a play."""

    number: int
    athletes: tuple[Athlete, Athlete]
    """Near end, far end."""
    identities: tuple[int, int]
    server: int
    """0 near, 1 far."""
    right_court: bool
    second: bool
    score: Score
    world: FlightWorld


@dataclass(frozen=True, eq=False, kw_only=True)
class _Course:
    """The ball from one hit on, if nobody touches it again."""

    hitter: int
    time: float
    flights: list[Flight]
    contacts: list[Contact]
    """One more than flights: the hit first."""
    verdict: Verdict
    intent: Intent

    @property
    def path(self) -> BallPath:
        return BallPath(flights=tuple(self.flights), contacts=tuple(self.contacts))


class _Point:
    """A play while it happens."""

    def __init__(self, rng: np.random.Generator, start: Start) -> None:
        self.rng, self.start = rng, start
        self.strokes: list[Stroke] = []
        self.shots: list[Shot] = []
        self.flights: list[Flight] = []
        self.contacts: list[Contact] = []
        self.forced = False

    def hit(self, side: Runner, intent: Intent, stroke: Stroke) -> _Course:
        """The ball's new course after a stroke."""
        strike = struck(self.rng, intent, side.player, stroke.ball, self.start.world)
        flights, contacts = follow(
            stroke.ball, strike.velocity, strike.spin, stroke.time, self.start.world,
            until=stroke.time + _FOLLOWED_S, rng=self.rng,
        )  # fmt: skip
        contact = Contact(time=stroke.time, kind="hit", player=side.player, position=stroke.ball)
        contacts = [contact, *contacts]
        serve = intent.kind == "serve"
        verdict = judged(tuple(contacts), side.player, serve_from_right=self.start.right_court if serve else None)
        along = strike.velocity / np.linalg.norm(strike.velocity)
        swing = along + np.array([0.0, 0.0, _RISE[intent.kind]])
        self.strokes.append(replace(stroke, swing=swing / np.linalg.norm(swing)))
        self.shots.append(
            Shot(
                stroke=len(self.strokes) - 1,
                player=side.player,
                contact=len(self.contacts),
                aim=strike.target,
                landing=verdict.landing,
                result=verdict.result,
                spin_rpm=strike.topspin_rpm,
                speed=float(np.linalg.norm(strike.velocity)),
            )
        )
        return _Course(
            hitter=side.player, time=stroke.time, flights=flights, contacts=contacts, verdict=verdict, intent=intent
        )

    def keep(self, course: _Course, until: float) -> None:
        """Write down the course up to a time at which it is hit again."""
        # The contact that ends it is the next hit, which its own course brings.
        flights, ends = truncated(course.flights, course.contacts[1:], until)
        if not any(c.kind == "bounce" for c in ends):
            # Volleyed: it came down nowhere.
            self.shots[-1] = replace(self.shots[-1], landing=np.full(2, np.nan), result="in")
        self.flights += flights
        self.contacts += [course.contacts[0], *ends]


def played(rng: np.random.Generator, start: Start) -> Play:
    """One play from the wait before the serve to the walk after the point."""
    point = _Point(rng, start)
    server = start.server
    toss = toss_ball(
        rng, start.athletes[server], server, Due(right=start.right_court, second=start.second), start.world
    )
    sides = _places(rng, start, toss)
    course = _serve(point, sides, toss)
    while True:
        reply = _answered(point, sides[1 - course.hitter], sides[course.hitter], course)
        if reply is None:
            break
        course = reply
    dead = max(course.verdict.dead, course.time)
    return _finished(point, sides, course, dead)


def _places(rng: np.random.Generator, start: Start, toss: Toss) -> tuple[Runner, Runner]:
    """Both players where they wait."""
    receiver = 1 - start.server
    forward = 1.0 if receiver == 0 else -1.0
    across = tables.drawn(rng, tables.RECEIVER_SIDEWAYS) * (1.0 if start.right_court else -1.0)
    depth = tables.drawn(rng, tables.RECEIVER_DEPTH[2 if start.second else 1])
    places = [np.zeros(2), np.zeros(2)]
    places[start.server] = toss.stance
    places[receiver] = forward * np.array([across, -depth])
    return (Runner(start.athletes[0], 0, places[0]), Runner(start.athletes[1], 1, places[1]))


def _serve(point: _Point, sides: tuple[Runner, Runner], toss: Toss) -> _Course:
    """The toss and the serve."""
    rng, start = point.rng, point.start
    server, receiver = sides[start.server], sides[1 - start.server]
    intent = choose_serve(rng, server.athlete, right_court=start.right_court, second=start.second)
    stroke = Stroke(
        player=server.player,
        time=toss.contact_time,
        kind="serve",
        side="overhead",
        hands=1,
        ball=toss.contact,
        swing=np.array([0.0, server.forward, 0.0]),
        hit=True,
        stretch=0.0,
        toss_time=toss.time,
        toss=toss.release,
    )
    goal = pelvis_at_contact(server.athlete.figure, server.player, toss.contact[:2], "overhead", 1)
    final = np.array([0.0, server.forward * 0.9])
    rise = cubic(toss.time, toss.contact_time, toss.stance, np.zeros(2), goal, final)
    server.track.follow([rise, *braked(toss.contact_time, goal, final, server.limits)])
    server.turn(-1.0, toss.contact_time, "overhead", 1)
    # The receiver hops into the split step as the ball goes up.
    place, _ = receiver.track.at(0.0)
    step = place + np.array([0.0, receiver.forward * rng.uniform(0.1, 0.45)])
    receiver.track.follow(
        recovered(toss.contact_time - 0.7, toss.contact_time + 0.05, place, np.zeros(2), step, receiver.limits)
    )
    point.contacts.append(Contact(time=toss.time, kind="first", player=-1, position=toss.release))
    point.flights.append(toss.flight)
    return point.hit(server, intent, stroke)


def _answered(point: _Point, side: Runner, hitter: Runner, course: _Course) -> _Course | None:
    """What the other player makes of a course: the next one, or None where the ball is not played."""
    rng, verdict = point.rng, course.verdict
    side.splits.append(course.time + float(rng.uniform(0.0, 0.1)))
    recover(rng, hitter, side, course.time, course.intent, course.verdict)
    returns = course.intent.kind == "serve"
    # A server's toss gives away much before the contact, and some other swings do.
    early = 0.5 if returns or rng.random() < _READ_SHARE else 1.0
    react = course.time + early * side.athlete.reaction_s
    if np.isfinite(verdict.net):
        # Nobody knows where a ball goes that is about to touch the net.
        react = max(react, verdict.net + 0.75 * side.athlete.reaction_s)
    judgement = verdict.margin + 0.25 * rng.normal()
    one_hand = prefers_one_hand(rng, side.athlete, returns=returns)
    luck = rng.random()
    end = min(verdict.second_bounce, verdict.end)
    if verdict.result == "net" or react >= min(verdict.dead, end) - 0.05:
        side.brake(react)
        return None
    place, velocity = side.track.at(react)
    ready = Readiness(
        athlete=side.athlete,
        limits=side.limits,
        time=react,
        place=place,
        velocity=velocity,
        at_net=side.at_net,
        depth=float(rng.normal(*(tables.RETURN_DEPTH if returns else tables.GROUND_DEPTH))),
        height=float(rng.normal(*(tables.RETURN_HEIGHT if returns else tables.GROUND_HEIGHT))),
        one_hand=one_hand,
        returns=returns,
    )
    found = meet(ready, Approach(path=course.path, bounce=verdict.bounce, end=end))
    if isinstance(found, Meeting) and not (found.volley and judgement > 0.1):
        return _met(point, side, hitter, course, found, react)
    if isinstance(found, Chase) and judgement < 0.5:
        _chased(point, side, course, found, react, luck)
    else:
        side.brake(react)
    return None


def _met(point: _Point, side: Runner, hitter: Runner, course: _Course, found: Meeting, react: float) -> _Course | None:
    """The way to the ball and the stroke, if the ball is still in play then."""
    side.track.follow(found.way)
    dead = course.verdict.result in ("out", "let") and found.time > course.verdict.bounce
    if dead:
        stop = course.verdict.bounce + _CALL_S
        if stop < found.time:
            if stop > found.time - 0.6:
                side.turn(react, found.time, found.side, found.hands)
            side.brake(stop)
        return None
    side.turn(react, found.time, found.side, found.hands)
    opponent, _ = hitter.track.at(found.time)
    own_ball = np.array([side.forward * found.ball[0], side.forward * found.ball[1], found.ball[2]])
    seen = Situation(
        athlete=side.athlete,
        ball=own_ball,
        opponent=side.forward * opponent,
        weaker=1.0 if hitter.athlete.figure.hand == "right" else -1.0,
        side=found.side,
        hands=found.hands,
        stretch=found.stretch,
        effort=found.effort,
        pace=float(np.linalg.norm(found.incoming)),
        volley=found.volley,
        since_bounce=found.since_bounce,
        returns=course.intent.kind == "serve",
    )
    intent = choose(point.rng, seen)
    point.keep(course, found.time)
    point.forced = (
        found.stretch >= 0.25 or found.effort > 0.7 or seen.pace > 22.0 or (seen.returns and not point.start.second)
    )
    stroke = Stroke(
        player=side.player,
        time=found.time,
        kind=intent.kind,
        side=found.side,
        hands=found.hands,
        ball=found.ball,
        swing=np.array([0.0, side.forward, 0.0]),
        hit=True,
        stretch=found.stretch,
        toss_time=_NO_TIME,
        toss=_NOWHERE,
    )
    side.at_net = intent.attacks
    return point.hit(side, intent, stroke)


def _chased(point: _Point, side: Runner, course: _Course, found: Chase, react: float, luck: float) -> None:
    """A run after a ball that is out of reach, and perhaps a swing at it."""
    place, velocity = side.track.at(react)
    pieces = chased(react, found.time, place, velocity, found.goal, side.limits)
    side.track.follow(pieces)
    swings = found.time < course.verdict.dead and found.lateness < 2.0 and luck < 0.8
    if not swings:
        return
    where, _ = side.track.at(found.time)
    hands: Literal[1, 2] = 1
    offset = side.forward * contact_offset(side.athlete.figure, found.side, hands, 1.0)
    height = float(np.clip(found.ball[2], LOWEST_BALL_M + 0.1, GROUND_REACH * side.athlete.figure.height_m - 0.1))
    racket = np.array([*(where + offset), height])
    if np.linalg.norm(racket - found.ball) < 0.3:
        return
    side.turn(react, found.time, found.side, hands)
    point.strokes.append(
        Stroke(
            player=side.player,
            time=found.time,
            kind="volley" if found.time < course.verdict.bounce else "slice",
            side=found.side,
            hands=hands,
            ball=racket,
            swing=np.array([0.0, side.forward * 0.95, -0.3]) / np.hypot(0.95, 0.3),
            hit=False,
            stretch=1.0,
            toss_time=_NO_TIME,
            toss=_NOWHERE,
        )
    )


def _outcome(point: _Point, course: _Course) -> tuple[Outcome, int]:
    """What the play came to, and who won it (-1 for nobody)."""
    hitter, verdict = course.hitter, course.verdict
    first = len(point.shots) == 1
    if first and verdict.result == "let":
        return "let", -1
    if verdict.result != "in":
        if first:
            return ("double_fault", 1 - hitter) if point.start.second else ("fault", -1)
        return ("forced_error" if point.forced else "unforced_error"), 1 - hitter
    touched = any(not stroke.hit for stroke in point.strokes)
    if first:
        return ("service_winner" if touched else "ace"), hitter
    return "winner", hitter


def _finished(point: _Point, sides: tuple[Runner, Runner], course: _Course, dead: float) -> Play:
    """The seconds after the point, and all of it written down."""
    rng, start = point.rng, point.start
    outcome, winner = _outcome(point, course)
    duration = dead + float(rng.uniform(1.3, 3.0))
    duration = max(duration, max(s.time for s in point.strokes) + 0.6)
    for side in sides:
        walk_off(rng, side, dead)
    end = min(duration, course.contacts[-1].time)
    flights, ends = (course.flights, course.contacts[1:])
    if end < course.contacts[-1].time - 1e-9:
        flights, ends = truncated(flights, ends, end)
        ends = [*ends, Contact(time=end, kind="last", player=-1, position=flights[-1].positions[-1])]
    contacts = [course.contacts[0], *ends]
    shots = _settled(point.shots, ends)
    times = np.arange(int(np.ceil(duration * RATE)) + 1) / RATE
    plans = [
        Plan(
            times=times,
            path=(path := side.track.sampled(times)),
            heading=headings(path, side.player, side.athlete.figure.hand, side.turns),
            splits=np.array([t for t in side.splits if t < duration]),
        )
        for side in sides
    ]
    return Play(
        number=start.number,
        duration_s=float(times[-1]),
        athletes=start.athletes,
        identities=start.identities,
        server=start.server,
        serve_number=2 if start.second else 1,
        score=start.score,
        ball=BallPath(flights=tuple(point.flights + flights), contacts=tuple(point.contacts + contacts)),
        strokes=tuple(sorted(point.strokes, key=lambda s: s.time)),
        shots=shots,
        plans=(plans[0], plans[1]),
        outcome=outcome,
        winner=winner,
    )


def _settled(shots: list[Shot], ends: list[Contact]) -> tuple[Shot, ...]:
    """Shots with the last one's landing only if the play lasts until then."""
    if not any(c.kind == "bounce" for c in ends):
        shots = [*shots[:-1], replace(shots[-1], landing=np.full(2, np.nan))]
    return tuple(shots)
