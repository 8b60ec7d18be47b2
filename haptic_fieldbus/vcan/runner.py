"""Run one command with virtual CAN interfaces, and return its exit status."""

import os
import re
import shlex
import shutil
import signal
import subprocess
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import dataclass
from importlib.resources import files
from math import inf
from pathlib import Path
from time import monotonic

from haptic_fieldbus.errors import UsageError, VcanError
from haptic_fieldbus.vcan.guest import CANNOT_RUN, SIGNALLED, Guest, ProcessGroup, require_guest

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
