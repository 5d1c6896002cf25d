"""Sub-pixel centres of painted lines, measured across the line where it is expected.

The picture of a line is modelled across it as two court levels joined at the line, plus a painted
box of the expected width, all blurred by the lens and the codec. Position, contrast and both levels
are fitted to each profile, so a baseline between two court colours is not pulled to either side.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float
from scipy.special import ndtr


@dataclass(frozen=True, kw_only=True)
class RidgeOptions:
    """How lines are measured."""

    search_px: float = 6.0
    """Furthest a line may lie from where it is expected, pixels."""
    step_px: float = 0.5
    """Distance between the points of a profile, pixels."""
    along_px: float = 1.5
    """Distance between neighbouring profiles that are averaged, pixels along the line."""
    averaged: int = 5
    """Profiles averaged into one."""
    blur_px: float = 0.8
    """Standard deviation of the picture's blur, pixels."""
    least_contrast: float = 4.0
    """Least brightness of a line above both of its sides, grey levels."""
    worn_width: float = 0.5
    """Share of a line's width that is tried where the full width explains a profile badly."""
    worn_fit: float = 0.97
    """Below this share of explained variance the narrower line is tried."""
    least_fit: float = 0.55
    """Least share of a profile's variance that the line's model explains."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Ridges:
    """What was found at each expected point."""

    offset_px: Float[np.ndarray, " samples"]
    """Signed distance of the line's centre from the expected point along the normal; NaN where there is no line."""
    sigma_px: Float[np.ndarray, " samples"]
    """Its standard deviation from the profile's noise."""
    contrast: Float[np.ndarray, " samples"]
    """Brightness above the sides, grey levels; NaN where there is no line."""
    readable: Bool[np.ndarray, " samples"]
    """Whether the whole profile lies inside the picture."""


def measure_ridges(
    luma: np.ndarray,
    pixels: Float[np.ndarray, "samples 2"],
    normals: Float[np.ndarray, "samples 2"],
    widths_px: Float[np.ndarray, " samples"],
    options: RidgeOptions,
) -> Ridges:
    """Line centres near the expected points of a grey picture (height, width), uint8."""
    count = len(pixels)
    if count == 0:
        empty = np.zeros(0)
        return Ridges(offset_px=empty, sigma_px=empty, contrast=empty, readable=np.zeros(0, bool))
    flank = 3.0
    reach = options.search_px + float(widths_px.max()) / 2 + 2 * options.blur_px + flank
    half = int(np.ceil(reach / options.step_px))
    x = np.arange(-half, half + 1) * options.step_px
    profiles = _profiles(luma, pixels, normals, x, options)
    height, width = luma.shape
    tips = pixels[:, None] + normals[:, None] * np.array([-1.0, 1.0])[:, None] * (options.search_px + 2)
    readable = ((tips >= 0) & (tips <= [width - 1, height - 1])).all(axis=(1, 2))
    centre, strength = _coarse(profiles, x, widths_px, options)
    found = readable & (strength > options.least_contrast)
    offset, sigma, contrast, fit = _fine(profiles, x, centre, widths_px, options)
    wide = np.flatnonzero(found & (widths_px > 2.0) & (fit < options.worn_fit))
    if len(wide):  # Worn paint is narrower than the rules say: take the narrower box where it explains more.
        worn = _fine(profiles[wide], x, centre[wide], widths_px[wide] * options.worn_width, options)
        better = worn[3] > fit[wide]
        for whole, part in zip((offset, sigma, contrast, fit), worn, strict=True):
            whole[wide[better]] = part[better]
    found &= (
        (np.abs(offset - centre) < 1.5 + 0.25 * widths_px)
        & (np.abs(offset) <= options.search_px + 0.5)
        & (contrast > options.least_contrast)
        & (fit > options.least_fit)
        & np.isfinite(sigma)
    )
    nan = np.where(found, 0.0, np.nan)
    return Ridges(offset_px=offset + nan, sigma_px=sigma + nan, contrast=contrast + nan, readable=readable)


