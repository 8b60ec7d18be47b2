"""The objects of a simulated drive beyond communication: CiA 402-2, and what its profile names.

Each row of the table names its clause. Objects that the profile gives another index or type stand there as the profile
says. What a profile does not name as offered (6007h, 605Eh, 6076h, 6077h) the drive does not have.
"""

from collections.abc import Iterable
from dataclasses import dataclass

from haptic_fieldbus.drive.objects import DataType
from haptic_fieldbus.drive.profile import RATED_TORQUE_UNITS, DriveProfile, MappedObject
from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.sim.dictionary import Access, Dictionary, Entry, Mappable, one_of

PERMILLE = 1e-3
_TORQUE_UNITS = {"permille_of_rated_torque": PERMILLE}
"""Unit of targets and actual values as a share of rated torque."""

DEVICE_TYPE = 0x0002_0192
"""CiA 402-2, 1000h: device profile 402, servo drive."""

NO_MODE = 0
# CiA 402-2, 6502h: bit of a mode is its number minus one; manufacturer specific modes are negative, bits 16 on.
_FIRST_MANUFACTURER_BIT = 16


@dataclass(frozen=True)
class Objects:
    """The entries that the drive itself works with; None where this model has none."""

    error_code: Entry
    controlword: Entry
    statusword: Entry
    quick_stop_option: Entry
    abort_connection_option: Entry | None
    fault_reaction_option: Entry | None
    mode: Entry
    mode_display: Entry
    position: Entry
    velocity: Entry
    target_torque: Entry
    actual_torque: Entry | None
    torque_mode: int
    rated_torque: float
    """[N·m], as 6076h says it."""
    torque_unit: float
    """[N·m] of one step of the target."""


def add_objects(dictionary: Dictionary, profile: DriveProfile, rated_torque: float, serial: int) -> Objects:
    """Fill the dictionary; UsageError for a torque unit that cannot be simulated."""
    share = _TORQUE_UNITS.get(profile.torque.target.unit)
    if share is None:
        raise UsageError(f'{profile.name}: targets in "{profile.torque.target.unit}" cannot be simulated')
    _add_identity(dictionary, profile, serial)
    rated = _add_rated(dictionary, profile, rated_torque)
    modes = (NO_MODE, profile.torque.mode_of_operation)
    add = dictionary.add
    add(Entry(0x6502, 0, DataType.UINT32, _supported(modes[1]), mappable=Mappable.TPDO))
    dictionary.add_record(  # 60C2h: value, and its power of ten [s]
        (
            Entry(0x60C2, 1, DataType.UINT8, 1, Access.RW, limits=(1, 255), mappable=Mappable.RPDO),
            Entry(0x60C2, 2, DataType.INT8, -3, Access.RW, limits=(-6, 0), mappable=Mappable.RPDO),
        )
    )
    actual = profile.torque.actual
    abort, reaction = profile.link_loss.abort_connection_option, profile.link_loss.fault_reaction_option
    return Objects(
        error_code=add(Entry(0x603F, 0, DataType.UINT16, mappable=Mappable.TPDO)),
        controlword=add(Entry(0x6040, 0, DataType.UINT16, 0, Access.RW, mappable=Mappable.BOTH)),
        statusword=add(Entry(0x6041, 0, DataType.UINT16, mappable=Mappable.TPDO)),
        quick_stop_option=_add_option(dictionary, 0x605A, 2, range(9)),
        abort_connection_option=_add_option(dictionary, abort.object, 1, range(4)) if abort else None,
        fault_reaction_option=_add_option(dictionary, reaction.object, 2, range(5)) if reaction else None,
        mode=add(Entry(0x6060, 0, DataType.INT8, 0, Access.RW, mappable=Mappable.BOTH, accept=one_of(modes))),
        mode_display=add(Entry(0x6061, 0, DataType.INT8, mappable=Mappable.TPDO)),
        position=_add_mapped(dictionary, profile.position.actual, Access.RO, Mappable.TPDO),
        velocity=add(Entry(0x606C, 0, DataType.INT32, mappable=Mappable.TPDO)),
        target_torque=_add_mapped(dictionary, profile.torque.target, Access.RW, Mappable.BOTH),
        actual_torque=_add_mapped(dictionary, actual, Access.RO, Mappable.TPDO) if actual is not None else None,
        torque_mode=modes[1],
        rated_torque=rated,
        torque_unit=rated * share,
    )


def _add_identity(dictionary: Dictionary, profile: DriveProfile, serial: int) -> None:
    """CiA 301: 1000h, 1008h, 1018h."""
    dictionary.add(Entry(0x1000, 0, DataType.UINT32, DEVICE_TYPE, Access.CONST))
    dictionary.add(Entry(0x1008, 0, None, access=Access.CONST, text=profile.title.encode()))
    identity = profile.identity
    product = identity.product_codes[0] if identity.product_codes else 0
    dictionary.add_record(
        Entry(0x1018, subindex, DataType.UINT32, value)
        for subindex, value in enumerate((identity.vendor_id or 0, product, 0x0001_0000, serial), start=1)
    )


def _add_rated(dictionary: Dictionary, profile: DriveProfile, rated_torque: float) -> float:
    """6076h; returns the rated torque as the object, in whole steps of its unit, says it [N·m], UsageError for none."""
    rated = profile.torque.rated
    if rated is None:
        return rated_torque
    unit = RATED_TORQUE_UNITS[rated.unit]
    entry = _add_mapped(dictionary, rated, Access.RO, Mappable.TPDO)
    entry.value = entry.default = round(rated_torque / unit)
    if not entry.value:
        raise UsageError(f"{profile.name}: {rated_torque} N·m of rated torque is less than one step of {rated.unit}")
    return entry.value * unit


def _add_mapped(dictionary: Dictionary, mapped: MappedObject, access: Access, mappable: Mappable) -> Entry:
    """An object that carries a signal, where the profile has it."""
    entry = Entry(mapped.object, mapped.subindex, mapped.type, 0, access, mappable=mappable)
    if mapped.subindex:
        dictionary.add_record([entry])
    return dictionary.add(entry)


def _add_option(dictionary: Dictionary, index: int, value: int, codes: Iterable[int]) -> Entry:
    """An option code with its power-on value; codes that are reserved are refused."""
    return dictionary.add(Entry(index, 0, DataType.INT16, value, Access.RW, accept=one_of(codes)))


def _supported(mode: int) -> int:
    """6502h for a drive with one mode."""
    return 1 << (mode - 1 if mode > 0 else _FIRST_MANUFACTURER_BIT - mode - 1)
