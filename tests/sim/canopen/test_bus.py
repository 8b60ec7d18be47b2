"""The simulated wire as a python-can interface, stepped; its paced half is in `test_pace`."""

import can
import pytest

from haptic_fieldbus.buses.canopen.opening import open_can
from haptic_fieldbus.clock import MonotonicClock, VirtualClock
from haptic_fieldbus.protocols.registry import protocol_named
from haptic_fieldbus.sim.canopen import bus as module
from haptic_fieldbus.sim.canopen.bus import SimulatedBus, embedded_bus, publish
from haptic_fieldbus.sim.canopen.world import LONGEST_WAIT_NS, World
from haptic_fieldbus.sim.drive_on_bus import DriveOnBus
from haptic_fieldbus.sim.faults import BusOff
from tests.sim.bench import NODE, axis, profile

CHANNEL = "maxon_epos4@5,generic_cia402@6"
READ_IDENTITY = bytes.fromhex("40 18 10 01 00 00 00 00")


def _open(channel: str = CHANNEL, **options: object) -> SimulatedBus:
    """A bus in virtual time."""
    return SimulatedBus(channel, clock=VirtualClock(), **options)  # type: ignore[arg-type]


def _request(bus: can.BusABC, node: int, data: bytes = READ_IDENTITY) -> can.Message | None:
    bus.send(can.Message(arbitration_id=0x600 + node, data=data, is_extended_id=False))
    return bus.recv(0.01)


def test_the_interface_is_found_by_its_name() -> None:
    with can.Bus(interface="haptic_sim", channel=CHANNEL, bitrate=500_000) as bus:
        assert isinstance(bus, SimulatedBus)
        assert bus.channel_info == f"haptic_sim {CHANNEL}"


def test_a_channel_creates_the_drives_that_it_names() -> None:
    with _open() as bus:
        answers = [_request(bus, node) for node in (5, 6)]
        assert [answer is not None and answer.data[0] for answer in answers] == [0x43, 0x43]
        assert _request(bus, 7) is None


@pytest.mark.parametrize(
    "channel", ["", "maxon_epos4", "maxon_epos4@", "maxon_epos4@0", "maxon_epos4@128", "@5", "a@b"]
)
def test_a_channel_that_names_no_drive_is_refused(channel: str) -> None:
    with pytest.raises(can.CanInitializationError, match="expected profile@node-ID"):
        SimulatedBus(channel)


@pytest.mark.parametrize(
    ("channel", "options"),
    [("maxon_epos5@5", {}), ("maxon_epos4@5,generic_cia402@5", {}), (CHANNEL, {"hand": "punch"}),
     (CHANNEL, {"workspace": "flat"})],
)  # fmt: skip
def test_a_world_that_cannot_be_made_is_refused(channel: str, options: dict[str, str]) -> None:
    with pytest.raises(can.CanInitializationError):
        SimulatedBus(channel, **options)  # type: ignore[arg-type]


def test_all_drives_of_a_channel_that_are_wrong_are_told_at_once() -> None:
    with pytest.raises(can.CanInitializationError) as refused:
        SimulatedBus("maxon_epos5@5,maxon_epos4@200,generic_cia402@6,generic_cia402@6")
    assert [line.split(maxsplit=1)[0] for line in str(refused.value).splitlines()] == [
        "no",
        '"maxon_epos4@200":',
        "node",
    ]


