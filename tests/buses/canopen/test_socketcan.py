"""The port on a SocketCAN socket, over a pair of datagram sockets that carry the same octets, with stamps on loopback.

What only a kernel with CAN does, filters, error frames and its transmit queue, is tested on vcan: `tests/vcan`.
"""

import errno
import socket
import sys
import time
from collections.abc import Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_fieldbus.buses.canopen.frames import EXTENDED_FLAG, REMOTE_FLAG
from haptic_fieldbus.buses.canopen.wire import OURS, SocketCanPort
from haptic_fieldbus.clock import MonotonicClock

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="SocketCAN is a part of Linux")
IDS = st.integers(0, 0x7FF) | st.integers(0, 0x1FFF_FFFF).map(lambda can_id: can_id | EXTENDED_FLAG)


class Ends:
    """The port on one end, the test on the other."""

    def __init__(self) -> None:
        ours, self.theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.ours, self.port = ours, SocketCanPort(ours, MonotonicClock())

    def close(self) -> None:
        self.ours.close()
        self.theirs.close()


class StampedEnds(Ends):
    """On UDP, whose frames the kernel stamps as those of CAN."""

    def __init__(self) -> None:
        self.ours, self.theirs = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
        self.ours.bind(("127.0.0.1", 0))
        self.theirs.connect(self.ours.getsockname())
        self.port = SocketCanPort(self.ours, MonotonicClock())
        # Linux begins to stamp datagrams in a task of its own, soon after the first socket asked for it.
        assert any(self._stamps() for _ in range(200))

    def _stamps(self) -> bool:
        """Return whether a frame that waited 5 ms to be read has an age of more than 4 ms."""
        self.theirs.send(octets(0x705, b""))
        time.sleep(0.005)
        self.port.receive(0.0)
        stamp = self.port.arrived_ns(0)
        return stamp is not None and time.monotonic_ns() - stamp > 4_000_000


@pytest.fixture
def ends() -> Iterator[Ends]:
    ends = Ends()
    yield ends
    ends.close()


@pytest.fixture
def stamped() -> Iterator[StampedEnds]:
    ends = StampedEnds()
    yield ends
    ends.close()


def octets(can_id: int, data: bytes) -> bytes:
    """`struct can_frame`, by hand."""
    return can_id.to_bytes(4, "little") + bytes((len(data), 0, 0, 0)) + data.ljust(8, b"\0")


@given(IDS, st.binary(max_size=8), st.booleans())
def test_a_frame_is_sixteen_octets_in_both_directions(can_id: int, data: bytes, remote: bool) -> None:
    ends = Ends()
    try:
        can_id, data = (can_id | REMOTE_FLAG, bytes(len(data))) if remote else (can_id, data)
        ends.port.send(can_id, data)
        assert ends.theirs.recv(100) == octets(can_id, data)
        ends.theirs.send(octets(can_id, data))
        assert ends.port.receive(0.0) == (can_id, data)
    finally:
        ends.close()


def test_nothing_is_waited_for_longer_than_asked(ends: Ends) -> None:
    assert ends.port.receive(0.0) is None
    before = time.monotonic()
    assert ends.port.receive(0.02) is None
    assert time.monotonic() - before >= 0.02


def test_a_frame_of_another_kind_is_none(ends: Ends) -> None:
    """CAN FD frames are longer; they are passed over, and the next frame is whole."""
    ends.theirs.send(octets(0x181, bytes(8)) + bytes(56))
    ends.theirs.send(octets(0x181, b"\x01"))
    assert ends.port.receive(0.0) is OURS
    assert ends.port.receive(0.0) == (0x181, b"\x01")


def test_a_full_queue_is_told_at_once_and_by_its_number(ends: Ends) -> None:
    ends.ours.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1)

    def flood() -> None:
        for _ in range(10_000):
            ends.port.send(0x080, b"")

    with pytest.raises(OSError, match="transmit queue") as caught:
        flood()
    assert caught.value.errno == errno.ENOBUFS


class TestArrival:
    """A stamp of CLOCK_REALTIME as an instant of our clock."""

    def test_is_the_instant_at_which_the_kernel_got_the_frame(self, stamped: StampedEnds) -> None:
        before = time.monotonic_ns()
        stamped.theirs.send(octets(0x705, b"\x05"))
        after = time.monotonic_ns()
        while time.monotonic_ns() < after + 20_000_000:
            """It waits to be read."""
        stamped.port.receive(0.0)
        assert before - 1_000_000 <= (stamped.port.arrived_ns(0) or 0) <= after + 1_000_000

    def test_is_that_of_the_frame_that_was_read_and_not_of_one_that_waits(self, stamped: StampedEnds) -> None:
        found = []
        for _ in range(2):
            stamped.theirs.send(octets(0x705, b"\x05"))
            time.sleep(0.02)
        for _ in range(2):
            stamped.port.receive(0.0)
            found.append(stamped.port.arrived_ns(0) or 0)
        assert found[1] - found[0] >= 15_000_000

    @pytest.mark.parametrize("step", [-3600.0, 3600.0])
    def test_lies_between_the_last_look_and_now_whatever_somebody_does_to_the_clock(
        self, stamped: StampedEnds, step: float, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        stamped.theirs.send(octets(0x705, b"\x05"))
        stamped.port.receive(0.0)
        real = time.time_ns
        monkeypatch.setattr(time, "time_ns", lambda: real() + round(step * 1e9))
        emptied = time.monotonic_ns() - 5_000_000
        assert emptied <= (stamped.port.arrived_ns(emptied) or 0) <= time.monotonic_ns()

    def test_is_unknown_where_no_stamp_came(self, ends: Ends) -> None:
        ends.theirs.send(octets(0x705, b"\x05"))
        ends.port.receive(0.0)
        assert ends.port.arrived_ns(0) is None
