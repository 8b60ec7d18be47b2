"""Claims of the integrators: orders measured, spectral radii by formula, digits at both ends of the step size."""

import itertools
import math
from collections.abc import Callable

import mpmath
import numpy as np
import pytest
import scipy.linalg

from haptic_fieldbus.numerics.integrators import METHODS, bind, discrete, discretise
from haptic_fieldbus.numerics.integrators.method import follow
from haptic_fieldbus.numerics.linear import StateSpace, parallel
from haptic_fieldbus.scenes.sprung_mass import SprungMass
from tests.cases import every
from tests.numerics.systems import DAMPED, SPACES, Array, run, sprung_mass
from tests.numerics.textbook import TEXTBOOK, Number, free_motion

WITHIN = 0.05
STEPS = {1: (4096, 8192, 16384), 2: (512, 1024, 2048), 3: (128, 256, 512), 4: (64, 128, 256)}
"""By the order that is claimed: fine enough for its power of the period to be all of the error."""


def leapfrog(h: float) -> float:
    return 1.0 if h <= 2 else (h * h - 2 + h * math.sqrt(h * h - 4)) / 2


RADII: dict[str, Callable[[float], float]] = {
    "forward-euler": lambda h: math.sqrt(1 + h * h),
    "backward-euler": lambda h: 1 / math.sqrt(1 + h * h),
    "trapezoidal": lambda h: 1.0,
    "semi-implicit": leapfrog,
    "semi-implicit-drift-first": leapfrog,
    "verlet": leapfrog,
    "rk4": lambda h: math.hypot(1 - h**2 / 2 + h**4 / 24, h - h**3 / 6),
    "exact-zoh": lambda h: 1.0,
    "exact-foh": lambda h: 1.0,
}
"""Of an undamped oscillator, by h = T·√(k/m), where there is a formula."""


def textbook_radius(method: str, h: float) -> float:
    """The formula, or the larger modulus of both eigenvalues of the textbook's step, to fifty digits."""
    if method in RADII:
        return RADII[method](h)
    with mpmath.workdps(50):
        one, square = mpmath.mpf(1), mpmath.mpf(h) ** 2
        (a, c), (b, d) = (TEXTBOOK[method](p, v, 0, 0, one, square) for p, v in ((one, 0 * one), (0 * one, one)))
        half, root = (a + d) / 2, mpmath.sqrt(((a - d) / 2) ** 2 + b * c)
        return float(max(abs(half + root), abs(half - root)))


def radius(system: StateSpace) -> float:
    return float(np.abs(np.linalg.eigvals(system.a)).max())


def orders(errors: list[float]) -> list[float]:
    """Each step size half of the one before."""
    return [math.log2(coarse / fine) for coarse, fine in itertools.pairwise(errors)]


def sequence(transition: Array, start: Array, steps: int) -> Array:
    """start, Φ start, Φ² start, …"""
    states = [start]
    for _ in range(steps):
        states.append(transition @ states[-1])
    return np.array(states)


