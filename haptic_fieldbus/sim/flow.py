"""A linear motion ż = A z, followed exactly over any time.

Theory: over whole nanoseconds z moves by the matrix exponential, kept for each span. Any other span is a sum of powers
of two of a nanosecond, whose exponentials are kept as well, and a rest shorter than `quantum_ns`, over which the Taylor
series of the exponential converges to rounding in a dozen terms. The same series, projected on a linear form p·z + p0,
is a polynomial in time: that is how the instant is found at which the form becomes negative.
Inside, times are nanoseconds and A is per nanosecond.
"""

import numpy as np

from haptic_fieldbus.numerics.exact import expm
from haptic_fieldbus.numerics.linear import Matrix

MAX_TRANSITIONS = 4096
_TERMS = 16
"""Of the Taylor series; at a rate of 1/4 a quantum the first one left out is below 1e-22."""
_BISECTIONS = 60


class Flow:
    """One mode of motion; `a` in 1/s, shape (n, n)."""

    def __init__(self, a: Matrix) -> None:
        self.a = a * 1e-9
        rate = float(np.abs(np.linalg.eigvals(self.a)).max())
        self._smallest = max(0, int(np.floor(np.log2(0.25 / rate)))) if rate > 0 else 20
        self.quantum_ns = float(1 << self._smallest)
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
        whole = int(span_ns / self.quantum_ns)
        rest = span_ns - whole * self.quantum_ns
        for power in range(whole.bit_length()):
            if whole >> power & 1:
                z = self.transition(1 << power + self._smallest) @ z
        term = z
        for k in range(1, _TERMS):
            term = self.a @ term * (rest / k)
            z = z + term
        return z

    def advance_many(self, states: Matrix, spans_ns: Matrix) -> Matrix:
        """Each state after its own span ≥ 0; states (m, n), spans (m,)."""
        states = states.copy()
        whole = np.floor(spans_ns / self.quantum_ns).astype(np.int64)
        rest = spans_ns - whole * self.quantum_ns
        for power in range(int(whole.max(initial=0)).bit_length()):
            rows = (whole >> power & 1).astype(bool)
            if rows.any():
                states[rows] = states[rows] @ self.transition(1 << power + self._smallest).T
        term = states
        for k in range(1, _TERMS):
            term = (term @ self.a.T) * (rest[:, np.newaxis] / k)
            states = states + term
        return states

    def first_negative(self, z: Matrix, span_ns: float, form: Matrix, offset: float) -> float | None:
        """When form·z + offset first becomes negative within the span [ns]; None when it does not.

        It is not negative at the start. Found are a change of sign and a dip between two positive ends, told by the
        sign of its rate; a form whose rate changes sign twice within the span may hide one.
        """
        end = self.advance(z, span_ns)
        rate = form @ self.a
        if form @ end + offset >= 0.0 and not (rate @ z < 0.0 < rate @ end):
            return None
        if span_ns <= self.quantum_ns:
            return _first_negative(self._series(z, form, offset), span_ns)
        half = span_ns / 2
        early = self.first_negative(z, half, form, offset)
        if early is not None:
            return early
        late = self.first_negative(self.advance(z, half), half, form, offset)
        return None if late is None else half + late

    def _series(self, z: Matrix, form: Matrix, offset: float) -> list[float]:
        """Coefficients of form·exp(A·h)·z + offset in h [ns]."""
        term = z
        coefficients = [float(form @ z) + offset]
        for k in range(1, _TERMS):
            term = self.a @ term / k
            coefficients.append(float(form @ term))
        return coefficients


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
