"""Which buses a run is on: those of the rig, or the simulation in their place."""

from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal

import pytest
from can.interfaces.virtual import channels

from haptic_fieldbus.api import plan, run
from haptic_fieldbus.drive.rig import LinearMechanism, Rig
from haptic_fieldbus.errors import (
    BusError,
    BusOverloadError,
    PlanError,
    RigError,
    SafetyTripError,
    SceneError,
    UsageError,
)
from haptic_fieldbus.numerics.linear import gain
from haptic_fieldbus.planning.request import Task
from haptic_fieldbus.planning.selection import check_rendering, load, select
from haptic_fieldbus.protocols.canopen.bus import CanSection
from haptic_fieldbus.scenes.sprung_mass import SprungMass
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.signals import Signal
from tests.builders import bit_rates, canopen, scene_of
from tests.several_buses import rig_on

SCENE = scene_of(Wall("left", stiffness=200.0, name="a"), Wall("right", stiffness=200.0, name="b"))
BUSES = {"left": "can_left", "right": "can_right"}


def test_a_mass_that_is_none_is_told_the_smallest_one_at_the_rate_that_is_asked_for() -> None:
    scene = scene_of(SprungMass("left", stiffness=200.0, mass=0.0))
    with pytest.raises(SceneError, match=r"semi-implicit renders it .* from 0\.0008 up, at 250 Hz"):
        select(Task(scene=scene, rate=250.0, method="semi-implicit"))


def counted_from(zero: int | Literal["start"]) -> Rig:
    """The bench of the wall with this zero, and limits around it."""
    bench = plan("wall").rig
    axis = bench.axis["handle"]
    mechanism, limits = replace(axis.mechanism, zero=zero), replace(axis.limits, position=(-0.1, 0.1))
    return replace(bench, axis={"handle": replace(axis, mechanism=mechanism, limits=limits)})


def test_zero_here_stands_in_the_place_of_the_zero_of_the_rig() -> None:
    assert plan("wall", counted_from(10_000)).rig.axis["handle"].mechanism.zero == 10_000
    assert plan("wall", counted_from(10_000), zero="here").rig == counted_from("start")


@pytest.mark.thorough("four runs")
def test_a_run_may_begin_where_the_handle_is() -> None:
    """The encoder begins at 0, which is 122 mm before the count of this rig, and outside of its limits."""
    assert run("wall", counted_from(0), duration=1.0).trips == ()
    with pytest.raises(SafetyTripError, match="position"):
        run("wall", counted_from(10_000), duration=1.0)
    here = run("wall", counted_from(10_000), duration=1.0, zero="here")
    assert here.torque_error == run("wall", counted_from(0), duration=1.0).torque_error


def test_a_travel_that_does_not_contain_the_start_is_refused_with_zero_here_and_kept_with_a_zero_of_the_rig() -> None:
    bench = counted_from(10_000)
    limits = replace(bench.axis["handle"].limits, position=(0.03, 0.1))
    away = replace(bench, axis={"handle": replace(bench.axis["handle"], limits=limits)})
    assert plan("wall", away).rig.axis["handle"].limits.position == (0.03, 0.1)
    with pytest.raises(
        UsageError, match=r"^--zero here: axis\.handle\.limits\.position is \[0\.03, 0\.1\]; expected a travel"
    ):
        plan("wall", away, zero="here")


def test_zero_is_here_or_that_of_the_rig() -> None:
    with pytest.raises(UsageError, match=r'^--zero "there": expected here; for an encoder count use'):
        plan("wall", zero="there")


def rig(interface: str = "haptic_sim", right: int = 1_000_000) -> Rig:
    return rig_on(SCENE, BUSES, {"can_right": right}, interface, profile="maxon_epos4")


