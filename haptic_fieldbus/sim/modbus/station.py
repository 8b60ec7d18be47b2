"""The drives' end of a line: octets of requests in, octets of answers out.

pymodbus decodes unusual requests and frames every answer; for usual requests it would take longer than the drive.

Theory (Modbus application protocol 1.1b3). A request is checked as a whole, function, counts and addresses, before any
of it is carried out. Function 23 writes before it reads. All drives execute a broadcast request (unit 0), and none
answers. A request to a missing unit, or with a wrong checksum, gets no answer.
"""

from collections.abc import Iterator, Mapping
from struct import Struct, pack, unpack_from
from typing import NamedTuple

from pymodbus.framer import FramerBase, FramerRTU, FramerSocket
from pymodbus.pdu import DecodePDU, ModbusPDU
from pymodbus.pdu.register_message import (
    ReadHoldingRegistersRequest,
    ReadWriteMultipleRegistersRequest,
    WriteMultipleRegistersRequest,
    WriteSingleRegisterRequest,
)

from haptic_fieldbus.defaults import DEFAULT_SEED
from haptic_fieldbus.protocols.modbus.profile import READ_HOLDING, READ_INPUT, WRITE_MULTIPLE, WRITE_SINGLE
from haptic_fieldbus.sim import faults
from haptic_fieldbus.sim.modbus.drives import AnswerDisturbances, FaultyLine, SimulatedUnits
from haptic_fieldbus.sim.modbus.registers import Refusal
from haptic_fieldbus.sim.modbus.unit import Unit

LONGEST_TCP = 254
"""Largest number that the length field of an MBAP header may have: unit id and PDU."""
EVERYBODY = 0
"""Unit id of a request to all drives."""
MOST_READ = 125
"""Largest number of registers that one request may read."""
_TWO, _WRITE = Struct(">HH"), Struct(">HHB")


class ServerRequest(NamedTuple):
    """A whole request: (first address, count) of the read, (first address, values) of the write, which comes first."""

    unit: int
    transaction: int
    function: int
    reads: tuple[int, int] | None = None
    writes: tuple[int, tuple[int, ...]] | None = None
    valid: bool = True
    """False: the function or its arguments do not exist in Modbus."""


class Station:
    """The drives on one line, by unit id."""

    def __init__(self, units: Mapping[int, Unit], *, serial: bool) -> None:
        self._units = units
        self._decoder = DecodePDU(True)
        self._framer: FramerBase = (FramerRTU if serial else FramerSocket)(self._decoder)

    def next(self, octets: bytes) -> tuple[int, ServerRequest | None]:
        """Return how many octets were used, and the first request in them; (0, None) when more are needed."""
        used, unit, transaction, body = self._framer.decode(octets)
        if not used or not body:
            return used, None
        asked = usual_request(unit, transaction, body)
        return used, asked or any_request(unit, transaction, body, self._decoder.decode(body))

    def carry_out(self, asked: ServerRequest, t_ns: int) -> bytes | None:
        """Execute a request at this time and return the PDU of its answer; None without an answer."""
        if asked.unit == EVERYBODY:
            for unit in self._units.values():
                if unit.hears(t_ns):
                    _carry_out(asked, unit, t_ns)
            return None
        addressed = self._units.get(asked.unit)
        if addressed is None or not addressed.hears(t_ns):
            return None
        outcome = _carry_out(asked, addressed, t_ns)
        return exception_for(asked, outcome) if isinstance(outcome, Refusal) else outcome

    def frame(self, asked: ServerRequest, answer: bytes) -> bytes:
        """Return the octets of an answer."""
        return self._framer.encode(answer, asked.unit, asked.transaction)


def starts_no_frame(octets: bytes) -> bool:
    """Return whether octets of a TCP connection cannot begin with an MBAP header."""
    if len(octets) < 6:
        return False
    return octets[2:4] != b"\0\0" or not 2 <= int.from_bytes(octets[4:6], "big") <= LONGEST_TCP


