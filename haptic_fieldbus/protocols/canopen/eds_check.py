"""Proof of a profile against the EDS of its drive: objects, types, access, mappability, limits, defaults, identity.

Each value of the profile that a file can show is looked up. What agrees is listed with its line, and what does not is a
fault with key, expected value and line. A profile may differ from its file on purpose: the source of a value begins
with "against the file" then, that of a key which is not there with "left out", and `simulation.differs` gives the
reason for an object of the simulated drive. Such differences are listed, and are no faults.

What no EDS shows is not looked at: units of torque, times, the best echo, values that are chosen.
"""

import re
import unicodedata
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from haptic_fieldbus.documents.expected import listed
from haptic_fieldbus.drive.cia402 import OptionCode, WrittenObject
from haptic_fieldbus.drive.profile import ObjectEntry
from haptic_fieldbus.drive.rig import PERMILLE, PERMILLE_OF_CURRENT
from haptic_fieldbus.eds import Eds, EdsEntry
from haptic_fieldbus.errors import Fault
from haptic_fieldbus.numerals import exactly
from haptic_fieldbus.protocols.canopen import eds_pdos, eds_values
from haptic_fieldbus.protocols.canopen.eds_pdos import COMMUNICATION, MAPPING, carries, fixed_pdos, pdo_room
from haptic_fieldbus.protocols.canopen.eds_values import BY_KEY, OBJECTS, USABLE, Finding, StandardObject, Use, value_at
from haptic_fieldbus.protocols.canopen.from_eds import AGAINST, LEFT_OUT
from haptic_fieldbus.protocols.canopen.pdo import Direction
from haptic_fieldbus.protocols.canopen.profile import CanopenProfile


def _line(eds: Eds, index: int) -> int | None:
    return eds.objects[index].line if index in eds else None


# What a file offers and a profile does not use, although the loop would be safer or better with it.


def left_out(profile: CanopenProfile, eds: Eds) -> Iterator[Finding]:
    """Yield a fault for each key that the profile leaves out and that the file has an object for."""
    torque, link_loss = profile.torque, profile.link_loss
    for row in OBJECTS:
        is_given = value_at(profile, row.key) is not None or (row.key == "torque.rated" and torque.rated_current)
        if row.is_offered and not is_given:
            yield from _unused(row, profile, eds)
    guards = [row for row in OBJECTS if row.key == "link_loss.life_guarding"]
    has_consumer = _offers(eds, BY_KEY["link_loss.heartbeat_consumer"])
    if not link_loss.life_guarding and not has_consumer and all(_offers(eds, row) for row in guards):
        yield from _unused(guards[0], profile, eds)
    if torque.echo == "none" and (torque.demand or torque.actual):
        yield Finding("torque.echo", "", fault='"none", although the drive has an object that returns the torque',
                      is_left_out=True)  # fmt: skip


def _unused(row: StandardObject, profile: CanopenProfile, eds: Eds) -> Iterator[Finding]:
    if row.of_current is not None and profile.torque.target.unit != PERMILLE and not _offers(eds, row):
        # A drive that takes a current shows the current actual value, if it does not show a torque.
        row = replace(row, index=row.of_current)
    if _offers(eds, row):
        fault = f"missing, although the file has {row.entry.place}; expected it, or a reason in [sources]"
        yield Finding(row.key, "", _line(eds, row.index), fault, is_left_out=True)


def _offers(eds: Eds, row: StandardObject) -> bool:
    entry = row.found(eds)
    return carries(eds, Direction.TPDO, entry) if entry and row.use is Use.SENT else row.use.permits(entry)


# The objects that a profile names, beside the file: type, access, mappability, limits of what is written.

_MANUFACTURER = range(0x2000, 0x6000)


