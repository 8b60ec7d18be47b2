"""The grating: friction of the place, paid once and never given back."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from pydantic import TypeAdapter, ValidationError
from scipy.integrate import quad

from haptic_fieldbus.scenes.grating import Grating
from tests.scenes.leaps import along, leaps
from tests.scenes.sheet import Motion, forces, given_to_the_hand, spring_leak

GRATING = Grating("handle", coulomb=0.8, stiffness=1e4, pitch=0.004, depth=0.6)


def friction(place: float) -> float:
    return 0.8 * (1.0 + 0.6 * math.sin(2.0 * math.pi * place / 0.004))


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_sliding_it_is_the_friction_of_the_place(way: float) -> None:
    motion = along([0.0, way * 0.03], 3000)
    slid = slice(200, None)
    exact = [-way * friction(float(place)) for place in motion.position[slid]]
    np.testing.assert_allclose(forces(GRATING, motion)[slid], exact, atol=1e-12)


def test_a_pitch_costs_the_integral_of_its_friction_both_ways() -> None:
    motion = along([0.0, 0.012, 0.008, 0.012], 20_000)
    force = forces(GRATING, motion)
    there = Motion(1e-3, motion.position[10_000:20_001], motion.velocity[10_000:20_001])
    work = -given_to_the_hand(there, force[10_000:20_001], held=False)
    assert work == pytest.approx(quad(friction, 0.006, 0.012)[0], rel=1e-6)
    assert (force[10_000:20_000] < 0.0).all()
    assert (force[22_000:40_000] > 0.0).all()


def test_it_holds_like_a_spring_below_its_friction() -> None:
    law = GRATING.begin(1e-3)
    assert [law(place) for place in (0.0, 5e-5, -2e-5, 0.0)] == pytest.approx([0.0, -0.5, 0.2, 0.0], abs=1e-9)


@settings(derandomize=True)
@given(motion=leaps(3e-3))
def test_it_leaks_when_sampled_no_more_than_its_spring_and_is_bounded(motion: Motion) -> None:
    force = forces(GRATING, motion)
    assert np.abs(force).max() <= 0.8 * 1.6 * (1.0 + 1e-12)
    assert given_to_the_hand(motion, force, held=True) <= spring_leak(1e4, motion) * (1.0 + 1e-9) + 1e-15


def test_a_position_that_is_no_number_gives_a_force_that_is_none() -> None:
    law = GRATING.begin(1e-3)
    law(0.0)
    assert math.isnan(law(math.nan))


@pytest.mark.parametrize("wrong", [{"coulomb": 0.0}, {"pitch": 0.0}, {"depth": 0.0}, {"depth": 1.1}])
def test_parameters_without_a_meaning_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        TypeAdapter(Grating).validate_python(
            {"axis": "handle", "coulomb": 1.0, "stiffness": 600.0, "pitch": 0.01, **wrong}
        )
