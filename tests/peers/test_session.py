"""A session on a real bus in real time: however its block is left, another program sees the drive torque-free."""

import re
import signal
import struct
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import can
import pytest

import haptic_fieldbus
from haptic_fieldbus import BusTimeoutError, DriveFaultError, LiveSession, Result, SafetyTripError
from haptic_fieldbus.planning.deadlines import EndCause
from tests.peers.hosts import GROUP, free_port, line_of, require_multicast, start
from tests.peers.test_master_dies import (
    ATTEMPTS,
    BUS,
    NODE,
    OPERATION_ENABLED,
    RATE,
    RIG,
    SETTING,
    STATE,
    Drive,
    stated,
)

pytestmark = pytest.mark.xdist_group("peers")

ENABLED = 0x0F
PUSHED = 2.0
"""Force at the handle at which the block is left [N]."""


def pushed(live: LiveSession) -> float:
    """Step until the wall pushes; return the time of day."""
    next(each for each in live if abs(each.given) >= PUSHED)
    return time.time()


def by_break(live: LiveSession, left: list[float]) -> None:
    for each in live:
        if abs(each.given) >= PUSHED:
            left.append(time.time())
            break


def by_an_error(live: LiveSession, left: list[float]) -> None:
    left.append(pushed(live))
    raise ZeroDivisionError


def by_a_signal(live: LiveSession, left: list[float]) -> None:
    left.append(pushed(live))
    signal.raise_signal(signal.SIGINT)


def bind(asked: list[str]) -> Callable[[str], bool]:
    """A person who notes the question and says yes."""

    def confirm(text: str) -> bool:
        asked.append(text)
        return True

    return confirm


@pytest.fixture
def rig(tmp_path: Path) -> Path:
    path = tmp_path / "rig.toml"
    path.write_text(RIG)
    return path


@pytest.fixture
def port(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """Of a bus with a drive on it, pushed by a hand."""
    port = free_port()
    require_multicast(port)
    monkeypatch.setenv("CAN_CONFIG", f'{{"port": {port}}}')
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    host = start(
        "simulate", "--drive", f"generic_cia402@{NODE}", "--bus", BUS.partition("@")[0], "--hand", "push", port=port
    )
    try:
        line_of(host)
        yield port
    finally:
        signal.signal(signal.SIGINT, before)
        host.kill()
        host.communicate()


@pytest.mark.thorough("seconds of real time")
@pytest.mark.parametrize("leave", [by_break, by_an_error, by_a_signal])
def test_the_drive_is_torque_free_within_the_stated_time_when_the_block_is_left(
    leave: Callable[[LiveSession, list[float]], None], rig: Path, port: int
) -> None:
    trips: list[str] = []
    for _ in range(ATTEMPTS):
        with (
            can.Bus(interface="udp_multicast", channel=GROUP, port=port) as bus,
            can.Bus(interface="udp_multicast", channel=GROUP, port=port) as ear,
            can.Notifier(ear, [(heard := list[can.Message]()).append]),
        ):
            asked, left = list[str](), list[float]()
            try:
                with haptic_fieldbus.session(
                    "wall", rig, rate=RATE, settings=dict([SETTING]), confirm=bind(asked)
                ) as live:
                    leave(live, left)
            except (ZeroDivisionError, KeyboardInterrupt):
                pass
            except haptic_fieldbus.HapticFieldbusError as error:  # late, and so tripped: torque is off then too
                trips.append(str(error))
                continue
            finally:
                assert Drive(bus).read(0x6041) & STATE != OPERATION_ENABLED
                assert Drive(bus).read(0x6077) == 0
            assert asked
            assert live.result is None if leave is by_an_error else live.result is not None
            time.sleep(0.1)  # what the ear has not yet taken
            sent = [each for each in heard if each.arbitration_id == 0x200 + NODE]
            targets = [(each.timestamp - left[0], *struct.unpack("<Hh", bytes(each.data))) for each in sent]
            assert targets[-1][1] != ENABLED
            assert targets[-1][2] == 0
            pushes = [after for after, _, torque in targets if torque]
            assert pushes, "it was left under torque"
            zero = min(after for after, _, torque in targets if after > pushes[-1] and not torque)
            if zero > stated(rig, EndCause.END):
                trips.append(f"torque-free after {zero} s, on a busy machine")
                continue
            return
    pytest.fail("\n".join(trips))


PERIOD = 1.0 / RATE


def always_too_long(live: LiveSession) -> None:
    for _ in live:
        time.sleep(1.5 * PERIOD)


def once_for_long(live: LiveSession) -> None:
    """Longer than the drive waits."""
    pushed(live)
    time.sleep(20.0 * PERIOD)
    next(live)


@pytest.mark.thorough("seconds of real time")
@pytest.mark.parametrize(("render", "longest"), [(always_too_long, 1.5 * PERIOD), (once_for_long, 20.0 * PERIOD)])
def test_a_slow_caller_is_told_and_trips_as_a_late_host(
    render: Callable[[LiveSession], None], longest: float, rig: Path, port: int
) -> None:
    for _ in range(ATTEMPTS):
        with can.Bus(interface="udp_multicast", channel=GROUP, port=port) as bus:
            with (
                pytest.raises((SafetyTripError, DriveFaultError, BusTimeoutError)) as raised,
                haptic_fieldbus.session("wall", rig, rate=RATE, settings=dict([SETTING]), yes=True) as live,
            ):
                render(live)
            assert Drive(bus).read(0x6041) & STATE != OPERATION_ENABLED
            assert Drive(bus).read(0x6077) == 0
        if not isinstance(raised.value, BusTimeoutError):  # which it is where the drive had no turn on a busy machine
            break
    (note,) = raised.value.__notes__
    found = re.fullmatch(r"the block of the session took up to ([\d.]+) ms between two periods of 20 ms", note)
    assert found
    assert 1e-3 * float(found[1]) >= 0.99 * longest
    assert isinstance(raised.value.result, Result)
    assert note in raised.value.result.warnings


@pytest.mark.thorough("seconds of real time")
def test_a_caller_that_was_slow_once_is_told(rig: Path, port: int) -> None:
    trips: list[str] = []
    settings = dict([SETTING])
    for _ in range(ATTEMPTS):
        try:
            with haptic_fieldbus.session("wall", rig, rate=RATE, settings=settings, yes=True, duration=0.4) as live:
                for number, _ in enumerate(live):
                    time.sleep(1.2 * PERIOD if number == 5 else 0.0)
        except haptic_fieldbus.HapticFieldbusError as error:  # a busy machine was late besides
            trips.append(str(error))
            continue
        assert live.result is not None
        assert [each for each in live.result.warnings if "the block of the session took up to " in each]
        return
    pytest.fail("\n".join(trips))
