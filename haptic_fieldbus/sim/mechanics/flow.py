"""A linear motion ż = A z, followed exactly over any time.

Theory: over whole nanoseconds z moves by the matrix exponential, kept for each span. Any other span is a sum of powers
of two of a nanosecond, whose exponentials are kept as well, and a rest shorter than a nanosecond (for many states at
once: than `quantum_ns`), over which the Taylor series of the exponential converges to rounding in a few terms (in a
dozen). The same series, projected on a linear form p·z + p0, is a polynomial in time: that is how the instant is found
at which the form becomes negative.
Inside, times are nanoseconds and A is per nanosecond.
"""

import math

import numpy as np

from haptic_fieldbus.numerics.exact import expm
from haptic_fieldbus.numerics.linear import Matrix

MAX_TRANSITIONS = 4096
_TERMS = 16
"""Of the Taylor series; at a rate of 1/4 a quantum the first one left out is below 1e-22."""
_BISECTIONS = 60
_BLOCK = 256
"""Rows that are multiplied at once: they stay in the cache, and the matrix library does it in one thread, so that the
result does not depend on the machine's load and does not wait for it."""


class Flow:
    """One mode of motion; `a` in 1/s, shape (n, n)."""

    def __init__(self, a: Matrix, rate: float = 0.0) -> None:
        """`rate` [1/s]: of changes that the eigenvalues of `a` do not show."""
        self.a = a * 1e-9
        fastest = max(float(np.abs(np.linalg.eigvals(self.a)).max()), rate * 1e-9)
        self._smallest = max(0, int(np.floor(np.log2(0.25 / fastest)))) if fastest > 0 else 20
        self.quantum_ns = float(1 << self._smallest)
        self._rest_terms = next((k for k in range(2, _TERMS) if fastest**k < math.factorial(k) * 1e-20), _TERMS)
        self._transitions: dict[int, Matrix] = {}

    def transition(self, span_ns: int) -> Matrix:
        """exp(A·span), (n, n)."""
        matrix = self._transitions.get(span_ns)
        if matrix is None:
            if len(self._transitions) >= MAX_TRANSITIONS:
                self._transitions.clear()
            matrix = self._transitions[span_ns] = expm(self.a * span_ns)
        return matrix

    def advance(self, z: Matrix, span_ns: float) -> Matrix:
        """The state after a span ≥ 0 [ns], not necessarily whole; z (n,)."""
        whole = int(span_ns)
        rest = span_ns - whole
        for power in range(whole.bit_length()):
            if whole >> power & 1:
                z = self.transition(1 << power) @ z
        if rest:
            term = z
            for k in range(1, self._rest_terms):
                term = self.a @ term * (rest / k)
                z = z + term
        return z

    def advance_many(self, states: Matrix, spans_ns: Matrix) -> Matrix:
        """Each state after its own span ≥ 0; states (m, n), spans (m,)."""
        states = states.copy()
        whole = np.floor(spans_ns / self.quantum_ns).astype(np.int64)
        rest = spans_ns - whole * self.quantum_ns
        for power in range(int(whole.max(initial=0)).bit_length()):
            rows = np.flatnonzero(whole >> power & 1)
            if len(rows):
                states[rows] = moved(states[rows], self.transition(1 << power + self._smallest))
        return self._taylor(states, rest)

    def _taylor(self, states: Matrix, spans_ns: Matrix) -> Matrix:
        """Each state after its own span, shorter than a quantum; in place, by blocks that stay in the cache."""
        transposed = self.a.T
        for first in range(0, len(states), _BLOCK):
            rows = slice(first, first + _BLOCK)
            block, span = states[rows], spans_ns[rows, np.newaxis]
            term = block.copy()
            for k in range(1, _TERMS):
                term = term @ transposed
                term *= span / k
                block += term
        return states

    def first_negative(self, z: Matrix, span_ns: float, form: Matrix, offset: float) -> float | None:
        """When form·z + offset first becomes negative within the span [ns]; None when it does not.

        It is not negative at the start. Found are a change of sign and a dip between two positive ends, told by the
        sign of its rate; a form whose rate changes sign twice within the span may hide one.
        """
        return self._search(z, self.advance(z, span_ns), span_ns, form, offset)

    def _search(self, z: Matrix, end: Matrix, span_ns: float, form: Matrix, offset: float) -> float | None:
        """`first_negative` between two states; cut at powers of two, whose transitions are at hand."""
        rate = form @ self.a
        if form @ end + offset >= 0.0 and not (rate @ z < 0.0 < rate @ end):
            return None
        if span_ns <= self.quantum_ns:
            return _first_negative(self._series(z, form, offset), span_ns)
        cut_ns = 1 << math.ceil(math.log2(span_ns)) - 1
        middle = self.transition(cut_ns) @ z
        early = self._search(z, middle, cut_ns, form, offset)
        if early is not None:
            return early
        late = self._search(middle, end, span_ns - cut_ns, form, offset)
        return None if late is None else cut_ns + late

    def _series(self, z: Matrix, form: Matrix, offset: float) -> list[float]:
        """Coefficients of form·exp(A·h)·z + offset in h [ns]."""
        term = z
        coefficients = [float(form @ z) + offset]
        for k in range(1, _TERMS):
            term = self.a @ term / k
            coefficients.append(float(form @ term))
        return coefficients


def moved(states: Matrix, transition: Matrix) -> Matrix:
    """Each of the states (m, n) after the same transition (n, n)."""
    after = np.empty_like(states)
    for first in range(0, len(states), _BLOCK):
        rows = slice(first, first + _BLOCK)
        np.matmul(states[rows], transition.T, out=after[rows])
    return after


def _first_negative(series: list[float], span_ns: float) -> float | None:
    """First instant at which the polynomial is negative; its rate changes sign at most once."""
    if _value(series, span_ns) < 0.0:
        return _crossing(series, 0.0, span_ns)
    slope = [k * coefficient for k, coefficient in enumerate(series)][1:]
    lowest = _crossing([-coefficient for coefficient in slope], 0.0, span_ns)
    return _crossing(series, 0.0, lowest) if _value(series, lowest) < 0.0 else None


def _crossing(series: list[float], low: float, high: float) -> float:
    """The end of the last bracket of a bisection: not negative before it, negative at it, to 2⁻⁶⁰ of the span."""
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        if _value(series, middle) < 0.0:
            high = middle
        else:
            low = middle
    return high


def _value(series: list[float], h: float) -> float:
    value = 0.0
    for coefficient in reversed(series):
        value = value * h + coefficient
    return value
