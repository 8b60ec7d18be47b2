"""Communication objects of a simulated node that belong to no other service."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from haptic_fieldbus.drive.profile import DataType
from haptic_fieldbus.sim.canopen.services.basics import ID, NO_RTR, Alarms, move_refused
from haptic_fieldbus.sim.drive.dictionary import AbortCode, Access, Dictionary, Entry, Mappable, one_of, only_if

# Manufacturer-specific objects of the simulated drive: memory for the user's data.
#
# 5FF0h *user data memory* (DOMAIN, rw): two blocks of up to 32 KiB that share 48 KiB, so that a client can try long
# transfers and a full memory. Volatile unless saved by 1010h.
#
# 5FF2h *erase user data memory* (UNSIGNED32, wo): *eras* in ASCII empties both blocks.

USER_DATA_MEMORY = 0x5FF0
ERASE_USER_DATA_MEMORY = 0x5FF2
BLOCK_OCTETS = 32 * 1024
SHARED_OCTETS = 48 * 1024
_ERASE = int.from_bytes(b"eras", "little")


def add_user_data_memory(dictionary: Dictionary) -> None:
    """Add both blocks, empty, and the command that empties them."""
    blocks = [Entry(USER_DATA_MEMORY, number, None, access=Access.RW, limits=(0, BLOCK_OCTETS)) for number in (1, 2)]
    for block, other in (blocks, reversed(blocks)):
        block.accept = only_if(partial(_fits_beside, other), AbortCode.OUT_OF_MEMORY)
    dictionary.add_record(blocks)
    erase = Entry(ERASE_USER_DATA_MEMORY, 0, DataType.UINT32, access=Access.WO, accept=one_of((_ERASE,)))
    erase.changed = lambda: _empty(blocks)
    dictionary.add(erase)


def _empty(blocks: list[Entry]) -> None:
    for block in blocks:
        block.text = b""


def _fits_beside(other: Entry, octets: int) -> bool:
    return octets + len(other.text) <= SHARED_OCTETS


# Parameters that outlive a reset: 1010h stores them, 1011h restores the defaults.
#
# Theory (CiA 301, 7.5.2.13 and 7.5.2.14). A command needs its signature, *save* or *load* in ASCII; any other value is
# refused with 0800 0020h. Sub-index 1 means all parameters, 2 those of communication (1000h to 1FFFh), 3 those of the
# application (6000h to 9FFFh), 4 those of the manufacturer (2000h to 5FFFh). Restored defaults become valid at the next
# reset, of the node or, for sub-index 2, of communication. Saved values replace the power-on values as long as the
# world exists.

SAVE, LOAD = (int.from_bytes(word, "little") for word in (b"save", b"load"))
GROUPS = {1: range(0x1000, 0x10000), 2: range(0x1000, 0x2000), 3: range(0x6000, 0xA000), 4: range(0x2000, 0x6000)}
_ON_COMMAND = 1
"""Value when read: the device stores (restores) on command, not autonomously."""

# Objects that are no parameters: histories and commands, controlword and mode, set-points and offsets of CiA 402-2.
_NO_PARAMETERS = {
    0x1003, 0x1010, 0x1011, 0x6040, 0x6042, 0x6060, 0x6071, 0x607A, 0x60B0, 0x60B1, 0x60B2, 0x60C1, 0x60FE, 0x60FF,
}  # fmt: skip


class Storage:
    """The non-volatile memory of one node."""

    def __init__(self, dictionary: Dictionary) -> None:
        self._dictionary = dictionary
        self._saved: dict[tuple[int, int], tuple[int, bytes]] = {}
        for index, signature, action in ((0x1010, SAVE, self._save), (0x1011, LOAD, self._forget)):
            signed = one_of((signature,), AbortCode.CANNOT_STORE)
            commands = [Entry(index, group, DataType.UINT32, _ON_COMMAND, Access.RW, accept=signed) for group in GROUPS]
            for entry in commands:
                entry.changed = partial(_run, entry, action)
            dictionary.add_record(commands)

    def restore(self, first: int, last: int) -> None:
        """Set the objects from `first` to `last` to their power-on values: saved values, else defaults."""
        self._dictionary.restore(first, last)
        for key, (value, text) in self._saved.items():
            if first <= key[0] <= last and key[0] in self._dictionary:
                entry = self._dictionary.find(*key)
                entry.value, entry.text = value, text

    def _save(self, group: int) -> None:
        for entry in self._dictionary:
            if entry.access is Access.RW and entry.index in GROUPS[group] and entry.index not in _NO_PARAMETERS:
                self._saved[entry.index, entry.subindex] = entry.value, entry.text

    def _forget(self, group: int) -> None:
        self._saved = {key: saved for key, saved in self._saved.items() if key[0] not in GROUPS[group]}


def _run(entry: Entry, action: Callable[[int], None]) -> None:
    """Run a command; its object shows the capability from then on, not the signature."""
    entry.value = _ON_COMMAND
    action(entry.subindex)


# TIME: the time of day that a simulated node takes from the bus (1012h).
#
# Reference: CiA 301 4.2, 7.2.6, 7.1.6.6 (TIME_OF_DAY: 28 bits milliseconds after midnight, 4 bits void, 16 bits days
# since 1 January 1984), 7.5.2.15. The node consumes TIME while bit 31 is set and never produces it. The manufacturer's
# object 5FF1h *time of day* shows the result: 1 milliseconds after midnight, 2 days since 1984.

TIME_ID = 0x100
TIME_OF_DAY = 0x5FF1
_CONSUMED = 1 << 31
_PRODUCED = NO_RTR
_OCTETS = 6
_DAY_MS = 24 * 60 * 60 * 1000
_MS = 1_000_000
_accept_consumer = only_if(lambda value: not value & _PRODUCED)


class TimeConsumer:
    """The clock of the node; `now` returns the time of the simulation [ns]."""

    def __init__(self, dictionary: Dictionary, now: Callable[[], int], changed: Callable[[], None]) -> None:
        self._now = now
        self._set_ns: int | None = None
        self._day = self._ms = 0
        self._cob_id = dictionary.add(Entry(0x1012, 0, DataType.UINT32, TIME_ID, Access.RW, accept=self._accept_cob_id))
        self._cob_id.changed = changed
        self._accept_move = move_refused(self._cob_id, lambda value: value & _CONSUMED != 0)
        ms = Entry(TIME_OF_DAY, 1, DataType.UINT32, mappable=Mappable.NO)
        days = Entry(TIME_OF_DAY, 2, DataType.UINT16, mappable=Mappable.NO)
        ms.fetch, days.fetch = (lambda: self.time_of_day()[1]), (lambda: self.time_of_day()[0])
        dictionary.add_record((ms, days))

    @property
    def can_id(self) -> int | None:
        """Return the identifier of TIME; None when it is not consumed."""
        value = self._cob_id.value
        return value & ID if value & _CONSUMED else None

    def time_of_day(self) -> tuple[int, int]:
        """Return (days since 1984, milliseconds after midnight); zeros before the first TIME."""
        if self._set_ns is None:
            return 0, 0
        days, ms = divmod(self._ms + (self._now() - self._set_ns) // _MS, _DAY_MS)
        return (self._day + days) & 0xFFFF, ms

    def received(self, data: bytes, t_ns: int) -> None:
        """Set the clock from a TIME message; a message of another length is ignored."""
        if len(data) == _OCTETS:
            self._ms = int.from_bytes(data[:4], "little") & 0x0FFF_FFFF
            self._day = int.from_bytes(data[4:], "little")
            self._set_ns = t_ns

    def forget(self) -> None:
        """Forget the time, as at power-on."""
        self._set_ns = None

    def _accept_cob_id(self, value: int) -> None:
        _accept_consumer(value)
        self._accept_move(value)


# The bit timing of a simulated node: whether it matches that of the bus.
#
# Reference: CiA 305, activate bit timing. The node is silent for the switch delay before the bit timing is switched,
# and for the same time after it. The bit rate of a simulated bus does not change. A node set to another one is
# therefore silent and deaf until a power-on restores the stored one.


@dataclass(eq=False)
class BitTiming:
    """The presence of a node on the bus, by its bit rate.

    `wanted` returns the bit rate [bit/s] to use; `changed` is called when the node leaves the bus or returns.
    """

    bus_bitrate: int
    _alarms: Alarms
    _wanted: Callable[[], int]
    _now: Callable[[], int]
    _changed: Callable[[], None]
    on_bus: bool = True
    """False: the node neither sends nor receives."""

    def __post_init__(self) -> None:
        self._alarm = self._alarms.new(lambda _t_ns: self.switch())

    def activate(self, delay_ms: int) -> None:
        """Leave the bus, and return with the wanted bit rate after two switch delays [ms]."""
        self.on_bus = False
        self._alarm.at(self._now() + 2 * delay_ms * _MS)
        self._changed()

    def switch(self) -> None:
        """Use the wanted bit rate now."""
        self._alarm.off()
        self.on_bus = self._wanted() == self.bus_bitrate
        self._changed()


# Communication objects that belong to no single service: 1014h, 1029h, 1200h, and the LSS address in 1018h.
#
# Reference: CiA 301 4.2, 7.5.2.17 (1014h), 7.5.2.32 (1029h), 7.5.2.33 (1200h), 7.5.2.21 (1018h).

_EMERGENCY_ID = 0x80
_SDO = ((1, 0x600), (2, 0x580))
_IDENTITY = 0x1018
_BEHAVIOURS = (0, 1, 2)


class NodeObjects:
    """The objects with the power-on values of node-ID `number`."""

    def __init__(self, dictionary: Dictionary, number: int) -> None:
        self._dictionary = dictionary
        emergency = Entry(0x1014, 0, DataType.UINT32, _EMERGENCY_ID + number, Access.RW, numbered=True)
        emergency.accept = move_refused(emergency)
        self.emergency = dictionary.add(emergency)
        """COB-ID of emergency messages."""
        self.behaviour = Entry(0x1029, 1, DataType.UINT8, 0, Access.RW, accept=one_of(_BEHAVIOURS))
        """Effect of a communication error on the NMT state."""
        dictionary.add_record([self.behaviour])
        dictionary.add_record(
            Entry(0x1200, subindex, DataType.UINT32, base + number, numbered=True) for subindex, base in _SDO
        )
        add_user_data_memory(dictionary)

    def identity(self) -> list[int]:
        """Return the LSS address: vendor-ID, product code, revision number, serial number; 0 for any missing one."""
        return [self._dictionary.value(_IDENTITY, subindex) for subindex in range(1, 5)]
