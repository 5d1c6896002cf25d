"""Words about what the player of the blocks does: short spans, several sentences each, every one true of the motion."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from pgm_data.simulate.blocks.course import TICK_S, Course
from pgm_data.simulate.blocks.naming import COMPASS, bearing
from pgm_data.simulate.blocks.sentences import sentences
from pgm_data.simulate.blocks.world import CELL_M, BlockWorld, column_of
from pgm_data.simulate.states import Caption

SPAN_S = (0.34, 0.8)
"""Shortest and longest span that is wished for; ends move to where the motion changes when that is near."""
SNAP_S = 0.2
LEAST_SPAN_S = 0.2


@dataclass(frozen=True, eq=False, kw_only=True)
class Facts:
    """What is true of one span."""

    seconds: float
    moved: Float[np.ndarray, " 2"]
    """World metres, from the start of the span to its end."""
    speed: float
    """Mean along the way, m/s."""
    most_speed: float
    rise: float
    """Metres, of the soles, from start to end."""
    turned: float
    """Radians, anticlockwise from above positive."""
    turn_range: float
    """Radians between the outermost headings."""
    facing: str
    """Compass direction of the heading at the end; empty where it lies between two."""
    shares: dict[str, float]
    """Share of the span in each kind of motion."""
    take_off: bool
    """Whether a jump begins in the span."""
    on_the_spot: bool
    """Whether that jump goes nowhere."""
    gap: bool
    """Whether that jump crosses lower ground."""
    landed_by: str
    """Kind of stretch (jump, fall, climb_up, climb_down) that ends in the span, if any."""
    landed_on: int
    """Element that it ends on; -1 where it is none's."""
    lands_on_ground: bool
    """Whether that is the ground of the world."""
    climbs_to: int
    """Element to whose top the ladder leads that is climbed; -1 where none is."""
    nears: int
    """Element that is aimed at and comes nearer during the span; -1 where there is none."""
    away: float
    """Metres left to it, level, at the end."""
    stands_on: int
    """Element below the player during all of the span; -1 where there is none."""
    at_edge: bool
    """Whether the player keeps to the outermost columns of the map."""

    @property
    def direction(self) -> str:
        """Compass direction of the motion; empty where it is too short."""
        return compass(self.moved) if float(np.linalg.norm(self.moved)) > 0.35 else ""


def compass(direction: Float[np.ndarray, " 2"]) -> str:
    """The nearest of the eight directions to a vector x (east), y (north)."""
    return COMPASS[round(bearing(direction)) % 8]


def draw_captions(rng: np.random.Generator, course: Course, world: BlockWorld, seconds: float) -> tuple[Caption, ...]:
    """Captions that cover a course from 0 to its end without gaps; true whatever the frame rate."""
    captions = []
    # The words have their own chance, so that a shorter shot begins with the same ones.
    cuts = _cuts(np.random.default_rng(rng.integers(2**63)), course, seconds)
    for start, end in zip(cuts, cuts[1:], strict=False):
        facts = facts_of(course, world, start, end)
        captions.append(Caption(player=0, start_s=start, end_s=end, texts=sentences(rng, facts, world)))
    return tuple(captions)


def _cuts(rng: np.random.Generator, course: Course, seconds: float) -> list[float]:
    cuts = [0.0]
    changes = course.starts
    while cuts[-1] < seconds:
        wish = cuts[-1] + float(rng.uniform(*SPAN_S))
        near = changes[np.abs(changes - wish) < SNAP_S]
        near = near[near > cuts[-1] + LEAST_SPAN_S]
        cuts.append(float(near[np.abs(near - wish).argmin()]) if len(near) else wish)
    cuts = [c for c in cuts if c < seconds - LEAST_SPAN_S] or [0.0]
    return [*cuts, seconds]


