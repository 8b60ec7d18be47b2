"""The loop: counts, deadlines, and that torque is off before anybody hears of a failure."""

import errno
import gc
import struct
from collections.abc import Callable
from dataclasses import replace

import can
import pytest

from haptic_fieldbus.assessing.loop_report import SAMPLES, LoopReport, Record
from haptic_fieldbus.assessing.summary import notices
from haptic_fieldbus.clock import VirtualClock
from haptic_fieldbus.cycle.cycle import Cycle
from haptic_fieldbus.errors import BusError, BusTimeoutError, DriveFaultError, HapticFieldbusError, SafetyTripError
from haptic_fieldbus.protocols.canopen.bus import CanSection
from haptic_fieldbus.running.loop import Caller
from tests.builders import WALL, plan_of, rig_of
from tests.buses.canopen.benches import HEARTBEAT, NODE, RPDO, TORQUE_FREE, Bench
from tests.whole_loop import run_loop

PERIOD_NS = 1_000_000
MILLISECOND_NS = 1_000_000
FAULT_AT = 100
"""Periods; the handle is in the wall by then."""


def _push(t_ns: int) -> int:
    """Into the wall at 0.5 m/s, and to rest 10 mm deep in it [counts]."""
    return min(2460, t_ns * 41 // MILLISECOND_NS)


def _bench_in_contact() -> Bench:
    bench = Bench().open()
    start_ns = bench.clock.now_ns() + 10 * MILLISECOND_NS
    bench.drive.counts_at = lambda t_ns: _push(max(0, t_ns - start_ns))
    return bench


def _run(bench: Bench, cycles: int = 400, report: LoopReport | None = None) -> LoopReport:
    return run_loop(bench.plan, Cycle(bench.plan), bench.bus, bench.clock, cycles=cycles, report=report)


def _torques(bench: Bench) -> list[int]:
    return [struct.unpack("<Hh", data)[1] for data in bench.can.of(RPDO)]


def test_cycles_count_from_operation_enabled() -> None:
    bench = Bench().open()
    report = _run(bench, cycles=50)
    assert report.cycles == 50
    assert report.first_ns is not None
    assert report.enabled_at_ns == report.first_ns + 3 * PERIOD_NS
    assert report.duration == pytest.approx(50e-3)
    assert report.missed == 0
    assert report.released
    assert not report.interrupted


def test_periods_start_at_absolute_deadlines() -> None:
    bench = Bench().open()
    started_ns = bench.clock.now_ns()
    _run(bench, cycles=20)
    syncs = [t_ns for t_ns, can_id, _ in bench.can.sent if can_id == 0x080]
    assert syncs[:20] == [started_ns + k * PERIOD_NS for k in range(20)]


def test_samples_are_taken_of_every_enabled_period() -> None:
    bench = Bench().open()
    report = _run(bench, cycles=30)
    assert report.sample("period_ns").tolist() == [PERIOD_NS] * 30
    assert set(report.sample("age_ns")) == {52_000.0}
    assert (report.sample("compute_ns") > 0).all()


def test_each_period_is_recorded_and_progress_told() -> None:
    bench = Bench().open()
    cycle = Cycle(bench.plan)
    record = Record(cycle.columns, 1000)
    told: list[int] = []
    run_loop(bench.plan, cycle, bench.bus, bench.clock, cycles=250, record=record, progress=told.append)
    assert told == [100, 200]
    assert len(record) == 253
    assert record.column("handle.statusword")[:4].tolist() == [0x40, 0x21, 0x23, 0x27]


class Sluggish(VirtualClock):
    """Oversleeps once, on its way to a SYNC: the waits for answers are shorter than half a period."""

    def __init__(self, at_ns: int, late_ns: int) -> None:
        super().__init__()
        self._at_ns, self._late_ns = at_ns, late_ns

    def sleep_until(self, deadline_ns: int) -> int:
        if self._late_ns and deadline_ns >= self._at_ns and deadline_ns - self.now_ns() > PERIOD_NS // 2:
            deadline_ns, late_ns, self._late_ns = deadline_ns + self._late_ns, self._late_ns, 0
            super().sleep_until(deadline_ns)
            return late_ns
        return super().sleep_until(deadline_ns)


@pytest.mark.thorough("a run for each delay", quick=1)
@pytest.mark.parametrize(("late_ns", "missed"), [(999_999, 0), (1_000_000, 1), (3_400_000, 3)])
def test_periods_that_were_slept_through_are_counted_and_never_made_up_for(late_ns: int, missed: int) -> None:
    clock = Sluggish(1200 * MILLISECOND_NS, late_ns)
    bench = Bench(clock=clock).open()
    cycle = Cycle(bench.plan)
    record = Record(cycle.columns, 300)
    report = run_loop(bench.plan, cycle, bench.bus, bench.clock, cycles=200, record=record)
    syncs = [t_ns for t_ns, can_id, _ in bench.can.sent if can_id == 0x080]
    first_ns = syncs[0]
    assert report.missed == missed
    assert report.cycles == 200
    assert (syncs[202] - first_ns) % PERIOD_NS == 0, "back on the grid"
    assert len({(t_ns - first_ns) // PERIOD_NS for t_ns in syncs[:200]}) == 200
    assert not record.column("handle.flags").any(), "a late period still waits for its feedback"


def _emergency(bench: Bench) -> None:
    bench.drive.emergency(0x3210)


def _fault(bench: Bench) -> None:
    bench.drive.power_stays = 0x08


def _disable(bench: Bench) -> None:
    bench.drive.power_stays = 0x40


def _restart(bench: Bench) -> None:
    bench.drive.restart()


def _not_operational(bench: Bench) -> None:
    bench.can.reply(HEARTBEAT, b"\x7f", 0)


def _lose_feedback(bench: Bench) -> None:
    bench.drive.mute_tpdos = True


def _lose_heartbeat(bench: Bench) -> None:
    bench.drive._beat = lambda: None  # type: ignore[method-assign]
    bench.can._events = [event for event in bench.can._events if isinstance(event[2], can.Message)]


def _bus_off(bench: Bench) -> None:
    bench.can.later(0, can.Message(arbitration_id=0x40, is_error_frame=True, is_extended_id=False, data=bytes(8)))


def _malform(bench: Bench) -> None:
    bench.drive.tpdo_change = lambda data: data[:-1]


def _jump(bench: Bench) -> None:
    bench.drive.counts_at = lambda t_ns: 2_000_000


TRIPS: dict[str, tuple[Callable[[Bench], None], type[HapticFieldbusError], str]] = {
    "emergency": (
        _emergency,
        DriveFaultError,
        r"Tripped 0\.\d+ s after enabling: .*emergency 3210h \(DC link over-voltage\); torque is off",
    ),
    "fault": (_fault, DriveFaultError, r"changed to fault by itself \(statusword 0008h\)"),
    "disabled": (_disable, DriveFaultError, "changed to switch on disabled by itself"),
    "node reset": (_restart, DriveFaultError, "node 1 restarted"),
    "not operational": (_not_operational, DriveFaultError, "not operational according to its heartbeat"),
    "feedback lost": (_lose_feedback, BusTimeoutError, r"feedback lost: the last from node 1 is 3\d\.\d ms old"),
    "heartbeat lost": (_lose_heartbeat, BusTimeoutError, "heartbeat of node 1 was lost"),
    "bus-off": (_bus_off, BusError, "bus-off; torque is off. Check the cable"),
    "malformed PDO": (_malform, BusError, "malformed PDO"),
    "speed": (_jump, SafetyTripError, r"speed .* m/s, above the limit of 2 m/s"),
}


@pytest.mark.thorough("a run for each of 10 faults", quick=3)
@pytest.mark.parametrize("name", TRIPS)
def test_torque_is_off_on_the_wire_before_the_exception(name: str) -> None:
    change, error, words = TRIPS[name]
    bench = _bench_in_contact()
    fault_ns = bench.clock.now_ns() + FAULT_AT * PERIOD_NS
    bench.can.later(fault_ns - bench.clock.now_ns(), lambda: change(bench))
    report = LoopReport()
    with pytest.raises(error, match=words):
        _run(bench, cycles=1000, report=report)
    before = [
        struct.unpack("<Hh", data)[1] for t_ns, can_id, data in bench.can.sent if can_id == RPDO and t_ns < fault_ns
    ]
    assert before[-1] < 0, "the wall pushed back when the fault came"
    last = [(can_id, data) for _, can_id, data in bench.can.sent if can_id in (RPDO, 0x000)]
    assert last[-1] == (0x000, bytes((0x80, NODE)))
    assert last[-2] == (RPDO, TORQUE_FREE)
    assert last[-3] == (RPDO, TORQUE_FREE)
    assert report.cycles >= FAULT_AT - 10
    assert report.last_ns is not None
    if name != "heartbeat lost":
        assert report.last_ns - fault_ns < (35 if name == "feedback lost" else 5) * PERIOD_NS


def test_the_second_missing_answer_takes_a_tenth_of_the_torque_and_the_eleventh_all() -> None:
    bench = _bench_in_contact()
    bench.can.later(FAULT_AT * PERIOD_NS, lambda: _lose_feedback(bench))
    with pytest.raises(BusTimeoutError):
        _run(bench)
    torques = _torques(bench)
    stop = torques.index(0, 80)
    held = torques[stop - 10]
    assert held < 0
    assert torques[stop - 11] == held
    assert torques[stop - 10 : stop] == pytest.approx([held * (10 - number) / 10 for number in range(10)], abs=0.51)


def test_a_dead_interface_is_the_buses_error_with_a_warning_about_the_motor() -> None:
    bench = _bench_in_contact()

    def unplug() -> None:
        bench.can.broken = can.CanOperationError("Failed to transmit", errno.ENODEV)

    bench.can.later(FAULT_AT * PERIOD_NS, unplug)
    with pytest.raises(BusError, match="down or gone") as caught:
        _run(bench)
    assert any("Switch the power off" in note for note in caught.value.__notes__)


def test_a_trip_that_no_drive_confirms_does_not_say_that_torque_is_off() -> None:
    bench = _bench_in_contact()

    def vanish() -> None:
        bench.drive.silent = True

    bench.can.later(FAULT_AT * PERIOD_NS, vanish)
    with pytest.raises(BusTimeoutError, match="zero torque was commanded, not confirmed") as caught:
        _run(bench)
    assert "torque is off" not in str(caught.value)
    assert any("Switch the power off" in note for note in caught.value.__notes__)


def test_a_drive_that_enables_itself_before_it_is_commanded_gets_no_torque() -> None:
    """As one that comes back by itself after its fault was cleared, or that an input enables."""
    bench = _bench_in_contact()
    bench.drive.power_stays = 0x27
    with pytest.raises(DriveFaultError, match="node 1 changed to operation enabled by itself"):
        _run(bench)
    assert not [data for data in bench.can.of(RPDO) if data[0] == 0x0F or any(data[2:])]


def test_a_drive_that_is_never_enabled_is_told_with_what_to_check() -> None:
    """`before enabling` stood at the end of the advice."""
    bench = Bench().open()
    bench.drive.power_stays = 0x21
    with pytest.raises(BusTimeoutError, match=r"ready to switch on.* no brake or enable input blocks the drive$"):
        _run(bench)


def test_ctrl_c_stops_torque_free_and_is_no_error() -> None:
    bench = _bench_in_contact()

    def interrupt() -> None:
        raise KeyboardInterrupt

    bench.can.later(FAULT_AT * PERIOD_NS, interrupt)
    report = _run(bench)
    assert report.interrupted
    assert report.released
    assert bench.can.of(RPDO)[-1] == TORQUE_FREE
    assert bench.drive.value(0x6041) == 0x40


def test_a_run_of_days_keeps_the_times_of_its_last_minutes_in_16_megabytes() -> None:
    bench = _bench_in_contact()

    def interrupt() -> None:
        raise KeyboardInterrupt

    bench.can.later(FAULT_AT * PERIOD_NS, interrupt)
    samples = _run(bench, cycles=10**9).samples
    assert 480_000 <= samples.capacity <= 16_000_000 / 8 / len(samples.columns), "eight minutes at 1 kHz"


def test_a_mistake_in_the_scene_stops_torque_free_too() -> None:
    bench = _bench_in_contact()
    cycle = Cycle(bench.plan)
    whole, enabled = cycle.step, 0

    def broken(image: bytes | bytearray) -> bytearray:
        nonlocal enabled
        enabled += cycle.enabled
        if enabled == 50:
            raise ZeroDivisionError
        return whole(image)

    cycle.step = broken
    with pytest.raises(ZeroDivisionError):
        run_loop(bench.plan, cycle, bench.bus, bench.clock, cycles=100)
    assert bench.can.of(RPDO)[-1] == TORQUE_FREE
    assert bench.drive.value(0x6041) == 0x40


def test_a_drive_that_does_not_enable_is_named_with_its_state_after_a_while() -> None:
    bench = Bench().open()
    bench.drive.power_stays = 0x40
    start_ns = bench.clock.now_ns()
    with pytest.raises(BusTimeoutError, match=r"within 3 s: axis handle is in the state switch on disabled\. .*STO"):
        _run(bench)
    assert bench.clock.now_ns() - start_ns < 3.1e9


def test_the_limit_of_a_rig_trips() -> None:
    bench = Bench(plan_of(rig=rig_of(WALL))).open()
    bench.drive.counts_at = lambda t_ns: t_ns * 200 // MILLISECOND_NS
    with pytest.raises(SafetyTripError, match=r"speed 2\.44 m/s, above the limit of 2 m/s"):
        _run(bench)


def test_the_garbage_collector_rests_during_the_loop_and_works_again_afterwards() -> None:
    seen: list[bool] = []
    bench = Bench().open()
    bench.can.later(FAULT_AT * PERIOD_NS, lambda: seen.append(gc.isenabled()))
    _run(bench, cycles=200)
    assert seen == [False]
    assert gc.isenabled()


@pytest.mark.thorough("renders the same twice")
def test_two_runs_put_the_same_frames_on_the_wire() -> None:
    logs = []
    for _ in range(2):
        bench = _bench_in_contact()
        _run(bench)
        bench.bus.close()
        logs.append(bench.frames)
    assert logs[0] == logs[1]


@pytest.mark.parametrize("interrupted", [False, True], ids=["ordinary end", "Ctrl-C"])
def test_a_run_whose_end_a_drive_did_not_confirm_is_no_success(interrupted: bool) -> None:
    """It ended with exit status 0 although `released` was False."""
    bench, report = Bench().open(), LoopReport()

    def stay(done: int) -> None:
        bench.drive.power_stays = 0x27
        if interrupted:
            raise KeyboardInterrupt

    with pytest.raises(BusError, match=r"did not confirm.*Switch the power off.*node 1 \(axis handle\)"):
        run_loop(bench.plan, Cycle(bench.plan), bench.bus, bench.clock, cycles=150, report=report, progress=stay)
    assert (report.released, report.interrupted) == (False, interrupted)


def test_no_garbage_is_collected_until_torque_is_off(monkeypatch: pytest.MonkeyPatch) -> None:
    """All that a caller kept was looked through while its last torque was held, for longer than a watchdog waits."""
    bench, collecting = Bench().open(), list[bool]()
    stop = bench.bus.stop

    def watched_stop() -> bool:
        collecting.append(gc.isenabled())
        return stop()

    monkeypatch.setattr(bench.bus, "stop", watched_stop)
    _run(bench, cycles=20)
    assert (collecting, gc.isenabled()) == ([False], True)


def test_a_fault_that_a_drive_tells_after_the_last_period_is_a_warning(monkeypatch: pytest.MonkeyPatch) -> None:
    bench, report = Bench().open(), LoopReport()
    release = bench.bus.release

    def late_release() -> None:
        bench.drive.emergency(0x3210)
        release()

    monkeypatch.setattr(bench.bus, "release", late_release)
    cycle = Cycle(bench.plan)
    run_loop(bench.plan, cycle, bench.bus, bench.clock, cycles=20, report=report)
    (told,) = [each for each in notices(bench.plan, cycle, report) if "3210h" in each]
    assert told == "axis handle: after the last period, node 1 sent emergency 3210h (DC link over-voltage)"


def test_a_caller_that_took_longer_than_a_period_is_told_with_both_times() -> None:
    plan = plan_of(rig=replace(rig_of(WALL), bus={"bus": CanSection("socketcan", "can0")}))
    report = LoopReport()
    assert Caller(longest_ns=PERIOD_NS).slow_on(plan, report) == []
    told = "the block of the session took up to 3.46 ms between two periods of 1 ms"
    assert Caller(longest_ns=3_456_000).slow_on(plan, report) == [told]
    report.samples = Record(SAMPLES, 2)
    for computing_ns in (20_000_000.0, 1_000.0):
        report.samples.push((1e6, 0.0, computing_ns, 0.0))
    told = "computing the force took up to 20 ms between two periods of 1 ms"
    assert Caller().slow_on(plan, report) == [told]
