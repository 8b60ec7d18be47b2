"""Costs with their spread, ratios of calls that took turns, and a warning where the machine was busy."""

import os
import select

import numpy as np
import pytest

from haptic_fieldbus.study.measure import timing
from haptic_fieldbus.study.measure.timing import Cost, MachineNoise, Timed, load_average

DRIFT = np.array([1.0, 1.0, 1.1, 1.5, 2.0, 4.0, 4.0, 4.0])
"""A machine that becomes slower while it is timed."""


def cost(*passes: float, lasted: int = 1000, ran: int = 1000) -> Cost:
    return Cost(np.array(passes), lasted, ran)


def test_calls_take_turns_pass_by_pass_after_one_pass_that_only_warms_up() -> None:
    calls: list[str] = []
    names = [["a"] * 3, ["b"] * 2]
    timed = {name[0]: Timed(calls.append, lambda name=name: (name,)) for name in names}  # type: ignore[misc]
    found = timing.in_turn(timed, repeats=20)
    assert "".join(calls) == "aaabb" * 21
    assert {name: len(each.passes) for name, each in found.items()} == {"a": 20, "b": 20}
    assert timing.REPEATS >= 20


def test_a_cost_is_its_median_pass_and_lies_inside_its_own_quartiles() -> None:
    found = cost(5.0, 1.0, 3.0, 2.0, 4.0)
    assert found.ns == 3.0
    assert found.quartiles == (2.0, 3.0, 4.0)
    assert found.spread == pytest.approx(2.0 / 3.0)


def test_a_ratio_in_turn_is_right_on_a_machine_that_becomes_slower() -> None:
    dear, cheap = Cost(300.0 * DRIFT, 1, 1), Cost(100.0 * DRIFT, 1, 1)
    assert dear.ratio(cheap) == pytest.approx((3.0, 3.0, 3.0))
    one_after_the_other = Cost(100.0 * DRIFT[::-1], 1, 1)
    assert dear.ratio(one_after_the_other)[2] > 6.0, "what is not taken in turn tells nothing"


def test_an_excess_is_taken_pass_by_pass() -> None:
    assert cost(5.0, 9.0, 7.0).excess(cost(1.0, 2.0, 3.0)).tolist() == [4.0, 7.0, 4.0]


def test_single_calls_that_do_more_take_longer() -> None:
    idle, busy = (timing.spread(call, [()] * 100) for call in (lambda: None, lambda: sum(range(2000))))
    assert idle.p50 <= busy.p50 <= busy.p999 <= busy.largest


def test_a_call_that_had_no_processor_shows() -> None:
    def waits(_: object) -> None:
        select.select([], [], [], 1e-3)

    found = timing.in_turn({"waits": Timed(waits, lambda: ([0],))}, repeats=5)["waits"]
    assert found.ran_ns < 0.7 * found.lasted_ns
    assert MachineNoise.of(0.0, [found]).busy


@pytest.mark.parametrize(
    ("load", "passes", "ran", "busy"),
    [
        (0.0, (10.0, 10.1, 10.2), 1000, False),
        (None, (10.0, 10.1, 10.2), 1000, False),
        (2.0, (10.0, 10.1, 10.2), 1000, True),
        (0.0, (10.0, 12.0, 16.0), 1000, True),
        (0.0, (10.0, 10.1, 10.2), 900, True),
    ],
)
def test_a_machine_is_busy_by_its_load_by_interruptions_or_by_scatter(
    load: float | None, passes: tuple[float, ...], ran: int, busy: bool
) -> None:
    quiet = MachineNoise.of(None if load is None else load * (os.cpu_count() or 1), [cost(*passes, ran=ran)])
    assert quiet.busy is busy
    assert bool(quiet.warning()) is busy
    if busy:
        assert "when nothing else runs" in quiet.warning()
        assert f"{ran // 10} % of a processor" in quiet.warning()


def test_the_load_is_known_where_the_system_has_one() -> None:
    assert (load_average() is None) is not hasattr(os, "getloadavg")
