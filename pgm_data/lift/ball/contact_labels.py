"""What touched the ball at each moment of its track: the cheapest chain of flights, and how sure its links are."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from pgm_data.lift.ball.contact_flights import KINDS, Hypotheses, Moments
from pgm_data.lift.ball.contact_motion import velocity_scale
from pgm_data.lift.ball.world import BallWorld

HIT, BOUNCE, NET, FIRST, LAST = range(5)


@dataclass(frozen=True, eq=False, kw_only=True)
class Rates:
    """How often things happen."""

    hit_per_s: float
    net_share: float
    """Share of flights to the net that touch it."""
    play_per_s: float
    """Beginnings and ends of play."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Chain:
    """The cheapest labelling."""

    moments: Int[np.ndarray, " contacts"]
    kinds: Int[np.ndarray, " contacts"]
    """Index into `KINDS`."""
    flights: Int[np.ndarray, " contacts"]
    """Row of the hypotheses that starts there; -1 where none does."""
    shares: Float[np.ndarray, "moments kinds"]
    """How likely each kind is at each moment, summed over all chains."""
    cost: float


@dataclass(frozen=True, eq=False, kw_only=True)
class _Links:
    """Pairs of flights that meet at a moment, and what each kind of contact between them costs."""

    before: np.ndarray
    after: np.ndarray
    kind: np.ndarray
    cost: np.ndarray


def link_costs(flights: Hypotheses, moments: Moments, *, world: BallWorld, rates: Rates) -> _Links:
    """All pairs of flights that meet, once for each kind of contact that they allow."""
    before, after = _pairs(flights)
    ground = flights.end_on_ground[before]
    low = np.flatnonzero(ground)
    free = np.flatnonzero(~ground)
    parts = []
    if len(low):
        cost = _bounce_costs(flights, before[low], after[low], moments, world)
        parts.append((before[low], after[low], np.full(len(low), BOUNCE), cost))
    if len(free):
        meeting = _meeting_costs(flights, before[free], after[free], moments)
        hit = meeting + _hit_costs(flights, before[free], after[free], world, rates)
        parts.append((before[free], after[free], np.full(len(free), HIT), hit))
        if len(world.net_xz):
            net = meeting + _net_costs(flights, before[free], after[free], world, rates)
            parts.append((before[free], after[free], np.full(len(free), NET), net))
    if not parts:
        empty = np.zeros(0, dtype=np.int64)
        return _Links(before=empty, after=empty, kind=empty, cost=np.zeros(0))
    before, after, kind, cost = (np.concatenate(values) for values in zip(*parts, strict=True))
    at = flights.end[before]
    cost = cost + moments.bias[at, kind] - np.log(2.5 * moments.time_std[at])
    good = np.isfinite(cost)
    return _Links(before=before[good], after=after[good], kind=kind[good], cost=cost[good])


def _pairs(flights: Hypotheses) -> tuple[np.ndarray, np.ndarray]:
    """Rows of flights that end where and how others begin."""
    ends = 2 * flights.end + flights.end_on_ground
    begins = 2 * flights.begin + flights.begin_on_ground
    order = np.argsort(begins, kind="stable")
    first = np.searchsorted(begins[order], ends, side="left")
    count = np.searchsorted(begins[order], ends, side="right") - first
    before = np.repeat(np.arange(len(ends)), count)
    within = np.arange(len(before)) - np.repeat(np.cumsum(count) - count, count)
    return before, order[np.repeat(first, count) + within]


def _gauss(off: np.ndarray, cov: np.ndarray) -> np.ndarray:
    """Negative log density of zero-mean Gaussians."""
    size = off.shape[-1]
    cov = 0.5 * (cov + np.swapaxes(cov, 1, 2)) + 1e-8 * np.eye(size)
    solved = np.linalg.solve(cov, off[..., None])[..., 0]
    return 0.5 * (np.sum(off * solved, axis=1) + np.linalg.slogdet(cov)[1] + size * np.log(2 * np.pi))


def _meeting_costs(flights: Hypotheses, before: np.ndarray, after: np.ndarray, moments: Moments) -> np.ndarray:
    """Both flights must be at one place; the second one's prior of it is taken back."""
    fits = flights.fits
    late = moments.time_std[flights.end[before]]
    turn = fits.end[before, 3:] - fits.start[after, 3:]
    cov = fits.end_cov[before, :3, :3] + fits.start_cov[after, :3, :3]
    cov = cov + late[:, None, None] ** 2 * turn[:, :, None] * turn[:, None, :] + 0.03**2 * np.eye(3)
    return _gauss(fits.end[before, :3] - fits.start[after, :3], cov) - _start_prior(flights, after, 3)


