"""Delays of rig and profile in a plan, and their ranges; a bench with a compliant coupling."""

import math
from dataclasses import replace
from typing import Any

import pytest

from haptic_fieldbus.api import plan
from haptic_fieldbus.drive.profile import DriveProfile
from haptic_fieldbus.drive.rig import CompliantCoupling, Mechanics, Rig, default_axis
from haptic_fieldbus.errors import UnstableSceneError, UsageError
from haptic_fieldbus.margins import Basis, Plant
from haptic_fieldbus.margins.bodies import HungBody, limit_with
from haptic_fieldbus.margins.plant import COUPLING_SHARES
from haptic_fieldbus.planning.axis_plan import has_shipped_values
from haptic_fieldbus.planning.compile import compile_plan, ranges_of
from haptic_fieldbus.planning.explain import margin_text, nominal_texts, passive_to, up_to, verdict_texts
from haptic_fieldbus.planning.live_changes import plan_change
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.planning.refusal import above_limit, check_stable
from haptic_fieldbus.planning.request import Task
from haptic_fieldbus.planning.selection import select
from haptic_fieldbus.protocols.canopen.bus import CanSection
from haptic_fieldbus.protocols.catalogue import load_profile
from haptic_fieldbus.protocols.registry import parse_bus, protocol_named
from haptic_fieldbus.protocols.traffic import ADAPTER_LATENCY, JITTER
from haptic_fieldbus.scenes.catalogue import load_scene
from haptic_fieldbus.signals import Workspace
from tests.loops import PERIOD, wall

SIMULATED, REAL = CanSection("haptic_sim", "sim"), CanSection("socketcan", "can0")
ARRIVAL, TICK = 0.277e-3, 0.4e-3
"""[s], of the EPOS4: when a set-point arrives, and the control period."""
PROFILE = load_profile("maxon_epos4")


def planned(section: CanSection, mechanics: Mechanics | None = None, **timing: object) -> Plan:
    axis = default_axis(Workspace.LINEAR, bus="b", node=1, profile="p")
    axis = replace(axis, simulation=mechanics or Mechanics())
    profile: DriveProfile = replace(PROFILE, timing=replace(PROFILE.timing, **timing))  # type: ignore[arg-type]
    return compile_plan(load_scene("wall"), Rig({"b": section}, {"handle": axis}), {"p": profile}, 1000.0)


@pytest.mark.parametrize(
    ("section", "timing", "transport", "longest"),
    [
        (SIMULATED, {}, TICK, ARRIVAL + 2 * TICK),
        (SIMULATED, {"control_tick": "sync"}, TICK, 2 * TICK),
        (SIMULATED, {"control_tick": "sync", "encoder_latency": 0.1e-3}, TICK + 0.1e-3, TICK + 0.1e-3),
        (SIMULATED, {"control_tick": "free"}, ARRIVAL + TICK, ARRIVAL + 2 * TICK),
        (SIMULATED, {"encoder_latency": 0.1e-3}, TICK + 0.1e-3, ARRIVAL + 2 * TICK + 0.1e-3),
        (replace(SIMULATED, adapter_latency=0.1e-3), {}, 2 * TICK, ARRIVAL + 0.2e-3 + 2 * TICK),
        (replace(SIMULATED, jitter=0.05e-3), {}, TICK, ARRIVAL + 0.05e-3 + 2 * TICK),
        (REAL, {}, TICK, ARRIVAL + 2 * ADAPTER_LATENCY + JITTER + 2 * TICK),
        (replace(REAL, adapter_latency=0.0, jitter=0.0), {}, TICK, ARRIVAL + 2 * TICK),
    ],
)
def test_what_is_stated_is_planned_and_what_is_not_counts_in_the_longest_delay(
    section: CanSection, timing: dict[str, object], transport: float, longest: float
) -> None:
    delay = planned(section, None, **timing).axes[0].delay
    assert delay.transport == pytest.approx(transport)
    assert delay.longest == pytest.approx(longest)
    assert delay.range[0] <= delay.transport <= delay.range[1]


@pytest.mark.parametrize(("source", "shares"), [("ASSUMED: usual", (1 / 2.0, 1 / 0.3)), ("manual", (1 / 1.4, 1 / 0.7))])
def test_an_assumed_bandwidth_has_the_wider_range(source: str, shares: tuple[float, float]) -> None:
    profile = replace(PROFILE, sources={"timing.torque_bandwidth": source})
    (axis,) = planned(SIMULATED).axes
    stated = replace(axis.bench, basis=Basis.STATED)
    lags = ranges_of(profile, axis.delay, stated, compliant=False).torque_lag
    assert lags == pytest.approx(tuple(share * profile.torque_lag for share in shares))


