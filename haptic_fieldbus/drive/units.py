"""Units of a drive's values, as named in profiles: the size of one step, in SI at the motor shaft."""

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from haptic_fieldbus.drive.rig import RigAxis

PERMILLE, MILLIAMPERE = "permille_of_rated_torque", "mA"
TORQUE_UNITS = (PERMILLE, MILLIAMPERE)
RATED_TORQUE_UNITS = {"µN·m": 1e-6, "mN·m": 1e-3, "N·m": 1.0}
"""Unit of the rated torque → size of one step [N·m]."""
COUNTS, TENTH_DEGREE = "counts", "0.1 deg"
STEPS_PER_REVOLUTION = {"mrad": 2e3 * math.pi, TENTH_DEGREE: 3600.0}
"""Unit of a position that is none of the encoder → number of steps in one revolution of the motor."""
COUNTS_PER_SECOND = "counts/s"
REVOLUTIONS_PER_SECOND = {"rpm": 1 / 60, "0.1 rpm": 1 / 600, "0.01 rpm": 1 / 6_000, "0.001 rpm": 1 / 60_000}
"""Unit of a velocity (CiA 402-2, 60A9h) → size of one step in revolutions of the motor a second."""
VELOCITY_UNITS = (*REVOLUTIONS_PER_SECOND, COUNTS_PER_SECOND)


def torque_step(unit: str, axis: "RigAxis") -> float | None:
    """Return one step of torque [N·m]; None when the rig lacks the value that it follows from (`needed_for`)."""
    if unit == MILLIAMPERE:
        return None if axis.torque_constant is None else 1e-3 * axis.torque_constant
    return None if axis.rated_torque is None else axis.rated_torque / 1000.0  # ‰ of rated torque


def needed_for(unit: str) -> str:
    """Return the key of a rig's axis from which a step of torque follows."""
    return "torque_constant" if unit == MILLIAMPERE else "rated_torque"


def steps_per_revolution(unit: str, counts_per_revolution: int) -> float:
    """Return the number of position steps in one revolution of the motor."""
    return STEPS_PER_REVOLUTION.get(unit, counts_per_revolution)


def velocity_step(unit: str, counts_per_revolution: int) -> float:
    """Return one step of a velocity [rad/s]; a unit not in revolutions is taken as counts a second."""
    return 2 * math.pi * REVOLUTIONS_PER_SECOND.get(unit, 1 / counts_per_revolution)
