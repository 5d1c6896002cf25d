"""Hits, bounces and net contacts told from the ball's track in the picture alone; no camera is needed.

A small network says for every 20 ms what happens in them, as probabilities that sum to one; an event is a hill of
such probability: its mass is the probability of the event, its mean and width the time and the time's deviation.
Where the path has a sharp kink, that makes the time finer.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from pgm_data.ball import BallEvents, BallTrack, no_events
from pgm_data.detect.ball.track_event_times import WINDOW_S, kink_time
from pgm_data.detect.ball.track_features import STEP_S, half_diagonal, step_features, stretches
from pgm_data.detect.ball.track_network import CLASSES, TrackEventNetwork

APART_S = 3.0
"""Parts of a track with a longer hole between them are looked at apart, s."""
MARGIN_STEPS = 40
"""Steps looked at before the first measurement of a part and after its last."""
REACH_STEPS = 15
"""A hill of probability reaches at most so far to each side."""
SMOOTH = np.array([1.0, 2.0, 3.0, 2.0, 1.0]) / 9.0
"""Hills are told apart after this smoothing."""
OUTSIDE_S = 0.1
"""Contacts may be told from what follows or went before, but not so far outside of the track's times, s."""
USUAL_SIGMA = 1.5e-3
"""Usual noise of a detector, half diagonals: 1.1 pixels at 720 rows."""
KINDS = {"hit": ("hit",), "bounce": ("bounce", "dead_bounce"), "net": ("net",), "first": ("toss",)}
"""Classes of the network that make each kind of event."""