@pytest.mark.thorough("2 cases of one rule", quick=1)
@pytest.mark.parametrize("stiffness", [0.02, 1.0])
def test_a_compliant_coupling_is_judged_as_one(stiffness: float) -> None:
    coupling = CompliantCoupling(stiffness=stiffness, load_inertia=3e-5, damping=1e-6)
    (axis,) = planned(SIMULATED, Mechanics(coupling=coupling)).axes
    assert axis.stability is not None
    assert axis.plant is not None
    assert axis.group is not None
    ratio = axis.rig.mechanism.ratio
    motor = Plant(1e-5 / ratio**2, axis.plant.damping, torque_lag=axis.plant.torque_lag)
    load = HungBody(3e-5 / ratio**2, stiffness / ratio**2, 1e-6 / ratio**2)
    expected = limit_with(motor, [load], PERIOD, axis.delay.transport, wall)
    assert axis.stability.stiffness_limit.stable == pytest.approx(expected, rel=1e-8)
    least = axis.group.limit_over_ranges()
    assert 0.0 < least.value < expected
    (at,) = least.judged_at
    body = replace(load, mass=load.mass * at.plant.mass / motor.mass, stiffness=at.coupling * load.stiffness)
    assert at.coupling in COUPLING_SHARES
    worst = limit_with(replace(at.plant, coulomb=0.0), [body], PERIOD, at.delay, wall)
    assert least.value == pytest.approx(worst, rel=1e-5)


def test_a_rigid_shaft_has_no_coupling_to_vary() -> None:
    stability = plan("wall").stability
    assert stability is not None
    assert [each.coupling for each in stability.limit.judged_at] == [1.0]


def test_the_defaults_change_nothing_that_was_planned_before() -> None:
    assert (PROFILE.timing.control_tick, PROFILE.timing.encoder_latency) == ("unknown", None)
    assert plan("wall").axes[0].delay.transport == pytest.approx(TICK)


BUSES = {
    "socketcan:can0@500000": "sim",
    "modbus-tcp:10.0.0.1": "sim",
    "modbus-rtu:/dev/ttyUSB0@115200": "sim-modbus-rtu@115200",
}


@pytest.mark.parametrize("bus", BUSES)
def test_a_rig_has_the_same_limit_on_the_simulated_bus_in_the_place_of_its_own(bus: str) -> None:
    section: Any = parse_bus(bus).section
    axis = default_axis(Workspace.LINEAR, bus="b", node=1, profile=protocol_named(section.protocol).default_drive)
    axis = replace(axis, limits=replace(axis.limits, effort=5.0))
    rig = Rig({"b": section}, {"handle": axis}, source="rig.toml")
    own, simulated = plan("wall", rig).stability, plan("wall", rig, bus=BUSES[bus]).stability
    assert own is not None
    assert simulated is not None
    assert (simulated.to_json(), simulated.limit.basis) == (own.to_json(), Basis.STATED)
    ideal = plan("wall", replace(rig, bus={"b": replace(section, jitter=0.0)})).stability
    assert ideal is not None
    assert ideal.limit.value > own.limit.value, "the host of a real bus may be late, and its simulation counts it"


def test_values_of_a_bench_are_exact_on_the_shipped_simulated_one_alone() -> None:
    axis = default_axis(Workspace.LINEAR, bus="b", node=1, profile="p")
    shipped = Rig({"b": SIMULATED}, {"handle": axis})
    assert has_shipped_values(shipped, "handle")
    others = (
        replace(shipped, source="rig.toml"),
        replace(shipped, bus={"b": REAL}),
        replace(shipped, axis={"handle": replace(axis, inertia=5.0e-5)}),
    )
    assert not any(has_shipped_values(rig, "handle") for rig in others)


def refused(section: CanSection, stiffness: float) -> str:
    """The refusal of a run on this bus; empty where it would begin."""
    axis = default_axis(Workspace.LINEAR, bus="b", node=1, profile="maxon_epos4")
    try:
        check_stable(plan("wall", Rig({"b": section}, {"handle": axis}), settings={"wall.stiffness": stiffness}))
    except UnstableSceneError as error:
        return str(error)
    return ""


