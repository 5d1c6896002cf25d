"""Flights that a ball may have made between any two moments of its track, each fitted and priced."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from pgm_data.lift.ball.contact_motion import Sights
from pgm_data.lift.ball.quick_flight import TURNS, FlightFits, fit_flights, flight_guess
from pgm_data.lift.ball.world import BallWorld

LONGEST_FLIGHT = 40.0
"""s."""
GROUND_MARGIN = 0.3
"""How far beyond the ground's edge a bounce may seem to lie: metres, and the same share of the ground's extent."""
MOST_IDLE = 5.5
"""What an idle frame costs at most more than one of a flight, nats; below what a stray costs."""
FEW = 7
"""So many moments on, every flight is tried, whatever its toll."""
MOST_PASSED = 48
"""Moments of all kinds that one flight may pass over."""
SPARE = 40.0
"""Flights dearer than idleness by more are left out, nats."""
CHUNK = 200_000
"""Frames of hypotheses fitted at a time, to bound memory."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Moments:
    """Times at which something may have touched the ball, rising, and what it may have been."""

    times: Float[np.ndarray, " moments"]
    time_std: Float[np.ndarray, " moments"]
    may_bounce: Bool[np.ndarray, " moments"]
    may_be_free: Bool[np.ndarray, " moments"]
    """Whether the ball may be above the ground there."""
    must: Bool[np.ndarray, " moments"]
    """A person says that something happened: no flight passes through it."""
    toll: Float[np.ndarray, " moments"]
    """What a smooth flight past it would cost at least, nats: much where the track bends sharply."""
    bias: Float[np.ndarray, "moments kinds"]
    """What each kind costs there beyond the rest, nats, in the order of `KINDS`; inf where it is excluded."""


KINDS = ("hit", "bounce", "net", "first", "last")


@dataclass(frozen=True, eq=False, kw_only=True)
class Hypotheses:
    """Flights between two moments, with both ends free or on the ground."""

    begin: Int[np.ndarray, " flights"]
    end: Int[np.ndarray, " flights"]
    begin_on_ground: Bool[np.ndarray, " flights"]
    end_on_ground: Bool[np.ndarray, " flights"]
    cost: Float[np.ndarray, " flights"]
    """Nats."""
    fits: FlightFits
    """Row for row."""


def idle_costs(sights: Sights, times: np.ndarray, rate: float, step: float) -> np.ndarray:
    """What it costs, nats, that from one moment to the next the ball is in no flight: frames times their rate."""
    count = np.diff(np.searchsorted(sights.times, times))
    return count * min(rate * step, MOST_IDLE)


def price_flights(
    sights: Sights,
    moments: Moments,
    *,
    world: BallWorld,
    toll: float,
    idle: Float[np.ndarray, " gaps"],
    thinning: int,
) -> Hypotheses:
    """All flights that pass moments of no more than this toll and are not far dearer than no flight at all."""
    begin, end = _spans(moments, toll)
    kinds = [
        (b, e)
        for b in (False, True)
        for e in (False, True)
        if (not b or moments.may_bounce.any()) and (not e or moments.may_bounce.any())
    ]
    rows = np.concatenate([np.stack([begin, end, np.full_like(begin, b), np.full_like(begin, e)], 1) for b, e in kinds])
    b_ground, e_ground = rows[:, 2] == 1, rows[:, 3] == 1
    fine = np.where(b_ground, moments.may_bounce[rows[:, 0]], moments.may_be_free[rows[:, 0]])
    fine &= np.where(e_ground, moments.may_bounce[rows[:, 1]], moments.may_be_free[rows[:, 1]])
    rows, b_ground, e_ground = rows[fine], b_ground[fine], e_ground[fine]
    spent = np.concatenate([[0.0], np.cumsum(idle)])
    allowed = spent[rows[:, 1]] - spent[rows[:, 0]] + SPARE
    few = sights.thinned(thinning)
    # A few turns on fewer frames tell the hopeless ones.
    _, cost = _fit_by_length(few, moments, rows, world, turns=3)
    hopeful = cost < allowed + SPARE
    rows, b_ground, e_ground, allowed = (values[hopeful] for values in (rows, b_ground, e_ground, allowed))
    fits, cost = _fit_by_length(sights, moments, rows, world, turns=TURNS)
    good = cost < allowed
    return Hypotheses(
        begin=rows[good, 0],
        end=rows[good, 1],
        begin_on_ground=b_ground[good],
        end_on_ground=e_ground[good],
        cost=cost[good],
        fits=_taken(fits, good),
    )


