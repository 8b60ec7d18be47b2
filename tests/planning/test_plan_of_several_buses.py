"""Plans of axes on several buses: each bus with its own load, delay and heartbeat, and a text that names them."""

from dataclasses import replace
from typing import Any

import pytest

from haptic_fieldbus.errors import BusOverloadError
from haptic_fieldbus.planning.compile import compile_plan
from haptic_fieldbus.planning.explain import explain
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.scenes.wall import Wall
from tests.builders import PROFILE, can_traffic, plan_of, scene_of
from tests.several_buses import rig_on

SCENE = scene_of(Wall("left", 100.0), Wall("right", 200.0, name="second"))
THREE = scene_of(Wall("left", 100.0), Wall("right", 200.0, name="second"), Wall("foot", 50.0, name="third"))
BUSES = {"left": "can0", "right": "can1"}
BITS_IN, BITS_OUT, SYNC_BITS, HEARTBEAT_BITS, INTERFRAME_BITS = 135, 95, 55, 65, 3
"""Worst case of 8 octets in, 4 out, none and one."""


def two_buses(left: int = 1_000_000, right: int = 1_000_000, rate: float = 1000.0, **changes: Any) -> Plan:
    rig = rig_on(SCENE, BUSES, {"can0": left, "can1": right}, **changes)
    return plan_of(SCENE, rate, rig=rig)


def test_each_bus_has_its_own_bit_rate_load_and_axes() -> None:
    plan = two_buses(1_000_000, 500_000)
    first, second = plan.buses
    bits = (SYNC_BITS + BITS_IN + BITS_OUT) * 1000 + HEARTBEAT_BITS * (100 + 10)
    assert (first.name, can_traffic(plan, 0).bitrate, first.axes) == ("can0", 1_000_000, ("left",))
    assert (second.name, can_traffic(plan, 1).bitrate, second.axes) == ("can1", 500_000, ("right",))
    assert [first.traffic.load, second.traffic.load] == pytest.approx([bits / 1e6, bits / 5e5])


def test_the_load_of_a_plan_is_that_of_its_fullest_bus() -> None:
    plan, alone = two_buses(1_000_000, 500_000), plan_of()
    assert plan.bus_load == plan.buses[1].traffic.load
    assert alone.bus_load == alone.buses[0].traffic.load


def test_two_buses_of_one_bit_rate_carry_what_each_would_carry_alone() -> None:
    """Their exchanges run side by side, so neither axis is later than on a bus of its own."""
    plan, alone = two_buses(), plan_of()
    assert {bus.traffic.load for bus in plan.buses} == {alone.bus_load}
    assert [axis.delay for axis in plan.axes] == [alone.delay, alone.delay]
    assert plan.bus_load < plan_of(SCENE).bus_load


def test_who_has_its_feedback_first_waits_for_the_slowest_bus() -> None:
    """SYNC and TPDO at 500 kbit/s end (55 + 135) bits of 1 µs later than at 1 Mbit/s; its latch, 55 µs later."""
    profile = replace(PROFILE, timing=replace(PROFILE.timing, control_period=0.0))
    rig = rig_on(SCENE, BUSES, {"can1": 500_000})
    fast, slow = compile_plan(SCENE, rig, {PROFILE.name: profile}, 1000.0).axes
    waiting = (SYNC_BITS + BITS_IN) * 1e-6
    assert fast.delay.bus == pytest.approx((BITS_IN + BITS_OUT - INTERFRAME_BITS) * 1e-6 + waiting)
    assert slow.delay.bus == pytest.approx((BITS_IN + BITS_OUT - INTERFRAME_BITS) * 2e-6)
    assert [fast.delay.drive, slow.delay.drive] == pytest.approx([0.0, 0.0], abs=1e-15)
    own = SYNC_BITS - BITS_OUT + INTERFRAME_BITS
    assert fast.delay.bus + own * 1e-6 == pytest.approx(slow.delay.bus + own * 2e-6), "both compute at the same instant"


def test_a_slow_bus_beside_it_costs_a_fast_one_stability() -> None:
    fast, beside_slow = two_buses().axes[0].stability, two_buses(right=250_000, rate=500.0).axes[0].stability
    alone = plan_of(rate=500.0).axes[0].stability
    assert fast is not None
    assert alone is not None
    assert beside_slow is not None
    assert (beside_slow.stiffness_limit.stable or 0.0) < (alone.stiffness_limit.stable or 0.0)


