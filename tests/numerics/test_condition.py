"""Conditions: dead band, coefficients and saturation against a plain piecewise definition."""

import math
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptic_fieldbus.numerics.condition import Side, bind, check_coefficients

numbers = st.floats(-5.0, 5.0)
sides = st.builds(Side, st.floats(0.0, 9.0), st.floats(0.0, 3.0), st.just(math.inf) | st.floats(0.1, 4.0))


def plain(metric: float, rate: float, neutral: float, dead_band: float, positive: Side, negative: Side) -> float:
    """As the standard says it, in one expression a side."""
    away = metric - neutral
    side, sign = (negative, -1.0) if away < -dead_band else (positive, 1.0)
    if abs(away) <= dead_band and dead_band:
        return 0.0
    unlimited = -side.coefficient * (away - sign * dead_band) - side.damping * rate
    return max(-side.saturation, min(side.saturation, unlimited))


@settings(derandomize=True)
@given(metric=numbers, rate=numbers, neutral=numbers, dead_band=st.floats(0.0, 2.0), positive=sides, negative=sides)
def test_it_is_the_condition_of_the_standard(
    metric: float, rate: float, neutral: float, dead_band: float, positive: Side, negative: Side
) -> None:
    expected = plain(metric, rate, neutral, dead_band, positive, negative)
    rates = (rate,) if positive.damping or negative.damping else ()
    assert bind(neutral, dead_band, positive, negative)(metric, *rates) == pytest.approx(expected, abs=1e-12)


@settings(derandomize=True)
@given(metric=numbers, rate=numbers, side=sides)
def test_equal_sides_are_odd(metric: float, rate: float, side: Side) -> None:
    force = bind(0.0, 0.3, side, side)
    assert force(-metric, -rate) == -force(metric, rate)


@settings(derandomize=True)
@given(metric=numbers, rate=numbers, positive=sides, negative=sides)
def test_damping_never_adds_power_whatever_is_limited(
    metric: float, rate: float, positive: Side, negative: Side
) -> None:
    damped = bind(0.0, 0.2, positive, negative)
    undamped = bind(0.0, 0.2, replace(positive, damping=0.0), replace(negative, damping=0.0))
    assert damped(metric, rate) * rate <= undamped(metric, rate) * rate


@pytest.mark.parametrize("dead_band", [0.0, 0.1])
@pytest.mark.parametrize("saturation", [math.inf, 2.0])
@pytest.mark.parametrize("damping", [0.0, 1.0])
def test_what_is_no_number_stays_none(dead_band: float, saturation: float, damping: float) -> None:
    side = Side(1.0, damping, saturation)
    rate = (0.5,) if damping else ()
    assert math.isnan(bind(0.0, dead_band, side, side)(math.nan, *rate))


def test_a_rate_that_is_no_number_gives_no_force() -> None:
    side = Side(1.0, 1.0, 2.0)
    assert math.isnan(bind(0.0, 0.0, side, side)(0.3, math.nan))


def test_without_a_dead_band_the_damping_acts_at_the_neutral_value_too() -> None:
    """A quantised position is often exactly there."""
    assert bind(0.1, 0.0, Side(5.0, 2.0, 9.0), Side(3.0, 2.0, 9.0))(0.1, 0.5) == -1.0


@pytest.mark.parametrize(("positive", "negative"), [(1.0, 1.0), (1.0, 0.0), (0.3, 1.0)])
def test_one_coefficient_of_one_is_enough(positive: float, negative: float) -> None:
    check_coefficients(positive, negative, "stiffness")


def test_two_smaller_coefficients_are_refused_in_a_sentence() -> None:
    with pytest.raises(
        ValueError, match=r"positive_coefficient 0\.5, negative_coefficient 0\.2: expected 1 for the stronger side"
    ):
        check_coefficients(0.5, 0.2, "stiffness")
