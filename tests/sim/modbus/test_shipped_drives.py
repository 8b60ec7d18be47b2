"""The shipped Modbus drives in simulation, commanded by their makers' own sequences, numbers and word orders.

Addresses and values here are those of the manuals and of the makers' code that the profiles name as their sources, not
read from the profiles: a profile that says something else shows here.
"""

import math
from dataclasses import replace

import pytest

from haptic_fieldbus.drive.rig import default_axis
from haptic_fieldbus.protocols.catalogue import load_profile, profile_names
from haptic_fieldbus.protocols.modbus.profile import ModbusProfile, modbus_profile
from haptic_fieldbus.signals import Workspace
from haptic_fieldbus.sim.drive.power import State
from haptic_fieldbus.sim.drive_on_bus import DriveOnBus
from haptic_fieldbus.sim.modbus.unit import Unit
from tests.sim.modbus.units import Driven, signed

METRES_PER_RADIAN = 0.05 / (2.0 * math.pi)
"""Of the shipped bench, a linear one."""


def profile(name: str) -> ModbusProfile:
    return modbus_profile(load_profile(name))


def usable() -> list[str]:
    """All shipped Modbus drives that can render force."""
    found = [load_profile(name) for name in profile_names()]
    return [each.name for each in found if each.drive.protocol == "modbus" and each.drive.usable]


@pytest.mark.parametrize("name", usable())
def test_every_register_of_a_profile_is_there(name: str) -> None:
    drive = Driven(profile(name))
    for register in profile(name).registers().values():
        words = drive.read(register.address, register.count)
        assert isinstance(words, list), register
        assert len(words) == register.count


def torque_of(drive: Driven) -> float:
    """The target that the motor is given [N·m]."""
    drive.unit.drive.measure(drive.t_ns)
    return drive.unit.drive.servo._target


def test_a_simplex_follows_its_target_in_mode_40() -> None:
    """Manual 02e: registers 400 (mode), 450/451 (target, ±32767 is the full torque of 2 N·m), 200/201 (position)."""
    drive = Driven(profile("simplex_motion"), hand="push")
    drive.write(449, 0, 3277)
    assert torque_of(drive) == 0.0
    assert drive.write(399, 40) is None
    drive.write(449, 0, 3277)
    drive.wait(1.0)
    assert torque_of(drive) == pytest.approx(0.2, rel=1e-3)
    drive.wait(20.0)
    words = drive.read(199, 2)
    assert isinstance(words, list)
    angle = drive.unit.drive.plant.state[0]
    assert signed(words) == pytest.approx(4096 * angle / (2 * math.pi), abs=1.0) != 0
    assert drive.value(202) == pytest.approx(200, abs=1), "measured torque in mN·m"
    drive.write(399, 0)
    assert (drive.value(399), torque_of(drive)) == (0, 0.0)


def test_an_orca_gives_the_force_of_its_registers_low_word_first() -> None:
    """Vendor's SDK: CTRL_REG_3 (3) = 2 is force mode, told by 317; FORCE_CMD 28/29 in mN; SHAFT_POS_UM 342/343."""
    drive = Driven(profile("iris_orca"), hand="push")
    assert drive.value(317) == 1
    assert drive.write(3, 2) is None
    assert drive.value(317) == 2
    drive.write(28, 5000, 0)
    drive.wait(1.0)
    assert torque_of(drive) == pytest.approx(5.0 * METRES_PER_RADIAN, rel=1e-3)
    drive.wait(20.0)
    words = drive.read(342, 2)
    assert isinstance(words, list)
    micrometres = 1e6 * METRES_PER_RADIAN * drive.unit.drive.plant.state[0]
    step = 1e6 * METRES_PER_RADIAN * 2.0 * math.pi / 4096
    assert signed(words[::-1]) == pytest.approx(micrometres, abs=step)
    drive.write(3, 1)
    assert (drive.value(317), torque_of(drive)) == (1, 0.0)


def test_an_ezmotion_is_enabled_as_in_its_maker_s_example() -> None:
    """Vendor's Python package: 6400h controlword, 6600h mode 4, 6710h target in ‰, 6640h position low word first."""
    drive = Driven(profile("ezmotion_mms"), hand="push")
    drive.write(0x6400, 0x0006)
    drive.write(0x6600, 4)
    drive.write(0x6710, 100)
    drive.write(0x6400, 0x0007)
    drive.write(0x6400, 0x000F)
    assert drive.state() is State.OPERATION_ENABLED
    # Mode 4 is profile torque: it goes to its target by the slope 6087h.
    drive.wait(20.0)
    assert torque_of(drive) == pytest.approx(0.04, rel=1e-3)
    words = drive.read(0x6640, 2)
    assert isinstance(words, list)
    assert signed(words[::-1]) > 0
    drive.write(0x6400, 0x0006)
    assert torque_of(drive) == 0.0


def test_a_position_in_metres_needs_a_mechanism_that_goes_straight() -> None:
    axis = default_axis(Workspace.LINEAR, bus="bus", node=1, profile="iris_orca")
    fine = replace(axis, encoder_counts_per_revolution=1_000_000)
    unit = Unit(DriveOnBus(1, profile("iris_orca"), fine))
    assert unit.drive.units.position(1_000_000) == 50_000  # one revolution is 0.05 m
