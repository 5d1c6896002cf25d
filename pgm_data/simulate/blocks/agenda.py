"""What the player of one shot sets out to do, and the course that comes of it."""

from dataclasses import dataclass, field

import numpy as np

from pgm_data.simulate.blocks.course import Course, Stretch, StretchKind, joined
from pgm_data.simulate.blocks.moves import (
    CLIMB_DOWN_SPEED,
    CLIMB_UP_SPEED,
    GRAVITY,
    JUMP_M,
    LEAVE_M,
    SPRINT_SPEED,
    STAIRS_SPEED,
    WALK_SPEED,
    Arc,
    hop,
    resampled,
    travel_times,
)
from pgm_data.simulate.blocks.navigation import Move, MoveKind, Spot, Ways, centre, find_way, spots_on, straight_free
from pgm_data.simulate.blocks.world import BlockWorld, body_fits

KNOT_M = 0.015
HOP_PLACES = np.array([[0.0, 0.0, z] for z in (0.0, 0.6, JUMP_M)])
BEND_M = 0.45
TIGHT_M = 0.15
"""Setback of bends beside steps, ladders and landings."""
STEP_FROM_M, STEP_TO_M = 0.0, 0.17
"""Where, from the middle of the column before, the feet rise onto a step."""
STEP_HELD_M = 0.21
"""Where the body's box comes over it."""
EDGE_SPEED = 2.4
"""Off a ladder's top and backwards onto it, m/s."""
UNHELD_M = 0.25
"""From the middle of the ladder's column to where the body's box comes over the wall."""
TOUCH_S = 0.06
"""Least time on the ground between two jumps."""
SHARP = np.radians(50)
"""A larger change of direction is made standing."""


@dataclass(eq=False)
class _Pen:
    """The player while the course is drawn."""

    world: BlockWorld
    ways: Ways
    rng: np.random.Generator
    spot: Spot
    at: np.ndarray
    heading: float
    time: float = 0.0
    speed: float = 0.0
    goal: int = -1
    stretches: list[Stretch] = field(default_factory=list)

    def add(self, kind: StretchKind, times: np.ndarray, points: np.ndarray, headings: np.ndarray, grounded: np.ndarray):
        """Append a stretch of times counted from now, and stand at its end."""
        self.stretches.append(
            Stretch(
                kind=kind,
                times=self.time + times,
                points=points,
                grounded=grounded,
                headings=headings,
                goal=self.goal,
            )
        )
        self.time += float(times[-1])
        self.at = points[-1].copy()
        self.heading = float(headings[-1])

    def hold(self, seconds: float, turn: float = 0.0) -> None:
        """Stand, or turn by an angle on the spot."""
        share = np.linspace(0, 1, max(int(seconds / 0.02), 1) + 1)
        headings = self.heading + turn * share**2 * (3 - 2 * share)
        ones = np.ones(len(share), dtype=bool)
        self.speed = 0.0
        self.add("turn" if turn else "stand", seconds * share, np.tile(self.at, (len(share), 1)), headings, ones)

    def face(self, heading: float, least: float = SHARP) -> None:
        """Turn the shorter way towards a heading where it is further off than `least`."""
        turn = (heading - self.heading + np.pi) % (2 * np.pi) - np.pi
        if abs(turn) > least:
            self.hold(0.1 + abs(turn) / 8.0, turn)

    def fly(self, kind: StretchKind, arc: Arc, end_height: float, lands_on: int) -> None:
        """Jump or fall along an arc, after a moment on the ground."""
        if self.stretches[-1].arc is not None:
            self.hold(TOUCH_S)
        times = np.linspace(0, arc.duration, 25)
        points = arc.at(times)
        points[-1, 2] = end_height
        moving = arc.distances[-1] > 0
        heading = _heading(arc.direction) if moving else self.heading
        heading = self.heading + (heading - self.heading + np.pi) % (2 * np.pi) - np.pi
        self.stretches.append(
            Stretch(
                kind=kind,
                times=self.time + times,
                points=points,
                grounded=np.zeros(25, dtype=bool),
                headings=np.full(25, heading),
                arc=arc,
                goal=self.goal,
                lands_on=lands_on,
            )
        )
        self.time += arc.duration
        self.at = points[-1].copy()
        self.heading = heading
        self.speed = arc.last_speed


