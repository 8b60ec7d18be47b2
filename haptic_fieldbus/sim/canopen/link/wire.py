"""The medium: one transmission at a time, arbitration by identifier, a transmit queue for each node.

A frame is received at the end of its end of frame; the bus is free three bits later. What is queued at the instant at
which the bus becomes free takes part in that arbitration. Times are integer nanoseconds.
"""

from array import array
from bisect import bisect_right
from collections import deque
from dataclasses import dataclass

import numpy as np

from haptic_fieldbus.sim import NEVER_NS
from haptic_fieldbus.sim.canopen.link.frame import INTERMISSION_BITS, Frame, arbitration_key, wire_bits


@dataclass(frozen=True)
class WireStatistics:
    """What was on the wire in a window; `bits` include stuffing and intermission."""

    frames: int
    bits: int
    load: float


class Port:
    """One node's controller: frames waiting to be sent.

    `in_order`: one queue, first in first out, as SocketCAN sends; else by priority, as a controller with mailboxes.
    """

    def __init__(self, *, in_order: bool) -> None:
        self.in_order = in_order
        self.waiting: deque[tuple[int, Frame]] = deque()

    def send(self, frame: Frame) -> None:
        """Queue a frame."""
        self.waiting.append((arbitration_key(frame), frame))

    def candidate(self) -> tuple[int, Frame]:
        """What takes part in the next arbitration; of equal priorities the older."""
        return self.waiting[0] if self.in_order or len(self.waiting) == 1 else min(self.waiting, key=_key)


def _key(item: tuple[int, Frame]) -> int:
    return item[0]


def _port_key(port: Port) -> int:
    return port.candidate()[0]


class Wire:
    """Who sends when, and how long it takes; two nodes that send the same identifier at once are not modelled.

    `longest`: of so many frames at least, the last ones, statistics are kept; None: of all.
    """

    def __init__(self, bitrate: int, longest: int | None = None) -> None:
        self.bitrate = bitrate
        self.ports: list[Port] = []
        self.sender: Port | None = None
        self._frame: Frame | None = None
        self.end_ns = NEVER_NS
        """When the frame on the wire will have been received; NEVER_NS when there is none."""
        self._free_ns = 0
        self._ends = array("q")
        self._bits = array("H")
        self._longest = longest

    def attach(self, *, in_order: bool) -> Port:
        port = Port(in_order=in_order)
        self.ports.append(port)
        return port

    def detach(self, port: Port) -> None:
        """Remove a node; what it is sending is completed."""
        self.ports.remove(port)

    def start_ns(self, now_ns: int) -> int:
        """When the next arbitration takes place, as things stand."""
        if self.end_ns != NEVER_NS:
            return NEVER_NS
        for port in self.ports:
            if port.waiting:
                return max(now_ns, self._free_ns)
        return NEVER_NS

    def start(self, t_ns: int) -> None:
        """Arbitrate and put the winner on the wire."""
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
        if self._longest is not None and len(self._ends) > 2 * self._longest:
            del self._ends[: -self._longest], self._bits[: -self._longest]

    def finish(self) -> Frame:
        """Take the received frame off the wire."""
        frame = self._frame
        if frame is None:
            raise RuntimeError("nothing is on the wire")
        self._frame = None
        self.end_ns = NEVER_NS
        return frame

    def duration_ns(self, bits: int) -> int:
        """Time of a number of bits, to the nearest nanosecond."""
        return (bits * 1_000_000_000 + self.bitrate // 2) // self.bitrate

    def statistics(self, from_ns: int, to_ns: int) -> WireStatistics:
        """Frames whose end lies in (from_ns, to_ns]."""
        first, last = bisect_right(self._ends, from_ns), bisect_right(self._ends, to_ns)
        bits = int(np.frombuffer(self._bits, dtype=np.uint16)[first:last].sum()) if last > first else 0
        window = max(to_ns - from_ns, 1)
        return WireStatistics(last - first, bits, bits * 1e9 / self.bitrate / window)
