import os

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from pgm_data.dataset.columns import table_columns
from pgm_data.dataset.tables import DTYPES, read_table, write_table
from pgm_data.scene import load_scene
from tests.dataset.work_folders import camera_columns, shots_columns

SCENE = load_scene("tennis")

COLUMNS = {table: table_columns(table, SCENE) for table in ("camera", "ball", "events", "captions")}

# A parquet string is any text but a lone half of a surrogate pair.
TEXTS = st.text(st.characters(exclude_categories=["Cs"]), max_size=20)


@st.composite
def tables(draw) -> tuple[str, dict]:
    """Any table, with any values that its columns can hold: NaN and infinities, both zeros, all bits."""
    table = draw(st.sampled_from(sorted(COLUMNS)))
    rows = draw(st.integers(0, 4))
    columns: dict = {}
    for column in COLUMNS[table]:
        if column.type == "string":
            words = st.sampled_from(column.allowed) if column.allowed else TEXTS
            columns[column.name] = draw(st.lists(words, min_size=rows, max_size=rows))
        else:
            shape = (rows, column.size) if column.size else (rows,)
            columns[column.name] = draw(arrays(DTYPES[column.type], shape))
    return table, columns


@settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow])
@given(tables())
def test_what_is_read_is_what_was_written_bit_for_bit(tmp_path, drawn):
    table, columns = drawn
    path = tmp_path / f"{table}.parquet"
    write_table(path, table=table, scene=SCENE, columns=columns)
    again = read_table(path)
    assert list(again) == list(columns)
    for name, values in columns.items():
        if isinstance(values, list):
            assert again[name].dtype == object
            assert again[name].tolist() == values
        else:
            assert again[name].dtype == values.dtype
            assert again[name].shape == values.shape
            # To the bit, except that which NaN it is does not matter.
            np.testing.assert_array_equal(again[name], values)
            if values.dtype.kind == "f":
                np.testing.assert_array_equal(np.signbit(again[name][values == 0]), np.signbit(values[values == 0]))


def test_matrices_are_written_row_by_row(tmp_path):
    columns = camera_columns("a", 6)
    stacked = columns | {"camera.K": columns["camera.K"].reshape(6, 3, 3)}
    write_table(tmp_path / "camera.parquet", table="camera", scene=SCENE, columns=stacked)
    np.testing.assert_array_equal(read_table(tmp_path / "camera.parquet")["camera.K"], columns["camera.K"])


def test_column_order_does_not_matter_and_is_the_contracts(tmp_path):
    columns = camera_columns("a", 6)
    write_table(tmp_path / "a.parquet", table="camera", scene=SCENE, columns=dict(reversed(columns.items())))
    assert list(read_table(tmp_path / "a.parquet")) == [c.name for c in table_columns("camera", SCENE)]


def test_tables_are_zstd_and_carry_units_and_version(tmp_path):
    path = tmp_path / "camera.parquet"
    write_table(path, table="camera", scene=SCENE, columns=camera_columns("a", 6))
    assert pq.ParquetFile(path).metadata.row_group(0).column(0).compression == "ZSTD"
    schema = pq.read_schema(path)
    assert schema.field("camera.t_cam_from_world").metadata[b"unit"] == b"m"
    assert schema.field("camera.t_cam_from_world").metadata[b"frame"] == b"camera"
    assert schema.metadata[b"pgm.schema_version"] == b"1.0"


