"""Guest kernel: its start, its output, and its end with all of its processes, however its runner ends."""

import os
import platform
import selectors
import shutil
import signal
import subprocess
import tempfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from math import inf
from pathlib import Path
from time import monotonic

from haptic_fieldbus.errors import VcanError

# Programs and modules that the guest kernel needs, and the Debian packages that bring them.

KERNEL = "linux.uml"
PROGRAMS = {KERNEL: "user-mode-linux", "insmod": "kmod", "ip": "iproute2"}
"""Program → package. Every Debian has the other programs of the guest: coreutils, util-linux, a POSIX shell."""
MODULES = Path("/usr/lib/uml/modules")
SYSTEM_FOLDERS = ("/usr/local/sbin", "/usr/sbin", "/sbin")
"""Folders on the PATH of the guest, but not of ordinary users."""
PROCESSORS = ("x86_64", "i386", "i486", "i586", "i686")


def program(name: str) -> str | None:
    """Return the path of a program, also of a program for root."""
    return shutil.which(name) or shutil.which(name, path=":".join(SYSTEM_FOLDERS))


def require_guest() -> None:
    """Raise VcanError with a remedy if no guest kernel can be started here."""
    if platform.system() != "Linux" or platform.machine() not in PROCESSORS:
        raise VcanError(
            f"no vcan on this machine. User-Mode Linux needs Linux on x86, this is {platform.system()} on "
            f"{platform.machine()}; as root, load the module by: modprobe vcan"
        )
    missing = {name: package for name, package in PROGRAMS.items() if program(name) is None}
    if missing:
        raise VcanError(
            f"no vcan on this machine, and no guest kernel without {', '.join(missing)}. Either, as root: modprobe "
            f"vcan and ip link add vcan0 type vcan; or: apt-get install {' '.join(PROGRAMS.values())}"
        )
    if not any(MODULES.glob("*/kernel/drivers/net/can/vcan.ko*")):
        raise VcanError(
            f"no vcan on this machine, and {program(KERNEL)} has no module vcan in {MODULES}; "
            "the one of Debian's package user-mode-linux has: apt-get install --reinstall user-mode-linux"
        )


# Process group that ends with its runner, even when that is killed.

CANNOT_RUN, SIGNALLED = 126, 128
"""Exit statuses of env(1) and the shell; the number of the signal is added to the second one."""

# Standard input brings the program's process number and ends with the runner, which alone can write to it. $1: a folder
# to remove then. User-Mode Linux puts itself into another process group, and its helpers outlive it.
WATCHER = """
trap '' HUP INT TERM
read -r program && read -r _
[ -z "$program" ] || kill -s KILL -- "-$program"
[ -z "$1" ] || rm -rf "$1"
kill -s KILL 0
"""


class ProcessGroup:
    """A program in its own process group, with a shell that waits for the end of the runner."""

    def __init__(
        self,
        words: Sequence[str],
        environment: Mapping[str, str],
        wakeup: int,
        *,
        folder: Path | str = "",
        keep: Sequence[int] = (),
        output: int | None = None,
    ) -> None:
        """Start the program; it keeps the file descriptors in `keep`, and `output` is its standard output and error.

        Without `output` it has those of the runner. `folder` is removed when the runner is killed. A signal makes the
        file descriptor `wakeup` readable.
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
        self._ended, self._wakeup = os.pidfd_open(self._process.pid), wakeup
        """Readable once the program has ended, and after a signal."""
        self._selector = selectors.DefaultSelector()
        for descriptor in (self._ended, wakeup):
            self._selector.register(descriptor, selectors.EVENT_READ)

    @property
    def ready(self) -> bool:
        """True when the command has been started."""
        return True

    @property
    def status(self) -> int | None:
        """Exit status of the command, 128 + number for a signal; None while it runs."""
        code = self._process.poll()
        return code if code is None or code >= 0 else SIGNALLED - code

    def last_words(self) -> str:
        """Return the end of the output where it is read: of the kernel of a guest alone."""
        return ""

    def turn(self, deadline: float) -> bool:
        """Wait until a time of the monotonic clock [s] or a signal; False once the program has ended."""
        return self._ended not in self._readable(deadline)

    def _readable(self, deadline: float) -> set[int]:
        """Wait until a time of the monotonic clock [s], and return what can be read; `wakeup` is emptied."""
        seconds = None if deadline == inf else max(0.0, deadline - monotonic())
        ready = {key.fd for key, _ in self._selector.select(seconds)}
        if self._wakeup in ready:
            os.read(self._wakeup, 1024)
        return ready

    def send(self, number: signal.Signals) -> None:
        """Send a signal to the group; the waiting shell ignores signals that request an end."""
        os.killpg(self._watcher.pid, number)

    def close(self) -> None:
        """Kill the remaining processes of the group."""
        if self._process.returncode is None:  # else its number may be that of another process by now
            with suppress(ProcessLookupError):
                os.killpg(self._process.pid, signal.SIGKILL)
        self._end_watcher()
        self._process.wait()
        self._selector.close()
        os.close(self._ended)

    def _end_watcher(self) -> None:
        """End the waiting shell with all others of its group."""
        os.killpg(self._watcher.pid, signal.SIGKILL)
        self._watcher.wait()
        os.close(self._lifeline)


MEMORY_MB = 1024
"""Memory of the guest. The used part takes space on the host, in an unnamed file."""
SHARED_MEMORY = Path("/dev/shm")
LAST_WORDS = 8
"""Number of last lines of the guest kernel in the message of its failure."""
CHUNK = 65536

Sink = Callable[[bytes], None]


@dataclass
class GuestReports:
    """Output of the first program of the guest so far, and of the kernel."""

    ready: bool = False
    status: int | None = None
    failed: str | None = None
    unwritten: list[str] = field(default_factory=list)
    kernel: bytes = b""
    _line: bytes = b""

    def hear(self, octets: bytes) -> None:
        """Read the output that arrived on the status line."""
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
        """Keep the end of the kernel's output."""
        self.kernel = (self.kernel + octets)[-CHUNK:]


