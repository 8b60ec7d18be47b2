"""One CAN bus, used in the calling thread: sending, receiving, and a handler for each identifier.

There is no Notifier and no thread. A caller that waits for a frame receives by `pump`. All waiting is measured on the
clock that was handed in, so that virtual time stays deterministic. Configuration and loop share this path.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import can

from haptic_fieldbus.buses.canopen.error_frames import ErrorFrames
from haptic_fieldbus.buses.canopen.errors import FOREIGN, is_queue_full, translate
from haptic_fieldbus.buses.canopen.frames import ERROR_FLAG, FrameLog, frame_bits
from haptic_fieldbus.buses.canopen.ports import OURS, CanPort, PythonCanPort
from haptic_fieldbus.buses.canopen.socketcan import SocketCanPort, is_socketcan
from haptic_fieldbus.clock import Clock
from haptic_fieldbus.errors import BusError

Handler = Callable[[bytes | bytearray], None]
Tap = Callable[[int, bytes | bytearray], None]
"""Function that is called with the CAN-ID, flags included, and the data of every frame that comes."""

ECHOING = ("udp_multicast",)
"""Interfaces that give back the frames one sends, without saying so."""


class Wire:
    """A python-can bus with a handler for each CAN-ID, flags included; `name` is its name in messages.

    Our own frames, when an interface gives them back, reach neither handlers nor log. `echoes` tells that an interface
    does so without saying it.
    """

    def __init__(
        self, can_bus: can.BusABC, clock: Clock, name: str, log: FrameLog | None = None, *, echoes: bool = False
    ) -> None:
        self.clock = clock
        self.name = name
        self.error_frames = ErrorFrames()
        self.foreign_bits = 0
        """Bits of the frames that came and that nobody listens to: those of other devices."""
        self.refusal: BusError | None = None
        """Error of the last frame that the full transmit queue refused; None when there was none."""
        # Bound methods are looked up once: the loop calls them for every frame.
        self._port = port_to(can_bus, clock, echoes=echoes)
        self._send, self._receive = self._port.send, self._port.receive
        self._now_ns = clock.now_ns
        self._empty_ns = self._logged_ns = 0
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
            # A log that raised meanwhile is used no more.
            self._log = None if self._log is None else log

    def focus(self, frames: int) -> None:
        """Be woken only by frames that have a handler, unless all are recorded; raises BusError.

        `frames` is the number of frames that we send each period at most: SYNC, set-points, proofs of life, questions.
        A handler that is added later hears nothing.
        """
        self._set_filter(None if self._log is not None else frozenset(self._handlers), frames)

    def unfocus(self) -> None:
        """Be woken by all frames; raises BusError."""
        self._set_filter(None, 0)

    def _set_filter(self, can_ids: frozenset[int] | None, frames: int) -> None:
        try:
            self._port.focus(can_ids, frames)
        except FOREIGN as error:
            raise translate(error, self.name) from error

    def mute(self) -> None:
        """Forget all handlers."""
        self._handlers.clear()

    @property
    def arrived_ns(self) -> int:
        """Instant at which the frame arrived that is handled at present [ns]; where it is unknown, the earliest.

        It came after the last look that found nothing. Whoever is heard too rarely must not count as heard later.
        """
        known = self._port.arrived_ns(self._empty_ns)
        return self._empty_ns if known is None else known

    @property
    def taken_ns(self) -> int:
        """Instant at which the frame arrived that is handled at present [ns]; where it is unknown, now."""
        known = self._port.arrived_ns(self._empty_ns)
        return self._now_ns() if known is None else known

    @property
    def sentences(self) -> list[str]:
        """Faults of this computer's end of the bus, for people: frames that were refused, states of the controller."""
        told = (self.refusal, self.error_frames.sentence(self.name))
        return [str(said) for said in told if said is not None]

    def send(self, can_id: int, data: bytes | bytearray = b"") -> None:
        """Send a frame; raises BusError when it is not accepted, also when the transmit queue is full."""
        if not self.offer(can_id, data):
            raise self.refusal or BusError(f"{self.name}: a frame was refused")

    def offer(self, can_id: int, data: bytes | bytearray = b"") -> bool:
        """Send a frame; False when the transmit queue is full and the frame was dropped. Raises BusError otherwise."""
        try:
            self._send(can_id, data)
        except FOREIGN as error:
            ours = translate(error, self.name)
            if not is_queue_full(error):
                raise ours from error
            self.refusal = ours
            return False
        if self._log is not None:
            self._write_log(self._log, self._now_ns(), can_id, data)
        return True

    def pump(self, deadline_ns: int) -> bool:
        """Receive one frame and call its handler; False when none came until the deadline [ns]. Raises BusError."""
        remaining_ns = deadline_ns - self._now_ns()
        try:
            received = self._receive(remaining_ns * 1e-9 if remaining_ns > 0 else 0.0)
        except FOREIGN as error:
            raise translate(error, self.name) from error
        if received is None:
            return False
        if received is OURS:
            return True
        can_id, data = received
        if can_id & ERROR_FLAG:
            self.error_frames.hear(can_id, data)
        if self._log is not None:
            known = self._port.arrived_ns(self._empty_ns)
            self._write_log(self._log, self._now_ns() if known is None else known, can_id, data)
        handler = self._handlers.get(can_id)
        if handler is None:
            self.foreign_bits += frame_bits(can_id, data)
        else:
            handler(data)
        return True

    def _write_log(self, log: FrameLog, t_ns: int, can_id: int, data: bytes | bytearray) -> None:
        """Write a frame to the log; a log that raises is used no more, so that a full disk stops no other frame."""
        self._logged_ns = t_ns = max(t_ns, self._logged_ns)  # what arrived before we sent may be read after it
        try:
            log(t_ns, can_id, data)
        except Exception:
            self._log = None
            raise

    def drain(self, deadline_ns: int) -> None:
        """Handle all frames that have already arrived, without waiting; in a flood, stop at the deadline [ns]."""
        while self.pump(0):
            if self._now_ns() >= deadline_ns:
                return
        self._empty_ns = self._now_ns()


def port_to(can_bus: can.BusABC, clock: Clock, *, echoes: bool) -> CanPort:
    """Return the port to an open bus: its socket where it is one of SocketCAN, else python-can's messages."""
    if is_socketcan(can_bus):
        return SocketCanPort(can_bus.socket, clock)  # type: ignore[attr-defined]
    return PythonCanPort(can_bus, marks=echoes)
