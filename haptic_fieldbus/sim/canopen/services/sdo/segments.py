"""Expedited and segmented SDO transfers.

Theory (CiA 301, 7.2.4.3.3 to 7.2.4.3.8): up to four octets travel in the initiate itself. Longer contents follow in
segments of seven octets, each confirmed, with a toggle bit that starts at 0.
"""

from haptic_fieldbus.sim.canopen.services.sdo.transfer import Response, Transfer
from haptic_fieldbus.sim.drive.dictionary import AbortCode, Entry, Refused

SEGMENT = 7
EXPEDITED = 4
_DOWNLOAD_SEGMENT, _UPLOAD_SEGMENT = 0, 3


def multiplexed(command: int, entry: Entry) -> bytes:
    """Return the first four octets of a response: command, index and sub-index of its entry."""
    return bytes((command, *entry.index.to_bytes(2, "little"), entry.subindex))


def initiated(entry: Entry) -> bytes:
    """Return the confirmation of a download initiate, which completes an expedited download."""
    # Server command specifier 3.
    return multiplexed(0x60, entry) + bytes(4)


class Collected:
    """The octets of a download as they arrive, never more than the capacity of the entry.

    Raises Refused when the entry cannot be written, or not with the announced number of octets.
    """

    def __init__(self, entry: Entry, announced: int | None) -> None:
        entry.begin_write(announced)
        self.octets = bytearray()
        self._entry = entry
        self._announced = announced

    def add(self, octets: bytes) -> None:
        """Add octets; raises Refused when there are too many."""
        self.octets += octets
        if len(self.octets) > self._entry.capacity:
            raise Refused(AbortCode.TOO_LONG)

    def write(self) -> None:
        """Write the entry once all octets have arrived.

        Raises Refused when their number is not the announced one, or when the entry refuses them.
        """
        if self._announced is not None and self._announced != len(self.octets):
            raise Refused(AbortCode.LENGTH)
        self._entry.write(bytes(self.octets))


class SegmentedDownload(Transfer):
    """A download in segments."""

    def __init__(self, entry: Entry, announced: int | None) -> None:
        super().__init__(entry)
        self._collected = Collected(entry, announced)
        self._toggle = 0

    def takes(self, command: int) -> bool:
        return command >> 5 == _DOWNLOAD_SEGMENT

    def request(self, data: bytes) -> Response:
        _check_toggle(data[0], self._toggle)
        # Server command specifier 1 with the toggle bit of the request.
        response = bytes((0x20 | self._toggle << 4,)) + bytes(7)
        self._toggle ^= 1
        # Bits 1 to 3 are the number of octets without data, bit 0 marks the last segment.
        self._collected.add(data[1 : 1 + SEGMENT - (data[0] >> 1 & 7)])
        if data[0] & 0x01:
            self._collected.write()
            self.finished = True
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
        raise Refused(AbortCode.TOGGLE_BIT)
