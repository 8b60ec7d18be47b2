"""Bus load and delay by hand-made sums."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from haptic_fieldbus.api import plan
from haptic_fieldbus.drive.cia402 import WrittenObject
from haptic_fieldbus.drive.profile import DataType
from haptic_fieldbus.drive.rig import RigAxis
from haptic_fieldbus.errors import BusOverloadError
from haptic_fieldbus.protocols.canopen.profile import CanopenProfile, LinkLossSection, SetupSection
from haptic_fieldbus.protocols.canopen.traffic import CanTraffic
from haptic_fieldbus.protocols.traffic import Delay
from haptic_fieldbus.signals import LinkFlag
from tests.builders import PROFILE, can_traffic, plan_of

TRAFFIC = can_traffic(plan_of())
(MEMBER,) = TRAFFIC.members


def acting(control_period: float, acts: str = "reception") -> CanTraffic:
    """The same traffic of a drive that takes over its targets so."""
    profile = replace(
        PROFILE,
        timing=replace(PROFILE.timing, control_period=control_period),
        pdo=replace(PROFILE.pdo, rpdo_acts=acts),  # type: ignore[arg-type]
    )
    return replace(TRAFFIC, members=(replace(MEMBER, profile=profile),))


def guarding(profile: CanopenProfile = PROFILE, rate: float = 1000.0, **changes: Any) -> list[str]:
    """Writes for the guard of a drive of this profile."""
    rig: RigAxis = replace(plan_of().axes[0].rig, **changes)
    traffic = replace(TRAFFIC, members=(replace(MEMBER, profile=profile),), rate=rate)
    return list(traffic.guarding("handle", rig))


def test_what_is_written_for_a_guard_is_heartbeats_reactions_and_mode() -> None:
    """1016h:01 is the node-ID of the master, 127, with 50 ms; at 50 Hz five periods are 100 ms."""
    heard = ["1017h:00 = 100", f"1016h:01 = {127 << 16 | 50}"]
    assert guarding() == [*heard, "6007h:00 = 2", "605Eh:00 = 0", "6060h:00 = 10"]
    assert guarding(on_link_loss="brake") == [*heard, "6007h:00 = 3", "605Ah:00 = 2", "605Eh:00 = 0", "6060h:00 = 10"]
    assert guarding(rate=50.0)[1] == f"1016h:01 = {127 << 16 | 100}"
    assert guarding(rate=500.0) == guarding()


def test_what_is_written_for_life_guarding_is_the_life_time_without_a_heartbeat() -> None:
    watched = replace(PROFILE, link_loss=LinkLossSection(life_guarding=True, reacts=True))
    assert guarding(watched) == ["1017h:00 = 0", "100Ch:00 = 10", "100Dh:00 = 5", "6060h:00 = 10"]


@pytest.mark.parametrize(("rate", "seconds"), [(1000.0, 0.3), (10.0, 0.3), (5.0, 0.5), (0.5, 4.1)])
def test_a_drive_is_silent_after_three_heartbeats_or_two_periods_and_one(rate: float, seconds: float) -> None:
    """A slow loop hears a heartbeat as late as a period. A guarded drive has its life time, five periods at least."""
    assert replace(TRAFFIC, rate=rate).silence_of("handle") == pytest.approx(seconds)
    watched = replace(PROFILE, link_loss=LinkLossSection(life_guarding=True, reacts=True))
    guarded = replace(TRAFFIC, members=(replace(MEMBER, profile=watched),), rate=rate)
    assert guarded.silence_of("handle") == pytest.approx(max(0.05, 5.0 / rate))


def test_what_a_profile_sets_up_belongs_to_its_guard() -> None:
    own = SetupSection((WrittenObject(0x1029, DataType.UINT8, 1, subindex=1),))
    assert guarding(replace(PROFILE, setup=own))[-2:] == ["1029h:01 = 1", "6060h:00 = 10"]
    assert guarding(replace(PROFILE, link_loss=LinkLossSection())) == ["1017h:00 = 100", "6060h:00 = 10"]


def test_a_period_is_sync_eight_octets_in_and_four_out() -> None:
    assert TRAFFIC.period_bits == 55 + 135 + 95
    assert TRAFFIC.answer_bits == 135 + 95 - 3


def test_load_counts_the_heartbeats_of_both_sides() -> None:
    """285 bits at 1 kHz, 65 bits at 100 Hz from us and at 10 Hz from the node."""
    assert TRAFFIC.load == pytest.approx((285_000 + 65 * 110) / 1e6)


def test_the_delay_is_bus_compute_wait_for_the_tick_and_lag() -> None:
    delay = acting(0.0004).delay("handle")
    assert delay.bus == pytest.approx(227e-6)
    assert delay.compute == 50e-6
    assert delay.transport == pytest.approx(400e-6)
    assert delay.torque_loop == pytest.approx(1 / (2 * math.pi * 1000))
    assert delay.total == pytest.approx(delay.transport + delay.torque_loop)


@pytest.mark.parametrize(("control_period", "acts_at"), [(0.0, 277e-6), (277e-6, 277e-6), (100e-6, 300e-6)])
def test_the_drive_takes_over_at_its_first_tick_after_the_rpdo(control_period: float, acts_at: float) -> None:
    assert acting(control_period).delay("handle").transport == pytest.approx(acts_at)


@pytest.mark.parametrize("acts", ["next_sync", "unknown"])
def test_what_does_not_act_on_reception_waits_for_the_next_sync(acts: str) -> None:
    assert acting(0.0004, acts).delay("handle").transport == pytest.approx(0.001)


def test_a_synchronous_rpdo_never_acts_on_reception() -> None:
    traffic = acting(0.0)
    (member,) = traffic.members
    rpdos = tuple(replace(pdo, transmission_type=1) for pdo in MEMBER.traffic.rpdos)
    synchronous = replace(traffic, members=(replace(member, traffic=replace(MEMBER.traffic, rpdos=rpdos)),))
    assert traffic.delay("handle").transport == pytest.approx(277e-6)
    assert synchronous.delay("handle").transport == pytest.approx(0.001)


def test_a_bus_that_carries_the_plan_passes() -> None:
    TRAFFIC.check("")


@pytest.mark.parametrize("rate", [3300.0, 3500.0, 5000.0, 20000.0])
def test_a_rate_that_the_bus_cannot_carry_is_refused_with_the_numbers_and_one_that_fits(rate: float) -> None:
    with pytest.raises(BusOverloadError, match=r"285 bits") as refused:
        replace(TRAFFIC, rate=rate).check("")
    fits = float(str(refused.value).rsplit("--rate ", 1)[1])
    assert rate / 10 < fits < rate
    replace(TRAFFIC, rate=fits).check("")


@pytest.mark.parametrize(("bitrate", "rate"), [(125_000, 1000.0), (50_000, 400.0), (10_000, 100.0)])
def test_on_a_slow_bus_the_rate_that_is_proposed_leaves_room_for_heartbeats(bitrate: int, rate: float) -> None:
    """They are as many at a lower rate: the drive's deadline sets their number."""
    slow = replace(TRAFFIC, bitrate=bitrate)
    with pytest.raises(BusOverloadError) as refused:
        replace(slow, rate=rate).check("")
    fits = float(str(refused.value).rsplit("--rate ", 1)[1])
    replace(slow, rate=fits).check("")
    assert 0.0 < fits < rate


