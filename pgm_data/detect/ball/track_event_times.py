"""When a contact happened, finer than a frame: where the ball's path in the picture has its kink."""

import numpy as np
from jaxtyping import Float

WINDOW_S = 0.2
"""How far before and after a contact its path is looked at, s."""
USUAL_BEND = 0.5
"""Usual coefficient of t^2 of each side's path, half diagonals per s^2."""
PRIOR_FREEDOM = 8.0
"""How many residuals the expected noise counts for beside those that are seen."""
TRUST = 0.6
"""Power of the likelihood: paths are not quite parabolas, so that residuals side by side are alike."""
GRID = 81
"""Times tried."""


def kink_time(
    times: Float[np.ndarray, " samples"],
    pixels: Float[np.ndarray, "samples 2"],
    *,
    about_s: float,
    about_std_s: float,
    sides_s: tuple[float, float],
    sigma_px: float,
    unit_px: float,
) -> tuple[float, float]:
    """Time of a contact and its standard deviation, s, from a first idea of it and the path round it.

    The path is two parabolas that meet at the contact. Each time near the first idea is tried: its weight is the
    likelihood of the best such path under noise of about `sigma_px`, times that of the first idea. Where fewer than
    two measurements lie on a side, the first idea is all there is.

    Args:
        times: Of the measurements, s, never falling.
        pixels: All finite.
        about_s: First idea of the time.
        about_std_s: Its standard deviation, above 0.
        sides_s: The contacts before and after, past which the path is another; infinite where there is none.
        sigma_px: Expected noise of a coordinate, above 0.
        unit_px: Half the picture's diagonal.
    """
    near = (times >= max(about_s - WINDOW_S, sides_s[0])) & (times <= min(about_s + WINDOW_S, sides_s[1]))
    t, places = times[near] - about_s, pixels[near]
    if len(np.unique(t[t < 0])) < 2 or len(np.unique(t[t > 0])) < 2:
        return about_s, about_std_s
    tried = np.linspace(-3.0, 3.0, GRID) * about_std_s
    squares = kink_squares(t, places - places.mean(axis=0), tried, bend=(sigma_px / (USUAL_BEND * unit_px)) ** 2)
    freedom = 2 * len(t) + PRIOR_FREEDOM
    logs = -0.5 * TRUST * freedom * np.log1p(squares / (PRIOR_FREEDOM * sigma_px**2)) - 0.5 * (tried / about_std_s) ** 2
    weights = np.exp(logs - logs.max())
    weights /= weights.sum()
    mean = float(weights @ tried)
    step = tried[1] - tried[0]
    return about_s + mean, float(np.sqrt(weights @ (tried - mean) ** 2 + step**2 / 12))


def kink_squares(
    t: Float[np.ndarray, " samples"],
    places: Float[np.ndarray, "samples 2"],
    kinks: Float[np.ndarray, " kinks"],
    *,
    bend: float,
) -> Float[np.ndarray, " kinks"]:
    """Least sum of squared residuals of two parabolas that meet at each of these times, px^2.

    `bend` is the weight of the parabolas' squared coefficients of t^2, which keeps short ones from swinging out.
    """
    before = t - kinks[:, None]
    after = np.maximum(before, 0.0)
    before = np.minimum(before, 0.0)
    terms = np.stack([np.ones_like(before), before, after, before**2, after**2], axis=-1)
    normal = np.swapaxes(terms, -1, -2) @ terms + np.diag([0.0, 1e-12, 1e-12, bend, bend])
    moments = np.swapaxes(terms, -1, -2) @ places
    explained = (moments * np.linalg.solve(normal, moments)).sum(axis=(-1, -2))
    return np.maximum((places**2).sum() - explained, 0.0)
