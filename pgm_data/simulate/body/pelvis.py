"""How the pelvis goes along a plan: its place, height and lean before the legs, and how far they pull it down."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter1d, maximum_filter1d, uniform_filter1d

from pgm_data.simulate import rotations
from pgm_data.simulate.body import feet, footsteps
from pgm_data.simulate.body.footsteps import TICK_S, Stances
from pgm_data.simulate.tennis.play import Plan

SPLIT_FLIGHT_S = 0.24
STRETCH = 0.985
"""Share of its greatest reach that a planted leg may use."""
_DEEPEST_M = [0.44, 0.38, 0.31, 0.26]
"""Below standing, a person 1.8 m tall, at rest to running."""
_FASTEST_SPLIT = 3.0
"""m/s."""
_GRAVITY = 9.81
_PUSH_S = 0.09
"""Time constant of the crouch before a leap and after a landing."""
_TOES_LEAVE_S, _TOES_MEET_S = 0.12, 0.12
"""How long before a hop the heels come up, and after it go down."""
_HIGH_HOP = 2.0
"""Take-off speed, m/s, of a hop with all of the feet's push."""


@dataclass(frozen=True, eq=False, kw_only=True)
class HipDemand:
    """What a stroke asks of the pelvis, on top of the plan."""

    turn: Float[np.ndarray, " times"]
    """Radians added to the plan's heading, anticlockwise from above."""
    drop: Float[np.ndarray, " times"]
    """Metres that the pelvis sinks below standing."""
    lean_forward: Float[np.ndarray, " times"]
    """Radians."""
    lean_left: Float[np.ndarray, " times"]
    """Radians."""
    hop: Float[np.ndarray, " times"]
    """Metres that both feet are off the ground."""


def no_demand(times: Float[np.ndarray, " times"]) -> HipDemand:
    """Nothing but the plan."""
    none = np.zeros(len(times))
    return HipDemand(turn=none, drop=none, lean_forward=none, lean_left=none, hop=none)


@dataclass(frozen=True, eq=False, kw_only=True)
class Moments:
    """The pelvis at some times, as far as the feet do not matter."""

    times: Float[np.ndarray, " times"]
    xy: Float[np.ndarray, "times 2"]
    """World metres."""
    velocity: Float[np.ndarray, "times 2"]
    """m/s."""
    acceleration: Float[np.ndarray, "times 2"]
    """m/s^2."""
    heading: Float[np.ndarray, " times"]
    """Of the plan, radians."""
    turn: Float[np.ndarray, " times"]
    drop: Float[np.ndarray, " times"]
    lean_forward: Float[np.ndarray, " times"]
    lean_left: Float[np.ndarray, " times"]
    air: Float[np.ndarray, " times"]
    """Metres of free flight of the whole body in a leap."""
    crouch: Float[np.ndarray, " times"]
    """Metres that the pelvis is lower before a leap and after its landing."""
    push: Float[np.ndarray, " times"]
    """0 to 1: how far the ground is pushed away with the toes for a hop, and met with them after it."""
    phase: Float[np.ndarray, " times"]
    """Stride phase, radians."""
    excess: Float[np.ndarray, " times"]
    """Metres by which the wanted height is too much for the planted legs."""

    @property
    def hips(self) -> np.ndarray:
        """Heading of the hips, radians."""
        return self.heading + self.turn


_WIDTHS = {
    name: 2 if name in ("xy", "velocity", "acceleration") else 1 for name in Moments.__annotations__ if name != "times"
}


