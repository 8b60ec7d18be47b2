"""Transfer functions and difference equations of systems that other modules give as matrices.

A discrete system has three forms, which tests compare with each other:

- matrices: x⁺ = A x + B u, y = C x + D u
- transfer function: H(z) = (b_0 zⁿ + b_1 zⁿ⁻¹ + …)/(zⁿ + a_1 zⁿ⁻¹ + …); the poles are the roots of the denominator
- difference equation: y_n = b_0 u_n + b_1 u_{n−1} + … − a_1 y_{n−1} − …

From rest they give the same numbers; Z{y_{k+n}} = zⁿ·Y holds only from rest. The loop uses matrices in increments, for
numerical reasons: at h = T·ω the denominator of an oscillator is z² − (2 − h²)·z + …, and rounding removes a small h²
beside the 2.

Substitution turns a continuous transfer function into a discrete one without matrices. An integrator 1/s becomes:

| rule        | 1/s →            | s →               | method         |
|-------------|------------------|-------------------|----------------|
| forward     | T/(z − 1)        | (z − 1)/T         | forward-euler  |
| backward    | T·z/(z − 1)      | (z − 1)/(T·z)     | backward-euler |
| trapezoidal | T·(z + 1)/(2·(z − 1)) | 2·(z − 1)/(T·(z + 1)) | trapezoidal |
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.numerals import exactly, rounded
from haptic_fieldbus.numerics.linear import StateSpace

Polynomial = tuple[float, ...]
"""Coefficients of a polynomial, the highest power first."""


ROUNDING = 1e-12
"""Share of the largest coefficient below which one is rounding."""
FORMULA_DIGITS = 9
"""Digits of a coefficient: at 1 kHz the denominator of an oscillator differs from (z - 1)^2 in the fourth."""


@dataclass(frozen=True)
class TransferFunction:
    """Proper rational function of s or z with a monic denominator."""

    num: Polynomial
    den: Polynomial

    @property
    def poles(self) -> NDArray[np.complex128]:
        """Roots of the denominator, (n,); for a function of z their largest modulus is the spectral radius."""
        return np.roots(self.den).astype(np.complex128)

    @property
    def zeros(self) -> NDArray[np.complex128]:
        """Roots of the numerator, at most (n,)."""
        return np.roots(self.num).astype(np.complex128)

    def __call__(self, at: complex) -> complex:
        return complex(np.polyval(self.num, at) / np.polyval(self.den, at))


def transfer_function(system: StateSpace, source: int = 0, output: int = 0) -> TransferFunction:
    """Return the transfer function from input `source` to output `output` of a continuous or discrete system.

    The method is that of Faddeev and LeVerrier: with N_1 = I, a_k = −tr(A N_k)/k and N_{k+1} = A N_k + a_k I, the
    denominator has the coefficients a_k, and C·adj·B has the coefficients C N_k B.
    """
    a, b, c = system.a, system.b[:, source], system.c[output]
    direct = float(system.d[output, source])
    den, num = [1.0], [direct]
    adjugate = np.eye(system.order)
    for power in range(1, system.order + 1):
        through = float(c @ adjugate @ b)
        adjugate = a @ adjugate
        coefficient = -float(np.trace(adjugate)) / power
        adjugate = adjugate + coefficient * np.eye(system.order)
        den.append(coefficient)
        num.append(through + direct * coefficient)
    return TransferFunction(tuple(num), tuple(den))


RULES: dict[str, Callable[[float], tuple[Polynomial, Polynomial]]] = {
    "forward": lambda period: ((1.0, -1.0), (0.0, period)),
    "backward": lambda period: ((1.0, -1.0), (period, 0.0)),
    "trapezoidal": lambda period: ((2.0, -2.0), (period, period)),
}
"""By the name of a rule: (numerator, denominator) of the function of z that replaces s, from the period [s]."""


def substituted(continuous: TransferFunction, period: float, rule: str) -> TransferFunction:
    """Return the function of z that a rule of RULES makes of a function of s.

    Raises UsageError for an unknown rule, a period [s] that is not above 0, and a pole that goes to infinity.
    """
    if rule not in RULES:
        raise UsageError(f'no substitution "{rule}"; there are: {", ".join(RULES)}')
    if not 0.0 < period < math.inf:
        raise UsageError(f"period {exactly(period)} s: expected a finite number above 0")
    above, below = RULES[rule](period)
    degree = len(continuous.den) - 1
    num, den = (_in_place_of_s(part, degree, above, below) for part in (continuous.num, continuous.den))
    if den[0] == 0.0:
        raise UsageError(f"{rule} substitution at {exactly(period)} s: a pole of the function goes to infinity")
    return TransferFunction(tuple((num / den[0]).tolist()), tuple((den / den[0]).tolist()))


def _in_place_of_s(part: Polynomial, degree: int, above: Polynomial, below: Polynomial) -> NDArray[np.float64]:
    """Return Σ p_k s^k·below^degree with s = above/below: a polynomial in z of this degree."""
    total = np.zeros(degree + 1)
    for power, coefficient in enumerate(reversed(part)):
        term = np.ones(1)
        for factor in [above] * power + [below] * (degree - power):
            term = np.convolve(term, factor)
        total += coefficient * term
    return total


def bind_difference_equation(function: TransferFunction) -> Callable[[float], float]:
    """Return a step from u_n to y_n = b_0 u_n + … − a_1 y_{n−1} − … in plain floats, from rest."""
    weights = (*_padded(function), *(-coefficient for coefficient in function.den[1:]))
    order = len(function.den) - 1
    inputs, outputs = [0.0] * order, [0.0] * order

    def step(u: float) -> float:
        nonlocal inputs, outputs
        y: float = sum(map(float.__mul__, weights, (u, *inputs, *outputs)))
        inputs, outputs = [u, *inputs][:order], [y, *outputs][:order]
        return y

    return step


def difference_equation(function: TransferFunction, source: str = "u", output: str = "y") -> str:
    """Return the difference equation as text for people."""
    terms = [_term(value, source, lag) for lag, value in _significant(_padded(function))]
    terms += [_term(-value, output, lag) for lag, value in _significant(function.den) if lag]
    return f"{output}[n] = " + (" ".join(terms).removeprefix("+ ") or "0")


def _padded(function: TransferFunction) -> Polynomial:
    return (0.0,) * (len(function.den) - len(function.num)) + function.num


def _term(value: float, name: str, lag: int) -> str:
    return f"{'-' if value < 0 else '+'} {rounded(abs(value), 6)} {name}[n{f'-{lag}' if lag else ''}]"


def fraction(function: TransferFunction, variable: str) -> str:
    """Return the fraction of two polynomials in s or z as text for people."""
    over, under = (_bracketed(_polynomial(part, variable)) for part in (function.num, function.den))
    return over.strip("()") if under == "1" else f"{over}/{under}"


def _bracketed(text: str) -> str:
    return f"({text})" if " + " in text or " - " in text else text


def _significant(coefficients: Polynomial) -> list[tuple[int, float]]:
    """Return the coefficients that are more than rounding, with their places."""
    largest = max(map(abs, coefficients), default=0.0)
    return [(place, value) for place, value in enumerate(coefficients) if abs(value) > ROUNDING * largest]


def _polynomial(coefficients: Polynomial, variable: str) -> str:
    degree = len(coefficients) - 1
    terms = [
        f"{'-' if value < 0 else '+'} {_monomial(abs(value), degree - place, variable)}"
        for place, value in _significant(coefficients)
    ]
    text = " ".join(terms)
    return (f"-{text[2:]}" if text.startswith("-") else text.removeprefix("+ ")) or "0"


def _monomial(value: float, power: int, variable: str) -> str:
    letters = {0: "", 1: variable}.get(power, f"{variable}^{power}")
    number = rounded(value, FORMULA_DIGITS)
    if not letters:
        return number
    return letters if number == "1" else f"{number} {letters}"
