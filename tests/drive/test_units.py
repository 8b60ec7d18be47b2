"""One step of torque, from the unit of a drive and what a rig says of its motor."""

import pytest

from haptic_fieldbus.drive.rig import (
    MILLIAMPERE,
    PEAK_SHARE,
    PEAK_SHARE_HIGH,
    PERMILLE,
    PERMILLE_OF_CURRENT,
    BusSection,
    RigAxis,
    RotaryMechanism,
    needed_for,
    torque_step,
)

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


@pytest.mark.parametrize(
    ("unit", "keys", "step"),
    [
        (PERMILLE_OF_CURRENT, {"rated_current": 8.0}, 8.0e-3 * 0.05),
        # Technosoft: 65520/(2·peak current) steps an ampere, in the high word of a set-point.
        (PEAK_SHARE, {"peak_current": 20.0}, 0.05 * 2 * 20.0 / 65520),
        (PEAK_SHARE_HIGH, {"peak_current": 20.0}, 0.05 * 2 * 20.0 / 65520 / 65536),
    ],
)
def test_a_share_of_a_current_needs_that_current_and_the_torque_constant(
    unit: str, keys: dict[str, float], step: float
) -> None:
    assert torque_step(unit, axis(**MOTOR, **keys)) == pytest.approx(step, rel=1e-12)
    (current,) = keys
    assert torque_step(unit, axis(**MOTOR)) is None
    assert needed_for(unit, axis(**MOTOR)) == current
    assert needed_for(unit, axis()) == f"{current} and torque_constant"


def test_a_bus_whose_protocol_says_nothing_else_is_no_simulation() -> None:
    assert not BusSection("serial", "/dev/ttyUSB0").simulated
    assert not BusSection("serial", "/dev/ttyUSB0").rehearsed
    assert BusSection("serial", "/dev/ttyUSB0").route == "serial:/dev/ttyUSB0"