def named_objects(profile: CanopenProfile, eds: Eds) -> Iterator[Finding]:
    """Compare each object that the profile names with the file; objects to which a value is written come first."""
    for row in sorted(OBJECTS, key=lambda row: row.use is Use.WRITTEN and row.value is None):
        if row.key in _UNITS:
            yield from _unit(row, profile, eds)
        elif row.key != USABLE and (entry := row.named(profile)) is not None:
            yield from _standard(row, entry)
            yield from _used(row, entry, profile, eds)
    for written in profile.setup.writes:
        yield from _written("setup.writes", written.entry, written.value, eds)


def _used(row: StandardObject, entry: ObjectEntry, profile: CanopenProfile, eds: Eds) -> Iterator[Finding]:
    """Compare an object that the profile names, and the values written to it, with the file."""
    value = value_at(profile, row.key)
    if isinstance(value, OptionCode | WrittenObject):
        yield from _written(row.key, entry, value.value, eds)
        return
    yield finding_of(row.key, entry, row.use, eds)
    values = value_at(profile, row.values) if row.values else ()
    for each in values if isinstance(values, tuple) else ():
        yield from _in_limits(row.values, entry, each, eds)
    power = eds_values.number_of(eds, entry.object, entry.subindex) if row.values == "sync.powers" else None
    if power is not None and power not in profile.sync.powers:
        fault = f"without {power}, the value of {entry.place} after power-on"
        yield Finding(row.values, "", _line(eds, entry.object), fault)


def _standard(row: StandardObject, entry: ObjectEntry) -> Iterator[Finding]:
    """Yield a fault for an object of a standard that means something else than the key of the profile."""
    index, is_current = entry.object, entry.unit not in (PERMILLE, PERMILLE_OF_CURRENT, "")
    expected = [row.index, row.of_current] if row.of_current is not None and is_current else [row.index]
    is_right = index in _MANUFACTURER or index in expected
    if is_right or row is not BY_KEY[row.key] or row.key == "torque.echo":
        return
    shown = str(ObjectEntry(index, entry.type))
    named = " or ".join(str(ObjectEntry(each, entry.type)).replace(":00", "") for each in expected)
    fault = f"{shown} has another meaning; expected {named}, or a manufacturer object (2000h to 5FFFh)"
    yield Finding(row.key, "", fault=fault)


def finding_of(key: str, entry: ObjectEntry, use: Use, eds: Eds) -> Finding:
    """Return what the file shows of an object that the master uses in one way."""
    found, where = eds.find(entry.object, entry.subindex), entry.place
    if found is None:
        other = f"; it has {entry.object:04X}h without that sub-index" if entry.object in eds else ""
        return Finding(key, "", _line(eds, entry.object), f"{where} is not in the file{other}")
    type = found.type.name if found.type is not None else "of an unknown type"
    shows = f"{where} {type} {found.access}{', mappable' if found.mappable else ''}"
    return Finding(key, shows, found.line, _fault(where, entry, found, use, eds))


def _fault(where: str, entry: ObjectEntry, found: EdsEntry, use: Use, eds: Eds) -> str:
    if eds_values.data_type(found) is not entry.type:
        type = found.type.name if found.type is not None else "of a type that only the drive defines"
        return f'{where} is {type}, the profile says "{entry.type.value}"'
    if not use.permits(found):
        return f"{where} cannot be {use.words}: its AccessType is {found.access}, expected {' or '.join(use.access)}"
    way = use.direction
    if way is not None and not eds_pdos.is_mappable(found, way) and not carries(eds, way, found):
        return f"{where} cannot be {use.words}: its PDOMapping is 0, expected 1"
    return ""


def _written(key: str, entry: ObjectEntry, value: int, eds: Eds) -> Iterator[Finding]:
    """Yield what the file shows of an object that gets a value; a constant that has it already is right."""
    found = eds.find(entry.object, entry.subindex)
    holds = found is not None and found.value(1) == value
    yield finding_of(key, entry, Use.READ if holds else Use.WRITTEN, eds)
    yield from _in_limits(key, entry, value, eds)


