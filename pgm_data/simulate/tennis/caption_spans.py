"""Where the captions of one player are cut: at what happens, into spans that a person would write a sentence about."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

SHORTEST_S, LONGEST_S, USUAL_S = 0.6, 3.0, 1.5
GRID_S = 0.3
"""Cuts where nothing happens are sought this far apart."""
SWING_S = (0.45, 0.15)
"""Before and after a player's own contact, where no cut belongs."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Cuts:
    """Moments at which a player's course might be cut, and their worth."""

    times: Float[np.ndarray, " cuts"]
    worth: Float[np.ndarray, " cuts"]


def spans(duration_s: float, cuts: Cuts, strokes_s: Sequence[float]) -> list[tuple[float, float]]:
    """Spans that tile 0 to the duration, cut where it is worth most, none with two of the player's own strokes.

    0.6 to 3 s long where the duration allows it.
    """
    if duration_s < 2 * SHORTEST_S:
        return [(0.0, duration_s)]
    inside = (cuts.times > 0) & (cuts.times < duration_s)
    grid = np.arange(1, int(np.ceil(duration_s / GRID_S))) * GRID_S
    grid = grid[grid < duration_s]
    times = np.concatenate([[0.0], cuts.times[inside], grid, [duration_s]])
    worth = np.concatenate([[0.0], cuts.worth[inside], np.zeros(len(grid)), [0.0]])
    order = np.argsort(times, kind="stable")
    times, worth = times[order], worth[order]
    for stroke in strokes_s:
        worth[(times > stroke - SWING_S[0]) & (times < stroke + SWING_S[1])] -= 4.0
    worth[0] = worth[-1] = 0.0
    length = times[None, :] - times[:, None]
    cost = 0.8 * np.log(np.maximum(length, 1e-3) / USUAL_S) ** 2
    cost += 50.0 * ((length < SHORTEST_S) | (length > LONGEST_S))
    held = np.searchsorted(np.asarray(strokes_s, dtype=float), times)
    cost += 10.0 * (held[None, :] - held[:, None] > 1)
    cost -= worth[None, :]
    cost[length <= 0] = np.inf
    best = np.full(len(times), np.inf)
    best[0] = 0.0
    before = np.zeros(len(times), dtype=np.int64)
    for i in range(1, len(times)):
        through = best[:i] + cost[:i, i]
        before[i] = int(np.argmin(through))
        best[i] = through[before[i]]
    chosen = [len(times) - 1]
    while chosen[-1] > 0:
        chosen.append(int(before[chosen[-1]]))
    ends = times[chosen[::-1]]
    return [(float(a), float(b)) for a, b in zip(ends[:-1], ends[1:], strict=True)]
