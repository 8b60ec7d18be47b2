"""The CAN controller of a program on the simulated bus: what it received, and whether it is bus-off."""

from collections import deque
from typing import NamedTuple

from haptic_fieldbus.sim.canopen.link.frame import Frame
from haptic_fieldbus.sim.canopen.link.wire import Port

# linux/can/error.h: classes of an error message frame, and what its second octet says of a controller problem.
_CONTROLLER, _PROTOCOL_VIOLATION, _BUS_OFF, _RESTARTED = 0x004, 0x008, 0x040, 0x100
_NO_DETAIL = bytes(8)
_RECEIVE_OVERFLOW = bytes((0, 0x01, 0, 0, 0, 0, 0, 0))


class Received(NamedTuple):
    """One frame as it comes out of the controller; `error`: an error message of the controller itself."""

    t_ns: int
    frame: Frame
    own: bool = False
    error: bool = False


class Controller:
    """The master's end of the wire; `room`: frames that it holds for the program, None: as many as come."""

    def __init__(self, port: Port, *, receive_own: bool = False, room: int | None = None) -> None:
        self.port = port
        self.received: deque[Received] = deque()
        self.off = False
        """Bus-off: nothing is sent or received."""
        self.closed = False
        """The program has left."""
        self.lost = 0
        """Frames that came while there was no room; an error message tells so once there is."""
        self._told = 0
        self._room = room
        self._receive_own = receive_own

    def frame_ended(self, frame: Frame, sender: Port | None, t_ns: int) -> None:
        """A frame was on the wire."""
        own = sender is self.port
        if self.off or (own and not self._receive_own):
            return
        if self._room is not None and len(self.received) >= self._room:
            self.lost += 1
            return
        if self.lost != self._told:
            self._told = self.lost
            self._report(_CONTROLLER, t_ns, _RECEIVE_OVERFLOW)
        self.received.append(Received(t_ns, frame, own))

    def bus_off(self, t_ns: int) -> None:
        """The error counter overflowed; what waited is lost."""
        self.off = True
        self.port.waiting.clear()
        self._report(_BUS_OFF, t_ns)

    def restarted(self, t_ns: int) -> None:
        """Back on the bus."""
        self.off = False
        self._report(_RESTARTED, t_ns)

    def error_frame(self, t_ns: int) -> None:
        """A frame was disturbed."""
        self._report(_PROTOCOL_VIOLATION, t_ns)

    def _report(self, error_class: int, t_ns: int, detail: bytes = _NO_DETAIL) -> None:
        self.received.append(Received(t_ns, Frame(error_class, detail), error=True))
