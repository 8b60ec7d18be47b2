"""The objects of CiA 402-2 that the modes of operation use, as a table.

A row gives the modes that need the object (none: every drive has it) and its power-on value. Where the standard gives
no value ("no default", "manufacturer-specific"), it follows from the bench, so that a drive moves without
configuration. Ramps that are 0 are not limited. The clause of a row is its index in CiA 402-2.
"""

from dataclasses import dataclass

from haptic_fieldbus.drive.objects import DataType
from haptic_fieldbus.sim.drive.dictionary import Access, Mappable

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
    """Torque that 32767 stands for in drives that count in shares of it [N·m]; 0: unknown."""


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


def rows(defaults: Defaults) -> tuple[Row, ...]:
    """Return the whole table."""
    return (*_options(), *_torque(defaults), *_speed(defaults), *_position(), *_factors(defaults))


def _options() -> tuple[Row, ...]:
    """Option codes, digital inputs and interpolation time; the defaults are those of the standard."""
    int16, no = DataType.INT16, Mappable.NO
    return (
        Row(0x605A, 0, int16, 2, mappable=no, allowed=tuple(range(9))),  # quick stop
        Row(0x605B, 0, int16, 0, mappable=no, allowed=(0, 1)),  # shutdown
        Row(0x605C, 0, int16, 1, mappable=no, allowed=(0, 1)),  # disable operation
        Row(0x605D, 0, int16, 1, mappable=no, allowed=(1, 2, 3, 4)),  # halt
        Row(0x60FD, 0, DataType.UINT32, 0, Access.RO, Mappable.TPDO),  # digital inputs
        Row(0x60C2, 1, DataType.UINT8, 1, limits=(1, 255)),  # interpolation time period
        Row(0x60C2, 2, DataType.INT8, -3, limits=(-6, 0)),  # and its power of ten [s]
    )


def _torque(defaults: Defaults) -> tuple[Row, ...]:
    """Objects in ‰ of rated torque or current, except 6075h [mA] and 6087h [‰/s]."""
    int16, uint16, limit = DataType.INT16, DataType.UINT16, defaults.max_torque_permille
    return (
        Row(0x6072, 0, uint16, limit),  # max torque
        Row(0x6073, 0, uint16, limit),  # max current
        Row(0x6074, 0, int16, 0, Access.RO, Mappable.TPDO),  # torque demand
        Row(0x6075, 0, DataType.UINT32, defaults.rated_current_ma, Access.RO, Mappable.TPDO),  # motor rated current
        Row(0x6078, 0, int16, 0, Access.RO, Mappable.TPDO),  # current actual value
        Row(0x6087, 0, DataType.UINT32, 100_000, modes=(PROFILE_TORQUE,)),  # torque slope
        Row(0x6088, 0, int16, 0, modes=(PROFILE_TORQUE,), allowed=(0,)),  # torque profile type: linear ramp
        Row(0x60B2, 0, int16, 0, modes=_CYCLIC),  # torque offset
        Row(0x60E0, 0, uint16, limit),  # positive torque limit
        Row(0x60E1, 0, uint16, limit),  # negative torque limit
    )


def _speed(defaults: Defaults) -> tuple[Row, ...]:
    """Objects in velocity units, except 6080h [r/min], times [ms] and ramps [position units/s²]."""
    int32, uint16, uint32 = DataType.INT32, DataType.UINT16, DataType.UINT32
    pv, ramp = (PROFILE_VELOCITY,), defaults.acceleration
    return (
        Row(0x606B, 0, int32, 0, Access.RO, Mappable.TPDO, _SPEED),  # velocity demand value
        Row(0x606D, 0, uint16, 200, modes=pv),  # velocity window
        Row(0x606E, 0, uint16, 0, modes=pv),  # velocity window time
        Row(0x606F, 0, uint16, 200, modes=pv),  # velocity threshold
        Row(0x6070, 0, uint16, 0, modes=pv),  # velocity threshold time
        Row(0x607F, 0, uint32, NO_LIMIT, modes=_PROFILES),  # max profile velocity
        Row(0x6080, 0, uint32, NO_LIMIT),  # max motor speed
        Row(0x6081, 0, uint32, defaults.velocity, modes=(PROFILE_POSITION,)),  # profile velocity
        Row(0x6083, 0, uint32, ramp, modes=_PROFILES),  # profile acceleration
        Row(0x6084, 0, uint32, ramp),  # profile deceleration: the slow down ramp of every mode
        Row(0x6085, 0, uint32, 2 * ramp),  # quick stop deceleration
        Row(0x6086, 0, DataType.INT16, 0, modes=_PROFILES, allowed=(0,)),  # motion profile type: linear ramp
        Row(0x60B1, 0, int32, 0, modes=(CYCLIC_POSITION, CYCLIC_VELOCITY)),  # velocity offset
        Row(0x60FF, 0, int32, 0, modes=_SPEED),  # target velocity
    )


def _position() -> tuple[Row, ...]:
    """Objects in position units, except times [ms]."""
    int32, uint16, uint32 = DataType.INT32, DataType.UINT16, DataType.UINT32
    pp, hm = (PROFILE_POSITION,), (HOMING,)
    return (
        Row(0x6062, 0, int32, 0, Access.RO, Mappable.TPDO, _POSITIONING),  # position demand value
        Row(0x6065, 0, uint32, NO_LIMIT, modes=_POSITIONING),  # following error window
        Row(0x6066, 0, uint16, 0, modes=_POSITIONING),  # following error time out
        Row(0x6067, 0, uint32, 10, modes=pp),  # position window
        Row(0x6068, 0, uint16, 0, modes=pp),  # position window time
        Row(0x607A, 0, int32, 0, modes=_POSITIONING),  # target position
        Row(0x607C, 0, int32, 0, modes=hm),  # home offset
        Row(0x6098, 0, DataType.INT8, CURRENT_POSITION[-1], modes=hm, allowed=CURRENT_POSITION),  # homing method
        Row(0x6099, 1, uint32, 0, modes=hm),  # homing speeds: not used by these methods
        Row(0x6099, 2, uint32, 0, modes=hm),
        Row(0x60B0, 0, int32, 0, modes=(CYCLIC_POSITION,)),  # position offset
        Row(0x60F4, 0, int32, 0, Access.RO, Mappable.TPDO, _POSITIONING),  # following error actual value
    )


def _factors(defaults: Defaults) -> tuple[Row, ...]:
    """The factor group; by default a position unit is one count of the encoder."""
    uint32, positive, counts = DataType.UINT32, (1, NO_LIMIT), defaults.counts_per_revolution
    return (
        Row(0x607E, 0, DataType.UINT8, 0, mappable=Mappable.NO),  # polarity
        Row(0x608F, 1, uint32, counts, mappable=Mappable.NO, limits=positive),  # position encoder resolution: counts
        Row(0x608F, 2, uint32, 1, mappable=Mappable.NO, limits=positive),  # per motor revolutions
        Row(0x6091, 1, uint32, 1, mappable=Mappable.NO, limits=positive),  # gear ratio: motor revolutions
        Row(0x6091, 2, uint32, 1, mappable=Mappable.NO, limits=positive),  # per driving shaft revolutions
        Row(0x6092, 1, uint32, counts, mappable=Mappable.NO, limits=positive),  # feed constant: position units
        Row(0x6092, 2, uint32, 1, mappable=Mappable.NO, limits=positive),  # per driving shaft revolutions
    )
