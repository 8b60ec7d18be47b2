"""The braking pulse: when it begins, how long it lasts, and that it only brakes."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError

from haptic_fieldbus.scenes.braking_pulse import BrakingPulse
from haptic_fieldbus.signals import Signal

PERIOD = 1e-3
PULSE = BrakingPulse("handle", damping=10.0, duration=0.005, rearm=0.01, position=0.02)


def braked(places: list[float], pulse: BrakingPulse = PULSE) -> list[bool]:
    """In which periods it brakes a handle of 1 m/s."""
    law = pulse.begin(PERIOD)
    return [law(place, 1.0) != 0.0 for place in places]


def test_it_brakes_for_its_duration_after_the_crossing() -> None:
    assert braked([0.0, 0.015, *[0.021] * 8]) == [False, False, *[True] * 5, *[False] * 3]


def test_a_crossing_from_the_other_side_counts_too() -> None:
    assert braked([0.04, 0.025, *[0.019] * 6]) == [False, False, *[True] * 5, False]


def test_reaching_the_place_is_crossing_it() -> None:
    assert braked([0.0, 0.02]) == [False, True]


def test_a_crossing_between_two_samples_is_seen_at_any_speed() -> None:
    assert braked([-1e3, 1e3]) == [False, True]


def test_a_handle_that_jitters_on_the_place_gives_one_pulse() -> None:
    assert sum(braked([0.0, *[0.021, 0.019] * 20])) == 5


def test_it_is_armed_again_by_going_far_enough_away() -> None:
    away_and_back = [0.0, *[0.021] * 6, 0.031, *[0.019] * 6]
    assert braked(away_and_back) == [False, *[True] * 5, False, False, *[True] * 5, False]


def test_beginning_too_near_it_is_not_armed() -> None:
    assert not any(braked([0.019, 0.021, 0.019, 0.02]))


def test_a_crossing_during_a_pulse_begins_it_anew() -> None:
    assert braked([0.0, 0.031, 0.031, 0.009, *[0.009] * 6]) == [False, *[True] * 7, False, False]


def test_it_opposes_the_speed_up_to_its_saturation_and_no_standing_handle() -> None:
    pulse = BrakingPulse("handle", damping=100.0, duration=1.0, rearm=0.01, saturation=3.0)
    law = pulse.begin(PERIOD)
    law(-0.05, 0.0)
    assert [law(0.001, speed) for speed in (0.5, -0.5, 0.01, 0.0)] == [-3.0, 3.0, -1.0, 0.0]


@settings(derandomize=True)
@given(
    places=st.lists(st.floats(-0.1, 0.1), min_size=2, max_size=60),
    speeds=st.lists(st.floats(-1e3, 1e3), min_size=60, max_size=60),
)
def test_it_never_gives_power(places: list[float], speeds: list[float]) -> None:
    law = PULSE.begin(PERIOD)
    assert all(law(place, speed) * speed <= 0.0 for place, speed in zip(places, speeds, strict=False))


def test_a_mass_that_crosses_loses_the_speed_of_the_closed_form() -> None:
    """v·e^(−B·t/m), in continuous time."""
    mass, fine = 0.5, 1e-5
    law, position, speed = PULSE.begin(fine), 0.0, 0.4
    for _ in range(20_000):
        speed += law(position, speed) / mass * fine
        position += speed * fine
    assert speed == pytest.approx(0.4 * math.exp(-10.0 * 0.005 / mass), rel=1e-4)


@pytest.mark.parametrize(("duration", "periods"), [(1e-9, 1), (0.0004, 1), (0.0026, 3), (1e300, 500)])
def test_its_duration_is_a_whole_number_of_periods_and_at_least_one(duration: float, periods: int) -> None:
    pulse = BrakingPulse("handle", damping=10.0, duration=duration, rearm=0.01)
    assert sum(braked([-0.02, *[0.001] * 500], pulse)) == periods


def test_two_laws_share_no_memory() -> None:
    first, second = PULSE.begin(PERIOD), PULSE.begin(PERIOD)
    first(0.0, 1.0)
    first(0.021, 1.0)
    assert second(0.021, 1.0) == 0.0


def test_a_place_that_is_no_number_gives_a_force_that_is_none() -> None:
    assert math.isnan(PULSE.begin(PERIOD)(math.nan, 0.0))


def test_stability_is_judged_as_if_the_pulse_lasted() -> None:
    assert PULSE.needs == (Signal.POSITION, Signal.VELOCITY)
    np.testing.assert_array_equal(PULSE.linearised().d, [[0.0, -10.0]])


@pytest.mark.parametrize(
    "wrong",
    [{"damping": 0.0}, {"duration": 0.0}, {"rearm": 0.0}, {"saturation": 0.0}, {"position": math.nan}, {"mass": 1.0}],
)
def test_parameters_without_a_meaning_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ValidationError):
        TypeAdapter(BrakingPulse).validate_python(
            {"axis": "handle", "damping": 1.0, "duration": 0.01, "rearm": 0.01, **wrong}
        )
