"""The master in the loop: exchanges, flags, stopping, closing."""

import errno
import struct

import can
import pytest

from haptic_fieldbus.buses.canopen.master import SYNC_BITS
from haptic_fieldbus.buses.canopen.setup import STATUSWORD
from haptic_fieldbus.buses.canopen.wire import MOST_WAITING
from haptic_fieldbus.errors import BusError
from haptic_fieldbus.planning.image import AXIS_HEADER, HEADER, LARGEST_AGE_NS
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.signals import LinkFlag
from tests.builders import can_traffic, plan_of, scene_of
from tests.buses.canopen.benches import HEARTBEAT, NODE, RPDO, TORQUE_FREE, TPDO, Bench
from tests.buses.canopen.fake_can import DELAY_NS

PERIOD_NS = 1_000_000
DISABLE_BY_SDO = b"\x2b\x40\x60\x00" + bytes(4)
"""Expedited download of 0 to 6040h."""
TWO_AXES = scene_of(Wall("left", stiffness=100.0, name="a"), Wall("right", stiffness=100.0, name="b"))


def _read(bench: Bench) -> bytearray:
    return bench.bus.read(bench.clock.now_ns() + PERIOD_NS)


def _header(bench: Bench, image: bytearray, axis: int = 0) -> tuple[int, LinkFlag, int]:
    age_ns, flags, code = AXIS_HEADER.unpack_from(image, bench.plan.image.axes[axis].header)
    return age_ns, LinkFlag(flags), code


def _payload(bench: Bench, image: bytearray, axis: int = 0) -> tuple[int, int]:
    offset, _ = bench.plan.image.axes[axis].inputs
    statusword, counts = struct.unpack_from("<Hi", image, offset)
    return statusword, counts


def test_an_exchange_is_sync_then_feedback_with_its_latch_instant_and_age() -> None:
    bench = Bench().open()
    bench.drive.counts_at = lambda t_ns: -123
    sent_ns = bench.clock.now_ns()
    image = _read(bench)
    assert bench.can.sent[-1] == (sent_ns, 0x080, b"")
    assert HEADER.unpack_from(image)[0] == sent_ns + SYNC_BITS * 1000
    assert _header(bench, image) == (DELAY_NS - SYNC_BITS * 1000, LinkFlag(0), 0)
    assert _payload(bench, image) == (0x40, -123)


def test_the_nominal_length_of_sync_is_that_of_its_stuffed_frame() -> None:
    header = "0" + f"{0x080:011b}" + "000" + "0000"
    crc = 0
    for bit in header:
        crc = (crc << 1) ^ (0x4599 if int(bit) ^ (crc >> 14 & 1) else 0)
        crc &= 0x7FFF
    stuffed = ""
    for bit in header + f"{crc:015b}":
        stuffed += bit
        if len(stuffed) >= 5 and stuffed[-5:] in ("00000", "11111"):
            stuffed += "1" if bit == "0" else "0"
    assert len(stuffed) + 3 + 7 == SYNC_BITS


def test_one_image_is_reused() -> None:
    bench = Bench().open()
    assert _read(bench) is _read(bench)


def test_missing_feedback_is_flagged_and_the_old_data_kept_while_its_age_grows() -> None:
    bench = Bench().open()
    bench.drive.counts_at = lambda t_ns: 7
    _read(bench)
    bench.drive.mute_tpdos = True
    ages = []
    for _ in range(2):
        image = _read(bench)
        age_ns, flags, _ = _header(bench, image)
        ages.append(age_ns)
        assert flags is LinkFlag.STALE
        assert _payload(bench, image) == (0x40, 7)
    assert ages[1] - ages[0] == PERIOD_NS


def test_without_any_feedback_the_age_is_the_largest() -> None:
    bench = Bench().open()
    bench.drive.mute_tpdos = True
    assert _header(bench, _read(bench)) == (LARGEST_AGE_NS, LinkFlag.STALE, 0)


