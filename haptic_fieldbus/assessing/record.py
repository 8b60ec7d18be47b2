"""What a run leaves behind: rows of numbers in a preallocated ring, and as a file of them."""

import struct
from array import array
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

ROW_SUFFIXES = (".csv",)


class Record:
    """The last `capacity` rows; one push is one `struct` call into memory that is there already."""

    def __init__(self, columns: Sequence[str], capacity: int) -> None:
        self.columns = tuple(columns)
        self.capacity = capacity
        self.pushed = 0
        """Rows ever pushed; the ring holds the last `capacity` of them."""
        self._values = array("d", bytes(8 * len(self.columns) * capacity))
        row = struct.Struct(f"{len(self.columns)}d")
        self._pack_into, self._size = row.pack_into, row.size

    def __len__(self) -> int:
        return min(self.pushed, self.capacity)

    def push(self, row: Sequence[float]) -> None:
        """Append one row, in the order of `columns`; the oldest goes when the ring is full."""
        self._pack_into(self._values, self.pushed % self.capacity * self._size, *row)
        self.pushed += 1

    def rows(self) -> NDArray[np.float64]:
        """A copy of all rows held, oldest first; shape (rows, columns)."""
        table = np.frombuffer(self._values).reshape(self.capacity, len(self.columns))
        if self.pushed <= self.capacity:
            return table[: self.pushed].copy()
        return np.roll(table, -(self.pushed % self.capacity), axis=0)

    def column(self, name: str) -> NDArray[np.float64]:
        """One quantity over time, oldest first; shape (rows,)."""
        return self.rows()[:, self.columns.index(name)]


def write_rows(record: Record, path: Path) -> None:
    """All rows held as CSV, one line each, with the names of the columns first; every digit is kept."""
    with path.open("w", encoding="utf-8", newline="\n") as file:
        file.write(",".join(record.columns) + "\n")
        file.writelines(
            ",".join(repr(value).removesuffix(".0") for value in row) + "\n" for row in record.rows().tolist()
        )
