"""One period on a real line: what goes out when, what comes in, and what a bad server can do to it."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass, field, replace
from threading import Event

import pytest

from haptic_fieldbus.errors import BusError
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.protocols.modbus.register_traffic import Transaction
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.signals import LinkFlag
from tests.builders import scene_of
from tests.buses.modbus.benches import PROFILE, Bench, plan_of
from tests.buses.modbus.servers import (
    COMMAND,
    DEMAND,
    ENABLED,
    FAULT,
    POSITION,
    RATED,
    STATUS,
    TARGET,
    Drive,
    Mischief,
    Server,
    crc,
    honest,
    rtu_server,
    tcp_server,
)

Lines = Callable[..., AbstractContextManager[Server]]
LINES: dict[str, Lines] = {"tcp": tcp_server, "rtu": rtu_server}
BOTH = ("tcp", pytest.param("rtu", marks=pytest.mark.thorough("listens to the serial line first")))
STALE, EXCEPTION = int(LinkFlag.STALE), int(LinkFlag.EXCEPTION)
DEADLINE = 0.03
"""[s] of a reading part that meets a bad server."""
Piece = bytes | float | None


@pytest.fixture
def opened() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack


def bench_on(stack: ExitStack, line: str, way: Transaction | None = None, **changes: object) -> tuple[Bench, Server]:
    """A master on a server with one drive, enabled."""
    server = stack.enter_context(LINES[line](Drive()))
    bench = stack.enter_context(Bench(plan_of(server.name, way=way, **changes)))  # type: ignore[arg-type]
    return bench.open().enable(), server


@pytest.mark.thorough("over every line in every way", quick=2)
@pytest.mark.parametrize("way", Transaction)
@pytest.mark.parametrize("line", LINES)
def test_a_period_carries_feedback_in_and_torque_out(opened: ExitStack, line: str, way: Transaction) -> None:
    bench, server = bench_on(opened, line, way)
    server.drive.move_to(-7_000_001 & 0xFFFF_FFFF)
    bench.write((0x0F, 123))
    _, age_ns, flags, _, statusword, position, *_, demand = bench.read()
    assert (statusword, position, flags) == (ENABLED, -7_000_001, 0)
    assert server.drive.value(DEMAND) == demand == 123
    assert 0 <= age_ns < 1e9


@pytest.mark.parametrize("line", BOTH)
def test_function_23_carries_the_torque_of_the_period_before_and_writes_before_it_reads(
    opened: ExitStack, line: str
) -> None:
    bench, server = bench_on(opened, line, Transaction.READ_WRITE)
    for torque in (10, -20, 30):
        requests = len(server.frames)
        bench.write((0x0F, torque))
        assert len(server.frames) == requests
        assert bench.read()[-1] == torque  # the demand, of the same answer
        (frame,) = server.frames[requests:]
        body = frame[7:] if line == "tcp" else frame[1:-2]
        assert body[0] == 23
        assert body[-2:] == (torque & 0xFFFF).to_bytes(2, "big")


def test_a_set_point_is_sent_once_so_that_a_loop_that_hangs_feeds_no_watchdog(opened: ExitStack) -> None:
    bench, server = bench_on(opened, "tcp", Transaction.READ_WRITE)
    bench.write((0x0F, 7))
    bench.read()
    written = len(server.drive.written)
    for _ in range(3):
        bench.read()
    assert len(server.drive.written) == written
    assert [frame[7] for frame in server.frames[-3:]] == [3, 3, 3]


def test_a_set_point_that_was_not_sent_is_replaced_by_a_newer_one(opened: ExitStack) -> None:
    bench, server = bench_on(opened, "tcp", Transaction.READ_WRITE)
    bench.write((0x0F, 7))
    bench.write((0x0F, 8))
    bench.read()
    assert server.drive.value(TARGET) == 8
    assert (TARGET, 7) not in server.drive.written


def silent(frame: bytes, asked: int) -> Iterator[Piece]:
    yield from ()


def slow(frame: bytes, asked: int) -> Iterator[Piece]:
    yield DEADLINE + 0.005
    yield frame


def garbage(frame: bytes, asked: int) -> Iterator[Piece]:
    yield bytes(range(0x50, 0x50 + len(frame)))


def truncated(frame: bytes, asked: int) -> Iterator[Piece]:
    yield frame[:-1]


def another_unit(frame: bytes, asked: int) -> Iterator[Piece]:
    if frame[2:4] == b"\x00\x00" and frame[6] == 1:
        yield frame[:6] + b"\x02" + frame[7:]
    else:
        yield b"\x02" + frame[1:-2] + crc(b"\x02" + frame[1:-2])


def bad_check(frame: bytes, asked: int) -> Iterator[Piece]:
    """A wrong checksum; on TCP, which has none, a wrong transaction id."""
    tcp = frame[2:4] == b"\x00\x00"
    yield bytes((frame[0] ^ 0x55, *frame[1:])) if tcp else bytes((*frame[:-1], frame[-1] ^ 0xFF))


def shorter(frame: bytes, asked: int) -> Iterator[Piece]:
    """A sound answer with a register less than was asked for."""
    if frame[2:4] == b"\x00\x00" and frame[6] == 1:
        body = frame[6:8] + bytes((frame[8] - 2,)) + frame[9:-2]
        yield frame[:4] + len(body).to_bytes(2, "big") + body
    else:
        body = frame[:2] + bytes((frame[2] - 2,)) + frame[3:-4]
        yield body + crc(body)


BAD: dict[str, Mischief] = {
    "silent": silent, "slow": slow, "garbage": garbage, "truncated": truncated, "another unit": another_unit,
    "bad check": bad_check, "shorter": shorter,
}  # fmt: skip


@pytest.mark.thorough("waits for the deadlines of all of them", quick=3)
@pytest.mark.parametrize("mischief", BAD)
@pytest.mark.parametrize("way", Transaction)
@pytest.mark.parametrize("line", LINES)
def test_a_bad_answer_makes_the_axis_stale_in_time_and_never_gives_a_wrong_position(
    opened: ExitStack, line: str, way: Transaction, mischief: str
) -> None:
    bench, server = bench_on(opened, line, way)
    before = _moved(bench, server, 1)
    assert before == 10
    server.mischief = BAD[mischief]
    waited_ns, taken = [], 1
    for number in range(2, 5):
        server.drive.move_to(10 * number)
        bench.write((0x0F, 0))
        began_ns = bench.clock.now_ns()
        _, age_ns, flags, _, _, position, *_ = bench.read(DEADLINE)
        waited_ns.append(bench.clock.now_ns() - began_ns)
        if mischief == "slow" and flags == 0 and waited_ns[-1] > 1e9 * DEADLINE:
            # This computer stood still until the answer was there: a sample of now.
            before, taken = 10 * number, number
        else:
            assert flags == STALE
            assert age_ns > 0.5e9 * DEADLINE * (number - taken)
        assert position == before
    assert min(waited_ns) < 1e9 * (DEADLINE + 0.02), "a busy machine may be late, but not each time"
    server.mischief = honest
    found = [_moved(bench, server, number) for number in range(5, 9)]
    # What is late may cost another sample, on a busy machine more of them, but none is taken for one of now.
    while found[-1] is None and len(found) < 50:
        found.append(_moved(bench, server, 5 + len(found)))
    assert found[-1] == 10 * (4 + len(found))
    assert all(each in (None, 10 * number) for number, each in enumerate(found, 5))


def _moved(bench: Bench, server: Server, number: int) -> int | None:
    """The position in a period before which the drive was moved; None when it is stale."""
    server.drive.move_to(10 * number)
    _, _, flags, _, _, position, *_ = bench.read(DEADLINE)
    bench.write((0x0F, 0))
    return None if flags & STALE else position


@pytest.mark.thorough("each answer waits for more than a period", quick=("tcp-read_write",))
@pytest.mark.parametrize("way", Transaction, ids=lambda way: way.name.lower())
@pytest.mark.parametrize("line", LINES)
def test_answers_that_always_come_a_period_late_are_never_taken_for_those_of_now(
    opened: ExitStack, line: str, way: Transaction
) -> None:
    bench, server = bench_on(opened, line, way)
    server.mischief = slow
    for number in range(1, 12):
        assert _moved(bench, server, number) in (None, 10 * number)


@pytest.mark.parametrize("code", [1, 6])
@pytest.mark.parametrize("way", Transaction)
def test_an_exception_is_flagged_with_its_code(opened: ExitStack, way: Transaction, code: int) -> None:
    bench, server = bench_on(opened, "tcp", way)
    server.drive.exceptions = dict.fromkeys((3, 23), code)
    bench.write((0x0F, 0))
    bench.read()
    _, flags, told = bench.header()
    assert (flags, told) == (STALE | EXCEPTION, code)
    assert f"exception {code}" in bench.plan.axes[0].traffic.fault_text(LinkFlag.EXCEPTION, told)
    server.drive.exceptions = {}
    bench.read()
    assert bench.header()[1] == 0


def test_a_refused_set_point_is_flagged_in_the_next_period(opened: ExitStack) -> None:
    bench, server = bench_on(opened, "tcp", Transaction.READ_THEN_WRITE)
    server.drive.exceptions = {16: 4}
    bench.write((0x0F, 0))
    bench.read()
    assert bench.header()[1:] == (EXCEPTION, 4)


@pytest.mark.parametrize("line", BOTH)
def test_a_dead_line_ends_the_exchange_in_a_sentence(opened: ExitStack, line: str) -> None:
    bench, server = bench_on(opened, line)

    def cut(frame: bytes, asked: int) -> Iterator[Piece]:
        server.cut()
        yield None

    server.mischief = cut
    with pytest.raises(BusError, match=r"connection|gone"):
        exchanged(bench, 3)


def exchanged(bench: Bench, periods: int) -> None:
    for _ in range(periods):
        bench.read(DEADLINE)
        bench.write((0x0F, 0))


@dataclass
class Held:
    """Holds answers back until it is told to let them go."""

    gate: Event = field(default_factory=Event)

    def __call__(self, frame: bytes, asked: int) -> Iterator[Piece]:
        self.gate.wait(10.0)
        yield frame


PATIENT = 2.0
"""[Hz]; at this rate an answer counts as lost after a second."""


@pytest.mark.parametrize("way", Transaction)
def test_on_tcp_nothing_is_sent_while_an_answer_is_outstanding(opened: ExitStack, way: Transaction) -> None:
    bench, server = bench_on(opened, "tcp", way, rate=PATIENT)
    bench.write((0x0F, -100))
    bench.read()
    frames = len(server.frames)
    server.mischief = silent
    for torque in (-100, -100, 120, -80, 0, 50):
        bench.write((0x0F, torque))
        bench.read(0.002)
    server.mischief = honest
    assert bench.bus.stop() is True
    first, then = server.frames[frames : frames + 2]
    assert first[7] == (23 if way is Transaction.READ_WRITE else 16)
    assert then[7:12] == bytes((6, 2, 1, 0, 0)), "zero torque comes next"


def held_back(stack: ExitStack, way: Transaction) -> tuple[Bench, Server, Held]:
    """A master that waits for an answer of the period before, at the begin of the next one."""
    bench, server = bench_on(stack, "tcp", way, rate=PATIENT)
    server.drive.move_to(10)
    server.mischief = held = Held()
    return bench, server, held


def next_period(bench: Bench, held: Held) -> tuple[int, ...]:
    """Begin a period, let the answers go, and return what the cycle would decode."""
    deadline_ns = bench.clock.now_ns() + 5_000_000_000
    bench.bus.prepare(deadline_ns)
    bench.bus.begin()
    held.gate.set()
    bench.image = bytes(bench.bus.collect(deadline_ns))
    return bench.decoded()


@pytest.mark.parametrize("way", Transaction)
def test_a_sample_of_an_earlier_question_counts_for_the_age_that_it_has(opened: ExitStack, way: Transaction) -> None:
    bench, server, held = held_back(opened, way)
    frames, begun_ns = len(server.frames), bench.clock.now_ns()
    assert bench.read(0.01)[2] == STALE
    next_ns = bench.clock.now_ns()
    t_ns, age_ns, flags, _, _, position, *_ = next_period(bench, held)
    assert (flags, position) == (0, 10)
    assert len(server.frames) == frames + 1, "no second question"
    assert begun_ns <= t_ns < next_ns
    assert next_ns - t_ns <= age_ns <= bench.clock.now_ns() - t_ns
    server.drive.move_to(20)
    assert bench.read()[5] == 20


def test_a_late_answer_to_a_set_point_leaves_the_line_free_in_the_same_period(opened: ExitStack) -> None:
    bench, _, held = held_back(opened, Transaction.READ_THEN_WRITE)
    bench.write((0x0F, 40))
    bench.bus.prepare(bench.clock.now_ns() + 1_000_000)
    _, _, flags, _, _, position, *_, demand = next_period(bench, held)
    assert (flags, position, demand) == (0, 10, 40)


@pytest.mark.parametrize("way", Transaction)
def test_a_late_exception_is_flagged(opened: ExitStack, way: Transaction) -> None:
    bench, server, held = held_back(opened, way)
    server.drive.exceptions = dict.fromkeys((3, 23), 6)
    bench.read(0.01)
    next_period(bench, held)
    assert bench.header()[1:] == (STALE | EXCEPTION, 6)
    server.drive.exceptions = {}


@pytest.mark.parametrize("way", Transaction)
def test_a_late_sample_of_one_unit_is_not_taken_for_that_of_another(opened: ExitStack, way: Transaction) -> None:
    drives = [Drive(unit=1), Drive(unit=2)]
    server = opened.enter_context(tcp_server(*drives))
    scene = scene_of(Wall("a", stiffness=30.0), Wall("b", stiffness=30.0))
    bench = opened.enter_context(Bench(plan_of(server.name, way=way, scene=scene, rate=PATIENT))).open().enable()
    for drive, counts in zip(drives, (11, 22), strict=True):
        drive.move_to(counts)
    held = Held()

    def second_alone(frame: bytes, asked: int) -> Iterator[Piece]:
        return held(frame, asked) if frame[6] == 2 else honest(frame, asked)

    server.mischief = second_alone
    bench.read(0.4)
    assert [bench.header(axis)[1] for axis in (0, 1)] == [0, STALE]
    assert [bench.decoded(axis)[5] for axis in (0, 1)] == [11, 0]
    next_period(bench, held)
    assert [bench.header(axis)[1] for axis in (0, 1)] == [0, 0]
    assert [bench.decoded(axis)[5] for axis in (0, 1)] == [11, 22]


def test_after_function_23_stayed_unanswered_a_serial_line_gets_the_set_point_by_another_function(
    opened: ExitStack,
) -> None:
    bench, server = bench_on(opened, "rtu", Transaction.READ_WRITE)
    server.mischief = silent
    functions = len(server.frames)
    bench.write((0x0F, 5))
    bench.read(DEADLINE)
    server.mischief = honest
    bench.write((0x0F, 6))
    assert bench.read()[2] == STALE
    assert server.drive.value(TARGET) == 6
    bench.write((0x0F, 7))
    assert bench.read()[2] == 0
    assert [frame[1] for frame in server.frames[functions:]] == [23, 16, 23]


def separate(name: str) -> Plan:
    """A plan for a drive whose command and target torque are no neighbours."""
    target = replace(PROFILE.torque.target, address=0x0106)
    profile = replace(PROFILE, torque=replace(PROFILE.torque, target=target))
    return plan_of(name, profile, way=Transaction.READ_THEN_WRITE)


def test_a_command_takes_the_place_of_the_set_point_until_it_is_answered(opened: ExitStack) -> None:
    server = opened.enter_context(tcp_server(Drive()))
    bench = opened.enter_context(Bench(separate(server.name))).open()
    bench.read()
    writes = len(server.drive.written)
    server.drive.exceptions = {6: 6}
    bench.write((0x06, 0))
    bench.read()
    server.drive.exceptions = {}
    for controlword, torque in ((0x06, 0), (0x06, 0), (0x0F, 0), (0x0F, 5)):
        bench.write((controlword, torque))
        bench.read()
    expected = [(COMMAND, 0x06), (0x0106, 0), (COMMAND, 0x0F), (0x0106, 5)]
    assert server.drive.written[writes:] == expected


@pytest.mark.parametrize("way", Transaction)
@pytest.mark.parametrize("line", BOTH)
def test_units_of_one_line_take_turns(opened: ExitStack, line: str, way: Transaction) -> None:
    drives = [Drive(unit=1), Drive(unit=2)]
    server = opened.enter_context(LINES[line](*drives))
    scene = scene_of(Wall("a", stiffness=30.0), Wall("b", stiffness=30.0))
    bench = opened.enter_context(Bench(plan_of(server.name, way=way, scene=scene, rate=30.0))).open().enable()
    for drive, counts in zip(drives, (11, 22), strict=True):
        drive.move_to(counts)
    requests = len(server.frames)
    bench.write((0x0F, 3), (0x0F, 4))
    bench.read()
    assert [bench.decoded(axis)[5] for axis in (0, 1)] == [11, 22]
    assert [drive.value(TARGET) for drive in drives] == [3, 4]
    units = [frame[6 if line == "tcp" else 0] for frame in server.frames[requests:]]
    assert units == ([1, 2] if way is Transaction.READ_WRITE else [1, 2, 1, 2])


@pytest.mark.thorough("listens to the serial line first")
def test_a_silent_unit_costs_the_others_no_sample_on_a_serial_line(opened: ExitStack) -> None:
    drives = [Drive(unit=1), Drive(unit=2)]
    server = opened.enter_context(rtu_server(*drives))
    scene = scene_of(Wall("a", stiffness=30.0), Wall("b", stiffness=30.0))
    bench = opened.enter_context(Bench(plan_of(server.name, scene=scene, rate=30.0))).open().enable()
    del server.drives[1]
    bench.write((0x0F, 0), (0x0F, 0))
    bench.read(0.1)
    assert [bench.header(axis)[1] for axis in (0, 1)] == [STALE, 0]


def test_a_torn_position_is_dropped_and_told_but_a_motion_is_not(opened: ExitStack) -> None:
    bench, server = bench_on(opened, "tcp")
    # Each more than once: these readings are not evenly spaced, so a speed may predict anything.
    for counts in (40_000, 40_000, 65_530, 65_530, 65_530):
        server.drive.move_to(counts)
        assert bench.read()[5] == counts
    server.drive.move_to(65_530 + 65_540)  # the high word of now, the low one of before
    assert bench.read()[2] & STALE
    assert bench.decoded()[5] == 65_530
    server.drive.move_to(65_545)
    assert bench.read()[2:6] == (0, 0, ENABLED, 65_545)
    assert bench.read()[5] == 65_545
    server.drive.move_to(65_545 + 65_536)
    assert bench.read()[2] & STALE
    assert bench.read()[5] == 65_545 + 65_536  # twice the same: it is there
    bench.bus.stop()
    assert any("jumps of about 65536 counts" in warning for warning in bench.bus.warnings)


@pytest.mark.thorough("listens to the serial line first")
def test_a_command_of_somebody_else_on_a_serial_line_is_flagged(opened: ExitStack) -> None:
    bench, server = bench_on(opened, "rtu")

    def and_another(frame: bytes, asked: int) -> Iterator[Piece]:
        yield frame
        request = bytes((1, 16, 2, 1, 0, 1, 2, 0, 50))
        yield 0.002
        yield request + crc(request)

    server.mischief = and_another
    flags = 0
    for _ in range(4):
        bench.read(DEADLINE)
        flags |= bench.header()[1]
        bench.write((0x0F, 0))
    assert flags & LinkFlag.FOREIGN
    assert bench.header()[2] == TARGET


def test_a_drive_that_has_the_low_word_first_is_read_so_and_its_torn_positions_are_dropped(opened: ExitStack) -> None:
    server = opened.enter_context(tcp_server(Drive()))
    profile = replace(PROFILE, line=replace(PROFILE.line, word_order="low first"))
    registers = server.drive.registers
    registers[RATED], registers[RATED + 1] = registers[RATED + 1], 0
    # Small steps: a torn value is one that is 65536 counts beside where the last motion leads in the time that passed.
    registers[POSITION], registers[POSITION + 1] = 64_900, 0
    bench = opened.enter_context(Bench(plan_of(server.name, profile))).open().enable()
    for counts in (64_950, 65_000, 65_000):
        registers[POSITION] = counts
        assert bench.read()[5] == counts
    registers[POSITION + 1] = 1
    assert bench.read()[2] & STALE
    assert bench.decoded()[5] == 65_000
    registers[POSITION], registers[POSITION + 1] = 65_100, 0
    assert bench.read()[5] == 65_100


def test_a_drive_in_fault_is_seen_in_its_status(opened: ExitStack) -> None:
    bench, server = bench_on(opened, "tcp")
    server.drive.registers[STATUS] = FAULT
    assert bench.read()[4] == FAULT
