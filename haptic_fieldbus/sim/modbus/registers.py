"""The registers of a simulated drive: addresses of 16 bits each, and the values made of them.

Theory (Modbus application protocol 1.1b3). A request names a first address and a count. It is carried out as a whole or
not at all, so a value of two registers is never torn inside one request. A request with only half of a value is
refused, so no master can tear a value. Unknown registers read as 0 if the profile says that they can be read; they
cannot be written.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from enum import IntEnum
from functools import lru_cache
from struct import Struct

from haptic_fieldbus.protocols.modbus.profile import READ_HOLDING, READ_INPUT, READ_WRITE, LineSection, Register
from haptic_fieldbus.sim.drive.dictionary import Access, AccessRefused, Entry

_READING = (READ_HOLDING, READ_INPUT, READ_WRITE)
"""Functions that read."""
_MASKS = {1: 0xFFFF, 2: 0xFFFF_FFFF}
"""Number of registers of a value → its bits; more are cut off where there is only one register."""

_Writer = tuple[Struct, tuple[Entry, ...], tuple[tuple[int, bool, int], ...], tuple[Callable[[], None], ...]]
"""Codec of a block, its entries, (place, low word first, sign bit) of each value, and the listeners."""


class Refusal(IntEnum):
    """Exception codes (Modbus application protocol 1.1b3, 7)."""

    FUNCTION = 1
    ADDRESS = 2
    VALUE = 3
    FAILURE = 4


@dataclass(frozen=True)
class RegisterCell:
    """A value in one register or two; `writes` None: read-only."""

    register: Register
    reads: Entry
    writes: Entry | None

    @property
    def sign(self) -> int:
        """Return the sign bit of the value; 0 without a sign."""
        return 1 << 16 * self.register.count - 1 if self.register.type.limits[0] < 0 else 0


class Registers:
    """All registers of a drive; `changed` is called after a request that has written."""

    def __init__(self, line: LineSection) -> None:
        self._line, self._low_first = line, line.word_order == "low first"
        self._cells: dict[int, RegisterCell] = {}
        self._owner: dict[int, int] = {}
        """Address of each register → first address of its value."""
        # A master asks for the same registers in every period.
        self.reader = lru_cache(maxsize=256)(self._new_reader)
        self._writer = lru_cache(maxsize=256)(self._new_writer)

    def add(self, register: Register, entry: Entry) -> None:
        """Put an entry behind its registers, with its access rights; a second one adds the write access."""
        reads, writes = entry, entry if entry.access is Access.RW else None
        self.reader.cache_clear()
        self._writer.cache_clear()
        if (before := self._cells.get(register.address)) is not None:
            reads, writes = before.reads, writes or before.writes
        self._cells[register.address] = RegisterCell(register, reads, writes)
        for address in range(register.address, register.address + register.count):
            self._owner[address] = register.address

    def __contains__(self, address: int) -> bool:
        return address in self._owner

    def write(self, address: int, octets: bytes) -> tuple[Entry, ...] | Refusal:
        """Write registers, all or none; return the entries that were written."""
        if (block := self._writer(address, len(octets) // 2)) is None:
            return Refusal.ADDRESS
        codec, entries, fields, listeners = block
        words, values = codec.unpack(octets), []
        for entry, (place, turned, sign) in zip(entries, fields, strict=True):
            value = ((_turned(words[place]) if turned else words[place]) ^ sign) - sign
            if not entry.low <= value <= entry.high or (
                entry.accept is not None and not _accepted(entry.accept, value)
            ):
                return Refusal.VALUE
            values.append(value)
        for entry, value in zip(entries, values, strict=True):
            entry.value = value
        # Each listener once: a drive acts on a command and a target of one request together.
        for listener in listeners:
            listener()
        return entries

    def _new_reader(self, function: int, address: int, count: int) -> Callable[[], bytes] | Refusal:
        """Return a function that returns the octets of registers, or why they cannot be read by this function code."""
        if function not in self._line.functions or function not in _READING:
            return Refusal.FUNCTION
        if not 1 <= count <= self._line.longest_read:
            return Refusal.VALUE
        if (cells := self._found(address, count)) is None:
            return Refusal.ADDRESS
        sources = [(cell.reads, _MASKS[cell.register.count], self._is_turned(cell)) for cell in cells]
        pack = _codec(address, count, cells).pack

        def read() -> bytes:
            values = []
            for entry, mask, turned in sources:
                # More bits than the registers have are cut off.
                value = (entry.value if entry.fetch is None else entry.fetch()) & mask
                values.append(_turned(value) if turned else value)
            return pack(*values)

        return read

    def _new_writer(self, address: int, count: int) -> _Writer | None:
        """Return how registers are written; None when they cannot be."""
        cells = self._found(address, count)
        if cells is None or sum(cell.register.count for cell in cells) != count:
            return None
        # The last one of two values for the same entry is taken.
        fields = {cell.writes: (place, self._is_turned(cell), cell.sign) for place, cell in enumerate(cells)}
        entries = tuple(entry for entry in fields if entry is not None)
        if len(entries) < len(fields):
            return None
        listeners = dict.fromkeys(entry.changed for entry in entries if entry.changed is not None)
        return _codec(address, count, cells), entries, tuple(fields.values()), tuple(listeners)

    def _is_turned(self, cell: RegisterCell) -> bool:
        """Return whether the low word of a value comes first."""
        return self._low_first and cell.register.count == 2

    def _found(self, address: int, count: int) -> list[RegisterCell] | None:
        """Return the values within these registers; None when one is cut, or a register does not exist."""
        asked = range(address, address + count)
        if not all(each in self._owner or self._line.has_all(each, each + 1) for each in asked):
            return None
        firsts = dict.fromkeys(self._owner[each] for each in asked if each in self._owner)
        cells = [self._cells[first] for first in firsts]
        inside = all(first in asked and first + self._cells[first].register.count - 1 in asked for first in firsts)
        return cells if inside else None


def _codec(address: int, count: int, cells: Iterable[RegisterCell]) -> Struct:
    """Return the codec of the values in a block of registers, without their signs; other registers are 0."""
    form, end = ">", address
    for cell in cells:
        form += f"{2 * (cell.register.address - end)}x{'H' if cell.register.count == 1 else 'I'}"
        end = cell.register.address + cell.register.count
    return Struct(f"{form}{2 * (address + count - end)}x")


def _turned(value: int) -> int:
    """Return a value of 32 bits with its words exchanged."""
    return (value << 16 | value >> 16) & 0xFFFF_FFFF


def _accepted(accept: Callable[[int], None], value: int) -> bool:
    """Return whether an entry takes this value."""
    try:
        accept(value)
    except AccessRefused:
        return False
    return True
