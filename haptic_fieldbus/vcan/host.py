"""Virtual CAN interfaces of this kernel: found as they are, or made for a while."""

import os
import selectors
import signal
import subprocess
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.vcan.group import ProcessGroup, waited

NET = Path("/sys/class/net")
UP = 0x1
"""IFF_UP of netdevice(7)."""


def is_up(interface: str) -> bool:
    """Whether an interface of this name exists and is up."""
    try:
        return bool(int((NET / interface / "flags").read_text(), 16) & UP)
    except FileNotFoundError:
        return False


@contextmanager
def lent(interfaces: Sequence[str]) -> Iterator[bool]:
    """Yield whether all of them are up as vcan; what had to be made or set up for that is taken back at the end.

    Raises UsageError when one exists and is no vcan.
    """
    with ExitStack() as taken_back:
        yield all(_lend(interface, taken_back) for interface in interfaces)


def _lend(interface: str, taken_back: ExitStack) -> bool:
    """Whether it is up now, as a vcan; that takes the right to change interfaces unless it was so before."""
    if not (NET / interface).exists():
        if not _add(interface):
            return False
        taken_back.callback(_ip, "link", "del", interface)
    elif not _is_vcan(interface):
        raise UsageError(
            f'interface "{interface}" exists and is no vcan: commands may do anything to theirs, so name another one'
        )
    if is_up(interface):
        return True
    taken_back.callback(_ip, "link", "set", interface, "down")
    return _ip("link", "set", interface, "up")


def _add(interface: str) -> bool:
    if _ip("link", "add", interface, "type", "vcan"):
        return True
    if hasattr(os, "geteuid") and os.geteuid() == 0:
        with suppress(FileNotFoundError):
            subprocess.run(["modprobe", "vcan"], capture_output=True, check=False)
        return _ip("link", "add", interface, "type", "vcan")
    return False


def _is_vcan(interface: str) -> bool:
    """As the kernel tells it; a file of the interface does not say."""
    return _ip("-details", "link", "show", "dev", interface, "type", "vcan", shows=interface)


def _ip(*words: str, shows: str = "") -> bool:
    """Whether `ip` from iproute2 exists, does this, and shows a text."""
    try:
        done = subprocess.run(["ip", *words], capture_output=True, text=True, check=False)
    except FileNotFoundError:
        return False
    return done.returncode == 0 and shows in done.stdout


class HostCommand:
    """A command that runs on this machine, beside its interfaces; it ends with its runner, as in a guest."""

    ready = True

    def __init__(self, command: Sequence[str], environment: Mapping[str, str], wakeup: int) -> None:
        self._wakeup = wakeup
        self._group = ProcessGroup(command, environment)
        self._selector = selectors.DefaultSelector()
        for descriptor in (self._group.ended, wakeup):
            self._selector.register(descriptor, selectors.EVENT_READ)

    @property
    def status(self) -> int | None:
        """Exit status of the command, once it has ended."""
        return self._group.status()

    def turn(self, deadline: float) -> bool:
        """Wait until a time of the monotonic clock [s] or a signal; False once the command has ended."""
        ready = waited(self._selector, deadline, self._wakeup)
        return self._group.ended not in ready

    def send(self, number: signal.Signals) -> None:
        """Let the command have a signal."""
        self._group.send(number)

    def last_words(self) -> str:
        """Return nothing: what the command says is not listened to."""
        return ""

    def close(self) -> None:
        """End what the command has left behind."""
        self._group.close()
        self._selector.close()
