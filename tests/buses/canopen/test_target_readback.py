"""The target torque asked by SDO beside the exchange: when, what lies in the image, and what an answer belongs to."""

import struct
from dataclasses import replace
from itertools import pairwise

import pytest

from haptic_fieldbus.errors import BusConfigurationError
from haptic_fieldbus.protocols.canopen.profile import CanopenProfile
from tests.builders import PROFILE, can_traffic, plan_of
from tests.buses.canopen.benches import NODE, Bench
from tests.buses.canopen.fake_can import DELAY_NS

ASKED: CanopenProfile = replace(PROFILE, torque=replace(PROFILE.torque, actual=None, echo="asked"))
REQUEST = b"\x40\x71\x60\x00" + bytes(4)
"""Upload of 6071h:00 (CiA 301 7.2.4.3.5)."""
MS = 1_000_000


def asked(rate: float = 1000.0) -> Bench:
    return Bench(plan_of(rate=rate, profile=ASKED)).open()


def period(bench: Bench, target: int = 0) -> tuple[int, int]:
    """Exchange once; the answer in the input image (target torque, periods since asked)."""
    end_ns = bench.clock.now_ns() + bench.plan.period_ns
    image = bench.bus.read(end_ns - bench.plan.period_ns // 5)
    # t_ns, age, flags, code, statusword, position come before.
    torque, periods = struct.unpack_from("<hH", image, 8 + 8 + 2 + 4)
    bench.bus.write(struct.pack("<Hh", 0x0F, target))
    bench.clock.sleep_until(end_ns)
    return torque, periods


def questions(bench: Bench) -> list[int]:
    """Times of the requests since the drive became operational [ns]."""
    started = max(t_ns for t_ns, can_id, data in bench.can.sent if (can_id, data) == (0, bytes((1, NODE))))
    return [
        t_ns for t_ns, can_id, data in bench.can.sent if (can_id, data) == (0x600 + NODE, REQUEST) and t_ns >= started
    ]


class TestQuestions:
    @pytest.mark.parametrize(("rate", "every"), [(1000.0, 5), (250.0, 2), (50.0, 1)])
    def test_an_answer_comes_in_the_next_period_with_the_target_of_the_one_before(
        self, rate: float, every: int
    ) -> None:
        bench = asked(rate)
        answers = [period(bench, target=number) for number in range(21)]
        assert [answer for answer in answers if answer[1]] == [(at, 1) for at in range(0, 20, every)]
        assert [at for at, answer in enumerate(answers) if answer[1]] == [at + 1 for at in range(0, 20, every)]

    def test_nothing_is_waited_for(self) -> None:
        bench = asked()
        bench.drive.sdo_delay_ns = 300_000_000
        for _ in range(20):
            began_ns = bench.clock.now_ns()
            bench.bus.read(began_ns + bench.plan.period_ns)
            bench.bus.write(bytes(4))
            assert bench.clock.now_ns() - began_ns == DELAY_NS, "the time of SYNC and TPDO, and no more"
            bench.clock.sleep_until(began_ns + bench.plan.period_ns)

    @pytest.mark.parametrize("rate", [1000.0, 250.0, 50.0])
    def test_two_questions_are_never_closer_than_5_ms(self, rate: float) -> None:
        bench = asked(rate)
        for _ in range(100):
            period(bench)
        times = questions(bench)
        assert min(later - earlier for earlier, later in pairwise(times)) >= 5 * MS

    def test_their_bits_are_in_the_load_and_in_what_may_delay_a_period(self) -> None:
        """Two frames of eight octets, 135 bits each at worst, 200 times a second."""
        other = replace(ASKED, torque=replace(ASKED.torque, echo="none"))
        traffic, without = can_traffic(plan_of(profile=ASKED)), can_traffic(plan_of(profile=other))
        assert traffic.load == pytest.approx(without.load + 2 * 135 * 200 / 1e6)
        assert traffic.disturbance == pytest.approx(without.disturbance + 2 * 135 / 1e6)
        slow, slow_without = (can_traffic(plan_of(rate=50.0, profile=each)) for each in (ASKED, other))
        assert slow.load == pytest.approx(slow_without.load + 2 * 135 * 50 / 1e6)

    def test_it_is_mapped_into_no_tpdo(self) -> None:
        bench = asked()
        assert 0x6071_0010 not in [value for name, value in bench.written() if name.startswith("1A")]
        assert "read by SDO target torque asked" in list(bench.plan.axes[0].traffic.summary())

    def test_the_way_to_zero_takes_over_the_responses(self) -> None:
        bench = asked()
        bench.drive.sdo_delay_ns = 900_000
        for _ in range(6):
            period(bench)
        assert bench.bus.stop() is True
        assert bench.bus.warnings == []

    def test_an_ordinary_sdo_client_may_still_read_when_nothing_is_asked(self) -> None:
        bench = asked()
        assert bench.bus._setups[0].node.read(PROFILE.position.actual.entry if PROFILE.position else None) == 0  # type: ignore[arg-type]


class TestAnswers:
    @pytest.mark.parametrize("late_ms", [3, 7, 14])
    def test_a_late_one_tells_how_many_periods_it_took(self, late_ms: int) -> None:
        bench = asked()
        bench.drive.sdo_delay_ns = late_ms * MS
        answers = [period(bench, target=100 + number) for number in range(60)]
        seen = [(at, *answer) for at, answer in enumerate(answers) if answer[1]]
        assert seen
        for at, torque, periods in seen:
            assert periods == late_ms
            # The drive answered with what it held when it was asked: one of the targets in between, the oldest here.
            assert torque == 100 + at - periods

    def test_a_lost_one_is_asked_for_again_after_15_ms(self) -> None:
        bench = asked()
        bench.drive.mute_sdo = True
        for _ in range(40):
            assert period(bench)[1] == 0
        times = questions(bench)
        assert [round((later - times[0]) / MS) for later in times] == [0, 15, 30]
        bench.drive.mute_sdo = False
        answers = [period(bench, 7)[1] for _ in range(10)]
        assert max(answers) == 46, "counted from the first question, which may be the one that was answered"

    @pytest.mark.parametrize("late_ms", [16, 17, 22, 29])
    def test_after_a_repetition_nothing_is_asked_until_the_other_answer_can_come_no_more(self, late_ms: int) -> None:
        """The answer to the first comes late, that to the second after it: it must not be taken for a third one's."""
        bench = asked()
        bench.drive.sdo_delay_ns = late_ms * MS
        answers = [(at, *period(bench, target=at)) for at in range(200)]
        assert len([periods for _, _, periods in answers if periods]) >= 3
        for at, torque, periods in answers:
            if periods:
                assert at - periods - 1 <= torque < at, "one of the targets that were in force meanwhile"
        times = questions(bench)
        assert min(later - earlier for earlier, later in pairwise(times)) >= 14 * MS

    def test_a_refusal_is_told_once_and_is_no_answer(self) -> None:
        bench = asked()
        del bench.drive.objects[0x6071, 0]
        bench.drive._take_rpdo = lambda can_id, data: None  # type: ignore[method-assign]
        assert {period(bench)[1] for _ in range(60)} == {0}
        assert bench.bus.warnings == ["node 1 (axis handle) refused to read 6071h:00 target torque (abort 06020000h)"]
        assert len(questions(bench)) > 5, "it may have been busy"

    @pytest.mark.parametrize(
        "octets", [b"\x41\x71\x60\x00" + bytes(4), b"\x60\x71\x60\x00" + bytes(4), b"\x4b\x71\x60\x00\x05"],
        ids=["not expedited", "of a download", "too short"],
    )  # fmt: skip
    def test_another_kind_of_response_is_no_answer(self, octets: bytes) -> None:
        bench = asked()
        bench.drive.mute_sdo = True
        period(bench)
        bench.can.reply(0x580 + NODE, octets, 0)
        assert period(bench)[1] == 0

    def test_a_response_to_another_request_is_none(self) -> None:
        bench = asked()
        bench.drive.mute_sdo = True
        period(bench)
        bench.can.reply(0x580 + NODE, b"\x4b\x41\x60\x00\x37\x02\x00\x00", 0)
        assert period(bench)[1] == 0

    def test_a_drive_that_does_not_let_it_be_read_is_refused_before_anything_is_written(self) -> None:
        bench = Bench(plan_of(profile=ASKED))
        del bench.drive.objects[0x6071, 0]
        words = r'reading 6071h:00 target torque: refused: .*; its profile has torque\.echo = "asked".*limited to 5 %'
        with pytest.raises(BusConfigurationError, match=words):
            bench.open()
        assert bench.written() == []