def test_a_real_bus_refuses_from_the_limit_on_and_a_simulated_one_from_where_the_loop_is_unstable() -> None:
    limit = "exceeds the limit of 291 N/m (damping stated, not measured) on this bench"
    assert refused(REAL, 291.0) == ""
    assert f"300 N/m {limit}" in refused(REAL, 300.0)
    assert refused(REAL, 300.0).endswith("--force continues with at most 5 % of rated torque.")
    assert refused(SIMULATED, 1490.0) == ""
    assert "1500 N/m exceeds the limit of 750 N/m on this bench, at 1000 Hz" in refused(SIMULATED, 1500.0)
    assert "--force" not in refused(SIMULATED, 1500.0)


def test_what_is_forced_above_its_limit_has_5_percent_of_rated_torque() -> None:
    axis = default_axis(Workspace.LINEAR, bus="b", node=1, profile="maxon_epos4")
    task = Task("wall", Rig({"b": REAL}, {"handle": axis}), settings={"wall.stiffness": 600.0})
    free, forced = select(task).plan.axes[0], replace(select(task), forced=True).plan
    (capped,) = forced.axes
    assert (free.cap, free.limits.effort) == ("", free.rated_effort)
    assert capped.limits.effort == pytest.approx(0.05 * free.rated_effort)
    assert capped.limits.slew == pytest.approx(0.05 * free.limits.slew)
    assert capped.cap == "force limited to 2.51 N (5 % of rated torque): the scene is above its limit (--force)"
    assert list(above_limit(forced)) == [
        "600 N/m exceeds the limit of 291 N/m (damping stated, not measured) on this bench; the loop may vibrate"
    ]


def test_a_run_that_is_not_capped_is_not_changed_above_its_limit_by_force() -> None:
    axis = default_axis(Workspace.LINEAR, bus="b", node=1, profile="maxon_epos4")
    task = Task("wall", Rig({"b": REAL}, {"handle": axis}), settings={"wall.stiffness": 200.0})
    running, capped = select(task).plan, replace(select(task), forced=True).plan
    with pytest.raises(UnstableSceneError, match="600 N/m exceeds the limit"):
        plan_change(running, running, {"wall.stiffness": 600.0}, force=True)
    changed = plan_change(capped, capped, {"wall.stiffness": 600.0}, force=True).plan
    assert changed.axes[0].limits.effort == capped.axes[0].limits.effort


def test_texts_of_nominal_limits_leave_out_what_there_is_not() -> None:
    found = plan("wall")
    (axis,) = found.axes
    assert axis.stability is not None
    limits = replace(axis.stability.stiffness_limit, stable=0.0, quantisation=None)
    none = replace(axis.stability, stiffness_limit=limits)
    assert next(nominal_texts(none)) == "stable at no stiffness"
    assert not [text for text in nominal_texts(none) if "between two counts" in text]
    assert list(verdict_texts(replace(found, axes=(replace(axis, stability=None),)))) == []


def test_no_part_of_a_limit_of_0_can_be_asked_for() -> None:
    task = Task("virtual_shaft", settings={"wall.stiffness": 3000.0, "shaft.stiffness": "max/2"})
    with pytest.raises(UsageError, match=r"^shaft\.stiffness=max/2: the limit is 0, because no stiffness is stable"):
        _ = select(task).plan


def test_a_nominal_limit_below_one_is_told_as_the_number_that_it_is() -> None:
    assert [up_to(limit, "N/m") for limit in (-1.0, 0.0, 0.5, math.inf)] == [
        "at no stiffness", "at no stiffness", "to 0.5 N/m", "with no limit",
    ]  # fmt: skip
    assert [passive_to(limit, "N/m") for limit in (0.0, 0.5)] == ["not passive", "passive to 0.5 N/m"]


def test_a_scene_without_a_stiffness_has_no_margin() -> None:
    judged = {name: plan(name).axes[0].stability for name in ("wall", "damper")}
    assert judged["wall"] is not None
    assert judged["damper"] is not None
    assert margin_text(judged["wall"]) == f"{math.floor(judged['wall'].limit.value / 6.0) / 100:.2f}"
    assert margin_text(judged["damper"]) == ""


@pytest.mark.parametrize("scene", ["wall", "virtual_shaft"])
def test_the_verdict_and_the_texts_of_a_plan_share_one_group_so_that_a_limit_is_computed_once(scene: str) -> None:
    for axis in plan(scene, rate=62.5).axes:  # at which no other test has made a plan
        assert axis.stability is not None
        assert axis.stability.find_limit.__self__ is axis.group  # type: ignore[union-attr]