class TestSharing:
    """One channel name in a process is one bus."""

    def test_two_buses_of_one_channel_hear_each_other(self) -> None:
        with _open() as one, SimulatedBus(CHANNEL) as other:
            one.send(can.Message(arbitration_id=0x123, data=b"\1\2", is_extended_id=False))
            heard = other.recv(0.01)
            assert heard is not None
            assert (heard.arbitration_id, heard.data, heard.is_rx) == (0x123, bytearray(b"\1\2"), True)
            assert one.recv(0.01) is None

    def test_the_world_ends_with_its_last_bus(self) -> None:
        with _open() as one:
            world = one.world
            with SimulatedBus(CHANNEL) as other:
                assert other.world is world
        with _open() as later:
            assert later.world is not world

    def test_a_shared_channel_has_one_clock_and_one_bit_rate(self) -> None:
        clock = VirtualClock()
        with SimulatedBus(CHANNEL, clock=clock):
            for options in ({"clock": VirtualClock()}, {"bitrate": 500_000}):
                with pytest.raises(can.CanInitializationError, match="another clock or bit rate"):
                    SimulatedBus(CHANNEL, **options)
            with SimulatedBus(CHANNEL, clock=clock) as other:
                assert other.clock is clock

    def test_a_world_is_opened_by_its_name_while_it_has_one(self) -> None:
        world = World(VirtualClock())
        with publish("mine", world):
            with SimulatedBus("mine") as bus:
                assert bus.world is world
            with pytest.raises(ValueError, match='channel "mine" is in use'), publish("mine", world):
                pass
        with pytest.raises(can.CanInitializationError, match='"mine": expected profile@node-ID'):
            SimulatedBus("mine")

    def test_a_bus_on_a_given_world_is_its_own(self) -> None:
        world = World(VirtualClock())
        world.add(DriveOnBus(NODE, profile(), axis()))
        with SimulatedBus(world=world, receive_own_messages=True) as bus:
            bus.send(can.Message(arbitration_id=0x123, is_extended_id=False))
            own = bus.recv(0.01)
            assert own is not None
            assert not own.is_rx


class StandingClock(MonotonicClock):
    """A wall clock that stands still until it is set."""

    now = 1_000_000_000_000

    def now_ns(self) -> int:
        return self.now


