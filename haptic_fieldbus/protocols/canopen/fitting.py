"""A profile of no particular drive, fitted to the drive that it meets.

Nearly all objects of CiA 402-2 are optional, so no drive has them all. What the drive has is used as the profile says;
what it lacks is left out, and where the standards have a second way, that one is taken: profile torque mode, torque
actual value as the echo, life guarding. Nothing takes the place of a guard that is not there: without one the plan caps
the torque, or is refused (decision 0036).
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from enum import Enum
from typing import Any

from haptic_fieldbus.drive.profile import DataType, ObjectEntry
from haptic_fieldbus.eds import Eds, EdsEntry, EdsObject, EdsType, ObjectCode
from haptic_fieldbus.errors import BusConfigurationError
from haptic_fieldbus.protocols.canopen import eds_values
from haptic_fieldbus.protocols.canopen.eds_pdos import COMMUNICATION, MAPPING, MOST_ENTRIES, carries, torque_mode
from haptic_fieldbus.protocols.canopen.eds_values import BY_KEY, OBJECTS, Use, data_type, number_of, value_at
from haptic_fieldbus.protocols.canopen.from_eds import LEFT_OUT, profile_from_eds
from haptic_fieldbus.protocols.canopen.pdo import Direction
from haptic_fieldbus.protocols.canopen.profile import NO_SUCH, CanopenProfile, SyncSection

# Which profiles fit a device, by what it says of itself, and how sure that is.


class MatchQuality(Enum):
    """How well a profile fits a device, the best first; the value is the words for people."""

    PRODUCT = "certain: vendor and product code match the profile"
    MODEL = "likely: the vendor matches, and the device name contains the model"
    VENDOR = "possible: the vendor matches; the profile has no product codes"
    DRIVE = "possible match: a CiA 402 drive of a vendor without a profile"


def fitting(
    profiles: Iterable[CanopenProfile], vendor_id: int | None, product_code: int | None, name: str | None
) -> list[tuple[CanopenProfile, MatchQuality]]:
    """Return the profiles that may be that of a CiA 402 drive, the surest first."""
    graded = ((profile, _sureness(profile, vendor_id, product_code, name or "")) for profile in profiles)
    found = [(profile, sureness) for profile, sureness in graded if sureness is not None]
    return sorted(found, key=lambda each: [*MatchQuality].index(each[1]))


def _sureness(profile: CanopenProfile, vendor: int | None, product: int | None, name: str) -> MatchQuality | None:
    expected = profile.identity
    if expected.vendor_id is None and not expected.product_codes:
        return MatchQuality.DRIVE
    if expected.vendor_id is not None and expected.vendor_id != vendor:
        return None
    if expected.product_codes:
        return MatchQuality.PRODUCT if product in expected.product_codes else None
    model = profile.drive.model.split()[0].casefold()
    return MatchQuality.MODEL if model in name.casefold() else MatchQuality.VENDOR


# The profile with what the drive has.

_TOLD = ("torque.mode_of_operation", "torque.slope.object", "torque.slope.value", "torque.echo",
         "position.actual.unit", "pdo.tpdos", "pdo.rpdos", "pdo.tpdo_fixed", "pdo.rpdo_fixed",
         "pdo.inhibit_time_default", "sync.interpolation_time", "sync.powers", "sync.values",
         "sync.cycle_period", "link_loss.life_guarding")  # fmt: skip
"""Keys whose values the drive tells."""
_KEPT = ("tpdo_types", "rpdo_types", "rpdo_acts", "entries")
"""Keys of the PDOs whose values are those of the profile."""
_CONSUMER = "link_loss.heartbeat_consumer"
_OPTIONAL = ("torque.rated", "torque.rated_current", "link_loss.abort_connection_option",
             "link_loss.fault_reaction_option", _CONSUMER)  # fmt: skip
"""Keys whose objects a drive may lack, beside those of the signals."""


def fitted(profile: CanopenProfile, eds: Eds) -> CanopenProfile:
    """Return the profile fitted to the drive, by the objects that were uploaded from it.

    It is not usable for force where the drive lacks what force needs. Raises EdsError for no CiA 402 drive.
    """
    mode, modes = profile.torque.mode_of_operation, eds_values.supported_modes(eds)
    if mode > 0 and modes and not modes >> mode - 1 & 1:  # the drive names its modes, and not this one
        mode = torque_mode(eds)
    made = profile_from_eds(eds, mode)
    lacked = _lacked(profile, eds)
    torque, guard, echo = profile.torque, profile.link_loss, profile.torque.echo
    if echo in ("demand", "actual") and (value_at(torque, echo) is None or f"torque.{echo}" in lacked):
        echo = made.torque.echo
    position = profile.position
    if position is not None and eds.find(position.actual.object, position.actual.subindex) is None:
        position = None
    elif position is not None and made.position is not None and number_of(eds, 0x60A8):
        position = made.position  # in the unit that the drive tells
    own = replace(
        profile,
        drive=replace(profile.drive, usable=made.drive.usable),
        torque=replace(
            torque, mode_of_operation=made.torque.mode_of_operation, echo=echo, slope=torque.slope or made.torque.slope
        ),
        position=position,
        velocity=profile.velocity or (made.velocity if position is None else None),
        pdo=replace(made.pdo, **{key: getattr(profile.pdo, key) for key in _KEPT}),
        sync=made.sync if profile.sync == SyncSection() else profile.sync,
        # The guard is that of the profile, else life guarding, else none.
        link_loss=replace(
            guard, life_guarding=guard.life_guarding or (_CONSUMER in lacked and made.link_loss.life_guarding)
        ),
    )
    for key in lacked:
        own = _without(own, key)
    return replace(own, sources={**profile.sources, **dict(_sources(own, made, lacked))})


def _lacked(profile: CanopenProfile, eds: Eds) -> dict[str, ObjectEntry]:
    """Return, by key, the objects of the profile that the drive does not have, or that no TPDO of it can carry."""
    found: dict[str, ObjectEntry] = {}
    for row in (BY_KEY[key] for key in ("torque.actual", "torque.demand", *_OPTIONAL)):
        named = row.named(profile)
        entry = None if named is None else eds.find(named.object, named.subindex)
        has = entry is not None and (row.use is not Use.SENT or carries(eds, Direction.TPDO, entry))
        if named is not None and not has:
            found[row.key] = named
    return found


def _without(table: Any, key: str) -> Any:
    """Return a profile, or a table of it, without the value at a key."""
    name, _, rest = key.partition(".")
    return replace(table, **{name: _without(getattr(table, name), rest) if rest else None})


def _sources(own: CanopenProfile, made: CanopenProfile, lacked: Mapping[str, ObjectEntry]) -> Iterator[tuple[str, str]]:
    """Yield key and source of each value that the drive has told, with the reason of each that is left out."""
    if not own.drive.usable:
        yield "drive.usable", made.sources["drive.usable"]
    for key, entry in lacked.items():
        # The sub-index of a signal is that of its axis, and is not told.
        yield key, f"{NO_SUCH}{ObjectEntry(entry.object, DataType.UINT8, BY_KEY[key].subindex)}"
    told = {key: made.sources[key] for key in _TOLD if key in made.sources}
    yield from ((key, source) for key, source in told.items() if not source.startswith(LEFT_OUT))


# The part of a drive's object dictionary that a profile of no particular drive depends on, as the drive tells it.
#
# An upload shows whether an object is there, its size and its value, but neither its access type nor whether a PDO may
# carry it. These are taken from CiA 301 and CiA 402-2; a drive that has them otherwise refuses the write or the
# mapping, and is refused itself, before there is torque.
#
# One sign shows that a mapping is fixed: the record has no entry beyond those that it uses. Where PDOs like this carry
# all that force needs, in both directions, they are used as they are (decision 0041).

Upload = Callable[[int, int], bytes | None]
"""Function that uploads an index and sub-index; None: it does not exist, empty: it cannot be read."""
SOURCE = "the drive"
_NUMBERS = {own: type for type in EdsType if (own := data_type(EdsEntry(0, 0, "", type, "ro"))) is not None}
"""Type of profiles → the same type of an EDS."""
_GAP = 8
"""PDOs that are missing in a row before the search for more ends; some drives have only every other one."""


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
    for own in (*profile.entries().values(), *(BY_KEY[key].named(profile) for key in _OPTIONAL)):
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