@dataclass(frozen=True, eq=False, kw_only=True)
class TrackEventOptions:
    """How events are told from a track."""

    network: Path | None = None
    """Network file; None for the one that ships with the package."""
    least_probability: float = 0.4
    """Events less probable than this are left out."""
    least_live: float = 0.5
    """Least probability that the play was still on at a bounce, given that it bounced. Bounces below it are no events,
    and their play's `last` is not after them; the first bounce after a hit always counts; 0 keeps all bounces."""
    longest_flight_s: float = 4.0
    """Contacts further apart than this belong to two plays."""
    longest_lead_s: float = 1.5
    """A play whose toss is not seen begins at most this long before its first contact."""
    longest_hole_s: float = 1.0
    """A play begins and ends with the ball seen; it is not followed across longer holes than this."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Hills:
    """Events of one kind, in order."""

    times: Float[np.ndarray, " hills"]
    """s."""
    stds: Float[np.ndarray, " hills"]
    """s."""
    masses: Float[np.ndarray, " hills"]
    """Probability, 0 to 1."""
    live: Float[np.ndarray, " hills"]
    """Share of the mass that is not of a dead ball."""

    def take(self, index: np.ndarray) -> "Hills":
        """Those at the places, or where the mask is true."""
        return Hills(times=self.times[index], stds=self.stds[index], masses=self.masses[index], live=self.live[index])


def find_events(
    track: BallTrack,
    *,
    size: tuple[int, int],
    options: TrackEventOptions | None = None,
    network: TrackEventNetwork | None = None,
) -> BallEvents:
    """What happens to the ball, with probabilities; also the `first` and `last` sight of it in each play.

    `first` is the toss where one is seen. A play is a run of contacts with no toss and no long pause between them.
    A track without an event gives none.

    Args:
        track: Of any frame rate.
        size: Width and height of the picture, px.
        options: How to tell.
        network: Used instead of loading the one that the options name.

    Raises:
        FileNotFoundError: If the options name a network file that is not there.
        ValueError: If the picture is empty or the file no such network.
    """
    options = options or TrackEventOptions()
    unit = half_diagonal(size)
    seen = track.measured
    times, pixels = track.times[seen], track.pixels[seen]
    if not len(times):
        return no_events()
    network = network or TrackEventNetwork.load(options.network)
    parts = [_read_part(times[p], pixels[p], size, network) for p in stretches(times, APART_S)]
    ends = (float(times[0]), float(times[-1]))
    hills = {kind: _joined([part[kind] for part in parts], ends, options) for kind in KINDS}
    dead = _dead(hills, options)
    contacts = _in_order({"hit": hills["hit"], "bounce": hills["bounce"].take(~dead), "net": hills["net"]})
    if not len(contacts):
        return no_events()
    contacts = _sharpened(contacts, times, pixels, unit)
    borders = np.concatenate([hills["first"].times, hills["bounce"].times[dead]])
    return _with_plays(contacts, hills["first"], borders, times, options)


def _dead(hills: dict[str, Hills], options: TrackEventOptions) -> np.ndarray:
    """Which bounces are of a dead ball: only ones that follow another bounce or the net, with no hit between."""
    bounces = hills["bounce"]
    contacts = np.sort(np.concatenate([bounces.times, hills["net"].times]))
    before = np.concatenate([[-np.inf], contacts])[np.searchsorted(contacts, bounces.times)]
    hits = np.concatenate([[-np.inf], hills["hit"].times])
    follows = (before > hits[np.searchsorted(hits[1:], bounces.times)]) & (
        bounces.times - before <= options.longest_flight_s
    )
    return (bounces.live < options.least_live) & follows


def _read_part(
    times: np.ndarray, pixels: np.ndarray, size: tuple[int, int], network: TrackEventNetwork
) -> dict[str, Hills]:
    """Hills of each kind in one part of the track."""
    start = times[0] - MARGIN_STEPS * STEP_S
    steps = int(np.ceil((times[-1] - times[0]) / STEP_S)) + 2 * MARGIN_STEPS + 1
    shares = network.shares(step_features(times, pixels, size=size, start_s=start, steps=steps))
    return {kind: find_hills(shares[[CLASSES.index(n) for n in names]], start_s=start) for kind, names in KINDS.items()}


def find_hills(shares: Float[np.ndarray, "classes steps"], *, start_s: float) -> Hills:
    """The hills of the classes' summed probability; the last class, where there are more, is of a dead ball."""
    whole = shares.sum(axis=0)
    smooth = np.convolve(whole, SMOOTH, mode="same")
    padded = np.pad(smooth, 1, constant_values=-1.0)
    tops = np.flatnonzero((smooth > padded[:-2]) & (smooth >= padded[2:]) & (smooth > 1e-3))
    if not len(tops):
        return Hills(times=np.zeros(0), stds=np.zeros(0), masses=np.zeros(0), live=np.zeros(0))
    # Each step belongs to the hill on its side of the lowest place between two tops.
    low = [int(a + np.argmin(smooth[a:b])) for a, b in zip(tops[:-1], tops[1:], strict=True)]
    owner = np.searchsorted(np.array(low, dtype=int), np.arange(len(whole)), side="right")
    near = np.abs(np.arange(len(whole)) - tops[owner]) <= REACH_STEPS
    weights = whole * near

    def total(values: np.ndarray) -> np.ndarray:
        return np.bincount(owner, values, len(tops))

    masses = total(weights)
    at = total(weights * np.arange(len(whole))) / masses
    spread = total(weights * (np.arange(len(whole)) - at[owner]) ** 2) / masses
    live = total(shares[0] * near) / masses
    # An event between two steps is divided between them, which alone spreads it by a quarter step squared at most.
    stds = STEP_S * np.sqrt(np.maximum(spread - 1 / 6, 0.05))
    return Hills(times=start_s + STEP_S * at, stds=stds, masses=np.minimum(masses, 1.0), live=live)


def _joined(parts: list[Hills], ends: tuple[float, float], options: TrackEventOptions) -> Hills:
    """The hills of all parts that are probable enough and within the track's times, but for a little."""
    whole = Hills(**{n: np.concatenate([getattr(p, n) for p in parts]) for n in ("times", "stds", "masses", "live")})
    inside = np.clip(whole.times, *ends)
    kept = whole.take((whole.masses >= options.least_probability) & (np.abs(inside - whole.times) <= OUTSIDE_S))
    clipped = np.clip(kept.times, *ends)
    return replace(kept, times=clipped, stds=np.hypot(kept.stds, clipped - kept.times))