def test_pandas_reads_our_tables(tmp_path):
    import pandas as pd

    path = tmp_path / "camera.parquet"
    write_table(path, table="camera", scene=SCENE, columns=camera_columns("a", 6))
    frame = pd.read_parquet(path)
    assert np.stack(frame["camera.K"].to_numpy()).shape == (6, 9)
    assert frame["camera.status"].tolist()[2] == "interpolated"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"camera.zoom": np.zeros(6)}, r"columns that scene tennis declares, got \['camera.zoom'\]"),
        ({"timestamp": np.zeros(5)}, "timestamp: expected 6 rows as in the first column, got 5"),
        ({"camera.K": np.zeros((6, 8))}, r"camera.K: expected shape \(6, 9\), got \(6, 8\)"),
        ({"timestamp": np.zeros((6, 2))}, r"timestamp: expected shape \(6,\), got \(6, 2\)"),
        ({"camera.inliers": np.full(6, 2.5)}, "camera.inliers: expected int32, got float64"),
        ({"camera.inliers": np.full(6, 2**31)}, "camera.inliers: expected int32, got values from"),
        ({"frame.is_duplicate": np.zeros(6)}, "frame.is_duplicate: expected bool, got float64"),
        ({"timestamp": ["0"] * 6}, "timestamp: expected double"),
        ({"timestamp": [None] * 6}, "timestamp: expected double, got object"),
        (
            {"camera.status": ["guessed"] * 6},
            "camera.status: expected one of measured, interpolated, none, got 'guessed'",
        ),
        ({"camera.reason": [None] * 6}, "camera.reason: expected strings, got None in row 0"),
        ({"camera.reason": ["", "", 3.0, "", "", ""]}, "camera.reason: expected strings, got 3.0 in row 2"),
    ],
)
def test_what_is_no_such_table_is_refused_and_nothing_is_written(tmp_path, change, message):
    path = tmp_path / "camera.parquet"
    with pytest.raises(ValueError, match=message):
        write_table(path, table="camera", scene=SCENE, columns=camera_columns("a", 6) | change)
    assert list(tmp_path.iterdir()) == []


def test_missing_columns_are_all_named(tmp_path):
    columns = camera_columns("a", 6)
    del columns["camera.K"], columns["timestamp"]
    with pytest.raises(ValueError, match=r"\['timestamp', 'camera.K'\]"):
        write_table(tmp_path / "camera.parquet", table="camera", scene=SCENE, columns=columns)


def test_numbers_that_float32_cannot_hold_are_refused(tmp_path):
    path = tmp_path / "ball.parquet"
    columns: dict = {}
    for column in table_columns("ball", SCENE):
        if column.type == "string":
            columns[column.name] = [column.allowed[0] if column.allowed else "a"]
        else:
            columns[column.name] = np.zeros((1, column.size) if column.size else 1, DTYPES[column.type])
    with pytest.raises(ValueError, match="ball.score: expected values that float32 can hold"):
        write_table(path, table="ball", scene=SCENE, columns=columns | {"ball.score": np.array([1e300])})
    write_table(path, table="ball", scene=SCENE, columns=columns | {"ball.score": np.array([np.inf])})
    assert read_table(path)["ball.score"][0] == np.inf


def test_a_failed_write_leaves_the_old_table_and_no_other_file(tmp_path, monkeypatch):
    path = tmp_path / "shots.parquet"
    write_table(path, table="shots", scene=SCENE, columns=shots_columns())
    before = path.read_bytes()

    def full_disk(*args, **kwargs):
        args[1].write_bytes(b"half of it")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(pq, "write_table", full_disk)
    with pytest.raises(OSError, match="No space left"):
        write_table(path, table="shots", scene=SCENE, columns=shots_columns(5))
    assert path.read_bytes() == before
    assert os.listdir(tmp_path) == ["shots.parquet"]


@pytest.mark.parametrize("content", [b"", b"PAR1", b"PAR1" + b"\x00" * 100 + b"PAR1", b"hello"])
def test_what_is_no_parquet_says_so(tmp_path, content):
    path = tmp_path / "camera.parquet"
    path.write_bytes(content)
    with pytest.raises(ValueError, match="camera.parquet: expected a parquet file, got"):
        read_table(path)


def test_a_missing_table_and_a_folder_say_so(tmp_path):
    with pytest.raises(ValueError, match="expected a parquet file, got: nothing there"):
        read_table(tmp_path / "camera.parquet")
    with pytest.raises(ValueError, match="expected a parquet file, got: a folder"):
        read_table(tmp_path)


def test_nulls_are_refused_wherever_they_hide(tmp_path):
    path = tmp_path / "a.parquet"
    inner = pa.array([[1.0, None], [2.0, 3.0]], type=pa.list_(pa.float64(), 2))
    for column in (pa.array(["a", None]), pa.array([1.0, None]), pa.array([[1.0, 2.0], None], inner.type), inner):
        pq.write_table(pa.table({"x": column}), path)
        with pytest.raises(ValueError, match="x: expected no nulls"):
            read_table(path)


def test_columns_no_table_could_hold_are_refused(tmp_path):
    path = tmp_path / "a.parquet"
    for column in (pa.array([[1.0], []]), pa.array([{"a": 1}]), pa.array([b"x"])):
        pq.write_table(pa.table({"x": column}), path)
        with pytest.raises(ValueError, match="x: expected numbers, strings or fixed-size lists"):
            read_table(path)
