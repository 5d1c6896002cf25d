"""Ways through a world of blocks: where one can stand, which moves lead from there, and the quickest way by A*."""

import heapq
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Bool

from pgm_data.simulate.blocks.moves import (
    CLIMB_DOWN_SPEED,
    CLIMB_UP_SPEED,
    SPRINT_SPEED,
    Arc,
    drop,
    jump,
)
from pgm_data.simulate.blocks.world import CELL_M, COLUMNS, BlockWorld, Element, body_fits, column_centre
from pgm_data.simulate.blocks.world import standing_levels as standing

MoveKind = Literal["walk", "step", "jump", "drop", "climb_up", "climb_down"]
Spot = tuple[int, int, int]
"""Column along x, column along y, level."""
LEAST_FALL_LEVELS = 2
DEEPEST_LEVELS = 9


@dataclass(frozen=True, eq=False, kw_only=True)
class Move:
    """One way from a spot to another."""

    kind: MoveKind
    start: Spot
    end: Spot
    seconds: float
    """About how long it takes."""
    arc: Arc | None = None
    """Of jumps and drops."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Ways:
    """All moves of a world."""

    stands: Bool[np.ndarray, "16 16 20"]
    moves: dict[Spot, tuple[Move, ...]]
    home: frozenset[Spot]
    """Spots from which every other of them can be reached."""


def centre(spot: Spot) -> np.ndarray:
    """Middle of a spot, world metres."""
    return column_centre((spot[0], spot[1]), spot[2])


def ways_of(world: BlockWorld) -> Ways:
    """Every move that a body can make in a world without touching anything on the way."""
    stands = standing(world)
    spots = [(int(i), int(j), int(k)) for i, j, k in np.argwhere(stands)]
    tried = [m for spot in spots for m in _tried(world, stands, spot)]
    fits = _all_fit(world, tried)
    moves: dict[Spot, list[Move]] = {spot: [] for spot in spots}
    for move, good in zip(tried, fits, strict=True):
        if good:
            moves[move.start].append(move)
    kept = {spot: tuple(own) for spot, own in moves.items()}
    return Ways(stands=stands, moves=kept, home=_home(kept))


def _tried(world: BlockWorld, stands: np.ndarray, spot: Spot) -> list[Move]:
    i, j, level = spot
    moves: list[Move] = []

    def levels_at(column: tuple[int, int]) -> list[int]:
        if not (0 <= column[0] < COLUMNS and 0 <= column[1] < COLUMNS):
            return []
        return [int(k) for k in np.flatnonzero(stands[column])]

    for a, b in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        for far in (1, 2, 3, 4):
            for other in levels_at((i + far * a, j + far * b)):
                end = (i + far * a, j + far * b, other)
                moves += _straight(spot, end, far, other - level)
    for a, b in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        inside = 0 <= i + a < COLUMNS and 0 <= j + b < COLUMNS
        if inside and stands[i + a, j, level] and stands[i, j + b, level] and stands[i + a, j + b, level]:
            moves.append(Move(kind="walk", start=spot, end=(i + a, j + b, level), seconds=1.415 / SPRINT_SPEED))
    for ladder in world.ladders:
        wall = (ladder.column[0] + ladder.towards[0], ladder.column[1] + ladder.towards[1], ladder.top)
        foot = (*ladder.column, ladder.bottom)
        high = (ladder.top - ladder.bottom) * CELL_M
        if spot == foot and stands[wall]:
            moves.append(Move(kind="climb_up", start=spot, end=wall, seconds=0.4 + high / CLIMB_UP_SPEED))
        if spot == wall and stands[foot]:
            moves.append(Move(kind="climb_down", start=spot, end=foot, seconds=0.8 + high / CLIMB_DOWN_SPEED))
    return moves


def _straight(spot: Spot, end: Spot, far: int, rise: int) -> list[Move]:
    """Moves along x or y by so many columns and levels."""
    if far == 1 and rise == 0:
        return [Move(kind="walk", start=spot, end=end, seconds=1 / SPRINT_SPEED)]
    if far == 1 and abs(rise) == 1:
        return [Move(kind="step", start=spot, end=end, seconds=0.35)]
    moves = []
    if far == 1 and rise == 2 or 2 <= far <= 4 and -4 <= rise <= (2, 2, 1, 0)[far - 1]:
        arc = jump(centre(spot), centre(end))
        moves.append(Move(kind="jump", start=spot, end=end, seconds=0.25 + arc.duration, arc=arc))
    if far <= 2 and -DEEPEST_LEVELS <= rise <= -LEAST_FALL_LEVELS:
        arc = drop(centre(spot), centre(end))
        moves.append(Move(kind="drop", start=spot, end=end, seconds=0.3 + arc.duration, arc=arc))
    return moves


SAMPLES = 33


def _all_fit(world: BlockWorld, moves: list[Move]) -> np.ndarray:
    """Whether the body touches nothing at any of some places along each move."""
    return np.asarray(body_fits(world, np.stack([_places(m) for m in moves])).all(axis=1))


def _places(move: Move) -> np.ndarray:
    start, end = centre(move.start), centre(move.end)
    share = np.linspace(0, 1, SAMPLES)[:, None]
    if move.arc is not None:
        before = start + np.linspace(0, 1, 4)[:, None] * (move.arc.start - start)
        flight = move.arc.at(np.linspace(0, move.arc.duration, SAMPLES - 8))
        flight[-1, 2] = end[2]
        return np.vstack([before, flight, flight[-1] + np.linspace(0, 1, 4)[:, None] * (end - flight[-1])])
    high = max(start[2], end[2])
    if move.kind.startswith("climb"):
        low, top = (start, end) if move.kind == "climb_up" else (end, start)
        up = np.column_stack([np.tile(low[:2], (SAMPLES - 6, 1)), np.linspace(low[2], top[2], SAMPLES - 6)])
        return np.vstack([up, up[-1] + np.linspace(0, 1, 6)[:, None] * (top - up[-1])])
    flat = start + share * (end - start)
    flat[:, 2] = high
    return flat


def _home(moves: dict[Spot, tuple[Move, ...]]) -> frozenset[Spot]:
    """The largest set of spots around the ground that can all reach each other."""
    back: dict[Spot, list[Spot]] = {spot: [] for spot in moves}
    ahead: dict[Spot, list[Spot]] = {spot: [m.end for m in own] for spot, own in moves.items()}
    for own in moves.values():
        for move in own:
            back[move.end].append(move.start)
    best: frozenset[Spot] = frozenset()
    ground = [spot for spot in moves if spot[2] == 0]
    for spot in (ground[len(ground) // 2], ground[0], ground[-1]):
        both = frozenset(_spread(spot, ahead) & _spread(spot, back))
        best = max(best, both, key=len)
    return best


def _spread(spot: Spot, to: dict[Spot, list[Spot]]) -> set[Spot]:
    seen, left = {spot}, [spot]
    while left:
        for other in to[left.pop()]:
            if other not in seen:
                seen.add(other)
                left.append(other)
    return seen


def find_way(ways: Ways, start: Spot, goals: frozenset[Spot], taste: dict[MoveKind, float]) -> list[Move]:
    """The moves from a spot to the cheapest of the goals, by A*; empty where it is there already or none leads there.

    Taste: factors on the seconds of each kind of move, at least 1, so that the straight distance stays a lower bound.
    """
    if start in goals or not goals:
        return []
    ends = np.array(sorted(goals))[:, :2]

    def left(spot: Spot) -> float:
        return float(np.hypot(*(ends - spot[:2]).T).min()) / (1.6 * SPRINT_SPEED)

    best = {start: 0.0}
    came: dict[Spot, Move] = {}
    queue = [(left(start), start)]
    closed: set[Spot] = set()
    while queue:
        _, spot = heapq.heappop(queue)
        if spot in goals:
            moves = []
            while spot != start:
                moves.append(came[spot])
                spot = came[spot].start
            return moves[::-1]
        if spot in closed:
            continue
        closed.add(spot)
        for move in ways.moves[spot]:
            cost = best[spot] + move.seconds * taste.get(move.kind, 1.0)
            if cost < best.get(move.end, np.inf):
                best[move.end] = cost
                came[move.end] = move
                heapq.heappush(queue, (cost + left(move.end), move.end))
    return []


def spots_on(ways: Ways, element: Element) -> frozenset[Spot]:
    """Where one stands on an element and can come from and go to elsewhere."""
    tops = zip(element.columns.tolist(), element.levels.tolist(), strict=True)
    return frozenset((c[0], c[1], level) for c, level in tops if (c[0], c[1], level) in ways.home)


def straight_free(ways: Ways, start: Spot, end: Spot) -> bool:
    """Whether one can walk straight from one spot to another of the same level, the whole body over firm ground."""
    a, b = np.array(start[:2]) + 0.5, np.array(end[:2]) + 0.5
    places = a + np.linspace(0, 1, max(int(np.linalg.norm(b - a) / 0.1), 1) + 1)[:, None] * (b - a)
    corners = places[:, None] + np.array([[x, y] for x in (-0.34, 0.34) for y in (-0.34, 0.34)])
    columns = np.clip(np.floor(corners).astype(int), 0, COLUMNS - 1)
    return bool(ways.stands[columns[..., 0], columns[..., 1], start[2]].all())
