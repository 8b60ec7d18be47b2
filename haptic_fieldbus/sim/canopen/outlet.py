"""The outlet of hosted drives to a python-can bus that may go down, and come back.

A drive does not end when its cable is pulled: it goes on, hears nothing, and lets go by its own watch. So nothing that
the interface raises ends the hosting. It is told once when the bus goes down and once when a frame passes again; what
is sent meanwhile is lost. An interface that goes on failing is opened anew, because its socket may belong to an adapter
that was unplugged.

Where the kernel stamps frames as they arrive, a frame is served at its stamp, so that a process that was woken late
latches what the shaft did when SYNC came, as a drive would. That holds for `LATEST_NS`: a process that slept longer
finds several SYNCs, and a master takes the first answer for one to its last SYNC, so that an old position would be a
jump. The stamp is of the wall clock, which may be set at any time; it is bounded by what was served before, and by now.
"""

import time
from collections.abc import Callable

import can

from haptic_fieldbus.buses.canopen.errors import FOREIGN, is_queue_full, translate
from haptic_fieldbus.clock import Clock
from haptic_fieldbus.errors import BusError, UsageError
from haptic_fieldbus.numerals import rounded
from haptic_fieldbus.sim.canopen.link.frame import Frame

REOPENED_EVERY_NS = 1_000_000_000
RETRIED_EVERY_NS = 20_000_000
"""Pause after a failure to receive, which comes at once and would keep a processor busy."""

LATEST_NS = 500_000
"""Longest time before now at which a frame is served."""
STAMPED = ("socketcan", "udp_multicast")
"""Interfaces whose time stamps are those of the kernel, by the wall clock of this computer."""

Tell = Callable[[str], None]
"""Tell the person a sentence."""


class Outlet:
    """A python-can bus, opened by `reopen` again when it goes on failing; `name` is the bus in sentences.

    `stamped`: its frames have time stamps of the kernel (see `STAMPED`).
    """

    def __init__(
        self,
        can_bus: can.BusABC,
        clock: Clock,
        name: str,
        tell: Tell,
        reopen: Callable[[], can.BusABC] | None = None,
        *,
        stamped: bool = False,
    ) -> None:
        self.lost = 0
        """Number of frames that could not be sent because the transmit queue was full."""
        self._bus: can.BusABC | None = can_bus
        self._clock = clock
        self._name = name
        self._tell = tell
        self._reopen = reopen
        self._stamped = stamped
        self._down_ns: int | None = None
        """Since when nothing passes; None while the bus is up."""
        self._opened_ns = clock.now_ns()

    def send(self, frame: Frame) -> None:
        """Send a frame; it is lost when the bus is down or its transmit queue full."""
        if self._bus is None:
            return
        message = can.Message(
            arbitration_id=frame.can_id,
            is_extended_id=frame.extended,
            is_remote_frame=frame.remote,
            dlc=len(frame.data),
            data=None if frame.remote else frame.data,
        )
        try:
            self._bus.send(message)
        except FOREIGN as error:
            if is_queue_full(error):
                self.lost += 1
            else:
                self._failed(error)
        else:
            self._passed()

    def receive(self, longest_ns: int) -> can.Message | None:
        """Return the next frame; None when none comes within `longest_ns`, or the bus is down."""
        message = None
        try:
            if self._bus is not None:
                message = self._bus.recv(max(0, longest_ns) * 1e-9)
        except FOREIGN as error:
            self._failed(error)
            self._pause(longest_ns)
        else:
            if self._bus is None:
                self._open()
                self._pause(longest_ns)
            elif message is not None:
                self._passed()
        return message

    def arrived_ns(self, message: can.Message, earliest_ns: int) -> int:
        """Return the instant at which a frame that was received now arrived, not before `earliest_ns`."""
        now_ns = self._clock.now_ns()
        age_ns = round((time.time() - message.timestamp) * 1e9) if self._stamped else 0
        return max(earliest_ns, now_ns - max(0, min(age_ns, LATEST_NS)))

    def close(self) -> None:
        """Leave the bus."""
        if self._bus is not None:
            self._bus.shutdown()

    def _pause(self, longest_ns: int) -> None:
        self._clock.sleep_until(self._clock.now_ns() + min(max(0, longest_ns), RETRIED_EVERY_NS))

    def _passed(self) -> None:
        if self._down_ns is not None:
            seconds = rounded((self._clock.now_ns() - self._down_ns) * 1e-9)
            self._down_ns = None
            self._tell(f"{self._name}: frames pass again, after {seconds} s")

    def _failed(self, error: Exception) -> None:
        """Tell that the bus is down, or open it anew when it has been failing for long."""
        why = translate(error, self._name)
        if self._down_ns is None:
            self._down_ns = self._clock.now_ns()
            self._tell(f"{why}. The drives go on; what they send is lost until the bus is back")
        elif self._clock.now_ns() - self._down_ns >= REOPENED_EVERY_NS:
            self._open()

    def _open(self) -> None:
        """Open the bus anew, at most once in `REOPENED_EVERY_NS`."""
        now_ns = self._clock.now_ns()
        if self._reopen is None or now_ns - self._opened_ns < REOPENED_EVERY_NS:
            return
        self._opened_ns = now_ns
        self.close()
        try:
            self._bus = self._reopen()
        except (BusError, UsageError):
            # It has been told that the bus is down.
            self._bus = None