@dataclass(frozen=True, eq=False, kw_only=True)
class PelvisCourse:
    """Moments on a fine even grid, read at any time."""

    grid: Moments
    airborne: Float[np.ndarray, "leaps 2"]
    """Take-off and landing of leaps, seconds."""
    wide: Float[np.ndarray, " leaps"]
    """Distance of the feet after each leap, metres before scaling; 0 leaves it to the gait."""

    @property
    def times(self) -> np.ndarray:
        """Seconds."""
        return self.grid.times

    def ground(self) -> footsteps.Course:
        """What the footsteps need. The feet follow half of a stroke's turn."""
        grid = self.grid
        return footsteps.Course(
            xy=grid.xy,
            velocity=grid.velocity,
            heading=grid.heading + 0.5 * grid.turn,
            airborne=self.airborne,
            wide=self.wide,
        )

    def with_phase(self, phase: np.ndarray) -> "PelvisCourse":
        """The same with the stride's phase."""
        return replace(self, grid=replace(self.grid, phase=phase))

    def with_excess(self, excess: np.ndarray) -> "PelvisCourse":
        """The same with the height that the legs take away."""
        return replace(self, grid=replace(self.grid, excess=excess))

    def at(self, times: np.ndarray) -> Moments:
        """Cubic interpolation; the ends hold before and after."""
        table = np.column_stack([getattr(self.grid, name) for name in _WIDTHS])
        values = _cubic(table, np.asarray(times, dtype=float) / TICK_S)
        columns, start = {}, 0
        for name, width in _WIDTHS.items():
            columns[name] = values[:, start] if width == 1 else values[:, start : start + width]
            start += width
        return Moments(times=np.asarray(times, dtype=float), **columns)


def course_of(plan: Plan, demand_of: Callable[[Float[np.ndarray, " times"]], HipDemand], scale: float) -> PelvisCourse:
    """The pelvis along a plan, without the feet."""
    count = int(np.floor((plan.times[-1] - plan.times[0]) / TICK_S + 1e-6)) + 1
    times = TICK_S * np.arange(max(count, 2))
    step = plan.times[1] - plan.times[0] if len(plan.times) > 1 else TICK_S
    knots = _cubic(np.column_stack([plan.path, plan.heading]), times / step)
    # Plans bend in their speed; a body's mass rounds that off (within 1 cm). What moves at an end moves on beyond it.
    margin = min(40, len(times) - 1)
    wider = np.pad(knots, ((margin, margin), (0, 0)), mode="reflect", reflect_type="odd")
    smooth = gaussian_filter1d(wider, 4.0, axis=0, mode="nearest")
    velocity = np.gradient(smooth[:, :2], TICK_S, axis=0)
    acceleration = gaussian_filter1d(np.gradient(velocity, TICK_S, axis=0), 8.0, axis=0, mode="nearest")
    smooth, velocity, acceleration = (a[margin : margin + len(times)] for a in (smooth, velocity, acceleration))
    demand = demand_of(times)
    airborne, wide, speeds = _leaps(plan.splits, np.hypot(velocity[:, 0], velocity[:, 1]), demand.hop, times)
    air = demand.hop.copy()
    crouch, push = np.zeros(len(times)), np.zeros(len(times))
    for (start, end), width, (up, down) in zip(airborne, wide, speeds, strict=True):
        if width > 0:
            u = np.clip((times - start) / (end - start), 0.0, 1.0)
            air += 0.5 * _GRAVITY * (end - start) ** 2 * u * (1.0 - u)
        before, after = np.maximum(start - times, 0.0), np.maximum(times - end, 0.0)
        crouch += up * before * np.exp(-before / _PUSH_S) + down * after * np.exp(-after / _PUSH_S)
        if width == 0:
            near = np.maximum(1.0 - before / _TOES_LEAVE_S, 0.0) * np.maximum(1.0 - after / _TOES_MEET_S, 0.0)
            push = np.maximum(push, min(up / _HIGH_HOP, 1.0) * near**2 * (3.0 - 2.0 * near))
    none = np.zeros(len(times))
    grid = Moments(
        times=times,
        xy=smooth[:, :2],
        velocity=velocity,
        acceleration=acceleration,
        heading=smooth[:, 2],
        turn=demand.turn,
        drop=demand.drop,
        lean_forward=demand.lean_forward,
        lean_left=demand.lean_left,
        air=air,
        crouch=crouch,
        push=push,
        phase=none,
        excess=none,
    )
    return PelvisCourse(grid=grid, airborne=airborne, wide=wide)


