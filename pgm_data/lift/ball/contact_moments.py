"""The moments at which contacts are looked for: bends of the track, and events that were found or marked before."""

import numpy as np
from jaxtyping import Float

from pgm_data.ball import BallEvents
from pgm_data.lift.ball.contact_candidates import Bends
from pgm_data.lift.ball.contact_chain import PlayFlights
from pgm_data.lift.ball.contact_flights import KINDS, Moments
from pgm_data.lift.ball.contact_motion import Sights
from pgm_data.lift.ball.world import BallWorld

BESIDE = 2.2
"""Frames around a person's event in which nothing else happens."""
FORBIDDEN = np.inf
AT_EDGE = 6.0
"""What it costs less that play begins or ends where the track does, nats."""
FAINT = 20.0
"""Bends that gain no more in chi-squared are passed freely."""
MOST_TOLL = 16.0
"""Of one bend, nats: two strays can make any bend."""
SURE = 8.0
"""What another kind costs where a person said which, nats; the ball's height there stays open."""


def moments_of(
    bends: Bends, events: BallEvents, sights: Sights, *, world: BallWorld, step: float, trust: float
) -> Moments:
    """Moments in order of time.

    `trust`: weight of the probabilities of detected events, 0 to 1.
    """
    said = events.sources == "human"
    within = (events.times >= sights.times[0] - 2 * step) & (events.times <= sights.times[-1] + 2 * step)
    human = np.flatnonzero(said & within)
    other = np.flatnonzero(~said & within)
    marks, mark_std = _refined(events, human, bends, step)
    times, spread = bends.times, bends.time_std
    edges = times[np.isinf(bends.gain)]
    free = _apart(times, marks, BESIDE * step)
    times, spread = times[free], spread[free]
    new = _apart(events.times[other], np.concatenate([times, marks]), 1.5 * step)
    new &= _apart(events.times[other], marks, BESIDE * step)
    extra = _thinned(events.times[other[new]], 0.6 * step)
    kept_marks = _thinned(marks, 0.6 * step)
    times = np.concatenate([times, extra, kept_marks])
    spread = np.concatenate([spread, np.full(len(extra), 0.5 * step), mark_std[np.searchsorted(marks, kept_marks)]])
    order = np.argsort(times, kind="stable")
    times, spread = times[order], spread[order]
    rows = np.full(len(events), -1)
    if len(times):
        near = np.abs(times[None] - events.times[:, None]).argmin(axis=1)
        gap = np.abs(times[near] - events.times)
        rows = np.where(within & (gap < np.where(said, BESIDE, 2.0) * step), near, -1)
    bias = _biases(events, rows, said, len(times), trust)
    bias[~_apart(times, edges, 0.5 * step), 3:] -= AT_EDGE
    must = np.zeros(len(times), dtype=bool)
    must[rows[said & (rows >= 0)]] = True
    ground = _over_ground(sights, times, world)
    low = np.isfinite(bias[:, 1]) & ground
    for row in rows[said & (events.kinds == "bounce") & (rows >= 0)]:
        low[row] = world.bounces
        bias[row, 0] = min(bias[row, 0], SURE) if not world.bounces else bias[row, 0]
    return Moments(
        times=times,
        time_std=np.maximum(spread, 0.05 * step),
        may_bounce=low,
        may_be_free=np.asarray(np.isfinite(bias[:, [0, 2, 3, 4]]).any(axis=1)),
        must=must,
        toll=_tolls(bends, times, step),
        bias=bias,
    )


def _tolls(bends: Bends, times: np.ndarray, step: float) -> np.ndarray:
    """What a smooth flight through each moment would cost at least."""
    if not len(bends.times):
        return np.zeros(len(times))
    near = np.abs(bends.times[None] - times[:, None]).argmin(axis=1)
    gain = np.where(np.isfinite(bends.gain), bends.gain, 0.0)[near]
    gain = np.where(np.abs(bends.times[near] - times) < 1.5 * step, gain, 0.0)
    return np.where(gain > FAINT, np.minimum(0.25 * gain, MOST_TOLL), 0.0)


def moved(moments: Moments, rows: np.ndarray, plays: PlayFlights, *, step: float) -> Moments:
    """The moments with those of the rows, at which these flights begin, where the flights put them.

    Others that are then beside them are left out.
    """
    times, spread = moments.times.copy(), moments.time_std.copy()
    known = np.isfinite(plays.begins) & np.isfinite(plays.begin_std)
    times[rows[known]] = plays.begins[known]
    spread[rows[known]] = np.clip(1.5 * plays.begin_std[known], 0.05 * step, 2 * step)
    fixed = np.zeros(len(times), dtype=bool)
    fixed[rows] = True
    beside = ~_apart(times, times[fixed], 1.2 * step) & ~fixed & ~moments.must
    order = np.argsort(times, kind="stable")
    order = order[~beside[order]]
    return Moments(
        times=times[order],
        time_std=spread[order],
        may_bounce=moments.may_bounce[order],
        may_be_free=moments.may_be_free[order],
        must=moments.must[order],
        toll=moments.toll[order],
        bias=moments.bias[order],
    )


