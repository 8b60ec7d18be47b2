"""A simulated drive whose profile names a unit of velocity, and one that offers velocity only."""

import math
from dataclasses import replace

import pytest

from haptic_fieldbus.drive.cia402 import MappedObject, VelocitySection
from haptic_fieldbus.drive.objects import DataType
from haptic_fieldbus.protocols.canopen.profile import CanopenProfile
from haptic_fieldbus.sim.drive.settings import DriveSettings
from tests.sim.bench import MS, DriveBench, axis, profile
from tests.sim.drive.sentences import read

PROFILE_VELOCITY, ENABLE = 3, (0x06, 0x07, 0x0F)


def measured(unit: str, *, position: bool = True) -> CanopenProfile:
    velocity = VelocitySection(MappedObject(0x606C, DataType.INT32, unit=unit))
    return replace(profile(), velocity=velocity, position=profile().position if position else None)


def turning(unit: str, speed: float, *, position: bool = True) -> DriveBench:
    """The shaft turns freely, with so many rad/s."""
    free = axis(viscous_damping=0.0, coulomb_friction=0.0)
    return DriveBench(measured(unit, position=position), free, settings=DriveSettings(velocity=speed))


@pytest.mark.parametrize(
    ("unit", "per_turn"),
    [("rpm", 60.0), ("0.1 rpm", 600.0), ("0.01 rpm", 6_000.0), ("0.001 rpm", 60_000.0), ("counts/s", 4096.0)],
)
@pytest.mark.parametrize("turns", [2.0083, -2.0083, 0.0])
def test_606ch_shows_the_speed_of_the_shaft_rounded_to_its_unit(unit: str, per_turn: float, turns: float) -> None:
    bench = turning(unit, 2 * math.pi * turns)
    assert read(bench, 0x606C) == round(turns * per_turn)


def test_a_target_velocity_is_in_the_same_unit() -> None:
    bench = DriveBench(measured("rpm"))
    bench.operational()
    assert bench.write(0x6060, 0, PROFILE_VELOCITY, "b") is None
    assert bench.write(0x60FF, 0, 120, "i") is None
    for word in ENABLE:
        assert bench.write(0x6040, 0, word, "H") is None
    bench.run(1000 * MS)
    assert read(bench, 0x606C) == pytest.approx(120, abs=1)
    assert bench.drive.plant.velocity == pytest.approx(4 * math.pi, rel=0.01)


def test_the_profile_velocity_after_power_on_is_the_same_speed_in_any_unit() -> None:
    speeds = [read(DriveBench(measured(unit)), 0x6081) / turn for unit, turn in (("rpm", 60), ("counts/s", 4096))]
    assert speeds[0] == pytest.approx(speeds[1], rel=0.01)


def test_a_drive_that_offers_velocity_only_shows_no_position() -> None:
    bench = turning("rpm", 2 * math.pi, position=False)
    assert bench.read(0x606C) == 60
    assert 0x6064 not in bench.drive.dictionary
    assert 0x6064 in turning("rpm", 0.0).drive.dictionary


def test_its_second_tpdo_carries_the_velocity_after_power_on() -> None:
    bench = turning("rpm", 0.0, position=False)
    assert [bench.read(0x1A01, subindex) for subindex in (1, 2)] == [0x6041_0010, 0x606C_0020]
