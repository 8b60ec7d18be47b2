"""Record of a run: rows of numbers in a preallocated ring buffer, and their CSV file."""

import struct
from array import array
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

ROW_SUFFIXES = (".csv",)
"""File suffixes that `write_rows` serves."""


class Record:
    """Ring buffer of the last `capacity` rows; a push is one `struct` call into memory allocated beforehand."""

    def __init__(self, columns: Sequence[str], capacity: int) -> None:
        self.columns = tuple(columns)
        self.capacity = capacity
        self.pushed = 0
        """Number of rows pushed so far; the ring holds the last `capacity` of them."""
        # 8 bytes a double. The whole ring is touched here, so that no push in the loop allocates memory.
        self._values = array("d", bytes(8 * len(self.columns) * capacity))
        row = struct.Struct(f"{len(self.columns)}d")
        self._pack_into, self._size = row.pack_into, row.size

    def __len__(self) -> int:
        return min(self.pushed, self.capacity)

    def push(self, row: Sequence[float]) -> None:
        """Append one row, in the order of `columns`; a full ring overwrites its oldest row.

        Raises `struct.error` when the row has another length than `columns`.
        """
        self._pack_into(self._values, self.pushed % self.capacity * self._size, *row)
        self.pushed += 1

    def rows(self) -> NDArray[np.float64]:
        """Return a copy of all rows held, oldest first, shape `(n_rows, n_columns)`."""
        table = np.frombuffer(self._values).reshape(self.capacity, len(self.columns))
        if self.pushed <= self.capacity:
            return table[: self.pushed].copy()
        # The oldest row stands where the next push would write; `roll` copies, so the ring is not aliased.
        return np.roll(table, -(self.pushed % self.capacity), axis=0)

    def column(self, name: str) -> NDArray[np.float64]:
        """Return one column, oldest value first, shape `(n_rows,)`; raises ValueError for an unknown name."""
        return self.rows()[:, self.columns.index(name)]


def write_rows(record: Record, path: Path) -> None:
    """Write all rows held as CSV under a line of column names.

    Every digit is kept. Raises OSError when the file cannot be written.
    """
    with path.open("w", encoding="utf-8", newline="\n") as file:
        file.write(",".join(record.columns) + "\n")
        # `repr` is the shortest text that reads back as the same double; counts and flags lose their ".0".
        file.writelines(
            ",".join(repr(value).removesuffix(".0") for value in row) + "\n" for row in record.rows().tolist()
        )
