"""The way to zero torque on real lines, whatever the drive, the line or somebody's program does meanwhile."""

import re
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack
from dataclasses import replace
from threading import Event
from typing import Any

import pytest

from haptic_fieldbus.buses.modbus import transport
from haptic_fieldbus.buses.modbus.requester import Requester
from haptic_fieldbus.cycle.cycle import Cycle
from haptic_fieldbus.errors import BusError, BusTimeoutError, DriveFaultError, HapticFieldbusError
from haptic_fieldbus.protocols.modbus.register_traffic import Transaction
from haptic_fieldbus.running.loop import UNCONFIRMED
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.signals import LinkFlag
from tests.builders import scene_of
from tests.buses.modbus.benches import PROFILE, Bench, plan_of
from tests.buses.modbus.servers import (
    COMMAND,
    DEMAND,
    ENABLED,
    ERROR,
    FAULT,
    LIMIT,
    STATUS,
    TARGET,
    WATCHDOG,
    Drive,
    Server,
    rtu_server,
    tcp_server,
)
from tests.whole_loop import run_loop

Lines = Callable[..., AbstractContextManager[Server]]
LINES: dict[str, Lines] = {"tcp": tcp_server, "rtu": rtu_server}
BOTH = ("tcp", pytest.param("rtu", marks=pytest.mark.thorough("listens to the serial line first")))
Piece = bytes | float | None


@pytest.fixture
def opened() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack


def pushing(
    stack: ExitStack, line: str, way: Transaction | None = None, drive: Drive | None = None
) -> tuple[Bench, Server]:
    """A master whose drive gives torque."""
    server = stack.enter_context(LINES[line](drive or Drive()))
    bench = stack.enter_context(Bench(plan_of(server.name, way=way))).open().enable()
    bench.write((0x0F, 200))
    bench.read()
    assert server.drive.value(DEMAND) == 200
    return bench, server


def silent(frame: bytes, asked: int) -> Iterator[Piece]:
    yield from ()


def off(drive: Drive) -> bool:
    return (drive.value(STATUS), drive.value(DEMAND), drive.value(TARGET)) == (0x40, 0, 0)


@pytest.mark.parametrize("way", Transaction)
@pytest.mark.parametrize("line", LINES)
def test_the_first_thing_that_goes_out_is_zero_torque(opened: ExitStack, line: str, way: Transaction) -> None:
    bench, server = pushing(opened, line, way)
    bench.write((0x0F, 300))  # with function 23 it has not gone out yet, and never does
    before = len(server.drive.written)
    assert bench.bus.stop() is True
    first = [each for each in server.drive.written[before:] if each != (TARGET, 300) and each != (COMMAND, 0x0F)][:2]
    assert first == [(TARGET, 0), (COMMAND, 0)]
    assert off(server.drive)
    # On a slow computer a request may be repeated before its answer comes, which is then dropped.
    assert [each for each in bench.bus.warnings if "answers were dropped" not in each] == []
    if way is Transaction.READ_WRITE:
        assert (TARGET, 300) not in server.drive.written


def test_a_second_stop_and_one_before_anything_was_written_do_nothing(opened: ExitStack) -> None:
    bench, server = pushing(opened, "tcp")
    assert bench.bus.stop() is True
    requests = len(server.frames)
    assert bench.bus.stop() is True
    assert len(server.frames) == requests


@pytest.mark.parametrize("line", BOTH)
def test_lost_requests_are_repeated_until_the_drive_is_off(opened: ExitStack, line: str) -> None:
    class Deaf(Drive):
        lost = 0

        def answer(self, pdu: bytes) -> bytes:
            if self.lost:
                self.lost -= 1
                raise LostError
            return super().answer(pdu)

    drive = Deaf()
    bench, server = pushing(opened, line, drive=drive)
    serve = server._answers

    def lossy(frame: bytes) -> Iterator[Piece]:
        try:
            yield from serve(frame)
        except LostError:
            return

    server._answers = lossy  # type: ignore[method-assign]
    drive.lost = 3
    assert bench.bus.stop() is True
    assert off(drive)


class LostError(Exception):
    """A request that a drive did not get."""


