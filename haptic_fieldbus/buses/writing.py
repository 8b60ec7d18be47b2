"""A process that writes a file while a run goes on, so that the loop waits for no disk and formats no text.

It is handed octets through a pipe that never makes the loop wait. It outlives a run that is killed, and writes all that
was handed over.
"""

import os
import subprocess
import sys
from collections.abc import Iterator
from select import select
from time import monotonic

PIPE = 1 << 20
"""[octets] that may wait for the disk: ten seconds of rows at 1 kHz."""
PARTING = 30.0
"""Longest time for which the end of the run waits for the disk [s]."""


class WritingProcess:
    """A process that runs `program`, a text in Python, which reads `pieces` and writes the file."""

    def __init__(self, program: str, *arguments: str) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-c", program, *arguments],
            bufsize=0,
            stdin=subprocess.PIPE,
            stderr=subprocess.PIPE,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
            start_new_session=True,  # Ctrl-C at the terminal ends the run, not the file
        )
        self._pipe = self._process.stdin.fileno() if self._process.stdin is not None else -1
        os.set_blocking(self._pipe, False)
        self._rest = b""

    def take(self, octets: bytes) -> None:
        """Hand over octets; raises OSError when the process has ended, or the disk is too slow."""
        self._rest += octets
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
        """Hand over the rest and wait for the end; raises OSError when the file is not complete."""
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


def pieces(size: int) -> Iterator[bytes]:
    """Yield what comes on standard input, whole pieces of so many octets, as soon as they are there."""
    waiting = b""
    while octets := os.read(0, PIPE):
        waiting += octets
        whole = len(waiting) // size * size
        yield waiting[:whole]
        waiting = waiting[whole:]