@pytest.mark.parametrize("method", METHODS)
class TestOrder:
    def test_of_a_driven_mass_is_the_one_claimed(self, method: str) -> None:
        """The puck on 1 − cos against the closed form: largest error along the run."""
        claimed = METHODS[method].order
        found = orders([self._driven(method, steps) for steps in STEPS[claimed]])
        assert found == pytest.approx([claimed] * 2, abs=WITHIN)

    @staticmethod
    def _driven(method: str, steps: int) -> float:
        natural, driven, stiffness, end = 30.0, 11.0, 450.0, 0.4
        space = SprungMass("handle", stiffness=stiffness, mass=stiffness / natural**2).dynamics
        times: Array = np.linspace(0.0, end, steps + 1)
        position: Array = 1.0 - np.cos(driven * times)
        forced = natural**2 / (natural**2 - driven**2)
        mass = 1 - forced * np.cos(driven * times) - (1 - forced) * np.cos(natural * times)
        found = np.array(run(space, method, end / steps, position))
        return float(np.abs(found - stiffness * (mass - position)).max())

    @pytest.mark.thorough("up to a million steps for each of 18 cases", quick=1)
    @pytest.mark.parametrize("name", ["sprung mass", "damped"])
    def test_of_a_free_motion_is_the_one_claimed(self, method: str, name: str) -> None:
        """From a state with an acceleration, so that a wrong start would be seen."""
        claimed = METHODS[method].free_order
        if name == "damped" and method == "semi-implicit":
            claimed = 1
        if math.isinf(claimed):
            assert self._free(method, SPACES[name], 100) < 1e-12
        else:
            errors = [self._free(method, SPACES[name], steps) for steps in STEPS[round(claimed)]]
            assert orders(errors) == pytest.approx([claimed] * 2, abs=WITHIN)

    @staticmethod
    def _free(method: str, space: StateSpace, steps: int) -> float:
        start, end = np.array([1.0, -4.0]), 0.06
        found = follow(discretise(space, end / steps, method), np.zeros((steps + 1, 2)), start)
        exact = sequence(scipy.linalg.expm(space.a * end / steps), start, steps) @ space.c[0]
        return float(np.abs(found.outputs[:, 0] - exact).max() / (np.abs(space.c) @ np.abs(start))[0])

    def test_of_a_lag_is_the_one_claimed(self, method: str) -> None:
        """No positions among the states: semi-implicit is forward Euler there."""
        claimed = METHODS[method].order if method not in ("semi-implicit",) else 1
        errors = [self._lag(method, steps) for steps in STEPS[claimed]]
        assert orders(errors) == pytest.approx([claimed] * 2, abs=WITHIN)

    @staticmethod
    def _lag(method: str, steps: int) -> float:
        """ż = −30·z + 30·u, u = t − sin(7t)/7 from rest, against a fine solution by quadrature."""
        end = 0.5
        times: Array = np.linspace(0.0, end, steps + 1)
        position: Array = times - np.sin(7 * times) / 7
        found = run(SPACES["grounded"], method, end / steps, position)[-1]
        with mpmath.workdps(30):
            moved = mpmath.quad(lambda t: 30 * mpmath.exp(-30 * (end - t)) * (t - mpmath.sin(7 * t) / 7), [0, end])
        return abs(found - float(-40 * moved - 60 * mpmath.mpf(position[-1])))


def test_semi_implicit_begun_with_the_velocity_of_now_is_first_order() -> None:
    """The classic start; the half kick of ours makes it second order."""

    def error(steps: int, half_kick: bool) -> float:
        period, square = 0.3 / steps, 2500.0
        p, v = 1.0, 0.0
        v += 0.5 * period * square * p * half_kick
        for _ in range(steps):
            v -= period * square * p
            p += period * v
        return abs(p - math.cos(50.0 * 0.3))

    assert orders([error(steps, False) for steps in STEPS[1]]) == pytest.approx([1, 1], abs=WITHIN)
    assert orders([error(steps, True) for steps in STEPS[2]]) == pytest.approx([2, 2], abs=WITHIN)
    ours = follow(discretise(sprung_mass(50.0 * 0.3 / 512, 0.3 / 512), 0.3 / 512, "semi-implicit"),
                  np.zeros((513, 2)), [1.0, 0.0])  # fmt: skip
    assert abs(ours.states[-1, 0] - math.cos(15.0)) == pytest.approx(error(512, True), rel=1e-6)


def test_the_input_between_samples_bounds_the_order_not_the_method() -> None:
    """rk4 and exact-foh make the same error with a sampled input, as far as the straight line is all of it."""
    errors = {method: TestOrder._driven(method, 1024) for method in ("rk4", "exact-foh", "exact-zoh", "forward-euler")}
    assert errors["rk4"] == pytest.approx(errors["exact-foh"], rel=0.01)
    assert errors["exact-zoh"] > 50 * errors["exact-foh"]


