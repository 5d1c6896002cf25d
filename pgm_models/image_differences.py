"""Finding the ball and players in pictures, real and made alike, by what differs from a picture without them.

Three detectors, none of which knows what a ball or a person looks like:

- `find_ball`: something small, brighter than the background, near where the ball should be;
- `find_player`: the places near where a player should be that differ from the background by more than light and shade;
- `find_change`: what one object alone changes, from a picture rendered with it and the same one rendered without it.

The BACKGROUND of a camera that does not move is the median over frames around (`median_background`), or over all clips
of a match that it stands still in; of one that moves it is a picture that the caller has without the object, as only a
renderer can give. Made pictures want a made background: against a real one every flaw of the model is a difference.
The first two detectors say that an object can be told from what else the picture shows; the third, which no clutter
disturbs, only that it leaves a mark, and where. The first two are told where to look, so what they find by chance must
be measured too: ask them for places `moved_aside`.

Pictures are RGB 0 to 1, channels first; lengths in options are of pictures 288 px high and grow with the height.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from pgm_models.image_metrics import check_colours

USUAL_HEIGHT = 288
"""Height of the pictures that lengths are stated for, px."""
NOTHING = np.zeros((0, 4))
"""No box."""


@dataclass(frozen=True, kw_only=True)
class BallSearch:
    """How the ball is looked for. Lengths in px of pictures 288 px high."""

    radius_px: float = 6.0
    """How far from where it should be it is looked for."""
    likely_px: float = 2.0
    """Of two blobs the nearer one counts more: by exp(-(distance / likely)^2 / 2)."""
    largest_px: float = 4.0
    """What is wider than this in both directions is no ball."""
    smooth_px: float = 0.7
    """Standard deviation of the smoothing that is done before blobs are told apart."""
    level: float = 8 / 255
    """Least brightness over the background, after smoothing."""


@dataclass(frozen=True, kw_only=True)
class PlayerSearch:
    """How a player is looked for. Lengths in px of pictures 288 px high."""

    grown: float = 0.2
    """How far outside of his box he is looked for, in its heights."""
    smooth_px: float = 0.6
    """Standard deviation of the smoothing of both pictures."""
    level: float = 16 / 255
    """Least difference from the background, of the colour that differs most."""
    darkest: float = 0.45
    """A shadow leaves at least this share of the light: down to it, a darker background is still the background."""
    closed_px: float = 3.0
    """Gaps up to this width are closed."""
    least_share: float = 0.1
    """Parts smaller than this share of the largest one are not his."""
    least_pixels: float = 6.0
    """Of the largest part, of pictures 288 px high; it grows with the area."""


@dataclass(frozen=True, kw_only=True)
class ChangeSearch:
    """What counts as a change."""

    level: float = 8 / 255
    """Least difference of the colour that differs most."""


def median_frames(frame: int, frames: int, *, window: int = 301, most: int = 61) -> Int[np.ndarray, " chosen"]:
    """Which frames of a clip to take the background of one of them from: evenly spread over a window about it.

    Args:
        frame: The frame, from 0.
        frames: How many the clip has.
        window: Frames that the window spans; long enough that nobody stands still for half of it.
        most: Frames to take at most.
    """
    first = int(np.clip(frame - window // 2, 0, max(frames - window, 0)))
    last = min(first + window, frames) - 1
    return np.unique(np.linspace(first, last, min(most, last - first + 1)).round().astype(np.int64))


def median_background(pictures: Sequence[Float[np.ndarray, "3 height width"]]) -> Float[np.ndarray, "3 height width"]:
    """The median of pictures of a camera that does not move: what most of them show at each pixel.

    Raises:
        ValueError: If there are no pictures, or a colour is not between 0 and 1.
    """
    if not len(pictures):
        raise ValueError("background: pictures: expected at least one, got none")
    for number, picture in enumerate(pictures):
        check_colours(picture, f"background: picture {number}")
    return np.median(np.stack(pictures), axis=0).astype(np.float32)


def find_ball(
    picture: Float[np.ndarray, "3 height width"],
    background: Float[np.ndarray, "3 height width"],
    expected_px: Float[np.ndarray, " 2"],
    search: BallSearch | None = None,
) -> Float[np.ndarray, "found 4"]:
    """The box of the ball, px: the blob brighter than the background that is most clear and near; none at all without.

    Its centre is that of the blob's brightness, to parts of a pixel. No box where the place is missing (NaN).

    Raises:
        ValueError: If a colour is not between 0 and 1, or the pictures differ in size.
    """
    import cv2

    search = search or BallSearch()
    _check_pair(picture, background)
    unit = picture.shape[1] / USUAL_HEIGHT
    side = max(3, round((search.largest_px + 1) * unit) | 1)
    radius, likely = search.radius_px * unit, search.likely_px * unit
    window = _window(expected_px, expected_px, radius + 2 * side, picture.shape[1:])
    if window is None:
        return NOTHING
    left, top, cut = window
    brighter = np.maximum((picture[cut] - background[cut]).mean(axis=0), 0.0).astype(np.float32)
    # Opening leaves what the square fits into; a streak is narrower than it, however long.
    wide = cv2.morphologyEx(brighter, cv2.MORPH_OPEN, np.ones((side, side), np.uint8))
    evidence = cv2.GaussianBlur(brighter - wide, (0, 0), search.smooth_px * unit)
    rows, columns = np.mgrid[: evidence.shape[0], : evidence.shape[1]]
    away = np.hypot(columns + left - expected_px[0], rows + top - expected_px[1])
    peaks = (evidence >= cv2.dilate(evidence, np.ones((3, 3), np.uint8))) & (evidence >= search.level)
    peaks &= away <= radius
    if not peaks.any():
        return NOTHING
    worth = np.where(peaks, evidence * np.exp(-0.5 * (away / likely) ** 2), -1.0)
    row, column = np.unravel_index(int(worth.argmax()), worth.shape)
    _, parts = cv2.connectedComponents((evidence >= 0.5 * evidence[row, column]).astype(np.uint8), connectivity=8)
    parts = np.asarray(parts)
    # What the peak is connected with may be a limb: only what lies within a ball's reach of it counts.
    reach = search.largest_px * unit / 2
    blob = (parts == parts[row, column]) & (np.hypot(rows - row, columns - column) <= reach)
    weight = np.where(blob, evidence, 0.0).astype(np.float64)
    weight /= weight.sum()
    centre = np.array([(weight * columns).sum(), (weight * rows).sum()])
    spread = np.array([(weight * (columns - centre[0]) ** 2).sum(), (weight * (rows - centre[1]) ** 2).sum()])
    # A bar of length L has a variance of L^2 / 12.
    half = np.sqrt(3 * spread)
    return np.concatenate([centre + [left, top] - half, centre + [left, top] + half])[None]


def find_player(
    picture: Float[np.ndarray, "3 height width"],
    background: Float[np.ndarray, "3 height width"],
    expected_box: Float[np.ndarray, " 4"],
    search: PlayerSearch | None = None,
) -> Float[np.ndarray, "found 4"]:
    """The box of what differs from the background in and around a box, px; none where too little does.

    Colours that are those of the background in less light, as in a shadow, do not count. No box where the expected one
    is missing (NaN).

    Raises:
        ValueError: If a colour is not between 0 and 1, or the pictures differ in size.
    """
    import cv2

    search = search or PlayerSearch()
    _check_pair(picture, background)
    unit = picture.shape[1] / USUAL_HEIGHT
    grown = search.grown * float(expected_box[3] - expected_box[1])
    window = _window(expected_box[:2], expected_box[2:], grown, picture.shape[1:])
    if window is None:
        return NOTHING
    left, top, cut = window
    shown, behind = (
        cv2.GaussianBlur(np.ascontiguousarray(colours.transpose(1, 2, 0), np.float32), (0, 0), search.smooth_px * unit)
        for colours in (picture[cut], background[cut])
    )
    light = (shown * behind).sum(axis=2) / np.maximum((behind**2).sum(axis=2), 1e-6)
    light = np.clip(light, search.darkest, 1.0)[..., None]
    differs = (np.abs(shown - light * behind).max(axis=2) > search.level).astype(np.uint8)
    side = max(1, round(search.closed_px * unit))
    closed = cv2.morphologyEx(differs, cv2.MORPH_CLOSE, np.ones((side, side), np.uint8))
    _, parts, statistics, _ = cv2.connectedComponentsWithStats(closed, connectivity=8)
    areas = np.asarray(statistics)[:, cv2.CC_STAT_AREA].copy()
    areas[0] = 0
    if areas.max() < search.least_pixels * unit**2:
        return NOTHING
    rows, columns = np.nonzero((areas >= search.least_share * areas.max())[np.asarray(parts)])
    return np.array([[columns.min() + left, rows.min() + top, columns.max() + left, rows.max() + top]], np.float64)


def find_change(
    with_object: Float[np.ndarray, "3 height width"],
    without_object: Float[np.ndarray, "3 height width"],
    search: ChangeSearch | None = None,
) -> Float[np.ndarray, "found 4"]:
    """The box whose centre is that of all that an object changes in a picture, px; none where it changes too little.

    Its sides are those of a bar that spreads as far as the change does, so that a few stray pixels do not move it.

    Raises:
        ValueError: If a colour is not between 0 and 1, or the pictures differ in size.
    """
    search = search or ChangeSearch()
    _check_pair(with_object, without_object)
    change = np.abs(with_object.astype(np.float64) - without_object).max(axis=0)
    weight = np.where(change >= search.level, change, 0.0)
    if not weight.any():
        return NOTHING
    weight /= weight.sum()
    rows, columns = np.arange(weight.shape[0]), np.arange(weight.shape[1])
    along = ((weight.sum(axis=0), columns), (weight.sum(axis=1), rows))
    centre = np.array([(share * place).sum() for share, place in along])
    spread = [(share * (place - middle) ** 2).sum() for (share, place), middle in zip(along, centre, strict=True)]
    half = np.sqrt(3 * np.array(spread))
    return np.concatenate([centre - half, centre + half])[None]


def moved_aside(
    places: Float[np.ndarray, "*batch 2"], distance_px: float, rng: np.random.Generator
) -> Float[np.ndarray, "*batch 2"]:
    """Places as far away from the true ones in directions of chance: what is found there is found by chance."""
    angle = rng.uniform(0.0, 2 * np.pi, places.shape[:-1])
    return places + distance_px * np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def _window(
    low: np.ndarray, high: np.ndarray, margin: float, size: tuple[int, ...]
) -> tuple[int, int, tuple[slice, slice, slice]] | None:
    """Left, top and the cut of a picture from `low` to `high` and a margin; None where it shows nothing of it."""
    if not (np.isfinite(low).all() and np.isfinite(high).all()):
        return None
    limits = np.array([size[1], size[0]])
    first = np.clip(np.floor(low - margin), 0, limits).astype(int)
    last = np.clip(np.ceil(high + margin) + 1, 0, limits).astype(int)
    if (last <= first).any():
        return None
    return int(first[0]), int(first[1]), (slice(None), slice(first[1], last[1]), slice(first[0], last[0]))


def _check_pair(picture: np.ndarray, other: np.ndarray) -> None:
    if picture.shape != other.shape:
        raise ValueError(f"background: expected {picture.shape}, as the picture, got {other.shape}")
    check_colours(picture, "picture")
    check_colours(other, "background")
