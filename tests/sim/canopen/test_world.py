"""The world: events in their order, lazily, the same for the same seed; and every fault."""

from dataclasses import replace

import numpy as np
import pytest

from haptic_fieldbus.clock import VirtualClock
from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.protocols.canopen.profile import SimulationSection
from haptic_fieldbus.sim import NEVER_NS, faults
from haptic_fieldbus.sim.bench import TimerQueue
from haptic_fieldbus.sim.canopen.link import INTERMISSION_BITS, Frame, wire_bits
from haptic_fieldbus.sim.canopen.world import World
from haptic_fieldbus.sim.drive_on_bus import DriveOnBus
from haptic_fieldbus.sim.hand import HANDS
from tests.sim.bench import MS, NODE, axis, profile
from tests.sim.master import Master

SYNC = Frame(0x80, b"")


def _master(
    seed: int = 0, hand: str = "push", these: tuple[faults.Fault, ...] = (), nodes: tuple[int, ...] = (NODE,)
) -> Master:
    clock = VirtualClock()
    world = World(clock, seed=seed)
    for node in nodes:
        world.add(DriveOnBus(node, profile(), replace(axis(), node=node), HANDS[hand], these))
    return Master(world, clock)


class TestTime:
    """Mover of the clock, and times of frames."""

    def test_a_receive_without_frame_moves_the_clock_to_its_deadline(self) -> None:
        clock = VirtualClock()
        world = World(clock)
        assert world.receive(world.attach(), 5 * MS) is None
        assert clock.now_ns() == 5 * MS

    def test_a_receive_moves_the_clock_to_the_end_of_the_frame(self) -> None:
        clock = VirtualClock()
        world = World(clock)
        one, other = world.attach(), world.attach()
        world.send(one, SYNC)
        received = world.receive(other, 5 * MS)
        assert received is not None
        assert received.frame == SYNC
        assert received.t_ns == clock.now_ns() == 1000 * wire_bits(SYNC)

    def test_a_frame_that_came_while_time_passed_elsewhere_is_received_with_its_own_time(self) -> None:
        clock = VirtualClock()
        world = World(clock)
        one, other = world.attach(), world.attach()
        world.send(one, SYNC)
        clock.compute(10 * MS)
        received = world.receive(other, 0)
        assert received is not None
        assert received.t_ns == 1000 * wire_bits(SYNC)
        assert clock.now_ns() == 10 * MS

    def test_what_is_queued_at_one_instant_takes_part_in_one_arbitration(self) -> None:
        clock = VirtualClock()
        world = World(clock)
        one, other, ear = world.attach(), world.attach(), world.attach()
        world.send(one, Frame(0x200, b""))
        world.send(other, Frame(0x100, b""))
        received = [world.receive(ear, MS) for _ in range(2)]
        assert [item.frame.can_id for item in received if item is not None] == [0x100, 0x200]

    def test_own_frames_come_back_only_when_asked_for(self) -> None:
        world = World(VirtualClock())
        deaf, own = world.attach(), world.attach(receive_own=True)
        world.send(deaf, SYNC)
        world.send(own, Frame(0x90, b""))
        assert [(item.frame.can_id, item.own) for item in (world.receive(own, MS), world.receive(own, MS)) if item] == [
            (0x80, False),
            (0x90, True),
        ]
        assert [item.frame.can_id for item in deaf.received] == [0x90]

    def test_a_world_begins_when_its_clock_does(self) -> None:
        clock = VirtualClock(start_ns=10**15)
        world = World(clock)
        slave = world.add(DriveOnBus(NODE, profile(), axis(), velocity=1.0))
        clock.compute(MS)
        position, _, _ = world.trajectory(NODE).sample(np.array([10**15 + MS]))
        assert slave.drive.plant.t_ns == 10**15 + MS
        assert position[0] == pytest.approx(1e-3, rel=0.05)

    def test_a_taken_node_is_refused(self) -> None:
        master = _master()
        with pytest.raises(ValueError, match="node 5 is on this bus already"):
            master.world.add(DriveOnBus(NODE, profile(), axis()))

    def test_a_bench_may_be_switched_on_now(self) -> None:
        world = World(VirtualClock())
        ear = world.attach()
        world.add(DriveOnBus(NODE, profile(), axis(), booted=False))
        received = world.receive(ear, MS)
        assert received is not None
        assert (received.frame.can_id, received.frame.data) == (0x705, b"\0")
        assert received.t_ns < 40_000 + 100_000

    def test_a_program_that_leaves_hears_nothing_more(self) -> None:
        world = World(VirtualClock())
        one, other = world.attach(), world.attach()
        world.detach(other)
        world.send(one, SYNC)
        world.receive(one, MS)
        assert not other.received

    def test_nothing_will_happen_in_an_idle_world(self) -> None:
        world = World(VirtualClock())
        one = world.attach()
        assert world.next_ns == NEVER_NS
        world.send(one, SYNC)
        assert world.next_ns < NEVER_NS


