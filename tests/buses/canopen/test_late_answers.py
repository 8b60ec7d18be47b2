"""Answers to SYNC that come periods late, as those of a drive that stood still: which sample belongs to which SYNC."""

import struct
from contextlib import ExitStack
from dataclasses import replace

import pytest

from haptic_fieldbus.errors import BusConfigurationError
from haptic_fieldbus.planning.image import AXIS_HEADER, LARGEST_AGE_NS
from haptic_fieldbus.protocols.canopen.bus import CanSection
from haptic_fieldbus.protocols.canopen.pdo import SYNC_COB_ID
from haptic_fieldbus.signals import LinkFlag
from tests.builders import plan_of
from tests.buses.canopen.benches import RPDO, TPDO, Bench

PERIOD_NS = 1_000_000
USUAL = 20
"""Periods by which the master knows how long an answer takes: 0.1 ms here."""


class Timed:
    """A drive whose counts are the number of the SYNC that it answers."""

    def __init__(self, usual: int = USUAL) -> None:
        self.bench = Bench().open()
        self.bench.drive.mute_tpdos = True
        self.number = 0
        for _ in range(usual):
            self.period([(100_000, 0)])

    def period(self, answers: list[tuple[int, int]]) -> tuple[LinkFlag, int]:
        """One period, with answers after so many nanoseconds to the SYNC so many periods ago: flags and counts."""
        self.number += 1
        for delay_ns, ago in answers:
            self.bench.can.reply(TPDO, struct.pack("<Hih", 0x40, self.number - ago, 0), delay_ns)
        begin_ns = self.bench.clock.now_ns()
        image = self.bench.bus.read(begin_ns + 800_000)
        self.bench.clock.sleep_until(begin_ns + PERIOD_NS)
        places = self.bench.plan.image.axes[0]
        flags = LinkFlag(AXIS_HEADER.unpack_from(image, places.header)[1])
        return flags, struct.unpack_from("<Hi", image, places.inputs[0])[1]


def test_a_late_answer_is_not_taken_for_that_of_the_last_sync() -> None:
    drive = Timed()
    assert drive.period([])[0] is LinkFlag.STALE
    assert drive.period([])[0] is LinkFlag.STALE
    assert drive.period([(700_000, 2)])[0] is LinkFlag.STALE
    flags, counts = drive.period([(50_000, 2), (60_000, 1), (150_000, 0)])
    assert (flags, counts) == (LinkFlag(0), drive.number)


def test_answers_that_come_all_at_once_leave_the_newest() -> None:
    drive = Timed()
    for _ in range(3):
        drive.period([])
    burst = [(500_000 + 50_000 * place, 3 - place) for place in range(4)]
    assert drive.period(burst) == (LinkFlag(0), drive.number)


@pytest.mark.parametrize("ahead_ns", [0, 20_000])
def test_an_answer_too_soon_to_be_one_is_an_older_one(ahead_ns: int) -> None:
    drive = Timed()
    drive.period([])
    assert drive.period([(ahead_ns, 1), (150_000, 0)]) == (LinkFlag(0), drive.number)


@pytest.mark.parametrize("after_ns", [30_000, 300_000])
def test_the_only_answer_at_a_third_or_three_times_the_usual_time_is_not_taken(after_ns: int) -> None:
    drive = Timed()
    drive.period([])
    assert drive.period([(after_ns, 1)])[0] is LinkFlag.STALE


@pytest.mark.parametrize(("number", "double"), [(2, False), (10, True)])
def test_a_sample_that_nobody_asked_for_is_that_of_the_start_or_of_a_second_node(number: int, double: bool) -> None:
    """As it becomes operational, a drive may send one, before it has answered three times."""
    drive, answer = Timed(usual=0), (100_000, 0)
    flags = [drive.period([answer] * (2 if place == number else 1))[0] for place in range(1, 20)]
    assert any(LinkFlag.DUPLICATE in each for each in flags) is double


def test_an_answer_that_was_lost_costs_one_sample() -> None:
    drive = Timed()
    assert drive.period([])[0] is LinkFlag.STALE
    for _ in range(100):
        assert drive.period([(120_000, 0)]) == (LinkFlag(0), drive.number)


