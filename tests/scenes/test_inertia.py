"""The virtual mass: its filter in closed form, and its limits in the sampled loop against the formulas it states."""

import math

import numpy as np
import pytest
import scipy.linalg
import scipy.signal
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError

from haptic_fieldbus.numerics import sampled
from haptic_fieldbus.numerics.linear import StateSpace
from haptic_fieldbus.numerics.passivity import damping_needed
from haptic_fieldbus.scenes.inertia import Inertia
from haptic_fieldbus.signals import Signal

PERIOD, DEVICE = 1e-3, 0.5
FREE = (np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0 / DEVICE]]))
SPANS = [1e-4, 1e-3, 5e-3, 0.02, 0.3]
"""Time constants [s], from a tenth of the period up."""


STILL = 1e-9
"""A handle that coasts has an eigenvalue of 1, as nothing brakes it here; this much of its rounding is let pass."""


def environment(inertia: Inertia) -> StateSpace:
    return sampled.environment(inertia.linearised(), period=PERIOD, method="exact-foh", estimator="backward-difference")


def growth(inertia: Inertia, delay: float) -> float:
    return sampled.growth(sampled.sample(*FREE, PERIOD, delay), environment(inertia))


def test_its_force_is_the_mass_times_the_filtered_acceleration() -> None:
    """−m·s/(τ·s + 1) from velocity to force, against scipy's transfer function."""
    space = Inertia("handle", mass=0.3, time_constant=0.02).linearised()
    numerator, denominator = scipy.signal.ss2tf(space.a, space.b[:, 1:], space.c, space.d[:, 1:])
    np.testing.assert_allclose(numerator[0] / denominator[1], [-0.3, 0.0], atol=1e-12)
    np.testing.assert_allclose(denominator / denominator[1], [0.02, 1.0], rtol=1e-12)


def test_pulled_at_a_constant_acceleration_it_resists_with_its_mass_after_its_time_constant() -> None:
    """F = −m·a·(1 − e^(−t/τ)), exact at the samples, as the velocity is a straight line."""
    step, acceleration = Inertia("handle", mass=0.3, time_constant=0.02).begin(PERIOD), 2.0
    times = [k * PERIOD for k in range(200)]
    forces = [step(acceleration * t) for t in times]
    np.testing.assert_allclose(forces, [-0.6 * -math.expm1(-t / 0.02) for t in times], atol=1e-12)


def test_a_constant_speed_is_not_resisted() -> None:
    step = Inertia("handle", mass=0.3, time_constant=0.005).begin(PERIOD)
    assert [step(1.0) for _ in range(200)][-1] == pytest.approx(0.0, abs=1e-12)


def test_a_slowly_swinging_handle_feels_heavier_by_the_mass() -> None:
    """Continuous: a device on a spring swings at √(k/(M + m)) while that is far below 1/τ."""
    mass, stiffness, span = 0.3, 20.0, 1e-3
    space = Inertia("handle", mass=mass, time_constant=span).linearised()
    system = np.array(
        [
            [0.0, 1.0, 0.0],
            [-stiffness / DEVICE, space.d[0, 1] / DEVICE, space.c[0, 0] / DEVICE],
            [0.0, space.b[0, 1], space.a[0, 0]],
        ]
    )
    slowest = np.abs(np.linalg.eigvals(system).imag).max()
    assert slowest == pytest.approx(math.sqrt(stiffness / (DEVICE + mass)), rel=1e-3)


@settings(derandomize=True)
@given(mass=st.floats(1e-3, 1e3), span=st.floats(1e-4, 10.0), turn=st.floats(1e-2, 1e5))
def test_in_continuous_time_it_is_passive(mass: float, span: float, turn: float) -> None:
    """Re Z(jω) = m·τ·ω²/(1 + τ²·ω²), never below zero."""
    space = Inertia("handle", mass=mass, time_constant=span).linearised()
    impedance = -(space.c[0, 0] * space.b[0, 1] / (1j * turn - space.a[0, 0]) + space.d[0, 1])
    assert impedance.real >= -1e-9 * abs(impedance)
    assert impedance == pytest.approx(mass * 1j * turn / (1.0 + 1j * turn * span), rel=1e-6)


@pytest.mark.parametrize("span", SPANS)
def test_without_delay_it_is_stable_up_to_the_limit_that_it_states_and_not_beyond(span: float) -> None:
    limit = 2.0 * DEVICE / -math.expm1(-PERIOD / span)
    assert growth(Inertia("handle", 0.999 * limit, span), 0.0) < 1.0 + STILL
    assert growth(Inertia("handle", 1.001 * limit, span), 0.0) > 1.0 + 1e-5


@pytest.mark.parametrize("span", SPANS)
def test_with_a_period_of_delay_it_is_stable_up_to_the_lower_limit_that_it_states(span: float) -> None:
    pole = math.exp(-PERIOD / span)
    limit = DEVICE * (math.sqrt((1.0 + pole) ** 2 + 4.0) - 1.0 - pole) / (1.0 - pole)
    assert growth(Inertia("handle", 0.999 * limit, span), PERIOD) < 1.0 + STILL
    assert growth(Inertia("handle", 1.001 * limit, span), PERIOD) > 1.0 + 1e-5


