"""Plans: what is mapped, what is left out, what is refused."""

import math
from dataclasses import replace

import pytest

from haptic_fieldbus.drive.cia402 import MappedObject
from haptic_fieldbus.drive.profile import DataType
from haptic_fieldbus.drive.rig import BusSection, Limits, RotaryMechanism
from haptic_fieldbus.errors import BusOverloadError, PlanError, SceneError, SignalUnavailableError
from haptic_fieldbus.margins import Basis, Limit
from haptic_fieldbus.planning.compile import compile_plan
from haptic_fieldbus.planning.explain import explain
from haptic_fieldbus.protocols.canopen.profile import CanopenProfile
from haptic_fieldbus.scenes.sprung_mass import SprungMass
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.signals import Signal, Workspace
from tests.builders import PERMILLE, PROFILE, WALL, can_traffic, pdos_of, plan_of, rig_of, scene_of
from tests.cycle.test_cycle import Constant

DAMPED = scene_of(Wall("handle", stiffness=600.0, position=0.02, damping=2.0))
SPRUNG = scene_of(SprungMass("handle", stiffness=100.0, mass=0.5))


def test_a_wall_maps_five_objects_and_nothing_else() -> None:
    assert plan_of().mapped == (
        "6041h:00 statusword",
        "6064h:00 position actual value",
        "6077h:00 torque actual value",
        "6040h:00 controlword",
        "6071h:00 target torque",
    )


def test_a_period_is_told_in_whole_nanoseconds() -> None:
    plan = plan_of()
    assert [replace(plan, rate=rate).period_ns for rate in (1.0, 3.0, 1000.0)] == [10**9, 333_333_333, 10**6]


def test_the_fastest_transmission_types_are_chosen() -> None:
    plan = plan_of()
    assert [pdo.transmission_type for pdo in pdos_of(plan)] == [1, 255]
    slow = replace(PROFILE, pdo=replace(PROFILE.pdo, rpdo_types=(1, 2)))
    assert [pdo.transmission_type for pdo in pdos_of(plan_of(profile=slow))] == [1, 1]
    assert plan_of(profile=slow).delay.transport == pytest.approx(0.001)


def test_a_drive_without_synchronous_tpdos_is_refused() -> None:
    with pytest.raises(PlanError, match="every SYNC"):
        plan_of(profile=replace(PROFILE, pdo=replace(PROFILE.pdo, tpdo_types=(255,))))


def left_out(scene_plan: object) -> set[str]:
    return {left.what for left in scene_plan.left_out}  # type: ignore[attr-defined]


def test_each_scene_leaves_out_what_it_does_not_need() -> None:
    wall, damped, sprung = plan_of(), plan_of(DAMPED), plan_of(SPRUNG)
    assert left_out(wall) == {"velocity", "estimator", "integrator", "virtual states"}
    assert left_out(damped) == {"integrator", "virtual states"}
    assert left_out(sprung) == {"velocity", "estimator"}
    asked = "haptic_fieldbus.cycle.standstill"
    assert wall.modules == (asked, "haptic_fieldbus.scenes.wall")
    assert damped.modules == (asked, "haptic_fieldbus.numerics.estimators", "haptic_fieldbus.scenes.wall")
    assert sprung.modules == (asked, "haptic_fieldbus.numerics.integrators", "haptic_fieldbus.scenes.sprung_mass")
    capped = plan_of(rig=rig_of(WALL, limits=Limits(effort=2.5)))
    assert capped.modules == ("haptic_fieldbus.scenes.wall",), "what a hand may be left alone with asks nothing"
    assert len({wall.steps, damped.steps, sprung.steps}) == 3


DEMAND = replace(
    PROFILE,
    torque=replace(PROFILE.torque, demand=MappedObject(0x6074, DataType.INT16, unit=PERMILLE), echo="demand"),
)
"""A drive whose set-points come back in a torque demand, so that torque actual is mapped only where it is asked for."""


