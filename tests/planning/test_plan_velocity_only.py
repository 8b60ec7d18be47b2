"""Plans for drives that offer velocity only, and for those that offer it beside their position."""

import math
from dataclasses import replace

import numpy as np
import pytest

from haptic_fieldbus.cycle.safety import Trip, TripKind
from haptic_fieldbus.cycle.trips import trip_error
from haptic_fieldbus.drive.cia402 import VelocitySection
from haptic_fieldbus.drive.rig import LinearMechanism, RotaryMechanism
from haptic_fieldbus.errors import PlanError, RigError, SignalUnavailableError, UnstableSceneError
from haptic_fieldbus.numerics.sampled import TACHOMETER
from haptic_fieldbus.planning.compile import compile_plan
from haptic_fieldbus.planning.live_changes import plan_change
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.protocols.canopen.profile import CanopenProfile
from haptic_fieldbus.scenes.coupling import Coupling
from haptic_fieldbus.scenes.scene import Scene
from haptic_fieldbus.scenes.sprung_mass import SprungMass
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.signals import Signal, Workspace
from tests.builders import PROFILE, VELOCITY_ONLY, WALL, plan_of, rig_of, scene_of
from tests.cycle.test_cycle import Constant
from tests.margins.test_tachometer import Tachometer

DAMPED = scene_of(Wall("handle", stiffness=600.0, position=0.02, damping=2.0))
SPRUNG = scene_of(SprungMass("handle", stiffness=100.0, mass=0.5))
ESTIMATORS = "haptic_fieldbus.numerics.estimators"
BOTH = replace(PROFILE, velocity=VELOCITY_ONLY.velocity)


def in_unit(unit: str) -> CanopenProfile:
    assert VELOCITY_ONLY.velocity is not None
    return replace(VELOCITY_ONLY, velocity=VelocitySection(replace(VELOCITY_ONLY.velocity.actual, unit=unit)))


def reasons(plan: Plan) -> dict[str, str]:
    return {left.what: left.why for left in plan.left_out}


@pytest.mark.thorough("3 cases of one rule", quick=2)
@pytest.mark.parametrize("scene", [WALL, DAMPED, SPRUNG])
def test_the_velocity_is_mapped_in_the_place_of_the_position(scene: Scene) -> None:
    plan = plan_of(scene, profile=VELOCITY_ONLY)
    assert plan.mapped == (
        "6041h:00 statusword",
        "606Ch:00 velocity actual value",
        "6077h:00 torque actual value",
        "6040h:00 controlword",
        "6071h:00 target torque",
    )
    assert (plan.bus_load, plan.delay) == (plan_of(scene).bus_load, plan_of(scene).delay)
    assert "haptic_fieldbus.cycle.tachometer" in plan.modules
    assert ESTIMATORS not in plan.modules
    assert reasons(plan)["estimator"] == "the drive reports velocity itself"
    assert "velocity" not in reasons(plan)


def test_the_steps_say_how_the_position_comes_about_and_how_long_it_holds() -> None:
    position = next(step for step in plan_of(profile=VELOCITY_ONLY).steps if step.startswith("position"))
    assert position == ("position: velocity → m by the trapezoidal rule; trips when uncertain by 5 mm, after 120 s")


def test_a_drive_that_offers_both_has_its_position_mapped_and_is_told_why() -> None:
    plan = plan_of(DAMPED, profile=BOTH)
    assert (plan.mapped, plan.steps, plan.modules) == (
        plan_of(DAMPED).mapped,
        plan_of(DAMPED).steps,
        plan_of(DAMPED).modules,
    )
    assert "the filter of the drive is unknown" in reasons(plan)["606Ch:00 velocity actual value"]
    assert reasons(plan).items() >= reasons(plan_of(DAMPED)).items()


def test_a_named_estimator_changes_nothing_where_velocity_is_read() -> None:
    plain, named = (plan_of(DAMPED, profile=VELOCITY_ONLY, estimator=name) for name in (None, "low-pass"))
    assert named.axes[0].estimator == plain.axes[0].estimator == TACHOMETER
    assert named.steps == plain.steps


@pytest.mark.parametrize(
    ("unit", "step"),
    [
        ("rpm", 0.05 / 60),
        ("0.1 rpm", 0.05 / 600),
        ("0.01 rpm", 0.05 / 6000),
        ("0.001 rpm", 0.05 / 60000),
        ("counts/s", 0.05 / 4096),
    ],
)
def test_a_step_of_velocity_is_so_long_at_the_handle(unit: str, step: float) -> None:
    axis = plan_of(profile=in_unit(unit)).axes[0]
    assert axis.velocity_unit == pytest.approx(step)
    assert axis.plant is not None
    assert axis.plant.resolution == pytest.approx(step * 1e-3)


def test_a_step_of_velocity_on_a_geared_knob() -> None:
    scene = scene_of(Wall("knob", stiffness=1.0), workspace=Workspace.ROTARY)
    rig = rig_of(scene, mechanism=RotaryMechanism("rotary", gear_ratio=4.0, sign=-1))
    axis = plan_of(scene, rig=rig, profile=in_unit("rpm")).axes[0]
    assert axis.velocity_unit == pytest.approx(-2 * math.pi / 60 / 4)
    assert axis.limits.drift == pytest.approx(0.1 * 2 * math.pi / 4)


