"""Ways of exchange, their times by hand, and the choice among them.

A frame of RTU has 3 octets beside its PDU, so function 23 with 2 registers written and 5 read is 17 + 15 characters,
function 3 with 4 registers is 8 + 13, function 16 is 13 + 8. Function 23 reads torque actual besides.
"""

from dataclasses import replace
from itertools import product
from typing import Any

import pytest

from haptic_fieldbus.drive.profile import DataType
from haptic_fieldbus.drive.rig import Rig, default_axis
from haptic_fieldbus.errors import BusOverloadError, PlanError
from haptic_fieldbus.planning.compile import compile_plan
from haptic_fieldbus.planning.explain import plan_json
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.planning.refusal import way_limits
from haptic_fieldbus.protocols.catalogue import load_profile
from haptic_fieldbus.protocols.modbus.bus import ModbusSection
from haptic_fieldbus.protocols.modbus.profile import ModbusProfile, Register, WrittenRegister
from haptic_fieldbus.protocols.modbus.register_traffic import Transaction
from haptic_fieldbus.protocols.registry import parse_bus
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.signals import Workspace
from tests.builders import WALL, scene_of
from tests.protocols.modbus.lines import (
    ANSWER_TIME,
    CHARACTER,
    COMPUTE,
    GENERIC,
    ROUND_TRIP,
    RTU,
    SILENCE,
    TCP,
    on,
    traffic_of,
    with_line,
)

ONE, READ, WRITE = (characters * CHARACTER + SILENCE + ANSWER_TIME for characters in (32, 21, 21))
"""Exchange of function 23, 3 and 16 [s]."""


def planned(bus: str = RTU, rate: float | None = None, profile: ModbusProfile = GENERIC, **axis: Any) -> Plan:
    """The wall on a bench whose drive has this profile."""
    handle = replace(default_axis(Workspace.LINEAR, bus="line", node=1, profile="drive"), **axis)
    rig = Rig({"line": parse_bus(bus).section}, {"handle": handle})
    return compile_plan(WALL, rig, {"drive": profile}, rate)


def two_units(bus: str, rate: float | None = None, profile: ModbusProfile = GENERIC) -> Plan:
    """Two walls, on units 1 and 2 of one line."""
    scene = scene_of(Wall("left", 100.0), Wall("right", 100.0, name="second"))
    axes = {
        name: default_axis(Workspace.LINEAR, bus="line", node=number, profile="drive")
        for number, name in enumerate(("left", "right"), start=1)
    }
    return compile_plan(scene, Rig({"line": parse_bus(bus).section}, axes), {"drive": profile}, rate)


