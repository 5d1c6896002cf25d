"""One clip as rows of a dataset: frame-aligned tables joined on their keys, the others after their episode.

Columns are taken over as they are stored, so nothing is copied but keys and captions.
"""

from collections.abc import Mapping

import numpy as np
import pyarrow as pa

from pgm_data.dataset.columns import Column
from pgm_data.dataset.dataset_columns import EPISODE, caption_name, frame_tables, row_columns
from pgm_data.dataset.tables import DTYPES
from pgm_data.scene import Scene

ABSENT = "none"
"""Status and event of what is not there."""


def data_rows(
    contents: Mapping[str, pa.Table],
    captions: Mapping[str, np.ndarray],
    scene: Scene,
    schema: pa.Schema,
    columns: Mapping[str, Column],
    own: Mapping[str, np.ndarray],
) -> pa.Table:
    """The wide rows of a clip, one a frame.

    Args:
        contents: The clip's tables as they are stored; all frame-aligned ones agree in their keys.
        captions: Columns of its captions; empty where it has none.
        scene: What the clip shows.
        schema: Of the dataset's data.
        columns: The same by name.
        own: Columns that no table has, as of `own_keys`.
    """
    stored = {name: table for name in frame_tables(scene) if (table := contents.get(name)) is not None}
    where = {name: table for table in reversed(stored.values()) for name in table.column_names}
    count = stored["camera"].num_rows
    spoken = {caption_name(player.name): number for number, player in enumerate(scene.players)}
    arrays = []
    for field in schema:
        if field.name in own:
            arrays.append(pa.array(own[field.name], type=field.type))
        elif field.name in spoken:
            arrays.append(pa.array(main_captions(captions, spoken[field.name], count), type=field.type))
        elif field.name in where:
            arrays.append(stored_as(where[field.name].column(field.name), field.type))
        else:
            arrays.append(absent_values(columns[field.name], count, field.type))
    return pa.Table.from_arrays(arrays, schema=schema)


def own_keys(
    camera: Mapping[str, np.ndarray], *, episode_index: int, first_index: int, rate: float = 0.0
) -> dict[str, np.ndarray]:
    """What a dataset adds to the keys of a clip: its time from 0, its episode and its rows.

    Args:
        camera: Columns of the clip's camera table.
        episode_index: The clip's episode.
        first_index: Row of the dataset at which it starts.
        rate: Frames per second at which its video is encoded; 0 where that keeps the source's times.
    """
    source = camera["timestamp"]
    time = np.arange(len(source)) / rate if rate else source - source[0]
    return {
        "timestamp": time.astype(np.float32),
        "source_timestamp": source,
        EPISODE.name: np.full(len(source), episode_index, dtype=np.int64),
        "index": first_index + np.arange(len(source), dtype=np.int64),
        "task_index": np.zeros(len(source), dtype=np.int64),
    }


def stored_as(values: pa.ChunkedArray, wanted: pa.DataType) -> pa.ChunkedArray:
    """A column of a clip's table in the type of the dataset's: texts in full, list elements under one name."""
    if values.type == wanted:
        return values
    if pa.types.is_fixed_size_list(wanted):
        parts = [pa.FixedSizeListArray.from_arrays(chunk.flatten(), type=wanted) for chunk in values.chunks]
        return pa.chunked_array(parts, type=wanted)
    return values.cast(wanted)


def absent_values(column: Column, count: int, wanted: pa.DataType) -> pa.Array:
    """Rows of a column whose stage has not run: NaN, status none, empty texts.

    Raises:
        ValueError: If the column's type has no way to say that a value is missing.
    """
    if column.type == "string":
        return pa.array([ABSENT if ABSENT in column.allowed else ""] * count, type=wanted)
    if column.type not in ("float", "double"):
        raise ValueError(f"{column.name}: expected values, since {column.type} cannot say that they are missing")
    flat = pa.array(np.full(count * max(column.size, 1), np.nan, dtype=DTYPES[column.type]))
    return pa.FixedSizeListArray.from_arrays(flat, type=wanted) if column.size else flat


def main_captions(captions: Mapping[str, np.ndarray], player: int, count: int) -> list[str]:
    """The main caption of each frame, of two the one that starts later; empty where there is none."""
    texts = [""] * count
    if not captions:
        return texts
    rows = np.flatnonzero((captions["player"] == player) & (captions["alternative"] == 0))
    rows = rows[np.argsort(captions["start_frame"][rows], kind="stable")]
    for row in rows:
        # A span that leaves its clip is a fault of its own.
        start, end = max(int(captions["start_frame"][row]), 0), min(int(captions["end_frame"][row]), count)
        if start < end:
            texts[start:end] = [str(captions["text"][row])] * (end - start)
    return texts


def configuration_rows(
    content: pa.Table | None, table: str, scene: Scene, schema: pa.Schema, *, episode_index: int
) -> pa.Table | None:
    """Rows of a table that is not frame-aligned, after their episode; None where the clip has none."""
    if content is None or not content.num_rows:
        return None
    arrays: list = [pa.array(np.full(content.num_rows, episode_index, dtype=np.int64))]
    names = [column.name for column in row_columns(table, scene)[1:]]
    arrays += [stored_as(content.column(name), schema.field(name).type) for name in names]
    return pa.Table.from_arrays(arrays, schema=schema)