def _in_limits(key: str, entry: ObjectEntry, value: int, eds: Eds) -> Iterator[Finding]:
    found = eds.find(entry.object, entry.subindex)
    if found is None or found.low is None or found.high is None or not found.low < found.high:
        return  # limits without room are a slip of the file
    takes = f"{entry.place} accepts {exactly(found.low)} to {exactly(found.high)}"
    yield Finding(key, takes, found.line, "" if found.low <= value <= found.high else f"{value}; {takes}")


_UNITS = {"position.actual.unit": eds_values.position_unit, "velocity.actual.unit": eds_values.velocity_unit}
"""Key of a unit → unit that the file gives."""


def _unit(row: StandardObject, profile: CanopenProfile, eds: Eds) -> Iterator[Finding]:
    unit, code, expected = value_at(profile, row.key), eds_values.number_of(eds, row.index), _UNITS[row.key](eds)
    # A position unit of 0 says nothing; without a value the velocity unit is that of the standard.
    is_told = code if row.key == "position.actual.unit" else row.index in eds
    if unit is None or not is_told:
        return
    words = f"[{row.index:04X}] DefaultValue {(code or 0) & 0xFFFF_FFFF:08X}h"
    named = f'"{expected}"' if expected else "another unit"
    fault = "" if unit == expected else f'"{unit}"; expected {named} by {words}'
    yield Finding(row.key, words, _line(eds, row.index), fault)


# The mode of operation of a profile, and the objects that every drive of CiA 402 needs, beside the file.

MODE_KEY = "torque.mode_of_operation"
_MANUFACTURER_BITS = 0xFFFF_0000
"""Bits of 6502h for modes of the manufacturer, which are negative."""


def mode_findings(profile: CanopenProfile, eds: Eds) -> Iterator[Finding]:
    """Yield what the file shows of the mode, and of the objects by which it is set and confirmed."""
    yield from (finding_of(USABLE, row.entry, row.use, eds) for row in OBJECTS if row.key == USABLE)
    mode = profile.torque.mode_of_operation
    if mode > 0 and mode not in eds_pdos.TORQUE_MODES:
        yield Finding(MODE_KEY, "", fault=f"{mode} is no torque mode of CiA 402-2; expected 4 (profile torque), "
                      "10 (cyclic) or a negative one of the manufacturer")  # fmt: skip
    entry = eds.find(0x6060)
    low, high, line = (entry.low, entry.high, entry.line) if entry is not None else (None, None, None)
    outside = (low is not None and mode < low) or (high is not None and mode > high)
    takes = "[6060] has no limit for it" if low is None and high is None else f"[6060] accepts {low} to {high}"
    yield Finding(MODE_KEY, takes, line, f"{mode}; {takes}" if outside else "")
    modes, entry = eds_values.supported_modes(eds), eds.find(0x6502)
    if modes and entry is not None:
        named = modes & _MANUFACTURER_BITS if mode < 0 else modes >> mode - 1 & 1 if mode else 0
        fault = "" if named else f"{mode}, which is not in 6502h = {modes:X}h; expected a mode of 6502h"
        yield Finding(MODE_KEY, f"[6502] DefaultValue {modes:X}h", entry.line, fault)


# Identity and PDOs of a profile beside the file.


def identity_findings(profile: CanopenProfile, eds: Eds) -> Iterator[Finding]:
    """Yield vendor-ID and product code; what the profile leaves out is not compared with the drive either."""
    section = profile.identity
    vendors = () if section.vendor_id is None else (section.vendor_id,)
    for subindex, name, own in ((1, "vendor_id", vendors), (2, "product_codes", section.product_codes)):
        shown = eds_values.identity(eds, subindex)
        if shown is None:
            continue
        words = f"1018h:{subindex:02X} or [DeviceInfo] is {shown:X}h"
        said = " or ".join(f"{each:X}h" for each in own) or "left out"
        fault = "" if shown in own else f"{said}; {words}"
        yield Finding(f"identity.{name}", words, _line(eds, 0x1018), fault, is_left_out=not own)


