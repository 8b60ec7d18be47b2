"""The standard linear solid: relaxation, creep of its surface, and what stability is told."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError

from haptic_fieldbus.margins import Plant, stiffness_limit
from haptic_fieldbus.numerics.linear import gain
from haptic_fieldbus.numerics.sampled import environment
from haptic_fieldbus.scenes.generalised_maxwell import GeneralisedMaxwell
from haptic_fieldbus.scenes.standard_linear_solid import StandardLinearSolid
from haptic_fieldbus.signals import Signal
from tests.lanes import examples

PERIOD = 1e-3
TISSUE = StandardLinearSolid("handle", rest=150.0, branch=300.0, time=0.05, position=0.01)


def test_after_a_press_it_relaxes_as_the_closed_form() -> None:
    """F = −D·(k₀ + k·g·e^(−t/τ)); g = τ/T·(1 − e^(−T/τ)) for the ramp of one period that the press is."""
    force = TISSUE.begin(PERIOD)
    force(0.01)
    ramp = -math.expm1(-PERIOD / 0.05) * 0.05 / PERIOD
    for n in range(300):
        exact = -2e-3 * (150.0 + 300.0 * ramp * math.exp(-n * PERIOD / 0.05))
        assert force(0.012) == pytest.approx(exact, rel=1e-12)


def test_it_is_the_generalised_maxwell_tissue_of_one_branch() -> None:
    one = GeneralisedMaxwell("handle", rest=150.0, branches=((300.0, 0.05),), position=0.01).begin(PERIOD)
    two = TISSUE.begin(PERIOD)
    for n in range(300):
        x = 0.01 + 0.005 * math.sin(0.1 * n)
        assert one(x) == two(x)


@settings(derandomize=True, max_examples=examples(100))
@given(depths=st.lists(st.floats(-1e3, 1e3), max_size=30), time=st.floats(1e-9, 1e3))
def test_it_never_pulls(depths: list[float], time: float) -> None:
    left = StandardLinearSolid("handle", rest=150.0, branch=300.0, time=time).begin(PERIOD)
    right = StandardLinearSolid("handle", rest=150.0, branch=300.0, time=time, side="negative").begin(PERIOD)
    for depth in depths:
        found = left(depth)
        assert found <= 0.0
        assert right(-depth) == -found


@pytest.mark.parametrize(("time", "felt"), [(1e9, 450.0), (1e-9, 150.0)])
def test_its_limit_is_that_of_the_spring_that_it_is_at_either_end(time: float, felt: float) -> None:
    """A branch that never relaxes is a spring of k₀ + k, one that always has is not there: Jury's limit of each."""
    plant, tissue = Plant(0.63, 1.58), StandardLinearSolid("handle", rest=150.0, branch=300.0, time=time)

    def scaled(stiffness: float) -> float:
        return stiffness_limit(
            plant,
            PERIOD,
            0.0,
            lambda k: environment(
                tissue.with_stiffness(k).linearised(), period=PERIOD, method="exact-foh", estimator=None
            ),
        )

    spring = stiffness_limit(plant, PERIOD, 0.0, lambda k: gain([[-k]]))
    assert scaled(1.0) * felt / 450.0 == pytest.approx(spring, rel=1e-4)


def test_the_law_in_contact_is_the_system_that_stability_judges() -> None:
    """The discrete environment of `linearised`, step by step against the law."""
    space = environment(TISSUE.linearised(), period=PERIOD, method="exact-foh", estimator=None)
    force, state, rng = TISSUE.begin(PERIOD), np.zeros(space.order), np.random.default_rng(3)
    force(0.01)
    depth = 0.0
    for _ in range(300):
        depth = min(0.01, depth + 2e-4 * rng.random())
        expected = float((space.c @ state + space.d[:, 0] * depth)[0])
        state = space.a @ state + space.b[:, 0] * depth
        assert force(0.01 + depth) == pytest.approx(expected, rel=1e-9)


def test_another_stiffness_scales_both_springs() -> None:
    twice = TISSUE.with_stiffness(900.0)
    assert (twice.rest, twice.branch, twice.time, twice.stiffness) == pytest.approx((300.0, 600.0, 0.05, 900.0))
    assert twice.needs == (Signal.POSITION,)


@pytest.mark.parametrize("wrong", [{"rest": 0.0}, {"branch": 0.0}, {"time": 0.0}, {"damping": 1.0}])
def test_parameters_without_a_meaning_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        TypeAdapter(StandardLinearSolid).validate_python(
            {"axis": "handle", "rest": 150.0, "branch": 300.0, "time": 0.05, **wrong}
        )