def _start_prior(flights: Hypotheses, after: np.ndarray, size: int) -> np.ndarray:
    """Negative log of the prior density that the fit gave its start."""
    off = flights.fits.start_off[after, :size]
    std = flights.fits.start_prior_std[after, :size]
    return np.sum(0.5 * (off / std) ** 2 + np.log(std * np.sqrt(2 * np.pi)), axis=1)


def _bounce_costs(
    flights: Hypotheses, before: np.ndarray, after: np.ndarray, moments: Moments, world: BallWorld
) -> np.ndarray:
    """The bounce law between the velocities, one place, and the time at which the first flight meets the ground."""
    e, mu = world.restitution, world.friction
    if e is None:
        return np.full(len(before), np.inf)
    fits = flights.fits
    late = moments.time_std[flights.end[before]]
    p0, v0 = fits.end[before, :3], fits.end[before, 3:]
    p1, v1 = fits.start[after, :3], fits.start[after, 3:]
    down = np.maximum(-v0[:, 2], 0.05)
    flat = np.linalg.norm(v0[:, :2], axis=1)
    loss = (0.5 * mu.mean if mu is not None else 0.2) * (1 + e.mean) * down
    kept = 1 - np.minimum(loss / np.maximum(flat, 1e-3), 0.5)
    expected = np.concatenate([kept[:, None] * v0[:, :2], (e.mean * down)[:, None]], axis=1)
    law = np.zeros((len(before), 6, 6))
    law[:, [0, 1, 2], [0, 1, 2]] = 1.0
    law[:, 3, 3] = law[:, 4, 4] = kept
    law[:, 5, 5] = -e.mean
    cov = law @ fits.end_cov[before] @ np.swapaxes(law, 1, 2) + fits.start_cov[after]
    turn = v0 - v1
    cov[:, :3, :3] += late[:, None, None] ** 2 * turn[:, :, None] * turn[:, None, :] + 0.03**2 * np.eye(3)
    sideways = 0.6 * loss + 0.06 * flat + 0.1
    cov[:, 3, 3] += sideways**2
    cov[:, 4, 4] += sideways**2
    cov[:, 5, 5] += ((e.std + 0.05) * down + 0.1) ** 2
    meeting = _gauss(np.concatenate([p0 - p1, expected - v1], axis=1), cov) - _start_prior(flights, after, 6)
    # The time of a bounce follows from the flight: a density in time, of which the fit has the exponent.
    deep = np.hypot(0.02 + 0.3 * world.radius_m, late * down)
    when = np.log(deep * np.sqrt(2 * np.pi)) - np.log(np.maximum(down, 0.3))
    upward = np.minimum(4.0 * np.maximum(v0[:, 2], 0.0) + 4.0 * np.maximum(-v1[:, 2], 0.0), 40.0)
    return meeting + when + upward


def _hit_costs(
    flights: Hypotheses, before: np.ndarray, after: np.ndarray, world: BallWorld, rates: Rates
) -> np.ndarray:
    """How seldom hits are; they send the ball back, towards the net."""
    fits = flights.fits
    came, goes = fits.end[before, 4], fits.start[after, 4]
    slow = 0.05 * velocity_scale(world)[1]
    y = fits.start[after, 1]
    onwards = (came * goes > 0) & (np.abs(came) > slow) & (np.abs(goes) > slow)
    away = (y * goes > 0) & (np.abs(y) > 0.1 * world.reach_half_size[1]) & (np.abs(goes) > slow)
    # A stroke sends the ball to the other side: hardly ever slowly.
    slack = fits.start_cov[after, 4, 4]
    size = (2.5 * slow) ** 2
    weak = 12.0 * np.exp(-(goes**2) / (size + 2 * slack)) * np.sqrt(size / (size + 2 * slack))
    # Nobody stands at the net itself.
    aside = (0.05 * world.reach_half_size[1]) ** 2
    slack = fits.start_cov[after, 1, 1]
    middle = 3.0 * np.exp(-0.5 * y**2 / (aside + slack)) * np.sqrt(aside / (aside + slack))
    return -np.log(rates.hit_per_s) + 3.0 * onwards + 3.0 * away + weak + middle


