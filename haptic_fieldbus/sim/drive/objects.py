"""The application objects of a simulated drive: CiA 402-2, and the objects that its profile names.

If the profile gives an object another index or type, it has that index or type. Objects that the drive lacks are not in
the dictionary: 6007h, 605Eh, 6076h and 6077h if the profile does not name them, objects of missing modes, objects that
its settings leave out. The drive still works with their power-on values.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial

from haptic_fieldbus.drive.cia402 import Cia402Profile, MappedObject, OptionCode, PositionSection, VelocitySection
from haptic_fieldbus.drive.profile import DataType
from haptic_fieldbus.drive.rig import RATED_TORQUE_UNITS, SHARES_OF_RATED
from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.numerals import exactly
from haptic_fieldbus.sim.drive.dictionary import Access, Dictionary, Entry, Mappable, one_of

# The objects of CiA 402-2 that the modes of operation use, as a table.
#
# A row gives the modes that need the object (none: every drive has it) and its power-on value. Where the standard gives
# no value ("no default", "manufacturer-specific"), it follows from the bench, so that a drive moves without
# configuration. Ramps that are 0 are not limited. The clause of a row is its index in CiA 402-2.

PROFILE_POSITION, PROFILE_VELOCITY, PROFILE_TORQUE, HOMING = 1, 3, 4, 6
CYCLIC_POSITION, CYCLIC_VELOCITY, CYCLIC_TORQUE = 8, 9, 10
STANDARD_MODES = frozenset(
    (PROFILE_POSITION, PROFILE_VELOCITY, PROFILE_TORQUE, HOMING, CYCLIC_POSITION, CYCLIC_VELOCITY, CYCLIC_TORQUE)
)
"""Modes that the simulated drive implements, by the numbers of 6060h."""

NO_LIMIT = 0xFFFF_FFFF
"""6065h: following error control is off; 607Fh, 6080h: speed is not limited."""
FACTORS = (0x607E, 0x608F, 0x6091, 0x6092)
"""Polarity, encoder resolution, gear ratio, feed constant."""
CURRENT_POSITION = (35, 37)
"""6098h: the methods of homing on the current position; 37 has replaced 35."""

_POSITIONING = (PROFILE_POSITION, CYCLIC_POSITION)
_PROFILES = (PROFILE_POSITION, PROFILE_VELOCITY)
_SPEED = (PROFILE_VELOCITY, CYCLIC_VELOCITY)
_CYCLIC = (CYCLIC_POSITION, CYCLIC_VELOCITY, CYCLIC_TORQUE)


@dataclass(frozen=True)
class Defaults:
    """Power-on values that follow from bench and settings."""

    rated_torque: float
    """[N·m]"""
    max_torque_permille: int
    rated_current_ma: int
    torque_constant: float
    """[N·m/A], of the motor."""
    peak_current: float
    """[A], of the power stage."""
    counts_per_revolution: int
    velocity: int
    """6081h [position units/s]."""
    acceleration: int
    """6083h and 6084h [position units/s²]; the quick stop ramp 6085h is twice as steep."""
    lever: float = 0.0
    """Torque of the motor for a force of 1 N at a handle that goes straight [N·m]; 0 for another handle."""
    full_scale: float = 0.0
    """Full-scale torque, which the value 32767 means in drives with this unit [N·m]; 0: unknown."""
    serial: int = 1
    modes: frozenset[int] | None = None
    """Modes of operation, besides the profile's torque mode; None: all."""
    without: frozenset[int] = frozenset()
    """Objects that are not in the dictionary."""


@dataclass(frozen=True)
class Row:
    """One sub-index of the table; `allowed` lists the only values that it takes, None: all within `limits`."""

    index: int
    subindex: int
    type: DataType
    value: int
    access: Access = Access.RW
    mappable: Mappable = Mappable.RPDO
    modes: tuple[int, ...] = ()
    limits: tuple[int, int] | None = None
    allowed: tuple[int, ...] | None = None


INT16, INT32, UINT16, UINT32 = DataType.INT16, DataType.INT32, DataType.UINT16, DataType.UINT32


def rows(defaults: Defaults) -> tuple[Row, ...]:
    """Return the whole table."""
    return (*_options(), *_torque(defaults), *_speed(defaults), *_position(), *_factors(defaults))


