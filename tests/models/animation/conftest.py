"""Small packed datasets, simulated in process without pictures, and changed copies of them."""

import shutil
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pgm_data.scene import Scene, load_scene
from pgm_data.simulate.clip_options import ClipOptions
from pgm_data.simulate.folders import MatchFiles, pack_truth, write_match, write_shots

Change = Callable[[dict[str, np.ndarray]], Mapping[str, np.ndarray]]
"""Takes the columns of a dataset's rows and returns those that the copy has."""


def simulated(out: Path, name: str, frames: int, fps: float) -> Path:
    """The dataset of two matches of so many frames each, as `pgm simulate --pictures none` writes it."""
    scene, options = load_scene(name), ClipOptions(frames=frames, fps=fps, closeups=True)
    files = MatchFiles(pictures="none", masks=False)
    write_shots(out, scene, [write_match(out, scene, options, files, seed=3, match=match) for match in range(2)])
    pack_truth(out, scene, videos=False)
    return out / "dataset"


@pytest.fixture(scope="session")
def tennis_dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Over a minute of tennis: 2 players of 24 joints, a ball, captions."""
    return simulated(tmp_path_factory.mktemp("tennis"), "tennis", 1200, 25.0)


@pytest.fixture(scope="session")
def blocks_dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """40 seconds of walks among blocks: 1 player of 13 joints, captions, no ball."""
    return simulated(tmp_path_factory.mktemp("blocks"), "blocks", 400, 20.0)


def read_rows(dataset: Path) -> dict[str, np.ndarray]:
    """All columns of a dataset's rows; writable."""
    table = pa.concat_tables([pq.read_table(path) for path in sorted((dataset / "data").glob("*/*.parquet"))])
    columns = {}
    for name in table.column_names:
        values = table.column(name).combine_chunks()
        if pa.types.is_fixed_size_list(values.type):
            columns[name] = values.flatten().to_numpy().reshape(len(values), -1).copy()
        else:
            columns[name] = np.array(values.to_pylist())
    return columns


def write_rows(dataset: Path, columns: Mapping[str, np.ndarray], row_group: int) -> None:
    """Replace a dataset's rows."""
    lists = {
        name: pa.FixedSizeListArray.from_arrays(pa.array(values.ravel()), values.shape[1])
        if values.ndim == 2
        else pa.array(values)
        for name, values in columns.items()
    }
    pq.write_table(pa.table(lists), dataset / "data" / "chunk-000" / "file-000.parquet", row_group_size=row_group)


@pytest.fixture
def altered(tmp_path: Path) -> Callable[..., Path]:
    """Makes a copy of a dataset with changed rows; its checksums are left out."""

    def make(dataset: Path, change: Change = dict, *, name: str = "altered", row_group: int = 3000) -> Path:
        copy = tmp_path / name
        shutil.copytree(dataset, copy, ignore=shutil.ignore_patterns("sha256sums.txt"))
        write_rows(copy, change(read_rows(dataset)), row_group)
        return copy

    return make


@pytest.fixture(scope="session")
def three_players() -> Scene:
    """Tennis with a third player and without a ball."""
    tennis = load_scene("tennis")
    third = replace(tennis.players[0], name="player2")
    return replace(tennis, name="trio", objects=(*tennis.players, third), ball=None)
