"""How like real pictures made ones are, without any network: PSNR, SSIM, MS-SSIM, and how steady they are in time.

Pictures are RGB 0 to 1, channels first, one a frame; what is computed of them is float64, one number a frame, so that
means over clips of any length are means over frames. MASKS say which pixels belong to an object; where a frame has
none of an object's, its figure is NaN and does not count.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

RANGE_SLACK = 1e-3
"""How far outside of 0 to 1 rounding may take a colour."""
WINDOW, WINDOW_SIGMA = 11, 1.5
"""Side and standard deviation of the window in which SSIM compares, pixels."""
BRIGHTNESS, CONTRAST = 0.01**2, 0.03**2
"""SSIM's two constants, for colours to 1."""
SCALE_WEIGHTS = (0.0448, 0.2856, 0.3001, 0.2363, 0.1333)
"""Of the scales of MS-SSIM, the finest first."""
STILL = 4 / 255
"""A real pixel none of whose colours changes by more from one frame to the next shows nothing that moves."""


def psnr(
    made: Float[np.ndarray, "frames 3 height width"], real: Float[np.ndarray, "frames 3 height width"]
) -> Float[np.ndarray, " frames"]:
    """Peak signal-to-noise ratio of each frame, dB, of all colours together; inf where they are the same.

    Raises:
        ValueError: If a colour is not between 0 and 1.
    """
    return psnr_of_error(squared_errors(made, real).mean(axis=(1, 2)))


def masked_psnr(
    made: Float[np.ndarray, "frames 3 height width"],
    real: Float[np.ndarray, "frames 3 height width"],
    mask: Bool[np.ndarray, "frames height width"],
) -> Float[np.ndarray, " frames"]:
    """PSNR of the pixels of a mask, dB; NaN in frames where it is empty.

    Raises:
        ValueError: If a colour is not between 0 and 1.
    """
    return psnr_of_error(mean_in(squared_errors(made, real), mask))


def squared_errors(
    made: Float[np.ndarray, "frames 3 height width"], real: Float[np.ndarray, "frames 3 height width"]
) -> Float[np.ndarray, "frames height width"]:
    """Squared difference of each pixel, the mean of its colours.

    Raises:
        ValueError: If a colour is not between 0 and 1.
    """
    made, real = _pair(made, real)
    return ((made - real) ** 2).mean(axis=1)


def psnr_of_error(mean_squared: Float[np.ndarray, "*batch"]) -> Float[np.ndarray, "*batch"]:
    """PSNR of mean squared errors, dB: of the mean over frames, it is that of a whole clip."""
    with np.errstate(divide="ignore"):
        return np.asarray(-10 * np.log10(mean_squared))


def mean_in(
    values: Float[np.ndarray, "frames height width"], mask: Bool[np.ndarray, "frames height width"]
) -> Float[np.ndarray, " frames"]:
    """Mean over the pixels of each frame's mask; NaN where it is empty."""
    count = mask.sum(axis=(1, 2))
    total = np.where(mask, values, 0.0).sum(axis=(1, 2))
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def ssim(
    made: Float[np.ndarray, "frames 3 height width"], real: Float[np.ndarray, "frames 3 height width"]
) -> Float[np.ndarray, " frames"]:
    """Structural similarity of each frame, the mean over colours and the pixels whose window lies in the picture.

    Raises:
        ValueError: If a colour is not between 0 and 1, or the pictures are smaller than the window.
    Source: Wang et al. 2004, with the window of its section III.
    """
    maps = ssim_map(made, real)
    edge = WINDOW // 2
    return maps[:, edge : maps.shape[1] - edge, edge : maps.shape[2] - edge].mean(axis=(1, 2))


def masked_ssim(
    made: Float[np.ndarray, "frames 3 height width"],
    real: Float[np.ndarray, "frames 3 height width"],
    mask: Bool[np.ndarray, "frames height width"],
) -> Float[np.ndarray, " frames"]:
    """The mean of SSIM's map over the pixels of a mask, whose windows reach over its edge; NaN where it is empty.

    Raises:
        ValueError: If a colour is not between 0 and 1, or the pictures are smaller than the window.
    """
    return mean_in(ssim_map(made, real), mask)


def ssim_map(
    made: Float[np.ndarray, "frames 3 height width"], real: Float[np.ndarray, "frames 3 height width"]
) -> Float[np.ndarray, "frames height width"]:
    """Structural similarity about each pixel, the mean of its colours; pictures are mirrored beyond their edges.

    Raises:
        ValueError: If a colour is not between 0 and 1, or the pictures are smaller than the window.
    """
    made, real = _pair(made, real)
    _check_size(made, WINDOW, "SSIM")
    maps = [_similarity(a, b) for a, b in zip(made, real, strict=True)]
    return np.array([(bright * structure).mean(axis=0) for bright, structure in maps]).reshape(
        len(made), *made.shape[2:]
    )


def ms_ssim(
    made: Float[np.ndarray, "frames 3 height width"],
    real: Float[np.ndarray, "frames 3 height width"],
    scales: int = len(SCALE_WEIGHTS),
) -> Float[np.ndarray, " frames"]:
    """Multi-scale structural similarity of each frame, the mean over colours.

    Args:
        made: Pictures made.
        real: What they should be.
        scales: How many of the five, from the finest on, their weights made to add up to 1 again: with fewer it is
            not what others call MS-SSIM, and must be named with its number of scales.

    Raises:
        ValueError: If a colour is not between 0 and 1, there are no such scales, or the pictures are smaller than the
            window at the coarsest: `most_scales` says how many they allow.
    Source: Wang et al. 2003, eq. 7; a scale where structures oppose each other counts as 0.
    """
    made, real = _pair(made, real)
    if not 1 <= scales <= len(SCALE_WEIGHTS):
        raise ValueError(f"MS-SSIM: scales: expected 1 to {len(SCALE_WEIGHTS)}, got {scales}")
    _check_size(made, WINDOW * 2 ** (scales - 1), f"MS-SSIM of {scales} scales")
    weights = np.array(SCALE_WEIGHTS[:scales]) / sum(SCALE_WEIGHTS[:scales])
    return np.array([_frame_ms_ssim(a, b, weights) for a, b in zip(made, real, strict=True)]).reshape(len(made))


