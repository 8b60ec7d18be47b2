"""Effects of each kind of fault of bus, drive, host and hand, seen from the wire and at the shaft.

Kinds that are older are tried in `tests.sim.canopen.test_world`.
"""

from dataclasses import replace

import can
import numpy as np
import pytest

from haptic_fieldbus.clock import VirtualClock
from haptic_fieldbus.sim import faults
from haptic_fieldbus.sim.canopen.bus import SimulatedBus
from haptic_fieldbus.sim.canopen.link import Frame
from haptic_fieldbus.sim.canopen.world import World
from haptic_fieldbus.sim.drive_on_bus import DriveOnBus
from haptic_fieldbus.sim.hand import HANDS, Hand, hand_named
from haptic_fieldbus.sim.simulation import HostClock, truth_of
from tests.sim.bench import MS, NODE, axis, profile
from tests.sim.master import Master

AT = 0.01
"""[s] after operation enabled, at which each fault happens."""
PERIODS = 40


def _master(*these: faults.Fault, hand: str = "none") -> Master:
    clock = VirtualClock()
    world = World(clock)
    world.add(DriveOnBus(NODE, profile(), replace(axis(), node=NODE), HANDS[hand], these))
    return Master(world, clock)


def _played(*these: faults.Fault, periods: int = PERIODS, target: int = 0, hand: str = "none") -> Master:
    master = _master(*these, hand=hand)
    master.enable(NODE)
    for _ in range(periods):
        master.period(NODE, 0x0F, target, optional=True)
    return master


def _torques(master: Master) -> np.ndarray:
    """Torque of the motor [‰ of rated] at the middle of each of the last periods."""
    times = master.clock.now_ns() - MS // 2 - MS * np.arange(PERIODS - 1, -1, -1)
    torque = master.world.trajectory(NODE).sample(times)[2]
    return np.round(torque / master.world.slave(NODE).drive.stage.permille)


