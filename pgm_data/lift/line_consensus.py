"""Which measurements of each line lie on one smooth course, before any camera is fitted to them."""

import numpy as np
from jaxtyping import Bool, Float, Int


def on_course(
    line: Int[np.ndarray, " samples"],
    along: Float[np.ndarray, " samples"],
    offset_px: Float[np.ndarray, " samples"],
    *,
    tolerance_px: float,
    least: int = 4,
) -> Bool[np.ndarray, " samples"]:
    """Measurements within the tolerance of their line's best straight course of offsets.

    A wrong prediction moves a line's image by an offset that changes evenly along it; stray edges, limbs and letters do
    not follow suit. Every pair of measurements proposes a course, and the one with most followers wins.
    Lines with fewer than ``least`` followers are dropped whole.
    """
    keep = np.zeros(len(line), bool)
    for each in np.unique(line):
        rows = np.flatnonzero((line == each) & np.isfinite(offset_px))
        if len(rows) < least:
            continue
        u, o = along[rows], offset_px[rows]
        i, j = np.triu_indices(len(rows), 1)
        apart = np.abs(u[i] - u[j]) > 0.15 * max(np.ptp(u), 1e-9)
        i, j = i[apart], j[apart]
        if len(i) == 0:
            continue
        slope = (o[j] - o[i]) / (u[j] - u[i])
        level = o[i] - slope * u[i]
        near = np.abs(level[:, None] + slope[:, None] * u - o) < tolerance_px
        winner = near[near.sum(axis=1).argmax()]
        if winner.sum() >= max(least, 0.25 * len(rows)):
            keep[rows[winner]] = True
    return keep
