"""A target torque that is read back on a real line: before it is written, that of one unit in each period."""

from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import replace

import pytest

from haptic_fieldbus.protocols.modbus.profile import ModbusProfile
from haptic_fieldbus.protocols.modbus.register_traffic import Transaction
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.signals import LinkFlag, Signal
from tests.builders import scene_of
from tests.buses.modbus.benches import PROFILE, Bench, plan_of
from tests.buses.modbus.servers import TARGET, Drive, Server, tcp_server

TWO = scene_of(Wall("left", 100.0, name="a"), Wall("right", 100.0, name="b"))
WITHOUT_ACTUAL = replace(PROFILE, torque=replace(PROFILE.torque, actual=None))
WITHOUT_ECHO = replace(PROFILE, torque=replace(PROFILE.torque, echo="none"))
READ_ONE = bytes((3, 2, 1, 0, 1))
"""Function 3 with the register of the target."""


@pytest.fixture
def opened() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack


def bench_on(stack: ExitStack, profile: ModbusProfile, way: Transaction) -> tuple[Bench, Server]:
    server = stack.enter_context(tcp_server(Drive()))
    return stack.enter_context(Bench(plan_of(server.name, profile, way=way))).open().enable(), server


def shown(bench: Bench, axis: int = 0) -> dict[Signal, int]:
    return dict(zip([m.signal for m in bench.plan.axes[axis].incoming], bench.decoded(axis)[4:], strict=True))


@pytest.mark.parametrize(
    ("profile", "way"),
    [
        (WITHOUT_ACTUAL, Transaction.READ_WRITE),
        (WITHOUT_ECHO, Transaction.READ_WRITE),
        (WITHOUT_ECHO, Transaction.READ_THEN_WRITE),
    ],
    ids=["demand alone, one request", "none, one request", "none, two requests"],
)
def test_it_is_what_another_master_has_written_before_ours_replaces_it(
    opened: ExitStack, profile: ModbusProfile, way: Transaction
) -> None:
    bench, server = bench_on(opened, profile, way)
    for torque in (40, -50):
        bench.write((0x0F, torque))
        bench.read()
        assert bench.header()[1] == 0
        if way is Transaction.READ_THEN_WRITE:
            assert server.drive.value(TARGET) == torque & 0xFFFF, "it is written in the same period"
        server.drive.registers[TARGET] = 777
        bench.read()
        assert (shown(bench)[Signal.TARGET_ASKED], shown(bench)[Signal.ASKED_PERIODS]) == (777, 1)
        bench.write((0x0F, torque))
        bench.read()
        assert server.drive.value(TARGET) == torque & 0xFFFF
    assert bench.bus.stop()


def test_it_goes_out_first_and_alone(opened: ExitStack) -> None:
    bench, server = bench_on(opened, WITHOUT_ACTUAL, Transaction.READ_WRITE)
    server.frames.clear()
    for _ in range(3):
        bench.write((0x0F, 10))
        bench.read()
    assert [frame[7] for frame in server.frames] == [3, 23] * 3
    assert server.frames[0][7:12] == READ_ONE


def test_two_units_take_turns(opened: ExitStack) -> None:
    server = opened.enter_context(tcp_server(Drive(1), Drive(2)))
    bench = opened.enter_context(Bench(plan_of(server.name, WITHOUT_ACTUAL, way=Transaction.READ_WRITE, scene=TWO)))
    bench.open().enable()
    server.frames.clear()
    came = []
    for _ in range(4):
        bench.write((0x0F, 10), (0x0F, -20))
        bench.read()
        came.append([shown(bench, axis)[Signal.ASKED_PERIODS] for axis in (0, 1)])
    assert sorted(came[:2]) == [[0, 1], [1, 0]]
    assert came[2:] == came[:2]
    assert [frame[7] for frame in server.frames] == [3, 23, 23] * 4


def test_an_answer_that_stays_away_is_missing_feedback(opened: ExitStack) -> None:
    bench, server = bench_on(opened, WITHOUT_ACTUAL, Transaction.READ_WRITE)
    honest = server.mischief

    def silent(frame: bytes, asked: int) -> Iterator[bytes | float | None]:
        if frame[7] != 3:
            yield frame

    server.mischief = silent
    bench.write((0x0F, 10))
    bench.read(0.03)
    assert bench.header()[1] & LinkFlag.STALE
    assert shown(bench)[Signal.ASKED_PERIODS] == 0
    server.mischief = honest
    for _ in range(3):
        bench.write((0x0F, 10))
        bench.read()
    assert bench.header()[1] == 0
