"""Conversion of an EDS or DCF to a drive profile, and its draft as a file; what the file of the vendor lacks is
completed by the standards and by named assumptions.

An EDS names objects, types and PDOs, but no units, times or reactions. Units are therefore those of CiA 402-2 (torque
in ‰ of rated torque, rated torque in mN·m); this is ASSUMED, and not every drive keeps to it. A file of no CiA 402
drive is refused. The profile of a drive that lacks what force needs is not usable for force, with a list of all that is
missing; such a drive can still be simulated.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field, fields, is_dataclass, replace
from enum import Enum
from pathlib import Path

from haptic_fieldbus.documents.edits import quoted, value_text
from haptic_fieldbus.drive import cia402
from haptic_fieldbus.drive.cia402 import MappedObject, OptionCode, TorqueSection, VelocitySection, WrittenObject
from haptic_fieldbus.drive.profile import ASSUMED, DriveSection, TimingSection
from haptic_fieldbus.drive.rig import COUNTS
from haptic_fieldbus.eds import Eds
from haptic_fieldbus.errors import EdsError, Fault
from haptic_fieldbus.numerals import exactly
from haptic_fieldbus.protocols.canopen import eds_pdos, eds_values
from haptic_fieldbus.protocols.canopen.eds_pdos import MAPPING, PROFILE_TORQUE, Lack, carries, records, torque_mode
from haptic_fieldbus.protocols.canopen.eds_values import BY_KEY, OBJECTS, STEEPEST, USABLE, Use, number_of, value_at
from haptic_fieldbus.protocols.canopen.pdo import Direction
from haptic_fieldbus.protocols.canopen.profile import (
    CanopenProfile,
    LinkLossSection,
    PdoSection,
    SetupSection,
    SyncSection,
)

POWERS = (-3, -4, -5, -6)
"""Powers of ten of the interpolation time period that are tried, the usual one first."""


@dataclass(frozen=True, kw_only=True)
class EdsProfile(CanopenProfile):
    """A profile made from an EDS, which it keeps so that the simulated drive can offer the same objects."""

    eds: Eds = field(default_factory=lambda: Eds({}))
    lacks: tuple[Lack, ...] = ()
    """Reasons for which the drive cannot render force."""

    def faults(self) -> list[Fault]:
        """Return the faults of the file, and what is missing for force."""
        return [*self.eds.faults, *(Fault("", f"not usable for force: {lack}", line) for lack, line in self.lacks)]


def profile_from_eds(eds: Eds, mode: int | None = None) -> EdsProfile:
    """Return the profile of an EDS; raises EdsError when it describes no CiA 402 drive.

    `mode` is the mode of operation; None: a torque mode of 6502h.
    """
    if faults := [Fault("", f"not a CiA 402 drive: {lack}", line) for lack, line in eds_pdos.automaton_lacks(eds)]:
        raise EdsError(eds.source, faults)
    velocity = _velocity(eds)
    lacks = tuple(eds_pdos.force_lacks(eds, mode, velocity))
    device, unit = eds.device, eds_values.position_unit(eds) or COUNTS
    vendor, product = eds_values.identity(eds, 1), eds_values.identity(eds, 2)
    profile = EdsProfile(
        schema=1,
        name=Path(eds.source).stem,
        source=eds.source,
        drive=DriveSection(
            vendor=device.vendor_name or "unknown vendor",
            model=device.product_name or Path(eds.source).stem or "unknown model",
            protocol="canopen",
            evidence="vendor-data",
            usable=not lacks,
        ),
        identity=cia402.IdentitySection(vendor, () if product is None else (product,)),
        torque=_torque(eds, mode or (torque_mode(eds) if BY_KEY["torque.target"].index in eds else 0)),
        # A drive without torque may have no position either; it is simulated with that of the standard.
        position=None if velocity else cia402.PositionSection(_standard("position.actual", unit)),
        velocity=velocity,
        pdo=eds_pdos.pdo_section(eds),
        setup=_setup(eds, velocity),
        sync=_sync(eds),
        link_loss=_link_loss(eds),
        # Usual figures for servo drives: an EDS has none. `sources_of` declares them as assumed.
        timing=TimingSection(torque_bandwidth=1000.0, control_period=0.0005),
        eds=eds,
        lacks=lacks,
    )
    return replace(profile, sources=sources_of(profile, eds, lacks))


def _standard(key: str, unit: str) -> MappedObject:
    """Return the object of a key as the standard has it."""
    entry = BY_KEY[key].entry
    return MappedObject(entry.object, entry.type, unit=unit)


def _mapped(eds: Eds, key: str) -> MappedObject | None:
    """Return the object of a key as a profile writes it; None for one that the file lacks or that cannot be used."""
    row = BY_KEY[key]
    entry = row.found(eds)
    if entry is None or (row.use is Use.SENT and not (entry.type in row.types and carries(eds, Direction.TPDO, entry))):
        return None
    type = eds_values.data_type(entry)  # None for a type that profiles do not have
    return None if type is None else MappedObject(row.index, type, unit=row.unit)


def _torque(eds: Eds, mode: int) -> TorqueSection:
    """Return the torque objects; a set-point comes back in a TPDO, else by asking for the target, else not at all."""
    actual, demand, target = _mapped(eds, "torque.actual"), _mapped(eds, "torque.demand"), BY_KEY["torque.target"]
    is_asked = Use.READ.permits(target.found(eds))
    return TorqueSection(
        mode,
        target=_mapped(eds, target.key) or _standard(target.key, target.unit),
        actual=actual,
        rated=_mapped(eds, "torque.rated"),
        demand=demand,
        echo="demand" if demand else "actual" if actual else "asked" if is_asked else "none",
        slope=_slope(eds) if mode == PROFILE_TORQUE else None,
    )


def _slope(eds: Eds) -> WrittenObject | None:
    """Return the steepest torque slope; None for a drive that has none to be written."""
    row = BY_KEY["torque.slope"]
    entry = row.found(eds)
    type = eds_values.data_type(entry) if entry is not None and row.is_usable(eds) else None
    if entry is None or type is None:
        return None
    return WrittenObject(row.index, type, min(_limit(entry.high, STEEPEST), type.limits[1], STEEPEST))


def _velocity(eds: Eds) -> VelocitySection | None:
    """Return the velocity section, for a drive with 606Ch and without 6064h; None when its unit is unknown."""
    unit, actual = eds_values.velocity_unit(eds), _mapped(eds, "velocity.actual")
    if BY_KEY["position.actual"].index in eds or actual is None or unit is None:
        return None
    return VelocitySection(replace(actual, unit=unit))


def _setup(eds: Eds, velocity: VelocitySection | None) -> SetupSection:
    """Return the write of the object that names the unit of position or velocity; none for one that is fixed.

    Such an object can be stored with another value than that of the file: the drive would be scaled wrong.
    """
    row = BY_KEY["position.actual.unit" if velocity is None else "velocity.actual.unit"]
    entry, code = row.found(eds), (number_of(eds, row.index) or 0) & 0xFFFF_FFFF
    type = eds_values.data_type(entry) if entry is not None else None
    is_told = code in (eds_values.POSITION_UNIT_CODES if velocity is None else eds_values.VELOCITY_UNIT_CODES)
    changes = Use.READ.permits(entry) and Use.WRITTEN.permits(entry)
    if type is None or type.size != 4 or not (code and is_told and changes):
        return SetupSection()
    return SetupSection((WrittenObject(row.index, type, code if code <= type.limits[1] else code - (1 << 32)),))


def _link_loss(eds: Eds) -> LinkLossSection:
    """Return the guard of the file, 1016h or else 100Ch with 100Dh, and the options that it has.

    The values of the options free the shaft (CiA 402-2).
    """
    consumer = _index(eds, "link_loss.heartbeat_consumer")
    return LinkLossSection(
        heartbeat_consumer=consumer,
        life_guarding=consumer is None and _index(eds, "link_loss.life_guarding") is not None,
        abort_connection_option=_option(eds, "link_loss.abort_connection_option"),
        fault_reaction_option=_option(eds, "link_loss.fault_reaction_option"),
    )


def _index(eds: Eds, key: str) -> int | None:
    """Return the index of an object that is written; None where one that the key stands for cannot be written."""
    return BY_KEY[key].index if all(row.is_usable(eds) for row in OBJECTS if row.key == key) else None


def _option(eds: Eds, key: str) -> OptionCode | None:
    """Return the option object of a key with the value that frees the shaft; None where it cannot be written."""
    row = BY_KEY[key]
    return OptionCode(row.index, row.value) if row.value is not None and row.is_usable(eds) else None


def _sync(eds: Eds) -> SyncSection:
    """Return the objects that tell the drive the period, with the values that the limits of the file leave."""
    cycle_period, step = _index(eds, "sync.cycle_period"), _index(eds, "sync.interpolation_time")
    value, power = eds.find(0x60C2, 1), eds.find(0x60C2, 2)
    if step is None or value is None or power is None:
        return SyncSection(cycle_period=cycle_period)
    low, high = max(_limit(value.low, 1), 1), _limit(value.high, 255)
    powers = [each for each in POWERS if _limit(power.low, each) <= each <= _limit(power.high, each)]
    if power.low is None or not powers:
        # Without limits only the power after power-on is known to be taken.
        shown = number_of(eds, step, 2)
        powers = [shown if shown in POWERS else POWERS[0]]
    return SyncSection(step, tuple(powers), (low, high) if low < high <= 255 else (1, 255), cycle_period)


def _limit(limit: int | float | None, otherwise: int) -> int:
    return limit if isinstance(limit, int) else otherwise


# The source of each value: file and section, a standard, or an assumption.

LEFT_OUT = "left out"
"""Beginning of the source of a key that a profile does not give."""
AGAINST = "against the file"
"""Beginning of the source of a value that a person trusts more than the vendor's file."""
Source = tuple[str, str]
"""Key and source of a value."""


