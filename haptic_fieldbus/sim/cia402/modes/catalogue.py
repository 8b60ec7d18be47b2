"""The modes of operation that a drive has, by their number in 6060h."""

from collections.abc import Callable

from haptic_fieldbus.sim.cia402.modes.homing import Homing
from haptic_fieldbus.sim.cia402.modes.mode import Mode
from haptic_fieldbus.sim.cia402.modes.position import CyclicPosition, ProfilePosition
from haptic_fieldbus.sim.cia402.modes.torque import CyclicTorque, ProfileTorque
from haptic_fieldbus.sim.cia402.modes.velocity import CyclicVelocity, ProfileVelocity
from haptic_fieldbus.sim.cia402.object_table import (
    CYCLIC_POSITION,
    CYCLIC_VELOCITY,
    HOMING,
    PROFILE_POSITION,
    PROFILE_TORQUE,
    PROFILE_VELOCITY,
)
from haptic_fieldbus.sim.cia402.objects import NO_MODE, Objects
from haptic_fieldbus.sim.cia402.stage import Stage


def build_modes(stage: Stage, objects: Objects, failed: Callable[[int], None]) -> dict[int, Mode]:
    """One of each that the drive offers, and no mode; a manufacturer's torque mode works as the cyclic one does."""

    def build(number: int) -> Mode:
        if number in (PROFILE_POSITION, CYCLIC_POSITION):
            position = ProfilePosition if number == PROFILE_POSITION else CyclicPosition
            return position(stage, objects, failed)
        return others.get(number, CyclicTorque)(stage, objects)

    others: dict[int, Callable[[Stage, Objects], Mode]] = {
        PROFILE_VELOCITY: ProfileVelocity,
        PROFILE_TORQUE: ProfileTorque,
        HOMING: Homing,
        CYCLIC_VELOCITY: CyclicVelocity,
    }
    return {NO_MODE: Mode(stage)} | {number: build(number) for number in sorted(objects.modes)}