def _options() -> tuple[Row, ...]:
    """Option codes, digital inputs and interpolation time; the defaults are those of the standard."""
    no = Mappable.NO
    return (
        Row(0x605A, 0, INT16, 2, mappable=no, allowed=tuple(range(9))),  # quick stop
        Row(0x605B, 0, INT16, 0, mappable=no, allowed=(0, 1)),  # shutdown
        Row(0x605C, 0, INT16, 1, mappable=no, allowed=(0, 1)),  # disable operation
        Row(0x605D, 0, INT16, 1, mappable=no, allowed=(1, 2, 3, 4)),  # halt
        Row(0x60FD, 0, UINT32, 0, Access.RO, Mappable.TPDO),  # digital inputs
        Row(0x60C2, 1, DataType.UINT8, 1, limits=(1, 255)),  # interpolation time period
        Row(0x60C2, 2, DataType.INT8, -3, limits=(-6, 0)),  # and its power of ten [s]
    )


def _torque(defaults: Defaults) -> tuple[Row, ...]:
    """Objects in ‰ of rated torque or current, except 6075h [mA] and 6087h [‰/s]."""
    limit = defaults.max_torque_permille
    return (
        Row(0x6072, 0, UINT16, limit),  # max torque
        Row(0x6073, 0, UINT16, limit),  # max current
        Row(0x6074, 0, INT16, 0, Access.RO, Mappable.TPDO),  # torque demand
        Row(0x6075, 0, UINT32, defaults.rated_current_ma, Access.RO, Mappable.TPDO),  # motor rated current
        Row(0x6078, 0, INT16, 0, Access.RO, Mappable.TPDO),  # current actual value
        Row(0x6087, 0, UINT32, 100_000, modes=(PROFILE_TORQUE,)),  # torque slope
        Row(0x6088, 0, INT16, 0, modes=(PROFILE_TORQUE,), allowed=(0,)),  # torque profile type: linear ramp
        Row(0x60B2, 0, INT16, 0, modes=_CYCLIC),  # torque offset
        Row(0x60E0, 0, UINT16, limit),  # positive torque limit
        Row(0x60E1, 0, UINT16, limit),  # negative torque limit
    )


def _speed(defaults: Defaults) -> tuple[Row, ...]:
    """Objects in velocity units, except 6080h [r/min], times [ms] and ramps [position units/s²]."""
    pv, ramp = (PROFILE_VELOCITY,), defaults.acceleration
    return (
        Row(0x606B, 0, INT32, 0, Access.RO, Mappable.TPDO, _SPEED),  # velocity demand value
        Row(0x606D, 0, UINT16, 200, modes=pv),  # velocity window
        Row(0x606E, 0, UINT16, 0, modes=pv),  # velocity window time
        Row(0x606F, 0, UINT16, 200, modes=pv),  # velocity threshold
        Row(0x6070, 0, UINT16, 0, modes=pv),  # velocity threshold time
        Row(0x607F, 0, UINT32, NO_LIMIT, modes=_PROFILES),  # max profile velocity
        Row(0x6080, 0, UINT32, NO_LIMIT),  # max motor speed
        Row(0x6081, 0, UINT32, defaults.velocity, modes=(PROFILE_POSITION,)),  # profile velocity
        Row(0x6083, 0, UINT32, ramp, modes=_PROFILES),  # profile acceleration
        Row(0x6084, 0, UINT32, ramp),  # profile deceleration: the slow down ramp of every mode
        Row(0x6085, 0, UINT32, 2 * ramp),  # quick stop deceleration
        Row(0x6086, 0, INT16, 0, modes=_PROFILES, allowed=(0,)),  # motion profile type: linear ramp
        Row(0x60B1, 0, INT32, 0, modes=(CYCLIC_POSITION, CYCLIC_VELOCITY)),  # velocity offset
        Row(0x60FF, 0, INT32, 0, modes=_SPEED),  # target velocity
    )


