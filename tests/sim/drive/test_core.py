"""CiA 402-2: what the drive does in its states, modes and emergencies, seen through its frames and its shaft."""

import struct
from dataclasses import replace

import numpy as np
import pytest

from haptic_fieldbus.drive import rig
from haptic_fieldbus.drive.cia402 import MappedObject
from haptic_fieldbus.drive.profile import DataType
from haptic_fieldbus.drive.rig import default_axis
from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.protocols.canopen.profile import CanopenProfile
from haptic_fieldbus.signals import Workspace
from haptic_fieldbus.sim.drive.core import LONGEST_NS
from haptic_fieldbus.sim.drive.settings import DriveSettings, known_mechanics
from haptic_fieldbus.sim.hand import HANDS
from haptic_fieldbus.sim.mechanics.motion import FORCE
from haptic_fieldbus.sim.mechanics.trajectory import Trajectory
from tests.sim.bench import MS, NODE, DriveBench, Refusal, axis, profile

EMERGENCY = 0x85
SHUTDOWN, SWITCH_ON, ENABLE, VOLTAGE_OFF, QUICK_STOP, RESET = 0x06, 0x07, 0x0F, 0x00, 0x02, 0x80
PROFILES = ["generic_cia402", "maxon_epos4"]


def _turning(velocity: float = 60.0, **options: object) -> DriveBench:
    """Enabled while the shaft turns."""
    bench = DriveBench(settings=DriveSettings(velocity=velocity), **options)  # type: ignore[arg-type]
    bench.enable()
    return bench


class TestStatusword:
    """Bits of the states, and bits 4, 9, 11, 12."""

    def test_the_way_to_operation_enabled(self) -> None:
        bench = DriveBench()
        bench.operational()
        seen = [bench.status()]
        for controlword in (SHUTDOWN, SWITCH_ON, ENABLE):
            bench.control(controlword)
            seen.append(bench.status())
        assert seen == [0x0270, 0x0231, 0x0233, 0x1237]

    def test_bit_12_says_that_the_target_is_followed_and_only_in_the_torque_mode(self) -> None:
        bench = DriveBench()
        bench.enable()
        assert bench.status() & 0x1000
        assert bench.write(0x6060, 0, 0, "b") is None
        assert bench.status() == 0x0237

    def test_bit_11_says_that_the_target_is_limited(self) -> None:
        bench = DriveBench(settings=DriveSettings(max_torque_permille=500))
        bench.enable()
        bench.control(ENABLE, 501)
        assert bench.status() & 0x0800
        bench.control(ENABLE, -500)
        assert not bench.status() & 0x0800


class TestTorque:
    """Only in operation enabled and in the torque mode."""

    def _targets(self, bench: DriveBench) -> list[float]:
        bench.run(2 * MS)
        bench.drive.measure(bench.t_ns)
        _, torques = Trajectory(bench.drive.plant.recorder, bench.t_ns).targets()
        return [float(torque) for torque in torques]

    def test_a_target_is_a_share_of_rated_torque(self) -> None:
        bench = DriveBench()
        bench.enable()
        bench.control(ENABLE, 250)
        assert self._targets(bench)[-1] == pytest.approx(0.25 * 0.4)

    def test_it_is_limited_to_the_maximum_torque(self) -> None:
        bench = DriveBench(settings=DriveSettings(max_torque_permille=100))
        bench.enable()
        bench.control(ENABLE, -2000)
        assert self._targets(bench)[-1] == pytest.approx(-0.04)

    @pytest.mark.parametrize("controlword", [SHUTDOWN, SWITCH_ON, VOLTAGE_OFF])
    def test_leaving_operation_enabled_without_a_ramp_zeroes_it_at_once(self, controlword: int) -> None:
        bench = DriveBench()
        assert bench.write(0x605C, 0, 0, "h") is None
        bench.enable()
        bench.control(ENABLE, 250)
        bench.run(5 * MS + 123)
        bench.control(controlword, 250)
        times, torques = Trajectory(bench.drive.plant.recorder, bench.t_ns).targets()
        assert (times[-1], torques[-1]) == (bench.t_ns, 0.0)

    @pytest.mark.parametrize("steps", [[], [SHUTDOWN], [SHUTDOWN, SWITCH_ON]])
    def test_targets_before_operation_enabled_do_nothing(self, steps: list[int]) -> None:
        bench = DriveBench()
        bench.operational()
        for controlword in steps:
            bench.control(controlword, 250)
        assert not any(self._targets(bench))

    def test_without_a_mode_targets_do_nothing(self) -> None:
        bench = DriveBench()
        bench.enable()
        bench.write(0x6060, 0, 0, "b")
        bench.control(ENABLE, 250)
        assert not any(self._targets(bench))

    def test_a_target_may_be_written_by_sdo(self) -> None:
        bench = DriveBench()
        bench.enable()
        assert bench.write(0x6071, 0, 100, "h") is None
        assert self._targets(bench)[-1] == pytest.approx(0.04)

    def test_the_motor_follows_as_a_first_order_lag(self) -> None:
        bench = DriveBench(drive_axis=axis(coulomb_friction=0.0))
        bench.enable()
        bench.sync()
        bench.control(ENABLE, 250)
        bench.run(10 * MS)
        bench.drive.measure(bench.t_ns)
        trajectory = Trajectory(bench.drive.plant.recorder, bench.t_ns)
        times, _ = trajectory.targets()
        lag = 1 / (2 * np.pi * profile().timing.torque_bandwidth)
        moments = np.array([times[-1], times[-1] + 100_000, times[-1] + 5 * MS])
        _, _, torque = trajectory.sample(moments)
        assert torque == pytest.approx(0.1 * (1 - np.exp(-(moments - times[-1]) * 1e-9 / lag)), abs=1e-12)


