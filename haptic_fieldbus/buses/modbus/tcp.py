"""Modbus TCP: one connection to one host, over a socket that never makes the loop wait longer than it asks to.

On TCP no octet is lost: a segment that was lost comes late, by 200 ms and more, and until then nothing else comes. What
is sent meanwhile would only queue up, so the master keeps to one request under way (`requester`).

Many servers leave Nagle's algorithm on: while a part of what they sent is not acknowledged, they hold back the next
small segment. Our acknowledgement rides on our next request, or goes out by itself after `DELAYED_ACK`. So when more is
waited for than has come, what has come is acknowledged at once (TCP_QUICKACK). The usual exchange, one request and one
whole answer, needs and does none of this.

Reference: MODBUS Messaging on TCP/IP Implementation Guide 1.0b, 4.3.2 (TCP_NODELAY); RFC 1122, 4.2.3.2 and 4.2.3.4
(delayed acknowledgement, Nagle's algorithm); tcp(7), TCP_QUICKACK.
"""

import select
import socket
from contextlib import suppress

from haptic_fieldbus.buses.modbus.errors import translate
from haptic_fieldbus.clock import Clock
from haptic_fieldbus.errors import BusError
from haptic_fieldbus.protocols.modbus.profile import Parity

CONNECTING, RECONNECTING = 3.0, 0.01
"""Longest time for a connection [s]: at first, and on the way to zero."""
DELAYED_ACK = 0.04
"""Time after which a computer acknowledges by itself what it has received [s]: TCP_DELACK_MIN of Linux (net/tcp.h)."""
QUICKACK: int | None = getattr(socket, "TCP_QUICKACK", None)
"""Option by which an acknowledgement goes out at once; None where the system has none: Linux alone has it."""
LARGEST = 4096
"""Octets that are taken at once; an answer has 260 at most."""


class TcpTransport:
    """A connection to `address`, a host and a port; raises BusError when there is none."""

    serial = False

    def __init__(self, name: str, address: tuple[str, int], clock: Clock) -> None:
        self.name = name
        self._address = address
        self._clock = clock
        self._open(CONNECTING)

    def _open(self, seconds: float) -> None:
        self._socket = self._connected(seconds)
        self._poll = None
        if hasattr(select, "poll"):  # Windows has none
            self._poll = select.poll()
            self._poll.register(self._socket, select.POLLIN)
        self._unacknowledged = False
        """Whether octets came since the last request."""

    def _connected(self, seconds: float) -> socket.socket:
        try:
            connected = socket.create_connection(self._address, seconds)
        except OSError as error:
            raise translate(error, f"cannot connect to {self.name}") from error
        connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connected.setblocking(False)
        return connected

    def tune(self, baud: int, parity: Parity, stop_bits: int) -> None:
        """Do nothing: a network has its own speed."""

    def discard(self) -> bytes:
        gathered = b""
        while octets := self._taken():
            gathered += octets
        return gathered

    def send(self, frame: bytes | bytearray) -> None:
        try:
            sent = self._socket.send(frame)
            self._unacknowledged = False  # the request carries the acknowledgement
        except BlockingIOError:
            sent = 0
        except OSError as error:
            raise translate(error, self.name) from error
        if sent < len(frame):
            raise BusError(f"{self.name}: the drive takes no more requests")

    def receive(self, deadline_ns: int) -> bytes:
        try:
            if self._unacknowledged:
                self._acknowledge()
            wait_ns = deadline_ns - self._clock.now_ns()
            # poll is twice as fast as select, but counts in milliseconds: select waits for the rest.
            if self._poll is not None and wait_ns >= 1_000_000 and self._poll.poll(wait_ns // 1_000_000):
                return self._taken()
            wait_ns = max(0, deadline_ns - self._clock.now_ns())
            return self._taken() if select.select((self._socket,), (), (), wait_ns * 1e-9)[0] else b""
        except (OSError, ValueError) as error:
            raise translate(error, self.name) from error

    def _acknowledge(self) -> None:
        """Acknowledge what has come, as more is waited for: the drive may hold it back until then."""
        self._unacknowledged = False
        if QUICKACK is not None:
            # It lasts until the kernel changes its mind, so it is set each time.
            self._socket.setsockopt(socket.IPPROTO_TCP, QUICKACK, 1)

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
