"""Every integrator: the contract of a step, its textbook, and what is refused."""

import itertools
import math
import pkgutil
from collections.abc import Callable
from importlib import import_module

import numpy as np
import pytest
import scipy.signal

from haptic_fieldbus.defaults import DEFAULT_METHOD
from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.numerics import integrators as package
from haptic_fieldbus.numerics.integrators import METHODS, bind, discrete, discretise, rest
from haptic_fieldbus.numerics.integrators.method import Integrator, follow
from haptic_fieldbus.numerics.integrators.staggered import positions
from haptic_fieldbus.numerics.linear import StateSpace, parallel
from haptic_fieldbus.scenes.sprung_mass import SprungMass
from tests.cases import every
from tests.numerics.systems import DAMPED, GROUNDED, SPACES, Array, run, sprung_mass
from tests.numerics.textbook import TEXTBOOK

FIXED_NAMES = (
    "forward-euler backward-euler trapezoidal semi-implicit semi-implicit-drift-first verlet rk4 exact-zoh exact-foh"
)


def test_the_names_that_are_promised_are_there() -> None:
    assert set(FIXED_NAMES.split()) <= set(METHODS)


def test_every_method_has_a_textbook_and_a_line() -> None:
    for name in METHODS:
        assert name in TEXTBOOK, f"add the step of {name} to TEXTBOOK in tests/numerics/textbook.py"
    assert set(TEXTBOOK) == set(METHODS), "remove the textbooks of methods that there are no more"
    modules = [import_module(each.name) for each in pkgutil.iter_modules(package.__path__, f"{package.__name__}.")]
    for method in (each for module in modules for each in vars(module).values() if isinstance(each, Integrator)):
        assert method.name in METHODS, f"add {method.name} to METHODS in {package.__file__}"


@pytest.mark.parametrize("method", METHODS)
class TestEveryMethod:
    def test_is_listed_under_its_name(self, method: str) -> None:
        assert METHODS[method].name == method

    @every("name", SPACES)
    @every("where", [0.0, 0.3, -7.0])
    def test_gives_exactly_the_force_of_rest_while_the_handle_stands(
        self, method: str, name: str, where: float
    ) -> None:
        forces = set(run(SPACES[name], method, 1e-3, np.full(200, where)))
        assert forces == {rest(SPACES[name])[1] * where}

    @every("h", [1e-3, 0.05, 0.9, 1.9])
    def test_is_its_textbook(self, method: str, h: float) -> None:
        period, mass = 1e-3, 0.5
        position = 0.01 * np.sin(np.arange(300) * 0.07) + 0.003 * np.sin(np.arange(300) * 1.1)
        stiffness, square = mass * (h / period) ** 2, (h / period) ** 2
        expected, p, v = [], 0.0, 0.0
        for x, after in itertools.pairwise([*position.tolist(), 0.0]):
            expected.append(stiffness * (float(p) - x))
            p, v = TEXTBOOK[method](p, v, x, after, period, square)
        found = run(sprung_mass(h, period, mass), method, period, position)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10 * max(map(abs, expected)))

    @every("name", SPACES)
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

    def test_a_fresh_binding_starts_anew(self, method: str) -> None:
        space, there = SPACES["sprung mass"], np.linspace(0.0, 0.1, 50)
        assert run(space, method, 1e-3, there) == run(space, method, 1e-3, there)

    def test_only_where_the_handle_was_first_matters_not_where_zero_is(self, method: str) -> None:
        way = 0.01 * np.sin(np.arange(1000) * 0.02)
        near = run(SPACES["sprung mass"], method, 1e-3, way)
        far = run(SPACES["sprung mass"], method, 1e-3, way + 1024.0)
        assert far == pytest.approx(near, rel=1e-6, abs=1250 * 1e-12)

    def test_several_systems_at_once_do_what_each_does_alone(self, method: str) -> None:
        """Also finds positions and velocities among the states of both."""
        parts, way = [sprung_mass(0.05), DAMPED, GROUNDED], 0.01 * np.sin(np.arange(300) * 0.05)
        together = run(parallel(parts), method, 1e-3, way)
        alone = np.sum([run(part, method, 1e-3, way) for part in parts], axis=0)
        np.testing.assert_allclose(together, alone, rtol=1e-9, atol=1e-9)

    @every("space", [DAMPED, GROUNDED], ids=["damped", "grounded"])
    def test_a_trajectory_from_rest_is_what_the_loop_runs(self, method: str, space: StateSpace) -> None:
        position = 0.01 * np.sin(np.arange(200) * 0.05) ** 2
        velocity = np.gradient(position, 1e-3)
        velocity[0] = 0.0
        inputs = np.stack([position, velocity], axis=-1)
        found = follow(discretise(space, 1e-3, method), inputs, [0.0] * space.order)
        step = bind(space, 1e-3, method)
        by_step = [step(x, v) if space.uses_velocity else step(x) for x, v in inputs.tolist()]
        np.testing.assert_allclose(found.outputs[:, 0], by_step, rtol=1e-9, atol=1e-9)
        assert not found.diverged

    def test_a_trajectory_begins_in_the_state_that_is_given(self, method: str) -> None:
        for space in (sprung_mass(0.2), DAMPED):
            start = [0.3, -2.0]
            found = follow(discretise(space, 1e-3, method), np.full((3, 2), [0.7, 0.1]), start)
            np.testing.assert_allclose(found.states[0], start, rtol=1e-12)

    def test_a_position_that_is_no_number_gives_a_force_that_is_none(self, method: str) -> None:
        for name in ("sprung mass", "grounded", "two at once"):
            step = bind(SPACES[name], 1e-3, method)
            step(0.0)
            assert math.isnan(step(math.nan))
            assert not math.isfinite(step(0.0))

    def test_a_run_that_overflows_is_seen_and_ends_before_it(self, method: str) -> None:
        """Twice as fast as stays stable, where there is such a limit; an unstable pole elsewhere."""
        growing = StateSpace(np.array([[900.0]]), np.array([[900.0]]), np.array([[1.0]]), np.array([[0.0]]))
        found = follow(discretise(growing, 1e-3, method), np.ones((5000, 1)), [0.0])
        assert found.diverged
        assert found.diverged_at == len(found.outputs) == len(found.states) > 300
        assert np.isfinite(found.outputs).all()

    @every("period", [0.0, -1e-3, math.nan, math.inf])
    def test_a_period_that_is_none_is_refused(self, method: str, period: float) -> None:
        with pytest.raises(UsageError, match=r"period .* expected a finite number above 0"):
            bind(GROUNDED, period, method)

    @every("value", [math.nan, math.inf])
    def test_a_system_with_an_entry_that_is_no_number_is_refused(self, method: str, value: float) -> None:
        broken = StateSpace(np.array([[0.0, 1.0], [value, 0.0]]), DAMPED.b, DAMPED.c, DAMPED.d)
        with pytest.raises(UsageError, match=r"A\[1, 0\] of the virtual states is (nan|inf).* above 0"):
            discrete(broken, 1e-3, method)


