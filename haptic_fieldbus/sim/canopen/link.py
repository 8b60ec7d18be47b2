"""The data link layer of CAN: frames and their bits, the medium, controllers, disturbances."""

from array import array
from bisect import bisect_left, bisect_right
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from haptic_fieldbus.sim import NEVER_NS, faults

# A CAN frame and the exact number of bits that it takes on the wire.
#
# Theory (ISO 11898-1, CAN 2.0): from start of frame to the end of the CRC sequence, a complementary bit is inserted
# after five equal bits. Inserted bits count towards the next run, and a bit is also inserted after the very last one.
# The tail (CRC delimiter, acknowledge slot and delimiter, seven bits end of frame) is not stuffed. A computation bit by
# bit would cost more than the whole simulated drive, so tables advance both CRC and stuffing a byte at a time. The
# stuffing state is the last bit and the length of its run, 1 to 4. The result for the header is cached for each
# (identifier, length, kind).

TAIL_BITS = 10
"""CRC delimiter, acknowledge slot, acknowledge delimiter and end of frame."""
INTERMISSION_BITS = 3
"""Bits after the end of frame before the bus is free again."""
LONGEST_BITS = 160
"""Largest number of bits of a frame and its intermission: an extended one of 8 octets, with all stuff bits."""

# x¹⁵ + x¹⁴ + x¹⁰ + x⁸ + x⁷ + x⁴ + x³ + 1 without its highest term (ISO 11898-1).
_CRC_POLYNOMIAL = 0x4599
_CRC_MASK = 0x7FFF
# Two values of the last bit times four lengths of its run; a run of five is stuffed at once and never kept.
_RUN_STATES = 8


class Frame(NamedTuple):
    """One CAN frame. A remote frame carries its length as that many empty octets."""

    can_id: int
    data: bytes
    extended: bool = False
    remote: bool = False


def arbitration_key(frame: Frame) -> int:
    """Return the bits of the arbitration field as a number: the lower one wins, because 0 is dominant.

    Standard: 11 bits, RTR, IDE 0; extended: 11 bits, SRR 1, IDE 1, 18 bits, RTR.
    """
    remote = int(frame.remote)
    if not frame.extended:
        return frame.can_id << 21 | remote << 20
    return (frame.can_id >> 18) << 21 | 0b11 << 19 | (frame.can_id & 0x3FFFF) << 1 | remote


def wire_bits(frame: Frame) -> int:
    """Return the bits from start of frame to end of frame, stuff bits included, intermission excluded."""
    can_id, data, extended, remote = frame
    crc, table, bits = _header(can_id, len(data), extended, remote)
    for octet in b"" if remote else data:
        crc = (crc & 0x7F) << 8 ^ _CRC_TABLE[crc >> 7 ^ octet]
        table, sent = table.octets[octet]
        bits += sent
    # The 15 bits of the CRC sequence are stuffed as well: the upper eight, then the lower seven.
    table, sent = table.octets[crc >> 7]
    return bits + sent + table.last_bits[crc & 0x7F] + TAIL_BITS


def _stuff(state: int, value: int, width: int) -> int:
    """Send `width` bits from a stuffing state; return the new state in the low three bits, the bits sent above them."""
    last, run = state >> 2, (state & 3) + 1
    sent = 0
    for position in reversed(range(width)):
        bit = value >> position & 1
        run = run + 1 if bit == last else 1
        last = bit
        sent += 1
        # The stuff bit is sent after five equal bits and starts a run of its own.
        if run == 5:
            last, run, sent = 1 - last, 1, sent + 1
    return sent << 3 | last << 2 | run - 1


def _crc(crc: int, value: int, width: int) -> int:
    """Return the CRC-15 register after `width` more bits."""
    for position in reversed(range(width)):
        feedback = (value >> position & 1) ^ crc >> 14
        crc = (crc << 1 & _CRC_MASK) ^ (_CRC_POLYNOMIAL if feedback else 0)
    return crc


class _Stuffing:
    """One state of the stuffing, the bits that follow in it, and the state after them."""

    __slots__ = ("last_bits", "octets")

    def __init__(self, state: int) -> None:
        self.octets: list[tuple[_Stuffing, int]] = []
        """By octet: the state after it, and the bits sent."""
        self.last_bits = [_stuff(state, value, 7) >> 3 for value in range(128)]
        """By the last seven bits of the CRC: the bits sent."""


_CRC_TABLE = [_crc(0, octet, 8) for octet in range(256)]
_STUFFING = [_Stuffing(state) for state in range(_RUN_STATES)]
for _state, _table in enumerate(_STUFFING):
    _table.octets += [(_STUFFING[step & 7], step >> 3) for step in (_stuff(_state, each, 8) for each in range(256))]


