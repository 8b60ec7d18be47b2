"""Hosting simulated drives on a python-can bus, and what is built before a drive is ready."""

import gc
import math
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path

import can
import pytest

from haptic_fieldbus.drive.rig import shipped_mechanism
from haptic_fieldbus.errors import BusError
from haptic_fieldbus.signals import Workspace
from haptic_fieldbus.sim.canopen.hosting import host
from haptic_fieldbus.sim.drive_on_bus import DriveOnBus
from haptic_fieldbus.sim.faults import Emergency
from haptic_fieldbus.sim.hand import HANDS, grip
from haptic_fieldbus.sim.host_request import HostRequest, NamedDrive, resolve, slot_of
from haptic_fieldbus.sim.mechanics import motion
from haptic_fieldbus.sim.mechanics.motion import Shaft
from haptic_fieldbus.sim.mechanics.plant import Plant
from tests.sim.canopen.hosted import MS, READ_IDENTITY, Hosted, enabled

PROJECT = Path(__file__).resolve().parents[3]


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
        assert hosted.host_port.lost == 2
        assert hosted.told == []

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


class TestWhatIsBuiltBeforeReady:
    """Nothing that takes long is left for the time when a master waits for an answer."""

    @pytest.mark.thorough("hosts drives in another process")
    def test_no_matrix_exponential_is_computed_afterwards(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """Through all that a shaft does: pushed, held, turned back, let go, stopped, at instants that never repeat."""
        hosted = Hosted(5, hand="release")
        hosted.serve()
        computed: list[object] = []
        monkeypatch.setattr(motion, "expm", computed.append)
        seen = enabled(hosted)
        for number in range(3000):
            hosted.send(0x80, b"")
            hosted.send(0x205, struct.pack("<Hh", 0x0F, -400 if number // 300 % 2 else 40))
            seen += hosted.serve(MS + 997 * (number % 13) + number)
        places = [struct.unpack("<Hi", data)[1] for can_id, data in seen if can_id == 0x185]
        steps = [after - before for before, after in pairwise(places)]
        assert min(steps) < -5 < 5 < max(steps), "it did move, both ways"
        hosted.send(0x205, struct.pack("<Hh", 0x02, 0))
        hosted.serve(500 * MS + 1)
        assert computed == []
        hosted.close()

    def test_a_motion_by_powers_of_two_is_that_of_its_spans(self) -> None:
        """Two plants, one prepared: the same pushes at the same odd instants."""
        hand = HANDS["push"]
        assert hand is not None
        plants = [Plant(Shaft(4e-5, 1e-4, 2e-3, 1.6e-4), grip(hand, shipped_mechanism(Workspace.LINEAR))) for _ in "ab"]
        plants[1].prepare()
        for plant in plants:
            plant.start_hand()
            for number in range(400):
                plant.set_target(0.02 * math.sin(0.1 * number))
                plant.advance(plant.t_ns + 999_983 + 7 * number)
        assert plants[1].state == pytest.approx(plants[0].state, rel=1e-9, abs=1e-12)
        assert abs(plants[0].position) > 0.1

    def test_while_nothing_is_asked_the_shafts_are_followed(self) -> None:
        """Work that a silence of minutes leaves would hold up the first answer."""
        hosted = Hosted(5, hand="push", led=True)
        (slave,) = hosted.host._drives.slaves.values()
        for _ in range(50):
            hosted.serve(100 * MS)
            assert slave.drive.plant.t_ns == hosted.clock.now_ns()
        hosted.close()

    def test_what_exists_is_out_of_garbage_collection_while_drives_are_hosted(self) -> None:
        bus, slots = resolve(HostRequest(["generic_cia402@7"], "virtual:hosting frozen"))
        frozen: list[int] = []
        gc.unfreeze()  # what these tests have frozen; it is frozen again below
        try:
            host(bus, slots, 0, lambda _slot: frozen.append(gc.get_freeze_count()), lambda: True)
            assert frozen[0] > 10_000
            assert gc.get_freeze_count() == 0
        finally:
            gc.freeze()

    @pytest.mark.thorough("a process of its own")
    def test_no_module_is_imported_afterwards(self) -> None:
        """In a process of its own, because this one has long imported everything."""
        ended = subprocess.run(
            [sys.executable, "-c", IMPORTS], cwd=PROJECT, capture_output=True, text=True, check=True, timeout=120
        )
        assert ended.stdout.split() == ["moved"]


IMPORTS = """
import sys
from tests.sim.canopen.hosted import Hosted, enabled
hosted = Hosted(5, hand="push")
hosted.serve()
known = set(sys.modules)
seen = enabled(hosted)
for number in range(1000):
    seen += hosted.serve(1_000_007 + number)
    hosted.send(0x80, b"")
print("moved" if len(seen) > 900 else "stood", *sorted(set(sys.modules) - known))
"""


class TestHosting:
    """The whole of it, in real time."""

    def test_a_bus_that_cannot_be_opened_is_a_bus_error(self) -> None:
        bus, slots = resolve(HostRequest(["generic_cia402"], "udp_multicast:127.0.0.1"))
        with pytest.raises(BusError, match="udp_multicast"):
            host(bus, slots, 0, lambda _slot: None, lambda: True)

    def test_hosting_ends_when_it_is_asked_to(self) -> None:
        bus, slots = resolve(HostRequest(["generic_cia402@7"], "virtual:hosting until asked"))
        told: list[int] = []
        asked = iter([False, True])
        with can.Bus(interface="virtual", channel="hosting until asked") as ear:

            def ready(slot: DriveOnBus) -> None:
                heard = [each.arbitration_id for each in iter(lambda: ear.recv(0), None)]
                assert heard == [0x607, 0x707], "it asks for its node-ID, and is ready after its boot-up message"
                told.append(slot.node)

            assert host(bus, slots, 0, ready, lambda: next(asked)) == 0
        assert told == [7]

    @pytest.mark.thorough("listens for a second each time", quick=1)
    @pytest.mark.parametrize("other", ["asked", "unasked", "remote", "of another node"])
    def test_a_node_id_that_another_device_has_is_refused_before_anything_is_opened(self, other: str) -> None:
        """The other device answers the one request, or sends a heartbeat before it is asked."""
        bus, slots = resolve(HostRequest(["generic_cia402@7", "generic_cia402@8"], f"virtual:hosting twice {other}"))
        told: list[object] = []
        with can.Bus(interface="virtual", channel=f"hosting twice {other}") as device:
            heard = can.Message(
                arbitration_id={"asked": 0x587, "of another node": 0x709}.get(other, 0x707),
                data=None if other == "remote" else bytes(8),
                is_remote_frame=other == "remote",
                is_extended_id=False,
            )

            def answer(message: can.Message) -> None:
                if message.arbitration_id == 0x607 or other != "asked":
                    device.send(heard)

            ended = threading.Event()
            notifier = can.Notifier(device, [answer])
            sender = None if other == "asked" else threading.Thread(target=_repeat, args=(device, heard, ended))
            try:
                if sender is not None:
                    sender.start()
                if other in ("remote", "of another node"):
                    assert host(bus, slots, 0, told.append, lambda: True, opened=told.append) == 0
                    assert len(told) == 3
                else:
                    with pytest.raises(BusError, match=r"another device on this bus has the node-ID 7; choose another"):
                        host(bus, slots, 0, told.append, lambda: True, opened=told.append)
                    assert told == []
            finally:
                ended.set()
                notifier.stop()
                if sender is not None:
                    sender.join()

    def test_a_device_that_takes_the_node_id_later_ends_the_hosting(self) -> None:
        bus, slots = resolve(HostRequest(["generic_cia402@7"], "virtual:hosting twice later"))
        with can.Bus(interface="virtual", channel="hosting twice later") as device:
            booted = can.Message(arbitration_id=0x707, data=b"\0", is_extended_id=False)
            end_s = time.monotonic() + 10.0
            with pytest.raises(BusError, match=r"later: another device on this bus has the node-ID 7; choose another"):
                host(bus, slots, 0, lambda slot: device.send(booted), lambda: time.monotonic() > end_s)

    def test_of_two_that_begin_at_the_same_time_at_most_one_goes_on(self) -> None:
        bus, slots = resolve(HostRequest(["generic_cia402@7"], "virtual:hosting twice at once"))
        together, end_s = threading.Barrier(2), time.monotonic() + 10.0
        told: list[str] = []

        def hosted() -> None:
            together.wait()
            try:
                host(bus, slots, 0, lambda slot: None, lambda: bool(told) or time.monotonic() > end_s)
            except BusError as error:
                told.append(str(error))

        threads = [threading.Thread(target=hosted) for _ in range(2)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert told
        assert all(" at once: another device on this bus has the node-ID 7; " in each for each in told)


def _repeat(device: can.BusABC, message: can.Message, ended: threading.Event) -> None:
    while not ended.wait(0.005):
        device.send(message)


class TestWhatConcernsTheDrives:
    """The kernel may drop all other frames, before this process has seen what came just before them."""

    def _told(self, hosted: Hosted) -> list[set[tuple[int, bool]]]:
        told: list[set[tuple[int, bool]]] = []
        hosted.host_port.focus = lambda concerns: told.append(set(concerns))  # type: ignore[method-assign]
        return told

    def test_is_known_before_the_answer_to_what_changed_it(self) -> None:
        hosted = Hosted(5)
        told = self._told(hosted)
        hosted.serve()
        assert {(0, False), (0x605, False), (0x7E5, False), (0x080, False), (0x705, True)} <= told[-1]
        # RPDO 1, and a master's heartbeat.
        assert (0x205, False) in told[-1]
        assert (0x77F, False) not in told[-1]
        seen: list[set[tuple[int, bool]]] = []
        send = hosted.host_port.send
        hosted.host_port.send = lambda frame: (seen.append(told[-1]), send(frame))[1]  # type: ignore[func-returns-value,method-assign]
        hosted.send(0x605, bytes.fromhex("23 16 10 01 32 00 7f 00"))
        hosted.serve(0)
        assert (0x77F, False) in seen[-1]
        hosted.close()

    def test_is_told_for_any_state_so_that_a_command_and_what_follows_it_pass_together(self) -> None:
        hosted = Hosted(5, 6)
        told = self._told(hosted)
        enabled(hosted)
        for command in (1, 2, 128, 130, 129, 1):
            hosted.send(0, bytes((command, 0)))
            hosted.serve(100 * MS)
            for _, slave in hosted.host._drives.attached:
                heard = {(each, False) for each in slave.node.handlers} | {(each, True) for each in slave.node.requests}
                assert heard <= told[-1]
            # All that it hears when it is operational, whatever its state is.
            assert {(0x080, False), (0x205, False), (0x206, False)} <= told[-1]
        hosted.close()