def most_scales(height: int, width: int) -> int:
    """How many of MS-SSIM's five scales pictures of that size allow; 0 for none."""
    return sum(min(height, width) >= WINDOW * 2**scale for scale in range(len(SCALE_WEIGHTS)))


def _frame_ms_ssim(made: np.ndarray, real: np.ndarray, weights: np.ndarray) -> float:
    edge = WINDOW // 2
    result = np.ones(3)
    for scale, weight in enumerate(weights):
        bright, structure = _similarity(made, real)
        likeness = structure if scale < len(weights) - 1 else bright * structure
        inner = likeness[:, edge : likeness.shape[1] - edge, edge : likeness.shape[2] - edge]
        result *= np.maximum(inner.mean(axis=(1, 2)), 0.0) ** weight
        made, real = _halved(made), _halved(real)
    return float(result.mean())


def _halved(picture: np.ndarray) -> np.ndarray:
    """Means of squares of two by two; an odd last row or column is dropped."""
    high, wide = picture.shape[1] // 2, picture.shape[2] // 2
    return picture[:, : 2 * high, : 2 * wide].reshape(3, high, 2, wide, 2).mean(axis=(2, 4))


def _similarity(made: np.ndarray, real: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """SSIM's terms of brightness, and of contrast and structure, of each colour and pixel."""
    mean_a, mean_b = _blurred(made), _blurred(real)
    variances = _blurred(made**2) + _blurred(real**2) - mean_a**2 - mean_b**2
    covariance = _blurred(made * real) - mean_a * mean_b
    bright = (2 * mean_a * mean_b + BRIGHTNESS) / (mean_a**2 + mean_b**2 + BRIGHTNESS)
    return bright, (2 * covariance + CONTRAST) / (variances + CONTRAST)


def _blurred(picture: np.ndarray) -> np.ndarray:
    """Gaussian means of each colour, mirrored beyond the edges with the edge pixel repeated."""
    import cv2

    places = np.arange(WINDOW) - WINDOW // 2
    window = np.exp(-0.5 * (places / WINDOW_SIGMA) ** 2)
    window /= window.sum()
    return np.stack([cv2.sepFilter2D(colour, -1, window, window, borderType=cv2.BORDER_REFLECT) for colour in picture])


@dataclass(frozen=True, eq=False, kw_only=True)
class Steadiness:
    """How pictures change from one frame of a clip to the next, beside how the real ones do."""

    change_psnr: Float[np.ndarray, " changes"]
    """PSNR of the change of each pixel against the real change, dB: what moves must move alike."""
    flicker: Float[np.ndarray, " changes"]
    """Root mean square change of the pixels where nothing moves in the real pictures, colours 0 to 1; NaN where there
    is no such pixel."""
    real_flicker: Float[np.ndarray, " changes"]
    """Likewise of the real pictures: noise and compression, below which no steadiness is asked."""
    still_share: Float[np.ndarray, " changes"]
    """Share of the pixels where nothing moves."""


def steadiness(
    made: Float[np.ndarray, "frames 3 height width"], real: Float[np.ndarray, "frames 3 height width"]
) -> Steadiness:
    """How pictures of one clip, frame after frame without a gap, change in time; one row fewer than frames.

    A repeat of a frame is a change of nothing: leave repeats out. A clip in parts needs each part's last frame again in
    the next.

    Raises:
        ValueError: If a colour is not between 0 and 1.
    """
    made, real = _pair(made, real)
    made_change, real_change = np.diff(made, axis=0), np.diff(real, axis=0)
    still = np.abs(real_change).max(axis=1) <= STILL
    return Steadiness(
        change_psnr=psnr_of_error(((made_change - real_change) ** 2).mean(axis=(1, 2, 3))),
        flicker=np.sqrt(mean_in((made_change**2).mean(axis=1), still)),
        real_flicker=np.sqrt(mean_in((real_change**2).mean(axis=1), still)),
        still_share=still.mean(axis=(1, 2)),
    )


def check_colours(pictures: Float[np.ndarray, "*frames 3 height width"], name: str) -> None:
    """See that colours are finite and run from 0 to 1, up to rounding.

    Raises:
        ValueError: If they do not, as those from -1 to 1 or to 255.
    """
    if pictures.size:
        low, high = float(pictures.min()), float(pictures.max())
        # Written so that NaN is refused too.
        if not (low >= -RANGE_SLACK and high <= 1 + RANGE_SLACK):
            raise ValueError(f"{name}: expected colours from 0 to 1, got {low:.4g} to {high:.4g}")


def _pair(made: np.ndarray, real: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Both in float64, after a look at their size and range."""
    if made.shape != real.shape:
        raise ValueError(f"pictures: expected made ones of {real.shape}, as the real ones, got {made.shape}")
    check_colours(made, "made pictures")
    check_colours(real, "real pictures")
    return made.astype(np.float64), real.astype(np.float64)


def _check_size(pictures: np.ndarray, least: int, name: str) -> None:
    height, width = pictures.shape[2:]
    if min(height, width) < least:
        raise ValueError(f"{name}: pictures: expected at least {least} px high and wide, got {width}x{height}")
