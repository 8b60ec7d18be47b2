"""Proof of a profile against the EDS of its drive: objects, types, access, mappability, limits, defaults, identity.

Each value of the profile that a file can show is looked up. What agrees is listed with its line, and what does not is a
fault with key, expected value and line. A profile may differ from its file on purpose: the source of a value begins
with "against the file" then, that of a key which is not there with "left out", and `simulation.differs` gives the
reason for an object of the simulated drive. Such differences are listed, and are no faults.

What no EDS shows is not looked at: units of torque, times, the best echo, values that are chosen.
"""

import re
import unicodedata
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

from haptic_fieldbus.drive.cia402 import MappedObject, WrittenObject
from haptic_fieldbus.drive.objects import DataType, ObjectEntry
from haptic_fieldbus.drive.rig import PERMILLE, PERMILLE_OF_CURRENT
from haptic_fieldbus.eds import Eds, EdsEntry
from haptic_fieldbus.errors import Fault
from haptic_fieldbus.numerals import exactly
from haptic_fieldbus.protocols.canopen.eds_pdos import (
    COMMUNICATION,
    MAPPING,
    carries,
    default_types,
    fixed_pdos,
    inhibit_time,
    pdo_room,
    type_limits,
)
from haptic_fieldbus.protocols.canopen.eds_sources import AGAINST, LEFT_OUT
from haptic_fieldbus.protocols.canopen.eds_values import (
    READABLE,
    RECEIVED,
    SENT,
    WRITABLE,
    Finding,
    data_type,
    identity,
    is_mappable,
    number_of,
    position_unit,
    supported_modes,
    velocity_unit,
)
from haptic_fieldbus.protocols.canopen.pdo import Direction
from haptic_fieldbus.protocols.canopen.profile import CanopenProfile, ShownObject

# What a file offers and a profile does not use, although the loop would be safer or better with it.


def left_out(profile: CanopenProfile, eds: Eds) -> Iterator[Finding]:
    """Yield a fault for each key that the profile leaves out and that the file has an object for."""
    torque, link_loss, sync = profile.torque, profile.link_loss, profile.sync
    # A drive that takes a current shows the current actual value, if it does not show a torque.
    is_torque = torque.target.unit == PERMILLE or _offers(eds, 0x6077, 0, SENT)
    for key, given, index, subindex, access in (
        ("torque.actual", torque.actual, 0x6077 if is_torque else 0x6078, 0, SENT),
        ("torque.demand", torque.demand, 0x6074, 0, SENT),
        ("torque.rated", torque.rated or torque.rated_current, 0x6076, 0, READABLE),
        ("link_loss.heartbeat_consumer", link_loss.heartbeat_consumer, 0x1016, 1, WRITABLE),
        ("link_loss.abort_connection_option", link_loss.abort_connection_option, 0x6007, 0, WRITABLE),
        ("link_loss.fault_reaction_option", link_loss.fault_reaction_option, 0x605E, 0, WRITABLE),
        ("sync.interpolation_time", sync.interpolation_time, 0x60C2, 1, WRITABLE),
        ("sync.cycle_period", sync.cycle_period, 0x1006, 0, WRITABLE),
    ):
        if given is None and _offers(eds, index, subindex, access):
            yield _unused(key, index, subindex, eds)
    guards = _offers(eds, 0x100C, 0, WRITABLE) and _offers(eds, 0x100D, 0, WRITABLE)
    if guards and not link_loss.life_guarding and not _offers(eds, 0x1016, 1, WRITABLE):
        yield _unused("link_loss.life_guarding", 0x100C, 0, eds)
    if torque.echo == "none" and (torque.demand or torque.actual):
        yield Finding("torque.echo", "", fault="none, although a torque is named in which it comes back",
                      is_left_out=True)  # fmt: skip


def _offers(eds: Eds, index: int, subindex: int, access: tuple[str, ...]) -> bool:
    entry = eds.find(index, subindex)
    if entry is None:
        return False
    return carries(eds, Direction.TPDO, entry) if access is SENT else entry.access in access


