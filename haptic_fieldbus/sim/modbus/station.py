"""The drives' end of a line: octets of requests in, octets of answers out, encoded and decoded by pymodbus.

Theory (Modbus application protocol 1.1b3). A request is checked as a whole, function, counts and addresses, before any
of it is carried out. Function 23 writes before it reads. A request to everybody (unit 0) is carried out by all and
answered by none; one to a unit that is not there, or whose checksum is wrong, is answered by nobody.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

from pymodbus.exceptions import ModbusException
from pymodbus.framer import FramerBase, FramerRTU, FramerSocket
from pymodbus.pdu import DecodePDU, ExceptionResponse, ModbusPDU
from pymodbus.pdu.register_message import (
    ReadHoldingRegistersRequest,
    ReadHoldingRegistersResponse,
    ReadInputRegistersResponse,
    ReadWriteMultipleRegistersRequest,
    ReadWriteMultipleRegistersResponse,
    WriteMultipleRegistersRequest,
    WriteMultipleRegistersResponse,
    WriteSingleRegisterRequest,
    WriteSingleRegisterResponse,
)

from haptic_fieldbus.defaults import DEFAULT_SEED
from haptic_fieldbus.protocols.modbus.profile import READ_INPUT
from haptic_fieldbus.sim import faults
from haptic_fieldbus.sim.modbus.drives import AnswerDisturbances, FaultyLine, SimulatedUnits
from haptic_fieldbus.sim.modbus.registers import Refusal
from haptic_fieldbus.sim.modbus.unit import Unit

LONGEST_TCP = 254
"""Largest number that the length field of an MBAP header may have: unit id and PDU."""
EVERYBODY = 0
"""Unit id of a request to all drives."""


@dataclass(frozen=True)
class ServerRequest:
    """A whole request; `pdu` None: its function, or what it asks for, is none of Modbus."""

    unit: int
    transaction: int
    function: int
    pdu: ModbusPDU | None


class Station:
    """The drives on one line, by unit id."""

    def __init__(self, units: Mapping[int, Unit], *, serial: bool) -> None:
        self._units = units
        self._framer: FramerBase = (FramerRTU if serial else FramerSocket)(DecodePDU(True))

    def next(self, octets: bytes) -> tuple[int, ServerRequest | None]:
        """Return how many octets were used, and the first request in them; (0, None) when more are needed."""
        try:
            used, pdu = self._framer.handleFrame(octets, 0, 0)
        except ModbusException as error:
            # The frame is whole, but pymodbus knows no such function, or no such count.
            used, unit, transaction, data = self._framer.decode(octets)
            return used, ServerRequest(unit, transaction, data[0] & 0x7F, None) if data and error else None
        return used, None if pdu is None else ServerRequest(pdu.dev_id, pdu.transaction_id, pdu.function_code, pdu)

    def carry_out(self, asked: ServerRequest, t_ns: int) -> ModbusPDU | None:
        """Carry a request out at this time and return its answer; None when nobody answers."""
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

    def frame(self, asked: ServerRequest, answer: ModbusPDU) -> bytes:
        """Return the octets of an answer."""
        answer.dev_id, answer.transaction_id = asked.unit, asked.transaction
        return self._framer.buildFrame(answer)


def starts_no_frame(octets: bytes) -> bool:
    """Return whether octets of a TCP connection cannot begin with an MBAP header."""
    if len(octets) < 6:
        return False
    return octets[2:4] != b"\0\0" or not 2 <= int.from_bytes(octets[4:6], "big") <= LONGEST_TCP


def exception_for(asked: ServerRequest, code: int) -> ModbusPDU:
    """Return the exception by which a request is refused."""
    return ExceptionResponse(asked.function, code)


def _carry_out(asked: ServerRequest, unit: Unit, t_ns: int) -> ModbusPDU | Refusal:
    pdu = asked.pdu
    if not unit.has(asked.function):
        return Refusal.FUNCTION
    if pdu is None:  # its function is known, so what it asks for cannot be
        return Refusal.VALUE
    if isinstance(pdu, ReadHoldingRegistersRequest):  # the request for input registers is one of them
        words = unit.read(asked.function, pdu.address, pdu.count, t_ns)
        answer = ReadInputRegistersResponse if asked.function == READ_INPUT else ReadHoldingRegistersResponse
        return words if isinstance(words, Refusal) else answer(registers=words)
    if isinstance(pdu, WriteSingleRegisterRequest):
        return unit.write(pdu.address, pdu.registers, t_ns) or WriteSingleRegisterResponse(
            address=pdu.address, registers=pdu.registers
        )
    if isinstance(pdu, WriteMultipleRegistersRequest):
        if not pdu.count == len(pdu.registers) == (pdu.byte_count or 0) // 2:
            return Refusal.VALUE
        return unit.write(pdu.address, pdu.registers, t_ns) or WriteMultipleRegistersResponse(
            address=pdu.address, count=pdu.count
        )
    return _read_write(pdu, unit, t_ns) if isinstance(pdu, ReadWriteMultipleRegistersRequest) else Refusal.FUNCTION


def _read_write(pdu: ReadWriteMultipleRegistersRequest, unit: Unit, t_ns: int) -> ModbusPDU | Refusal:
    if not pdu.write_count == len(pdu.write_registers) == pdu.write_byte_count // 2:
        return Refusal.VALUE
    # What cannot be read keeps the drive from writing too.
    outcome = unit.cannot_read(pdu.function_code, pdu.read_address, pdu.read_count)
    outcome = outcome or unit.write(pdu.write_address, pdu.write_registers, t_ns)
    if outcome is not None:
        return outcome
    words = unit.read(pdu.function_code, pdu.read_address, pdu.read_count, t_ns)
    return words if isinstance(words, Refusal) else ReadWriteMultipleRegistersResponse(registers=words)


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
        """Carry a request out; yield what arrives as its answer: by how much later [ns], and the octets."""
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
            asked = replace(asked, unit=fault.to)
        yield from self.disturbances.arriving(fault, self.station.frame(asked, answer))
