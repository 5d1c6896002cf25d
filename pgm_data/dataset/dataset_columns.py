"""Columns of a packed dataset, and where its files lie: LeRobot's layout, filled with the contract's tables."""

import hashlib
from collections.abc import Collection
from dataclasses import replace

from pgm_data.dataset.columns import CLIP_ID, KEYS, PLAYER, TABLES, Column, Table, scene_tables, table_columns
from pgm_data.scene import Scene

LAYOUT_VERSION = "v3.0"
"""LeRobot's version of the layout."""
FILE = "chunk-{chunk_index:03d}/file-{file_index:03d}"
DATA_PATH = f"data/{FILE}.parquet"
EPISODES_PATH = f"meta/episodes/{FILE}.parquet"
VIDEO_PATH = f"videos/{{video_key}}/{FILE}.mp4"
VIDEO_KEY = "observation.images.main"
"""LeRobot's name for pictures of a camera."""
FILES_PER_CHUNK = 1000
SPLITS = ("train", "val", "test")
"""In this order of episodes, so that each split is a range of them."""
NO_VIDEO = hashlib.sha256().hexdigest()
"""Of an empty file: what stands for the video of a simulator that drew no pictures."""
SUMS_PATH = "meta/sha256sums.txt"
"""What every file but the card holds, as `sha256sum --check` reads it."""

ROW_TABLES = ("captions", "events", "ball_shots")
"""Tables of a clip that are not frame-aligned; each becomes a configuration of its own."""


def _key(name: str, type: str, meaning: str, unit: str = "") -> Column:
    return Column(name=name, type=type, unit=unit, meaning=meaning)  # type: ignore[arg-type]


EPISODE = _key("episode_index", "int64", "episode of the dataset, from 0; one episode is one clip")
FRAME_KEYS = (
    CLIP_ID,
    *(key for key in KEYS if key.name in ("frame_index", "video_frame")),
    _key("timestamp", "float", "time since the episode's first frame, as LeRobot wants it", "s"),
    _key("source_timestamp", "double", "the video's own presentation time", "s"),
    EPISODE,
    _key("index", "int64", "row of the dataset, from 0"),
    _key("task_index", "int64", "row of meta/tasks.parquet"),
)
"""What every row of `data` starts with."""

OWN_KEYS = frozenset(key.name for key in FRAME_KEYS)


CAPTION = "caption"
_MAIN_CAPTION = Column(
    name=f"{PLAYER}.{CAPTION}",
    type="string",
    meaning="main caption covering the frame, the later one where two do; empty where none does",
)

DATA = Table(
    name="data",
    row="one frame of one episode of a packed dataset",
    needs="",
    frame_aligned=False,
    columns=(
        *FRAME_KEYS,
        *(
            replace(column, when=f"the scene declares {table.needs}") if table.needs == "ball" else column
            for table in TABLES.values()
            if table.frame_aligned
            for column in table.columns[len(KEYS) :]
        ),
        _MAIN_CAPTION,
    ),
)
"""The columns of `data`, before a scene fixes players and sizes."""


def caption_name(player: str) -> str:
    """Column of `data` with the main caption of a player object."""
    return f"{player}.{CAPTION}"


def frame_tables(scene: Scene) -> tuple[str, ...]:
    """Frame-aligned tables that the scene declares."""
    return tuple(name for name in scene_tables(scene) if TABLES[name].frame_aligned)


def row_tables(scene: Scene) -> tuple[str, ...]:
    """Tables of the scene that become configurations of their own."""
    return tuple(name for name in ROW_TABLES if name in scene_tables(scene))


def data_columns(scene: Scene, *, optional: Collection[str] = ()) -> tuple[Column, ...]:
    """Columns of `data`: keys, the frame-aligned tables joined, and the main captions; optional ones only as named."""
    keys = {key.name for key in KEYS}
    joined = tuple(
        column
        for table in frame_tables(scene)
        for column in table_columns(table, scene)
        if column.name not in keys and (not column.optional or column.name in optional)
    )
    captions = tuple(replace(_MAIN_CAPTION, name=caption_name(player.name)) for player in scene.players)
    return FRAME_KEYS + joined + captions


def row_columns(table: str, scene: Scene) -> tuple[Column, ...]:
    """Columns of a configuration of its own: the table's, after the episode's index."""
    return (EPISODE, *table_columns(table, scene))