def test_heartbeats_follow_the_deadline_of_the_drives_on_their_bus() -> None:
    hasty = replace(PROFILE, name="hasty", link_loss=replace(PROFILE.link_loss, deadline=0.02))
    rig = rig_on(SCENE, BUSES)
    rig = replace(rig, axis={**rig.axis, "right": replace(rig.axis["right"], profile="hasty")})
    plan = compile_plan(SCENE, rig, {PROFILE.name: PROFILE, "hasty": hasty}, 1000.0)
    assert [can_traffic(plan, place).heartbeat_every for place in (0, 1)] == [10, 4]


def test_node_ids_may_repeat_and_ours_is_free_on_each_bus() -> None:
    assert [axis.node for axis in two_buses(node=127).axes] == [127, 127]
    assert can_traffic(two_buses(node=127)).master_node == 126
    rig = rig_on(SCENE, BUSES)
    nodes = {"left": 127, "right": 126}
    axes = {name: replace(axis, node=nodes[name]) for name, axis in rig.axis.items()}
    plan = plan_of(SCENE, rig=replace(rig, axis=axes))
    assert [can_traffic(plan, place).master_node for place in (0, 1)] == [126, 127]


@pytest.mark.parametrize(("left", "right", "full"), [(250_000, 1_000_000, "can0"), (1_000_000, 250_000, "can1")])
def test_the_bus_that_is_too_full_is_named(left: int, right: int, full: str) -> None:
    with pytest.raises(
        BusOverloadError, match=rf"^bus {full}: 1000 Hz needs 285 bits per period: 117 % of 250000 bit/s"
    ):
        two_buses(left, right)


def test_on_a_rig_with_one_bus_no_name_is_needed() -> None:
    with pytest.raises(BusOverloadError, match=r"^5000 Hz needs"):
        plan_of(rate=5000.0)


def test_the_rate_that_is_proposed_fits_all_buses() -> None:
    with pytest.raises(BusOverloadError) as refused:
        two_buses(125_000, 250_000)
    rate = float(str(refused.value).split("--rate ")[1])
    assert all(bus.traffic.load <= 0.9 for bus in two_buses(125_000, 250_000, rate=rate).buses)


def test_the_part_of_a_bus_holds_its_axes_and_their_places_in_the_whole_image() -> None:
    buses = {"left": "can0", "right": "can1", "foot": "can0"}
    plan = plan_of(THREE, rig=rig_on(THREE, buses, {"can1": 500_000}))
    first, second = (plan.on(bus) for bus in plan.buses)
    assert [axis.name for axis in first.axes] == ["left", "foot"]
    assert first.image.axes == (plan.image.axes[0], plan.image.axes[2])
    assert second.axes == (plan.axes[1],)
    assert second.image.axes == (plan.image.axes[1],)
    assert (first.image.input_size, second.image.output_size) == (plan.image.input_size, plan.image.output_size)
    assert (can_traffic(first).bitrate, can_traffic(second).bitrate) == (1_000_000, 500_000)


def test_the_text_names_each_bus_its_load_and_its_axes_and_lists_its_pdos_below() -> None:
    lines = explain(two_buses(1_000_000, 500_000)).splitlines()
    at = next(number for number, line in enumerate(lines) if line.startswith("bus"))
    pdos = [
        "in         TPDO1 {tpdo}h, type 1 (every SYNC), 8 octets",
        "             6041h:00 statusword",
        "             6064h:00 position actual value",
        "             6077h:00 torque actual value",
        "out        RPDO1 {rpdo}h, type 255 (event-driven), 4 octets",
        "             6040h:00 controlword",
        "             6071h:00 target torque",
    ]
    assert lines[at : at + 16] == [
        "bus        can0: 1000 Hz at 1 Mbit/s, load 29 % (worst case), axes left",
        *(line.format(tpdo=181, rpdo=201) for line in pdos),
        "bus        can1: 1000 Hz at 500 kbit/s, load 58 % (worst case), axes right",
        *(line.format(tpdo=182, rpdo=202) for line in pdos),
    ]


def test_a_bus_on_which_the_scene_has_no_axis_is_left_out() -> None:
    alone = scene_of(Wall("left", 100.0))
    rig = rig_on(SCENE, BUSES)
    plan = plan_of(alone, rig=rig)
    assert [bus.name for bus in plan.buses] == ["can0"]
    assert explain(plan) == explain(plan_of(alone))
