"""The way of octets between master and drives: the contract, TCP, serial ports, and their errors."""

import errno
import os
import select
import socket
from collections.abc import Callable
from contextlib import suppress
from itertools import islice
from typing import Protocol

import serial

from haptic_fieldbus.buses.usb_serial import NO_SERIAL_LINE, NO_SUCH_DEVICE, leads_elsewhere
from haptic_fieldbus.clock import Clock
from haptic_fieldbus.errors import BusError, UsageError
from haptic_fieldbus.protocols.modbus.profile import Parity

# Errors of sockets and serial ports as our own, in words; nothing else of the operating system leaves this folder.

CHECK_DRIVE = "check that the drive has power, its address and the cable"
WORDS = {
    errno.ECONNREFUSED: "no server at this address; check address and port, and that Modbus TCP is enabled in the "
    "drive",
    errno.ECONNRESET: "the drive reset the connection: it restarted, or serves another master",
    errno.ECONNABORTED: "the connection was aborted",
    errno.EPIPE: "the drive closed the connection",
    errno.ETIMEDOUT: f"no answer; {CHECK_DRIVE}",
    errno.EHOSTUNREACH: f"host unreachable; {CHECK_DRIVE}",
    errno.ENETUNREACH: "no route to that network; check the address of this computer",
    errno.ENOENT: NO_SUCH_DEVICE,
    errno.EACCES: "no permission; add the user to the group of the device (`ls -l`), often dialout",
    errno.EBUSY: "another program has it open",
    errno.EWOULDBLOCK: "another program has it open",
    errno.EIO: "the adapter is gone (unplugged?)",
    errno.ENODEV: "the adapter is gone (unplugged?)",
    errno.ENXIO: "the adapter is gone (unplugged?)",
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


def translate(error: Exception, subject: str, port: str | None = None) -> BusError:
    """Return an error of a socket, or of a serial `port`, as a BusError that begins with `subject`."""
    if port is not None and leads_elsewhere(port, error):
        return BusError(f"{subject}: {NO_SERIAL_LINE}")
    if isinstance(error, socket.gaierror | UnicodeError):  # a name with an empty or a long part is the latter
        return BusError(f"{subject}: no such host; check its name, or write its address in numbers")
    if isinstance(error, TimeoutError):
        return BusError(f"{subject}: {WORDS[errno.ETIMEDOUT]}")
    if isinstance(error, ValueError):  # by which select refuses a descriptor that was closed
        return BusError(f"{subject}: {WORDS[errno.EBADF]}")
    number = error.errno if isinstance(error, OSError) else error.args[0] if error.args else None
    words = WORDS.get(number) if isinstance(number, int) else None
    return BusError(f"{subject}: {words or getattr(error, 'strerror', None) or error}")


# Modbus TCP: one connection to one host, over a socket that never makes the loop wait longer than it asks to.
#
# On TCP no octet is lost: a segment that was lost comes late, by 200 ms and more, and until then nothing else comes.
# What is sent meanwhile would only queue up, so the master keeps to one request under way (`requester`).
#
# Many servers leave Nagle's algorithm on: while a part of what they sent is not acknowledged, they hold back the next
# small segment. Our acknowledgement rides on our next request, or goes out by itself after `DELAYED_ACK`. So when more
# is waited for than has come, what has come is acknowledged at once (TCP_QUICKACK). The usual exchange, one request and
# one whole answer, needs and does none of this.
#
# Reference: MODBUS Messaging on TCP/IP Implementation Guide 1.0b, 4.3.2 (TCP_NODELAY); RFC 1122, 4.2.3.2 and 4.2.3.4
# (delayed acknowledgement, Nagle's algorithm); tcp(7), TCP_QUICKACK.

CONNECTING, RECONNECTING = 3.0, 0.01
"""Longest time for a connection [s]: at first, and on the way to zero."""
DELAYED_ACK = 0.04
"""Time after which a computer acknowledges by itself what it has received [s]: TCP_DELACK_MIN of Linux (net/tcp.h)."""
QUICKACK: int | None = getattr(socket, "TCP_QUICKACK", None)
"""Option by which an acknowledgement goes out at once; None where the system has none: Linux alone has it."""
MOST_RECEPTIONS = 64
"""Largest number of receptions of what waits: a peer may go on sending."""
LARGEST = 260
"""Octets that are taken at once: the longest answer. More would be room that is given back each time."""
NUMERIC = socket.NI_NUMERICHOST | socket.NI_NUMERICSERV
"""Asks for a host and a port by numbers; a link-local address of IPv6 keeps its interface."""


def gathered(receive: Callable[[], bytes]) -> bytes:
    """Return what waits, up to `MOST_RECEPTIONS` of a function that returns nothing where nothing waits."""
    return b"".join(islice(iter(receive, b""), MOST_RECEPTIONS))


class TcpTransport:
    """A connection to `address`, a host and a port; raises BusError when there is none."""

    serial = False

    def __init__(self, name: str, address: tuple[str, int], clock: Clock) -> None:
        self.name = name
        self._address: tuple[str, int | str] = address
        """Host and port; by numbers since the first connection, as to look up a name again may take seconds."""
        self._now_ns = clock.now_ns
        self._open(CONNECTING)

    def _open(self, seconds: float) -> None:
        try:
            self._socket = socket.create_connection(self._address, seconds)
            self._address = socket.getnameinfo(self._socket.getpeername(), NUMERIC)
        except (OSError, UnicodeError) as error:
            raise translate(error, f"cannot connect to {self.name}") from error
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._socket.setblocking(False)
        self._poll = select.poll() if hasattr(select, "poll") else None  # Windows has none
        if self._poll is not None:
            self._poll.register(self._socket, select.POLLIN)
        self._unacknowledged = False
        """Whether octets came since the last request."""

    def tune(self, baud: int, parity: Parity, stop_bits: int) -> None:
        """Do nothing: a network has its own speed."""

    def discard(self) -> bytes:
        return gathered(self._taken)

    def send(self, frame: bytes | bytearray) -> None:
        try:
            sent = self._socket.send(frame)
            self._unacknowledged = False  # the request carries the acknowledgement
        except BlockingIOError:
            sent = 0
        except OSError as error:
            raise translate(error, self.name) from error
        if sent < len(frame):
            raise BusError(f"{self.name}: the drive accepts no more requests")

    def receive(self, deadline_ns: int) -> bytes:
        try:
            if self._unacknowledged:
                # Acknowledge what has come, as more is waited for: the drive may hold it back until then.
                self._unacknowledged = False
                if QUICKACK is not None:
                    # It lasts until the kernel changes its mind, so it is set each time.
                    self._socket.setsockopt(socket.IPPROTO_TCP, QUICKACK, 1)
            wait_ns = deadline_ns - self._now_ns()
            # poll is twice as fast as select, but counts in milliseconds: select waits for the rest.
            if self._poll is not None and wait_ns >= 1_000_000 and self._poll.poll(wait_ns // 1_000_000):
                return self._taken()
            wait_ns = max(0, deadline_ns - self._now_ns())
            return self._taken() if select.select((self._socket,), (), (), wait_ns * 1e-9)[0] else b""
        except (OSError, ValueError) as error:
            raise translate(error, self.name) from error

    def _taken(self) -> bytes:
        try:
            octets = self._socket.recv(LARGEST)
        except BlockingIOError:
            return b""
        except OSError as error:
            raise translate(error, self.name) from error
        if not octets:
            raise BusError(f"{self.name}: the drive closed the connection, as it does when it restarts")
        self._unacknowledged = True
        return octets

    def reopen(self) -> None:
        self.close()
        self._open(RECONNECTING)

    def close(self) -> None:
        with suppress(OSError):
            self._socket.close()


# Modbus RTU: a serial port, RS-485 or RS-232, read and written without waiting.
#
# pyserial opens the port and sets bit rate and characters. The lines RTS and DTR stay as the system has them, since
# adapters turn their driver on by themselves, and a kernel that does it by RTS was told so by somebody else.
#
# A port that is gone reads as readable without octets, or fails with EIO. A pseudo-terminal has no parity and refuses
# to be told one, so it keeps its own characters.

PARITIES = {"none": serial.PARITY_NONE, "even": serial.PARITY_EVEN, "odd": serial.PARITY_ODD}
PSEUDO_TERMINALS = range(136, 144)
"""Major numbers of the devices /dev/pts/* (Linux, admin-guide/devices.txt)."""
CLOSED = -1


class SerialTransport:
    """The serial port `device`, held by this program alone; raises BusError when it cannot be opened.

    Raises UsageError on a system whose ports have no descriptors (Windows).
    """

    serial = True

    def __init__(self, name: str, device: str, clock: Clock) -> None:
        self.name = name
        self._clock = clock
        self._errors = port_errors()
        self._port = serial.Serial(timeout=0, write_timeout=0, exclusive=True)
        self._port.port = device
        self._open()

    def _open(self) -> None:
        try:
            self._port.open()
        except self._errors as error:  # pyserial's own errors are among them
            raise translate(error, f"cannot open {self.name}", str(self._port.port)) from error
        with suppress(OSError, ValueError):  # not every driver knows of it
            self._port.set_low_latency_mode(True)
        self._number = self._port.fileno()

    def tune(self, baud: int, parity: Parity, stop_bits: int) -> None:
        try:
            self._port.baudrate = baud
            if os.major(os.fstat(self._number).st_rdev) not in PSEUDO_TERMINALS:
                self._port.parity, self._port.stopbits = PARITIES[parity], stop_bits
        except ValueError as error:
            raise BusError(f"{self.name} at {baud} bit/s: {error}") from error
        except self._errors as error:
            raise translate(error, f"{self.name} at {baud} bit/s") from error

    def discard(self) -> bytes:
        return gathered(lambda: self._taken() if self._waits(0.0) else b"")

    def send(self, frame: bytes | bytearray) -> None:
        try:
            sent = os.write(self._number, frame)
        except BlockingIOError:
            sent = 0
        except OSError as error:
            raise translate(error, self.name) from error
        if sent < len(frame):
            raise BusError(f"{self.name}: the port accepts no more octets")

    def receive(self, deadline_ns: int) -> bytes:
        wait_ns = deadline_ns - self._clock.now_ns()
        return self._taken() if self._waits(wait_ns * 1e-9 if wait_ns > 0 else 0.0) else b""

    def _waits(self, seconds: float) -> bool:
        try:
            readable, _, _ = select.select((self._number,), (), (), seconds)
        except (OSError, ValueError) as error:
            raise translate(error, self.name) from error
        return bool(readable)

    def _taken(self) -> bytes:
        try:
            octets = os.read(self._number, LARGEST)
        except OSError as error:
            raise translate(error, self.name) from error
        if not octets:
            raise BusError(f"{self.name}: the adapter is gone (unplugged?)")
        return octets

    def reopen(self) -> None:
        self.close()
        self._open()

    def close(self) -> None:
        self._number = CLOSED  # the system gives the number to the next file
        with suppress(OSError):
            self._port.close()


# The way of octets between master and drives, real or simulated: one request is under way at a time.


class Transport(Protocol):
    """A line or a connection that carries octets; it is used in one thread and waits only up to given deadlines."""

    name: str
    """Name of the bus, as users write it: `modbus-tcp:192.168.0.10`."""
    serial: bool
    """True on RTU, False on TCP."""

    def tune(self, baud: int, parity: Parity, stop_bits: int) -> None:
        """Set bit rate [bit/s] and characters of a serial line; nothing on TCP. Raises BusError."""

    def discard(self) -> bytes:
        """Drop all octets that wait, and return them: they belong to no request of now. Raises BusError when dead."""

    def send(self, frame: bytes | bytearray) -> None:
        """Send a frame; raises BusError when the line is dead or takes no more."""

    def receive(self, deadline_ns: int) -> bytes:
        """Return what has arrived; wait for at least one octet until the deadline [ns], and return none after it.

        What has arrived is returned after the deadline too. Raises BusError when the line is dead.
        """

    def reopen(self) -> None:
        """Open a dead line anew, for the way to zero alone, and wait some milliseconds at most; raises BusError."""

    def close(self) -> None:
        """Release the line; raises nothing."""