def sources_of(profile: CanopenProfile, eds: Eds, lacks: tuple[Lack, ...]) -> dict[str, str]:
    """Return the source of each value, by key; that of a value which is left out says why."""
    found = Path(eds.source).name
    said = dict(
        [
            *_identity_sources(eds, found),
            *_torque_sources(profile, eds, found),
            *_motion_sources(profile, eds, found),
            *_pdo_sources(profile.pdo, eds, found),
            *(("setup.writes", f"{found}, [{each.object:04X}] DefaultValue") for each in profile.setup.writes),
            *_written_sources(profile, "sync", found),
            *_written_sources(profile, "link_loss", found),
            ("link_loss.deadline", "chosen here: short for a hand, long for the loop period"),
            ("timing.torque_bandwidth", f"{ASSUMED}: a usual figure for current loops; to be measured on the bench"),
            ("timing.control_period", f"{ASSUMED}: a usual figure for servo drives; to be measured on the bench"),
            ("timing.mode_change_timeout", "chosen here"),
        ]
    )
    return {USABLE: "; ".join(lack for lack, _ in lacks), **said} if lacks else said


def _identity_sources(eds: Eds, found: str) -> Iterator[Source]:
    for subindex, key, name in ((1, "vendor_id", "VendorNumber"), (2, "product_codes", "ProductNumber")):
        if number_of(eds, 0x1018, subindex):
            yield f"identity.{key}", f"{found}, [1018sub{subindex}] DefaultValue"
        else:
            given = eds_values.identity(eds, subindex) is not None
            yield f"identity.{key}", f"{found}, [DeviceInfo] {name}" if given else f"{LEFT_OUT}: not in {found}"


