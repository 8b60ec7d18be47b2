"""Textures: the shape of their ridges, their energy, and the slope that they are judged by."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError
from scipy.integrate import quad

from haptic_fieldbus.scenes.element import abilities
from haptic_fieldbus.scenes.texture import Texture
from tests.scenes.leaps import leaps
from tests.scenes.sheet import Motion, forces, given_to_the_hand, spring_leak
from tests.scenes.sheets.texture import stored

SINE = Texture("handle", amplitude=0.5, pitch=0.004)
TRIANGLE = Texture("handle", amplitude=0.5, pitch=0.004, profile="triangle", rounding=0.25)
ROUND = Texture("handle", amplitude=0.5, pitch=0.004, profile="triangle", rounding=1.0)
ALL = (SINE, TRIANGLE, ROUND)


def test_a_triangle_has_straight_flanks_between_a_rounded_valley_and_a_rounded_crest() -> None:
    eighths = [TRIANGLE.force(0.004 * eighth / 8.0) for eighth in (0, 0.25, 0.5, 1, 2, 3, 3.5, 3.75, 4)]
    assert eighths == pytest.approx([0.0, -0.25, -0.5, -0.5, -0.5, -0.5, -0.5, -0.25, 0.0], abs=1e-12)
    assert TRIANGLE.force(0.003) == 0.5


def test_a_sine_is_one() -> None:
    for place in (0.0, 0.0007, 0.0025, -0.0011):
        assert SINE.force(place) == pytest.approx(-0.5 * math.sin(2.0 * math.pi * place / 0.004), abs=1e-12)


@pytest.mark.thorough("3 cases of one rule", quick=1)
@pytest.mark.parametrize("texture", ALL)
def test_no_slope_is_steeper_than_the_stiffness_that_it_is_judged_by(texture: Texture) -> None:
    place = np.linspace(-0.01, 0.01, 50_001)
    slope = np.diff([texture.force(float(x)) for x in place]) / np.diff(place)
    assert np.abs(slope).max() == pytest.approx(texture.stiffness, rel=1e-5)
    np.testing.assert_array_equal(texture.linearised().d, [[-texture.stiffness, 0.0]])


@settings(derandomize=True)
@given(start=st.floats(-0.006, 0.006), end=st.floats(-0.006, 0.006), texture=st.sampled_from(ALL))
def test_its_force_is_what_its_energy_falls_by(start: float, end: float, texture: Texture) -> None:
    kinks = [0.002 * half + side * texture.rounding * 0.001 for half in range(-3, 4) for side in (-1.0, 1.0)]
    work, _ = quad(texture.force, start, end, points=kinks, limit=400, epsabs=1e-12)
    assert work == pytest.approx(stored(texture, start) - stored(texture, end), abs=1e-10)


@pytest.mark.parametrize("texture", ALL)
def test_its_stiffness_can_be_varied(texture: Texture) -> None:
    assert abilities(texture).with_stiffness is not None
    assert texture.with_stiffness(300.0).stiffness == pytest.approx(300.0, rel=1e-15)
    assert texture.with_stiffness(texture.stiffness).amplitude == pytest.approx(0.5, rel=1e-15)


@settings(derandomize=True)
@given(motion=leaps(5e-3), texture=st.sampled_from(ALL))
def test_it_leaks_when_sampled_no_more_than_a_spring_of_its_steepest_slope(motion: Motion, texture: Texture) -> None:
    energy = stored(texture, motion.position[0]) - stored(texture, motion.position[-1])
    given_away = given_to_the_hand(motion, forces(texture, motion), held=True)
    assert given_away <= energy + spring_leak(texture.stiffness, motion) + 1e-12


@settings(derandomize=True)
@given(place=st.floats(-1e300, 1e300), texture=st.sampled_from(ALL))
def test_its_force_is_bounded_anywhere(place: float, texture: Texture) -> None:
    assert abs(texture.force(place)) <= 0.5


def test_faster_than_half_a_pitch_a_period_it_feels_as_other_ridges() -> None:
    """At 1 kHz and 0.9 pitches a period: ridges of ten periods, passed backwards."""
    found = [SINE.force(0.9 * 0.004 * k) for k in range(40)]
    ghost = [0.5 * math.sin(2.0 * math.pi * 0.1 * k) for k in range(40)]
    assert found == pytest.approx(ghost, abs=1e-9)


@pytest.mark.parametrize(
    "wrong", [{"amplitude": 0.0}, {"pitch": 0.0}, {"rounding": 0.0}, {"rounding": 1.5}, {"profile": "saw"}]
)
def test_parameters_without_a_meaning_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        TypeAdapter(Texture).validate_python({"axis": "handle", "amplitude": 1.0, "pitch": 0.01, **wrong})
