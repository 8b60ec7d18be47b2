"""One step of torque, from the unit of a drive and what a rig says of its motor."""

import pytest

from haptic_fieldbus.drive.rig import BusSection, RigAxis, RotaryMechanism
from haptic_fieldbus.drive.units import MILLIAMPERE, PERMILLE, needed_for, torque_step

MOTOR = {"rated_torque": 0.4, "torque_constant": 0.05}
CASES = [(PERMILLE, "rated_torque", 0.4e-3), (MILLIAMPERE, "torque_constant", 50e-6)]


def axis(**motor: float) -> RigAxis:
    return RigAxis("bus", 1, "drive", RotaryMechanism("rotary"), 4096, **motor)  # type: ignore[arg-type]


@pytest.mark.parametrize(("unit", "key", "step"), CASES)
def test_a_step_of_torque_follows_from_one_key_of_the_rig(unit: str, key: str, step: float) -> None:
    assert needed_for(unit) == key
    assert torque_step(unit, axis(**MOTOR)) == pytest.approx(step)
    others = {name: value for name, value in MOTOR.items() if name != key}
    assert torque_step(unit, axis(**others)) is None


def test_a_bus_whose_protocol_says_nothing_else_is_no_simulation() -> None:
    assert not BusSection("serial", "/dev/ttyUSB0").simulated
