"""Record of a run: rows of numbers in a preallocated ring buffer."""

import struct
from array import array
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray


class Record:
    """Ring buffer of the last `capacity` rows; a push is one `struct` call into memory allocated beforehand."""

    def __init__(self, columns: Sequence[str], capacity: int) -> None:
        self.columns = tuple(columns)
        self.capacity = capacity
        self.pushed = 0
        """Number of rows pushed so far; the ring holds the last `capacity` of them."""
        # The whole ring is touched here, so that no push in the loop allocates memory.
        self._values = array("d", [0.0]) * (len(self.columns) * capacity)
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
        table = self._table()
        if self.pushed <= self.capacity:
            return table[: self.pushed].copy()
        # The oldest row stands where the next push would write; `roll` copies, so the ring is not aliased.
        return np.roll(table, -(self.pushed % self.capacity), axis=0)

    def column(self, name: str, first: int = 0) -> NDArray[np.float64]:
        """Return one column from row number `first` on, oldest value first, shape `(n_rows,)`.

        Raises ValueError for an unknown name.
        """
        values: NDArray[np.float64] = self._table()[self._held(first), self.columns.index(name)]
        return values

    def since(self, first: int) -> NDArray[np.float64]:
        """Return a copy of the rows from number `first` on, counted from the first push; the oldest may be gone."""
        return self._table()[self._held(first)]

    def _held(self, first: int) -> NDArray[np.int64]:
        """Return the places of the rows from number `first` on, as far as they are held."""
        return np.arange(max(first, self.pushed - self.capacity), self.pushed) % self.capacity

    def _table(self) -> NDArray[np.float64]:
        return np.frombuffer(self._values).reshape(self.capacity, len(self.columns))
