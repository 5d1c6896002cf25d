"""Which frames of a noisy ball path belong to one flight: breaks chosen so that few flights explain all states.

With what gravity and drag do taken off, a flight is a straight line in places and velocities alike, bent a little where
a ball spins. How well a line fits follows from running sums, so all flights between any two frames are weighed at once;
which of them make up the path is found frame by frame (dynamic programming).
"""

from dataclasses import dataclass
from functools import partial

import numpy as np
from jaxtyping import Bool, Float, Int

from pgm_data.lift.ball.world import BallWorld
from pgm_models.animation import flight

STEP_S = 0.125
"""Longest step of the integration of flights, s."""
LEAST_PULL = 0.3
"""Size of a flight's steady acceleration beside gravity and drag at least, m/s^2."""
WAYS = 6
"""Places on the way between two frames that are looked at, besides the frames."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Costs:
    """What contacts and frames outside flights cost, in squared errors of the size of the path's own."""

    contact: float
    """A bounce near the ground, a hit near a player, the net."""
    free: float
    """A change of velocity that nothing explains."""
    skipped: float
    """A frame that is part of a contact and of no flight."""
    skipped_frames: int
    """How many of them a contact may have."""
    rolling: float
    """A stretch on the ground, in place of a flight."""
    held: float
    """A frame in which a player holds the ball, in place of a flight."""
    held_m_s: float
    """Fastest that a held ball is, m/s."""
    longest_s: float
    """Longest flight, s."""
    reach_m: float
    """Of a player's root."""


@dataclass(frozen=True, eq=False, kw_only=True)
class States:
    """A path as it is given, and the sizes of its errors."""

    position: Float[np.ndarray, "T 3"]
    velocity: Float[np.ndarray, "T 3"]
    times: Float[np.ndarray, " T"]
    error_m: Float[np.ndarray, "T 3"]
    error_m_s: Float[np.ndarray, "T 3"]
    alike: float
    """Neighbouring frames whose errors are so alike that they count for one."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Flights:
    """Stretches of frames without contact, in order; a row a flight."""

    first: Int[np.ndarray, " flights"]
    last: Int[np.ndarray, " flights"]
    rolls: Bool[np.ndarray, " flights"]
    """On the ground all along."""
    held: Bool[np.ndarray, " flights"]
    """In no flight at all, but slow and near a player all along."""
    pull: Float[np.ndarray, "flights 3"]
    """Steady acceleration beside gravity and drag, m/s^2."""
    position: Float[np.ndarray, "T 3"]
    """Each frame as its flight fits it; as given where a frame is in none."""
    velocity: Float[np.ndarray, "T 3"]


flown = partial(flight.flown, step_s=STEP_S)


def ground_of(position: Float[np.ndarray, "*batch 3"], world: BallWorld) -> Float[np.ndarray, "*batch"]:
    """Lowest height of the ball's centre at those places: on the surface or, beside a raised one, on the floor."""
    inside = (np.abs(position[..., :2]) <= world.ground_half_size).all(axis=-1) | (world.floor_z >= 0)
    return np.where(inside, 0.0, world.floor_z) + world.radius_m


def find_flights(
    states: States,
    now: tuple[np.ndarray, np.ndarray],
    kept: Bool[np.ndarray, " T"],
    roots: Float[np.ndarray, "T players 3"],
    world: BallWorld,
    costs: Costs,
    turn_std: float,
) -> Flights:
    """The flights that explain the states at the least cost.

    Args:
        states: What is to be explained.
        now: Positions and velocities as they are believed to be; drag and nearness are taken from them.
        kept: Frames that must be in a flight.
        roots: Of the players; infinite where there is none.
        world: Of the ball.
        costs: Of contacts.
        turn_std: How spin turns flights, rad/s; a steady acceleration here, the larger the faster the ball is.
    """
    frames = len(states.times)
    span = min(frames, int(np.searchsorted(states.times, states.times[0] + costs.longest_s)) + 1)
    rows = np.minimum(np.arange(frames)[:, None] + np.arange(span), frames - 1)
    s = states.times[rows] - states.times[:, None]
    beyond = (np.arange(frames)[:, None] + np.arange(span) >= frames) | (s > costs.longest_s)
    places, speeds = _without_forces(states, now, world)
    pull_std = np.maximum(turn_std * np.linalg.norm(now[1], axis=1), LEAST_PULL)
    fits = _Fits(states, rows, s, places, speeds, pull_std)
    low = ground_of(states.position, world)
    depth = np.maximum(low[:, None] - (fits.start + states.position[:, None])[..., 2], 0.0)
    depth = np.maximum(depth, low[rows] - (states.position[rows] + fits.end)[..., 2])
    cost = fits.cost / states.alike + (depth / (0.02 + states.error_m[:, None, 2])) ** 2
    rolled = np.zeros_like(cost, dtype=bool)
    ground = None
    slow = (states.position[:, 2] - low < 3 * states.error_m[:, 2]) & (
        np.abs(states.velocity[:, 2]) < 3 * states.error_m_s[:, 2]
    )
    if slow.any():
        lying, still = states.position.copy(), states.velocity.copy()
        lying[:, 2], still[:, 2] = states.position[:, 2] - low, states.velocity[:, 2]
        ground = _Fits(states, rows, s, lying, still, np.ones(frames), grounded=True)
        rolling = ground.cost / states.alike + costs.rolling
        rolled = rolling < cost
        cost = np.where(rolled, rolling, cost)
    near = np.linalg.norm(now[0][:, None] - roots, axis=-1).min(axis=1, initial=np.inf) < costs.reach_m
    near &= np.linalg.norm(now[1], axis=1) < costs.held_m_s
    holding = np.cumsum(np.where(near, costs.held / states.alike, np.inf)[rows], axis=1)
    held = holding < cost
    cost = np.where(held, holding, cost)
    cost[beyond] = np.inf
    first, last = _cheapest(cost, _break_costs(states, now, roots, world, costs), kept, costs)
    held = held[first, last - first]
    rolls = rolled[first, last - first] & ~held
    position, velocity = states.position.copy(), states.velocity.copy()
    flight = flight_of(first, last, frames)
    there = np.flatnonzero(flight >= 0)
    start, end = first[flight[there]], last[flight[there]]
    for kind, fit in ((False, fits), (True, ground)):
        if fit is not None:
            mine = (rolls[flight[there]] == kind) & ~held[flight[there]]
            at, p, v = there[mine], *fit.off(start[mine], end[mine], there[mine])
            position[at] += p
            velocity[at] += v
    pull = np.where((rolls | held)[:, None], 0.0, fits.pull[first, last - first])
    return Flights(first=first, last=last, rolls=rolls, held=held, pull=pull, position=position, velocity=velocity)


