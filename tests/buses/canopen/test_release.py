"""The way to zero torque on one bus: every drive is freed, by whatever acts, and nothing keeps it from that."""

import errno
from collections.abc import Callable
from itertools import pairwise

import can
import pytest

from haptic_fieldbus.buses.canopen.frames import FrameLog
from haptic_fieldbus.buses.canopen.master import CanopenBus
from haptic_fieldbus.buses.canopen.node import request
from haptic_fieldbus.clock import VirtualClock
from haptic_fieldbus.drive.profile import DataType, ObjectEntry
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.scenes.wall import Wall
from tests.builders import can_traffic, plan_of, scene_of
from tests.buses.canopen.fake_can import FakeCan, FakeDrive, epos4_objects

MS = 1_000_000
ENABLED, DISABLED = 0x27, 0x40
STATES = {1: 0x21, 2: 0x23, 3: ENABLED, 4: ENABLED}
"""Statusword after so many steps of the way to *operation enabled*."""
TWO_AXES = scene_of(Wall("left", stiffness=100.0, name="a"), Wall("right", stiffness=100.0, name="b"))
GUARD = 0x1016, 1
RPDOS, HEARTBEAT = (0x201, 0x202), 0x77F


class TwoDrives:
    """Two drives on one bus, enabled or after some steps on the way, and their master."""

    def __init__(self, rate: float = 1000.0, log: FrameLog | None = None, steps: int = 4) -> None:
        self.plan: Plan = plan_of(TWO_AXES, rate=rate)
        self.clock = VirtualClock()
        self.can = FakeCan(self.clock)
        self.drives = [FakeDrive(self.can, axis.node, epos4_objects(axis.node)) for axis in self.plan.axes]
        self.bus = CanopenBus(self.can, self.clock, log)
        self.bus.open(self.plan)
        for controlword in (0x06, 0x07, 0x0F, 0x0F)[:steps]:
            self.bus.read(self.clock.now_ns() + self.plan.period_ns)
            self.bus.write(bytes((controlword, 0, 100, 0)) * 2)
        assert self.states == [STATES[steps]] * 2
        self.stopped_ns = self.clock.now_ns()
        self._before = len(self.can.sent)

    @property
    def states(self) -> list[int]:
        return [drive.value(0x6041) for drive in self.drives]

    @property
    def took(self) -> float:
        """Time since the stop began [ms]."""
        return (self.clock.now_ns() - self.stopped_ns) / MS

    def sent(self) -> list[tuple[int, int, bytes]]:
        """Frames that the master sent since the stop began."""
        return self.can.sent[self._before :]


def test_set_points_and_downloads_to_all_drives_go_out_before_anything_is_waited_for() -> None:
    bench = TwoDrives()
    bench.bus.release()
    sent = bench.sent()
    assert [can_id for _, can_id, _ in sent] == [0x201, 0x202, 0x601, 0x602]
    assert {data for _, _, data in sent} == {bytes(4), b"\x2b\x40\x60\x00" + bytes(4)}
    assert bench.clock.now_ns() == bench.stopped_ns
    assert bench.states == [DISABLED, DISABLED]


@pytest.mark.parametrize("rate", [1000.0, 250.0, 50.0])
def test_an_ordinary_end_takes_milliseconds_at_any_rate_and_leaves_no_guard(rate: float) -> None:
    bench = TwoDrives(rate)
    assert bench.bus.stop() is True
    assert bench.took < 3.0
    assert [drive.value(*GUARD) for drive in bench.drives] == [0, 0]
    assert [drive.state for drive in bench.drives] == [0x7F, 0x7F]
    assert bench.bus.warnings == []


def _disable_rpdo(drive: FakeDrive) -> None:
    drive.objects[0x1400, 1] = (0x8000_0200 + drive.node).to_bytes(4, "little")


def _pre_operational(drive: FakeDrive) -> None:
    drive.state = 0x7F


def _stopped(drive: FakeDrive) -> None:
    """A node that somebody stopped serves neither PDOs nor SDOs."""
    drive.state = 0x04
    serve = drive._serve
    drive._serve = lambda request: serve(request) if drive.state != 0x04 else None  # type: ignore[method-assign]


@pytest.mark.parametrize("rate", [1000.0, 50.0])
@pytest.mark.parametrize("change", [_disable_rpdo, _pre_operational, _stopped])
def test_a_drive_whose_set_points_do_not_act_is_freed_within_milliseconds_at_any_rate(
    change: Callable[[FakeDrive], None], rate: float
) -> None:
    """69 ms at 1 kHz and 530 ms at 50 Hz, when only RPDOs were sent for twenty periods."""
    bench = TwoDrives(rate)
    change(bench.drives[0])
    bench.bus.release()
    assert bench.states[1] == DISABLED
    while not bench.bus.settle():
        pass
    assert bench.states == [DISABLED, DISABLED]
    assert bench.took < 12.0
    assert bench.bus.leave() is True
    assert [drive.value(*GUARD) for drive in bench.drives] == [0, 0]


