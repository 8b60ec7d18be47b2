"""Three forms of one system: matrices, difference equations, transfer functions."""

import math

import numpy as np
import pytest
import scipy.signal
from hypothesis import given, settings
from hypothesis import strategies as st

from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.numerics.estimators import ESTIMATORS
from haptic_fieldbus.numerics.estimators import discrete as estimator_system
from haptic_fieldbus.numerics.integrators import METHODS, bind, discrete
from haptic_fieldbus.numerics.linear import StateSpace
from haptic_fieldbus.numerics.transfer import TransferFunction, difference_equation, fraction, transfer_function
from tests.cases import every
from tests.lanes import examples
from tests.numerics.substitution import RULES, bind_difference_equation, substituted
from tests.numerics.systems import DAMPED, GROUNDED, SPACES, sprung_mass

AGREE = 1e-12
BY_SUBSTITUTION = {"forward-euler": "forward", "backward-euler": "backward", "trapezoidal": "trapezoidal"}
ON_THE_CIRCLE = np.exp(1j * np.linspace(0.05, math.pi, 40))


def response(system: StateSpace, z: complex) -> complex:
    states = np.linalg.solve(z * np.eye(system.order) - system.a, system.b[:, 0].astype(complex))
    return complex(system.c[0] @ states + system.d[0, 0])


def motion(steps: int = 300) -> list[float]:
    n = np.arange(steps)
    way: list[float] = (0.01 * np.sin(0.11 * n) + 0.002 * np.cos(1.3 * n) - 0.002).tolist()
    return way


@every("method", METHODS)
@every("name", ["sprung mass", "damped", "grounded", "two at once"])
def test_the_transfer_function_of_a_method_is_that_of_its_matrices(method: str, name: str) -> None:
    system = discrete(SPACES[name], 1e-2, method)
    function = transfer_function(system)
    found = np.array([function(z) for z in ON_THE_CIRCLE])
    expected = np.array([response(system, z) for z in ON_THE_CIRCLE])
    np.testing.assert_allclose(found, expected, rtol=0, atol=AGREE * np.abs(expected).max())
    np.testing.assert_allclose(np.sort(np.abs(function.poles)), np.sort(np.abs(np.linalg.eigvals(system.a))), rtol=1e-9)


@every("method", METHODS)
@every("h", [0.2, 0.7, 1.5])
def test_the_difference_equation_gives_what_the_loop_gives(method: str, h: float) -> None:
    space = sprung_mass(h)
    step, equation = (
        bind(space, 1e-3, method),
        bind_difference_equation(transfer_function(discrete(space, 1e-3, method))),
    )
    start = [0.0, *motion()]
    expected, found = [step(x) for x in start], [equation(x) for x in start]
    np.testing.assert_allclose(found, expected, rtol=0, atol=AGREE * max(map(abs, expected)))


@pytest.mark.parametrize("method", BY_SUBSTITUTION)
@pytest.mark.parametrize("space", [sprung_mass(0.2), DAMPED, GROUNDED], ids=["sprung mass", "damped", "one state"])
def test_substitution_in_the_transfer_function_is_the_method_in_matrices(method: str, space: StateSpace) -> None:
    period = 1e-3 if space is not DAMPED else 1e-2
    by_matrices = transfer_function(discrete(space, period, method))
    by_substitution = substituted(transfer_function(space), period, BY_SUBSTITUTION[method])
    for ours, theirs in ((by_matrices.den, by_substitution.den), (by_matrices.num, by_substitution.num)):
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=AGREE * np.abs(theirs).max())


def test_an_integrator_becomes_what_the_rules_say() -> None:
    """1/s → T/(z − 1), T·z/(z − 1), T·(z + 1)/(2·(z − 1))."""
    integrator, period = TransferFunction((1.0,), (1.0, 0.0)), 0.25
    expected = {
        "forward": TransferFunction((0.0, period), (1.0, -1.0)),
        "backward": TransferFunction((period, 0.0), (1.0, -1.0)),
        "trapezoidal": TransferFunction((period / 2, period / 2), (1.0, -1.0)),
    }
    assert {rule: substituted(integrator, period, rule) for rule in RULES} == expected


