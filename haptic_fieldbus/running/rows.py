"""Files of rows (.csv): one line a period, written while the run goes on.

In virtual time the loop itself writes, because nothing waits for it. On a real bus another process does: a tenth of a
second at a time, the loop hands it the rows through a pipe that never makes it wait. The process outlives a run that is
killed, and writes all rows that were handed over.
"""

import os
import subprocess
import sys
from array import array
from collections.abc import Sequence
from pathlib import Path
from select import select
from time import monotonic
from typing import TYPE_CHECKING, Protocol

from haptic_fieldbus.buses.log_file import LogFile

if TYPE_CHECKING:  # imported for its type alone: the writing process does without numpy
    from haptic_fieldbus.assessing.record import Record

ROW_SUFFIXES = (".csv",)
"""Suffixes of files of rows."""
PIPE = 1 << 20
"""[octets] that may wait for the disk: ten seconds of rows at 1 kHz."""
PARTING = 30.0
"""Longest time for which the end of the run waits for the disk [s]."""


class RowFile(Protocol):
    """A file that takes rows while the loop runs."""

    def take(self, record: "Record") -> None:
        """Take the rows pushed since the last call; raises OSError when no more can be taken."""

    def close(self) -> None:
        """Finish the file; raises OSError when it is not complete."""


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

    def close(self) -> None:
        self._file.close()


class ProcessRows:
    """A file that another process writes; `take` never waits for it."""

    def __init__(self, path: Path, columns: Sequence[str]) -> None:
        path.open("wb").close()  # what cannot be written is refused at once
        self._process = subprocess.Popen(
            [sys.executable, "-c", "from haptic_fieldbus.running.rows import main; main()", str(path), *columns],
            bufsize=0,
            stdin=subprocess.PIPE,
            stderr=subprocess.PIPE,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
            start_new_session=True,  # Ctrl-C at the terminal ends the run, not the file
        )
        self._pipe = self._process.stdin.fileno() if self._process.stdin is not None else -1
        os.set_blocking(self._pipe, False)
        self._taken = 0
        self._rest = b""

    def take(self, record: "Record") -> None:
        self._rest += record.since(self._taken).tobytes()
        self._taken = record.pushed
        self._pass_on()
        if len(self._rest) > PIPE:
            raise OSError("the disk is too slow")

    def _pass_on(self) -> None:
        """Hand over as much as the pipe takes now; raises BrokenPipeError when nobody reads it."""
        try:
            while self._rest:
                self._rest = self._rest[os.write(self._pipe, self._rest) :]
        except BlockingIOError:
            pass

    def close(self) -> None:
        end = monotonic() + PARTING
        try:
            while self._rest and select([], [self._pipe], [], max(0.0, end - monotonic()))[1]:
                self._pass_on()
        except BrokenPipeError:
            pass  # the process tells why
        try:
            _, told = self._process.communicate(timeout=max(1.0, end - monotonic()))
        except subprocess.TimeoutExpired:
            raise OSError(f"the disk did not take the last rows within {PARTING:g} s") from None
        if self._process.returncode or self._rest:
            raise OSError(told.decode(errors="replace").strip() or "its writing process was killed")


class Rows:
    """The file of rows of a run, if it has one; `fault` is what ended it before the run, None: nothing."""

    def __init__(self, record: "Record", path: Path | None, *, simulated: bool) -> None:
        """Begin the file; raises OSError."""
        self.fault: OSError | None = None
        self._record = record
        self._file: RowFile | None = None
        if path is not None and path.suffix in ROW_SUFFIXES:
            self._file = (DirectRows if simulated else ProcessRows)(path, record.columns)

    def flush(self) -> None:
        """Pass on the new rows; a file that fails is left, because the run must go on."""
        if self._file is not None and self.fault is None:
            try:
                self._file.take(self._record)
            except OSError as error:
                self.fault = error

    def close(self) -> None:
        """Pass on the last rows and finish the file."""
        self.flush()
        if self._file is not None:
            try:
                self._file.close()
            except OSError as error:
                self.fault = error  # of the disk itself, so it says more than that of the pipe


def heading(columns: Sequence[str]) -> bytes:
    """Return the first line."""
    return (",".join(columns) + "\n").encode()


def row_line(row: Sequence[float]) -> bytes:
    """Return the line of a row: the shortest texts that read back as the same numbers, whole ones without ".0"."""
    return (",".join([repr(value).removesuffix(".0") for value in row]) + "\n").encode()


def main() -> None:
    """Write the rows that come on standard input, doubles of this machine, to the file named by the first argument."""
    path, *columns = sys.argv[1:]
    try:
        _write_all(LogFile(Path(path)), columns)
    except OSError as error:
        sys.exit(error.strerror or str(error))


def _write_all(file: LogFile, columns: Sequence[str]) -> None:
    """Write each row as soon as it has come; raises OSError."""
    file.add(heading(columns))
    size = 8 * len(columns)
    waiting = b""
    while octets := os.read(0, PIPE):
        waiting += octets
        whole = len(waiting) // size * size
        values, waiting = array("d", waiting[:whole]), waiting[whole:]
        for first in range(0, len(values), len(columns)):
            file.add(row_line(values[first : first + len(columns)]))
        file.flush()
    file.close()
