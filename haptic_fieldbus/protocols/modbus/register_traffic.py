"""The process data of one unit: its blocks of registers, and the requests that carry them in each period."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from enum import Enum

from haptic_fieldbus.drive.profile import DataType, MappedSignal, Order
from haptic_fieldbus.errors import ImageTooLargeError
from haptic_fieldbus.numerals import rounded
from haptic_fieldbus.protocols.modbus.profile import (
    READ_WRITE,
    WRITE_MULTIPLE,
    WRITE_SINGLE,
    LineSection,
    ModbusProfile,
    Register,
)
from haptic_fieldbus.protocols.traffic import Json
from haptic_fieldbus.signals import LinkFlag, Signal

# Registers that are exchanged with one drive in each period, laid out in as few requests as pay.
#
# Signals in adjacent registers share a block. A gap is read through where that is cheaper than a request of its own and
# the profile says that the registers in it exist; nothing that was not asked for is ever written.


@dataclass(frozen=True)
class Block:
    """Registers in a row, which one request reads or writes."""

    address: int
    count: int
    signals: tuple[MappedSignal, ...]
    """In the order of their addresses."""
    offsets: tuple[int, ...]
    """Place of each signal in the octets of the block."""

    @property
    def places(self) -> Iterator[tuple[int, int]]:
        """Yield the first octet of each signal in the octets of the block, and the one behind its last."""
        for offset, mapped in zip(self.offsets, self.signals, strict=True):
            yield offset, offset + mapped.type.size

    @property
    def gaps(self) -> int:
        """Registers that are read without being used, between two that are."""
        return self.count - sum(mapped.type.size for mapped in self.signals) // 2

    def has(self, signal: Signal) -> bool:
        return any(mapped.signal is signal for mapped in self.signals)


@dataclass(frozen=True)
class RegisterRequest:
    """One request to a drive: its function, and what it reads and writes."""

    function: int
    read: Block | None = None
    write: Block | None = None


def blocks(profile: ModbusProfile, signals: Sequence[Signal], longest: int, largest_gap: int) -> tuple[Block, ...]:
    """Return blocks with these signals, by address; gaps of at most `largest_gap` registers are read through.

    Raises ImageTooLargeError when one signal is longer than a request may be.
    """
    registers = profile.registers()
    groups: list[list[tuple[Signal, Register]]] = []
    first = end = 0  # of the last group
    for signal in sorted(signals, key=lambda each: registers[each].address):
        own = registers[signal]
        if own.count > longest:
            raise ImageTooLargeError(f"{signal.value} needs {own.count} registers; a request may have {longest}")
        gap, last = own.address - end, own.address + own.count
        is_near = gap == 0 or (0 < gap <= largest_gap and profile.line.has_all(end, own.address))
        if not groups or not is_near or last - first > longest:
            groups.append([])
            first = own.address
        groups[-1].append((signal, own))
        end = last
    return tuple(_block(profile, group) for group in groups)


def _block(profile: ModbusProfile, members: Sequence[tuple[Signal, Register]]) -> Block:
    first, last = members[0][1].address, members[-1][1]
    signals = tuple(profile.mapped(signal, register) for signal, register in members)
    offsets = tuple(2 * (register.address - first) for _, register in members)
    return Block(first, last.address + last.count - first, signals, offsets)


# What requests and answers take on a line: octets of each function, characters, silence, answer time.
#
# A request is sent. The drive knows its end by the silence after it, and works for its answer time, at the end of which
# it writes and reads its registers; then the answer is sent, and again there is silence. On RTU every octet takes a
# character of 10 or 11 bits. On TCP a frame takes no time of its own and its length is told; the network and both
# stacks take `round_trip` for a request and its answer together, half of it on each way.
#
# Reference: Modbus application protocol 1.1b3, 6.3, 6.6, 6.12, 6.17; Modbus over serial line 1.02, 2.5.1.1.

RTU_OCTETS, TCP_OCTETS = 3, 7
"""Octets of a frame beside its PDU: unit and checksum; MBAP header."""
SILENT_CHARACTERS, LONGEST_SILENCE, SILENT_ABOVE = 3.5, 1.75e-3, 19200
"""Silence between frames: 3.5 characters, and 1.75 ms at more than 19200 bit/s."""
ROUND_TRIP = 0.25e-3
"""[s], of a network whose rig does not state it, the simulated one included: a switch, and the stacks of both ends."""


@dataclass(frozen=True)
class LineTimes:
    """Times of one line [s]."""

    octet: float
    """Time of one character; 0 on TCP."""
    silence: float
    """Silence that ends a frame and separates it from the next; 0 on TCP."""
    round_trip: float
    """Time that network, adapter and stacks take for a request and its answer."""
    frame_octets: int = RTU_OCTETS
    speed: str = ""
    """The line in words."""

    def executed(self, request: RegisterRequest, answer_time: float) -> float:
        """Return the time from the first octet of a request until the drive writes and reads [s]."""
        sent = self.octet * (self.frame_octets + request_octets(request)) + 0.5 * self.round_trip
        return sent + self.silence + answer_time

    def answer_duration(self, request: RegisterRequest) -> float:
        """Return the time from the begin of an answer until the master has all of it [s]."""
        return self.octet * (self.frame_octets + answer_octets(request)) + 0.5 * self.round_trip

    def exchange(self, request: RegisterRequest, answer_time: float) -> float:
        """Return the time from the first octet of a request to the last one of its answer [s]."""
        return self.executed(request, answer_time) + self.answer_duration(request)

    def octets(self, request: RegisterRequest) -> int:
        """Return the octets of a request and its answer."""
        return 2 * self.frame_octets + request_octets(request) + answer_octets(request)


def serial_line(baud: int, bits: int, silence: float | None, round_trip: float = 0.0) -> LineTimes:
    """Return an RTU line of `baud` bit/s with characters of so many bits; `silence` None: that of the standard."""
    character, speed = bits / baud, f"Modbus RTU at {baud} bit/s"
    standard = LONGEST_SILENCE if baud > SILENT_ABOVE else SILENT_CHARACTERS * character
    return LineTimes(character, standard if silence is None else silence, round_trip, speed=speed)


def tcp_line(round_trip: float | None) -> LineTimes:
    """Return a TCP line; `round_trip` None: that which is assumed."""
    return LineTimes(0.0, 0.0, ROUND_TRIP if round_trip is None else round_trip, TCP_OCTETS, "Modbus TCP")


def request_octets(request: RegisterRequest) -> int:
    """Return the octets of the PDU of a request."""
    written = 0 if request.write is None else 2 * request.write.count
    fixed = {READ_WRITE: 10, WRITE_MULTIPLE: 6, WRITE_SINGLE: 3}
    return fixed.get(request.function, 5) + written


def answer_octets(request: RegisterRequest) -> int:
    """Return the octets of the PDU of its answer."""
    return 5 if request.read is None else 2 + 2 * request.read.count


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
        """Return the same blocks with the requests of that way.

        It must be `possible`; raises ValueError when the drive lacks a function that they need.
        """
        reads = self.watching if self.watching and way is Transaction.READ_WRITE else self.reads
        read = [RegisterRequest(section.reading, block) for block in reads if section.reading is not None]
        function = section.writing(self.set_point.count)
        if way is Transaction.READ_WRITE:
            reading, writing = [RegisterRequest(READ_WRITE, reads[0], self.set_point), *read[1:]], []
        elif function is None or len(read) < len(reads):
            raise ValueError(f"unit {self.unit} has no functions for {way}")
        else:
            # The motion is read last, so that it is the youngest.
            reading, writing = read[::-1], [RegisterRequest(function, write=self.set_point)]
        both = [*reading, *writing]
        return replace(
            self,
            reads=reads,
            asked=self.read_back if way in self.read_back_ways else None,
            reading=tuple(reading),
            writing=tuple(writing),
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
            # In the order in which the drive does it.
            both = (("writes", request.write), ("reads", request.read))
            words = [f"{word} {_names(block)}" for word, block in both if block is not None]
            yield f"function {request.function} {', '.join(words)}"
        if self.asked is not None:
            yield f"one unit in each period: reads {_names(self.asked)}"

    def to_json(self, bus: str) -> dict[str, list[Json]]:
        """Return the `registers` of `plan --json`."""
        return {
            "registers": [
                {
                    "bus": bus,
                    "unit": self.unit,
                    "function": request.function,
                    "octets": octets,
                    "time_s": time,
                    "read": _block_json(request.read),
                    "write": _block_json(request.write),
                    "command": _block_json(self.command if request.write is not None else None),
                }
                for request, time, octets in zip(self.requests, self.times, self.octets, strict=True)
            ]
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
    LinkFlag.NOT_OPERATIONAL: "unit {unit} left its torque mode",
    LinkFlag.EMERGENCY: "unit {unit} reports the fault {code}",
    LinkFlag.EXCEPTION: "unit {unit} refused a request with exception {exception}",
    LinkFlag.FOREIGN: "another master on {bus} writes register {code} of unit {unit}; end that master, and put axes "
    "that share a line into one rig",
    LinkFlag.DUPLICATE: "unit {unit} sent more answers than requests",
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
