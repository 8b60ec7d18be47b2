"""Waves in time: exact phase at any clock, forms against scipy, envelopes against their corners."""

import math
from decimal import Decimal
from fractions import Fraction

import mpmath
import numpy as np
import pytest
import scipy.signal
from hypothesis import given, settings
from hypothesis import strategies as st

from haptic_fieldbus.numerics.waves import SECOND, WAVEFORMS, Envelope, nanoseconds, played, turns

LONG = 10**9 * SECOND
"""A billion seconds, about 32 years [ns]."""
frequencies = st.floats(1e-3, 5e3)
phases = st.floats(-2.0, 2.0)


def exact(elapsed: int, frequency: float, phase: float) -> Fraction:
    return (Fraction(elapsed, SECOND) * Fraction(frequency) + Fraction(phase)) % 1


@settings(derandomize=True)
@given(elapsed=st.integers(0, 2 * LONG), frequency=frequencies, phase=phases)
def test_the_turn_is_the_exact_one_correctly_rounded_at_any_clock(elapsed: int, frequency: float, phase: float) -> None:
    assert turns(frequency, phase)(elapsed) == float(exact(elapsed, frequency, phase))


@pytest.mark.parametrize("frequency", [0.1, 7.3, 50.0, 440.0, 1234.5678])
def test_after_a_billion_seconds_a_sine_is_as_exact_as_at_the_start(frequency: float) -> None:
    """Against 60 digits; floating-point time would be wrong by whole turns of these."""
    turn, sine = turns(frequency, 0.125), WAVEFORMS["sine"]
    with mpmath.workdps(60):
        for elapsed in range(LONG, LONG + 3_000_000, 333_333):
            angle = 2 * mpmath.pi * (mpmath.mpf(frequency) * elapsed / SECOND + mpmath.mpf("0.125"))
            assert sine(turn(elapsed)) == pytest.approx(float(mpmath.sin(angle)), abs=2e-15)


def test_a_clock_in_floating_point_would_not_do() -> None:
    """Reason for whole numbers: at 32 years seconds as a float are 0.1 µs apart."""
    frequency, elapsed = 1234.5678, LONG + 1
    naive = (elapsed / SECOND * frequency) % 1.0
    assert abs(naive - float(exact(elapsed, frequency, 0.0))) > 1e-5
    assert turns(frequency, 0.0)(elapsed) == float(exact(elapsed, frequency, 0.0))


@pytest.mark.parametrize("frequency", [5e-324, 1e-300, 1e300, 1.7e308])
def test_absurd_frequencies_have_a_turn(frequency: float) -> None:
    for elapsed in (0, 1, SECOND, LONG):
        assert turns(frequency, 0.3)(elapsed) == float(exact(elapsed, frequency, 0.3))


@pytest.mark.parametrize(
    ("waveform", "reference"),
    [
        ("square", lambda angle: scipy.signal.square(angle)),
        ("saw_up", lambda angle: scipy.signal.sawtooth(angle, 1.0)),
        ("saw_down", lambda angle: scipy.signal.sawtooth(angle, 0.0)),
        ("triangle", lambda angle: scipy.signal.sawtooth(angle + math.pi, 0.5)),
        ("sine", np.sin),
    ],
)
def test_forms_are_those_of_scipy(waveform: str, reference: object) -> None:
    turn = np.arange(1, 1000, 2) / 1000.0  # between the jumps
    found = [WAVEFORMS[waveform](each) for each in turn.tolist()]
    assert callable(reference)
    np.testing.assert_allclose(found, reference(2.0 * math.pi * turn), atol=1e-12)


@pytest.mark.parametrize(
    ("waveform", "quarters"),
    [
        ("sine", [0.0, 1.0, 0.0, -1.0]),
        ("square", [1.0, 1.0, -1.0, -1.0]),
        ("triangle", [1.0, 0.0, -1.0, 0.0]),
        ("saw_up", [-1.0, -0.5, 0.0, 0.5]),
        ("saw_down", [1.0, 0.5, 0.0, -0.5]),
    ],
)
def test_forms_begin_where_directinput_says(waveform: str, quarters: list[float]) -> None:
    assert [WAVEFORMS[waveform](quarter / 4) for quarter in range(4)] == pytest.approx(quarters, abs=1e-15)


