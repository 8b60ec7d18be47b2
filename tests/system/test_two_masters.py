"""Two masters on one bus: the second is refused, or both let go, and nobody feeds the guard of a dead one's drive."""

import json
import signal
import struct
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import can
import pytest

from haptic_fieldbus.buses.canopen.master import CanopenBus
from haptic_fieldbus.clock import VirtualClock
from haptic_fieldbus.cycle.cycle import Cycle
from haptic_fieldbus.cycle.safety import TripKind
from haptic_fieldbus.errors import ForeignMasterError, SafetyTripError
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.sim.canopen.bus import SimulatedBus
from haptic_fieldbus.sim.canopen.world import World
from haptic_fieldbus.sim.drive_on_bus import DriveOnBus
from haptic_fieldbus.sim.hand import hand_named
from tests.builders import WALL, plan_of, rig_of
from tests.buses.canopen.test_other_master import COMMANDS
from tests.peers.hosts import GROUP, STARTS_WITHIN, free_port, line_of, require_multicast, start
from tests.whole_loop import run_loop

PERIOD_NS = 1_000_000
CONTACT = 600
"""[periods] after operation enabled; the pushing hand is in the wall by then."""


def plan_on(node: int) -> Plan:
    rig = rig_of(WALL)
    return plan_of(rig=replace(rig, axis={"handle": replace(rig.axis["handle"], node=node)}))


class Bench:
    """Drives 1 and 2 on one simulated wire; every frame on it is kept."""

    def __init__(self) -> None:
        self.clock = VirtualClock()
        self.world = World(self.clock)
        self.plans = {node: plan_on(node) for node in (1, 2)}
        for node, plan in self.plans.items():
            axis = plan.axes[0]
            self.world.add(DriveOnBus(node, axis.profile, axis.rig, hand_named("push")))
        self.frames: list[tuple[int, int, bytes]] = []
        self.world.tap(lambda t_ns, can_id, data: self.frames.append((t_ns, can_id, data)))
        self.forger = SimulatedBus(world=self.world)
        self._ports = [self.forger]

    def master(self) -> CanopenBus:
        self._ports.append(SimulatedBus(world=self.world))
        return CanopenBus(self._ports[-1], self.clock)

    def close(self) -> None:
        for port in self._ports:
            port.shutdown()

    def forge(self, can_id: int, data: bytes) -> None:
        self.forger.send(can.Message(arbitration_id=can_id, data=data, is_extended_id=False))

    def torques(self, node: int) -> list[int]:
        return [struct.unpack("<Hh", data)[1] for _, can_id, data in self.frames if can_id == 0x200 + node]


