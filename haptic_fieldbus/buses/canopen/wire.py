"""One CAN bus, used in the calling thread: sending, receiving, and a handler for each identifier.

There is no Notifier and no thread. A caller that waits for a frame receives by `pump`. All waiting is measured on the
clock that was handed in, so that virtual time stays deterministic. Configuration and loop share this path.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from uuid import uuid4

import can

from haptic_fieldbus.buses.canopen.errors import FOREIGN, is_queue_full, translate
from haptic_fieldbus.buses.canopen.frames import ERROR_FLAG, EXTENDED_FLAG, REMOTE_FLAG, FrameLog
from haptic_fieldbus.clock import Clock
from haptic_fieldbus.errors import BusError

Handler = Callable[[bytearray], None]
Tap = Callable[[int, bytes | bytearray], None]
"""Function that is called with the CAN-ID, flags included, and the data of every frame that comes."""

ECHOING = ("udp_multicast",)
"""Interfaces that give back the frames one sends, without saying so."""

BUS_OFF_ERROR = 0x040
"""Bit in the identifier of an error frame (linux/can/error.h, CAN_ERR_BUSOFF)."""


class Wire:
    """A python-can bus with a handler for each identifier; `name` is its name in messages.

    Our own frames, when an interface gives them back, reach neither handlers nor log. Most interfaces mark them
    (`is_rx`). One that `echoes` does not; there we mark them, see `_Marked`.
    """

    def __init__(
        self, can_bus: can.BusABC, clock: Clock, name: str, log: FrameLog | None = None, *, echoes: bool = False
    ) -> None:
        self.clock = clock
        self.name = name
        self.bus_off = False
        self.refusal: BusError | None = None
        """Error of the last frame that the full transmit queue refused; None when there was none."""
        # Bound methods are looked up once: the loop calls them for every frame.
        port = _Marked(can_bus) if echoes else can_bus
        self._send = port.send
        self._recv = port.recv
        self._now_ns = clock.now_ns
        self._log = log
        self._handlers: dict[int, Handler] = {}

    def listen(self, can_id: int, handler: Handler) -> None:
        """Hand all frames with this CAN-ID to `handler`, which replaces an earlier one."""
        self._handlers[can_id] = handler

    @contextmanager
    def overhear(self, tap: Tap) -> Iterator[None]:
        """Call `tap` with every frame that comes meanwhile; nothing may be sent."""
        log = self._log

        def both(t_ns: int, can_id: int, data: bytes | bytearray) -> None:
            tap(can_id, data)
            if log is not None:
                log(t_ns, can_id, data)

        self._log = both
        try:
            yield
        finally:
            self._log = log

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
            can_id = message.arbitration_id | (REMOTE_FLAG if message.is_remote_frame else 0)
            self._write_log(self._log, can_id, message.data)
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
        if not message.is_rx:
            return True
        can_id = message.arbitration_id
        # The flags change the key of extended, remote and error frames, so that no handler of a data frame gets them.
        if message.is_extended_id or message.is_remote_frame or message.is_error_frame:
            can_id |= _flags(message)
            if message.is_error_frame and can_id & BUS_OFF_ERROR:
                self.bus_off = True
        if self._log is not None:
            self._write_log(self._log, can_id, message.data)
        handler = self._handlers.get(can_id)
        if handler is not None:
            handler(message.data)
        return True

    def _write_log(self, log: FrameLog, can_id: int, data: bytes | bytearray) -> None:
        """Write a frame to the log; a log that raises is used no more, so that a full disk stops no other frame."""
        try:
            log(self._now_ns(), can_id, data)
        except Exception:
            self._log = None
            raise

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


class _Marked:
    """A bus that gives back the frames one sends: ours carry a mark, and come back as not received.

    python-can's UDP datagrams pass on the channel of a frame, which means nothing there. To count what was sent would
    not do, because a lost echo would excuse the same frame of somebody else.
    """

    def __init__(self, can_bus: can.BusABC) -> None:
        self._bus = can_bus
        self._mark = uuid4().hex

    def send(self, message: can.Message) -> None:
        message.channel = self._mark
        self._bus.send(message)

    def recv(self, timeout: float) -> can.Message | None:
        message = self._bus.recv(timeout)
        if message is not None and message.channel == self._mark:
            message.is_rx = False
        return message


def frame(can_id: int, data: bytes | bytearray = b"") -> can.Message:
    """Return a data frame with an 11-bit identifier; a bytearray is not copied."""
    return can.Message(arbitration_id=can_id, data=data, is_extended_id=False)


def remote_frame(can_id: int, octets: int) -> can.Message:
    """Return a remote frame with an 11-bit identifier, which requests so many octets."""
    return can.Message(arbitration_id=can_id, dlc=octets, is_remote_frame=True, is_extended_id=False)
