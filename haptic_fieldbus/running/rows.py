"""Files of rows (.csv, .mcap): one line or message a period, written during the run.

In virtual time the loop itself writes, because time stands still meanwhile. On a real bus another process writes; it
gets the rows of a tenth of a second at a time.
"""

import os
import pickle
import sys
from array import array
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from haptic_fieldbus.buses.writing import LogFile, WritingProcess
from haptic_fieldbus.errors import UsageError, require
from haptic_fieldbus.recordings.provenance import Provenance, side_file
from haptic_fieldbus.recordings.tables import column_units, heading, row_line

if TYPE_CHECKING:  # imported for its type alone: the writing process does without numpy
    from haptic_fieldbus.assessing.loop_report import Record

ROW_SUFFIXES = (".csv", ".mcap")
"""Suffixes of files of rows."""


def set_aside(record: Path | None) -> list[tuple[Path, Path]]:
    """Give an earlier recording of this name another one, with the file beside it; return both names of each file.

    A file that cannot get another name is left, and will be overwritten; so is a device.
    """
    moved: list[tuple[Path, Path]] = []
    for file in () if record is None else (record, side_file(record)):
        target = Path(os.path.realpath(file))  # a link stays
        other = target.with_name(f"{target.name}.before-{os.getpid()}")
        with suppress(OSError):
            if target.is_file():
                os.replace(target, other)
                moved.append((target, other))
    return moved


def put_back(moved: Sequence[tuple[Path, Path]], *, is_replaced: bool = False) -> None:
    """Give earlier files their names again; remove them if a run that has begun replaces them."""
    for target, other in moved:
        with suppress(OSError):
            if is_replaced:
                other.unlink()
            else:
                os.replace(other, target)


class RowFile(Protocol):
    """A file that takes rows while the loop runs, as doubles of this machine."""

    def take(self, octets: bytes) -> None:
        """Take whole rows; raises OSError if it can take no more."""

    def close(self, provenance: str | None) -> None:
        """Finish the file with the last provenance; raises OSError when it is not complete.

        None: the file ended before the run, and stays as one that was cut off.
        """


class CsvFile:
    """A file of lines, whose format holds neither units nor provenance."""

    def __init__(self, path: Path, columns: Sequence[str], units: Mapping[str, str], provenance: str) -> None:
        self._file, self._width = LogFile(path), len(columns)
        self._file.add(heading(columns))

    def take(self, octets: bytes) -> None:
        values = array("d", octets)
        for first in range(0, len(values), self._width):
            self._file.add(row_line(values[first : first + self._width]))
        self._file.flush()

    def close(self, provenance: str | None) -> None:
        self._file.close()


class ProcessFile:
    """A file that another process writes; `take` never waits for it."""

    def __init__(self, path: Path, columns: Sequence[str], units: Mapping[str, str], provenance: str) -> None:
        if path.suffix == ".mcap":
            require("mcap", "data")
        path.open("wb").close()  # what cannot be written is refused at once
        self._process = WritingProcess("from haptic_fieldbus.running.rows import main; main()", str(path))
        self._process.take(pickle.dumps((list(columns), dict(units), provenance)))

    def take(self, octets: bytes) -> None:
        self._process.take(pickle.dumps(octets))

    def close(self, provenance: str | None) -> None:
        try:
            if provenance is not None:
                self._process.take(pickle.dumps(provenance))
        finally:
            self._process.close()


def kind_of_file(path: Path) -> Callable[[Path, Sequence[str], Mapping[str, str], str], RowFile]:
    """Return the class of a file that this process writes."""
    if path.suffix != ".mcap":
        return CsvFile
    from haptic_fieldbus.recordings.mcap import McapFile

    return McapFile


class Rows:
    """The file of rows of a run, if it has one; `fault` is the reason of an early end of the file, or None."""

    def __init__(
        self, record: "Record", path: Path | None, *, simulated: bool, provenance: Provenance | None = None
    ) -> None:
        """Begin the file; raises OSError, or UsageError without the library of its format."""
        self.fault: OSError | None = None
        self._record, self._taken = record, 0
        self._file: RowFile | None = None
        if path is not None and path.suffix in ROW_SUFFIXES:
            # Windows has no pipe that takes octets without waiting.
            direct = simulated or not hasattr(os, "fork")
            units, text = column_units(record.columns, provenance), "" if provenance is None else provenance.text()
            self._file = (kind_of_file(path) if direct else ProcessFile)(path, record.columns, units, text)

    def flush(self) -> None:
        """Pass on the new rows; a file that fails is abandoned, because the run must continue."""
        if self._file is not None and self.fault is None:
            rows, self._taken = self._record.since(self._taken), self._record.pushed
            try:
                self._file.take(rows.tobytes())
            except OSError as error:
                self.fault = error

    def close(self, provenance: Provenance | None = None) -> None:
        """Pass on the last rows and the last provenance, and finish the file."""
        self.flush()
        if self._file is not None:
            try:
                text = "" if provenance is None else provenance.text()
                self._file.close(text if self.fault is None else None)
            except OSError as error:
                self.fault = error  # of the disk itself, so it says more than that of the pipe


# The process that writes a file while a run goes on. On standard input it gets columns, units and provenance, then rows
# as octets, and at the end of the run the last provenance as a text.


def _pieces() -> Iterator[Any]:
    """Yield each value that comes; one that is cut off at the end is left out."""
    with suppress(EOFError, pickle.UnpicklingError):
        while True:
            yield pickle.load(sys.stdin.buffer)


def main() -> None:
    """Write the pieces that come on standard input."""
    try:
        pieces, path = _pieces(), Path(sys.argv[1])
        last: str | None = None  # as it stays when the run was killed
        begin = next(pieces, None)
        if begin is None:
            return
        file = kind_of_file(path)(path, *begin)
        for piece in pieces:
            if isinstance(piece, bytes):
                file.take(piece)
            else:
                last = piece
        file.close(last)
    except (OSError, UsageError) as error:
        sys.exit(getattr(error, "strerror", None) or str(error))
