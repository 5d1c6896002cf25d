"""Statistics of a dataset's columns, gathered clip by clip."""

from collections.abc import Mapping, Sequence

import numpy as np
import pyarrow as pa
from jaxtyping import Float

from pgm_data.dataset.columns import Column
from pgm_data.dataset.laws import per_row
from pgm_data.dataset.tables import Values, numpy_column

NUMBERS = ("int32", "int64", "float", "double")


class RunningStats:
    """Least, largest, mean and standard deviation of every component of every numeric column, NaN left out."""

    def __init__(self, columns: Sequence[Column]) -> None:
        self._columns = tuple(column for column in columns if column.type in NUMBERS)
        self._of = {column.name: _Components(max(column.size, 1)) for column in self._columns}

    def add(self, rows: pa.Table) -> None:
        """Take in rows of the dataset as they are stored."""
        self.update({column.name: numpy_column(rows.column(column.name), column.name) for column in self._columns})

    def update(self, rows: Mapping[str, Values]) -> None:
        """Take in rows of the dataset."""
        for column in self._columns:
            values = np.asarray(rows[column.name])
            if column.type == "float":
                values = values.astype(np.float32)  # as stored
            self._of[column.name].update(per_row(values).astype(np.float64))

    def document(self) -> dict[str, dict[str, list[float] | list[int]]]:
        """By column: min, max, mean, std per component, and count, the rows that have a value.

        Columns with a component that never has a value are left out, since there is no number to say of it.
        """
        return {name: part.document() for name, part in self._of.items() if part.complete}


class _Components:
    """The statistics of one column."""

    def __init__(self, size: int) -> None:
        self.rows = 0
        self.count = np.zeros(size)
        self.mean = np.zeros(size)
        self.squares = np.zeros(size)
        self.least = np.full(size, np.inf)
        self.largest = np.full(size, -np.inf)

    @property
    def complete(self) -> bool:
        return bool((self.count > 0).all())

    def update(self, values: Float[np.ndarray, "rows size"]) -> None:
        """Merge rows into the sums (Chan, Golub, LeVeque: Updating formulae for sample variances)."""
        if not len(values):
            return
        there = np.isfinite(values)
        if there.all():
            count = np.full(values.shape[1], len(values))
            self.rows += len(values)
            mean = values.mean(axis=0)
            squares, lowest, highest = values - mean, values, values
        else:
            count = there.sum(axis=0)
            self.rows += int(np.any(there, axis=1).sum())
            mean = np.where(there, values, 0.0).sum(axis=0) / np.maximum(count, 1)
            squares = np.where(there, values - mean, 0.0)
            lowest, highest = np.where(there, values, np.inf), np.where(there, values, -np.inf)
        total = self.count + count
        share = count / np.maximum(total, 1)
        apart = mean - self.mean
        self.squares += np.einsum("ij,ij->j", squares, squares) + apart**2 * self.count * share
        self.mean += apart * share
        self.count = total
        self.least = np.minimum(self.least, lowest.min(axis=0))
        self.largest = np.maximum(self.largest, highest.max(axis=0))

    def document(self) -> dict[str, list[float] | list[int]]:
        return {
            "min": self.least.tolist(),
            "max": self.largest.tolist(),
            "mean": self.mean.tolist(),
            "std": np.sqrt(self.squares / self.count).tolist(),
            "count": [self.rows],
        }
