"""Run one command with virtual CAN interfaces, and return its exit status."""

import os
import platform
import re
import selectors
import shlex
import shutil
import signal
import subprocess
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import dataclass, field
from importlib.resources import files
from math import inf
from pathlib import Path
from time import monotonic

from haptic_fieldbus.errors import UsageError, VcanError

# Guest kernel: its start, its output, and its end with all of its processes, however its runner ends.


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


# Folder in which the guest finds what it shall do, and the host's folders that it shall write to.

OWN_FOLDERS = ("/dev", "/proc", "/run", "/sys")
"""Folders that the guest has itself, so that it does not see those of the host."""
TMPDIR = "/run/tmp"
OWN_ENVIRONMENT = {
    "TMPDIR": TMPDIR,
    "XDG_CACHE_HOME": f"{TMPDIR}/cache",
    "XDG_STATE_HOME": f"{TMPDIR}/state",
    "PYTHONDONTWRITEBYTECODE": "1",
}
"""Environment of the command in the guest, besides that of the caller: folders that it can write to."""


@dataclass(frozen=True)
class GuestTask:
    """A command, its interfaces, folders it writes to, its time limit [s], and whether a guest is required."""

    command: Sequence[str]
    interfaces: Sequence[str]
    writable: Sequence[Path] = ()
    limit_s: float = inf
    guest: bool = False

    def require_folders(self) -> None:
        """Raise UsageError if a folder is missing, or hidden from the guest."""
        for folder in self.writable:
            if not folder.is_dir():
                raise UsageError(f'--out "{folder}": no such folder')
            if not os.access(folder, os.W_OK | os.X_OK):
                raise UsageError(f'--out "{folder}": no permission to write')
        for folder in (Path.cwd(), *self.writable):
            hidden = next((own for own in OWN_FOLDERS if folder.resolve().is_relative_to(own)), None)
            if hidden is not None:
                raise UsageError(f"{folder}: the guest kernel has its own {hidden}; use another folder")


@contextmanager
def written(task: GuestTask) -> Iterator[Path]:
    """Yield a folder with the first program of the guest, its settings and the command; remove it at the end.

    Raises VcanError when it cannot be written.
    """
    try:
        made = tempfile.TemporaryDirectory(prefix="haptic-fieldbus-vcan-", ignore_cleanup_errors=True)
    except OSError as error:
        raise VcanError(f"no temporary folder for the guest kernel: {error.strerror or error}") from error
    with made as name:
        folder = Path(name)
        try:
            (folder / "init").write_bytes(files("haptic_fieldbus.vcan").joinpath("guest.sh").read_bytes())
            (folder / "settings").write_bytes(os.fsencode(_settings(task)))
            (folder / "command").write_bytes(os.fsencode(_command(task)))
        except OSError as error:
            raise VcanError(f"{folder} cannot be written: {error.strerror}") from error
        yield folder


def _settings(task: GuestTask) -> str:
    """Return variables and one function, for the shell of the guest."""
    # Without a terminal at both outputs the command writes into pipes.
    columns, rows = os.get_terminal_size() if os.isatty(1) and os.isatty(2) else ("", "")
    folders = [f'"$1" {shlex.quote(str(folder.resolve()))}' for folder in task.writable]
    return (
        f"interfaces={shlex.quote(' '.join(task.interfaces))} columns={columns} rows={rows}\n"
        f"each_writable() {{\n{chr(10).join([':', *folders])}\n}}\n"
    )


def _command(task: GuestTask) -> str:
    """Return a script that executes the command; its status is 126 or 127 if the command cannot start, as in env(1)."""
    environment = {**os.environ, PLACE_VARIABLE: "guest", **OWN_ENVIRONMENT}
    words = [*(f"{name}={value}" for name, value in environment.items()), *task.command]
    return (
        "echo $$ >/run/command.pid\n"
        f"mkdir -p {TMPDIR}/cache {TMPDIR}/state\n"
        f"cd {shlex.quote(os.getcwd())} || exit 126\n"
        f"exec env -i -- {' '.join(map(shlex.quote, words))}\n"
    )


# Virtual CAN interfaces of this kernel: found as they are, or made for a while.

NET = Path("/sys/class/net")
UP = 0x1
"""IFF_UP of netdevice(7)."""


def is_up(interface: str) -> bool:
    """Return whether an interface of this name exists and is up."""
    with suppress(FileNotFoundError):
        return bool(int((NET / interface / "flags").read_text(), 16) & UP)
    return False


@contextmanager
def lent(interfaces: Sequence[str]) -> Iterator[bool]:
    """Yield whether all interfaces are up as vcan; created or changed interfaces are restored at the end.

    Raises UsageError if one exists and is no vcan.
    """
    with ExitStack() as taken_back:
        yield all(_lend(interface, taken_back) for interface in interfaces)


def _lend(interface: str, taken_back: ExitStack) -> bool:
    """Return whether the interface is up now, as a vcan; to set it up takes the right to change interfaces."""
    if not (NET / interface).exists():
        added = _ip("link", "add", interface, "type", "vcan")
        if not added and hasattr(os, "geteuid") and os.geteuid() == 0:
            with suppress(FileNotFoundError):
                subprocess.run(["modprobe", "vcan"], capture_output=True, check=False)
            added = _ip("link", "add", interface, "type", "vcan")
        if not added:
            return False
        taken_back.callback(_ip, "link", "del", interface)
    # The kernel tells the kind of an interface; none of its files does.
    elif not _ip("-details", "link", "show", "dev", interface, "type", "vcan", shows=interface):
        raise UsageError(
            f'interface "{interface}" exists and is not a vcan. The command could change it, so choose another name'
        )
    if is_up(interface):
        return True
    taken_back.callback(_ip, "link", "set", interface, "down")
    return _ip("link", "set", interface, "up")


