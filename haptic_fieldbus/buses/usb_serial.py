"""Serial ports: whether a path leads to one, and the latency timer of a USB adapter.

The latency timer is the time for which an FTDI chip holds back what it received (AN232B-04 of FTDI).
"""

import errno
import os
import stat
from collections.abc import Iterator
from pathlib import Path

from haptic_fieldbus.buses.scan_result import Check

SYS = Path("/sys")
LONGEST_LATENCY = 1
"""[ms]; it is 16 after plugging in."""
NO_SERIAL_LINE = "it is no serial device; expected the device of an adapter, such as /dev/ttyUSB0"
NO_SUCH_DEVICE = "no such device; plug the adapter in, or see `ls /dev/tty*`"


def leads_elsewhere(port: str, error: BaseException | None) -> bool:
    """Return whether a port could not be opened because its path leads to a file, a folder or another device."""
    # pyserial repeats an error of termios in words alone.
    if any(each.args[:1] == (errno.ENOTTY,) for each in _with_contexts(error)):
        return True
    try:
        return not stat.S_ISCHR(os.stat(port).st_mode)
    except (OSError, ValueError):  # there is nothing of this name
        return False


def is_missing(error: BaseException | None) -> bool:
    """Return whether a port could not be opened because there is no device of its name."""
    return any(getattr(each, "errno", None) == errno.ENOENT for each in _with_contexts(error))


def _with_contexts(error: BaseException | None) -> Iterator[BaseException]:
    """Yield an error, and those during whose handling it was raised."""
    while error is not None:
        yield error
        error = error.__context__


def latency_timer(port: str, root: Path = SYS) -> Check:
    """Check the latency timer of a serial port, given by name or path; `root` is the folder of sysfs."""
    name = Path(port).name
    file = root / "bus" / "usb-serial" / "devices" / name / "latency_timer"
    try:
        milliseconds = int(file.read_text(encoding="ascii"))
    except (OSError, ValueError):
        return Check("usb_latency_timer", None, f"{name} has none")
    rule = 'ACTION=="add", SUBSYSTEM=="usb-serial", DRIVER=="ftdi_sio", ATTR{latency_timer}="1"'
    advice = f"shorten it: echo 1 > {file}; for good, write {rule} into /etc/udev/rules.d/99-can.rules"
    fits = milliseconds <= LONGEST_LATENCY
    return Check("usb_latency_timer", fits, f"{milliseconds} ms", "" if fits else advice)