def _position() -> tuple[Row, ...]:
    """Objects in position units, except times [ms]."""
    pp, hm = (PROFILE_POSITION,), (HOMING,)
    return (
        Row(0x6062, 0, INT32, 0, Access.RO, Mappable.TPDO, _POSITIONING),  # position demand value
        Row(0x6065, 0, UINT32, NO_LIMIT, modes=_POSITIONING),  # following error window
        Row(0x6066, 0, UINT16, 0, modes=_POSITIONING),  # following error time out
        Row(0x6067, 0, UINT32, 10, modes=pp),  # position window
        Row(0x6068, 0, UINT16, 0, modes=pp),  # position window time
        Row(0x607A, 0, INT32, 0, modes=_POSITIONING),  # target position
        Row(0x607C, 0, INT32, 0, modes=hm),  # home offset
        Row(0x6098, 0, DataType.INT8, CURRENT_POSITION[-1], modes=hm, allowed=CURRENT_POSITION),  # homing method
        Row(0x6099, 1, UINT32, 0, modes=hm),  # homing speeds: not used by these methods
        Row(0x6099, 2, UINT32, 0, modes=hm),
        Row(0x60B0, 0, INT32, 0, modes=(CYCLIC_POSITION,)),  # position offset
        Row(0x60F4, 0, INT32, 0, Access.RO, Mappable.TPDO, _POSITIONING),  # following error actual value
    )


def _factors(defaults: Defaults) -> tuple[Row, ...]:
    """The factor group; by default a position unit is one count of the encoder."""
    positive, counts = (1, NO_LIMIT), defaults.counts_per_revolution
    return (
        Row(0x607E, 0, DataType.UINT8, 0, mappable=Mappable.NO),  # polarity
        Row(0x608F, 1, UINT32, counts, mappable=Mappable.NO, limits=positive),  # position encoder resolution: counts
        Row(0x608F, 2, UINT32, 1, mappable=Mappable.NO, limits=positive),  # per motor revolutions
        Row(0x6091, 1, UINT32, 1, mappable=Mappable.NO, limits=positive),  # gear ratio: motor revolutions
        Row(0x6091, 2, UINT32, 1, mappable=Mappable.NO, limits=positive),  # per driving shaft revolutions
        Row(0x6092, 1, UINT32, counts, mappable=Mappable.NO, limits=positive),  # feed constant: position units
        Row(0x6092, 2, UINT32, 1, mappable=Mappable.NO, limits=positive),  # per driving shaft revolutions
    )


PERMILLE = 1e-3
_WORD = 0x1_0000
_FULL_SCALE = 32760
"""Value of 16 bits for the peak current of the power stage, in drives with this unit."""

TORQUE_DEMAND = 0x6074
DEVICE_TYPE = 0x0002_0192
"""1000h (CiA 402-2): device profile 402, servo drive."""

NO_MODE = 0
NO_ACTION, FAULT = 0, 1
"""Value of 6007h in a drive without it: no reaction to a lost link, or a fault if its profile states a reaction."""
DISABLE, SLOW_DOWN = 0, 2
"""Value of 605Eh in a drive without it: free at once if its profile states a reaction, otherwise the quick stop
ramp."""
# CiA 402-2, 6502h: the bit of a mode is its number minus one; manufacturer-specific modes are negative and have bits 16
# on.
_FIRST_MANUFACTURER_BIT = 16


@dataclass(frozen=True)
class Objects:
    """The entries that the drive itself uses, in the dictionary or not."""

    error_code: Entry
    controlword: Entry
    statusword: Entry
    abort_connection_option: Entry
    fault_reaction_option: Entry
    mode: Entry
    mode_display: Entry
    position: Entry
    velocity: Entry
    target_torque: Entry
    actual_torque: Entry
    modes: frozenset[int]
    """Modes of operation that the drive offers."""
    torque_mode: int
    rated_torque: float
    """[N·m], with the rounding of 6076h."""
    permille: float
    """‰ of the rated torque, or of the torque at rated current, of which limits and target torque are shares [N·m]."""
    torque_unit: float
    """One step of the target torque [N·m]."""
    actual_unit: float
    """One step of the torque actual value [N·m]."""
    demand_unit: float
    """One step of the torque demand [N·m]."""
    mode_bits: int
    """Bits of the controlword that the drive's own torque mode requires for torque; 0: none."""
    table: dict[tuple[int, int], Entry]
    """The entries of the table, by index and sub-index."""
    step: Callable[[str], float]
    """Returns one step of a unit of torque [N·m]; raises UsageError for an unknown one."""

    def row(self, index: int, subindex: int = 0) -> Entry:
        """Return an entry of the table."""
        return self.table[index, subindex]

    def on_written(self, changed: Callable[[], None], factors_changed: Callable[[], None]) -> None:
        """Set the functions to call after a client has written an entry: `factors_changed` for factors, else `changed`.

        Process data do not call them; `Drive.act` handles these.
        """
        for entry in (*self.table.values(), self.controlword, self.mode, self.target_torque):
            if entry.access is Access.RW:
                entry.changed = factors_changed if entry.index in FACTORS else changed


