"""What the pictures of a clip show where nobody stands, for a camera that turns and zooms about one place.

The BACKGROUND is the median over pictures of the clip, all seen by one camera without a lens error that holds whatever
they show (the CANVAS). Pictures are looked at in small copies. A person who stands in one place for most of the clip is
in the median, and the ground appears where he leaves: such places are told by the colours around them, and repaired.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from pgm_data.dataset.clip_camera import ClipCamera
from pgm_data.detect.players.candidates import Pictures
from pgm_data.detect.players.canvas import SmallView, canvas_from_view, canvas_of, largest_shift, view_from_canvas
from pgm_data.geometry.camera import Camera

QUIET_SHARE = 0.35
"""Share of pictures, at least, that show the background at a pixel."""
QUIET_SIGMA = 0.454
"""Standard deviations that this share of normal differences lie below."""


@dataclass(frozen=True, kw_only=True)
class BackgroundOptions:
    """How the background is learnt."""

    width: int = 640
    """Width of the small copies, px."""
    pictures: int = 25
    """Pictures that the median is taken over."""
    level: float = 7.0
    """Least difference from the background that is none of noise, grey levels."""
    over_noise: float = 3.0
    """The same, in standard deviations of a pixel over the clip."""
    most: float = 27.0
    """What is more is never noise, grey levels: a person who moves on one spot must not hide himself."""
    still: float = 0.25
    """Shift of the pictures' corners under which a camera stands still, small px."""
    least_share: float = 0.12
    """Least share of pictures in which a place shows something else, for it to be asked which of both is the ground."""
    largest_drift_m: float = 0.5
    """A camera that travels by more has no background."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Background:
    """What there is to see where nobody stands, on a canvas."""

    middle: UInt8[np.ndarray, "high wide 3"]
    """Its colours."""
    other: UInt8[np.ndarray, "high wide 3"]
    """What else a place shows for a good part of the clip; the same colours where that is nothing."""
    margin: UInt8[np.ndarray, "high wide"]
    """Differences from them up to which nothing is new, grey levels."""
    camera: Camera
    """Of the canvas."""
    moving: bool
    """Whether the clip's cameras see the canvas in different ways."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Bounds:
    """Which colours are nothing new, in one picture."""

    lower: UInt8[np.ndarray, "high wide 3"]
    """Darkest."""
    upper: UInt8[np.ndarray, "high wide 3"]
    """Brightest."""
    middle: UInt8[np.ndarray, "high wide 3"]
    """The background itself."""


def bounds(background: Background, camera: Camera, size: tuple[int, int]) -> Bounds:
    """What is nothing new to a camera of the clip; where it sees more than the canvas shows, everything."""
    middle, margin = background.middle, background.margin
    if background.moving:
        x, y = canvas_from_view(background.camera, camera, size)
        middle = cv2.remap(middle, x, y, cv2.INTER_LINEAR)
        margin = cv2.remap(margin, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=255)
    wide = cv2.merge([margin, margin, margin])
    darkest, brightest = middle, middle
    if background.moving:
        # A camera that moves is known to less than a pixel only, and edges are sharper in a picture than in the median.
        darkest, brightest = cv2.erode(middle, REACH_OF_DOUBT), cv2.dilate(middle, REACH_OF_DOUBT)
        wide = cv2.add(wide, cv2.convertScaleAbs(cv2.subtract(brightest, darkest), alpha=EDGE_DOUBT))
    return Bounds(lower=cv2.subtract(darkest, wide), upper=cv2.add(brightest, wide), middle=middle)


REACH_OF_DOUBT = np.ones((3, 3), np.uint8)
"""Neighbours whose colours a pixel may have where the camera moves."""
EDGE_DOUBT = 0.5
"""By how much more an edge may be sharper than in the median, in its height."""


def distinct_frames(clip: ClipCamera) -> Int[np.ndarray, " distinct"]:
    """Frames that have a camera and are no repeats."""
    return np.flatnonzero(clip.has_camera & ~clip.is_duplicate)


