"""Conversion of an EDS or DCF to a drive profile; the file is completed by the standards and by named assumptions.

An EDS names objects, types and PDOs, but no units, times or reactions. Units are therefore those of CiA 402-2 (torque
in ‰ of rated torque, rated torque in mN·m); this is ASSUMED, and not every drive keeps to it. A file of no CiA 402
drive is refused. The profile of a drive that lacks what force needs is not usable for force, with a list of all that is
missing; such a drive can still be simulated.
"""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

from haptic_fieldbus.drive.cia402 import (
    IdentitySection,
    MappedObject,
    OptionCode,
    PositionSection,
    TorqueSection,
    VelocitySection,
    WrittenObject,
)
from haptic_fieldbus.drive.objects import DataType
from haptic_fieldbus.drive.profile import DriveSection, TimingSection
from haptic_fieldbus.drive.rig import COUNTS, PERMILLE
from haptic_fieldbus.eds import Eds, EdsEntry, EdsType
from haptic_fieldbus.errors import EdsError, Fault
from haptic_fieldbus.protocols.canopen.eds_pdos import (
    PROFILE_TORQUE,
    TORQUE_TYPES,
    Lack,
    automaton_lacks,
    carries,
    force_lacks,
    pdo_section,
    torque_mode,
)
from haptic_fieldbus.protocols.canopen.eds_sources import sources_of
from haptic_fieldbus.protocols.canopen.eds_values import (
    READABLE,
    WRITABLE,
    data_type,
    identity,
    number_of,
    position_unit,
    velocity_unit,
)
from haptic_fieldbus.protocols.canopen.pdo import Direction
from haptic_fieldbus.protocols.canopen.profile import CanopenProfile, LinkLossSection, SyncSection

TARGET = 0x6071
POWERS = (-3, -4, -5, -6)
"""Powers of ten of the interpolation time period that are tried, the usual one first."""
STEEPEST = 1_000_000
"""Torque slope [‰ of rated torque per s]: rated torque in 1 ms."""


@dataclass(frozen=True, kw_only=True)
class EdsProfile(CanopenProfile):
    """A profile made from an EDS, which it keeps so that the simulated drive can offer the same objects."""

    eds: Eds = field(default_factory=lambda: Eds({}))
    lacks: tuple[Lack, ...] = ()
    """What keeps the drive from rendering force."""

    def faults(self) -> list[Fault]:
        """Return the faults of the file, and what is missing for force."""
        return [*self.eds.faults, *(Fault("", f"not usable for force: {lack}", line) for lack, line in self.lacks)]


def profile_from_eds(eds: Eds, mode: int | None = None) -> EdsProfile:
    """Return the profile of an EDS; raises EdsError when it describes no CiA 402 drive.

    `mode` is the mode of operation; None: a torque mode of 6502h.
    """
    faults = [Fault("", f"no CiA 402 drive: {lack}", line) for lack, line in automaton_lacks(eds)]
    if faults:
        raise EdsError(eds.source, faults)
    velocity = _velocity(eds)
    lacks = tuple(force_lacks(eds, mode, velocity))
    device = eds.device
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
        identity=_identity(eds),
        torque=_torque(eds, mode or (torque_mode(eds) if TARGET in eds else 0)),
        # A drive without torque may have no position either; it is simulated with that of the standard.
        position=None if velocity else PositionSection(MappedObject(0x6064, DataType.INT32, unit=_position_unit(eds))),
        velocity=velocity,
        pdo=pdo_section(eds),
        sync=_sync(eds),
        link_loss=_link_loss(eds),
        # Usual figures for servo drives: an EDS has none. `sources_of` declares them as assumed.
        timing=TimingSection(torque_bandwidth=1000.0, control_period=0.0005),
        eds=eds,
        lacks=lacks,
    )
    return replace(profile, sources=sources_of(profile, eds, lacks))


def _position_unit(eds: Eds) -> str:
    return position_unit(eds) or COUNTS


def _identity(eds: Eds) -> IdentitySection:
    """Return the identity; a vendor-ID or product code of 0 is not compared."""
    product = identity(eds, 2)
    return IdentitySection(identity(eds, 1), () if product is None else (product,))


def _torque(eds: Eds, mode: int) -> TorqueSection:
    """Return the torque objects; None for one that is missing or cannot be used."""
    actual, demand = _sent_torque(eds, 0x6077), _sent_torque(eds, 0x6074)
    return TorqueSection(
        mode,
        target=_mapped(eds.find(TARGET), PERMILLE) or MappedObject(TARGET, DataType.INT16, unit=PERMILLE),
        actual=actual,
        rated=_mapped(eds.find(0x6076), "mN·m"),
        demand=demand,
        echo=_echo(eds, demand, actual),
        slope=_slope(eds, mode),
    )


