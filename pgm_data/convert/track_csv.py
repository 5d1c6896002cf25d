"""TRACK.csv: a ball's track in the picture by somebody else's program, in any of the forms that such programs write.

Ours is written in two forms: `frame,x,y,visible,timestamp`, and TrackNetV2's `Frame,Visibility,X,Y`.

Pixels are those of a picture whose top-left pixel has its CENTRE at (0, 0). A row counts as not detected where it says
so (visible 0), holds no coordinates, or (-1, -1), or without a column that tells, (0, 0).
"""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Int

from pgm_data.convert.loose_csv import LooseTable, read_loose_csv
from pgm_data.dataset.files import whole_file
from pgm_data.geometry.arrays import frozen

LAST_FRAME = 2_000_000
"""Frames beyond this are a mistake: eleven hours of video."""
HIDDEN = 3.0
"""TrackNet's word for a ball behind something, whose place is a guess."""
CLOCK_TIME = re.compile(r"(?:(\d+):)?(\d+):(\d+(?:\.\d+)?)", re.ASCII)
NUMBER = re.compile(r"[-+]?[0-9.]+e[-+]?[0-9]+|[-+]?(nan|inf|infinity)", re.ASCII | re.IGNORECASE)
"""Numbers that have letters in them."""
FILE_FRAME = re.compile(r"(\d+)(?:\.[A-Za-z]\w*)?$", re.ASCII)
ALIASES = {
    "frame": ("frame", "frames", "num", "framenum", "framenumber", "frameno", "frameid", "frameindex", "filename"),
    "x": ("x", "xcoordinate", "xcoord", "ballx", "cx", "xpx"),
    "y": ("y", "ycoordinate", "ycoord", "bally", "cy", "ypx"),
    "visible": ("visible", "visibility", "visibilityclass", "vis", "isvisible"),
    "timestamp": ("timestamp", "time", "timestamps", "times", "t", "seconds", "second"),
    "score": ("score", "confidence", "conf", "probability", "prob"),
    "interpolated": ("interpolated", "isinterpolated", "inpainted", "inpaint", "inpaintmask", "filled"),
}
TrackForm = Literal["plain", "tracknet"]
YES = {"true": 1.0, "yes": 1.0, "false": 0.0, "no": 0.0}


@dataclass(frozen=True, eq=False, kw_only=True)
class TrackRows:
    """What the file says, one row each, in order of frames; frames that it leaves out have no row."""

    path: Path
    frame: Int[np.ndarray, " rows"]
    """Frame of the video in a sequential decode, from 0; rising."""
    pixels: Float[np.ndarray, "rows 2"]
    """NaN where the ball was not detected."""
    is_interpolated: Bool[np.ndarray, " rows"]
    """Whether the pixel was put there between others, or guessed behind something: it is no measurement."""
    score: Float[np.ndarray, " rows"]
    """As the file has it, on any scale; NaN where it has none."""
    timestamp: Float[np.ndarray, " rows"]
    """Presentation time, s; NaN where the file has none."""

    def __post_init__(self) -> None:
        """Keep read-only copies."""
        for name, kind in (("frame", np.int64), ("is_interpolated", bool)):
            object.__setattr__(self, name, frozen(getattr(self, name), kind))
        for name in ("pixels", "score", "timestamp"):
            object.__setattr__(self, name, frozen(getattr(self, name)))

    @property
    def visible(self) -> Bool[np.ndarray, " rows"]:
        """Rows with a pixel, measured or not."""
        return np.asarray(np.isfinite(self.pixels).all(axis=1))

    @property
    def frames(self) -> int:
        """Frames up to the last that the file names."""
        return int(self.frame[-1]) + 1 if len(self.frame) else 0


def read_track_csv(path: Path) -> TrackRows:
    """The rows of a track with the columns frame, x, y and perhaps visible, timestamp, score, interpolated.

    Titles are matched loosely, TrackNet's and WASB's among them; the rest of the columns is passed over.

    Raises:
        ValueError: If the file cannot be read, has no such columns or no row, a frame repeats or falls, or a cell is
            not what it must be. The message names file, line, field, what was expected and found.
    """
    table = read_loose_csv(path, ALIASES, required=("frame", "x", "y"))
    if not len(table):
        raise ValueError(f"{path}: expected a row for each frame, got none")
    frame = _frames(table)
    pixels, guessed = _pixels(table)
    none = np.full(len(table), np.nan)
    interpolated = _flags(table, "interpolated") > 0 if table.has("interpolated") else np.zeros(len(table), dtype=bool)
    return TrackRows(
        path=path,
        frame=frame,
        pixels=pixels,
        is_interpolated=(interpolated | guessed) & np.isfinite(pixels[:, 0]),
        score=table.numbers("score") if table.has("score") else none,
        timestamp=_timestamps(table) if table.has("timestamp") else none,
    )


