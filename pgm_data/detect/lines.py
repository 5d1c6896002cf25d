"""Sub-pixel centres of painted lines, measured across the line where it is expected.

The picture of a line is modelled across it as three flat levels, court, paint of the expected width, and court
again, blurred by the lens and the codec. Position and all levels are fitted to each profile, so a baseline between two
court colours is not pulled to either side.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int
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
    most_two_tone: float = 2.0
    """Most difference of the two sides, over the contrast: beyond it a line is an edge between colours."""
    least_fit: float = 0.55
    """Least share of a profile's variance that the line's model explains."""


@dataclass(frozen=True, eq=False, kw_only=True)
class LineLook:
    """What the lines of one camera's pictures look like; the same from frame to frame."""

    blur_px: float
    """Standard deviation of the picture's blur, pixels."""
    spill: Float[np.ndarray, " lines"]
    """How far the court's colour on one side of each line reaches past the line's other edge, in line widths.

    Positive where the colour on the normal's side spills, negative where the other does: two-tone courts are
    seldom painted to change colour exactly under the line.
    """


@dataclass(frozen=True, eq=False, kw_only=True)
class Ridges:
    """What was found at each expected point."""

    offset_px: Float[np.ndarray, " samples"]
    """Signed distance of the line's centre from the expected point along the normal; NaN where there is no line."""
    sigma_px: Float[np.ndarray, " samples"]
    """Its standard deviation from the profile's noise."""
    contrast: Float[np.ndarray, " samples"]
    """Brightness above the sides, grey levels; NaN where there is no line."""
    two_tone: Float[np.ndarray, " samples"]
    """Difference of the court on the line's two sides, over the line's contrast."""
    readable: Bool[np.ndarray, " samples"]
    """Whether the whole profile lies inside the picture."""


def measure_ridges(
    luma: np.ndarray,
    pixels: Float[np.ndarray, "samples 2"],
    normals: Float[np.ndarray, "samples 2"],
    widths_px: Float[np.ndarray, " samples"],
    options: RidgeOptions,
    spill: Float[np.ndarray, " samples"] | None = None,
) -> Ridges:
    """Line centres near the expected points of a grey picture (height, width), uint8.

    `spill` is that of each sample's line (`LineLook.spill`); None for none.
    """
    count = len(pixels)
    if count == 0:
        empty = np.zeros(0)
        return Ridges(offset_px=empty, sigma_px=empty, contrast=empty, two_tone=empty, readable=np.zeros(0, bool))
    x = _places(widths_px, options)
    profiles = _profiles(luma, pixels, normals, x, options)
    height, width = luma.shape
    tips = pixels[:, None] + normals[:, None] * np.array([-1.0, 1.0])[:, None] * (options.search_px + 2)
    readable = ((tips >= 0) & (tips <= [width - 1, height - 1])).all(axis=(1, 2))
    centre, strength = _coarse(profiles, x, widths_px, options)
    found = readable & (strength > options.least_contrast)
    spills = np.zeros(count) if spill is None else spill
    fine = _fine(profiles, x, centre, widths_px, spills, options.blur_px, options.step_px)
    offset, sigma, contrast, fit = fine.centre, fine.sigma, fine.contrast, fine.fit
    wide = np.flatnonzero(found & (widths_px > 2.0) & (fit < options.worn_fit))
    if len(wide):  # Worn paint is narrower than the rules say: take the narrower box where it explains more.
        width = widths_px[wide] * options.worn_width
        worn = _fine(profiles[wide], x, centre[wide], width, spills[wide], options.blur_px, options.step_px)
        better = wide[worn.fit > fit[wide]]
        chosen = worn.fit > fit[wide]
        two_tone = fine.two_tone
        pairs = (
            (offset, worn.centre),
            (sigma, worn.sigma),
            (contrast, worn.contrast),
            (fit, worn.fit),
            (two_tone, worn.two_tone),
        )
        for whole, part in pairs:
            whole[better] = part[chosen]
    found &= (
        (np.abs(offset - centre) < 1.5 + 0.25 * widths_px)
        & (np.abs(offset) <= options.search_px + 0.5)
        & (contrast > options.least_contrast)
        & (fit > options.least_fit)
        & (fine.two_tone < options.most_two_tone)
        & np.isfinite(sigma)
    )
    nan = np.where(found, 0.0, np.nan)
    return Ridges(
        offset_px=offset + nan,
        sigma_px=sigma + nan,
        contrast=contrast + nan,
        two_tone=fine.two_tone,
        readable=np.asarray(readable),
    )


