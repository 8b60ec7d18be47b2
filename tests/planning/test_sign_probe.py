"""Torque, length and travel of the pulses that show the sign."""

import math
from contextlib import nullcontext
from dataclasses import replace
from itertools import pairwise
from typing import Any

import pytest

from haptic_fieldbus.drive.rig import Limits, LinearMechanism, Permissions, RigAxis, Seen
from haptic_fieldbus.errors import PlanError, RigError
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.planning.request import Task
from haptic_fieldbus.planning.selection import load, select
from haptic_fieldbus.planning.sign_probe import SignProbe, is_checked, raising, sign_probe, sign_text
from haptic_fieldbus.protocols.catalogue import load_profile
from haptic_fieldbus.protocols.registry import protocol_named
from haptic_fieldbus.scenes.detents import Detents
from haptic_fieldbus.signals import Workspace
from tests.builders import PROFILE, VELOCITY_ONLY, WALL, plan_of, rig_of, scene_of, shipped

RATIO = 0.05 / (2.0 * math.pi)
RATED = 0.4 / RATIO
MASS, FRICTION = 4e-5 / RATIO**2, 2e-3 / RATIO


def planned(rate: float = 1000.0, **changes: Any) -> Plan:
    return plan_of(rate=rate, rig=rig_of(WALL, **({"seen": Seen()} | changes)))


def probe_of(plan: Plan) -> SignProbe:
    probe = sign_probe(plan.axes[0], plan.period)
    assert probe is not None
    return probe


def test_a_simulated_bench_whose_sign_was_seen_has_no_pulses() -> None:
    plan = planned(seen=Seen(sign="seen"))
    assert sign_probe(plan.axes[0], plan.period) is None
    assert not [step for step in plan.steps if step.startswith("sign")]


def test_on_a_real_bus_the_sign_is_looked_for_whatever_the_rig_says() -> None:
    rig = rig_of(WALL)
    assert all(axis.seen.sign for axis in rig.axis.values())
    real = replace(rig, bus={name: replace(bus, interface="socketcan") for name, bus in rig.bus.items()})
    assert probe_of(plan_of(rig=real)).stages


@pytest.mark.parametrize("counts", [24, 400, 1000, 2000, 4096])
def test_a_pulse_on_the_free_handle_is_worth_four_counts_and_no_period_more(counts: int) -> None:
    probe = probe_of(planned(encoder_counts_per_revolution=counts))
    first = probe.stages[0]
    assert first.effort == pytest.approx(2.0 / 3.0 * 0.05 * RATED, abs=RATED / 1000.0)

    def shown(periods: int) -> float:
        return (first.effort - FRICTION) / MASS * (periods * 1e-3) ** 2 / (0.05 / counts)

    assert shown(first.periods) >= 4.0 or first.periods == 100
    assert first.periods == 5 or shown(first.periods - 1) < 4.0
    assert probe.travel == pytest.approx(first.effort / MASS * (first.periods * 1e-3) ** 2), "as without friction"
    last = probe.stages[-1]
    assert probe.farthest == pytest.approx(last.effort / MASS * (last.periods * 1e-3) ** 2)


@pytest.mark.parametrize("rate", [1000.0, 250.0, 50.0])
def test_a_pulse_has_whole_periods_and_five_milliseconds_at_least(rate: float) -> None:
    probe = probe_of(planned(rate))
    assert all(stage.periods / rate >= 0.005 - 1e-12 for stage in probe.stages)
    assert probe.time == pytest.approx({1000.0: 0.09, 250.0: 0.144, 50.0: 0.72}[rate])


@pytest.mark.parametrize("friction", [0.0, 0.005, 0.0133, 0.018, 0.03, 0.2, 0.399])
def test_whatever_friction_is_told_no_pulse_is_above_the_bound(friction: float) -> None:
    probe = probe_of(planned(coulomb_friction=friction))
    assert 4.9 < probe.largest <= 5.0
    assert probe.largest <= 0.15 * RATED
    assert probe.stages[0].effort <= 2.0 / 3.0 * 0.05 * RATED
    assert probe.holding == pytest.approx(0.05 * RATED)