@pytest.mark.parametrize("method", METHODS)
class TestSpectralRadius:
    H = (*np.geomspace(1e-6, 1e3, 37).tolist(), 1.999, 2.001, 2.8284, 2.8285, 2 * math.pi)

    @pytest.mark.thorough("378 steps of time", quick=63)
    @pytest.mark.parametrize("h", H)
    def test_is_its_formula(self, method: str, h: float) -> None:
        expected = textbook_radius(method, h)
        assert METHODS[method].oscillator_growth(h) == pytest.approx(expected, rel=1e-9)
        for mass, period in ((0.5, 1e-3), (1e-5, 1e-4), (10.0, 1.0)):
            assert radius(discrete(sprung_mass(h, period, mass), period, method)) == pytest.approx(expected, rel=1e-9)

    def test_reaches_one_at_the_limit_that_is_claimed(self, method: str) -> None:
        limit = METHODS[method].oscillator_limit
        if math.isinf(limit):
            assert textbook_radius(method, 1e6) <= 1.0 + 1e-12
        elif limit == 0.0:
            assert textbook_radius(method, 1e-3) > 1.0
        else:
            assert textbook_radius(method, limit * (1 - 1e-6)) <= 1.0 < textbook_radius(method, limit * (1 + 1e-6))
            assert radius(discrete(sprung_mass(limit * (1 + 1e-6)), 1e-3, method)) > 1.0 + 1e-7
            assert radius(discrete(sprung_mass(limit * (1 - 1e-6)), 1e-3, method)) < 1.0 + 1e-12

    def test_of_a_decay_reaches_one_at_the_limit_that_is_claimed(self, method: str) -> None:
        def decay(rate: float) -> float:
            system = StateSpace(np.array([[-rate]]), np.ones((1, 1)), np.ones((1, 1)), np.zeros((1, 1)))
            return abs(float(discrete(system, 1.0, method).a[0, 0]))

        limit = METHODS[method].lag_limit
        if math.isinf(limit):
            assert decay(1e6) <= 1.0
        else:
            assert decay(limit * (1 - 1e-9)) < 1.0 < decay(limit * (1 + 1e-9))

    @every("name", ["sprung mass", "damped", "grounded", "two at once"])
    @every("period", [1e-4, 1e-3, 1e-2])
    def test_of_any_system_is_the_growth_of_its_modes(self, method: str, name: str, period: float) -> None:
        growth, space = METHODS[method].growth, SPACES[name]
        if growth is None:
            assert method in ("semi-implicit", "semi-implicit-drift-first", "verlet")
            return
        modes = np.sort_complex(np.linalg.eigvals(discrete(space, period, method).a))
        claimed = np.sort_complex([growth(complex(s) * period) for s in np.linalg.eigvals(space.a)])
        np.testing.assert_allclose(modes, claimed, rtol=1e-9)


def test_forward_euler_is_stable_up_to_its_general_limit() -> None:
    """T < min(−2·Re s/|s|²) over the poles."""
    poles = np.linalg.eigvals(DAMPED.a)
    limit = float((-2 * poles.real / np.abs(poles) ** 2).min())
    assert radius(discrete(DAMPED, limit * (1 - 1e-6), "forward-euler")) < 1.0
    assert radius(discrete(DAMPED, limit * (1 + 1e-6), "forward-euler")) > 1.0


def test_forward_euler_with_a_damper_of_stiffness_times_period_neither_grows_nor_decays() -> None:
    stiffness, mass, period = 250.0, 0.4, 1e-3
    damped = StateSpace(
        np.array([[0.0, 1.0], [-stiffness / mass, -stiffness * period / mass]]),
        np.zeros((2, 2)), np.zeros((1, 2)), np.zeros((1, 2)),
    )  # fmt: skip
    np.testing.assert_allclose(np.abs(np.linalg.eigvals(discrete(damped, period, "forward-euler").a)), 1.0, rtol=1e-12)


