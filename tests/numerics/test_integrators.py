"""Every integrator against its own claims and closed forms; precision at both ends of the step size."""

import itertools
import math
from collections.abc import Callable

import mpmath
import numpy as np
import pytest
from numpy.typing import NDArray

from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.numerics.integrators import DEFAULT_METHOD, METHODS, bind, discrete, rest
from haptic_fieldbus.numerics.linear import StateSpace, gain, parallel
from haptic_fieldbus.scenes.sprung_mass import SprungMass


def sprung_mass(h: float, period: float = 1e-3, mass: float = 0.5) -> StateSpace:
    """One whose period is h in units of 1/ω."""
    return SprungMass("handle", stiffness=mass * (h / period) ** 2, mass=mass).dynamics


DAMPED = StateSpace(
    a=np.array([[0.0, 1.0], [-900.0, -20.0]]),
    b=np.array([[0.0, 0.0], [900.0, 20.0]]),
    c=np.array([[450.0, 10.0]]),
    d=np.array([[-450.0, -10.0]]),
)
"""Mass 0.5, spring 450 and damper 10 to the puck: needs its velocity."""
GROUNDED = StateSpace(np.array([[-30.0]]), np.array([[30.0, 0.0]]), np.array([[-40.0]]), np.array([[-60.0, 0.0]]))
"""A spring to the ground of which a part gives way: one state, and a force at rest."""
DRIVEN = StateSpace(np.array([[0.0, 1.0], [0.0, -4.0]]), np.array([[0, 0], [0, 4.0]]), np.array([[0, 2.0]]),
                    np.array([[0.0, -2.0]]))  # fmt: skip
"""A free mass dragged along by a damper: where it is does not matter."""
SPACES = {
    "sprung mass": sprung_mass(0.05),
    "damped": DAMPED,
    "grounded": GROUNDED,
    "driven": DRIVEN,
    "two at once": parallel([sprung_mass(0.05), GROUNDED]),
    "memoryless": gain([[-300.0, -2.0]]),
}


def run(space: StateSpace, method: str, period: float, position: NDArray[np.float64]) -> list[float]:
    """Forces for a sampled position, its velocity by central differences where it matters."""
    step = bind(space, period, method)
    if not space.uses_velocity:
        return [step(x) for x in position.tolist()]
    velocity = np.gradient(position, period)
    return [step(x, v) for x, v in zip(position.tolist(), velocity.tolist(), strict=True)]