@pytest.mark.parametrize(
    ("permissions", "largest"),
    [
        (Permissions(), 5.0),
        (Permissions(sign_effort=3.0), 3.0),
        (Permissions(sign_effort=40.0), 0.15 * RATED),
        (Permissions(sign_pulse=0.3), 5.0),
        (Permissions(sign_pulse=0.3, sign_effort=40.0), 0.3 * RATED),
        (Permissions(sign_pulse=0.02), 0.02 * RATED),
    ],
)
def test_a_permission_of_its_own_moves_the_bound(permissions: Permissions, largest: float) -> None:
    probe = probe_of(planned(permissions=permissions))
    assert largest - RATED / 1000.0 < probe.largest <= largest + 1e-9
    assert probe.holding == pytest.approx(min(0.05 * RATED, largest), abs=RATED / 1000.0)


def test_more_than_30_percent_of_rated_torque_is_no_permission() -> None:
    bench = load(Task("wall")).rig
    for share, refused in ((0.3, False), (0.301, True)):
        axes = {name: replace(axis, permissions=Permissions(sign_pulse=share)) for name, axis in bench.axis.items()}
        with pytest.raises(RigError, match="sign_pulse") if refused else nullcontext():
            select(Task("wall", rig=replace(bench, axis=axes)))


def test_on_a_knob_the_bound_is_a_quarter_of_a_newton_metre() -> None:
    scene = scene_of(Detents("knob", 12.0, 0.1), workspace=Workspace.ROTARY)
    plan = plan_of(scene, rig=rig_of(scene, seen=Seen(), rated_torque=4.0))
    assert probe_of(plan).largest == pytest.approx(0.248), "a whole number of steps of 4 mN·m"


@pytest.mark.parametrize("effort", [None, 3.0, 0.4])
def test_pulses_grow_by_half_at_most_from_step_to_step(effort: float | None) -> None:
    probe = probe_of(planned(limits=Limits(effort=effort)))
    efforts = list(dict.fromkeys(stage.effort for stage in probe.stages))
    step = RATED / 1000.0
    assert efforts == sorted(efforts)
    assert all(after <= 1.5 * before + step for before, after in pairwise(efforts))
    assert all(each / step == pytest.approx(round(each / step)) for each in efforts)
    assert [stage.effort for stage in probe.stages[-3:]] == [probe.largest] * 3, "at the bound they become longer"


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({}, "raise axis.handle.permissions.sign_effort, now 5 N"),
        (
            {"permissions": Permissions(sign_effort=9.0)},
            "permissions.sign_pulse, now 0.15 of rated torque, to at most 0.3",
        ),
        ({"permissions": Permissions(0.3, 40.0)}, "pulses cannot exceed 30 % of rated torque"),
        ({"limits": Limits(effort=1.0)}, "pulses cannot exceed the limit of the axis, 1 N"),
    ],
)
def test_what_would_permit_more_is_named(changes: dict[str, Any], words: str) -> None:
    assert words in raising(planned(**changes).axes[0])


def test_friction_above_the_bound_is_told_before_anything_moves() -> None:
    plan = planned(coulomb_friction=0.1)
    told = sign_text(plan.axes[0], probe_of(plan))
    assert "friction in the rig (12.6 N) is not below the largest pulse" in told
    assert "sign_effort" in told
    free = planned()
    assert "friction" not in sign_text(free.axes[0], probe_of(free))


@pytest.mark.parametrize("friction", [0.4, 2.0])
def test_friction_that_leaves_nothing_of_rated_torque_is_refused(friction: float) -> None:
    with pytest.raises(PlanError, match=r"node 1: coulomb_friction \(.*\) must be below rated_torque \(0.4 N·m\)"):
        planned(coulomb_friction=friction)


def test_a_step_of_torque_above_the_bound_is_refused() -> None:
    with pytest.raises(PlanError, match=r"one step of target torque is 5.65 N at the handle, above the torque allowed"):
        planned(mechanism=LinearMechanism("linear", 0.05 / 112.5))
    known = planned(mechanism=LinearMechanism("linear", 0.05 / 112.5), seen=Seen(sign="seen"))
    assert known.axes[0].limits.before_sign == 0.0, "of a doubt while a scene runs"