def add_objects(dictionary: Dictionary, profile: Cia402Profile, defaults: Defaults) -> Objects:
    """Add all application objects to the dictionary.

    Raises UsageError when the profile's torque unit cannot be simulated, or when the rated torque is less than one step
    of its unit.
    """
    _add_identity(dictionary, profile, defaults.serial)
    rated = _add_rated(dictionary, profile, defaults.rated_torque)
    if (current := profile.torque.rated_current) is not None:
        _add_mapped(dictionary, current, Access.RO, Mappable.TPDO).start_with(defaults.rated_current_ma)
    step = partial(_torque_step, profile.name, defaults, rated)
    torque_mode = profile.torque.mode_of_operation
    offered = (STANDARD_MODES if defaults.modes is None else STANDARD_MODES & defaults.modes) | {torque_mode}
    table = _add_table(dictionary, defaults, offered, profile.torque.demand)
    add = dictionary.add
    bits = (mode - 1 if mode > 0 else _FIRST_MANUFACTURER_BIT - mode - 1 for mode in offered if mode)
    add(Entry(0x6502, 0, DataType.UINT32, sum(1 << bit for bit in bits), mappable=Mappable.TPDO))
    actual, demand, target = profile.torque.actual, profile.torque.demand, profile.torque.target
    permille = step(target.unit if target.unit in SHARES_OF_RATED else SHARES_OF_RATED[0])
    abort, reaction = profile.link_loss.abort_connection_option, profile.link_loss.fault_reaction_option
    stops_free = profile.guarded and not abort
    return Objects(
        error_code=add(Entry(0x603F, 0, DataType.UINT16, mappable=Mappable.TPDO)),
        controlword=add(Entry(0x6040, 0, DataType.UINT16, 0, Access.RW, mappable=Mappable.BOTH)),
        statusword=add(Entry(0x6041, 0, DataType.UINT16, mappable=Mappable.TPDO)),
        abort_connection_option=_add_option(
            dictionary, abort, 1, range(4), Entry(0x6007, 0, INT16, FAULT if profile.guarded else NO_ACTION)
        ),
        fault_reaction_option=_add_option(
            dictionary, reaction, 2, range(5), Entry(0x605E, 0, INT16, DISABLE if stops_free else SLOW_DOWN)
        ),
        mode=add(
            Entry(0x6060, 0, DataType.INT8, 0, Access.RW, mappable=Mappable.BOTH, accept=one_of((NO_MODE, *offered)))
        ),
        mode_display=add(Entry(0x6061, 0, DataType.INT8, mappable=Mappable.TPDO)),
        position=_add_motion(dictionary, profile, 0x6064, profile.position),
        velocity=_add_motion(dictionary, profile, 0x606C, profile.velocity),
        target_torque=_add_mapped(dictionary, profile.torque.target, Access.RW, Mappable.BOTH),
        actual_torque=(
            _add_mapped(dictionary, actual, Access.RO, Mappable.TPDO) if actual is not None else Entry(0x6077, 0, INT16)
        ),
        modes=offered,
        torque_mode=torque_mode,
        rated_torque=rated,
        permille=permille,
        torque_unit=step(target.unit),
        actual_unit=step((actual or target).unit),
        demand_unit=step(demand.unit) if demand is not None else permille,
        mode_bits=profile.torque.controlword,
        table=table,
        step=step,
    )


def _torque_step(name: str, bench: Defaults, rated: float, unit: str) -> float:
    """Return one step of a torque unit [N·m] at this rated torque; raises UsageError for an unknown unit."""
    steps = {
        "permille_of_rated_torque": rated * PERMILLE,
        "permille_of_rated_current": bench.rated_current_ma * 1e-6 * bench.torque_constant,
        "mA": 1e-3 * bench.torque_constant,
        "peak_current/32760": bench.peak_current * bench.torque_constant / _FULL_SCALE,
        "peak_current/32760/65536": bench.peak_current * bench.torque_constant / _FULL_SCALE / _WORD,
        "mN·m": 1e-3,
        "mN": 1e-3 * bench.lever,
        "full_scale/32767": bench.full_scale / 0x7FFF,
    }
    if not steps.get(unit):
        raise UsageError(f'{name}: torque in "{unit}" cannot be simulated')
    return steps[unit]


