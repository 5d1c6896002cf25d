"""Small blobs in a picture of motion: centre, streak, and how probably each is a ball.

A ball of radius r that moves by L while the shutter is open leaves a streak whose weight varies by L^2 / 12 more along
the motion than across it.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, Int, UInt8

CELL = 8
"""Side of the squares over which noise is averaged first, px."""
FEATURES = 11
"""Numbers by which a blob is judged, the constant one included."""
WEIGHTS = np.array([-30.4, 1.568, -2.34, 10.172, -4.937, -2.276, 0.159, 9.717, 3.31, 1.609, 4.719])
"""Log odds of a ball by the features of a blob: a logistic regression on simulated pictures, with balls of longer
streaks and paler colours painted into half of them."""
LEAST_SIGMA = 0.15
"""Standard deviation of a clear, round blob's centre along each axis, px; on simulated pictures, as the next two."""
SIGMA_OF_STREAK = 0.05
"""What each pixel of streak adds to it, in squares."""
SIGMA_OF_DOUBT = 0.8
"""What a blob that is surely no ball adds to it, in squares; one of score 0.5 adds half."""


@dataclass(frozen=True, kw_only=True)
class BlobOptions:
    """What may be a ball. Lengths for a picture 720 px high."""

    level: float = 4.0
    """Least smoothed evidence, grey levels."""
    over_noise: float = 2.5
    """Least smoothed evidence, over its mean around."""
    noise_px: float = 72.0
    """Side of the square in which evidence is averaged for its noise."""
    largest_px: float = 70.0
    """Largest side of a blob's box."""
    largest_area: float = 500.0
    """Largest area, px^2."""
    judged: int = 40
    """Blobs that are judged, the strongest ones."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Blobs:
    """Blobs, best first. Pixels of the picture looked at."""

    pixels: Float[np.ndarray, "blobs 2"]
    sigma_px: Float[np.ndarray, " blobs"]
    score: Float[np.ndarray, " blobs"]
    streak_px: Float[np.ndarray, "blobs 2"]
    features: Float[np.ndarray, "blobs features"]


def best_blobs(
    evidence: UInt8[np.ndarray, "height width"],
    pictures: tuple[np.ndarray, np.ndarray, np.ndarray],
    *,
    unit: float,
    most: int,
    options: BlobOptions,
) -> Blobs:
    """The blobs that are most probably balls.

    Args:
        evidence: Of motion.
        pictures: In colour: the one looked at, and the two it was compared with.
        unit: Height of the picture, 720 px.
        most: How many.
        options: What may be a ball.
    """
    smooth = np.asarray(cv2.GaussianBlur(evidence, (3, 3), 0))
    noise = _noise(evidence, options.noise_px * unit)
    bar = cv2.addWeighted(noise, options.over_noise, noise, 0.0, options.level)
    mask = cv2.dilate(cv2.compare(smooth, bar, cv2.CMP_GT), np.ones((3, 3), np.uint8))
    where = cv2.findNonZero(mask)
    if where is None:
        return _blobs(np.zeros((0, 5)), np.zeros((0, FEATURES)), np.zeros(0), 0)
    columns, rows = np.asarray(where, dtype=np.int64).reshape(-1, 2).T
    # The sums of the few marked pixels are cheaper than OpenCV's statistics of the whole picture.
    count, found = cv2.connectedComponents(mask, connectivity=8)
    labels = np.asarray(found)
    label: Int[np.ndarray, " pixels"] = np.asarray(labels[rows, columns], dtype=np.int64)
    area = np.bincount(label, minlength=count)
    mass = np.bincount(label, evidence[rows, columns], count)
    # The dilation adds its pixel all round, however small the picture.
    side = np.maximum(_extent(rows, label, count), _extent(columns, label, count)) - 2
    fits = (side <= options.largest_px * unit) & (area <= options.largest_area * unit**2 + 40) & (mass > 0)
    fits[0] = False
    strongest = np.argsort(np.where(fits, mass / np.sqrt(np.maximum(area, 1)), -1.0))[::-1][: options.judged]
    strongest = strongest[fits[strongest]]
    number = np.full(count, -1)
    number[strongest] = np.arange(len(strongest))
    kept = number[label] >= 0
    rows, columns, label = rows[kept], columns[kept], number[label[kept]]
    shape = _moments(rows, columns, evidence[rows, columns].astype(np.float64), label, len(strongest))
    features = _features(
        shape, (rows, columns, label), pictures, smooth=smooth, noise=noise, evidence=evidence, unit=unit
    )
    return _blobs(shape, features, 1 / (1 + np.exp(-features @ WEIGHTS)), most)


def _extent(places: np.ndarray, label: np.ndarray, count: int) -> Int[np.ndarray, " blobs"]:
    """How many rows or columns each blob's box spans."""
    low, high = np.full(count, np.iinfo(np.int32).max), np.full(count, -1)
    np.minimum.at(low, label, places)
    np.maximum.at(high, label, places)
    return high - low + 1


