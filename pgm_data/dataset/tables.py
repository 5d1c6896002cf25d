"""Tables of the contract as parquet files: columns checked on the way out, arrays on the way in."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from pgm_data.dataset.columns import Column, arrow_schema, table_columns
from pgm_data.dataset.files import whole_file
from pgm_data.scene import Scene

ROW_GROUP = 3000
"""Rows per row group."""

Values = np.ndarray | Sequence


def write_table(path: Path, *, table: str, scene: Scene, columns: Mapping[str, Values]) -> None:
    """Write the columns as the given table of the scene, zstd-compressed, whole or not at all.

    Vector columns are (N, size) or shaped (N, ...) with as many values, in row-major order.

    Raises:
        ValueError: If a column is missing, undeclared, of another length, size or type, or holds a word it may not.
    """
    expected = table_columns(table, scene)
    names = {column.name for column in expected}
    unknown = sorted(set(columns) - names)
    if unknown:
        raise ValueError(f"{path}: {table}: expected columns that scene {scene.name} declares, got {unknown}")
    missing = [column.name for column in expected if column.name not in columns and not column.optional]
    if missing:
        raise ValueError(f"{path}: {table}: expected the columns {missing}, got none of them")
    present = [column for column in expected if column.name in columns]
    schema = arrow_schema(table, scene, without={c.name for c in expected} - {c.name for c in present})
    content = arrow_table(columns, present, schema, place=str(path))
    with whole_file(path) as temporary:
        pq.write_table(content, temporary, row_group_size=ROW_GROUP, **storage(schema))


def arrow_table(
    columns: Mapping[str, Values], declared: Sequence[Column], schema: pa.Schema, *, place: str
) -> pa.Table:
    """The declared columns as the schema's Arrow table; `place` says in errors where they are.

    Raises:
        ValueError: If a column is of another length, size or type, or holds a word it may not.
    """
    rows = len(columns[declared[0].name])
    arrays = [
        _arrow(columns[column.name], column, rows, schema.field(column.name).type, f"{place}: {column.name}")
        for column in declared
    ]
    return pa.Table.from_arrays(arrays, schema=schema)


def storage(schema: pa.Schema) -> dict[str, Any]:
    """How parquet files are stored: zstd, and a dictionary for texts alone, since numbers hardly ever repeat."""
    return {"compression": "zstd", "use_dictionary": [f.name for f in schema if pa.types.is_string(f.type)]}


def _arrow(values: Values, column: Column, rows: int, arrow: pa.DataType, place: str) -> pa.Array:
    if len(values) != rows:
        raise ValueError(f"{place}: expected {rows} rows as in the first column, got {len(values)}")
    if column.type == "string":
        words = list(values)
        wrong = next((i for i, word in enumerate(words) if not isinstance(word, str)), None)
        if wrong is not None:
            raise ValueError(f"{place}: expected strings, got {words[wrong]!r} in row {wrong}")
        stray = sorted(set(words) - set(column.allowed)) if column.allowed else []
        if stray:
            raise ValueError(f"{place}: expected one of {', '.join(column.allowed)}, got {str(stray[0])!r}")
        return pa.array(words, type=arrow)
    flat = _numbers(np.asarray(values), column, place)
    if flat.size != rows * max(column.size, 1):
        shape = (rows, column.size) if column.size else (rows,)
        raise ValueError(f"{place}: expected shape {shape}, got {np.shape(values)}")
    if column.size:
        return pa.FixedSizeListArray.from_arrays(pa.array(flat.reshape(-1)), type=arrow)
    return pa.array(flat.reshape(-1), type=arrow)


DTYPES = {"bool": np.bool_, "int32": np.int32, "int64": np.int64, "float": np.float32, "double": np.float64}


def _numbers(values: np.ndarray, column: Column, place: str) -> np.ndarray:
    kinds = {"bool": "b", "int32": "iu", "int64": "iu", "float": "fiu", "double": "fiu"}[column.type]
    if values.size and values.dtype.kind not in kinds:
        raise ValueError(f"{place}: expected {column.type}, got {values.dtype}")
    dtype = np.dtype(DTYPES[column.type])
    if column.type == "int32" and values.size:
        bounds = np.iinfo(np.int32)
        if values.min() < bounds.min or values.max() > bounds.max:
            raise ValueError(f"{place}: expected int32, got values from {values.min()} to {values.max()}")
    with np.errstate(over="ignore"):
        numbers = values.astype(dtype)
    if column.type == "float" and np.isinf(numbers).sum() > np.isinf(values.astype(np.float64)).sum():
        raise ValueError(f"{place}: expected values that float32 can hold, got some beyond it")
    return np.ascontiguousarray(numbers)


def read_table(path: Path) -> dict[str, np.ndarray]:
    """Columns of a parquet file: vectors as (N, size) arrays, strings as object arrays.

    Raises:
        ValueError: If the file is not parquet, or holds a column that no table of the contract could hold.
    """
    try:
        with open_table(path) as file:
            content = file.read()
    except (pa.ArrowException, OSError, ValueError) as error:
        raise ValueError(f"{path}: expected a parquet file, got: {error}") from error
    return {name: numpy_column(content.column(name), f"{path}: {name}") for name in content.column_names}


def open_table(path: Path) -> pq.ParquetFile:
    """The parquet file, with each text kept once however often it stands there.

    Raises:
        pyarrow.ArrowException, OSError, ValueError: If it is no parquet file.
    """
    if not path.is_file():  # opening a pipe would wait for ever
        raise ValueError("a folder" if path.is_dir() else "no regular file" if path.exists() else "nothing there")
    metadata = pq.read_metadata(path)
    texts = [f.name for f in metadata.schema.to_arrow_schema() if pa.types.is_string(f.type)]
    return pq.ParquetFile(path, metadata=metadata, read_dictionary=texts)


def stored_schema(file: pq.ParquetFile) -> pa.Schema:
    """The schema of a file as it was written, without the dictionaries that reading makes of texts."""
    return file.metadata.schema.to_arrow_schema()


def numpy_column(values: pa.ChunkedArray, place: str) -> np.ndarray:
    """Values of an Arrow column: (N,) of scalars, (N, size) of fixed-size lists, objects of strings.

    Raises:
        ValueError: If it holds nulls or another type.
    """
    if values.null_count:
        raise ValueError(f"{place}: expected no nulls, got {values.null_count}")
    texts = values.type.value_type if pa.types.is_dictionary(values.type) else values.type
    if pa.types.is_string(texts) or pa.types.is_large_string(texts):
        return _texts(values)
    if pa.types.is_fixed_size_list(values.type):
        size = values.type.list_size
        chunks = [chunk.flatten() for chunk in values.chunks]
        if any(chunk.null_count for chunk in chunks):
            raise ValueError(f"{place}: expected no nulls within its lists, got some")
        return _scalars(pa.chunked_array(chunks, type=values.type.value_type), place).reshape(-1, size)
    return _scalars(values, place)


def _texts(values: pa.ChunkedArray) -> np.ndarray:
    result = np.empty(len(values), dtype=object)
    row = 0
    for chunk in values.chunks:
        chunk = chunk if pa.types.is_dictionary(chunk.type) else chunk.dictionary_encode()
        words = np.empty(len(chunk.dictionary), dtype=object)
        words[:] = chunk.dictionary.to_pylist()
        result[row : row + len(chunk)] = words[chunk.indices.to_numpy()]
        row += len(chunk)
    return result


def _scalars(values: pa.ChunkedArray, place: str) -> np.ndarray:
    if not (pa.types.is_boolean(values.type) or pa.types.is_integer(values.type) or pa.types.is_floating(values.type)):
        raise ValueError(f"{place}: expected numbers, strings or fixed-size lists of numbers, got {values.type}")
    return values.to_numpy()
