"""Frames of Modbus by pymodbus's framers and PDUs, and the proof that an answer belongs to its request.

pymodbus leaves some things to its caller:

- RTU has no transaction id, so the answer to an earlier request looks like the right one. Whoever asks drops all octets
  before each request; function and sizes are compared here.
- A bad checksum and an answer of another unit both come back as octets used and no frame; here they have two names.
- A byte count that does not fit what was asked for is no fault to it; here it is.
- In front of a frame it hunts through octets that are none, and drops all that stands behind it.

Reference: Modbus application protocol 1.1b3, clause 7 (exceptions); Modbus over serial line 1.02, 2.5.1.2 (CRC).
"""

import logging
import struct
from dataclasses import dataclass
from enum import Enum

from pymodbus.exceptions import ModbusException
from pymodbus.framer import FramerRTU, FramerSocket
from pymodbus.pdu import DecodePDU, ExceptionResponse, ModbusPDU
from pymodbus.pdu.register_message import (
    ReadHoldingRegistersRequest,
    ReadInputRegistersRequest,
    ReadWriteMultipleRegistersRequest,
    WriteMultipleRegistersRequest,
    WriteSingleRegisterRequest,
)

from haptic_fieldbus.protocols.modbus.profile import READ_INPUT, READ_WRITE, WRITE_MULTIPLE, WRITE_SINGLE

# What pymodbus notes of a frame that it does not understand is told here; it must not fall back to standard error.
logging.getLogger("pymodbus").addHandler(logging.NullHandler())

HEADER_OCTETS, LONGEST_TCP = 6, 254
"""Octets of an MBAP header before its unit id; largest number that its length field may have: unit id and PDU."""
REFUSED = (ModbusException, ValueError, IndexError, struct.error)
"""Exceptions by which pymodbus refuses octets."""


class Surprise(Enum):
    """Octets that were dropped, as a part of a sentence."""

    GARBAGE = "were no frame, or had a wrong checksum"
    UNIT = "came from another unit"
    EARLIER = "answered an earlier request"
    SIZE = "did not fit what was asked for"


@dataclass(frozen=True)
class Question:
    """A request to a unit: what is read, or written, or both; `values` are registers of 16 bits."""

    unit: int
    function: int
    address: int
    count: int
    """Registers that are read; 0: none."""
    values: tuple[int, ...] = ()
    write_address: int = 0
    """With FC23 alone; else values are written to `address`."""

    def pdu(self) -> ModbusPDU:
        """Return the request as pymodbus encodes it."""
        if self.function == READ_WRITE:
            return ReadWriteMultipleRegistersRequest(
                self.address, self.count, self.write_address, self.values, dev_id=self.unit
            )
        if self.function == WRITE_MULTIPLE:
            return WriteMultipleRegistersRequest(dev_id=self.unit, address=self.address, registers=self.values)
        if self.function == WRITE_SINGLE:
            return WriteSingleRegisterRequest(dev_id=self.unit, address=self.address, registers=self.values)
        kind = ReadInputRegistersRequest if self.function == READ_INPUT else ReadHoldingRegistersRequest
        return kind(dev_id=self.unit, address=self.address, count=self.count)


@dataclass(frozen=True)
class Answer:
    """The answer to a question: registers that were read, or the code of an exception."""

    registers: tuple[int, ...] = ()
    exception: int | None = None


class Framing:
    """Frames of one line, RTU when it is `serial`, else TCP; it remembers the question that is under way."""

    def __init__(self, *, serial: bool) -> None:
        self._serial = serial
        self._decoder = DecodePDU(False)
        self._framer = FramerRTU(self._decoder) if serial else FramerSocket(self._decoder)
        self._transaction = 0
        self._asked: Question | None = None

    def frame(self, question: Question) -> bytes:
        """Return the frame of a question; answers are compared with it from now on."""
        # 0 is left out, as pymodbus takes it for no transaction id at all.
        self._transaction = self._transaction % 0xFFFF + 1
        self._asked = question
        pdu = question.pdu()
        pdu.transaction_id = self._transaction
        return self._framer.buildFrame(pdu)

    def take(self, octets: bytes) -> tuple[int, Answer | Surprise | None]:
        """Return how many octets are done with, and what they were; (0, None) while a frame is not complete."""
        if not self._serial and self._no_header(octets):
            return len(octets), Surprise.GARBAGE
        try:
            used, unit, transaction, body = self._framer.decode(octets)
            if not used:
                return 0, None
            judged = self._judge(unit, transaction, body)
        except REFUSED:
            return len(octets), Surprise.GARBAGE
        if isinstance(judged, Answer):
            self._asked = None  # the same answer once more answers nothing
        return used, judged

    def _no_header(self, octets: bytes) -> bool:
        """Whether octets that must begin with an MBAP header do not."""
        if len(octets) < HEADER_OCTETS:
            return False
        _, protocol, length = struct.unpack_from(">HHH", octets)
        return protocol != 0 or not 2 < length <= LONGEST_TCP

    def _judge(self, unit: int, transaction: int, body: bytes) -> Answer | Surprise:
        """Return the answer when it is that to the question under way."""
        asked = self._asked
        if not body:
            return Surprise.GARBAGE
        if asked is None or (not self._serial and transaction != self._transaction):
            return Surprise.EARLIER
        if unit != asked.unit:
            return Surprise.UNIT
        pdu = self._decoder.decode(body)
        if pdu is None:
            return Surprise.GARBAGE
        if pdu.function_code & 0x7F != asked.function:
            return Surprise.EARLIER
        if isinstance(pdu, ExceptionResponse):
            return Answer(exception=pdu.exception_code)
        return self._fitting(pdu, len(body), asked)

    def _fitting(self, pdu: ModbusPDU, size: int, asked: Question) -> Answer | Surprise:
        """Compare what an answer repeats of its request: number of registers, or the address that was written."""
        if asked.count:
            fits = len(pdu.registers) == asked.count and size == 2 + 2 * asked.count
            return Answer(tuple(pdu.registers)) if fits else Surprise.SIZE
        written = (
            pdu.registers[0] == asked.values[0] if asked.function == WRITE_SINGLE else pdu.count == len(asked.values)
        )
        return Answer() if written and pdu.address == asked.address else Surprise.EARLIER
