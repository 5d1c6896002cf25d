"""Contacts of a ball, told apart by the flights between them, where the camera is known."""

from dataclasses import dataclass, replace

import numpy as np

from pgm_data.ball import BallEvents, BallTrack
from pgm_data.geometry.camera import Camera
from pgm_data.lift.ball.contact_candidates import find_bends
from pgm_data.lift.ball.contact_chain import PlayFlights, PlaySketch, fit_plays
from pgm_data.lift.ball.contact_flights import KINDS, Moments, idle_costs, price_flights
from pgm_data.lift.ball.contact_labels import FIRST, HIT, LAST, Chain, Rates, cheapest_chain, link_costs
from pgm_data.lift.ball.contact_moments import BESIDE, filled, moments_of, moved
from pgm_data.lift.ball.contact_motion import Sights, sights_of, velocity_scale
from pgm_data.lift.ball.solution import PlayersAt
from pgm_data.lift.ball.world import GRAVITY, BallWorld

FEWEST = 4
"""Measured frames below which nothing is decided."""
ROUGH_FPS = 25.0
"""Frames a second that suffice to tell hopeless flights."""
MOST_FPS = 50.0
"""Frames a second that suffice to tell contacts apart; times take all frames."""
SHORT = 30
"""Tracks of no more measured frames are tried at every frame."""
WORSE = 2.0
"""A further round that costs more by this is not believed, nats."""
POOR = 0.12
"""Share of a flight's frames that lie far from it above which more moments are tried within it."""
SHORT_PAUSE = 1.0
"""A ball that is seen for no longer outside of flights may be in one, s."""
SLOW = 0.12
"""A play in which the ball never goes along the court at this share of a stroke's usual speed is none."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ContactOptions:
    """How contacts are found."""

    bends_per_s: float = 9.0
    """Most bends of the track tried, per second."""
    toll_nats: float = 40.0
    """Bends that one flight may pass over, by what they would cost a smooth path."""
    rounds: int = 2
    """How often contacts are decided; from the second round on at the times that flights gave them."""
    hit_per_s: float = 1.0
    """How often a ball in play is hit."""
    net_share: float = 0.03
    """Share of flights across the net that touch it."""
    play_per_s: float = 0.05
    """How often play begins, and ends."""
    idle_nats: float = 170.0
    """What it costs that the ball is seen but in no flight, for as long as it would fall half the ground's length."""
    trust: float = 0.5
    """Weight of the log odds of events that were given, 0 to 1."""
    temperature: float = 2.0
    """Costs are divided by this for probabilities: real flights are less simple than fitted ones."""
    least_probability: float = 0.3
    """Contacts less likely than this are left out."""


def place_events(
    track: BallTrack,
    events: BallEvents,
    camera: Camera,
    *,
    world: BallWorld,
    players: PlayersAt | None,
    options: ContactOptions,
) -> BallEvents:
    """Hits, bounces, net contacts and the beginning and end of each play, with what the flights between them say.

    Rows of source `human` stay, and nothing else lies beside them; their time is sharpened where a flight allows it.
    Other rows are hints. Where too little is seen the given events come back as they are.
    """
    full = sights_of(track, camera)
    if len(full) < FEWEST:
        return events
    sights = full.thinned(round(1 / (MOST_FPS * max(float(np.median(np.diff(full.times))), 1e-4))))
    step = float(np.median(np.diff(sights.times)))
    bends = find_bends(sights.times, track.pixels[sights.frames], sights.sigma_px, most_per_s=options.bends_per_s)
    moments = moments_of(bends, events, sights, world=world, step=step, trust=options.trust)
    if len(sights) <= SHORT:
        moments = filled(moments, sights, sights.times[None, [0, -1]], world=world, step=step, apart=step)
    told = _decide((sights, full), moments, world=world, step=step, options=options)
    decided = moments
    for _ in range(options.rounds - 1):
        poor = _poor_spans(told, moments, sights)
        if told.plays is not None:
            moments = moved(moments, told.chain.moments[told.starts], told.plays, step=step)
        moments = filled(moments, sights, poor, world=world, step=step, apart=max(1.5 * step, 0.04))
        again = _decide((sights, full), moments, world=world, step=step, options=options)
        if again.chain.cost > told.chain.cost + WORSE:
            break
        told, decided = again, moments
    return _as_events(told, decided, events, players, step, options)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Told:
    """A labelling with its flights fitted together."""

    chain: Chain
    starts: np.ndarray
    """Places in the chain at which a flight starts."""
    plays: PlayFlights | None
    """None without a flight."""


