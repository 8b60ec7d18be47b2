"""CSV files of a sampled quantity: a column of rising times [s] beside a column of values.

The first row names the columns, in any order; further columns are ignored. Each fault has its line and column; all of
them are found in one reading.
"""

import csv
import math
from array import array
from collections.abc import Sequence
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from haptic_fieldbus.documents.safe_read import TABLE_SIZE, read_octets
from haptic_fieldbus.errors import DocumentError, Fault
from haptic_fieldbus.numerals import exactly

if TYPE_CHECKING:
    import _csv

Array = NDArray[np.float64]

TIME = "time"
MOST_ROWS = 1_000_000
"""Largest number of rows of a file."""
LARGEST = 1e100
"""Largest number in a file; squares of it are finite too."""
MOST_FAULTS = 20
"""Largest number of faults listed one by one; the others are counted."""


@dataclass(frozen=True, eq=False)
class Samples:
    """Values of one quantity (n,) at rising times (n,) [s], n at least 2, and the lines of the file (n,)."""

    quantity: str
    """Name of the column."""
    times: Array
    values: Array
    lines: NDArray[np.int64]


def read_samples(path: Path, quantities: Sequence[str]) -> Samples:
    """Read from a file the times and the column named by one of `quantities`.

    Raises DocumentError for a file that cannot be read, and for columns, rows and numbers that are not as expected.
    """
    try:
        text = read_octets(path, TABLE_SIZE).decode("utf-8-sig")
    except OSError as error:
        raise DocumentError(path, [Fault("", f"cannot be read: {error.strerror}")]) from error
    except UnicodeDecodeError as error:
        raise DocumentError(path, [Fault("", f"not UTF-8, from octet {error.start} on")]) from error
    table = _Table(csv.reader(StringIO(text, newline="")))
    try:
        quantity = table.read_header(quantities)
        table.read_rows(quantity)
    except csv.Error as error:
        table.fault("", f"not CSV: {error}")
    if table.faults:
        raise DocumentError(path, table.faults + ([Fault("", f"and {table.more} more errors")] if table.more else []))
    return Samples(quantity, np.array(table.times), np.array(table.values), np.array(table.lines))


class _Table:
    """A file during reading; its numbers take 24 octets a row."""

    def __init__(self, rows: "_csv.Reader") -> None:
        self._rows = rows
        self._places: dict[str, int] = {}
        self.times, self.values, self.lines = array("d"), array("d"), array("q")
        self.faults: list[Fault] = []
        self.more = 0  # faults that are not listed

    def fault(self, column: str, message: str) -> None:
        """Note a fault in the line that was read last."""
        if len(self.faults) < MOST_FAULTS:
            self.faults.append(Fault(column, message, self._rows.line_num or None))
        else:
            self.more += 1

    def read_header(self, quantities: Sequence[str]) -> str:
        """Find the columns, and return the name of the column of values; raises csv.Error like `read_rows`."""
        names = [name.strip() for name in next(self._rows, [])]
        self._places = {name: place for place, name in enumerate(names)}
        present = [name for name in quantities if name in names]
        expected = f"expected the columns {TIME} and {' or '.join(quantities)}, separated by commas"
        if TIME not in names or not present:
            self.fault("", f'columns "{", ".join(names)[:80]}"; {expected}')
        elif len(present) > 1:
            self.fault("", f"columns {' and '.join(present)}; {expected}, and only one of these")
        for name in (TIME, *present):
            if names.count(name) > 1:
                self.fault(name, f"appears {names.count(name)} times; expected one column with this name")
        return present[0] if present else quantities[0]

    def read_rows(self, quantity: str) -> None:
        """Read all rows, unless the columns were not found."""
        if self.faults:
            return
        latest = -math.inf
        for row in filter(any, self._rows):  # without empty ones
            if len(self.times) == MOST_ROWS:
                self.fault("", f"too many rows; expected at most {MOST_ROWS}")
                return
            time, value = self._number(row, TIME), self._number(row, quantity)
            if time <= latest:
                self.fault(TIME, f"{exactly(time)} after {exactly(latest)}; expected a later time")
            latest = latest if math.isnan(time) else time
            self.times.append(time)
            self.values.append(value)
            self.lines.append(self._rows.line_num)
        if not self.faults and len(self.times) < 2:
            self.fault("", f"{len(self.times)} rows of numbers; expected two or more")

    def _number(self, row: list[str], column: str) -> float:
        """Return the number of a row in a column; without a number, note a fault and return not-a-number."""
        place = self._places[column]
        text = row[place].strip() if place < len(row) else ""
        try:
            if abs(number := float(text)) <= LARGEST:
                return number
            self.fault(column, f"{text[:40]}; expected a finite number, at most {exactly(LARGEST)} in size")
        except ValueError:
            self.fault(column, f'"{row[place][:40]}"; expected a number' if text else "missing; expected a number")
        return math.nan
