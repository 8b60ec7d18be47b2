"""The paced bus: the wall clock, several threads, several buses on one channel; deadlines that a busy machine keeps."""

import errno
import struct
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise

import can
import pytest

from haptic_fieldbus.clock import MonotonicClock, VirtualClock
from haptic_fieldbus.sim.canopen.bus import SimulatedBus
from haptic_fieldbus.sim.canopen.link import Frame
from haptic_fieldbus.sim.canopen.world import RECEIVE_ROOM, TRANSMIT_ROOM, PacedByClock, Stepped, World
from haptic_fieldbus.sim.drive_on_bus import DriveOnBus
from haptic_fieldbus.sim.faults import BusOff, DriveFault
from tests.sim.bench import NODE, axis, profile

CHANNEL = "maxon_epos4@5,generic_cia402@6"
LONG = 60.0
"""[s]: no frame takes so long, on any machine."""
CLOCKS_DIFFER = 0.5
"""[s]: how far the time of day may be set while a test runs."""
READ_IDENTITY = bytes.fromhex("40 18 10 01 00 00 00 00")
OVERFLOW = 0x004


def frame(can_id: int, data: bytes = b"") -> can.Message:
    return can.Message(arbitration_id=can_id, data=data, is_extended_id=False)


def heartbeat_every(bus: can.BusABC, milliseconds: int, node: int = 6) -> None:
    """Write 1017h; the confirmation is received here."""
    bus.send(frame(0x600 + node, b"\x2b\x17\x10\x00" + struct.pack("<HH", milliseconds, 0)))
    while (message := bus.recv(LONG)) is not None and message.arbitration_id != 0x580 + node:
        pass
    assert message is not None
    assert message.data[0] == 0x60


@pytest.fixture
def bus() -> Iterator[SimulatedBus]:
    with SimulatedBus(CHANNEL) as subject:
        yield subject


@pytest.fixture
def elsewhere() -> Iterator[ThreadPoolExecutor]:
    """Other threads."""
    with ThreadPoolExecutor(8) as executor:
        yield executor


class TestWhoMovesTheTime:
    """The wall clock, unless another clock is given."""

    def test_without_a_clock_it_is_the_machine_s(self, bus: SimulatedBus) -> None:
        assert isinstance(bus.clock, MonotonicClock)
        assert isinstance(bus.world.pace, PacedByClock)

    def test_with_a_virtual_clock_the_program_that_receives(self) -> None:
        with SimulatedBus(CHANNEL, clock=VirtualClock()) as stepped:
            assert isinstance(stepped.world.pace, Stepped)

    def test_no_thread_is_started(self) -> None:
        before = threading.active_count()
        with SimulatedBus(CHANNEL) as bus:
            bus.send(frame(0x605, READ_IDENTITY))
            assert bus.recv(LONG) is not None
            assert threading.active_count() == before

    def test_messages_carry_the_time_of_day(self, bus: SimulatedBus) -> None:
        before = time.time()
        bus.send(frame(0x605, READ_IDENTITY))
        answer = bus.recv(LONG)
        assert answer is not None
        assert before - CLOCKS_DIFFER < answer.timestamp < time.time() + CLOCKS_DIFFER

    def test_a_time_out_takes_its_time(self, bus: SimulatedBus) -> None:
        start = time.monotonic()
        assert bus.recv(0.02) is None
        assert time.monotonic() - start >= 0.02

    def test_no_frame_is_received_before_its_last_bit(self, bus: SimulatedBus) -> None:
        """Request and answer have 8 octets each, at least 111 bits at 1 Mbit/s."""
        for _ in range(20):
            start = time.monotonic()
            bus.send(frame(0x605, READ_IDENTITY))
            while bus.recv(0) is None:
                pass
            assert time.monotonic() - start >= 2 * 111e-6

    def test_periods_are_kept_on_average_however_late_the_program_wakes(self, bus: SimulatedBus) -> None:
        heartbeat_every(bus, 10)
        stamps = []
        for _ in range(20):
            message = bus.recv(LONG)
            assert message is not None
            stamps.append(message.timestamp)
        assert stamps[-1] - stamps[0] == pytest.approx(0.19, abs=0.001)

    def test_what_fell_due_meanwhile_is_received_with_its_own_time(self, bus: SimulatedBus) -> None:
        heartbeat_every(bus, 5)
        time.sleep(0.05)
        beats = list(iter(lambda: bus.recv(0), None))
        assert len(beats) >= 9
        steps = [later.timestamp - earlier.timestamp for earlier, later in pairwise(beats)]
        assert steps == pytest.approx([0.005] * len(steps), abs=1e-6)

    def test_an_answer_comes_within_a_millisecond_of_the_bus(self, bus: SimulatedBus) -> None:
        """By the stamps of a listener: how late a program reads them is a matter of the machine."""
        with SimulatedBus(CHANNEL) as listener:
            for _ in range(20):
                bus.send(frame(0x605, READ_IDENTITY))
                request, answer = listener.recv(LONG), listener.recv(LONG)
                assert request is not None
                assert answer is not None
                assert (request.arbitration_id, answer.arbitration_id) == (0x605, 0x585)
                assert 111e-6 < answer.timestamp - request.timestamp < 1e-3