def test_a_drive_that_was_enabled_before_a_new_start_is_not_enabled_now() -> None:
    """As after the proof of a guard, on a computer that is late for the first exchange of the run."""
    bench = Bench().open()
    _enable(bench)
    assert _payload(bench, _read(bench))[0] & 0x6F == 0x27
    bench.bus.stop()
    bench.bus.configure(bench.plan)
    bench.bus.start()
    bench.drive.mute_tpdos = True
    image = _read(bench)
    assert _payload(bench, image) == (0, 0)
    assert _header(bench, image) == (LARGEST_AGE_NS, LinkFlag.STALE, 0)


def test_reading_ends_at_its_deadline() -> None:
    bench = Bench().open()
    bench.drive.mute_tpdos = True
    deadline_ns = bench.clock.now_ns() + 700_000
    bench.bus.read(deadline_ns)
    assert bench.clock.now_ns() == deadline_ns


def test_a_late_tpdo_is_not_taken_for_the_next_period() -> None:
    bench = Bench().open()
    _read(bench)
    bench.drive.mute_tpdos = True
    bench.can.reply(TPDO, struct.pack("<Hih", 0x27, 999, 0), delay_ns=0)
    image = _read(bench)
    assert LinkFlag.EXCEPTION not in _header(bench, image)[1], "of the length that it has in time"
    assert LinkFlag.STALE in _header(bench, image)[1]
    assert _payload(bench, image) == (0x40, 0)


@pytest.mark.parametrize("change", [bytes.__len__, None], ids=["shorter", "longer"])
def test_a_tpdo_of_the_wrong_length_is_refused(change: object) -> None:
    bench = Bench().open()
    bench.drive.tpdo_change = lambda data: data[:-1] if change else data + b"\0"
    assert _header(bench, _read(bench))[1] == LinkFlag.STALE | LinkFlag.EXCEPTION
    bench.drive.tpdo_change = lambda data: data
    assert _header(bench, _read(bench))[1] == LinkFlag(0)


@pytest.mark.parametrize("kind", ["extended", "remote"])
def test_frames_of_another_format_with_the_same_identifier_are_not_ours(kind: str) -> None:
    bench = Bench().open()
    bench.drive.mute_tpdos = True
    bench.can.later(
        50_000,
        can.Message(
            arbitration_id=TPDO,
            data=b"" if kind == "remote" else bytes(6),
            is_extended_id=kind == "extended",
            is_remote_frame=kind == "remote",
        ),
    )
    assert _header(bench, _read(bench))[1] is LinkFlag.STALE


def test_an_emergency_is_flagged_with_its_code_until_it_is_reset() -> None:
    bench = Bench().open()
    bench.drive.emergency(0x8130)
    assert _header(bench, _read(bench))[1:] == (LinkFlag.EMERGENCY, 0x8130)
    assert _header(bench, _read(bench))[1:] == (LinkFlag.EMERGENCY, 0x8130)
    bench.drive.emergency(0x0000)
    assert _header(bench, _read(bench))[1:] == (LinkFlag(0), 0)


def test_an_emergency_that_is_reset_within_the_period_is_flagged_once() -> None:
    bench = Bench().open()
    bench.drive.emergency(0x8130)
    bench.drive.emergency(0x0000)
    assert _header(bench, _read(bench))[1:] == (LinkFlag.EMERGENCY, 0x8130)
    assert _header(bench, _read(bench))[1:] == (LinkFlag(0), 0)


def test_of_many_emergencies_the_first_is_named() -> None:
    """The others follow from it, as 8140h after a bus-off, or the storm of a drive that repeats itself."""
    bench = Bench().open()
    for code in (0x8130, 0x8140, *range(0x2000, 0x2400)):
        bench.drive.emergency(code)
    assert _header(bench, _read(bench))[1:] == (LinkFlag.EMERGENCY, 0x8130)
    bench.drive.emergency(0x0000)
    bench.drive.emergency(0x3210)
    assert _header(bench, _read(bench))[1:] == (LinkFlag.EMERGENCY, 0x3210)


