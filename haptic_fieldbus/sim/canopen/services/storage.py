"""Parameters that outlive a reset: 1010h stores them, 1011h restores the defaults.

Theory (CiA 301, 7.5.2.13 and 7.5.2.14). A command needs its signature, *save* or *load* in ASCII; any other value is
refused with 0800 0020h. Sub-index 1 means all parameters, 2 those of communication (1000h to 1FFFh), 3 those of the
application (6000h to 9FFFh), 4 those of the manufacturer (2000h to 5FFFh). Restored defaults become valid at the next
reset, of the node or, for sub-index 2, of communication. Saved values replace the power-on values as long as the world
exists.
"""

from collections.abc import Callable, Iterator

from haptic_fieldbus.drive.objects import DataType
from haptic_fieldbus.sim.drive.dictionary import AbortCode, Access, Dictionary, Entry, Refused

SAVE, LOAD = (int.from_bytes(word, "little") for word in (b"save", b"load"))
GROUPS = {
    1: range(0x1000, 0x10000),
    2: range(0x1000, 0x2000),
    3: range(0x6000, 0xA000),
    4: range(0x2000, 0x6000),
}
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
            dictionary.add_record(self._commands(index, signature, action))

    def restore(self, first: int, last: int) -> None:
        """Set the objects from `first` to `last` to their power-on values: saved values, else defaults."""
        self._dictionary.restore(first, last)
        for key, (value, text) in self._saved.items():
            if first <= key[0] <= last and key[0] in self._dictionary:
                entry = self._dictionary.find(*key)
                entry.value, entry.text = value, text

    def _commands(self, index: int, signature: int, action: Callable[[int], None]) -> Iterator[Entry]:
        for group in GROUPS:
            entry = Entry(index, group, DataType.UINT32, _ON_COMMAND, Access.RW, accept=_signed(signature))
            entry.changed = _command(entry, action)
            yield entry

    def _save(self, group: int) -> None:
        for entry in self._dictionary:
            if entry.access is Access.RW and entry.index in GROUPS[group] and entry.index not in _NO_PARAMETERS:
                self._saved[entry.index, entry.subindex] = entry.value, entry.text

    def _forget(self, group: int) -> None:
        self._saved = {key: saved for key, saved in self._saved.items() if key[0] not in GROUPS[group]}


def _signed(signature: int) -> Callable[[int], None]:
    def accept(value: int) -> None:
        if value != signature:
            raise Refused(AbortCode.CANNOT_STORE)

    return accept


def _command(entry: Entry, action: Callable[[int], None]) -> Callable[[], None]:
    """Return a `changed` that runs the command and then shows the capability of the object, not the signature."""

    def changed() -> None:
        entry.value = _ON_COMMAND
        action(entry.subindex)

    return changed
