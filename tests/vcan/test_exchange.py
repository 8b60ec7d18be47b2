"""The wire of the master on a real SocketCAN interface: what wakes it, what it hears, and when."""

import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import can
import pytest

from haptic_fieldbus.buses.canopen.frames import ERROR_FLAG, EXTENDED_FLAG, REMOTE_FLAG
from haptic_fieldbus.buses.canopen.wire import QUEUED_PERIODS, PythonCanPort, SocketCanPort, Wire
from haptic_fieldbus.clock import MonotonicClock
from haptic_fieldbus.errors import BusError
from tests.vcan.links import Link

pytestmark = [pytest.mark.vcan, pytest.mark.thorough("in a guest kernel, which takes seconds to begin")]

LONG_NS = 5_000_000_000
OURS, FOREIGN = 0x185, 0x2A7


@contextmanager
def opened(link: Link) -> Iterator[can.BusABC]:
    with can.Bus(interface="socketcan", channel=link.name) as bus:
        yield bus


@pytest.fixture
def theirs(vcan: Link) -> Iterator[can.BusABC]:
    """The socket of another program."""
    with opened(vcan) as bus:
        yield bus


class FrameCounts:
    """A wire with a handler for one identifier, and all that woke it."""

    def __init__(self, bus: can.BusABC, name: str) -> None:
        self.wire = Wire(bus, MonotonicClock(), name)
        self.handled: list[bytes] = []
        self.woken = 0
        self.wire.listen(OURS, lambda data: self.handled.append(bytes(data)))

    def receive(self, last: bytes) -> None:
        """Receive until the handler got these octets."""
        deadline_ns = time.monotonic_ns() + LONG_NS
        while last not in self.handled and self.wire.pump(deadline_ns):
            self.woken += 1


@pytest.fixture
def heard(vcan: Link) -> Iterator[FrameCounts]:
    with opened(vcan) as bus:
        yield FrameCounts(bus, bus.channel_info)


def sent(can_id: int, data: bytes = b"", **flags: bool) -> can.Message:
    options = {"is_extended_id": False, **flags}
    return can.Message(arbitration_id=can_id, data=None if flags.get("is_remote_frame") else data, **options)


def test_a_program_of_this_computer_is_somebody_else(vcan: Link, heard: FrameCounts) -> None:
    """python-can's `is_rx` is False for its frames, by which a master was deaf to `simulate` beside it."""
    assert isinstance(heard.wire._port, SocketCanPort)
    subprocess.run(["cansend", vcan.name, f"{OURS:03X}#01"], check=True)
    heard.receive(b"\x01")
    assert heard.handled == [b"\x01"]


def test_our_own_frames_are_not_heard(heard: FrameCounts, theirs: can.BusABC) -> None:
    heard.wire.send(OURS, b"\x07")
    message = theirs.recv(5.0)
    assert message is not None
    assert (message.arbitration_id, bytes(message.data)) == (OURS, b"\x07")
    theirs.send(sent(OURS, b"\x01"))
    heard.receive(b"\x01")
    assert heard.handled == [b"\x01"]


class TestFilter:
    def test_only_frames_with_a_handler_and_telling_error_frames_wake_us(
        self, heard: FrameCounts, theirs: can.BusABC
    ) -> None:
        heard.wire.focus(4)
        for number in range(200):
            theirs.send(sent(FOREIGN, bytes((number,))))
        theirs.send(sent(OURS, b"\x02", is_extended_id=True))
        theirs.send(sent(OURS, is_remote_frame=True))
        theirs.send(sent(0x088, bytes(8), is_error_frame=True))  # a single bit on the wire
        theirs.send(sent(0x004, bytes((0, 0x20, 0, 0, 0, 0, 0, 0)), is_error_frame=True))
        theirs.send(sent(OURS, b"\x01"))
        heard.receive(b"\x01")
        assert heard.woken == 2
        assert heard.handled == [b"\x01"]
        assert heard.wire.sentences == [
            f"{heard.wire.name}: CAN controller error: error passive by transmit errors 1×. Check wiring, "
            "terminators and bit rate"
        ]

    def test_whoever_listens_to_the_bus_hears_all(self, heard: FrameCounts, theirs: can.BusABC) -> None:
        heard.wire.focus(4)
        heard.wire.unfocus()
        noted: list[int] = []
        with heard.wire.overhear(lambda can_id, data: noted.append(can_id)):
            theirs.send(sent(FOREIGN))
            theirs.send(sent(FOREIGN, is_extended_id=True))
            theirs.send(sent(FOREIGN, is_remote_frame=True))
            theirs.send(sent(0x008, bytes(8), is_error_frame=True))
            theirs.send(sent(OURS, b"\x01"))
            heard.receive(b"\x01")
        assert noted == [FOREIGN, FOREIGN | EXTENDED_FLAG, FOREIGN | REMOTE_FLAG, 0x008 | ERROR_FLAG, OURS]

    def test_a_recording_holds_all_frames(self, vcan: Link, theirs: can.BusABC) -> None:
        noted: list[int] = []
        with opened(vcan) as bus:
            wire = Wire(bus, MonotonicClock(), vcan.name, lambda t_ns, can_id, data: noted.append(can_id))
            wire.focus(4)
            theirs.send(sent(FOREIGN))
            assert wire.pump(time.monotonic_ns() + LONG_NS)
        assert noted == [FOREIGN]

    def test_more_identifiers_than_the_kernel_takes_are_no_filter(self, heard: FrameCounts, theirs: can.BusABC) -> None:
        for can_id in range(0x100, 0x400):
            heard.wire.listen(can_id, lambda data: heard.handled.append(bytes(data)))
        heard.wire.focus(4)
        theirs.send(sent(0x3FF, b"\x03"))
        heard.receive(b"\x03")
        assert heard.handled == [b"\x03"]


