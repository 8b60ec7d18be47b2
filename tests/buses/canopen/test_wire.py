"""Frames of all kinds in the log."""

from typing import Any

import can
import pytest

from haptic_fieldbus.buses.canopen.wire import ECHOING, Wire
from haptic_fieldbus.clock import Clock, MonotonicClock, VirtualClock
from tests.buses.canopen.fake_can import FakeCan
from tests.peers.hosts import GROUP, free_port, require_multicast


def test_the_log_tells_extended_remote_and_error_frames_apart_as_socketcan_does() -> None:
    clock = VirtualClock()
    bus = FakeCan(clock)
    logged: list[int] = []
    wire = Wire(bus, clock, "fake0", lambda t_ns, can_id, data: logged.append(can_id))
    for extended, remote, error in (
        (False, False, False),
        (True, False, False),
        (False, True, False),
        (False, False, True),
    ):
        message = can.Message(
            arbitration_id=0x20, is_extended_id=extended, is_remote_frame=remote, is_error_frame=error
        )
        bus.later(0, message)
    wire.drain(1)
    bus.shutdown()
    assert logged == [0x20, 0x8000_0020, 0x4000_0020, 0x2000_0020]


def test_a_flood_of_frames_ends_at_the_deadline() -> None:
    clock = VirtualClock()
    bus = FakeCan(clock)

    def babble() -> None:
        bus.reply(0x001, b"", 0)
        clock.compute(1000)
        bus.later(0, babble)

    babble()
    Wire(bus, clock, "fake0").drain(50_000)
    bus.shutdown()
    assert clock.now_ns() <= 60_000


def frame(can_id: int, data: bytes = b"") -> can.Message:
    """A frame of another program."""
    return can.Message(arbitration_id=can_id, data=data, is_extended_id=False)


class FrameCounts:
    """Frames that reach the handlers and the log of a wire."""

    def __init__(self, bus: can.BusABC, clock: Clock, *, echoes: bool = False) -> None:
        self.logged: list[int] = []
        self.handled: list[int] = []
        self.wire = Wire(bus, clock, "test", lambda t_ns, can_id, data: self.logged.append(can_id), echoes=echoes)
        for can_id in (0x080, 0x77F):
            self.wire.listen(can_id, lambda data, can_id=can_id: self.handled.append(can_id))  # type: ignore[misc]

    def receive_for(self, seconds: float) -> None:
        deadline_ns = self.wire.clock.now_ns() + round(seconds * 1e9)
        while self.wire.pump(deadline_ns):
            pass


@pytest.mark.parametrize("interface", ["virtual", "haptic_sim"])
def test_our_own_frames_that_an_interface_gives_back_marked_are_not_heard(interface: str) -> None:
    channel = {"virtual": "wire-own", "haptic_sim": "generic_cia402@5"}[interface]
    with (
        can.Bus(interface=interface, channel=channel, receive_own_messages=True) as ours,
        can.Bus(interface=interface, channel=channel) as theirs,
    ):
        heard = FrameCounts(ours, MonotonicClock())
        heard.wire.send(0x080)
        theirs.send(frame(0x77F, b"\x05"))
        heard.receive_for(0.1)
        assert heard.handled == [0x77F]
        assert heard.logged == [0x080, 0x77F], "each frame once"


@pytest.mark.xdist_group("peers")
class TestUdpMulticast:
    """Datagrams come back to their sender, and nothing but what they carry tells whose they are."""

    @pytest.fixture
    def options(self) -> dict[str, Any]:
        port = free_port()
        require_multicast(port)
        return {"interface": "udp_multicast", "channel": GROUP, "port": port}

    def test_what_we_send_is_not_taken_for_somebody_elses(self, options: dict[str, Any]) -> None:
        assert "udp_multicast" in ECHOING
        with can.Bus(**options) as bus:
            heard = FrameCounts(bus, MonotonicClock(), echoes=True)
            for _ in range(100):
                heard.wire.send(0x080)
                heard.wire.send(0x77F, b"\x05")
            heard.receive_for(0.3)
            assert heard.handled == []
            assert len(heard.logged) == 200

    def test_the_very_same_frames_of_somebody_else_are(self, options: dict[str, Any]) -> None:
        """Ours and theirs are mixed; both are of this package, so both carry a mark, each its own."""
        with can.Bus(**options) as ours, can.Bus(**options) as theirs, can.Bus(**options) as plain:
            heard, others = (FrameCounts(bus, MonotonicClock(), echoes=True) for bus in (ours, theirs))
            for _ in range(20):
                heard.wire.send(0x080)
                others.wire.send(0x080)
                plain.send(frame(0x080))
            heard.receive_for(0.3)
            assert heard.handled == [0x080] * 40

    def test_frames_of_ours_that_nobody_read_excuse_none_of_theirs(self, options: dict[str, Any]) -> None:
        """Echoes that the socket had no room for are lost; a ledger of what was sent would wait for them for ever."""
        with can.Bus(**options) as ours, can.Bus(**options) as theirs:
            heard = FrameCounts(ours, MonotonicClock(), echoes=True)
            for _ in range(5000):
                heard.wire.send(0x080)
            heard.receive_for(0.3)
            theirs.send(frame(0x080))
            heard.receive_for(0.3)
            assert heard.handled == [0x080]
