"""Process data objects of a simulated node: communication and mapping parameters, and the compiled packing.

Theory (CiA 301, 7.2.2 and 7.5.2.35 to 38). A PDO is changed in this order: set bit 31 of its COB-ID, set the number of
mapped objects to 0, write the mapping entries, write their number, clear bit 31; any other order is refused.
Transmission types 0 to 240 follow SYNC (0: at the SYNC after a change, n: at every nth). Types 254 and 255 follow an
event: a mapped value changed, or the event timer elapsed, but not within the inhibit time after the last transmission.
TPDOs of type 252 and 253 are sent on a remote frame, 252 with the values of the last SYNC; a remote frame may request
any TPDO whose COB-ID has bit 30 clear. A synchronous RPDO acts at the next SYNC, an event-driven one at once; its event
timer is a deadline. When a parameter changes, the PDO is compiled to one `struct` and a list of entries, so a frame
needs no look-up.
"""

import struct
from collections.abc import Callable
from dataclasses import dataclass

from haptic_fieldbus.drive.profile import DataType
from haptic_fieldbus.sim.canopen.services.basics import ID, INVALID, NO_RTR, move_refused
from haptic_fieldbus.sim.drive.dictionary import AbortCode, Access, AccessRefused, Dictionary, Entry, Mappable, one_of

MS = 1_000_000
_MAX_BITS = 64
_LAST_SYNCHRONOUS = 240
_SAMPLED_AT_SYNC, _FIRST_EVENT = 252, 254
_EVENT_DRIVEN = 255
_RPDO_TYPES = (*range(_LAST_SYNCHRONOUS + 1), 254, _EVENT_DRIVEN)
_TPDO_TYPES = (*_RPDO_TYPES, 252, 253)

# CiA 301, 7.4.7.1: data types as dummy entries, which are unused space in an RPDO.
_DUMMIES = {
    0x0002: DataType.INT8, 0x0003: DataType.INT16, 0x0004: DataType.INT32,
    0x0005: DataType.UINT8, 0x0006: DataType.UINT16, 0x0007: DataType.UINT32,
}  # fmt: skip


@dataclass(frozen=True)
class PdoDefaults:
    """A PDO after power-on, event-driven; `mapping` holds the values of its mapping entries."""

    number: int
    cob_id: int
    mapping: tuple[int, ...] = ()
    max_entries: int = 8
    inhibit_time: int = 0
    """[100 µs]"""
    sync_honoured: bool = True
    """False: an RPDO of a synchronous type still acts on reception (a quirk of some drives)."""
    fixed: bool = False
    """True: the mapping cannot be written."""


