"""A video split into shots while it is read, with the frames of transitions and repeated pictures marked.

Vocabulary: a SHOT is one uninterrupted run of a camera. A BREAK at frame t lies between t - 1 and t: a hard cut. A
frame in a TRANSITION (cross-fade, wipe, fade through black, or a picture of at most eight frames between two breaks)
belongs to no shot.

Not seen as a break: a jump of a camera that does not move at all, where only the players change place.
"""

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float32

from pgm_data.repeats import RepeatOptions, capture_times, is_repeat, local_change
from pgm_data.video import DecodedFrame

__all__ = ["MarkedFrame", "RepeatOptions", "ShotOptions", "capture_times", "split_shots", "transition_inside"]

SMALL_AREA = 5000
"""Pixels of the small picture that shots are judged by."""
NOISE_LEVEL = 3.0
"""Grey levels of contrast below which a picture counts as blank."""
CELL = 6
"""Side of the cells that changes are counted in, pixels of the small picture."""
CELL_LEVELS = 6.0
"""Mean difference that makes a cell count as changed, grey levels."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ShotOptions:
    """When a change is a cut, a fade, a wipe or none. Changes are 0 for equal and about 1 for unrelated pictures."""

    look_ahead: int = 16
    """Frames read before a frame's verdict is given, at least 16; that many pictures are held in memory."""
    cut_change: float = 0.08
    """Smallest change at a cut."""
    cut_spread: float = 0.4
    """Smallest share of the picture that changes at a cut or over a transition; overlays that pop up stay below it."""
    cut_contrast: float = 4.0
    """A cut's change over the second largest change within six frames to both sides: pans and zooms stay near 1."""
    sure_change: float = 0.6
    """Change that is a cut whatever its neighbours do."""
    flash_return: float = 0.5
    """No cut where a picture from before comes back within six frames, to this share of the change."""
    shortest_shot: int = 8
    """Breaks at most this many frames apart enclose a transition, frames."""
    fade_change: float = 0.05
    """Smallest change over the 8 or 16 frames that a fade or a wipe is looked for in."""
    fade_residual: float = 0.1
    """Largest share of a fade's change that is not a straight mix of its first and last picture (mean over frames)."""
    wipe_step: float = 0.62
    """Smallest share of all its change that a cell makes within two frames of a wipe (mean over changed cells)."""
    unexplained: float = 0.82
    """Smallest share of a transition's change that no motion of the camera explains."""
    repeats: RepeatOptions = RepeatOptions()
    """When a frame repeats the one before."""

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


def change_between(a: Float32[np.ndarray, "height width"], b: Float32[np.ndarray, "height width"]) -> float:
    """How unlike two small pictures are: 0 for equal, about 1 for unrelated ones, whatever their mean brightness."""
    a, b = a - a.mean(), b - b.mean()
    noise = 2 * a.size * NOISE_LEVEL**2
    return float(np.vdot(a - b, a - b)) / (float(np.vdot(a, a) + np.vdot(b, b)) + noise)


def _cells(difference: Float32[np.ndarray, "height width"]) -> Float32[np.ndarray, "rows columns"]:
    """Means over square cells of a small picture."""
    rows, columns = max(1, difference.shape[0] // CELL), max(1, difference.shape[1] // CELL)
    return cv2.resize(difference, (columns, rows), interpolation=cv2.INTER_AREA)


def changed_share(a: Float32[np.ndarray, "height width"], b: Float32[np.ndarray, "height width"]) -> float:
    """Share of the cells of two small pictures that differ."""
    return float((_cells(np.abs(a - b)) > CELL_LEVELS).mean())


def transition_inside(pictures: Float32[np.ndarray, "frames height width"], options: ShotOptions) -> tuple[int, int]:
    """First frame and end (excluded) of a cross-fade or wipe among the frames; an empty range if there is none.

    In a cross-fade every picture is a straight mix of the first and the last; in a wipe every part of the picture
    changes once and at once. A moving camera does neither, and its small steps are explained by the gradients.
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
    if not is_fade and _steepness(pictures) < options.wipe_step:
        return nothing
    if _unexplained_by_motion(0.5 * (first + last), whole, energy) < options.unexplained:
        return nothing
    # A pan before or after a fade makes small steps too; a wipe's steps differ by what lies under its edge.
    large = np.flatnonzero(steps > (0.5 if is_fade else 0.15) * steps.max())
    return int(large[0]) + 1, int(large[-1]) + 1


def _steepness(pictures: Float32[np.ndarray, "frames height width"]) -> float:
    """How far cells change at once: their largest change within two frames over all they change, mean, 0 to 1.

    It is 0 where most cells change at one time, as in a cut or a flash.
    """
    cells = np.stack([_cells(picture) for picture in pictures]).reshape(len(pictures), -1)
    total = np.abs(cells[-1] - cells[0])
    changed = total > CELL_LEVELS
    if not changed.any():
        return 0.0
    cells, total = cells[:, changed], total[changed]
    moves = np.abs(cells[2:] - cells[:-2])
    path = np.abs(np.diff(cells, axis=0)).sum(axis=0)
    times = np.bincount(moves.argmax(axis=0), minlength=len(moves))
    if (times[1:] + times[:-1]).max() > 0.6 * len(total):
        return 0.0
    return float((np.minimum(moves.max(axis=0), total) / np.maximum(path, total)).mean())


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
        return is_repeat(changes, at - begin, self._options.repeats)