def test_hardly_filtered_it_cannot_exceed_twice_the_device() -> None:
    assert (
        growth(Inertia("handle", 1.99 * DEVICE, 1e-5), 0.0) < 1.0 < growth(Inertia("handle", 2.01 * DEVICE, 1e-5), 0.0)
    )


@pytest.mark.parametrize("span", SPANS)
def test_it_is_passive_on_a_device_with_the_damping_that_it_states(span: float) -> None:
    needed = damping_needed(environment(Inertia("handle", 0.3, span)), PERIOD, 0.0)
    assert needed == pytest.approx(2.0 * 0.3 / PERIOD * math.tanh(0.5 * PERIOD / span), rel=1e-6)


@settings(derandomize=True)
@given(st.lists(st.floats(-2.0, 2.0), min_size=1, max_size=60), st.floats(1e-4, 1.0))
def test_its_own_step_is_the_exact_one_along_straight_lines(speeds: list[float], span: float) -> None:
    """Beside scipy's first-order hold of the filter, from rest."""
    inertia = Inertia("handle", mass=0.3, time_constant=span)
    space = inertia.linearised()
    system = (space.a, space.b[:, 1:], space.c, space.d[:, 1:])
    a, b, c, d, _ = scipy.signal.cont2discrete(system, PERIOD, "foh")
    _, expected, _ = scipy.signal.dlsim((a, b, c, d, PERIOD), np.array([0.0, *speeds]))
    law = inertia.begin(PERIOD)
    np.testing.assert_allclose([law(0.0), *map(law, speeds)], expected[:, 0], rtol=1e-7, atol=1e-7 * 0.3 / span)


def test_beyond_the_dead_band_each_sign_has_its_share_and_its_saturation() -> None:
    """Steady accelerations, the filter settled: −m·c·(a − offset ∓ w), cut off."""
    inertia = Inertia(
        "handle",
        mass=0.5,
        time_constant=0.001,
        offset=1.0,
        dead_band=2.0,
        positive_coefficient=0.5,
        positive_saturation=3.0,
        negative_saturation=4.0,
    )
    for acceleration, force in (
        (1.0, 0.0),
        (2.9, 0.0),
        (-0.9, 0.0),
        (7.0, -1.0),
        (-5.0, 2.0),
        (50.0, -3.0),
        (-50.0, 4.0),
    ):
        law = inertia.begin(PERIOD)
        assert [law(acceleration * k * PERIOD) for k in range(200)][-1] == pytest.approx(force, abs=1e-9)


@pytest.mark.parametrize(
    ("positive", "negative", "strongest"), [(None, None, 0.0), (0.5, 2.0, 2.0), (0.5, None, math.inf)]
)
def test_a_saturated_mass_is_active(positive: float | None, negative: float | None, strongest: float) -> None:
    """Sped up at 50 m/s² it takes 0.5 N at most, and braked at 1 m/s² it gives 0.3 N: up to 0.15 J from ½·m·v²."""
    inertia = Inertia("handle", 0.3, 1e-3, positive_saturation=positive, negative_saturation=negative)
    assert inertia.strongest == strongest
    law = inertia.begin(PERIOD)
    speeds = np.concatenate([np.linspace(0.0, 1.0, 21), np.linspace(1.0, 0.0, 1001)])
    given = sum(law(speed) * speed * PERIOD for speed in speeds.tolist())
    assert (given > 0.1) is (strongest > 0.0)


def test_one_of_the_coefficients_is_that_of_all_of_the_mass() -> None:
    with pytest.raises(ValueError, match=r"positive_coefficient 0\.5, negative_coefficient 0\.7"):
        Inertia("handle", mass=0.5, positive_coefficient=0.5, negative_coefficient=0.7)


def test_a_time_constant_far_below_the_period_is_no_trouble() -> None:
    """It tends to the plain difference of velocities."""
    step = Inertia("handle", mass=0.3, time_constant=1e-9).begin(PERIOD)
    forces = [step(speed) for speed in (0.0, 0.1, 0.1)]
    assert forces == pytest.approx([0.0, -0.3 * 0.1 / PERIOD, 0.0], abs=1e-3)


def test_it_needs_velocity() -> None:
    assert Inertia("handle", mass=0.3).needs == (Signal.VELOCITY,)
    assert Inertia("handle", mass=0.3).linearised().uses_velocity


@pytest.mark.parametrize(
    "wrong", [{"mass": 0.0}, {"mass": -1.0}, {"mass": math.inf}, {"time_constant": 0.0}, {"damping": 1.0}]
)
def test_parameters_without_a_meaning_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        TypeAdapter(Inertia).validate_python({"axis": "handle", "mass": 0.3, **wrong})
