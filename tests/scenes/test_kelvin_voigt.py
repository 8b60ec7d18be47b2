"""Kelvin–Voigt tissue: a spring and damper that lets go and comes back in its own time."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError
from scipy.integrate import quad

from haptic_fieldbus.scenes.kelvin_voigt import KelvinVoigt
from tests.lanes import examples
from tests.scenes.sheet import Motion, forces, given_to_the_hand
from tests.scenes.sheets.kelvin_voigt import sampled

PERIOD = 1e-3
TISSUE = KelvinVoigt("handle", stiffness=400.0, damping=8.0)
RECOVERY = 8.0 / 400.0


def test_pressed_it_is_a_spring_and_a_damper() -> None:
    force = TISSUE.begin(PERIOD)
    for n in range(1, 50):
        assert force(1e-4 * n, 0.1) == pytest.approx(-400.0 * 1e-4 * n - 0.8)


@pytest.mark.parametrize("wait", [1, 7, 40])
def test_a_dent_comes_back_exponentially_and_pushes_nobody_before(wait: int) -> None:
    """s = D·e^(−t·K/B), whatever the period: the closed form, met a little above and below."""
    for period in (PERIOD, 20 * PERIOD):
        for factor, met in ((0.999, False), (1.001, True)):
            force = TISSUE.begin(period)
            force(0.01, 0.0)
            for _ in range(wait):
                assert force(-0.05, -1.0) == 0.0
            left = 0.01 * math.exp(-(wait + 1) * period / RECOVERY)
            assert (force(factor * left, 0.0) < 0.0) is met


def test_a_tool_that_leaves_slowly_is_followed_and_one_that_leaves_fast_is_not() -> None:
    """Followed as long as it leaves slower than K·d/B."""
    for speed, pushed in ((0.1 * 0.01 / RECOVERY, True), (3.0 * 0.01 / RECOVERY, False)):
        force = TISSUE.begin(PERIOD)
        force(0.01, 0.0)
        assert (force(0.01 - speed * PERIOD, -speed) < 0.0) is pushed


@settings(derandomize=True, max_examples=examples(200))
@given(
    depths=st.lists(st.floats(-0.02, 0.02), min_size=2, max_size=40), speeds=st.lists(st.floats(-5.0, 5.0), min_size=40)
)
def test_it_never_pulls_whatever_the_estimator_says(depths: list[float], speeds: list[float]) -> None:
    force = TISSUE.begin(PERIOD)
    mirrored = KelvinVoigt("handle", stiffness=400.0, damping=8.0, side="negative").begin(PERIOD)
    for depth, speed in zip(depths, speeds, strict=False):
        found = force(depth, speed)
        assert found <= 0.0
        assert mirrored(-depth, -speed) == -found


@settings(derandomize=True, max_examples=examples(100))
@given(
    sizes=st.lists(st.floats(0.0, 0.01), min_size=3, max_size=3),
    turns=st.lists(st.floats(5.0, 250.0), min_size=3, max_size=3),
    damping=st.floats(0.1, 50.0),
)
def test_sampled_it_gives_no_more_than_the_stated_leak(sizes: list[float], turns: list[float], damping: float) -> None:
    tissue, time = KelvinVoigt("handle", stiffness=400.0, damping=damping), np.arange(300) * PERIOD
    position = sum(size * np.sin(turn * time) for size, turn in zip(sizes, turns, strict=True))
    velocity = sum(size * turn * np.cos(turn * time) for size, turn in zip(sizes, turns, strict=True))
    motion = Motion(PERIOD, np.asarray(position), np.asarray(velocity))
    assert given_to_the_hand(motion, forces(tissue, motion), held=True) <= sampled(tissue, motion) + 1e-12


def test_a_slow_tap_loses_what_the_damper_takes() -> None:
    """Work of a round trip that is followed all the way, by quadrature of B·v²."""
    period, turn, deep = 1e-5, 5.0, 0.004
    time = np.arange(round(math.pi / turn / period) + 1) * period
    motion = Motion(period, 0.01 + deep * np.sin(2 * turn * time), 2 * turn * deep * np.cos(2 * turn * time))
    lost = quad(lambda t: 8.0 * (2 * turn * deep * math.cos(2 * turn * t)) ** 2, 0.0, math.pi / turn)[0]
    assert -given_to_the_hand(motion, forces(TISSUE, motion), held=False) == pytest.approx(lost, rel=1e-3)


def test_a_dent_that_recovers_within_a_period_leaves_no_trace() -> None:
    """B/K far below the period, down to the smallest number there is."""
    for damping in (1e-9, 5e-324):
        force = KelvinVoigt("handle", stiffness=400.0, damping=damping).begin(PERIOD)
        assert [force(0.01, 0.0), force(-0.01, 0.0), force(1e-9, 0.0)] == pytest.approx([-4.0, 0.0, -4e-7])


def test_what_is_no_number_is_handed_on() -> None:
    assert math.isnan(TISSUE.begin(PERIOD)(math.nan, 0.0))
    assert math.isnan(TISSUE.begin(PERIOD)(0.01, math.nan))


@pytest.mark.parametrize("wrong", [{"damping": 0.0}, {"stiffness": 0.0}, {"damping": math.nan}])
def test_parameters_without_a_meaning_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        TypeAdapter(KelvinVoigt).validate_python({"axis": "handle", "stiffness": 400.0, "damping": 8.0, **wrong})
