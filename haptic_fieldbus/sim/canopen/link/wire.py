"""The medium: one transmission at a time, arbitration by identifier, a transmit queue for each node.

A frame is received when its end of frame is over; the bus is free three bits later. Frames queued at the instant at
which the bus becomes free take part in that arbitration. Times are integer nanoseconds.
"""

from array import array
from bisect import bisect_left, bisect_right
from collections import deque
from dataclasses import dataclass

import numpy as np

from haptic_fieldbus.sim import NEVER_NS
from haptic_fieldbus.sim.canopen.link.frame import INTERMISSION_BITS, Frame, arbitration_key, wire_bits


@dataclass(frozen=True)
class WireStatistics:
    """Traffic in a time window; `bits` include stuffing and intermission, `load` is their share of the window."""

    frames: int
    bits: int
    load: float


class Port:
    """The transmit side of one node's controller: the frames waiting to be sent.

    With `in_order` the queue is first in, first out, as SocketCAN sends; otherwise frames go by priority, as from a
    controller with mailboxes.
    """

    def __init__(self, *, in_order: bool) -> None:
        self.in_order = in_order
        self.waiting: deque[tuple[int, Frame]] = deque()

    def send(self, frame: Frame) -> None:
        """Queue a frame."""
        self.waiting.append((arbitration_key(frame), frame))

    def candidate(self) -> tuple[int, Frame]:
        """Return the frame that takes part in the next arbitration; of equal priorities the older one."""
        return self.waiting[0] if self.in_order or len(self.waiting) == 1 else min(self.waiting, key=_key)


def _key(item: tuple[int, Frame]) -> int:
    return item[0]


def _port_key(port: Port) -> int:
    return port.candidate()[0]


class Wire:
    """The arbitration of all ports and the duration of each frame.

    Two nodes that send the same identifier at once are not modelled. Statistics cover at least the `longest` latest
    frames, None: all.
    """

    def __init__(self, bitrate: int, longest: int | None = None) -> None:
        self.bitrate = bitrate
        self.ports: list[Port] = []
        self.sender: Port | None = None
        self._frame: Frame | None = None
        self.end_ns = NEVER_NS
        """End of the frame on the wire; NEVER_NS when there is none."""
        self._free_ns = 0
        self._ends = array("q")
        self._bits = array("H")
        self._longest = longest

    def attach(self, *, in_order: bool) -> Port:
        """Add a node and return its port."""
        port = Port(in_order=in_order)
        self.ports.append(port)
        return port

    def detach(self, port: Port) -> None:
        """Remove a node; a frame that it is sending is completed."""
        self.ports.remove(port)

    def start_ns(self, now_ns: int) -> int:
        """Return the time of the next arbitration; NEVER_NS while a frame is on the wire or none is waiting."""
        if self.end_ns != NEVER_NS:
            return NEVER_NS
        for port in self.ports:
            if port.waiting:
                return max(now_ns, self._free_ns)
        return NEVER_NS

    def start(self, t_ns: int) -> None:
        """Arbitrate at `t_ns` and put the winning frame on the wire."""
        contenders = [port for port in self.ports if port.waiting]
        winner = contenders[0] if len(contenders) == 1 else min(contenders, key=_port_key)
        item = winner.candidate()
        winner.waiting.remove(item)
        self.sender, self._frame = winner, item[1]
        bits = wire_bits(item[1])
        self.end_ns = t_ns + self.duration_ns(bits)
        self._free_ns = t_ns + self.duration_ns(bits + INTERMISSION_BITS)
        self._ends.append(self.end_ns)
        self._bits.append(bits + INTERMISSION_BITS)
        # Cut only at twice the length, so that the deletion costs little per frame on average.
        if self._longest is not None and len(self._ends) > 2 * self._longest:
            del self._ends[: -self._longest], self._bits[: -self._longest]

    def finish(self) -> Frame:
        """Take the received frame off the wire and return it; raises RuntimeError when there is none."""
        frame = self._frame
        if frame is None:
            raise RuntimeError("nothing is on the wire")
        self._frame = None
        self.end_ns = NEVER_NS
        return frame

    def duration_ns(self, bits: int) -> int:
        """Return the duration of a number of bits, to the nearest nanosecond."""
        return (bits * 1_000_000_000 + self.bitrate // 2) // self.bitrate

    def forget(self, before_ns: int) -> None:
        """Drop the frames that ended before an instant [ns] from the statistics."""
        first = bisect_left(self._ends, before_ns)
        del self._ends[:first], self._bits[:first]

    def statistics(self, from_ns: int, to_ns: int) -> WireStatistics:
        """Return the traffic of the frames that end in (from_ns, to_ns]."""
        first, last = bisect_right(self._ends, from_ns), bisect_right(self._ends, to_ns)
        bits = int(np.frombuffer(self._bits, dtype=np.uint16)[first:last].sum()) if last > first else 0
        window = max(to_ns - from_ns, 1)
        return WireStatistics(last - first, bits, bits * 1e9 / self.bitrate / window)
