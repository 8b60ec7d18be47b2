"""Process data objects of a simulated node: communication and mapping parameters, and the compiled packing.

Theory (CiA 301, 7.2.2 and 7.5.2.35 to 38). A PDO is changed in this order: bit 31 of its COB-ID set, number of mapped
objects 0, the mapping entries, the number of them, bit 31 cleared; everything else is refused. Types 0 to 240 follow
SYNC (0: at the SYNC after a change, n: every nth), 254 and 255 an event: a mapped value changed, or the event timer
elapsed, not sooner than the inhibit time after the last one. A synchronous RPDO acts at the next SYNC, an event-driven
one at once. Whenever a parameter changes the PDO is compiled to one `struct` and a list of entries, so a frame costs no
look-up.
"""

import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from haptic_fieldbus.drive.objects import DataType
from haptic_fieldbus.sim.dictionary import AbortCode, Access, Dictionary, Entry, Mappable, SdoAbort, one_of

INVALID = 1 << 31
_EXTENDED = 1 << 29
_ID = 0x7FF
_MAX_BITS = 64
_LAST_SYNCHRONOUS = 240
TRANSMISSION_TYPES = (*range(_LAST_SYNCHRONOUS + 1), 254, 255)

# CiA 301, table 41: CAN-IDs of restricted use.
_RESTRICTED = (
    range(0x080), range(0x101, 0x181), range(0x581, 0x600), range(0x601, 0x680), range(0x6E0, 0x700),
    range(0x701, 0x800),
)  # fmt: skip

# CiA 301, 7.4.7.1: data types as dummy entries, space in an RPDO that is not used.
_DUMMIES = {
    0x0002: DataType.INT8, 0x0003: DataType.INT16, 0x0004: DataType.INT32,
    0x0005: DataType.UINT8, 0x0006: DataType.UINT16, 0x0007: DataType.UINT32,
}  # fmt: skip


@dataclass(frozen=True)
class PdoDefaults:
    """A PDO after power-on; `mapping` holds the values of its mapping entries."""

    number: int
    cob_id: int
    mapping: tuple[int, ...] = ()
    max_entries: int = 8
    transmission_type: int = 255
    inhibit_time: int = 0
    """[100 µs]"""


class Pdo:
    """What TPDO and RPDO share: the records, their rules, the compiled form."""

    direction = Mappable.NO
    communication_base = 0
    mapping_base = 0

    def __init__(self, dictionary: Dictionary, defaults: PdoDefaults, changed: Callable[[], None]) -> None:
        self.number = defaults.number
        self._dictionary = dictionary
        self._changed = changed
        self._max_entries = defaults.max_entries
        self._cob_id, self._type = self._add_communication(defaults)
        self._count, self._entries = self._add_mapping(defaults)
        self.mapped: list[Entry] = []
        self.packing = struct.Struct("<")
        self.valid = False
        self.can_id = 0
        self.synchronous = False
        self._compile()

    @property
    def size(self) -> int:
        """Octets of the mapped objects."""
        return self.packing.size

    def compile(self) -> None:
        """Take over the parameters as they stand in the dictionary."""
        self._compile()
        self._changed()

    def _compile(self) -> None:
        self.valid = not self._cob_id.value & INVALID
        self.can_id = self._cob_id.value & _ID
        self.synchronous = self._type.value <= _LAST_SYNCHRONOUS
        self.mapped = [self._resolve(entry.value) for entry in self._entries[: self._count.value]]
        self.packing = struct.Struct("<" + "".join(entry.type.code for entry in self.mapped if entry.type is not None))

    def _add_communication(self, defaults: PdoDefaults) -> tuple[Entry, Entry]:
        index = self.communication_base + defaults.number - 1
        cob_id = Entry(index, 1, DataType.UINT32, defaults.cob_id, Access.RW, accept=self._accept_cob_id)
        type_ = Entry(
            index, 2, DataType.UINT8, defaults.transmission_type, Access.RW, accept=one_of(TRANSMISSION_TYPES)
        )
        cob_id.changed = type_.changed = self.compile
        self._dictionary.add_record([cob_id, type_, *self._timers()])
        return cob_id, type_

    def _timers(self) -> Sequence[Entry]:
        """Further entries of the communication record."""
        return ()

    def _add_mapping(self, defaults: PdoDefaults) -> tuple[Entry, list[Entry]]:
        index = self.mapping_base + defaults.number - 1
        values = (*defaults.mapping, *(0,) * (defaults.max_entries - len(defaults.mapping)))
        entries = [
            Entry(index, number, DataType.UINT32, value, Access.RW, accept=self._accept_entry)
            for number, value in enumerate(values, start=1)
        ]
        count = Entry(index, 0, DataType.UINT8, len(defaults.mapping), Access.RW, accept=self._accept_count)
        count.changed = self.compile
        for entry in (count, *entries):
            self._dictionary.add(entry)
        return count, entries

    def _accept_cob_id(self, value: int) -> None:
        becomes_valid = not value & INVALID
        moves = self.valid and value & _ID != self.can_id
        restricted = any(value & _ID in identifiers for identifiers in _RESTRICTED)
        if value & _EXTENDED or (becomes_valid and (moves or restricted)):
            raise SdoAbort(AbortCode.INVALID_VALUE)

    def _accept_locked(self, _value: int) -> None:
        """What may only be changed while the PDO does not exist."""
        if self.valid:
            raise SdoAbort(AbortCode.UNSUPPORTED_ACCESS)

    def _accept_entry(self, value: int) -> None:
        self._accept_locked(value)
        if self._count.value:
            raise SdoAbort(AbortCode.UNSUPPORTED_ACCESS)
        if value:
            self._resolve(value)

    def _accept_count(self, value: int) -> None:
        self._accept_locked(value)
        if value > self._max_entries:
            raise SdoAbort(AbortCode.MAPPING_TOO_LONG)
        if sum(self._resolve(entry.value).bits for entry in self._entries[:value]) > _MAX_BITS:
            raise SdoAbort(AbortCode.MAPPING_TOO_LONG)

    def _resolve(self, mapping: int) -> Entry:
        """The entry that a mapping value names; SdoAbort when it cannot be mapped here."""
        index, subindex, bits = mapping >> 16, mapping >> 8 & 0xFF, mapping & 0xFF
        if index in _DUMMIES and self.direction is Mappable.RPDO:
            entry = Entry(index, subindex, _DUMMIES[index], mappable=Mappable.RPDO)
        else:
            entry = self._dictionary.find(index, subindex)
        if self.direction not in entry.mappable or entry.type is None or entry.bits != bits:
            raise SdoAbort(AbortCode.NOT_MAPPABLE)
        return entry