def _torque_sources(profile: CanopenProfile, eds: Eds, found: str) -> Iterator[Source]:
    modes, assumed = eds_values.supported_modes(eds), f"{ASSUMED}: {found} has no value for 6502h"
    yield "torque.mode_of_operation", f"{found}, [6502] DefaultValue" if modes else assumed
    for key in ("torque.target", "torque.actual", "torque.rated", "torque.demand"):
        index = BY_KEY[key].index
        if value_at(profile, key) is None:
            why = f"[{index:04X}] cannot be sent in a PDO" if index in eds else f"{index:04X}h is not in the file"
            yield key, f"{LEFT_OUT}: {found}, {why}"
        elif index in eds:
            yield from _mapped_sources(key, found, f"{ASSUMED}: as CiA 402-2 has it; an EDS names no units")
        else:
            yield key, f"CiA 402-2, {index:04X}h; not in {found}"
    if profile.torque.slope is not None:
        ramp = f"{ASSUMED}: in ‰ of rated torque per s, as CiA 402-2 has it; rated torque in 1 ms"
        yield from _mapped_sources("torque.slope", found, ramp, "value")
    echo = f"{found}: the first of 6074h and 6077h that a TPDO can carry, otherwise 6071h if it is readable"
    yield "torque.echo", echo


