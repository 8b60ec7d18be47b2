"""Faults of answers on a simulated line: what a master gets of them, octet by octet."""

import pytest

from haptic_fieldbus.errors import BusError
from haptic_fieldbus.protocols.catalogue import load_profile
from haptic_fieldbus.protocols.modbus.profile import modbus_profile
from haptic_fieldbus.sim import faults
from haptic_fieldbus.sim.drive.power import State
from haptic_fieldbus.sim.modbus.drives import GARBAGE
from tests.sim.modbus.test_line import READ, asked, crc, rtu, tcp
from tests.sim.modbus.units import DEMAND, GENERIC, NUMBER, TARGET, WATCHDOG, Driven, virtual_line

USUAL = 13
"""Octets of the usual answer on RTU."""
TOOK = 21 * 11 / 115200 + 1.95e-3
"""[s] of a request and its usual answer."""


def answers(fault: faults.AnswerFault, count: int = 3, serial: bool = True) -> list[bytes]:
    """Answers to so many requests, of which the fault concerns the first `fault.count`."""
    line, clock = virtual_line(serial=serial)
    line.let_happen(NUMBER, fault)
    clock.sleep_until(1_000_000)
    got = []
    for transaction in range(count):
        clock.sleep_until(clock.now_ns() + 2_000_000)
        frame = rtu(NUMBER, READ) if serial else tcp(NUMBER, READ, transaction)
        got.append(asked(line, clock, frame, wait=0.02)[0])
    return got


def is_right(octets: bytes) -> bool:
    return len(octets) == USUAL and octets[:3] == bytes((NUMBER, 3, 8)) and octets[-2:] == crc(octets[:-2])


def test_a_lost_answer_does_not_come() -> None:
    got = answers(faults.AnswerLost("answer_lost", 0.0, 2))
    assert got[:2] == [b"", b""]
    assert is_right(got[2])


def test_a_delayed_answer_comes_later_and_when_nobody_waits_for_it() -> None:
    line, clock = virtual_line()
    line.let_happen(NUMBER, faults.AnswerDelayed("answer_delayed", 0.0, 0.01))
    clock.sleep_until(1_000_000)
    octets, took = asked(line, clock, rtu(NUMBER, READ), wait=0.02)
    assert is_right(octets)
    assert took == pytest.approx(TOOK + 0.01, abs=1e-8)
    line.let_happen(NUMBER, faults.AnswerDelayed("answer_delayed", 0.0, 0.01))
    clock.sleep_until(clock.now_ns() + 2_000_000)
    assert asked(line, clock, rtu(NUMBER, READ), wait=0.005)[0] == b""
    clock.sleep_until(clock.now_ns() + 20_000_000)
    assert is_right(line.discard())


def test_a_swapped_answer_is_that_of_the_request_before() -> None:
    got = answers(faults.AnswerSwapped("answer_swapped", 0.0, 2), serial=False)
    assert [octets[:2] for octets in got] == [b"", b"\0\0", b"\0\1"]


def test_garbage_is_random_and_the_same_for_the_same_seed() -> None:
    got = answers(faults.AnswerGarbage("answer_garbage", 0.0, 2))
    assert got == answers(faults.AnswerGarbage("answer_garbage", 0.0, 2))
    assert all(GARBAGE[0] <= len(octets) <= GARBAGE[1] and not is_right(octets) for octets in got[:2])
    assert got[0] != got[1]
    assert is_right(got[2])


def test_a_corrupted_answer_has_one_other_bit() -> None:
    got = answers(faults.AnswerCorrupted("answer_corrupted", 0.0, 2))
    for octets in got[:2]:
        assert sum((one ^ other).bit_count() for one, other in zip(octets, got[2], strict=True)) == 1
    header, usual = answers(faults.AnswerCorrupted("answer_corrupted", 0.0, 1), 2, serial=False)
    assert header[8:] == usual[8:]