class TestModes:
    """6060h, 6061h, 6502h."""

    def test_a_drive_with_no_other_modes_has_the_one_of_its_profile(self) -> None:
        bench = DriveBench(settings=DriveSettings(modes=frozenset()))
        assert bench.read(0x6502) == 1 << 9
        assert bench.write(0x6060, 0, 8, "b") == Refusal(0x0609_0030)
        assert bench.write(0x6060, 0, 10, "b") is None
        assert (bench.read(0x6060), bench.read(0x6061)) == (10, 10)

    def test_an_unsupported_mode_in_an_rpdo_is_ignored(self) -> None:
        bench = DriveBench()
        bench.map(2, 255, [0x6040_0010, 0x6060_0008], tpdo=False)
        bench.operational()
        bench.give(0x305, struct.pack("<Hb", SHUTDOWN, 7))
        assert bench.read(0x6061) == 10
        bench.give(0x305, struct.pack("<Hb", SHUTDOWN, 0))
        assert bench.read(0x6061) == 0

    def test_a_manufacturer_specific_mode_has_its_bit_above_the_others_and_works_as_cyclic_torque(self) -> None:
        base = profile()
        torque = replace(base.torque, mode_of_operation=-3)
        bench = DriveBench(replace(base, torque=torque), settings=DriveSettings(modes=frozenset()))
        assert bench.read(0x6502) == 1 << 18
        assert bench.write(0x6060, 0, -3, "b") is None
        for controlword in (SHUTDOWN, ENABLE):
            assert bench.write(0x6040, 0, controlword, "H") is None
        assert bench.write(0x6071, 0, 100, "h") is None
        bench.run(20 * MS)
        assert bench.read(0x6077) == 100

    def test_controlword_mode_and_targets_come_by_pdo_as_well(self) -> None:
        bench = DriveBench()
        bench.map(2, 1, [0x6040_0010, 0x6060_0008, 0x60FF_0020], tpdo=False)
        bench.operational()
        for controlword in (SHUTDOWN, SWITCH_ON, ENABLE):
            bench.give(0x305, struct.pack("<Hbi", controlword, 9, 4096))
            bench.sync()
        for _ in range(100):
            bench.run(MS)
            bench.give(0x305, struct.pack("<Hbi", ENABLE, 9, 4096))
            bench.sync()
        assert bench.read(0x606C) == pytest.approx(4096, abs=3)

    def test_a_torque_limit_by_pdo_acts_on_the_target_that_comes_with_it(self) -> None:
        bench = DriveBench()
        bench.map(2, 255, [0x6071_0010, 0x6072_0010], tpdo=False)
        bench.enable()
        bench.give(0x305, struct.pack("<hH", 500, 120))
        assert bench.read(0x6074) == 120
        bench.give(0x305, struct.pack("<hH", -32768, 65535))
        assert bench.read(0x6074) == 0x10000 - 3000