@pytest.mark.parametrize("method", METHODS)
class TestEveryMethod:
    def test_is_listed_under_its_name(self, method: str) -> None:
        assert METHODS[method].name == method

    @pytest.mark.parametrize("name", SPACES)
    @pytest.mark.parametrize("where", [0.0, 0.3, -7.0])
    def test_gives_exactly_the_force_of_rest_while_the_handle_stands(
        self, method: str, name: str, where: float
    ) -> None:
        forces = set(run(SPACES[name], method, 1e-3, np.full(200, where)))
        assert forces == {rest(SPACES[name])[1] * where}

    @pytest.mark.parametrize("name", SPACES)
    def test_runs_as_the_linear_system_that_stability_is_judged_by(self, method: str, name: str) -> None:
        space, period = SPACES[name], 1e-3
        system = discrete(space, period, method)
        position = 0.2 + 0.01 * np.sin(np.arange(300) * 0.03)
        velocity = np.gradient(position, period)
        state, expected = np.zeros(space.order), []
        for x, v in zip(position, velocity, strict=True):
            u = np.array([x - position[0], v])
            expected.append(rest(space)[1] * position[0] + float(system.c[0] @ state + system.d[0] @ u))
            state = system.a @ state + system.b @ u
        np.testing.assert_allclose(run(space, method, period, position), expected, rtol=1e-9, atol=1e-9)

    @pytest.mark.parametrize("name", ["sprung mass", "damped", "grounded"])
    @pytest.mark.parametrize("period", [1e-4, 1e-3, 1e-2])
    def test_its_modes_grow_as_claimed(self, method: str, name: str, period: float) -> None:
        space = SPACES[name]
        modes = np.sort_complex(np.linalg.eigvals(discrete(space, period, method).a))
        claimed = np.sort_complex([METHODS[method].growth(complex(s) * period) for s in np.linalg.eigvals(space.a)])
        np.testing.assert_allclose(modes, claimed, rtol=1e-9)

    @pytest.mark.parametrize("h", [1e-2, 0.3, 1.0, 1.9, 2.1, 2.8, 2.9, 50.0])
    def test_an_undamped_oscillator_does_not_grow_up_to_the_claimed_step(self, method: str, h: float) -> None:
        radius = np.abs(np.linalg.eigvals(discrete(sprung_mass(h), 1e-3, method).a)).max()
        if h <= METHODS[method].oscillator_limit:
            assert radius <= 1.0 + 1e-12
        else:
            assert radius > 1.0 + 1e-9

    def test_its_order_is_the_one_claimed(self, method: str) -> None:
        """Sine of the puck against the closed form, error halved so many times with the period."""
        errors = [abs(self._error_at_the_end(method, 2.0**-power * 1e-2)) for power in (4, 5, 6)]
        orders = [math.log2(coarse / fine) for coarse, fine in itertools.pairwise(errors)]
        assert orders == pytest.approx([METHODS[method].order] * 2, abs=0.15)

    def test_a_fresh_binding_starts_anew(self, method: str) -> None:
        space, there = SPACES["sprung mass"], np.linspace(0.0, 0.1, 50)
        assert run(space, method, 1e-3, there) == run(space, method, 1e-3, there)

    def test_only_where_the_handle_was_first_matters_not_where_zero_is(self, method: str) -> None:
        way = 0.01 * np.sin(np.arange(1000) * 0.02)
        near = run(SPACES["sprung mass"], method, 1e-3, way)
        far = run(SPACES["sprung mass"], method, 1e-3, way + 1024.0)
        assert far == pytest.approx(near, rel=1e-6, abs=1250 * 1e-12)

    @staticmethod
    def _error_at_the_end(method: str, period: float) -> float:
        natural, driven, stiffness, end = 30.0, 11.0, 450.0, 0.64
        space = SprungMass("handle", stiffness=stiffness, mass=stiffness / natural**2).dynamics
        times = np.arange(round(end / period) + 1).astype(np.float64) * period
        position: NDArray[np.float64] = 1.0 - np.cos(driven * times)
        found = run(space, method, period, position)[-1]
        forced = natural**2 / (natural**2 - driven**2)
        mass = 1 - forced * math.cos(driven * end) - (1 - forced) * math.cos(natural * end)
        return found - stiffness * (mass - (1.0 - math.cos(driven * end)))


def test_a_puck_on_a_ramp_is_followed_exactly_at_the_samples() -> None:
    """Straight lines are what exact-foh is exact for, however large the period."""
    for h in (0.1, 1.0, 3.0, 40.0):
        space = sprung_mass(h, period=1e-3, mass=0.5)
        natural, stiffness, speed = h / 1e-3, 0.5 * (h / 1e-3) ** 2, 0.2
        times: NDArray[np.float64] = np.arange(1000).astype(np.float64) * 1e-3
        expected = -stiffness * speed / natural * np.sin(natural * times)
        found = run(space, "exact-foh", 1e-3, times * speed)
        np.testing.assert_allclose(found, expected, rtol=0, atol=2e-10 * stiffness * speed / natural * max(1.0, h))


