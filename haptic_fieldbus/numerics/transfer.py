"""Transfer functions and difference equations of systems that other modules give as matrices.

A discrete system has three forms, which tests compare with each other:

- matrices: x⁺ = A x + B u, y = C x + D u
- transfer function: H(z) = (b_0 zⁿ + b_1 zⁿ⁻¹ + …)/(zⁿ + a_1 zⁿ⁻¹ + …); the poles are the roots of the denominator
- difference equation: y_n = b_0 u_n + b_1 u_{n−1} + … − a_1 y_{n−1} − …

From rest they give the same numbers; Z{y_{k+n}} = zⁿ·Y holds only from rest. The loop uses matrices in increments, for
numerical reasons: at h = T·ω the denominator of an oscillator is z² − (2 − h²)·z + …, and rounding removes a small h²
beside the 2.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from haptic_fieldbus.numerals import rounded
from haptic_fieldbus.numerics.linear import StateSpace

Polynomial = tuple[float, ...]
"""Coefficients of a polynomial, the highest power first."""


ROUNDING = 1e-12
"""Share of the largest coefficient below which a coefficient counts as rounding."""
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
