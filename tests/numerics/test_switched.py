"""Two modes of one body: exact in each, and the change between them found in time."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from haptic_fieldbus.numerics.linear import StateSpace
from haptic_fieldbus.scenes.virtual_coupling import bind_linear, bind_switched

PERIOD, MASS, LEAD, WALL = 1e-3, 0.05, 800.0, 2e5
"""A wall so stiff that a visit lasts 1.6 periods: all the switching there can be."""


def tool(wall: float) -> StateSpace:
    return StateSpace(
        a=np.array([[0.0, 1.0], [-(LEAD + wall) / MASS, 0.0]]),
        b=np.array([[0.0, 0.0], [LEAD / MASS, 0.0]]),
        c=np.array([[LEAD, 0.0]]),
        d=np.array([[-LEAD, 0.0]]),
    )


def energy(first: float, second: float, lead: float = 0.0) -> float:
    return 0.5 * (MASS * second**2 + WALL * max(0.0, first) ** 2 + lead * first**2)


@pytest.mark.parametrize("phase", np.linspace(0.0, 1.0, 9).tolist())
def test_a_tool_thrown_at_the_wall_comes_back_with_its_energy(phase: float) -> None:
    """Handle held at the surface, a bounce every 25 ms: no energy is made that matters, and little is lost."""
    advance = bind_switched(tool(0.0), tool(WALL), PERIOD)
    state = (-0.4 * PERIOD * phase - 1e-9, 0.4)
    begun, energies, inside = energy(*state, LEAD), [], 0
    for _ in range(400):
        state = advance(*state, (0.0, 0.0), (0.0, 0.0))
        energies.append(energy(*state, LEAD))
        inside += state[0] > 0.0
    one_crossing = 0.5 * WALL * (0.4 * PERIOD) ** 2
    assert inside > 10
    assert max(energies) <= begun + 16 * one_crossing / 1024**2
    assert energies[-1] >= begun - 16 * one_crossing / 1024


def test_it_follows_a_fine_integration_with_events() -> None:
    """A handle that dips into the wall and comes out, by scipy with the crossings found."""
    wall = 2e3
    advance, times = bind_switched(tool(0.0), tool(wall), PERIOD), np.arange(301) * PERIOD

    def handle(t: float) -> float:
        return -0.005 * math.cos(30.0 * t) - 0.001

    def rates(t: float, z: np.ndarray) -> list[float]:
        return [z[1], (LEAD * (handle(t) - z[0]) - wall * max(0.0, z[0])) / MASS]

    exact = solve_ivp(rates, (0.0, 0.3), [handle(0.0), 0.0], t_eval=times, rtol=1e-10, atol=1e-13, max_step=1e-4).y
    state, found = (handle(0.0), 0.0), [handle(0.0)]
    for before, now in zip(times[:-1].tolist(), times[1:].tolist(), strict=True):
        state = advance(*state, (handle(before), 0.0), (handle(now), 0.0))
        found.append(state[0])
    assert (exact[0] > 0.0).sum() > 30
    np.testing.assert_allclose(found, exact[0], atol=2e-3 * np.abs(exact[0]).max())


def test_where_nothing_is_crossed_it_is_the_linear_step() -> None:
    switched, linear = bind_switched(tool(0.0), tool(WALL), PERIOD), bind_linear(tool(0.0), PERIOD)
    one = two = (-0.1, 0.2)
    for n in range(50):
        before, now = (-0.1 - 1e-4 * n, 0.0), (-0.1 - 1e-4 * (n + 1), 0.0)
        one, two = switched(*one, before, now), linear(*two, before, now)
        assert one == two


def test_what_is_no_number_is_handed_on() -> None:
    advance = bind_switched(tool(0.0), tool(WALL), PERIOD)
    assert all(map(math.isnan, advance(0.0, 0.0, (0.0, 0.0), (math.nan, 0.0))))
    assert all(map(math.isnan, advance(0.01, 0.0, (0.0, 0.0), (math.nan, 0.0))))