def _unused(key: str, index: int, subindex: int, eds: Eds) -> Finding:
    fault = f"left out, although the file has {index:04X}h:{subindex:02X}; expected it, or its reason in [sources]"
    return Finding(key, "", eds.objects[index].line, fault, index, subindex, is_left_out=True)


# The objects that a profile names, beside the file: type, access, mappability, limits of what is written.


class Use(Enum):
    """What the master does with an object; the value says it in words."""

    READ = "read by SDO"
    WRITTEN = "written by SDO"
    RECEIVED = "received in a PDO"
    SENT = "sent in a PDO"


_ACCESS = {Use.READ: READABLE, Use.WRITTEN: WRITABLE, Use.RECEIVED: RECEIVED, Use.SENT: SENT}
_DIRECTIONS = {Use.RECEIVED: Direction.RPDO, Use.SENT: Direction.TPDO}
_STANDARD: Mapping[str, tuple[int, ...]] = {
    "torque.target": (0x6071,),
    "torque.actual": (0x6077,),
    "torque.demand": (0x6074,),
    "torque.rated": (0x6076,),
    "torque.rated_current": (0x6075,),
    "torque.slope": (0x6087,),
    "position.actual": (0x6064,),
    "velocity.actual": (0x606C,),
    "link_loss.abort_connection_option": (0x6007,),
    "link_loss.fault_reaction_option": (0x605E,),
    "link_loss.heartbeat_consumer": (0x1016,),
    "sync.interpolation_time": (0x60C2,),
    "sync.cycle_period": (0x1006,),
}
"""Objects of the standards for each key; in the area of a standard no other object has that meaning."""
_CURRENT_ACTUAL = 0x6078
_MANUFACTURER = range(0x2000, 0x6000)


def named_objects(profile: CanopenProfile, eds: Eds) -> Iterator[Finding]:
    """Yield what the file shows of each object that the profile names."""
    yield from _signals(profile, eds)
    yield from _options(profile, eds)
    yield from _period(profile, eds)
    for written in profile.setup.writes:
        yield from _written("setup.writes", written, eds)


def _signals(profile: CanopenProfile, eds: Eds) -> Iterator[Finding]:
    torque, position, velocity = profile.torque, profile.position, profile.velocity
    signals: tuple[tuple[str, MappedObject | None, Use], ...] = (
        ("torque.target", torque.target, Use.RECEIVED),
        ("torque.actual", torque.actual, Use.SENT),
        ("torque.demand", torque.demand, Use.SENT),
        ("torque.rated", torque.rated, Use.READ),
        ("torque.rated_current", torque.rated_current, Use.READ),
        ("position.actual", position.actual if position else None, Use.SENT),
        ("velocity.actual", velocity.actual if velocity else None, Use.SENT),
    )
    for key, mapped, use in signals:
        if mapped is None:
            continue
        yield from _standard(key, mapped.object, mapped.unit)
        yield finding_of(key, mapped.entry, use, eds)
    if position is not None and number_of(eds, 0x60A8):
        yield _unit("position.actual.unit", position.actual.unit, position_unit(eds), 0x60A8, eds)
    if velocity is not None and 0x60A9 in eds:
        yield _unit("velocity.actual.unit", velocity.actual.unit, velocity_unit(eds), 0x60A9, eds)
    if torque.echo == "asked":
        yield finding_of("torque.echo", torque.target.entry, Use.READ, eds)
    if torque.slope is not None:
        yield from _standard("torque.slope", torque.slope.object)
        yield from _written("torque.slope", torque.slope, eds)


