"""The requests of one line, over lines that are slow or full of what nobody asked for."""

from collections.abc import Callable, Sequence

import pytest

from haptic_fieldbus.buses.modbus.framing import Question, checksum
from haptic_fieldbus.buses.modbus.master import LineRelease
from haptic_fieldbus.buses.modbus.requester import MOST_LATE, Requester
from haptic_fieldbus.buses.modbus.transport import MOST_RECEPTIONS, gathered
from haptic_fieldbus.buses.modbus.unit import ANSWER_TIMEOUT, UnitClient
from haptic_fieldbus.clock import VirtualClock
from haptic_fieldbus.drive.profile import DataType
from haptic_fieldbus.errors import BusTimeoutError
from haptic_fieldbus.protocols.modbus.profile import LineSection, Register

MS = 1_000_000
ASKED = range(10, 70, 10)
"""Addresses of registers; each holds its address."""


class SlowLine:
    """An RTU line whose unit answers one request after the other, each after the same time [s]."""

    serial, name = True, "modbus-rtu:slow"

    def __init__(self, clock: VirtualClock, takes: float) -> None:
        self._clock, self._takes_ns, self._busy_ns = clock, round(takes * 1e9), 0
        self._answers: list[tuple[int, bytes]] = []

    def send(self, frame: bytes | bytearray) -> None:
        body = bytes((frame[0], frame[1], 2)) + bytes(frame[2:4])
        self._busy_ns = max(self._busy_ns, self._clock.now_ns()) + self._takes_ns
        self._answers.append((self._busy_ns, body + checksum(body)))

    def discard(self) -> bytes:
        due = [octets for at_ns, octets in self._answers if at_ns <= self._clock.now_ns()]
        self._answers = self._answers[len(due) :]
        return b"".join(due)

    def receive(self, deadline_ns: int) -> bytes:
        self._clock.sleep_until(min([deadline_ns, *(at_ns for at_ns, _ in self._answers)]))
        return self.discard()


@pytest.mark.parametrize("takes", [0.01, 0.29, 0.36, 0.4, 0.45, 0.5, 0.55])
def test_a_unit_that_is_slower_than_the_time_out_never_gives_one_register_for_another(takes: float) -> None:
    clock = VirtualClock()
    line = SlowLine(clock, takes)
    unit = UnitClient(Requester(line, clock), 1, "unit 1", LineSection(transports=("rtu",), functions=(3, 16)))  # type: ignore[arg-type]
    found: list[int | None] = []
    for address in ASKED:
        try:
            found.append(unit.read(Register(address, DataType.UINT16)))
        except BusTimeoutError:
            found.append(None)
    assert all(value in (None, address) for value, address in zip(found, ASKED, strict=True))
    if takes < ANSWER_TIMEOUT:
        assert found == list(ASKED)


class Flood:
    """A peer that always has something to send, which is no answer; each reception takes a microsecond."""

    serial, name = False, "modbus-tcp:flood"

    def __init__(self, clock: VirtualClock) -> None:
        self._clock, self.received = clock, 0

    def send(self, frame: bytes | bytearray) -> None:
        """Take a request."""

    def receive(self, deadline_ns: int) -> bytes:
        self._clock.sleep_until(self._clock.now_ns() + 1000)
        self.received += 1
        return bytes(260)


@pytest.mark.parametrize(
    "wait",
    [
        lambda requester, end_ns: requester.answer(end_ns),
        lambda requester, end_ns: requester.listen(end_ns) and None,
        lambda requester, end_ns: requester.quiet(end_ns),
    ],
)
def test_a_peer_that_goes_on_sending_holds_nobody_beyond_the_deadline(
    wait: Callable[[Requester, int], object],
) -> None:
    clock = VirtualClock()
    flood = Flood(clock)
    requester = Requester(flood, clock)  # type: ignore[arg-type]
    requester.ask(Question(1, 3, 0, 1))
    assert wait(requester, MS) is None
    assert clock.now_ns() <= MS + 1000 * (MOST_LATE + 2)
    flood.received = 0
    requester.ask(Question(1, 3, 0, 1))
    assert requester.waiting() is None
    assert flood.received <= MOST_LATE + 1


def test_what_waits_is_dropped_up_to_a_number_of_receptions() -> None:
    assert gathered(lambda: b"x") == b"x" * MOST_RECEPTIONS
    some = iter((b"a", b"b", b"", b"c"))
    assert gathered(lambda: next(some)) == b"ab"


class NotedRequester:
    """A requester of two units that notes whom the first question after a stop is for."""

    outstanding = None

    def __init__(self) -> None:
        self.transport, self.clock, self.asked = Flood(VirtualClock()), VirtualClock(), list[int]()

    def ask(self, question: Question) -> None:
        self.asked.append(question.unit)


class StoppedUnit:
    """A drive of a line on its way to zero torque."""

    settled = freed = zeroed = free = False

    def __init__(self, unit: int) -> None:
        self.unit, self.kept = UnitClient(None, unit, f"unit {unit}", None), ()  # type: ignore[arg-type]

    def begin(self) -> None:
        """Begin."""

    def question(self) -> Question:
        return Question(self.unit.id, 6, 0, 0, (0,))


@pytest.mark.parametrize("stops", [([1, 0], [0, 1]), ([0, 1], [1, 0], [0, 1])])
def test_each_stop_of_a_line_frees_the_drives_that_answer_first(stops: Sequence[Sequence[int]]) -> None:
    requester = NotedRequester()
    release = LineRelease(requester, [StoppedUnit(1), StoppedUnit(2)], exchange=0.001, guard=0.05)  # type: ignore[arg-type, list-item]
    for missing in stops:
        release.begin(missing)
    assert requester.asked == [1 + missing.index(0) for missing in stops]