def _add_table(
    dictionary: Dictionary, defaults: Defaults, modes: frozenset[int], demand: MappedObject | None
) -> dict[tuple[int, int], Entry]:
    """Create the entries of all rows, and add the existing ones to the dictionary.

    The torque demand is the object `demand` if the profile names it.
    """
    entries: dict[tuple[int, int], Entry] = {}
    shown: dict[int, list[Entry]] = {}
    for row in rows(defaults):
        accept = one_of(row.allowed) if row.allowed is not None else None
        # Targets and parameters that an RPDO may write may also be read back by a TPDO.
        both = Mappable.BOTH if row.mappable is Mappable.RPDO else row.mappable
        entry = Entry(row.index, row.subindex, row.type, row.value, row.access,
                      limits=row.limits, mappable=both, accept=accept)  # fmt: skip
        if demand is not None and row.index == TORQUE_DEMAND:
            entry = Entry(demand.object, demand.subindex, demand.type, mappable=both)
        entries[row.index, row.subindex] = entry
        if entry.index not in defaults.without and (not row.modes or modes.intersection(row.modes)):
            shown.setdefault(entry.index, []).append(entry)
    for members in shown.values():
        if members[0].subindex:
            dictionary.add_record(members)
        else:
            dictionary.add(members[0])
    return entries


def _add_identity(dictionary: Dictionary, profile: Cia402Profile, serial: int) -> None:
    """Add 1000h, 1008h and 1018h (CiA 301)."""
    dictionary.add(Entry(0x1000, 0, DataType.UINT32, DEVICE_TYPE, Access.CONST))
    dictionary.add(Entry(0x1008, 0, None, access=Access.CONST, text=profile.title.encode()))
    identity = profile.identity
    product = identity.product_codes[0] if identity.product_codes else 0
    dictionary.add_record(
        Entry(0x1018, subindex, DataType.UINT32, value)
        for subindex, value in enumerate((identity.vendor_id or 0, product, 0x0001_0000, serial), start=1)
    )


def _add_rated(dictionary: Dictionary, profile: Cia402Profile, rated_torque: float) -> float:
    """Add 6076h; return the rated torque [N·m] in whole steps of its unit.

    Raises UsageError when it is less than one step. Without 6076h in the profile the torque is returned unchanged.
    """
    if (rated := profile.torque.rated) is None:
        return rated_torque
    unit = RATED_TORQUE_UNITS[rated.unit]
    entry = _add_mapped(dictionary, rated, Access.RO, Mappable.TPDO)
    steps, most = round(rated_torque / unit), rated.type.limits[1]
    if steps > most:
        raise UsageError(
            f"{profile.name}: {exactly(rated_torque)} N·m of rated torque; expected at most {exactly(most * unit)} N·m"
        )
    entry.start_with(steps)
    if not entry.value:
        raise UsageError(f"{profile.name}: {rated_torque} N·m of rated torque is less than one step of {rated.unit}")
    return entry.value * unit


def _add_mapped(dictionary: Dictionary, mapped: MappedObject, access: Access, mappable: Mappable) -> Entry:
    """Add an object that carries a signal, at the index of the profile."""
    entry = Entry(mapped.object, mapped.subindex, mapped.type, 0, access, mappable=mappable)
    if mapped.subindex:
        dictionary.add_record([entry])
    return dictionary.add(entry)


def _add_motion(
    dictionary: Dictionary, profile: Cia402Profile, index: int, section: PositionSection | VelocitySection | None
) -> Entry:
    """Add an object of the measured motion; a drive that offers velocity only has no position object."""
    if section is not None:
        return _add_mapped(dictionary, section.actual, Access.RO, Mappable.TPDO)
    entry = Entry(index, 0, DataType.INT32, mappable=Mappable.TPDO)
    return dictionary.add(entry) if profile.position is not None else entry


def _add_option(
    dictionary: Dictionary, option: OptionCode | None, value: int, codes: Iterable[int], hidden: Entry
) -> Entry:
    """Add an option code with its power-on value; reserved codes are refused. Without it the drive uses `hidden`."""
    if option is None:
        return hidden
    return dictionary.add(Entry(option.object, 0, INT16, value, Access.RW, accept=one_of(codes)))
