"""The free puck: four states, their frequencies and their energy."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from haptic_fieldbus.numerics.integrators import bind
from haptic_fieldbus.scenes.free_puck import FreePuck
from haptic_fieldbus.signals import Signal

PUCK = FreePuck("handle", stiffness=800.0, damping=2.0, puck=0.2, spring=200.0, mass=0.5)


def test_a_loose_coupling_leaves_puck_and_mass_swinging_about_their_common_centre() -> None:
    """The lecture's free puck: ω = √(k·(1/M + 1/m)), and a common drift."""
    space = FreePuck("handle", stiffness=1e-12, puck=0.2, spring=200.0, mass=0.5).dynamics
    turns = sorted(np.abs(np.linalg.eigvals(space.a).imag))
    assert turns[-1] == pytest.approx(math.sqrt(200.0 * (1 / 0.2 + 1 / 0.5)))
    assert turns[0] < 1e-5


def test_a_hard_coupling_makes_it_the_held_puck() -> None:
    """The mass swings at √(k/m) as if the puck were the handle."""
    space = FreePuck("handle", stiffness=1e9, puck=0.2, spring=200.0, mass=0.5).dynamics
    assert min(np.abs(np.linalg.eigvals(space.a).imag)) == pytest.approx(20.0, rel=1e-6)


@pytest.mark.parametrize("damping", [0.0, 2.0])
def test_it_follows_the_four_ordinary_differential_equations(damping: float) -> None:
    """Written out by hand, by scipy, for a handle that swings off from rest."""
    element, turn, period = FreePuck("handle", 800.0, 0.2, 200.0, 0.5, damping), 15.0, 1e-3

    def rates(t: float, z: np.ndarray) -> list[float]:
        x, v = 0.01 * (1.0 - math.cos(turn * t)), 0.01 * turn * math.sin(turn * t)
        coupling, spring = 800.0 * (x - z[0]) + damping * (v - z[1]), 200.0 * (z[2] - z[0])
        return [z[1], (coupling + spring) / 0.2, z[3], -spring / 0.5]

    times = np.arange(501) * period
    exact = solve_ivp(rates, (0.0, times[-1]), [0.0] * 4, t_eval=times, rtol=1e-11, atol=1e-13, method="DOP853").y
    x, v = 0.01 * (1.0 - np.cos(turn * times)), 0.01 * turn * np.sin(turn * times)
    force = 800.0 * (exact[0] - x) + damping * (exact[1] - v)
    law = bind(element.dynamics, period)
    found = [law(a, b) if damping else law(a) for a, b in zip(x.tolist(), v.tolist(), strict=True)]
    np.testing.assert_allclose(found, force, atol=1e-3 * np.abs(force).max())


def test_all_that_the_handle_puts_in_is_stored_or_lost_in_the_coupling() -> None:
    """Power balance of the matrices, whatever the state."""
    k, b, spring, puck, mass = 800.0, 2.0, 200.0, 0.2, 0.5
    y, vy, p, vp, x, v = 0.01, -0.3, 0.02, 0.4, -0.005, 0.2
    space = PUCK.dynamics
    rate = space.a @ [y, vy, p, vp] + space.b @ [x, v]
    force = float((space.c @ [y, vy, p, vp] + space.d @ [x, v])[0])
    stored = puck * vy * rate[1] + mass * vp * rate[3] + k * (y - x) * (vy - v) + spring * (p - y) * (vp - vy)
    assert -force * v == pytest.approx(stored + b * (vy - v) ** 2)


def test_it_needs_the_velocity_only_for_the_damper_of_its_coupling() -> None:
    assert PUCK.needs == (Signal.POSITION, Signal.VELOCITY)
    assert FreePuck("handle", 800.0, 0.2, 200.0, 0.5).needs == (Signal.POSITION,)