class Guest(ProcessGroup):
    """A running guest kernel, and the pipes to it."""

    def __init__(self, folder: Path, output: Sink, error: Sink, wakeup: int) -> None:
        """Start the guest with the folder of its job; the command's output goes to the two sinks.

        Raises VcanError without room for its memory.
        """
        environment = {"PATH": os.environ.get("PATH", os.defpath), "TMPDIR": memory_folder(), "HOME": str(folder)}
        self.heard = GuestReports()
        self._sinks: dict[int, Sink] = {}
        status, out, err, kernel = map(self._pipe, (self.heard.hear, output, error, self.heard.hear_kernel))
        control, self._control = os.pipe()
        terminals = (f"ssl0=fd:{control},fd:{status}", f"con1=null,fd:{out}", f"con2=null,fd:{err}")
        inherited = (status, out, err, kernel, control)
        words = command_line(folder, terminals)
        super().__init__(words, environment, wakeup, folder=folder, keep=inherited, output=kernel)
        for descriptor in inherited:
            os.close(descriptor)
        for descriptor in self._sinks:
            self._selector.register(descriptor, selectors.EVENT_READ)

    @property
    def ready(self) -> bool:
        """Whether the command has been started; raises VcanError if the guest reported that it cannot start."""
        if self.heard.failed is not None:
            raise VcanError(self.heard.failed)
        return self.heard.ready

    @property
    def status(self) -> int | None:
        """Exit status of the command; raises VcanError if part of its output did not reach the host."""
        if self.heard.unwritten and self.heard.status is not None:
            raise VcanError(f"{', '.join(self.heard.unwritten)}: could not be written completely; is the disk full?")
        return self.heard.status

    def last_words(self) -> str:
        """Return the last lines of the kernel, indented, each after a line feed."""
        lines = self.heard.kernel.decode(errors="replace").replace("\r", "").splitlines()
        return "".join(f"\n  {line}" for line in lines[-LAST_WORDS:])

    def turn(self, deadline: float) -> bool:
        """Pass on output until a time of the monotonic clock [s] or a signal; False once the guest has ended."""
        ready = self._readable(deadline)
        for descriptor in ready & self._sinks.keys():
            octets = os.read(descriptor, CHUNK)
            self._sinks[descriptor](octets)
            if not octets:
                self._selector.unregister(descriptor)
                del self._sinks[descriptor]
                os.close(descriptor)
        return self._ended not in ready

    def send(self, number: signal.Signals) -> None:
        """Send a signal to the command."""
        with suppress(BrokenPipeError):
            os.write(self._control, f"{number.name.removeprefix('SIG')}\n".encode())

    def close(self) -> None:
        """End the guest at once if it still runs, and pass on its remaining output."""
        super().close()
        try:
            for descriptor, sink in self._sinks.items():
                while octets := os.read(descriptor, CHUNK):
                    sink(octets)
        finally:
            for descriptor in (*self._sinks, self._control):
                os.close(descriptor)

    def _pipe(self, sink: Sink) -> int:
        """Return the writing end of a pipe into a sink."""
        reading, writing = os.pipe()
        self._sinks[reading] = sink
        return writing


def memory_folder() -> str:
    """Return a folder for the memory file of the guest: in shared memory if there is room, otherwise temporary.

    Raises VcanError if neither has room: in a full folder the kernel would end without a message.
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
        f"the guest kernel needs a folder with {MEMORY_MB} MB of free space in which programs may run: {room}; set "
        "TMPDIR to another one"
    )


def command_line(folder: Path, terminals: Sequence[str]) -> list[str]:
    """Return the words that start the kernel; `terminals` are its terminals with their file descriptors."""
    return [
        program(KERNEL) or KERNEL,
        f"mem={MEMORY_MB}M",
        *("rootfstype=hostfs", "rootflags=/", "ro"),
        *("con=null", "ssl=null", "con0=null,fd:1", *terminals),
        *("quiet", f"uml_dir={folder}/", "umid=guest"),
        *("init=/bin/sh", "--", f'"{folder}/init"', f'"{folder}"'),
    ]
