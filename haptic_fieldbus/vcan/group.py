"""Process group that ends with its runner, even when that is killed."""

import os
import selectors
import signal
import subprocess
from collections.abc import Mapping, Sequence
from contextlib import suppress
from math import inf
from pathlib import Path
from time import monotonic

from haptic_fieldbus.errors import VcanError

CANNOT_RUN, SIGNALLED = 126, 128
"""Exit statuses, as env(1) and the shell have them; to the second the number of the signal is added."""

# Standard input brings the program's process number and ends with the runner, which alone can write to it. $1: a folder
# to remove then. User-Mode Linux puts itself into another process group, and its helpers outlive it.
WATCHER = """
trap '' HUP INT TERM
read -r program && read -r _
[ -z "$program" ] || kill -s KILL -- "-$program"
[ -z "$1" ] || rm -rf "$1"
kill -s KILL 0
"""


def waited(selector: selectors.BaseSelector, deadline: float, wakeup: int) -> set[int]:
    """Wait until a time of the monotonic clock [s], and return what can be read; `wakeup` is emptied."""
    seconds = None if deadline == inf else max(0.0, deadline - monotonic())
    ready = {key.fd for key, _ in selector.select(seconds)}
    if wakeup in ready:
        os.read(wakeup, 1024)
    return ready


class ProcessGroup:
    """A program in a process group of its own, with a shell in it that waits for the end of the runner."""

    def __init__(
        self,
        words: Sequence[str],
        environment: Mapping[str, str],
        *,
        folder: Path | str = "",
        keep: Sequence[int] = (),
        output: int | None = None,
    ) -> None:
        """Start it; it keeps the file descriptors in `keep`, and `output` is its standard output and error.

        Without `output` it has those of the runner. `folder` is removed when the runner is killed.
        """
        reading, self._lifeline = os.pipe()
        self._watcher = subprocess.Popen(
            ["/bin/sh", "-c", WATCHER, "sh", str(folder)],
            stdin=reading,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            process_group=0,
        )
        os.close(reading)
        try:
            self._process = subprocess.Popen(
                words,
                env=environment,
                pass_fds=keep,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=output,
                process_group=self._watcher.pid,
            )
        except OSError as error:
            self._end_watcher()
            raise VcanError(f"{words[0]} cannot be started: {error.strerror}", CANNOT_RUN) from error
        os.write(self._lifeline, f"{self._process.pid}\n".encode())
        self.ended = os.pidfd_open(self._process.pid)
        """Readable once the program has ended."""

    def status(self) -> int | None:
        """Return the exit status, 128 + number for a signal; None while it runs."""
        code = self._process.poll()
        return code if code is None or code >= 0 else SIGNALLED - code

    def send(self, number: signal.Signals) -> None:
        """Send a signal to the group; the waiting shell ignores those that ask for an end."""
        os.killpg(self._watcher.pid, number)

    def close(self) -> None:
        """Kill what is left of the group."""
        if self._process.returncode is None:  # else its number may be that of another process by now
            with suppress(ProcessLookupError):
                os.killpg(self._process.pid, signal.SIGKILL)
        self._end_watcher()
        self._process.wait()
        os.close(self.ended)

    def _end_watcher(self) -> None:
        """It ends with all others of its group."""
        os.killpg(self._watcher.pid, signal.SIGKILL)
        self._watcher.wait()
        os.close(self._lifeline)