def _options(profile: CanopenProfile, eds: Eds) -> Iterator[Finding]:
    """Yield the guard of the drive and its reactions."""
    section = profile.link_loss
    for name in ("abort_connection_option", "fault_reaction_option"):
        option = getattr(section, name)
        if option is not None:
            yield from _standard(f"link_loss.{name}", option.object)
            yield from _written(f"link_loss.{name}", WrittenObject(option.object, DataType.INT16, option.value), eds)
    if section.heartbeat_consumer is not None:
        yield from _standard("link_loss.heartbeat_consumer", section.heartbeat_consumer)
        consumer = ObjectEntry(section.heartbeat_consumer, DataType.UINT32, 1)
        yield finding_of("link_loss.heartbeat_consumer", consumer, Use.WRITTEN, eds)
    if section.life_guarding:
        for index, type in ((0x100C, DataType.UINT16), (0x100D, DataType.UINT8)):
            yield finding_of("link_loss.life_guarding", ObjectEntry(index, type), Use.WRITTEN, eds)


def _period(profile: CanopenProfile, eds: Eds) -> Iterator[Finding]:
    """Yield the objects that tell the drive the period, with the range of their values."""
    sync = profile.sync
    if sync.interpolation_time is not None:
        yield from _standard("sync.interpolation_time", sync.interpolation_time)
        for subindex, type, key, values in (
            (1, DataType.UINT8, "sync.values", sync.values),
            (2, DataType.INT8, "sync.powers", sync.powers),
        ):
            entry = ObjectEntry(sync.interpolation_time, type, subindex)
            yield finding_of("sync.interpolation_time", entry, Use.WRITTEN, eds)
            for value in values:
                yield from _in_limits(key, entry, value, eds)
        power = number_of(eds, sync.interpolation_time, 2)
        if power is not None and power not in sync.powers:
            fault = f"without {power}, which {sync.interpolation_time:04X}h:02 has after power-on"
            yield Finding("sync.powers", "", eds.objects[sync.interpolation_time].line, fault)
    if sync.cycle_period is not None:
        yield from _standard("sync.cycle_period", sync.cycle_period)
        yield finding_of("sync.cycle_period", ObjectEntry(sync.cycle_period, DataType.UINT32), Use.WRITTEN, eds)


def _standard(key: str, index: int, unit: str = "") -> Iterator[Finding]:
    """Yield a fault for an object of a standard that means something else."""
    expected = _STANDARD[key]
    if key == "torque.actual" and unit not in (PERMILLE, PERMILLE_OF_CURRENT, ""):
        expected = (*expected, _CURRENT_ACTUAL)
    # The objects of a second axis on one node are 800h further on.
    if index in _MANUFACTURER or any((index - each) % 0x800 == 0 and index >= each for each in expected):
        return
    named = " or ".join(str(ObjectEntry(each, DataType.UINT32)).replace(":00", "") for each in expected)
    yield Finding(key, "", fault=f"{ObjectEntry(index, DataType.UINT32)} has another meaning; expected {named}, or an "
                  "object of the manufacturer (2000h to 5FFFh)", index=index)  # fmt: skip


def finding_of(key: str, entry: ObjectEntry, use: Use, eds: Eds) -> Finding:
    """Return what the file shows of an object that the master uses in one way."""
    found = eds.find(entry.object, entry.subindex)
    where = f"{entry.object:04X}h:{entry.subindex:02X}"
    if found is None:
        other = f"; it has {entry.object:04X}h without that sub-index" if entry.object in eds else ""
        line = eds.objects[entry.object].line if entry.object in eds else None
        return Finding(key, "", line, f"{where} is not in the file{other}", entry.object, entry.subindex)
    fault = _fault(where, entry, found, use, eds)
    return Finding(key, _shown(where, found), found.line, fault, entry.object, entry.subindex)


def _fault(where: str, entry: ObjectEntry, found: EdsEntry, use: Use, eds: Eds) -> str:
    if data_type(found) is not entry.type:
        type = found.type.name if found.type is not None else "a type that only the drive knows"
        return f'{where} is {type}, the profile says "{entry.type.value}"'
    if found.access not in _ACCESS[use]:
        return f"{where} cannot be {use.value}: its AccessType is {found.access}, expected {' or '.join(_ACCESS[use])}"
    if use in _DIRECTIONS and not is_mappable(found, _ACCESS[use]) and not carries(eds, _DIRECTIONS[use], found):
        return f"{where} cannot be {use.value}: its PDOMapping is 0, expected 1"
    return ""


