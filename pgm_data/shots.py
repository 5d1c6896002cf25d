"""A video split into shots while it is read, its repeated pictures marked, and the times its pictures were taken.

Vocabulary: a SHOT is one uninterrupted run of a camera. A BREAK at frame t lies between t - 1 and t: a hard cut. A
frame in a TRANSITION (cross-fade, wipe, fade through black, or a picture of at most eight frames between two breaks)
belongs to no shot. A REPEAT shows the same picture as the frame before, as converted frame rates do: 25 pictures a
second shown as 30 repeat every sixth frame.

Not seen as a break: a jump of a camera that does not move at all, where only the players change place.
"""

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, UInt8

from pgm_data.video import DecodedFrame

SMALL_AREA = 5000
"""Pixels of the small picture that shots are judged by."""
NOISE_LEVEL = 3.0
"""Grey levels of contrast below which a picture counts as blank."""
CELL = 6
"""Side of the cells that changes are counted in, pixels of the small picture."""
CELL_LEVELS = 6.0
"""Mean difference that makes a cell count as changed, grey levels."""
REPEAT_FLOOR = 4.0
"""Added to changes before they are compared as ratios, grey levels."""
LARGE_CHANGE = 128.0
"""Local change beyond which more does not matter, grey levels."""
STRIP_ROWS = 32
"""Rows of a picture compared at a time."""
EVIDENT_REPEATS = 3
"""Repeats that a stretch needs before its even spacing counts as a converted frame rate."""
SPACING_SLACK = 1.35
"""How far first showings may scatter about even spacing, frames shown: 1 is exact rounding to the display's grid."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ShotOptions:
    """When a change of picture is a cut, a fade, a wipe or none: a change is 0 for equal and 1 for unrelated pictures."""

    look_ahead: int = 16
    """Frames read before a frame's verdict is given, at least 16; that many pictures are held in memory."""
    cut_change: float = 0.08
    """Smallest change at a cut."""
    cut_spread: float = 0.4
    """Smallest share of the picture that changes at a cut or over a transition; overlays that pop up stay below it."""
    cut_contrast: float = 4.0
    """A cut's change over the second largest change within six frames to both sides: pans and zooms stay near 1."""
    sure_change: float = 0.45
    """Change that is a cut whatever its neighbours do."""
    flash_return: float = 0.3
    """No cut where a picture from before comes back within six frames, to this share of the change."""
    shortest_shot: int = 8
    """Breaks at most this many frames apart enclose a transition, frames."""
    fade_change: float = 0.05
    """Smallest change over the 8 or 16 frames that a fade or a wipe is looked for in."""
    fade_residual: float = 0.1
    """Largest share of a fade's change that is not a straight mix of its first and last picture (mean over frames)."""
    wipe_residual: float = 0.08
    """Largest distance of a wipe's pixels from both end pictures, share of the distance between the two."""
    unexplained: float = 0.82
    """Smallest share of a transition's change that no motion of the camera explains."""
    repeat_level: float = 40.0
    """Largest local change of a repeat, grey levels: what a codec adds on coding a picture again."""
    repeat_gap: float = 2.2
    """Ratio in local change that must part repeats from the frames around them."""
    repeat_run: int = 4
    """Most repeats of one picture; a longer quiet stretch is a still or a calm scene, and counts as no repeat."""

    def __post_init__(self) -> None:
        """Check the one value that the method relies on."""
        if self.look_ahead < 16:
            raise ValueError(f"look_ahead: expected at least 16 frames, got {self.look_ahead}")


@dataclass(frozen=True, eq=False, kw_only=True)
class MarkedFrame:
    """A frame and the shot it belongs to."""

    frame: DecodedFrame
    """The frame as it was read."""
    shot: int
    """Number of the shot, from 0; in a transition that of the shot before it."""
    is_transition: bool
    """Whether the frame lies in a transition and belongs to no shot."""
    is_duplicate: bool
    """Whether the frame repeats the picture of the frame before it."""