def test_a_frame_that_waited_has_the_instant_of_its_arrival(heard: FrameCounts, theirs: can.BusABC) -> None:
    before_ns = time.monotonic_ns()
    theirs.send(sent(OURS, b"\x01"))
    after_ns = time.monotonic_ns()
    while time.monotonic_ns() < after_ns + 50_000_000:
        """It waits to be read."""
    heard.receive(b"\x01")
    assert before_ns - 1_000_000 <= heard.wire.arrived_ns <= after_ns + 1_000_000


def test_an_interface_that_goes_down_is_named_and_used_again_when_it_is_up(vcan: Link, heard: FrameCounts) -> None:
    vcan.down()
    uses: tuple[Callable[[], object], ...] = (lambda: heard.wire.drain(0), lambda: heard.wire.offer(0x080))
    for use in uses:
        with pytest.raises(BusError, match=rf"{vcan.name}.*the interface is down or gone"):
            use()
    vcan.up()
    assert heard.wire.offer(0x080)
    subprocess.run(["cansend", vcan.name, f"{OURS:03X}#01"], check=True)
    heard.receive(b"\x01")
    assert heard.handled == [b"\x01"]


def commanded(words: str) -> None:
    """Run a command of iproute2; skip where this kernel or this user cannot."""
    try:
        done = subprocess.run(words.split(), capture_output=True, text=True, check=False)
    except FileNotFoundError as error:
        pytest.skip(f"apt-get install iproute2: {error}")
    if done.returncode:
        pytest.skip(f"{words}: {done.stderr.strip()}")


@pytest.fixture
def slow_cable() -> Iterator[tuple[str, str]]:
    """Two interfaces with a cable between them that carries 20 kbit/s of frames, after 2000 octets that go at once.

    Between two sockets of one interface frames pass by its transmit queue.
    """
    # In a guest kernel nothing loads modules by itself.
    load = "insmod /usr/lib/uml/modules/$(uname -r)/kernel/net/sched/sch_tbf.ko || modprobe sch_tbf"
    subprocess.run(["sh", "-c", load], capture_output=True, check=False)
    near, far = "near0", "far0"
    commanded(f"ip link add {near} type vxcan peer name {far}")
    try:
        for name in (near, far):
            commanded(f"ip link set {name} up")
        commanded(f"tc qdisc replace dev {near} root tbf rate 20kbit burst 2000 limit 100000")
        yield near, far
    finally:
        subprocess.run(["ip", "link", "del", near], check=True)


@pytest.mark.parametrize("direct", [True, False], ids=["our port", "python-can"])
def test_on_a_bus_that_is_busy_the_set_point_that_goes_out_is_one_of_the_last(
    slow_cable: tuple[str, str], vcan: Link, *, direct: bool
) -> None:
    """Of 3 frames a period the bus takes 1. python-can queues hundreds, which shows that this queue is a real one."""
    frames, most = 3, 3000
    near, far = slow_cable
    clock = MonotonicClock()
    with opened(Link(near)) as bus, opened(Link(far)) as other:
        port = SocketCanPort(bus.socket, clock) if direct else PythonCanPort(bus)  # type: ignore[attr-defined]
        port.focus(frozenset({OURS}), frames)
        refused, oldest = 0, 0
        for period in range(most):
            if refused > 75 and period >= 300:
                break
            end = time.monotonic() + 0.005
            try:
                for each in range(frames):
                    port.send(0x200 + each, period.to_bytes(2, "little"))
            except (OSError, can.CanError):
                refused += 1
            waits = True  # and what has come is read to its end: a frame that waits for its reader looks old
            while waits:
                message = other.recv(max(0.0, end - time.monotonic()))
                waits = message is not None or time.monotonic() < end
                if message is not None:
                    oldest = max(oldest, period - int.from_bytes(message.data, "little"))
    assert refused > 75, "the queue was full, however slow this machine is"
    if direct:
        assert oldest <= 3 * (QUEUED_PERIODS + 1), "the bus takes three periods for the frames of one"
    else:
        assert oldest > 50
