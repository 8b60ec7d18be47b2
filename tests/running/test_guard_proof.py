"""Drives left alone at zero torque: the time until they let go, judged by what the wire and the drive saw."""

import re
import signal
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from haptic_fieldbus.api import plan, run
from haptic_fieldbus.errors import BusError, DriveFaultError, PlanError, SafetyTripError, UnprovedGuardError
from haptic_fieldbus.planning.guards import SetGuard
from haptic_fieldbus.protocols.catalogue import load_profile
from haptic_fieldbus.running import proofs
from haptic_fieldbus.sim.canopen.world import World
from haptic_fieldbus.sim.faults import DeadGuard, DriveFault, SdoRefusal
from tests.builders import canopen, shipped
from tests.running.guard_bench import DEAD, EMERGENCY_STOP, MASTER_HEARTBEAT, RPDO, GuardBench, rig_text

MS = 1_000_000
SHIPPED = [name for name in shipped() if load_profile(name).drive.usable]
LIFE_GUARDED = [name for name in SHIPPED if canopen(name).link_loss.life_guarding]
MASTER_NODE = 0x7F


@pytest.fixture
def rig(tmp_path: Path) -> Path:
    path = tmp_path / "rig.toml"
    path.write_text(rig_text(), encoding="utf-8")
    return path


