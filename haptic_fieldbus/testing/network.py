"""canopen in virtual time, in one thread.

Theory: canopen receives in a thread of its own, and its callers wait for that thread by the wall clock. In virtual time
there is one thread, and time passes only in it. So this network has no receiving thread: an SDO request lets virtual
time pass until its answer has come, right where it is sent, and `wait` lets any time pass. In both, the frames that
arrive go to canopen's callbacks.

What waits by the wall clock or has a thread does not work: periodic transmission (SYNC, heartbeat, `PdoMap.start`) is
refused, and `LssMaster`, `wait_for_heartbeat`, `wait_for_bootup`, `wait_for_reception` and `BaseNode402` wait in vain.
"""

import can
import canopen
from canopen.network import PeriodicMessageTask

from haptic_fieldbus.clock import Clock

_SDO_REQUESTS, _SDO_RESPONSES = range(0x601, 0x680), 0x580
_LONGEST_NS = 300_000_000
"""Time that an answer may take, the time-out of canopen's SDO client."""


class SteppedNetwork(canopen.Network):
    """A canopen network whose time passes in its requests and in `wait`."""

    def __init__(self, bus: can.BusABC, clock: Clock) -> None:
        super().__init__(bus)
        self._wire = bus
        self._clock = clock

    def send_message(self, can_id: int, data: bytes, remote: bool = False) -> None:
        """Send a frame; after an SDO request, go on to its answer."""
        super().send_message(can_id, data, remote)
        if can_id in _SDO_REQUESTS:
            self._go_on(_LONGEST_NS, until=_SDO_RESPONSES + can_id % 0x80)

    def send_periodic(self, can_id: int, data: bytes, period: float, remote: bool = False) -> PeriodicMessageTask:
        """Refuse, because periodic transmission has a thread; raises RuntimeError."""
        raise RuntimeError(f"{can_id:03X}h cannot be sent periodically in virtual time; send it each time it is due")

    def wait(self, seconds: float) -> None:
        """Let time pass [s]."""
        self._go_on(round(seconds * 1e9))

    def _go_on(self, longest_ns: int, until: int | None = None) -> None:
        end_ns = self._clock.now_ns() + longest_ns
        while (message := self._wire.recv(max(0, end_ns - self._clock.now_ns()) * 1e-9)) is not None:
            for listener in self.listeners:
                listener(message)
            if message.arbitration_id == until:
                return
