"""Frames of all kinds in the log."""

import socket
import time
from typing import Any

import can
import pytest

from haptic_fieldbus.buses.canopen import wire as wire_module
from haptic_fieldbus.buses.canopen.frames import CAN_ID_MASK, ERROR_FLAG, EXTENDED_FLAG, REMOTE_FLAG
from haptic_fieldbus.buses.canopen.wire import MOST_WAITING, MulticastPort, Wire, port_to
from haptic_fieldbus.clock import Clock, MonotonicClock, VirtualClock
from haptic_fieldbus.errors import BusError
from tests.buses.canopen.fake_can import FakeCan
from tests.peers.hosts import GROUP, free_port, require_multicast

LONGEST_DROPPED = 18
"""Octets of a datagram below which the filter of the kernel finds no mark to read."""


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


def flooded(clock: VirtualClock) -> FakeCan:
    """A bus on which the next frame is there whenever one was taken, after a microsecond."""
    bus = FakeCan(clock)

    def babble() -> None:
        bus.reply(0x001, b"", 0)
        clock.compute(1000)
        bus.later(0, babble)

    babble()
    return bus


def test_a_flood_of_frames_ends_at_the_deadline() -> None:
    clock = VirtualClock()
    bus = flooded(clock)
    Wire(bus, clock, "fake0").drain(50_000)
    bus.shutdown()
    assert clock.now_ns() <= 60_000


def frame(can_id: int, data: bytes = b"") -> can.Message:
    """A frame of another program."""
    return can.Message(arbitration_id=can_id, data=data, is_extended_id=False)