def _spans(moments: Moments, toll: float) -> tuple[np.ndarray, np.ndarray]:
    count = len(moments.times)
    paid = np.concatenate([[0.0], np.cumsum(moments.toll)])
    most = np.searchsorted(paid[1:], paid[1:] + toll, side="right") - np.arange(count)
    far = max(FEW, min(int(most.max(initial=1)), MOST_PASSED))
    begin, end = (part.ravel() for part in np.meshgrid(np.arange(count), np.arange(1, far + 1), indexing="ij"))
    end = begin + end
    inside = end < count
    begin, end = begin[inside], end[inside]
    passable = (paid[end] - paid[begin + 1] <= toll) | (end - begin <= FEW)
    begin, end = begin[passable], end[passable]
    stops = np.concatenate([[0], np.cumsum(moments.must)])
    open_between = stops[end] - stops[begin + 1] == 0
    length = moments.times[end] - moments.times[begin]
    kept = open_between & (length > 1e-3) & (length < LONGEST_FLIGHT)
    return begin[kept], end[kept]


def _fit_by_length(
    sights: Sights, moments: Moments, rows: np.ndarray, world: BallWorld, *, turns: int
) -> tuple[FlightFits, np.ndarray]:
    """Fits in the order of the rows; flights of like length are fitted together."""
    begins, ends = moments.times[rows[:, 0]], moments.times[rows[:, 1]]
    count = np.searchsorted(sights.times, ends, side="right") - np.searchsorted(sights.times, begins)
    order = np.argsort(count, kind="stable")
    parts: list[FlightFits] = []
    at = 0
    while at < len(order) or not parts:
        least = count[order[at]] if len(order) else 0
        stop = int(np.searchsorted(count[order], max(8, 1.5 * least), side="right"))
        stop = min(max(stop, at + 1), at + max(1, CHUNK // max(int(count[order[at:stop]].max(initial=1)), 1)))
        part = order[at:stop]
        guess = flight_guess(
            begin_on_ground=rows[part, 2] == 1,
            end_on_ground=rows[part, 3] == 1,
            begin_time_std=moments.time_std[rows[part, 0]],
            end_time_std=moments.time_std[rows[part, 1]],
            world=world,
        )
        parts.append(fit_flights(sights, begins[part], ends[part], guess, world=world, turns=turns))
        at = stop
    back = np.argsort(order, kind="stable")
    fits = _taken(_joined(parts), back)
    return fits, fits.cost + rule_costs(fits, world)


def rule_costs(fits: FlightFits, world: BallWorld) -> Float[np.ndarray, " flights"]:
    """What flights cost that run under the ground or through the net, nats."""
    x, y, z = np.moveaxis(fits.path, -1, 0)
    half = world.ground_half_size
    over = (np.abs(x) < half[0]) & (np.abs(y) < half[1])
    floor = np.where(over, 0.0, world.floor_z)
    scale = 0.15 if world.floor_z == 0 else 0.08
    under = np.maximum(floor - z - 0.5 * scale, 0.0).max(axis=1)
    cost = np.minimum((under / scale) ** 2, 40.0)
    if not len(world.net_xz):
        return cost
    crossing = (y[:, :-1] * y[:, 1:] < 0) & (np.abs(y[:, :-1] - y[:, 1:]) > 1e-9)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(crossing, y[:, :-1] / (y[:, :-1] - y[:, 1:]), 0.0)
    cross_x, cross_z = x[:, :-1] + share * np.diff(x, axis=1), z[:, :-1] + share * np.diff(z, axis=1)
    top = np.interp(cross_x, world.net_xz[:, 0], world.net_xz[:, 1], left=-np.inf, right=-np.inf)
    low = np.where(crossing, top - cross_z, -np.inf).max(axis=1)
    return cost + np.clip(8.0 * (low / scale - 0.5), 0.0, 8.0)


def _joined(parts: list[FlightFits]) -> FlightFits:
    longest = max(part.path.shape[1] for part in parts)

    def padded(path: np.ndarray) -> np.ndarray:
        return np.concatenate([path, np.repeat(path[:, -1:], longest - path.shape[1], axis=1)], axis=1)

    return FlightFits(
        **{
            name: np.concatenate([getattr(part, name) for part in parts])
            for name in (
                "cost",
                "start",
                "start_cov",
                "end",
                "end_cov",
                "start_off",
                "start_prior_std",
                "spin",
                "measured",
                "strays",
                "inside",
            )
        },
        path=np.concatenate([padded(part.path) for part in parts]),
    )


def _taken(fits: FlightFits, index: np.ndarray) -> FlightFits:
    return FlightFits(**{name: getattr(fits, name)[index] for name in FlightFits.__dataclass_fields__})
