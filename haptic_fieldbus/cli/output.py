"""Standard output and standard error that never block the end of a command and never fail for a missing character.

- *A reader that does not read* (Ctrl-S at a terminal, a full pipe) blocks a program that writes. A run from enabling
  on, a command that hosts drives (`never_wait`) and a command that a signal ends must not wait: a thread writes their
  output and waits instead. At the end of the command the thread has `PATIENCE` for each piece; if a reader takes
  nothing for this time, its stream is abandoned and the rest is dropped.
- *A reader that is gone* (a closed pipe or terminal) ends any other command. It does not end these three: the exit
  status stays that of the run.
- *A character that the encoding of the stream lacks* is spelt in ASCII: "N·m" as "N.m". JSON has escapes of its own.
"""

import codecs
import io
import sys
import threading
import unicodedata
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from time import sleep
from typing import TextIO, cast

PATIENCE = 5.0
"""Longest time that the end of a command waits for a reader that takes nothing [s]."""
PIECE = 1024
"""Octets that are written at once: a slow terminal takes them well within `PATIENCE`."""
NAP = 0.01
"""Time between two attempts at a stream that another program made non-blocking [s]."""
SPELT = {
    "·": ".", "⋅": ".", "−": "-", "–": "-", "—": "-", "→": "->", "←": "<-", "≤": "<=", "≥": ">=", "±": "+/-",
    "×": "x", "√": "sqrt ", "∞": "inf", "Ω": "ohm", "µ": "u", "μ": "u", "°": "deg", "‰": " per mille", "π": "pi",
    "ω": "omega", "τ": "tau", "“": '"', "”": '"', "’": "'", "′": "'", "─": "-", "│": "|", "├": "+", "└": "+",
}  # fmt: skip
"""ASCII spelling of characters in our texts; for others the ASCII part of their compatibility decomposition is used."""
IN_ASCII = "haptic_fieldbus.in_ascii"
"""Name of the error handler that spells characters in ASCII."""