def _motion_sources(profile: CanopenProfile, eds: Eds, found: str) -> Iterator[Source]:
    if profile.position is not None:
        unit = f"{found}, [60A8] DefaultValue" if number_of(eds, 0x60A8) else f"{ASSUMED}: counts of the encoder"
        yield from _mapped_sources("position.actual", found, f"{unit}; 608Fh is ignored")
    if profile.velocity is not None:
        unit = f"{found}, [60A9] DefaultValue" if 0x60A9 in eds else f"{ASSUMED}: {found} has no 60A9h"
        yield from _mapped_sources("velocity.actual", found, unit)


def _mapped_sources(key: str, found: str, why: str, last: str = "unit") -> Iterator[Source]:
    index = BY_KEY[key].index
    yield f"{key}.object", f"{found}, [{index:04X}]"
    yield f"{key}.type", f"{found}, [{index:04X}] DataType"
    yield f"{key}.{last}", why


def _pdo_sources(section: PdoSection, eds: Eds, found: str) -> Iterator[Source]:
    for direction, name, clause in ((Direction.TPDO, "tpdo", "7.5.2.37"), (Direction.RPDO, "rpdo", "7.5.2.35")):
        present = [*records(eds, direction).values()]
        parameters, mappings = (
            f"[{present[0] + more:04X}] to [{present[-1] + more:04X}]" if present else f"no {direction.value}"
            for more in (0, MAPPING)
        )
        yield f"pdo.{name}s", f"{found}, {parameters}"
        yield f"pdo.{name}_entries", f"{found}, {mappings}"
        if section.fixed(direction):
            yield f"pdo.{name}_fixed", f"{found}, {mappings}: the mappings that cannot be written"
        usual = f"{ASSUMED}: the types of CiA 301 4.2.0, {clause}, with the defaults of {found}, {parameters}"
        yield f"pdo.{name}_types", usual
    yield "pdo.entries", f"{found}, 1600h to 1BFFh"
    longest = ", [1800sub3] and on, the longest" if section.inhibit_time_default else ": no 1800h:03 other than 0"
    yield "pdo.inhibit_time_default", f"{found}{longest}"


def _written_sources(profile: CanopenProfile, section: str, found: str) -> Iterator[Source]:
    """Yield the sources of the objects of a section that the master writes."""
    for row in (row for row in OBJECTS if row.key.startswith(section) and row is BY_KEY[row.key]):
        value, subindex = value_at(profile, row.key), 0 if row.values else row.subindex
        if value is None:
            place = f"{row.index:04X}h{f':{subindex:02X}' if subindex else ''}"
            usable = "writable and readable" if row.is_read_back else "writable"
            yield row.key, f"{LEFT_OUT}: {found} has no {usable} {place}"
        elif isinstance(value, OptionCode):
            yield f"{row.key}.object", f"{found}, [{row.index:04X}]"
            yield f"{row.key}.value", f"CiA 402-2, {row.index:04X}h: {row.meaning}"
        elif value is True:
            yield row.key, f"{found}, [100C] and [100D]; there is no 1016h"
        elif value:
            yield row.key, f"{found}, [{row.index:04X}{f'sub{subindex}' if subindex else ''}]"
        if value and row.values:
            yield "sync.powers", f"{found}, [60C2sub2]: within its limits, else its default"
            yield "sync.values", f"{found}, [60C2sub1]: within its limits, else 1 to 255"


# The TOML of a profile that is made from an EDS: a beginning, which says of each value where it comes from.

