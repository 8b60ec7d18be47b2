"""Exact discretisation against mpmath, scipy and closed forms."""

import mpmath
import numpy as np
import pytest
import scipy.linalg
import scipy.signal
from hypothesis import given, settings
from hypothesis import strategies as st

from haptic_fieldbus.numerics.linear import Matrix, expm, expm1, foh, polynomial_step, polynomial_system, zoh
from tests.cases import every
from tests.lanes import examples

SQUARES = [-1e12, -1e6, -4.0, -1e-3, 0.0, 25.0]
"""Of the natural frequency, with the sign that makes it an oscillator; 0 is a free mass, positive an unstable pole."""


def oscillator(square: float) -> Matrix:
    return np.array([[0.0, 1.0], [square, 0.0]])


def reference_expm1(x: Matrix) -> Matrix:
    with mpmath.workdps(60):
        exponential = mpmath.expm(mpmath.matrix(x.tolist()), method="taylor") - mpmath.eye(len(x))
        return np.array(exponential.tolist(), dtype=float)


@every("phase", [1e-9, 1e-6, 1e-3, 0.1, 1.0, 10.0, 100.0, 1e3])
@every("natural", [1e-2, 1.0, 1e3, 1e6])
def test_an_oscillator_keeps_its_digits_for_every_step_and_stiffness(natural: float, phase: float) -> None:
    step = phase / natural
    found = expm1(oscillator(-(natural**2)) * step) * np.array([[1.0, natural], [1.0 / natural, 1.0]])
    with mpmath.workdps(40):
        turned = mpmath.sqrt(mpmath.mpf(natural**2)) * mpmath.mpf(step)
        expected = np.array(
            [[mpmath.cos(turned) - 1, mpmath.sin(turned)], [-mpmath.sin(turned), mpmath.cos(turned) - 1]], dtype=float
        )
    if phase < 1.0:
        np.testing.assert_allclose(found, expected, rtol=1e-15 * 20)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * max(1.0, phase / 100))


@settings(derandomize=True, max_examples=examples(60))
@given(
    st.integers(1, 4).flatmap(
        lambda n: st.lists(st.lists(st.floats(-20, 20), min_size=n, max_size=n), min_size=n, max_size=n)
    )
)
def test_any_matrix_agrees_with_sixty_digits(rows: list[list[float]]) -> None:
    x = np.array(rows)
    growth = np.linalg.norm(scipy.linalg.expm(np.abs(x)))
    assert np.linalg.norm(expm1(x) - reference_expm1(x)) <= 1e-13 * growth


@pytest.mark.parametrize("square", SQUARES)
def test_a_millisecond_agrees_with_sixty_digits(square: float) -> None:
    x = oscillator(square) * 1e-3
    np.testing.assert_allclose(expm1(x), reference_expm1(x), rtol=1e-12, atol=1e-20)


def test_several_matrices_at_once_are_each_done() -> None:
    both = np.array([oscillator(-4.0), oscillator(25.0)])
    np.testing.assert_allclose(expm(both), [expm(both[0]), expm(both[1])], rtol=1e-14)


def test_the_exponential_of_nothing_is_one() -> None:
    np.testing.assert_array_equal(expm(np.zeros((3, 3))), np.eye(3))
    assert expm(np.zeros((0, 0))).shape == (0, 0)


@pytest.mark.parametrize(
    ("square", "step"),
    [(square, step) for square in SQUARES for step in (1e-6, 1e-3, 0.1) if abs(square) * step**2 < 1e6],
)
def test_hold_and_ramp_agree_with_scipy(square: float, step: float) -> None:
    a, b = oscillator(square - 1.0) - 0.3 * np.eye(2), np.array([[0.0, 0.5], [2.0, -1.0]])
    transition, held = zoh(a, b, step)
    expected = scipy.signal.cont2discrete((a, b, np.eye(2), np.zeros((2, 2))), step, method="zoh")
    size = np.abs(np.array(expected[0])).max()
    np.testing.assert_allclose(transition, expected[0], rtol=1e-9, atol=1e-13 * size)
    np.testing.assert_allclose(held, expected[1], rtol=1e-9, atol=1e-13 * size)

    transition, now, after = foh(a, b, step)
    expected = scipy.signal.cont2discrete((a, b, np.eye(2), np.zeros((2, 2))), step, method="foh")
    np.testing.assert_allclose(transition, expected[0], rtol=1e-9, atol=1e-13 * size)
    np.testing.assert_allclose(now + transition @ after, expected[1], rtol=1e-8, atol=1e-13 * size)
    np.testing.assert_allclose(after, expected[3], rtol=1e-8, atol=1e-13 * size)


