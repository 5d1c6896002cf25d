"""EVENTS.csv: what a person saw happen to the ball, read strictly, and human marks as events."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Shaped

from pgm_data.ball import EVENT_KINDS, BallEvents
from pgm_data.ball_marks import ORDER
from pgm_data.convert.loose_csv import read_loose_csv
from pgm_data.geometry.arrays import frozen

ALIASES = {
    "frame": ("frame", "framenum", "framenumber", "frameindex"),
    "kind": ("kind", "event", "type", "label"),
    "x": ("x", "groundx", "xpx"),
    "y": ("y", "groundy", "ypx"),
    "player": ("player",),
}
FRACTIONAL_STD = 0.1
"""Standard deviation of a time that was given finer than a frame, frames."""
COUNT_SLACK = 0.99
"""Share of the video's frames that a marking program must count: it may miss the last."""


@dataclass(frozen=True, eq=False, kw_only=True)
class EventMarks:
    """What a person marked, one row an event, in any order."""

    source: str
    """File the marks are from, named in errors."""
    place: tuple[str, ...]
    """Where in the file each mark stands, such as `line 3`."""
    frame: Float[np.ndarray, " marks"]
    """Frame of the video from 0, perhaps between two."""
    frames_wide: Float[np.ndarray, " marks"]
    """Frames over which it may have happened: 1 of a whole frame, 0 where the mark is finer than a frame."""
    kind: Shaped[np.ndarray, " marks"]
    ground_px: Float[np.ndarray, "marks 2"]
    """Pixel of the ball's vertical projection on the ground; NaN where not marked."""
    player: Shaped[np.ndarray, " marks"]
    """Player object, such as player0; empty where not named."""
    frames_counted: int | None
    """Frames that the marking program counted in the video; None where it does not say."""

    def __post_init__(self) -> None:
        """Keep read-only copies."""
        for name in ("frame", "frames_wide", "ground_px"):
            object.__setattr__(self, name, frozen(getattr(self, name)))


def read_events_csv(
    path: Path,
    times: Float[np.ndarray, " frames"],
    *,
    first_frame: int = 0,
    size: tuple[int, int] | None = None,
) -> BallEvents:
    """The events of a file of the columns frame, kind, x, y (and perhaps player), by a person, in order of time.

    A time is good to a standard deviation of 0.29 frames where the frame is a whole number (it may be anywhere within
    half a frame of it), of a tenth where it is fractional.

    Args:
        path: The file.
        times: Capture times of the clip's frames, s.
        first_frame: Frame of the video that the clip begins with.
        size: Width and height of the picture, px, where it is known: marks must lie near it.

    Raises:
        ValueError: If the file cannot be read, lacks a column, or a row is not what it must be, names a frame that the
            clip has not, or says what a row before it says. The message names file, line, field, expected, found.
    """
    table = read_loose_csv(path, ALIASES, required=("frame", "kind", "x", "y"))
    frame = table.numbers("frame", "a frame's number")
    wrong = np.flatnonzero(~(frame >= 0))
    if len(wrong):
        raise table.fault(int(wrong[0]), "frame", "a frame's number of 0 or more")
    kinds = np.array([text.lower() for text in table.texts("kind")], dtype=object)
    strange = next((row for row, kind in enumerate(kinds) if kind not in EVENT_KINDS), None)
    if strange is not None:
        raise table.fault(strange, "kind", f"one of {', '.join(EVENT_KINDS)}")
    ground = np.stack([table.numbers("x", "a pixel"), table.numbers("y", "a pixel")], axis=1)
    half = np.flatnonzero(np.isfinite(ground).sum(axis=1) == 1)
    if len(half):
        name = "x" if np.isnan(ground[half[0], 0]) else "y"
        raise table.fault(int(half[0]), name, "a pixel, as the row has its other coordinate")
    none = ("",) * len(table)
    marks = EventMarks(
        source=str(path),
        place=tuple(f"line {line}" for line in table.lines),
        frame=frame,
        frames_wide=np.where(frame == np.floor(frame), 1.0, 0.0),
        kind=kinds,
        ground_px=ground,
        player=np.array(table.texts("player") if table.has("player") else none, dtype=object),
        frames_counted=None,
    )
    return events_of_marks(marks, times, first_frame=first_frame, size=size)


def events_of_marks(
    marks: EventMarks,
    times: Float[np.ndarray, " frames"],
    *,
    first_frame: int = 0,
    size: tuple[int, int] | None = None,
) -> BallEvents:
    """Human marks as events of a clip, in order of time; see `read_events_csv`.

    Raises:
        ValueError: If the marks count frames at another rate, or a mark names a frame that the clip has not, lies far
            outside the picture, or repeats another.
    """
    frames = len(times)
    if frames < 2:
        raise ValueError(f"{marks.source}: times: expected at least two frames to tell time by, got {frames}")
    if marks.frames_counted is not None and marks.frames_counted < COUNT_SLACK * (first_frame + frames) - 1:
        raise ValueError(
            f"{marks.source}: frames: expected the video's {first_frame + frames} frames at least, got "
            f"{marks.frames_counted} that the marking program counted: set the video's frame rate there"
        )
    index = marks.frame - first_frame
    outside = np.flatnonzero(~((index >= 0) & (index <= frames - 1)))
    if len(outside):
        row = outside[0]
        span = f"{first_frame} to {first_frame + frames - 1}"
        raise ValueError(f"{_at(marks, row)}: frame: expected one of the clip's, {span}, got {marks.frame[row]:g}")
    if size is not None:
        limits = np.array(size, dtype=float)
        with np.errstate(invalid="ignore"):
            # A ball in the picture may have its projection outside, but not by the half of it.
            far = np.argwhere((marks.ground_px < -0.5 * limits) | (marks.ground_px > 1.5 * limits))
        if len(far):
            row, axis = far[0]
            x, y = marks.ground_px[row]
            said = f"expected a pixel near a picture of {size[0]} x {size[1]}, got {x:g}, {y:g}"
            raise ValueError(f"{_at(marks, row)}: {'xy'[axis]}: {said}")
    rank = np.array([ORDER.index(kind) for kind in marks.kind], dtype=float)
    order = np.lexsort((rank, marks.frame))
    same = np.flatnonzero((np.diff(marks.frame[order]) == 0) & (np.diff(rank[order]) == 0))
    if len(same):
        one, other = sorted(order[same[0] : same[0] + 2].tolist())
        said = f"expected one {marks.kind[one]} a frame, got another as in {marks.place[one]}"
        raise ValueError(f"{_at(marks, other)}: kind: {said}")
    steps = np.diff(times)
    step = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
    if not step > 0:
        raise ValueError(f"{marks.source}: times: expected capture times that rise, got {frames} equal ones")
    # Anything within a span of w frames has a standard deviation of w / sqrt(12) frames.
    std = np.where(marks.frames_wide > 0, marks.frames_wide / np.sqrt(12.0), FRACTIONAL_STD) * step
    return BallEvents(
        times=np.interp(index[order], np.arange(frames), times),
        kinds=marks.kind[order],
        probability=np.ones(len(order)),
        time_std=std[order],
        sources=np.full(len(order), "human", dtype=object),
        players=marks.player[order],
        ground_px=marks.ground_px[order],
    )


def _at(marks: EventMarks, row) -> str:
    return f"{marks.source}: {marks.place[int(row)]}"