class TestAGuardThatActs:
    @pytest.mark.thorough("a run for each profile and rate", quick=2)
    @pytest.mark.parametrize("rate", [50.0, 250.0, 1000.0])
    @pytest.mark.parametrize("profile", [name for name in SHIPPED if name not in LIFE_GUARDED])
    def test_of_every_shipped_profile_is_proved_by_the_time_that_1016h_holds(
        self, profile: str, rate: float, rig: Path
    ) -> None:
        rig.write_text(rig_text(profile=profile), encoding="utf-8")
        bench = GuardBench(rig, rate=rate).put()
        (proof,) = bench.run().proofs
        # The first that was written arms the watch, the last of all before the loss is what the drive went by.
        watch, period = bench.written(0x1016, 1)[0], bench.plan.period
        (lost_ns,) = bench.losses()
        heard_ns = max(t_ns for t_ns in bench.times(MASTER_HEARTBEAT) if t_ns < lost_ns)
        written_ns = max(t_ns for t_ns in bench.times(RPDO + 1) if t_ns < lost_ns)
        assert watch >> 16 == MASTER_NODE
        assert (lost_ns - heard_ns) / MS == pytest.approx(watch & 0xFFFF, abs=0.3)
        assert proof.holds
        assert proof.off is not None
        # Seen after it happened, at the next look but one at the latest, by somebody who asks for a millisecond.
        assert 0.0 <= proof.off - (lost_ns - written_ns) * 1e-9 + 3e-4 <= 2 * period + 1.5e-3
        assert proof.off <= (watch & 0xFFFF) * 1e-3 + 2 * period + 2e-3
        assert set(bench.torques_of_the_proof()) == {0}

    @pytest.mark.thorough("every drive without 1016h", quick=2)
    @pytest.mark.parametrize("rate", [50.0, 1000.0])
    @pytest.mark.parametrize("name", ["life_guarded.toml", *LIFE_GUARDED])
    def test_is_proved_by_the_life_time_of_a_drive_that_is_guarded_by_requests(
        self, name: str, rate: float, rig: Path
    ) -> None:
        own = Path(__file__).parents[1] / "system" / "profiles" / name
        rig.write_text(rig_text(profile=str(own) if own.is_file() else name), encoding="utf-8")
        bench = GuardBench(rig, rate=rate).put()
        (proof,) = bench.run(0.2).proofs
        life_time = next(filter(None, bench.written(0x100C, 0))) * next(filter(None, bench.written(0x100D, 0))) * MS
        (lost_ns,) = bench.losses()
        # Requests and answers alike have the COB-ID of the node.
        heard_ns = max(t_ns for t_ns in bench.times(0x701) if t_ns < lost_ns)
        assert proof.holds
        assert lost_ns - heard_ns == pytest.approx(life_time, abs=0.5 * MS)

    def test_leaves_a_drive_with_which_the_run_goes_on(self, rig: Path) -> None:
        bench = GuardBench(rig).put()
        result = bench.run(0.2)
        (warning,) = result.warnings
        assert result.cycles == 200
        assert "direction not confirmed by a person" in warning
        assert bench.is_free()

    @pytest.mark.thorough("a run each", quick=1)
    @pytest.mark.parametrize("behaviour", [0, 1, 2])
    def test_is_seen_whether_the_node_stays_in_the_exchange_leaves_it_or_stops(self, behaviour: int, rig: Path) -> None:
        """1029h:01: a node that lost its master goes pre-operational, stays operational, or stops (no SDO then)."""

        def behave(world: World) -> None:
            world.slave(1).drive.dictionary.find(0x1029, 1).value = behaviour

        (proof,) = GuardBench(rig).put(but=behave).run().proofs
        assert proof.holds
        assert proof.off is not None
        assert 0.039 < proof.off < 0.075

    def test_of_a_drive_that_goes_to_fault_is_cleared_and_nothing_else(self, tmp_path: Path, rig: Path) -> None:
        """6007h = 1: the loss of the master is a fault, 8130h."""
        rig.write_text(rig_text(profile=str(_faulting(tmp_path))), encoding="utf-8")
        bench = GuardBench(rig).put()
        result = bench.run(0.1)
        assert (result.cycles, len(bench.losses())) == (100, 1)
        words = [data[4] for _, can_id, data in bench.frames if can_id == 0x601 and data[:4] == b"\x2b\x40\x60\x00"]
        assert words.count(0x80) == 1

    @pytest.mark.thorough("a run with another fault")
    def test_takes_no_other_fault_for_the_loss_of_the_master(self, tmp_path: Path, rig: Path) -> None:
        rig.write_text(rig_text(profile=str(_faulting(tmp_path))), encoding="utf-8")
        bench = GuardBench(rig).put([DriveFault("drive_fault", 0.02, 0x2310)])
        with pytest.raises(DriveFaultError, match=r"2310h \(continuous over-current.*Nothing was cleared"):
            bench.run()
        assert bench.world.slave(1).drive.objects.error_code.value == 0x2310

    @pytest.mark.thorough("a run for each profile", quick=("generic_cia402",))
    @pytest.mark.parametrize("profile", SHIPPED)
    def test_of_every_shipped_profile_is_digested_with_all_that_was_written(self, profile: str, rig: Path) -> None:
        """But for PDOs, limits that are put back, the period, and the controlword: no guard depends on them."""
        rig.write_text(rig_text(profile=profile), encoding="utf-8")
        bench = GuardBench(rig).put()
        bench.run()
        *told, place = bench.plan.guards[0].set_to.written
        assert place.startswith("socketcan:can0")
        stated = [re.fullmatch(r"(\w{4})h:(\w\w) = (-?\d+)", each) for each in told]
        digested = {(int(each[1], 16), int(each[2], 16)): int(each[3]) for each in stated if each}
        assert len(digested) == len(told)
        for (index, subindex), value in digested.items():
            held = bench.world.slave(1).drive.dictionary.find(index, subindex)
            sent = {each & 0xFF for each in bench.written(index, subindex)} or {(held.value if held else 0) & 0xFF}
            assert value & 0xFF in sent
        apart = {*range(0x1400, 0x1C00), 0x1006, 0x6040, 0x6072, 0x6087, 0x60C2, 0x60E0, 0x60E1}
        assert {index for index, _ in bench.downloads()} - {index for index, _ in digested} <= apart

    @pytest.mark.thorough("one more reaction")
    def test_brakes_where_the_rig_says_so(self, rig: Path) -> None:
        rig.write_text(rig_text(more='on_link_loss = "brake"\n'), encoding="utf-8")
        bench = GuardBench(rig).put()
        (proof,) = bench.run().proofs
        assert proof.holds
        assert bench.world.slave(1).drive.dictionary.find(0x605A, 0).value == 2