def _poor_spans(told: _Told, moments: Moments, sights: Sights) -> np.ndarray:
    """Spans of time whose flights leave much unexplained, or in which a ball is seen beside a play: spans, 2."""
    plays = told.plays
    if plays is None:
        return np.zeros((0, 2))
    bad = plays.misfit > POOR
    spans = np.stack([plays.begins[bad], plays.ends[bad]], axis=1)
    chain = told.chain
    first = moments.times[chain.moments[chain.kinds == FIRST]]
    last = moments.times[chain.moments[chain.kinds == LAST]]
    edges = np.concatenate([[sights.times[0]], last]), np.concatenate([first, [sights.times[-1]]])
    idle = np.stack(edges, axis=1)[: len(first) + 1]
    idle = idle[(idle[:, 1] - idle[:, 0] > 0) & (idle[:, 1] - idle[:, 0] < SHORT_PAUSE)]
    return np.concatenate([spans, idle])


def _decide(
    seen: tuple[Sights, Sights], moments: Moments, *, world: BallWorld, step: float, options: ContactOptions
) -> _Told:
    """The labelling by the first sights, its times by the second ones."""
    sights, full = seen
    fall = np.sqrt(2 * max(world.ground_half_size) / GRAVITY)
    idle = idle_costs(sights, moments.times, options.idle_nats / fall, step)
    thinning = max(1, round(1 / (ROUGH_FPS * step)))
    flights = price_flights(sights, moments, world=world, toll=options.toll_nats, idle=idle, thinning=thinning)
    rates = Rates(hit_per_s=options.hit_per_s, net_share=options.net_share, play_per_s=options.play_per_s)
    links = link_costs(flights, moments, world=world, rates=rates)
    chain = cheapest_chain(flights, links, moments, idle, rates=rates, temperature=options.temperature)
    starts = np.flatnonzero(chain.flights >= 0)
    if not len(starts):
        return _Told(chain=chain, starts=starts, plays=None)
    kinds = np.array(KINDS, dtype=object)[chain.kinds]
    times, row = moments.times[chain.moments], chain.flights[starts]
    entered = (chain.kinds[starts] != FIRST) & (starts > 0) & (chain.flights[np.maximum(starts - 1, 0)] >= 0)
    sketch = PlaySketch(
        begins=times[starts],
        ends=times[starts + 1],
        kinds=kinds[starts],
        joined=entered,
        time_std=np.maximum(moments.time_std[chain.moments[starts]], 0.5 * step),
        state=np.concatenate([flights.fits.start[row], flights.fits.spin[row]], axis=1),
    )
    return _live(chain, starts, fit_plays(full, sketch, world=world, step=step), world, moments)


def _live(chain: Chain, starts: np.ndarray, plays: PlayFlights, world: BallWorld, moments: Moments) -> _Told:
    """The labelling without what comes before the ball first surely goes fast along the court, such as a server's
    dribbling, unless a person marked it.
    """
    play = np.cumsum(chain.kinds == FIRST)
    pace = np.full(len(play), -np.inf)
    pace[starts] = np.abs(plays.state[:, 4]) - np.sqrt(np.maximum(plays.state_cov[:, 4, 4], 0.0))
    fast = (pace > SLOW * velocity_scale(world)[1]) | moments.must[chain.moments]
    if not fast.any() and np.ptp(moments.times[chain.moments]) > 0.8 * np.ptp(moments.times):
        # A track of nothing else is hardly that of a ball out of play.
        return _Told(chain=chain, starts=starts, plays=plays)
    place = np.arange(len(play))
    opening = np.full(len(play) + 1, len(play))
    np.minimum.at(opening, play[fast], place[fast])
    # The flight into the first fast one is its toss, or what it answers.
    opens = opening[play] - 1
    live = place >= np.where(chain.kinds[np.minimum(opens + 1, len(play) - 1)] == FIRST, opens + 1, opens)
    live &= opening[play] < len(play)
    kinds = np.where(live & (place == opens) & ~moments.must[chain.moments], FIRST, chain.kinds)
    chain = replace(chain, moments=chain.moments[live], kinds=kinds[live], flights=chain.flights[live])
    left = np.flatnonzero(live[starts])
    if not len(left):
        return _Told(chain=chain, starts=left, plays=None)
    return _Told(chain=chain, starts=np.flatnonzero(chain.flights >= 0), plays=plays.take(left))


