"""Which frames of a long sequence are made when: a few far apart first, then those between them.

A *level* is a rising row of frames that are generated at about one rate. The first level spans the whole sequence; each
level holds those before it, its *keyframes*, and the last one holds every frame. Frames that somebody fixed a value at
are keyframes of the first level where they can be, so that the first stage knows of them at their true time.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Int

NEAREST = 0.75
"""Share of the spacing that two keyframes of the first level are apart at least, where a wanted frame is one."""
LEAST_SPACING = 2.0
"""Frames; keyframes nearer to each other would save nothing."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Pieces:
    """Windows that are filled in at once."""

    frames: Int[np.ndarray, "windows length"]
    """Frames of the sequence that each window shows."""
    made: Bool[np.ndarray, "windows length"]
    """Which of them are taken from this window; the others are shown because a window is so long."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Plan:
    """In what order the frames of a sequence are made."""

    levels: tuple[Int[np.ndarray, " _"], ...]
    """Coarse to fine; the last holds every frame."""
    window: int
    """Most frames that are filled in at once."""
    keep: int
    """Frames that a window of the first level keeps of the one before."""
    rate: float
    """Of the sequence, frames a second."""

    @property
    def keyframe_rate(self) -> float:
        """Of the first level, frames a second on average; that of the sequence where one level does."""
        first = self.levels[0]
        return self.rate * (len(first) - 1) / int(first[-1] - first[0]) if len(first) > 1 else self.rate

    def pieces(self) -> Iterator[Pieces]:
        """What is filled in, in this order; every frame is made once."""
        yield from shifted_pieces(self.levels[0], window=self.window, keep=self.keep)
        for keyframes, level in pairwise(self.levels):
            yield chunk_pieces(level, keyframes, window=self.window)


def plan_of(
    known: Bool[np.ndarray, "frames properties"],
    *,
    rate: float,
    window: int,
    rates: tuple[float, float],
    keyframe_hz: float | None = None,
    keep: int | None = None,
) -> Plan:
    """The order in which a sequence is made with a model.

    Args:
        known: What is fixed.
        rate: Of the sequence, frames a second.
        window: Frames that the model was trained with.
        rates: Lowest and highest rate that it was trained with, frames a second.
        keyframe_hz: Rate of the first level, frames a second; chosen where None, as `keyframe_spacing` says.
        keep: Frames that a window of the first level keeps of the one before; half of them where None.

    Raises:
        ValueError: If the rate of the first level, or what is kept, cannot be.
    """
    frames = len(known)
    spacing = keyframe_spacing(frames, rate, window=window, rates=rates, keyframe_hz=keyframe_hz)
    levels = levels_of(frames, spacing=spacing, window=window, wanted=wanted_frames(known))
    kept = max(1, window // 2) if keep is None else keep
    if len(levels[0]) > window and not 1 <= kept < window:
        raise ValueError(f"keep: expected 1 to {window - 1} of the {window} frames of a window, got {kept}")
    return Plan(levels=levels, window=window, keep=kept, rate=rate)


def keyframe_spacing(
    frames: int, rate: float, *, window: int, rates: tuple[float, float], keyframe_hz: float | None = None
) -> float:
    """Frames from one keyframe of the first stage to the next; 1 where one stage does.

    Unless a rate is asked for, it is the least at which one window spans the sequence, but never so large that the
    first stage runs slower than anything the model was trained with.

    Args:
        frames: Of the sequence.
        rate: Of the sequence, frames a second.
        window: Frames that the model was trained with.
        rates: Lowest and highest rate that it was trained with, frames a second.
        keyframe_hz: Rate of the first stage that is asked for, frames a second.

    Raises:
        ValueError: If the rate that is asked for is not above 0.
    """
    if keyframe_hz is not None and not keyframe_hz > 0:
        raise ValueError(f"keyframe_hz: expected above 0, got {keyframe_hz}")
    if frames <= window or window < 3:
        return 1.0
    if keyframe_hz is not None:
        spacing = min(rate / keyframe_hz, frames - 1.0)
    else:
        spacing = min(max((frames - 1) / (window - 1), LEAST_SPACING), rate / rates[0])
    return spacing if spacing >= LEAST_SPACING else 1.0


def levels_of(
    frames: int, *, spacing: float, window: int, wanted: Bool[np.ndarray, " frames"]
) -> tuple[Int[np.ndarray, " _"], ...]:
    """The levels of a sequence, coarse to fine; neighbours of one level lie less than a window apart in the next.

    Args:
        frames: Of the sequence, one or more.
        spacing: Frames between keyframes of the first level; 1 for one level.
        window: Frames that are filled in at once.
        wanted: Frames that had better be keyframes, such as those with a fixed value.
    """
    every = np.arange(frames)
    if spacing <= 1 or frames <= window:
        return (every,)
    levels = [_split(_anchors(wanted, spacing), spacing)]
    while (gap := int(np.diff(levels[-1]).max())) > window - 1:
        levels.append(_split(levels[-1], max(gap**0.5, gap / (window - 1))))
    return (*levels, every) if len(levels[-1]) < frames else tuple(levels)


def wanted_frames(known: Bool[np.ndarray, "frames properties"]) -> Bool[np.ndarray, " frames"]:
    """The first and the last frame of each stretch over which a property is fixed."""
    outside = np.zeros((1, known.shape[1]), dtype=bool)
    before, after = np.concatenate([outside, known[:-1]]), np.concatenate([known[1:], outside])
    return np.any(known & ~(before & after), axis=1)


def _anchors(wanted: Bool[np.ndarray, " frames"], spacing: float) -> Int[np.ndarray, " _"]:
    """The first frame, the last, and of those wanted as many as lie far enough apart."""
    last = len(wanted) - 1
    chosen = [0]
    for frame in np.flatnonzero(wanted).tolist():
        if frame - chosen[-1] >= NEAREST * spacing and last - frame >= NEAREST * spacing:
            chosen.append(frame)
    return np.array([*chosen, last])


def _split(frames: Int[np.ndarray, " _"], spacing: float) -> Int[np.ndarray, " _"]:
    """The frames, and others between them that divide each gap evenly, about so far apart."""
    parts = []
    for first, last in pairwise(frames.tolist()):
        count = min(max(1, round((last - first) / spacing)), last - first)
        parts.append(np.rint(np.linspace(first, last, count + 1)).astype(np.int64)[:-1])
    return np.concatenate([*parts, frames[-1:]])


def shifted_pieces(level: Int[np.ndarray, " level"], *, window: int, keep: int) -> tuple[Pieces, ...]:
    """The windows of a first level in turn: each keeps the last `keep` frames of the one before, and makes the rest.

    The last one begins where it ends with the level, so that all are of one length.
    """
    count, length = len(level), min(window, len(level))
    pieces, done = [], 0
    while done < count:
        start = min(max(done - keep, 0), count - length)
        places = np.arange(start, start + length)
        pieces.append(Pieces(frames=level[places][None], made=(places >= done)[None]))
        done = start + length
    return tuple(pieces)


def chunk_pieces(level: Int[np.ndarray, " level"], keyframes: Int[np.ndarray, " _"], *, window: int) -> Pieces:
    """Windows that fill a level in between keyframes, all at once: what each makes begins and ends at a keyframe.

    A window holds as many gaps as it has room for; what it shows beyond belongs to its neighbours.
    """
    count, length = len(level), min(window, len(level))
    bounds = _bounds(np.searchsorted(level, keyframes).tolist(), length)
    begin, end = np.array(bounds[:-1]), np.array(bounds[1:])
    places = np.minimum(begin, count - length)[:, None] + np.arange(length)
    frames = level[places]
    made = (places > begin[:, None]) & (places < end[:, None]) & ~np.isin(frames, keyframes)
    return Pieces(frames=frames, made=made)


def _bounds(keyframes: Sequence[int], length: int) -> list[int]:
    """Where chunks begin and end: each at the last keyframe that its window reaches."""
    bounds = [keyframes[0]]
    for place, following in pairwise([*keyframes[1:], keyframes[-1] + length]):
        if following - bounds[-1] > length - 1:
            bounds.append(place)
    return bounds