def test_a_limit_of_more_steps_than_the_type_of_the_target_has_is_refused() -> None:
    """A torque constant a thousand times too small makes milliamperes of 8 N·m more than 16 bits hold."""
    amperes = replace(PROFILE.torque.target, unit="mA")
    profile = replace(PROFILE, torque=replace(PROFILE.torque, target=amperes, rated=None))
    words = (
        r"one step of target torque is 6.28 µN at the handle, and at most 32767 steps are possible: less than the limit"
    )
    rig = rig_of(WALL, torque_constant=5e-5, rated_current=None, limits=Limits(effort=20.0))
    with pytest.raises(PlanError, match=words):
        plan_of(rig=rig, profile=profile)


NOT_CHECKED = {"iris_orca", "maxon_epos2", "simplex_motion", "technosoft_ipos"}


@pytest.mark.parametrize("protocol", ["canopen", "modbus"])
def test_a_plan_says_of_which_drives_the_torque_cannot_be_checked(protocol: str) -> None:
    usable = [name for name in shipped(protocol) if load_profile(name).drive.usable]
    assert usable
    for name in usable:
        task = Task("wall", drive=name, bus=protocol_named(protocol).simulated_bus(load_profile(name)))
        rig = load(task).rig
        rig = replace(rig, axis={axis: replace(each, seen=Seen()) for axis, each in rig.axis.items()})
        plan = select(replace(task, rig=rig, drive=None)).plan
        (step,) = [step for step in plan.steps if step.startswith("sign: ")]
        assert is_checked(plan.axes[0]) is (name not in NOT_CHECKED)
        assert ("cannot be checked" in step) is (name in NOT_CHECKED)


@pytest.mark.parametrize("constant", [0.00005, 0.05, 1.0])
def test_a_drive_of_currents_gets_a_share_of_its_rated_current(constant: float) -> None:
    """Whatever the torque constant is said to be: 1000 steps are the rated current."""
    current = replace(PROFILE.torque.target, unit="permille_of_rated_current")
    profile = replace(PROFILE, torque=replace(PROFILE.torque, target=current, rated=None))
    plan = plan_of(rig=rig_of(WALL, seen=Seen(), torque_constant=constant), profile=profile)
    axis = plan.axes[0]
    assert axis.limits.effort <= 1000.0 * axis.effort_unit + 1e-9
    assert probe_of(plan).largest <= 150.0 * axis.effort_unit + 1e-9


def test_a_limit_of_the_rig_bounds_the_pulses_too() -> None:
    assert probe_of(planned(limits=Limits(effort=1.0))).largest <= 1.0


def test_an_unknown_inertia_begins_with_the_shortest_pulse_and_tells_no_travel() -> None:
    probe = probe_of(planned(inertia=None))
    assert (probe.stages[0].periods, probe.travel) == (5, None)
    assert [stage.periods for stage in probe.stages] == [5, 5, 5, 10, 20]
    assert probe.farthest is None
    assert "the travel of the handle is unknown" in sign_text(planned(inertia=None).axes[0], probe)


def test_a_drive_with_velocity_only_states_the_speed() -> None:
    rig = rig_of(WALL, seen=Seen())
    plan = plan_of(rig=rig, profile=VELOCITY_ONLY)
    probe = probe_of(plan)
    assert probe.speed
    assert probe.step == pytest.approx(0.05 / 600)
    first = probe.stages[0]
    assert (first.effort - FRICTION) / MASS * first.periods * 1e-3 >= 4.0 * probe.step
    (step,) = [step for step in plan.steps if step.startswith("sign: ")]
    assert "m/s" in step


def test_the_bench_of_a_rig_file_is_looked_at_unless_it_says_so() -> None:
    assert RigAxis.__dataclass_fields__["seen"].default_factory is Seen
    assert Seen().sign is None


def test_until_the_sign_is_seen_no_more_is_permitted_than_the_axis_may_have() -> None:
    plan = planned(limits=Limits(effort=1.0))
    assert probe_of(plan).holding == pytest.approx(1.0, abs=RATED / 1000.0)
    assert sign_text(plan.axes[0], probe_of(plan)).endswith("at most 0.955 N")
    assert probe_of(planned()).holding == pytest.approx(0.05 * RATED)
    strong = planned(rated_torque=4.0)
    assert 4.5 < probe_of(strong).holding <= 5.0, "5 % of rated torque are 25 N"