def split_shots(frames: Iterable[DecodedFrame], options: ShotOptions | None = None) -> Iterator[MarkedFrame]:
    """Every frame in order with its shot, each given out `look_ahead` frames after it was read.

    Raises:
        ValueError: If the size of the pictures changes.
    """
    splitter = _Splitter(options or ShotOptions())
    for frame in frames:
        yield from splitter.add(frame)
    yield from splitter.rest()


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
    return np.maximum.accumulate(taken)[np.cumsum(is_source) - 1]


def change_between(a: Float32[np.ndarray, "height width"], b: Float32[np.ndarray, "height width"]) -> float:
    """How unlike two small pictures are: 0 for equal, about 1 for unrelated ones, whatever their mean brightness."""
    a, b = a - a.mean(), b - b.mean()
    noise = 2 * a.size * NOISE_LEVEL**2
    return float(np.vdot(a - b, a - b)) / (float(np.vdot(a, a) + np.vdot(b, b)) + noise)


def changed_share(a: Float32[np.ndarray, "height width"], b: Float32[np.ndarray, "height width"]) -> float:
    """Share of the cells of two small pictures that differ."""
    rows, columns = max(1, a.shape[0] // CELL), max(1, a.shape[1] // CELL)
    cells = cv2.resize(np.abs(a - b), (columns, rows), interpolation=cv2.INTER_AREA)
    return float((cells > CELL_LEVELS).mean())


def local_change(luma: UInt8[np.ndarray, "height width"], previous: UInt8[np.ndarray, "height width"]) -> float:
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


def transition_inside(pictures: Float32[np.ndarray, "frames height width"], options: ShotOptions) -> tuple[int, int]:
    """First frame and end (excluded) of a cross-fade or wipe among the frames; an empty range if there is none.

    In a cross-fade every picture is a straight mix of the first and the last; in a wipe every pixel is either the
    first's or the last's. A moving camera does neither, and its small steps are explained by the picture's gradients.
    """
    first, last = pictures[0], pictures[-1]
    nothing = (0, 0)
    if change_between(first, last) < options.fade_change or changed_share(first, last) < options.cut_spread:
        return nothing
    flat = pictures.reshape(len(pictures), -1)
    flat = flat - flat.mean(axis=1, keepdims=True)
    whole = flat[-1] - flat[0]
    energy = float(whole @ whole)
    likeness = float(flat[0] @ flat[-1]) / np.sqrt(float(flat[0] @ flat[0]) * float(flat[-1] @ flat[-1]) + 1.0)
    done = (flat - flat[0]) @ whole / energy
    steps = np.diff(done)
    # A change of exposure keeps the picture alike; a single step is a cut.
    if likeness > 0.95 or steps.max() > 0.6:
        return nothing
    rest = flat - flat[0] - done[:, None] * whole
    is_fade = float((rest**2).sum(axis=1).mean()) <= options.fade_residual * energy
    if not is_fade:
        differs = np.abs(whole) > 20
        nearer = np.minimum(np.abs(flat - flat[0]), np.abs(flat - flat[-1]))[1:-1, differs] / np.abs(whole[differs])
        if differs.mean() < 0.1 or float(nearer.mean()) > options.wipe_residual:
            return nothing
    if _unexplained_by_motion(0.5 * (first + last), whole, energy) < options.unexplained:
        return nothing
    large = np.flatnonzero(steps > 0.35 * steps.max())
    return int(large[0]) + 1, int(large[-1]) + 1


def is_repeat(changes: Float[np.ndarray, " frames"], at: int, options: ShotOptions) -> bool:
    """Whether frame `at` repeats the frame before it, by the local changes of the frames around it (one shot only).

    The changes must fall into two groups far apart, the frame's in the lower one and low enough for the noise of a
    codec, with at most `repeat_run` frames of the lower group in a row: a scene where little moves has no such gap.
    """
    ordered = np.sort(changes)
    gaps = np.diff(np.log(ordered + REPEAT_FLOOR))
    gaps[ordered[:-1] > options.repeat_level] = 0.0
    if len(gaps) < 2:
        return False
    highest_low = int(gaps.argmax())
    if gaps[highest_low] < np.log(options.repeat_gap) or len(ordered) - highest_low - 1 < 2:
        return False
    low = changes <= ordered[highest_low]
    if not low[at]:
        return False
    breaks = np.flatnonzero(~low)
    after = breaks[breaks > at]
    before = breaks[breaks < at]
    run = (int(after[0]) if len(after) else len(low)) - (int(before[-1]) if len(before) else -1) - 1
    return run <= options.repeat_run


def _unexplained_by_motion(
    middle: Float32[np.ndarray, "height width"], whole: Float32[np.ndarray, " pixels"], energy: float
) -> float:
    """Share of a change that is left after the best small affine motion of the picture, by its gradients."""
    height, width = middle.shape
    right = cv2.Sobel(middle, cv2.CV_32F, 1, 0, ksize=3)
    down = cv2.Sobel(middle, cv2.CV_32F, 0, 1, ksize=3)
    y, x = np.mgrid[:height, :width].astype(np.float32)
    x, y = x / width - 0.5, y / height - 0.5
    moves = np.stack([right, down, x * right, y * right, x * down, y * down]).reshape(6, -1)
    gram = moves @ moves.T
    size = np.linalg.solve(gram + (1e-6 * np.trace(gram) + 1e-6) * np.eye(6, dtype=np.float32), moves @ whole)
    return float(((whole - size @ moves) ** 2).sum()) / energy


def _even(times: Float[np.ndarray, " pictures"]) -> Float[np.ndarray, " pictures"]:
    """The evenly spaced times nearest to the given ones, by least squares."""
    number = np.arange(len(times)) - (len(times) - 1) / 2
    spacing = float(number @ times) / max(float(number @ number), 1.0)
    return times.mean() + spacing * number


def _even_stretch(times: Float[np.ndarray, " pictures"], slack: float) -> int:
    """How many of the first times lie within the slack about even spacing: the longest such beginning, at least 1."""

    def fits(count: int) -> bool:
        return float(np.ptp(times[:count] - _even(times[:count]))) <= slack

    good, step = 1, 1
    while good + step <= len(times) and fits(good + step):
        good, step = good + step, 2 * step
    while step:
        if good + step <= len(times) and fits(good + step):
            good += step
        step //= 2
    return good


@dataclass(frozen=True, eq=False, kw_only=True)
class _Measured:
    """What is kept of a frame that was read."""

    small: Float32[np.ndarray, "height width"]
    """Its small picture."""
    change: float
    """Change from the frame before, 0 for the first."""
    spread: float
    """Share of the picture that changed, 0 where the change is too small for a cut."""
    local: float
    """Local change, grey levels, NaN for the first."""


class _Splitter:
    """Frames in, marked frames out, with a bounded memory of the frames between."""

    REACH = 6
    """Frames to both sides that a cut is compared with."""
    REPEAT_REACH = 7
    """Frames to both sides that a repeat is compared with."""

    def __init__(self, options: ShotOptions) -> None:
        self._options = options
        self._width = 0
        self._read = self._given = 0
        self._waiting: deque[DecodedFrame] = deque()
        self._measured: dict[int, _Measured] = {}
        self._last_luma: np.ndarray | None = None
        self._breaks: dict[int, bool] = {}
        self._transitions: deque[tuple[int, int]] = deque()
        self._shot = 0
        self._shot_has_frames = False
        self._in_transition = False

    def add(self, frame: DecodedFrame) -> Iterator[MarkedFrame]:
        """Read one frame; gives the frame whose verdict is ready, if any."""
        luma = frame.luma
        if not self._width:
            self._width = max(CELL, round((SMALL_AREA * luma.shape[1] / luma.shape[0]) ** 0.5))
        small = frame.small_luma(self._width).astype(np.float32)
        change, spread, local = 0.0, 0.0, float("nan")
        if self._last_luma is not None:
            before = self._measured[self._read - 1].small
            local = local_change(luma, self._last_luma)
            change = change_between(before, small)
            spread = changed_share(before, small) if change >= self._options.cut_change else 0.0
        self._last_luma = luma
        self._waiting.append(frame)
        self._measured[self._read] = _Measured(small=small, change=change, spread=spread, local=local)
        self._read += 1
        for length in (9, 17):
            self._find_transition(self._read - length)
        if self._read - self._given > self._options.look_ahead:
            yield self._give()

    def rest(self) -> Iterator[MarkedFrame]:
        """The frames still held, after the last was read."""
        while self._given < self._read:
            yield self._give()

    def _find_transition(self, begin: int) -> None:
        """Keep the transition among the frames read last, joined to the one before if they nearly touch."""
        if begin not in self._measured:
            return
        if (
            change_between(self._measured[begin].small, self._measured[self._read - 1].small)
            < self._options.fade_change
        ):
            return
        pictures = np.stack([self._measured[frame].small for frame in range(begin, self._read)])
        start, end = transition_inside(pictures, self._options)
        if start >= end:
            return
        start, end = start + begin, end + begin
        if self._transitions and start <= self._transitions[-1][1] + 4:
            last_start, last_end = self._transitions.pop()
            start, end = min(start, last_start), max(end, last_end)
        self._transitions.append((start, end))

    def _give(self) -> MarkedFrame:
        """The oldest frame held, with its verdict."""
        at = self._given
        is_duplicate = self._is_repeat(at)
        if self._is_transition(at):
            self._in_transition = True
        else:
            self._shot += self._shot_has_frames and (self._in_transition or self._is_break(at))
            self._in_transition = False
            self._shot_has_frames = True
        self._given += 1
        self._forget()
        return MarkedFrame(
            frame=self._waiting.popleft(),
            shot=self._shot,
            is_transition=self._in_transition,
            is_duplicate=is_duplicate,
        )

    def _forget(self) -> None:
        """Drop what no later verdict needs."""
        oldest = self._given - 2 * self._options.shortest_shot - self.REACH
        self._measured.pop(oldest, None)
        self._breaks.pop(oldest, None)
        while self._transitions and self._transitions[0][1] < oldest:
            self._transitions.popleft()

    def _is_transition(self, at: int) -> bool:
        """Whether the frame is blank, in a fade or wipe, or between two breaks."""
        is_blank = float(self._measured[at].small.std()) < NOISE_LEVEL
        if is_blank or any(start <= at < end for start, end in self._transitions):
            return True
        reach = self._options.shortest_shot
        before = [frame for frame in range(max(at - reach + 1, 1), at + 1) if self._is_break(frame)]
        after = [frame for frame in range(at + 1, at + reach + 1) if self._is_break(frame)] if before else []
        return bool(after) and after[0] - before[-1] <= reach

    def _is_break(self, at: int) -> bool:
        """Whether a hard cut lies just before the frame."""
        if at not in self._breaks:
            self._breaks[at] = self._judge_break(at)
        return self._breaks[at]

    def _judge_break(self, at: int) -> bool:
        """A change that is large, wide, out of the ordinary, and does not go back at once."""
        measured, options = self._measured.get(at), self._options
        if measured is None or measured.change < options.cut_change or measured.spread < options.cut_spread:
            return False
        around = [frame for frame in range(at - self.REACH, at + self.REACH + 1) if frame in self._measured]
        others = sorted(self._measured[frame].change for frame in around if frame != at)
        # The second largest: two cuts may come close together, and most steps are 0 where pictures repeat.
        usual = others[-2] if len(others) > 1 else 0.0
        if measured.change < min(options.sure_change, options.cut_contrast * usual):
            return False
        before = [self._measured[frame].small for frame in around if frame < at]
        after = [self._measured[frame].small for frame in around if frame >= at]
        back = options.flash_return * measured.change
        return all(change_between(one, other) > back for one in before for other in after)

    def _is_repeat(self, at: int) -> bool:
        """Whether the frame repeats the one before, judged inside its shot."""
        begin = end = at
        while begin > max(at - self.REPEAT_REACH, 0) and not self._is_break(begin):
            begin -= 1
        while end < min(at + self.REPEAT_REACH, self._read - 1) and not self._is_break(end + 1):
            end += 1
        if begin == 0 or self._is_break(begin):
            # The first frame of a shot repeats nothing, and its change says nothing about the others.
            begin += 1
        if begin > at:
            return False
        changes = np.array([self._measured[frame].local for frame in range(begin, end + 1)])
        return is_repeat(changes, at - begin, self._options)
