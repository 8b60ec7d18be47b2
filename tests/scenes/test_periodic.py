"""The waves: exact at any clock, with envelope, delay and duration, against an independent computation."""

import math
from fractions import Fraction
from typing import Literal, get_args, get_type_hints

import numpy as np
import pytest
import scipy.integrate
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError

from haptic_fieldbus.numerics.waves import WAVEFORMS
from haptic_fieldbus.scenes.periodic import Periodic
from haptic_fieldbus.signals import Signal

SECOND = 1_000_000_000
Waveform = Literal["sine", "square", "triangle", "saw_up", "saw_down"]
FORMS: tuple[Waveform, ...] = get_args(Waveform)


def test_a_file_may_name_every_form_there_is_and_no_other() -> None:
    assert get_args(get_type_hints(Periodic)["waveform"]) == tuple(WAVEFORMS) == FORMS


@settings(derandomize=True)
@given(elapsed=st.integers(0, 10**18), frequency=st.floats(0.01, 2000.0), phase=st.floats(-1.0, 1.0))
@pytest.mark.parametrize("waveform", FORMS)
def test_it_is_offset_and_magnitude_times_its_form_at_the_exact_turn(
    waveform: Waveform, elapsed: int, frequency: float, phase: float
) -> None:
    turn = float((Fraction(elapsed, SECOND) * Fraction(frequency) + Fraction(phase)) % 1)
    force = Periodic("handle", 2.0, frequency, waveform, offset=0.5, phase=phase).force
    assert force(elapsed) == 0.5 + 2.0 * WAVEFORMS[waveform](turn)


def test_it_has_the_power_of_a_sine() -> None:
    """Mean square A²/2 over whole periods."""
    force = Periodic("handle", magnitude=3.0, frequency=4.0).force
    assert np.mean([force(k * 1_000_000) ** 2 for k in range(1000)]) == pytest.approx(4.5)


def test_pushing_a_free_mass_it_gives_the_energy_of_the_closed_form() -> None:
    """m·ẍ = A·sin ωt from rest: v = A/(m·ω)·(1 − cos ωt)."""
    mass, turn = 0.5, 2.0 * math.pi * 3.0
    force = Periodic("handle", magnitude=2.0, frequency=3.0).force
    time = np.linspace(0.0, 1.0, 21)
    found = scipy.integrate.solve_ivp(
        lambda t, y: [force(round(t * SECOND)) / mass], (0.0, 1.0), [0.0], t_eval=time, rtol=1e-9, atol=1e-12
    )
    np.testing.assert_allclose(found.y[0], 2.0 / (mass * turn) * (1.0 - np.cos(turn * time)), atol=1e-7)


def test_the_envelope_moves_the_amplitude_but_not_the_offset() -> None:
    wave = Periodic("handle", 2.0, 1.0, "square", offset=5.0, duration=4.0, attack_time=1.0, fade_time=1.0)
    times = [0.0, 0.25, 0.75, 1.0, 2.5, 3.25, 3.75, 4.0]
    expected = [5.0, 5.5, 3.5, 7.0, 5.0 - 2.0 * 1.0, 5.0 + 2.0 * 0.75, 5.0 - 2.0 * 0.25, 0.0]
    assert [wave.force(round(time * SECOND)) for time in times] == pytest.approx(expected)


def test_its_phase_begins_with_the_effect_not_with_the_clock() -> None:
    wave = Periodic("handle", 2.0, 10.0, "saw_up", start_delay=0.123)
    assert [wave.force(round(time * SECOND)) for time in (0.122, 0.123, 0.173)] == pytest.approx([0.0, -2.0, 0.0])


@settings(derandomize=True)
@given(elapsed=st.integers(0, 10**18))
@pytest.mark.parametrize("waveform", FORMS)
def test_it_never_exceeds_what_it_states(waveform: Waveform, elapsed: int) -> None:
    wave = Periodic(
        "handle", 2.0, 7.3, waveform, offset=-1.0, duration=1e10, attack_level=3.0, attack_time=1e9, start_delay=0.1
    )
    assert abs(wave.force(elapsed)) <= 1.0 + wave.envelope.peak == 4.0


def test_it_needs_the_time_alone_and_no_motion_changes_it() -> None:
    wave = Periodic("handle", magnitude=1.0, frequency=1.0)
    assert wave.needs == (Signal.ELAPSED_NS,)
    assert not wave.linearised().d.any()


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"frequency": 0.0}, "greater than"),
        ({"magnitude": 0.0}, "greater than"),
        ({"waveform": "cosine"}, "sine"),
        ({"fade_time": 1.0}, "expected a duration too"),
        ({"fade_level": 1.0, "duration": 1.0}, "expected a fade_time too"),
        ({"phase": math.nan}, "finite"),
        ({"period": 1.0}, "period"),
    ],
)
def test_parameters_without_a_meaning_are_refused(wrong: dict[str, object], words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        TypeAdapter(Periodic).validate_python({"axis": "handle", "magnitude": 2.0, "frequency": 5.0, **wrong})