class Loop:
    """The loop of one master, one period a call, so that two of them can take turns."""

    def __init__(self, bench: Bench, node: int) -> None:
        self.bench, self.plan, self.bus = bench, bench.plans[node], bench.master()
        self.cycle = Cycle(self.plan)

    def period(self) -> TripKind | None:
        self.bus.write(self.cycle(self.bus.read(self.bench.clock.now_ns() + PERIOD_NS // 2)))
        return None if self.cycle.trip is None else self.cycle.trip.kind

    def turn(self) -> None:
        """A whole period, in which nothing may trip."""
        assert self.period() is None
        self.bench.clock.sleep_until(self.bench.clock.now_ns() + PERIOD_NS // 2)


class TakingTurns(SimulatedBus):
    """The port of a second master, which gives the first one its turn each time that it waits."""

    def __init__(self, first: Loop) -> None:
        super().__init__(world=first.bench.world)
        self._first = first

    def recv(self, timeout: float | None = None) -> can.Message | None:
        self._first.turn()
        return super().recv(0.0)


@pytest.fixture
def bench() -> Iterator[Bench]:
    subject = Bench()
    yield subject
    subject.close()


FORGED = [name for name in COMMANDS if "boot-up" not in name and "without" not in name]


@pytest.mark.thorough("a run for each frame", quick=1)
@pytest.mark.parametrize("name", FORGED)
def test_a_forged_command_in_contact_takes_the_torque_away(bench: Bench, name: str) -> None:
    bus, cycle = bench.master(), Cycle(bench.plans[1])

    def progress(done: int) -> None:
        if done == CONTACT:
            assert min(bench.torques(1)) < 0, "the wall was being rendered"
            bench.forge(*COMMANDS[name])

    bus.open(bench.plans[1])
    sentence = rf"\({COMMANDS[name][0]:03X}h\), which we did not send.*torque is off"
    with pytest.raises(SafetyTripError, match=sentence):
        run_loop(bench.plans[1], cycle, bus, bench.clock, cycles=1000, progress=progress)
    assert cycle.trip is not None
    assert (cycle.trip.kind, int(cycle.trip.value)) == (TripKind.FOREIGN_MASTER, COMMANDS[name][0])
    assert bench.torques(1)[-1] == 0


def test_a_second_node_that_answers_every_sync_takes_the_torque_away(bench: Bench) -> None:
    loop = Loop(bench, 1)
    loop.bus.open(loop.plan)
    for _ in range(CONTACT):
        loop.turn()
    trips = []
    for _ in range(3):
        # The same octets as ours: another position would trip the speed limit before.
        bench.forge(0x181, next(data for _, can_id, data in reversed(bench.frames) if can_id == 0x181))
        trips.append(loop.period())
        bench.clock.sleep_until(bench.clock.now_ns() + PERIOD_NS // 2)
    assert TripKind.DUPLICATE_NODE in trips
    loop.bus.close()


class TestTwoOfUs:
    def test_the_second_is_refused_and_the_first_goes_on(self, bench: Bench) -> None:
        first = Loop(bench, 1)
        first.bus.open(first.plan)
        second = CanopenBus(TakingTurns(first), bench.clock, owned=True)
        with pytest.raises(ForeignMasterError, match=r"received SYNC \(080h\) .*within 1 s\..*Nothing was sent"):
            second.open(bench.plans[2])
        assert 0x602 not in {can_id for _, can_id, _ in bench.frames}
        assert {data[1] for _, can_id, data in bench.frames if can_id == 0x000} == {1}, (
            "NMT commands of the first alone"
        )
        for _ in range(50):
            first.turn()
        first.bus.close()

    @pytest.mark.parametrize("thought", [0, 1])
    def test_of_two_that_both_heard_nothing_none_goes_on(self, bench: Bench, thought: int) -> None:
        """Both listened in the same second; whoever begins first is heard by the other at the latest in its loop."""
        loops = [Loop(bench, node) for node in (1, 2)]
        images = [bytearray(loop.plan.image.input_size) for loop in loops]
        for loop, image in zip(loops, images, strict=True):
            loop.bus.inspect(loop.plan, image)
        order = loops if thought == 0 else loops[::-1]
        for loop in order:
            loop.bus.configure(loop.plan)
        for loop in order:
            loop.bus.start()
        kinds: set[TripKind | None] = set()
        for _ in range(5):
            for loop in order:
                kinds.add(loop.period())
            bench.clock.sleep_until(bench.clock.now_ns() + PERIOD_NS // 2)
        assert [loop.cycle.trip.kind for loop in loops if loop.cycle.trip] == [TripKind.FOREIGN_MASTER] * 2
        assert set(bench.torques(1)) | set(bench.torques(2)) <= {0}
        for loop in loops:
            loop.bus.close()

    def test_one_that_began_while_the_other_was_asked_is_heard_before_anything_is_written(self, bench: Bench) -> None:
        asked, quick = Loop(bench, 1), Loop(bench, 2)
        asked.bus.inspect(asked.plan, bytearray(asked.plan.image.input_size))
        quick.bus.open(quick.plan)
        for _ in range(50):
            quick.turn()
        with pytest.raises(ForeignMasterError, match="Nothing was written"):
            asked.bus.configure(asked.plan)
        assert quick.period() is None, "it was not disturbed"
        quick.bus.close()


# Real processes, on UDP multicast.

RATE = 20.0
"""[Hz]: slow enough for a busy machine."""
GUARD = 5 / RATE
"""[s]; of the drive, five periods."""
RIG = """
[bus.can]
interface = "udp_multicast"
channel = "{group}"
{more}

[axis.handle]
bus = "can"
node = {node}
profile = "generic_cia402"
rated_torque = 0.4
encoder_counts_per_revolution = 4096
inertia = 4.0e-5
viscous_damping = 1.0e-4
coulomb_friction = 2.0e-3
mechanism = {{ kind = "linear", metres_per_revolution = 0.05 }}
limits = {{ speed = 10.0, acceleration = 1.0e6 }}
"""
ENABLED = 0x27


class Hosted:
    """Two drives in a process of their own, and a third program on their bus that only watches, or forges."""

    def __init__(self, port: int, folder: Path) -> None:
        self.port, self.folder = port, folder
        self.bus = can.Bus(interface="udp_multicast", channel=GROUP, port=port)
        self._running: list[subprocess.Popen[str]] = []

    def run(self, node: int, *words: str, more: str = "") -> "subprocess.Popen[str]":
        """A master of one drive, which goes on for long."""
        rig = self.folder / f"rig_{node}.toml"
        rig.write_text(RIG.format(group=GROUP, node=node, more=more), encoding="utf-8")
        process = start(
            *("run", "wall", "--rig", str(rig), "--rate", f"{RATE:g}", "--set", "wall.stiffness=max/2", "--yes"),
            *("--duration", "600", *words),
            port=self.port,
        )
        self._running.append(process)
        return process

    def wait_for(self, wanted: Callable[[can.Message], bool], seconds: float = STARTS_WITHIN) -> can.Message | None:
        """The first frame that is wanted."""
        clock = _Stopwatch()
        while clock.elapsed < seconds:
            message = self.bus.recv(max(0.0, seconds - clock.elapsed))
            if message is not None and wanted(message):
                return message
        return None

    def send(self, can_id: int, data: bytes) -> None:
        self.bus.send(can.Message(arbitration_id=can_id, data=data, is_extended_id=False))

    def end(self) -> None:
        for process in self._running:
            process.kill()
            process.communicate()
        self.bus.shutdown()


class _Stopwatch:
    def __init__(self) -> None:
        from haptic_fieldbus.clock import MonotonicClock

        self._now_ns = MonotonicClock().now_ns
        self._began_ns = self._now_ns()

    @property
    def elapsed(self) -> float:
        """[s]."""
        return (self._now_ns() - self._began_ns) * 1e-9


@contextmanager
def _hosted(folder: Path) -> Iterator[Hosted]:
    port = free_port()
    require_multicast(port)
    drives = ("--drive", "generic_cia402@1", "--drive", "generic_cia402@2")
    # A hand that leads keeps the limits for as long as another process takes to start.
    process = start("simulate", *drives, "--bus", f"udp_multicast:{GROUP}", "--hand", "guide", port=port)
    hosted = Hosted(port, folder)
    try:
        for _ in range(2):
            line_of(process)
        yield hosted
    finally:
        hosted.end()
        process.kill()
        process.communicate()


def _torque(node: int) -> Callable[[can.Message], bool]:
    """Whether a set-point asks the drive for torque."""
    return lambda message: message.arbitration_id == 0x200 + node and bytes(message.data[2:4]) not in (b"", b"\0\0")


def _let_go(node: int) -> Callable[[can.Message], bool]:
    """Whether the drive says that it missed its master: emergency 8130h."""
    return lambda message: message.arbitration_id == 0x080 + node and message.data[:2] == b"\x30\x81"


@pytest.mark.xdist_group("peers")
@pytest.mark.thorough("real processes in real time")
class TestProcesses:
    def test_a_killed_master_is_missed_though_another_tried_to_join(self, tmp_path: Path) -> None:
        """The other had the same heartbeat and fed the guard of the drive for as long as it lived."""
        with _hosted(tmp_path) as hosted:
            first = hosted.run(1)
            assert hosted.wait_for(_torque(1)) is not None, "the first renders its wall"
            second = hosted.run(2, "--json")
            out, err = second.communicate(timeout=STARTS_WITHIN)
            assert second.returncode == 4, err
            assert "one rig" in err
            assert json.loads(out)["cycles"] is None or json.loads(out)["cycles"] == 0
            assert first.poll() is None, "the first was not disturbed"
            first.send_signal(signal.SIGKILL)
            first.wait()
            clock = _Stopwatch()
            assert hosted.wait_for(_let_go(1), 5.0) is not None
            assert clock.elapsed < GUARD + 0.2

    def test_a_master_that_has_another_heartbeat_feeds_nobody_elses_guard(self, tmp_path: Path) -> None:
        """A foreign heartbeat that is not ours is no proof of our life: the drive watches our node-ID alone."""
        with _hosted(tmp_path) as hosted:
            first = hosted.run(1)
            assert hosted.wait_for(_torque(1)) is not None
            first.send_signal(signal.SIGKILL)
            first.wait()
            clock = _Stopwatch()
            while clock.elapsed < 5.0:
                hosted.send(0x77E, b"\x05")
                if hosted.wait_for(_let_go(1), 0.01) is not None:
                    break
            assert clock.elapsed < GUARD + 0.2

    def test_a_forger_of_our_heartbeat_is_refused_before_and_trips_in_the_loop(self, tmp_path: Path) -> None:
        with _hosted(tmp_path) as hosted:
            running = hosted.run(1)
            assert hosted.wait_for(_torque(1)) is not None
            hosted.send(0x77F, b"\x05")
            _, err = running.communicate(timeout=STARTS_WITHIN)
            assert running.returncode == 3, err
            assert "listened for 1 s without sending; received " in err
            assert "heartbeat of node 127 (77Fh), which we did not send" in err
            late = hosted.run(1)
            while late.poll() is None:
                hosted.send(0x77F, b"\x05")
                hosted.wait_for(lambda message: False, 0.02)
            _, err = late.communicate()
            assert late.returncode == 4, err
            assert "choose another master_node" in err

    def test_two_that_start_in_the_same_second_do_not_both_go_on(self, tmp_path: Path) -> None:
        with _hosted(tmp_path) as hosted:
            both = [hosted.run(node) for node in (1, 2)]
            clock = _Stopwatch()
            while clock.elapsed < STARTS_WITHIN and all(process.poll() is None for process in both):
                hosted.wait_for(lambda message: False, 0.1)
            ended = [process for process in both if process.poll() is not None]
            assert ended
            assert {process.returncode for process in ended} <= {3, 4}
