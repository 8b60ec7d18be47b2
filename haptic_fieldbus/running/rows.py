"""Files of rows (.csv, .mcap): one line or message a period, written during the run.

In virtual time the loop itself writes, because time stands still meanwhile. On a real bus another process writes; it
gets the rows of a tenth of a second at a time.
"""

import json
import os
import sys
from array import array
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from haptic_fieldbus.buses.writing import LogFile, WritingProcess, pieces
from haptic_fieldbus.errors import require
from haptic_fieldbus.recordings.provenance import Provenance
from haptic_fieldbus.recordings.tables import LAST, ROWS, column_units, heading, piece, row_line

if TYPE_CHECKING:  # imported for its type alone: the writing process does without numpy
    from haptic_fieldbus.assessing.loop_report import Record

ROW_SUFFIXES = (".csv", ".mcap")
"""Suffixes of files of rows."""


class RowFile(Protocol):
    """A file that takes rows while the loop runs."""

    def take(self, record: "Record") -> None:
        """Take the rows pushed since the last call; raises OSError if it can take no more."""

    def close(self, provenance: str = "") -> None:
        """Finish the file with the last provenance; raises OSError when it is not complete."""


class DirectRows:
    """A file that this process writes."""

    def __init__(self, path: Path, columns: Sequence[str]) -> None:
        self._file = LogFile(path)
        self._file.add(heading(columns))
        self._taken = 0

    def take(self, record: "Record") -> None:
        for row in record.since(self._taken).tolist():
            self._file.add(row_line(row))
        self._taken = record.pushed
        self._file.flush()

    def close(self, provenance: str = "") -> None:
        self._file.close()


class ProcessRows:
    """A file that another process writes; `take` never waits for it."""

    def __init__(self, path: Path, columns: Sequence[str]) -> None:
        path.open("wb").close()  # what cannot be written is refused at once
        self._process = WritingProcess("from haptic_fieldbus.running.rows import main; main()", str(path), *columns)
        self._taken = 0

    def take(self, record: "Record") -> None:
        rows = record.since(self._taken)
        self._taken = record.pushed
        self._process.take(rows.tobytes())

    def close(self, provenance: str = "") -> None:
        self._process.close()


class DirectMcap:
    """An MCAP file that this process writes."""

    def __init__(self, path: Path, columns: Sequence[str], units: Mapping[str, str], provenance: str) -> None:
        from haptic_fieldbus.recordings.mcap import McapFile

        self._file = McapFile(path, columns, units, provenance)
        self._taken = 0

    def take(self, record: "Record") -> None:
        rows = record.since(self._taken)
        self._taken = record.pushed
        self._file.take(rows.tolist())

    def close(self, provenance: str = "") -> None:
        self._file.close(provenance)


class ProcessMcap:
    """An MCAP file that another process writes; `take` never waits for it."""

    def __init__(self, path: Path, columns: Sequence[str], units: Mapping[str, str], provenance: str) -> None:
        require("mcap", "data")
        path.open("wb").close()  # what cannot be written is refused at once
        self._process = WritingProcess("from haptic_fieldbus.recordings.mcap import main; main()", str(path))
        begin = {"columns": list(columns), "units": dict(units), "provenance": provenance}
        self._process.take(piece(ROWS, json.dumps(begin).encode()))
        self._taken = 0

    def take(self, record: "Record") -> None:
        rows = record.since(self._taken)
        self._taken = record.pushed
        self._process.take(piece(ROWS, rows.tobytes()))

    def close(self, provenance: str = "") -> None:
        try:
            self._process.take(piece(LAST, provenance.encode()))
        finally:
            self._process.close()


class Rows:
    """The file of rows of a run, if it has one; `fault` is the reason of an early end of the file, or None."""

    def __init__(
        self, record: "Record", path: Path | None, *, simulated: bool, provenance: Provenance | None = None
    ) -> None:
        """Begin the file; raises OSError, or UsageError without the library of its format."""
        self.fault: OSError | None = None
        self._record = record
        self._file: RowFile | None = None
        if path is not None and path.suffix in ROW_SUFFIXES:
            # Windows has no pipe that takes octets without waiting.
            direct = simulated or not hasattr(os, "fork")
            if path.suffix == ".mcap":
                units, text = column_units(record.columns, provenance), "" if provenance is None else provenance.text()
                self._file = (DirectMcap if direct else ProcessMcap)(path, record.columns, units, text)
            else:
                self._file = (DirectRows if direct else ProcessRows)(path, record.columns)

    def flush(self) -> None:
        """Pass on the new rows; a file that fails is abandoned, because the run must continue."""
        if self._file is not None and self.fault is None:
            try:
                self._file.take(self._record)
            except OSError as error:
                self.fault = error

    def close(self, provenance: Provenance | None = None) -> None:
        """Pass on the last rows and the last provenance, and finish the file."""
        self.flush()
        if self._file is not None:
            try:
                self._file.close("" if provenance is None else provenance.text())
            except OSError as error:
                self.fault = error  # of the disk itself, so it says more than that of the pipe


def main() -> None:
    """Write the rows from standard input, doubles of this machine, to the file named by the first argument."""
    path, *columns = sys.argv[1:]
    try:
        _write_all(LogFile(Path(path)), columns)
    except OSError as error:
        sys.exit(error.strerror or str(error))


def _write_all(file: LogFile, columns: Sequence[str]) -> None:
    """Write each row as soon as it arrives; raises OSError."""
    file.add(heading(columns))
    for octets in pieces(8 * len(columns)):
        values = array("d", octets)
        for first in range(0, len(values), len(columns)):
            file.add(row_line(values[first : first + len(columns)]))
        file.flush()
    file.close()
