"""Statements of a plan about set-points of another master: the time that they act, and what is not seen of them."""

import math

import pytest

from haptic_fieldbus.planning.deadlines import EndCause, unseen_text
from haptic_fieldbus.planning.explain import explain
from haptic_fieldbus.planning.limits import FOREIGN_TIMES, doubt_time, foreign_gap
from haptic_fieldbus.planning.plan import Plan
from tests.builders import plan_of
from tests.protocols.modbus.lines import RTU, TCP, on
from tests.protocols.modbus.test_other_masters import ONE, TWO, drive
from tests.protocols.modbus.test_traffic import planned, two_units


def stated(plan: Plan) -> dict[EndCause, float]:
    return {each.cause: each.seconds for each in plan.deadlines}


@pytest.mark.parametrize("rate", [1000.0, 143.0, 50.0])
def test_they_act_for_three_looks_a_period_of_a_gateway_and_the_way_to_zero(rate: float) -> None:
    """Three looks take no longer than set-points may be without effect."""
    plan = planned(TCP, rate, drive(TWO))
    found = stated(plan)
    looks = max(0.035, 3.0 * plan.period)
    assert found[EndCause.OTHER_MASTER] == pytest.approx(looks + plan.period + found[EndCause.END])
    assert FOREIGN_TIMES * foreign_gap(plan.period, 1) == pytest.approx(doubt_time(plan.period))


def test_a_drive_that_shows_nothing_lets_them_act_without_end() -> None:
    plan = planned(TCP, 50.0, drive((23,), actual=None))
    assert math.isinf(stated(plan)[EndCause.OTHER_MASTER])
    text = explain(plan)
    assert "set-points of another master  without end  not detected" in text
    assert "unseen     set-points of another master on sim-modbus-tcp: all of them; no register of generic" in text


def test_a_plan_tells_which_are_not_seen_and_for_how_long() -> None:
    text = explain(planned(TCP, 50.0, drive(TWO)))
    assert (
        "unseen     set-points of another master on sim-modbus-tcp: those that act for less than 0.7 ms (period "
        "20 ms); those outside the range of ours in the last 120 ms by less than 5 % of rated torque. Fewer "
        "than 3 within 10 s do not trip\n"
    ) in text
    measured = explain(planned(TCP, 50.0, drive(ONE)))
    assert "by less than 5 % of rated torque and 25 % of their range. Fewer than 3" in measured
    assert "torque actual shows them; 3 within 10 s are a trip" in measured


def test_units_that_are_looked_at_in_turns_are_told() -> None:
    plan = two_units(RTU, 20.0, drive(ONE, actual=None))
    for axis in plan.axes:
        assert "(period 50 ms), checked in one of 2 periods; those" in unseen_text(axis, plan.period)


def test_on_can_every_node_hears_another_master() -> None:
    plan = plan_of()
    assert EndCause.OTHER_MASTER not in stated(plan)
    assert "\nunseen " not in explain(plan)
    assert unseen_text(plan.axes[0], plan.period) == ""


def test_the_bus_is_named_as_people_name_it() -> None:
    assert on(TCP).axes[0].bus_name == "sim-modbus-tcp"
    assert plan_of().axes[0].bus_name == "haptic_sim:sim@1000000"