class Pdo:
    """The common part of TPDO and RPDO: the records, their rules, the compiled form."""

    direction = Mappable.NO
    communication_base = 0
    mapping_base = 0
    types: tuple[int, ...] = ()
    _further: tuple[Entry, ...] = ()
    """Further entries of the communication record."""

    def __init__(self, dictionary: Dictionary, defaults: PdoDefaults, changed: Callable[[], None]) -> None:
        self.number = defaults.number
        self._sync_honoured = defaults.sync_honoured
        self._dictionary = dictionary
        self._changed = changed
        self._max_entries = defaults.max_entries
        self._event_timer = self._timer(5, 0)
        self._cob_id, self._type = self._add_communication(defaults)
        self._count, self._entries = self._add_mapping(defaults)
        self.mapped: list[Entry] = []
        self.packing = struct.Struct("<")
        self.exists = False
        self.valid = False
        """True when the PDO exists and maps at least one object."""
        self.can_id = 0
        self.synchronous = False
        self._compile()

    def compile(self) -> None:
        """Take over the parameters of the dictionary."""
        self._compile()
        self._changed()

    def _compile(self) -> None:
        self.exists = not self._cob_id.value & INVALID
        self.can_id = self._cob_id.value & ID
        self.synchronous = self._sync_honoured and self._type.value <= _LAST_SYNCHRONOUS
        try:
            self.mapped = [self._resolve(entry.value) for entry in self._entries[: self._count.value]]
        except AccessRefused:
            # A described power-on value maps what cannot be mapped; what is written was judged before.
            self.mapped = []
        self.packing = struct.Struct("<" + "".join(entry.type.code for entry in self.mapped if entry.type is not None))
        self.valid = self.exists and bool(self.mapped)

    def _add_communication(self, defaults: PdoDefaults) -> tuple[Entry, Entry]:
        index = self.communication_base + defaults.number - 1
        # A predefined identifier contains the node-ID, no identifier does not.
        numbered = bool(defaults.cob_id & ID)
        cob_id = Entry(index, 1, DataType.UINT32, defaults.cob_id, Access.RW, numbered=numbered)
        cob_id.accept = move_refused(cob_id)
        type_ = Entry(index, 2, DataType.UINT8, _EVENT_DRIVEN, Access.RW, accept=one_of(self.types))
        cob_id.changed = type_.changed = self._event_timer.changed = self.compile
        self._dictionary.add_record([cob_id, type_, self._event_timer, *self._further])
        return cob_id, type_

    def _timer(self, subindex: int, value: int, *, locked: bool = False) -> Entry:
        index = self.communication_base + self.number - 1
        accept = self._accept_locked if locked else None
        return Entry(index, subindex, DataType.UINT16, value, Access.RW, accept=accept)

    def _add_mapping(self, defaults: PdoDefaults) -> tuple[Entry, list[Entry]]:
        index, access = self.mapping_base + defaults.number - 1, Access.RO if defaults.fixed else Access.RW
        values = (*defaults.mapping, *(0,) * (defaults.max_entries - len(defaults.mapping)))
        entries = [
            Entry(index, number, DataType.UINT32, value, access, accept=self._accept_entry)
            for number, value in enumerate(values, start=1)
        ]
        count = Entry(index, 0, DataType.UINT8, len(defaults.mapping), access, accept=self._accept_count)
        count.changed = self.compile
        for entry in (count, *entries):
            self._dictionary.add(entry)
        return count, entries

    def _accept_locked(self, _value: int) -> None:
        """Refuse a value that may only be changed while the PDO does not exist."""
        if self.exists:
            raise AccessRefused(AbortCode.UNSUPPORTED_ACCESS)

    def _accept_entry(self, value: int) -> None:
        self._accept_locked(value)
        if self._count.value:
            raise AccessRefused(AbortCode.UNSUPPORTED_ACCESS)
        # 0 marks an entry that is not used.
        if value:
            self._resolve(value)

    def _accept_count(self, value: int) -> None:
        self._accept_locked(value)
        if value > self._max_entries:
            raise AccessRefused(AbortCode.MAPPING_TOO_LONG)
        if sum(self._resolve(entry.value).bits for entry in self._entries[:value]) > _MAX_BITS:
            raise AccessRefused(AbortCode.MAPPING_TOO_LONG)

    def _resolve(self, mapping: int) -> Entry:
        """Return the entry that a mapping value names; raises Refused when it cannot be mapped here."""
        # Mapping value: index in bits 16 to 31, sub-index in 8 to 15, length in bits below.
        index, subindex, bits = mapping >> 16, mapping >> 8 & 0xFF, mapping & 0xFF
        if index in _DUMMIES and self.direction is Mappable.RPDO:
            entry = Entry(index, subindex, _DUMMIES[index], mappable=Mappable.RPDO)
        else:
            entry = self._dictionary.find(index, subindex)
        if self.direction not in entry.mappable or entry.type is None or entry.bits != bits:
            raise AccessRefused(AbortCode.NOT_MAPPABLE)
        return entry