def test_forward_euler_is_the_classic_pseudocode() -> None:
    stiffness, mass, period = 300.0, 0.5, 1e-3
    step = bind(SprungMass("handle", stiffness, mass).dynamics, period, "forward-euler")
    p, q = 0.0, 0.0
    for n in range(500):
        x = 0.01 * math.sin(0.02 * n)
        force = stiffness * (p - x)
        p, q = p + period * q, q + period * stiffness / mass * (x - p)
        assert step(x) == pytest.approx(force, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("period", [1e-6, 1e-3, 1.0])
def test_forward_euler_of_an_oscillator_grows_at_every_period(period: float) -> None:
    system = discrete(SprungMass("handle", 100.0, 1.0).dynamics, period, "forward-euler")
    growth = np.abs(np.linalg.eigvals(system.a))
    np.testing.assert_allclose(growth, math.sqrt(1 + 100.0 * period**2), rtol=1e-12)


def test_forward_euler_with_a_damper_of_stiffness_times_period_neither_grows_nor_decays() -> None:
    stiffness, mass, period = 250.0, 0.4, 1e-3
    damped = StateSpace(
        np.array([[0.0, 1.0], [-stiffness / mass, -stiffness * period / mass]]),
        np.zeros((2, 2)), np.zeros((1, 2)), np.zeros((1, 2)),
    )  # fmt: skip
    np.testing.assert_allclose(np.abs(np.linalg.eigvals(discrete(damped, period, "forward-euler").a)), 1.0, rtol=1e-12)


def after_a_unit_step(h: float, steps: int) -> list[float]:
    """Force/stiffness at some of so many steps after the puck was moved by 1 at once (a ramp of one period, to FOH)."""
    step = bind(SprungMass("handle", stiffness=h**2, mass=1.0).dynamics, 1.0, "exact-foh")
    forces = [step(0.0)] + [step(1.0) for _ in range(steps)]
    return [forces[n] / h**2 for n in (steps // 3, steps // 2, steps)]


@pytest.mark.parametrize(
    ("h", "steps", "tolerance"),
    [(1e-6, 1_000_000, 1e-13), (1e-3, 1_000_000, 1e-12), (0.5, 100_000, 1e-10), (1e3, 10_000, 1e-10)],
)
def test_a_million_steps_stay_on_the_closed_form(h: float, steps: int, tolerance: float) -> None:
    """F/k = −(2/h)·sin(h/2)·cos(h·(n − ½)) for a mean over the ramp's period; tiny steps lose no digits."""
    with mpmath.workdps(40):
        phase, half = mpmath.sqrt(mpmath.mpf(h**2)), mpmath.sqrt(mpmath.mpf(h**2)) / 2
        expected = [
            float(-mpmath.sin(half) / half * mpmath.cos(phase * n - half)) for n in (steps // 3, steps // 2, steps)
        ]
    assert after_a_unit_step(h, steps) == pytest.approx(expected, rel=0, abs=tolerance)


def test_the_energy_of_the_exact_method_does_not_drift_in_a_million_steps() -> None:
    modes = np.linalg.eigvals(discrete(sprung_mass(0.1), 1e-3, "exact-foh").a)
    np.testing.assert_allclose(np.abs(modes) ** 1e6, 1.0, rtol=0, atol=1e-9)


@pytest.mark.parametrize(("stiffness", "mass"), [(1e9, 1e-6), (1e-6, 1e6), (1e12, 1e-3), (1e-3, 1e-9)])
def test_extreme_masses_and_stiffnesses_stay_finite_and_bounded(stiffness: float, mass: float) -> None:
    step = bind(SprungMass("handle", stiffness, mass).dynamics, 1e-3, "exact-foh")
    forces = [step(0.001 * math.sin(0.01 * n)) for n in range(5000)]
    assert all(abs(force) <= 4e-3 * stiffness for force in forces)


def test_a_position_that_is_no_number_gives_a_force_that_is_none() -> None:
    step = bind(SPACES["sprung mass"], 1e-3)
    step(0.0)
    assert math.isnan(step(math.nan))


def test_whether_velocity_matters_is_read_from_the_system() -> None:
    assert {name: space.uses_velocity for name, space in SPACES.items()} == {
        "sprung mass": False,
        "damped": True,
        "grounded": False,
        "driven": True,
        "two at once": False,
        "memoryless": True,
    }


def test_the_default_is_a_method() -> None:
    assert DEFAULT_METHOD in METHODS


@pytest.mark.parametrize("ask", [bind, discrete])
def test_an_unknown_name_is_refused_with_those_that_there_are(ask: Callable[..., object]) -> None:
    with pytest.raises(UsageError, match=r'no method "euler"; there are: exact-foh, forward-euler'):
        ask(GROUNDED, 1e-3, "euler")