class FrameCounts:
    """Frames that reach the handlers and the log of a wire."""

    def __init__(self, bus: can.BusABC, clock: Clock) -> None:
        self.logged: list[int] = []
        self.handled: list[int] = []
        self.wire = Wire(bus, clock, "test", lambda t_ns, can_id, data: self.logged.append(can_id))
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

    @pytest.fixture(params=[True, False])
    def platform(self, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
        """A kernel that drops our own datagrams, and one that gives them back."""
        if not request.param:
            monkeypatch.setattr(wire_module, "SO_ATTACH_FILTER", -1)

    @pytest.fixture
    def options(self) -> dict[str, Any]:
        port = free_port()
        require_multicast(port)
        return {"interface": "udp_multicast", "channel": GROUP, "port": port}

    @pytest.mark.usefixtures("platform")
    def test_what_we_send_is_not_taken_for_somebody_elses(self, options: dict[str, Any]) -> None:
        with can.Bus(**options) as bus:
            heard = FrameCounts(bus, MonotonicClock())
            for _ in range(100):
                heard.wire.send(0x080)
                heard.wire.send(0x77F, b"\x05")
            heard.receive_for(0.3)
            assert heard.handled == []
            assert len(heard.logged) == 200

    @pytest.mark.usefixtures("platform")
    def test_the_very_same_frames_of_somebody_else_are(self, options: dict[str, Any]) -> None:
        """Ours and theirs are mixed; both are of this package, so both carry a mark, each its own."""
        with can.Bus(**options) as ours, can.Bus(**options) as theirs, can.Bus(**options) as plain:
            heard, others = (FrameCounts(bus, MonotonicClock()) for bus in (ours, theirs))
            for _ in range(20):
                heard.wire.send(0x080)
                others.wire.send(0x080)
                plain.send(frame(0x080))
            heard.receive_for(0.3)
            assert heard.handled == [0x080] * 40

    def test_frames_of_ours_that_nobody_read_excuse_none_of_theirs(self, options: dict[str, Any]) -> None:
        """Echoes that the socket had no room for are lost; a ledger of what was sent would wait for them for ever."""
        with can.Bus(**options) as ours, can.Bus(**options) as theirs:
            heard = FrameCounts(ours, MonotonicClock())
            for _ in range(5000):
                heard.wire.send(0x080)
            heard.receive_for(0.3)
            theirs.send(frame(0x080))
            heard.receive_for(0.3)
            assert heard.handled == [0x080]

    @pytest.mark.parametrize("can_id", [0x000, 0x07F, 0x185, 0x7FF, 0x000 | EXTENDED_FLAG, 0x1FFF_FFFF | EXTENDED_FLAG])
    @pytest.mark.parametrize("data", [b"", b"\x01", bytes(range(8)), None])
    def test_python_can_reads_what_we_send_and_we_read_what_it_sends(
        self, options: dict[str, Any], can_id: int, data: bytes | None
    ) -> None:
        """`data` None is a remote frame that asks for three octets."""
        remote = data is None
        flagged, octets = can_id | REMOTE_FLAG * remote, bytes(3) if data is None else data
        with can.Bus(**options) as ours, can.Bus(**options) as theirs:
            port = port_to(ours, MonotonicClock())
            port.send(flagged, octets)
            sent = can.Message(
                arbitration_id=can_id & CAN_ID_MASK, is_extended_id=bool(can_id & EXTENDED_FLAG),
                is_remote_frame=remote, dlc=len(octets), data=data, check=True,
            )  # fmt: skip
            received = theirs.recv(1.0)
            assert received is not None
            assert received.equals(sent, timestamp_delta=None, check_channel=False)
            theirs.send(sent)
            assert port.receive(1.0) == (flagged, octets)

    @pytest.mark.parametrize(
        "datagram", [b"", b"\xc1", bytes(64), b"\x81\xa3dlc\x08" + bytes(30), b"\x93" + bytes(40), b"\xff" * 40]
    )
    def test_a_datagram_that_is_no_frame_is_dropped_or_an_error_of_the_bus(
        self, options: dict[str, Any], datagram: bytes
    ) -> None:
        with can.Bus(**options) as bus, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            wire = Wire(bus, MonotonicClock(), "test")
            sender.sendto(datagram, (GROUP, options["port"]))
            if len(datagram) < LONGEST_DROPPED:
                assert wire.pump_for(0.05) is False
            else:
                with pytest.raises(BusError, match="no CAN frame"):
                    wire.pump_for(1.0)

    def test_an_error_frame_of_somebody_else_keeps_its_flag(self, options: dict[str, Any]) -> None:
        with can.Bus(**options) as ours, can.Bus(**options) as theirs:
            port = port_to(ours, MonotonicClock())
            theirs.send(can.Message(arbitration_id=0x040, is_error_frame=True, is_extended_id=False))
            assert isinstance(port, MulticastPort)
            assert port.receive(1.0) == (0x040 | ERROR_FLAG, b"")

    def test_a_frame_has_the_instant_at_which_the_kernel_got_it(self, options: dict[str, Any]) -> None:
        with can.Bus(**options) as ours, can.Bus(**options) as theirs:
            port = port_to(ours, MonotonicClock())
            # Linux begins to stamp datagrams in a task of its own, soon after the first socket asked for it.
            assert any(self.is_stamped(port, theirs) for _ in range(50))

    def is_stamped(self, port: Any, theirs: can.BusABC) -> bool:
        """Return whether a frame that waited 20 ms to be read has the instant at which it was sent."""
        before = time.monotonic_ns()
        theirs.send(frame(0x705, b"\x05"))
        after = time.monotonic_ns()
        while time.monotonic_ns() < after + 20_000_000:
            """It waits to be read."""
        port.receive(0.0)
        stamp: int = port.arrived_ns(0) or 0
        return before - 1_000_000 <= stamp <= after + 1_000_000


def test_waiting_for_an_answer_ends_with_its_deadline_in_a_flood_too() -> None:
    """Frames that waited are still taken, and then no more."""
    clock = VirtualClock()
    bus = flooded(clock)
    Wire(bus, clock, "fake0").pump_until(50_000, lambda: False)
    bus.shutdown()
    assert 50_000 < clock.now_ns() <= 50_000 + 1000 * (MOST_WAITING + 2)