def _frames(table: LooseTable) -> Int[np.ndarray, " rows"]:
    expected = f"a frame's number from 0 to {LAST_FRAME}"
    texts = table.texts("frame")
    if any(re.search("[A-Za-z]", text) and not NUMBER.fullmatch(text) for text in texts):  # names of picture files
        found = [FILE_FRAME.search(text) for text in texts]
        wrong = next((i for i, match in enumerate(found) if match is None or len(match[1]) > 15), None)
        if wrong is not None:
            raise table.fault(wrong, "frame", f"{expected}, or a picture's file name that ends in one")
        frame = np.array([int(match[1]) for match in found if match is not None], dtype=np.int64)
        if frame.max() > LAST_FRAME:
            raise table.fault(int(frame.argmax()), "frame", expected)
    else:
        frame = table.whole_numbers("frame", expected, LAST_FRAME)
    fallen = np.flatnonzero(np.diff(frame) <= 0)
    if len(fallen):
        before = frame[fallen[0]]
        raise table.fault(int(fallen[0]) + 1, "frame", f"frames that rise, so above {before} of the row before")
    return frame


def _pixels(table: LooseTable) -> tuple[Float[np.ndarray, "rows 2"], Bool[np.ndarray, " rows"]]:
    """Pixels, NaN where there is none, and which of them are guesses at a hidden ball."""
    pixels = np.stack([table.numbers("x", "a pixel"), table.numbers("y", "a pixel")], axis=1)
    pixels[(pixels == -1).all(axis=1)] = np.nan
    if table.has("visible"):
        level = _flags(table, "visible")
        wrong = np.flatnonzero(~np.isin(level, [0, 1, 2, 3]))
        if len(wrong):
            raise table.fault(int(wrong[0]), "visible", "0 or 1 (or TrackNet's 0 to 3)")
        hidden = level == 0
    else:
        level = np.ones(len(table))
        hidden = (pixels == 0).all(axis=1)
    pixels[hidden] = np.nan
    half = np.flatnonzero(np.isfinite(pixels).sum(axis=1) == 1)
    if len(half):
        name = "x" if np.isnan(pixels[half[0], 0]) else "y"
        raise table.fault(int(half[0]), name, "a pixel, as the row has its other coordinate")
    seen = np.isfinite(pixels).all(axis=1)
    if seen.sum() >= 10 and (np.abs(pixels[seen]) <= 1).all():
        row = int(np.flatnonzero(seen)[0])
        raise table.fault(row, "x", "pixels, not shares of the picture's width")
    return pixels, np.asarray((level == HIDDEN) & seen)


def _flags(table: LooseTable, name: str) -> Float[np.ndarray, " rows"]:
    """A column of numbers or yes and no; 0 where a cell is empty."""
    texts = [text.lower() for text in table.texts(name)]
    if all(text in YES or not text for text in texts):
        return np.array([YES.get(text, 0.0) for text in texts])
    return np.nan_to_num(table.numbers(name, "0 or 1"))


def _timestamps(table: LooseTable) -> Float[np.ndarray, " rows"]:
    """Times in seconds, or as hours, minutes and seconds.

    Raises:
        ValueError: If some are missing, or times do not rise.
    """
    clock = [CLOCK_TIME.fullmatch(text) for text in table.texts("timestamp")]
    if all(match is not None for match in clock):
        times = np.array([3600 * int(m[1] or 0) + 60 * int(m[2]) + float(m[3]) for m in clock if m is not None])
    else:
        times = table.numbers("timestamp", "a time in seconds")
    if np.isnan(times).all():
        return times
    wrong = np.flatnonzero(~(np.diff(times, prepend=-np.inf) > 0))
    if len(wrong):
        raise table.fault(int(wrong[0]), "timestamp", "a time in seconds above that of the row before")
    return times


def write_track_csv(
    path: Path,
    *,
    frame: Int[np.ndarray, " rows"],
    pixels: Float[np.ndarray, "rows 2"],
    timestamp: Float[np.ndarray, " rows"],
    form: TrackForm = "plain",
) -> None:
    """Write a row a frame; pixels are those that `read_track_csv` reads back.

    `plain`: `frame,x,y,visible,timestamp`, numbers to the last bit, no pixel where the ball was not detected.
    `tracknet`: `Frame,Visibility,X,Y` with whole pixels and 0, 0 where it was not, as TrackNetV2 and V3 take them; it
    loses up to half a pixel and the times.

    Args:
        path: The file.
        frame: Frame of the video in a sequential decode, from 0; rising.
        pixels: NaN where the ball was not detected; the centre of the top-left pixel is (0, 0).
        timestamp: Presentation time, s.
        form: Which of the two.

    Raises:
        ValueError: If frames do not rise or a pixel is NaN in part.
    """
    if (np.diff(frame) <= 0).any():
        raise ValueError(f"{path}: frame: expected frames that rise, got others")
    seen = np.asarray(np.isfinite(pixels).all(axis=1))
    if not np.isnan(pixels[~seen]).all():
        raise ValueError(f"{path}: pixels: expected both coordinates finite, or both NaN, got others")
    if form == "plain":
        lines = ["frame,x,y,visible,timestamp"]
        for row, (x, y), time in zip(frame.tolist(), pixels.tolist(), timestamp.tolist(), strict=True):
            lines.append(f"{row},{x!r},{y!r},1,{time!r}" if x == x else f"{row},,,0,{time!r}")
    else:
        whole = np.where(seen[:, None], np.rint(np.where(seen[:, None], pixels, 0.0)), 0.0).astype(np.int64)
        lines = ["Frame,Visibility,X,Y"]
        rows = zip(frame.tolist(), seen.tolist(), whole.tolist(), strict=True)
        lines += [f"{row},{int(visible)},{x},{y}" for row, visible, (x, y) in rows]
    with whole_file(path) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")
