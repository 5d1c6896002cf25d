"""OpenCV's lens model (k1, k2, p1, p2) on normalised image coordinates, and its inverse.

The radial map ``r -> r (1 + k1 r^2 + k2 r^4)`` rises up to its first turning point and then folds
back: points beyond it have no image, and radii beyond its maximum have no source. Both are NaN.
"""

import numpy as np
from jaxtyping import Float

NEWTON_STEPS = 60
"""Upper bound on the inverse's bracketed Newton steps; it stops at float64 convergence."""

TANGENTIAL_STEPS = 60
"""Upper bound on the fixed-point steps that take p1 and p2 off."""


def fold_radius(
    k1: Float[np.ndarray, "*#batch"] | float, k2: Float[np.ndarray, "*#batch"] | float
) -> Float[np.ndarray, "..."]:
    """Undistorted radius at which the radial map turns; infinity where it never does.

    The square root of the first positive root of ``1 + 3 k1 s + 5 k2 s^2``, without cancellation.
    """
    b, a = 3 * np.asarray(k1, np.float64), 5 * np.asarray(k2, np.float64)
    with np.errstate(all="ignore"):  # where there is no turning point, the roots are NaN, negative or infinite
        disc = b**2 - 4 * a
        q = -0.5 * (b + np.where(b < 0, -1.0, 1.0) * np.sqrt(disc))
        roots = np.stack(np.broadcast_arrays(q / a, 1 / q))
        turns = np.where((roots > 0) & np.isfinite(roots), roots, np.inf).min(axis=0)
        return np.asarray(np.sqrt(np.where(np.isnan(b + a), np.nan, turns)))


def _radial(k1: np.ndarray, k2: np.ndarray, s: np.ndarray) -> np.ndarray:
    return 1 + s * (k1 + s * k2)


def _tangential(xy: np.ndarray, p1: np.ndarray, p2: np.ndarray) -> np.ndarray:
    x, y = xy[..., 0], xy[..., 1]
    s = x * x + y * y
    return np.stack([2 * p1 * x * y + p2 * (s + 2 * x * x), p1 * (s + 2 * y * y) + 2 * p2 * x * y], axis=-1)


def distort(
    xy: Float[np.ndarray, "*#batch points 2"], distortion: Float[np.ndarray, "*#batch 4"]
) -> Float[np.ndarray, "... points 2"]:
    """Distorted normalised coordinates; NaN past the fold.

    Source: OpenCV's camera model, calib3d documentation.
    """
    k1, k2, p1, p2 = (distortion[..., i][..., None] for i in range(4))
    xy = np.asarray(xy, np.float64)
    with np.errstate(over="ignore", invalid="ignore"):
        s = (xy * xy).sum(axis=-1)
        radial = np.where(np.sqrt(s) <= fold_radius(k1, k2), _radial(k1, k2, s), np.nan)
        return xy * radial[..., None] + _tangential(xy, p1, p2)


def _undistort_radius(r_distorted: np.ndarray, k1: np.ndarray, k2: np.ndarray) -> np.ndarray:
    """Radii whose distorted radius is given: Newton's method kept inside a shrinking bracket."""
    fold = np.broadcast_to(fold_radius(k1, k2), r_distorted.shape)
    # Without a fold the map rises without bound: expand until it brackets.
    high = np.where(np.isfinite(fold), fold, np.maximum(r_distorted, 1.0))
    for _ in range(80):
        short = ~np.isfinite(fold) & (high * _radial(k1, k2, high**2) < r_distorted)
        if not short.any():
            break
        high = np.where(short, 2 * high, high)
    reachable = r_distorted <= high * _radial(k1, k2, high**2)
    low = np.zeros_like(high)
    r = np.clip(r_distorted, low, high)
    for _ in range(NEWTON_STEPS):
        s = r * r
        value = r * _radial(k1, k2, s) - r_distorted
        slope = 1 + s * (3 * k1 + 5 * k2 * s)
        high, low = np.where(value > 0, r, high), np.where(value > 0, low, r)
        newton = r - value / slope
        inside = (newton >= low) & (newton <= high)
        following = np.where(inside, newton, 0.5 * (low + high))
        if np.all((np.abs(following - r) <= 4e-16 * r) | ~reachable):
            break
        r = following
    return np.where(reachable, r, np.nan)


def undistort(
    xy: Float[np.ndarray, "*#batch points 2"], distortion: Float[np.ndarray, "*#batch 4"]
) -> Float[np.ndarray, "... points 2"]:
    """Undistorted normalised coordinates: the exact inverse of `distort`; NaN where it has none."""
    k1, k2, p1, p2 = (distortion[..., i][..., None] for i in range(4))
    xy = np.asarray(xy, np.float64)
    with np.errstate(all="ignore"):  # what is out of reach overflows on its way to NaN
        if not (np.any(p1) or np.any(p2)):
            return _undistort_radially(xy, k1, k2)
        guess = xy
        for _ in range(TANGENTIAL_STEPS):
            following = _undistort_radially(xy - _tangential(guess, p1, p2), k1, k2)
            settled = ~(np.abs(following - guess) > 1e-15 * (1 + np.abs(following)))
            guess = following
            if settled.all():
                break
        # The outer iteration need not contract for absurd p1, p2: never return garbage.
        error = np.abs(distort(guess, distortion) - xy).max(axis=-1)
        return np.where((error < 1e-9)[..., None], guess, np.nan)


def _undistort_radially(xy: np.ndarray, k1: np.ndarray, k2: np.ndarray) -> np.ndarray:
    r_distorted = np.hypot(xy[..., 0], xy[..., 1])
    r = _undistort_radius(r_distorted, *np.broadcast_arrays(k1, k2, r_distorted)[:2])
    scale = np.where(r_distorted > 0, r / r_distorted, np.where(np.isnan(r), np.nan, 1.0))
    return xy * scale[..., None]