def _ip(*words: str, shows: str = "") -> bool:
    """Return whether `ip` from iproute2 exists, succeeds, and prints a text."""
    try:
        done = subprocess.run(["ip", *words], capture_output=True, text=True, check=False)
    except FileNotFoundError:
        return False
    return done.returncode == 0 and shows in done.stdout


TIMED_OUT, NOT_FOUND = 124, 127
"""Exit statuses of timeout(1) and env(1)."""
BOOT_LIMIT_S = 60.0
"""Longest start of the guest [s]; a second is usual, a busy machine takes longer."""
GRACE_S = 10.0
"""Time for a command to end after a signal or its time limit [s]."""
PLACE_VARIABLE = "HAPTIC_FIELDBUS_VCAN"
"""Environment variable with the place of a command: `host` or `guest`."""
ENDING = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))
"""Signals that are passed on to the command; a second one ends it at once."""
NOTHING_WRITABLE = "the command can write to $TMPDIR only; for a folder of the host use --out"
NAME = re.compile(r"[A-Za-z0-9._-]{1,15}")
"""Name of an interface, as permitted by Linux, without special characters of a shell."""


def run(task: GuestTask, note: Callable[[str], None]) -> int:
    """Run the command and return its exit status, or 124 after its time limit.

    `note` gets the place where it runs. Raises UsageError, and VcanError if it cannot be run.
    """
    _check(task)
    if not hasattr(os, "pidfd_open"):  # not Linux, for which there is nothing but a refusal
        require_guest()
    with lent(() if task.guest else task.interfaces) as there, _signals() as (arrived, wakeup):
        names = " ".join(task.interfaces)
        if there and not task.guest:
            note(f"{names} of this machine")
            with closing(ProcessGroup(task.command, {**os.environ, PLACE_VARIABLE: "host"}, wakeup)) as command:
                return _attend(command, task.limit_s, arrived)
        require_guest()
        task.require_folders()
        writable = ", ".join(str(folder.resolve()) for folder in task.writable)
        told = f"it can write to $TMPDIR, and on the host to {writable}" if writable else NOTHING_WRITABLE
        note(f"{names} in a guest kernel; {told}")
        with written(task) as folder, closing(Guest(folder, _writer(1), _writer(2), wakeup)) as guest:
            return _attend(guest, task.limit_s, arrived)


def _attend(place: ProcessGroup, limit_s: float, arrived: list[signal.Signals]) -> int:
    """Wait for the end of the command, and return its exit status.

    A signal, or SIGTERM at the time limit, is passed on to it. A second signal, or a late end, kills it; the status is
    then that of the signal that it did not obey.
    """
    lives = place.ready or _wait(place, BOOT_LIMIT_S, arrived, lambda: place.ready)
    if arrived and not place.ready:
        return SIGNALLED + arrived[0]
    if lives and not place.ready:
        raise VcanError(f"the guest kernel was not ready within {BOOT_LIMIT_S:g} s{place.last_words()}")
    if lives and _wait(place, limit_s, arrived) and place.status is None:
        # The command has a while to end after a signal.
        timed_out = not arrived
        asked = signal.SIGTERM if timed_out else arrived.pop(0)
        place.send(asked)
        _wait(place, GRACE_S, arrived)
        if timed_out:
            raise VcanError(f"the command was ended at its time limit of {limit_s:g} s", TIMED_OUT)
        return SIGNALLED + asked if place.status is None else place.status
    if place.status is None:
        raise VcanError(f"the guest kernel ended before the command did{place.last_words()}")
    return place.status


def _wait(place: ProcessGroup, seconds: float, arrived: list[signal.Signals], done: Callable[[], bool] = bool) -> bool:
    """Wait for the end of the command, a signal, the end of a time [s], or `done`; False when the place ended."""
    deadline = monotonic() + seconds
    while place.status is None and not arrived and not done() and monotonic() < deadline:
        if not place.turn(deadline):
            return False
    return True


@contextmanager
def _signals() -> Iterator[tuple[list[signal.Signals], int]]:
    """Yield a list that collects signals that request an end, and a file descriptor that becomes readable then."""
    arrived: list[signal.Signals] = []
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    os.set_blocking(reading, False)
    former = {each: signal.signal(each, lambda number, _: arrived.append(signal.Signals(number))) for each in ENDING}
    former_wakeup = signal.set_wakeup_fd(writing)
    try:
        yield arrived, reading
    finally:
        signal.set_wakeup_fd(former_wakeup)
        for number, handler in former.items():
            signal.signal(number, handler)
        os.close(reading)
        os.close(writing)


def _check(task: GuestTask) -> None:
    """Raise UsageError for names that no interface can have, and VcanError for a command that does not exist."""
    for name in task.interfaces:
        if not NAME.fullmatch(name):
            raise UsageError(f'interface "{name}": expected 1 to 15 letters, digits, dots, dashes or underscores')
    if len(set(task.interfaces)) < len(task.interfaces):
        raise UsageError(f"interfaces {', '.join(task.interfaces)}: each can be named once")
    word = task.command[0]
    if shutil.which(word) is None:
        if "/" in word and Path(word).exists():
            raise VcanError(f"{word}: no permission to run it", CANNOT_RUN)
        raise VcanError(f'no program "{word}"' + ("" if "/" in word else " in the folders of PATH"), NOT_FOUND)


def _writer(descriptor: int) -> Callable[[bytes], None]:
    """Return a function that writes its argument completely to a file descriptor."""

    def write(octets: bytes) -> None:
        while octets:
            octets = octets[os.write(descriptor, octets) :]

    return write
