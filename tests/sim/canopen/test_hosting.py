"""Hosting simulated drives on a python-can bus: in this thread, on `virtual`, served turn by turn."""

import struct
from collections.abc import Callable, Iterator

import can
import pytest

from haptic_fieldbus.clock import VirtualClock
from haptic_fieldbus.errors import BusError, UsageError
from haptic_fieldbus.signals import Workspace
from haptic_fieldbus.sim.canopen.channel import NamedDrive, slot_of
from haptic_fieldbus.sim.canopen.hosting import Host, HostRequest, host, joined_bus, numbered, resolve
from haptic_fieldbus.sim.faults import BusOff, Emergency, ErrorFrame, Fault
from haptic_fieldbus.sim.slot import Slot

MS = 1_000_000
READ_IDENTITY = bytes.fromhex("40 18 10 01 00 00 00 00")


class Hosted:
    """Drives on one end of a virtual bus, the test on the other; time moves when told to."""

    def __init__(self, *nodes: int, faults: tuple[Fault, ...] = (), echoes: bool = False) -> None:
        channel = f"hosting {id(self)}"
        self.clock = VirtualClock()
        self.theirs = can.Bus(interface="virtual", channel=channel, receive_own_messages=echoes)
        self.bus = can.Bus(interface="virtual", channel=channel)
        self.host = Host(self.theirs, self.clock, "virtual:hosting", echoes=echoes)
        for node in nodes:
            drive = NamedDrive("generic_cia402", node)
            self.host.add(slot_of(drive, "virtual:hosting", Workspace.LINEAR, None, faults, booted=False))

    def send(self, can_id: int, data: bytes, *, remote: bool = False, extended: bool = False) -> None:
        self.bus.send(
            can.Message(
                arbitration_id=can_id,
                data=None if remote else data,
                dlc=len(data),
                is_remote_frame=remote,
                is_extended_id=extended,
            )
        )

    def serve(self, duration_ns: int = MS) -> list[tuple[int, bytes]]:
        """Time passes; what was sent is served first, then what falls due; returns what the drives sent."""
        for _ in range(20):
            self.host.serve(0)
        self.clock.compute(duration_ns)
        self.host.serve(0)
        heard = iter(lambda: self.bus.recv(0), None)
        return [(message.arbitration_id, bytes(message.data)) for message in heard]

    def close(self) -> None:
        self.theirs.shutdown()
        self.bus.shutdown()


@pytest.fixture
def hosted() -> Iterator[Hosted]:
    subject = Hosted(5, 6)
    yield subject
    subject.close()


class TestHost:
    """Frames in, frames out."""

    def test_drives_that_are_switched_on_say_so(self, hosted: Hosted) -> None:
        assert sorted(hosted.serve()) == [(0x705, b"\0"), (0x706, b"\0")]

    def test_each_drive_answers_for_itself(self, hosted: Hosted) -> None:
        hosted.serve()
        hosted.send(0x606, READ_IDENTITY)
        ((can_id, data),) = hosted.serve()
        assert (can_id, data[:4]) == (0x586, bytes.fromhex("43 18 10 01"))

    def test_timers_keep_their_own_time_however_late_they_are_served(self, hosted: Hosted) -> None:
        hosted.serve()
        hosted.send(0x605, bytes.fromhex("2B 17 10 00 0A 00 00 00"))
        hosted.serve(0)
        assert hosted.serve(95 * MS) == [(0x705, b"\x7f")] * 9
        assert hosted.serve(6 * MS) == [(0x705, b"\x7f")]

    def test_what_drives_send_at_one_instant_goes_out_by_priority(self) -> None:
        hosted = Hosted(7, 5, 6)
        hosted.serve()
        hosted.send(0, bytes((129, 0)))
        hosted.serve()
        for node in (7, 5, 6):
            hosted.send(0x600 + node, bytes.fromhex("2F 00 18 02 01 00 00 00"))
        hosted.serve(100 * MS)
        hosted.send(0, bytes((1, 0)))
        hosted.serve()
        hosted.send(0x80, b"")
        sent = [can_id for can_id, _ in hosted.serve() if can_id & 0x780 == 0x180]
        assert sent == sorted(sent)
        hosted.close()

    @pytest.mark.parametrize("echoes", [False, True])
    def test_drives_of_one_host_hear_one_another_once(self, echoes: bool) -> None:
        """Node 6 watches the heartbeat of node 5; it complains when that stops, and not before."""
        hosted = Hosted(5, 6, echoes=echoes)
        hosted.serve()
        hosted.send(0x606, bytes.fromhex("23 16 10 01") + struct.pack("<HBB", 25, 5, 0))
        hosted.send(0x605, bytes.fromhex("2B 17 10 00 0A 00 00 00"))
        hosted.serve(0)
        heard = [frame for _ in range(20) for frame in hosted.serve(10 * MS)]
        assert 0x86 not in {can_id for can_id, _ in heard}
        hosted.send(0x605, bytes.fromhex("2B 17 10 00 00 00 00 00"))
        heard = [frame for _ in range(10) for frame in hosted.serve(10 * MS)]
        assert [data[:2] for can_id, data in heard if can_id == 0x86] == [bytes.fromhex("30 81")]
        hosted.close()

    def test_error_frames_and_frames_that_a_drive_cannot_use_are_passed_over(self, hosted: Hosted) -> None:
        hosted.serve()
        hosted.bus.send(can.Message(is_error_frame=True))
        hosted.bus.send(can.Message(arbitration_id=0x605, is_fd=True, data=bytes(12), is_extended_id=False))
        hosted.send(0x605, READ_IDENTITY, extended=True)
        hosted.send(0x605, bytes(8), remote=True)
        assert hosted.serve() == []

    def test_a_full_transmit_queue_loses_frames_and_counts_them(self, hosted: Hosted) -> None:
        hosted.theirs.send = _refuse("Transmit buffer full")  # type: ignore[method-assign,assignment]
        hosted.serve()
        assert hosted.host.lost == 2

    def test_a_dead_bus_is_a_bus_error(self, hosted: Hosted) -> None:
        hosted.theirs.send = _refuse("network is down")  # type: ignore[method-assign,assignment]
        with pytest.raises(BusError, match="virtual:hosting: network is down"):
            hosted.serve()
        hosted.theirs.shutdown()
        with pytest.raises(BusError, match="virtual:hosting"):
            hosted.host.serve(0)

    def test_a_node_id_is_given_once(self, hosted: Hosted) -> None:
        with pytest.raises(ValueError, match="node 5 is on this bus already"):
            hosted.host.add(slot_of(NamedDrive("generic_cia402", 5), "bus", Workspace.LINEAR))

    def test_faults_befall_hosted_drives(self) -> None:
        hosted = Hosted(5, faults=(Emergency("emergency", at=0.01, code=0x4210),))
        hosted.serve()
        hosted.send(0, bytes((1, 5)))
        for controlword in (0x06, 0x07, 0x0F):
            hosted.send(0x205, struct.pack("<H", controlword))
        hosted.serve(5 * MS)
        assert 0x85 not in {can_id for can_id, _ in hosted.serve(4 * MS)}
        assert (0x85, bytes.fromhex("10 42")) in [(can_id, data[:2]) for can_id, data in hosted.serve(2 * MS)]
        hosted.close()