class TestAGuardThatDoesNot:
    def test_free_the_shaft_is_none_although_the_drive_leaves_operation(self, rig: Path) -> None:
        """A quick stop that never ends holds the shaft with torque (CiA 402-2, 605Ah = 6)."""

        def hold(world: World) -> None:
            drive = world.slave(1).drive
            drive._quick_stop_option = SimpleNamespace(value=6)  # type: ignore[assignment]

        rig.write_text(rig_text(more='on_link_loss = "brake"\n'), encoding="utf-8")
        with pytest.raises(UnprovedGuardError, match="the power stage of the drive stayed on for 2"):
            GuardBench(rig).put(but=hold).run()
        assert 'guard = "none"' in rig.read_text()

    @pytest.mark.thorough("a run each", quick=1)
    @pytest.mark.parametrize(
        ("factor", "seen"),
        [
            (None, "for 201 ms and did not switch off"),
            (10.0, "for 201 ms and did not switch off"),
            (2.0, r"for 98.9 ms \(watchdog"),
            (1.1, r"for 53.9 ms \(watchdog"),
        ],
    )
    def test_ends_the_run_torque_free_and_says_what_was_measured(
        self, factor: float | None, seen: str, rig: Path
    ) -> None:
        bench = GuardBench(rig).put([DeadGuard("dead_guard", factor=factor)])
        with pytest.raises(UnprovedGuardError, match="the power stage of the drive stayed on " + seen) as caught:
            bench.run()
        assert "(watchdog 50 ms, at most" in str(caught.value)
        assert bench.is_free()
        assert set(bench.torques()) == {0}
        assert not hasattr(caught.value, "__notes__"), "the drive confirmed that it is off"

    @pytest.mark.thorough("three runs")
    def test_is_kept_so_that_the_next_plan_is_refused(self, rig: Path) -> None:
        with pytest.raises(UnprovedGuardError, match=r'axis\.handle\.emergency_stop = "power"'):
            GuardBench(rig).put([DEAD]).run()
        with pytest.raises(PlanError, match=r"did not fire in the test on 20.*emergency_stop"):
            GuardBench(rig)
        # Asked for by hand the guard is tried anew, and one that was repaired counts.
        assert GuardBench(rig, prove=True).put().run().proofs[0].holds
        assert GuardBench(rig).put().run().proofs == ()

    def test_caps_torque_where_a_person_can_cut_the_power_and_is_not_tried_again(self, rig: Path) -> None:
        rig.write_text(rig_text(more=EMERGENCY_STOP), encoding="utf-8")
        with pytest.raises(UnprovedGuardError, match="from the next run on torque is limited to 5 % of rated"):
            GuardBench(rig).put([DEAD]).run()
        bench = GuardBench(rig).put([DEAD])
        axis = bench.plan.axes[0]
        assert axis.limits.effort == pytest.approx(0.05 * axis.rated_effort)
        assert bench.run().proofs == ()
        assert "at most 5 % of rated torque" in bench.asked
        assert "about to test the drive watchdog" not in bench.asked

    def test_is_not_kept_and_not_called_kept_after_a_simulated_test(self, rig: Path) -> None:
        rig.write_text(rig_text(more=EMERGENCY_STOP), encoding="utf-8")
        before = rig.read_text(encoding="utf-8")
        soft = {"wall.stiffness": 200.0}
        with pytest.raises(UnprovedGuardError, match="the rig keeps no result of a simulated test"):
            run("wall", rig, bus="sim", settings=soft, prove=True, faults=[DEAD], duration=0.1)
        assert rig.read_text(encoding="utf-8") == before

    def test_frees_both_drives_of_a_rig_and_keeps_the_outcome_of_each(self, rig: Path) -> None:
        rig.write_text(rig_text("left", "right"), encoding="utf-8")
        bench = GuardBench(rig, scene="virtual_shaft").put([DeadGuard("dead_guard", node=2)])
        with pytest.raises(UnprovedGuardError) as caught:
            bench.run()
        assert "axis right: the watchdog" in str(caught.value)
        assert "axis left" not in str(caught.value)
        assert bench.is_free(1)
        assert bench.is_free(2)
        assert [text.split('"')[1] for text in rig.read_text().splitlines() if text.startswith("guard = ")] == [
            "proved",
            "none",
        ]

    @pytest.mark.thorough("two runs")
    def test_of_another_drive_says_nothing_about_this_one(self, rig: Path) -> None:
        GuardBench(rig, seed=1).put().run()
        before = rig.read_text()
        bench = GuardBench(rig, seed=2).put()
        result = bench.run()
        assert result.proofs[0].holds
        assert "the proof in the rig file is for another drive: serial 0x" in bench.asked
        assert rig.read_text() != before
        assert rig.read_text().count("[axis.handle.proved]") == 1