class TestTimes:
    def test_of_function_23_on_rtu(self) -> None:
        traffic = traffic_of(on(RTU, 100.0))
        assert traffic.way is Transaction.READ_WRITE
        assert traffic.latch("handle") == pytest.approx(17 * CHARACTER + SILENCE + ANSWER_TIME)
        assert traffic.feedback_time == pytest.approx(ONE)
        assert traffic.shortest_period == pytest.approx(ONE + SILENCE), "computing goes on during the silence"
        assert traffic.delay("handle").transport == pytest.approx(0.010), "one whole period"
        assert traffic.sending_ns == 0.0
        assert traffic.load == pytest.approx(100 * (ONE + SILENCE))

    def test_of_reading_then_writing_on_rtu(self) -> None:
        traffic = traffic_of(on(RTU, 50.0))
        assert traffic.way is Transaction.READ_THEN_WRITE, "at 50 Hz a whole period is longer"
        assert traffic.latch("handle") == pytest.approx(8 * CHARACTER + SILENCE + ANSWER_TIME)
        assert traffic.feedback_time == pytest.approx(READ)
        assert traffic.shortest_period == pytest.approx(READ + SILENCE + WRITE + SILENCE)
        until_written = 13 * CHARACTER + SILENCE + 13 * CHARACTER + SILENCE + ANSWER_TIME
        assert traffic.delay("handle").transport == pytest.approx(until_written)
        assert traffic.sending_ns == pytest.approx(1e9 * (SILENCE - COMPUTE + WRITE + SILENCE))

    def test_of_reading_then_writing_on_tcp(self) -> None:
        traffic, exchange = traffic_of(on(TCP, 1000.0)), ROUND_TRIP + ANSWER_TIME
        assert traffic.way is Transaction.READ_THEN_WRITE
        assert traffic.feedback_time == pytest.approx(exchange)
        assert traffic.shortest_period == pytest.approx(2 * exchange + COMPUTE)
        assert traffic.delay("handle").transport == pytest.approx(ROUND_TRIP + COMPUTE + ANSWER_TIME)
        assert traffic.load == pytest.approx(2 * exchange * 1000)

    def test_units_of_one_line_take_turns(self) -> None:
        traffic = traffic_of(two_units(RTU, 50.0))
        assert traffic.way is Transaction.READ_WRITE
        assert traffic.latch("right") - traffic.latch("left") == pytest.approx(ONE + SILENCE)
        assert traffic.shortest_period == pytest.approx(2 * (ONE + SILENCE))
        assert traffic.line().endswith("; 2 units in turn take 13.5 ms per period, one alone 6.76 ms")
        both = traffic_of(two_units(TCP, 500.0))
        exchange = ROUND_TRIP + ANSWER_TIME
        assert both.shortest_period == pytest.approx(4 * exchange + COMPUTE)
        left, right = (both.delay(name).transport for name in ("left", "right"))
        assert left == pytest.approx(right), "who is read first is written first"
        assert left == pytest.approx(2 * exchange + COMPUTE)

    def test_one_register_is_written_with_function_6_and_a_command_in_the_place_of_the_set_point(self) -> None:
        apart = replace(GENERIC, power=replace(GENERIC.power, command=Register(0x20A, GENERIC.power.command.type)))
        plan = planned(TCP, 1000.0, apart)
        traffic = traffic_of(plan).of("handle")
        assert [request.function for request in traffic.requests] == [3, 6]
        assert traffic.command is not None
        assert [mapped.signal.value for mapped in traffic.outgoing] == ["target torque", "controlword"]
        assert traffic_of(plan).shortest_period == pytest.approx(2 * (ROUND_TRIP + ANSWER_TIME) + COMPUTE)

    def test_the_block_with_the_motion_is_read_last_and_written_with_first(self) -> None:
        apart = with_line(
            replace(GENERIC, power=replace(GENERIC.power, status=Register(0x400, GENERIC.power.status.type)))
        )
        reading = traffic_of(planned(TCP, 500.0, apart)).of("handle").reading
        assert [request.read.address for request in reading if request.read] == [0x400, 0x101]
        (other,) = traffic_of(planned(TCP, 500.0, apart)).others()
        assert [request.function for request in other.of("handle").requests] == [23, 3]
        assert other.delay("handle").transport == pytest.approx(2e-3), "one whole period all the same"


class TestChoice:
    @pytest.mark.thorough("every bench by every line", quick=1)
    @pytest.mark.parametrize("bus", [TCP, RTU, "sim-modbus-rtu@1000000", "sim-modbus-rtu@9600"])
    @pytest.mark.parametrize("answer_time", [1e-4, 1e-3, 4e-3])
    def test_is_the_way_with_the_highest_stiffness_limit_within_three_percent(
        self, bus: str, answer_time: float
    ) -> None:
        benches = product((4e-6, 4e-5, 1e-3), (1e-5, 1e-3))
        for (inertia, damping), rate in product(benches, (None, 20.0)):
            profile = with_line(answer_time=answer_time)
            found = way_limits(planned(bus, rate, profile, inertia=inertia, viscous_damping=damping))
            limits = {way.exchange: way.limit or 0.0 for way in found if rate is None or way.rate == rate}
            assert found[0].chosen
            # The way is chosen for the values of rig and profile; the limit holds for all that are open.
            assert limits[found[0].exchange] >= 0.97 * max(limits.values()), (inertia, damping, rate)

    def test_of_one_way_alone(self) -> None:
        for functions, way in (
            ((3, 16), Transaction.READ_THEN_WRITE),
            ((23,), Transaction.READ_WRITE),
            ((4, 16), Transaction.READ_THEN_WRITE),
        ):
            plan = planned(TCP, 500.0, with_line(functions=functions))
            assert traffic_of(plan).way is way
            assert traffic_of(plan).others() == ()
            assert way_limits(plan) == (), "there is nothing to compare"
        assert traffic_of(planned(TCP, 500.0, with_line(functions=(4, 16)))).exchange == "FC4 then FC16"

    def test_of_none_is_refused(self) -> None:
        with pytest.raises(PlanError, match="the drives of the line share no function codes"):
            planned(TCP, 500.0, with_line(functions=(3, 6)))

    def test_of_one_that_fits_when_the_other_does_not(self) -> None:
        assert traffic_of(on(RTU, 100.0)).way is Transaction.READ_WRITE
        assert traffic_of(on(RTU, 87.0)).way is Transaction.READ_THEN_WRITE
        with pytest.raises(BusOverloadError, match=r"160 Hz is too fast: FC23 takes 6\.76 ms per period.*--rate 140"):
            on(RTU, 160.0)


