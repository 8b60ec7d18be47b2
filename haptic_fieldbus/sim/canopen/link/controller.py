"""The CAN controller of a program on the simulated bus: its received frames and its bus-off state."""

from collections import deque
from typing import NamedTuple

from haptic_fieldbus.sim.canopen.link.frame import Frame
from haptic_fieldbus.sim.canopen.link.wire import Port

# linux/can/error.h: the classes of an error message frame, and the second octet of a controller problem (receive
# overflow).
_CONTROLLER, _PROTOCOL_VIOLATION, _BUS_OFF, _RESTARTED = 0x004, 0x008, 0x040, 0x100
_NO_DETAIL = bytes(8)
_RECEIVE_OVERFLOW = bytes((0, 0x01, 0, 0, 0, 0, 0, 0))


class Received(NamedTuple):
    """One frame as the controller delivers it; `error` marks an error message of the controller itself."""

    t_ns: int
    frame: Frame
    own: bool = False
    error: bool = False


class Controller:
    """A program's CAN controller; `room` is the number of frames that it holds for the program, None for no limit."""

    def __init__(self, port: Port, *, receive_own: bool = False, room: int | None = None) -> None:
        self.port = port
        self.received: deque[Received] = deque()
        self.off = False
        """True while bus-off: no frame is sent or received."""
        self.down = False
        """True while the interface is down: to send and to receive fails."""
        self.closed = False
        """True once the program has left."""
        self.lost = 0
        """Number of frames that came while there was no room; reported by an error message once there is room."""
        self._told = 0
        self._room = room
        self._receive_own = receive_own

    def frame_ended(self, frame: Frame, sender: Port | None, t_ns: int) -> None:
        """Receive a frame that has ended on the wire, unless bus-off; count it as lost when there is no room."""
        own = sender is self.port
        if self.off or (own and not self._receive_own):
            return
        if self._room is not None and len(self.received) >= self._room:
            self.lost += 1
            return
        # The error message needs room too, so it is queued before the first frame that fits again.
        if self.lost != self._told:
            self._told = self.lost
            self._report(_CONTROLLER, t_ns, _RECEIVE_OVERFLOW)
        self.received.append(Received(t_ns, frame, own))

    def bus_off(self, t_ns: int) -> None:
        """Go bus-off because the error counter overflowed; frames waiting to be sent are lost."""
        self.off = True
        self.port.waiting.clear()
        self._report(_BUS_OFF, t_ns)

    def restarted(self, t_ns: int) -> None:
        """Return to the bus."""
        self.off = False
        self._report(_RESTARTED, t_ns)

    def interface_down(self) -> None:
        """Take the interface down; what was received and what waits to be sent is lost."""
        self.off = self.down = True
        self.port.waiting.clear()
        self.received.clear()

    def interface_up(self, _t_ns: int) -> None:
        """Bring the interface up again."""
        self.off = self.down = False

    def error_frame(self, t_ns: int) -> None:
        """Report that a frame was disturbed."""
        self._report(_PROTOCOL_VIOLATION, t_ns)

    def _report(self, error_class: int, t_ns: int, detail: bytes = _NO_DETAIL) -> None:
        self.received.append(Received(t_ns, Frame(error_class, detail), error=True))
