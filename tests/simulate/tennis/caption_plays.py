"""Plays made by hand for captions: parabolas, smooth runs, every stroke and every outcome, and no tactics."""

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np

from pgm_data.simulate.body.figure import draw_figure
from pgm_data.simulate.flight.path import BallPath, Contact, Flight
from pgm_data.simulate.tennis.play import Athlete, Outcome, Plan, Play, Score, Shot, Stroke

LANDING_TO_HIT_S, SERVE_S = 0.55, 2.6
KINDS = ("drive", "drive", "slice", "volley", "half_volley", "smash", "lob", "drop")
OUTCOMES: tuple[Outcome, ...] = (
    "ace", "service_winner", "winner", "forced_error", "unforced_error", "fault", "double_fault", "let",
)  # fmt: skip
ENDS = ("out", "net")


@dataclass(frozen=True, eq=False, kw_only=True)
class Story:
    """What is to happen."""

    outcome: Outcome
    server: int
    rally: int
    """Strokes after the serve, where the outcome leaves room for them."""
    error: str
    """How an error ends: out or net."""
    swings_and_misses: bool


def athlete(rng: np.random.Generator, name: str) -> Athlete:
    hand = "left" if rng.random() < 0.3 else "right"
    return Athlete(
        identity=name, figure=draw_figure(rng, hand), backhand_hands=1 if rng.random() < 0.4 else 2, top_speed=7.0,
        acceleration=5.0, reaction_s=0.2, power=1.0, topspin=1.0, attacks_net=0.3, steadiness=1.0,
    )  # fmt: skip


def parabola(start: np.ndarray, end: np.ndarray, begin: float, finish: float, spin: np.ndarray) -> Flight:
    times = np.linspace(begin, finish, 6)
    t = (times - begin)[:, None]
    gravity = np.array([0.0, 0.0, -9.81])
    first = (end - start) / (finish - begin) - 0.5 * gravity * (finish - begin)
    return Flight(
        times=times, positions=start + first * t + 0.5 * gravity * t**2, velocities=first + gravity * t,
        spins=np.tile(spin, (6, 1)), drag_per_m=0.0,
    )  # fmt: skip