def merged(ridges: Ridges, again: Ridges, rows: Int[np.ndarray, " some"], take: Bool[np.ndarray, " some"]) -> Ridges:
    """The ridges with some rows measured again, of which those to take are taken."""
    parts = {}
    for name in ("offset_px", "sigma_px", "contrast", "two_tone", "readable"):
        parts[name] = getattr(ridges, name).copy()
        parts[name][rows[take]] = getattr(again, name)[take]
    return Ridges(**parts)


BLURS = (0.35, 0.5, 0.65, 0.8, 1.0, 1.25, 1.6, 2.1)
"""Blurs tried by `look_of_lines`, pixels."""
SPILLS = (0.0, 0.25, 0.5, 0.8, 1.2, 1.8, -0.25, -0.5, -0.8, -1.2, -1.8)
"""Spills tried, in line widths."""
TWO_TONE = 0.12
"""Least difference of the two sides, over the line's contrast, at which a spill can be told."""


def look_of_lines(
    luma: np.ndarray,
    pixels: Float[np.ndarray, "samples 2"],
    normals: Float[np.ndarray, "samples 2"],
    widths_px: Float[np.ndarray, " samples"],
    line: Int[np.ndarray, " samples"],
    lines: int,
    options: RidgeOptions,
) -> LineLook:
    """The blur, and each line's spill, that explain the profiles of a picture's lines best.

    A wrong blur or an unseen spill moves the found centre of a line between two court colours by up to 0.3 px. Where
    too few profiles show a line, the options' blur and no spill are returned.
    """
    plain = LineLook(blur_px=options.blur_px, spill=np.zeros(lines))
    if len(pixels) < 8:
        return plain
    x = _places(widths_px, options)
    profiles = _profiles(luma, pixels, normals, x, options)
    centre, strength = _coarse(profiles, x, widths_px, options)
    good = strength > 2 * options.least_contrast
    if good.sum() < 8:
        return plain
    profiles, centre, widths_px, line = profiles[good], centre[good], widths_px[good], line[good]
    some = np.linspace(0, len(profiles) - 1, min(80, len(profiles))).round().astype(int)

    def unexplained(rows: np.ndarray, blur: float, spill: float) -> np.ndarray:
        fine = _fine(profiles[rows], x, centre[rows], widths_px[rows], np.full(len(rows), spill), blur, options.step_px)
        return np.log(np.maximum(1 - fine.fit, 1e-5))

    def best_blur(rows: np.ndarray) -> float:
        return BLURS[int(np.argmin([unexplained(rows, blur, 0.0).mean() for blur in BLURS]))]

    fine = _fine(profiles, x, centre, widths_px, np.zeros(len(profiles)), options.blur_px, options.step_px)
    two_tone = fine.two_tone > TWO_TONE
    # The blur is read off lines with one colour on both sides where there are enough of them.
    one_tone = some[~two_tone[some]]
    blur = best_blur(one_tone if len(one_tone) >= 12 else some)
    spill = np.zeros(lines)
    for each in np.unique(line):
        rows = np.flatnonzero((line == each) & two_tone & (widths_px > 1.5))
        if len(rows) < 6:
            continue
        rows = rows[np.linspace(0, len(rows) - 1, min(16, len(rows))).round().astype(int)]
        levels = [float(np.median(unexplained(rows, blur, value))) for value in SPILLS]
        if min(levels) < levels[0] - 0.2:
            spill[each] = SPILLS[int(np.argmin(levels))]
    return LineLook(blur_px=blur, spill=spill)


def _places(widths_px: np.ndarray, options: RidgeOptions) -> np.ndarray:
    """Places along the normal at which profiles are read, pixels from the expected point."""
    flank = 3.0
    reach = options.search_px + float(widths_px.max()) / 2 + 2 * options.blur_px + flank
    half = int(np.ceil(reach / options.step_px))
    return np.arange(-half, half + 1) * options.step_px


