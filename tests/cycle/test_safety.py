"""The limiter and the staleness rule, against their definitions."""

import math
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_fieldbus.cycle.safety import bind_limiter, hold_gain
from haptic_fieldbus.planning.limits import EffortLimits

PERIOD = 0.001


def limits(effort: float = 5.0, slew: float = 1e9, fade_in: float = PERIOD) -> EffortLimits:
    return EffortLimits(effort=effort, speed=1.0, slew=slew, fade_in=fade_in)


def test_force_fades_in_linearly_from_the_first_period() -> None:
    limit = bind_limiter(limits(fade_in=0.01), PERIOD)
    assert [limit(1.0) for _ in range(12)] == pytest.approx(
        [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.0, 1.0]
    )


@pytest.mark.parametrize(("asked", "permitted"), [(9.0, 5.0), (-9.0, -5.0), (4.0, 4.0)])
def test_effort_is_clamped_on_both_sides(asked: float, permitted: float) -> None:
    assert bind_limiter(limits(), PERIOD)(asked) == permitted


def test_slew_bounds_the_change_of_a_period_in_both_directions() -> None:
    limit = bind_limiter(limits(slew=1000.0), PERIOD)
    assert [limit(5.0), limit(5.0), limit(-5.0), limit(-5.0)] == pytest.approx([1.0, 2.0, 1.0, 0.0])


@given(st.lists(st.floats(-1e6, 1e6), min_size=2, max_size=50))
def test_no_input_passes_effort_or_slew(asked: list[float]) -> None:
    limit = bind_limiter(limits(slew=2000.0, fade_in=0.02), PERIOD)
    permitted = [0.0, *[limit(value) for value in asked]]
    assert max(abs(value) for value in permitted) <= 5.0
    assert all(abs(b - a) <= 2.0 + 1e-12 for a, b in pairwise(permitted))


def test_stale_feedback_holds_one_period_fades_the_second_and_stops_at_the_third() -> None:
    assert [hold_gain(periods) for periods in range(5)] == [1.0, 1.0, 0.5, None, None]


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("periods_before", [0, 1000])
def test_what_is_not_finite_comes_out_as_no_number_and_leaves_no_trace(value: float, periods_before: int) -> None:
    limit = bind_limiter(limits(), PERIOD)
    for _ in range(periods_before):
        limit(1.0)
    untouched = bind_limiter(limits(), PERIOD)
    for _ in range(periods_before):
        untouched(1.0)
    assert math.isnan(limit(value))
    assert limit(1.0) == untouched(1.0)
