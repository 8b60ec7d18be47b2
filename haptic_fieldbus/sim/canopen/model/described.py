"""The object dictionary of a simulated drive as its profile describes it, in [simulation.objects].

An object that the simulated drive implements keeps its behaviour and takes access, limits, mappability and power-on
value from the description; one with another type, and one that the drive does not implement, only stores its value.
What is not described stays as it is, since a profile lists differences alone.
"""

import re
from collections.abc import Iterator, Mapping
from itertools import product

from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.protocols.canopen.profile import SimulatedObject
from haptic_fieldbus.sim.drive.dictionary import Access, Dictionary, Entry, Mappable

_MAPPINGS = (*range(0x1600, 0x1800), *range(0x1A00, 0x1C00))
_LAST_DUMMY = 0x0007
NODE_ID = re.compile(r"\$NODEID\s*\+\s*(0x[0-9A-Fa-f]+|\d+)")
"""A value that contains the node-ID."""
OCTETS = 256
"""Capacity of an entry without a type."""
ACCESS = {access.value: access for access in Access} | {"rwr": Access.RW, "rww": Access.RW}
"""Access type of an EDS → access of an entry."""
WAYS = {
    "ro": Mappable.TPDO, "const": Mappable.TPDO, "rwr": Mappable.TPDO,
    "wo": Mappable.RPDO, "rww": Mappable.RPDO, "rw": Mappable.BOTH,
}  # fmt: skip
"""Access type of an EDS → PDOs into which a mappable entry may be mapped."""


def install_described(dictionary: Dictionary, objects: Mapping[str, SimulatedObject], node: int) -> None:
    """Make the dictionary hold the described objects, for this node-ID."""
    present = {(entry.index, entry.subindex): entry for entry in dictionary}
    for name, described in objects.items():
        for index, subindex in entries_of(name):
            entry = present.get((index, subindex))
            if described.absent:
                dictionary.remove(index, subindex)
            elif entry is None or (described.type is not None and described.type is not entry.type):
                dictionary.add(_stored(index, subindex, described, node))
            else:
                _change(entry, described, node)
    _check_mappings(dictionary)


def _check_mappings(dictionary: Dictionary) -> None:
    """Raise UsageError for a PDO that maps an object after power-on which the drive does not have."""
    for count in [entry for entry in dictionary if entry.subindex == 0 and entry.index in _MAPPINGS]:
        for subindex in range(1, count.default + 1):
            mapping = dictionary.value(count.index, subindex)
            if mapping >> 16 not in dictionary and mapping >> 16 > _LAST_DUMMY:
                raise UsageError(
                    f"simulation.objects: {count.index:04X}h:{subindex:02X} maps {mapping:08X}h, which the drive does "
                    "not have; describe that object too, or let the PDO map nothing"
                )


def entries_of(name: str) -> Iterator[tuple[int, int]]:
    """Yield index and sub-index of each entry that a key of [simulation.objects] names.

    All numbers are hexadecimal, and each may be a range: "6007", "60C2:01", "1400-1403:01-02".
    """
    indices, _, subindices = name.partition(":")
    yield from product(_range(indices), _range(subindices or "0"))


def _range(text: str) -> range:
    first, _, last = text.partition("-")
    return range(int(first, 16), int(last or first, 16) + 1)


def _stored(index: int, subindex: int, described: SimulatedObject, node: int) -> Entry:
    """Return an entry that only stores its value; without a type it stores octets."""
    access = described.access or "ro"
    ways = _ways(access, described.mappable)
    entry = Entry(index, subindex, described.type, access=ACCESS[access], mappable=ways, capacity=OCTETS)
    _set_limits(entry, described)
    _set_value(entry, described.value if described.value is not None else max(entry.low, min(entry.high, 0)), node)
    return entry


def _change(entry: Entry, described: SimulatedObject, node: int) -> None:
    """Give an entry that the drive implements what is described of it."""
    if described.access is not None:
        entry.access = ACCESS[described.access]
    if described.mappable is not None or (described.access is not None and entry.mappable):
        access = described.access or ("rw" if entry.access is Access.RW else entry.access.value)
        entry.mappable = _ways(access, described.mappable is not False)
    _set_limits(entry, described)
    if described.value is not None:
        _set_value(entry, described.value, node)


def _ways(access: str, mappable: bool | None) -> Mappable:
    return WAYS[access] if mappable else Mappable.NO


def _set_limits(entry: Entry, described: SimulatedObject) -> None:
    if entry.type is not None:
        entry.low = entry.low if described.low is None else described.low
        entry.high = entry.high if described.high is None else described.high
        # A value of the bench, such as a ramp, may be beyond them.
        entry.value = entry.default = max(entry.low, min(entry.high, entry.default))


def _set_value(entry: Entry, value: int | str, node: int) -> None:
    """Set the power-on value; a number with the node-ID changes with it."""
    if entry.type is None:
        entry.text = entry.default_text = str(value).encode()
        return
    offset = NODE_ID.fullmatch(value) if isinstance(value, str) else None
    entry.numbered = offset is not None
    entry.value = entry.default = int(offset[1], 0) + node if offset is not None else int(value)
