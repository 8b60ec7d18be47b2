"""Signals that show a set-point of another master before ours replaces it, and its time unseen, by hand."""

from dataclasses import replace

import pytest

from haptic_fieldbus.planning.explain import explain
from haptic_fieldbus.protocols.modbus.profile import ModbusProfile, Register
from haptic_fieldbus.protocols.modbus.register_traffic import Transaction
from haptic_fieldbus.protocols.traffic import OtherMasters
from haptic_fieldbus.signals import Signal
from tests.protocols.modbus.lines import (
    ANSWER_TIME,
    CHARACTER,
    COMPUTE,
    GENERIC,
    ROUND_TRIP,
    RTU,
    SILENCE,
    TCP,
    traffic_of,
    with_line,
)
from tests.protocols.modbus.test_traffic import planned, two_units

LAG = 3.0 / (2000.0 * 3.141592653589793)
"""Three time constants of 1 kHz [s]."""
EXCHANGE = ROUND_TRIP + ANSWER_TIME
ONE, TWO = (3, 23), (3, 16)
TARGET_READ = (8 + 7) * CHARACTER + 2 * SILENCE + ANSWER_TIME
"""Function 3 with one register on RTU, with the silence behind it [s]."""


def drive(functions: tuple[int, ...] = ONE, **torque: object) -> ModbusProfile:
    return replace(
        with_line(functions=functions),
        torque=replace(GENERIC.torque, **torque),  # type: ignore[arg-type]
    )


def seen(profile: ModbusProfile, bus: str = TCP, rate: float = 50.0) -> OtherMasters:
    return traffic_of(planned(bus, rate, profile)).other_masters("handle")


def test_the_echo_is_read_before_a_set_point_is_written_by_two_requests() -> None:
    found = seen(drive(TWO))
    assert (found.shown_by, found.every) == (Signal.TORQUE_DEMAND, 1)
    assert found.blind == pytest.approx(ROUND_TRIP + COMPUTE + 2 * ANSWER_TIME)
    assert Signal.TORQUE_ACTUAL not in signals(drive(TWO))


def test_function_23_reads_torque_actual_beside_the_echo_for_it() -> None:
    found = seen(drive(ONE))
    assert (found.shown_by, found.every) == (Signal.TORQUE_ACTUAL, 1)
    assert found.blind == pytest.approx(ANSWER_TIME + LAG)
    assert {Signal.TORQUE_ACTUAL, Signal.TORQUE_DEMAND} <= set(signals(drive(ONE)))


@pytest.mark.parametrize("functions", [ONE, TWO])
def test_an_echo_that_is_measured_shows_it_by_either_way(functions: tuple[int, ...]) -> None:
    profile = drive(functions, echo="actual", demand=None)
    found, between = seen(profile), 0.0 if functions == ONE else ROUND_TRIP + COMPUTE + ANSWER_TIME
    assert found.shown_by is Signal.TORQUE_ACTUAL
    assert found.blind == pytest.approx(between + ANSWER_TIME + LAG)


@pytest.mark.parametrize(
    ("profile", "way"),
    [
        (drive(ONE, actual=None), Transaction.READ_WRITE),
        (drive(ONE, echo="none"), Transaction.READ_WRITE),
        (drive(TWO, echo="none"), Transaction.READ_THEN_WRITE),
    ],
    ids=["demand alone", "none, one request", "none, two requests"],
)
def test_else_the_target_is_read_back_by_a_request_of_its_own(profile: ModbusProfile, way: Transaction) -> None:
    traffic, found = traffic_of(planned(TCP, 50.0, profile)), seen(profile)
    assert (traffic.way, found.shown_by, found.every) == (way, Signal.TARGET_ASKED, 1)
    if way is Transaction.READ_WRITE:
        assert found.blind == pytest.approx(EXCHANGE + ANSWER_TIME)
        assert traffic.shortest_period == pytest.approx(2 * EXCHANGE + COMPUTE)
        assert traffic.latch("handle") == pytest.approx(EXCHANGE + 0.5 * ROUND_TRIP + ANSWER_TIME)
    else:
        assert found.blind == pytest.approx(2 * EXCHANGE + COMPUTE + ANSWER_TIME)
        assert traffic.shortest_period == pytest.approx(3 * EXCHANGE + COMPUTE)
    assert signals(profile)[-2:] == [Signal.TARGET_ASKED, Signal.ASKED_PERIODS]


def test_a_torque_actual_that_another_request_reads_comes_too_late_to_show_it() -> None:
    """A value read behind function 23 is read behind our own set-point."""
    assert GENERIC.torque.actual is not None
    apart = drive(ONE, actual=replace(GENERIC.torque.actual, address=0x500))
    assert seen(apart).shown_by is Signal.TARGET_ASKED


def test_a_drive_that_shows_nothing_is_told_so() -> None:
    assert seen(drive((23,), actual=None)) == OtherMasters(None)


def test_the_read_back_of_a_line_takes_the_time_of_one_request_a_period() -> None:
    without, line = drive(ONE, actual=None), traffic_of(planned(RTU, 50.0, drive(ONE, actual=None)))
    assert line.instants.shown["handle"] == pytest.approx(8 * CHARACTER + SILENCE + ANSWER_TIME)
    both = replace(traffic_of(two_units(RTU, 20.0, without)), way=Transaction.READ_WRITE)
    one = replace(line, rate=20.0)
    assert both.shortest_period - one.shortest_period == pytest.approx(one.shortest_period - TARGET_READ, abs=1e-9)
    assert [both.other_masters(name).every for name in ("left", "right")] == [2, 2]


def test_a_plan_tells_what_is_read_back() -> None:
    text = explain(planned(TCP, 50.0, drive(ONE, actual=None)))
    assert "in         unit 1, before it is written, one unit of the line in each period\n" in text
    assert "             reads 1 from 0201h\n               register 0201h target torque\n" in text
    (axis,) = planned(TCP, 50.0, drive(ONE, actual=None)).axes
    assert "one unit in each period: reads target torque asked" in list(axis.traffic.summary())


def signals(profile: ModbusProfile) -> list[Signal]:
    (axis,) = planned(TCP, 50.0, profile, emergency_stop="power").axes
    return [mapped.signal for mapped in axis.traffic.incoming]


def test_two_registers_of_a_target_are_read_back_together() -> None:
    wide = drive(ONE, actual=None, target=Register(0x201, GENERIC.position.actual.type, GENERIC.torque.target.unit))  # type: ignore[union-attr]
    asked = traffic_of(planned(TCP, 50.0, wide)).of("handle").asked
    assert asked is not None
    assert (asked.address, asked.count) == (0x201, 2)
