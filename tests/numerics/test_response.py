"""Whole motions at once against step-by-step runs and closed forms."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from haptic_fieldbus.assessing.virtual_states import ExactResponse, SequenceResponse, recursion
from haptic_fieldbus.numerics.integrators import METHODS, bind, discrete, rest
from haptic_fieldbus.numerics.linear import StateSpace
from haptic_fieldbus.scenes.sprung_mass import SprungMass

Array = NDArray[np.float64]
DRIVEN = 25.0
DAMPED = StateSpace(
    a=np.array([[0.0, 1.0], [-900.0, -20.0]]),
    b=np.array([[0.0, 0.0], [900.0, 20.0]]),
    c=np.array([[450.0, 10.0]]),
    d=np.array([[-450.0, -10.0]]),
)


def motion(times_ns: NDArray[np.int64]) -> tuple[Array, Array]:
    """Begins at rest away from zero."""
    times: Array = times_ns.astype(np.float64) * 1e-9
    position: Array = 0.3 + 0.01 * (1 - np.cos(DRIVEN * times))
    velocity: Array = 0.01 * DRIVEN * np.sin(DRIVEN * times)
    return position, velocity


def sprung_mass_force(natural: float, stiffness: float, times_ns: NDArray[np.int64]) -> Array:
    """k·(p − x) in closed form."""
    times: Array = times_ns.astype(np.float64) * 1e-9
    forced = natural**2 / (natural**2 - DRIVEN**2)
    p = 0.01 * (1 - forced * np.cos(DRIVEN * times) - (1 - forced) * np.cos(natural * times))
    force: Array = stiffness * (p - 0.01 * (1 - np.cos(DRIVEN * times)))
    return force


def nodes(spacing_ns: int, end: float = 1.0) -> NDArray[np.int64]:
    return np.concatenate([[0], np.arange(spacing_ns // 2, int(end * 1e9), spacing_ns, dtype=np.int64)])


@pytest.mark.parametrize("steps", [0, 1, 2, 3, 4, 24, 25, 26, 1000])
def test_the_recursion_does_what_a_loop_does(steps: int) -> None:
    drive = np.sin(np.arange(2.0 * steps)).reshape(steps, 2)
    transition, state = np.array([[0.9, 0.2], [-0.1, 0.95]]), np.array([1.0, -2.0])
    expected = [state]
    for row in drive:
        expected.append(transition @ expected[-1] + row)
    np.testing.assert_allclose(recursion(transition, drive, state), expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("method", METHODS)
def test_a_sequence_is_answered_as_the_step_of_the_loop_answers_it(method: str) -> None:
    inputs = np.stack([0.3 + 0.01 * np.sin(np.arange(500) * 0.1), 0.1 * np.cos(np.arange(500) * 0.1)], axis=-1)
    step = bind(DAMPED, 1e-3, method)
    expected = [step(x, v) for x, v in inputs.tolist()]
    found = SequenceResponse(discrete(DAMPED, 1e-3, method), rest(DAMPED)[1])(inputs)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("natural", [3.0, 40.0, 1e3, 3e4])
def test_an_oscillator_along_a_sine_is_its_closed_form(natural: float) -> None:
    """Also one that swings several times between two nodes."""
    space = SprungMass("handle", stiffness=200.0, mass=200.0 / natural**2).dynamics
    times_ns = nodes(62_500)
    response = ExactResponse(space, times_ns, *motion(times_ns))
    np.testing.assert_allclose(response.force, sprung_mass_force(natural, 200.0, times_ns), rtol=0, atol=2e-10)


@pytest.mark.parametrize("natural", [3.0, 40.0, 1e3, 3e4])
def test_between_the_nodes_it_is_as_exact(natural: float) -> None:
    space = SprungMass("handle", stiffness=200.0, mass=200.0 / natural**2).dynamics
    times_ns = nodes(62_500)
    between_ns = np.concatenate([[0], times_ns[:-1:7] + 12_345, [times_ns[-1] + 40_000]])
    found = ExactResponse(space, times_ns, *motion(times_ns)).force_at(between_ns, *motion(between_ns))
    np.testing.assert_allclose(found, sprung_mass_force(natural, 200.0, between_ns), rtol=0, atol=2e-10)


def test_refining_sixteen_points_a_period_changes_less_than_1e_10() -> None:
    """Here with a damper, whose force needs the velocity; at nodes that both grids have."""
    coarse_ns, fine_ns = nodes(62_500)[1:], nodes(62_500 // 25)
    coarse_ns = np.concatenate([[0], coarse_ns])
    coarse, fine = (ExactResponse(DAMPED, at_ns, *motion(at_ns)) for at_ns in (coarse_ns, fine_ns))
    shared = np.searchsorted(fine_ns, coarse_ns)
    np.testing.assert_array_equal(fine_ns[shared], coarse_ns)
    np.testing.assert_allclose(coarse.force, fine.force[shared], rtol=0, atol=1e-10)


def test_it_is_fourth_order_in_the_distance_of_the_nodes() -> None:
    errors = []
    for spacing_ns in (16_000_000, 8_000_000, 4_000_000):
        times_ns = nodes(spacing_ns)
        space = SprungMass("handle", stiffness=200.0, mass=200.0 / 40.0**2).dynamics
        response = ExactResponse(space, times_ns, *motion(times_ns))
        errors.append(np.abs(response.force - sprung_mass_force(40.0, 200.0, times_ns)).max())
    orders = [math.log2(errors[0] / errors[1]), math.log2(errors[1] / errors[2])]
    assert orders == pytest.approx([4.0, 4.0], abs=0.3)