class Machine:
    """How long something took, and how much of it this machine withheld from a bare timer beside it [s]."""

    STEP = 0.005

    def __init__(self) -> None:
        self.seconds = self.withheld = 0.0
        self.watches = False
        self.timer = threading.Thread(target=self.tick, daemon=True)

    def __enter__(self) -> "Machine":
        self.watches, self.began = True, time.monotonic()
        self.timer.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.seconds, self.watches = time.monotonic() - self.began, False
        self.timer.join()

    def tick(self) -> None:
        while self.watches:
            before = time.monotonic()
            time.sleep(self.STEP)
            self.withheld += time.monotonic() - before - self.STEP


def test_a_drive_that_confirms_nothing_is_told_after_its_watchdog_and_still_gets_zero_torque(opened: ExitStack) -> None:
    bench, server = pushing(opened, "tcp")
    before = server.drive.written.count((TARGET, 0))
    server.mischief = silent
    with Machine() as machine:
        assert bench.bus.stop() is False
    guard = bench.plan.guards[0].seconds
    # 50 ms of grace, six answers of 15 ms, and one that a server with Nagle's algorithm holds back for 40 ms.
    assert guard < machine.seconds < guard + 0.3 + machine.withheld
    assert off(server.drive)
    assert server.drive.written.count((TARGET, 0)) - before == 2  # each feeds the watchdog
    assert "unit 1 (axis handle) did not confirm that its motor is off" in bench.bus.warnings


