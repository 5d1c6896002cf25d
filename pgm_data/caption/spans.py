"""Where the captions of one player are cut: at what happens, into spans that a person would write a sentence about."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True, eq=False, kw_only=True)
class SpanOptions:
    """How long spans are."""

    usual_s: float = 1.5
    """Length that is aimed at, s."""
    shortest_s: float = 0.5
    longest_s: float = 3.0
    before_hit_s: float = 0.5
    """No cut from this long before an own hit ..."""
    after_hit_s: float = 0.2
    """... to this long after it."""


WALKS = SpanOptions(usual_s=0.7, shortest_s=0.3, longest_s=1.5)
"""Of scenes without a net, in which nothing is hit."""
GRID_S = 0.25
"""Cuts where nothing happens are sought this far apart."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Cuts:
    """Moments at which something happens, and how much a cut there is worth."""

    times: Float[np.ndarray, " cuts"]
    """Capture times, s."""
    worth: Float[np.ndarray, " cuts"]


def cut(
    start_s: float, end_s: float, cuts: Cuts, own_hits_s: Float[np.ndarray, " hits"], options: SpanOptions
) -> list[tuple[float, float]]:
    """Spans that tile the time from start to end, none with two own hits where that can be helped.

    The best of all ways to cut: each span costs the square of the logarithm of its length over the usual one, each cut
    pays its worth.
    """
    if end_s - start_s < 2 * options.shortest_s:
        return [(start_s, end_s)]
    inside = (cuts.times > start_s) & (cuts.times < end_s)
    grid = np.arange(start_s + GRID_S, end_s - 1e-6, GRID_S)
    times = np.concatenate([cuts.times[inside], grid])
    worth = np.concatenate([cuts.worth[inside], np.zeros(len(grid))])
    for hit in own_hits_s:
        worth[(times > hit - options.before_hit_s) & (times < hit + options.after_hit_s)] -= 5.0
    order = np.argsort(times, kind="stable")
    times = np.concatenate([[start_s], times[order], [end_s]])
    worth = np.concatenate([[0.0], worth[order], [0.0]])
    hits_before = np.searchsorted(own_hits_s, times)
    least = np.full(len(times), np.inf)
    least[0] = 0.0
    came_from = np.zeros(len(times), dtype=np.int64)
    for k in range(1, len(times)):
        length = np.maximum(times[k] - times[:k], 1e-3)
        cost = np.log(length / options.usual_s) ** 2
        cost += 50.0 * ((length < options.shortest_s) | (length > options.longest_s))
        cost += 10.0 * (hits_before[k] - hits_before[:k] > 1)
        through = least[:k] + cost
        came_from[k] = int(np.argmin(through))
        least[k] = through[came_from[k]] - worth[k]
    chain = [len(times) - 1]
    while chain[-1] > 0:
        chain.append(int(came_from[chain[-1]]))
    ends = times[chain[::-1]]
    return [(float(a), float(b)) for a, b in zip(ends[:-1], ends[1:], strict=True)]
