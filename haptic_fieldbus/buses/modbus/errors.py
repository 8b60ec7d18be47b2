"""Errors of sockets and serial ports as our own, in words; nothing else of the operating system leaves this folder."""

import errno
import socket

from haptic_fieldbus.errors import BusError, UsageError

CHECK_DRIVE = "check that the drive has power, its address and the cable"
WORDS = {
    errno.ECONNREFUSED: "nobody listens there; check address and port, and that Modbus TCP is enabled in the drive",
    errno.ECONNRESET: "the drive reset the connection, as it does when it restarts, or serves another master",
    errno.ECONNABORTED: "the connection was aborted",
    errno.EPIPE: "the drive closed the connection",
    errno.ETIMEDOUT: f"nobody answers; {CHECK_DRIVE}",
    errno.EHOSTUNREACH: f"the host cannot be reached; {CHECK_DRIVE}",
    errno.ENETUNREACH: "there is no way to that network; check the address of this computer",
    errno.ENOENT: "there is no such device; plug the adapter in, or see `ls /dev/tty*`",
    errno.EACCES: "it may not be opened; add the user to the group of the device (`ls -l`), often dialout",
    errno.EBUSY: "another program has it open",
    errno.EWOULDBLOCK: "another program has it open",
    errno.EIO: "the adapter is gone, as when it is unplugged",
    errno.ENODEV: "the adapter is gone, as when it is unplugged",
    errno.ENXIO: "the adapter is gone, as when it is unplugged",
    errno.EBADF: "it was closed",
}
"""Number of an error → its meaning on a Modbus line, and what to do."""


def port_errors() -> tuple[type[Exception], ...]:
    """Return the errors that opening and setting a serial port may raise; raises UsageError where none can be used."""
    try:
        from termios import error  # no OSError, but with number and text in the same places
    except ImportError:
        raise UsageError(
            "modbus-rtu: serial lines work under Linux and macOS only; modbus-tcp:HOST and sim-modbus-rtu work here"
        ) from None
    return OSError, error


def translate(error: Exception, subject: str) -> BusError:
    """Return an error of a socket or a serial port as a BusError that begins with `subject`."""
    if isinstance(error, socket.gaierror):
        return BusError(f"{subject}: no such host; check its name, or write its address in numbers")
    if isinstance(error, TimeoutError):
        return BusError(f"{subject}: {WORDS[errno.ETIMEDOUT]}")
    if isinstance(error, ValueError):  # by which select refuses a descriptor that was closed
        return BusError(f"{subject}: {WORDS[errno.EBADF]}")
    number = error.errno if isinstance(error, OSError) else error.args[0] if error.args else None
    words = WORDS.get(number) if isinstance(number, int) else None
    return BusError(f"{subject}: {words or getattr(error, 'strerror', None) or error}")