def pdo_findings(profile: CanopenProfile, eds: Eds) -> Iterator[Finding]:
    """Yield number, room, transmission types and inhibit time of the PDOs."""
    for direction in (Direction.TPDO, Direction.RPDO):
        yield _count(profile, eds, direction)
        yield from _rooms(profile, eds, direction)
        yield from _types(profile, eds, direction)
    own, shown = profile.pdo.inhibit_time_default, eds_pdos.inhibit_time(eds)
    fault = "" if abs(own - shown) < 1e-6 else f"{exactly(own)} s; the longest 1800h:03 is {exactly(shown)} s"
    shows = f"1800h:03 {exactly(shown)} s at most"
    yield Finding("pdo.inhibit_time_default", shows, _line(eds, 0x1800), fault)


def _count(profile: CanopenProfile, eds: Eds, direction: Direction) -> Finding:
    """Return the number of PDOs."""
    own, shown = profile.pdo.room(direction), pdo_room(eds, direction)
    missing = [str(number) for number, room in sorted(own.items()) if room and number not in shown]
    beyond, fault = [str(number) for number in sorted(shown.keys() - own.keys())], ""
    if missing:
        are = "is" if len(missing) == 1 else "are"
        fault = f"{len(own)}; {direction.value} {listed(missing, 'and')} {are} not in the file"
    elif beyond:
        fault = f"{len(own)}; the file also has {direction.value} {listed(beyond, 'and')}, which would stay active"
    line = _line(eds, COMMUNICATION[direction].start)
    return Finding(f"pdo.{direction.value.lower()}s", f"{len(shown)} {direction.value}s", line, fault)


def _rooms(profile: CanopenProfile, eds: Eds, direction: Direction) -> Iterator[Finding]:
    """Yield the number of entries of each PDO that the profile says it has, and the mappings that are fixed."""
    own, shown, name = profile.pdo.room(direction), pdo_room(eds, direction), direction.value.lower()
    first = COMMUNICATION[direction].start + MAPPING - 1
    listed = value_at(profile, f"pdo.{name}_entries")
    for number in sorted(own.keys() & shown.keys()):
        entries = f"{first + number:04X}h has {shown[number]} entries that can be written"
        fault = "" if own[number] == shown[number] else f"{own[number]}; {entries}"
        key = f"pdo.{name}_entries" if listed else "pdo.entries"
        yield Finding(key, entries, _line(eds, first + number), fault)
    held = {each.number: each.maps for each in fixed_pdos(eds, direction)}
    for each in profile.pdo.fixed(direction):
        found = held.get(each.number, ())
        maps = f"{first + each.number:04X}h maps {_hexadecimal(found)} and cannot be written"
        fault = "" if found == each.maps else f"{direction.value}{each.number} {_hexadecimal(each.maps)}; {maps}"
        yield Finding(f"pdo.{name}_fixed", maps, _line(eds, first + each.number), fault)


def _types(profile: CanopenProfile, eds: Eds, direction: Direction) -> Iterator[Finding]:
    """Yield the transmission types: types after power-on are permitted, types beyond a limit of the file are not."""
    own = profile.pdo.tpdo_types if direction is Direction.TPDO else profile.pdo.rpdo_types
    low, high = eds_pdos.type_limits(eds, direction)
    first, missing = COMMUNICATION[direction].start, sorted(eds_pdos.default_types(eds, direction) - set(own))
    faults = [f"{kind}; {first:04X}h:02 accepts {low} to {high}" for kind in own if not low <= kind <= high]
    faults += [f"without {kind}, the value of {first:04X}h:02 or a later one after power-on" for kind in missing]
    yield from (Finding(f"pdo.{direction.value.lower()}_types", "", _line(eds, first), fault) for fault in faults)


