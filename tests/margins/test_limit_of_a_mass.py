"""Damped virtual masses over ranges, and beside a texture, against loops put together from scipy alone."""

import math

import numpy as np
import pytest
import scipy.linalg
import scipy.signal

from haptic_fieldbus.margins import Plant, Ranges, Verdict
from haptic_fieldbus.margins.group import Group, Member
from haptic_fieldbus.scenes.damped_sprung_mass import DampedSprungMass
from haptic_fieldbus.scenes.texture import Texture
from tests.loops import Array

PERIOD = 2e-3


SCIPY = {"trapezoidal": "bilinear", "exact-foh": "foh"}
"""Names of discretisations in scipy."""


def mass_step(stiffness: float, mass: float, damping: float, method: str = "trapezoidal") -> tuple[Array, ...]:
    """Return (A, B, C, D) of a sprung mass by a method: (position, velocity of the handle) → force on it."""
    a = np.array([[0.0, 1.0], [-stiffness / mass, -damping / mass]])
    b = np.array([[0.0, 0.0], [stiffness / mass, damping / mass]])
    c, d = np.array([[stiffness, damping]]), np.array([[-stiffness, -damping]])
    return tuple(scipy.signal.cont2discrete((a, b, c, d), PERIOD, method=SCIPY[method])[:4])


def growth(
    plant: Plant, delay: float, element: tuple[float, float, float], spring: float = 0.0, method: str = "trapezoidal"
) -> float:
    """Return the spectral radius; states x, v, f, x before, the mass, forces.

    Without a `spring` to the ground the eigenvalue 1 of a shift is left out.
    """
    a, b, c, d = mass_step(*element, method)
    whole = math.floor(delay / PERIOD)
    rest, size = delay - whole * PERIOD, 7 + whole
    system = np.zeros((4, 4))
    system[0, 1], system[1, 1], system[1, 2] = 1.0, -plant.damping / plant.mass, 1.0 / plant.mass
    system[2, 2:] = -1.0 / plant.torque_lag, 1.0 / plant.torque_lag
    early, late = scipy.linalg.expm(system * rest), scipy.linalg.expm(system * (PERIOD - rest))

    def period(state: Array) -> Array:
        inputs = np.array([state[0], (state[0] - state[3]) / PERIOD])
        inner = state[4:6]
        forces = [float((c @ inner + d @ inputs)[0]) - spring * state[0], *state[6:]]
        moved = late @ [*(early @ [*state[:3], forces[whole + 1]])[:3], forces[whole]]
        return np.array([*moved[:3], state[0], *(a @ inner + b @ inputs), *forces[:-1]])

    modes = np.linalg.eigvals(np.array([period(unit) for unit in np.eye(size)]).T)
    shift = [] if spring else [int(np.argmin(np.abs(modes - 1.0)))]
    return float(np.abs(np.delete(modes, shift)).max())


@pytest.mark.parametrize(
    ("plant", "delays", "mass", "damping", "at", "stiffness"),
    [
        # at an end of the ranges, in a window of 12 to 39 kN/m; once 219 kN/m
        (Plant(1.35820, 1.24755, torque_lag=2.5175e-3), (3.2411e-3, 4.8411e-3), 0.119568, 4.27832,
         (Plant(1.08656, 0.623775, torque_lag=1.25873e-3), 3.2411e-3), 20_000.0),
        # between the ends of the delay; once 68 kN/m
        (Plant(1.39591, 1.96603, torque_lag=1.70656e-3), (0.3592e-3, 3.3592e-3), 0.177797, 17.7605,
         (Plant(1.11673, 0.983013, torque_lag=0.85328e-3), 1.6344e-3), 60_000.0),
    ],
)  # fmt: skip
def test_no_value_in_the_ranges_grows_below_the_limit(
    plant: Plant, delays: tuple[float, float], mass: float, damping: float, at: tuple[Plant, float], stiffness: float
) -> None:
    lag = plant.torque_lag
    ranges = Ranges((0.5 * lag, 1.4 * lag), delays)
    element = DampedSprungMass("a", 50.0, mass, damping)
    member = Member("a", plant, delays[0], (element,), "trapezoidal", "backward-difference", ranges=ranges)
    assert growth(*at, (stiffness, mass, damping)) > 1.002
    assert growth(*at, (50.0, mass, damping)) < 1.0
    assert 50.0 < Group((member,), (), PERIOD).limit_over_ranges().value < stiffness


@pytest.mark.parametrize(
    ("plant", "delays", "mass", "damping", "at", "stiffness", "once"),
    [
        (Plant(0.066900, 0.186114, torque_lag=0.812533e-3), (1.598486e-3, 3.040454e-3), 2.853604e-3, 0.869896,
         (Plant(0.053520, 0.093057, torque_lag=0.406267e-3), 3.040454e-3), 128_900.0, 271_900.0),
        (Plant(0.182384, 7.476228, torque_lag=0.126493e-3), (1.781518e-3, 3.399082e-3), 2.155972e-3, 0.272402,
         (Plant(0.145907, 3.738114, torque_lag=0.063246e-3), 1.781518e-3), 335_000.0, 745_900.0),
    ],
)  # fmt: skip
def test_a_narrow_window_of_stiffness_in_which_a_mass_grows_is_found(
    plant: Plant, delays: tuple[float, float], mass: float, damping: float, at: tuple[Plant, float], stiffness: float,
    once: float,
) -> None:  # fmt: skip
    """It is a tenth wide; `once` the limit lay above it, where the loop with these values is stable again."""
    radii = [growth(*at, (share * stiffness, mass, damping), method="exact-foh") for share in (0.9, 1.0, 1.15)]
    assert max(radii[0], radii[2]) < 1.0
    assert radii[1] > 1.005
    ranges, element = (
        Ranges((0.5 * plant.torque_lag, 1.4 * plant.torque_lag), delays),
        DampedSprungMass("a", 1.0, mass, damping),
    )
    member = Member("a", plant, delays[0], (element,), "exact-foh", "backward-difference", ranges=ranges)
    assert 0.9 * stiffness < Group((member,), (), PERIOD).limit_over_ranges().value < stiffness < once


def test_every_slope_of_a_texture_counts_beside_a_virtual_mass() -> None:
    """Its slopes run from 0 to 232 N/m; once only 0, 116, 201 and 232 N/m were tried, all of which are stable."""
    plant, delay = Plant(2.5120e-3, 0.0976858, torque_lag=0.3858e-3), 0.80222e-3
    mass = DampedSprungMass("a", 187.217, 1.66373e-3, 0.450362)
    element = mass.stiffness, mass.mass, mass.damping
    assert all(growth(plant, delay, element, slope) < 1.0 for slope in (1.0, 116.0, 201.0, 232.0))
    worst = max(growth(plant, delay, element, slope) for slope in np.linspace(130.0, 190.0, 13))
    assert worst > 1.001

    def judged(*elements: Texture | DampedSprungMass) -> Group:
        member = Member("a", plant, delay, elements, "trapezoidal", "backward-difference", effort=10.0)
        return Group((member,), (), PERIOD)

    texture = Texture("a", 232.0 * 0.01 / (2.0 * math.pi), 0.01)
    found = judged(texture, mass).stability
    assert found.verdict is Verdict.UNSTABLE
    assert found.spectral_radius == pytest.approx(worst, abs=1e-4)
    assert judged(mass).stability.verdict is Verdict.STABLE
