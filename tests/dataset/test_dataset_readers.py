"""What was packed comes back bit for bit in pandas, DuckDB and Hugging Face datasets, by name and streamed."""

from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest

from pgm_data.dataset.tables import numpy_column, read_table

SPLITS = ("train", "val", "test")


def clip_of(work: Path, clip: str) -> dict[str, np.ndarray]:
    """The joined frame tables of a clip."""
    tables = [read_table(work / clip / f"{name}.parquet") for name in ("camera", "players", "ball")]
    return {name: values for table in tables for name, values in table.items() if name != "timestamp"}


def assert_same_bits(found: np.ndarray, wanted: np.ndarray, name: str) -> None:
    if wanted.dtype == object:
        assert found.tolist() == wanted.tolist(), name
    else:
        assert found.astype(wanted.dtype).tobytes() == wanted.tobytes(), name


def test_pandas_has_every_bit(small_work: Path, small_dataset: Path) -> None:
    frame = pd.read_parquet(small_dataset / "data")
    for clip, rows in frame.groupby("clip_id"):
        for name, wanted in clip_of(small_work, str(clip)).items():
            found = np.stack(list(rows[name])) if wanted.ndim == 2 else rows[name].to_numpy()
            assert_same_bits(found, wanted, name)


def test_duckdb_reads_all_tables_and_joins_them(small_work: Path, small_dataset: Path) -> None:
    duckdb = pytest.importorskip("duckdb", reason="DUCKDB IS NOT INSTALLED: nothing was read with it")
    with duckdb.connect() as base:
        data, captions = (f"'{small_dataset}/{name}/*/*.parquet'" for name in ("data", "captions"))
        query = f"select * from {data} where clip_id = 'b' order by \"index\""
        found = base.execute(query).fetchnumpy()
        for name, wanted in clip_of(small_work, "b").items():
            if wanted.ndim == 1:
                assert_same_bits(np.asarray(found[name]), wanted, name)
        third = base.execute(f"select \"ball.position\"[3] z from {data} where clip_id = 'b'").fetchnumpy()["z"]
        assert_same_bits(np.asarray(third), clip_of(small_work, "b")["ball.position"][:, 2], "z")
        spoken = f"""select count(distinct d."index") from {data} d
            join {captions} c on d.episode_index = c.episode_index
            and d.frame_index >= c.start_frame and d.frame_index < c.end_frame and c.alternative = 0 and c.player = 0
            where d."player0.caption" = c.text"""
        shown = base.execute(f"select count(*) from {data} where \"player0.caption\" <> ''").fetchone()
        assert base.execute(spoken).fetchone() == shown and shown[0] > 0


def test_hugging_face_datasets_loads_each_configuration_by_name_and_streams_it(
    small_work: Path, small_dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    monkeypatch.setenv("HF_HOME", str(tmp_path / "home"))
    datasets = pytest.importorskip(
        "datasets", reason="HUGGING FACE DATASETS IS NOT INSTALLED: nothing was read with it"
    )
    datasets.disable_progress_bars()
    found = datasets.load_dataset(str(small_dataset), "default", cache_dir=str(tmp_path / "cache"))
    frame = pd.read_parquet(small_dataset / "data")
    assert list(found) == list(SPLITS) and sum(map(len, found.values())) == len(frame)
    assert found["train"].features["camera.K"].length == 9
    wanted = clip_of(small_work, "b")
    for split in SPLITS:
        rows = found[split].with_format("arrow")[:]
        own = numpy_column(rows.column("clip_id"), "clip_id") == "b"
        for name, values in wanted.items() if own.any() else ():
            assert_same_bits(numpy_column(rows.column(name), name)[own], values, name)
    count = 0
    for split in SPLITS:
        for row in datasets.load_dataset(str(small_dataset), "captions", split=split, streaming=True):
            assert row["text"] and len(row["clip_id"]) and isinstance(row["episode_index"], int)
            count += 1
    files = (small_dataset / "captions").rglob("*.parquet")
    assert count == sum(pq.read_metadata(path).num_rows for path in files) > 0
