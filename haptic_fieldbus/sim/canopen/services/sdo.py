"""The SDO server: it decides which transfer a request begins, continues or ends.

Theory (CiA 301, 7.2.4.3): the client starts a download or an upload, expedited or segmented or in blocks . There is one
transfer at a time; a new initiate replaces the old one, and either side may abort. A request that fits no transfer is
answered with *command specifier not valid*. A transfer whose client is silent for `TIMEOUT_NS` is aborted with *SDO
protocol timed out*. This protects the next client: inside a block any octet may be data, so without the time-out the
initiate of the next client would be read as a segment.
"""

from abc import ABC, abstractmethod
from binascii import crc_hqx
from enum import Enum

from haptic_fieldbus.sim.drive.dictionary import AbortCode, AccessRefused, Dictionary, Entry

# The common interface of SDO transfers that take more than one request.

Response = list[bytes]
"""Frames that the server sends, eight octets each."""


class Transfer(ABC):
    """A transfer of the content of an entry; `finished` is True when no further request is expected."""

    def __init__(self, entry: Entry) -> None:
        self.entry = entry
        self.finished = False

    @abstractmethod
    def takes(self, command: int) -> bool:
        """Return whether a request with this first octet continues the transfer."""

    @abstractmethod
    def request(self, data: bytes) -> Response:
        """Handle one request of the transfer and return the responses; raises Refused to abort the transfer."""


# Expedited and segmented SDO transfers.
#
# Theory (CiA 301, 7.2.4.3.3 to 7.2.4.3.8): up to four octets travel in the initiate itself. Longer contents follow in
# segments of seven octets, each confirmed, with a toggle bit that starts at 0.

SEGMENT = 7
EXPEDITED = 4
_DOWNLOAD_SEGMENT, _UPLOAD_SEGMENT = 0, 3


def multiplexed(command: int, entry: Entry) -> bytes:
    """Return the first four octets of a response: command, index and sub-index of its entry."""
    return bytes((command, *entry.index.to_bytes(2, "little"), entry.subindex))


class Download(Transfer):
    """A download, with the octets as they arrive, never more than the capacity of the entry.

    Raises Refused when the entry cannot be written, or not with the announced number of octets.
    """

    def __init__(self, entry: Entry, announced: int | None) -> None:
        super().__init__(entry)
        entry.begin_write(announced)
        self._octets = bytearray()
        self._announced = announced

    def add(self, octets: bytes) -> None:
        """Add octets; raises Refused when there are too many."""
        self._octets += octets
        if len(self._octets) > self.entry.capacity:
            raise AccessRefused(AbortCode.TOO_LONG)

    def write(self) -> None:
        """Write the entry once all octets have arrived, which ends the transfer.

        Raises Refused when their number is not the announced one, or when the entry refuses them.
        """
        if self._announced is not None and self._announced != len(self._octets):
            raise AccessRefused(AbortCode.LENGTH)
        self.entry.write(bytes(self._octets))
        self.finished = True


class SegmentedDownload(Download):
    """A download in segments."""

    def __init__(self, entry: Entry, announced: int | None) -> None:
        super().__init__(entry, announced)
        self._toggle = 0

    def takes(self, command: int) -> bool:
        return command >> 5 == _DOWNLOAD_SEGMENT

    def request(self, data: bytes) -> Response:
        _check_toggle(data[0], self._toggle)
        # Server command specifier 1 with the toggle bit of the request.
        response = bytes((0x20 | self._toggle << 4,)) + bytes(7)
        self._toggle ^= 1
        # Bits 1 to 3 are the number of octets without data, bit 0 marks the last segment.
        self.add(data[1 : 1 + SEGMENT - (data[0] >> 1 & 7)])
        if data[0] & 0x01:
            self.write()
        return [response]