def facts_of(course: Course, world: BlockWorld, start: float, end: float) -> Facts:
    """What happens between two times of a course."""
    count = max(int(np.ceil((end - start) / TICK_S)), 2)
    times = np.linspace(start, end, count + 1)
    feet = course.feet_at(times)
    headings = course.heading_at(times)
    steps = np.linalg.norm(np.diff(feet[:, :2], axis=0), axis=1)
    first, last = int(course.stretch_at(times[:1])[0]), int(course.stretch_at(times[-1:] - 1e-9)[0])
    inside = course.stretches[first : last + 1]
    overlap = [min(end, float(s.times[-1])) - max(start, float(s.times[0])) for s in inside]
    shares: dict[str, float] = {}
    for stretch, seconds in zip(inside, overlap, strict=True):
        shares[stretch.kind] = shares.get(stretch.kind, 0.0) + seconds / (end - start)
    jumps = [s for s in inside if s.kind == "jump" and start <= s.times[0] and s.times[0] + 0.1 < end]
    ends = [
        s
        for s in inside
        if s.kind in ("jump", "fall", "climb_up", "climb_down") and start + 0.1 < s.times[-1] <= end + 1e-9
    ]
    if jumps:
        # Of several contacts, the one that the jump spoken of ends in.
        ends = [s for s in jumps if s.times[-1] <= end + 1e-9]
    climbs = [s for s in inside if s.kind == "climb_up"]
    goals = {s.goal for s in inside}
    nears, away = -1, 0.0
    if len(goals) == 1 and min(goals) >= 0:
        (goal,) = goals
        before, after = distance_to(world, goal, feet[0]), distance_to(world, goal, feet[-1])
        if before - after > 0.3:
            nears, away = goal, after
    return Facts(
        seconds=end - start,
        moved=feet[-1, :2] - feet[0, :2],
        speed=float(steps.sum() / (end - start)),
        most_speed=float(steps.max() / (times[1] - times[0])),
        rise=float(feet[-1, 2] - feet[0, 2]),
        turned=float(headings[-1] - headings[0]),
        turn_range=float(np.ptp(headings)),
        facing=_facing(float(headings[-1])),
        shares=shares,
        take_off=bool(jumps),
        on_the_spot=bool(jumps) and all(s.arc is not None and s.arc.distances[-1] == 0 for s in jumps),
        gap=bool(jumps) and _crosses_lower_ground(world, jumps[0].points),
        landed_by=ends[-1].kind if ends else "",
        landed_on=ends[-1].lands_on if ends else -1,
        lands_on_ground=bool(ends) and abs(float(ends[-1].points[-1, 2])) < 1e-6,
        climbs_to=climbs[-1].lands_on if climbs else -1,
        nears=nears,
        away=away,
        stands_on=_below_throughout(world, feet),
        at_edge=bool((np.abs(feet[:, :2]).max(axis=1) > 7.0).all()),
    )


def distance_to(world: BlockWorld, element: int, feet: Float[np.ndarray, " 3"]) -> float:
    """Level distance from a place to the nearest column of an element, metres; 0 within one."""
    low = world.elements[element].columns - 8.0
    gap = np.maximum(np.maximum(low - feet[:2], feet[:2] - low - 1.0), 0.0)
    return float(np.linalg.norm(gap, axis=1).min())


def _facing(heading: float) -> str:
    eighth = bearing(np.array([-np.sin(heading), np.cos(heading)]))
    return COMPASS[round(eighth) % 8] if abs(eighth - round(eighth)) < 0.35 else ""


def _below_throughout(world: BlockWorld, feet: np.ndarray) -> int:
    for number, element in enumerate(world.elements):
        columns = column_of(feet)
        same = (columns[:, None] == element.columns).all(axis=2)
        tops = np.where(same, element.levels * CELL_M, -99.0).max(axis=1)
        if (np.abs(tops - feet[:, 2]) < 0.01).all():
            return number
    return -1


def _crosses_lower_ground(world: BlockWorld, points: np.ndarray) -> bool:
    """Whether somewhere under the middle of an arc there is nothing within half a metre below both of its ends."""
    middle = points[len(points) // 2]
    i, j = column_of(middle)
    low = min(points[0, 2], points[-1, 2])
    top = int(round(low / CELL_M)) + 4
    filled = world.cells[2 * i, 2 * j, max(top - 2, 0) : top]
    return not filled.any()
