"""The virtual shaft against closed forms of two masses on a spring, and against its own power balance."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import scipy.integrate
from hypothesis import given
from hypothesis import strategies as st

from haptic_fieldbus.scenes.coupling import Coupling
from haptic_fieldbus.signals import Signal

AXES = ("left", "right")
NUMBERS = st.floats(-10.0, 10.0)


def forces(coupling: Coupling, *feedback: float) -> tuple[float, float]:
    return coupling.begin(1e-3)(*feedback)


def swing(coupling: Coupling, masses: tuple[float, float], start: list[float], end: float) -> Any:
    """(x₁, v₁, x₂, v₂) of two free masses on the shaft, as scipy integrates them."""
    law = coupling.begin(1e-3)

    def slope(_: float, state: list[float]) -> list[float]:
        first, first_speed, second, second_speed = state
        given = state if coupling.damping else (first, second)
        on_first, on_second = law(*given)
        return [first_speed, on_first / masses[0], second_speed, on_second / masses[1]]

    return scipy.integrate.solve_ivp(slope, (0.0, end), start, rtol=1e-10, atol=1e-12, dense_output=True)


@pytest.mark.parametrize("ratio", [1.0, -1.0, 2.5, 0.05])
def test_the_twist_of_two_free_masses_swings_as_one_mass_of_1_over_1_m1_plus_n2_m2(ratio: float) -> None:
    coupling, masses = Coupling(AXES, stiffness=300.0, ratio=ratio), (0.6, 0.25)
    rate = math.sqrt(300.0 * (1 / masses[0] + ratio**2 / masses[1]))
    found = swing(coupling, masses, [0.01, 0.0, 0.0, 0.0], 3 * 2 * math.pi / rate)
    times = np.linspace(0.0, found.t[-1], 200)
    states = found.sol(times)
    np.testing.assert_allclose(states[0] - ratio * states[2], 0.01 * np.cos(rate * times), atol=1e-9)
    momentum = ratio * masses[0] * states[1] + masses[1] * states[3]
    np.testing.assert_allclose(momentum, 0.0, atol=1e-9)


def test_damping_makes_the_twist_decay_as_the_damped_oscillator_does() -> None:
    coupling = Coupling(AXES, stiffness=300.0, damping=2.0)
    mass = 1 / (1 / 0.6 + 1 / 0.25)
    decay, rate = 2.0 / (2 * mass), math.sqrt(300.0 / mass - (2.0 / (2 * mass)) ** 2)
    found = swing(coupling, (0.6, 0.25), [0.01, 0.0, 0.0, 0.0], 0.5)
    times = np.linspace(0.0, 0.5, 200)
    states = found.sol(times)
    expected = 0.01 * np.exp(-decay * times) * (np.cos(rate * times) + decay / rate * np.sin(rate * times))
    np.testing.assert_allclose(states[0] - states[2], expected, atol=1e-9)


@given(x1=NUMBERS, v1=NUMBERS, x2=NUMBERS, v2=NUMBERS, ratio=st.floats(-5.0, 5.0).filter(lambda n: abs(n) > 1e-3))
def test_what_both_hands_get_is_the_power_of_the_twist(
    x1: float, v1: float, x2: float, v2: float, ratio: float
) -> None:
    coupling = Coupling(AXES, stiffness=300.0, damping=2.0, ratio=ratio)
    first, second = forces(coupling, x1, v1, x2, v2)
    twist, rate = x1 - ratio * x2, v1 - ratio * v2
    assert first * v1 + second * v2 == pytest.approx(-(300.0 * twist + 2.0 * rate) * rate, rel=1e-9, abs=1e-6)


def test_a_rack_and_pinion_has_the_pinions_radius_as_its_ratio() -> None:
    """20 mm per radian: at half a radian ahead the rack is pushed by K·10 mm, the pinion back by r times it."""
    coupling = Coupling(("rack", "pinion"), stiffness=500.0, ratio=0.02)
    assert forces(coupling, 0.0, 0.5) == pytest.approx((5.0, -0.1))
    turned = Coupling(("pinion", "rack"), stiffness=500.0 * 0.02**2, ratio=1 / 0.02)
    assert forces(turned, 0.5, 0.0) == pytest.approx((-0.1, 5.0))


def test_within_the_play_nothing_is_felt_and_beyond_it_the_spring_begins_at_zero() -> None:
    coupling = Coupling(AXES, stiffness=300.0, dead_band=0.004)
    assert forces(coupling, 0.003, 0.0) == (0.0, 0.0)
    assert forces(coupling, 0.006, 0.0) == pytest.approx((-0.6, 0.6))
    assert forces(coupling, 0.0, 0.006) == pytest.approx((0.6, -0.6))


def test_saturation_bounds_the_force_on_the_first_axis_and_n_times_that_on_the_second() -> None:
    coupling = Coupling(AXES, stiffness=300.0, saturation=3.0, ratio=2.0)
    assert forces(coupling, 1.0, 0.0) == pytest.approx((-3.0, 6.0))
    assert forces(coupling, 0.0, 1.0) == pytest.approx((3.0, -6.0))


@pytest.mark.parametrize("place", range(4))
def test_one_feedback_that_is_no_number_makes_both_forces_none(place: int) -> None:
    plain = Coupling(AXES, stiffness=300.0, damping=2.0)
    for coupling in (plain, replace(plain, dead_band=0.004, saturation=3.0)):
        feedback = [0.1, 0.2, 0.3, 0.4]
        feedback[place] = math.nan
        assert all(map(math.isnan, forces(coupling, *feedback)))


def test_velocity_is_asked_for_only_by_damping() -> None:
    assert Coupling(AXES, stiffness=300.0).needs == (Signal.POSITION,)
    assert Coupling(AXES, stiffness=300.0, damping=2.0).needs == (Signal.POSITION, Signal.VELOCITY)


def test_one_axis_cannot_be_coupled_to_itself() -> None:
    with pytest.raises(ValueError, match="axes left, left: expected two different axes"):
        Coupling(("left", "left"), stiffness=300.0)


def test_a_ratio_of_zero_is_refused() -> None:
    with pytest.raises(ValueError, match="ratio 0: expected another number"):
        Coupling(AXES, stiffness=300.0, ratio=0.0)
