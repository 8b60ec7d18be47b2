"""Guest kernel: started, listened to, and ended with all of its processes, however its runner ends."""

import os
import selectors
import signal
import tempfile
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from haptic_fieldbus.errors import VcanError
from haptic_fieldbus.vcan.group import ProcessGroup, waited
from haptic_fieldbus.vcan.needs import KERNEL, program

MEMORY_MB = 1024
"""Of the guest. It takes from the host what it uses, in a file without a name."""
SHARED_MEMORY = Path("/dev/shm")
LAST_WORDS = 8
"""Lines of what the guest kernel said last, told when it fails."""
CHUNK = 65536

Sink = Callable[[bytes], None]


@dataclass
class GuestReports:
    """What the first program of the guest has said so far, and the kernel."""

    ready: bool = False
    status: int | None = None
    failed: str | None = None
    unwritten: list[str] = field(default_factory=list)
    kernel: bytes = b""
    _line: bytes = b""

    def hear(self, octets: bytes) -> None:
        """Take in what came on the status line."""
        *lines, self._line = (self._line + octets).split(b"\n")
        for line in lines:
            match os.fsdecode(line).strip().split(" ", 1):
                case ["ready"]:
                    self.ready = True
                case ["failed", why]:
                    self.failed = why
                case ["unwritten", folder]:
                    self.unwritten.append(folder)
                case ["status", number]:
                    self.status = int(number)

    def hear_kernel(self, octets: bytes) -> None:
        """Keep the end of what the kernel said."""
        self.kernel = (self.kernel + octets)[-CHUNK:]


class Guest:
    """A running guest kernel, and the pipes to it."""

    def __init__(self, folder: Path, output: Sink, error: Sink, wakeup: int) -> None:
        """Start it with the folder of its job; what the command writes goes to the two sinks.

        Raises VcanError when there is no room for its memory.
        """
        environment = {"PATH": os.environ.get("PATH", os.defpath), "TMPDIR": memory_folder(), "HOME": str(folder)}
        self.heard = GuestReports()
        self._wakeup = wakeup
        self._sinks: dict[int, Sink] = {}
        self._selector = selectors.DefaultSelector()
        status, out, err, kernel = map(self._pipe, (self.heard.hear, output, error, self.heard.hear_kernel))
        control, self._control = os.pipe()
        words = command_line(folder, {"ssl0": (control, status), "con1": ("null", out), "con2": ("null", err)})
        inherited = (status, out, err, kernel, control)
        self._group = ProcessGroup(words, environment, folder=folder, keep=inherited, output=kernel)
        for descriptor in inherited:
            os.close(descriptor)
        for descriptor in (self._group.ended, wakeup):
            self._selector.register(descriptor, selectors.EVENT_READ)

    @property
    def ready(self) -> bool:
        """Whether the command has been started; raises VcanError when the guest said that it cannot be."""
        if self.heard.failed is not None:
            raise VcanError(self.heard.failed)
        return self.heard.ready

    @property
    def status(self) -> int | None:
        """Exit status of the command; raises VcanError when not all that it wrote has come to the host."""
        if self.heard.unwritten and self.heard.status is not None:
            raise VcanError(f"{', '.join(self.heard.unwritten)}: not all could be written; is the disk full?")
        return self.heard.status

    def last_words(self) -> str:
        """Return the last lines of the kernel, indented, each after a line feed."""
        lines = self.heard.kernel.decode(errors="replace").replace("\r", "").splitlines()
        return "".join(f"\n  {line}" for line in lines[-LAST_WORDS:])

    def turn(self, deadline: float) -> bool:
        """Pass on what comes until a time of the monotonic clock [s] or a signal; False once the guest has ended."""
        ready = waited(self._selector, deadline, self._wakeup)
        for descriptor in ready & self._sinks.keys():
            self._pass_on(descriptor)
        return self._group.ended not in ready

    def send(self, number: signal.Signals) -> None:
        """Let the command have a signal."""
        with suppress(BrokenPipeError):
            os.write(self._control, f"{number.name.removeprefix('SIG')}\n".encode())

    def close(self) -> None:
        """End the guest at once if it has not ended, and pass on what it had said."""
        self._group.close()
        try:
            for descriptor in list(self._sinks):
                while self._pass_on(descriptor):
                    pass
        finally:
            self._selector.close()
            for descriptor in (*self._sinks, self._control):
                os.close(descriptor)

    def _pipe(self, sink: Sink) -> int:
        """Return the writing end of a pipe into a sink."""
        reading, writing = os.pipe()
        self._sinks[reading] = sink
        self._selector.register(reading, selectors.EVENT_READ)
        return writing

    def _pass_on(self, descriptor: int) -> bool:
        """Pass on what is there; False at the end, after which nobody listens any more."""
        octets = os.read(descriptor, CHUNK)
        if octets:
            self._sinks[descriptor](octets)
            return True
        self._selector.unregister(descriptor)
        del self._sinks[descriptor]
        os.close(descriptor)
        return False


def memory_folder() -> str:
    """Return a folder for the file that is the guest's memory: of shared memory where there is room, else temporary.

    Raises VcanError when neither has room: the kernel would end without a word once it is full.
    """
    free = {}
    for folder in (SHARED_MEMORY, Path(tempfile.gettempdir())):
        if folder.is_dir() and os.access(folder, os.W_OK | os.X_OK):
            about = os.statvfs(folder)
            free[folder] = about.f_bavail * about.f_frsize // 2**20
            if free[folder] >= MEMORY_MB and not about.f_flag & os.ST_NOEXEC:
                return str(folder)
    room = ", ".join(f"{folder} has {megabytes}" for folder, megabytes in free.items()) or "none can be written"
    raise VcanError(
        f"the guest kernel needs a folder with {MEMORY_MB} MB free for its memory, in which programs may run: {room}; "
        "TMPDIR names another one"
    )


def command_line(folder: Path, channels: dict[str, tuple[int | str, int]]) -> list[str]:
    """Return the words that start the kernel; `channels` are file descriptors for what it takes for terminals."""

    def channel(end: int | str) -> str:
        return f"fd:{end}" if isinstance(end, int) else end

    terminals = (f"{name}={channel(reads)},{channel(writes)}" for name, (reads, writes) in channels.items())
    return [
        program(KERNEL) or KERNEL,
        f"mem={MEMORY_MB}M",
        *("rootfstype=hostfs", "rootflags=/", "ro"),
        *("con=null", "ssl=null", "con0=null,fd:1", *terminals),
        *("quiet", f"uml_dir={folder}/", "umid=guest"),
        *("init=/bin/sh", "--", f'"{folder}/init"', f'"{folder}"'),
    ]