def _shown(where: str, found: EdsEntry) -> str:
    type = found.type.name if found.type is not None else "of an unknown type"
    return f"{where} {type} {found.access}{', mappable' if found.mappable else ''}"


def _written(key: str, written: WrittenObject, eds: Eds) -> Iterator[Finding]:
    """Yield what the file shows of an object that gets a value; a constant that has it already is right."""
    entry, found = written.entry, eds.find(written.object, written.subindex)
    holds = found is not None and found.value(1) == written.value
    yield finding_of(key, entry, Use.READ if holds else Use.WRITTEN, eds)
    yield from _in_limits(key, entry, written.value, eds)


def _in_limits(key: str, entry: ObjectEntry, value: int, eds: Eds) -> Iterator[Finding]:
    found = eds.find(entry.object, entry.subindex)
    low, high = (found.low, found.high) if found is not None else (None, None)
    if found is None or low is None or high is None or not low < high:
        return  # limits without room are a slip of the file
    where = f"{entry.object:04X}h:{entry.subindex:02X}"
    fault = "" if low <= value <= high else f"{value}; {where} takes {exactly(low)} to {exactly(high)}"
    yield Finding(
        key, f"{where} takes {exactly(low)} to {exactly(high)}", found.line, fault, entry.object, entry.subindex
    )


def _unit(key: str, unit: str, shown: str | None, index: int, eds: Eds) -> Finding:
    code = (number_of(eds, index) or 0) & 0xFFFF_FFFF
    words = f"[{index:04X}] DefaultValue {code:08X}h"
    expected = f'"{shown}"' if shown else "another unit"
    fault = "" if unit == shown else f'"{unit}"; expected {expected} by {words}'
    return Finding(key, words, eds.objects[index].line, fault, index)


# The mode of operation of a profile, and the objects that every drive of CiA 402 needs, beside the file.

TORQUE_MODES = (4, 10)
"""Modes of CiA 402-2 with a target torque: profile torque, cyclic synchronous torque."""
MODE_KEY = "torque.mode_of_operation"
_MANUFACTURER_BITS = 0xFFFF_0000
"""Bits of 6502h for modes of the manufacturer, which are negative."""
_AUTOMATON = (
    (0x6040, DataType.UINT16, Use.RECEIVED),
    (0x6041, DataType.UINT16, Use.SENT),
    (0x6060, DataType.INT8, Use.WRITTEN),
    (0x6061, DataType.INT8, Use.READ),
)


def mode_findings(profile: CanopenProfile, eds: Eds) -> Iterator[Finding]:
    """Yield what the file shows of the mode, and of the objects by which it is set and confirmed."""
    for index, type, use in _AUTOMATON:
        yield finding_of("drive.usable", ObjectEntry(index, type), use, eds)
    mode = profile.torque.mode_of_operation
    if mode > 0 and mode not in TORQUE_MODES:
        yield Finding(MODE_KEY, "", fault=f"{mode} is no torque mode of CiA 402-2; expected 4 (profile torque), "
                      "10 (cyclic) or a negative one of the manufacturer")  # fmt: skip
    yield _within_limits(mode, eds)
    yield from _supported(mode, eds)


def _within_limits(mode: int, eds: Eds) -> Finding:
    entry = eds.find(0x6060)
    low, high = (entry.low, entry.high) if entry is not None else (None, None)
    outside = (low is not None and mode < low) or (high is not None and mode > high)
    line = entry.line if entry is not None else None
    if low is None and high is None:
        return Finding(MODE_KEY, "[6060] sets no limit to it", line)
    takes = f"[6060] takes {low} to {high}"
    return Finding(MODE_KEY, takes, line, f"{mode}; {takes}" if outside else "", 0x6060)