def test_a_signal_that_an_element_asks_for_is_mapped() -> None:
    scene = scene_of(Constant("handle", 0.0, needs=(Signal.POSITION, Signal.TORQUE_ACTUAL)))
    plan, without = plan_of(scene, profile=DEMAND), plan_of(profile=DEMAND)
    assert "6077h:00 torque actual value" in plan.mapped
    assert "torque actual" not in left_out(plan)
    assert "6077h:00 torque actual value" not in without.mapped
    assert "torque actual" in left_out(without)


@pytest.mark.parametrize(
    ("profile", "shown"), [(PROFILE, "6077h:00 torque actual value"), (DEMAND, "6074h:00 torque demand")]
)
def test_safety_needs_what_set_points_come_back_in(profile: CanopenProfile, shown: str) -> None:
    plan = plan_of(profile=profile)
    assert shown in plan.mapped
    assert [step for step in plan.steps if step.startswith("echo: ")] == [
        f"echo: compares {shown[9:].removesuffix(' value')} with the sent set-point; trips if they differ for 35 ms"
    ]
    assert plan.axes[0].limits.effort == pytest.approx(plan.axes[0].rated_effort)


@pytest.mark.parametrize(("rate", "longest"), [(1000.0, 0.035), (250.0, 0.035), (50.0, 0.06)])
def test_the_deadline_of_the_echo_is_35_ms_or_three_periods(rate: float, longest: float) -> None:
    plan = compile_plan(WALL, rig_of(WALL), {PROFILE.name: PROFILE}, rate)
    assert plan.axes[0].limits.echo == pytest.approx(longest)


def test_a_drive_that_shows_nothing_of_its_set_points_gets_what_a_hand_may_hold_and_the_plan_says_so() -> None:
    plan = plan_of(profile=replace(PROFILE, torque=replace(PROFILE.torque, echo="none")))
    assert plan.axes[0].limits.effort == pytest.approx(0.05 * plan.axes[0].rated_effort)
    assert math.isinf(plan.axes[0].limits.echo)
    (why,) = [left.why for left in plan.left_out if left.what == "echo of the set-points"]
    assert "5 % of rated" in why
    assert "6077h:00 torque actual value" not in plan.mapped


def test_a_signal_that_the_drive_lacks_is_an_error_naming_element_signal_and_drive() -> None:
    scene = scene_of(Constant("handle", 0.0, needs=(Signal.POSITION, Signal.TORQUE_ACTUAL)))
    without = replace(PROFILE, torque=replace(PROFILE.torque, actual=None))
    with pytest.raises(SignalUnavailableError, match=r"constant.*torque actual.*test drive"):
        plan_of(scene, profile=without)


def test_a_rate_beyond_the_bus_is_refused() -> None:
    with pytest.raises(BusOverloadError, match="285 bits"):
        plan_of(rate=5000.0)


def test_a_linear_scene_on_a_rotary_mechanism_is_refused_with_key_and_units() -> None:
    with pytest.raises(SceneError, match=r"axis\.handle\.workspace.*linear \(N, m\).*rotary"):
        plan_of(rig=rig_of(WALL, mechanism=RotaryMechanism("rotary")))


def test_an_axis_that_the_rig_lacks_is_named() -> None:
    rig = rig_of(scene_of(Constant("elbow", 0.0)))
    with pytest.raises(PlanError, match=r"'handle'.*elbow"):
        plan_of(rig=rig)


def test_a_profile_that_is_not_usable_is_refused() -> None:
    with pytest.raises(PlanError, match="not usable"):
        plan_of(profile=replace(PROFILE, drive=replace(PROFILE.drive, usable=False)))


def test_an_unknown_torque_unit_is_refused() -> None:
    target = replace(PROFILE.torque.target, unit="A")
    with pytest.raises(PlanError, match="'A'"):
        plan_of(profile=replace(PROFILE, torque=replace(PROFILE.torque, target=target)))


