"""One parquet file against the columns that its table must have, without trusting a byte of it."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from pgm_data.dataset.camera_laws import camera_faults
from pgm_data.dataset.columns import SCHEMA_VERSION, TABLES, Column, arrow_schema, declared, table_columns
from pgm_data.dataset.documents import Fault
from pgm_data.dataset.laws import Columns, Context, key_faults, shots_faults, value_faults
from pgm_data.dataset.play_laws import ball_faults, ball_shots_faults, captions_faults, events_faults
from pgm_data.dataset.player_laws import players_faults
from pgm_data.dataset.tables import numpy_column, open_table, stored_schema
from pgm_data.scene import Scene

LARGEST_TABLE = 4 * 2**30
"""Bytes in memory above which a table is not read: a few kilobytes of parquet can claim any number of rows."""
STRING_BYTES = 64
"""Bytes that a string is taken to need, for that bound."""
SCALAR_BYTES = {"bool": 1, "int32": 4, "int64": 8, "float": 4, "double": 8, "string": STRING_BYTES}

LAWS: dict[str, Callable[[Columns, Context], Iterator[Fault]]] = {
    "shots": lambda columns, _: shots_faults(columns),
    "camera": camera_faults,
    "players": players_faults,
    "ball": ball_faults,
    "events": events_faults,
    "ball_shots": ball_shots_faults,
    "captions": captions_faults,
}


@dataclass(frozen=True, eq=False, kw_only=True)
class CheckedTable:
    """What one parquet file holds, and what is wrong with it."""

    columns: dict[str, np.ndarray]
    """Those that are what they must be."""
    content: pa.Table | None
    """The same as they are stored, texts as dictionaries; None where nothing could be read."""
    faults: tuple[Fault, ...]


def checked_table(path: Path, table: str, context: Context) -> CheckedTable:
    """The columns of the file that are what they must be, and every fault found in it."""
    if context.scene is not None and not declared(TABLES[table].needs, context.scene):
        expected = f"no such file: scene {context.scene.name} declares no {TABLES[table].needs}"
        return _unread(Fault(field="", expected=expected, found=path.name))
    try:
        with open_table(path) as file:
            schema = stored_schema(file)
            wanted = _declared_columns(table, context.scene)
            faults = [*size_faults(file, wanted)]
            if context.scene is None or not schema.equals(_plain_schema(table, context.scene), check_metadata=True):
                faults = [*schema_faults(schema, table, context.scene, wanted), *faults]
            if any(fault.field == "rows" for fault in faults):
                return _unread(*faults)
            right = [c.name for c in wanted if not faults or _is_right(schema, c)]
            right = [name for name in right if name in schema.names]
            content = file.read(columns=right, use_threads=False)
    except (pa.ArrowException, OSError, ValueError) as error:
        found = " ".join(str(error).split()) or repr(error)
        return _unread(Fault(field="", expected="a parquet file", found=found))
    columns: dict[str, np.ndarray] = {}
    for name in right:
        try:
            columns[name] = numpy_column(content.column(name), name)
        except (ValueError, pa.ArrowException) as error:
            faults.append(Fault(field=name, expected="values without nulls", found=" ".join(str(error).split())))
    faults += value_faults(columns, wanted)
    if TABLES[table].frame_aligned:
        faults += key_faults(columns, context)
    faults += LAWS[table](columns, context)
    return CheckedTable(columns=columns, content=content, faults=tuple(faults))


def _unread(*faults: Fault) -> CheckedTable:
    return CheckedTable(columns={}, content=None, faults=faults)


@lru_cache(maxsize=64)
def _plain_schema(table: str, scene: Scene) -> pa.Schema:
    """The schema of a table without optional columns, as our own writer writes it."""
    optional = {column.name for column in table_columns(table, scene) if column.optional}
    return arrow_schema(table, scene, without=optional)


def _is_right(schema: pa.Schema, column: Column) -> bool:
    return bool(schema.get_all_field_indices(column.name)) and _type_found(schema, column) is None


@lru_cache(maxsize=64)
def _declared_columns(table: str, scene: Scene | None) -> tuple[Column, ...]:
    return TABLES[table].columns if scene is None else table_columns(table, scene)


def schema_faults(schema: pa.Schema, table: str, scene: Scene | None, wanted: tuple[Column, ...]) -> Iterator[Fault]:
    """Columns that are missing, stray, or of another type, unit or frame than wanted, and wrong metadata."""
    metadata = {k.decode(errors="replace"): v.decode(errors="replace") for k, v in (schema.metadata or {}).items()}
    version = metadata.get("pgm.schema_version")
    if version is None or version.split(".")[0] != SCHEMA_VERSION.split(".")[0]:
        yield Fault(field="pgm.schema_version", expected=f"{SCHEMA_VERSION} in the metadata", found=version or "none")
    if metadata.get("pgm.table", table) != table:
        yield Fault(field="pgm.table", expected=table, found=metadata["pgm.table"])
    if scene is not None and metadata.get("pgm.scene", scene.name) != scene.name:
        yield Fault(field="pgm.scene", expected=scene.name, found=metadata["pgm.scene"])
    known = {column.name for column in wanted}
    for name in dict.fromkeys(schema.names):
        if name not in known:
            where = f"{table} of scene {scene.name}" if scene is not None else table
            yield Fault(field=name, expected=f"no such column: {where} does not declare it", found="the column")
        if len(schema.get_all_field_indices(name)) > 1:
            yield Fault(
                field=name, expected="the column once", found=f"{len(schema.get_all_field_indices(name))} times"
            )
    for column in wanted:
        if not schema.get_all_field_indices(column.name):
            if not column.optional:
                yield Fault(field=column.name, expected="the column", found="none")
            continue
        wrong = _type_found(schema, column)
        if wrong is not None:
            size = f"fixed_size_list<{column.type}>[{column.size}]" if column.size else column.type
            yield Fault(field=column.name, expected=size, found=wrong)
            continue
        own = schema.field(column.name).metadata or {}
        for key, value in (("unit", column.unit), ("frame", column.frame)):
            found = own.get(key.encode(), b"").decode(errors="replace")
            if found != value:
                yield Fault(field=f"{column.name}.{key}", expected=value or "none", found=found or "none")


def _type_found(schema: pa.Schema, column: Column) -> str | None:
    """The column's type where it is not what it must be."""
    indices = schema.get_all_field_indices(column.name)
    if len(indices) != 1:
        return "several columns"
    found = schema.field(indices[0]).type
    scalar = found
    if column.size:
        if not pa.types.is_fixed_size_list(found) or found.list_size != column.size:
            return str(found)
        scalar = found.value_type
    elif pa.types.is_dictionary(found):
        scalar = found.value_type
    if column.type == "string":
        right = pa.types.is_string(scalar) or pa.types.is_large_string(scalar)
    else:
        right = (
            scalar
            == {
                "bool": pa.bool_(),
                "int32": pa.int32(),
                "int64": pa.int64(),
                "float": pa.float32(),
                "double": pa.float64(),
            }[column.type]
        )
    return None if right else str(found)


def size_faults(file: pq.ParquetFile, wanted: tuple[Column, ...]) -> Iterator[Fault]:
    """More rows than can be read; the fault's field is `rows`."""
    rows = file.metadata.num_rows
    needed = rows * sum(max(column.size, 1) * SCALAR_BYTES[column.type] for column in wanted)
    stored = sum(file.metadata.row_group(i).total_byte_size for i in range(file.metadata.num_row_groups))
    if not 0 <= max(needed, stored) <= LARGEST_TABLE or rows < 0:
        yield Fault(field="rows", expected=f"a table of at most {LARGEST_TABLE} bytes", found=f"{rows} rows")