@pytest.mark.parametrize("phase", [1e-8, 1e-4, 1.0, 30.0, 1e3])
def test_the_ramp_on_an_oscillator_is_its_closed_form(phase: float) -> None:
    natural = 1e4
    step = phase / natural
    _, (held, slope) = polynomial_step(oscillator(-(natural**2)), np.array([[0.0], [natural**2]]), step, 1)
    with mpmath.workdps(50):
        turned = mpmath.mpf(natural) * mpmath.mpf(step)
        expected = [float(1 - mpmath.cos(turned)), float(1 - mpmath.sin(turned) / turned)]
    np.testing.assert_allclose([held[0, 0], slope[0, 0]], expected, rtol=1e-12 * max(1.0, phase / 100))


def test_a_cubic_input_is_followed_exactly() -> None:
    """z′ = u with u = 1 + 2t + 3t² + 4t³ over two seconds."""
    _, gammas = polynomial_step(np.zeros((1, 1)), np.ones((1, 1)), 2.0, 3)
    by_theta = [1.0, 2.0 * 2, 6.0 * 4, 24.0 * 8]
    moved = sum(float(gamma[0, 0]) * derivative for gamma, derivative in zip(gammas, by_theta, strict=True))
    assert moved == pytest.approx(2 + 4 + 8 + 16, rel=1e-14)


BADLY_SCALED = {
    "oscillator": [[0.0, 1.0], [-1e12, 0.0]],
    "critically damped": [[0.0, 1.0], [-1e12, -2e6]],
    "nearly critically damped": [[0.0, 1.0], [-1e12, -2e6 * (1 + 1e-9)]],
    "overdamped": [[0.0, 1.0], [-1e12, -1e7]],
    "light": [[0.0, 1.0], [-1e-6, -1e-9]],
    "free mass": [[0.0, 1.0], [0.0, 0.0]],
    "repeated oscillator": [[0, 1, 0, 0], [-1e12, 0, 1e12, 0], [0, 0, 0, 1], [0, 0, -1e12, 0]],
}
"""Of which scipy's expm errs by 1e-11, or whose eigenvectors are parallel."""


@every("name", BADLY_SCALED)
@every("h", [1e-6, 1e-3, 0.1, 1.0, 30.0, 1e3])
def test_badly_scaled_and_repeated_modes_agree_with_fifty_digits(name: str, h: float) -> None:
    """Transition and both inputs of the exact step, positions in units of velocity/ω: 1e-12·max(1, h/100)."""
    a = np.array(BADLY_SCALED[name])
    natural = max(1e-3, abs(a[1, 0]) ** 0.5)
    step, order = h / natural, len(a)
    b = np.eye(order)[:, 1:2] * natural**2
    increment, (held, slope) = polynomial_step(a, b, step, 1)
    system = polynomial_system(a * step, b * step, 1)
    with mpmath.workdps(50):
        exponential = mpmath.expm(mpmath.matrix(system.tolist()), method="taylor")
        expected = np.array((exponential - mpmath.eye(order + 2)).tolist(), dtype=float)[:order]
    units = np.array([1.0, 1.0 / natural] * (order // 2))
    found = np.hstack([increment / units, held, slope]) * units[:, None]
    expected = np.hstack([expected[:, :order] / units, expected[:, order:]]) * units[:, None]
    allowed = 1e-12 * max(1.0, h / 100)
    for part in (slice(0, order), slice(order, order + 1), slice(order + 1, order + 2)):
        assert np.abs((found - expected)[:, part]).max() <= allowed * np.abs(expected[:, part]).max()