class TestFrames:
    """Frames that arrive of one that was sent."""

    def test_dropped_tpdos_are_missing(self) -> None:
        assert _played(faults.FrameDropped("frame_dropped", AT, "tpdo", 3)).missed == 3

    @pytest.mark.parametrize(("node", "missed"), [(None, 3), (NODE, 3), (NODE + 1, 0)])
    def test_only_frames_of_the_node_are_concerned(self, node: int | None, missed: int) -> None:
        assert _played(faults.FrameDropped("frame_dropped", AT, "tpdo", 3, node=node)).missed == missed

    def test_dropped_syncs_are_answered_by_nobody(self) -> None:
        assert _played(faults.FrameDropped("frame_dropped", AT, "sync", 3)).missed == 3

    def test_dropped_rpdos_leave_the_last_target(self) -> None:
        master = _master(faults.FrameDropped("frame_dropped", AT, "rpdo", 1000))
        master.enable(NODE)
        for target in range(30):
            master.period(NODE, 0x0F, target)
        assert master.read(NODE, 0x6071) == pytest.approx(10, abs=1)

    def test_a_delayed_tpdo_comes_later_and_counts_as_missing(self) -> None:
        master = _played(faults.FrameDelayed("frame_delayed", AT, 0.0007, "tpdo", 1))
        gaps = np.diff([item.t_ns for item in master.heard(0x180 + NODE)])
        assert master.missed == 1
        assert gaps.max() == pytest.approx(1.7 * MS, abs=0.05 * MS)

    def test_a_duplicated_tpdo_comes_twice(self) -> None:
        healthy, master = _played(), _played(faults.FrameDuplicated("frame_duplicated", AT, "tpdo", 5))
        assert len(master.heard(0x180 + NODE)) == len(healthy.heard(0x180 + NODE)) + 5

    @pytest.mark.parametrize("length", [0, 3, 8])
    def test_a_tpdo_of_another_length_keeps_the_octets_that_fit(self, length: int) -> None:
        master = _master(faults.FrameWrongLength("frame_wrong_length", AT, length, "tpdo", 1))
        sent: list[bytes] = []
        master.world.tap(lambda t_ns, can_id, data: sent.append(data) if can_id == 0x180 + NODE else None)
        master.enable(NODE)
        for _ in range(PERIODS):
            master.send(0x80, b"")
            master.wait(MS)
        came = [item.frame.data for item in master.heard(0x180 + NODE)]
        assert {len(data) for data in sent} == {6}, "on the wire they are as they were sent"
        wrong = [(was, data) for was, data in zip(sent, came, strict=True) if was != data]
        assert [data for _, data in wrong] == [was[:length].ljust(length, b"\0") for was, _ in wrong]
        assert len(wrong) == 1

    def test_a_short_rpdo_is_an_emergency_of_the_drive(self) -> None:
        master = _played(faults.FrameWrongLength("frame_wrong_length", AT, 1, "rpdo", 1))
        assert master.heard(0x080 + NODE)[0].frame.data[:2] == b"\x10\x82"

    def test_a_tpdo_of_another_node_keeps_its_service(self) -> None:
        master = _played(faults.FrameWrongNode("frame_wrong_node", AT, 77, "tpdo", 2))
        assert len(master.heard(0x180 + 77)) == 2
        assert master.missed == 2

    def test_foreign_frames_come_as_often_as_they_should(self) -> None:
        master = _played(faults.ForeignFrame("foreign_frame", AT, 0x123, (1, 2, 3), 4, 0.002))
        heard = master.heard(0x123)
        assert [item.frame.data for item in heard] == [b"\1\2\3"] * 4
        assert np.diff([item.t_ns for item in heard]) == pytest.approx(2 * MS, abs=0.3 * MS)

    def test_a_foreign_set_point_acts_on_the_drive(self) -> None:
        foreign = faults.ForeignFrame("foreign_frame", AT, 0x200 + NODE, (0x0F, 0, 100, 0), 1)
        master = _played(foreign)
        permille = master.world.slave(NODE).drive.stage.permille
        assert {0, 100} == set(np.round(master.world.trajectory(NODE).targets()[1] / permille))

    def test_an_interface_that_is_down_refuses_and_comes_back(self) -> None:
        master = _master(faults.InterfaceDown("interface_down", AT, 0.005))
        with SimulatedBus(world=master.world) as bus:
            master.enable(NODE)
            master.clock.sleep_until(master.enabled_ns + 12 * MS)
            master.world.run()
            with pytest.raises(can.CanOperationError, match="Network is down"):
                bus.send(can.Message(arbitration_id=0x80, is_extended_id=False))
            with pytest.raises(can.CanOperationError, match="Network is down"):
                bus.recv(0.0)
            master.clock.sleep_until(master.enabled_ns + 20 * MS)
            master.world.run()
            bus.send(can.Message(arbitration_id=0x80, is_extended_id=False))
            answer = bus.recv(0.01)
            assert answer is not None
            assert answer.arbitration_id == 0x180 + NODE