def flight_of(first: Int[np.ndarray, " flights"], last: Int[np.ndarray, " flights"], frames: int) -> np.ndarray:
    """Number of each frame's flight; -1 where it is in none."""
    number = np.searchsorted(first, np.arange(frames), side="right") - 1
    return np.where(np.arange(frames) <= last[number], number, -1)


def _without_forces(
    states: States, now: tuple[np.ndarray, np.ndarray], world: BallWorld
) -> tuple[np.ndarray, np.ndarray]:
    """Places and velocities less what gravity and drag have done since the first frame."""
    drag, h = world.drag_per_m.mean, np.diff(states.times)
    (p, v), step = now, h[:, None]
    ahead, faster = flown(p[:-1], v[:-1], h, drag)
    behind, slower = flown(p[1:], v[1:], -h, drag)
    push = 0.5 * ((faster - v[:-1]) + (v[1:] - slower))
    shift = 0.5 * ((ahead - p[:-1] - step * v[:-1]) + (p[1:] - behind - step * slower))
    pushed = np.concatenate([np.zeros((1, 3)), np.cumsum(push, axis=0)])
    shifted = np.concatenate([np.zeros((1, 3)), np.cumsum(shift + step * pushed[:-1], axis=0)])
    return states.position - shifted, states.velocity - pushed


