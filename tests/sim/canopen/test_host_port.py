"""A bus that goes down, comes back, or is gone, under hosted drives."""

import errno
import struct
import time
from collections.abc import Callable, Iterator
from contextlib import closing

import can
import pytest

from haptic_fieldbus.buses.canopen.wire import FRAME, SocketCanPort
from haptic_fieldbus.clock import VirtualClock
from haptic_fieldbus.errors import BusError
from haptic_fieldbus.sim.canopen import hosting
from haptic_fieldbus.sim.canopen.hosting import RETRIED_EVERY_NS, HostPort
from tests.buses.canopen.test_socketcan import Ends, StampedEnds
from tests.sim.canopen.hosted import MS, READ_IDENTITY, Hosted, enabled


@pytest.fixture
def hosted() -> Iterator[Hosted]:
    subject = Hosted(5, 6)
    yield subject
    subject.close()


class TestABusThatGoesDown:
    """As SocketCAN does it: `recv` raises ENETDOWN once and then hears nothing, `send` raises it each time."""

    def _pull(self, hosted: Hosted) -> None:
        """The interface is down."""
        down = can.CanOperationError("Network is down", errno.ENETDOWN)
        raised = iter([down])

        def receive(timeout: float | None = None) -> None:
            for error in raised:
                raise error

        hosted.theirs.recv = receive  # type: ignore[method-assign]
        hosted.theirs.send = _raising(down)  # type: ignore[method-assign]

    def _push(self, hosted: Hosted) -> None:
        del hosted.theirs.recv, hosted.theirs.send

    def test_drives_go_on_and_are_heard_again(self, hosted: Hosted) -> None:
        hosted.serve()
        hosted.send(0x605, bytes.fromhex("2B 17 10 00 0A 00 00 00"))
        hosted.serve(0)
        self._pull(hosted)
        assert [frame for _ in range(50) for frame in hosted.serve(10 * MS)] == []
        self._push(hosted)
        assert hosted.serve(10 * MS) == [(0x705, b"\x7f")]
        down, up = hosted.told
        assert "virtual:hosting: the interface is down or gone" in down
        assert "The drives continue" in down
        assert "frames pass again after 0." in up

    def test_a_drive_lets_go_by_its_own_watch_meanwhile(self) -> None:
        hosted = Hosted(5)
        hosted.serve()
        hosted.send(0x605, bytes.fromhex("23 16 10 01") + struct.pack("<HBB", 50, 0x7F, 0))
        hosted.send(0x605, bytes.fromhex("2B 07 60 00 02 00 00 00"))
        hosted.send(0, bytes((1, 5)))
        for controlword in (0x06, 0x07, 0x0F):
            hosted.send(0x205, struct.pack("<H", controlword))
        hosted.send(0x77F, b"\5")
        hosted.serve(MS)
        self._pull(hosted)
        hosted.serve(60 * MS)
        self._push(hosted)
        hosted.serve(0)
        hosted.send(0x605, bytes.fromhex("40 41 60 00 00 00 00 00"))
        answers = [data[4] & 0x6F for can_id, data in hosted.serve() if can_id == 0x585]
        assert answers == [0x60], "switch on disabled"
        hosted.close()

    def test_a_bus_that_is_gone_is_opened_anew(self, hosted: Hosted) -> None:
        """An adapter that was unplugged: the old socket never works again."""
        hosted.serve()
        gone = hosted.theirs
        gone.recv = _raising(OSError(errno.ENODEV, "No such device"))  # type: ignore[method-assign]
        gone.send = _raising(OSError(errno.ENODEV, "No such device"))  # type: ignore[method-assign]
        for _ in range(3):
            hosted.serve(500 * MS)
        assert hosted.theirs is not gone
        hosted.send(0x606, READ_IDENTITY)
        assert [can_id for can_id, _ in hosted.serve()] == [0x586]
        assert len(hosted.told) == 2

    def test_one_that_cannot_be_opened_is_tried_again_and_drives_go_on(
        self, hosted: Hosted, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        refusals = [BusError("no such interface")] * 3
        again = hosted.reopened

        def reopened() -> can.BusABC:
            for refusal in iter(refusals.pop, None) if refusals else ():
                raise refusal
            return again()

        monkeypatch.setattr(hosted.host_port, "_reopen", reopened)
        hosted.serve()
        hosted.theirs.recv = _raising(OSError(errno.ENODEV, "gone"))  # type: ignore[method-assign]
        for _ in range(12):
            hosted.serve(500 * MS)
        hosted.send(0x606, READ_IDENTITY)
        assert [can_id for can_id, _ in hosted.serve()] == [0x586]

    def test_waiting_for_a_bus_that_raises_at_once_takes_time(self, hosted: Hosted) -> None:
        hosted.serve()
        hosted.theirs.recv = _raising(OSError(errno.ENODEV, "gone"))  # type: ignore[method-assign]
        before_ns = hosted.clock.now_ns()
        hosted.host.serve(10 * RETRIED_EVERY_NS)
        assert hosted.clock.now_ns() - before_ns == RETRIED_EVERY_NS


def _raising(error: Exception) -> Callable[..., None]:
    def raising(*args: object, **kwargs: object) -> None:
        raise error

    return raising


class TestTheInstantOfAFrame:
    """A frame is served when it came, not when this process was woken; both bounds hold whatever the stamp says."""

    @pytest.fixture
    def arrived(self, monkeypatch: pytest.MonkeyPatch) -> Callable[..., int]:
        """The instant of a frame that the kernel stamped so long ago [s], by a clock that shows 10 ms."""

        def instant(ago: float, earliest_ns: int, *, stamped: bool = True) -> int:
            ends = StampedEnds() if stamped else Ends()
            with closing(ends), can.Bus(interface="virtual", channel="stamps") as bus, monkeypatch.context() as patched:
                patched.setattr(hosting, "port_to", lambda _, clock: SocketCanPort(ends.ours, clock))
                ends.theirs.send(FRAME.pack(0x080, 0, b""))
                outlet = HostPort(bus, VirtualClock(10 * MS), "vcan0", print)
                real = time.time_ns
                patched.setattr(time, "time_ns", lambda: real() + round(ago * 1e9))
                assert outlet.receive(0) is not None
                return outlet.arrived_ns(earliest_ns)

        return instant

    def test_is_its_stamp(self, arrived: Callable[..., int]) -> None:
        assert 5.0 * MS <= arrived(0.004, 0) <= 6.0 * MS

    def test_is_not_before_what_was_served(self, arrived: Callable[..., int]) -> None:
        assert arrived(0.004, 9_900_000) == 9_900_000

    def test_is_not_before_what_was_served_when_the_wall_clock_was_set(self, arrived: Callable[..., int]) -> None:
        assert arrived(3600.0, 9 * MS) == 9 * MS

    def test_is_not_in_the_future(self, arrived: Callable[..., int]) -> None:
        assert arrived(-3600.0, 0) == 10 * MS

    def test_is_now_where_there_is_no_stamp(self, arrived: Callable[..., int]) -> None:
        assert arrived(0.004, 0, stamped=False) == 10 * MS

    def test_heartbeats_that_waited_while_this_process_slept_are_not_missed(self) -> None:
        """1016h is 50 ms; 80 ms of sleep with a heartbeat every 10 ms, and then with none."""
        hosted = Hosted(5)
        hosted.serve()
        hosted.send(0x605, bytes.fromhex("23 16 10 01 32 00 7f 00"))
        enabled(hosted)
        stamps: list[int] = []
        hosted.host_port.arrived_ns = lambda earliest_ns: stamps.pop(0) if stamps else hosted.clock.now_ns()  # type: ignore[method-assign]

        def slept(beats: int) -> list[int]:
            begun_ns = hosted.clock.now_ns()
            for beat in range(beats):
                hosted.send(0x77F, b"\x05")
                stamps.append(begun_ns + 10 * MS * (beat + 1))
            hosted.clock.compute(85 * MS)
            heard = [*hosted.serve(0), *hosted.serve(0)]
            return [int.from_bytes(data[:2], "little") for can_id, data in heard if can_id == 0x085]

        assert slept(8) == []
        assert slept(8) == []
        assert slept(0) == [0x8130]

    def test_a_shaft_is_latched_where_it_was_when_sync_came(self) -> None:
        """The process sleeps for 5 ms after SYNC; the position is that at SYNC, and a later one comes with the next."""
        hosted = Hosted(5, hand="push")
        hosted.serve()
        enabled(hosted)
        hosted.serve(400 * MS)

        def latched(late_ns: int) -> int:
            hosted.host_port.arrived_ns = lambda earliest_ns: hosted.clock.now_ns() - late_ns  # type: ignore[method-assign]
            hosted.send(0x80, b"")
            hosted.clock.compute(late_ns)
            hosted.host.serve(0)
            (counts,) = [struct.unpack("<Hi", data)[1] for can_id, data in hosted.serve(0) if can_id == 0x185]
            return int(counts)

        at_once = latched(0)
        assert latched(20 * MS) == at_once
        assert latched(0) > at_once