class TestWhileADriveIsLeftAlone:
    def test_somebody_else_who_feeds_its_guard_ends_the_run(self, rig: Path) -> None:
        bench = GuardBench(rig).put()
        bench.when_left_alone(lambda: bench.forge(MASTER_HEARTBEAT, b"\x05"))
        sentence = r"77Fh\), which we did not send.*during the watchdog test. No torque was commanded"
        with pytest.raises(SafetyTripError, match=sentence):
            bench.run()
        assert bench.is_free()
        assert "proved" not in rig.read_text()

    @pytest.mark.thorough("a run each", quick=1)
    @pytest.mark.parametrize("name", ["SIGINT", "SIGTERM"])
    def test_a_signal_frees_it_before_anything_else(self, name: str, rig: Path) -> None:
        bench, number = GuardBench(rig).put(), getattr(signal, name)
        bench.when_left_alone(lambda: signal.raise_signal(number))
        # Tests that run in the background ignore Ctrl-C, and a run leaves that as it is.
        before = signal.signal(number, signal.SIG_DFL)
        try:
            result = bench.run()
        finally:
            signal.signal(number, before)
        assert (result.cycles, result.warnings) == (0, ())
        assert result.stopped is not None
        assert (result.stopped.signal, result.stopped.time) == (name, None)
        assert result.stopped.message.endswith(" before enabling: no torque was applied")
        assert bench.is_free()
        assert bench.losses() == [], "it was freed long before its guard would have done it"
        assert "proved" not in rig.read_text()

    @pytest.mark.parametrize("always", [False, pytest.param(True, marks=pytest.mark.thorough("five proofs"))])
    def test_a_drive_that_something_else_switched_off_has_proved_nothing(self, always: bool, rig: Path) -> None:
        """Safe torque off opens for a moment 12 ms after each set-point that asked for operation enabled, or once."""
        bench = GuardBench(rig).put([DEAD])
        enabled, due = False, list[int]()

        def tapped(t_ns: int, can_id: int, data: bytes) -> None:
            nonlocal enabled
            before, drive = enabled, bench.world.slave(1).drive
            enabled = drive.objects.statusword.value & 0x6F == 0x27
            if enabled and not before and (always or not due):
                due.append(t_ns + 12 * MS)
            elif enabled and due and 0 <= t_ns - due[-1] < MS:
                drive.sto(True, t_ns)
                drive.sto(False, t_ns)

        bench.world.tap(tapped)
        of = r"was off after 1[2-4](\.\d+)? ms in all 5 watchdog tests.*The watchdog is not tested"
        with pytest.raises(UnprovedGuardError, match=of if always else "did not switch off"):
            bench.run()
        assert len(due) == (5 if always else 1)
        assert ('guard = "none"' in rig.read_text()) is not always
        assert bench.is_free()

    @pytest.mark.thorough("five proofs of two drives")
    def test_a_guard_that_failed_is_kept_though_nothing_was_learnt_about_another(self, rig: Path) -> None:
        rig.write_text(rig_text("left", "right"), encoding="utf-8")
        bench = GuardBench(rig, scene="virtual_shaft").put([DeadGuard("dead_guard", node=2)])
        due = list[int]()

        def tapped(t_ns: int, can_id: int, data: bytes) -> None:
            drive = bench.world.slave(1).drive
            enabled = drive.objects.statusword.value & 0x6F == 0x27
            if enabled and (not due or t_ns > due[-1] + 100 * MS):
                due.append(t_ns + 12 * MS)
            elif enabled and due and t_ns >= due[-1]:
                drive.sto(True, t_ns)
                drive.sto(False, t_ns)

        bench.world.tap(tapped)
        with pytest.raises(UnprovedGuardError, match=r"(?s)axis right: the watchdog.*axis left: .*is not tested"):
            bench.run()
        text = rig.read_text()
        assert "[axis.right.proved]" in text
        assert "[axis.left.proved]" not in text
        assert (bench.is_free(1), bench.is_free(2)) == (True, True)

    def test_a_computer_that_was_late_looks_again(self, rig: Path) -> None:
        bench = GuardBench(rig).put()

        def freeze() -> None:
            bench.clock.late_ns, bench.clock.times = 80 * MS, 1

        bench.when_left_alone(freeze)
        (proof,) = bench.run().proofs
        assert proof.holds
        assert len(bench.losses()) == 2

    @pytest.mark.thorough("five proofs")
    def test_a_computer_that_is_late_each_time_is_not_held_against_the_drive(self, rig: Path) -> None:
        bench = GuardBench(rig).put()
        read = bench.bus.read

        def late(deadline_ns: int):  # type: ignore[no-untyped-def]
            if bench.world.slave(1).drive.objects.statusword.value & 0x6F == 0x27:
                bench.clock.compute(80 * MS)
            return read(deadline_ns)

        bench.bus.read = late  # type: ignore[method-assign]
        with pytest.raises(BusError, match="this computer was late in all 5 watchdog tests"):
            bench.run()
        assert "proved" not in rig.read_text()