@settings(derandomize=True)
@given(turn=st.floats(0.0, 1.0))
@pytest.mark.parametrize("waveform", WAVEFORMS)
def test_no_form_leaves_its_bounds(waveform: str, turn: float) -> None:
    assert -1.0 <= WAVEFORMS[waveform](turn) <= 1.0


FULL = Envelope(4.0, duration=1.0, attack_level=1.0, attack_time=0.2, fade_level=2.0, fade_time=0.4)


def test_an_envelope_goes_through_its_corners_on_straight_lines() -> None:
    times = np.concatenate([np.arange(0.0, 1.0, 0.05), [0.1999, 0.2001, 0.5999, 0.6001, 0.9999]])
    found = [FULL.amplitude()(nanoseconds(time)) for time in times.tolist()]
    np.testing.assert_allclose(found, np.interp(times, [0.0, 0.2, 0.6, 1.0], [1.0, 4.0, 4.0, 2.0]), rtol=1e-12)


def test_an_envelope_without_a_fade_lasts() -> None:
    attack = Envelope(4.0, attack_time=0.2)
    assert [attack.amplitude()(time) for time in (0, SECOND // 10, SECOND, LONG)] == [0.0, 2.0, 4.0, 4.0]


def test_only_an_envelope_with_attack_or_fade_is_not_flat() -> None:
    assert Envelope(4.0, duration=1.0).is_flat
    assert not FULL.is_flat
    assert not Envelope(4.0, attack_time=0.1).is_flat


@settings(derandomize=True)
@given(
    levels=st.tuples(*[st.floats(0.0, 9.0)] * 3),
    times=st.tuples(*[st.floats(1e-6, 0.5)] * 2),
    elapsed=st.integers(0, SECOND - 1),
)
def test_an_amplitude_stays_between_its_levels(
    levels: tuple[float, float, float], times: tuple[float, float], elapsed: int
) -> None:
    envelope = Envelope(levels[0], 1.0, levels[1], times[0], levels[2], times[1])
    assert min(levels) - 1e-12 <= envelope.amplitude()(elapsed) <= envelope.peak + 1e-12


@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [
        ({"fade_time": 0.5}, "fade_time 0.5: expected a duration too"),
        ({"duration": 1.0, "attack_time": 0.7, "fade_time": 0.4}, "attack_time 0.7 and fade_time 0.4: expected"),
        ({"attack_level": 2.0}, "attack_level 2: expected an attack_time too"),
        ({"duration": 1.0, "fade_level": 2.0}, "fade_level 2: expected a fade_time too"),
    ],
)
def test_an_envelope_that_contradicts_itself_is_refused(wrong: dict[str, float], sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        Envelope(1.0, **wrong)


def test_an_effect_plays_from_its_delay_on_for_its_duration() -> None:
    effect = played(lambda elapsed: 1.0 + elapsed, start_delay=0.5, duration=0.25)
    begin, end = SECOND // 2, 3 * SECOND // 4
    assert [effect(time) for time in (0, begin - 1, begin, end - 1, end)] == [0.0, 0.0, 1.0, 0.25 * SECOND, 0.0]


def test_an_effect_that_always_plays_is_itself() -> None:
    effect = turns(7.0, 0.0)
    assert played(effect, 0.0, None) is effect
    assert played(lambda elapsed: 2.0, 0.5, None)(LONG) == 2.0


@settings(derandomize=True)
@given(attack=st.integers(1, 10_000), fade=st.integers(1, 10_000), digits=st.integers(1, 6))
def test_times_that_fill_the_duration_fit_into_it(attack: int, fade: int, digits: int) -> None:
    """Decimals as in a file, such as 0.1 s and 0.2 s in 0.3 s."""
    one, other, whole = (float(Decimal(each).scaleb(-digits)) for each in (attack, fade, attack + fade))
    amplitude = Envelope(2.0, whole, attack_time=one, fade_time=other).amplitude()
    assert amplitude(nanoseconds(one)) == 2.0
    assert amplitude(nanoseconds(whole)) == 0.0
    with pytest.raises(ValueError, match="expected to fit"):
        Envelope(2.0, whole - 2e-9, attack_time=one, fade_time=other)