def test_an_unknown_rated_torque_is_refused() -> None:
    with pytest.raises(PlanError, match="rated_torque"):
        plan_of(rig=rig_of(WALL, rated_torque=None))


@pytest.mark.parametrize(("key", "what"), [("torque_constant", "scale"), ("rated_torque", "limit")])
def test_where_torque_is_told_in_current_constant_and_rated_torque_must_be_known(key: str, what: str) -> None:
    target = replace(PROFILE.torque.target, unit="mA")
    rig = rig_of(WALL, **{"torque_constant": 0.05, "rated_torque": 0.4, key: None})
    with pytest.raises(PlanError, match=f"node 1: {key} is missing in the rig; it is needed to {what} the torque"):
        plan_of(rig=rig, profile=replace(PROFILE, torque=replace(PROFILE.torque, target=target)))


@pytest.mark.parametrize("unknown", ["inertia", "viscous_damping", "coulomb_friction"])
def test_an_unknown_bench_has_no_verdict_and_little_effort(unknown: str) -> None:
    plan = plan_of(rig=rig_of(WALL, **{unknown: None}))
    assert plan.stability is None
    assert plan.axes[0].limits.effort == pytest.approx(0.05 * plan_of().axes[0].limits.effort)
    assert "inertia" in explain(plan)


def test_the_rigs_effort_limit_wins_when_it_is_smaller() -> None:
    assert plan_of(rig=rig_of(WALL, limits=Limits(effort=8.0))).axes[0].limits.effort == 8.0
    most = plan_of().axes[0].limits.effort
    assert plan_of(rig=rig_of(WALL, limits=Limits(effort=1e6))).axes[0].limits.effort == most


def test_two_axes_share_the_bus_and_are_told_apart() -> None:
    scene = scene_of(Wall("left", 100.0), Wall("right", 200.0, name="second"))
    plan = plan_of(scene)
    assert [axis.node for axis in plan.axes] == [1, 2]
    assert plan.bus_load == pytest.approx(((55 + 2 * 230) * 1000 + 65 * (100 + 2 * 10)) / 1e6)
    assert plan.delay.bus > plan_of().delay.bus
    assert plan.stability is plan.axes[1].stability
    assert plan.steps[0].startswith("left: ")


def test_the_plant_is_the_bench_seen_through_the_mechanism() -> None:
    """r = 0.05/2π: 4e-5/r², 1e-4/r², 2e-3/r; one count is 0.05/4096 m."""
    plant = plan_of().axes[0].plant
    assert plant is not None
    assert plant.mass == pytest.approx(0.63165, rel=1e-4)
    assert plant.damping == pytest.approx(1.57914, rel=1e-4)
    assert plant.coulomb == pytest.approx(0.25133, rel=1e-4)
    assert plant.resolution == pytest.approx(0.05 / 4096)


def test_a_rotary_scene_uses_the_rotary_bench() -> None:
    scene = scene_of(Wall("handle", 1.0), workspace=Workspace.ROTARY)
    plan = plan_of(scene)
    assert plan.axes[0].plant is not None
    assert plan.axes[0].plant.mass == pytest.approx(4e-5)
    assert plan.axes[0].position_unit == pytest.approx(2 * 3.141592653589793 / 4096)


def test_only_the_stiffest_element_is_varied_for_the_limit() -> None:
    weak, strong = Wall("handle", 10.0, name="weak"), Wall("handle", 500.0)
    plan, alone = plan_of(scene_of(weak, strong)), plan_of(scene_of(strong))
    assert plan.stability is not None
    assert alone.stability is not None
    assert plan.stability.stiffness == 500.0
    limits = (plan.stability.stiffness_limit.stable, alone.stability.stiffness_limit.stable)
    assert limits[0] == pytest.approx((limits[1] or 0.0) - 10.0, rel=1e-6)