class TestObjects:
    """Values in the dictionary."""

    @pytest.mark.parametrize("name", PROFILES)
    def test_everything_that_a_profile_names_is_there(self, name: str) -> None:
        subject = profile(name)
        bench = DriveBench(subject)
        for entry in subject.entries().values():
            assert isinstance(bench.read(entry.object, entry.subindex), int)
        for option in (subject.link_loss.abort_connection_option, subject.link_loss.fault_reaction_option):
            assert option is not None
            assert bench.write(option.object, 0, option.value, "h") is None
            assert bench.read(option.object) == option.value

    @pytest.mark.parametrize(("unit", "value"), [("µN·m", 400_000), ("mN·m", 400)])
    def test_rated_torque_is_told_in_the_unit_of_the_profile(self, unit: str, value: int) -> None:
        base = profile()
        rated = MappedObject(0x6076, DataType.UINT32, unit=unit)
        assert DriveBench(replace(base, torque=replace(base.torque, rated=rated))).read(0x6076) == value

    def test_a_rated_torque_below_one_step_of_its_unit_is_refused(self) -> None:
        base = profile()
        rated = MappedObject(0x6076, DataType.UINT32, unit="N·m")
        with pytest.raises(UsageError, match="less than one step of N·m"):
            DriveBench(replace(base, torque=replace(base.torque, rated=rated)))

    def test_a_profile_without_them_has_none_of_the_optional_objects(self) -> None:
        base = profile()
        bare = replace(
            base,
            torque=replace(base.torque, rated=None, actual=None),
            link_loss=replace(base.link_loss, abort_connection_option=None, fault_reaction_option=None),
        )
        bench = DriveBench(bare)
        for index in (0x6076, 0x6077, 0x6007, 0x605E):
            assert bench.read(index) == Refusal(0x0602_0000)
        bench.enable()
        bench.run(MS)
        bench.nmt(2)
        bench.drive.measure(bench.t_ns)
        assert bench.drive.objects.statusword.value & 0x6F == 0x27
        bench.drive.fault(0x2310, bench.t_ns)
        assert bench.drive.objects.statusword.value & 0x4F == 0x0F

    def test_objects_stand_where_the_profile_has_them(self) -> None:
        base = profile()
        moved = MappedObject(0x2030, DataType.INT32, subindex=2, unit="permille_of_rated_torque")
        bench = DriveBench(replace(base, torque=replace(base.torque, target=moved)))
        assert bench.read(0x2030) == 2
        assert bench.write(0x2030, 2, -70_000, "i") is None
        assert bench.read(0x6071) == Refusal(0x0602_0000)

    def test_a_unit_that_cannot_be_simulated_is_refused(self) -> None:
        base = profile()
        turns = MappedObject(0x6071, DataType.INT16, unit="turns")
        with pytest.raises(UsageError, match='"turns" cannot be simulated'):
            DriveBench(replace(base, torque=replace(base.torque, target=turns)))

    @pytest.mark.parametrize(
        ("index", "subindex", "value", "code", "refusal"),
        [
            (0x60C2, 1, 0, "B", 0x0609_0032),
            (0x60C2, 1, 1, "B", None),
            (0x60C2, 2, 1, "b", 0x0609_0031),
            (0x60C2, 2, -4, "b", None),
            (0x605A, 0, 9, "h", 0x0609_0030),
            (0x605E, 0, -1, "h", 0x0609_0030),
            (0x6007, 0, 4, "h", 0x0609_0030),
            (0x6041, 0, 1, "H", 0x0601_0002),
            (0x6064, 0, 1, "i", 0x0601_0002),
            (0x6076, 0, 1, "I", 0x0601_0002),
        ],
    )
    def test_values_are_checked(self, index: int, subindex: int, value: int, code: str, refusal: int | None) -> None:
        expected = None if refusal is None else Refusal(refusal)
        assert DriveBench().write(index, subindex, value, code) == expected

    def test_measured_values_are_live(self) -> None:
        bench = DriveBench(settings=DriveSettings(velocity=2 * np.pi), drive_axis=axis(coulomb_friction=0.0))
        bench.run(500 * MS)
        position, velocity = bench.read(0x6064), bench.read(0x606C)
        assert isinstance(position, int)
        assert isinstance(velocity, int)
        pole = 1e-4 / 4e-5
        assert position == pytest.approx(4096 / pole * (1 - np.exp(-pole * 0.5)), abs=1)
        assert velocity == pytest.approx(4096 * np.exp(-pole * 0.5), abs=1)

    def test_actual_torque_is_told_in_the_unit_of_the_target(self) -> None:
        bench = DriveBench()
        bench.enable()
        bench.control(ENABLE, -123)
        bench.run(20 * MS)
        assert bench.read(0x6077) == 0x10000 - 123

    def test_unknown_values_of_a_rig_are_those_of_the_shipped_bench(self) -> None:
        bench = default_axis(Workspace.LINEAR, bus="", node=1, profile="")
        unknown = replace(bench, inertia=None, viscous_damping=None, rated_torque=None)
        assert known_mechanics(unknown) == (4e-5, 1e-4, 0.4)

    def test_a_shipped_bench_must_know_its_values(self, monkeypatch: pytest.MonkeyPatch) -> None:
        unknown = axis(inertia=None)
        monkeypatch.setattr(rig, "default_axis", lambda *_, **__: unknown)
        with pytest.raises(ValueError, match="unknown values"):
            known_mechanics(unknown)