class TestRate:
    @pytest.mark.parametrize(
        ("bus", "rate"), [(TCP, 1000.0), (RTU, 140.0), ("sim-modbus-rtu@1000000", 230.0), ("sim-modbus-rtu", 140.0)]
    )
    def test_without_one_is_the_highest_of_the_best_way_in_two_digits(self, bus: str, rate: float) -> None:
        plan = on(bus)
        assert plan.rate == rate
        assert 1.05 * rate <= traffic_of(plan).highest_rate < 1.05 * rate + 20.0, "what was late is made up"

    def test_of_a_wall_at_100_hz_has_a_limit_near_104(self) -> None:
        """b/(T/2 + T + lag) with 1.58 N·s/m, 10 ms and 0.159 ms is 104 N/m."""
        found = on(RTU, 100.0).stability
        assert found is not None
        assert found.stiffness_limit.stable == pytest.approx(1e-4 / (0.05 / 6.283185) ** 2 / 15.159e-3, rel=0.01)

    def test_of_canopen_stays(self) -> None:
        assert on("sim").rate == 1000.0

    def test_is_that_of_the_slowest_bus(self) -> None:
        assert mixed(RTU).rate == 125.0, "140 Hz, and in whole milliseconds 8"
        assert mixed(TCP).rate == 1000.0

    def test_can_be_asked_for_by_half_of_the_limit(self) -> None:
        plan = on(RTU, settings={"wall.stiffness": "max/2"})
        assert plan.stability is not None
        assert plan.stability.margin == pytest.approx(2.0, rel=1e-3)


def mixed(bus: str, rate: float | None = None) -> Plan:
    """One axis on CANopen, one on Modbus."""
    axes = {
        "left": default_axis(Workspace.LINEAR, bus="can", node=1, profile="maxon_epos4"),
        "right": default_axis(Workspace.LINEAR, bus="line", node=1, profile="generic_cia402_modbus"),
    }
    scene = scene_of(Wall("left", 100.0), Wall("right", 100.0, name="second"))
    rig = Rig({"can": parse_bus("sim").section, "line": parse_bus(bus).section}, axes)
    return compile_plan(scene, rig, {axis.profile: load_profile(axis.profile) for axis in axes.values()}, rate)


class TestBesideCanopen:
    def test_who_has_its_feedback_first_waits(self) -> None:
        """SYNC and TPDO of 55 + 135 bits at 1 Mbit/s are 0.19 ms; function 3 over TCP is 0.45 ms."""
        can, line = mixed(TCP, 1000.0).axes
        alone = ROUND_TRIP + COMPUTE + ANSWER_TIME
        assert line.delay.transport == pytest.approx(alone)
        rpdo = 95 - 3
        assert can.delay.bus == pytest.approx((135 + rpdo) * 1e-6 + (0.45e-3 - 190e-6))

    def test_a_line_that_waits_needs_a_longer_period(self) -> None:
        plan = on(TCP, 500.0)
        waiting = replace(traffic_of(plan), waiting=0.3e-3)
        assert waiting.shortest_period - traffic_of(plan).shortest_period == pytest.approx(0.3e-3)
        assert waiting.delay("handle").transport - plan.delay.transport == pytest.approx(0.3e-3)
        assert waiting.load == pytest.approx(traffic_of(plan).load), "nothing is sent meanwhile"

    def test_json_has_the_traffic_of_both(self) -> None:
        shown = plan_json(mixed(TCP))
        assert [pdo["name"] for pdo in shown["pdos"]] == ["TPDO1", "RPDO1"]  # type: ignore[union-attr,call-overload,index]
        assert [row["function"] for row in shown["registers"]] == [3, 16]  # type: ignore[union-attr,call-overload,index]