@pytest.mark.parametrize("steps", [1, 2, 3])
def test_a_drive_on_its_way_is_not_off_by_its_statusword_of_before(steps: int) -> None:
    """The sample of the period before says *ready to switch on* while the command to go on is already there."""
    bench = TwoDrives(steps=steps)
    for drive in bench.drives:
        _disable_rpdo(drive)
    assert bench.bus.stop() is True
    assert bench.states == [DISABLED, DISABLED]
    downloads = [(can_id, data[:4]) for _, can_id, data in bench.sent() if 0x600 < can_id < 0x680]
    assert downloads[:2] == [(0x601, b"\x2b\x40\x60\x00"), (0x602, b"\x2b\x40\x60\x00")]


@pytest.mark.parametrize("rate", [1000.0, 50.0])
def test_a_drive_that_stays_enabled_keeps_its_guard_and_hears_nothing_of_us_any_more(rate: float) -> None:
    bench = TwoDrives(rate)
    bench.drives[0].power_stays = ENABLED
    assert bench.bus.stop() is False
    assert HEARTBEAT not in {can_id for _, can_id, _ in bench.sent()}, "the proof of life is withheld"
    assert [bool(drive.value(*GUARD)) for drive in bench.drives] == [True, False]
    guard = max(can_traffic(bench.plan).guard(axis.name) for axis in bench.plan.axes)
    assert 1e3 * guard < bench.took < 1e3 * guard + 35.0
    assert bench.bus.warnings == ["node 1 (axis left) did not confirm that its motor is off"]


def test_a_drive_in_a_state_that_nobody_knows_is_not_off() -> None:
    """0067h: the bits of operation enabled, with that of switch on disabled."""
    bench = TwoDrives()
    bench.drives[0].power_stays = 0x67
    assert bench.bus.stop() is False
    assert bench.drives[0].value(*GUARD) != 0
    assert bench.drives[1].value(*GUARD) == 0


def test_a_drive_that_its_guard_has_disabled_is_confirmed() -> None:
    """It obeys nothing, and falls into *fault* when our heartbeat stays away."""
    bench = TwoDrives()
    drive = bench.drives[0]
    drive.power_stays = ENABLED

    def guard() -> None:
        drive.power_stays = 0x08
        drive.objects[0x6041, 0] = b"\x08\x00"

    bench.can.later(50 * MS, guard)
    assert bench.bus.stop() is True
    assert bench.took < 60.0


def test_a_vanished_drive_keeps_no_other_from_being_confirmed_and_disarmed_at_once() -> None:
    bench = TwoDrives()
    bench.drives[0].silent = True
    assert bench.bus.stop() is False
    asked = [t_ns for t_ns, can_id, _ in bench.sent() if can_id == 0x602]
    assert (max(asked) - bench.stopped_ns) / MS < 5.0
    assert (bench.states[1], bench.drives[1].value(*GUARD)) == (DISABLED, 0)


def test_a_silent_drive_is_asked_again_when_15_ms_are_over_and_not_before() -> None:
    """From the request on that follows its way to pre-operational, where it serves requests whatever was done."""
    bench = TwoDrives()
    bench.drives[0].silent = True
    bench.bus.stop()
    _, *asked = [t_ns / MS for t_ns, can_id, _ in bench.sent() if can_id == 0x601]
    apart = [later - earlier for earlier, later in pairwise(asked)]
    assert asked[0] - bench.stopped_ns / MS == pytest.approx(4.0, abs=0.5), "two looks"
    assert len(apart) > 2
    assert 15.0 <= min(apart) <= max(apart) < 20.0


class FullDisk:
    """A log that fails from the moment it is told to."""

    def __init__(self, *, for_ever: bool = True) -> None:
        self.full = False
        self._for_ever = for_ever

    def __call__(self, t_ns: int, can_id: int, data: bytes | bytearray) -> None:
        if self.full:
            self.full = self._for_ever
            raise OSError(errno.ENOSPC, "No space left on device")


def test_a_full_disk_keeps_no_axis_from_being_freed() -> None:
    """The OSError of the first frame's log left the second axis with its torque until its own guard."""
    log = FullDisk()
    bench = TwoDrives(log=log)
    log.full = True
    assert bench.bus.stop() is True
    assert bench.states == [DISABLED, DISABLED]
    assert bench.took < 6.0
    assert [drive.value(*GUARD) for drive in bench.drives] == [0, 0]
    assert any("No space left on device" in sentence for sentence in bench.bus.warnings)


REFUSALS = [
    can.CanOperationError("Failed to transmit", errno.ENOBUFS),
    can.CanOperationError("Failed to transmit: Network is down", errno.ENETDOWN),
    RuntimeError("the driver fell over"),
    OSError(errno.EIO, "Input/output error"),
]