def draw_course(rng: np.random.Generator, world: BlockWorld, ways: Ways, seconds: float) -> Course:
    """A course of at least so many seconds through the world."""
    spots = sorted(ways.home)
    spot = spots[int(rng.integers(len(spots)))]
    pen = _Pen(world, ways, rng, spot, centre(spot), float(rng.uniform(-np.pi, np.pi)))
    targets = [frozenset(spots_on(ways, e)) for e in world.elements]
    reachable = [n for n, own in enumerate(targets) if own]
    pen.hold(float(rng.uniform(0.2, 0.9)))
    while pen.time < seconds + 1.0:
        choice = rng.random()
        if choice < 0.62 and reachable:
            number = reachable[int(rng.integers(len(reachable)))]
            own = sorted(targets[number])
            # Often a chosen place on it, else wherever one arrives first.
            goals = targets[number] if rng.random() < 0.5 else frozenset([own[int(rng.integers(len(own)))]])
            _go(pen, goals, number)
        elif choice < 0.82:
            near = [s for s in spots if 2.5 <= np.hypot(s[0] - pen.spot[0], s[1] - pen.spot[1]) <= 8.0]
            _go(pen, frozenset([near[int(rng.integers(len(near)))]] if near else []), -1)
        elif choice < 0.89 and body_fits(world, pen.at + HOP_PLACES).all():
            for _ in range(int(rng.integers(1, 4))):
                pen.goal = -1
                pen.fly("jump", hop(pen.at), pen.at[2], element_at(world, pen.spot))
                pen.speed = 0.0
                pen.hold(float(rng.uniform(0.08, 0.2)))
        else:
            pen.goal = -1
            turn = float(rng.choice([-1, 1]) * rng.uniform(0.5, 2 * np.pi))
            pen.hold(abs(turn) / float(rng.uniform(2.5, 5.0)), turn)
        if rng.random() < 0.45:
            pen.goal = -1
            pen.hold(float(rng.uniform(0.3, 1.6)))
    return joined(pen.stretches)


def element_at(world: BlockWorld, spot: Spot) -> int:
    """Index of the element whose top a spot is; -1 where it is none's."""
    for number, element in enumerate(world.elements):
        if ((element.columns == spot[:2]).all(axis=1) & (element.levels == spot[2])).any():
            return number
    return -1


def _go(pen: _Pen, goals: frozenset[Spot], goal: int) -> None:
    """Walk or run, jump, fall and climb to one of the goals."""
    kinds: tuple[MoveKind, ...] = ("walk", "step", "jump", "drop", "climb_up", "climb_down")
    factors = np.exp(pen.rng.uniform(0.0, (0.7, 0.7, 1.2, 2.3, 1.0, 0.3)))
    taste: dict[MoveKind, float] = {k: float(v) for k, v in zip(kinds, factors, strict=True)}
    if pen.rng.random() < 0.25:
        # Now and then by stairs and ladders only, where there is a choice.
        taste["jump"] = taste["drop"] = 8.0
    moves = find_way(pen.ways, pen.spot, goals, taste)
    sprints = pen.rng.random() < 0.5
    straight = pen.rng.random() < 0.7
    pen.goal = goal
    first = 0
    while first < len(moves):
        last = first
        while last < len(moves) and moves[last].kind in ("walk", "step"):
            last += 1
        then = moves[last] if last < len(moves) else None
        _run(pen, moves[first:last], then, sprints=sprints, straight=straight)
        if then is not None:
            _special(pen, then)
        first = last + 1
        pen.spot = moves[min(first, len(moves)) - 1].end