def _supported(mode: int, eds: Eds) -> Iterator[Finding]:
    """Yield whether 6502h names the mode, if the file gives its value."""
    modes, entry = supported_modes(eds), eds.find(0x6502)
    if not modes or entry is None:
        return
    named = modes & _MANUFACTURER_BITS if mode < 0 else modes >> mode - 1 & 1 if mode else 0
    shows = f"[6502] DefaultValue {modes:X}h"
    fault = "" if named else f"{mode}, which 6502h = {modes:X}h does not name; expected one that it names"
    yield Finding(MODE_KEY, shows, entry.line, fault, 0x6502)


# Identity and PDOs of a profile beside the file.


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


# The values that only a vendor's tool sets, beside the file: each is shown under a name, which the file has too.

SHOWN_KEY = "commissioning.shown"
_SMALL_WORDS = {"of", "the", "a", "an", "in", "for"}
_EXPLANATION = re.compile(r"\([^)]*\)")


def shown_findings(profile: CanopenProfile, eds: Eds) -> Iterator[Finding]:
    """Yield what the file has of each value; an object that stands twice is a slip of copying."""
    shown = profile.commissioning.shown
    places = [(each.object, each.subindex) for each in shown]
    for each, place in zip(shown, places, strict=True):
        yield finding_of(SHOWN_KEY, each.entry, Use.READ, eds)
        found = eds.find(*place)
        if found is not None and found.name:
            yield _named(each, found)
        if places.count(place) > 1:
            yield Finding(SHOWN_KEY, "", fault=f"{each.object:04X}h:{each.subindex:02X} stands twice; expected it once")


def _named(shown: ShownObject, found: EdsEntry) -> Finding:
    """Return a fault where the name of the profile has a word that the file's name of the object does not have."""
    said = f'{shown.object:04X}h:{shown.subindex:02X} is "{found.name}"'
    other = _words(_EXPLANATION.sub(" ", shown.name)) - _words(found.name)
    fault = f'"{shown.name}"; {said}. What the file does not say stands in parentheses' if other else ""
    return Finding(f"{SHOWN_KEY}.name", said, found.line, fault, shown.object, shown.subindex)


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
    """What a file shows of a profile."""

    source: str
    """The vendor's file, in which the lines of the faults are."""
    agreed: tuple[Finding, ...]
    faults: tuple[Fault, ...]
    known: tuple[KnownDifference, ...]


def compare(profile: CanopenProfile, eds: Eds, more: tuple[Finding, ...] = ()) -> Comparison:
    """Return what the file shows of the profile; `more` are findings of other readers of both."""
    findings = [*_findings(profile, eds), *more]
    faults = [(finding, finding.as_fault(), _reason(profile, finding)) for finding in findings if finding.fault]
    return Comparison(
        Path(eds.source).name,
        tuple(finding for finding in findings if not finding.fault),
        tuple(fault for _, fault, reason in faults if not reason),
        tuple(KnownDifference(fault, reason) for _, fault, reason in faults if reason),
    )


def _findings(profile: CanopenProfile, eds: Eds) -> Iterator[Finding]:
    yield from identity_findings(profile, eds)
    if profile.drive.usable:
        yield from mode_findings(profile, eds)
        yield from named_objects(profile, eds)
        yield from shown_findings(profile, eds)
        yield from left_out(profile, eds)
    yield from pdo_findings(profile, eds)


def _reason(profile: CanopenProfile, finding: Finding) -> str:
    """Return the reason that the profile gives for a difference; empty when it gives none."""
    source = profile.sources.get(finding.key, "")
    if source.startswith(LEFT_OUT if finding.is_left_out else AGAINST):
        return source
    if not finding.key.startswith("simulation") or finding.index is None:
        return ""
    differs = profile.simulation.differs.items()
    return next((reason for place, reason in differs if _covers(place, finding.index, finding.subindex)), "")


def _covers(place: str, index: int, subindex: int) -> bool:
    """Return whether a key such as "6007", "1400-1403" or "1016:01-02" names the entry; all numbers are hexadecimal."""
    indices, _, subindices = place.partition(":")
    return index in _range(indices) and (not subindices or subindex in _range(subindices))


def _range(text: str) -> range:
    first, _, last = text.partition("-")
    return range(int(first, 16), int(last or first, 16) + 1)