def test_slow_answers_are_the_usual_ones_of_a_slow_drive() -> None:
    drive = Timed()
    for _ in range(200):
        assert drive.period([(600_000, 0)]) == (LinkFlag(0), drive.number)
    drive.period([])
    assert drive.period([(600_000, 0)]) == (LinkFlag(0), drive.number)


def test_after_a_gap_an_old_answer_that_comes_at_the_usual_time_is_not_taken_either() -> None:
    drive = Timed()
    for _ in range(3):
        drive.period([])
    burst = [(100_000 + 60_000 * place, 3 - place) for place in range(4)]
    assert drive.period(burst) == (LinkFlag(0), drive.number)


def test_after_feedback_was_lost_for_long_the_next_answer_is_taken() -> None:
    drive = Timed()
    for _ in range(20):
        assert drive.period([])[0] is LinkFlag.STALE
    for _ in range(10):
        assert drive.period([(110_000, 0)]) == (LinkFlag(0), drive.number)


def test_answers_that_take_another_time_from_now_on_are_taken_after_some_periods() -> None:
    drive = Timed()
    drive.period([])
    flags = [drive.period([(600_000, 0)])[0] for _ in range(30)]
    assert flags[:4] == [LinkFlag.STALE] * 3 + [LinkFlag(0)]
    assert set(flags[4:]) == {LinkFlag(0)}


def test_what_an_earlier_exchange_left_in_the_image_is_no_state_of_the_drive() -> None:
    """After the proof of a guard, whose last state was operation enabled; the first answer of the run stays away."""
    bench = Bench().open()
    assert bench.bus.read(bench.clock.now_ns() + 800_000)[bench.plan.image.axes[0].inputs[0] :] != bytes(8)
    bench.bus.stop()
    bench.bus.configure(bench.plan)
    bench.bus.start()
    bench.drive.mute_tpdos = True
    image = bench.bus.read(bench.clock.now_ns() + 800_000)
    places = bench.plan.image.axes[0]
    assert set(image[places.inputs[0] : sum(places.inputs)]) == {0}
    age_ns, flags, _ = AXIS_HEADER.unpack_from(image, places.header)
    assert age_ns == LARGEST_AGE_NS
    assert LinkFlag.STALE in LinkFlag(flags)


class RealBench(Bench):
    """A bench whose plan takes its bus for a real one."""

    def __init__(self) -> None:
        plan = plan_of()
        rig = replace(plan.rig, bus={name: CanSection("socketcan", "can0") for name in plan.rig.bus})
        super().__init__(replace(plan, rig=rig))

    def syncs(self) -> int:
        """How often SYNC was sent before drives were freed."""
        sent = [can_id for _, can_id, _ in self.frames if can_id in (SYNC_COB_ID, RPDO)]
        return sent.index(RPDO) if RPDO in sent else len(sent)


@pytest.mark.parametrize(
    ("delay_us", "refused"), [(100, False), (950, False), (1_200, True), (2_300, True), (7_400, True)]
)
def test_a_drive_that_answers_more_than_a_period_late_is_refused_before_torque(delay_us: int, refused: bool) -> None:
    """In the loop each answer would pass for that to the SYNC after it: with 1.2 ms it comes 0.2 ms after one."""
    bench = RealBench()
    bench.drive.tpdo_delay_ns = delay_us * 1000
    with ExitStack() as expected:
        if refused:
            words = f"answers SYNC after {delay_us / 1000:g} ms, and a period lasts 1 ms. .*Ask for a lower rate$"
            expected.enter_context(pytest.raises(BusConfigurationError, match=words))
        bench.open()
    assert bench.syncs() == (10 if refused else 1)
    assert bench.drive.value(0x6041) == 0x40, "switch on disabled"


@pytest.mark.parametrize(("kind", "syncs"), [("once late", 2), ("silent", 1)])
def test_one_late_answer_is_no_reason_and_a_missing_one_is_told_by_the_loop(kind: str, syncs: int) -> None:
    bench, delays_ns = RealBench(), iter([1_500_000, 100_000])
    bench.drive.mute_tpdos = kind == "silent"

    def delayed(data: bytes) -> bytes:
        bench.drive.tpdo_delay_ns = next(delays_ns)
        return data

    bench.drive.tpdo_change = delayed
    bench.open()
    assert bench.syncs() == syncs
