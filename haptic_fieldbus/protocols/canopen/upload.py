"""The part of a drive's object dictionary that a profile of no particular drive depends on, as the drive tells it.

An upload shows whether an object is there, its size and its value, but neither its access type nor whether a PDO may
carry it. These are taken from CiA 301 and CiA 402-2; a drive that has them otherwise refuses the write or the mapping,
and is refused itself, before there is torque.

One sign shows that a mapping is fixed: the record has no entry beyond those that it uses. Where PDOs like this carry
all that force needs, in both directions, they are used as they are (decision 0041).
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import replace

from haptic_fieldbus.eds import Eds, EdsEntry, EdsObject, EdsType, ObjectCode
from haptic_fieldbus.errors import BusConfigurationError
from haptic_fieldbus.protocols.canopen.eds_pdos import COMMUNICATION, MAPPING, MOST_ENTRIES
from haptic_fieldbus.protocols.canopen.eds_values import BY_KEY, OBJECTS, Use, data_type
from haptic_fieldbus.protocols.canopen.pdo import Direction
from haptic_fieldbus.protocols.canopen.profile import CanopenProfile

Upload = Callable[[int, int], bytes | None]
"""Function that uploads an index and sub-index; None: it does not exist, empty: it cannot be read."""
SOURCE = "the drive"
_NUMBERS = {own: type for type in EdsType if (own := data_type(EdsEntry(0, 0, "", type, "ro"))) is not None}
"""Type of profiles → the same type of an EDS."""
_GAP = 8
"""PDOs that are missing in a row before the search for more ends; some drives have only every other one."""
_LACKED = ("torque.rated", "torque.rated_current", "link_loss.abort_connection_option",
           "link_loss.fault_reaction_option", "link_loss.heartbeat_consumer")  # fmt: skip
"""Keys whose objects a drive may lack, beside those of the signals."""


def uploaded(profile: CanopenProfile, upload: Upload) -> Eds:
    """Return the objects of the standards, and those that the profile names, which the drive has, with their values."""
    found: dict[int, dict[int, EdsEntry]] = {}
    for entry in _wanted(profile):
        data = upload(entry.index, entry.subindex)
        if data is not None:
            found.setdefault(entry.index, {})[entry.subindex] = _as_it_is(entry, data)
    held = {direction: _held(direction, upload) for direction in Direction}
    # The objects that force needs in the PDOs of each direction.
    needed = {Direction.TPDO: {0x6041, 0x6064 if 0x6064 in found else 0x606C}, Direction.RPDO: {0x6040, 0x6071}}
    carried = {way: {value >> 16 for values in mappings.values() for value in values} for way, mappings in held.items()}
    is_fixed = all(needed[direction] <= carried[direction] for direction in Direction)
    for direction in Direction:
        for entry in _pdos(held[direction], upload, profile.pdo.entries, is_fixed=is_fixed):
            found.setdefault(entry.index, {})[entry.subindex] = entry
    objects = {index: EdsObject(index, "", ObjectCode.RECORD, entries) for index, entries in found.items()}
    return Eds(objects, source=SOURCE)


def _wanted(profile: CanopenProfile) -> Iterator[EdsEntry]:
    """Yield the objects of the standards, those of PDOs first, then the others that the profile names."""
    standard = sorted(
        (row for row in OBJECTS if row.types),
        key=lambda row: (row.use is not Use.SENT, row.use is not Use.RECEIVED, row.index, row.subindex),
    )
    for row in standard:
        access = {Use.SENT: "ro", Use.RECEIVED: "rww"}.get(row.use, "rw")
        yield _entry(row.index, row.subindex, row.types[0], access, mappable=row.use.direction is not None)
    for own in (*profile.entries().values(), *(BY_KEY[key].named(profile) for key in _LACKED)):
        if own is not None and all(own.object != row.index for row in standard):
            yield _entry(own.object, own.subindex, _NUMBERS[own.type], "rw", mappable=True)


def _held(direction: Direction, upload: Upload) -> dict[int, tuple[int, ...]]:
    """Return the mapping of each PDO with no mapping entry beyond those that it uses, by its communication parameter.

    The others have entries that are free, so their mapping can be written, and are here without any.
    """
    found: dict[int, tuple[int, ...]] = {}
    for index in _present(direction, upload):
        count = int.from_bytes(upload(index + MAPPING, 0) or b"", "little")
        is_full = 0 < count <= MOST_ENTRIES
        with suppress(BusConfigurationError):  # an abort code of the vendor's own: the entry is not there
            is_full = is_full and upload(index + MAPPING, count + 1) is None
        octets = [upload(index + MAPPING, each) or b"" for each in range(1, count + 1)] if is_full else []
        found[index] = tuple(int.from_bytes(each, "little") for each in octets)
    return found


def _pdos(held: Mapping[int, tuple[int, ...]], upload: Upload, entries: int, *, is_fixed: bool) -> Iterator[EdsEntry]:
    """Yield the communication and the mapping parameters of the PDOs of a direction.

    With `is_fixed` a mapping without a free entry is taken as it is; else each has room for `entries`.
    """
    for index, values in held.items():
        yield _entry(index, 1, EdsType.UNSIGNED32, "rw")
        yield _entry(index, 2, EdsType.UNSIGNED8, "rw")
        inhibit = upload(index, 3) if index in COMMUNICATION[Direction.TPDO] else None
        if inhibit:
            yield _as_it_is(_entry(index, 3, EdsType.UNSIGNED16, "rw"), inhibit)
        if values and is_fixed:
            for subindex, value in enumerate((len(values), *values)):
                yield replace(_entry(index + MAPPING, subindex, EdsType.UNSIGNED32, "ro"), default=value)
            continue
        yield _entry(index + MAPPING, 0, EdsType.UNSIGNED8, "rw")
        yield from (_entry(index + MAPPING, each, EdsType.UNSIGNED32, "rw") for each in range(1, entries + 1))


def _present(direction: Direction, upload: Upload) -> list[int]:
    """Return the communication parameters of the PDOs that have a mapping parameter too."""
    records, found = COMMUNICATION[direction], list[int]()
    index = after = records.start
    while index < min(after + _GAP, records.stop):
        if upload(index, 1) is not None and upload(index + MAPPING, 0) is not None:
            found.append(index)
            after = index + 1
        index += 1
    return found


def _entry(index: int, subindex: int, type: EdsType, access: str, *, mappable: bool = False) -> EdsEntry:
    return EdsEntry(index, subindex, "", type, access, mappable=mappable)


def _as_it_is(entry: EdsEntry, data: bytes) -> EdsEntry:
    """Return an entry with the size and the value that were uploaded; nothing was of one that can only be written."""
    signed = entry.type is not None and entry.type.signed
    sized = {type.size: type for type in _NUMBERS.values() if type.signed is signed}
    if not data:
        return replace(entry, access="wo")
    return replace(entry, type=sized.get(len(data)), default=int.from_bytes(data, "little", signed=signed))