class Maker:
    """Adds contacts, flights, strokes and stations of the players one by one."""

    def __init__(self, rng: np.random.Generator, story: Story) -> None:
        self.rng, self.story = rng, story
        self.contacts: list[Contact] = []
        self.flights: list[Flight] = []
        self.strokes: list[Stroke] = []
        self.shots: list[Shot] = []
        self.stations: list[list[tuple[float, np.ndarray]]] = [[], []]
        self.result = "in"

    def fly(self, kind: str, end: np.ndarray, time: float, player: int = -1, spin: Any = (0.0, 0.0, 0.0)) -> None:
        last = self.contacts[-1]
        self.flights.append(parabola(last.position, end, last.time, time, np.array(spin)))
        self.contacts.append(Contact(time=time, kind=kind, player=player, position=end))  # pyright: ignore

    def stroke(self, player: int, kind: str, ball: np.ndarray, time: float, *, hit: bool = True) -> None:
        rng = self.rng
        side = "overhead" if kind in ("serve", "smash") else str(rng.choice(["forehand", "backhand"]))
        hands = int(rng.integers(1, 3)) if side == "backhand" else 1
        serve = kind == "serve"
        toss = np.array([ball[0], ball[1], 1.6]) if serve else np.full(3, np.nan)
        self.strokes.append(
            Stroke(
                player=player, time=time, kind=kind, side=side, hands=hands, ball=ball, hit=hit,  # pyright: ignore
                swing=np.array([0.0, 1.0 if player == 0 else -1.0, 0.0]), stretch=float(rng.random()),
                toss_time=time - 0.9 if serve else np.nan, toss=toss,
            )
        )  # fmt: skip
        feet = ball[:2] + rng.normal(0, 0.5, 2)
        self.stations[player].append((time, feet))
        if rng.random() < 0.6:
            self.stations[player].append((time + rng.uniform(0.3, 0.8), feet + rng.normal(0, 1.2, 2)))

    def shoot(self, time: float, result: str, *, serve: bool, taken: bool) -> tuple[np.ndarray, float]:
        """The last stroke's ball up to where it lands, or nearly; where that is, and when."""
        rng, stroke = self.rng, self.strokes[-1]
        sign = 1.0 if stroke.player == 0 else -1.0
        half = 1.0 if stroke.ball[0] * sign > 0 else -1.0
        depth = 6.35 if serve else 11.8
        aim = np.array([rng.uniform(-4.05, 4.05), rng.uniform(1.5, depth)])
        if serve:
            aim[0] = -half * abs(aim[0])
        landing = aim.copy()
        if result == "out":
            if rng.random() < 0.5:
                landing[1] = (6.4 if serve else 11.885) + rng.uniform(0.05, 2.0)
            else:
                landing[0] = (-half if serve else rng.choice([-1.0, 1.0])) * rng.uniform(4.2, 6.5)
        landing, aim = sign * landing, sign * aim
        spin = rng.normal(0, 200, 3)
        flight = rng.uniform(0.35, 0.9)
        shot: dict[str, Any] = {
            "stroke": len(self.strokes) - 1, "player": stroke.player, "contact": len(self.contacts) - 1, "aim": aim,
            "result": result, "spin_rpm": float(rng.normal(800, 1600)), "speed": float(rng.uniform(10, 60)),
        }  # fmt: skip
        if result == "net":
            share = abs(stroke.ball[1]) / (abs(stroke.ball[1]) + abs(landing[1]))
            x = stroke.ball[0] + share * (landing[0] - stroke.ball[0])
            self.fly("net", np.array([x, 0.0, 0.7]), time + share * flight, spin=spin)
            self.fly("bounce", np.array([x, -0.6 * sign, 0.033]), time + share * flight + 0.35)
            landing = np.full(2, np.nan)
        elif taken:
            landing = np.full(2, np.nan)
        else:
            if result == "let" or rng.random() < 0.04:
                x = (stroke.ball[0] + landing[0]) / 2
                self.fly("net", np.array([x, 0.0, 0.95]), time + 0.5 * flight, spin=spin)
            self.fly("bounce", np.array([*landing, 0.033]), time + flight, spin=spin)
        self.shots.append(Shot(landing=landing, **shot))
        self.result = result
        return (aim if result == "net" or taken else landing), self.contacts[-1].time


