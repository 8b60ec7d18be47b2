"""The magnet: how far, how strong, how stiff, and what it stores."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError
from scipy.integrate import quad
from scipy.optimize import minimize_scalar

from haptic_fieldbus.scenes.element import abilities
from haptic_fieldbus.scenes.magnet import Magnet
from tests.scenes.leaps import leaps
from tests.scenes.sheet import Motion, forces, given_to_the_hand, spring_leak
from tests.scenes.sheets.magnet import stored

MAGNET = Magnet("handle", pull=2.0, radius=0.012, position=0.015)


def test_its_largest_pull_is_the_one_given() -> None:
    found = minimize_scalar(MAGNET.force, bounds=(0.015, 0.027), options={"xatol": 1e-10})
    assert found.fun == pytest.approx(-2.0, rel=1e-9)
    assert found.x - 0.015 == pytest.approx(0.012 / math.sqrt(5.0), rel=1e-4)


def test_its_slopes_are_within_the_stiffness_that_it_is_judged_by() -> None:
    place = np.linspace(0.0, 0.03, 60_001)
    slope = np.diff([MAGNET.force(float(x)) for x in place]) / np.diff(place)
    assert slope.min() == pytest.approx(-MAGNET.stiffness, rel=1e-5)
    assert slope.max() == pytest.approx(0.8 * MAGNET.stiffness, rel=1e-5)
    np.testing.assert_array_equal(MAGNET.linearised().d, [[-MAGNET.stiffness, 0.0]])


@settings(derandomize=True)
@given(start=st.floats(-0.03, 0.05), end=st.floats(-0.03, 0.05))
def test_its_force_is_what_its_energy_falls_by(start: float, end: float) -> None:
    work, _ = quad(MAGNET.force, start, end, points=[0.003, 0.027], limit=200, epsabs=1e-12)
    assert work == pytest.approx(stored(MAGNET, start) - stored(MAGNET, end), abs=1e-9)


def test_what_it_stores_is_what_its_force_takes_to_go_there() -> None:
    magnet = Magnet("handle", pull=1.2, radius=0.02, position=0.001)
    for place in (-0.03, -0.012, 0.004, 0.0105, 0.05):
        work, _ = quad(magnet.force, magnet.position, place, limit=200, points=[-0.019, 0.021])
        assert magnet.stored(place) - magnet.stored(magnet.position) == pytest.approx(-work, rel=1e-6)


def test_to_leave_it_costs_as_much_as_it_says() -> None:
    cost = -quad(MAGNET.force, 0.015, 0.027)[0]
    assert cost == pytest.approx(MAGNET.stiffness * 0.012**2 / 6.0, rel=1e-9)


def test_beyond_its_radius_there_is_nothing() -> None:
    assert [MAGNET.force(x) for x in (0.0029, 0.0271, -1e300, 1e300)] == [0.0] * 4


def test_its_stiffness_can_be_varied() -> None:
    assert abilities(MAGNET).with_stiffness is not None
    assert MAGNET.with_stiffness(300.0).stiffness == pytest.approx(300.0, rel=1e-15)
    assert MAGNET.with_stiffness(MAGNET.stiffness).pull == pytest.approx(2.0, rel=1e-15)


@settings(derandomize=True)
@given(motion=leaps(5e-3))
def test_it_leaks_when_sampled_no_more_than_a_spring_of_its_steepest_slope(motion: Motion) -> None:
    energy = stored(MAGNET, motion.position[0]) - stored(MAGNET, motion.position[-1])
    given_away = given_to_the_hand(motion, forces(MAGNET, motion), held=True)
    assert given_away <= energy + spring_leak(MAGNET.stiffness, motion) + 1e-12


@pytest.mark.parametrize("wrong", [{"pull": 0.0}, {"radius": 0.0}, {"radius": math.inf}, {"stiffness": 1.0}])
def test_parameters_without_a_meaning_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        TypeAdapter(Magnet).validate_python({"axis": "handle", "pull": 1.0, "radius": 0.01, **wrong})
