"""Where balls land, and how probable it is that this is in."""

import numpy as np
from jaxtyping import Float, Shaped

SERVE_HEIGHT = 1.15
"""A first hit of a play above this share of a person's height is a serve."""


def inside_probability(
    point: Float[np.ndarray, " 2"], cov: Float[np.ndarray, "2 2"], area: Float[np.ndarray, "2 2"]
) -> float:
    """Probability that a Gaussian point lies in the rectangle of lower and upper corner; 0 or 1 where it is exact."""
    from scipy.stats import multivariate_normal

    if not np.diag(cov).max() > 1e-12:
        return float(np.all((point >= area[0]) & (point <= area[1])))
    # A correlated pair over a rectangle; SciPy integrates it exactly in two dimensions.
    normal = multivariate_normal(point, cov + 1e-12 * np.eye(2), allow_singular=True)  # pyright: ignore[reportArgumentType] SciPy's default is an int
    return float(np.clip(normal.cdf(area[1], lower_limit=area[0]), 0.0, 1.0))


def in_probability(
    landing: Float[np.ndarray, " 3"],
    landing_cov: Float[np.ndarray, "3 3"],
    *,
    start: Float[np.ndarray, " 3"],
    is_serve: bool,
    in_play: Float[np.ndarray, "areas 2 2"],
    in_serve: Float[np.ndarray, "boxes 2 2"],
) -> float:
    """Probability that a hit from `start` lands in; NaN where nothing lands or the court does not say what counts.

    A serve goes to the box of the other half and the other side; every other ball anywhere in the other half.
    """
    areas = in_serve if is_serve and len(in_serve) else in_play
    if not (len(areas) and np.isfinite(landing).all() and np.isfinite(landing_cov).all() and np.isfinite(start).all()):
        return float("nan")
    if is_serve and len(in_serve):
        middle = areas.mean(axis=1)
        other = (np.sign(middle[:, 1]) != np.sign(start[1])) & (np.sign(middle[:, 0]) != np.sign(start[0]))
        areas = areas[other]
    else:
        half = areas.copy()
        half[:, 1 if start[1] > 0 else 0, 1] = 0.0
        areas = half
    point, cov = landing[:2], landing_cov[:2, :2]
    return float(min(sum(inside_probability(point, cov, area) for area in areas), 1.0))


def serves(
    kinds: Shaped[np.ndarray, " events"],
    times: Float[np.ndarray, " events"],
    position: Float[np.ndarray, "events 3"],
    *,
    serve_z: float,
    pause_s: float = 4.0,
) -> np.ndarray:
    """Which events are serves: hits above `serve_z` (world z, m) with no hit in the `pause_s` before them."""
    hits = np.flatnonzero(kinds == "hit")
    found = np.zeros(len(kinds), dtype=bool)
    before = np.concatenate([[-np.inf], times[hits][:-1]])
    with np.errstate(invalid="ignore"):
        found[hits] = (times[hits] - before > pause_s) & (position[hits, 2] > serve_z)
    return found