def _noise(evidence: np.ndarray, side: float) -> UInt8[np.ndarray, "height width"]:
    """Mean evidence around each pixel."""
    height, width = evidence.shape
    small = cv2.resize(evidence, (max(1, width // CELL), max(1, height // CELL)), interpolation=cv2.INTER_AREA)
    cells = max(1, round(side / CELL)) | 1
    return cv2.resize(cv2.blur(small, (cells, cells)), (width, height), interpolation=cv2.INTER_LINEAR)


def _moments(
    rows: np.ndarray, columns: np.ndarray, weight: np.ndarray, label: np.ndarray, count: int
) -> Float[np.ndarray, "blobs 5"]:
    """Centre x, y and covariance xx, xy, yy of the weight of each blob."""

    def total(values: np.ndarray) -> np.ndarray:
        return np.bincount(label, weight * values, count)

    mass = np.bincount(label, weight, count)
    x, y = total(columns) / mass, total(rows) / mass
    dx, dy = columns - x[label], rows - y[label]
    return np.stack([x, y, total(dx * dx) / mass, total(dx * dy) / mass, total(dy * dy) / mass], axis=1)


def axes_of(
    shape: Float[np.ndarray, "blobs 5"],
) -> tuple[Float[np.ndarray, " blobs"], Float[np.ndarray, " blobs"], Float[np.ndarray, "blobs 2"]]:
    """Variance along and across each blob, px^2, and the direction along it."""
    half_sum, half_gap = (shape[:, 2] + shape[:, 4]) / 2, (shape[:, 2] - shape[:, 4]) / 2
    spread = np.hypot(half_gap, shape[:, 3])
    angle = np.arctan2(shape[:, 3], half_gap) / 2
    return half_sum + spread, np.maximum(half_sum - spread, 0.0), np.stack([np.cos(angle), np.sin(angle)], axis=1)


def _features(
    shape: np.ndarray,
    members: tuple[np.ndarray, np.ndarray, np.ndarray],
    pictures: tuple[np.ndarray, np.ndarray, np.ndarray],
    *,
    smooth: np.ndarray,
    noise: np.ndarray,
    evidence: np.ndarray,
    unit: float,
) -> Float[np.ndarray, "blobs features"]:
    """What each blob is judged by: contrast, size, streak, colour, and how alone it is."""
    rows, columns, label = members
    count = len(shape)
    along, across, _ = axes_of(shape)
    area = np.maximum(np.bincount(label, minlength=count), 1)
    mass = np.bincount(label, evidence[rows, columns], count)
    peak = np.zeros(count)
    np.maximum.at(peak, label, smooth[rows, columns])
    around = np.bincount(label, noise[rows, columns], count) / area
    inside = _mass_in_box(evidence, shape[:, :2], 24 * unit)
    alone = mass / np.maximum(inside, mass)
    change = pictures[0][rows, columns].astype(np.float64)
    change -= (pictures[1][rows, columns].astype(np.float64) + pictures[2][rows, columns]) / 2
    colour = np.stack([np.bincount(label, change[:, channel], count) for channel in range(3)], axis=1)
    size = np.abs(colour).sum(axis=1) + 1.0
    width = np.log(np.sqrt(across) / unit + 0.3)
    streak = np.log1p(np.sqrt(12 * (along - across)) / unit)
    fill = np.log(area / (np.sqrt(along * across) + 0.5))
    return np.stack(
        [
            np.ones(count),
            np.log((peak + 1) / (around + 1)),
            np.log(peak + 1),
            width,
            width**2,
            streak,
            streak**2,
            fill,
            alone,
            colour.sum(axis=1) / size,
            (colour[:, 1] + colour[:, 2] - 2 * colour[:, 0]) / (2 * size),
        ],
        axis=1,
    )


def _mass_in_box(evidence: np.ndarray, centres: np.ndarray, half: float) -> Float[np.ndarray, " blobs"]:
    """Evidence in the square around each centre."""
    height, width = evidence.shape
    sums = cv2.integral(evidence)
    x0, y0 = (
        np.clip(np.round(centres[:, axis] - half), 0, size).astype(int) for axis, size in ((0, width), (1, height))
    )
    x1, y1 = (
        np.clip(np.round(centres[:, axis] + half), 0, size).astype(int) for axis, size in ((0, width), (1, height))
    )
    return (sums[y1, x1] - sums[y0, x1] - sums[y1, x0] + sums[y0, x0]).astype(np.float64)


def _blobs(shape: np.ndarray, features: np.ndarray, score: np.ndarray, most: int) -> Blobs:
    """The best ones."""
    order: Int[np.ndarray, " blobs"] = np.argsort(-score, kind="stable")[:most]
    shape = shape[order]
    along, across, direction = axes_of(shape)
    length = np.sqrt(12 * (along - across))
    return Blobs(
        pixels=shape[:, :2],
        sigma_px=np.sqrt(LEAST_SIGMA**2 + (SIGMA_OF_STREAK * length) ** 2 + (SIGMA_OF_DOUBT * (1 - score[order])) ** 2),
        score=score[order],
        streak_px=direction * length[:, None],
        features=features[order],
    )