def usual_request(unit: int, transaction: int, body: bytes) -> ServerRequest | None:
    """Return a valid request that reads or writes registers; None for every other PDU.

    The result is that of pymodbus, without its objects, which take longer than the drive.
    """
    function, size = body[0], len(body)
    if function in (READ_HOLDING, READ_INPUT) and size == 5:
        reads = _TWO.unpack_from(body, 1)
        return ServerRequest(unit, transaction, function, reads) if 1 <= reads[1] <= MOST_READ else None
    if function == WRITE_MULTIPLE and size >= 6:
        address, count, octets = _WRITE.unpack_from(body, 1)
        if octets == 2 * count == size - 6:
            return ServerRequest(unit, transaction, function, None, (address, unpack_from(f">{count}H", body, 6)))
    return None


def any_request(unit: int, transaction: int, body: bytes, pdu: ModbusPDU | None) -> ServerRequest:
    """Return a request as pymodbus decodes it; None if it cannot."""
    invalid = ServerRequest(unit, transaction, body[0] & 0x7F, valid=False)
    if pdu is None:
        return invalid
    asked = invalid._replace(function=pdu.function_code)
    if isinstance(pdu, ReadHoldingRegistersRequest):  # the request for input registers is one of them
        return asked._replace(reads=(pdu.address, pdu.count), valid=True)
    if isinstance(pdu, WriteSingleRegisterRequest):
        return asked._replace(writes=(pdu.address, tuple(pdu.registers)), valid=True)
    if isinstance(pdu, WriteMultipleRegistersRequest):
        whole = pdu.count == len(pdu.registers) == (pdu.byte_count or 0) // 2
        return asked._replace(writes=(pdu.address, tuple(pdu.registers)), valid=whole)
    if isinstance(pdu, ReadWriteMultipleRegistersRequest):
        whole = pdu.write_count == len(pdu.write_registers) == pdu.write_byte_count // 2
        written = (pdu.write_address, tuple(pdu.write_registers))
        return asked._replace(reads=(pdu.read_address, pdu.read_count), writes=written, valid=whole)
    return asked


def exception_for(asked: ServerRequest, code: int) -> bytes:
    """Return the exception by which a request is refused."""
    return bytes((asked.function | 0x80, code))


def _carry_out(asked: ServerRequest, unit: Unit, t_ns: int) -> bytes | Refusal:
    function, reads, writes = asked.function, asked.reads, asked.writes
    if not unit.has(function):
        return Refusal.FUNCTION
    if not asked.valid:  # its function is known, so what it asks for cannot be
        return Refusal.VALUE
    if writes is not None:
        # What cannot be read keeps the drive from writing too.
        outcome = unit.cannot_read(function, *reads) if reads is not None else None
        outcome = outcome or unit.write(*writes, t_ns)
        if outcome is not None:
            return outcome
    if reads is None:
        address, values = writes or (0, ())
        return bytes((function,)) + _TWO.pack(address, values[0] if function == WRITE_SINGLE else len(values))
    words = unit.read(function, *reads, t_ns)
    return words if isinstance(words, Refusal) else pack(f">BB{len(words)}H", function, 2 * len(words), *words)


# Requests carried out and answered, with the faults of the answers: what a line in virtual time and a server share.


class RequestServer:
    """The drives of a line behind octets; all times are those of one clock [ns]."""

    def __init__(
        self, line: FaultyLine, seed: int | str = DEFAULT_SEED, *, serial: bool, longest: int | None = None
    ) -> None:
        self.rack = SimulatedUnits(line, seed, longest)
        self.station = Station(self.rack.units, serial=serial)
        self.disturbances = AnswerDisturbances(seed, serial=serial)

    def answer(self, asked: ServerRequest, t_ns: int) -> Iterator[tuple[int, bytes]]:
        """Execute a request; yield the frames that arrive as its answer: additional delay [ns] and octets."""
        unit = self.rack.units.get(asked.unit)
        fault = self.disturbances.take(asked.unit) if unit is not None and unit.hears(t_ns) else None
        if isinstance(fault, faults.AnswerException):
            answer = exception_for(asked, fault.code)
        else:
            found = self.station.carry_out(asked, t_ns)
            if found is None:
                return
            answer = found
        if isinstance(fault, faults.AnswerWrongUnit):
            asked = asked._replace(unit=fault.to)
        octets = self.station.frame(asked, answer)
        if fault is None:
            yield 0, octets
        else:
            yield from self.disturbances.arriving(fault, octets)
