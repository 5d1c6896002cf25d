"""The ball's path out of tracklets: which of them are the ball's, decided over the whole clip at once.

Between two tracklets of one ball it flies on unseen, or meets something on the way: the first path's end and the
second's start, carried on, then come together at some time in between.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from pgm_data.detect.ball.link_lattice import Lattice
from pgm_data.detect.ball.link_tracklets import LocalFit, MotionModel, Tracklets

MEETING_TIMES = 9
"""Times between two tracklets at which they may meet."""
MOST_OVERLAP = 2
"""Pictures that two tracklets of one ball may share: where one runs on past a contact by chance."""


@dataclass(frozen=True, kw_only=True)
class ChainModel:
    """How tracklets follow each other."""

    gap_s: float = 0.4
    """Longest time between two tracklets that are judged by where they meet, s."""
    contact: float = 1.0
    """Price of a contact between two tracklets: of a kink in the path."""
    start: float = 1.0
    """Price of a tracklet that starts anew, as a play does."""
    best_meeting: float = 4.0
    """Most that a good meeting is worth."""


def tracklet_features(
    lattice: Lattice, tracklets: Tracklets, apart: LocalFit, height: float
) -> Float[np.ndarray, "tracklets features"]:
    """What each tracklet is judged by.

    Args:
        lattice: The candidates.
        tracklets: Theirs.
        apart: Of each candidate, the fit by its neighbours without it.
        height: Of the picture, px.
    """
    owner, count = tracklets.owner, len(tracklets.count)
    picture, slot = tracklets.picture, tracklets.slot
    number = np.maximum(tracklets.count, 1)

    def mean(values: np.ndarray) -> np.ndarray:
        return np.bincount(owner, values, count) / number

    points = lattice.points[picture, slot]
    off = ((points - apart.place) ** 2).sum(axis=1) / (2 * (lattice.variance[picture, slot] + apart.variance))
    speed = np.hypot(apart.velocity[:, 0], apart.velocity[:, 1]) / height
    extent = np.zeros((count, 2))
    for axis in (0, 1):
        low, high = np.full(count, np.inf), np.full(count, -np.inf)
        np.minimum.at(low, owner, points[:, axis])
        np.maximum.at(high, owner, points[:, axis])
        extent[:, axis] = high - low
    last = tracklets.first + tracklets.count - 1
    taken = lattice.times[picture]
    duration = taken[last] - taken[tracklets.first] + lattice.frame_s
    log_odds = mean(lattice.log_odds[picture, slot])
    return np.stack(
        [
            np.ones(count),
            np.log(np.minimum(tracklets.count, 30)),
            tracklets.worth / number,
            log_odds,
            np.log(mean(speed) + 0.02),
            np.minimum(np.sqrt(mean(off)), 5.0),
            mean(lattice.log_clutter[picture, slot]) + 2 * np.log(height),
            np.log(np.hypot(extent[:, 0], extent[:, 1]) / height + 0.005),
            np.log(tracklets.count * lattice.frame_s / duration),
        ],
        axis=1,
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class Meetings:
    """Pairs of tracklets near each other in time."""

    earlier: Int[np.ndarray, " pairs"]
    later: Int[np.ndarray, " pairs"]
    worth: Float[np.ndarray, " pairs"]
    """What it is worth that the later one follows the earlier one."""


def meetings(
    lattice: Lattice, tracklets: Tracklets, fit: LocalFit, height: float, motion: MotionModel, model: ChainModel
) -> Meetings:
    """How well tracklets near each other in time meet."""
    first = tracklets.first
    last = first + tracklets.count - 1
    earlier, later = _near(lattice, tracklets, model)
    taken = lattice.times[tracklets.picture]
    at_end, at_begin = last[earlier], first[later]
    between = taken[at_begin] - taken[at_end]
    share = np.linspace(0.0, 1.0, MEETING_TIMES)
    after, before = share * between[:, None], (1 - share) * between[:, None]
    one = fit.place[at_end][:, None] + after[..., None] * fit.velocity[at_end][:, None]
    two = fit.place[at_begin][:, None] - before[..., None] * fit.velocity[at_begin][:, None]
    turn = (motion.acceleration * height) ** 2 / 4
    variance = fit.variance[at_end][:, None] + fit.velocity_variance[at_end][:, None] * after**2 + turn * after**4
    variance = variance + fit.variance[at_begin][:, None] + fit.velocity_variance[at_begin][:, None] * before**2
    variance = variance + turn * before**4 + 4.0
    fitting = -((one - two) ** 2).sum(axis=-1) / (2 * variance) - np.log(2 * np.pi * variance)
    clutter = lattice.log_clutter[tracklets.picture[at_begin], tracklets.slot[at_begin]]
    met = fitting.max(axis=1) - clutter - model.contact
    return Meetings(earlier=earlier, later=later, worth=np.clip(met, -model.start, model.best_meeting))


def _near(
    lattice: Lattice, tracklets: Tracklets, model: ChainModel
) -> tuple[Int[np.ndarray, " pairs"], Int[np.ndarray, " pairs"]]:
    """Pairs of which the later one begins at most `gap_s` after the earlier one ends."""
    begin = tracklets.picture[tracklets.first]
    end = tracklets.picture[tracklets.first + tracklets.count - 1]
    later = np.argsort(begin, kind="stable")
    by_end = np.argsort(end, kind="stable")
    soonest = np.searchsorted(lattice.times[end[by_end]], lattice.times[begin[later]] - model.gap_s, side="left")
    latest = np.searchsorted(end[by_end], begin[later] + MOST_OVERLAP, side="left")
    number = np.maximum(latest - soonest, 0)
    place = np.arange(number.sum()) - np.repeat(np.cumsum(number) - number, number)
    earlier = by_end[np.repeat(soonest, number) + place]
    later = np.repeat(later, number)
    can = (begin[earlier] < begin[later]) & (end[earlier] < end[later])
    return earlier[can], later[can]


def best_chain(
    gain: Float[np.ndarray, " tracklets"],
    begin_s: Float[np.ndarray, " tracklets"],
    end_s: Float[np.ndarray, " tracklets"],
    meet: Meetings,
    model: ChainModel,
) -> tuple[Int[np.ndarray, " chosen"], Float[np.ndarray, " chosen"]]:
    """The tracklets of the chain that gains most, in order of time, and how much each gains with its neighbours.

    Args:
        gain: Log odds of each to be the ball's.
        begin_s: When each begins.
        end_s: When each ends.
        meet: What it is worth that one follows another soon.
        model: What it costs to start anew later.
    """
    count = len(gain)
    total = gain.astype(np.float64).copy()
    before = np.full(count, -1)
    link = np.zeros(count)  # What it is worth to follow the one before.
    order, by_end = np.argsort(begin_s, kind="stable"), np.argsort(end_s, kind="stable")
    ended, best_ended = 0, -1
    rank = np.empty(count, dtype=np.int64)
    rank[order] = np.arange(count)
    pairs = np.argsort(rank[meet.later], kind="stable")
    start = np.searchsorted(rank[meet.later[pairs]], np.arange(count + 1))
    for place, at in enumerate(order.tolist()):
        while ended < count and end_s[by_end[ended]] < begin_s[at] - model.gap_s:
            if best_ended < 0 or total[by_end[ended]] > total[best_ended]:
                best_ended = int(by_end[ended])
            ended += 1
        near = pairs[start[place] : start[place + 1]]
        so_far, source, worth = 0.0, -1, 0.0
        if best_ended >= 0 and total[best_ended] > model.start:
            so_far, source, worth = total[best_ended] - model.start, best_ended, -model.start
        if len(near):
            met = total[meet.earlier[near]] + meet.worth[near]
            best = int(met.argmax())
            if met[best] > so_far:
                so_far, source, worth = met[best], int(meet.earlier[near[best]]), meet.worth[near[best]]
        total[at] += so_far
        before[at], link[at] = source, worth
    if not count or total.max() <= 0:
        return np.zeros(0, dtype=np.int64), np.zeros(0)
    chain = [int(total.argmax())]
    while before[chain[-1]] >= 0:
        chain.append(int(before[chain[-1]]))
    chosen = np.array(chain[::-1])
    together = gain[chosen] + link[chosen] / 2
    together[:-1] += link[chosen[1:]] / 2
    return chosen, together