def _special(pen: _Pen, move: Move) -> None:
    lands_on = element_at(pen.world, move.end)
    if move.arc is not None:
        pen.face(_heading(move.arc.direction))
        pen.fly("jump" if move.kind == "jump" else "fall", move.arc, centre(move.end)[2], lands_on)
        return
    wall = centre(move.end if move.kind == "climb_up" else move.start)
    foot = centre(move.start if move.kind == "climb_up" else move.end)
    heading = _heading(wall[:2] - foot[:2])
    pen.face(heading, least=np.radians(8))
    heading = pen.heading + (heading - pen.heading + np.pi) % (2 * np.pi) - np.pi
    if move.kind == "climb_up":
        _straight(pen, "climb_up", wall[2] - foot[2], foot * [1, 1, 0] + [0, 0, wall[2]], CLIMB_UP_SPEED, heading)
        pen.stretches[-1] = _landed(pen.stretches[-1], lands_on)
        _straight(pen, "walk", 1.0, wall, EDGE_SPEED, heading, firm=(UNHELD_M, 1.0))
        pen.speed = EDGE_SPEED
    else:
        top = foot * [1, 1, 0] + [0, 0, wall[2]]
        _straight(pen, "walk", 1.0, top, EDGE_SPEED, heading, firm=(0.0, 1.0 - UNHELD_M))
        _straight(pen, "climb_down", wall[2] - foot[2], foot, CLIMB_DOWN_SPEED, heading)
        pen.speed = 0.0


def _landed(stretch: Stretch, lands_on: int) -> Stretch:
    return Stretch(**{**vars(stretch), "lands_on": lands_on})


def _straight(
    pen: _Pen,
    kind: StretchKind,
    metres: float,
    end: np.ndarray,
    speed: float,
    heading: float,
    firm: tuple[float, float] = (2.0, 2.0),
) -> None:
    """Move to a point in a straight line, looking along a heading; on firm ground between two shares of the way."""
    knots = max(int(metres / 0.02), 2)
    share = np.linspace(0, 1, knots)
    points = pen.at + share[:, None] * (end - pen.at)
    grounded = (share >= firm[0]) & (share <= firm[1])
    pen.add(kind, share * metres / speed, points, np.full(knots, heading), grounded)


def _heading(direction: np.ndarray) -> float:
    """Radians as `rotations.facing` of a direction (x, y)."""
    return float(np.arctan2(-direction[0], direction[1]))


@dataclass(eq=False)
class _Corner:
    """One corner of a run."""

    place: np.ndarray
    height: float
    setback: float


def _run(pen: _Pen, moves: list[Move], then: Move | None, *, sprints: bool, straight: bool) -> None:
    """Walk along moves on firm ground up to where the next special move begins."""
    corners = _corners(pen, moves, straight)
    end_speed = 0.0
    if then is not None and then.arc is not None:
        end_speed = then.arc.first_speed
        start = then.arc.start[:2]
        if np.linalg.norm(start - corners[-1].place) > 1e-6:
            corners[-1].setback = TIGHT_M
            corners.append(_Corner(start, corners[-1].height, 0.0))
    elif then is not None:
        target = centre(then.start)
        if np.linalg.norm(target[:2] - corners[-1].place) > 1e-6:
            corners.append(_Corner(target[:2], target[2], 0.0))
    elif not moves:
        return
    corners = [corners[0]] + [c for a, c in zip(corners, corners[1:], strict=False) if _apart(a, c)]
    if len(corners) > 2 and _turns_back(corners):
        del corners[1]
    if len(corners) < 2:
        return
    way = corners[1].place - corners[0].place
    first = _heading(way)
    off = abs((first - pen.heading + np.pi) % (2 * np.pi) - np.pi)
    if pen.speed < 0.5 or off > np.radians(100):
        pen.face(first)
        pen.speed = 0.0
    else:
        pen.speed *= max(float(np.cos(off)), 0.0)
    _draw_run(pen, corners, end_speed, SPRINT_SPEED if sprints else WALK_SPEED)
    pen.speed = end_speed


def _turns_back(corners: list[_Corner]) -> bool:
    """Whether the way to the second corner would be gone back at once."""
    first, second = corners[1].place - corners[0].place, corners[2].place - corners[1].place
    return float(first @ second) < -0.17 * float(np.linalg.norm(first) * np.linalg.norm(second))


def _apart(a: _Corner, b: _Corner) -> bool:
    return float(np.linalg.norm(a.place - b.place)) > 1e-6


