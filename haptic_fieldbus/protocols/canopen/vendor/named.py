"""The objects that a profile names, beside the file: type, access, mappability, limits of what is written."""

from collections.abc import Iterator, Mapping
from enum import Enum

from haptic_fieldbus.drive.cia402 import MappedObject, WrittenObject
from haptic_fieldbus.drive.objects import DataType, ObjectEntry
from haptic_fieldbus.drive.units import PERMILLE, PERMILLE_OF_CURRENT
from haptic_fieldbus.eds import Eds, EdsEntry
from haptic_fieldbus.numerals import exactly
from haptic_fieldbus.protocols.canopen.pdo import Direction
from haptic_fieldbus.protocols.canopen.profile import CanopenProfile
from haptic_fieldbus.protocols.canopen.vendor.findings import Finding
from haptic_fieldbus.protocols.canopen.vendor.pdos import carries
from haptic_fieldbus.protocols.canopen.vendor.values import (
    READABLE,
    RECEIVED,
    SENT,
    WRITABLE,
    data_type,
    is_mappable,
    number_of,
    position_unit,
    velocity_unit,
)


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