def test_the_buses_of_a_rig_are_simulated_each_by_itself_with_its_bit_rate() -> None:
    bench = rig("socketcan", right=250_000)
    assert bit_rates(plan(SCENE, bench, rate=500.0, bus="sim")) == [
        1_000_000,
        250_000,
    ]
    result = run(SCENE, bench, bus="sim", rate=500.0, duration=0.5)
    assert (result.cycles, result.clock, result.bus) == (250, "virtual", "sim")
    with pytest.raises(BusOverloadError, match=r"^bus can_right: 1000 Hz"):
        run(SCENE, bench, bus="sim")


def test_a_bit_rate_given_with_the_simulation_is_that_of_all_buses() -> None:
    bench = rig("socketcan", right=250_000)
    assert bit_rates(plan(SCENE, bench, bus="sim@500000")) == [
        500_000,
        500_000,
    ]


def test_the_only_bus_of_a_rig_is_simulated_with_its_bit_rate_too() -> None:
    bench = rig_on(SCENE, dict.fromkeys(BUSES, "can0"), {"can0": 800_000}, "socketcan", profile="maxon_epos4")
    assert bit_rates(plan(SCENE, bench, bus="sim")) == [800_000]
    assert bit_rates(plan(SCENE, bench, bus="sim@1000000")) == [1_000_000]


def test_a_bus_that_is_named_stands_for_the_only_bus_of_a_rig() -> None:
    bench = rig_on(SCENE, dict.fromkeys(BUSES, "can0"), interface="socketcan", profile="maxon_epos4")
    found = plan(SCENE, bench, rate=500.0, bus="pcan:PCAN_USBBUS1@500000")
    assert found.rig.bus == {"can0": CanSection("pcan", "PCAN_USBBUS1", 500_000)}


def test_real_and_simulated_buses_in_one_run_are_refused() -> None:
    bench = rig()
    mixed = replace(bench, bus={**bench.bus, "can_left": CanSection("socketcan", "can0")})
    with pytest.raises(UsageError, match=r"mixes simulated and real buses: can_left is socketcan:can0.*haptic_sim:can"):
        run(SCENE, mixed)
    assert run(SCENE, mixed, bus="sim", duration=0.1).cycles == 100


def test_one_bus_under_two_names_is_refused() -> None:
    with pytest.raises(
        UsageError, match=r"lists one bus twice: can_left is socketcan:can0.*can_right is socketcan:can0"
    ):
        run(SCENE, replace(rig(), bus=dict.fromkeys(BUSES.values(), CanSection("socketcan", "can0"))))


def test_a_real_bus_cannot_stand_for_several() -> None:
    with pytest.raises(UsageError, match=r"is one bus, but the axes .* use several: can_left, can_right"):
        run(SCENE, rig(), bus="socketcan:can0")


def test_the_real_buses_of_a_rig_are_all_opened() -> None:
    """On python-can's own bus for one process, where nobody answers: the first drive that is missed is named."""
    with pytest.raises(BusError, match=r"node 1 \(axis left\) does not answer on can_left"):
        run(SCENE, rig("virtual"), confirm=lambda _: True)


def test_of_real_buses_that_cannot_all_be_opened_none_stays_open() -> None:
    bench = rig("virtual")
    broken = replace(bench, bus={**bench.bus, "can_right": CanSection("socketcan", "no_such_bus")})
    with pytest.raises(BusError, match="cannot open socketcan:no_such_bus"):
        run(SCENE, broken, confirm=lambda _: True)
    assert not channels.get("can_left")


def test_of_a_real_bus_without_a_rig_the_bench_is_unknown() -> None:
    task = Task(SCENE, bus="socketcan:can0", node=5)
    rig = load(task).rig
    assert rig.bus == {"socketcan:can0": CanSection("socketcan", "can0")}
    assert [(axis.node, axis.inertia, axis.mechanism.ratio) for axis in rig.axis.values()] == [
        (5, None, LinearMechanism("linear", 0.05).ratio),
        (6, None, LinearMechanism("linear", 0.05).ratio),
    ]
    with pytest.raises(PlanError, match=r"lacks axis\.left\.rated_torque, axis\.left\.inertia, .*axis\.right\."):
        select(task)