class Rpdo(Pdo):
    """A PDO that the node receives; `waiting` is what acts at the next SYNC."""

    direction = Mappable.RPDO
    communication_base = 0x1400
    mapping_base = 0x1600
    waiting: bytes | None = None

    def apply(self, data: bytes) -> None:
        """Write the mapped entries; `data` holds at least `size` octets."""
        for entry, value in zip(self.mapped, self.packing.unpack_from(data), strict=True):
            entry.value = value


class Tpdo(Pdo):
    """A PDO that the node sends."""

    direction = Mappable.TPDO
    communication_base = 0x1800
    mapping_base = 0x1A00

    def __init__(self, dictionary: Dictionary, defaults: PdoDefaults, changed: Callable[[], None]) -> None:
        index = self.communication_base + defaults.number - 1
        self._inhibit_time = Entry(
            index, 3, DataType.UINT16, defaults.inhibit_time, Access.RW, accept=self._accept_locked
        )
        self._event_timer = Entry(index, 5, DataType.UINT16, 0, Access.RW)
        super().__init__(dictionary, defaults, changed)
        self.restart(0)

    def restart(self, t_ns: int) -> None:
        """Entering *operational*: SYNC is counted from here, and the present values are an event."""
        self._syncs = 0
        self._sent: bytes | None = None
        self._sent_ns = t_ns
        self._free_ns = t_ns

    def data(self) -> bytes:
        """The mapped values as they stand."""
        return self.packing.pack(*[entry.value for entry in self.mapped])

    def at_sync(self) -> bytes | None:
        """What is sent after this SYNC."""
        self._syncs += 1
        type_ = self._type.value
        if type_ == 0:
            data = self.data()
            if data == self._sent:
                return None
            self._sent = data
            return data
        if self._syncs < type_:
            return None
        self._syncs = 0
        return self.data()

    def at_event(self, t_ns: int) -> bytes | None:
        """What an event-driven TPDO sends now [ns]."""
        if t_ns < self._free_ns:
            return None
        data = self.data()
        timer_ns = self._event_timer.value * 1_000_000
        if data == self._sent and not (timer_ns and t_ns >= self._sent_ns + timer_ns):
            return None
        self._sent, self._sent_ns = data, t_ns
        self._free_ns = t_ns + self._inhibit_time.value * 100_000
        return data

    def _timers(self) -> Sequence[Entry]:
        return self._inhibit_time, self._event_timer
