"""Tables of text that other programs and people write: delimiters, headers and order as they come, values strictly."""

import csv
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

LARGEST_FILE = 128 * 2**20
"""Bytes above which a table is not read: ten million rows of a track."""
DELIMITERS = (",", ";", "\t")
MISSING_WORDS = frozenset({"", "nan", "na", "n/a", "none", "null", "-"})
"""What a cell without a value holds, in small letters."""


@dataclass(frozen=True, eq=False, kw_only=True)
class LooseTable:
    """The columns of a file that were asked for, as text, and where each row stands."""

    path: Path
    lines: tuple[int, ...]
    """Line of the file that each row ends in, from 1."""
    names: tuple[str, ...]
    """Columns found, by the names they were asked for with."""
    titles: tuple[str, ...]
    """The same columns as the file's header writes them."""
    cells: tuple[tuple[str, ...], ...]
    """One tuple of texts a column, without blanks around them."""
    decimal_comma: bool
    """Whether a comma may stand for the decimal point, as the columns are parted by something else."""

    def __len__(self) -> int:
        """Number of rows."""
        return len(self.lines)

    def has(self, name: str) -> bool:
        """Whether the file has the column."""
        return name in self.names

    def texts(self, name: str) -> tuple[str, ...]:
        """The column's cells."""
        return self.cells[self.names.index(name)]

    def fault(self, row: int, name: str, expected: str) -> ValueError:
        """The error for a cell, naming file, line and field."""
        title = self.titles[self.names.index(name)]
        return ValueError(
            f"{self.path}: line {self.lines[row]}: {title}: expected {expected}, got {self.texts(name)[row]!r}"
        )

    def numbers(self, name: str, expected: str = "a number") -> Float[np.ndarray, " rows"]:
        """The column as numbers; NaN where a cell says that there is none.

        Raises:
            ValueError: If a cell holds something else, or a number that is not finite.
        """
        texts = self.texts(name)
        values = np.array([_number(text, self.decimal_comma) for text in texts], dtype=np.float64)
        wrong = np.flatnonzero(np.isinf(values))
        if len(wrong):
            raise self.fault(int(wrong[0]), name, f"{expected} or nothing")
        return values

    def whole_numbers(self, name: str, expected: str, most: int) -> Int[np.ndarray, " rows"]:
        """The column as whole numbers of 0 to `most`; 12.0 is one.

        Raises:
            ValueError: If a cell holds anything else.
        """
        values = self.numbers(name, expected)
        wrong = np.flatnonzero(~((values >= 0) & (values <= most) & (values == np.floor(values))))
        if len(wrong):
            raise self.fault(int(wrong[0]), name, expected)
        return values.astype(np.int64)


def read_loose_csv(path: Path, aliases: Mapping[str, tuple[str, ...]], *, required: tuple[str, ...]) -> LooseTable:
    """The columns of a file whose header names them, in any order, case and punctuation; others are passed over.

    Parted by commas, semicolons or tabs, in UTF-8, with or without a byte order mark. Blank lines count for nothing.

    Args:
        path: The file.
        aliases: For each column, the titles it may have, in small letters and digits alone.
        required: Columns that must be there.

    Raises:
        ValueError: If the file cannot be read, has no such header, names a column twice, or a row has another number
            of cells. The message names the file, the line and what was expected.
    """
    columns = ",".join(aliases)
    try:
        if not path.is_file():  # opening a pipe would wait for ever
            raise OSError("a folder" if path.is_dir() else "no regular file" if path.exists() else "nothing there")
        if path.stat().st_size > LARGEST_FILE:
            raise OSError(f"{path.stat().st_size} bytes, more than {LARGEST_FILE}")
        with path.open(encoding="utf-8-sig", newline="") as file:
            first = file.readline()
            delimiter = max(DELIMITERS, key=first.count)
            file.seek(0)
            return _table(path, csv.reader(file, delimiter=delimiter, strict=True), aliases, required, delimiter)
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ValueError(f"{path}: expected a CSV file in UTF-8 with columns of {columns}, got: {error}") from error


def _table(path: Path, reader, aliases: Mapping[str, tuple[str, ...]], required: tuple[str, ...], delimiter: str):
    header = next(reader, None)
    if header is None:
        raise ValueError(f"{path}: line 1: expected a header with the columns {','.join(required)}, got an empty file")
    place: dict[str, int] = {}
    for index, title in enumerate(header):
        plain = re.sub("[^a-z0-9]", "", title.lower())
        name = next((name for name, titles in aliases.items() if plain in titles), None)
        if name is None:
            continue
        if name in place:
            both = f"{header[place[name]]!r} and {title!r}"
            raise ValueError(f"{path}: line 1: {name}: expected one such column, got {both}")
        place[name] = index
    absent = [name for name in required if name not in place]
    if absent:
        got = ",".join(header)[:200] or "nothing"
        raise ValueError(f"{path}: line 1: {absent[0]}: expected a header with the column, got {got}")
    lines, rows = [], []
    for cells in reader:
        if not any(cell.strip() for cell in cells):
            continue
        if len(cells) != len(header):
            said = f"expected {len(header)} fields as in the header, got {len(cells)}"
            raise ValueError(f"{path}: line {reader.line_num}: {said}")
        lines.append(reader.line_num)
        rows.append([cells[index].strip() for index in place.values()])
    columns = tuple(zip(*rows, strict=True)) if rows else ((),) * len(place)
    return LooseTable(
        path=path,
        lines=tuple(lines),
        names=tuple(place),
        titles=tuple(header[index].strip() for index in place.values()),
        cells=columns,
        decimal_comma=delimiter != ",",
    )


def _number(text: str, decimal_comma: bool) -> float:
    """The number a cell holds; NaN where it holds nothing, infinity where it holds no number."""
    if text.lower() in MISSING_WORDS:
        return math.nan
    if decimal_comma:
        text = text.replace(",", ".")
    try:
        # Python alone would read 1_000 as a thousand.
        value = float(text) if "_" not in text else math.inf
    except ValueError:
        return math.inf
    return math.inf if math.isnan(value) else value
