"""Parquet files of a dataset, written as rows come: even row groups, a new file at a bound, little in memory."""

import io
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from pgm_data.dataset.dataset_columns import FILE, FILES_PER_CHUNK
from pgm_data.dataset.tables import ROW_GROUP, storage


@dataclass(frozen=True, kw_only=True)
class Shard:
    """One file of a dataset."""

    number: int
    """From 0, over all chunks."""
    split: str
    """The only split that it holds."""

    @property
    def chunk_index(self) -> int:
        """Folder that it is in."""
        return self.number // FILES_PER_CHUNK

    @property
    def file_index(self) -> int:
        """Within that folder."""
        return self.number % FILES_PER_CHUNK

    @property
    def name(self) -> str:
        """Path below the table's folder, without its suffix."""
        return FILE.format(chunk_index=self.chunk_index, file_index=self.file_index)


class ShardWriter:
    """Writes tables one after another into numbered files.

    A table is never divided between files; a file holds one split and ends with the table that takes it to the bound.
    At most the rows of one row group and one table are in memory.
    """

    def __init__(
        self,
        folder: Path,
        schema: pa.Schema,
        *,
        bound_bytes: int,
        written: Callable[[pa.Table], None] = lambda content: None,
    ) -> None:
        """Begin without a file; `written` gets the rows of each write, after it."""
        self.folder = folder
        self.schema = schema
        self.bound_bytes = bound_bytes
        self._written = written
        self.shards: list[Shard] = []
        self._file: io.BufferedWriter | None = None
        self._writer: pq.ParquetWriter | None = None
        self._waiting: list[pa.Table] = []
        self._rows = 0

    def add(self, table: pa.Table, split: str) -> Shard:
        """Write the table; the file that it is in."""
        if self._file is None or split != self.shards[-1].split or self._file.tell() >= self.bound_bytes:
            self._begin(split)
        self._waiting.append(table)
        self._rows += table.num_rows
        if self._rows >= ROW_GROUP:
            self._write(self._rows - self._rows % ROW_GROUP)
        return self.shards[-1]

    def _begin(self, split: str) -> None:
        self.close()
        self.shards.append(Shard(number=len(self.shards), split=split))
        path = self.folder / f"{self.shards[-1].name}.parquet"
        path.parent.mkdir(parents=True, exist_ok=True)
        self._file = path.open("wb")
        self._writer = pq.ParquetWriter(self._file, self.schema, **storage(self.schema))

    def _write(self, rows: int) -> None:
        """Write the first rows of those that wait."""
        if self._writer is None:
            return
        content = pa.concat_tables(self._waiting)
        if rows:
            self._writer.write_table(content.slice(0, rows), row_group_size=ROW_GROUP)
            self._written(content.slice(0, rows))
        rest = content.slice(rows)
        self._waiting, self._rows = [rest] if rest.num_rows else [], rest.num_rows

    def close(self) -> None:
        """End the file that is being written, if there is one."""
        if self._writer is not None and self._file is not None:
            if self._rows:
                self._write(self._rows)
            self._writer.close()
            self._file.close()
        self._writer, self._file, self._waiting, self._rows = None, None, [], 0

    def __enter__(self) -> "ShardWriter":
        return self

    def __exit__(self, *error: object) -> None:
        self.close()
