"""Run one command where virtual CAN interfaces are, and give back its exit status."""

import os
import re
import shutil
import signal
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from math import inf
from pathlib import Path
from time import monotonic
from typing import Protocol

from haptic_fieldbus.errors import UsageError, VcanError
from haptic_fieldbus.vcan import host, needs
from haptic_fieldbus.vcan.group import CANNOT_RUN, SIGNALLED
from haptic_fieldbus.vcan.guest import Guest
from haptic_fieldbus.vcan.job import Job, written

TIMED_OUT, NOT_FOUND = 124, 127
"""Exit statuses, as timeout(1) and env(1) have them."""
BOOT_LIMIT_S = 60.0
"""A second is usual; a busy machine takes longer."""
GRACE_S = 10.0
"""Time that a command has to end after a signal or its time limit."""
PLACE_VARIABLE = "HAPTIC_FIELDBUS_VCAN"
"""Environment variable by which a command sees where it runs: `host` or `guest`."""
ENDING = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))
"""Signals that are passed on to the command; a second one ends it at once."""
NAME = re.compile(r"[A-Za-z0-9._-]{1,15}")
"""Of an interface, as Linux allows it, without what a shell would take for something else."""


@dataclass(frozen=True)
class Errand:
    """A command, its interfaces, folders it writes to, limit of its time [s], and whether a guest is wanted."""

    command: Sequence[str]
    interfaces: Sequence[str]
    writable: Sequence[Path] = ()
    limit_s: float = inf
    guest: bool = False


class Place(Protocol):
    """Where a command runs."""

    @property
    def ready(self) -> bool:
        """Whether the command has been started."""

    @property
    def status(self) -> int | None:
        """Exit status of the command, once it has ended."""

    def turn(self, deadline: float) -> bool:
        """Pass on what comes until a time of the monotonic clock [s] or a signal; False when the place has ended."""

    def send(self, number: signal.Signals) -> None:
        """Let the command have a signal."""

    def last_words(self) -> str:
        """Return what the place itself said last, in lines of their own."""


def run(errand: Errand, note: Callable[[str], None]) -> int:
    """Run the command, and return its exit status, or 124 when its time was up.

    `note` is told where it runs. Raises UsageError, and VcanError when it cannot be run.
    """
    _check(errand)
    if not hasattr(os, "pidfd_open"):  # not Linux, for which there is nothing but a refusal
        needs.require_guest()
    with host.lent(() if errand.guest else errand.interfaces) as there, _signals() as (arrived, wakeup):
        names = " ".join(errand.interfaces)
        if there and not errand.guest:
            note(f"{names} of this machine")
            with closing(host.HostCommand(errand.command, _environment("host"), wakeup)) as place:
                return _attend(place, errand.limit_s, arrived)
        needs.require_guest()
        job = Job(errand.command, _environment("guest"), errand.interfaces, errand.writable, _terminal())
        job.require_folders()
        note(f"{names} in a guest kernel; {_writable(errand.writable)}")
        with written(job) as folder, closing(Guest(folder, _writer(1), _writer(2), wakeup)) as guest:
            return _attend(guest, errand.limit_s, arrived)


def _attend(place: Place, limit_s: float, arrived: list[signal.Signals]) -> int:
    """Wait for the end of the command, and return its exit status.

    A signal, or SIGTERM when time is up, is passed on to it; a second one, or too long an end, ends it.
    """
    lives = place.ready or _wait(place, BOOT_LIMIT_S, arrived, lambda: place.ready)
    if arrived and not place.ready:
        return SIGNALLED + arrived[0]
    if lives and not place.ready:
        raise VcanError(f"the guest kernel was not ready within {BOOT_LIMIT_S:g} s{place.last_words()}")
    if lives and _wait(place, limit_s, arrived) and place.status is None:
        return _end(place, limit_s, arrived)
    if place.status is None:
        raise VcanError(f"the guest kernel ended before the command did{place.last_words()}")
    return place.status


def _wait(place: Place, seconds: float, arrived: list[signal.Signals], enough: Callable[[], bool] = bool) -> bool:
    """Wait until the command ends, a signal arrives, a time [s] is over or it is enough; False when the place ended."""
    deadline = monotonic() + seconds
    while place.status is None and not arrived and not enough() and monotonic() < deadline:
        if not place.turn(deadline):
            return False
    return True


def _end(place: Place, limit_s: float, arrived: list[signal.Signals]) -> int:
    """Ask the command to end, and return its exit status, or that of the signal that it did not obey in time."""
    timed_out = not arrived
    asked = signal.SIGTERM if timed_out else arrived.pop(0)
    place.send(asked)
    _wait(place, GRACE_S, arrived)
    if timed_out:
        raise VcanError(f"the command was ended after {limit_s:g} s, its time limit", TIMED_OUT)
    return SIGNALLED + asked if place.status is None else place.status


@contextmanager
def _signals() -> Iterator[tuple[list[signal.Signals], int]]:
    """Yield a list into which signals that ask for an end come, and a file descriptor that is readable then."""
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


def _check(errand: Errand) -> None:
    """Raise UsageError for names that no interface can have, and VcanError for a command that does not exist."""
    for name in errand.interfaces:
        if not NAME.fullmatch(name):
            raise UsageError(f'interface "{name}": expected 1 to 15 letters, digits, dots, dashes or underscores')
    if len(set(errand.interfaces)) < len(errand.interfaces):
        raise UsageError(f"interfaces {', '.join(errand.interfaces)}: each can be named once")
    word = errand.command[0]
    if shutil.which(word) is None:
        if "/" in word and Path(word).exists():
            raise VcanError(f"{word} is no program that this user may run", CANNOT_RUN)
        raise VcanError(f'no program "{word}"' + ("" if "/" in word else " in the folders of PATH"), NOT_FOUND)


def _environment(place: str) -> dict[str, str]:
    return {**os.environ, PLACE_VARIABLE: place}


def _terminal() -> os.terminal_size | None:
    """Size of the terminal when standard output and error both are one; else the command writes into pipes."""
    return os.get_terminal_size() if os.isatty(1) and os.isatty(2) else None


def _writable(folders: Sequence[Path]) -> str:
    """Say where a command in a guest can write to."""
    if not folders:
        return "it can write to $TMPDIR, and to no folder of the host without --out"
    return f"it can write to $TMPDIR, and on the host to {', '.join(str(folder.resolve()) for folder in folders)}"


def _writer(descriptor: int) -> Callable[[bytes], None]:
    """Return a function that writes all it is given to a file descriptor."""

    def write(octets: bytes) -> None:
        while octets:
            octets = octets[os.write(descriptor, octets) :]

    return write