def _refuse(sentence: str) -> Callable[[can.Message, float | None], None]:
    def send(message: can.Message, timeout: float | None = None) -> None:
        raise can.CanOperationError(sentence)

    return send


class TestRequest:
    """What is asked for is checked, all of it, before a bus is opened."""

    @pytest.mark.parametrize(
        ("texts", "first", "nodes"),
        [
            (["maxon_epos4"], 1, [1]),
            (["maxon_epos4", "generic_cia402"], 5, [5, 6]),
            (["maxon_epos4@9", "generic_cia402", "generic_cia402@5", "maxon_epos4"], 5, [9, 6, 5, 7]),
        ],
    )
    def test_drives_get_the_node_id_they_ask_for_or_the_next_free_one(
        self, texts: list[str], first: int, nodes: list[int]
    ) -> None:
        drives = numbered(texts, first)
        assert [drive.node for drive in drives] == nodes
        assert [drive.profile for drive in drives] == [text.partition("@")[0] for text in texts]

    @pytest.mark.parametrize(
        ("texts", "first", "said"),
        [
            (["a@5", "b@5"], 1, "node-ID 5 is asked for twice"),
            (["a"], 0, "node 0: a node-ID is a whole number from 1 to 127"),
            (["a@200"], 1, "expected profile@node-ID"),
            (["a", "b"], 127, "no node-ID is left for b"),
        ],
    )
    def test_impossible_node_ids_are_refused(self, texts: list[str], first: int, said: str) -> None:
        with pytest.raises(UsageError, match=said):
            numbered(texts, first)

    @pytest.mark.parametrize("bus", ["sim", "sim@500000", "haptic_sim:maxon_epos4@5", None])
    def test_a_bus_that_no_other_program_can_join_is_refused(self, bus: str | None) -> None:
        with pytest.raises(UsageError, match="socketcan:can0"):
            joined_bus(bus)

    def test_all_that_is_wrong_is_told_at_once(self) -> None:
        faults = (BusOff("bus_off", 1.0), ErrorFrame("error_frame", 1.0), Emergency("emergency", 1.0, 1, bus="can0"))
        request = HostRequest(["generic_cia402", "nonsense"], "sim", hand="foot", faults=faults)
        with pytest.raises(UsageError) as refused:
            resolve(request)
        said = str(refused.value).splitlines()
        assert [line.split()[0:2] for line in said] == [
            ["fault", '"bus_off"'], ["fault", '"error_frame"'], ["fault", '"emergency"'], ["no", "hand"],
            ["bus", '"sim":'], ["no", "profile"],
        ]  # fmt: skip

    def test_a_bus_that_cannot_be_opened_is_a_bus_error(self) -> None:
        bus, slots = resolve(HostRequest(["generic_cia402"], "udp_multicast:127.0.0.1"))
        with pytest.raises(BusError, match="udp_multicast"):
            host(bus, slots, 0, lambda _slot: None, lambda: True)

    def test_hosting_ends_when_it_is_asked_to(self) -> None:
        bus, slots = resolve(HostRequest(["generic_cia402@7"], "virtual:hosting until asked"))
        told: list[int] = []
        asked = iter([False, True])
        with can.Bus(interface="virtual", channel="hosting until asked") as ear:

            def ready(slot: Slot) -> None:
                boot_up = ear.recv(0)
                assert boot_up is not None, "it is ready when its boot-up message has been sent"
                told.append(boot_up.arbitration_id - 0x700)
                assert slot.node == told[-1]

            assert host(bus, slots, 0, ready, lambda: next(asked)) == 0
        assert told == [7]
