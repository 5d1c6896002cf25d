"""When the frames of a foreign track were shown and taken, and which of them repeat the one before."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from pgm_data.convert.track_csv import TrackRows
from pgm_data.geometry.arrays import frozen
from pgm_data.repeats import capture_times

LONGEST_CYCLE = 12
"""Frames in which a converted frame rate repeats its pattern, at most."""
LEAST_CYCLES = 3
"""Repeats at one place of the cycle that make a pattern."""
LEAST_SHARE = 0.8
"""Of the frames at that place that can tell, how many must repeat."""
MOST_STRAYS = 0.1
"""Share of all other frames that can tell and repeat, at most."""
MOVING_PX = 2.0
"""Steps that a ball must take shortly before and after a repeat to count as moving, px."""
NEAR_FRAMES = 3
"""How shortly: a picture is seldom shown more often in a row."""


@dataclass(frozen=True, eq=False, kw_only=True)
class FrameClock:
    """One row a frame, in order.

    Raises:
        ValueError: If there is no frame, lengths differ, or frames or times are not in order.
    """

    video_frame: Int[np.ndarray, " frames"]
    """Frame of the video in a sequential decode; rising."""
    timestamp: Float[np.ndarray, " frames"]
    """Presentation time, s; rising."""
    capture_time: Float[np.ndarray, " frames"]
    """When the picture was taken, s; never falling."""
    is_duplicate: Bool[np.ndarray, " frames"]
    """Whether the picture repeats the one before."""
    said: str
    """Where the times are from, and what was found of repeats."""

    def __post_init__(self) -> None:
        """Keep read-only copies and check the values."""
        frames = len(self.video_frame)
        if not frames:
            raise ValueError("frames: expected at least one, got none")
        kinds = {"video_frame": np.int64, "is_duplicate": bool}
        for name in ("video_frame", "timestamp", "capture_time", "is_duplicate"):
            object.__setattr__(self, name, frozen(getattr(self, name), kinds.get(name, np.float64)))
            if len(getattr(self, name)) != frames:
                raise ValueError(f"{name}: expected {frames} rows, got {len(getattr(self, name))}")
        if (np.diff(self.video_frame) <= 0).any() or (np.diff(self.timestamp) <= 0).any():
            raise ValueError("video_frame, timestamp: expected values that rise, got others")
        if not np.isfinite(self.capture_time).all() or (np.diff(self.capture_time) < 0).any():
            raise ValueError("capture_time: expected finite times that never fall, got others")


def clock_of_rows(rows: TrackRows, *, fps: float | None = None, frames: int | None = None) -> FrameClock:
    """The clock of a track that comes alone, from frame 0 to its last (or `frames` of them).

    Times are those of `fps` where it is given, else the file's, frames between its rows evenly between theirs.

    Raises:
        ValueError: If there are neither, `fps` is none that a camera has, or there are fewer frames than rows name.
    """
    count = rows.frames if frames is None else frames
    if count < rows.frames:
        raise ValueError(f"{rows.path}: frame: expected fewer than {count} frames, got frame {rows.frames - 1}")
    index = np.arange(count)
    if fps is not None:
        if not 1 <= fps <= 2000:
            raise ValueError(f"fps: expected 1 to 2000 frames a second, got {fps}")
        timestamps, source = index / fps, f"{fps:g} frames a second"
    elif np.isfinite(rows.timestamp).all():
        timestamps, source = _between(rows, index), "times of the file"
    else:
        raise ValueError(f"{rows.path}: timestamp: expected the column, or frames per second (--fps), got neither")
    is_duplicate, found = repeated_rows(rows, count)
    return FrameClock(
        video_frame=index,
        timestamp=timestamps,
        capture_time=capture_times(timestamps, is_duplicate),
        is_duplicate=is_duplicate,
        said=f"{source}; {found}",
    )


def _between(rows: TrackRows, index: Int[np.ndarray, " frames"]) -> Float[np.ndarray, " frames"]:
    """Times of all frames from those of the rows, on in the mean step before the first and after the last."""
    if len(rows.frame) < 2:
        raise ValueError(
            f"{rows.path}: timestamp: expected at least two rows to tell the time by, got {len(rows.frame)}"
        )
    times = np.interp(index, rows.frame, rows.timestamp)
    step = (rows.timestamp[-1] - rows.timestamp[0]) / (rows.frame[-1] - rows.frame[0])
    beyond = np.minimum(index - rows.frame[0], 0) + np.maximum(index - rows.frame[-1], 0)
    return times + step * beyond


def repeated_rows(rows: TrackRows, frames: int) -> tuple[Bool[np.ndarray, " frames"], str]:
    """Which frames repeat the picture before, as far as the track can tell, and what was found in words.

    A repeat has the pixel of the row before to the last bit while the ball moves before and after. One alone may be
    chance; they count only where they come at the same places of a cycle of frames, at least `LEAST_CYCLES` times, and
    hardly anywhere else. Then frames at those places are repeats even where the ball was not seen, from the first
    found to the last, but for those in which it moved.
    """
    pixels = np.full((frames, 2), np.nan)
    usable = rows.visible & ~rows.is_interpolated
    pixels[rows.frame[usable]] = rows.pixels[usable]
    step = np.full(frames, np.nan)
    step[1:] = np.linalg.norm(np.diff(pixels, axis=0), axis=1)
    with np.errstate(invalid="ignore"):
        moved = step > 0
    near = np.pad(np.nan_to_num(step), NEAR_FRAMES)
    windows = np.lib.stride_tricks.sliding_window_view(near, NEAR_FRAMES).max(axis=1)
    moves = (windows[:frames] > MOVING_PX) & (windows[NEAR_FRAMES + 1 :] > MOVING_PX)
    can_tell = np.isfinite(step) & moves
    same = can_tell & ~moved
    hits = int(same.sum())
    nothing = np.zeros(frames, dtype=bool)
    if hits < LEAST_CYCLES:
        return nothing, "no repeated pictures"
    index = np.arange(frames)
    for cycle in range(2, LONGEST_CYCLE + 1):
        tested = np.bincount(index[can_tell] % cycle, minlength=cycle)
        repeated = np.bincount(index[same] % cycle, minlength=cycle)
        places = (repeated >= LEAST_CYCLES) & (repeated >= LEAST_SHARE * tested)
        others = max(int(tested[~places].sum()), 1)
        if places.any() and not places.all() and repeated[~places].sum() <= MOST_STRAYS * others:
            first, last = np.flatnonzero(same)[[0, -1]]
            found = places[index % cycle] & ~moved & (index >= first) & (index <= last)
            return found, f"{places.sum()} of every {cycle} pictures repeats the one before, {found.sum()} in all"
    return nothing, f"{hits} rows stand still in a moving track, without a steady pattern: not taken as repeats"