def test_a_bus_that_heartbeats_alone_fill_fits_no_rate() -> None:
    """Of twenty nodes ten times a second, 65 bits each, on 10 kbit/s."""
    crowd = replace(TRAFFIC, bitrate=10_000, rate=100.0, members=(MEMBER,) * 20)
    with pytest.raises(BusOverloadError, match="No rate fits"):
        crowd.check("")


@pytest.mark.parametrize(("bitrate", "shown"), [(1_000_000, "1 Mbit/s"), (125_000, "125 kbit/s")])
def test_a_bit_rate_is_told_in_the_unit_that_reads_best(bitrate: int, shown: str) -> None:
    assert replace(TRAFFIC, bitrate=bitrate).speed == shown


def test_waiting_for_another_bus_makes_the_period_longer_but_not_fuller() -> None:
    waiting = replace(acting(0.0), waiting=100e-6)
    assert waiting.shortest_period == pytest.approx(TRAFFIC.shortest_period + 100e-6)
    assert waiting.load == TRAFFIC.load
    assert waiting.delay("handle").bus == pytest.approx(327e-6)
    assert TRAFFIC.feedback_time == pytest.approx((55 + 135) * 1e-6)


@pytest.mark.parametrize(("rate", "every"), [(1000.0, 10), (250.0, 2), (10.0, 1)])
def test_five_heartbeats_fit_into_the_drives_deadline(rate: float, every: int) -> None:
    assert replace(TRAFFIC, rate=rate).heartbeat_every == every


@pytest.mark.parametrize("flag", set(LinkFlag) - {LinkFlag.STALE})
def test_every_fault_of_the_link_is_told_in_words(flag: LinkFlag) -> None:
    text = MEMBER.traffic.fault_text(flag, 0x8130)
    assert text[0].islower()
    assert ("8130h (life guard or heartbeat error" in text) is (flag is LinkFlag.EMERGENCY)


def test_transport_leaves_the_lag_out() -> None:
    assert Delay(1.0, 2.0, 3.0, 4.0).transport == 6.0


def test_what_is_asked_by_sdo_stands_below_the_pdos() -> None:
    asked = Path(__file__).parents[2] / "system" / "profiles" / "asked_echo.toml"
    traffic = plan("wall", drive=str(asked)).axes[0].traffic
    assert list(traffic.lines())[-1] == ("ask", "SDO upload at most every 5 ms: 6071h:00 target torque")
    assert list(traffic.summary())[-1] == "read by SDO target torque asked"


def test_computing_overlaps_the_space_after_the_last_tpdo() -> None:
    """55 bits of SYNC, 135 and 95 of PDOs, of which 3 are space; 50 µs of computing: 332 µs at 1 Mbit/s, not 335."""
    fast = can_traffic(plan("wall", drive="generic_cia402", rate=3000.0))
    assert fast.shortest_period == pytest.approx((55 + 135 - 3 + 95 + 50) * 1e-6)


@pytest.mark.parametrize(("rate", "late"), [(1000.0, False), (2500.0, False), (2550.0, True), (3000.0, True)])
def test_our_sign_of_life_moves_where_it_has_no_room_behind_the_set_points(rate: float, late: bool) -> None:
    """It takes 65 bits at worst: 332 + 65 = 397 µs, the period of 2519 Hz."""
    assert can_traffic(plan("wall", drive="generic_cia402", rate=rate)).proves_while_computing is late