def picked(pictures: Pictures, frames: Int[np.ndarray, " some"], clip: ClipCamera) -> Iterator[tuple[int, np.ndarray]]:
    """The given frames of a fresh pass over the pictures, in order.

    Raises:
        ValueError: If there are fewer pictures than the clip has frames up to the last one given.
    """
    wanted = set(frames.tolist())
    last = max(wanted, default=-1)
    number = -1
    for number, bgr in enumerate(pictures()):
        if number in wanted:
            yield number, bgr
        if number >= last:
            return
    if number < last:
        raise ValueError(f"{clip.clip_id}: pictures: expected at least {last + 1}, got {number + 1}")


def learn_background(
    pictures: Pictures, clip: ClipCamera, view: SmallView, options: BackgroundOptions
) -> Background | None:
    """The background of a clip; None where its camera travels, or there are no three pictures to compare."""
    frames = distinct_frames(clip)
    place = view.camera.position_world[frames]
    if len(frames) < 3 or np.linalg.norm(place - np.median(place, axis=0), axis=1).max() > options.largest_drift_m:
        return None
    moving = largest_shift(view, frames) > options.still
    canvas, size = canvas_of(view, frames) if moving else (view.camera[int(frames[len(frames) // 2])], view.size)
    taken = frames[np.unique(np.linspace(0, len(frames) - 1, options.pictures).round().astype(int))]
    samples, unseen = [], []
    for frame, bgr in picked(pictures, taken, clip):
        small = view.shrunk(bgr)
        if moving:
            x, y = view_from_canvas(view.camera[frame], canvas, size)
            unseen.append(cv2.remap(np.ones(small.shape[:2], np.uint8), x, y, cv2.INTER_NEAREST) == 0)
            small = cv2.remap(small, x, y, cv2.INTER_LINEAR)
        samples.append(small)
    return _background_of(samples, unseen, canvas, options)


def _background_of(
    samples: list[np.ndarray], unseen: list[np.ndarray], canvas: Camera, options: BackgroundOptions
) -> Background:
    """The background; `unseen` marks what each picture does not show of the canvas, and is empty where all show all."""
    _balance_unseen(samples, unseen)
    median = ranked(samples, 0.5)
    apart = _apart(samples, unseen, median)
    median, other = repaired(median, samples, [d > _margin(apart, options) for d in apart], options.least_share)
    margin = np.clip(_margin(_apart(samples, unseen, median), options), 0, 255).astype(np.uint8)
    if unseen:
        margin[np.mean(unseen, axis=0) > 0.999] = 255
    return Background(middle=median, other=other, margin=margin, camera=canvas, moving=bool(unseen))


def _apart(samples: list[np.ndarray], unseen: list[np.ndarray], median: np.ndarray) -> list[np.ndarray]:
    """By how much each picture differs from the median, in the colour that differs most; 0 where it shows nothing."""
    apart = [_largest_channel(cv2.absdiff(sample, median)) for sample in samples]
    for difference, hidden in zip(apart, unseen, strict=False):
        difference[hidden] = 0
    return apart


def _margin(apart: list[np.ndarray], options: BackgroundOptions) -> Float[np.ndarray, "high wide"]:
    """Differences from the background that are none of noise, grey levels."""
    # The smaller differences are of noise, whatever passed in the other pictures.
    noise = ranked(apart, QUIET_SHARE).astype(np.float32) / QUIET_SIGMA
    margin = np.minimum(options.level + options.over_noise * noise, options.most)
    return np.asarray(cv2.blur(margin, (3, 3)))


def ranked(pictures: list[UInt8[np.ndarray, "*shape"]], share: float) -> UInt8[np.ndarray, "*shape"]:
    """At each pixel the value that the given share of the pictures lie below: the median for one half.

    By a network of comparisons of whole pictures, which is many times faster than sorting at each pixel.
    """
    ranks = [picture.copy() for picture in pictures]
    spare = np.empty_like(ranks[0])
    for turn in range(len(ranks)):
        for low in range(turn % 2, len(ranks) - 1, 2):
            cv2.min(ranks[low], ranks[low + 1], dst=spare)
            cv2.max(ranks[low], ranks[low + 1], dst=ranks[low + 1])
            ranks[low], spare = spare, ranks[low]
    return ranks[min(int(len(ranks) * share), len(ranks) - 1)]


def _balance_unseen(samples: list[np.ndarray], unseen: list[np.ndarray]) -> None:
    """Fill what a picture does not show with black and white in turn, which leaves the median of the others."""
    turn = np.zeros(samples[0].shape[:2], bool)
    for sample, hidden in zip(samples, unseen, strict=False):
        sample[hidden] = np.where(turn[hidden], 255, 0).astype(np.uint8)[:, None]
        turn ^= hidden


def _largest_channel(picture: UInt8[np.ndarray, "high wide 3"]) -> UInt8[np.ndarray, "high wide"]:
    blue, green, red = cv2.split(picture)
    return cv2.max(cv2.max(blue, green), red)


RING = 7
"""Side of the square that a place is widened by for the colours around it, small px."""
LEAST_PLACE = 30
"""Smallest place that is asked about, small px."""
CLEARLY = 8.0
"""By how much the other colour must fit better, grey levels."""


def repaired(
    median: UInt8[np.ndarray, "high wide 3"],
    samples: list[UInt8[np.ndarray, "high wide 3"]],
    differs: list[Bool[np.ndarray, "high wide"]],
    least_share: float,
) -> tuple[UInt8[np.ndarray, "high wide 3"], UInt8[np.ndarray, "high wide 3"]]:
    """The median, with what else a place shows in its stead wherever that fits better; and what else is left over.

    What fits is told by the colours around.

    Args:
        median: The background so far.
        samples: The pictures.
        differs: Where each of them shows something else.
        least_share: Least share of pictures that must.
    """
    count = np.sum(differs, axis=0, dtype=np.float32)
    often = np.asarray(count >= least_share * len(samples), dtype=np.uint8)
    asked = cv2.morphologyEx(often, cv2.MORPH_OPEN, np.ones((3, 3)))
    rows, columns = np.nonzero(asked)
    if not len(rows):
        return median, median
    shown = np.stack([sample[rows, columns] for sample in samples]).astype(np.float32)
    other = np.stack([difference[rows, columns] for difference in differs])[..., None]
    mean = (shown * other).sum(axis=0) / np.maximum(other.sum(axis=0), 1)
    alternative = median.astype(np.float32)
    alternative[rows, columns] = mean
    number, labels, statistics, _ = cv2.connectedComponentsWithStats(asked, connectivity=8)
    result = median.copy()
    for place in range(1, number):
        left, top, width, height, area = statistics[place]
        if area < LEAST_PLACE:
            continue
        window = (
            slice(max(0, top - RING), top + height + RING),
            slice(max(0, left - RING), left + width + RING),
        )
        inside = labels[window] == place
        around = (cv2.dilate(inside.astype(np.uint8), np.ones((RING, RING))) > 0) & (asked[window] == 0)
        if around.sum() < LEAST_PLACE:
            continue
        colours = median[window][around].astype(np.float32)
        gain = _strangeness(median[window].astype(np.float32), inside, colours)
        gain -= _strangeness(alternative[window], inside, colours)
        share = cv2.blur(inside.astype(np.float32), (5, 5))
        better = inside & (cv2.blur(gain, (5, 5)) > CLEARLY * share)
        result[window][better] = alternative[window][better].round().astype(np.uint8)
    return result, np.where(result == median, alternative.round().astype(np.uint8), result)


def _strangeness(
    picture: Float[np.ndarray, "high wide 3"], inside: Bool[np.ndarray, "high wide"], colours: np.ndarray
) -> Float[np.ndarray, "high wide"]:
    """How far each pixel's colour is from all of those around, grey levels; 0 elsewhere."""
    palette = colours[:: max(1, len(colours) // 60)]
    pixels = picture[inside]
    result = np.zeros(inside.shape, np.float32)
    # A tenth of the colours around may be those of something that is no ground either.
    distances = np.abs(pixels[:, None] - palette[None]).max(axis=2)
    rank = min(len(palette) - 1, len(palette) // 10)
    result[inside] = np.partition(distances, rank, axis=1)[:, rank]
    return result