class SegmentedUpload(Transfer):
    """An upload in segments; one of up to four octets is expedited and finished by the initiate's response."""

    def __init__(self, entry: Entry, content: bytes) -> None:
        super().__init__(entry)
        self.finished = 0 < len(content) <= EXPEDITED
        self._content = content
        self._sent = 0
        self._toggle = 0

    def begin(self) -> bytes:
        """Return the response to the initiate."""
        content = self._content
        # Server command specifier 2. Bit 0: the size is indicated; bit 1: expedited, with the number of octets without
        # data in bits 2 and 3.
        if self.finished:
            return multiplexed(0x43 | (EXPEDITED - len(content)) << 2, self.entry) + content.ljust(EXPEDITED, b"\0")
        return multiplexed(0x41, self.entry) + len(content).to_bytes(4, "little")

    def takes(self, command: int) -> bool:
        return command >> 5 == _UPLOAD_SEGMENT

    def request(self, data: bytes) -> Response:
        _check_toggle(data[0], self._toggle)
        part = self._content[self._sent : self._sent + SEGMENT]
        self._sent += len(part)
        self.finished = self._sent >= len(self._content)
        head = self._toggle << 4 | (SEGMENT - len(part)) << 1 | self.finished
        self._toggle ^= 1
        return [bytes((head,)) + part.ljust(SEGMENT, b"\0")]


def _check_toggle(command: int, toggle: int) -> None:
    if command >> 4 & 1 != toggle:
        raise AccessRefused(AbortCode.TOGGLE_BIT)


# SDO block transfers: many segments for one confirmation, with a CRC over all octets.
#
# Theory (CiA 301, 7.2.4.3.9 to 7.2.4.3.16). A block is up to 127 segments of seven octets, numbered from 1; bit 7 of
# the number marks the last segment of the whole transfer. The receiver confirms a block with the number of the last
# segment that came in order, and with the size of the next block; the sender continues after that segment. A receiver
# that misses a segment ignores the rest of the block. The end of the transfer gives the number of meaningless octets in
# the last segment, and the CRC (x¹⁶ + x¹² + x⁵ + 1, start 0) if both sides support it. This server declares its support
# only to clients that declare theirs, because some look at the server's flag alone (canopen 2.4.1).

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
        raise AccessRefused(AbortCode.BLOCK_SIZE)
    return block_size


class BlockDownload(Download):
    """A download in blocks: the client sends segments."""

    def __init__(self, entry: Entry, announced: int | None, *, crc: bool, block_size: int) -> None:
        super().__init__(entry, announced)
        self._crc = crc
        self._block_size = block_size
        self._received = 0
        self._held = b""
        """Last segment in order, held back until the end request gives its number of valid octets."""
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
            raise AccessRefused(AbortCode.SEQUENCE_NUMBER)
        # A segment out of order is ignored; the confirmation names the segment after which the client continues.
        if number == self._received + 1:
            self._received = number
            self.add(self._held)
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
            raise AccessRefused(AbortCode.UNKNOWN_COMMAND)
        # Bits 2 to 4 of the end are the number of octets without data in the last segment.
        self.add(self._held[: SEGMENT - (data[0] >> 2 & 7)])
        if self._crc and int.from_bytes(data[1:3], "little") != crc(self._octets):
            raise AccessRefused(AbortCode.CRC)
        self.write()
        return [bytes((0xA1, 0, 0, 0, 0, 0, 0, 0))]


class _Step(Enum):
    """The next request that a block upload expects of the client; the value is its subcommand."""

    START = 3
    CONFIRMATION = 2
    END = 1


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
        if data[0] & 0x03 != self._step.value:
            raise AccessRefused(AbortCode.UNKNOWN_COMMAND)
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
            raise AccessRefused(AbortCode.SEQUENCE_NUMBER)
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


TIMEOUT_NS = 1_000_000_000
_FRAME = 8
_ABORT = 0x80
_DOWNLOAD, _UPLOAD, _ABORT_SPECIFIER, _BLOCK_UPLOAD, _BLOCK_DOWNLOAD = 1, 2, 4, 5, 6