def _profiles(luma: np.ndarray, pixels: np.ndarray, normals: np.ndarray, x: np.ndarray, options: RidgeOptions) -> np.ndarray:
    """Grey levels across each line, averaged over neighbouring profiles: (samples, len(x))."""
    tangents = np.stack([normals[:, 1], -normals[:, 0]], axis=-1)
    along = (np.arange(options.averaged) - (options.averaged - 1) / 2) * options.along_px
    places = (
        pixels[:, None, None] + tangents[:, None, None] * along[:, None, None] + normals[:, None, None] * x[:, None]
    ).astype(np.float32)
    rows = places.reshape(len(pixels) * options.averaged, len(x), 2)
    # remap keeps its source coordinates in 16 bits: slices of at most 30,000 rows stay clear of that.
    read = np.concatenate(
        [
            cv2.remap(luma, part[..., 0], part[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
            for part in np.split(rows, range(30000, len(rows), 30000))
        ]
    )
    return read.reshape(len(pixels), options.averaged, len(x)).mean(axis=1, dtype=np.float64)


def _coarse(profiles: np.ndarray, x: np.ndarray, widths_px: np.ndarray, options: RidgeOptions) -> tuple[np.ndarray, np.ndarray]:
    """Best centre on the profile's grid, and how much brighter a box there is than both of its sides."""
    step = options.step_px
    summed = np.concatenate([np.zeros((len(profiles), 1)), np.cumsum(profiles, axis=1)], axis=1)
    half_box = np.maximum(np.round(widths_px / 2 / step), 1).astype(int)
    gap = np.maximum(np.round((widths_px / 2 + options.blur_px + 0.5) / step), half_box + 1).astype(int)
    side = max(int(round(2.0 / step)), 2)
    index = np.arange(len(x))[None]

    def mean(low: np.ndarray, high: np.ndarray) -> np.ndarray:
        low, high = np.clip(low, 0, len(x)), np.clip(high, 0, len(x))
        n = np.maximum(high - low, 1)
        return (np.take_along_axis(summed, high, 1) - np.take_along_axis(summed, low, 1)) / n

    box = mean(index - half_box[:, None], index + half_box[:, None] + 1)
    left = mean(index - gap[:, None] - side, index - gap[:, None] + 1)
    right = mean(index + gap[:, None], index + gap[:, None] + side + 1)
    strength = box - np.maximum(left, right)
    strength = np.where(np.abs(x) <= options.search_px, strength, -np.inf)
    best = strength.argmax(axis=1)
    return x[best], np.take_along_axis(strength, best[:, None], 1)[:, 0]


def _fine(
    profiles: np.ndarray, x: np.ndarray, centre: np.ndarray, widths_px: np.ndarray, options: RidgeOptions
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Centre, its standard deviation, contrast and share of variance explained, by Gauss-Newton on each profile."""
    sigma = options.blur_px
    reach = widths_px / 2 + 2.5 * sigma + 2.0
    # Only points near the coarse centre count: gather those.
    near = min(int(np.ceil((float(reach.max()) + 1.0) / options.step_px)), (len(x) - 1) // 2)
    middle = np.clip(np.round((centre - x[0]) / options.step_px).astype(int), near, len(x) - 1 - near)
    index = middle[:, None] + np.arange(-near, near + 1)
    profiles, x = np.take_along_axis(profiles, index, axis=1), x[index]
    # Points are weighted by a soft window about the coarse centre, so that neighbours outside do not pull.
    window = 1 / (1 + np.exp((np.abs(x - centre[:, None]) - reach[:, None]) * 4))
    half = widths_px[:, None] / 2
    c = centre.copy()
    levels = np.zeros((len(centre), 3))
    normal = np.eye(4)[None]
    residual = profiles
    for _ in range(3):
        d = x - c[:, None]
        rise, fall, mid = ndtr((d + half) / sigma), ndtr((d - half) / sigma), ndtr(d / sigma)
        bump = rise - fall
        basis = np.stack([1 - mid, mid, bump], axis=-1)
        weighted = basis * window[..., None]
        gram = np.swapaxes(weighted, 1, 2) @ basis + 1e-9 * np.eye(3)
        levels = np.linalg.solve(gram, np.swapaxes(weighted, 1, 2) @ profiles[..., None])[..., 0]
        residual = profiles - (basis @ levels[..., None])[..., 0]
        density = np.exp(-0.5 * (np.stack([d + half, d - half, d]) / sigma) ** 2) / (sigma * np.sqrt(2 * np.pi))
        slope = -(levels[:, 2:3] * (density[0] - density[1]) + (levels[:, 1:2] - levels[:, 0:1]) * density[2])
        full = np.concatenate([slope[..., None], basis], axis=-1)
        weighted = full * window[..., None]
        normal = np.swapaxes(weighted, 1, 2) @ full + 1e-9 * np.eye(4)
        move = np.linalg.solve(normal, np.swapaxes(weighted, 1, 2) @ residual[..., None])[:, 0, 0]
        c = c + np.clip(move, -0.7, 0.7)
    weight = window.sum(axis=1)
    noise = (window * residual**2).sum(axis=1) / np.maximum(weight - 4, 1)
    mean = (window * profiles).sum(axis=1) / weight
    spread = (window * (profiles - mean[:, None]) ** 2).sum(axis=1) / weight
    fit = 1 - (window * residual**2).sum(axis=1) / weight / np.maximum(spread, 1e-9)
    # Neighbouring points of a profile share source pixels: about 1 / step of them are independent.
    variance = np.linalg.inv(normal)[:, 0, 0] * noise / options.step_px
    return c, np.sqrt(np.maximum(variance, 1e-8)), levels[:, 2], fit
