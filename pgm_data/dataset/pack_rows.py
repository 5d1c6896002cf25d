"""One clip as rows of a dataset: frame-aligned tables joined on their keys, the others after their episode."""

from collections.abc import Mapping, Sequence

import numpy as np

from pgm_data.dataset.columns import Column
from pgm_data.dataset.dataset_columns import OWN_KEYS, caption_name, frame_tables, row_columns
from pgm_data.dataset.tables import Values
from pgm_data.scene import Scene

Tables = Mapping[str, Mapping[str, np.ndarray]]
ABSENT = "none"
"""Status and event of what is not there."""


def data_rows(
    tables: Tables, scene: Scene, columns: Sequence[Column], *, episode_index: int, first_index: int
) -> dict[str, Values]:
    """The wide rows of a clip, one a frame.

    Args:
        tables: The clip's tables; the camera's is there, and all frame-aligned ones agree in their keys.
        scene: What the clip shows.
        columns: Of the dataset.
        episode_index: The clip's episode.
        first_index: Row of the dataset at which it starts.
    """
    camera = tables["camera"]
    count = len(camera["frame_index"])
    source = camera["timestamp"]
    rows: dict[str, Values] = {
        "clip_id": camera["clip_id"],
        "frame_index": camera["frame_index"],
        "video_frame": camera["video_frame"],
        "timestamp": source - source[0],
        "source_timestamp": source,
        "episode_index": np.full(count, episode_index, dtype=np.int64),
        "index": first_index + np.arange(count, dtype=np.int64),
        "task_index": np.zeros(count, dtype=np.int64),
    }
    joined = {name: values for table in frame_tables(scene) for name, values in tables.get(table, {}).items()}
    captions = {caption_name(player.name): number for number, player in enumerate(scene.players)}
    for column in columns:
        if column.name in OWN_KEYS:
            continue
        if column.name in captions:
            rows[column.name] = main_captions(tables.get("captions", {}), captions[column.name], count)
        elif column.name in joined:
            rows[column.name] = joined[column.name]
        else:
            rows[column.name] = absent_values(column, count)
    return rows


def absent_values(column: Column, count: int) -> Values:
    """Rows of a column whose stage has not run: NaN, status none, empty texts.

    Raises:
        ValueError: If the column's type has no way to say that a value is missing.
    """
    if column.type == "string":
        return [ABSENT if ABSENT in column.allowed else ""] * count
    if column.type not in ("float", "double"):
        raise ValueError(f"{column.name}: expected values, since {column.type} cannot say that they are missing")
    return np.full((count, column.size) if column.size else count, np.nan)


def main_captions(captions: Mapping[str, np.ndarray], player: int, count: int) -> list[str]:
    """The main caption of each frame, of two the one that starts later; empty where there is none."""
    texts = [""] * count
    if not captions:
        return texts
    rows = np.flatnonzero((captions["player"] == player) & (captions["alternative"] == 0))
    rows = rows[np.argsort(captions["start_frame"][rows], kind="stable")]
    for row in rows:
        start, end = int(captions["start_frame"][row]), min(int(captions["end_frame"][row]), count)
        texts[start:end] = [str(captions["text"][row])] * (end - start)
    return texts


def configuration_rows(tables: Tables, table: str, scene: Scene, *, episode_index: int) -> dict[str, Values] | None:
    """Rows of a table that is not frame-aligned, after their episode; None where the clip has none."""
    own = tables.get(table)
    if own is None or not len(own["clip_id"]):
        return None
    rows: dict[str, Values] = {"episode_index": np.full(len(own["clip_id"]), episode_index, dtype=np.int64)}
    return rows | {column.name: own[column.name] for column in row_columns(table, scene)[1:]}