class TestEmbedded:
    """Drives inside this program by the wall clock, on a bus that is treated as a real one."""

    def test_a_run_takes_the_bus_for_a_real_one_and_knows_that_it_is_a_rehearsal(self) -> None:
        with embedded_bus([DriveOnBus(NODE, profile(), axis())]) as section:
            assert (section.simulated, section.rehearsed) == (False, True)
            name = protocol_named("canopen").bus_name(section)
            assert (name.section, name.simulated) == (section, False)
            for _ in range(2):
                with open_can(section) as bus:
                    assert _request(bus, NODE) is not None, "the same drive each time"
        with pytest.raises(can.CanInitializationError):
            SimulatedBus("nothing of this name is left")

    def test_a_guard_acts_at_its_own_instant_though_nothing_looked_for_a_second(
        self, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """1016h:01 = 50 ms: the emergency 8130h is on the wire 50 ms after the last heartbeat, when it is read late."""
        clock = StandingClock()
        monkeypatch.setattr(module, "MonotonicClock", lambda: clock)
        with embedded_bus([DriveOnBus(NODE, profile(), axis())]) as section, open_can(section) as bus:

            def send(can_id: int, data: bytes) -> None:
                bus.send(can.Message(arbitration_id=can_id, data=data, is_extended_id=False))
                clock.now += 1_000_000

            clock.now += 10_000_000
            send(0x600 + NODE, b"\x23\x16\x10\x01" + (127 << 16 | 50).to_bytes(4, "little"))
            send(0x77F, b"\x05")
            alive_ns = clock.now - 1_000_000
            clock.now += 1_000_000_000
            frames = {frame.arbitration_id: frame for frame in iter(lambda: bus.recv(0.0), None)}
            emergency = frames[0x080 + NODE]
            assert emergency.data[:2] == b"\x30\x81"
            late = emergency.timestamp - bus.pace.timestamp(alive_ns)  # type: ignore[attr-defined]
            assert late == pytest.approx(0.050, abs=1e-3)


class TestReceive:
    """Time goes along with recv."""

    def test_a_time_out_moves_virtual_time(self) -> None:
        with _open() as bus:
            start_ns = bus.clock.now_ns()
            assert bus.recv(0.25) is None
            assert bus.clock.now_ns() == start_ns + 250_000_000

    @pytest.mark.parametrize("timeout", [0, 0.0, -1.0])
    def test_no_time_out_takes_what_is_there(self, timeout: float) -> None:
        with _open() as bus:
            start_ns = bus.clock.now_ns()
            assert bus.recv(timeout) is None
            assert bus.clock.now_ns() == start_ns

    def test_waiting_for_ever_ends_with_the_next_frame(self) -> None:
        with _open() as bus:
            bus.send(can.Message(arbitration_id=0x605, data=READ_IDENTITY, is_extended_id=False))
            answer = bus.recv()
            assert answer is not None
            assert answer.arbitration_id == 0x585
            assert answer.timestamp == pytest.approx(bus.clock.now_ns() * 1e-9)

    def test_waiting_for_ever_for_nothing_is_an_error_and_not_a_hang(self) -> None:
        with _open() as bus, pytest.raises(can.CanOperationError, match="nothing will arrive"):
            bus.recv()

    def test_waiting_for_ever_while_only_frames_of_no_interest_come_ends_after_a_minute(self) -> None:
        with _open("generic_cia402@6", can_filters=[{"can_id": 0x123, "can_mask": 0x7FF}]) as bus:
            bus.send(
                can.Message(arbitration_id=0x606, data=bytes.fromhex("2b 17 10 00 e8 03 00 00"), is_extended_id=False)
            )
            with pytest.raises(can.CanOperationError, match="60 s"):
                bus.recv()
            assert bus.clock.now_ns() == pytest.approx(LONGEST_WAIT_NS, abs=1_000_000)

    def test_filters_hide_other_frames_and_the_deadline_stays(self) -> None:
        with _open(CHANNEL, can_filters=[{"can_id": 0x586, "can_mask": 0x7FF, "extended": False}]) as bus:
            for node in (5, 6):
                bus.send(can.Message(arbitration_id=0x600 + node, data=READ_IDENTITY, is_extended_id=False))
            answer = bus.recv(0.01)
            assert answer is not None
            assert answer.arbitration_id == 0x586
            start_ns = bus.clock.now_ns()
            bus.send(can.Message(arbitration_id=0x605, data=READ_IDENTITY, is_extended_id=False))
            assert bus.recv(0.01) is None
            assert bus.clock.now_ns() == start_ns + 10_000_000

    def test_messages_do_not_share_their_octets(self) -> None:
        with _open() as one, SimulatedBus(CHANNEL) as other, SimulatedBus(CHANNEL) as third:
            one.send(can.Message(arbitration_id=0x123, data=b"\1", is_extended_id=False))
            heard, again = other.recv(0.01), third.recv(0.01)
            assert heard is not None
            assert again is not None
            heard.data[0] = 9
            assert again.data == bytearray(b"\1")


class TestSend:
    """Frames that the wire takes."""

    @pytest.mark.parametrize(
        "message",
        [
            can.Message(arbitration_id=0x1ABCDE, data=b"\1\2\3", is_extended_id=True),
            can.Message(arbitration_id=0x7FF, dlc=5, is_remote_frame=True, is_extended_id=False),
            can.Message(arbitration_id=0, is_extended_id=False),
        ],
        ids=["extended", "remote", "empty"],
    )
    def test_frames_arrive_as_they_were_sent(self, message: can.Message) -> None:
        with _open() as one, SimulatedBus(CHANNEL) as other:
            one.send(message)
            heard = other.recv(0.01)
            assert heard is not None
            assert heard.equals(message, timestamp_delta=None, check_channel=False, check_direction=False)

    @pytest.mark.parametrize(
        "message",
        [
            can.Message(is_fd=True, data=bytes(12)),
            can.Message(is_error_frame=True),
            can.Message(data=bytes(9), is_extended_id=False),
        ],
        ids=["FD", "error frame", "nine octets"],
    )
    def test_what_a_classical_bus_cannot_carry_is_refused(self, message: can.Message) -> None:
        with _open() as bus, pytest.raises(can.CanOperationError, match="classical"):
            bus.send(message)

    def test_a_bus_that_is_off_sends_nothing_and_says_so(self) -> None:
        world = World(VirtualClock())
        world.add(DriveOnBus(NODE, profile(), axis()))
        with SimulatedBus(world=world) as bus:
            states = [bus.state]
            world.inject_line(BusOff("bus_off", 0.0), 0)
            error = bus.recv(0)
            assert error is not None
            assert error.is_error_frame
            states.append(bus.state)
            assert states == [can.BusState.ACTIVE, can.BusState.ERROR]
            with pytest.raises(can.CanOperationError, match="bus-off"):
                bus.send(can.Message(arbitration_id=1, is_extended_id=False))

    def test_the_state_cannot_be_set(self) -> None:
        with _open() as bus, pytest.raises(NotImplementedError):
            bus.state = can.BusState.PASSIVE


def test_shutting_down_twice_is_allowed() -> None:
    bus = _open()
    bus.shutdown()
    bus.shutdown()
