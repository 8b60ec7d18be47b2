"""Times of a request on its line; positions of two registers that a drive may tear: what is doubted, what is motion."""

from dataclasses import replace
from struct import pack

import pytest

from haptic_fieldbus.buses.bus import traffic_of
from haptic_fieldbus.buses.modbus.link import StoredSetPoint, UnitLink, WideValue, times_of
from haptic_fieldbus.planning.image import AXIS_HEADER, LARGEST_AGE_NS
from haptic_fieldbus.protocols.modbus.register_traffic import RegisterRequest
from haptic_fieldbus.protocols.modbus.traffic import ModbusTraffic
from tests.buses.modbus.benches import PROFILE, plan_of

PERIOD_NS = 7_000_000


def torn(value: WideValue, counts: int, period: int) -> bool:
    """Verdict on a position of this period, the high word first."""
    return value.torn(pack(">i", counts), period * PERIOD_NS)


@pytest.mark.parametrize("speed", [0, 3, -3, 20_000, -50_000, 65_536, -65_536, 100_000, 131_072, 400_000])
def test_motion_at_any_speed_is_none_and_a_tear_in_it_is(speed: int) -> None:
    """Counts a period; at 65536 of them each two positions are as far apart as a tear makes them."""
    value, begin = WideValue(low_first=False, start=0), 1_000
    assert not torn(value, begin, 0)
    said = [torn(value, begin + speed * period, period) for period in range(1, 10)]
    assert not any(said[1:]), "only the first step may be doubted, before a speed is known"
    for period, off in ((10, 65_536), (12, -65_536)):
        assert torn(value, begin + speed * period + off, period)
        assert not torn(value, begin + speed * (period + 1), period + 1), "with the next one all is well"


def test_a_sample_that_was_missed_is_motion_too() -> None:
    value = WideValue(low_first=False, start=0)
    assert not any(torn(value, 60_000 * period, period) for period in (0, 2, 3, 4, 9, 10))


def test_a_speed_predicts_no_position_after_a_long_gap() -> None:
    """Eleven counts within 0.2 ms, then a slow host: the speed would lead 65536 counts away."""
    value = WideValue(low_first=False, start=0)
    assert not value.torn(pack(">i", 0), 0)
    assert not value.torn(pack(">i", 11), 200_000)
    assert not value.torn(pack(">i", 11), 200_000 + 65_536 * 200_000 // 11)


def test_what_hardly_is_as_fast_as_before_is_motion() -> None:
    """A handle whose speed changes by less than three quarters of 65536 counts a period."""
    value, at = WideValue(low_first=False, start=0), 0
    for period, way in enumerate((0, 20_000, 60_000, 100_000, 70_000, 30_000, -10_000, -50_000)):
        at += way
        assert not torn(value, at, period)


def test_a_jump_is_believed_when_it_is_seen_twice() -> None:
    value = WideValue(low_first=False, start=0)
    assert [torn(value, counts, period) for period, counts in enumerate((5, 5, 65_541, 65_541, 65_541))] == [
        False, False, True, False, False
    ]  # fmt: skip


def test_32_bits_run_over_without_a_word() -> None:
    value, near = WideValue(low_first=False, start=0), 2**31 - 10
    assert not torn(value, near, 0)
    assert not torn(value, near - 2**32 + 20, 1)


@pytest.mark.parametrize("silence", [2e-3, 5e-3])
def test_the_times_of_a_request_are_those_of_its_characters(silence: float) -> None:
    """19,200 bit/s and 11 bits a character, as Modbus over Serial Line V1.02, 2.5.1, has them."""
    character = 11 / 19_200
    line = {"baud": 19_200, "parity": "even", "stop_bits": 1, "silence": silence}
    traffic = traffic_of(plan_of("sim-modbus-rtu", section=line, rate=20.0), ModbusTraffic)
    request = next(each for each in traffic.of("handle").reading if each.read is not None)
    assert request.read is not None
    profile = replace(PROFILE, line=replace(PROFILE.line, answer_time=0.003))
    times = times_of(traffic, profile, RegisterRequest(3, request.read))
    assert times.executed_ns == pytest.approx(1e9 * (8 * character + silence + 0.003), rel=1e-6)
    assert times.answer_ns == pytest.approx(1e9 * (5 + 2 * request.read.count) * character, rel=1e-6)
    assert times.whole_ns == pytest.approx(times.executed_ns + times.answer_ns + 1e9 * silence, rel=1e-6)


def test_an_age_that_the_header_cannot_hold_is_the_largest_one() -> None:
    """A process that was stopped for longer than 4.29 s while it waited for the answer."""
    image = bytearray(AXIS_HEADER.size)
    plan = plan_of("sim-modbus-tcp")
    traffic = traffic_of(plan, ModbusTraffic)
    (member,) = traffic.members
    link = UnitLink(1, StoredSetPoint(traffic.of("handle"), member.profile.line, 0), 0, image, 0)
    for stood_ns in (LARGEST_AGE_NS - 1, LARGEST_AGE_NS, LARGEST_AGE_NS + 1, 10**12, -5):
        link.missing = 0
        link.latch_ns = 0
        link.finish(stood_ns, 0, None)
        age_ns, flags, _ = AXIS_HEADER.unpack_from(image)
        assert (age_ns, flags) == (max(0, min(stood_ns, LARGEST_AGE_NS)), 0)