def filled(
    moments: Moments,
    sights: Sights,
    spans: Float[np.ndarray, "spans 2"],
    *,
    world: BallWorld,
    step: float,
    apart: float,
) -> Moments:
    """The moments with more of them, so far apart, within these spans of time."""
    grids = [np.arange(low + 0.5 * apart, high, apart) for low, high in spans]
    extra = np.unique(np.concatenate([np.zeros(0), *grids]))
    extra = extra[_apart(extra, moments.times, 0.6 * apart) & _apart(extra, moments.times[moments.must], BESIDE * step)]
    extra = extra[(extra > sights.times[0]) & (extra < sights.times[-1])]
    if not len(extra):
        return moments
    count = len(extra)
    times = np.concatenate([moments.times, extra])
    order = np.argsort(times, kind="stable")
    plain = np.zeros((count, len(KINDS)))
    plain[:, :3] = np.median(moments.bias[~moments.must, :3], axis=0) if not moments.must.all() else 0.0
    yes, no = np.ones(count, dtype=bool), np.zeros(count, dtype=bool)
    return Moments(
        times=times[order],
        time_std=np.concatenate([moments.time_std, np.full(count, 0.35 * apart)])[order],
        may_bounce=np.concatenate([moments.may_bounce, _over_ground(sights, extra, world)])[order],
        may_be_free=np.concatenate([moments.may_be_free, yes])[order],
        must=np.concatenate([moments.must, no])[order],
        toll=np.concatenate([moments.toll, np.zeros(count)])[order],
        bias=np.concatenate([moments.bias, plain])[order],
    )


def _refined(events: BallEvents, human: np.ndarray, bends: Bends, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Times of a person's events, moved to a bend where one lies within their doubt."""
    marks = events.times[human].copy()
    spread = np.clip(np.nan_to_num(events.time_std[human], nan=0.5 * step), 0.1 * step, 2 * step)
    inner = np.isfinite(bends.gain)
    if len(marks) and inner.any():
        at, std = bends.times[inner], bends.time_std[inner]
        near = np.abs(at[None] - marks[:, None]).argmin(axis=1)
        close = np.abs(at[near] - marks) <= np.maximum(2 * spread, 0.6 * step)
        marks, spread = np.where(close, at[near], marks), np.where(close, std[near], spread)
    order = np.argsort(marks, kind="stable")
    return marks[order], spread[order]


def _apart(times: np.ndarray, others: np.ndarray, least: float) -> np.ndarray:
    return np.abs(times[:, None] - others[None]).min(axis=1, initial=np.inf) > least


def _thinned(times: np.ndarray, least: float) -> np.ndarray:
    """Times of which none lies nearer to the one before than this."""
    return times[np.diff(times, prepend=-np.inf) > least]


def _biases(events: BallEvents, rows: np.ndarray, said: np.ndarray, count: int, trust: float) -> np.ndarray:
    bias = np.zeros((count, len(KINDS)))
    kind = np.array([KINDS.index(k) for k in events.kinds], dtype=np.int64)
    found = np.flatnonzero(~said & (rows >= 0))
    if len(found):
        # Where nothing was found a contact is a little less likely.
        bias[:, :3] += 0.7 * trust
        chance = np.full((count, len(KINDS)), np.nan)
        sure = np.clip(np.nan_to_num(events.probability[found], nan=0.5), 0.02, 0.98)
        np.fmax.at(chance, (rows[found], kind[found]), sure)
        odds = trust * (np.log(chance / (1 - chance)) + 1.0)
        bias = np.where(np.isfinite(chance), bias - odds, bias)
    for event in np.flatnonzero(said & (rows >= 0)):
        row, wanted = rows[event], kind[event]
        same = said & (rows == row)
        told = np.zeros(len(KINDS), dtype=bool)
        told[kind[same]] = True
        bias[row] = np.where(told, -SURE, FORBIDDEN)
        # The ball may come into sight as it is hit, or out of sight as it touches something.
        if wanted in (0, 1, 2):
            bias[row, 3:] = np.where(told[3:], -SURE, 2.0)
    return bias


def _over_ground(sights: Sights, times: np.ndarray, world: BallWorld) -> np.ndarray:
    """Whether a ball on the ground would be seen there at those times."""
    if not world.bounces:
        return np.zeros(len(times), dtype=bool)
    half = np.array(world.ground_half_size)
    margin = 0.05 * half + 2 * world.radius_m
    after = np.clip(np.searchsorted(sights.times, times), 1, max(len(sights) - 1, 1))
    near = np.stack([after - 1, np.minimum(after, len(sights) - 1)])
    with np.errstate(divide="ignore", invalid="ignore"):
        far = (world.radius_m - sights.centre[near][..., 2]) / sights.direction[near][..., 2]
        at = sights.centre[near] + far[..., None] * sights.direction[near]
    over = (far > 0) & (np.abs(at[..., :2]) < half + margin).all(axis=-1)
    distant = np.abs(sights.times[near] - times).min(axis=0) > 0.15
    return over.any(axis=0) | distant
