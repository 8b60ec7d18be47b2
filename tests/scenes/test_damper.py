"""The damper condition: its law, its dissipation in closed form, and its limits in the sampled loop."""

import math

import numpy as np
import pytest
import scipy.integrate
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError

from haptic_fieldbus.numerics import sampled
from haptic_fieldbus.numerics.passivity import damping_needed
from haptic_fieldbus.scenes.damper import Damper
from haptic_fieldbus.signals import Signal

PERIOD, MASS = 1e-3, 0.5
FREE = (np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0 / MASS]]))


def growth(damping: float) -> float:
    """Of a free device without delay, velocity by backward difference."""
    linear = Damper("handle", damping=damping).linearised()
    environment = sampled.environment(linear, period=PERIOD, method=None, estimator="backward-difference")
    return sampled.growth(sampled.sample(*FREE, PERIOD, 0.0), environment)


def test_it_opposes_the_speed_beyond_its_dead_band_up_to_its_saturation() -> None:
    force = Damper("handle", damping=10.0, dead_band=0.1, positive_saturation=2.0, negative_coefficient=0.5).force
    assert [force(speed) for speed in (0.05, -0.1, 0.2, 5.0, -0.3)] == pytest.approx([0.0, 0.0, -1.0, -2.0, 1.0])


def test_each_direction_has_its_own_saturation() -> None:
    force = Damper("handle", damping=10.0, positive_saturation=2.0, negative_saturation=1.0).force
    assert [force(speed) for speed in (0.1, 5.0, -0.05, -5.0)] == pytest.approx([-1.0, -2.0, 0.5, 1.0])


def test_without_options_it_is_a_plain_viscous_force() -> None:
    assert [Damper("handle", damping=10.0).force(speed) for speed in (0.2, -0.3)] == pytest.approx([-2.0, 3.0])


@settings(derandomize=True)
@given(speed=st.floats(-1e300, 1e300), dead_band=st.floats(0.0, 1.0), share=st.floats(0.0, 1.0))
def test_it_never_gives_power(speed: float, dead_band: float, share: float) -> None:
    damper = Damper("handle", damping=7.0, dead_band=dead_band, positive_coefficient=share, negative_saturation=3.0)
    assert damper.force(speed) * math.copysign(1.0, speed) <= 0.0


def test_a_thrown_mass_comes_to_rest_as_in_closed_form() -> None:
    """v = w + (v₀ − w)·e^(−Bt/m) above the dead band w: it coasts on at w."""
    damper = Damper("handle", damping=2.0, dead_band=0.1)
    time = np.linspace(0.0, 2.0, 21)
    found = scipy.integrate.solve_ivp(
        lambda t, y: [damper.force(y[0]) / MASS], (0.0, 2.0), [1.0], t_eval=time, rtol=1e-10, atol=1e-12
    )
    np.testing.assert_allclose(found.y[0], 0.1 + 0.9 * np.exp(-4.0 * time), atol=1e-8)


def test_it_is_stable_up_to_twice_the_mass_over_the_period_and_not_beyond() -> None:
    limit = 2.0 * MASS / PERIOD
    assert growth(0.999 * limit) < 1.0 < growth(1.001 * limit)


def test_it_is_passive_on_a_device_of_as_much_damping() -> None:
    linear = Damper("handle", damping=3.0).linearised()
    environment = sampled.environment(linear, period=PERIOD, method=None, estimator="backward-difference")
    assert damping_needed(environment, PERIOD, 0.0) == pytest.approx(3.0)


def test_it_needs_velocity_alone_and_is_no_spring() -> None:
    damper = Damper("handle", damping=3.0)
    assert damper.needs == (Signal.VELOCITY,)
    np.testing.assert_array_equal(damper.linearised().d, [[0.0, -3.0]])


@pytest.mark.parametrize(
    "wrong",
    [
        {"damping": 0.0},
        {"damping": math.nan},
        {"dead_band": -0.1},
        {"positive_coefficient": 0.5, "negative_coefficient": 0.0},
        {"positive_coefficient": 2.0},
        {"positive_saturation": 0.0},
        {"stiffness": 1.0},
    ],
)
def test_parameters_without_a_meaning_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        TypeAdapter(Damper).validate_python({"axis": "handle", "damping": 3.0, **wrong})
