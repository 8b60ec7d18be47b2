"""SDO block transfers: many segments for one confirmation, with a CRC over all octets.

Theory (CiA 301, 7.2.4.3.9 to 7.2.4.3.16). A block is up to 127 segments of seven octets, numbered from 1; bit 7 of the
number marks the last segment of the whole transfer. The receiver confirms a block with the number of the last segment
that came in order, and with the size of the next block; the sender continues after that segment. A receiver that misses
a segment ignores the rest of the block. The end of the transfer gives the number of meaningless octets in the last
segment, and the CRC (x¹⁶ + x¹² + x⁵ + 1, start 0) if both sides support it. This server declares its support only to
clients that declare theirs, because some look at the server's flag alone (canopen 2.4.1).
"""

from binascii import crc_hqx
from enum import Enum, auto

from haptic_fieldbus.sim.canopen.services.sdo.segments import SEGMENT, Collected, multiplexed
from haptic_fieldbus.sim.canopen.services.sdo.transfer import Response, Transfer
from haptic_fieldbus.sim.drive.dictionary import AbortCode, Entry, Refused

LARGEST_BLOCK = 127
_LAST = 0x80
_NUMBER = 0x7F
_UPLOAD_REQUEST, _DOWNLOAD_REQUEST = 5, 6
_KNOWS_CRC = 0x04


def crc(octets: bytes | bytearray) -> int:
    """Return the CRC of CiA 301, 7.2.4.3.16; of "123456789" it is 31C3h."""
    return crc_hqx(octets, 0)


def _checked(block_size: int) -> int:
    if not 1 <= block_size <= LARGEST_BLOCK:
        raise Refused(AbortCode.BLOCK_SIZE)
    return block_size


class BlockDownload(Transfer):
    """A download in blocks: the client sends segments."""

    def __init__(self, entry: Entry, announced: int | None, *, crc: bool, block_size: int) -> None:
        super().__init__(entry)
        self._collected = Collected(entry, announced)
        self._crc = crc
        self._block_size = block_size
        self._received = 0
        self._held = b""
        """Last segment in order, held back because the end gives the number of its octets that count."""
        self._complete = False

    def begin(self) -> bytes:
        """Return the response to the initiate."""
        # Server command specifier 5; bit 2 declares the CRC, the fifth octet is the block size.
        head = multiplexed(0xA0 | (_KNOWS_CRC if self._crc else 0), self.entry)
        return head + bytes((self._block_size, 0, 0, 0))

    def takes(self, command: int) -> bool:
        """Return whether the octet continues the transfer; inside a block every octet is a segment number."""
        return command >> 5 == _DOWNLOAD_REQUEST if self._complete else True

    def request(self, data: bytes) -> Response:
        return self._end(data) if self._complete else self._segment(data)

    def _segment(self, data: bytes) -> Response:
        number, last = data[0] & _NUMBER, bool(data[0] & _LAST)
        if not 1 <= number <= self._block_size:
            raise Refused(AbortCode.SEQUENCE_NUMBER)
        # A segment out of order is ignored; the confirmation names the segment after which the client continues.
        if number == self._received + 1:
            self._received = number
            self._collected.add(self._held)
            self._held = data[1:]
            self._complete = last
        # The last number of the block requires the confirmation, even when segments before it are missing.
        if not last and number < self._block_size:
            return []
        confirmed, self._received = self._received, 0
        # Server command specifier 5, subcommand 2: the last segment in order and the next block size.
        return [bytes((0xA2, confirmed, self._block_size, 0, 0, 0, 0, 0))]

    def _end(self, data: bytes) -> Response:
        if data[0] & 0x03 != 0x01:
            raise Refused(AbortCode.UNKNOWN_COMMAND)
        # Bits 2 to 4 of the end are the number of octets without data in the last segment.
        self._collected.add(self._held[: SEGMENT - (data[0] >> 2 & 7)])
        if self._crc and int.from_bytes(data[1:3], "little") != crc(self._collected.octets):
            raise Refused(AbortCode.CRC)
        self._collected.write()
        self.finished = True
        return [bytes((0xA1, 0, 0, 0, 0, 0, 0, 0))]


class _Step(Enum):
    """The next request that a block upload expects of the client."""

    START = auto()
    CONFIRMATION = auto()
    END = auto()


class BlockUpload(Transfer):
    """An upload in blocks: the client receives segments."""

    def __init__(self, entry: Entry, content: bytes, *, crc: bool, block_size: int) -> None:
        super().__init__(entry)
        self._content = content
        self._crc = crc
        self._block_size = _checked(block_size)
        self._confirmed = 0
        """Octets that the client has confirmed."""
        self._in_block = 0
        """Segments of the block that was sent last."""
        self._step = _Step.START

    def begin(self) -> bytes:
        """Return the response to the initiate, with the size of the content."""
        # Server command specifier 6; bit 1 indicates the size.
        head = multiplexed(0xC2 | (_KNOWS_CRC if self._crc else 0), self.entry)
        return head + len(self._content).to_bytes(4, "little")

    def takes(self, command: int) -> bool:
        return command >> 5 == _UPLOAD_REQUEST and bool(command & 0x03)

    def request(self, data: bytes) -> Response:
        subcommand = data[0] & 0x03
        if subcommand != {_Step.START: 3, _Step.CONFIRMATION: 2, _Step.END: 1}[self._step]:
            raise Refused(AbortCode.UNKNOWN_COMMAND)
        if self._step is _Step.START:
            return self._block()
        if self._step is _Step.CONFIRMATION:
            return self._confirm(data[1], data[2])
        self.finished = True
        return []

    def _block(self) -> Response:
        self._step = _Step.CONFIRMATION
        rest = self._content[self._confirmed : self._confirmed + SEGMENT * self._block_size]
        # An empty content still takes one segment, which carries the mark of the last one.
        parts = [rest[start : start + SEGMENT] for start in range(0, max(len(rest), 1), SEGMENT)]
        self._in_block = len(parts)
        ends = self._confirmed + len(rest) >= len(self._content)
        return [
            bytes((number | (_LAST if ends and number == len(parts) else 0),)) + part.ljust(SEGMENT, b"\0")
            for number, part in enumerate(parts, start=1)
        ]

    def _confirm(self, number: int, block_size: int) -> Response:
        if number > self._in_block:
            raise Refused(AbortCode.SEQUENCE_NUMBER)
        complete = number == self._in_block
        self._confirmed += number * SEGMENT
        # Otherwise the next block begins after the last confirmed segment, so lost segments are sent again.
        if complete and self._confirmed >= len(self._content):
            self._step = _Step.END
            unused = (-len(self._content)) % SEGMENT if self._content else SEGMENT
            check = crc(self._content) if self._crc else 0
            return [bytes((0xC1 | unused << 2, *check.to_bytes(2, "little"))) + bytes(5)]
        self._block_size = _checked(block_size)
        return self._block()