def test_an_emergency_that_comes_after_the_trip_is_its_cause_unless_we_provoked_it() -> None:
    bench = Bench().open()
    _read(bench)
    assert bench.bus.causes == {}
    bench.drive.mute_tpdos = bench.drive.mute_sdo = True
    bench.drive.emergency(0x8130, delay_ns=1_000_000)
    bench.bus.stop()
    assert bench.bus.causes == {"handle": (LinkFlag.EMERGENCY, 0x8130)}
    again = Bench().open()
    again.drive.mute_tpdos = again.drive.mute_sdo = True
    again.drive.emergency(0x8130, delay_ns=40_000_000)  # our heartbeat stays away, and NMT has set it pre-operational
    again.bus.stop()
    assert again.bus.causes == {}


def test_nothing_of_a_run_before_is_left_in_the_image() -> None:
    """A drive that was enabled then is not now; until it has spoken, nothing is known of it."""
    bench = Bench().open()
    bench.drive.power_stays = 0x27
    bench.drive._store((0x6040, 0), bytes(2))
    _read(bench)
    assert _payload(bench, _read(bench))[0] == 0x27
    bench.bus.stop()
    bench.drive.power_stays = None
    bench.drive.objects[0x6041, 0] = bytes((0x40, 0))
    bench.bus.acknowledge()
    bench.bus.configure(bench.plan)
    bench.bus.start()
    bench.drive.mute_tpdos = True
    image = _read(bench)
    assert _payload(bench, image) == (0, 0)
    assert _header(bench, image)[:2] == (LARGEST_AGE_NS, LinkFlag.STALE)


def test_a_late_answer_to_an_earlier_request_is_passed_over() -> None:
    """A busy drive answers after the time-out, while the next question waits for its own answer."""
    bench = Bench().open()
    node = bench.bus._setups[0].node
    bench.can.reply(0x580 + NODE, b"\x43\x72\x60\x00\x07\x00\x00\x00", 10_000)
    bench.can.reply(0x580 + NODE, b"\x80\x72\x60\x00\x00\x00\x02\x06", 20_000)
    assert node.read(STATUSWORD) == 0x40


def test_an_emergency_too_short_for_a_code_is_ignored() -> None:
    bench = Bench().open()
    bench.can.reply(0x080 + NODE, b"\x30", 0)
    assert _header(bench, _read(bench))[1] == LinkFlag(0)


def test_a_restart_is_flagged_for_good() -> None:
    bench = Bench().open()
    bench.drive.restart()
    flags = _header(bench, _read(bench))[1]
    assert flags == LinkFlag.BOOT_UP | LinkFlag.NOT_OPERATIONAL | LinkFlag.STALE
    bench.drive.state = 0x05
    bench.can.reply(HEARTBEAT, b"\x05", 0)
    assert _header(bench, _read(bench))[1] == LinkFlag.BOOT_UP


def test_a_heartbeat_that_names_another_state_is_flagged() -> None:
    bench = Bench().open()
    bench.can.reply(HEARTBEAT, b"\x7f", 0)
    assert _header(bench, _read(bench))[1] is LinkFlag.NOT_OPERATIONAL


def test_a_heartbeat_that_stays_away_for_three_times_its_period_is_flagged() -> None:
    bench = Bench().open()
    opened_ns = bench.clock.now_ns()
    bench.drive._beat = lambda: None  # type: ignore[method-assign]
    bench.can._events.clear()
    flags = {}
    while bench.clock.now_ns() < opened_ns + 320_000_000:
        flags[bench.clock.now_ns() - opened_ns] = _header(bench, _read(bench))[1]
        bench.clock.sleep_until(bench.clock.now_ns() + PERIOD_NS)
    lost = [t_ns for t_ns, flag in flags.items() if LinkFlag.NO_SIGN_OF_LIFE in flag]
    assert 298_000_000 <= lost[0] <= 302_000_000
    assert all(flag in (LinkFlag(0), LinkFlag.NO_SIGN_OF_LIFE) for flag in flags.values())


def test_bus_off_is_flagged_on_every_axis() -> None:
    bench = Bench(plan_of(TWO_AXES)).open()
    bench.can.later(0, can.Message(arbitration_id=0x40, is_error_frame=True, is_extended_id=False, data=bytes(8)))
    image = _read(bench)
    assert [_header(bench, image, axis)[1] for axis in (0, 1)] == [LinkFlag.BUS_OFF, LinkFlag.BUS_OFF]


