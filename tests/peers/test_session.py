"""A session on a real bus in real time: however its block is left, another program sees the drive torque-free."""

import signal
import struct
from collections.abc import Callable
from pathlib import Path

import can
import pytest

import haptic_fieldbus
from haptic_fieldbus import LiveSession
from tests.peers.hosts import GROUP, free_port, line_of, require_multicast, start
from tests.peers.test_master_dies import BUS, NODE, OPERATION_ENABLED, RIG, SETTING, STATE, Drive

pytestmark = pytest.mark.xdist_group("peers")

RATE, PERIODS = 50.0, 25
"""A slow loop, whose guard a busy machine does not reach by itself."""
ATTEMPTS = 3


def by_break(live: LiveSession) -> None:
    for number, _ in enumerate(live):
        if number == PERIODS:
            break


def by_an_error(live: LiveSession) -> None:
    for number, _ in enumerate(live):
        if number == PERIODS:
            raise ZeroDivisionError


def by_a_signal(live: LiveSession) -> None:
    for number, _ in enumerate(live):
        if number == PERIODS:
            signal.raise_signal(signal.SIGINT)


def bind(asked: list[str]) -> Callable[[str], bool]:
    """A person who notes the question and says yes."""

    def confirm(text: str) -> bool:
        asked.append(text)
        return True

    return confirm


@pytest.mark.thorough("seconds of real time")
@pytest.mark.parametrize("leave", [by_break, by_an_error, by_a_signal])
def test_the_drive_is_torque_free_when_the_block_is_left(
    leave: Callable[[LiveSession], None], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    port = free_port()
    require_multicast(port)
    monkeypatch.setenv("CAN_CONFIG", f'{{"port": {port}}}')
    rig = tmp_path / "rig.toml"
    rig.write_text(RIG)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    host = start(
        "simulate", "--drive", f"generic_cia402@{NODE}", "--bus", BUS.partition("@")[0], "--hand", "none", port=port
    )
    try:
        line_of(host)
        trips: list[str] = []
        for _ in range(ATTEMPTS):
            with can.Bus(interface="udp_multicast", channel=GROUP, port=port) as bus:
                asked: list[str] = []
                try:
                    with haptic_fieldbus.session(
                        "wall", rig, rate=RATE, settings=dict([SETTING]), confirm=bind(asked)
                    ) as live:
                        leave(live)
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
                sent = [heard for heard in iter(lambda: bus.recv(0), None) if heard.arbitration_id == 0x200 + NODE]
                assert all(struct.unpack("<Hh", bytes(each.data))[1] == 0 for each in sent[-1:])
                return
        pytest.fail("\n".join(trips))
    finally:
        signal.signal(signal.SIGINT, before)
        host.kill()
        host.communicate()
