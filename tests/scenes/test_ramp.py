"""The ramp: a straight line between two forces, and nothing around it."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError

from haptic_fieldbus.scenes.ramp import Ramp
from haptic_fieldbus.signals import Signal

SECOND = 1_000_000_000


def test_it_goes_from_start_to_end_within_its_duration() -> None:
    force = Ramp("handle", start=-1.0, end=3.0, duration=2.0, start_delay=1.0).force
    times = np.arange(0.0, 4.0, 0.25)
    expected = np.where((times >= 1.0) & (times < 3.0), np.interp(times, [1.0, 3.0], [-1.0, 3.0]), 0.0)
    np.testing.assert_allclose([force(round(time * SECOND)) for time in times.tolist()], expected, rtol=1e-15)


@settings(derandomize=True)
@given(elapsed=st.integers(0, 10**18 - 1))
def test_over_a_billion_seconds_it_is_still_the_straight_line(elapsed: int) -> None:
    force = Ramp("handle", start=0.0, end=2.0, duration=1e9).force
    assert force(elapsed) == pytest.approx(float(Fraction(2 * elapsed, 10**18)), rel=1e-15)


def test_a_duration_below_a_nanosecond_plays_nothing() -> None:
    force = Ramp("handle", start=1.0, end=2.0, duration=1e-12).force
    assert [force(time) for time in (0, 1, SECOND)] == [0.0, 0.0, 0.0]


def test_it_needs_the_time_alone_and_no_motion_changes_it() -> None:
    ramp = Ramp("handle", start=1.0, end=2.0, duration=1.0)
    assert ramp.needs == (Signal.ELAPSED_NS,)
    assert not ramp.linearised().d.any()


@pytest.mark.parametrize("wrong", [{"duration": 0.0}, {"start_delay": -0.1}, {"end": float("nan")}, {"magnitude": 1.0}])
def test_parameters_without_a_meaning_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ValidationError):
        TypeAdapter(Ramp).validate_python({"axis": "handle", "start": 1.0, "end": 2.0, "duration": 1.0, **wrong})


def test_the_envelope_scales_the_line() -> None:
    """Attack from a fifth within 10 ms, fade to nothing within the last 20 ms, the line 1 N to 3 N in 100 ms."""
    law = Ramp("handle", 1.0, 3.0, 0.1, attack_level=0.2, attack_time=0.01, fade_time=0.02).force
    for ms, level in ((0, 0.2), (5, 0.6), (10, 1.0), (50, 1.0), (80, 1.0), (90, 0.5), (99, 0.05)):
        assert law(ms * 1_000_000) == pytest.approx(level * (1.0 + 0.02 * ms))
    assert law(100_000_000) == 0.0


def test_an_envelope_that_does_not_fit_is_refused() -> None:
    with pytest.raises(ValueError, match=r"attack_time 0\.08 and fade_time 0\.04"):
        Ramp("handle", 1.0, 3.0, 0.1, attack_time=0.08, fade_time=0.04)