@pytest.mark.parametrize(("scene", "damping"), [(WALL, 0.0), (DAMPED, 2.0)])
def test_stability_is_judged_as_the_loop_by_hand_does(scene: Scene, damping: float) -> None:
    axis = plan_of(scene, profile=VELOCITY_ONLY).axes[0]
    assert axis.stability is not None
    assert axis.plant is not None
    limit = axis.stability.stiffness_limit.stable
    assert limit is not None
    grows = [Tachometer(axis.plant, axis.delay.transport, part * limit, damping).growth() for part in (0.99, 1.0, 1.01)]
    assert grows[0] < 1.0 < grows[2]
    assert grows[1] == pytest.approx(1.0, abs=1e-7)
    own = Tachometer(axis.plant, axis.delay.transport, 600.0, damping).period_map()
    modes = np.abs(np.linalg.eigvals(own))
    assert np.abs(modes - axis.stability.spectral_radius).min() < 1e-9


def test_an_unknown_bench_is_planned_without_a_verdict() -> None:
    plan = plan_of(rig=rig_of(WALL, inertia=None), profile=VELOCITY_ONLY)
    assert (plan.stability, plan.axes[0].plant) == (None, None)


def test_a_zero_at_an_encoder_count_is_refused_with_file_and_key() -> None:
    rig = replace(rig_of(WALL, mechanism=LinearMechanism("linear", 0.05, zero=1000)), source="bench.toml")
    with pytest.raises(RigError, match=r'bench.toml.*axis.handle.mechanism.zero: 1000; expected "start".*test drive'):
        plan_of(rig=rig, profile=VELOCITY_ONLY)


def test_a_drive_without_either_is_an_error_naming_who_asks_signal_and_drive() -> None:
    with pytest.raises(SignalUnavailableError, match=r"position check on axis handle needs position.*test drive"):
        plan_of(profile=replace(PROFILE, position=None))


def test_what_a_scene_asks_for_besides_is_mapped_or_refused_as_ever() -> None:
    scene = scene_of(Constant("handle", 0.0, needs=(Signal.VELOCITY, Signal.TORQUE_ACTUAL)))
    assert plan_of(scene, profile=VELOCITY_ONLY).mapped[2] == "6077h:00 torque actual value"
    without = replace(VELOCITY_ONLY, torque=replace(VELOCITY_ONLY.torque, actual=None))
    with pytest.raises(SignalUnavailableError, match=r"constant on axis handle needs torque actual.*test drive"):
        plan_of(scene, profile=without)


def test_the_drift_trip_says_what_happened_and_what_to_do() -> None:
    trip = Trip(TripKind.DRIFT, "handle", 2_000_000_000, 0.00501, 0.005)
    assert str(trip_error(trip, plan_of(profile=in_unit("rpm")), 1_000_000_000)) == (
        "Tripped 1.000 s after enabling: position uncertain by 0.00501 m, above the limit of 0.005 m: test drive "
        "reports only velocity, rounded to 0.000833 m/s, and the rounding errors add up; torque is off. Restart with "
        "the handle at its zero, or raise axis.handle.limits.drift."
    )


def test_a_coupling_is_refused_because_the_position_drifts_against_the_other() -> None:
    walls = scene_of(Wall("left", 600.0), Wall("right", 600.0))
    scene = replace(walls, elements=(*walls.elements, Coupling(("left", "right"), 200.0)))
    with pytest.raises(PlanError, match=r"coupling couples axis left, .*test drive reports velocity only.*drifts"):
        plan_of(scene, profile=VELOCITY_ONLY)


def mixed() -> Plan:
    """An axis with an encoder beside one without; both need velocity."""
    scene = scene_of(Wall("left", 600.0, damping=2.0, name="one"), Wall("right", 600.0, damping=2.0, name="two"))
    rig = rig_of(scene)
    other = replace(rig.axis["right"], profile="other")
    profiles = {PROFILE.name: PROFILE, "other": replace(VELOCITY_ONLY, name="other")}
    return compile_plan(scene, replace(rig, axis={**rig.axis, "right": other}), profiles, 1000.0)


def test_an_axis_with_an_encoder_beside_one_without_keeps_its_estimator() -> None:
    plan = mixed()
    assert [axis.estimator for axis in plan.axes] == ["backward-difference", TACHOMETER]
    assert {ESTIMATORS, "haptic_fieldbus.cycle.tachometer"} <= set(plan.modules)
    assert "estimator" not in reasons(plan)


def test_a_change_of_the_running_scene_keeps_both_as_they_are() -> None:
    plan = mixed()
    changed = plan_change(plan, plan, {"two.stiffness": 700.0}).plan
    assert [axis.estimator for axis in changed.axes] == [axis.estimator for axis in plan.axes]
    with pytest.raises(UnstableSceneError):
        plan_change(plan, plan, {"two.stiffness": 5000.0})