def _profiles(
    luma: np.ndarray, pixels: np.ndarray, normals: np.ndarray, x: np.ndarray, options: RidgeOptions
) -> np.ndarray:
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


def _coarse(
    profiles: np.ndarray, x: np.ndarray, widths_px: np.ndarray, options: RidgeOptions
) -> tuple[np.ndarray, np.ndarray]:
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


@dataclass(frozen=True, eq=False, kw_only=True)
class _Fine:
    """Profiles fitted one by one."""

    centre: np.ndarray
    """Pixels from the expected point."""
    sigma: np.ndarray
    """Its standard deviation, pixels."""
    contrast: np.ndarray
    """Paint above the brighter side, grey levels."""
    fit: np.ndarray
    """Share of the profile's variance explained."""
    two_tone: np.ndarray
    """Difference of the two sides over the contrast."""


def _fine(
    profiles: np.ndarray,
    x: np.ndarray,
    centre: np.ndarray,
    widths_px: np.ndarray,
    spill: np.ndarray,
    blur: float,
    step: float,
) -> _Fine:
    """The three levels and the place of each profile's line, by Gauss-Newton from a coarse centre.

    Edges, in order along the normal: where a spilled far side begins, the paint's two edges, where a spilled near side
    ends. `spill` is in line widths; see `LineLook.spill`.
    """
    reach = widths_px / 2 + 4.0
    # Only points near the coarse centre count: gather those.
    near = min(int(np.ceil((float(reach.max()) + 1.0) / step)), (len(x) - 1) // 2)
    middle = np.clip(np.round((centre - x[0]) / step).astype(int), near, len(x) - 1 - near)
    index = middle[:, None] + np.arange(-near, near + 1)
    profiles, x = np.take_along_axis(profiles, index, axis=1), x[index]
    # Points are weighted by a soft window about the coarse centre, so that neighbours outside do not pull.
    window = 1 / (1 + np.exp((np.abs(x - centre[:, None]) - reach[:, None]) * 4))
    half = widths_px[:, None] / 2
    far_spill, near_spill = np.maximum(spill * widths_px, 0)[:, None], np.maximum(-spill * widths_px, 0)[:, None]
    edges = np.stack([-half - far_spill, -half, half, half + near_spill])
    spills_far, spills_near = far_spill > 0, near_spill > 0
    c = centre.copy()
    levels = np.zeros((len(centre), 3))
    normal = np.eye(4)[None]
    residual = profiles
    for _ in range(3):
        z = (x - c[:, None] - edges) / blur
        first, rise, fall, last = ndtr(z)
        before = np.where(spills_near, (1 - rise) + (fall - last), 1 - first)
        after = np.where(spills_far, (first - rise) + fall, last)
        basis = np.stack([before, rise - fall, after], axis=-1)
        weighted = basis * window[..., None]
        gram = np.swapaxes(weighted, 1, 2) @ basis + 1e-9 * np.eye(3)
        levels = np.linalg.solve(gram, np.swapaxes(weighted, 1, 2) @ profiles[..., None])[..., 0]
        residual = profiles - (basis @ levels[..., None])[..., 0]
        density = np.exp(-0.5 * z**2) / (blur * np.sqrt(2 * np.pi))
        L0, W, L1 = levels[:, 0:1], levels[:, 1:2], levels[:, 2:3]
        jumps = np.stack(
            [
                np.where(spills_far, L1 - L0, 0.0),
                W - np.where(spills_far, L1, L0),
                np.where(spills_near, L0, L1) - W,
                np.where(spills_near, L1 - L0, 0.0),
            ]
        )
        slope = -(jumps * density).sum(axis=0)
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
    variance = np.linalg.inv(normal)[:, 0, 0] * noise / step
    contrast = levels[:, 1] - np.maximum(levels[:, 0], levels[:, 2])
    return _Fine(
        centre=c,
        sigma=np.sqrt(np.maximum(variance, 1e-8)),
        contrast=contrast,
        fit=fit,
        two_tone=np.abs(levels[:, 2] - levels[:, 0]) / np.maximum(contrast, 1.0),
    )