class TestWaiting:
    """A bus may be used by several threads at once."""

    def test_waiting_for_ever_ends_with_a_frame_of_another_thread(
        self, bus: SimulatedBus, elsewhere: ThreadPoolExecutor
    ) -> None:
        waiter = elsewhere.submit(bus.recv)
        with SimulatedBus(CHANNEL) as other:
            other.send(frame(0x123, b"\1"))
            message = waiter.result(LONG)
        assert message is not None
        assert message.arbitration_id == 0x123

    def test_what_is_changed_in_a_world_that_is_held_is_noticed_by_whoever_waits(
        self, bus: SimulatedBus, elsewhere: ThreadPoolExecutor
    ) -> None:
        waiting = elsewhere.submit(bus.recv, LONG)
        with bus.world.pace.held():
            bus.world.let_happen(6, DriveFault("drive_fault", 0.01))
        message = waiting.result(LONG)
        assert message is not None
        assert message.arbitration_id == 0x086

    def test_every_frame_goes_to_one_of_those_that_wait_on_one_bus(
        self, bus: SimulatedBus, elsewhere: ThreadPoolExecutor
    ) -> None:
        waiters = [elsewhere.submit(bus.recv, LONG) for _ in range(4)]
        with SimulatedBus(CHANNEL) as other:
            for can_id in range(0x100, 0x104):
                other.send(frame(can_id))
            received = [waiter.result(LONG) for waiter in waiters]
        assert sorted(message.arbitration_id for message in received if message is not None) == [*range(0x100, 0x104)]

    def test_every_bus_of_a_channel_hears_every_frame(self, elsewhere: ThreadPoolExecutor) -> None:
        with SimulatedBus(CHANNEL) as one, SimulatedBus(CHANNEL) as two, SimulatedBus(CHANNEL) as three:
            listeners = [elsewhere.submit(_take, subject, 50) for subject in (two, three)]
            for number in range(50):
                one.send(frame(0x100 + number))
            for listener in listeners:
                assert listener.result(LONG) == [0x100 + number for number in range(50)]

    def test_threads_may_send_and_receive_at_once(self, bus: SimulatedBus, elsewhere: ThreadPoolExecutor) -> None:
        with SimulatedBus(CHANNEL) as other:
            senders = [elsewhere.submit(_send_all, bus, range(base, base + 40)) for base in (0x100, 0x200, 0x300)]
            received = _take(other, 120)
            for sender in senders:
                sender.result(LONG)
        assert sorted(received) == [*range(0x100, 0x128), *range(0x200, 0x228), *range(0x300, 0x328)]

    def test_shutting_down_wakes_whoever_waits(self, elsewhere: ThreadPoolExecutor) -> None:
        bus = SimulatedBus(CHANNEL)
        waiters = [elsewhere.submit(bus.recv), elsewhere.submit(bus.recv, 60.0)]
        time.sleep(0.05)
        bus.shutdown()
        for waiter in waiters:
            with pytest.raises(can.CanOperationError, match="shut down"):
                waiter.result(LONG)

    @pytest.mark.parametrize("use", [lambda bus: bus.recv(0), lambda bus: bus.send(frame(1))], ids=["recv", "send"])
    def test_a_bus_that_was_shut_down_is_of_no_use(self, use: Callable[[can.BusABC], object]) -> None:
        bus = SimulatedBus(CHANNEL)
        bus.shutdown()
        with pytest.raises(can.CanOperationError, match="shut down"):
            use(bus)

    def test_a_filter_hides_frames_and_keeps_the_deadline(self) -> None:
        filters: list[dict[str, int | bool]] = [{"can_id": 0x586, "can_mask": 0x7FF, "extended": False}]
        with SimulatedBus(CHANNEL, can_filters=filters) as bus:  # type: ignore[arg-type]
            for node in (5, 6):
                bus.send(frame(0x600 + node, READ_IDENTITY))
            answer = bus.recv(LONG)
            assert answer is not None
            assert answer.arbitration_id == 0x586
            assert bus.recv(0.01) is None

    def test_many_buses_come_and_go_while_others_use_the_channel(self, elsewhere: ThreadPoolExecutor) -> None:
        with SimulatedBus(CHANNEL):
            visits = [elsewhere.submit(_visit, number) for number in range(40)]
            assert [visit.result(LONG) for visit in visits] == [0x586] * 40


