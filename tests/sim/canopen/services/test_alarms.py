"""Alarms: the earliest time is known, and what is due is done once, in order."""

from collections.abc import Callable

from hypothesis import given
from hypothesis import strategies as st

from haptic_fieldbus.sim import NEVER_NS
from haptic_fieldbus.sim.canopen.services.basics import Alarms


@given(st.lists(st.tuples(st.integers(0, 4), st.integers(0, 20) | st.none()), max_size=40))
def test_the_earliest_is_known_whatever_is_set_and_put_off(settings: list[tuple[int, int | None]]) -> None:
    alarms = Alarms()
    all_ = [alarms.new(lambda _t_ns: None) for _ in range(5)]
    for number, due_ns in settings:
        all_[number].off() if due_ns is None else all_[number].at(due_ns)
        assert alarms.due_ns == min(alarm.due_ns for alarm in all_)


def _note(rung: list[int], number: int) -> Callable[[int], None]:
    return lambda _t_ns: rung.append(number)


def test_what_is_due_rings_once_in_the_order_of_making() -> None:
    alarms, rung = Alarms(), list[int]()
    late, first, second = (alarms.new(_note(rung, number)) for number in range(3))
    late.at(11)
    second.at(5)
    first.at(10)
    alarms.ring(10)
    assert rung == [1, 2]
    assert alarms.due_ns == 11
    alarms.ring(11)
    assert rung == [1, 2, 0]
    assert alarms.due_ns == NEVER_NS


def test_an_alarm_may_set_itself_again() -> None:
    alarms = Alarms()
    alarm = alarms.new(lambda t_ns: alarm.at(t_ns + 3))
    alarm.at(1)
    alarms.ring(1)
    assert alarms.due_ns == 4