def in_ascii(error: UnicodeError) -> tuple[str, int]:
    """Spell the characters that could not be encoded, "?" for those that have no spelling (see `codecs`)."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    return "".join(map(_spelt, error.object[error.start : error.end])), error.end


def _spelt(character: str) -> str:
    parts = unicodedata.normalize("NFKD", character).encode("ascii", "ignore").decode("ascii")
    return SPELT.get(character) or parts or "?"


class OutputThread:
    """A thread that writes pieces in order, so that no other thread waits for their readers."""

    def __init__(self) -> None:
        self._pieces: deque[tuple[io.RawIOBase, bytes]] = deque()
        self._lost: set[int] = set()
        """Abandoned streams."""
        self.fault: OSError | None = None
        """Error by which output was lost, other than that of a reader who wanted no more."""
        self._changed = threading.Condition()
        self._thread: threading.Thread | None = None

    def note(self, fault: Exception) -> None:
        """Note that output is lost, unless because its reader wanted no more."""
        if isinstance(fault, OSError) and not isinstance(fault, BrokenPipeError):
            self.fault = fault

    @property
    def busy(self) -> bool:
        """True while there are octets left to write."""
        return bool(self._pieces)

    @property
    def at_work(self) -> bool:
        """True after the first piece; later pieces must then go through the thread too."""
        return self._thread is not None

    def take(self, stream: io.RawIOBase, octets: bytes) -> None:
        """Take octets to be written; returns at once."""
        with self._changed:
            self._pieces.extend((stream, octets[at : at + PIECE]) for at in range(0, len(octets), PIECE))
            if self._thread is None:
                self._begin()
            self._changed.notify_all()

    def finish(self, patience: float) -> None:
        """Wait until all is written; abandon a stream that takes nothing for this time [s]."""
        with self._changed:
            while self._pieces:
                if not self._changed.wait_for(self._gone_on(self._pieces[0]), patience):
                    self._lost.add(id(self._pieces[0][0]))
                    self._begin()  # the thread before this one waits for ever, and ends with the process
            self._thread = None
            self._changed.notify_all()

    def _gone_on(self, piece: tuple[io.RawIOBase, bytes]) -> Callable[[], bool]:
        return lambda: not self._pieces or self._pieces[0] is not piece

    def _begin(self) -> None:
        self._thread = threading.Thread(target=self._work, name="output", daemon=True)
        self._thread.start()

    def _work(self) -> None:
        me = threading.current_thread()
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._pieces or self._thread is not me)
                if self._thread is not me:
                    return
                stream, octets = self._pieces[0]
                lost = id(stream) in self._lost
            fault = None if lost else _fault_of(stream, octets)
            with self._changed:
                if self._thread is not me:
                    return
                if fault is not None:
                    self._lost.add(id(stream))
                    self.note(fault)
                self._pieces.popleft()
                self._changed.notify_all()


def _fault_of(stream: io.RawIOBase, octets: bytes) -> Exception | None:
    """Write all octets; return why that was impossible, None if it was possible."""
    try:
        while octets:
            count = stream.write(octets)
            octets = octets[count or 0 :]
            if count is None:
                sleep(NAP)
    except (OSError, ValueError) as error:  # ValueError: the stream was closed
        return error
    return None


class OutputStream(io.RawIOBase):
    """A stream that is written directly, or by the thread once `leaving()` is True."""

    def __init__(self, stream: io.RawIOBase, thread: OutputThread, leaving: Callable[[], bool]) -> None:
        self._stream, self._thread, self._leaving = stream, thread, leaving
        self.waits = True
        """False: the thread always writes."""
        self._gone = False
        """True: the reader has closed its end. The writer has had its error once, and the rest is dropped."""

    def writable(self) -> bool:
        return True

    def isatty(self) -> bool:
        return self._stream.isatty()

    def fileno(self) -> int:
        return self._stream.fileno()

    @property
    def behind(self) -> bool:
        """True while output waits for a reader."""
        return self._thread.busy

    def write(self, octets: object) -> int | None:
        piece = bytes(cast(bytes, octets))
        if self._gone:
            return len(piece)
        if self.waits and not self._thread.at_work and not self._leaving():
            try:
                return self._stream.write(piece)
            except BrokenPipeError:
                self._gone = True
                raise
            except OSError as error:  # such as a full disk: the command goes on to its end
                self._gone = True
                self._thread.note(error)
                return len(piece)
        self._thread.take(self._stream, piece)
        return len(piece)


def _under(stream: TextIO) -> OutputStream | None:
    raw = getattr(getattr(stream, "buffer", None), "raw", None)
    return raw if isinstance(raw, OutputStream) else None


def behind(stream: TextIO) -> bool:
    """Return whether written output still waits for its reader."""
    raw = _under(stream)
    return raw is not None and raw.behind


def asks_at_terminal() -> bool:
    """Return whether standard input is a terminal, so that a person can answer; it may have been closed before."""
    return sys.stdin is not None and sys.stdin.isatty()


def never_wait() -> None:
    """Let no reader of standard output and standard error hold up this command from now on."""
    for raw in filter(None, map(_under, (sys.stdout, sys.stderr))):
        raw.waits = False


@contextmanager
def free_output(leaving: Callable[[], bool]) -> Iterator[OutputThread]:
    """Replace standard output and standard error inside the block by streams that never block its end.

    After the block, `fault` of the value says why output was lost. A stream that was closed before is thrown away.
    A stream without a file, as in some tests, only gets the spelling of characters.
    """
    codecs.register_error(IN_ASCII, in_ascii)
    thread, before = OutputThread(), (sys.stdout, sys.stderr)
    sys.stdout, sys.stderr = (_stream(stream or io.StringIO(), thread, leaving) for stream in before)
    try:
        yield thread
    finally:
        for stream in (sys.stdout, sys.stderr):
            with suppress(OSError, ValueError):
                stream.flush()
        thread.finish(PATIENCE)
        sys.stdout, sys.stderr = before


def _stream(stream: TextIO, thread: OutputThread, leaving: Callable[[], bool]) -> TextIO:
    if not isinstance(stream, io.TextIOWrapper):
        return stream
    buffer = stream.buffer
    raw = buffer if isinstance(buffer, io.RawIOBase) else getattr(buffer, "raw", None)
    if not isinstance(raw, io.RawIOBase):
        stream.reconfigure(errors=IN_ASCII)
        return stream
    stream.flush()
    return io.TextIOWrapper(
        io.BufferedWriter(OutputStream(raw, thread, leaving)),
        encoding=stream.encoding,
        errors=IN_ASCII,
        line_buffering=stream.line_buffering,
        write_through=stream.write_through,
    )