class TestDrive:
    """Encoder, current loop, and what the node ignores."""

    def test_safe_torque_off_ends_torque_and_the_drive_stays_off(self) -> None:
        master = _played(faults.SafeTorqueOff("safe_torque_off", AT, 0.005), target=50)
        assert master.statusword & 0x4F == 0x40
        assert _torques(master)[-1] == 0

    @pytest.mark.parametrize(("count", "missed"), [(4, 4), (None, 30)])
    def test_ignored_syncs_are_not_answered(self, count: int | None, missed: int) -> None:
        assert _played(faults.SyncIgnored("sync_ignored", AT, count)).missed == pytest.approx(missed, abs=1)

    def test_a_second_node_answers_whatever_is_asked(self) -> None:
        healthy, master = _played(), _played(faults.DuplicateNode("duplicate_node", AT))
        twice = len(master.heard(0x180 + NODE)) - len(healthy.heard(0x180 + NODE))
        assert twice == pytest.approx(PERIODS - 10, abs=1)

    @pytest.mark.parametrize("factor", [-1.0, 3.0, 0.5])
    def test_an_encoder_counts_otherwise_from_here_on(self, factor: float) -> None:
        """The shaft moves as in a healthy run, since nobody acts on the counts."""
        fault: faults.Fault = faults.EncoderScaling("encoder_scaling", AT, factor)
        if factor == -1.0:
            fault = faults.EncoderReversed("encoder_reversed", AT)
        right = np.array(_played(target=40).positions)
        wrong = np.array(_played(fault, target=40).positions)
        begin = 10
        assert wrong[:begin] == pytest.approx(right[:begin])
        assert wrong[-1] - right[begin] == pytest.approx(factor * (right[-1] - right[begin]), abs=4 + abs(factor) * 4)

    def test_an_encoder_that_counts_otherwise_shows_another_velocity(self) -> None:
        master = _played(faults.EncoderReversed("encoder_reversed", AT), target=40)
        drive = master.world.slave(NODE).drive
        drive.measure(master.clock.now_ns())
        assert drive.plant.velocity > 0.0
        assert drive.dictionary.find(0x606C, 0).value < 0

    def test_a_dead_current_loop_makes_no_torque_and_shows_none(self) -> None:
        master = _played(faults.TorqueDead("torque_dead", AT), target=100)
        torques = _torques(master)
        assert torques[5] == 100
        assert torques[-1] == 0
        assert master.read(NODE, 0x6077) == 0

    def test_a_saturated_current_loop_reaches_its_share(self) -> None:
        master = _played(faults.TorqueSaturated("torque_saturated", AT, 0.03), target=100)
        assert _torques(master)[-1] == 30
        assert master.read(NODE, 0x6077) == 30

    def test_a_second_fault_of_a_motor_mends_nothing_of_the_first(self) -> None:
        weak, whole = (faults.TorqueSaturated("torque_saturated", 2 * AT, share) for share in (0.03, 1.0))
        dead = faults.TorqueDead("torque_dead", AT)
        reversed_ = faults.TorqueReversed("torque_reversed", AT)
        assert _torques(_played(dead, whole, target=100))[-1] == 0
        assert _torques(_played(reversed_, weak, target=100))[-1] == -30

    def test_a_motor_that_turns_the_other_way_shows_the_current_that_was_commanded(self) -> None:
        master = _played(faults.TorqueReversed("torque_reversed", AT), target=100)
        assert _torques(master)[-1] == -100
        assert master.read(NODE, 0x6077) == 100


class TestHost:
    """A clock over the true time of the worlds."""

    def test_without_a_fault_it_is_the_true_time(self) -> None:
        clock = HostClock(VirtualClock())
        assert clock.sleep_until(5) == 0
        clock.compute(7)
        assert clock.now_ns() == truth_of(clock).now_ns() == 12
        assert truth_of(VirtualClock(3)).now_ns() == 3

    def test_a_late_host_oversleeps_a_few_times(self) -> None:
        clock = HostClock(VirtualClock())
        clock.happen(faults.HostLate("host_late", 0.0, 2e-6, 2))
        assert [clock.sleep_until(deadline_ns) for deadline_ns in (10_000, 20_000, 30_000)] == [2000, 2000, 0]
        assert clock.now_ns() == 30_000

    def test_a_paused_host_does_nothing_once(self) -> None:
        clock = HostClock(VirtualClock())
        clock.happen(faults.HostPaused("host_paused", 0.0, 0.5))
        assert clock.sleep_until(1000) == 500_000_000
        assert clock.sleep_until(1000) == 500_000_000, "still late, and not later"

    def test_a_clock_that_steps_leaves_the_true_time_alone(self) -> None:
        clock = HostClock(VirtualClock())
        clock.happen(faults.ClockStep("clock_step", 0.0, -1e-6))
        assert clock.now_ns() == -1000
        clock.sleep_until(0)
        assert truth_of(clock).now_ns() == 1000

    def test_a_slow_host_needs_longer_a_few_times(self) -> None:
        clock = HostClock(VirtualClock())
        fault = faults.SlowCompute("slow_compute", 0.0, 1e-6, 1)
        clock.happen(fault)
        clock.happen(fault)  # told by a second bus: it is one fault
        clock.compute(10)
        clock.compute(10)
        assert clock.now_ns() == 1020

    def test_a_world_without_such_a_clock_refuses(self) -> None:
        with pytest.raises(ValueError, match="host_paused"):
            _played(faults.HostPaused("host_paused", AT, 0.1))