@settings(derandomize=True, max_examples=examples(50))
@given(
    den=st.lists(st.floats(-5, 5), min_size=1, max_size=4),
    num=st.lists(st.floats(-5, 5), min_size=1, max_size=4),
    z=st.complex_numbers(min_magnitude=1.1, max_magnitude=3),
)
def test_a_substituted_function_is_the_function_at_the_substituted_s(
    den: list[float], num: list[float], z: complex
) -> None:
    period, continuous = 0.01, TransferFunction(tuple(num[: len(den)]), (1.0, *den))
    for rule, s in {
        "forward": (z - 1) / period,
        "backward": (z - 1) / (period * z),
        "trapezoidal": 2 / period * (z - 1) / (z + 1),
    }.items():
        if min(abs(s - pole) for pole in continuous.poles) > 1.0 and abs(z + 1) > 0.1:
            assert substituted(continuous, period, rule)(z) == pytest.approx(continuous(s), rel=1e-8, abs=1e-12)


@settings(derandomize=True, max_examples=examples(50))
@given(rows=st.lists(st.lists(st.floats(-2, 2), min_size=5, max_size=5), min_size=5, max_size=5))
def test_matrices_of_any_kind_have_the_coefficients_that_scipy_finds(rows: list[list[float]]) -> None:
    table = np.array(rows)
    system = StateSpace(table[:4, :4], table[:4, 4:], table[4:, :4], table[4:, 4:])
    found = transfer_function(system)
    num, den = scipy.signal.ss2tf(system.a, system.b, system.c, system.d)
    np.testing.assert_allclose(found.den, den, rtol=0, atol=1e-10 * np.abs(den).max())
    np.testing.assert_allclose(found.num, num[0], rtol=0, atol=1e-10 * max(1.0, np.abs(num).max()))


@pytest.mark.parametrize("name", [name for name in ESTIMATORS if estimator_system(name, 1e-3) is not None])
def test_estimators_have_transfer_functions_too(name: str) -> None:
    """With a zero at 1, where nothing moves."""
    system = estimator_system(name, 1e-3)
    assert system is not None
    function = transfer_function(system)
    for z in ON_THE_CIRCLE[::8]:
        assert function(z) == pytest.approx(response(system, z), rel=1e-9)
    assert abs(function(1.0 + 0j)) < 1e-9 / 1e-3
    assert max(abs(function.poles)) < 1.0


def test_zeros_are_the_roots_of_the_numerator() -> None:
    np.testing.assert_allclose(np.sort(TransferFunction((1.0, -3.0, 2.0), (1.0, 0.0, 0.0)).zeros), [1.0, 2.0])


def test_a_system_without_states_is_its_gain() -> None:
    function = transfer_function(SPACES["memoryless"], source=1)
    assert (function.num, function.den) == ((-2.0,), (1.0,))
    assert [bind_difference_equation(function)(x) for x in (1.0, 3.0)] == [-2.0, -6.0]


def test_the_difference_equation_is_told_in_words_of_people() -> None:
    oscillator = substituted(TransferFunction((400.0,), (1.0, 0.0, 400.0)), 0.01, "forward")
    assert difference_equation(oscillator, "x", "p") == "p[n] = 0.04 x[n-2] + 2 p[n-1] - 1.04 p[n-2]"
    assert difference_equation(TransferFunction((0.0,), (1.0,))) == "y[n] = 0"


def test_what_cannot_be_substituted_is_refused() -> None:
    function = TransferFunction((1.0,), (1.0, -200.0))
    with pytest.raises(UsageError, match=r'no substitution "tustin"; there are: forward, backward, trapezoidal'):
        substituted(function, 0.01, "tustin")
    with pytest.raises(UsageError, match="above 0"):
        substituted(function, 0.0, "forward")
    with pytest.raises(UsageError, match="goes to infinity"):
        substituted(function, 0.01, "trapezoidal")


@pytest.mark.parametrize(
    ("function", "text"),
    [
        (TransferFunction((-200.0, 1e-15, 0.0), (1.0, 0.0, 400.0)), "-200 s^2/(s^2 + 400)"),
        (TransferFunction((1.0, -0.5), (1.0, 0.0)), "(s - 0.5)/s"),
        (TransferFunction((0.0, 2.0), (1.0, 3.0)), "2/(s + 3)"),
        (TransferFunction((-600.0,), (1.0,)), "-600"),
        (TransferFunction((0.0,), (1.0,)), "0"),
    ],
)
def test_a_transfer_function_is_told_as_a_fraction(function: TransferFunction, text: str) -> None:
    assert fraction(function, "s") == text
