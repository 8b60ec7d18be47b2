"""The drives' end of a line: octets of requests in, octets of answers out.

pymodbus decodes unusual requests and frames every answer; for usual requests it would take longer than the drive.

Theory (Modbus application protocol 1.1b3). A request is checked as a whole, function, counts and addresses, before any
of it is carried out. Function 23 writes before it reads. All drives execute a broadcast request (unit 0), and none
answers. A request to a missing unit, or with a wrong checksum, gets no answer.
"""

from collections.abc import Iterable, Sequence
from struct import Struct
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
from haptic_fieldbus.sim.modbus.drives import AnswerDisturbances, InjectLine, SimulatedUnits
from haptic_fieldbus.sim.modbus.registers import Refusal
from haptic_fieldbus.sim.modbus.unit import Unit

LONGEST_TCP = 254
"""Largest number that the length field of an MBAP header may have: unit id and PDU."""
EVERYBODY = 0
"""Unit id of a request to all drives."""
MOST_READ = 125
"""Largest number of registers that one request may read."""
_TWO, _WRITE, _MBAP = Struct(">HH"), Struct(">HHB"), Struct(">HHHB")
_HEADER_OCTETS = 6
"""Octets of an MBAP header before its unit id."""


class ServerRequest(NamedTuple):
    """A whole request: (first address, count) of the read, (first address, octets) of the write, which comes first."""

    unit: int
    transaction: int
    function: int
    reads: tuple[int, int] | None = None
    writes: tuple[int, bytes] | None = None
    valid: bool = True
    """False: the function or its arguments do not exist in Modbus."""


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
            return ServerRequest(unit, transaction, function, None, (address, body[6:]))
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
        return asked._replace(writes=(pdu.address, _octets_of(pdu.registers)), valid=True)
    if isinstance(pdu, WriteMultipleRegistersRequest):
        whole = pdu.count == len(pdu.registers) == (pdu.byte_count or 0) // 2
        return asked._replace(writes=(pdu.address, _octets_of(pdu.registers)), valid=whole)
    if isinstance(pdu, ReadWriteMultipleRegistersRequest):
        whole = pdu.write_count == len(pdu.write_registers) == pdu.write_byte_count // 2
        written = (pdu.write_address, _octets_of(pdu.write_registers))
        return asked._replace(reads=(pdu.read_address, pdu.read_count), writes=written, valid=whole)
    return asked


def _octets_of(registers: Sequence[int]) -> bytes:
    return b"".join(register.to_bytes(2, "big") for register in registers)


def exception_for(asked: ServerRequest, code: int) -> bytes:
    """Return the exception by which a request is refused."""
    return bytes((asked.function | 0x80, code))


def _carry_out(asked: ServerRequest, unit: Unit, t_ns: int) -> bytes | Refusal:
    function, reads, writes = asked.function, asked.reads, asked.writes
    if function not in unit.functions:
        return Refusal.FUNCTION
    if not asked.valid:  # its function is known, so what it asks for cannot be
        return Refusal.VALUE
    if writes is not None:
        # What cannot be read keeps the drive from writing too.
        reader = None if reads is None else unit.registers.reader(function, *reads)
        refusal = reader if isinstance(reader, Refusal) else unit.write(*writes, t_ns)
        if refusal is not None:
            return refusal
    if reads is None:
        address, octets = writes or (0, b"")
        count = octets if function == WRITE_SINGLE else (len(octets) // 2).to_bytes(2, "big")
        return bytes((function,)) + address.to_bytes(2, "big") + count
    data = unit.read(function, *reads, t_ns)
    return data if isinstance(data, Refusal) else bytes((function, len(data))) + data


# Requests carried out and answered, with the faults of the answers: what a line in virtual time and a server share.


class RequestServer:
    """The drives of a line behind octets; all times are those of one clock [ns]."""

    def __init__(
        self, inject_line: InjectLine, seed: int | str = DEFAULT_SEED, *, serial: bool, longest: int | None = None
    ) -> None:
        self.drives = SimulatedUnits(inject_line, seed, longest)
        self.disturbances = AnswerDisturbances(seed, serial=serial)
        self._units, self._serial, self._decoder = self.drives.units, serial, DecodePDU(True)
        self._framer: FramerBase = (FramerRTU if serial else FramerSocket)(self._decoder)

    def next(self, octets: bytes) -> tuple[int, ServerRequest | None]:
        """Return how many octets were used, and the first request in them; (0, None) when more are needed."""
        if not self._serial and len(octets) > _MBAP.size:
            # The usual case on TCP: one whole request and nothing else.
            transaction, protocol, length, unit = _MBAP.unpack_from(octets)
            is_whole = not protocol and length == len(octets) - _HEADER_OCTETS
            if is_whole and (asked := usual_request(unit, transaction, octets[_MBAP.size :])) is not None:
                return len(octets), asked
        used, unit, transaction, body = self._framer.decode(octets)
        if not used or not body:
            return used, None
        asked = usual_request(unit, transaction, body)
        return used, asked or any_request(unit, transaction, body, self._decoder.decode(body))

    def carry_out(self, asked: ServerRequest, t_ns: int) -> bytes | None:
        """Execute a request at this time and return the PDU of its answer; None without an answer."""
        addressed = self._units.get(asked.unit)
        if addressed is not None and addressed.hears(t_ns):
            outcome = _carry_out(asked, addressed, t_ns)
            return outcome if isinstance(outcome, bytes) else exception_for(asked, outcome)
        if asked.unit == EVERYBODY:
            for unit in self._units.values():
                if unit.hears(t_ns):
                    _carry_out(asked, unit, t_ns)
        return None

    def frame(self, asked: ServerRequest, answer: bytes) -> bytes:
        """Return the octets of an answer."""
        if self._serial:
            return self._framer.encode(answer, asked.unit, asked.transaction)
        return _MBAP.pack(asked.transaction, 0, len(answer) + 1, asked.unit) + answer

    def answer(self, asked: ServerRequest, t_ns: int) -> Iterable[tuple[int, bytes]]:
        """Execute a request; return the frames that arrive as its answer: additional delay [ns] and octets."""
        unit, fault = self.drives.units.get(asked.unit), None
        if self.disturbances.waiting and unit is not None and unit.hears(t_ns):
            fault = self.disturbances.take(asked.unit)
        if isinstance(fault, faults.AnswerException):
            answer: bytes | None = exception_for(asked, fault.code)
        else:
            answer = self.carry_out(asked, t_ns)
        if answer is None:
            return ()
        if isinstance(fault, faults.AnswerWrongUnit):
            asked = asked._replace(unit=fault.to)
        octets = self.frame(asked, answer)
        return ((0, octets),) if fault is None else self.disturbances.arriving(fault, octets)
