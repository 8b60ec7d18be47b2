"""Units of a drive's values, as named in profiles: the size of one step, in SI at the motor shaft."""

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from haptic_fieldbus.drive.rig import RigAxis

PERMILLE, MILLIAMPERE, PERMILLE_OF_CURRENT = "permille_of_rated_torque", "mA", "permille_of_rated_current"
PEAK_SHARE, PEAK_SHARE_HIGH = "peak_current/32760", "peak_current/32760/65536"
"""Current of the power stage in 16 bits; and the same in the high word of 32 bits."""
_NEEDED = {
    PERMILLE: ("rated_torque",),
    MILLIAMPERE: ("torque_constant",),
    PERMILLE_OF_CURRENT: ("rated_current", "torque_constant"),
    PEAK_SHARE: ("peak_current", "torque_constant"),
    PEAK_SHARE_HIGH: ("peak_current", "torque_constant"),
}
"""Unit of torque → keys of a rig's axis whose product, times `_SHARES`, is one step [N·m]."""
_SHARES = {
    PERMILLE: 1e-3,
    MILLIAMPERE: 1e-3,
    PERMILLE_OF_CURRENT: 1e-3,
    PEAK_SHARE: 1 / 32760,
    PEAK_SHARE_HIGH: 1 / 32760 / 65536,
}
TORQUE_UNITS = tuple(_NEEDED)
SHARES_OF_RATED = (PERMILLE, PERMILLE_OF_CURRENT)
"""Units of torque that are a share of a rated value of the drive."""
RATED_TORQUE_UNITS = {"µN·m": 1e-6, "mN·m": 1e-3, "N·m": 1.0}
"""Unit of the rated torque → size of one step [N·m]."""
FULL_SCALE, MILLINEWTON = "full_scale/32767", "mN"
"""A torque of the profile's own in 16 bits; and the force of a motor that goes straight."""
ABSOLUTE_TORQUE_UNITS = (*RATED_TORQUE_UNITS, FULL_SCALE, MILLINEWTON)
"""Units of torque that need no value of the motor."""
COUNTS, TENTH_DEGREE = "counts", "0.1 deg"
STEPS_PER_REVOLUTION = {"mrad": 2e3 * math.pi, TENTH_DEGREE: 3600.0}
"""Unit of a position that is none of the encoder → number of steps in one revolution of the motor."""
METRES = {"µm": 1e-6}
"""Unit of the position of a motor that goes straight → size of one step [m]."""
COUNTS_PER_SECOND = "counts/s"
REVOLUTIONS_PER_SECOND = {"rpm": 1 / 60, "0.1 rpm": 1 / 600, "0.01 rpm": 1 / 6_000, "0.001 rpm": 1 / 60_000}
"""Unit of a velocity (CiA 402-2, 60A9h) → size of one step in revolutions of the motor a second."""
VELOCITY_UNITS = (*REVOLUTIONS_PER_SECOND, COUNTS_PER_SECOND)


def torque_step(unit: str, axis: "RigAxis", full_scale: float | None = None) -> float | None:
    """Return one step of torque [N·m]; None when the rig lacks the value that it follows from (`needed_for`).

    `full_scale` is that of the profile [N·m].
    """
    if unit == FULL_SCALE:
        return None if full_scale is None else full_scale / 32767
    if unit == MILLINEWTON:
        return 1e-3 * axis.mechanism.ratio if axis.mechanism.kind == "linear" else None
    if unit in RATED_TORQUE_UNITS:
        return RATED_TORQUE_UNITS[unit]
    factors = [getattr(axis, key) for key in _NEEDED[unit]]
    return None if None in factors else math.prod(factors) * _SHARES[unit]


def is_current(unit: str) -> bool:
    """Return whether a torque of this unit is a current, so that the rig's torque constant scales it."""
    return "torque_constant" in _NEEDED.get(unit, ())


def needed_for(unit: str, axis: "RigAxis | None" = None) -> str:
    """Return the keys of a rig's axis from which a step of torque follows, in words; only those that `axis` lacks."""
    if unit in ABSOLUTE_TORQUE_UNITS:
        return "linear mechanism"
    return " and ".join(key for key in _NEEDED[unit] if axis is None or getattr(axis, key) is None)


def steps_per_revolution(unit: str, counts_per_revolution: int, metres_per_revolution: float = 0.0) -> float:
    """Return the number of position steps in one revolution of the motor; 0 for a length without a linear mechanism."""
    if unit in METRES:
        return metres_per_revolution / METRES[unit]
    return STEPS_PER_REVOLUTION.get(unit, counts_per_revolution)


def velocity_step(unit: str, counts_per_revolution: int) -> float:
    """Return one step of a velocity [rad/s]; a unit not in revolutions is taken as counts a second."""
    return 2 * math.pi * REVOLUTIONS_PER_SECOND.get(unit, 1 / counts_per_revolution)
