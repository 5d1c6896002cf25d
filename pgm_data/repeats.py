"""Repeated pictures, as converted frame rates have them, and the times when the pictures were taken.

A REPEAT shows the same picture as the frame before: 25 pictures a second shown as 30 repeat every sixth frame. It is no
new measurement, and it makes a flying ball seem to stand still.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

REPEAT_FLOOR = 4.0
"""Added to changes before they are compared as ratios, grey levels."""
LARGE_CHANGE = 128.0
"""Local change beyond which more does not matter, grey levels."""
STRIP_ROWS = 32
"""Rows of a picture compared at a time."""
EVIDENT_REPEATS = 3
"""Repeats that a stretch needs before its even spacing counts as a converted frame rate."""
SPACING_SLACK = 1.15
"""How far first showings may scatter about even spacing, frames shown: 1 is exact rounding to the display's grid."""
LEAST_STEP = 0.25
"""Shortest time between two distinct pictures, share of the time between their showings."""


@dataclass(frozen=True, eq=False, kw_only=True)
class RepeatOptions:
    """When a picture counts as the one before it, coded again."""

    level: float = 40.0
    """Largest local change of a repeat, grey levels: what a codec adds on coding a picture again."""
    gap: float = 2.2
    """Ratio in local change that must part repeats from the frames around them."""
    run: int = 4
    """Most repeats of one picture; a longer quiet stretch is a still or a calm scene, and counts as no repeat."""


def local_change(luma: UInt8[np.ndarray, "height width"], previous: UInt8[np.ndarray, "rows columns"]) -> float:
    """The largest change that a square of 2 x 2 pixels shares, grey levels, at most `LARGE_CHANGE`.

    It sees a ball move and passes over lone pixels.
    """
    if luma.shape != previous.shape:
        raise ValueError(f"luma: expected the size of the frame before, {previous.shape}, got {luma.shape}")
    square = np.ones((2, 2), np.uint8)
    largest = 0.0
    # In strips that stay in the processor's cache; each overlaps the next by the height of the square less one.
    for top in range(0, luma.shape[0], STRIP_ROWS):
        rows = slice(max(top - 1, 0), top + STRIP_ROWS)
        shared = cv2.erode(cv2.absdiff(luma[rows], previous[rows]), square)
        largest = max(largest, float(cv2.minMaxLoc(shared)[1]))
        if largest >= LARGE_CHANGE:
            return LARGE_CHANGE
    return largest


def is_repeat(changes: Float[np.ndarray, " frames"], at: int, options: RepeatOptions) -> bool:
    """Whether frame `at` repeats the frame before it, by the local changes of the frames around it (one shot only).

    The changes must fall into two groups far apart, the frame's in the lower one and low enough for the noise of a
    codec, with at most `run` frames of the lower group in a row: a scene where little moves has no such gap.
    """
    ordered = np.sort(changes)
    gaps = np.diff(np.log(ordered + REPEAT_FLOOR))
    gaps[ordered[:-1] > options.level] = 0.0
    if len(gaps) < 2:
        return False
    highest_low = int(gaps.argmax())
    if gaps[highest_low] < np.log(options.gap) or len(ordered) - highest_low - 1 < 2:
        return False
    low = changes <= ordered[highest_low]
    if not low[at]:
        return False
    breaks = np.flatnonzero(~low)
    after = breaks[breaks > at]
    before = breaks[breaks < at]
    run = (int(after[0]) if len(after) else len(low)) - (int(before[-1]) if len(before) else -1) - 1
    return run <= options.run


def capture_times(
    timestamps: Float[np.ndarray, " frames"], is_duplicate: Bool[np.ndarray, " frames"]
) -> Float[np.ndarray, " frames"]:
    """When each picture of a shot was taken, seconds on the clock of the presentation times, never going back.

    Where repeats come so evenly that one spacing in time explains which pictures were shown twice, the frame rate was
    converted, and the distinct pictures get that even spacing. Elsewhere (no repeats, or only stray ones; a variable
    frame rate) a picture was taken when it is shown. A repeat always carries its source's time.

    Raises:
        ValueError: If the presentation times are not finite or go back.
    """
    if not np.isfinite(timestamps).all() or (np.diff(timestamps) < 0).any():
        raise ValueError("timestamps: expected finite times that do not go back")
    if len(timestamps) < 2:
        return timestamps.astype(np.float64)
    is_source = ~is_duplicate
    is_source[0] = True
    shown = timestamps[is_source].astype(np.float64)
    shown_frame = np.flatnonzero(is_source)
    slack = SPACING_SLACK * float(np.median(np.diff(timestamps)))
    taken = shown.copy()
    begin = 0
    while begin < len(shown):
        end = _even_stretch(shown[begin:], slack) + begin
        repeats = shown_frame[end - 1] - shown_frame[begin] - (end - 1 - begin)
        if repeats >= EVIDENT_REPEATS:
            taken[begin:end] = _even(shown[begin:end])
        begin = end
    # Two stretches may overlap by a part of a frame where they meet.
    taken = np.maximum.accumulate(taken - LEAST_STEP * shown) + LEAST_STEP * shown
    return taken[np.cumsum(is_source) - 1]


def _even(times: Float[np.ndarray, " pictures"]) -> Float[np.ndarray, " pictures"]:
    """The evenly spaced times nearest to two or more given ones, by least squares."""
    number = np.arange(len(times)) - (len(times) - 1) / 2
    return times.mean() + float(number @ times) / float(number @ number) * number


def _unevenness(times: Float[np.ndarray, " pictures"]) -> float:
    """The least scatter of two or more times about even spacing, from lowest to highest, seconds.

    The scatter is convex in the spacing, so that a ternary search finds it.
    """
    number = np.arange(len(times))
    low, high = 0.0, 2 * float(times[-1] - times[0]) / (len(times) - 1)
    for _ in range(40):
        one, other = low + (high - low) / 3, high - (high - low) / 3
        if np.ptp(times - one * number) < np.ptp(times - other * number):
            high = other
        else:
            low = one
    return float(np.ptp(times - (low + high) / 2 * number))


def _even_stretch(times: Float[np.ndarray, " pictures"], slack: float) -> int:
    """How many of the first times lie within the slack about even spacing: the longest such beginning, at least 1."""
    good, step = 1, 1
    while good + step <= len(times) and _unevenness(times[: good + step]) <= slack:
        good, step = good + step, 2 * step
    while step:
        if good + step <= len(times) and _unevenness(times[: good + step]) <= slack:
            good += step
        step //= 2
    return good