class TestRecording:
    """Taps, statistics, trajectories."""

    def test_a_tap_is_told_of_every_data_frame_at_its_end(self) -> None:
        world = World(VirtualClock())
        heard: list[tuple[int, int, bytes]] = []
        world.tap(lambda t_ns, can_id, data: heard.append((t_ns, can_id, data)))
        one = world.attach()
        for frame in (SYNC, Frame(0x90, bytes(2), remote=True), Frame(0x91, b"\1")):
            world.send(one, frame)
        world.receive(one, MS)
        assert [(can_id, data) for _, can_id, data in heard] == [(0x80, b""), (0x91, b"\1")]
        assert heard[0][0] == 1000 * wire_bits(SYNC)

    def test_bus_load_is_bits_over_time(self) -> None:
        clock = VirtualClock()
        world = World(clock, bitrate=500_000)
        one = world.attach()
        world.send(one, SYNC)
        clock.compute(MS)
        world.run()
        statistics = world.statistics(0, MS)
        assert (statistics.frames, statistics.bits) == (1, wire_bits(SYNC) + INTERMISSION_BITS)
        assert statistics.load == pytest.approx(statistics.bits / 500)

    def test_a_drive_can_be_looked_at(self) -> None:
        assert _master().world.slave(NODE).node.number == NODE


def _play(master: Master, periods: int = 60) -> bytes:
    """A spring of 1 N per count or so, and everything that was on the wire meanwhile."""
    heard = bytearray()
    master.world.tap(
        lambda t_ns, can_id, data: heard.extend(t_ns.to_bytes(8, "little") + can_id.to_bytes(2, "little") + data)
    )
    master.enable(NODE)
    for _ in range(periods):
        _, position = master.period(NODE, 0x0F, max(-500, min(500, -20 * master.position)))
        master.position = position
    return bytes(heard)


def test_the_same_seed_gives_the_same_octets_and_another_one_others() -> None:
    first, second, other = (_play(_master(seed)) for seed in (1, 1, 2))
    assert first == second
    assert first != other


def test_torque_makes_the_motion_that_the_closed_form_says() -> None:
    """Without friction and hand: a constant target from a known instant, through the lag, on inertia and damper."""
    clock = VirtualClock()
    world = World(clock)
    world.add(DriveOnBus(NODE, profile(), axis(coulomb_friction=0.0)))
    master = Master(world, clock)
    master.enable(NODE)
    for _ in range(100):
        master.period(NODE, 0x0F, 50)
    trajectory = world.trajectory(NODE)
    times, torques = trajectory.targets()
    start = int(times[np.flatnonzero(torques)[0]])
    inertia, damping, target = 4e-5, 1e-4, 0.02
    lag, pole = 1 / (2 * np.pi * profile().timing.torque_bandwidth), damping / inertia
    moments = np.arange(start, trajectory.end_ns, 37_000)
    t = (moments - start) * 1e-9
    fast = target / inertia / (1 / lag - pole)
    expected = target / damping * (1 - np.exp(-pole * t)) + fast * (np.exp(-t / lag) - np.exp(-pole * t))
    position, velocity, torque = trajectory.sample(moments)
    assert velocity == pytest.approx(expected, rel=1e-8, abs=1e-11)
    assert torque == pytest.approx(target * (1 - np.exp(-t / lag)), rel=1e-9, abs=1e-13)
    assert master.last_position == pytest.approx(position[-1] * 4096 / (2 * np.pi), abs=10)