def test_a_truncated_answer_ends_early() -> None:
    got = answers(faults.AnswerTruncated("answer_truncated", 0.0, length=5))
    assert got[0] == got[1][:5]
    assert answers(faults.AnswerTruncated("answer_truncated", 0.0, length=0))[0] == b""


def test_an_answer_may_come_under_another_number() -> None:
    got = answers(faults.AnswerWrongUnit("answer_wrong_unit", 0.0, to=9))
    assert got[0][0] == 9
    assert got[0][-2:] == crc(got[0][:-2])


def test_an_exception_is_no_answer_and_nothing_is_carried_out() -> None:
    line, clock = virtual_line()
    line.let_happen(NUMBER, faults.AnswerException("answer_exception", 0.0, code=4))
    clock.sleep_until(1_000_000)
    octets, _ = asked(line, clock, rtu(NUMBER, bytes.fromhex("0602010063")), wait=0.02)
    assert octets[:3] == bytes((NUMBER, 0x86, 4))
    assert line.unit(NUMBER).drive.objects.target_torque.value == 0


@pytest.mark.parametrize(("serial", "said"), [(False, "reset the connection"), (True, "adapter is gone")])
def test_a_broken_line_is_noticed_by_who_waits_for_an_answer(serial: bool, said: str) -> None:
    line, clock = virtual_line(serial=serial)
    line.let_happen(NUMBER, faults.ConnectionReset("connection_reset", 0.001))
    line.send(rtu(NUMBER, READ) if serial else tcp(7, READ))
    with pytest.raises(BusError, match=said):
        line.receive(10**8)
    assert clock.now_ns() == 1_000_000
    with pytest.raises(BusError):
        line.reopen()


def test_answers_of_other_drives_come_as_ever() -> None:
    line, clock = virtual_line(numbers=(3, 4))
    line.let_happen(3, faults.AnswerLost("answer_lost", 0.0, 100))
    clock.sleep_until(1_000_000)
    for number, comes in ((3, False), (4, True)):
        clock.sleep_until(clock.now_ns() + 2_000_000)
        assert bool(asked(line, clock, rtu(number, READ), wait=0.02)[0]) is comes


class TestForeignSetPoints:
    """Another master that nobody hears."""

    def test_they_act_once_every_interval_until_ours_replace_them(self) -> None:
        driven = Driven(GENERIC, faults.ForeignSetPoints("foreign_set_points", 0.01, 0.8, 0.05, 2))
        driven.enable()
        driven.write(TARGET, 100)
        seen = []
        for _ in range(16):
            driven.wait(10.0)
            seen.append(driven.value(DEMAND))
            if len(seen) % 2 == 0:
                driven.write(TARGET, 100)
        assert seen == [800, 800, 100, 100, 100, 800, *[100] * 10]

    def test_their_torque_is_a_share_of_rated_torque_in_whatever_unit(self) -> None:
        driven = Driven(modbus_profile(load_profile("simplex_motion")))
        driven.unit.write_as_stranger(-0.5, 0)
        objects = driven.unit.drive.objects
        assert objects.target_torque.value * objects.torque_unit == pytest.approx(-0.5 * objects.rated_torque, rel=1e-3)

    def test_they_feed_the_watchdog_as_ours_do(self) -> None:
        driven = Driven(GENERIC, faults.ForeignSetPoints("foreign_set_points", 0.0, 0.1, 0.02))
        driven.write(WATCHDOG, 50)
        driven.enable()
        driven.wait(500.0)
        assert driven.state() is State.OPERATION_ENABLED

    def test_a_unit_that_is_cut_off_hears_them_no_more_than_ours(self) -> None:
        driven = Driven(GENERIC, faults.ForeignSetPoints("foreign_set_points", 0.01, 0.1, 0.02))
        driven.enable()
        driven.unit.silent_until_ns = 1_000_000_000
        driven.wait(100.0)
        assert driven.unit.drive.objects.target_torque.value == 0
