"""A simulated drive whose profile or file names units of position and velocity, and one that offers velocity only."""

import math
from dataclasses import replace

import pytest

from haptic_fieldbus.drive.cia402 import MappedObject, PositionSection, VelocitySection, WrittenObject
from haptic_fieldbus.drive.profile import DataType
from haptic_fieldbus.eds import EdsType
from haptic_fieldbus.protocols.canopen.from_eds import profile_from_eds
from haptic_fieldbus.protocols.canopen.profile import CanopenProfile, SetupSection
from haptic_fieldbus.sim.drive.settings import DriveSettings
from tests.eds.sheets import changed, generic
from tests.sim.bench import MS, DriveBench, Refusal, axis, profile
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


@pytest.mark.parametrize("writes", [(), (WrittenObject(0x60A8, DataType.UINT32, 0xFF41_0000),)])
def test_6064h_is_in_the_unit_of_a_profile_that_describes_no_60a8h(writes: tuple[WrittenObject, ...]) -> None:
    unit = PositionSection(MappedObject(0x6064, DataType.INT32, unit="0.1 deg"))
    described = replace(profile(), position=unit, setup=SetupSection(writes))
    free = axis(viscous_damping=0.0, coulomb_friction=0.0)
    bench = DriveBench(described, free, settings=DriveSettings(velocity=4 * math.pi))
    for each in writes:
        assert bench.write(each.object, each.subindex, each.value, "I") is None
    bench.run(1000 * MS)
    assert read(bench, 0x6064) == pytest.approx(7200, abs=1)


def of_a_file(speed: float = 0.0, **codes: int) -> DriveBench:
    """The drive of a vendor's file with these values of 60A8h (`position`) and 60A9h (`velocity`)."""
    eds = generic()
    for name, code in codes.items():
        eds = changed(eds, {"position": 0x60A8, "velocity": 0x60A9}[name], type=EdsType.UNSIGNED32, default=code)
    free = axis(viscous_damping=0.0, coulomb_friction=0.0)
    return DriveBench(profile_from_eds(eds), free, settings=DriveSettings(velocity=speed))


class TestUnitsOfAFile:
    """60A8h and 60A9h by the notation of CiA 303-2: prefix, numerator, denominator, 0."""

    @pytest.mark.parametrize(
        ("code", "per_turn"),
        [
            (0x00B4_4700, 60.0),
            (0xFDB4_4700, 60_000.0),
            (0x00B4_0300, 1.0),
            (0xFD10_0300, 2000.0 * math.pi),
            (0x00B5_0300, 4096.0),
            (0x0000_3131, 4096.0),
        ],
        ids=["r/min", "0.001 r/min", "r/s", "mrad/s", "counts/s", "unknown"],
    )
    def test_606ch_is_in_the_unit_of_60a9h(self, code: int, per_turn: float) -> None:
        assert read(of_a_file(2 * math.pi * -7.3, velocity=code), 0x606C) == round(-7.3 * per_turn)

    def test_60a9h_can_be_written_and_unknown_units_are_refused(self) -> None:
        bench = of_a_file(4 * math.pi, velocity=0x00B4_4700)
        assert bench.write(0x60A9, 0, 0xFFB4_4700, "I") is None
        assert read(bench, 0x606C) == 1200
        assert bench.write(0x60A9, 0, 0x0001_0300, "I") == Refusal(0x0609_0030)
        assert read(bench, 0x606C) == 1200

    @pytest.mark.parametrize(("code", "per_turn"), [(0xFF41_0000, 3600), (0x00B5_0000, 4096), (0, 4096)])
    def test_6064h_is_in_the_unit_of_60a8h(self, code: int, per_turn: int) -> None:
        bench = of_a_file(2 * math.pi * 2.0, position=code)
        bench.run(1000 * MS)
        assert read(bench, 0x6064) == pytest.approx(2 * per_turn, abs=1)

    def test_the_profile_velocity_after_power_on_is_the_same_speed_in_any_unit(self) -> None:
        turns = read(of_a_file(velocity=0x00B4_4700), 0x6081) / 60
        assert turns == pytest.approx(read(of_a_file(velocity=0x00B5_0300), 0x6081) / 4096, rel=0.01)

    def test_a_target_velocity_is_in_the_unit_of_60a9h(self) -> None:
        bench = of_a_file(velocity=0x00B4_4700)
        bench.operational()
        assert bench.write(0x6060, 0, PROFILE_VELOCITY, "b") is None
        assert bench.write(0x60FF, 0, 120, "i") is None
        for word in ENABLE:
            assert bench.write(0x6040, 0, word, "H") is None
        bench.run(1000 * MS)
        assert bench.drive.plant.velocity == pytest.approx(4 * math.pi, rel=0.01)