def test_forward_euler_is_the_classic_pseudocode() -> None:
    stiffness, mass, period = 300.0, 0.5, 1e-3
    step = bind(SprungMass("handle", stiffness, mass).dynamics, period, "forward-euler")
    p, q = 0.0, 0.0
    for n in range(500):
        x = 0.01 * math.sin(0.02 * n)
        force = stiffness * (p - x)
        p, q = p + period * q, q + period * stiffness / mass * (x - p)
        assert step(x) == pytest.approx(force, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize(
    ("method", "scipys", "alpha"),
    [("forward-euler", "gbt", 0.0), ("backward-euler", "gbt", 1.0), ("trapezoidal", "gbt", 0.5),
     ("exact-zoh", "zoh", None), ("exact-foh", "foh", None)],
)  # fmt: skip
@pytest.mark.parametrize("space", [DAMPED, parallel([DAMPED, GROUNDED])], ids=["two states", "three states"])
def test_where_scipy_has_the_method_its_frequency_response_is_ours(
    method: str, scipys: str, alpha: float | None, space: StateSpace
) -> None:
    period = 2e-3
    a, b, c, d, _ = scipy.signal.cont2discrete((space.a, space.b, space.c, space.d), period, scipys, alpha=alpha)
    ours = discrete(space, period, method)
    for z in np.exp(1j * np.array([0.01, 0.3, 2.0, 3.1])):
        expected = c @ np.linalg.solve(z * np.eye(len(a)) - a, b) + d
        found = ours.c @ np.linalg.solve(z * np.eye(len(a)) - ours.a, ours.b.astype(complex)) + ours.d
        np.testing.assert_allclose(found, expected, rtol=1e-11)


def test_a_puck_on_a_ramp_is_followed_exactly_at_the_samples() -> None:
    """Straight lines are what exact-foh is exact for, however large the period."""
    for h in (0.1, 1.0, 3.0, 40.0):
        space = sprung_mass(h, period=1e-3, mass=0.5)
        natural, stiffness, speed = h / 1e-3, 0.5 * (h / 1e-3) ** 2, 0.2
        times: Array = np.arange(1000).astype(np.float64) * 1e-3
        expected = -stiffness * speed / natural * np.sin(natural * times)
        found = run(space, "exact-foh", 1e-3, times * speed)
        np.testing.assert_allclose(found, expected, rtol=0, atol=2e-10 * stiffness * speed / natural * max(1.0, h))


def test_an_implicit_method_without_a_solution_is_refused() -> None:
    """1 − T·λ = 0"""
    growing = StateSpace(np.array([[4.0]]), np.array([[1.0]]), np.array([[1.0]]), np.array([[0.0]]))
    with pytest.raises(UsageError, match=r"backward-euler has no step of 0.25 s .* use a shorter period"):
        discrete(growing, 0.25, "backward-euler")


def test_positions_are_states_whose_rate_is_another_state() -> None:
    assert positions(DAMPED) == [True, False]
    assert positions(GROUNDED) == [False]
    assert positions(parallel([GROUNDED, DAMPED])) == [False, True, False]
    free = np.array([[0.0, 1.0], [-1.0, 0.0]])
    assert positions(StateSpace(free, np.zeros((2, 1)), np.ones((1, 2)), np.zeros((1, 1)))) == [True, False]
    mutual = np.array([[0.0, 1.0], [1.0, 0.0]])
    assert positions(StateSpace(mutual, np.zeros((2, 1)), np.ones((1, 2)), np.zeros((1, 1)))) == [True, False]


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
def test_an_unknown_name_is_refused_with_the_nearest_and_all_others(ask: Callable[..., object]) -> None:
    with pytest.raises(UsageError, match=r'no method "exact-fo"; nearest: exact-foh; there are: forward-euler, .*foh$'):
        ask(GROUNDED, 1e-3, "exact-fo")
    with pytest.raises(UsageError, match=r'no method "xyz"; there are: forward-euler'):
        ask(GROUNDED, 1e-3, "xyz")
