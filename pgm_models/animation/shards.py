"""Rows of a packed dataset as arrays, read some at a time, and refused where they say nothing sound."""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from jaxtyping import Int

from pgm_data.scene import Scene, load_scene

EPISODE, FRAME, REPEAT, TIME = "episode_index", "frame_index", "frame.is_duplicate", "frame.capture_time"
KEYS = (EPISODE, FRAME, REPEAT, TIME)
POSE = ("root_rotation", "joint_rotations", "joint_translations")
ABSENT = "none"
"""Status of what is not there."""
ROWS = 4096
"""Read at once."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Episodes:
    """Clips of a dataset, in the order of their episodes."""

    clips: tuple[str, ...]
    """Id of each."""
    matches: tuple[str, ...]
    """Match that each belongs to."""
    splits: tuple[str, ...]
    """`train`, `val` or `test`."""

    def of_matches(self, matches: Sequence[str] | None) -> Int[np.ndarray, " episodes"]:
        """Numbers of the episodes of those matches; of all where None.

        Raises:
            ValueError: If there is no such match.
        """
        if matches is None:
            return np.arange(len(self.clips))
        strange = sorted(set(matches) - set(self.matches))
        if strange:
            raise ValueError(f"matches: expected some of {', '.join(sorted(set(self.matches)))}, got {strange[0]!r}")
        return np.array([row for row, match in enumerate(self.matches) if match in set(matches)], dtype=np.int64)


def scene_of(dataset: Path) -> Scene:
    """The scene that a packed dataset names.

    Raises:
        ValueError: If there is no dataset, or its scene does not ship with the package.
    """
    path = dataset / "meta" / "info.json"
    try:
        name = json.loads(path.read_text(encoding="utf-8"))["pgm"]["scene"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ValueError(f"{path}: expected the description of a packed dataset, got {error!r}") from error
    return load_scene(name)


def read_episodes(dataset: Path) -> Episodes:
    """Clips, matches and splits of a packed dataset.

    Raises:
        ValueError: If its table of episodes is missing or of another kind.
    """
    names = (EPISODE, "clip_id", "match_id", "split")
    try:
        tables = [pq.read_table(path, columns=list(names)) for path in _files(dataset / "meta" / "episodes")]
        table = pa.concat_tables(tables).sort_by(EPISODE)
        numbers, clips, matches, splits = (table.column(name).to_pylist() for name in names)
    except (pa.ArrowException, OSError, KeyError) as error:
        raise ValueError(f"{dataset / 'meta' / 'episodes'}: expected a table of episodes, got {error}") from error
    if numbers != list(range(len(numbers))):
        raise ValueError(f"{dataset / 'meta' / 'episodes'}: {EPISODE}: expected 0, 1, 2, ..., got {numbers[:9]}")
    return Episodes(clips=tuple(clips), matches=tuple(matches), splits=tuple(splits))


def split_matches(dataset: Path, split: str) -> tuple[str, ...]:
    """Matches of one split of a packed dataset, sorted; none where it has no such split."""
    episodes = read_episodes(dataset)
    return tuple(sorted({m for m, s in zip(episodes.matches, episodes.splits, strict=True) if s == split}))


def state_columns(scene: Scene, available: Sequence[str]) -> tuple[str, ...]:
    """Columns that states of the scene are made of, and their statuses, as far as there are such."""
    names = [f"{player.name}.{name}" for player in scene.players for name in ("status", "root_position", *POSE)]
    if scene.ball is not None:
        names += [f"ball.{name}" for name in ("status", "position", "velocity")]
    return tuple(name for name in names if name in available)


def column_names(dataset: Path) -> tuple[str, ...]:
    """Columns of a packed dataset's rows.

    Raises:
        ValueError: If it has no rows, or its file is no parquet file.
    """
    path = data_files(dataset)[0]
    try:
        return tuple(pq.read_schema(path).names)
    except (pa.ArrowException, OSError) as error:
        raise ValueError(f"{path}: expected a parquet file, got {error}") from error


def count_rows(dataset: Path) -> int:
    """Rows of a packed dataset, by the footers of its files."""
    return sum(pq.read_metadata(path).num_rows for path in data_files(dataset))


def data_files(dataset: Path) -> list[Path]:
    """Files of a packed dataset's rows, in order.

    Raises:
        ValueError: If there are none.
    """
    files = _files(dataset / "data")
    if not files:
        raise ValueError(f"{dataset}: expected a packed dataset with data/chunk-*/file-*.parquet, got no such file")
    return files


def _files(folder: Path) -> list[Path]:
    return sorted(folder.glob("chunk-*/file-*.parquet"))


def sound_rows(
    dataset: Path, columns: Sequence[str], clips: Sequence[str], *, every: int = 1
) -> Iterator[dict[str, np.ndarray]]:
    """Columns of the dataset's rows, some at a time, without repeated pictures, which measure nothing.

    Args:
        dataset: Folder of the packed dataset.
        columns: Columns of `state_columns`; the keys come on top.
        clips: Id of each episode, to name rows by.
        every: Of all rows only each so-manieth is handed out; all are looked at.

    Raises:
        ValueError: If a number is infinite, or NaN where its status says otherwise; names file, clip, frame, column.
    """
    passed = 0
    for path in data_files(dataset):
        try:
            with pq.ParquetFile(path) as file:
                for batch in file.iter_batches(batch_size=ROWS, columns=[*KEYS, *columns]):
                    rows = {name: _array(batch.column(name)) for name in batch.schema.names}
                    refuse_unsound(rows, clips)
                    kept = ~rows[REPEAT] & ((passed + np.arange(batch.num_rows)) % every == 0)
                    passed += batch.num_rows
                    yield {name: values[kept] for name, values in rows.items()}
        except (pa.ArrowException, OSError, KeyError) as error:
            raise ValueError(f"{path}: expected rows with {', '.join((*KEYS, *columns))}, got {error}") from error
        except ValueError as error:
            raise ValueError(f"{path}: {error}") from error


def _array(values: pa.Array) -> np.ndarray:
    """Values of a column, a row a row."""
    if pa.types.is_fixed_size_list(values.type):
        return values.flatten().to_numpy(zero_copy_only=False).reshape(len(values), values.type.list_size)
    return values.to_numpy(zero_copy_only=False)


def refuse_unsound(rows: Mapping[str, np.ndarray], clips: Sequence[str]) -> None:
    """Raise ValueError where a number is infinite, or NaN though its object is there by its status.

    A pose may be missing as a whole where a person's place is known; a part of one may not.
    """
    untimed = np.flatnonzero(~np.isfinite(rows[TIME]))
    if len(untimed):
        raise ValueError(
            f"{_place(rows, clips, untimed[0])}: {TIME}: expected a finite number, got {rows[TIME][untimed[0]]}"
        )
    for name, status in rows.items():
        if not name.endswith(".status"):
            continue
        owner = name.removesuffix(".status")
        there = status != ABSENT
        own = {column: values for column, values in rows.items() if column.startswith(f"{owner}.") and column != name}
        empty = {column: np.isnan(values).all(axis=1) for column, values in own.items()}
        joints = [empty[f"{owner}.{joint}"] for joint in POSE[1:] if f"{owner}.{joint}" in empty]
        no_joints = np.logical_and.reduce(joints) if joints else np.ones(len(status), dtype=bool)
        for column, values in own.items():
            wanted = there & ~(no_joints & empty[column]) if column.removeprefix(f"{owner}.") in POSE else there
            bad = wanted[:, None] & ~np.isfinite(values)
            if bad.any():
                row, number = np.argwhere(bad)[0]
                raise ValueError(
                    f"{_place(rows, clips, row)}: {column}[{number}]: expected a finite number, "
                    f"since {name} is {status[row]}, got {values[row, number]}"
                )


def _place(rows: Mapping[str, np.ndarray], clips: Sequence[str], row: np.integer) -> str:
    return f"clip {clips[int(rows[EPISODE][row])]}, frame {rows[FRAME][row]}"
