"""Conversion of an EDS or DCF to a drive profile; the file is completed by the standards and by named assumptions.

An EDS names objects, types and PDOs, but no units, times or reactions. Units are therefore those of CiA 402-2 (torque
in ‰ of rated torque, rated torque in mN·m); this is ASSUMED, and not every drive keeps to it. A file that lacks an
object which force needs is refused, with a list of all that is missing.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from haptic_fieldbus.drive.cia402 import (
    IdentitySection,
    MappedObject,
    OptionCode,
    PositionSection,
    TorqueSection,
    VelocitySection,
)
from haptic_fieldbus.drive.objects import NAMES, DataType
from haptic_fieldbus.drive.profile import DriveSection, TimingSection
from haptic_fieldbus.drive.units import COUNTS_PER_SECOND, PERMILLE
from haptic_fieldbus.eds import Eds, EdsEntry, EdsType
from haptic_fieldbus.errors import EdsError, Fault
from haptic_fieldbus.protocols.canopen.profile import CanopenProfile, LinkLossSection, PdoSection
from haptic_fieldbus.protocols.canopen.si_units import POSITION_UNIT_CODES, VELOCITY_UNIT_CODES

CYCLIC_TORQUE, PROFILE_TORQUE = 10, 4
"""Modes of operation (6060h)."""
NEEDED: Mapping[int, tuple[EdsType, ...]] = {
    0x6040: (EdsType.UNSIGNED16,),
    0x6041: (EdsType.UNSIGNED16,),
    0x6060: (EdsType.INTEGER8,),
    0x6061: (EdsType.INTEGER8,),
    0x6064: (EdsType.INTEGER32,),
    0x6071: (EdsType.INTEGER16, EdsType.INTEGER32),
}
"""Objects without which no force can be rendered → types that each may have; 606Ch may replace 6064h."""
MAPPED = {0x6040: "received", 0x6041: "sent", 0x6064: "sent", 0x6071: "received"}
"""Objects that the cycle maps → direction as the drive sees it."""
_RECEIVED, _SENT = ("rw", "rww", "wo"), ("ro", "rw", "rwr", "const")
"""Access types with which an object may be mapped into an RPDO, and into a TPDO."""
_TYPES: Mapping[EdsType | None, DataType] = {
    EdsType.INTEGER8: DataType.INT8,
    EdsType.INTEGER16: DataType.INT16,
    EdsType.INTEGER32: DataType.INT32,
    EdsType.UNSIGNED8: DataType.UINT8,
    EdsType.UNSIGNED16: DataType.UINT16,
    EdsType.UNSIGNED32: DataType.UINT32,
}
_ANY_NODE = 1
"""Node-ID for which default values are evaluated; a default that does not follow the node-ID is the same for all."""
_MOST_ENTRIES = 64
"""Largest number of mapping entries of one PDO."""
_INHIBIT_UNIT = 1e-4
"""Unit of the inhibit time, 1800h:03 [s]."""


@dataclass(frozen=True, kw_only=True)
class EdsProfile(CanopenProfile):
    """A profile made from an EDS, which it keeps so that the simulated drive can offer the same objects."""

    eds: Eds = field(default_factory=lambda: Eds({}))


def data_type(entry: EdsEntry) -> DataType | None:
    """Return the type of an entry as profiles write it; None for a type that profiles do not have."""
    return _TYPES.get(entry.type)


def profile_from_eds(eds: Eds, mode: int | None = None) -> EdsProfile:
    """Return the profile of an EDS; raises EdsError with all that is missing for force.

    `mode` is the mode of operation; None: a torque mode of 6502h.
    """
    velocity = _velocity(eds)
    position = None if velocity else _position(eds)
    faults = [Fault("", f"not usable for force: {lack}", line) for lack, line in _lacks(eds, mode, velocity, position)]
    if faults:
        raise EdsError(eds.source, faults)
    device = eds.device
    link_loss = _link_loss(eds)
    return EdsProfile(
        schema=1,
        name=Path(eds.source).stem,
        source=eds.source,
        drive=DriveSection(
            vendor=device.vendor_name or "unknown vendor",
            model=device.product_name or Path(eds.source).stem or "unknown model",
            protocol="canopen",
            evidence="vendor-data",
        ),
        identity=_identity(eds),
        torque=_torque(eds, mode or _torque_mode(eds)),
        position=position,
        velocity=velocity,
        pdo=_pdos(eds),
        link_loss=link_loss,
        # Usual figures for servo drives: an EDS has none. `_sources` declares them as assumed.
        timing=TimingSection(torque_bandwidth=1000.0, control_period=0.0005),
        sources=_sources(eds, link_loss, velocity),
        eds=eds,
    )


def pdo_count(eds: Eds, communication: int) -> int:
    """Return how many PDOs, counted from the first one, have both of their records.

    `communication` is the index of the first communication record: 1400h for RPDOs, 1800h for TPDOs.
    """
    count = 0
    while communication + count in eds and communication + 0x200 + count in eds:
        count += 1
    return count


def _lacks(
    eds: Eds, mode: int | None, velocity: VelocitySection | None, position: PositionSection | None
) -> Iterator[tuple[str, int | None]]:
    """Yield each lack in words, with the line of the file that shows it; None when there is no such line."""
    for index, types in NEEDED.items():
        entry = eds.find(index)
        if index == 0x6064 and velocity is not None:  # the position is integrated from the velocity instead
            continue
        if entry is None:
            yield f"there is no {_named(index)}", None
        elif entry.type not in types:
            found = entry.type.name if entry.type is not None else "of an unknown type"
            yield f"{_named(index)} is {found}, expected {' or '.join(type.name for type in types)}", entry.line
        elif index in MAPPED and not (entry.mappable and entry.access in _ways(MAPPED[index])):
            yield f"{_named(index)} cannot be {MAPPED[index]} in a PDO", entry.line
    if velocity is None and position is None:
        code = (_number(eds, 0x60A8) or 0) & 0xFFFF_FFFF
        yield f"60A8h SI unit position is {code:08X}h, expected 00B50000h (counts) or FF410000h (0.1 degrees)", None
    for communication, name in ((0x1400, "RPDO"), (0x1800, "TPDO")):
        if not pdo_count(eds, communication):
            yield f"there is no {name} ({communication:04X}h and {communication + 0x200:04X}h)", None
    if not mode and not _torque_mode(eds):
        entry = eds.find(0x6502)
        yield f"{_named(0x6502)} {_supported(eds):X}h names no torque mode", entry.line if entry else None


def _named(index: int) -> str:
    """Return index and name of an object, as messages write it."""
    return f"{index:04X}h {NAMES[index]}"


def _ways(way: str) -> tuple[str, ...]:
    """Return the access types that permit a direction of `MAPPED`."""
    return _RECEIVED if way == "received" else _SENT


def _supported(eds: Eds) -> int:
    """Return the supported drive modes, 6502h; 0 when the file has no value."""
    return _number(eds, 0x6502) or 0


def _torque_mode(eds: Eds) -> int:
    """Return the mode of operation for torque: cyclic before profile torque, 0 when the drive has neither.

    A file without supported drive modes is trusted to have the cyclic one.
    """
    modes = _supported(eds)
    if not modes:
        return CYCLIC_TORQUE
    # Bit n − 1 of 6502h stands for mode n.
    return next((mode for mode in (CYCLIC_TORQUE, PROFILE_TORQUE) if modes >> mode - 1 & 1), 0)


def _number(eds: Eds, index: int, subindex: int = 0) -> int | None:
    """Return the default value of an entry; None when there is none, or no number."""
    entry = eds.find(index, subindex)
    value = entry.value(_ANY_NODE) if entry is not None else None
    return value if isinstance(value, int) else None


def _identity(eds: Eds) -> IdentitySection:
    """Return the identity by 1018h, else by [DeviceInfo]; a vendor-ID or product code of 0 is not compared."""
    vendor, product = _number(eds, 0x1018, 1), _number(eds, 0x1018, 2)
    vendor, product = vendor or eds.device.vendor_number, product or eds.device.product_number
    return IdentitySection(vendor or None, (product,) if product else ())


def _torque(eds: Eds, mode: int) -> TorqueSection:
    """Return the torque objects; None for one that is missing or cannot be used."""
    actual, demand = _sent_torque(eds, 0x6077), _sent_torque(eds, 0x6074)
    return TorqueSection(
        mode,
        target=MappedObject(0x6071, _TYPES[eds.objects[0x6071].entries[0].type], unit=PERMILLE),
        actual=actual,
        rated=_mapped(eds.find(0x6076), "mN·m"),
        demand=demand,
        echo=_echo(eds, demand, actual),
    )


def _echo(
    eds: Eds, demand: MappedObject | None, actual: MappedObject | None
) -> Literal["demand", "actual", "asked", "none"]:
    """Return the way in which a set-point comes back: in a TPDO, else by asking for the target, else none."""
    if demand is not None:
        return "demand"
    if actual is not None:
        return "actual"
    return "none" if eds.objects[0x6071].entries[0].access == "wo" else "asked"


def _sent_torque(eds: Eds, index: int) -> MappedObject | None:
    """Return a torque that the drive can send in a PDO; None for one that it cannot."""
    entry = eds.find(index)
    is_sent = entry is not None and entry.mappable and entry.type in NEEDED[0x6071] and entry.access in _SENT
    return _mapped(entry if is_sent else None, PERMILLE)


def _mapped(entry: EdsEntry | None, unit: str) -> MappedObject | None:
    """Return an entry as a profile writes it; None for no entry, and for a type that profiles do not have."""
    found = data_type(entry) if entry is not None else None
    return MappedObject(entry.index, found, unit=unit) if entry is not None and found is not None else None


def _position(eds: Eds) -> PositionSection | None:
    """Return the position section; None when 60A8h names a unit that is not known."""
    # Without 60A8h, counts are assumed. The mask makes a default that is written with a sign unsigned.
    unit = POSITION_UNIT_CODES.get((_number(eds, 0x60A8) or 0) & 0xFFFF_FFFF)
    return None if unit is None else PositionSection(MappedObject(0x6064, DataType.INT32, unit=unit))


def _velocity(eds: Eds) -> VelocitySection | None:
    """Return the velocity section, for a drive with 606Ch and without 6064h; None when its unit is unknown."""
    actual = eds.find(0x606C)
    if 0x6064 in eds or actual is None or actual.type is not EdsType.INTEGER32:
        return None
    code = _number(eds, 0x60A9)
    # Without 60A9h, counts a second are assumed. The mask makes a default that is written with a sign unsigned.
    unit = COUNTS_PER_SECOND if code is None else VELOCITY_UNIT_CODES.get(code & 0xFFFF_FFFF)
    if unit is None or not (actual.mappable and actual.access in _SENT):
        return None
    return VelocitySection(MappedObject(0x606C, DataType.INT32, unit=unit))


def _pdos(eds: Eds) -> PdoSection:
    """Return the PDOs of the file: their numbers, the fewest mapping entries and the longest inhibit time of any."""
    rpdos, tpdos = pdo_count(eds, 0x1400), pdo_count(eds, 0x1800)
    mappings = [*range(0x1600, 0x1600 + rpdos), *range(0x1A00, 0x1A00 + tpdos)]
    # Sub-index 0 holds the number of entries and is no entry itself.
    room = min(len(eds.objects[index].entries.keys() - {0}) for index in mappings)
    inhibit = max(_number(eds, 0x1800 + number, 3) or 0 for number in range(tpdos))
    return PdoSection(  # transmission types as in CiA 301, because an EDS does not list those of the drive
        tpdo_types=(1, 254, 255),
        rpdo_types=(1, 254, 255),
        tpdos=tpdos,
        rpdos=rpdos,
        entries=min(max(room, 1), _MOST_ENTRIES),
        inhibit_time_default=inhibit * _INHIBIT_UNIT,
    )


def _link_loss(eds: Eds) -> LinkLossSection:
    """Return the guard of the file, 1016h or else 100Ch with 100Dh, and those of 6007h and 605Eh that it has.

    The values of the last two free the shaft (CiA 402-2).
    """
    has_consumer = eds.find(0x1016, 1) is not None
    return LinkLossSection(
        heartbeat_consumer=0x1016 if has_consumer else None,
        life_guarding=not has_consumer and 0x100C in eds and 0x100D in eds,
        abort_connection_option=OptionCode(0x6007, 2) if 0x6007 in eds else None,
        fault_reaction_option=OptionCode(0x605E, 0) if 0x605E in eds else None,
    )


def _sources(eds: Eds, link_loss: LinkLossSection, velocity: VelocitySection | None) -> dict[str, str]:
    """Return the source of each value, by key; assumptions are marked as ASSUMED."""
    file = Path(eds.source).name
    assumed = "as CiA 402-2 has it: ASSUMED, an EDS names no units"
    absent = {name: f"left out: not in {file}" for name, value in vars(link_loss).items() if value is None}
    unit = "60A8h" if _number(eds, 0x60A8) else "in counts: ASSUMED"
    motion = {"position.actual": f"{file}, 6064h and {unit}; 608Fh and the factor group are not looked at"}
    if velocity is not None:
        unit = "60A9h" if 0x60A9 in eds else "in counts/s: ASSUMED, there is no 60A9h"
        motion = {"velocity.actual": f"{file}, 606Ch and {unit}; there is no 6064h"}
    return {
        "identity": f"{file}, 1018h or [DeviceInfo]",
        "torque.mode_of_operation": f"{file}, 6502h; where it says nothing, 10 (cyclic synchronous torque) is ASSUMED",
        "torque.target": f"{file}, 6071h; unit {assumed}",
        "torque.actual": f"{file}, 6077h; unit {assumed}",
        "torque.rated": f"{file}, 6076h; unit {assumed}",
        "torque.demand": f"{file}, 6074h; unit {assumed}",
        "torque.echo": f"{file}: the first of 6074h and 6077h that a TPDO can carry, else 6071h where it is readable",
        **motion,
        "pdo": f"{file}, 1400h to 1BFFh; transmission types as in CiA 301 4.2.0, 7.5.2.35 and 7.5.2.37",
        "link_loss": f"{file}; values as in CiA 402-2, deadline chosen here",
        **{f"link_loss.{name}": text for name, text in absent.items()},
        "timing": "ASSUMED: usual figures for servo drives; to be measured on the bench",
    }
