"""The registers of a simulated drive: addresses of 16 bits each, and the values made of them.

Theory (Modbus application protocol 1.1b3). A request names a first address and a count. It is carried out as a whole or
not at all, so a value of two registers is never torn inside one request. A request with only half of a value is
refused, so no master can tear a value. Unknown registers read as 0 if the profile says that they can be read; they
cannot be written.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from functools import lru_cache
from struct import Struct

from haptic_fieldbus.protocols.modbus.profile import LineSection, Register, WordOrder
from haptic_fieldbus.sim.drive.dictionary import Access, AccessRefused, Entry

_LOW_FIRST = {1: Struct("<H"), 2: Struct("<2H")}
"""Number of registers of a value → its words, the low one first."""


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

    def words(self, order: WordOrder) -> list[int]:
        """Return the registers of the present value; more than 16 bits are cut off where there is only one."""
        form, octets = _LOW_FIRST[self.register.count], self.reads.read()
        if len(octets) < form.size:
            value = int.from_bytes(octets, "little", signed=self.reads.low < 0)
            octets = value.to_bytes(form.size, "little", signed=self.reads.low < 0)
        words = [*form.unpack_from(octets)]
        return words[::-1] if order == "high first" else words

    def value(self, words: Sequence[int], order: WordOrder) -> int:
        """Return the value of these registers."""
        octets = _LOW_FIRST[len(words)].pack(*(words[::-1] if order == "high first" else words))
        return int.from_bytes(octets, "little", signed=self.register.type.limits[0] < 0)


class Registers:
    """All registers of a drive; `changed` is called after a request that has written."""

    def __init__(self, line: LineSection) -> None:
        self._order, self._can_be_read = line.word_order, line.has_all
        self._cells: dict[int, RegisterCell] = {}
        self._owner: dict[int, int] = {}
        """Address of each register → first address of its value."""
        # A master asks for the same registers in every period.
        self._whole = lru_cache(maxsize=256)(self._found)

    def add(self, register: Register, reads: Entry, writes: Entry | None = None) -> None:
        """Put a value behind its registers; a second value at the same address adds the write access."""
        self._whole.cache_clear()
        before = self._cells.get(register.address)
        if before is not None:
            reads, writes = before.reads, writes or before.writes
        self._cells[register.address] = RegisterCell(register, reads, writes)
        for address in range(register.address, register.address + register.count):
            self._owner[address] = register.address

    def both(self, register: Register, entry: Entry) -> None:
        """Put an entry behind its registers, with its access rights."""
        self.add(register, entry, entry if entry.access is Access.RW else None)

    def __contains__(self, address: int) -> bool:
        return address in self._owner

    def has(self, address: int, count: int) -> bool:
        """Return whether these registers can be read."""
        return self._whole(address, count) is not None

    def read(self, address: int, count: int) -> list[int]:
        """Return the values of registers, which must be there."""
        words = [0] * count
        for first, cell in (self._whole(address, count) or {}).items():
            words[first - address : first - address + cell.register.count] = cell.words(self._order)
        return words

    def write(self, address: int, words: Sequence[int]) -> list[Entry] | Refusal:
        """Write registers, all or none; return the entries that were written."""
        cells = self._whole(address, len(words))
        if cells is None or sum(cell.register.count for cell in cells.values()) != len(words):
            return Refusal.ADDRESS
        taken: dict[Entry, int] = {}
        for first, cell in cells.items():
            if cell.writes is None:
                return Refusal.ADDRESS
            taken[cell.writes] = cell.value(words[first - address : first - address + cell.register.count], self._order)
        if not all(_accepted(entry, value) for entry, value in taken.items()):
            return Refusal.VALUE
        for entry, value in taken.items():
            entry.value = value
        # Each listener once: a drive acts on a command and a target of one request together.
        for listener in dict.fromkeys(entry.changed for entry in taken if entry.changed is not None):
            listener()
        return list(taken)

    def _found(self, address: int, count: int) -> dict[int, RegisterCell] | None:
        """Return the values within these registers, by address; None when one is cut, or a register does not exist."""
        asked = range(address, address + count)
        if not all(each in self._owner or self._can_be_read(each, each + 1) for each in asked):
            return None
        firsts = dict.fromkeys(self._owner[each] for each in asked if each in self._owner)
        cells = {first: self._cells[first] for first in firsts}
        inside = all(first in asked and first + cell.register.count - 1 in asked for first, cell in cells.items())
        return cells if inside else None


def _accepted(entry: Entry, value: int) -> bool:
    """Return whether an entry takes this value."""
    try:
        if entry.accept is not None:
            entry.accept(value)
    except AccessRefused:
        return False
    return entry.low <= value <= entry.high