class _Fits:
    """Least-squares lines p = A + B s + a s^2 / 2, v = B + a s through the states of all flights.

    All arrays have a row for each first frame and a column for each number of further frames, then x, y, z.
    """

    def __init__(
        self,
        states: States,
        rows: np.ndarray,
        s: np.ndarray,
        places: np.ndarray,
        speeds: np.ndarray,
        pull_std: np.ndarray,
        *,
        grounded: bool = False,
    ) -> None:
        weight_p, weight_v = states.error_m[rows] ** -2, states.error_m_s[rows] ** -2
        base_p, base_v = places.copy(), speeds.copy()
        if grounded:  # Heights are compared with the ground itself, and not with a line.
            base_p[:, 2] = base_v[:, 2] = 0.0
        self._s = s = s[..., None]
        self._y = places[rows] - base_p[:, None] - base_v[:, None] * s
        self._u = speeds[rows] - base_v[:, None]
        y, u, half = self._y, self._u, 0.5 * s**2

        def sums(values: np.ndarray) -> np.ndarray:
            return np.cumsum(values, axis=1)

        m00, m01, m02 = sums(weight_p), sums(weight_p * s), sums(weight_p * half)
        m11 = sums(weight_p * s**2 + weight_v)
        m12 = sums(weight_p * s * half + weight_v * s)
        m22 = sums(weight_p * half**2 + weight_v * s**2) + pull_std[:, None, None] ** -2
        b0 = sums(weight_p * y)
        b1 = sums(weight_p * s * y + weight_v * u)
        b2 = sums(weight_p * half * y + weight_v * s * u)
        # Gauss' elimination of three unknowns.
        f1, f2 = m01 / m00, m02 / m00
        n11, n12, n22 = m11 - f1 * m01, m12 - f1 * m02, m22 - f2 * m02
        c1, c2 = b1 - f1 * b0, b2 - f2 * b0
        g = n12 / n11
        pull = (c2 - g * c1) / (n22 - g * n12)
        slope = (c1 - n12 * pull) / n11
        place = (b0 - m01 * slope - m02 * pull) / m00
        if grounded:
            place[..., 2] = slope[..., 2] = pull[..., 2] = 0.0
        self.start, self._slope, self.pull = place, slope, pull
        left = sums(weight_p * y**2 + weight_v * u**2) - place * b0 - slope * b1 - pull * b2
        self.cost = np.maximum(left, 0.0).sum(axis=2)
        """Squared errors."""
        self.end = place + slope * s + pull * half - y
        """From the last frame's place to the line."""

    def off(self, first: np.ndarray, last: np.ndarray, frame: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """From the states of frames to those of the flights that go from a first to a last frame."""
        flight, at = (first, last - first), (first, frame - first)
        s, place, slope, pull = self._s[at], self.start[flight], self._slope[flight], self.pull[flight]
        return place + slope * s + 0.5 * pull * s**2 - self._y[at], slope + pull * s - self._u[at]


def _break_costs(
    states: States, now: tuple[np.ndarray, np.ndarray], roots: np.ndarray, world: BallWorld, costs: Costs
) -> np.ndarray:
    """Cost of a contact before each frame, by how many frames it takes: (frames, skipped frames + 1)."""
    frames = len(states.times)
    out = np.full((frames, costs.skipped_frames + 1), np.inf)
    for skipped in range(costs.skipped_frames + 1):
        before = np.arange(max(frames - 1 - skipped, 0))
        after = before + 1 + skipped
        if not len(before):
            continue
        near = _near(states, now, before, after, roots, world, costs)
        out[after, skipped] = np.where(near, costs.contact, costs.free) + skipped * costs.skipped
    return out


def _near(
    states: States,
    now: tuple[np.ndarray, np.ndarray],
    before: np.ndarray,
    after: np.ndarray,
    roots: np.ndarray,
    world: BallWorld,
    costs: Costs,
) -> np.ndarray:
    """Whether ground, net or a player are near on the way between frames."""
    p, v = now
    h = states.times[after] - states.times[before]
    shares = np.linspace(0.0, 1.0, WAYS)[:, None] * h
    shape = (WAYS, len(before), 3)
    ways = np.concatenate(
        [
            flown(np.broadcast_to(p[row], shape), np.broadcast_to(v[row], shape), sign * shares, world.drag_per_m.mean)[
                0
            ]
            for row, sign in ((before, 1.0), (after, -1.0))
        ]
    )
    slack = np.minimum(0.1 + 2.0 * states.error_m[before].max(axis=1), 1.0)
    near = touches_net(ways, world, slack).any(axis=0)
    if world.bounces:
        near |= (ways[..., 2] - ground_of(ways, world) < slack).any(axis=0)
    for root in (roots[before], roots[after]):
        away = np.linalg.norm(ways[:, :, None] - root, axis=-1)
        near |= (away < costs.reach_m + slack[:, None]).any(axis=(0, 2))
    return near


def touches_net(
    position: Float[np.ndarray, "*batch 3"], world: BallWorld, slack: float | Float[np.ndarray, " n"]
) -> Bool[np.ndarray, "*batch"]:
    """Whether places are at the net, to that many metres."""
    if not len(world.net_xz):
        return np.zeros(position.shape[:-1], dtype=bool)
    top = np.interp(position[..., 0], world.net_xz[:, 0], world.net_xz[:, 1], left=-np.inf, right=-np.inf)
    return np.array((np.abs(position[..., 1]) < slack) & (position[..., 2] < top + world.radius_m + slack), dtype=bool)


def _cheapest(
    cost: Float[np.ndarray, "T span"], breaks: Float[np.ndarray, "T skips"], kept: Bool[np.ndarray, " T"], costs: Costs
) -> tuple[np.ndarray, np.ndarray]:
    """First and last frames of the flights of least total cost; a frame's best follows from those before it."""
    frames, span = cost.shape
    # Of flights that end at a frame: reach[t, k] starts k frames before it.
    start = np.arange(frames)[:, None] - np.arange(span)
    reach = np.where(start >= 0, cost[np.maximum(start, 0), np.arange(span)], np.inf)
    total = np.full(frames, np.inf)
    enter = np.full(frames, np.inf)
    enter[0] = 0.0
    length, skip = np.zeros(frames, dtype=np.int64), np.zeros(frames, dtype=np.int64)
    held = np.concatenate([[0], np.cumsum(kept)])
    for t in range(frames):
        if t:
            most = min(costs.skipped_frames, t - 1)
            ways = total[t - 1 - most : t][::-1] + breaks[t, : most + 1]
            ways[held[t] - held[t - np.arange(most + 1)] > 0] = np.inf
            skip[t] = ways.argmin()
            enter[t] = ways[skip[t]]
        back = min(span, t + 1)
        ways = enter[t + 1 - back : t + 1][::-1] + reach[t, :back]
        length[t] = ways.argmin()
        total[t] = ways[length[t]]
    first, last, t = [], [], frames - 1
    while t >= 0:
        last.append(t)
        first.append(t - length[t])
        t = first[-1] - 1 - skip[first[-1]]
    return np.array(first[::-1], dtype=np.int64), np.array(last[::-1], dtype=np.int64)