@lru_cache(maxsize=4096)
def _header(can_id: int, length: int, extended: bool, remote: bool) -> tuple[int, _Stuffing, int]:
    """Return CRC register, stuffing state and bits sent after the control field."""
    # Identifier (its upper 11 bits, SRR 1, IDE 1, its lower 18 bits), RTR, two reserved bits, four bits of length.
    if extended:
        value = (can_id >> 18) << 27 | 0b11 << 25 | (can_id & 0x3FFFF) << 7 | remote << 6 | length
        width = 38
    else:
        # 11 bits of identifier, RTR, IDE 0, one reserved bit, four bits of length.
        value = can_id << 7 | remote << 6 | length
        width = 18
    # The start of frame is dominant after an idle bus: a run of one zero.
    step = _stuff(0, value, width)
    return _crc(_crc(0, 0, 1), value, width), _STUFFING[step & 7], 1 + (step >> 3)


# The medium: one transmission at a time, arbitration by identifier, a transmit queue for each node.
#
# A frame is received when its end of frame is over; the bus is free three bits later. Frames queued at the instant at
# which the bus becomes free take part in that arbitration. Times are integer nanoseconds.


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
        self.waiting: deque[Frame] = deque()
        self.send: Callable[[Frame], None] = self.waiting.append
        """Queue a frame."""

    def candidate(self) -> Frame:
        """Return the frame that takes part in the next arbitration; of equal priorities the older one."""
        return self.waiting[0] if self.in_order or len(self.waiting) == 1 else min(self.waiting, key=arbitration_key)

    def urgency(self) -> int:
        """Return the arbitration key of that frame."""
        return arbitration_key(self.candidate())

    def take(self) -> Frame:
        """Take that frame out of the queue."""
        if self.in_order or len(self.waiting) == 1:
            return self.waiting.popleft()
        frame = self.candidate()
        self.waiting.remove(frame)
        return frame


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
        self._durations = [self.duration_ns(bits) for bits in range(LONGEST_BITS + 1)]
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
        self.sender = winner = contenders[0] if len(contenders) == 1 else min(contenders, key=Port.urgency)
        self._frame = frame = winner.take()
        bits, durations = wire_bits(frame), self._durations
        self.end_ns = end_ns = t_ns + durations[bits]
        bits += INTERMISSION_BITS
        self._free_ns = t_ns + durations[bits]
        self._ends.append(end_ns)
        self._bits.append(bits)
        # Cut only at twice the length, so that the deletion costs little per frame on average.
        if self._longest is not None and len(self._ends) > 2 * self._longest:
            del self._ends[: -self._longest], self._bits[: -self._longest]

    def finish(self) -> Frame:
        """Take the received frame off the wire and return it; raises RuntimeError when there is none."""
        if (frame := self._frame) is None:
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


# The CAN controller of a program on the simulated bus: its received frames and its bus-off state.

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
        """True while the interface is down: sending and receiving fail."""
        self.closed = False
        """True once the program has left."""
        self.lost = 0
        """Number of frames that arrived while there was no room; an error message reports it once there is room."""
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
        """Take the interface down; received and waiting frames are lost."""
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


# Disturbances of frames on the way from their sender to the receivers.
#
# Each disturbance takes the next frames of one service; the first that wants a frame gets it. What arrives is a list of
# frames, each with the time by which it comes later.

_NODE, _FUNCTION = 0x07F, 0x780
# CiA 301, 7.3.5: function codes of the predefined connection set.
_FUNCTIONS: dict[faults.FrameGroup, tuple[int, ...]] = {
    "tpdo": (0x180, 0x280, 0x380, 0x480),
    "rpdo": (0x200, 0x300, 0x400, 0x500),
    "sync": (0x080,),
    "emergency": (0x080,),
    "heartbeat": (0x700,),
    "sdo": (0x580, 0x600),
    "nmt": (0x000,),
}
_BROADCAST: tuple[faults.FrameGroup, ...] = ("sync", "nmt")


def frames_arriving(active: list[faults.Disturbance], frame: Frame) -> Sequence[tuple[int, Frame]]:
    """Return the frames that arrive for a sent frame, as (additional delay [ns], frame).

    `active` are the disturbances at work; the `count` of each is what is left of it.
    """
    for place, fault in enumerate(active):
        if _concerns(fault, frame):
            active[place : place + 1] = [replace(fault, count=fault.count - 1)] if fault.count > 1 else []
            return _disturbed(fault, frame)
    return ((0, frame),)


def _concerns(fault: faults.Disturbance, frame: Frame) -> bool:
    function, node = frame.can_id & _FUNCTION, frame.can_id & _NODE
    if frame.extended or frame.remote or function not in _FUNCTIONS[fault.frames]:
        return False
    if fault.frames in _BROADCAST:
        return node == 0
    return node != 0 and fault.node in (None, node)


def _disturbed(fault: faults.Disturbance, frame: Frame) -> Sequence[tuple[int, Frame]]:
    match fault:
        case faults.FrameDropped():
            return ()
        case faults.FrameDelayed(delay=delay):
            return ((round(delay * 1e9), frame),)
        case faults.FrameDuplicated():
            return ((0, frame), (0, frame))
        case faults.FrameWrongLength(length=length):
            return ((0, frame._replace(data=frame.data[:length].ljust(length, b"\0"))),)
        case faults.FrameWrongNode(to=to):
            return ((0, frame._replace(can_id=frame.can_id & _FUNCTION | to)),)