class TestRoom:
    """Queues are as long as those of a controller, not endless."""

    def test_frames_that_nobody_reads_are_lost_and_that_is_told(self, bus: SimulatedBus) -> None:
        with SimulatedBus(CHANNEL) as deaf:
            _send_all(bus, [0x123] * 600)
            _drain(bus)
            _send_all(bus, [0x123] * 600)
            _drain(bus)
            assert len(list(iter(lambda: deaf.recv(0), None))) == RECEIVE_ROOM
            bus.send(frame(0x124))
            told, next_one = deaf.recv(LONG), deaf.recv(LONG)
            assert told is not None
            assert next_one is not None
            assert (told.is_error_frame, told.arbitration_id, told.data[1]) == (True, OVERFLOW, 1)
            assert next_one.arbitration_id == 0x124

    def test_a_full_transmit_queue_is_an_error_of_its_own_kind(self) -> None:
        """At 50 kbit/s a frame takes a millisecond, so that a slow machine fills the queue too."""
        with SimulatedBus(CHANNEL, bitrate=50_000) as slow:
            with pytest.raises(can.CanOperationError, match="queue is full") as caught:
                _send_all(slow, [0x123] * 100 * TRANSMIT_ROOM)
            assert caught.value.error_code == errno.ENOBUFS

    def test_with_a_time_out_sending_waits_for_room(self, bus: SimulatedBus) -> None:
        for _ in range(TRANSMIT_ROOM + 200):
            bus.send(frame(0x123), timeout=LONG)

    def test_what_a_program_sent_last_is_sent_although_it_leaves(self, bus: SimulatedBus) -> None:
        with SimulatedBus(CHANNEL) as other:
            for can_id in (0x101, 0x102, 0x103):
                other.send(frame(can_id))
        assert _take(bus, 3) == [0x101, 0x102, 0x103]

    def test_a_program_that_runs_for_days_is_not_remembered_for_ever(self) -> None:
        clock = VirtualClock()
        world = World(clock, longest=10)
        world.add(DriveOnBus(NODE, profile(), axis()))
        controller = world.attach()
        for number in range(100):
            world.send(controller, Frame(0x100 + number, b""))
            world.receive(controller, 1_000_000)
            plant = world.slave(NODE).drive.plant
            plant.advance(clock.now_ns())
            plant.set_target(0.001 * number)
        assert 10 <= world.statistics(0, clock.now_ns()).frames <= 21
        times, _ = world.trajectory(NODE).targets()
        assert 10 <= len(times) <= 21
        world.trajectory(NODE).sample(times[-5:])


def test_faults_of_the_link_reach_every_program_of_a_paced_world() -> None:
    world = World(MonotonicClock())
    world.add(DriveOnBus(NODE, profile(), axis()))
    with SimulatedBus(world=world) as one, SimulatedBus(world=world) as other:
        world.inject_line(BusOff("bus_off", 0.0), world.clock.now_ns())
        for subject in (one, other):
            message = subject.recv(LONG)
            assert message is not None
            assert (message.is_error_frame, message.arbitration_id) == (True, 0x40)
        with pytest.raises(can.CanOperationError, match="bus-off"):
            one.send(frame(1))


def test_a_notifier_and_other_threads_share_a_bus(bus: SimulatedBus) -> None:
    reader = can.BufferedReader()
    notifier = can.Notifier(bus, [reader], timeout=0.05)
    try:
        for node in (5, 6) * 10:
            bus.send(frame(0x600 + node, READ_IDENTITY))
            answer = reader.get_message(LONG)
            assert answer is not None
            assert answer.arbitration_id == 0x580 + node
    finally:
        notifier.stop()


def test_periodic_tasks_of_python_can_send_and_end_with_the_bus() -> None:
    with SimulatedBus(CHANNEL) as listener:
        with SimulatedBus(CHANNEL) as bus:
            bus.send_periodic(frame(0x123), 0.005)
            assert _take(listener, 10) == [0x123] * 10
        _drain(listener)
        sent_before_the_end = list(iter(lambda: listener.recv(0), None))
        assert {message.arbitration_id for message in sent_before_the_end} <= {0x123}
        assert listener.recv(0.05) is None


def _take(bus: can.BusABC, count: int) -> list[int]:
    taken = []
    for _ in range(count):
        message = bus.recv(LONG)
        assert message is not None
        taken.append(message.arbitration_id)
    return taken


def _drain(bus: can.BusABC) -> None:
    """Until all that was sent has gone, as the last frame shows."""
    with SimulatedBus(bus.channel_info.removeprefix("haptic_sim ")) as ear:
        bus.send(frame(0x7FE), timeout=LONG)
        while (message := ear.recv(LONG)) is not None and message.arbitration_id != 0x7FE:
            pass


def _send_all(bus: can.BusABC, identifiers: "range | list[int]") -> None:
    for can_id in identifiers:
        bus.send(frame(can_id))


def _visit(_number: int) -> int:
    """Open the channel, ask a drive, leave."""
    with SimulatedBus(CHANNEL, can_filters=[{"can_id": 0x586, "can_mask": 0x7FF, "extended": False}]) as bus:
        bus.send(frame(0x606, READ_IDENTITY))
        answer = bus.recv(LONG)
        return 0 if answer is None else answer.arbitration_id