def waits_of(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Return a list that takes how long each answer is waited for from now on [ns]."""
    waits: list[int] = []
    answer = Requester.answer

    def noted(self: Requester, deadline_ns: int) -> Any:
        waits.append(deadline_ns - self.clock.now_ns())
        return answer(self, deadline_ns)

    monkeypatch.setattr(Requester, "answer", noted)
    return waits


def test_a_silent_line_holds_up_the_other_lines_of_a_rig_for_two_milliseconds_at_a_time(
    opened: ExitStack, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench, server = pushing(opened, "tcp")
    server.mischief = silent
    waits = waits_of(monkeypatch)
    bench.bus.release()
    while not bench.bus.settle():
        pass
    assert 1_000_000 < max(waits) <= 2_000_000


def test_a_silent_drive_without_a_watchdog_is_tried_to_be_freed_for_a_second(opened: ExitStack) -> None:
    server = opened.enter_context(tcp_server(Drive()))
    plan = plan_of(server.name, replace(PROFILE, watchdog=None), emergency_stop="power")
    bench = opened.enter_context(Bench(plan)).open().enable()
    server.mischief = silent
    with Machine() as machine:
        assert bench.bus.stop() is False
    assert 1.0 <= machine.seconds < 1.5 + machine.withheld


@pytest.mark.thorough("listens to the serial line first")
def test_on_a_slow_line_an_answer_has_the_time_that_its_octets_take(
    opened: ExitStack, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Eight octets of a request and seven of its answer, of 11 bits each."""
    server = opened.enter_context(rtu_server(Drive()))
    bench = opened.enter_context(Bench(plan_of(server.name, rate=5.0, section={"baud": 4800}))).open().enable()
    server.mischief = silent
    waits = waits_of(monkeypatch)
    assert bench.bus.stop() is False
    assert max(waits) >= 1e9 * 15 * 11 / 4800


@pytest.mark.parametrize("quickack", [True, False], ids=["at once", "after 40 ms"])
@pytest.mark.parametrize("way", Transaction)
def test_a_server_with_nagles_algorithm_confirms_that_it_is_off(
    opened: ExitStack, monkeypatch: pytest.MonkeyPatch, way: Transaction, quickack: bool
) -> None:
    """Zero torque follows a request whose answer is late; its own is then held back until that one is acknowledged."""
    if not quickack:
        monkeypatch.setattr(transport, "QUICKACK", None)
    server = opened.enter_context(tcp_server(Drive(), nagle=True))
    bench = opened.enter_context(Bench(plan_of(server.name, way=way, rate=4.0))).open().enable()
    for _ in range(50):  # the kernel acknowledges at once until it takes the connection for a dialogue
        bench.write((0x0F, 200))
        bench.read()
    released = Event()

    def late(frame: bytes, asked: int) -> Iterator[Piece]:
        server.mischief = honestly
        released.wait(10.0)
        yield frame

    server.mischief = late
    bench.write((0x0F, 200))
    bench.read(0.001)
    bench.bus.release()
    released.set()
    while not bench.bus.settle():
        pass
    assert bench.bus.leave() is True
    assert server.drive.value(DEMAND) == 0
    assert not [warning for warning in bench.bus.warnings if "did not confirm" in warning]


def test_a_drive_that_refuses_to_be_put_back_is_told(opened: ExitStack) -> None:
    class Keeps(Drive):
        def write(self, address: int, value: int) -> None:
            if address == WATCHDOG and not value:
                raise KeyError
            super().write(address, value)

    bench, _ = pushing(opened, "tcp", drive=Keeps())
    assert bench.bus.stop() is True
    (told,) = bench.bus.warnings
    assert "keeps register 0204h (exception 2), which could not be put back" in told


def test_a_reset_connection_is_opened_again_for_zero_torque_alone(opened: ExitStack) -> None:
    bench, server = pushing(opened, "tcp")

    def reset(frame: bytes, asked: int) -> Iterator[Piece]:
        server.cut()
        server.mischief = honestly
        yield None

    server.mischief = reset
    with pytest.raises(BusError, match="connection"):
        bench.read()
    assert server.drive.value(DEMAND) == 200
    assert bench.bus.stop() is True
    assert off(server.drive)
    assert ENABLED not in [value for address, value in server.drive.written[-10:] if address == COMMAND]


def honestly(frame: bytes, asked: int) -> Iterator[Piece]:
    yield frame


@pytest.mark.thorough("listens to the serial line first")
def test_all_units_of_a_line_get_zero_torque_before_any_is_asked_whether_it_is_off(opened: ExitStack) -> None:
    drives = [Drive(unit=1), Drive(unit=2), Drive(unit=3)]
    server = opened.enter_context(rtu_server(*drives))
    scene = scene_of(*(Wall(name, stiffness=10.0) for name in "abc"))
    bench = opened.enter_context(Bench(plan_of(server.name, scene=scene, rate=25.0))).open().enable()
    bench.write((0x0F, 1), (0x0F, 2), (0x0F, 3))
    bench.read()
    requests = len(server.frames)
    assert bench.bus.stop() is True
    assert all(off(drive) for drive in drives)
    zeros = [at for at, frame in enumerate(server.frames[requests:]) if frame[2:6] == bytes((2, 1, 0, 0))]
    asked = [at for at, frame in enumerate(server.frames[requests:]) if frame[1] == 3 and frame[2:4] == bytes((1, 0))]
    assert {server.frames[requests + at][0] for at in zeros} == {1, 2, 3}
    assert max(zeros) < min(at for at in asked if server.frames[requests + at][0] != 1) + 3


@pytest.mark.thorough("a second of real time")
def test_a_unit_that_is_silent_holds_up_zero_torque_of_no_other_one(opened: ExitStack) -> None:
    drives = [Drive(unit=1), Drive(unit=2)]
    server = opened.enter_context(tcp_server(*drives))
    scene = scene_of(*(Wall(name, stiffness=10.0) for name in "ab"))
    bench = opened.enter_context(Bench(plan_of(server.name, scene=scene))).open().enable()
    bench.write((0x0F, 1), (0x0F, 2))
    bench.read()
    server.mischief = lambda frame, asked: iter((frame,) if frame[6] == 2 else ())
    bench.read()
    requests = len(server.frames)
    assert bench.bus.stop() is False
    assert drives[1].value(DEMAND) == 0
    first = server.frames[requests]
    assert (first[6], first[-4:]) == (2, bytes((2, 1, 0, 0))), "unit, register and value"


def test_a_fault_of_the_drive_is_told_with_its_code(opened: ExitStack) -> None:
    bench, server = pushing(opened, "tcp")
    server.drive.registers |= {STATUS: FAULT, ERROR: 0x2310}
    assert bench.bus.stop() is True
    assert bench.bus.causes == {"handle": (LinkFlag.EMERGENCY, 0x2310)}


Break = Callable[[Server], None]


def goes_silent(server: Server) -> None:
    server.mischief = silent


def resets(server: Server) -> None:
    def reset(frame: bytes, asked: int) -> Iterator[Piece]:
        server.cut()
        yield None

    server.mischief = reset


def refuses(server: Server) -> None:
    server.drive.exceptions = {3: 4, 23: 4}


def faults(server: Server) -> None:
    server.drive.registers |= {STATUS: FAULT, ERROR: 0x2310, DEMAND: 0}


def falls_asleep(server: Server) -> None:
    def slow(frame: bytes, asked: int) -> Iterator[Piece]:
        yield 0.03
        yield frame

    server.mischief = slow


BREAKS: dict[str, tuple[Break, type[HapticFieldbusError], str]] = {
    "silent": (goes_silent, BusTimeoutError, "feedback lost: the last from node 1 is"),
    "slow": (falls_asleep, BusTimeoutError, "the last from node 1 is|feedback lost too often"),
    "reset": (resets, BusError, "connection|gone"),
    "exception": (refuses, BusError, r"refused a request with exception 4 \(server device failure\)"),
    "fault": (faults, DriveFaultError, "2310h"),
}


ATTEMPTS = 10
"""On a computer so busy that a run ends before anything breaks."""


def broken(opened: ExitStack, line: str, break_it: Break) -> tuple[Server, Bench, Machine, HapticFieldbusError]:
    """A run that breaks in its first period: how long it went on then, and how it ended."""
    server = opened.enter_context(LINES[line](Drive()))
    plan = plan_of(server.name, scene=scene_of(Wall("handle", stiffness=20.0, position=-0.05)), rate=80.0)
    plan = replace(plan, axes=tuple(replace(axis, sign_known=True) for axis in plan.axes))
    bench, machine = opened.enter_context(Bench(plan)), Machine()
    bench.bus.open(plan)

    def progress(done: int) -> None:
        if not machine.watches:
            machine.__enter__()
            break_it(server)

    with pytest.raises(HapticFieldbusError) as raised:
        run_loop(plan, Cycle(plan), bench.bus, bench.clock, cycles=400, progress=progress)
    return server, bench, machine, raised.value


@pytest.mark.thorough("runs each until it ends", quick=("tcp-reset",))
@pytest.mark.parametrize("what", BREAKS)
@pytest.mark.parametrize("line", LINES)
def test_a_run_that_breaks_ends_torque_free_in_time_with_a_sentence_and_does_not_resume(
    opened: ExitStack, line: str, what: str
) -> None:
    break_it, error, words = BREAKS[what]
    for _ in range(ATTEMPTS):
        server, bench, machine, raised = broken(opened, line, break_it)
        if machine.watches:
            break
        assert server.drive.value(DEMAND) == 0  # it ended before, on a busy computer
    assert machine.watches, raised
    machine.__exit__()
    assert isinstance(raised, error), raised
    assert re.search(words, str(raised))
    plan = bench.plan
    longest = max(deadline.seconds for deadline in plan.deadlines)
    assert machine.seconds < longest + plan.guards[0].seconds + 0.3 + machine.withheld
    confirmed = UNCONFIRMED not in getattr(raised, "__notes__", ())
    if confirmed:
        assert server.drive.value(DEMAND) == 0
    # The drive's own watch ends it where nobody reached the drive.
    server.drive.now = lambda: time.monotonic() + plan.guards[0].seconds
    server.drive.watch()
    assert server.drive.value(STATUS) != ENABLED
    writes = len(server.drive.written)
    bench.bus.close()
    assert server.drive.written[-1] == (TARGET, 0) or all(
        value == 0 or address not in (TARGET, COMMAND) for address, value in server.drive.written[writes:]
    )


def test_the_torque_limit_is_put_back_on_the_way(opened: ExitStack) -> None:
    bench, server = pushing(opened, "tcp")
    assert bench.bus.stop() is True
    assert server.drive.value(LIMIT) == 1000
    assert PROFILE.torque.limit is not None