class TestQuickStop:
    """605Ah: 0 frees the shaft, 1 to 4 brake and switch off, 5 to 8 brake and stay."""

    @pytest.mark.parametrize("option", range(9))
    def test_the_option_code_decides(self, option: int) -> None:
        bench = _turning()
        assert bench.write(0x605A, 0, option, "h") is None
        bench.control(QUICK_STOP)
        assert bench.status() & 0x6F == (0x60 if option == 0 else 0x07)
        bench.run(300 * MS)
        assert bench.status() & 0x6F == (0x07 if option > 4 else 0x60)
        bench.drive.measure(bench.t_ns)
        velocity = bench.drive.plant.velocity
        if option == 0:
            assert velocity > 5.0
        else:
            assert abs(velocity) < 0.3

    def test_operation_goes_on_after_a_stop_that_stays(self) -> None:
        bench = _turning()
        bench.write(0x605A, 0, 6, "h")
        bench.control(QUICK_STOP)
        bench.run(100 * MS)
        bench.control(ENABLE)
        assert bench.status() & 0x6F == 0x27

    def test_a_stop_that_ends_cannot_be_taken_back(self) -> None:
        bench = _turning()
        bench.control(QUICK_STOP)
        bench.control(ENABLE)
        assert bench.status() & 0x6F == 0x07

    def test_voltage_can_be_taken_away_while_braking(self) -> None:
        bench = _turning()
        bench.control(QUICK_STOP)
        bench.run(MS)
        bench.control(VOLTAGE_OFF)
        assert bench.status() & 0x6F == 0x60
        assert bench.drive.plant.state[7] == 0.0

    def test_braking_against_a_pushing_hand_ends_all_the_same(self) -> None:
        bench = DriveBench(hand=HANDS["push"])
        bench.enable()
        bench.run(600 * MS)
        bench.control(QUICK_STOP)
        bench.run(LONGEST_NS + 10 * MS)
        assert bench.status() & 0x6F == 0x60

    def test_brake_torque_is_limited(self) -> None:
        bench = DriveBench(settings=DriveSettings(velocity=2000.0, max_torque_permille=200))
        bench.enable()
        bench.control(QUICK_STOP)
        bench.run(5 * MS)
        assert bench.drive.plant.state[7] == pytest.approx(-0.08)