def _echo(
    eds: Eds, demand: MappedObject | None, actual: MappedObject | None
) -> Literal["demand", "actual", "asked", "none"]:
    """Return the way in which a set-point comes back: in a TPDO, else by asking for the target, else none."""
    if demand is not None:
        return "demand"
    if actual is not None:
        return "actual"
    target = eds.find(TARGET)
    return "none" if target is None or target.access == "wo" else "asked"


def _sent_torque(eds: Eds, index: int) -> MappedObject | None:
    """Return a torque that the drive can send in a PDO; None for one that it cannot."""
    entry = eds.find(index)
    is_sent = entry is not None and entry.type in TORQUE_TYPES and carries(eds, Direction.TPDO, entry)
    return _mapped(entry if is_sent else None, PERMILLE)


def _mapped(entry: EdsEntry | None, unit: str) -> MappedObject | None:
    """Return an entry as a profile writes it; None for no entry, and for a type that profiles do not have."""
    found = data_type(entry) if entry is not None else None
    return MappedObject(entry.index, found, unit=unit) if entry is not None and found is not None else None


def _velocity(eds: Eds) -> VelocitySection | None:
    """Return the velocity section, for a drive with 606Ch and without 6064h; None when its unit is unknown."""
    actual = eds.find(0x606C)
    if 0x6064 in eds or actual is None or actual.type is not EdsType.INTEGER32:
        return None
    unit = velocity_unit(eds)
    if unit is None or not carries(eds, Direction.TPDO, actual):
        return None
    return VelocitySection(MappedObject(0x606C, DataType.INT32, unit=unit))


def _link_loss(eds: Eds) -> LinkLossSection:
    """Return the guard of the file, 1016h or else 100Ch with 100Dh, and those of 6007h and 605Eh that it has.

    The values of the last two free the shaft (CiA 402-2).
    """
    has_consumer = _is_writable(eds, 0x1016, 1)
    return LinkLossSection(
        heartbeat_consumer=0x1016 if has_consumer else None,
        life_guarding=not has_consumer and _is_writable(eds, 0x100C) and _is_writable(eds, 0x100D),
        abort_connection_option=OptionCode(0x6007, 2) if _is_writable(eds, 0x6007) else None,
        fault_reaction_option=OptionCode(0x605E, 0) if _is_writable(eds, 0x605E) else None,
    )


def _sync(eds: Eds) -> SyncSection:
    """Return the objects that tell the drive the period, with the values that the limits of the file leave."""
    cycle_period = 0x1006 if _is_written_back(eds, 0x1006) else None
    value, power = eds.find(0x60C2, 1), eds.find(0x60C2, 2)
    if value is None or power is None or not all(_is_written_back(eds, 0x60C2, each) for each in (1, 2)):
        return SyncSection(cycle_period=cycle_period)
    low, high = (_limit(value.low, 1), _limit(value.high, 255))
    powers = [each for each in POWERS if _limit(power.low, each) <= each <= _limit(power.high, each)]
    return SyncSection(
        interpolation_time=0x60C2,
        # Without limits only the power after power-on is known to be taken.
        powers=tuple(powers) if power.low is not None and powers else (_default_power(eds),),
        values=(max(low, 1), high) if max(low, 1) < high <= 255 else (1, 255),
        cycle_period=cycle_period,
    )


def _default_power(eds: Eds) -> int:
    power = number_of(eds, 0x60C2, 2)
    return power if power in POWERS else POWERS[0]


def _limit(limit: int | float | None, otherwise: int) -> int:
    return limit if isinstance(limit, int) else otherwise


def _slope(eds: Eds, mode: int) -> WrittenObject | None:
    """Return the steepest torque slope, for profile torque mode alone; None for a drive that has none to be written."""
    entry = eds.find(0x6087)
    type = data_type(entry) if entry is not None and _is_written_back(eds, 0x6087) else None
    if mode != PROFILE_TORQUE or entry is None or type is None:
        return None
    return WrittenObject(0x6087, type, min(_limit(entry.high, STEEPEST), type.limits[1], STEEPEST))


def _is_written_back(eds: Eds, index: int, subindex: int = 0) -> bool:
    """Return whether an entry can be written and read back."""
    entry = eds.find(index, subindex)
    return entry is not None and entry.access in WRITABLE and entry.access in READABLE


def _is_writable(eds: Eds, index: int, subindex: int = 0) -> bool:
    entry = eds.find(index, subindex)
    return entry is not None and entry.access in WRITABLE
