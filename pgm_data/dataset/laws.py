"""What the values of every table hold to, and how rows that do not are named."""

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from pgm_data.dataset.columns import KEYS, Column
from pgm_data.dataset.document_schemas import PATTERN_WORDS, SOURCE_PATH
from pgm_data.dataset.documents import Fault
from pgm_data.scene import Scene

Columns = Mapping[str, np.ndarray]
"""Columns of one table that could be read as what they must be; a law whose columns are not all there is silent."""

LATEST_S = 1e7
"""No time lies further from zero: a hundred days."""

FASTEST_M_S = 120.0
"""Nothing of a scene moves faster, a smashed shuttlecock in play included."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Context:
    """What is known about the clip that a table belongs to; None of each where it is not."""

    scene: Scene | None = None
    clip_id: str | None = None
    n_frames: int | None = None
    first_video_frame: int | None = None
    size: tuple[int, int] | None = None
    """Width and height, pixels."""
    quality: str | None = None
    """Preset, `truth` `imported` or `generated`."""


def rows_fault(
    field: str, bad: ArrayLike, expected: str, shown: Sequence | np.ndarray | Callable[[int], object]
) -> Iterator[Fault]:
    """One fault for all rows that are bad: the first row's value, and how many more there are."""
    bad = np.asarray(bad)
    if np.count_nonzero(bad):
        rows = np.flatnonzero(bad)
        first = int(rows[0])
        value = shown(first) if callable(shown) else shown[first]
        more = f" and {len(rows) - 1} more" if len(rows) > 1 else ""
        yield Fault(field=field, expected=expected, found=f"{as_text(value)} in row {first}{more}")


def as_text(value: object) -> str:
    """A value as an error shows it, cut to a line."""
    if isinstance(value, np.ndarray):
        text = np.array2string(value, precision=6, separator=", ", threshold=12).replace("\n", " ")
    else:
        plain = value.item() if isinstance(value, np.generic) else value
        text = f"{plain:.9g}" if isinstance(plain, float) else repr(plain)
    return text if len(text) <= 100 else text[:97] + "..."


def per_row(values: np.ndarray) -> np.ndarray:
    """The values as one row of numbers per row of the table."""
    return values.reshape(len(values), math.prod(values.shape[1:]))


def value_faults(columns: Columns, declared: Sequence[Column]) -> Iterator[Fault]:
    """Words that a column may not hold, and infinite numbers."""
    for column in declared:
        values = columns.get(column.name)
        if values is None:
            continue
        if column.allowed:
            yield from rows_fault(
                column.name, not_among(values, column.allowed), f"one of {', '.join(column.allowed)}", values
            )
        if column.type in ("float", "double"):
            infinite = np.isinf(values)
            if np.count_nonzero(infinite):
                yield from rows_fault(column.name, per_row(infinite).any(axis=1), "finite numbers or NaN", values)


def not_among(words: np.ndarray, allowed: Sequence[str]) -> np.ndarray:
    """Which words are none of those allowed."""
    # No numpy text: it would pad every row to the longest word of a file that nobody vouches for.
    known = set(allowed)
    if known.issuperset(words):
        return np.zeros(len(words), dtype=bool)
    return np.array([word not in known for word in words], dtype=bool)


def repeated(words: np.ndarray) -> np.ndarray:
    """Which words stood in an earlier row already."""
    seen: set[str] = set()
    again = np.zeros(len(words), dtype=bool)
    for row, word in enumerate(words):
        again[row] = word in seen
        seen.add(word)
    return again


def clip_id_faults(columns: Columns, context: Context) -> Iterator[Fault]:
    """Rows of another clip."""
    ids = columns.get("clip_id")
    if ids is None or not len(ids):
        return
    expected = context.clip_id if context.clip_id is not None else ids[0]
    place = "the clip's folder" if context.clip_id is not None else "the first row"
    yield from rows_fault("clip_id", ids != expected, f"{expected!r} as in {place}", ids)


def key_faults(columns: Columns, context: Context) -> Iterator[Fault]:
    """Keys of a frame-aligned table: one row per frame of the clip, in order."""
    yield from clip_id_faults(columns, context)
    rows = len(next(iter(columns.values()), ()))
    if context.n_frames is not None and rows != context.n_frames:
        yield Fault(field="", expected=f"{context.n_frames} rows, n_frames of clip.json", found=f"{rows} rows")
    if rows == 0:
        yield Fault(field="", expected="at least one row", found="none")
        return
    if "frame_index" in columns:
        index = columns["frame_index"]
        yield from rows_fault("frame_index", index != np.arange(rows), "the row's own number, from 0", index)
    if "video_frame" in columns:
        frame = columns["video_frame"]
        yield from rows_fault("video_frame", frame < 0, "at least 0", frame)
        if context.first_video_frame is not None and frame[0] != context.first_video_frame:
            expected = f"{context.first_video_frame} in row 0, first_video_frame of clip.json"
            yield Fault(field="video_frame", expected=expected, found=as_text(int(frame[0])))
        yield from _not_rising("video_frame", frame)
    if "timestamp" in columns:
        yield from time_faults("timestamp", columns["timestamp"])
        yield from _not_rising("timestamp", columns["timestamp"])


def time_faults(field: str, time: np.ndarray) -> Iterator[Fault]:
    """Times that are missing or absurd."""
    with np.errstate(invalid="ignore"):
        bad = ~(np.abs(time) <= LATEST_S)
    yield from rows_fault(field, bad, f"a time within {LATEST_S:.0e} s", time)