def _leaps(
    splits: np.ndarray, speed: np.ndarray, hop: np.ndarray, times: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(take-off, landing) of hops and split steps, their widths, and speeds up and down.

    A hop wins over a split, and who runs fast runs on without one.
    """
    up = np.concatenate([[False], hop > 1e-5, [False]])
    edges = np.diff(up.astype(int))
    starts, ends = np.flatnonzero(edges == 1) - 1, np.flatnonzero(edges == -1)
    rate = np.gradient(hop, TICK_S) if len(hop) > 1 else np.zeros(len(hop))
    rows = []
    for start, end in zip(np.maximum(starts, 0), np.minimum(ends, len(times) - 1), strict=True):
        # Rates inside of the hop, continued to its ends.
        near, far = min(start + 2, end), max(end - 2, start)
        up_speed = 2.5 * rate[near] - 1.5 * rate[min(near + 1, end)]
        down_speed = 1.5 * rate[max(far - 1, start)] - 2.5 * rate[far]
        speeds = max(up_speed, 0.0), max(down_speed, 0.0)
        rows.append((times[start], times[end], 0.0, *speeds))
    rise = 0.5 * _GRAVITY * SPLIT_FLIGHT_S
    for split in np.sort(splits):
        start = split - SPLIT_FLIGHT_S
        slow = np.interp(split, times, speed) < _FASTEST_SPLIT
        if (
            slow
            and start > 0.1
            and split < times[-1]
            and all(split < a - 0.15 or start > b + 0.15 for a, b, *_ in rows)
        ):
            rows.append((start, split, footsteps.SPLIT_WIDTH_M, rise, rise))
    table = np.array(sorted(rows), dtype=float).reshape(-1, 5)
    return table[:, :2], table[:, 2], table[:, 3:]


def stride_phase(stances: tuple[Stances, Stances], times: np.ndarray) -> np.ndarray:
    """Radians, a multiple of 2 pi at every landing of the left foot and pi more at the right foot's."""
    land = np.concatenate([feet_.land[1:] for feet_ in stances])
    foot = np.repeat([0, 1], [len(feet_.land) - 1 for feet_ in stances])
    if len(land) == 0:
        return np.zeros(len(times))
    order = np.lexsort((foot, land))
    land, foot = land[order], foot[order]
    # Of two feet that land almost together, one counts.
    apart = np.concatenate([[True], np.diff(land) > 0.13])
    land, foot = land[apart], foot[apart]
    rise = np.where(np.diff(foot) == 0, 2.0 * np.pi, np.pi)
    value = np.pi * foot[0] + np.concatenate([[0.0], np.cumsum(rise)])
    # A step after a rest takes its own time, not the rest's.
    gaps = np.diff(land, prepend=-np.inf)
    late = gaps > 0.55
    before = np.concatenate([[value[0] - np.pi], value[:-1]])
    knots = np.concatenate([land, land[late] - 0.45])
    values = np.concatenate([value, before[late]])
    order = np.argsort(knots, kind="stable")
    return gaussian_filter1d(np.interp(times, knots[order], values[order]), 4.0, mode="nearest")


def wanted_position(moment: Moments, standing: float, scale: float) -> Float[np.ndarray, "times 3"]:
    """Pelvis, world metres, were the legs long enough.

    Args:
        moment: The pelvis' course.
        standing: Height of the pelvis over the ground with straight legs, metres.
        scale: Of the body.
    """
    ahead, left = _in_hips(moment.velocity, moment.hips)
    speed = np.hypot(ahead, left)
    sideways = (left**2 + np.minimum(ahead, 0.0) ** 2) / (speed**2 + 0.09)
    low = np.interp(speed, [0.0, 1.2, 2.5, 6.0], [0.05, 0.03, 0.06, 0.08])
    low += sideways * np.interp(speed, [0.0, 1.5], [0.0, 0.05])
    # Walking, the pelvis is highest over the standing foot; running, it is lowest there.
    rate, contact = footsteps.gait(ahead, left)
    middle = np.pi * 0.5 * contact * rate
    bob = np.interp(speed, [0.1, 0.8, 1.6, 2.4, 4.0], [0.0, 0.014, 0.008, -0.022, -0.03])
    height = standing - scale * low - moment.drop - moment.crouch
    height += scale * bob * np.cos(2.0 * (moment.phase - middle))
    # Nobody runs in a squat: a fast player stays higher than a stroke asks for.
    above = height - (standing - scale * np.interp(speed, [1.0, 2.5, 4.5, 6.0], _DEEPEST_M))
    height += 0.5 * (np.sqrt(above**2 + (0.04 * scale) ** 2) - above) + moment.air
    # At rest the weight goes from foot to foot.
    resting = 1.0 / (1.0 + (speed / 0.2) ** 4)
    sway = 0.012 * resting * np.sin(1.7 * moment.times + np.abs(moment.xy).sum(axis=-1))
    to_left = np.stack([-np.cos(moment.hips), -np.sin(moment.hips)], axis=-1)
    return np.concatenate([moment.xy + sway[:, None] * to_left, height[:, None]], axis=-1)


def rotation(moment: Moments) -> Float[np.ndarray, "times 3 3"]:
    """R_world_from_root: heading, turns with the stride, and a lean into the acceleration."""
    ahead, left = _in_hips(moment.velocity, moment.hips)
    push, push_left = _in_hips(moment.acceleration, moment.hips)
    speed = np.hypot(ahead, left)
    forwards = ahead / (speed + 0.3)
    moving = np.interp(speed, [0.1, 1.5, 5.0], [0.0, 0.7, 1.0])
    twist = -0.12 * moving * forwards * np.cos(moment.phase)
    list_left = 0.04 * moving * np.sin(moment.phase)
    lean = 0.05 + 0.02 * np.clip(ahead, -3.0, 6.0) + 0.25 * np.arctan(push / _GRAVITY)
    lean_left = 0.3 * np.arctan(push_left / _GRAVITY) + list_left
    tilt = rotations.about(2, -(moment.lean_left + lean_left)) @ rotations.about(0, moment.lean_forward + lean)
    return rotations.facing(moment.hips + twist) @ tilt


def excess_height(
    root: Float[np.ndarray, "times 3"], hip_from_root: Float[np.ndarray, "times 3"], pose: "feet.FootPose", reach: float
) -> Float[np.ndarray, " times"]:
    """Metres by which the pelvis is too high for a foot that stands, or is about to, or just stood; times in order."""
    hip = root + hip_from_root
    level = np.sum((hip[:, :2] - pose.ankle[:, :2]) ** 2, axis=-1)
    longest = STRETCH * reach
    highest = pose.ankle[:, 2] + np.sqrt(np.maximum(longest**2 - level, (0.4 * longest) ** 2))
    stands = maximum_filter1d(pose.planted, 3, mode="nearest")
    return np.where(stands, np.maximum(hip[:, 2] - highest, 0.0), 0.0)


def smooth_excess(excess: Float[np.ndarray, " ticks"]) -> Float[np.ndarray, " ticks"]:
    """A smooth curve on or above the excess: its running maximum over 0.25 s, averaged within the same window."""
    smooth = maximum_filter1d(excess, 25, mode="nearest")
    for _ in range(3):
        smooth = uniform_filter1d(smooth, 9, mode="nearest")
    return smooth


def _in_hips(vectors: np.ndarray, heading: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Components ahead and to the left."""
    c, s = np.cos(heading), np.sin(heading)
    return -s * vectors[:, 0] + c * vectors[:, 1], -c * vectors[:, 0] - s * vectors[:, 1]


def _cubic(values: Float[np.ndarray, "knots columns"], at: Float[np.ndarray, " times"]) -> np.ndarray:
    """Catmull-Rom interpolation at fractional knot numbers, constant outside."""
    last = len(values) - 1
    at = np.clip(at, 0.0, last)
    i = np.minimum(at.astype(int), max(last - 1, 0))
    u = (at - i)[:, None]
    a, b, c, d = (values[np.clip(i + k, 0, last)] for k in (-1, 0, 1, 2))
    return b + 0.5 * u * (c - a + u * (2 * a - 5 * b + 4 * c - d + u * (3 * (b - c) + d - a)))
