"""The SDO server: it decides which transfer a request begins, continues or ends.

Theory (CiA 301, 7.2.4.3): the client starts a download or an upload, expedited or segmented (`segments`) or in blocks
(`block`). There is one transfer at a time; a new initiate replaces the old one, and either side may abort. A request
that fits no transfer is answered with *command specifier not valid*. A transfer whose client is silent for `TIMEOUT_NS`
is aborted with *SDO protocol timed out*. This protects the next client: inside a block any octet may be data, so
without it the initiate of that client would be taken for a segment.
"""

from haptic_fieldbus.sim.canopen.services.sdo.block import BlockDownload, BlockUpload
from haptic_fieldbus.sim.canopen.services.sdo.segments import EXPEDITED, SegmentedDownload, SegmentedUpload, initiated
from haptic_fieldbus.sim.canopen.services.sdo.transfer import Response, Transfer
from haptic_fieldbus.sim.drive.dictionary import AbortCode, Dictionary, Entry, Refused

TIMEOUT_NS = 1_000_000_000
_FRAME = 8
_ABORT = 0x80
_DOWNLOAD, _UPLOAD, _ABORT_SPECIFIER, _BLOCK_UPLOAD, _BLOCK_DOWNLOAD = 1, 2, 4, 5, 6


class SdoServer:
    """The server of one node: it takes requests and returns responses.

    `refuse` maps (index, sub-index) to an abort code for accesses that are refused whatever the dictionary allows.
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
        except Refused as abort:
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
            raise Refused(AbortCode.UNKNOWN_COMMAND)
        self._transfer = None
        index, subindex = int.from_bytes(data[1:3], "little"), data[3]
        if (index, subindex) in self.refuse:
            raise Refused(self.refuse[index, subindex])
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
        return [initiated(entry)]

    def _upload(self, entry: Entry, _data: bytes) -> Response:
        transfer = SegmentedUpload(entry, entry.read())
        self._transfer = None if transfer.finished else transfer
        return [transfer.begin()]

    def _block_download(self, entry: Entry, data: bytes) -> Response:
        transfer = BlockDownload(
            entry, _announced(data) if data[0] & 0x02 else None, crc=bool(data[0] & 0x04), block_size=self.block_size
        )
        self._transfer = transfer
        return [transfer.begin()]

    def _block_upload(self, entry: Entry, data: bytes) -> Response:
        content = entry.read()
        if data[5] and len(content) <= data[5]:  # below the client's protocol switch threshold blocks are not worth it
            return self._upload(entry, data)
        transfer = BlockUpload(entry, content, crc=bool(data[0] & 0x04), block_size=data[4])
        self._transfer = transfer
        return [transfer.begin()]


# By command specifier: the sub-command bits that are 0 in an initiate (CiA 301, 7.2.4.3.9 and 7.2.4.3.13).
_BEGINNINGS = {_BLOCK_UPLOAD: 0x03, _BLOCK_DOWNLOAD: 0x01}


def _announced(data: bytes) -> int:
    return int.from_bytes(data[4:8], "little")


def _multiplexer(data: bytes, transfer: Transfer | None) -> tuple[int, int]:
    """Return index and sub-index of an abort: those of an initiate, else those of the transfer under way."""
    names = data[0] >> 5 in (_DOWNLOAD, _UPLOAD) or (
        data[0] >> 5 in _BEGINNINGS and not data[0] & _BEGINNINGS[data[0] >> 5]
    )
    if transfer is None or (names and not transfer.takes(data[0])):
        return int.from_bytes(data[1:3], "little"), data[3]
    return transfer.entry.index, transfer.entry.subindex


def _abort(code: int, index: int, subindex: int) -> bytes:
    return bytes((_ABORT, *index.to_bytes(2, "little"), subindex)) + code.to_bytes(4, "little")