def test_the_explanation_names_what_is_mapped_left_out_and_run() -> None:
    text = explain(plan_of())
    for part in ("6064h:00 position actual value", "TPDO1 181h", "left out", "element: wall", "margin", "ms: bus"):
        assert part in text


def test_a_scene_without_stiffness_has_no_limit() -> None:
    plan = plan_of(scene_of(Constant("handle", 0.0, needs=())))
    assert explain(plan).endswith("limit      none: no stiffness to vary")
    assert explain(plan, verbose=True).endswith("stability  passive")


def test_a_limit_is_told_with_its_margin_and_by_what_it_is_known() -> None:
    plan = plan_of()
    (axis,) = plan.axes
    assert axis.stability is not None

    def told(found: Limit) -> str:
        judged = replace(axis.stability, find_limit=lambda: found)  # type: ignore[type-var]
        text = explain(replace(plan, axes=(replace(axis, stability=judged),)))
        return text.splitlines()[-1].removeprefix("limit      ")

    assert told(Limit(750.4, Basis.SIMULATED)) == "750 N/m; 600 is inside, margin 1.25"
    assert told(Limit(599.9, Basis.SIMULATED)) == "599 N/m; 600 is above it, margin 0.998"
    assert told(Limit(301.0, Basis.STATED)) == ("301 N/m (damping stated, not measured); 600 is above it, margin 0.501")
    assert told(Limit(0.0, Basis.SIMULATED)) == "0 N/m; no stiffness is stable"
    assert told(Limit(math.inf, Basis.SIMULATED)) == "none: stable at any stiffness; 600 N/m asked"


def test_the_nominal_limits_stand_in_the_long_form_alone() -> None:
    plan = plan_of()
    assert plan.stability is not None
    nominal = plan.stability.stiffness_limit
    assert nominal.stable is not None
    long = explain(plan, verbose=True)
    assert f"nominal: stable to {nominal.stable:.4g} N/m" in long
    assert "worst case: mass 0.632 kg, damping 1.58 N·s/m, torque loop " in long
    for word in ("nominal", "passive", "worst case:"):
        assert word not in explain(plan)


def test_our_own_node_id_is_one_that_no_drive_has() -> None:
    assert can_traffic(plan_of()).master_node == 127
    assert can_traffic(plan_of(rig=rig_of(WALL, node=127))).master_node == 126


def test_a_bus_of_no_protocol_is_refused_with_what_would_be_one() -> None:
    rig = replace(rig_of(WALL), bus={"bus": BusSection("haptic_sim", "sim")})
    with pytest.raises(PlanError, match="has no protocol; in Python use CanSection for a CAN bus"):
        plan_of(rig=rig)


class TestVerdictsOfEarlierPlans:
    """A verdict takes most of the time of a plan; it is a matter of the loop alone."""

    def test_the_same_loop_is_judged_once(self) -> None:
        first, second = (plan_of(scene_of(Wall("handle", 611.0, 0.02))).axes[0] for _ in range(2))
        assert first.stability is second.stability
        assert first.group is not None
        assert second.group is not None
        assert second.group.stiffest is second.elements[0], "the group has the elements of its own plan"

    @pytest.mark.parametrize(
        "other", [Wall("handle", 612.0, 0.02), Wall("handle", 611.0, 0.03), Wall("handle", 611.0, 0.02, 1.0)]
    )
    def test_another_one_is_judged_anew(self, other: Wall) -> None:
        first, second = (plan_of(scene_of(each)).axes[0].group for each in (Wall("handle", 611.0, 0.02), other))
        assert first != second

    def test_an_element_of_ones_own_need_not_have_a_hash(self) -> None:
        class Unhashed(Wall):
            __hash__ = None  # type: ignore[assignment]

        axis, known = (plan_of(scene_of(kind("handle", 611.0, 0.02))).axes[0] for kind in (Unhashed, Wall))
        assert axis.stability is not None
        assert known.stability is not None
        assert axis.stability.to_json() == known.stability.to_json()