def _as_events(
    told: _Told, moments: Moments, given: BallEvents, players: PlayersAt | None, step: float, options: ContactOptions
) -> BallEvents:
    """The labelling as events, with a person's rows among them."""
    chain = told.chain
    times, spread = moments.times[chain.moments].copy(), moments.time_std[chain.moments].copy()
    names = np.full(len(times), "", dtype=object)
    if told.plays is not None:
        times[told.starts], spread[told.starts] = told.plays.begins, told.plays.begin_std
        who = _hitters(told.plays.state, players)
        names[told.starts] = np.where(chain.kinds[told.starts] == HIT, who, "")
    # The first frame of a play that begins with a hit is that hit's.
    same = np.flatnonzero((chain.kinds[:-1] == FIRST) & (chain.moments[:-1] == chain.moments[1:]))
    times[same], spread[same] = times[same + 1], spread[same + 1]
    chance = _gathered(chain, moments, times, 2.0 * step)
    human = given.sources == "human"
    marks = given.times[human]
    beside = np.abs(times[:, None] - marks[None]) < BESIDE * step
    kinds = np.array(KINDS, dtype=object)[chain.kinds]
    kept = ~beside.any(axis=1) & ((chance >= options.least_probability) | np.isin(chain.kinds, (FIRST, LAST)))
    mark_times, mark_std = marks.copy(), given.time_std[human].copy()
    mark_names = given.players[human].copy()
    for mark, kind in enumerate(given.kinds[human]):
        same = np.flatnonzero(beside[:, mark] & (kinds == kind)) if len(times) else np.zeros(0, dtype=np.int64)
        if len(same):
            near = same[np.abs(times[same] - marks[mark]).argmin()]
            limit = np.nan_to_num(mark_std[mark], nan=step)
            if abs(times[near] - marks[mark]) <= 3 * max(limit, 0.3 * step):
                mark_times[mark], mark_std[mark] = times[near], min(spread[near], max(limit, 0.05 * step))
            if kind == "hit" and not mark_names[mark]:
                mark_names[mark] = names[near]
    all_times = np.concatenate([times[kept], mark_times])
    order = np.argsort(all_times, kind="stable")
    count = int(kept.sum())
    return BallEvents(
        times=all_times[order],
        kinds=np.concatenate([kinds[kept], given.kinds[human]])[order],
        probability=np.concatenate([chance[kept], given.probability[human]])[order],
        time_std=np.concatenate([spread[kept], mark_std])[order],
        sources=np.concatenate([np.full(count, "detected", dtype=object), given.sources[human]])[order],
        players=np.concatenate([names[kept], mark_names])[order],
        ground_px=np.concatenate([np.full((count, 2), np.nan), given.ground_px[human]])[order],
    )


def _hitters(state: np.ndarray, players: PlayersAt | None) -> np.ndarray:
    """Who hits a ball that starts so: the player on whose side it is, or away from whom it goes if it is at the net."""
    named = players.names if players is not None and len(players.names) >= 2 else ("player0", "player1")
    near = np.where(np.abs(state[:, 1]) > 1e-9, state[:, 1] < 0, state[:, 4] > 0)
    return np.where(near, named[0], named[1]).astype(object)


def _gathered(chain: Chain, moments: Moments, times: np.ndarray, apart: float) -> np.ndarray:
    """Probability of each contact of the chain: all ways in which its kind happens about then."""
    near = np.abs(moments.times[None] - times[:, None]) <= apart
    chance = near @ chain.shares
    return np.clip(chance[np.arange(len(times)), chain.kinds], 0.0, 0.999)