def test_other_error_frames_are_no_fault() -> None:
    bench = Bench().open()
    bench.can.later(0, can.Message(arbitration_id=0x04, is_error_frame=True, is_extended_id=False, data=bytes(8)))
    assert _header(bench, _read(bench))[1] == LinkFlag(0)


def test_flags_belong_to_one_axis() -> None:
    bench = Bench(plan_of(TWO_AXES)).open()
    bench.drives[1].emergency(0x3210)
    image = _read(bench)
    assert _header(bench, image, 0)[1:] == (LinkFlag(0), 0)
    assert _header(bench, image, 1)[1:] == (LinkFlag.EMERGENCY, 0x3210)


def test_writing_sends_each_axis_its_octets_and_the_heartbeat_when_due() -> None:
    bench = Bench(plan_of(TWO_AXES)).open()
    opened = len(bench.can.sent)
    for value in range(2 * can_traffic(bench.plan).heartbeat_every + 1):
        bench.bus.write(bytearray((value, 0, 1, 0, value, 0, 2, 0)))
    sent = [(can_id, data) for _, can_id, data in bench.can.sent[opened:]]
    assert [data for can_id, data in sent if can_id == 0x201][:2] == [b"\0\0\1\0", b"\1\0\1\0"]
    assert [data for can_id, data in sent if can_id == 0x202][:2] == [b"\0\0\2\0", b"\1\0\2\0"]
    assert [data for can_id, data in sent if can_id == 0x77F] == [b"\x05"] * 3
    assert sent[2] == (0x77F, b"\x05")


def _queue_full(message: can.Message) -> Exception | None:
    return can.CanOperationError("Failed to transmit", errno.ENOBUFS) if message.arbitration_id == RPDO else None


def test_a_full_queue_drops_set_points_and_is_an_exception_when_it_lasts() -> None:
    bench = Bench().open()
    flags = []
    bench.can.refuse = _queue_full
    for _ in range(4):
        flags.append(_header(bench, _read(bench))[1])
        bench.bus.write(TORQUE_FREE)
    bench.can.refuse = lambda message: None
    assert flags == [LinkFlag(0), LinkFlag(0), LinkFlag(0), LinkFlag.EXCEPTION]
    assert bench.can.of(RPDO) == []
    bench.bus.stop()
    assert any("txqueuelen" in sentence for sentence in bench.bus.warnings)


def test_a_full_queue_for_sync_is_missing_feedback() -> None:
    bench = Bench().open()
    bench.can.refuse = lambda message: can.CanOperationError("Transmit buffer full")
    assert _header(bench, _read(bench))[1] is LinkFlag.STALE


def test_a_dead_interface_raises_and_stopping_still_tries_every_axis() -> None:
    bench = Bench(plan_of(TWO_AXES)).open()
    bench.can.broken = can.CanOperationError("Failed to transmit: Network is down", errno.ENETDOWN)
    with pytest.raises(BusError, match="fake0: the interface is down or gone"):
        _read(bench)
    with pytest.raises(BusError, match="Network is down"):
        bench.bus.write(bytes(8))
    assert bench.bus.stop() is False
    assert sum("set-point of zero torque" in sentence for sentence in bench.bus.warnings) == 2
    bench.bus.close()
    assert bench.can.is_shut_down


def _enable(bench: Bench) -> None:
    for controlword in (0x06, 0x07, 0x0F, 0x0F):
        _read(bench)
        bench.bus.write(struct.pack("<Hh", controlword, 100))


def test_stopping_sends_torque_free_set_points_first_and_waits_until_the_drive_says_so() -> None:
    bench = Bench().open()
    _enable(bench)
    assert bench.drive.value(0x6041) == 0x27
    enabled = len(bench.can.sent)
    assert bench.bus.stop() is True
    sent = [(can_id, data) for _, can_id, data in bench.can.sent[enabled:]]
    assert sent[:3] == [(RPDO, TORQUE_FREE), (0x600 + NODE, DISABLE_BY_SDO), (0x080, b"")]
    commands = [data for can_id, data in sent if can_id == 0x000]
    assert commands == [bytes((0x80, NODE))]
    assert bench.drive.value(0x6071) == 0
    assert bench.drive.value(0x6041) == 0x40