def _not_rising(field: str, values: np.ndarray) -> Iterator[Fault]:
    stuck = np.concatenate([[False], values[1:] <= values[:-1]])
    yield from rows_fault(
        field, stuck, "more than in the row before", lambda row: f"{values[row]} after {values[row - 1]}"
    )


def share_faults(columns: Columns, names: Sequence[str]) -> Iterator[Fault]:
    """Probabilities outside of 0 to 1; NaN is no fault."""
    for name in names:
        if name in columns:
            values = columns[name]
            bad = ((per_row(values) < 0) | (per_row(values) > 1)).any(axis=1)
            yield from rows_fault(name, bad, "a probability of 0 to 1", values)


def covariance_faults(columns: Columns, name: str) -> Iterator[Fault]:
    """Covariances, stored as xx, xy, xz, yy, yz, zz, that are NaN in part or not positive semidefinite."""
    if name not in columns:
        return
    values = columns[name].astype(np.float64)
    finite = np.isfinite(values).all(axis=1)
    yield from rows_fault(name, ~finite & ~np.isnan(values).all(axis=1), "six numbers, or six NaN", values)
    matrices = values[:, [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(-1, 3, 3)
    scale = np.abs(matrices).max(axis=(1, 2), initial=0.0)
    usable = finite & (scale > 0)
    smallest = np.zeros(len(values))
    if usable.any():
        smallest[usable] = np.linalg.eigvalsh(matrices[usable] / scale[usable, None, None])[:, 0]
    rounding = 1e-9 if columns[name].dtype == np.float64 else 1e-5
    yield from rows_fault(name, smallest < -rounding, "a positive semidefinite matrix", values)


def missing_faults(columns: Columns, names: Sequence[str], status: np.ndarray, status_name: str) -> Iterator[Fault]:
    """Values where the status says that there are none."""
    for name in names:
        if name in columns:
            bad = (status == "none") & ~np.isnan(per_row(columns[name])).all(axis=1)
            yield from rows_fault(name, bad, f"NaN, since {status_name} is none", columns[name])


def torn_faults(columns: Columns, names: Sequence[str], size: int = 0) -> Iterator[Fault]:
    """Vectors that are NaN in part: of the whole row, or of each `size` numbers of it."""
    for name in names:
        if name in columns:
            missing = np.isnan(columns[name])
            together = size or missing.shape[1]
            if np.count_nonzero(missing):
                count = missing.reshape(len(missing), missing.shape[1] // together, together).sum(axis=2)
                torn = np.any((count > 0) & (count < together), axis=1)
                expected = f"numbers, or NaN in all {together} that belong together"
                yield from rows_fault(name, torn, expected, columns[name])


def there_faults(columns: Columns, names: Sequence[str], status: np.ndarray, status_name: str) -> Iterator[Fault]:
    """Values that are missing although the status says that there are some."""
    present = status != "none"
    for name in names:
        if name in columns:
            bad = present & np.isnan(per_row(columns[name])).any(axis=1)
            yield from rows_fault(name, bad, f"numbers, since {status_name} is not none", columns[name])


def shots_faults(columns: Columns) -> Iterator[Fault]:
    """Laws of the table of shots: every frame of every video once, in order, and clips that belong to their video."""
    if not all(name in columns for name in ("video", "video_frame", "timestamp", "verdict", "reason", "clip_id")):
        return
    video, frame, clip = columns["video"], columns["video_frame"], columns["clip_id"]
    in_clip = columns["verdict"] == "clip"
    safe = [name for name in set(video) if re.match(SOURCE_PATH, name)]
    yield from rows_fault("video", not_among(video, safe), PATTERN_WORDS[SOURCE_PATH], video)
    yield from rows_fault("clip_id", in_clip & (clip == ""), "a clip, since the verdict is clip", clip)
    yield from rows_fault("clip_id", ~in_clip & (clip != ""), "nothing, since the verdict is not clip", clip)
    yield from rows_fault("reason", ~in_clip & (columns["reason"] == ""), "why the verdict is not clip", clip)
    yield from time_faults("timestamp", columns["timestamp"])
    if not len(video):
        return
    begins = np.concatenate([[True], video[1:] != video[:-1]])
    starts = np.flatnonzero(begins)
    again = np.zeros(len(video), dtype=bool)
    again[starts] = repeated(video[starts])
    yield from rows_fault("video", again, "all rows of a video together", video)
    number = np.arange(len(video)) - np.repeat(starts, np.diff(starts, append=len(video)))
    yield from rows_fault(
        "video_frame", frame != number, "the frame's number in its video, from 0, without gaps", frame
    )
    time = columns["timestamp"]
    back = np.concatenate([[False], time[1:] <= time[:-1]]) & ~begins
    yield from rows_fault(
        "timestamp", back, "more than in the row before", lambda row: f"{time[row]} after {time[row - 1]}"
    )
    yield from _torn_clips(video, clip)


def _torn_clips(video: np.ndarray, clip: np.ndarray) -> Iterator[Fault]:
    """Clips whose rows do not follow on each other in one video."""
    run_begins = np.concatenate([[True], (clip[1:] != clip[:-1]) | (video[1:] != video[:-1])])
    starts = np.flatnonzero(run_begins & (clip != ""))
    torn = np.zeros(len(clip), dtype=bool)
    torn[starts] = repeated(clip[starts])
    yield from rows_fault("clip_id", torn, "one run of frames per clip", clip)


def declared_keys(columns: Columns) -> bool:
    """Whether all keys of a frame-aligned table could be read."""
    return all(key.name in columns for key in KEYS)