def _corners(pen: _Pen, moves: list[Move], straight: bool) -> list[_Corner]:
    spots = [pen.spot] + [m.end for m in moves]
    corners = [_Corner(pen.at[:2].copy(), float(pen.at[2]), 0.0)]
    middle = centre(spots[0])[:2]
    ahead = np.array([-np.sin(pen.heading), np.cos(pen.heading)])
    if (middle - pen.at[:2]) @ ahead > 0.02:
        corners.append(_Corner(middle, float(pen.at[2]), TIGHT_M))
    index = 0
    while index < len(moves):
        reach = index + 1
        if straight:
            for further in range(index + 2, min(index + 14, len(moves)) + 1):
                level = {s[2] for s in spots[index : further + 1]}
                if len(level) > 1 or not straight_free(pen.ways, spots[index], spots[further]):
                    break
                reach = further
        beside = moves[index].kind == "step" or moves[reach - 1].kind == "step"
        beside = beside or (reach < len(moves) and moves[reach].kind == "step")
        place = centre(spots[reach])
        corners.append(_Corner(place[:2], float(place[2]), TIGHT_M if beside else BEND_M))
        index = reach
    for before, after in zip(corners, corners[1:], strict=False):
        if before.height != after.height:
            before.setback = min(before.setback, TIGHT_M)
    return corners


def _draw_run(pen: _Pen, corners: list[_Corner], end_speed: float, speed: float) -> None:
    places = np.array([c.place for c in corners])
    flat, at = resampled(places, np.array([c.setback for c in corners]), KNOT_M)
    s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(flat, axis=0), axis=1))])
    limit = np.full(len(flat), speed)
    steps = [n for n in range(len(corners) - 1) if corners[n].height != corners[n + 1].height]
    for n in steps:
        limit[(s > at[n] - 0.2) & (s < at[n + 1] + 0.3)] = min(STAIRS_SPEED, speed)
    times = travel_times(flat, limit, pen.speed, end_speed)
    height = np.full(len(flat), corners[0].height)
    grounded = np.ones(len(flat), dtype=bool)
    rest = 0.0
    for n in steps:
        low, high = corners[n].height, corners[n + 1].height
        leg = places[n + 1] - places[n]
        # From the middle of the column before, whether or not the way begins there.
        past = 1.0 + (flat - places[n + 1]) @ leg / float(np.linalg.norm(leg))
        past = np.where(s < at[n] - 0.3, -1.0, np.where(s > at[n + 1], 1.0, past))
        if high > low:
            begin = max(STEP_FROM_M, float(past[0])) if n == 0 else STEP_FROM_M
            share = np.clip((past - begin) / (STEP_TO_M - begin), 0, 1)
            height += (high - low) * share * share * (3 - 2 * share)
            grounded &= (share == 0) | (past > STEP_HELD_M)
        else:
            left = int(np.argmax(past >= LEAVE_M))
            part = (LEAVE_M - past[left - 1]) / (past[left] - past[left - 1])
            begin = float(times[left - 1] + part * (times[left] - times[left - 1]))
            fallen = 0.5 * GRAVITY * np.maximum(times - begin, 0) ** 2
            height -= np.minimum(fallen, low - high)
            grounded &= (fallen == 0) | (fallen >= low - high)
            rest = max(rest, begin + float(np.sqrt(2 * (low - high) / GRAVITY)) - float(times[-1]))
    ahead = np.diff(flat, axis=0)
    headings = np.unwrap(np.arctan2(-ahead[:, 0], ahead[:, 1]))
    headings = np.append(headings, headings[-1])
    headings += round((pen.heading - headings[0]) / (2 * np.pi)) * 2 * np.pi
    if rest > 0:
        extra = np.linspace(0, rest, 12)[1:]
        missing = height[-1] - corners[-1].height
        done = np.sqrt(max(corners[-2].height - height[-1], 0.0) * 2 / GRAVITY)
        falling = 0.5 * GRAVITY * ((done + extra) ** 2 - done**2)
        times = np.append(times, times[-1] + extra)
        height = np.append(height, height[-1] - np.minimum(falling, missing))
        height[-1] = corners[-1].height
        flat = np.vstack([flat, np.tile(flat[-1], (len(extra), 1))])
        headings = np.append(headings, np.full(len(extra), headings[-1]))
        grounded = np.append(grounded, np.append(np.zeros(len(extra) - 1, dtype=bool), True))
    kind: StretchKind = "sprint" if speed > 0.5 * (WALK_SPEED + SPRINT_SPEED) else "walk"
    pen.add(kind, times, np.column_stack([flat, height]), headings, grounded)
