"""How a small bright thing is smeared in a picture: the way it went while the shutter was open, by second moments.

A disc that moves evenly by (x, y) spreads its light by (x, y)(x, y)^T / 12 beyond the disc and the lens, which spread
it alike in all directions: the difference of the two principal spreads is the square of the way's length over 12.
"""

import cv2
import numpy as np
from jaxtyping import Float, UInt8

REACH = 24
"""Half the side of the piece that is looked at, pixels."""
LEAST_RISE = 8.0
"""Grey values by which the thing must stand out."""
SHARE = 0.3
"""Of the highest rise: what lies under it is not counted."""
AGREED = 0.35
"""By how much of the way, or of `AGREED_PX`, the two measurements may differ."""
AGREED_PX = 4.0


def streaks_at(
    frames: UInt8[np.ndarray, "3 height width"], pixels: Float[np.ndarray, "places 2"]
) -> Float[np.ndarray, "places 2"]:
    """The way (x, y), x not negative, that things at those pixels of the middle frame went while its shutter was open.

    Measured twice, against the frames before and after and against what lies around it in the frame itself; NaN
    where the two disagree (it hardly moved between frames, or lies on a line), where nothing stands out, or where it
    is longer than the piece that is looked at.
    """
    found = np.full((len(pixels), 2), np.nan)
    for k, pixel in enumerate(pixels):
        if np.isfinite(pixel).all():
            found[k] = _streak(frames, pixel)
    return found


def _streak(frames: np.ndarray, pixel: np.ndarray) -> np.ndarray:
    nothing = np.full(2, np.nan)
    height, width = frames.shape[1:]
    column, row = (int(v) for v in np.round(pixel))
    top, left = max(row - REACH, 0), max(column - REACH, 0)
    piece = frames[:, top : row + REACH + 1, left : column + REACH + 1].astype(np.float32)
    place = (row - top, column - left)
    if not (0 <= row < height and 0 <= column < width) or min(piece.shape[1:]) < 8:
        return nothing
    before, now, after = piece
    passing = np.minimum(now - before, now - after)
    around = now - np.median(now)
    one, two = _way(passing, place), _way(around, place)
    if one is None or two is None:
        return nothing
    if one @ two < 0:
        two = -two
    way = 0.5 * (one + two)
    if np.linalg.norm(one - two) > AGREED * max(float(np.linalg.norm(way)), AGREED_PX):
        return nothing
    return way if way[0] >= 0 else -way


def _way(rise: np.ndarray, place: tuple[int, int]) -> np.ndarray | None:
    """The smear of what rises round that place of the piece, or None where there is nothing whole."""
    row, column = place
    near = rise[max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2]
    highest = float(near.max())
    if highest < LEAST_RISE:
        return None
    _, labels = cv2.connectedComponents((rise > SHARE * highest).astype(np.uint8), connectivity=8)
    at = np.unravel_index(int(near.argmax()), near.shape)
    own = labels == labels[max(row - 1, 0) + at[0], max(column - 1, 0) + at[1]]
    if own[0].any() or own[-1].any() or own[:, 0].any() or own[:, -1].any():
        return None
    rows, columns = np.nonzero(own)
    light = rise[rows, columns].astype(float)
    offsets = np.stack([columns, rows], axis=1) - np.average(np.stack([columns, rows], axis=1), axis=0, weights=light)
    spread = np.einsum("n,ni,nj->ij", light, offsets, offsets) / light.sum()
    (least, most), axes = np.linalg.eigh(spread)
    return np.sqrt(12 * max(most - least, 0.0)) * axes[:, 1]
