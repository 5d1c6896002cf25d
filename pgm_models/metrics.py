"""Distances between samples: of distributions (Frechet, MMD), of forecasts (energy score) and of rotations.

Rows of a sample are its members, columns their numbers; everything is float64.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from pgm_data.geometry.arrays import frozen
from pgm_data.geometry.rigid import rotation_from_rotvec

BLOCK = 512
"""Rows of a kernel matrix that are held at once."""
PARTS, TURNS = 4, 4
"""Into how many parts rows are divided to tell what their number does to a distance, and how often."""
MEDIAN_OF = 1_000
"""Rows at most that the bandwidth of a kernel is taken from."""


def frechet_distance(a: Float[np.ndarray, "rows_a d"], b: Float[np.ndarray, "rows_b d"]) -> float:
    """Squared Frechet distance between the Gaussians of two samples, in the square of their unit.

    |mean_a - mean_b|^2 + tr(A + B - 2 (A^1/2 B A^1/2)^1/2) with unbiased covariances A and B. Safe where they are
    rank-deficient, as with fewer rows than numbers; what it then says of the distributions is mostly chance.

    Raises:
        ValueError: If a sample has fewer than two rows or a number is not finite.
    Source: Dowson and Landau 1982; used for pictures by Heusel et al. 2017 (eq. 6).
    """
    a, b = _checked_pair(a, b)
    if min(len(a), len(b)) < 2:
        raise ValueError(f"samples: expected at least two rows each, got {len(a)} and {len(b)}")
    return _frechet(a.mean(axis=0), _factor_of_rows(a), b.mean(axis=0), _factor_of_rows(b))


def frechet_of_gaussians(
    mean_a: Float[np.ndarray, " d"],
    covariance_a: Float[np.ndarray, "d d"],
    mean_b: Float[np.ndarray, " d"],
    covariance_b: Float[np.ndarray, "d d"],
) -> float:
    """Squared Frechet distance between two Gaussians; covariances symmetric, none below 0 in any direction."""
    return _frechet(mean_a, _factor_of_covariance(covariance_a), mean_b, _factor_of_covariance(covariance_b))


def _frechet(mean_a: np.ndarray, factor_a: np.ndarray, mean_b: np.ndarray, factor_b: np.ndarray) -> float:
    """With covariances as factor^T factor.

    tr (A^1/2 B A^1/2)^1/2 is the sum of the singular values of factor_a factor_b^T: unlike roots of eigenvalues these
    lose no digits where a covariance is singular.
    """
    cross = np.linalg.svd(factor_a @ factor_b.T, compute_uv=False).sum()
    spread = (factor_a**2).sum() + (factor_b**2).sum() - 2 * cross
    return max(float(((mean_a - mean_b) ** 2).sum() + spread), 0.0)


def _factor_of_rows(rows: np.ndarray) -> np.ndarray:
    return np.linalg.qr(rows - rows.mean(axis=0), mode="r") / np.sqrt(len(rows) - 1)


def _factor_of_covariance(covariance: np.ndarray) -> np.ndarray:
    values, vectors = np.linalg.eigh(np.asarray(covariance, np.float64))
    return np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T


@dataclass(frozen=True, kw_only=True)
class FrechetScore:
    """A Frechet distance, and how much of it is not owed to how few rows there are."""

    distance: float
    """Squared Frechet distance of all rows, in the square of their unit; never below 0."""
    excess: float
    """What remains of it as rows grow in number, also below 0 by chance; NaN where there are too few to tell."""
    rows: int
    """Of each sample."""
    dimensions: int
    """Numbers of a row."""

    @property
    def reliable(self) -> bool:
        """Whether there are enough rows that covariances of quarters of them have full rank."""
        return self.rows >= PARTS * (self.dimensions + 1)


def frechet_score(
    generated: Float[np.ndarray, "rows d"], real: Float[np.ndarray, "_ d"], rng: np.random.Generator
) -> FrechetScore:
    """Frechet distance between samples of as many rows, and its limit for ever more rows.

    The part owed to the number of rows falls as 1 / rows: distances of quarters of the rows tell how large it is. Row
    by row the samples may depend on each other, as a sequence with filled-in gaps and the same one as it was: quarters
    take the same rows of both, so that their dependence is kept. (Of such samples the distance lies far below that of
    independent real ones, and taking that away from it would say nothing.)

    Raises:
        ValueError: If the samples differ in shape, have fewer than two rows or a number is not finite.
    Source: Chong and Forsyth 2020, section 4: the limit for many rows, here from two numbers of rows.
    """
    if generated.shape != real.shape:
        raise ValueError(f"samples: expected as many rows, got {generated.shape} and {real.shape}")
    rows = len(real)
    distance = frechet_distance(generated, real)
    excess = float("nan")
    if rows >= 2 * PARTS:
        parts = [
            order[start::PARTS] for order in (rng.permutation(rows) for _ in range(TURNS)) for start in range(PARTS)
        ]
        of_parts = float(np.mean([frechet_distance(generated[part], real[part]) for part in parts]))
        excess = distance - (of_parts - distance) / (PARTS - 1)
    return FrechetScore(distance=distance, excess=excess, rows=rows, dimensions=real.shape[1])


@dataclass(frozen=True, kw_only=True)
class Discrepancy:
    """Squared maximum mean discrepancy between two samples, unbiased: about 0, also below it, where they are alike."""

    value: float
    low: float
    """2.5th percentile of its bootstrap; too low rather than too high where the samples are alike."""
    high: float
    """97.5th percentile."""
    bandwidth: float
    """Of the kernel exp(-|x - y|^2 / (2 bandwidth^2)), in the unit of the numbers."""


def median_distance(rows: Float[np.ndarray, "rows d"]) -> float:
    """Median distance between different rows: the usual bandwidth; 1 where all rows are the same.

    Of more than a thousand rows, evenly spread ones are taken.

    Raises:
        ValueError: If there are fewer than two rows.
    """
    if len(rows) < 2:
        raise ValueError(f"rows: expected at least two, got {len(rows)}")
    some = np.asarray(rows, np.float64)[np.linspace(0, len(rows) - 1, min(len(rows), MEDIAN_OF)).astype(np.int64)]
    above = np.triu_indices(len(some), 1)
    return float(np.median(np.sqrt(_squared_distances(some, some)[above]))) or 1.0


def discrepancy(
    generated: Float[np.ndarray, "rows_a d"],
    real: Float[np.ndarray, "rows_b d"],
    *,
    bandwidth: float,
    rng: np.random.Generator,
    bootstraps: int = 1_000,
) -> Discrepancy:
    """Unbiased squared MMD with a Gaussian kernel, and a bootstrap interval of it.

    Memory grows with the rows and not with their square.

    Args:
        generated: One sample.
        real: The other.
        bandwidth: Of the kernel; take it from the real rows alone (`median_distance`), so that models compare.
        rng: Source of the bootstrap's choices.
        bootstraps: How many.

    Raises:
        ValueError: If a sample has fewer than two rows or a number is not finite.
    Source: Gretton et al. 2012, eq. 3.
    """
    a, b = _checked_pair(generated, real)
    if min(len(a), len(b)) < 2:
        raise ValueError(f"samples: expected at least two rows each, got {len(a)} and {len(b)}")
    drawn_a, drawn_b = _choices(len(a), bootstraps, rng), _choices(len(b), bootstraps, rng)
    values = (
        _mean_between(a, a, drawn_a, drawn_a, bandwidth, apart=True)
        + _mean_between(b, b, drawn_b, drawn_b, bandwidth, apart=True)
        - 2 * _mean_between(a, b, drawn_a, drawn_b, bandwidth, apart=False)
    )
    low, high = np.quantile(values[1:], (0.025, 0.975)) if bootstraps else (np.nan, np.nan)
    return Discrepancy(value=float(values[0]), low=float(low), high=float(high), bandwidth=bandwidth)


def _choices(rows: int, bootstraps: int, rng: np.random.Generator) -> np.ndarray:
    """How often each row is taken: all once, then as each bootstrap draws them."""
    drawn = rng.multinomial(rows, np.full(rows, 1.0 / rows), size=bootstraps)
    return np.concatenate([np.ones((1, rows)), drawn])


def _mean_between(
    a: np.ndarray, b: np.ndarray, times_a: np.ndarray, times_b: np.ndarray, bandwidth: float, *, apart: bool
) -> np.ndarray:
    """Mean kernel between members of two samples for each choice of them; a row is no pair with itself if `apart`."""
    total = np.zeros(len(times_a))
    for start in range(0, len(a), BLOCK):
        block = slice(start, start + BLOCK)
        kernel = np.exp(-_squared_distances(a[block], b) / (2 * bandwidth**2))
        if apart:
            kernel[np.arange(len(kernel)), start + np.arange(len(kernel))] = 0.0
        total += ((times_a[:, block] @ kernel) * times_b).sum(axis=1)
    pairs = times_a.sum(axis=1) * times_b.sum(axis=1)
    return total / (pairs - (times_a * times_b).sum(axis=1) if apart else pairs)


def _squared_distances(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    squares = (a**2).sum(axis=1)[:, None] + (b**2).sum(axis=1) - 2 * a @ b.T
    return np.maximum(squares, 0.0)


def energy_score(
    samples: Float[np.ndarray, "samples *batch d"], truth: Float[np.ndarray, "*batch d"]
) -> Float[np.ndarray, " *batch"]:
    """E|X - y| - E|X - X'| / 2 of several samples X of a forecast and what happened, in the unit of the numbers.

    Pairs of different samples only, so that its mean does not depend on how many there are. Lowest, on average, for
    samples of the true distribution. With one number (d = 1) it is the CRPS.

    Raises:
        ValueError: If there are fewer than two samples.
    Source: Gneiting and Raftery 2007, eq. 22; Ferro 2014 for the count.
    """
    count = len(samples)
    if count < 2:
        raise ValueError(f"samples: expected at least two, got {count}")
    to_truth = np.linalg.norm(samples - truth, axis=-1).mean(axis=0)
    between = np.zeros(to_truth.shape)
    for shift in range(1, count):
        between += np.linalg.norm(samples[shift:] - samples[:-shift], axis=-1).sum(axis=0)
    return np.asarray(to_truth - between / (count * (count - 1)))


def geodesic_angle(a: Float[np.ndarray, "*batch 3"], b: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, " *batch"]:
    """Angle |log(A^T B)| between rotations given as axis-angle vectors, radians, 0 to pi."""
    relative = np.swapaxes(rotation_from_rotvec(a), -1, -2) @ rotation_from_rotvec(b)
    sine = 0.5 * np.sqrt(
        (relative[..., 2, 1] - relative[..., 1, 2]) ** 2
        + (relative[..., 0, 2] - relative[..., 2, 0]) ** 2
        + (relative[..., 1, 0] - relative[..., 0, 1]) ** 2
    )
    return np.asarray(np.arctan2(sine, 0.5 * (np.trace(relative, axis1=-2, axis2=-1) - 1.0)))


@dataclass(frozen=True, eq=False, kw_only=True)
class Projection:
    """Principal axes of a sample, fixed, onto which others are projected; lengths stay in their unit."""

    mean: Float[np.ndarray, " d"]
    axes: Float[np.ndarray, "kept d"]
    """Orthonormal; the first carries most variance."""
    share: float
    """Of the sample's variance that the axes carry, 0 to 1."""

    def __post_init__(self) -> None:
        """Keep read-only copies."""
        object.__setattr__(self, "mean", frozen(self.mean))
        object.__setattr__(self, "axes", frozen(self.axes))

    def project(self, rows: Float[np.ndarray, "rows d"]) -> Float[np.ndarray, "rows kept"]:
        """The rows along the axes."""
        return (rows - self.mean) @ self.axes.T


def principal_axes(rows: Float[np.ndarray, "rows d"], most: int) -> Projection:
    """The `most` principal axes of the rows; fewer where there are fewer numbers or rows.

    Raises:
        ValueError: If there are fewer than two rows or a number is not finite.
    """
    rows = _checked(rows, "rows")
    if len(rows) < 2:
        raise ValueError(f"rows: expected at least two, got {len(rows)}")
    centred = rows - rows.mean(axis=0)
    _, values, vectors = np.linalg.svd(np.linalg.qr(centred, mode="r"), full_matrices=False)
    kept = min(most, rows.shape[1], len(rows) - 1)
    variance = values**2
    share = float(variance[:kept].sum() / variance.sum()) if variance.sum() > 0 else 1.0
    return Projection(mean=rows.mean(axis=0), axes=vectors[:kept], share=share)


def _checked_pair(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return _checked(a, "first sample"), _checked(b, "second sample")


def _checked(rows: np.ndarray, name: str) -> np.ndarray:
    rows = np.asarray(rows, np.float64)
    bad = np.flatnonzero(~np.isfinite(rows).all(axis=1))
    if len(bad):
        raise ValueError(f"{name}: expected finite numbers, got others in {len(bad)} rows, the first {bad[0]}")
    return rows
