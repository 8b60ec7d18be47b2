"""The SDO server: expedited and segmented transfers.

Theory (CiA 301, 7.2.4.3): the client starts a download (1) or an upload (2); what does not fit into four octets follows
in segments of seven, each with a toggle bit that starts at 0. One transfer at a time; a new initiate replaces the old.
Block transfers are answered with *command specifier not valid*.
"""

from dataclasses import dataclass, field

from haptic_fieldbus.sim.dictionary import AbortCode, Dictionary, Entry, SdoAbort

_SEGMENT = 7
_EXPEDITED = 4


@dataclass
class _Transfer:
    """A segmented transfer under way."""

    entry: Entry
    data: bytearray
    upload: bool
    announced: int | None = None
    toggle: int = field(default=0)


class SdoServer:
    """Requests in, responses out; `refuse` aborts chosen accesses whatever the dictionary says."""

    def __init__(self, dictionary: Dictionary) -> None:
        self.refuse: dict[tuple[int, int], int] = {}
        self._dictionary = dictionary
        self._transfer: _Transfer | None = None
        self._services = {
            0: self._download_segment,
            1: self._download,
            2: self._upload,
            3: self._upload_segment,
        }

    def request(self, data: bytes) -> bytes | None:
        """The response to one request of eight octets; None where the protocol has none."""
        if len(data) != 8:
            return None
        specifier = data[0] >> 5
        if specifier == 4:
            self._transfer = None
            return None
        index, subindex = int.from_bytes(data[1:3], "little"), data[3]
        if specifier in (0, 3) and self._transfer is not None:
            index, subindex = self._transfer.entry.index, self._transfer.entry.subindex
        try:
            service = self._services.get(specifier)
            if service is None:
                raise SdoAbort(AbortCode.UNKNOWN_COMMAND)
            return service(data)
        except SdoAbort as abort:
            self._transfer = None
            return bytes((0x80, *index.to_bytes(2, "little"), subindex)) + abort.code.to_bytes(4, "little")

    def reset(self) -> None:
        """Forget a transfer under way."""
        self._transfer = None

    def _find(self, data: bytes) -> Entry:
        self._transfer = None
        index, subindex = int.from_bytes(data[1:3], "little"), data[3]
        if (index, subindex) in self.refuse:
            raise SdoAbort(self.refuse[index, subindex])
        return self._dictionary.find(index, subindex)

    def _download(self, data: bytes) -> bytes:
        entry = self._find(data)
        expedited, sized = data[0] & 0x02, data[0] & 0x01
        if expedited:
            default = entry.type.size if entry.type is not None else _EXPEDITED
            size = _EXPEDITED - (data[0] >> 2 & 3) if sized else default
            entry.write(data[4 : 4 + size])
        else:
            announced = int.from_bytes(data[4:8], "little") if sized else None
            self._transfer = _Transfer(entry, bytearray(), upload=False, announced=announced)
        return bytes((0x60, *data[1:4], 0, 0, 0, 0))

    def _download_segment(self, data: bytes) -> bytes:
        transfer = self._current(upload=False, toggle=data[0] >> 4 & 1)
        transfer.data += data[1 : 1 + _SEGMENT - (data[0] >> 1 & 7)]
        if data[0] & 0x01:
            self._transfer = None
            if transfer.announced is not None and transfer.announced != len(transfer.data):
                raise SdoAbort(AbortCode.LENGTH)
            transfer.entry.write(bytes(transfer.data))
        return bytes((0x20 | (transfer.toggle ^ 1) << 4, 0, 0, 0, 0, 0, 0, 0))

    def _upload(self, data: bytes) -> bytes:
        entry = self._find(data)
        content = entry.read()
        if 0 < len(content) <= _EXPEDITED:
            return bytes((0x43 | (_EXPEDITED - len(content)) << 2, *data[1:4])) + content.ljust(_EXPEDITED, b"\0")
        self._transfer = _Transfer(entry, bytearray(content), upload=True)
        return bytes((0x41, *data[1:4])) + len(content).to_bytes(4, "little")

    def _upload_segment(self, data: bytes) -> bytes:
        transfer = self._current(upload=True, toggle=data[0] >> 4 & 1)
        part = bytes(transfer.data[:_SEGMENT])
        del transfer.data[:_SEGMENT]
        last = not transfer.data
        if last:
            self._transfer = None
        head = (transfer.toggle ^ 1) << 4 | (_SEGMENT - len(part)) << 1 | last
        return bytes((head,)) + part.ljust(_SEGMENT, b"\0")

    def _current(self, *, upload: bool, toggle: int) -> _Transfer:
        """The transfer that a segment belongs to; its toggle bit is turned for the next one."""
        transfer = self._transfer
        if transfer is None or transfer.upload is not upload:
            raise SdoAbort(AbortCode.UNKNOWN_COMMAND)
        if transfer.toggle != toggle:
            raise SdoAbort(AbortCode.TOGGLE_BIT)
        transfer.toggle ^= 1
        return transfer