class SdoServer:
    """The server of one node: it takes requests and returns responses.

    `refuse` maps (index, sub-index) to the abort code of accesses that are refused regardless of the dictionary.
    """

    def __init__(self, dictionary: Dictionary) -> None:
        self.refuse: dict[tuple[int, int], int] = {}
        self.block_size = 127
        """Segments of a block download between two confirmations."""
        self._dictionary = dictionary
        self._transfer: Transfer | None = None
        self._services = {
            _DOWNLOAD: self._download,
            _UPLOAD: self._upload,
            _BLOCK_UPLOAD: self._block_upload,
            _BLOCK_DOWNLOAD: self._block_download,
        }

    @property
    def busy(self) -> bool:
        """Return whether a transfer is under way."""
        return self._transfer is not None

    def request(self, data: bytes) -> Response:
        """Return the responses to one request of eight octets; none where the protocol has none."""
        if len(data) != _FRAME:
            return []
        transfer = self._transfer
        # A segment of a block may begin with the octet of any command, so the transfer is asked first.
        continues = transfer is not None and transfer.takes(data[0])
        if data[0] == _ABORT or (not continues and data[0] >> 5 == _ABORT_SPECIFIER):
            self._transfer = None
            return []
        try:
            if transfer is None or not continues:
                return self._initiate(data)
            responses = transfer.request(data)
        except AccessRefused as abort:
            self._transfer = None
            return [_abort(abort.code, *_multiplexer(data, transfer))]
        if transfer.finished:
            self._transfer = None
        return responses

    def reset(self) -> None:
        """Discard a transfer under way."""
        self._transfer = None

    def expire(self) -> Response:
        """Abort a transfer whose client was silent for too long; return the abort, nothing without a transfer."""
        transfer, self._transfer = self._transfer, None
        if transfer is None:
            return []
        return [_abort(AbortCode.TIMEOUT.value, transfer.entry.index, transfer.entry.subindex)]

    def _initiate(self, data: bytes) -> Response:
        service = self._services.get(data[0] >> 5)
        if service is None or (data[0] >> 5 in _BEGINNINGS and data[0] & _BEGINNINGS[data[0] >> 5]):
            raise AccessRefused(AbortCode.UNKNOWN_COMMAND)
        self._transfer = None
        index, subindex = int.from_bytes(data[1:3], "little"), data[3]
        if (index, subindex) in self.refuse:
            raise AccessRefused(self.refuse[index, subindex])
        return service(self._dictionary.find(index, subindex), data)

    def _download(self, entry: Entry, data: bytes) -> Response:
        # Bit 0: the size is indicated; bit 1: expedited, with the number of octets without data in bits 2 and 3.
        sized = data[0] & 0x01
        if data[0] & 0x02:
            # An expedited download without size fills the entry.
            default = min(entry.capacity, EXPEDITED)
            entry.write(data[4 : 4 + (EXPEDITED - (data[0] >> 2 & 3) if sized else default)])
        else:
            self._transfer = SegmentedDownload(entry, _announced(data) if sized else None)
        # Server command specifier 3 confirms the initiate, and completes an expedited download.
        return [multiplexed(0x60, entry) + bytes(4)]

    def _upload(self, entry: Entry, _data: bytes) -> Response:
        transfer = SegmentedUpload(entry, entry.read())
        self._transfer = None if transfer.finished else transfer
        return [transfer.begin()]

    def _block_download(self, entry: Entry, data: bytes) -> Response:
        announced = _announced(data) if data[0] & 0x02 else None
        self._transfer = BlockDownload(entry, announced, crc=bool(data[0] & 0x04), block_size=self.block_size)
        return [self._transfer.begin()]

    def _block_upload(self, entry: Entry, data: bytes) -> Response:
        content = entry.read()
        if data[5] and len(content) <= data[5]:  # below the client's protocol switch threshold blocks are not worth it
            return self._upload(entry, data)
        self._transfer = BlockUpload(entry, content, crc=bool(data[0] & 0x04), block_size=data[4])
        return [self._transfer.begin()]


# By command specifier: the sub-command bits that are 0 in an initiate (CiA 301, 7.2.4.3.9 and 7.2.4.3.13).
_BEGINNINGS = {_BLOCK_UPLOAD: 0x03, _BLOCK_DOWNLOAD: 0x01}


def _announced(data: bytes) -> int:
    return int.from_bytes(data[4:8], "little")


def _multiplexer(data: bytes, transfer: Transfer | None) -> tuple[int, int]:
    """Return index and sub-index of an abort: from an initiate request, otherwise from the present transfer."""
    names = data[0] >> 5 in (_DOWNLOAD, _UPLOAD) or (
        data[0] >> 5 in _BEGINNINGS and not data[0] & _BEGINNINGS[data[0] >> 5]
    )
    if transfer is None or (names and not transfer.takes(data[0])):
        return int.from_bytes(data[1:3], "little"), data[3]
    return transfer.entry.index, transfer.entry.subindex


def _abort(code: int, index: int, subindex: int) -> bytes:
    return bytes((_ABORT, *index.to_bytes(2, "little"), subindex)) + code.to_bytes(4, "little")
