"""Identity and PDOs of a profile beside the file."""

from collections.abc import Iterator

from haptic_fieldbus.eds import Eds
from haptic_fieldbus.numerals import exactly
from haptic_fieldbus.protocols.canopen.pdo import Direction
from haptic_fieldbus.protocols.canopen.profile import CanopenProfile
from haptic_fieldbus.protocols.canopen.vendor.findings import Finding
from haptic_fieldbus.protocols.canopen.vendor.pdos import (
    COMMUNICATION,
    MAPPING,
    default_types,
    fixed_pdos,
    inhibit_time,
    pdo_room,
    type_limits,
)
from haptic_fieldbus.protocols.canopen.vendor.values import identity


def identity_findings(profile: CanopenProfile, eds: Eds) -> Iterator[Finding]:
    """Yield vendor-ID and product code; what the profile leaves out is not compared with the drive either."""
    section = profile.identity
    line = eds.objects[0x1018].line if 0x1018 in eds else None
    vendors = () if section.vendor_id is None else (section.vendor_id,)
    for subindex, key, own in ((1, "vendor_id", vendors), (2, "product_codes", section.product_codes)):
        shown, key = identity(eds, subindex), f"identity.{key}"
        if shown is None:
            continue
        words = f"1018h:{subindex:02X} or [DeviceInfo] is {shown:X}h"
        if not own:
            yield Finding(key, "", line, f"left out; {words}", 0x1018, subindex, is_left_out=True)
            continue
        said = " or ".join(f"{each:X}h" for each in own)
        yield Finding(key, words, line, "" if shown in own else f"{said}; {words}", 0x1018, subindex)


def pdo_findings(profile: CanopenProfile, eds: Eds) -> Iterator[Finding]:
    """Yield number, room, transmission types and inhibit time of the PDOs."""
    for direction, name in ((Direction.TPDO, "tpdo"), (Direction.RPDO, "rpdo")):
        yield from _rooms(profile, eds, direction, name)
        yield from _types(profile, eds, direction, name)
    own, shown = profile.pdo.inhibit_time_default, inhibit_time(eds)
    fault = "" if abs(own - shown) < 1e-6 else f"{exactly(own)} s; the longest 1800h:03 is {exactly(shown)} s"
    yield Finding(
        "pdo.inhibit_time_default", f"1800h:03 {exactly(shown)} s at most", _line(eds, 0x1800), fault, 0x1800, 3
    )


def _rooms(profile: CanopenProfile, eds: Eds, direction: Direction, name: str) -> Iterator[Finding]:
    """Yield the number of PDOs, and of each that the profile says it has the number of its entries."""
    own, shown = profile.pdo.room(direction), pdo_room(eds, direction)
    first = COMMUNICATION[direction].start
    missing = sorted(number for number, room in own.items() if room and number not in shown)
    beyond = sorted(shown.keys() - own.keys())
    are = "is" if len(missing) == 1 else "are"
    fault = f"{direction.value} {_numbers(missing)} {are} not in the file" if missing else ""
    if beyond and not fault:
        fault = f"the file has {direction.value} {_numbers(beyond)} too, which would stay switched on"
    said = f"{len(shown)} {direction.value}s"
    yield Finding(f"pdo.{name}s", said, _line(eds, first), f"{len(own)}; {fault}" if fault else "", first)
    listed = profile.pdo.tpdo_entries if direction is Direction.TPDO else profile.pdo.rpdo_entries
    key = f"pdo.{name}_entries" if listed else "pdo.entries"
    for number in sorted(own.keys() & shown.keys()):
        index = first + MAPPING + number - 1
        entries = f"{index:04X}h has {shown[number]} entries that can be written"
        wrong = "" if own[number] == shown[number] else f"{own[number]}; {entries}"
        yield Finding(key, entries, _line(eds, index), wrong, index)
    held = {each.number: each.maps for each in fixed_pdos(eds, direction)}
    for each in profile.pdo.fixed(direction):
        index, found = first + MAPPING + each.number - 1, held.get(each.number, ())
        maps = f"{index:04X}h maps {_hexadecimal(found)} and cannot be written"
        wrong = "" if found == each.maps else f"{direction.value}{each.number} {_hexadecimal(each.maps)}; {maps}"
        yield Finding(f"pdo.{name}_fixed", maps, _line(eds, index), wrong, index)


def _types(profile: CanopenProfile, eds: Eds, direction: Direction, name: str) -> Iterator[Finding]:
    """Yield the transmission types: those after power-on are taken, those beyond a limit of the file are not."""
    own = profile.pdo.tpdo_types if direction is Direction.TPDO else profile.pdo.rpdo_types
    low, high = type_limits(eds, direction)
    first, key = COMMUNICATION[direction].start, f"pdo.{name}_types"
    for kind in own:
        if not low <= kind <= high:
            yield Finding(key, "", _line(eds, first), f"{kind}; {first:04X}h:02 takes {low} to {high}", first, 2)
    for kind in sorted(default_types(eds, direction) - set(own)):
        fault = f"without {kind}, which {first:04X}h:02 or a later one has after power-on"
        yield Finding(key, "", _line(eds, first), fault, first, 2)


def _hexadecimal(values: tuple[int, ...]) -> str:
    return ", ".join(f"{value:08X}h" for value in values) or "nothing"


def _numbers(numbers: list[int]) -> str:
    *first, last = map(str, numbers)
    return f"{', '.join(first)} and {last}" if first else last


def _line(eds: Eds, index: int) -> int | None:
    return eds.objects[index].line if index in eds else None
