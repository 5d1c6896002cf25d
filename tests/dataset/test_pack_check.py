"""A dataset that was changed after packing is found out."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pgm_data.dataset.check import check_paths
from pgm_data.dataset.pack import pack_work_folders
from pgm_data.scene import load_scene
from tests.simulate.store_worlds import write_truth_clip

DATA = "data/chunk-000/file-000.parquet"
EPISODES = "meta/episodes/chunk-000/file-000.parquet"
INFO = "meta/info.json"
Change = Callable[[Path], object]


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("sound")
    for number, match in enumerate("aabcd"):
        folder = root / "work" / f"{match}.{number:02d}"
        write_truth_clip(folder, load_scene("tennis"), frames=15, match_id=match, seed=number)
    pack_work_folders([root / "work"], root / "dataset")
    assert check_paths([root / "dataset"]) == []
    return root / "dataset"


def info(**changes: Any) -> Change:
    def change(path: Path) -> None:
        value = json.loads(path.read_text())
        path.write_text(json.dumps(value | changes))

    return change


def stats(**changes: Any) -> Change:
    return info(**changes)


def column(name: str, row: int, value: Any) -> Change:
    """One value of a parquet file, all else as it was; `...` takes the column away."""

    def change(path: Path) -> None:
        table = pq.read_table(path)
        index = table.schema.get_field_index(name)
        if value is ...:
            pq.write_table(table.remove_column(index), path)
            return
        values = table.column(index).to_pylist()
        values[row] = value
        field = table.schema.field(index)
        pq.write_table(table.set_column(index, field, pa.array(values, type=field.type)), path)

    return change


def rows(keep: slice) -> Change:
    def change(path: Path) -> None:
        table = pq.read_table(path)
        pq.write_table(table.take(pa.array(np.arange(len(table))[keep])), path)

    return change


FAULTS: dict[str, tuple[str, Change, str, str]] = {
    "a wrong number of frames": (INFO, info(total_frames=74), "total_frames", "75, dataset_to_index"),
    "a wrong number of episodes": (INFO, info(total_episodes=6), "total_episodes", "5, the rows"),
    "a wrong number of tasks": (INFO, info(total_tasks=2), "", "total_tasks"),
    "a split that divides a match": (
        INFO,
        info(splits={"train": "0:1", "val": "1:4", "test": "4:5"}),
        "split",
        "by info.json",
    ),
    "episodes without a split": (INFO, info(splits={"train": "0:2"}), "split", "a split"),
    "splits that overlap": (INFO, info(splits={"train": "0:5", "val": "4:5"}), "splits.val", "no other split"),
    "a split beyond the end": (INFO, info(splits={"train": "0:9"}), "splits.train", "range of the 5"),
    "a scene that nobody knows": (
        INFO,
        info(pgm={"schema_version": "1.0", "scene": "chess", "units": {}, "constant_rate": True}),
        "pgm.scene",
        "ships",
    ),
    "an unknown layout": (INFO, info(codebase_version="v2.1"), "codebase_version", "one of v3.0"),
    "no features": (INFO, info(features={}), "features.clip_id", "the column"),
    "data elsewhere": (INFO, info(data_path="rows.parquet"), "data_path", "data/chunk"),
    "a match in two splits": (EPISODES, column("match_id", 4, "a"), "match_id", "never divide"),
    "an episode that begins late": (EPISODES, column("dataset_from_index", 2, 31), "dataset_from_index", "the end"),
    "a length that is none": (EPISODES, column("length", 1, 0), "length", "at least 1"),
    "a clip twice": (EPISODES, column("clip_id", 1, "a.00"), "clip_id", "once"),
    "an episode without a clip": (EPISODES, column("clip_id", 1, None), "clip_id", "a value"),
    "episodes without a column": (EPISODES, column("data/file_index", 0, ...), "data/file_index", "once"),
    "an episode in another file": (EPISODES, column("data/file_index", 1, 7), "", "which episodes are in"),
    "rows that are missing": (DATA, rows(slice(0, 20)), "", "15 rows"),
    "a row twice": (DATA, rows(np.s_[[*range(20), 19, *range(20, 45)]]), "index", "numbered one after another"),
    "a column that is missing": (DATA, column("camera.K", 0, ...), "camera.K", "the column"),
    "a row of another clip": (DATA, column("clip_id", 3, "b.02"), "clip_id", "'"),
    "a time that does not restart": (DATA, column("timestamp", 17, 8.0), "timestamp", "source_timestamp"),
    "a camera that is no camera": (DATA, column("camera.K", 4, [0.0] * 9), "camera.K", "focal"),
    "a joint that is off": (DATA, column("player0.joints", 4, [0.0] * 72), "player0.joints", "entry 0"),
    "a caption that covers nothing": (DATA, column("player1.caption", 2, "flies"), "player1.caption", "main caption"),
    "an event that never was": (DATA, column("ball.event", 4, "net"), "ball.event", "events.parquet"),
    "a span after its clip": (
        "captions/chunk-000/file-000.parquet",
        column("end_frame", 0, 99),
        "end_frame",
        "0 to 15",
    ),
    "a flight of no event": (
        "ball_shots/chunk-000/file-000.parquet",
        column("end_event", 1, 80),
        "end_event",
        "events",
    ),
    "spans out of order": (
        "captions/chunk-000/file-000.parquet",
        column("episode_index", 0, 1),
        "episode_index",
        "in order",
    ),
    "events of no episode": ("events/chunk-000/file-000.parquet", column("kind", 0, "kick"), "kind", "one of"),
    "statistics of nothing": ("meta/stats.json", stats(nothing={}), "nothing", "a column"),
    "statistics that cannot be": (
        "meta/stats.json",
        stats(index={"min": [3], "max": [2], "mean": [1], "std": [0], "count": [9]}),
        "index",
        "min <= mean",
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_change_is_found_where_it_is(sound: Path, tmp_path: Path, fault: str) -> None:
    name, change, field, expected = FAULTS[fault]
    copy = tmp_path / "dataset"
    shutil.copytree(sound, copy)
    change(copy / name)
    found = check_paths([copy])
    assert any(v.field == field and expected in v.expected for v in found), [str(v) for v in found]


@pytest.mark.parametrize("name", [DATA, EPISODES, "README.md", "meta/stats.json", "meta/tasks.parquet"])
def test_a_missing_or_broken_file_is_named(sound: Path, tmp_path: Path, name: str) -> None:
    copy = tmp_path / "dataset"
    shutil.copytree(sound, copy)
    (copy / name).unlink()
    assert any(v.path == copy / name for v in check_paths([copy]))
    if not name.endswith(".md"):
        (copy / name).write_bytes(b"\x00 neither JSON nor parquet")
        assert any(v.path == copy / name for v in check_paths([copy]))


def test_an_unfinished_file_is_found_anywhere(sound: Path, tmp_path: Path) -> None:
    copy = tmp_path / "dataset"
    shutil.copytree(sound, copy)
    (copy / "data" / "chunk-000" / ".file-000.parquet.17.tmp").write_bytes(b"")
    assert [v.expected for v in check_paths([copy])] == ["no unfinished file"]


def test_a_folder_of_a_work_folder_and_a_dataset_is_checked_as_both(sound: Path) -> None:
    found = check_paths([sound.parent])
    assert {v.path.relative_to(sound.parent).as_posix() for v in found} == {"work/run.json", "work/shots.parquet"}
    (sound.parent / "elsewhere").mkdir()
    assert {v.path.name for v in check_paths([sound.parent / "elsewhere"])} == {"run.json", "shots.parquet"}