@pytest.mark.thorough("several runs each")
class TestWithoutAPlaceForAProof:
    def test_a_drive_without_a_serial_number_is_proved_at_every_start(self, rig: Path) -> None:
        before = rig.read_text()
        for _ in range(2):
            bench = GuardBench(rig).put([SdoRefusal("sdo_abort", 0x1018, 4, 0x0609_0011)])
            assert bench.run().proofs[0].holds
        assert rig.read_text() == before

    def test_a_drive_without_a_serial_number_that_failed_is_capped_all_the_same(self, rig: Path) -> None:
        with pytest.raises(UnprovedGuardError):
            GuardBench(rig).put([SdoRefusal("sdo_abort", 0x1018, 4, 0x0609_0011), DEAD]).run()
        assert "serial" not in rig.read_text()
        with pytest.raises(PlanError, match="did not fire"):
            GuardBench(rig)

    @pytest.mark.parametrize("rate", [50.0, 1000.0])
    def test_a_proof_of_another_guard_does_not_count(self, rate: float, rig: Path) -> None:
        GuardBench(rig, rate=250.0).put().run()
        bench = GuardBench(rig, rate=rate).put()
        assert bool(bench.run().proofs) is (rate == 50.0), "at 50 Hz the guard is 100 ms, else 50 ms"


