"""The process data of one unit: its blocks of registers, and the requests that carry them in each period."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from enum import Enum

from haptic_fieldbus.drive.objects import DataType, Order
from haptic_fieldbus.drive.profile import MappedSignal
from haptic_fieldbus.numerals import rounded
from haptic_fieldbus.protocols.modbus.line import LineTimes
from haptic_fieldbus.protocols.modbus.profile import READ_WRITE, LineSection
from haptic_fieldbus.protocols.modbus.requests import Block, RegisterRequest
from haptic_fieldbus.protocols.traffic import Json
from haptic_fieldbus.signals import LinkFlag, Signal


class Transaction(Enum):
    """How feedback and set-point are exchanged in a period; the value is its description."""

    READ_WRITE = "one request writes and reads"
    """Function 23 in the reading part of a period. It writes before it reads, so its write carries the torque of the
    period before."""
    READ_THEN_WRITE = "a request reads, another one writes"
    """All drives are read; the torque is computed; all drives are written."""


@dataclass(frozen=True)
class RegisterTraffic:
    """Blocks of one unit; incoming and outgoing are meant from the side of the master."""

    unit: int
    reads: tuple[Block, ...]
    """The block with the motion first."""
    set_point: Block
    """Target torque, with the command where that stands beside it."""
    command: Block | None = None
    """Command of the power stage by itself, written in the place of the set-point when it changes; None: it is a part
    of `set_point`."""
    reading: tuple[RegisterRequest, ...] = ()
    """Requests before the torque is computed; empty until the way is chosen."""
    writing: tuple[RegisterRequest, ...] = ()
    """Requests after it; empty where function 23 writes."""
    times: tuple[float, ...] = ()
    """Time of each request with its answer [s], in the order of `requests`."""
    octets: tuple[int, ...] = ()
    """Octets of each request with its answer."""
    watching: tuple[Block, ...] = ()
    """Blocks that function 23 reads in the place of `reads`: it writes first, and then torque actual alone still shows
    which set-point of another master it has replaced. Empty: `reads` will do, or the drive has no such register."""
    read_back: Block | None = None
    """Target torque, to be read back before it is written; None where that is never needed, or cannot be."""
    read_back_ways: tuple[Transaction, ...] = ()
    """Ways by which no other register shows a set-point of another master."""
    asked: Block | None = None
    """`read_back` where the way that was chosen needs it; one unit of a line is asked in each period."""

    @property
    def requests(self) -> tuple[RegisterRequest, ...]:
        """All requests of a period, in their order."""
        return self.reading + self.writing

    @property
    def incoming(self) -> tuple[MappedSignal, ...]:
        found = tuple(mapped for block in self.reads for mapped in block.signals)
        return found if self.asked is None else (*found, *read_back_signals(self.asked))

    @property
    def outgoing(self) -> tuple[MappedSignal, ...]:
        return self.set_point.signals + (self.command.signals if self.command else ())

    @property
    def motion(self) -> Signal:
        """Signal from which the loop has the motion of the handle."""
        found = [mapped.signal for mapped in self.incoming]
        return Signal.POSITION if Signal.POSITION in found else Signal.VELOCITY

    def requested(self, way: Transaction, line: LineTimes, section: LineSection) -> "RegisterTraffic":
        """Return the same blocks with the requests of that way, which must be possible (`possible`)."""
        reads = self.watching if self.watching and way is Transaction.READ_WRITE else self.reads
        reading, writing = _requests(replace(self, reads=reads), way, section)
        both = (*reading, *writing)
        return replace(
            self,
            reads=reads,
            asked=self.read_back if way in self.read_back_ways else None,
            reading=reading,
            writing=writing,
            times=tuple(line.exchange(each, section.answer_time) for each in both),
            octets=tuple(line.octets(each) for each in both),
        )

    def lines(self) -> Iterator[tuple[str, str]]:
        """Yield each request with its function, size and time, followed by its registers."""
        for request, time, octets in zip(self.requests, self.times, self.octets, strict=True):
            key = "out" if request.read is None else "in" if request.write is None else "in, out"
            yield key, f"unit {self.unit}, function {request.function}, {octets} octets, {rounded(1e3 * time)} ms"
            for word, block in (("writes", request.write), ("reads", request.read)):
                yield from _block_lines(word, block)
        if self.command is not None:
            yield "", "  in its place, when it changes"
            yield from _block_lines("writes", self.command)
        if self.asked is not None:
            yield "in", f"unit {self.unit}, before it is written, one unit of the line in each period"
            yield from _block_lines("reads", self.asked)

    def summary(self) -> Iterator[str]:
        """Yield a line for each request with its signals."""
        for request in self.requests:
            words = [f"{word} {_names(block)}" for word, block in _parts(request)]
            yield f"function {request.function} {', '.join(words)}"
        if self.asked is not None:
            yield f"one unit in each period: reads {_names(self.asked)}"

    def to_json(self, bus: str) -> dict[str, list[Json]]:
        """Return the `registers` of `plan --json`."""
        timed = zip(self.requests, self.times, self.octets, strict=True)
        return {"registers": [self._row(bus, request, time, octets) for request, time, octets in timed]}

    def _row(self, bus: str, request: RegisterRequest, time: float, octets: int) -> Json:
        return {
            "bus": bus,
            "unit": self.unit,
            "function": request.function,
            "octets": octets,
            "time_s": time,
            "read": _block_json(request.read),
            "write": _block_json(request.write),
            "command": _block_json(self.command if request.write is not None else None),
        }

    def fault_text(self, flag: LinkFlag, code: int, bus: str = "the line") -> str:
        """Return a link fault in the terms of Modbus; raises KeyError for STALE, which is no fault."""
        words = f"{code} ({EXCEPTIONS.get(code, 'not one of the standard')})"
        return FAULT_TEXTS[flag].format(unit=self.unit, code=f"{code:04X}h", exception=words, bus=bus)


EXCEPTIONS = {
    1: "illegal function",
    2: "illegal data address",
    3: "illegal data value",
    4: "server device failure",
    5: "acknowledge",
    6: "server device busy",
    8: "memory parity error",
    10: "gateway path unavailable",
    11: "gateway target device failed to respond",
}
"""Exception codes (Modbus application protocol 1.1b3, 7)."""
FAULT_TEXTS = {
    LinkFlag.BUS_OFF: "the line is dead: the connection was closed, or the serial device is gone",
    LinkFlag.BOOT_UP: "unit {unit} restarted",
    LinkFlag.NO_SIGN_OF_LIFE: "unit {unit} does not answer",
    LinkFlag.NOT_OPERATIONAL: "unit {unit} left the mode in which it follows its target torque",
    LinkFlag.EMERGENCY: "unit {unit} reports the fault {code}",
    LinkFlag.EXCEPTION: "unit {unit} refused a request with exception {exception}",
    LinkFlag.FOREIGN: "another master on {bus} writes to register {code} of unit {unit}; end that master, and put axes "
    "that share a line into one rig",
    LinkFlag.DUPLICATE: "unit {unit} answered more often than it was asked",
}


def read_back_signals(asked: Block) -> tuple[MappedSignal, ...]:
    """Return the signals of a target torque that is read back: its value, and whether it came in this period."""
    (value,) = asked.signals
    return value, MappedSignal(Signal.ASKED_PERIODS, value.address, DataType.UINT16, order=Order.BIG)


def possible(way: Transaction, traffic: RegisterTraffic, section: LineSection) -> bool:
    """Return True when a drive has the functions that a way needs."""
    if way is Transaction.READ_WRITE:
        return READ_WRITE in section.functions and (len(traffic.reads) == 1 or section.reading is not None)
    written = (traffic.set_point, *((traffic.command,) if traffic.command else ()))
    return section.reading is not None and all(section.writing(block.count) for block in written)


def _requests(
    traffic: RegisterTraffic, way: Transaction, section: LineSection
) -> tuple[tuple[RegisterRequest, ...], tuple[RegisterRequest, ...]]:
    """Return the requests before and after computing.

    Raises ValueError when the drive lacks a function that they need.
    """
    reading = [RegisterRequest(section.reading, block) for block in traffic.reads if section.reading is not None]
    if way is Transaction.READ_WRITE:
        return (RegisterRequest(READ_WRITE, traffic.reads[0], traffic.set_point), *reading[1:]), ()
    function = section.writing(traffic.set_point.count)
    if function is None or len(reading) < len(traffic.reads):
        raise ValueError(f"unit {traffic.unit} has no functions for {way}")
    # The motion is read last, so that it is the youngest.
    return tuple(reading[::-1]), (RegisterRequest(function, write=traffic.set_point),)


def _parts(request: RegisterRequest) -> Iterator[tuple[str, Block]]:
    """Yield what a request writes and reads, in the order in which the drive does it."""
    for word, block in (("writes", request.write), ("reads", request.read)):
        if block is not None:
            yield word, block


def _names(block: Block) -> str:
    return ", ".join(mapped.signal.value for mapped in block.signals)


def _block_lines(word: str, block: Block | None) -> Iterator[tuple[str, str]]:
    if block is None:
        return
    through = f", {block.gaps} of them read through" if block.gaps else ""
    yield "", f"  {word} {block.count} from {block.address:04X}h{through}"
    for mapped in block.signals:
        yield "", f"    {mapped.address}"


def _block_json(block: Block | None) -> Json:
    if block is None:
        return None
    mapped: list[Json] = [each.address for each in block.signals]
    return {"address": block.address, "count": block.count, "read_through": block.gaps, "mapped": mapped}