@pytest.mark.thorough("a million steps for each method")
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("h", "steps", "tolerance"), [(1e-6, 1_000_000, 1e-12), (1e-3, 20_000, 1e-12)])
def test_tiny_steps_lose_no_digits(method: str, h: float, steps: int, tolerance: float) -> None:
    """Against the same method in fifty digits: a puck moved by one at once, and then held."""
    step = bind(SprungMass("handle", stiffness=h**2, mass=1.0).dynamics, 1.0, method)
    step(0.0)
    for _ in range(steps - 1):
        step(1.0)
    found = step(1.0) / h**2
    with mpmath.workdps(50):
        p, v = first_step(method, mpmath.mpf(h**2))
        left = free_motion(method, 1.0, h**2, (p - 1, v), steps - 1)[0]
    assert found == pytest.approx(float(left), rel=0, abs=tolerance)


@pytest.mark.thorough("a million steps for each method")
@pytest.mark.parametrize("method", ["exact-foh", "verlet"])
def test_tiny_steps_of_more_states_and_of_velocity_lose_no_digits_either(method: str) -> None:
    """A million steps of h = 1e-6, a puck moved by one at once: two masses beside one, and one with a faint damper."""
    h, steps = 1e-6, 1_000_000
    one = SprungMass("handle", stiffness=h**2, mass=1.0).dynamics
    pair, four = bind(one, 1.0, method), bind(parallel([one, one]), 1.0, method)
    dragged = StateSpace(one.a - np.diag([0.0, 1e-30]), one.b + np.array([[0, 0], [0, 1e-30]]), one.c, one.d)
    by_velocity = bind(dragged, 1.0, method)
    for step in (pair, four):
        step(0.0)
    by_velocity(0.0, 0.0)
    for _ in range(steps):
        alone, both, damped = pair(1.0), four(1.0), by_velocity(1.0, 0.0)
    assert both / 2.0 == pytest.approx(alone, rel=0, abs=1e-12 * h**2)
    assert damped == pytest.approx(alone, rel=0, abs=1e-12 * h**2)


def first_step(method: str, square: Number) -> tuple[Number, Number]:
    """(p, v) at the sample where the puck is first at one."""
    return TEXTBOOK[method](mpmath.mpf(0), mpmath.mpf(0), 0, 1, mpmath.mpf(1), square)


@pytest.mark.parametrize(("h", "steps", "tolerance"), [(0.5, 100_000, 1e-10), (1e3, 10_000, 1e-10)])
def test_large_steps_of_the_exact_method_stay_on_the_closed_form(h: float, steps: int, tolerance: float) -> None:
    """F/k = −(2/h)·sin(h/2)·cos(h·(n − ½)) for a mean over the ramp's period."""
    step = bind(SprungMass("handle", stiffness=h**2, mass=1.0).dynamics, 1.0, "exact-foh")
    forces = [step(0.0)] + [step(1.0) for _ in range(steps)]
    for n in (steps // 3, steps // 2, steps):
        with mpmath.workdps(40):
            expected = float(-mpmath.sin(mpmath.mpf(h) / 2) * 2 / h * mpmath.cos(mpmath.mpf(h) * n - mpmath.mpf(h) / 2))
        assert forces[n] / h**2 == pytest.approx(expected, rel=0, abs=tolerance)


def test_the_energy_of_the_exact_method_does_not_drift_in_a_million_steps() -> None:
    modes = np.linalg.eigvals(discrete(sprung_mass(0.1), 1e-3, "exact-foh").a)
    np.testing.assert_allclose(np.abs(modes) ** 1e6, 1.0, rtol=0, atol=1e-9)


@pytest.mark.parametrize(("stiffness", "mass"), [(1e9, 1e-6), (1e-6, 1e6), (1e12, 1e-3), (1e-3, 1e-9)])
def test_extreme_masses_and_stiffnesses_stay_finite_and_bounded(stiffness: float, mass: float) -> None:
    step = bind(SprungMass("handle", stiffness, mass).dynamics, 1e-3, "exact-foh")
    forces = [step(0.001 * math.sin(0.01 * n)) for n in range(5000)]
    assert all(abs(force) <= 4e-3 * stiffness for force in forces)