def _net_costs(
    flights: Hypotheses, before: np.ndarray, after: np.ndarray, world: BallWorld, rates: Rates
) -> np.ndarray:
    """A touch of the net: at y = 0, not over its top, and slower after."""
    fits = flights.fits
    p, v = fits.end[before, :3], fits.end[before, 3:]
    goes = fits.start[after, 3:]
    var = fits.end_cov[before, 1, 1] + 0.15**2
    across = 0.5 * p[:, 1] ** 2 / var + 0.5 * np.log(2 * np.pi * var) - np.log(np.maximum(np.abs(v[:, 1]), 0.3))
    top = np.interp(p[:, 0], world.net_xz[:, 0], world.net_xz[:, 1], left=-np.inf, right=-np.inf)
    tall = 0.15 * (world.net_xz[:, 1].max() - 0.0)
    over = np.maximum(p[:, 2] - top - tall, 0.0)
    high = np.minimum(0.5 * over**2 / (fits.end_cov[before, 2, 2] + tall**2), 40.0)
    faster = np.linalg.norm(goes, axis=1) > 1.1 * np.linalg.norm(v, axis=1)
    return -np.log(rates.net_share) + across + np.where(np.isfinite(high), high, 40.0) + 4.0 * faster


def cheapest_chain(
    flights: Hypotheses,
    links: _Links,
    moments: Moments,
    idle: Float[np.ndarray, " gaps"],
    *,
    rates: Rates,
    temperature: float,
) -> Chain:
    """The cheapest way through all moments, in flight or idle, and the shares of all ways."""
    rare = -np.log(rates.play_per_s) - np.log(2.5 * moments.time_std)
    starts = np.where(flights.begin_on_ground, np.inf, 0.0) + (rare + moments.bias[:, FIRST])[flights.begin]
    stops = np.where(flights.end_on_ground, np.inf, 0.0) + (rare + moments.bias[:, LAST])[flights.end]
    served = (rare - np.log(rates.hit_per_s) + 1.0 + moments.bias[:, HIT])[flights.begin]
    served = np.where(flights.begin_on_ground, np.inf, served)
    best = _Pass(flights, links, idle, moments.must, starts, served, stops, scale=1.0)
    forward, came, idle_from = best.forwards(hard=True)
    chain = best.walk_back(forward, came, idle_from, len(moments.times))
    soft = _Pass(flights, links, idle, moments.must, starts, served, stops, scale=1 / temperature)
    shares = soft.shares(len(moments.times))
    return Chain(
        moments=np.array([m for m, _, _ in chain], dtype=np.int64),
        kinds=np.array([k for _, k, _ in chain], dtype=np.int64),
        flights=np.array([f for _, _, f in chain], dtype=np.int64),
        shares=shares,
        cost=float(forward[1][-1]),
    )