def _hexadecimal(values: tuple[int, ...]) -> str:
    return ", ".join(f"{value:08X}h" for value in values) or "nothing"


# The values that only a vendor's tool sets, beside the file: each is shown under a name, which the file has too.

SHOWN_KEY = "commissioning.shown"
_SMALL_WORDS = {"of", "the", "a", "an", "in", "for"}
_EXPLANATION = re.compile(r"\([^)]*\)")


def shown_findings(profile: CanopenProfile, eds: Eds) -> Iterator[Finding]:
    """Compare each shown value with the file; an object that is named twice is a fault."""
    places = [each.entry.place for each in profile.commissioning.shown]
    for each in profile.commissioning.shown:
        yield finding_of(SHOWN_KEY, each.entry, Use.READ, eds)
        found = eds.find(each.object, each.subindex)
        if found is not None and found.name:
            # Each word of the profile's name must be in the file's name of the object.
            said = f'{each.entry.place} is "{found.name}"'
            other = _words(_EXPLANATION.sub(" ", each.name)) - _words(found.name)
            fault = f'"{each.name}"; {said}. Put additions to the name of the file in parentheses' if other else ""
            yield Finding(f"{SHOWN_KEY}.name", said, found.line, fault)
        if places.count(each.entry.place) > 1:
            yield Finding(SHOWN_KEY, "", fault=f"{each.entry.place} appears twice; expected once")


def _words(text: str) -> set[str]:
    """Return the words of a name, each in its singular and without regard to case and superscripts."""
    plain = unicodedata.normalize("NFKC", text).casefold()
    return {word.removesuffix("s") for word in re.findall(r"[a-z0-9]+", plain)} - _SMALL_WORDS


@dataclass(frozen=True)
class KnownDifference:
    """A difference from the file that the profile explains."""

    fault: Fault
    reason: str


@dataclass(frozen=True)
class Comparison:
    """Comparison of a profile with its vendor's file."""

    source: str
    """The vendor's file, in which the lines of the faults are."""
    agreed: tuple[Finding, ...]
    faults: tuple[Fault, ...]
    known: tuple[KnownDifference, ...]


def compare(profile: CanopenProfile, eds: Eds, more: tuple[Finding, ...] = ()) -> Comparison:
    """Return what the file shows of the profile; `more` are findings of other readers of both."""
    findings = [*identity_findings(profile, eds)]
    if profile.drive.usable:
        for find in (mode_findings, named_objects, shown_findings, left_out):
            findings += find(profile, eds)
    findings += (*pdo_findings(profile, eds), *more)
    faults = [(Fault(each.key, each.fault, each.line), _reason(profile, each)) for each in findings if each.fault]
    return Comparison(
        Path(eds.source).name,
        tuple(finding for finding in findings if not finding.fault),
        tuple(fault for fault, reason in faults if not reason),
        tuple(KnownDifference(fault, reason) for fault, reason in faults if reason),
    )


def _reason(profile: CanopenProfile, finding: Finding) -> str:
    """Return the reason that the profile gives for a difference; empty when it gives none."""
    source = profile.sources.get(finding.key, "")
    if source.startswith(LEFT_OUT if finding.is_left_out else AGAINST):
        return source
    differs = profile.simulation.differs if finding.key.startswith("simulation") else {}
    return next((reason for place, reason in differs.items() if _covers(place, finding)), "")


def _covers(place: str, finding: Finding) -> bool:
    """Return whether a key such as "6007", "1400-1403" or "1016:01-02" names the object; numbers are hexadecimal."""
    indices, _, subindices = place.partition(":")
    return finding.index in _range(indices) and (not subindices or finding.subindex in _range(subindices))


def _range(text: str) -> range:
    first, _, last = text.partition("-")
    return range(int(first, 16), int(last or first, 16) + 1)
