"""Checks of this computer: wake-ups against a clock whose lateness is known, and rights as they were got."""

import pytest

from haptic_fieldbus.assessing.result import Right
from haptic_fieldbus.buses.scan_result import Check
from haptic_fieldbus.clock import VirtualClock
from haptic_fieldbus.running.rights import clock_check, examine, lateness, right_check, wake_up_check


class Late(VirtualClock):
    """A clock that wakes up late by 0, 10, 20 … 990 µs in turn."""

    def __init__(self) -> None:
        super().__init__()
        self._turn = 0

    def sleep_until(self, deadline_ns: int) -> int:
        late = self._turn % 100 * 10_000
        self._turn += 1
        return super().sleep_until(deadline_ns) or late


def test_wake_ups_are_measured_on_the_grid_of_the_periods() -> None:
    late = lateness(Late(), 1000.0)
    assert len(late) == 1000
    assert sorted(set(late)) == pytest.approx([step * 1e-5 for step in range(100)])


@pytest.mark.parametrize(("rate", "punctual"), [(1000.0, False), (105.0, False), (100.0, True), (10.0, True)])
def test_one_of_a_hundred_may_be_late_by_more_than_a_tenth_of_the_period(rate: float, punctual: bool) -> None:
    check = wake_up_check([step * 1e-5 for step in range(100)], rate)  # 99 of 100 by 0.98 ms at most
    assert check.ok is punctual
    assert bool(check.advice) is not punctual
    assert "990 µs (max)" in check.measured


def test_a_right_is_a_check_with_its_advice() -> None:
    refused = Right("memory", "memory locked", "at most 8 MiB", granted=False, advice="log in again")
    assert right_check(refused) == Check("memory", False, "at most 8 MiB", "log in again")
    assert right_check(Right("memory", "memory locked", "memory locked", granted=True)).ok is True


def test_the_clock_of_this_computer_is_fine_and_all_checks_come_in_order() -> None:
    assert clock_check().ok is True
    mine = Check("adapter", True, "open")
    names = [check.name for check in examine(lambda: [mine], 100.0)]
    assert names[:3] == ["adapter", "clock", "wake_up"]
    assert {"scheduling", "memory", "timer_slack", "idle_states", "processor"} == set(names[3:])