class TestFault:
    """Transitions 13 to 15, 603Fh, 605Eh, emergencies."""

    def test_a_fault_is_told_and_ends_in_fault_with_a_free_shaft(self) -> None:
        bench = _turning()
        assert bench.write(0x605E, 0, 0, "h") is None
        bench.control(ENABLE, 100)
        bench.run(MS)
        bench.sent.clear()
        bench.drive.fault(0x2310, bench.t_ns)
        assert bench.take(EMERGENCY) == [bytes.fromhex("10 23 03 00 00 00 00 00")]
        assert bench.status() & 0x4F == 0x08
        assert bench.read(0x603F) == 0x2310
        assert bench.drive.plant.state[7] == 0.0

    @pytest.mark.parametrize("option", [1, 2, 3, 4])
    def test_a_ramp_brakes_first(self, option: int) -> None:
        bench = _turning()
        assert bench.write(0x605E, 0, option, "h") is None
        bench.drive.fault(0x2310, bench.t_ns)
        assert bench.status() & 0x4F == 0x0F
        bench.run(300 * MS)
        assert bench.status() & 0x4F == 0x08
        assert abs(bench.drive.plant.velocity) < 0.3

    def test_a_drive_that_was_not_energised_does_not_brake(self) -> None:
        bench = DriveBench(settings=DriveSettings(velocity=60.0))
        bench.drive.fault(0x2310, bench.t_ns)
        assert bench.status() & 0x4F == 0x08

    def test_a_second_fault_is_told_but_the_first_one_stays_in_603fh(self) -> None:
        bench = DriveBench()
        bench.drive.fault(0x2310, 0)
        bench.sent.clear()
        bench.drive.fault(0x3210, 0)
        assert len(bench.take(EMERGENCY)) == 1
        assert bench.read(0x603F) == 0x2310

    def test_a_reset_wants_a_rising_edge_and_tells_that_the_error_is_over(self) -> None:
        bench = DriveBench()
        bench.operational()
        bench.drive.fault(0x2310, 0)
        bench.control(VOLTAGE_OFF)
        assert bench.status() & 0x4F == 0x08
        bench.sent.clear()
        bench.control(RESET)
        assert bench.take(EMERGENCY) == [bytes(8)]
        assert bench.status() & 0x6F == 0x60
        assert (bench.read(0x603F), bench.read(0x1001)) == (0, 0)

    def test_a_reset_does_not_end_an_error_of_communication(self) -> None:
        bench = DriveBench()
        bench.operational()
        bench.give(0x205, b"")
        bench.drive.fault(0x2310, 0)
        bench.sent.clear()
        bench.control(RESET)
        bench.take(EMERGENCY)
        assert bench.read(0x1001) == 0
        bench.give(0x205, b"")
        bench.drive.fault(0x2310, 0)
        assert bench.write(0x6040, 0, 0, "H") is None
        assert bench.write(0x6040, 0, RESET, "H") is None
        assert bench.read(0x1001) == 0x11

    def test_a_reset_without_fault_does_nothing(self) -> None:
        bench = DriveBench()
        bench.enable()
        bench.control(RESET)
        assert bench.status() & 0x6F == 0x27


class TestLinkLoss:
    """The events of 6007h that are not a lost heartbeat."""

    @pytest.mark.parametrize(("action", "status"), [(0, 0x27), (1, 0x08), (2, 0x60)])
    def test_stopping_the_node_is_one(self, action: int, status: int) -> None:
        bench = DriveBench()
        bench.enable()
        bench.write(0x605E, 0, 0, "h")
        bench.write(0x6007, 0, action, "h")
        bench.nmt(2)
        mask = 0x4F if action == 1 else 0x6F
        assert bench.drive.objects.statusword.value & mask == status

    def test_a_node_that_is_switched_off_has_nothing_to_do(self) -> None:
        bench = DriveBench()
        bench.write(0x6007, 0, 2, "h")
        bench.nmt(2)
        assert bench.drive.objects.statusword.value & 0x6F == 0x60


