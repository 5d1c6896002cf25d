"""Flights that meet at contacts: fitted together to the states of a noisy path, each an exact flight.

A flight is its place, velocity and turn (how spin bends it) at its first frame; a contact is when it happens. All are
improved at once by Gauss and Newton's steps, with contacts as conditions that weigh much more than any state.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import csc_array, diags_array
from scipy.sparse.linalg import spsolve

from pgm_data.lift.ball.world import BallWorld
from pgm_models.animation.settle_breaks import Flights, States, flight_of, flown, ground_of

TIED_M = 1e-4
"""Size of error up to which flights meet at a contact, and on the ground at a bounce, metres."""
TIED_M_S = 1e-2
"""The same of velocities, m/s."""
REACH_M = 1e-3
"""Size of error up to which strokes are within reach, metres."""
ABOVE_M = 1e-3
"""The same of frames that would be below the ground, metres."""
SAMPLES = 17
"""Moments between two frames that a contact is looked for at first."""
SLIGHT_M_S = 0.2
"""A bounce slower than this, m/s, is none."""
FARTHEST = np.array([3.0] * 3 + [15.0] * 3 + [0.5] * 3)
"""Longest step of a flight's place, velocity and turn: metres, m/s, rad/s."""
MOST_TURN = 4.0
"""Largest turn, in deviations."""
HOLD = 1e-9
"""Weight of staying where it is, for what nothing else determines."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Joined:
    """Flights, and the contacts between each two of them; a row a flight, and a row less of contacts."""

    first: Int[np.ndarray, " flights"]
    last: Int[np.ndarray, " flights"]
    rolls: Bool[np.ndarray, " flights"]
    held: Bool[np.ndarray, " flights"]
    start: Float[np.ndarray, "flights 9"]
    """Place (m), velocity (m/s), turn (rad/s) at the first frame."""
    moment: Float[np.ndarray, " contacts"]
    """When the contact is, s."""
    tied: Bool[np.ndarray, " contacts"]
    """Whether the flights meet there; where not, more happened between two frames than one contact."""
    bounce: Bool[np.ndarray, " contacts"]
    hitter: Int[np.ndarray, " contacts"]
    """Player who must reach it; -1 where nobody."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Reach:
    """Where players are, and how far from there they hit a ball."""

    roots: Float[np.ndarray, "T players 3"]
    """Metres; infinite where there is none."""
    looks: Int[np.ndarray, " players"]
    """Whether each looks along world +y (1) or -y (-1) at the net; 0 where it may send the ball anywhere."""
    level_m: float
    """Level distance from the root within which a stroke is, metres."""
    farthest_m: float
    """Strokes farther off than this are left where they are, metres."""

    def roots_at(
        self, seconds: Float[np.ndarray, " n"], times: Float[np.ndarray, " T"]
    ) -> Float[np.ndarray, "n players 3"]:
        """Roots at any times, straight between frames."""
        after = np.searchsorted(times, seconds).clip(1, max(len(times) - 1, 1)).clip(max=len(times) - 1)
        before = np.maximum(after - 1, 0)
        share = (seconds - times[before]) / np.maximum(times[after] - times[before], 1e-9)
        share = share.clip(0.0, 1.0)[:, None, None]
        one, two = self.roots[before], self.roots[after]
        there = np.isfinite(one) & np.isfinite(two)
        step = np.where(there, two, 0.0) - np.where(there, one, 0.0)
        return np.where(there, np.where(there, one, 0.0) + share * step, np.inf)


@dataclass(frozen=True, eq=False, kw_only=True)
class Air:
    """What all flights are under."""

    world: BallWorld
    turn_std: float
    """Size of turns, rad/s; 0 without lift."""
    miss_m: float
    """Farthest that flights fitted alone may miss each other at a contact, metres."""
    miss_errors: float
    """The same, in sizes of the path's errors, where that is more."""


def joined_flights(states: States, flights: Flights, given: Bool[np.ndarray, " T"], air: Air, steps: int) -> Joined:
    """The flights that fit the states best and meet at their contacts.

    Args:
        states: With small errors where a frame must be met.
        flights: Which frames are in which.
        given: Frames whose errors are known, and not guessed: they weigh in full.
        air: What flights are under.
        steps: Of Gauss and Newton.
    """
    start = np.concatenate(
        [flights.position[flights.first], flights.velocity[flights.first], _turns(flights, air.turn_std)], axis=1
    )
    count = len(flights.first) - 1
    found = Joined(
        first=flights.first,
        last=flights.last,
        rolls=flights.rolls,
        held=flights.held,
        start=start,
        moment=0.5 * (states.times[flights.last[:-1]] + states.times[flights.first[1:]]),
        tied=np.zeros(count, dtype=bool),
        bounce=np.zeros(count, dtype=bool),
        hitter=np.full(count, -1),
    )
    fit = _Fit(states, found, given, air)
    for _ in range(2):
        found = fit.improved(found)
    return _improved(_with_contacts(found, states, air), fit, steps)


