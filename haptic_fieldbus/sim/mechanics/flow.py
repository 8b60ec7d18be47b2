"""A linear motion ż = A z, followed exactly over any time.

Theory: over whole nanoseconds, z moves by the matrix exponential, which is cached for each span. Any other span is
split into powers of two of a nanosecond, whose exponentials are cached too, and a rest shorter than a nanosecond. Over
the rest, a few terms of the Taylor series of the exponential are exact to rounding. For many states at once, the split
ends at `quantum_ns`, and the series needs a dozen terms. The same series, projected on a linear form p·z + p0, is a
polynomial in time; its sign gives the instant at which the form becomes negative.

Inside, times are in nanoseconds and A is per nanosecond.
"""

import math

import numpy as np

from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.numerals import exactly, rounded
from haptic_fieldbus.numerics.exact import expm
from haptic_fieldbus.numerics.linear import Matrix

MAX_TRANSITIONS = 4096
"""Matrices that one cache holds; it is emptied when full."""
FASTEST = 1.0
"""Fastest rate [1/ns], at which the first omitted term of the series over a rest of 1 ns is below 1e-13."""
_TERMS = 16
"""Terms of the Taylor series; at a rate of 1/4 per quantum the first omitted term is below 1e-22."""
# Enough for the last bit of a float: 2⁻⁶⁰ of the bracket.
_BISECTIONS = 60
_BLOCK = 256
"""Rows that are multiplied at once.

A block of them stays in the cache, and the matrix library multiplies it in one thread. So the result does not depend on
the load of the machine and does not wait for other threads.
"""


class Flow:
    """One mode of motion, ż = A z, with `a` of shape (n, n) in 1/s."""

    def __init__(self, a: Matrix, rate: float = 0.0) -> None:
        """Prepare the motion; `rate` [1/s] is that of changes that the eigenvalues of `a` do not show.

        Raises UsageError for a motion that is faster than the series takes.
        """
        self.a = a * 1e-9
        fastest = max(float(np.abs(np.linalg.eigvals(self.a)).max()), rate * 1e-9)
        if not fastest <= FASTEST:
            found, most = rounded(fastest * 1e9), exactly(FASTEST * 1e9)
            raise UsageError(
                f"the simulated mechanics changes at {found} 1/s; expected at most {most} 1/s: "
                "less stiffness or damping, or more inertia"
            )
        # The largest power of two of a nanosecond whose product with the fastest rate is at most 1/4.
        self._smallest = max(0, int(np.floor(np.log2(0.25 / fastest)))) if fastest > 0 else 20
        self.quantum_ns = float(1 << self._smallest)
        # Over less than a nanosecond the k-th term is below fastest^k/k!; terms below 1e-20 are omitted.
        self._rest_terms = next((k for k in range(2, _TERMS) if fastest**k < math.factorial(k) * 1e-20), _TERMS)
        self._transitions: dict[int, Matrix] = {}

    def transition(self, span_ns: int) -> Matrix:
        """Return exp(A·span), shape (n, n), for a span of whole nanoseconds."""
        matrix = self._transitions.get(span_ns)
        if matrix is None:
            if len(self._transitions) >= MAX_TRANSITIONS:
                self._transitions.clear()
            matrix = self._transitions[span_ns] = expm(self.a * span_ns)
        return matrix

    def advance(self, z: Matrix, span_ns: float) -> Matrix:
        """Return the state after a span ≥ 0 [ns], which need not be whole; `z` has shape (n,)."""
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
        """Return each state after its own span ≥ 0 [ns]; `states` has shape (m, n), `spans_ns` (m,)."""
        states = states.copy()
        whole = np.floor(spans_ns / self.quantum_ns).astype(np.int64)
        rest = spans_ns - whole * self.quantum_ns
        for power in range(int(whole.max(initial=0)).bit_length()):
            rows = np.flatnonzero(whole >> power & 1)
            if len(rows):
                states[rows] = moved(states[rows], self.transition(1 << power + self._smallest))
        return self._taylor(states, rest)

    def _taylor(self, states: Matrix, spans_ns: Matrix) -> Matrix:
        """Advance each state by its own span, shorter than a quantum; in place, by blocks that stay in the cache."""
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
        """Return the time [ns] at which form·z + offset first becomes negative; None when it does not within the span.

        The value must not be negative at the start; `z` and `form` have shape (n,). A change of sign is found, and so
        is a dip between two positive ends, from the signs of the rate there. If the rate changes sign twice within the
        span, a dip may be missed.
        """
        return self._search(z, self.advance(z, span_ns), span_ns, form, offset)

    def _search(self, z: Matrix, end: Matrix, span_ns: float, form: Matrix, offset: float) -> float | None:
        """Search as `first_negative` between two states; halve at powers of two, whose transitions are cached."""
        # Nothing to find: not negative at the end and, by the signs of the rate, no minimum inside.
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
        """Return the coefficients of form·exp(A·h)·z + offset as a polynomial in h [ns]."""
        term = z
        coefficients = [float(form @ z) + offset]
        for k in range(1, _TERMS):
            term = self.a @ term / k
            coefficients.append(float(form @ term))
        return coefficients


def moved(states: Matrix, transition: Matrix) -> Matrix:
    """Return each of the states (m, n) after the same transition (n, n); the result has shape (m, n)."""
    after = np.empty_like(states)
    for first in range(0, len(states), _BLOCK):
        rows = slice(first, first + _BLOCK)
        np.matmul(states[rows], transition.T, out=after[rows])
    return after


def _first_negative(series: list[float], span_ns: float) -> float | None:
    """Return the first time at which the polynomial is negative; its rate changes sign at most once."""
    if _value(series, span_ns) < 0.0:
        return _crossing(series, 0.0, span_ns)
    slope = [k * coefficient for k, coefficient in enumerate(series)][1:]
    lowest = _crossing([-coefficient for coefficient in slope], 0.0, span_ns)
    return _crossing(series, 0.0, lowest) if _value(series, lowest) < 0.0 else None


def _crossing(series: list[float], low: float, high: float) -> float:
    """Return the time of the sign change by bisection, to 2⁻⁶⁰ of the span.

    The polynomial is negative at the returned time, and was not negative at the last lower bound.
    """
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
