"""One CAN bus, used in the calling thread: sending, receiving, and a handler for each identifier.

There is no Notifier and no thread. A caller that waits for a frame receives by `pump`. All waiting is measured on the
clock that was handed in, so that virtual time stays deterministic. Configuration and loop share this path.
"""

from collections.abc import Callable

import can

from haptic_fieldbus.buses.canopen.errors import FOREIGN, is_queue_full, translate
from haptic_fieldbus.buses.canopen.frames import FrameLog
from haptic_fieldbus.clock import Clock
from haptic_fieldbus.errors import BusError

Handler = Callable[[bytearray], None]

EXTENDED_FLAG = 0x8000_0000
REMOTE_FLAG = 0x4000_0000
ERROR_FLAG = 0x2000_0000
BUS_OFF_ERROR = 0x040
"""Bit in the identifier of an error frame (linux/can/error.h, CAN_ERR_BUSOFF)."""


class Wire:
    """A python-can bus with a handler for each identifier; `name` is its name in messages."""

    def __init__(self, can_bus: can.BusABC, clock: Clock, name: str, log: FrameLog | None = None) -> None:
        self.clock = clock
        self.name = name
        self.bus_off = False
        self.refusal: BusError | None = None
        """Error of the last frame that the full transmit queue refused; None when there was none."""
        # Bound methods are looked up once: the loop calls them for every frame.
        self._send = can_bus.send
        self._recv = can_bus.recv
        self._now_ns = clock.now_ns
        self._log = log
        self._handlers: dict[int, Handler] = {}

    def listen(self, can_id: int, handler: Handler) -> None:
        """Hand all frames with this CAN-ID to `handler`, which replaces an earlier one."""
        self._handlers[can_id] = handler

    def mute(self) -> None:
        """Forget all handlers."""
        self._handlers.clear()

    def send(self, message: can.Message) -> None:
        """Send a frame; raises BusError when it is not accepted, also when the transmit queue is full."""
        if not self.offer(message):
            raise self.refusal or BusError(f"{self.name}: a frame was refused")

    def offer(self, message: can.Message) -> bool:
        """Send a frame; False when the transmit queue is full and the frame was dropped. Raises BusError otherwise."""
        try:
            self._send(message)
        except FOREIGN as error:
            ours = translate(error, self.name)
            if not is_queue_full(error):
                raise ours from error
            self.refusal = ours
            return False
        if self._log is not None:
            self._log(self._now_ns(), message.arbitration_id, message.data)
        return True

    def pump(self, deadline_ns: int) -> bool:
        """Receive one frame and call its handler; False when none came until the deadline [ns]. Raises BusError."""
        remaining_ns = deadline_ns - self._now_ns()
        try:
            message = self._recv(remaining_ns * 1e-9 if remaining_ns > 0 else 0.0)
        except FOREIGN as error:
            raise translate(error, self.name) from error
        if message is None:
            return False
        can_id = message.arbitration_id
        # The flags change the key of extended, remote and error frames, so that no handler of a data frame gets them.
        if message.is_extended_id or message.is_remote_frame or message.is_error_frame:
            can_id |= _flags(message)
            if message.is_error_frame and can_id & BUS_OFF_ERROR:
                self.bus_off = True
        if self._log is not None:
            self._log(self._now_ns(), can_id, message.data)
        handler = self._handlers.get(can_id)
        if handler is not None:
            handler(message.data)
        return True

    def drain(self, deadline_ns: int) -> None:
        """Handle all frames that have already arrived, without waiting; in a flood, stop at the deadline [ns]."""
        while self.pump(0) and self._now_ns() < deadline_ns:
            pass


def _flags(message: can.Message) -> int:
    return (
        (EXTENDED_FLAG if message.is_extended_id else 0)
        | (REMOTE_FLAG if message.is_remote_frame else 0)
        | (ERROR_FLAG if message.is_error_frame else 0)
    )


def frame(can_id: int, data: bytes | bytearray = b"") -> can.Message:
    """Return a data frame with an 11-bit identifier; a bytearray is not copied."""
    return can.Message(arbitration_id=can_id, data=data, is_extended_id=False)
