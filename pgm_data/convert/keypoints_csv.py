"""KEYPOINTS.csv: court points that a person marked in frames of videos, read strictly."""

import csv
import math
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from pgm_data.court import Court
from pgm_data.geometry.arrays import frozen

COLUMNS = ("video", "frame", "name", "x", "y")
WHOLE_NUMBER = re.compile(r"[0-9]{1,15}", re.ASCII)


@dataclass(frozen=True, eq=False, kw_only=True)
class KeypointMarks:
    """Marked court points, one per row of the file, in its order."""

    video: tuple[str, ...]
    """The video as the file names it."""
    frame: Int[np.ndarray, " marks"]
    """Frame of the video in a sequential decode, from 0."""
    name_index: Int[np.ndarray, " marks"]
    """Index of the point in the court's `all_names`."""
    pixels: Float[np.ndarray, "marks 2"]
    """Where it was marked, pixels; the centre of the top-left pixel is (0, 0)."""

    def __post_init__(self) -> None:
        """Keep read-only copies."""
        object.__setattr__(self, "frame", frozen(self.frame, np.int64))
        object.__setattr__(self, "name_index", frozen(self.name_index, np.int64))
        object.__setattr__(self, "pixels", frozen(self.pixels))


def read_keypoints(path: Path, court: Court) -> KeypointMarks:
    """The marks in a file of the columns video, frame, name, x, y.

    Raises:
        ValueError: If the file cannot be read, a column is missing, unknown or repeated, or a row holds a point that
            the court does not have, a number that is none, or a point marked before. The message names the first such
            place by file, line and field, and counts the others.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            return _marks(path, csv.reader(file, strict=True), court)
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ValueError(
            f"{path}: expected a CSV file in UTF-8 with the columns {','.join(COLUMNS)}, got: {error}"
        ) from (error)


def _marks(path: Path, reader, court: Court) -> KeypointMarks:
    header = next(reader, None)
    if header is None:
        raise ValueError(f"{path}: line 1: expected the columns {','.join(COLUMNS)}, got an empty file")
    names = [name.strip() for name in header]
    if sorted(names) != sorted(COLUMNS):
        raise ValueError(f"{path}: line 1: expected the columns {','.join(COLUMNS)}, got {','.join(names) or 'none'}")
    index_of = {name: i for i, name in enumerate(court.all_names)}
    rows: list[tuple[str, int, int, float, float]] = []
    faults: list[str] = []
    first_line: dict[tuple[str, int, int], int] = {}
    for cells in reader:
        line = reader.line_num
        if not any(cell.strip() for cell in cells):
            continue
        if len(cells) != len(COLUMNS):
            faults.append(f"line {line}: expected {len(COLUMNS)} fields, got {len(cells)}")
            continue
        row = {name: cell.strip() for name, cell in zip(names, cells, strict=True)}
        wrong = _faults(row, index_of)
        if wrong:
            faults.extend(f"line {line}: {fault}" for fault in wrong)
            continue
        frame, index = int(row["frame"]), index_of[row["name"]]
        before = first_line.setdefault((row["video"], frame, index), line)
        if before != line:
            point = f"{row['name']} in frame {frame} of {row['video']}"
            faults.append(f"line {line}: name: expected each point once per frame, got {point} as in line {before}")
            continue
        rows.append((row["video"], frame, index, float(row["x"]), float(row["y"])))
    if faults:
        more = f" (and {len(faults) - 1} more)" if len(faults) > 1 else ""
        raise ValueError(f"{path}: {faults[0]}{more}")
    return KeypointMarks(
        video=tuple(row[0] for row in rows),
        frame=np.array([row[1] for row in rows], dtype=np.int64),
        name_index=np.array([row[2] for row in rows], dtype=np.int64),
        pixels=np.array([row[3:] for row in rows], dtype=np.float64).reshape(-1, 2),
    )


def _faults(row: dict[str, str], index_of: dict[str, int]) -> list[str]:
    faults = []
    if not row["video"]:
        faults.append("video: expected the name of a video, got nothing")
    if not WHOLE_NUMBER.fullmatch(row["frame"]):
        faults.append(f"frame: expected a whole number of 0 or more, got {row['frame']!r}")
    if row["name"] not in index_of:
        faults.append(f"name: expected one of {', '.join(index_of)}, got {row['name']!r}")
    for axis in ("x", "y"):
        if not math.isfinite(_number(row[axis])):
            faults.append(f"{axis}: expected a pixel coordinate, got {row[axis]!r}")
    return faults


def _number(text: str) -> float:
    """The number a cell holds; NaN where it holds none."""
    try:
        # Python alone would read 1_000 as a thousand.
        return float(text) if "_" not in text else math.nan
    except ValueError:
        return math.nan