class TestHand:
    """The force of the hand, piece by piece."""

    def force(self, hand: Hand, time: float) -> float:
        return hand._at(time).force

    @pytest.mark.parametrize("name", ["push", "tap", "sine", "guide", "release"])
    def test_a_blow_is_added_for_its_time(self, name: str) -> None:
        healthy = hand_named(name)
        assert healthy is not None
        struck = healthy.hitting(0.52, 100.0, 0.02)
        for time in np.arange(0.0, 2.0, 0.0037):
            extra = 100.0 if 0.52 <= time < 0.54 else 0.0
            expected = self.force(healthy, time) + extra
            assert self.force(struck, time) == pytest.approx(expected, abs=1e-6 + 0.01 * extra)

    def test_a_hand_lets_go_at_the_earlier_time(self) -> None:
        push, release = hand_named("push"), hand_named("release")
        assert push is not None
        assert release is not None
        assert push.letting_go(0.7).release == 0.7
        assert release.letting_go(3.0).release == 2.0

    def test_a_hand_that_lets_go_leaves_the_handle_alone(self) -> None:
        held, free = (
            _played(*these, periods=300, hand="push").positions[-1]
            for these in ((), (faults.HandRelease("hand_release", AT),))
        )
        assert abs(free) < 0.2 * abs(held)

    def test_a_hand_that_is_not_there_does_neither(self) -> None:
        master = _played(faults.HandHit("hand_hit", AT), faults.HandRelease("hand_release", AT))
        assert len(set(master.positions)) == 1


def test_all_kinds_are_tried_here_or_with_the_world() -> None:
    tried = {
        "frame_dropped", "frame_delayed", "frame_duplicated", "frame_wrong_length", "frame_wrong_node", "foreign_frame",
        "interface_down", "safe_torque_off", "sync_ignored", "duplicate_node", "encoder_scaling", "encoder_reversed",
        "torque_dead", "torque_saturated", "torque_reversed", "host_late", "host_paused", "clock_step", "slow_compute",
        "hand_release", "hand_hit",
        # In test_world:
        "emergency", "drive_fault", "node_reset", "silence", "missing_tpdos", "missing_rpdos", "heartbeat_lost",
        "encoder_jump", "position_stuck", "bus_off", "error_frame", "missing_node", "wrong_identity", "sdo_abort",
        "dead_guard",
        # In tests/sim/modbus/test_line_faults.py:
        "answer_lost", "answer_delayed", "answer_swapped", "answer_garbage", "answer_corrupted", "answer_truncated",
        "answer_wrong_unit", "answer_exception", "connection_reset", "foreign_set_points",
    }  # fmt: skip
    assert {kind.__annotations__["kind"].__args__[0] for kind in faults.Fault.__args__} == tried


def test_disturbed_frames_are_on_the_wire_as_they_were_sent() -> None:
    master = _master(faults.FrameDropped("frame_dropped", AT, "tpdo", 1000))
    master.enable(NODE)
    seen: list[Frame] = []
    master.world.watch(lambda t_ns, frame, sender: seen.append(frame))
    for _ in range(PERIODS):
        master.period(NODE, 0x0F, 0, optional=True)
    assert sum(frame.can_id == 0x180 + NODE for frame in seen) >= PERIODS - 1
    assert master.missed > PERIODS // 2


def test_a_run_without_faults_builds_no_schema_of_their_file(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("haptic_fieldbus.sim.faults.Document", None)
    assert faults.checked_faults(()) == ()
    with pytest.raises(TypeError, match="not callable"):
        faults.checked_faults([faults.SafeTorqueOff("safe_torque_off", at=0.1)])