@pytest.mark.thorough("several runs each")
class TestInASimulation:
    def test_a_guard_is_proved_when_asked_for_and_never_kept(self, rig: Path) -> None:
        before = rig.read_text()
        assert run("wall", rig=rig, bus="sim", duration=0.05).proofs == ()
        proved = run("wall", rig=rig, bus="sim", duration=0.05, prove=True)
        assert [proof.holds for proof in proved.proofs] == [True]
        assert rig.read_text() == before

    def test_the_hand_waits_until_the_guard_is_proved(self) -> None:
        """So the run feels the same: the same force error as without, but for the encoder's place within a count."""
        plain, proved = (run("wall", duration=1.5, prove=asked) for asked in (False, True))
        assert plain.torque_error is not None
        assert proved.torque_error is not None
        assert proved.torque_error.max < 2.0 * plain.torque_error.max
        assert proved.trips == ()

    def test_two_buses_are_proved_together(self, tmp_path: Path) -> None:
        text = rig_text("left", "right").replace('bus = "can"\nnode = 2', 'bus = "other"\nnode = 2')
        path = tmp_path / "rig.toml"
        path.write_text('[bus.other]\ninterface = "socketcan"\nchannel = "can1"\n' + text, encoding="utf-8")
        result = run("virtual_shaft", rig=path, bus="sim", duration=0.05, prove=True)
        assert [(proof.axis, proof.holds) for proof in result.proofs] == [("left", True), ("right", True)]
        with pytest.raises(UnprovedGuardError, match=r"^axis right"):
            run("virtual_shaft", rig=path, bus="sim", duration=0.05, prove=True, faults=[replace(DEAD, node=2)])


class TestAProfileWithoutAGuard:
    @pytest.fixture
    def rig(self, tmp_path: Path) -> Path:
        text = (Path(load_profile("generic_cia402").source)).read_text(encoding="utf-8")
        own = tmp_path / "unguarded.toml"
        own.write_text("".join(line for line in text.splitlines(True) if "heartbeat_consumer" not in line))
        path = tmp_path / "rig.toml"
        path.write_text(rig_text(profile=str(own)), encoding="utf-8")
        return path

    @pytest.mark.parametrize("bus", [None, "sim"])
    def test_is_refused_without_an_emergency_stop_on_any_bus(self, bus: str | None, rig: Path) -> None:
        with pytest.raises(PlanError, match=r'has no watchdog that.*axis\.handle\.emergency_stop = "power"'):
            plan("wall", rig=rig, bus=bus)

    def test_gives_little_torque_with_one_and_its_watch_is_not_written(self, rig: Path) -> None:
        rig.write_text(rig.read_text() + EMERGENCY_STOP, encoding="utf-8")
        bench = GuardBench(rig).put()
        assert bench.run().proofs == ()
        assert bench.written(0x1016, 1) == []
        assert "the motor keeps its torque until its power is cut" in bench.asked
        axis = bench.plan.axes[0]
        assert axis.limits.effort == pytest.approx(0.05 * axis.rated_effort)
        ends = {each.cause.value: each.seconds for each in bench.plan.deadlines}
        assert ends["master killed"] == float("inf")
        assert ends["own limit or trip"] < 0.01


def _faulting(folder: Path) -> Path:
    """A profile whose drive takes the loss of its master for a fault."""
    text = Path(load_profile("generic_cia402").source).read_text(encoding="utf-8")
    path = folder / "faulting.toml"
    path.write_text(text.replace("object = 0x6007, value = 2", "object = 0x6007, value = 1"), encoding="utf-8")
    return path


class Asked:
    """A clock, and a bus whose drive answers 3 ms after a question that its state was asked with."""

    def __init__(self) -> None:
        self.time_ns = 0

    def now_ns(self) -> int:
        return self.time_ns

    def ask(self, axis: str) -> int:
        self.time_ns += 3_000_000
        return 0x0237  # operation enabled


@pytest.mark.parametrize(("questions", "lasted"), [(1, 0.003), (6, 0.018), (12, 0.02)])
def test_the_time_of_questions_counts_for_the_drive_up_to_20_ms(questions: int, lasted: float) -> None:
    guard = SetGuard(seconds=0.1, late=0.002, period=0.001)
    axis: Any = SimpleNamespace(name="handle", power=plan("wall").axes[0].power)
    looked, asked = proofs._TestedDrive(axis, plan("wall").image.axes[0], guard), Asked()
    for _ in range(questions):
        looked.ask(asked, asked)  # type: ignore[arg-type]
    proof = looked.proof(0)
    assert proof.allowed - guard.allowed == pytest.approx(lasted)
    assert proof.between - guard.between == pytest.approx(lasted)
