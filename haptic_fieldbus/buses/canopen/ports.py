"""A port to one CAN bus: frames as CAN-ID and data, over any interface of python-can.

A CAN-ID holds the identifier, and the flags of linux/can.h for extended, remote and error frames, so that no handler of
a data frame ever gets one of those. The data of a remote frame is as many octets as it asks for.

Our own frames, when an interface gives them back, come as `OURS`. Most interfaces mark them (`is_rx`). One that echoes
without a mark gets one from us. On SocketCAN `is_rx` says another thing, that a frame comes from a process of this
computer; there `SocketCanPort` takes the place of this one.
"""

from typing import Protocol
from uuid import uuid4

import can

from haptic_fieldbus.buses.canopen.frames import CAN_ID_MASK, ERROR_FLAG, EXTENDED_FLAG, REMOTE_FLAG

Received = tuple[int, bytes | bytearray]
"""CAN-ID with its flags, and data."""
OURS: Received = (0, b"")
"""What stands for a frame of our own; compared by identity."""


class CanPort(Protocol):
    """Sends and receives in the calling thread. Each method may raise what python-can or the system raises."""

    def send(self, can_id: int, data: bytes | bytearray) -> None:
        """Send a frame, or raise; it never waits for room in the transmit queue."""

    def receive(self, seconds: float) -> Received | None:
        """Return a frame, after waiting this long [s] at most; None when none came."""

    def arrived_ns(self, earliest_ns: int) -> int | None:
        """Return the instant on our clock at which the last frame arrived, `earliest_ns` or later; None if unknown."""

    def focus(self, can_ids: frozenset[int] | None, frames: int) -> None:
        """Let only frames with these CAN-IDs, and error frames that matter, wake us; None: all frames.

        `frames` is the number that we send each period; old ones beyond a few periods are refused, not queued.
        """


class PythonCanPort:
    """Any interface of python-can; with `marks`, of one that gives back our frames without saying so.

    python-can's UDP datagrams pass on the channel of a frame, which means nothing there. To count what was sent would
    not do, because a lost echo would excuse the same frame of somebody else.
    """

    def __init__(self, can_bus: can.BusABC, *, marks: bool = False) -> None:
        self._bus = can_bus
        self._mark = uuid4().hex if marks else None
        self.stamp = 0.0
        """Time stamp of the last frame [s], by whatever clock its interface has."""

    def send(self, can_id: int, data: bytes | bytearray) -> None:
        remote = bool(can_id & REMOTE_FLAG)
        message = can.Message(
            arbitration_id=can_id & CAN_ID_MASK,
            data=None if remote else data,
            dlc=len(data),
            is_remote_frame=remote,
            is_extended_id=bool(can_id & EXTENDED_FLAG),
            channel=self._mark,
        )
        self._bus.send(message)

    def receive(self, seconds: float) -> Received | None:
        message = self._bus.recv(seconds)
        if message is None:
            return None
        self.stamp = message.timestamp
        if not message.is_rx or (self._mark is not None and message.channel == self._mark):
            return OURS
        if not (message.is_extended_id or message.is_remote_frame or message.is_error_frame):
            return message.arbitration_id, message.data
        data = bytes(message.dlc) if message.is_remote_frame else message.data
        return message.arbitration_id | _flags(message), data

    def arrived_ns(self, earliest_ns: int) -> int | None:
        """Return None: the time stamps of interfaces come from many clocks."""
        return None

    def focus(self, can_ids: frozenset[int] | None, frames: int) -> None:
        """Do nothing: python-can's own filter would cost more than the look-up of a handler."""


def _flags(message: can.Message) -> int:
    return (
        (EXTENDED_FLAG if message.is_extended_id else 0)
        | (REMOTE_FLAG if message.is_remote_frame else 0)
        | (ERROR_FLAG if message.is_error_frame else 0)
    )