@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [({"method": "rk5"}, "rk4"), ({"estimator": "kalmann-velocity"}, "kalman-velocity")],
    ids=["method", "estimator"],
)
def test_names_are_checked_also_where_the_scene_needs_neither(wrong: dict[str, str], sentence: str) -> None:
    with pytest.raises(UsageError, match=sentence):
        check_rendering(Task(SCENE, method=wrong.get("method"), estimator=wrong.get("estimator")))
    check_rendering(Task(SCENE, method="rk4", estimator="kalman-velocity"))


def test_a_profile_of_no_particular_drive_is_asked_for_by_a_run_and_the_plan_says_so() -> None:
    def left_out(drive: str, simulated: str, bus: str) -> list[str]:
        rig = load(Task("wall", drive=drive, bus=simulated)).rig
        axes = {name: replace(axis, emergency_stop="power") for name, axis in rig.axis.items()}
        return [each.what for each in plan("wall", replace(rig, axis=axes), bus=bus).left_out]

    asked, wire = "objects that the drive lacks", "udp_multicast:239.74.163.2@1000000"
    assert asked in left_out("generic_cia402", "sim", wire)
    assert asked not in left_out("generic_cia402", "sim", "sim"), "the simulated drive is that of the profile"
    assert asked not in left_out("maxon_epos4", "sim", wire)
    assert asked not in left_out("generic_cia402_modbus", "sim-modbus-tcp", "modbus-tcp:127.0.0.1"), "nobody asks there"


def test_a_profile_that_is_known_already_is_not_loaded() -> None:
    loaded = load(Task("wall"))
    axes = {name: replace(axis, profile="no file has this name") for name, axis in loaded.rig.axis.items()}
    known = {"no file has this name": canopen("generic_cia402")}
    (axis,) = replace(loaded, rig=replace(loaded.rig, axis=axes), profiles=known).plan.axes
    assert axis.profile is known["no file has this name"]


@dataclass(frozen=True)
class Own:
    """An element of one's own, with a linear model that may be none."""

    linear: Any
    axis: str = "left"
    name: str = "own"
    needs: ClassVar = (Signal.POSITION,)

    def force(self, position: float) -> float:
        return 0.0

    def linearised(self) -> Any:
        return self.linear


def test_the_linear_model_of_an_own_element_has_one_form() -> None:
    check_rendering(Task(scene_of(Own(gain([[0.0, 0.0]])))))
    told = r"scene: element own: linearised\(\) must return a StateSpace with 2 inputs and 1 output"
    for wrong in (3, gain([[0.0]])):
        with pytest.raises(UsageError, match=told):
            check_rendering(Task(scene_of(Own(wrong))))


def test_a_rig_made_in_python_is_held_to_the_rules_of_files() -> None:
    rig = counted_from("start")
    wrong = replace(rig, axis={"handle": replace(rig.axis["handle"], inertia=-1.0, bus="nowhere")})
    with pytest.raises(RigError) as refused:
        plan("wall", wrong)
    assert [fault.key for fault in refused.value.faults] == ["axis.handle.inertia", "axis.handle.bus"]
    assert plan("wall", rig).rig == rig


@pytest.mark.parametrize(("bus", "node", "last"), [("sim", 127, 128), ("sim-modbus-tcp", 247, 248)])
def test_a_node_id_that_a_second_axis_would_pass_is_refused(bus: str, node: int, last: int) -> None:
    """COB-IDs of node 128 would be those of other messages: its TPDO is the RPDO of node 0, its SDO that of NMT."""
    assert plan("virtual_shaft", bus=bus, node=node - 1).axes[1].node == node
    with pytest.raises(UsageError, match=f"node {node}: the 2 axes .* take the numbers {node} to {last}"):
        plan("virtual_shaft", bus=bus, node=node)
