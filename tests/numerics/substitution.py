"""Other ways to the discrete forms of a system: substitution in a transfer function, and a difference equation.

Substitution turns a continuous transfer function into a discrete one without matrices. An integrator 1/s becomes:

| rule        | 1/s →            | s →               | method         |
|-------------|------------------|-------------------|----------------|
| forward     | T/(z − 1)        | (z − 1)/T         | forward-euler  |
| backward    | T·z/(z − 1)      | (z − 1)/(T·z)     | backward-euler |
| trapezoidal | T·(z + 1)/(2·(z − 1)) | 2·(z − 1)/(T·(z + 1)) | trapezoidal |
"""

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.numerals import exactly
from haptic_fieldbus.numerics.transfer import Polynomial, TransferFunction

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
    padded = (0.0,) * (len(function.den) - len(function.num)) + function.num
    weights = (*padded, *(-coefficient for coefficient in function.den[1:]))
    order = len(function.den) - 1
    inputs, outputs = [0.0] * order, [0.0] * order

    def step(u: float) -> float:
        nonlocal inputs, outputs
        y: float = sum(map(float.__mul__, weights, (u, *inputs, *outputs)))
        inputs, outputs = [u, *inputs][:order], [y, *outputs][:order]
        return y

    return step
