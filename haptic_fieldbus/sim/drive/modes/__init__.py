"""The modes of operation of the simulated drive, one file for each group."""

from collections.abc import Callable
from functools import partial

from haptic_fieldbus.sim.drive.modes.homing import Homing
from haptic_fieldbus.sim.drive.modes.mode import Mode
from haptic_fieldbus.sim.drive.modes.position import CyclicPosition, ProfilePosition
from haptic_fieldbus.sim.drive.modes.torque import CyclicTorque, OwnTorque, ProfileTorque
from haptic_fieldbus.sim.drive.modes.velocity import CyclicVelocity, ProfileVelocity
from haptic_fieldbus.sim.drive.objects import (
    CYCLIC_POSITION,
    CYCLIC_TORQUE,
    CYCLIC_VELOCITY,
    HOMING,
    NO_MODE,
    PROFILE_POSITION,
    PROFILE_TORQUE,
    PROFILE_VELOCITY,
    Objects,
)
from haptic_fieldbus.sim.drive.stage import Stage

# The modes of operation of a drive, by their number in 6060h.


def build_modes(stage: Stage, objects: Objects, failed: Callable[[int], None]) -> dict[int, Mode]:
    """Return the modes that the drive offers, and the mode for 0; a manufacturer's torque mode works as the cyclic one.

    `failed` is called with the time [ns] when a following error occurs.
    """
    kinds: dict[int, Callable[[Stage, Objects], Mode]] = {
        # Only the modes with a position demand have a following error to report.
        PROFILE_POSITION: partial(ProfilePosition, failed=failed),
        CYCLIC_POSITION: partial(CyclicPosition, failed=failed),
        PROFILE_VELOCITY: ProfileVelocity,
        PROFILE_TORQUE: ProfileTorque,
        HOMING: Homing,
        CYCLIC_VELOCITY: CyclicVelocity,
        CYCLIC_TORQUE: CyclicTorque,
    }
    modes = {number: kinds.get(number, OwnTorque)(stage, objects) for number in objects.modes}
    return modes | {NO_MODE: Mode(stage)}