def rejoined_flights(
    found: Joined,
    states: States,
    given: Bool[np.ndarray, " T"],
    stray: Bool[np.ndarray, " T"],
    air: Air,
    reach: Reach,
    steps: int,
) -> Joined:
    """Flights whose contacts were moved, fitted together again; strokes within reach of their hitters.

    Frames that are `stray` belong to no flight; other arguments as of `joined_flights`.
    """
    return _improved(found, _Fit(states, found, given, air, reach, stray), steps)


def _improved(found: Joined, fit: "_Fit", steps: int) -> Joined:
    for step in range(steps):
        found = fit.improved(found, within=step >= steps // 2)
    return found


def _turns(flights: Flights, turn_std: float) -> np.ndarray:
    """Turns that bend flights as their steady accelerations do, halfway."""
    velocity = flights.velocity[(flights.first + flights.last) // 2]
    turn = np.cross(velocity, flights.pull) / np.maximum((velocity**2).sum(axis=1, keepdims=True), 1.0)
    return turn.clip(-2 * turn_std, 2 * turn_std)


def states_at(
    found: Joined, flight: Int[np.ndarray, " n"], seconds: Float[np.ndarray, " n"], world: BallWorld
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
    """Positions and velocities of flights so long after their first frames."""
    return _moved(found.start[flight], found.rolls[flight], seconds, world)


def _moved(
    start: Float[np.ndarray, "*batch n 9"], rolls: Bool[np.ndarray, " n"], seconds: np.ndarray, world: BallWorld
) -> tuple[np.ndarray, np.ndarray]:
    place, velocity, turn = start[..., :3], start[..., 3:6], start[..., 6:]
    p, v = flown(place, velocity, np.broadcast_to(seconds, place.shape[:-1]), world.drag_per_m.mean, turn)
    if rolls.any():
        p = np.where(rolls[:, None], place + velocity * seconds[:, None], p)
        v = np.where(rolls[:, None], velocity, v)
    return p, v


def _with_contacts(found: Joined, states: States, air: Air) -> Joined:
    """When flights meet best, and whether on the ground; not tied where they do not meet."""
    before, world = np.arange(len(found.moment)), air.world
    if not len(before):
        return found
    begun, ended = states.times[found.last[:-1]], states.times[found.first[1:]]
    moments = begun + np.linspace(0.0, 1.0, SAMPLES)[:, None] * (ended - begun)
    many = np.tile(before, (SAMPLES, 1)).ravel()
    one, v = states_at(found, many, (moments - states.times[found.first[:-1]]).ravel(), world)
    two, w = states_at(found, many + 1, (moments - ended).ravel(), world)
    ground = ground_of(0.5 * (one + two), world)
    miss = np.linalg.norm(one - two, axis=1).reshape(moments.shape)
    landed = np.linalg.norm(
        np.column_stack([(one - two)[:, :2], one[:, 2] - ground, two[:, 2] - ground]), axis=1
    ).reshape(moments.shape)
    falls = ((v[:, 2] < -SLIGHT_M_S) & (w[:, 2] > SLIGHT_M_S)).reshape(moments.shape)
    # What goes on as it did has bounced; a ball hit as low as that comes back.
    on = ((v[:, :2] * w[:, :2]).sum(axis=1) > 0) | (np.hypot(v[:, 0], v[:, 1]) < 2.0)
    landed = np.where(falls & on.reshape(moments.shape) & world.bounces, landed, np.inf)
    landed[:, found.rolls[:-1] | found.rolls[1:]] = np.inf
    sizes = np.maximum(states.error_m[found.last[:-1]], states.error_m[found.first[1:]]).max(axis=1)
    allowed = np.maximum(air.miss_m, air.miss_errors * sizes)
    bounce = landed.min(axis=0) < allowed
    at = np.where(bounce, landed.argmin(axis=0), miss.argmin(axis=0))
    flies = ~(found.held[:-1] | found.held[1:])
    return replace(
        found,
        moment=moments[at, before],
        tied=flies & (bounce | (miss.min(axis=0) < allowed)),
        bounce=flies & bounce,
    )


class _Fit:
    """Gauss-Newton steps for the flights of one path. Unknowns: nine a flight, then the moment of the contact after."""

    def __init__(
        self,
        states: States,
        flights: Joined,
        given: np.ndarray,
        air: Air,
        reach: Reach | None = None,
        stray: np.ndarray | None = None,
    ) -> None:
        self._states, self._air, self._given, self._reach = states, air, given, reach
        flight = flight_of(flights.first, flights.last, len(states.times))
        inside = (flight >= 0) & ~flights.held[flight]
        self._frames = np.flatnonzero(inside if stray is None else inside & ~stray)
        self._flight = flight[self._frames]
        self._seconds = states.times[self._frames] - states.times[flights.first[self._flight]]
        self._low = np.zeros(len(self._frames), dtype=bool)

    def improved(self, found: Joined, *, within: bool = False) -> Joined:
        """One step; `within` holds bounces to the speeds that the ground can give back."""
        tied = np.flatnonzero(found.tied)
        sides = [(tied, found.moment[tied] - self._states.times[found.first[tied]])]
        sides.append((tied + 1, found.moment[tied] - self._states.times[found.first[tied + 1]]))
        asked = [(self._flight, self._seconds), *sides]
        every = self._slopes(found, *(np.concatenate(part) for part in zip(*asked, strict=True)))
        ends = np.cumsum([len(flight) for flight, _ in asked])[:-1]
        at, before, after = zip(*(np.split(part, ends) for part in every), strict=True)
        parts = [*self._of_states(found, at), *self._of_starts(found)]
        if len(tied):
            parts += self._of_contacts(found, tied, before, after, within=within)
        count = 10 * len(found.first)
        rows, offset = [], 0
        for _, residual, _ in parts:
            rows.append(offset + np.arange(len(residual)))
            offset += len(residual)
        columns = np.concatenate([column.ravel() for column, _, _ in parts])
        row = np.concatenate([np.repeat(r, column.shape[1]) for r, (column, _, _) in zip(rows, parts, strict=True)])
        values = np.concatenate([slope.ravel() for _, _, slope in parts])
        residual = np.concatenate([residual for _, residual, _ in parts])
        slopes = csc_array((values, (row, columns)), shape=(offset, count))
        normal = slopes.T @ slopes
        normal = csc_array(normal + diags_array(1e-10 * normal.diagonal() + HOLD))
        change = np.asarray(spsolve(normal, -(slopes.T @ residual))).reshape(-1, 10)
        begun = self._states.times[found.last[:-1]]
        ended = self._states.times[found.first[1:]]
        # Far steps are cut short: what is linear here is not so there.
        start = found.start + change[:, :9].clip(-FARTHEST, FARTHEST)
        most = MOST_TURN * self._air.turn_std
        return replace(
            found,
            start=np.concatenate([start[:, :6], start[:, 6:].clip(-most, most)], axis=1),
            moment=(found.moment + change[:-1, 9]).clip(begun, ended),
        )

    def _slopes(
        self, found: Joined, flight: np.ndarray, seconds: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Places and velocities of flights, and how they change with the flights' starts, (n, 3, 9)."""
        sizes = np.array([1e-3] * 3 + [1e-4] * 3)
        start = np.tile(found.start[flight], (7, 1, 1))
        start[np.arange(1, 7), :, np.arange(3, 9)] += sizes[:, None]
        p, v = _moved(start, found.rolls[flight], seconds, self._air.world)
        by_place, by_speed = (np.zeros((len(flight), 3, 9)) for _ in range(2))
        by_place[:, :, :3] = np.eye(3)
        by_place[:, :, 3:] = np.moveaxis((p[1:] - p[0]) / sizes[:, None, None], 0, -1)
        by_speed[:, :, 3:] = np.moveaxis((v[1:] - v[0]) / sizes[:, None, None], 0, -1)
        return p[0], v[0], by_place, by_speed

    def _of_states(
        self, found: Joined, at: Sequence[np.ndarray]
    ) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """Columns, residuals and slopes of what is given of the path, and of frames that would be underground."""
        p, v, by_p, by_v = at
        states, frames = self._states, self._frames
        off_p = (p - states.position[frames]) / states.error_m[frames]
        off_v = (v - states.velocity[frames]) / states.error_m_s[frames]
        squared = (off_p**2 + off_v**2).sum(axis=1)
        # A frame that disagrees more than errors do weighs less (Cauchy's weights).
        weight = np.where(self._given[frames], 1.0, 1.0 / np.sqrt(1.0 + squared / 18.0)) / np.sqrt(states.alike)
        weight = np.where(self._given[frames], 1.0, weight)
        columns = 10 * self._flight[:, None] + np.arange(9)
        for off, by, error in ((off_p, by_p, states.error_m[frames]), (off_v, by_v, states.error_m_s[frames])):
            for axis in range(3):
                yield columns, weight * off[:, axis], by[:, axis] * (weight / error[:, axis])[:, None]
        # Frames below the ground are put on it, and stay there as long as they are not well above.
        under = p[:, 2] - ground_of(p, self._air.world)
        self._low = (under < np.where(self._low, 5 * ABOVE_M, 0.0)) & ~found.rolls[self._flight] & found.tied.any()
        low = self._low
        yield columns[low], under[low] / ABOVE_M, by_p[low, 2] / ABOVE_M

    def _of_starts(self, found: Joined) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """How turns are distributed; and what rolls is on the ground."""
        flights, turn_std = np.arange(len(found.first)), self._air.turn_std
        turn = np.where(found.rolls, TIED_M, max(turn_std, TIED_M))
        for axis in range(6, 9):
            yield (10 * flights + axis)[:, None], found.start[:, axis] / turn, (1.0 / turn)[:, None]
        rolling = flights[found.rolls]
        ground = ground_of(found.start[rolling, :3], self._air.world)
        ones = np.ones((len(rolling), 1))
        yield 10 * rolling[:, None] + 2, (found.start[rolling, 2] - ground) / TIED_M, ones / TIED_M
        yield 10 * rolling[:, None] + 5, found.start[rolling, 5] / TIED_M_S, ones / TIED_M_S

    def _of_contacts(
        self,
        found: Joined,
        tied: np.ndarray,
        one_side: Sequence[np.ndarray],
        other_side: Sequence[np.ndarray],
        *,
        within: bool,
    ) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """Flights meet; on the ground, with the speeds that it gives back, where they bounce."""
        world, times = self._air.world, self._states.times
        (p, v, p_by, v_by), (q, w, q_by, w_by) = one_side, other_side
        before, after = 10 * tied[:, None] + np.arange(9), 10 * (tied + 1)[:, None] + np.arange(9)
        moment = 10 * tied[:, None] + 9
        columns = np.concatenate([before, after, moment], axis=1)
        bounce = found.bounce[tied]
        for axis in range(3):
            slope = np.concatenate([p_by[:, axis], -q_by[:, axis], (v - w)[:, axis, None]], axis=1)
            yield columns, (p - q)[:, axis] / TIED_M, slope / TIED_M
        slope = np.concatenate([p_by[bounce, 2], v[bounce, 2, None]], axis=1)
        one = np.concatenate([before, moment], axis=1)[bounce]
        yield one, (p[bounce, 2] - ground_of(p[bounce], world)) / TIED_M, slope / TIED_M
        yield from self._of_strokes(found, tied, before, moment, one_side)
        step = 0.25 * (times[found.first[tied + 1]] - times[found.last[tied]])
        yield moment, np.zeros(len(tied)), (1.0 / step)[:, None]
        if world.restitution is None or not bounce.any():
            return
        down, up = v[bounce, 2], w[bounce, 2]
        mean, std = world.restitution.mean, world.restitution.std
        kept = -up / np.minimum(down, -SLIGHT_M_S)
        both = np.concatenate([before, after], axis=1)[bounce]
        goals = [(np.full_like(kept, mean), std * np.maximum(-down, 1.0))]
        if within:
            goals.append((kept.clip(mean - 2 * std, min(mean + 2 * std, 1.0)), np.full_like(kept, TIED_M_S)))
        for goal, error in goals:
            slope = np.concatenate([goal[:, None] * v_by[bounce, 2], w_by[bounce, 2]], axis=1)
            yield both, (up + goal * down) / error, slope / error[:, None]

    def _of_strokes(
        self,
        found: Joined,
        tied: np.ndarray,
        before: np.ndarray,
        moment: np.ndarray,
        one_side: Sequence[np.ndarray],
    ) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """Strokes that are out of their hitters' reach are drawn to its edge."""
        rows = np.flatnonzero(found.hitter[tied] >= 0)
        if self._reach is None or not len(rows):
            return
        p, v, p_by, _ = (part[rows] for part in one_side)
        at = self._reach.roots_at(found.moment[tied[rows]], self._states.times)
        off = p[:, :2] - at[np.arange(len(rows)), found.hitter[tied[rows]], :2]
        away = np.linalg.norm(off, axis=1)
        far = away > self._reach.level_m
        towards = (off / np.maximum(away, 1e-9)[:, None])[far]
        slope = np.concatenate(
            [np.einsum("na,nak->nk", towards, p_by[far, :2]), (towards * v[far, :2]).sum(axis=1)[:, None]], axis=1
        )
        columns = np.concatenate([before[rows], moment[rows]], axis=1)[far]
        yield columns, (away[far] - self._reach.level_m) / REACH_M, slope / REACH_M
