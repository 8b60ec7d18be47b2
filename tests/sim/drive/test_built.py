"""The bench as it is built, where it differs from the values of the axis; each value against a closed form."""

import math

import pytest

from haptic_fieldbus.drive.rig import Mechanics, RigAxis
from haptic_fieldbus.sim.drive.settings import DriveSettings, as_built, build_gains, build_plant
from haptic_fieldbus.sim.mechanics.body import Body
from tests.sim.bench import MS, DriveBench, axis, profile

STATED = {"inertia": 4e-5, "viscous_damping": 1e-4, "coulomb_friction": 2e-3, "encoder_counts_per_revolution": 4096}
TRUE = {"inertia": 9e-5, "viscous_damping": 4e-4, "coulomb_friction": 5e-3, "encoder_counts_per_revolution": 1024}
POSITION, TORQUE = 0x6064, 0x6077


def built(**true: float) -> RigAxis:
    """The axis with its stated values, and a bench that has others."""
    return axis(**STATED, simulation=Mechanics(**true))  # type: ignore[arg-type]


def plant(velocity: float = 0.0, **true: float) -> Body:
    return build_plant(profile(), built(**true), None, DriveSettings(velocity=velocity), 0)


def test_the_bench_has_each_given_value_and_else_those_of_the_axis() -> None:
    assert as_built(built()) == built()
    for key, value in TRUE.items():
        given = as_built(built(**{key: value}))
        assert {each: getattr(given, each) for each in STATED} == STATED | {key: value}


def test_a_bench_without_friction_is_no_bench_of_unknown_friction() -> None:
    assert as_built(built(coulomb_friction=0.0)).coulomb_friction == 0.0
    assert as_built(built(viscous_damping=0.0)).viscous_damping == 0.0


def test_viscous_damping_slows_the_shaft_exponentially() -> None:
    shaft = plant(velocity=30.0, viscous_damping=4e-4, coulomb_friction=0.0)
    shaft.advance(50 * MS)
    assert shaft.velocity == pytest.approx(30.0 * math.exp(-4e-4 / 4e-5 * 0.05), rel=1e-9)


def test_coulomb_friction_slows_the_shaft_by_the_same_in_every_millisecond() -> None:
    shaft = plant(velocity=30.0, viscous_damping=0.0, coulomb_friction=5e-3)
    shaft.advance(100 * MS)
    assert shaft.velocity == pytest.approx(30.0 - 5e-3 / 4e-5 * 0.1, rel=1e-9)


def test_a_shaft_that_states_no_inertia_has_the_true_one() -> None:
    loose = axis(**STATED | {"inertia": None}, simulation=Mechanics(inertia=9e-5, viscous_damping=0.0))  # type: ignore[arg-type]
    shaft = build_plant(profile(), loose, None, DriveSettings(velocity=30.0), 0)
    shaft.advance(100 * MS)
    assert shaft.velocity == pytest.approx(30.0 - 2e-3 / 9e-5 * 0.1, rel=1e-9)


@pytest.mark.parametrize("inertia", [1e-5, 9e-5])
def test_a_constant_torque_gives_the_acceleration_of_the_true_inertia(inertia: float) -> None:
    shaft = plant(inertia=inertia, viscous_damping=0.0, coulomb_friction=0.0)
    shaft.set_target(0.02)
    shaft.advance(100 * MS)
    lag = 1 / (2 * math.pi * profile().timing.torque_bandwidth)
    assert shaft.velocity == pytest.approx(0.02 / inertia * (0.1 - lag), rel=1e-9)


@pytest.mark.parametrize("bandwidth", [45.0, 3000.0])
def test_the_torque_follows_with_the_true_lag(bandwidth: float) -> None:
    shaft = plant(torque_bandwidth=bandwidth)
    shaft.set_target(0.1)
    shaft.advance(1 * MS)
    assert shaft.torque == pytest.approx(0.1 * -math.expm1(-2 * math.pi * bandwidth * 1e-3), rel=1e-9)


def test_loops_of_the_drive_are_tuned_on_the_bench_as_it_is() -> None:
    tuned = build_gains(profile(), built(inertia=9e-5, viscous_damping=4e-4, torque_bandwidth=45.0), 1e-3)
    assert (tuned.inertia, tuned.damping) == (9e-5, 4e-4)
    assert tuned.bandwidth == pytest.approx(1 / (4 * (1e-3 + 1 / (2 * math.pi * 45.0))))


# Counts and torque scale, as the drive shows them.


@pytest.mark.parametrize("counts", [1024, 4096, 65_536])
def test_the_encoder_counts_the_true_counts_and_the_drive_is_configured_with_those_of_the_axis(counts: int) -> None:
    bench = DriveBench(drive_axis=built(encoder_counts_per_revolution=counts), settings=DriveSettings(position=2.5))
    bench.drive.measure(0)
    assert bench.read(POSITION) == math.floor(2.5 * counts / (2 * math.pi) + 0.5)
    assert bench.read(0x608F, 1) == 4096


@pytest.mark.parametrize("counts", [1024, 4096])
def test_a_velocity_in_counts_is_that_of_the_true_counts(counts: int) -> None:
    bench = DriveBench(drive_axis=built(encoder_counts_per_revolution=counts), settings=DriveSettings(velocity=10.0))
    bench.drive.stage.show()
    shown = bench.drive.objects.velocity.value * abs(bench.drive.units.speed)
    assert shown == pytest.approx(10.0 * counts / 4096, rel=1e-2)


@pytest.mark.parametrize("scale", [0.25, 1.0, 4.0])
def test_the_motor_gives_its_share_of_the_torque_and_the_drive_shows_what_was_asked(scale: float) -> None:
    bench = DriveBench(drive_axis=built(torque_scale=scale, viscous_damping=0.0, coulomb_friction=0.0))
    bench.enable()
    bench.control(0x0F, 100)
    bench.run(50 * MS)
    bench.drive.measure(bench.t_ns)
    assert bench.drive.plant.torque == pytest.approx(scale * 0.04, rel=1e-9)
    assert bench.read(TORQUE) == 100
    lag = 1 / (2 * math.pi * profile().timing.torque_bandwidth)
    assert bench.drive.plant.velocity == pytest.approx(scale * 0.04 / 4e-5 * (0.05 - lag), rel=2e-2)


def test_a_motor_of_another_torque_that_turns_the_other_way_does_both() -> None:
    bench = DriveBench(drive_axis=built(torque_scale=0.5))
    bench.enable()
    bench.drive.servo.impair(math.inf, -1.0)
    bench.control(0x0F, 100)
    bench.run(50 * MS)
    bench.drive.measure(bench.t_ns)
    assert bench.drive.plant.torque == pytest.approx(-0.02, rel=1e-9)
    assert bench.read(TORQUE) == 100
