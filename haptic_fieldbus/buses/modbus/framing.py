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
from typing import NamedTuple

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
CRC_OCTETS = 2
REFUSED = (ModbusException, ValueError, IndexError, struct.error)
"""Exceptions by which pymodbus refuses octets."""


class DroppedOctets(Enum):
    """Octets that were dropped, as a part of a sentence."""

    GARBAGE = "were no frames, or had a wrong checksum"
    UNIT = "were from another unit"
    EARLIER = "answered an earlier request, or none"
    SIZE = "did not match the request"


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


class Answer(NamedTuple):
    """The answer to a question: octets of the registers that were read, or the code of an exception."""

    data: bytes = b""
    exception: int | None = None

    @property
    def registers(self) -> tuple[int, ...]:
        return struct.unpack(f">{len(self.data) // 2}H", self.data)


class FrameForm:
    """A question whose frame was encoded once, so that the loop only fills in what changes.

    What changes is the transaction id on TCP, the values that are written, and the checksum of RTU. The right answer
    can then be told by its size and its first octets; every other one is looked at by pymodbus.
    """

    def __init__(self, question: Question, frame: bytes, *, serial: bool) -> None:
        self.question = question
        self.frame = bytearray(frame)
        self.repeats = question.function == WRITE_SINGLE
        """Whether the answer repeats the whole request."""
        body = len(frame) - (CRC_OCTETS if serial else 0)
        self.values = slice(body - 2 * len(question.values), body)
        """Place of the values that are written: in every request they stand last."""
        repeated = bytes((2 * question.count,)) if question.count else frame[(2 if serial else 8) :][:4]
        self.head = bytes((question.unit, question.function)) + repeated
        """Begin of the right answer, from the unit id on."""
        start, data = 0 if serial else HEADER_OCTETS, 2 * question.count
        self.repeated = slice(start + 1, start + 6)
        """Place in the request of what the answer to a write repeats: function, address, and value or count."""
        self.data = slice(start + len(self.head), start + len(self.head) + data)
        """Place of the registers in the answer."""
        self.size = self.data.stop + (CRC_OCTETS if serial else 0)
        if not serial:
            self.head = bytes(2) + (len(self.head) + data).to_bytes(2, "big") + self.head


def checksum(octets: bytes | bytearray) -> bytes:
    """Return the checksum of RTU, as it stands at the end of a frame."""
    return FramerRTU.compute_CRC(bytes(octets)).to_bytes(CRC_OCTETS, "big")


class Framing:
    """Frames of one line, RTU when it is `serial`, else TCP; it remembers the question that is under way."""

    def __init__(self, *, serial: bool) -> None:
        self._serial = serial
        self._decoder = DecodePDU(False)
        self._framer = FramerRTU(self._decoder) if serial else FramerSocket(self._decoder)
        self._transaction, self._id = 0, b""
        self._asked: FrameForm | None = None

    def form(self, question: Question) -> FrameForm:
        """Return the form of a question, with the values that it has now."""
        return FrameForm(question, self._framer.buildFrame(question.pdu()), serial=self._serial)

    def fill(self, form: FrameForm, values: bytes | bytearray = b"") -> bytearray:
        """Return the frame of a form, with other octets of the values that are written; answers belong to it now."""
        frame = form.frame
        if values:
            frame[form.values] = values
        if self._serial:
            frame[-CRC_OCTETS:] = checksum(frame[:-CRC_OCTETS])
        else:
            # 0 is left out, as pymodbus takes it for no transaction id at all.
            self._transaction = self._transaction % 0xFFFF + 1
            frame[:2] = self._id = self._transaction.to_bytes(2, "big")
        self._asked = form
        return frame

    def take(self, octets: bytes) -> tuple[int, Answer | DroppedOctets | None]:
        """Return the number of octets used and the frame in them; (0, None) while a frame is not complete."""
        data = self.data_of(octets)
        if data is not None:
            return len(octets), Answer(data)
        if not self._serial and len(octets) >= HEADER_OCTETS:
            _, protocol, length = struct.unpack_from(">HHH", octets)
            if protocol != 0 or not 2 < length <= LONGEST_TCP:  # it is no MBAP header
                return len(octets), DroppedOctets.GARBAGE
        try:
            used, unit, transaction, body = self._framer.decode(octets)
            if not used:
                return 0, None
            judged = self._judge(unit, transaction, body)
        except REFUSED:
            return len(octets), DroppedOctets.GARBAGE
        if isinstance(judged, Answer):
            self._asked = None  # the same answer once more answers nothing
        return used, judged

    def data_of(self, octets: bytes) -> bytes | None:
        """Return the registers when all octets together are the answer to the question under way; None otherwise."""
        form = self._asked
        if form is None or len(octets) != form.size:
            return None
        if form.repeats:
            right = octets == form.frame
        elif self._serial:
            right = octets.startswith(form.head) and octets[-CRC_OCTETS:] == checksum(octets[:-CRC_OCTETS])
        else:
            right = octets.startswith(self._id) and octets.startswith(form.head, 2)
        if not right:
            return None
        self._asked = None
        return octets[form.data]

    def _judge(self, unit: int, transaction: int, body: bytes) -> Answer | DroppedOctets:
        """Return the answer when it is that to the question under way."""
        if not body:
            return DroppedOctets.GARBAGE
        if self._asked is None or (not self._serial and transaction != self._transaction):
            return DroppedOctets.EARLIER
        asked = self._asked.question
        if unit != asked.unit:
            return DroppedOctets.UNIT
        pdu = self._decoder.decode(body)
        if pdu is None:
            return DroppedOctets.GARBAGE
        if pdu.function_code & 0x7F != asked.function:
            return DroppedOctets.EARLIER
        if isinstance(pdu, ExceptionResponse):
            return Answer(exception=pdu.exception_code)
        if asked.count:
            fits = len(pdu.registers) == asked.count and len(body) == 2 + 2 * asked.count
            return Answer(struct.pack(f">{asked.count}H", *pdu.registers)) if fits else DroppedOctets.SIZE
        # A write is answered by the first octets of its request.
        return Answer() if body == self._asked.frame[self._asked.repeated] else DroppedOctets.EARLIER