@pytest.mark.parametrize("error", REFUSALS, ids=["queue full", "network down", "driver", "OSError"])
@pytest.mark.parametrize("can_id", [0x000, 0x080, 0x201, 0x202, 0x601, 0x602])
def test_a_frame_that_cannot_be_sent_keeps_no_axis_from_being_freed(can_id: int, error: Exception) -> None:
    bench = TwoDrives()
    bench.can.refuse = lambda message: error if message.arbitration_id == can_id else None
    freed = bench.bus.stop()
    assert bench.states == [DISABLED, DISABLED], "each by the other way"
    assert freed
    assert bench.took < 90.0


@pytest.mark.parametrize("error", REFUSALS, ids=["queue full", "network down", "driver", "OSError"])
def test_a_bus_that_is_gone_is_left_in_bounded_time_without_an_exception(error: Exception) -> None:
    bench = TwoDrives()
    bench.can.broken = error
    assert bench.bus.stop() is False
    assert bench.took < 90.0


def test_a_bus_that_comes_back_meanwhile_still_frees_the_drives() -> None:
    bench = TwoDrives()
    bench.can.broken = can.CanOperationError("Failed to transmit: Network is down", errno.ENETDOWN)
    bench.bus.release()
    for _ in range(5):
        assert bench.bus.settle() is False
    bench.can.broken = None
    while not bench.bus.settle():
        pass
    assert bench.bus.leave() is True
    assert bench.states == [DISABLED, DISABLED]


def test_a_bus_that_was_stopped_can_be_configured_again() -> None:
    bench = TwoDrives()
    assert bench.bus.stop() is True
    bench.bus.configure(bench.plan)
    bench.bus.start()
    for controlword in (0x06, 0x07, 0x0F, 0x0F):
        bench.bus.read(bench.clock.now_ns() + bench.plan.period_ns)
        bench.bus.write(bytes((controlword, 0, 0, 0)) * 2)
    assert bench.states == [ENABLED, ENABLED]
    assert bench.bus.stop() is True


def test_a_stop_that_was_interrupted_begins_anew() -> None:
    bench = TwoDrives()
    interrupted: list[Exception | None] = [None]

    def interrupt(message: can.Message) -> Exception | None:
        if message.arbitration_id == 0x080 and interrupted:
            interrupted.clear()
            raise KeyboardInterrupt
        return None

    bench.can.refuse = interrupt
    with pytest.raises(KeyboardInterrupt):
        bench.bus.stop()
    assert bench.states == [DISABLED, DISABLED], "before anything was waited for"
    assert bench.bus.stop() is True
    assert [drive.value(*GUARD) for drive in bench.drives] == [0, 0]


def test_late_answers_to_what_the_loop_asked_for_are_not_taken_for_confirmations() -> None:
    bench = TwoDrives()
    for drive in bench.drives:
        drive.power_stays = ENABLED
        drive.mute_tpdos = True
    bench.bus.release()
    # Target torque 0 read as 6041h would say "not ready to switch on", which is no energised state.
    bench.can.reply(0x581, b"\x4b\x71\x60\x00" + bytes(4), 0)
    bench.can.reply(0x582, b"\x4b\x41\x60", 0)
    while not bench.bus.settle():
        pass
    assert bench.bus.leave() is False


def test_a_flood_of_foreign_frames_does_not_make_a_stop_longer() -> None:
    bench = TwoDrives()
    bench.drives[0].silent = True

    def again() -> None:
        bench.can.reply(0x3FF, b"", 0)
        bench.can.later(20_000, again)

    again()
    assert bench.bus.stop() is False
    assert bench.took < 90.0


@pytest.mark.parametrize(("kind", "first"), [(DataType.UINT8, 0x2F), (DataType.INT16, 0x2B), (DataType.UINT32, 0x23)])
def test_a_download_is_expedited_with_its_size(kind: DataType, first: int) -> None:
    octets = request(ObjectEntry(0x1016, kind, 1), 5)
    assert octets == bytes((first, 0x16, 0x10, 0x01, 5, 0, 0, 0))


def test_an_upload_request_holds_nothing_but_the_address() -> None:
    assert request(ObjectEntry(0x6041, DataType.UINT16), None) == b"\x40\x41\x60\x00" + bytes(4)


def test_an_answer_without_a_value_does_not_say_that_a_motor_is_off() -> None:
    """An upload may be answered in segments (CiA 301 7.2.4.3.5); a statusword of 0 would be a motor without power."""
    two = TwoDrives()
    drive = two.drives[0]
    drive.in_segments.add((0x6041, 0))
    drive.mute_tpdos, drive.power_stays = True, ENABLED
    assert two.bus.stop() is False
    assert drive.value(*GUARD) != 0
    assert two.drives[1].value(*GUARD) == 0
    assert any("node 1" in told and "did not confirm that its motor is off" in told for told in two.bus.warnings)


def test_what_is_put_back_and_answered_without_a_value_is_told() -> None:
    two = TwoDrives()
    two.drives[0].in_segments.add(GUARD)
    assert two.bus.stop() is True
    assert any("1016h:01" in told for told in two.bus.warnings)
