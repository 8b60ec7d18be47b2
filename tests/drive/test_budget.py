"""Bus load and delay by hand-made sums."""

import math
from dataclasses import replace

import pytest

from haptic_fieldbus.drive.budget import (
    Delay,
    Exchange,
    acts_on_reception,
    check_load,
    delay_of,
    heartbeat_every,
)
from haptic_fieldbus.drive.profile import DriveProfile
from haptic_fieldbus.errors import BusOverloadError
from tests.builders import PROFILE, plan_of

PLAN = plan_of()
EXCHANGE = Exchange(PLAN.axes[0].tpdos, PLAN.axes[0].rpdos, 1_000_000)


def profile(control_period: float, acts: str = "reception") -> DriveProfile:
    return replace(
        PROFILE,
        timing=replace(PROFILE.timing, control_period=control_period),
        pdo=replace(PROFILE.pdo, rpdo_acts=acts),  # type: ignore[arg-type]
    )


def test_a_period_is_sync_six_octets_in_and_four_out() -> None:
    assert EXCHANGE.period_bits == 55 + 115 + 95
    assert EXCHANGE.answer_bits == 115 + 95 - 3


def test_load_counts_the_heartbeats_of_both_sides() -> None:
    """265 bits at 1 kHz, 65 bits at 100 Hz from us and at 10 Hz from the node."""
    assert EXCHANGE.load(1000.0, 10, 1) == pytest.approx((265_000 + 65 * 110) / 1e6)


def test_the_delay_is_bus_compute_wait_for_the_tick_and_lag() -> None:
    delay = delay_of(EXCHANGE, profile(0.0004), 0.001)
    assert delay.bus == pytest.approx(207e-6)
    assert delay.compute == 50e-6
    assert delay.transport == pytest.approx(400e-6)
    assert delay.torque_loop == pytest.approx(1 / (2 * math.pi * 1000))
    assert delay.total == pytest.approx(delay.transport + delay.torque_loop)


@pytest.mark.parametrize(("control_period", "acts_at"), [(0.0, 257e-6), (257e-6, 257e-6), (100e-6, 300e-6)])
def test_the_drive_takes_over_at_its_first_tick_after_the_rpdo(control_period: float, acts_at: float) -> None:
    assert delay_of(EXCHANGE, profile(control_period), 0.001).transport == pytest.approx(acts_at)


@pytest.mark.parametrize("acts", ["next_sync", "unknown"])
def test_what_does_not_act_on_reception_waits_for_the_next_sync(acts: str) -> None:
    assert delay_of(EXCHANGE, profile(0.0004, acts), 0.001).transport == pytest.approx(0.001)


def test_a_synchronous_rpdo_never_acts_on_reception() -> None:
    synchronous = tuple(replace(pdo, transmission_type=1) for pdo in EXCHANGE.rpdos)
    assert acts_on_reception(PROFILE, EXCHANGE.rpdos)
    assert not acts_on_reception(PROFILE, synchronous)


def test_a_bus_that_carries_the_plan_passes() -> None:
    check_load(EXCHANGE, 1000.0, EXCHANGE.load(1000.0, 10, 1))


@pytest.mark.parametrize("rate", [3300.0, 3500.0, 5000.0, 20000.0])
def test_a_rate_that_the_bus_cannot_carry_is_refused_with_the_numbers_and_one_that_fits(rate: float) -> None:
    with pytest.raises(BusOverloadError, match=r"265 bits") as refused:
        check_load(EXCHANGE, rate, EXCHANGE.load(rate, 10, 1))
    fits = float(str(refused.value).rsplit("--rate ", 1)[1])
    assert rate / 10 < fits < rate
    check_load(EXCHANGE, fits, EXCHANGE.load(fits, 10, 1))


@pytest.mark.parametrize(("bitrate", "rate"), [(125_000, 1000.0), (50_000, 400.0), (10_000, 100.0)])
def test_on_a_slow_bus_the_rate_that_is_proposed_leaves_room_for_heartbeats(bitrate: int, rate: float) -> None:
    """They are as many at a lower rate: the drive's deadline sets their number."""
    slow, heartbeats = replace(EXCHANGE, bitrate=bitrate), 110.0

    def load(at: float) -> float:
        return (slow.period_bits * at + 65 * heartbeats) / bitrate

    with pytest.raises(BusOverloadError) as refused:
        check_load(slow, rate, load(rate))
    fits = float(str(refused.value).rsplit("--rate ", 1)[1])
    check_load(slow, fits, load(fits))
    with pytest.raises(BusOverloadError):
        check_load(slow, 1.2 * fits, load(1.2 * fits))


def test_a_bus_that_heartbeats_alone_fill_fits_no_rate() -> None:
    slow = replace(EXCHANGE, bitrate=10_000)
    with pytest.raises(BusOverloadError, match="No rate would fit"):
        check_load(slow, 100.0, slow.load(100.0, 1, 20))


def test_waiting_for_another_bus_makes_the_period_longer_but_not_fuller() -> None:
    waiting = replace(EXCHANGE, waiting=100e-6)
    assert waiting.shortest_period == pytest.approx(EXCHANGE.shortest_period + 100e-6)
    assert waiting.load(1000.0, 10, 1) == EXCHANGE.load(1000.0, 10, 1)
    assert delay_of(waiting, profile(0.0), 0.001).bus == pytest.approx(307e-6)
    assert EXCHANGE.feedback_time == pytest.approx((55 + 115) * 1e-6)


@pytest.mark.parametrize(("rate", "every"), [(1000.0, 10), (250.0, 2), (10.0, 1)])
def test_five_heartbeats_fit_into_the_drives_deadline(rate: float, every: int) -> None:
    assert heartbeat_every(0.05, rate) == every


def test_transport_leaves_the_lag_out() -> None:
    assert Delay(1.0, 2.0, 3.0, 4.0).transport == 6.0