class TestGuard:
    @pytest.mark.parametrize(("rate", "seconds"), [(1000.0, 0.05), (100.0, 0.05), (80.0, 0.063), (20.0, 0.25)])
    def test_covers_five_periods_in_whole_milliseconds(self, rate: float, seconds: float) -> None:
        assert traffic_of(planned(TCP, rate)).guard("handle") == pytest.approx(seconds)

    @pytest.mark.parametrize(("deadline", "seconds"), [(0.05, 1.0), (1.0, 1.0), (1.6, 2.0)])
    def test_in_a_register_of_seconds_is_no_shorter_than_it_is_told(self, deadline: float, seconds: float) -> None:
        """0 s would be no watchdog at all."""
        assert GENERIC.watchdog is not None
        time = replace(GENERIC.watchdog.time, unit="s")
        own = replace(GENERIC, watchdog=replace(GENERIC.watchdog, deadline=deadline, time=time))
        plan = planned(TCP, 500.0, own)
        assert traffic_of(plan).guard("handle") == seconds
        written = traffic_of(plan).guarding("handle", plan.axes[0].rig)
        assert f"register 0204h = {1e3 * seconds:.0f} ms, in s" in written

    def test_is_written_with_its_reactions_the_set_up_and_the_mode(self) -> None:
        assert GENERIC.watchdog is not None
        watchdog = replace(GENERIC.watchdog, writes=(WrittenRegister(0x0210, DataType.UINT16, value=3),))
        own = replace(GENERIC, watchdog=watchdog, setup=(WrittenRegister(0x0107, DataType.UINT16, value=5),))
        plan = planned(TCP, 80.0, own)
        written = ("register 0107h = 5", "register 0210h = 3", "register 0204h = 63 ms, in ms", "register 0202h = 10")
        assert traffic_of(plan).guarding("handle", plan.axes[0].rig) == written
        none = planned(TCP, 80.0, replace(GENERIC, watchdog=None, mode=None), emergency_stop="power")
        assert traffic_of(none).guarding("handle", none.axes[0].rig) == ()

    def test_that_does_not_exist_caps_the_torque_and_needs_an_emergency_stop(self) -> None:
        alone = replace(GENERIC, watchdog=None)
        with pytest.raises(PlanError, match=r'has no watchdog that.*emergency_stop = "power"'):
            planned(TCP, 500.0, alone)
        (axis,) = planned(TCP, 500.0, alone, emergency_stop="power").axes
        assert axis.limits.holding == pytest.approx(0.05 * axis.rated_effort)
        assert on(RTU, drive="simplex_motion").axes[0].limits.effort == pytest.approx(0.05 * axis.rated_effort)


class TestLongestDelay:
    def test_takes_an_answer_time_that_is_sampled_early_or_late(self) -> None:
        delay = traffic_of(on(TCP, 1000.0)).delay("handle")
        assert delay.range == pytest.approx((delay.transport - ANSWER_TIME, delay.transport + ANSWER_TIME))
        one = traffic_of(on(RTU, 100.0)).delay("handle")
        assert one.range == pytest.approx((0.010 - ANSWER_TIME, 0.010)), "it writes before it reads"

    def test_takes_what_a_real_line_does_not_state(self) -> None:
        """Half a millisecond of adapter and a tenth of lateness, as on CAN."""
        section = ModbusSection("modbus-tcp", "10.0.0.1")
        unknown = real(section)
        assert unknown.delay.range[1] - unknown.delay.transport == pytest.approx(ANSWER_TIME + 0.5e-3 + 0.1e-3)
        stated = real(replace(section, round_trip=0.4e-3, jitter=0.05e-3))
        assert stated.delay.transport == pytest.approx(0.4e-3 + COMPUTE + ANSWER_TIME)
        assert stated.delay.range[1] - stated.delay.transport == pytest.approx(ANSWER_TIME + 0.05e-3)


def real(section: ModbusSection) -> Plan:
    """The wall on a real line whose rig states this."""
    axis = default_axis(Workspace.LINEAR, bus="line", node=1, profile="drive")
    return compile_plan(WALL, Rig({"line": section}, {"handle": axis}), {"drive": GENERIC}, 500.0)
