"""The sprung mass: its physics in closed form, and what is refused."""

import math

import numpy as np
import pytest
import scipy.linalg
from pydantic import TypeAdapter, ValidationError

from haptic_fieldbus.numerics.integrators import bind, rest
from haptic_fieldbus.scenes.sprung_mass import SprungMass
from haptic_fieldbus.signals import Signal

MASS = SprungMass("handle", stiffness=200.0, mass=0.5)
NATURAL = 20.0


def test_its_natural_frequency_is_the_root_of_stiffness_over_mass() -> None:
    np.testing.assert_allclose(np.linalg.eigvals(MASS.dynamics.a), [1j * NATURAL, -1j * NATURAL], rtol=1e-12)


def test_it_rests_where_the_handle_is_and_gives_no_force_there() -> None:
    state, force = rest(MASS.dynamics)
    assert state.tolist() == [1.0, 0.0]
    assert force == 0.0


@pytest.mark.parametrize("time", [0.01, 0.1, 0.3])
def test_after_a_step_of_the_puck_it_swings_about_it(time: float) -> None:
    """Held puck: p = 1 − cos ωt, F = k·(p − 1) = −k·cos ωt: it pulls the puck back first."""
    space = MASS.dynamics
    system = np.zeros((3, 3))
    system[:2, :2], system[:2, 2] = space.a, space.b[:, 0]
    p, q, x = scipy.linalg.expm(system * time) @ [0.0, 0.0, 1.0]
    assert p == pytest.approx(1 - math.cos(NATURAL * time))
    assert q == pytest.approx(NATURAL * math.sin(NATURAL * time))
    force = space.c[0] @ [p, q] + space.d[0, 0] * x
    assert force == pytest.approx(-200.0 * math.cos(NATURAL * time))


def test_puck_and_mass_pull_each_other_with_opposite_force() -> None:
    """Free puck: momentum is kept by the four states of both."""
    space, puck = MASS.dynamics, 0.2
    system = np.zeros((4, 4))  # x, v of the puck; p, q of the mass
    system[0, 1] = 1.0
    system[1, 0], system[1, 2:] = space.d[0, 0] / puck, space.c[0] / puck
    system[2:, 2:], system[2:, 0] = space.a, space.b[:, 0]
    moved = scipy.linalg.expm(system * 0.37) @ [0.01, 0.3, 0.0, 0.0]
    assert puck * moved[1] + MASS.mass * moved[3] == pytest.approx(puck * 0.3)
    fast = np.abs(np.linalg.eigvals(system).imag).max()
    assert fast == pytest.approx(math.sqrt(200.0 * (1 / 0.5 + 1 / puck)))


@pytest.mark.parametrize("mass", [1e-1, 1e-2, 1e-3, 1e-4])
def test_a_lighter_and_lighter_mass_is_felt_as_its_inertia_and_vanishes(mass: float) -> None:
    """At a constant acceleration a of the puck the mean force tends to −m·a."""
    step = bind(SprungMass("handle", 2e3, mass).dynamics, 1e-4)
    forces = [step(0.5 * 3.0 * (n * 1e-4) ** 2) for n in range(8000)]
    assert sum(forces) / len(forces) == pytest.approx(-3.0 * mass, rel=0.02)


def test_it_needs_position_only() -> None:
    assert MASS.needs == (Signal.POSITION,)
    assert not MASS.dynamics.b[:, 1].any()


@pytest.mark.parametrize(
    "wrong",
    [
        {"mass": 0.0},
        {"mass": -1.0},
        {"mass": math.nan},
        {"mass": math.inf},
        {"stiffness": 0.0},
        {"stiffness": -5.0},
        {"stiffness": math.nan},
        {"damping": 1.0},
    ],
)
def test_parameters_without_a_meaning_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        TypeAdapter(SprungMass).validate_python({"axis": "handle", "stiffness": 200.0, "mass": 0.5, **wrong})