class TestHandsClock:
    """The hand starts with each operation enabled, and rests while the drive is off."""

    def test_each_time_is_told_and_each_end(self) -> None:
        bench = DriveBench()
        told: list[tuple[str, int]] = []
        bench.drive.on_enabled = lambda t_ns: told.append(("enabled", t_ns))
        bench.drive.on_freed = lambda t_ns: told.append(("freed", t_ns))
        bench.run(7 * MS)
        bench.enable()
        bench.run(2 * MS)
        bench.control(VOLTAGE_OFF)
        bench.run(1 * MS)
        bench.control(SHUTDOWN)
        bench.control(ENABLE)
        assert bench.status() & 0x6F == 0x27
        assert told == [("enabled", 7 * MS), ("freed", 9 * MS), ("enabled", 10 * MS)]

    def test_a_quick_stop_that_is_taken_back_starts_nothing_anew(self) -> None:
        bench = DriveBench()
        told: list[int] = []
        assert bench.write(0x605A, 0, 6, "h") is None
        bench.enable()
        bench.drive.on_enabled = bench.drive.on_freed = told.append
        bench.control(QUICK_STOP)
        assert bench.status() & 0x6F == 0x07
        bench.control(ENABLE)
        assert bench.status() & 0x6F == 0x27
        assert told == []

    @pytest.mark.thorough("a run for each hand", quick=2)
    @pytest.mark.parametrize("name", [name for name, hand in HANDS.items() if hand is not None])
    def test_a_hand_rests_while_the_drive_is_off_and_does_the_same_again(self, name: str) -> None:
        """Motion of a hand in 2.5 s is repeated in the next 2.5 s, and nothing moves by itself meanwhile."""
        bench = DriveBench(hand=HANDS[name])
        bench.operational()
        forces = []
        for _ in range(2):
            for controlword in (SHUTDOWN, ENABLE):
                bench.control(controlword)
            start_ns = bench.t_ns
            bench.run(2500 * MS)
            bench.control(VOLTAGE_OFF)
            trajectory = Trajectory(bench.drive.plant.recorder, bench.t_ns)
            forces.append(trajectory.states(start_ns + np.arange(0, 2499, 7) * MS)[:, FORCE])
            bench.run(3000 * MS)
            bench.drive.measure(bench.t_ns)
            place = bench.drive.plant.position
            bench.run(1000 * MS)
            bench.drive.measure(bench.t_ns)
            assert bench.drive.plant.position == place
            assert bench.drive.plant.velocity == 0.0
        assert np.abs(forces[0]).max() > 0.0
        assert forces[1] == pytest.approx(forces[0], abs=1e-12)

    def test_the_hand_pushes_from_then_on(self) -> None:
        bench = DriveBench(hand=HANDS["push"])
        bench.run(300 * MS)
        bench.drive.measure(bench.t_ns)
        assert bench.drive.plant.position == 0.0
        bench.enable()
        bench.run(300 * MS)
        bench.drive.measure(bench.t_ns)
        assert bench.drive.plant.position > 0.0


class TestSilence:
    """A node whose cable is off."""

    def test_nothing_is_sent_or_heard_until_it_is_plugged_in_again(self) -> None:
        bench = DriveBench()
        bench.write(0x1017, 0, 10, "H")
        bench.sent.clear()
        bench.slave.silent_until_ns = 55 * MS
        bench.nmt(1)
        bench.run(54 * MS)
        assert bench.sent == []
        bench.run(10 * MS)
        assert [frame.data for _, frame in bench.sent] == [b"\x7f"]


def _profile_acting_at_sync() -> CanopenProfile:
    base = profile()
    return replace(base, pdo=replace(base.pdo, rpdo_acts="next_sync"))


def test_a_drive_may_hold_even_event_driven_rpdos_until_the_next_sync() -> None:
    bench = DriveBench(_profile_acting_at_sync())
    bench.operational(rpdo_type=255)
    bench.control(SHUTDOWN)
    assert bench.status() & 0x6F == 0x60
    bench.sync()
    assert bench.status() & 0x6F == 0x21


def test_a_drive_without_control_period_is_looked_at_every_millisecond() -> None:
    base = profile()
    bench = DriveBench(replace(base, timing=replace(base.timing, control_period=0.0)))
    assert bench.drive.event_period_ns == MS


def test_a_profile_with_one_entry_a_pdo_maps_nothing_by_default_where_two_are_needed() -> None:
    base = profile()
    bench = DriveBench(replace(base, pdo=replace(base.pdo, entries=1, tpdos=5)))
    assert (bench.read(0x1A00), bench.read(0x1A01)) == (1, 0)
    assert bench.read(0x1804, 1) == 0xC000_0000


def test_the_drive_is_the_node_that_it_was_told_to_be() -> None:
    bench = DriveBench()
    assert bench.node.number == NODE