def make(rng: np.random.Generator, story: Story) -> Play:
    maker = Maker(rng, story)
    server, sign = story.server, (1.0 if story.server == 0 else -1.0)
    court = rng.choice([-1.0, 1.0])
    begin = SERVE_S + rng.uniform(-1.0, 1.0)
    ball = np.array([sign * court * rng.uniform(0.3, 2.0), -sign * 11.8, 2.7])
    maker.stations[server].append((0.0, np.array([ball[0] + rng.normal(0, 0.5), -sign * rng.uniform(12.0, 13.0)])))
    maker.stations[1 - server].append((0.0, np.array([rng.normal(0, 2), sign * rng.uniform(11.3, 15)])))
    maker.contacts.append(Contact(time=begin - 0.9, kind="first", player=-1, position=np.array([*ball[:2], 1.6])))
    maker.stroke(server, "serve", ball, begin)
    maker.fly("hit", ball, begin, server)
    ends_at_serve = {"ace": "in", "fault": story.error, "double_fault": story.error, "let": "let"}
    errs = story.outcome.endswith("error") or story.outcome == "service_winner"
    strokes = 0 if story.outcome in ends_at_serve else 1 if story.outcome == "service_winner" else story.rally
    player, time = server, begin
    for i in range(strokes + 1):
        last = i == strokes
        serve = i == 0
        result = ends_at_serve.get(story.outcome, "in") if serve else story.error if last and errs else "in"
        kind = KINDS[int(rng.integers(len(KINDS)))]
        taken = not last and not serve and kind in ("volley", "smash")
        place, time = maker.shoot(time, result, serve=serve, taken=taken)
        player = 1 - player
        if last:
            break
        time = maker.strokes[-1].time + rng.uniform(0.6, 1.0) if taken else time + rng.uniform(0.35, LANDING_TO_HIT_S)
        back = 1.0 if player == 0 else -1.0
        ball = np.array([place[0] * 1.15, 0.0, rng.uniform(0.3, 2.6)])
        ball[1] = -back * 2.5 if taken else place[1] - back * rng.uniform(1.5, 5.0)
        maker.stroke(player, kind, ball, time)
        maker.fly("hit", ball, time, player)
    ended = maker.strokes[-1].player
    if maker.result == "in":
        after = maker.contacts[-1]
        drop = after.position + np.array([0.0, 3.0 if ended == 0 else -3.0, 0.0])
        if story.swings_and_misses:
            maker.stroke(1 - ended, "drive", (after.position + drop) / 2 + [1.0, 0, 0.8], after.time + 0.4, hit=False)
        maker.fly("bounce", drop, after.time + 0.8)
    end = maker.contacts[-1].position + np.array([0.3, 0.1, 0.0])
    maker.fly("last", end, maker.contacts[-1].time + 0.5)
    duration = maker.contacts[-1].time + rng.uniform(0.0, 2.0)
    winner = ended if maker.result == "in" else 1 - ended
    plans = [plan(rng, player, maker.stations[player], duration) for player in (0, 1)]
    return Play(
        number=0, duration_s=duration, athletes=(athlete(rng, "a"), athlete(rng, "b")), identities=(0, 1),
        server=server,
        serve_number={"double_fault": 2, "fault": 1}.get(story.outcome, int(rng.integers(1, 3))),
        score=Score(sets=((0, 0),), points=("0", "0")), ball=BallPath(
            flights=tuple(maker.flights), contacts=tuple(maker.contacts)),
        strokes=tuple(maker.strokes), shots=tuple(maker.shots), plans=(plans[0], plans[1]), outcome=story.outcome,
        winner=-1 if story.outcome in ("fault", "let") else winner,
    )  # fmt: skip  # pyright: ignore[reportArgumentType]


def plan(rng: np.random.Generator, player: int, stations: list[tuple[float, np.ndarray]], duration: float) -> Plan:
    """Smooth runs from station to station, with a rest before some of them."""
    times = np.arange(int(np.floor(duration * 50)) + 1) / 50
    path = np.tile(stations[0][1], (len(times), 1))
    stations = sorted(stations, key=lambda s: s[0])
    for (t0, p0), (t1, p1) in itertools.pairwise([*stations, (duration + 2, stations[-1][1] + rng.normal(0, 2, 2))]):
        start = max(t0, t1 - np.linalg.norm(p1 - p0) / 3.0) if rng.random() < 0.7 else t0
        u = np.clip((times - start) / max(t1 - start, 0.02), 0, 1)
        blend = u * u * (3 - 2 * u)
        inside = times >= t0
        path[inside] = (p0 + blend[:, None] * (p1 - p0))[inside]
    net = 0.0 if player == 0 else np.pi
    velocity = np.gradient(path, axis=0) * 50
    along = np.arctan2(-velocity[:, 0], velocity[:, 1])
    turned = (along - net + np.pi) % (2 * np.pi) - np.pi
    speed = np.hypot(*velocity.T)
    heading = net + turned * np.clip((speed - 1.5) / 2.0, 0, 1) * (1.0 if rng.random() < 0.7 else 0.0)
    splits = np.sort(rng.uniform(0, duration, int(rng.integers(0, 4))))
    return Plan(times=times, path=path, heading=heading, splits=splits)


def stories(rng: np.random.Generator, count: int) -> list[Story]:
    """Every outcome at both ends in turn."""
    return [
        Story(
            outcome=OUTCOMES[i % len(OUTCOMES)], server=(i // len(OUTCOMES)) % 2, rally=int(rng.integers(1, 9)),
            error=ENDS[int(rng.integers(2))], swings_and_misses=bool(rng.random() < 0.3),
        )
        for i in range(count)
    ]  # fmt: skip


def plays(seed: int, count: int) -> list[Play]:
    """Plays of all outcomes, at both ends."""
    rng = np.random.default_rng(seed)
    return [make(rng, story) for story in stories(rng, count)]
