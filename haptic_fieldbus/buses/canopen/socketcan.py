"""The socket of a SocketCAN interface, used without python-can's messages in between.

python-can opens and closes the socket. A frame is 16 octets in both directions (`struct can_frame` of linux/can.h):
CAN-ID with its flags, length, three octets of padding, eight octets of data. A frame costs one system call to send, and
two to wait for and receive.

- *Filters.* In the loop the kernel wakes us for frames that have a handler, and for the error frames that tell the
  state of the controller. A bus full of frames for others costs nothing then.
- *Latest value wins.* The kernel queues frames while the bus is busy, up to the length of its transmit queue. What
  waits there is old when it goes out. Therefore room for a few periods of our frames is all that our socket asks for;
  beyond that a frame is refused, and the next period sends a newer one.
- *Time stamps.* The kernel stamps a frame as it arrives, by CLOCK_REALTIME, which may be set at any time. The stamp
  becomes an age by that clock, and the age an instant on ours; it must lie between the moment at which the socket was
  last seen empty and now, else one of these is taken.

Reference: Linux, Documentation/networking/can.rst, sections "RAW protocol sockets" and "Timestamps".
"""

import errno
import select
import socket
import time
from struct import Struct, pack

import can

from haptic_fieldbus.buses.canopen.error_frames import TOLD
from haptic_fieldbus.buses.canopen.frames import EXTENDED_FLAG, REMOTE_FLAG
from haptic_fieldbus.buses.canopen.ports import OURS, Received
from haptic_fieldbus.clock import Clock

FRAME = Struct("=IB3x8s")
"""`struct can_frame`."""
EXACTLY = EXTENDED_FLAG | REMOTE_FLAG | 0x7FF
"""Mask of a filter that takes one CAN-ID of 11 bits, flags included."""
TIMESPEC = Struct("@ll")
MOST_FILTERS = 512
"""Number that the kernel takes (CAN_RAW_FILTER_MAX)."""
STAMP_SIZE = 64
"""Room for the control message with a time stamp, in octets."""
QUEUED_PERIODS = 4
"""Periods whose frames may wait in the transmit queue. Slow adapters confirm a frame some milliseconds after it."""
FRAME_COST = 768
"""What the kernel charges to the send buffer for a frame that waits, in octets; it doubles what one asks for."""
CAN_RAW_ERR_FILTER, ALL_ERRORS = 2, 0x1FFF_FFFF
"""Option of the socket (linux/can/raw.h), which Python does not name, and its value for all error frames."""


def is_socketcan(can_bus: can.BusABC) -> bool:
    """Whether a bus of python-can is one SocketCAN interface, whose socket can be used."""
    family = getattr(getattr(can_bus, "socket", None), "family", None)
    return family is not None and family == getattr(socket, "AF_CAN", None) and bool(getattr(can_bus, "channel", ""))


class SocketCanPort:
    """A port on an open socket, which stays the property of its python-can bus."""

    def __init__(self, opened: socket.socket, clock: Clock) -> None:
        self._socket, self._clock = opened, clock
        self._send, self._receive = opened.send, opened.recvmsg_into
        self._sockets = (opened,)
        self._buffer = bytearray(FRAME.size)
        self._buffers = (self._buffer,)
        self._unwanted = socket.MSG_TRUNC | getattr(socket, "MSG_CONFIRM", 0)
        """Flags of a frame that is none of CAN 2.0, and of one of our own."""
        self._ancillary: list[tuple[int, int, bytes]] = []

    def send(self, can_id: int, data: bytes | bytearray) -> None:
        try:
            self._send(FRAME.pack(can_id, len(data), data), socket.MSG_DONTWAIT)
        except BlockingIOError as full:  # our part of the queue is full, see `focus`
            raise OSError(errno.ENOBUFS, "our share of the transmit queue is full") from full

    def receive(self, seconds: float) -> Received | None:
        if seconds > 0.0 and not select.select(self._sockets, (), (), seconds)[0]:
            return None
        try:
            _, self._ancillary, flags, _ = self._receive(self._buffers, STAMP_SIZE, socket.MSG_DONTWAIT)
        except BlockingIOError:
            return None
        if flags & self._unwanted:
            return OURS
        can_id, length, data = FRAME.unpack_from(self._buffer)
        return can_id, data[:length]  # of a remote frame, zeros

    def arrived_ns(self, earliest_ns: int) -> int | None:
        stamp = self._ancillary[0][2] if self._ancillary else b""
        if len(stamp) != TIMESPEC.size:
            return None
        seconds, nanoseconds = TIMESPEC.unpack(stamp)
        age_ns: int = time.time_ns() - (seconds * 1_000_000_000 + nanoseconds)
        now_ns = self._clock.now_ns()
        return min(now_ns, max(now_ns - age_ns, earliest_ns))

    def focus(self, can_ids: frozenset[int] | None, frames: int) -> None:
        if can_ids is None or len(can_ids) > MOST_FILTERS:
            self._filter(pack("=II", 0, 0), ALL_ERRORS)
            return
        wanted = sorted(can_id for can_id in can_ids if not can_id & EXTENDED_FLAG)
        self._filter(b"".join(pack("=II", can_id, EXACTLY) for can_id in wanted), TOLD)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, QUEUED_PERIODS * frames * FRAME_COST // 2)

    def _filter(self, filters: bytes, errors: int) -> None:
        self._socket.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, filters)
        self._socket.setsockopt(socket.SOL_CAN_RAW, CAN_RAW_ERR_FILTER, errors)