class Rpdo(Pdo):
    """A PDO that the node receives."""

    direction = Mappable.RPDO
    communication_base = 0x1400
    mapping_base = 0x1600
    types = _RPDO_TYPES

    @property
    def deadline_ns(self) -> int:
        """Return the longest permitted time between two receptions; 0: no deadline."""
        return self._event_timer.value * MS

    def apply(self, data: bytes) -> None:
        """Write the mapped entries; `data` holds at least the octets of all of them."""
        for entry, value in zip(self.mapped, self.packing.unpack_from(data), strict=True):
            entry.value = value


class Tpdo(Pdo):
    """A PDO that the node sends."""

    direction = Mappable.TPDO
    communication_base = 0x1800
    mapping_base = 0x1A00
    types = _TPDO_TYPES

    def __init__(self, dictionary: Dictionary, defaults: PdoDefaults, changed: Callable[[], None]) -> None:
        # The timer's index needs the number, and the record that super().__init__ adds needs the timer.
        self.number = defaults.number
        self._inhibit_time = self._timer(3, defaults.inhibit_time, locked=True)
        index = self.communication_base + defaults.number - 1
        self._start = Entry(
            index, 6, DataType.UINT8, 0, Access.RW, limits=(0, _LAST_SYNCHRONOUS), accept=self._accept_locked
        )
        self._further = self._inhibit_time, self._start
        super().__init__(dictionary, defaults, changed)
        self.restart(0)

    @property
    def event_driven(self) -> bool:
        return self._type.value >= _FIRST_EVENT

    @property
    def with_sync(self) -> bool:
        """Return whether a SYNC sends this TPDO or samples it."""
        return self.synchronous or self._type.value == _SAMPLED_AT_SYNC

    @property
    def on_request(self) -> bool:
        """Return whether remote frames are answered."""
        return self.valid and not self._cob_id.value & NO_RTR

    def restart(self, t_ns: int, *, counted: bool = False) -> None:
        """Start anew on entering *operational*: count SYNC from here, and treat the present values as an event.

        With `counted` the SYNC messages carry a counter, and the TPDO waits for its SYNC start value.
        """
        self._syncs = 0
        self._awaited = self._start.value if counted else 0
        self._sent: bytes | None = None
        self._sampled: bytes | None = None
        self._sent_ns = t_ns
        self._free_ns = t_ns

    def data(self) -> bytes:
        """Return the mapped values as they are now."""
        return self.packing.pack(*[entry.value for entry in self.mapped])

    def at_sync(self, counter: int) -> bytes | None:
        """Return the octets to send after this SYNC; None for no transmission."""
        if self._awaited:
            if counter != self._awaited:
                return None
            self._awaited = 0
        self._syncs += 1
        type_ = self._type.value
        # Acyclic: only when a mapped value has changed since the last transmission.
        if type_ == 0:
            data = self.data()
            if data == self._sent:
                return None
            self._sent = data
            return data
        if type_ == _SAMPLED_AT_SYNC:
            self._sampled = self.data()
            return None
        if self._syncs < type_:
            return None
        self._syncs = 0
        return self.data()

    def at_event(self, t_ns: int) -> bytes | None:
        """Return the octets that an event-driven TPDO sends at `t_ns`; None for no transmission."""
        if t_ns < self._free_ns:
            return None
        data = self.data()
        timer_ns = self._event_timer.value * MS
        if data == self._sent and not (timer_ns and t_ns >= self._sent_ns + timer_ns):
            return None
        self._sent, self._sent_ns = data, t_ns
        # 1800h:03 is in steps of 100 µs.
        self._free_ns = t_ns + self._inhibit_time.value * 100_000
        return data

    def at_request(self, measure: Callable[[], None]) -> bytes | None:
        """Return the answer to a remote frame; None for no transmission.

        Type 252 answers with the sample of the last SYNC, None before one. Other types answer with the mapped values,
        which `measure` brings up to date first unless the type is synchronous.
        """
        if self._type.value == _SAMPLED_AT_SYNC:
            return self._sampled
        if not self.synchronous:
            measure()
        return self.data()