class _Pass:
    """Sums or minima over chains. A state is a flight, or idleness at a moment."""

    def __init__(self, flights, links, idle, must, starts, served, stops, *, scale: float) -> None:
        self.flights, self.links, self.must = flights, links, must
        self.idle = idle * scale
        self.held = np.where(must, 12.0, 0.0) * scale
        self.starts, self.served, self.stops = starts * scale, served * scale, stops * scale
        self.own, self.link = flights.cost * scale, links.cost * scale
        self.by_begin = _groups(flights.begin, len(must))
        self.by_end = _groups(flights.end, len(must))
        self.link_at = _groups(flights.end[links.before], len(must))

    def forwards(self, *, hard: bool):
        """Cost of reaching the end of each flight, and idleness at each moment; where the least came from."""
        count, flights = len(self.must), len(self.own)
        reached = np.full(flights, np.inf)
        came = np.full(flights, -2)
        idle = np.full(count, np.inf)
        idle_from = np.full(count, -1)
        for m in range(count):
            into = self.by_end[m]
            if m == 0:
                idle[m] = 0.0
            else:
                ways = np.concatenate(
                    [[idle[m - 1] + self.idle[m - 1] + self.held[m]], reached[into] + self.stops[into]]
                )
                idle[m], pick = _least(ways, hard)
                idle_from[m] = -1 if pick == 0 else into[pick - 1]
            entry = idle[m] - self.held[m] if m == 0 or idle_from[m] == -1 else idle[m]
            out = self.by_begin[m]
            if not len(out):
                continue
            fresh = np.stack([entry + self.starts[out], entry + self.served[out]])
            cost = fresh.min(axis=0) if hard else -np.logaddexp(-fresh[0], -fresh[1])
            source = np.where(fresh[0] <= fresh[1], -2, -3)
            rows = self.link_at[m]
            if len(rows):
                slot = np.searchsorted(out, self.links.after[rows])
                ways = reached[self.links.before[rows]] + self.link[rows]
                if hard:
                    order = np.argsort(ways, kind="stable")[::-1]
                    least, which = np.full(len(out), np.inf), np.full(len(out), -1)
                    least[slot[order]], which[slot[order]] = ways[order], rows[order]
                    better = least < cost
                    cost, source = np.where(better, least, cost), np.where(better, which, source)
                else:
                    total = -cost
                    np.logaddexp.at(total, slot, -ways)
                    cost = -total
            reached[out] = cost + self.own[out]
            came[out] = source
        return (reached, idle), came, idle_from

    def walk_back(self, forward, came, idle_from, count: int) -> list[tuple[int, int, int]]:
        """Contacts of the cheapest chain: moment, kind, flight that starts there."""
        chain: list[tuple[int, int, int]] = []
        m = count - 1
        while m > 0:
            flight = int(idle_from[m])
            if flight < 0:
                m -= 1
                continue
            chain.append((m, LAST, -1))
            while True:
                source = int(came[flight])
                m = int(self.flights.begin[flight])
                if source < 0:
                    if source == -3:
                        chain.append((m, HIT, flight))
                    chain.append((m, FIRST, -1 if source == -3 else flight))
                    break
                chain.append((m, int(self.links.kind[source]), flight))
                flight = int(self.links.before[source])
        return chain[::-1]

    def shares(self, count: int) -> np.ndarray:
        """Share of each kind at each moment over all chains."""
        (reached, idle), _, _ = self.forwards(hard=False)
        onward = np.full(len(self.own), np.inf)
        idle_on = np.full(count, np.inf)
        idle_on[-1] = 0.0
        for m in range(count - 1, -1, -1):
            out = self.by_begin[m]
            if m < count - 1:
                held = self.held[m + 1]
                ways = [idle_on[m + 1] + self.idle[m] + held]
                ways.extend(-np.logaddexp(-self.starts[out], -self.served[out]) + self.own[out] + onward[out])
                idle_on[m] = _least(np.array(ways), False)[0]
            into = self.by_end[m]
            if not len(into):
                continue
            total = -(self.stops[into] + idle_on[m])
            rows = self.link_at[m]
            if len(rows):
                after = self.links.after[rows]
                slot = np.searchsorted(into, self.links.before[rows])
                np.logaddexp.at(total, slot, -(self.link[rows] + self.own[after] + onward[after]))
            onward[into] = -total
        whole = idle[-1]
        shares = np.zeros((count, len(KINDS)))
        links = self.links
        with np.errstate(under="ignore", invalid="ignore"):
            chance = np.exp(
                np.minimum(whole - reached[links.before] - self.link - self.own[links.after] - onward[links.after], 0.0)
            )
            np.add.at(shares, (self.flights.end[links.before], links.kind), np.nan_to_num(chance))
            first = np.exp(np.minimum(whole - idle[self.flights.begin] - self.starts - self.own - onward, 0.0))
            serve = np.exp(np.minimum(whole - idle[self.flights.begin] - self.served - self.own - onward, 0.0))
            last = np.exp(np.minimum(whole - reached - self.stops - idle_on[self.flights.end], 0.0))
        np.add.at(shares, (self.flights.begin, FIRST), np.nan_to_num(first + serve))
        np.add.at(shares, (self.flights.begin, HIT), np.nan_to_num(serve))
        np.add.at(shares, (self.flights.end, LAST), np.nan_to_num(last))
        return np.minimum(shares, 1.0)


def _least(ways: np.ndarray, hard: bool) -> tuple[float, int]:
    pick = int(ways.argmin())
    if hard or not np.isfinite(ways[pick]):
        return float(ways[pick]), pick
    return float(ways[pick] - np.log(np.sum(np.exp(ways[pick] - ways)))), pick


def _groups(values: np.ndarray, count: int) -> list[np.ndarray]:
    """Rows that hold each value, rising."""
    order = np.argsort(values, kind="stable")
    edges = np.searchsorted(values[order], np.arange(count + 1))
    return [np.sort(order[edges[k] : edges[k + 1]]) for k in range(count)]