def test_stopping_twice_is_the_same_as_once() -> None:
    bench = Bench().open()
    _enable(bench)
    bench.bus.stop()
    sent = len(bench.can.sent)
    assert bench.bus.stop() is True
    assert len(bench.can.sent) == sent


def test_stopping_says_when_a_drive_stays_enabled() -> None:
    bench = Bench().open()
    bench.drive.power_stays = 0x27
    _enable(bench)
    assert bench.bus.stop() is False
    assert bench.can.of(RPDO)[-1] == TORQUE_FREE
    assert bench.drive.value(0x1016, 1) != 0, "its guard is what is left to disable it"


def test_without_feedback_stopping_asks_by_sdo() -> None:
    bench = Bench().open()
    _enable(bench)
    bench.drive.mute_tpdos = True
    assert bench.bus.stop() is True
    assert b"\x40\x41\x60\x00" + bytes(4) in bench.can.of(0x600 + NODE)[-3:]


def test_stopping_a_vanished_drive_is_not_confirmed() -> None:
    bench = Bench().open()
    _enable(bench)
    bench.drive.silent = True
    assert bench.bus.stop() is False
    assert bench.bus.warnings


def test_a_confirmed_stop_ends_the_drives_watch_on_us_and_closing_shuts_the_bus() -> None:
    bench = Bench().open()
    _enable(bench)
    stopped_ns = bench.clock.now_ns()
    bench.bus.stop()
    assert bench.drive.value(0x1016, 1) == 0
    assert bench.clock.now_ns() - stopped_ns < 3_000_000, "long before the guard would have fired"
    bench.bus.close()
    assert bench.can.is_shut_down


def test_closing_without_stopping_stops() -> None:
    bench = Bench().open()
    _enable(bench)
    bench.bus.close()
    assert bench.can.of(RPDO)[-1] == TORQUE_FREE
    assert bench.drive.value(0x6041) == 0x40


def test_a_guard_that_cannot_be_released_is_a_warning() -> None:
    bench = Bench().open()
    bench.drive.aborts[0x1016, 1] = 0x0800_0022
    assert bench.bus.stop() is True
    assert any("watchdog armed" in sentence for sentence in bench.bus.warnings)


def test_a_bus_that_was_never_opened_may_be_stopped_and_closed() -> None:
    bench = Bench()
    assert bench.bus.stop() is True
    bench.bus.close()
    assert bench.can.sent == []


def test_every_frame_is_logged_in_both_directions_configuration_included() -> None:
    bench = Bench().open()
    _read(bench)
    ours = [frame for frame in bench.frames if frame in bench.can.sent]
    assert ours == bench.can.sent
    heard = {can_id for _, can_id, _ in bench.frames}
    assert {0x581, HEARTBEAT, TPDO} <= heard
    assert [t_ns for t_ns, _, _ in bench.frames] == sorted(t_ns for t_ns, _, _ in bench.frames)


def test_two_runs_send_the_same_octets_at_the_same_times() -> None:
    logs = []
    for _ in range(2):
        bench = Bench().open()
        _enable(bench)
        bench.bus.close()
        logs.append(bench.frames)
    assert logs[0] == logs[1]


def test_a_flood_while_feedback_is_missing_ends_with_the_deadline() -> None:
    bench = Bench().open()
    bench.drive.mute_tpdos = True

    def babble() -> None:
        bench.can.reply(0x001, b"", 0)
        bench.clock.compute(5_000)
        bench.can.later(0, babble)

    bench.can.later(100_000, babble)
    deadline_ns = bench.clock.now_ns() + PERIOD_NS
    image = bench.bus.read(deadline_ns)
    assert bench.clock.now_ns() <= deadline_ns + 5_000 * (MOST_WAITING + 2)
    assert _header(bench, image)[1] == LinkFlag.STALE
