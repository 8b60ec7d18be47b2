"""Detents against the pendulum that they are, and against their energy."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError
from scipy.integrate import quad, solve_ivp
from scipy.special import ellipk

from haptic_fieldbus.scenes.detents import Detents
from haptic_fieldbus.scenes.element import abilities
from tests.scenes.leaps import leaps
from tests.scenes.sheet import Motion, forces, given_to_the_hand, spring_leak
from tests.scenes.sheets.detents import stored

ENDLESS = Detents("handle", amplitude=1.5, pitch=0.008, position=0.003)
THREE = Detents("handle", amplitude=1.2, pitch=0.02, position=-0.02, count=3)


@pytest.mark.thorough("3 cases of one rule", quick=1)
@pytest.mark.parametrize("swing", [0.01, 0.5, 2.5])
def test_a_handle_swings_in_a_valley_as_a_pendulum(swing: float) -> None:
    """With θ = 2π·x/p the period is 4·K(sin²(θ₀/2))/ω, ω = √(2π·A/(p·m)); the first comes to rest 1/2 of it later."""
    mass, phase = 0.4, 0.008 / (2.0 * math.pi)
    turn = math.sqrt(2.0 * math.pi * 1.5 / (0.008 * mass))
    period = 4.0 * ellipk(math.sin(0.5 * swing) ** 2) / turn
    found = solve_ivp(
        lambda t, y: (y[1], ENDLESS.force(y[0]) / mass),
        (0.0, 5.25 * period),
        [0.003 + swing * phase, 0.0],
        rtol=1e-10,
        atol=1e-13,
        events=lambda t, y: y[0] - 0.003,
    )
    crossings = found.t_events[0]
    assert np.diff(crossings) == pytest.approx(0.5 * period, rel=1e-6)
    assert len(crossings) == 11


@settings(derandomize=True)
@given(start=st.floats(-0.05, 0.05), end=st.floats(-0.05, 0.05), detents=st.sampled_from([ENDLESS, THREE]))
def test_its_force_is_what_its_energy_falls_by(start: float, end: float, detents: Detents) -> None:
    work, _ = quad(detents.force, start, end, points=[-0.03, 0.03], limit=200, epsabs=1e-12)
    assert work == pytest.approx(stored(detents, start) - stored(detents, end), abs=1e-9)


def test_a_ridge_costs_as_much_as_it_says() -> None:
    assert -quad(ENDLESS.force, 0.003, 0.007)[0] == pytest.approx(1.5 * 0.008 / math.pi, rel=1e-9)


@pytest.mark.thorough("2 cases of one rule", quick=1)
@pytest.mark.parametrize("detents", [ENDLESS, THREE])
def test_no_slope_is_steeper_than_the_stiffness_that_it_is_judged_by(detents: Detents) -> None:
    place = np.linspace(-0.05, 0.05, 100_001)
    slope = np.diff([detents.force(float(x)) for x in place]) / np.diff(place)
    assert np.abs(slope).max() == pytest.approx(detents.stiffness, rel=1e-5)
    assert -slope[np.searchsorted(place, detents.position)] == pytest.approx(detents.stiffness, rel=1e-5)
    np.testing.assert_array_equal(detents.linearised().d, [[-detents.stiffness, 0.0]])


def test_its_stiffness_can_be_varied() -> None:
    assert abilities(ENDLESS).with_stiffness is not None
    assert ENDLESS.with_stiffness(100.0).stiffness == pytest.approx(100.0, rel=1e-15)
    assert ENDLESS.with_stiffness(100.0).pitch == 0.008
    assert ENDLESS.with_stiffness(ENDLESS.stiffness).amplitude == pytest.approx(1.5, rel=1e-15)


def test_there_are_as_many_valleys_as_counted_and_no_force_beyond() -> None:
    place = np.linspace(-0.1, 0.1, 20_002)
    force = np.array([THREE.force(float(x)) for x in place])
    valleys = place[1:][(force[:-1] > 0.0) & (force[1:] <= 0.0)]
    np.testing.assert_allclose(valleys, [-0.02, 0.0, 0.02], atol=2e-5)
    assert not force[np.abs(place) >= 0.03].any()
    assert np.abs(np.diff(force)).max() <= THREE.stiffness * (place[1] - place[0])


def test_a_knob_feels_the_same_after_a_million_turns() -> None:
    """Pitches are counted off exactly, so that no phase is lost."""
    pitch = 2.0**-3
    knob = Detents("knob", amplitude=0.02, pitch=pitch)
    for place in (0.01, 0.03, -0.05):
        assert knob.force(place + 2**20 * pitch) == pytest.approx(knob.force(place), rel=1e-8)
    assert abs(knob.force(1e300)) <= 0.02


@settings(derandomize=True)
@given(motion=leaps(5e-3), detents=st.sampled_from([ENDLESS, THREE]))
def test_it_leaks_when_sampled_no_more_than_a_spring_of_its_steepest_slope(motion: Motion, detents: Detents) -> None:
    energy = stored(detents, motion.position[0]) - stored(detents, motion.position[-1])
    given_away = given_to_the_hand(motion, forces(detents, motion), held=True)
    assert given_away <= energy + spring_leak(detents.stiffness, motion) + 1e-12


@pytest.mark.parametrize(
    "wrong",
    [{"amplitude": 0.0}, {"pitch": 0.0}, {"pitch": math.inf}, {"count": -1}, {"count": 1.5}, {"stiffness": 1.0}],
)
def test_parameters_without_a_meaning_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        TypeAdapter(Detents).validate_python({"axis": "handle", "amplitude": 1.0, "pitch": 0.01, **wrong})