def _events(kinds: np.ndarray, times: np.ndarray, probability: np.ndarray, time_std: np.ndarray) -> BallEvents:
    """Detected events in order of time; of those at one time, in the order given."""
    order = np.argsort(times, kind="stable")
    return BallEvents(
        times=times[order],
        kinds=kinds[order],
        probability=probability[order],
        time_std=time_std[order],
        sources=np.full(len(times), "detected", dtype=object),
        players=np.full(len(times), "", dtype=object),
        ground_px=np.full((len(times), 2), np.nan),
    )


def _in_order(hills: dict[str, Hills]) -> BallEvents:
    """The hills of several kinds as events."""
    return _events(
        np.concatenate([np.full(len(h.times), kind, dtype=object) for kind, h in hills.items()]),
        np.concatenate([h.times for h in hills.values()]),
        np.concatenate([h.masses for h in hills.values()]),
        np.concatenate([h.stds for h in hills.values()]),
    )


def _sharpened(events: BallEvents, times: np.ndarray, pixels: np.ndarray, unit_px: float) -> BallEvents:
    """The events with each time told finer by the kink of the path there."""
    sides = np.concatenate([[-np.inf], events.times, [np.inf]])
    finer, stds = events.times.copy(), events.time_std.copy()
    for i, (at, std) in enumerate(zip(events.times, events.time_std, strict=True)):
        low, high = np.searchsorted(times, (at - WINDOW_S, at + WINDOW_S))
        finer[i], stds[i] = kink_time(
            times[low:high],
            pixels[low:high],
            about_s=float(at),
            about_std_s=float(std),
            sides_s=(float(sides[i]), float(sides[i + 2])),
            sigma_px=USUAL_SIGMA * unit_px,
            unit_px=unit_px,
        )
    return _events(events.kinds, finer, events.probability, stds)


def _with_plays(
    contacts: BallEvents, tosses: Hills, borders: np.ndarray, times: np.ndarray, options: TrackEventOptions
) -> BallEvents:
    """The contacts with the `first` and `last` of each play, which does not reach past the borders after it."""
    toss_between = np.diff(np.searchsorted(tosses.times, contacts.times)) > 0
    opens = np.concatenate([[True], (np.diff(contacts.times) > options.longest_flight_s) | toss_between])
    first, last = np.flatnonzero(opens), np.flatnonzero(np.concatenate([opens[1:], [True]]))
    run = np.concatenate([[0], np.cumsum(np.diff(times) > options.longest_hole_s)])
    frame_std = float(np.median(np.diff(times)) if len(times) > 1 else STEP_S) / np.sqrt(12)
    begins, ends, begin_stds, floor = [], [], [], -np.inf
    for a, b in zip(first, last, strict=True):
        begin, end = float(contacts.times[a]), float(contacts.times[b])
        toss = np.flatnonzero((tosses.times > max(floor, begin - options.longest_flight_s)) & (tosses.times < begin))
        if len(toss):
            begins.append(float(tosses.times[toss[-1]]))
            begin_stds.append(float(tosses.stds[toss[-1]]))
        else:
            begins.append(
                _sight(times, run, begin, max([floor, begin - options.longest_lead_s, *borders[borders < begin]]))
            )
            begin_stds.append(frame_std)
        later = np.concatenate([borders, contacts.times, [end + options.longest_flight_s]])
        ends.append(_sight(times, run, end, float(later[later > end].min())))
        floor = ends[-1]
    kinds = np.array(["first"] * len(begins), dtype=object), np.array(["last"] * len(ends), dtype=object)
    return _events(
        np.concatenate([kinds[0], contacts.kinds, kinds[1]]),
        np.concatenate([begins, contacts.times, ends]),
        np.concatenate([contacts.probability[first], contacts.probability, contacts.probability[last]]),
        np.concatenate([begin_stds, contacts.time_std, np.full(len(ends), frame_std)]),
    )


def _sight(times: np.ndarray, run: np.ndarray, contact: float, limit: float) -> float:
    """Time of the furthest measurement from a contact, short of a limit, that no long hole parts from it."""
    low, high = min(contact, limit), max(contact, limit)
    inside = np.flatnonzero((times > low) & (times < high))
    if not len(inside):
        return contact
    back = limit < contact
    same = inside[run[inside] == run[inside[-1 if back else 0]]]
    return float(times[same[0 if back else -1]])