SECTIONS = ("drive", "identity", "torque", "position", "velocity", "pdo", "setup", "sync", "link_loss", "timing")
HEXADECIMAL = ("object", "heartbeat_consumer", "interpolation_time", "cycle_period", "vendor_id", "product_codes",
               "maps")  # fmt: skip
"""Keys whose numbers are written as in vendors' manuals."""


@dataclass(frozen=True)
class Assumption:
    """A value that no EDS can know, as it is written, and the reason for it."""

    key: str
    value: str
    why: str


@dataclass(frozen=True)
class Draft:
    """The text of a profile, and what has to be found out before it moves a motor."""

    text: str
    assumed: tuple[Assumption, ...]
    known: int
    """Number of values with a source other than an assumption."""


def draft_of(profile: EdsProfile, file: str) -> Draft:
    """Return the draft of a profile; `file` is the name of the vendor's file."""
    written = {section: _section(profile, section) for section in SECTIONS}
    values = {f"{section}.{key}": text for section, items in written.items() for key, text in items.items()}
    # The source of a value belongs into the file, and the reason for one that is not there.
    sources = {
        key: text
        for key, text in profile.sources.items()
        if text.startswith(LEFT_OUT) or key == USABLE or ".".join(key.split(".")[:2]) in values
    }
    assumed = tuple(
        Assumption(key, _toml(key.rpartition(".")[2], value_at(profile, key)), text)
        for key, text in sources.items()
        if ASSUMED in text
    )
    lines = [*_head(profile, file, assumed), "schema = 1", ""]
    for section, items in (*written.items(), ("sources", {quoted(key): quoted(text) for key, text in sources.items()})):
        if items or section == "sources":
            lines += [f"[{section}]", *(f"{key} = {text}" for key, text in items.items()), ""]
    left_out = sum(text.startswith(LEFT_OUT) for text in sources.values())
    return Draft("\n".join(lines), assumed, len(sources) - len(assumed) - left_out)


def _section(profile: EdsProfile, section: str) -> dict[str, str]:
    """Return the values of a section as TOML, by key: those with a source, and those other than the usual."""
    table = getattr(profile, section)
    found: dict[str, str] = {}
    for each in fields(table) if table is not None else ():
        value, key = getattr(table, each.name), f"{section}.{each.name}"
        told = any(name == key or name.startswith(f"{key}.") for name in profile.sources)
        if value not in (None, ()) and (told or value != each.default):
            found[each.name] = value_text(_plain(value), _CODES.get(key, _number), each.name)
    return found


def _toml(key: str, value: object) -> str:
    """Return a value as TOML."""
    return value_text(_plain(value), _number, key)


def _plain(value: object) -> object:
    """Return a value without dataclasses; sub-index 0 and an empty unit are left out, as most objects have no other."""
    if isinstance(value, tuple):
        return tuple(map(_plain, value))
    if not is_dataclass(value):
        return value.value if isinstance(value, Enum) else value
    items = {name: _plain(each) for name, each in vars(value).items() if each not in ("", None)}
    return {name: each for name, each in items.items() if (name, each) != ("subindex", 0)}


def _number(key: str, number: int | float) -> str:
    if isinstance(number, float):
        return exactly(number)
    return f"0x{number:04X}" if key in HEXADECIMAL else str(number)


def _code(key: str, number: int | float) -> str:
    """Return a number of a table whose value is a code of four octets."""
    return f"0x{number:08X}" if key == "value" and isinstance(number, int) and number >= 0 else _number(key, number)


_CODES = {"setup.writes": _code}


def _head(profile: EdsProfile, file: str, assumed: tuple[Assumption, ...]) -> Iterator[str]:
    """Yield the comment at the top: what the drive is, and what is still to be found out."""
    yield _comment(f"{profile.title} on CANopen, drafted from {file}. Not tested on hardware.")
    yield "#"
    if not profile.drive.usable:
        yield _comment(f"Not usable for force: {profile.sources[USABLE]}.")
        yield "#"
    yield _comment("An EDS does not contain the following; see the vendor's manual, or measure on the bench:")
    yield from (_comment(f"- {each.key} = {each.value}") for each in assumed)


def _comment(text: str) -> str:
    return "# " + re.sub(r"[\x00-\x1f\x7f]", " ", text)