class TestFaults:
    """Every kind, seen from the wire. Times count from the first operation enabled."""

    def _played(self, fault: faults.Fault, periods: int = 40) -> Master:
        master = _master(these=(fault,))
        master.enable(NODE)
        for _ in range(periods):
            master.period(NODE, 0x0F, 0, optional=True)
        return master

    def test_an_emergency_is_told_and_the_drive_goes_on(self) -> None:
        master = self._played(faults.Emergency("emergency", 0.01, 0x3210))
        (message,) = master.heard(0x85)
        assert message.frame.data.hex() == "1032050000000000"
        assert message.t_ns == pytest.approx(master.enabled_ns + 10 * MS, abs=400_000)
        assert master.statusword & 0x6F == 0x27

    def test_a_drive_fault_ends_in_fault(self) -> None:
        master = self._played(faults.DriveFault("drive_fault", 0.01))
        assert master.heard(0x85)[0].frame.data[:2] == b"\x10\x23"
        assert master.statusword & 0x08

    def test_a_fault_may_be_asked_for_while_the_world_runs_and_counts_from_then(self) -> None:
        master = self._played(faults.MissingTpdos("missing_tpdos", 10.0))
        asked_ns = master.clock.now_ns()
        master.world.let_happen(NODE, faults.DriveFault("drive_fault", 0.005))
        for _ in range(10):
            master.period(NODE, 0x0F, 0)
        assert master.statusword & 0x08
        assert master.heard(0x85)[0].t_ns == pytest.approx(asked_ns + 5 * MS, abs=500_000)

    def test_a_node_reset_ends_in_a_boot_up_message(self) -> None:
        master = self._played(faults.NodeReset("node_reset", 0.01))
        (message,) = master.heard(0x705)
        assert message.frame.data == b"\0"
        assert message.t_ns == pytest.approx(master.enabled_ns + 11 * MS, abs=500_000)

    @pytest.mark.parametrize(("duration", "missing"), [(None, 30), (0.005, 5)])
    def test_a_silent_node_sends_no_pdos(self, duration: float | None, missing: int) -> None:
        master = self._played(faults.Silence("silence", 0.01, duration))
        assert master.missed == pytest.approx(missing, abs=1)

    def test_tpdos_are_missing(self) -> None:
        assert self._played(faults.MissingTpdos("missing_tpdos", 0.01, 3)).missed == 3

    @pytest.mark.parametrize(("count", "heard"), [(5, 30), (None, 10)])
    def test_rpdos_are_lost(self, count: int | None, heard: int) -> None:
        """Ten milliseconds after *operation enabled*: the drive keeps the last target that it heard."""
        master = _master(these=(faults.MissingRpdos("missing_rpdos", 0.01, count),))
        master.enable(NODE)
        for target in range(1, 31):
            master.period(NODE, 0x0F, target)
        master.wait(MS)
        assert master.read(NODE, 0x6071) == pytest.approx(heard, abs=1)

    def test_an_encoder_jumps(self) -> None:
        master = self._played(faults.EncoderJump("encoder_jump", 0.01, 1000))
        assert max(np.diff(master.positions)) == pytest.approx(1000, abs=20)

    def test_a_position_is_stuck_for_a_while(self) -> None:
        master = self._played(faults.PositionStuck("position_stuck", 0.2, 0.01), periods=230)
        assert len(set(master.positions[202:210])) == 1
        assert master.positions[-1] > master.positions[205]

    def test_a_position_is_stuck_for_good(self) -> None:
        master = self._played(faults.PositionStuck("position_stuck", 0.2), periods=230)
        assert len(set(master.positions[202:])) == 1

    def test_only_the_heartbeat_is_lost(self) -> None:
        master = _master(these=(faults.HeartbeatLost("heartbeat_lost", 0.02),))
        master.write(NODE, 0x1017, 0, 5, 2)
        master.enable(NODE)
        for _ in range(60):
            master.period(NODE, 0x0F, 0)
        last = max(item.t_ns for item in master.heard(0x705))
        assert last == pytest.approx(master.enabled_ns + 20 * MS, abs=6 * MS)
        assert master.missed == 0

    def test_bus_off_is_told_and_ends(self) -> None:
        master = self._played(faults.BusOff("bus_off", 0.01, 0.01))
        errors = [item.frame.can_id for item in master.log if item.error]
        assert errors == [0x40, 0x100]
        assert master.missed == pytest.approx(10, abs=1)

    def test_bus_off_may_be_for_good(self) -> None:
        master = self._played(faults.BusOff("bus_off", 0.01))
        assert [item.frame.can_id for item in master.log if item.error] == [0x40]
        assert not master.world.send(master.controller, SYNC)

    def test_a_disturbed_frame_is_told_and_nothing_is_lost(self) -> None:
        master = self._played(faults.ErrorFrame("error_frame", 0.01))
        assert [item.frame.can_id for item in master.log if item.error] == [0x08]
        assert master.missed == 0

    def test_a_missing_node_never_answers(self) -> None:
        master = _master(these=(faults.MissingNode("missing_node"),))
        assert master.read(NODE, 0x1000) is None

    @pytest.mark.parametrize(
        ("fault", "expected"),
        [
            (faults.WrongIdentity("wrong_identity", vendor_id=7), (7, None)),
            (faults.WrongIdentity("wrong_identity", product_code=9), (None, 9)),
        ],
    )
    def test_an_identity_is_wrong_even_after_a_reset(
        self, fault: faults.Fault, expected: tuple[int | None, int | None]
    ) -> None:
        right = (_master().read(NODE, 0x1018, 1), _master().read(NODE, 0x1018, 2))
        master = _master(these=(fault,))
        wanted = tuple(new if new is not None else old for new, old in zip(expected, right, strict=True))
        for _ in range(2):
            assert (master.read(NODE, 0x1018, 1), master.read(NODE, 0x1018, 2)) == wanted
            master.send(0, bytes((129, 0)))
            master.wait(50 * MS)

    def test_a_wrong_identity_needs_the_object_that_it_changes(self) -> None:
        bare = replace(profile(), simulation=SimulationSection(absent=(0x1018,)))
        slot = DriveOnBus(NODE, bare, axis(), None, (faults.WrongIdentity("wrong_identity", product_code=9),))
        world = World(VirtualClock())
        with pytest.raises(UsageError, match=f"wrong_identity: node {NODE} has no 1018h:02, which this fault changes"):
            world.add(slot)
        world.add(replace(slot, faults=()))  # a refused drive takes no node-ID

    def test_a_fault_without_an_end_plans_nothing(self) -> None:
        queue, ended = TimerQueue(), list[int]()
        queue.plan(NEVER_NS, ended.append)
        queue.run(NEVER_NS - 1)
        assert (queue.due_ns, queue._waiting, ended) == (NEVER_NS, [], [])

    def test_an_sdo_access_is_refused(self) -> None:
        master = _master(these=(faults.SdoRefusal("sdo_abort", 0x6060, code=0x0800_0022),))
        with pytest.raises(AssertionError, match="08000022"):
            master.write(NODE, 0x6060, 0, 10, 1)

    def test_a_fault_of_another_node_is_not_ours(self) -> None:
        master = _master(these=(faults.Emergency("emergency", 0.0, 0x3210, node=9),))
        master.enable(NODE)
        master.wait(10 * MS)
        assert master.heard(0x85) == []

    @pytest.mark.parametrize(("factor", "lost"), [(1.0, True), (3.0, False), (None, False)])
    def test_a_dead_or_slow_guard_does_not_miss_us_in_time(self, factor: float | None, lost: bool) -> None:
        master = _master(these=(faults.DeadGuard("dead_guard", factor=factor),))
        master.write(NODE, 0x1016, 1, 0x7F_0014, 4)
        master.send(0x77F, b"\x05")
        master.wait(50 * MS)
        assert bool(master.heard(0x80 + NODE)) is lost


def test_remote_frames_are_answered_by_nobody() -> None:
    master = _master()
    master.world.send(master.controller, Frame(0x185, bytes(8), remote=True))
    master.wait(5 * MS)
    assert master.log == []


def test_several_drives_send_their_pdos_in_the_order_of_their_identifiers() -> None:
    master = _master(nodes=(7, 5, 6))
    for node in (7, 5, 6):
        master.enable(node)
    master.wait(MS)
    master.log.clear()
    master.send(0x80, b"")
    master.wait(2 * MS)
    assert [item.frame.can_id for item in master.log] == [0x185, 0x186, 0x187]
