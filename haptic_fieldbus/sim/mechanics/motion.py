"""The modes of motion of the shaft, each a linear system: slipping or sticking, with a hand or without.

States: shaft angle θ and speed ω, motor torque τ, stretch δ = φ_h − θ of the hand's spring and the hand's speed ν, the
hand's force f and its slope g, the target u of the torque loop and the friction torque c:

    θ' = ω          ω' = (τ + c − b·ω + k·δ + d·(ν − ω)) / J         τ' = (u − τ) / T
    δ' = ν − ω      ν' = (f − k·δ − d·(ν − ω)) / m                   f' = g,  g' = −Ω²·f

While sticking, θ and ω are constant and the other equations hold. All quantities are at the motor shaft, SI.
"""

import math
from dataclasses import dataclass

import numpy as np

from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.numerals import exactly, rounded
from haptic_fieldbus.numerics.linear import Matrix, expm
from haptic_fieldbus.sim.hand import Grip

# A linear motion ż = A z, followed exactly over any time.
#
# Theory: over whole nanoseconds, z moves by the matrix exponential, which is cached for each span. Any other span is
# split into powers of two of a nanosecond, whose exponentials are cached too, and a rest shorter than a nanosecond.
# Over the rest, a few terms of the Taylor series of the exponential are exact to rounding. For many states at once, the
# split ends at `quantum_ns`, and the series needs a dozen terms. The same series, projected on a linear form p·z + p0,
# is a polynomial in time; its sign gives the instant at which the form becomes negative.
#
# Inside, times are in nanoseconds and A is per nanosecond.

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
        """Prepare the motion; `rate` [1/s] covers changes that the eigenvalues of `a` do not show.

        Raises UsageError for a motion that is too fast for the series.
        """
        self.a = a * 1e-9
        fastest = max(float(np.abs(np.linalg.eigvals(self.a)).max()), rate * 1e-9)
        if not fastest <= FASTEST:
            found, most = rounded(fastest * 1e9), exactly(FASTEST * 1e9)
            raise UsageError(
                f"the simulated mechanics has a rate of {found} 1/s; expected at most {most} 1/s: less stiffness or "
                "damping, or more inertia"
            )
        # The largest power of two of a nanosecond whose product with the fastest rate is at most 1/4.
        self._smallest = max(0, int(np.floor(np.log2(0.25 / fastest)))) if fastest > 0 else 20
        self.quantum_ns = float(1 << self._smallest)
        # Over less than a nanosecond the k-th term is below fastest^k/k!; terms below 1e-20 are omitted.
        self._rest_terms = next((k for k in range(2, _TERMS) if fastest**k < math.factorial(k) * 1e-20), _TERMS)
        self._transitions: dict[int, Matrix] = {}

    def transition(self, span_ns: int) -> Matrix:
        """Return exp(A·span), shape (n, n), for a span of whole nanoseconds."""
        if (matrix := self._transitions.get(span_ns)) is None:
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
            if len(due := np.flatnonzero(whole >> power & 1)):
                states[due] = moved(states[due], self.transition(1 << power + self._smallest))
        # A block stays in the cache, and is advanced in place.
        transposed = self.a.T
        for first in range(0, len(states), _BLOCK):
            rows = slice(first, first + _BLOCK)
            block, span = states[rows], rest[rows, np.newaxis]
            term = block.copy()
            for k in range(1, _TERMS):
                term = term @ transposed
                term *= span / k
                block += term
        return states

    def first_negative(self, z: Matrix, span_ns: float, form: Matrix, offset: float) -> float | None:
        """Return the time [ns] at which form·z + offset first becomes negative; None if it stays above within the span.

        The value must not be negative at the start; `z` and `form` have shape (n,). It finds a change of sign, and a
        dip between two positive ends by the signs of the rate at the ends. If the rate changes sign twice within the
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
            # form·exp(A·h)·z + offset as a polynomial in h [ns].
            term, coefficients = z, [float(form @ z) + offset]
            for k in range(1, _TERMS):
                term = self.a @ term / k
                coefficients.append(float(form @ term))
            return _first_negative(coefficients, span_ns)
        cut_ns = 1 << math.ceil(math.log2(span_ns)) - 1
        middle = self.transition(cut_ns) @ z
        if (early := self._search(z, middle, cut_ns, form, offset)) is not None:
            return early
        late = self._search(middle, end, span_ns - cut_ns, form, offset)
        return None if late is None else cut_ns + late


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


ANGLE, SPEED, TORQUE, STRETCH, HAND_SPEED, FORCE, SLOPE, TARGET, FRICTION = range(9)
ORDER = 9
State = tuple[float, ...]
"""All states, the nine of this module first, in this order."""

LONGEST_POWER = 48
"""Powers of two of a nanosecond that a prepared motion knows; together three days."""
_COUPLED = (SPEED, TORQUE, STRETCH, HAND_SPEED, FORCE, SLOPE, TARGET, FRICTION)
# Entries of the transition matrix that may be neither 0 nor 1, in the order in which `_held` and `_free` unpack them.
_HELD_ENTRIES = (
    *((row, column) for row in (ANGLE, SPEED, STRETCH, HAND_SPEED) for column in _COUPLED),
    *((TORQUE, TORQUE), (TORQUE, TARGET), (FORCE, FORCE), (FORCE, SLOPE), (SLOPE, FORCE), (SLOPE, SLOPE)),
)
_FREE_ENTRIES = (
    *((row, column) for row in (ANGLE, SPEED) for column in (SPEED, TORQUE, TARGET, FRICTION)),
    *((TORQUE, TORQUE), (TORQUE, TARGET)),
)


@dataclass(frozen=True)
class Shaft:
    """Inertia [kg·m²], viscous damping [N·m·s/rad], Coulomb friction [N·m] and lag of the torque loop [s]."""

    inertia: float
    damping: float
    coulomb: float
    lag: float


class Motion:
    """One mode of motion; `step` is the work of every period, in plain floats on the entries that are not zero."""

    def __init__(self, shaft: Shaft, grip: Grip | None, *, sticking: bool) -> None:
        self.flow = Flow(_matrix(shaft, grip, sticking))
        self._kernel = _free if grip is None else _held
        self._entries = _FREE_ENTRIES if grip is None else _HELD_ENTRIES
        self._tables: dict[int, tuple[float, ...]] = {}
        self._powers: tuple[tuple[float, ...], ...] = ()
        """Tables of 1, 2, 4 … ns once the motion is prepared."""

    def prepare(self, usual_ns: int) -> None:
        """Prepare steps of any length, so that no exponential is computed from now on.

        A step then consists of a few steps over powers of two, with the same accuracy; a step of `usual_ns` is built at
        once.
        """
        self._tables[usual_ns] = self._table(usual_ns)
        self._powers = tuple(self._table(1 << power) for power in range(LONGEST_POWER))

    def step(self, state: State, span_ns: int) -> State:
        """Return the state after a whole number of nanoseconds."""
        if (table := self._tables.get(span_ns)) is None:
            if self._powers:
                while span_ns:
                    power = min(span_ns.bit_length(), LONGEST_POWER) - 1
                    state = self._kernel(state, self._powers[power])
                    span_ns -= 1 << power
                return state
            # The spans of a run repeat, so the cache rarely fills.
            if len(self._tables) >= MAX_TRANSITIONS:
                self._tables.clear()
            table = self._tables[span_ns] = self._table(span_ns)
        return self._kernel(state, table)

    def _table(self, span_ns: int) -> tuple[float, ...]:
        transition = self.flow.transition(span_ns)
        return tuple(float(transition[entry]) for entry in self._entries)


def _matrix(shaft: Shaft, grip: Grip | None, sticking: bool) -> Matrix:
    a = np.zeros((ORDER, ORDER))
    a[TORQUE, TARGET], a[TORQUE, TORQUE] = 1 / shaft.lag, -1 / shaft.lag
    k, d = (grip.stiffness, grip.damping) if grip is not None else (0.0, 0.0)
    if grip is not None:
        a[STRETCH, HAND_SPEED], a[STRETCH, SPEED] = 1.0, -1.0
        a[HAND_SPEED, FORCE], a[HAND_SPEED, STRETCH] = 1 / grip.inertia, -k / grip.inertia
        a[HAND_SPEED, HAND_SPEED], a[HAND_SPEED, SPEED] = -d / grip.inertia, d / grip.inertia
        a[FORCE, SLOPE], a[SLOPE, FORCE] = 1.0, -(grip.angular_frequency**2)
    if not sticking:
        a[ANGLE, SPEED] = 1.0
        a[SPEED, TORQUE] = a[SPEED, FRICTION] = 1 / shaft.inertia
        a[SPEED, SPEED] = -(shaft.damping + d) / shaft.inertia
        a[SPEED, STRETCH], a[SPEED, HAND_SPEED] = k / shaft.inertia, d / shaft.inertia
    return a


def _free(state: State, table: tuple[float, ...]) -> State:
    aw, at, au, ac, ww, wt, wu, wc, tt, tu = table
    angle, speed, torque, stretch, hand, force, slope, target, friction = state
    return (
        angle + aw * speed + at * torque + au * target + ac * friction,
        ww * speed + wt * torque + wu * target + wc * friction,
        tt * torque + tu * target,
        stretch,
        hand,
        force,
        slope,
        target,
        friction,
    )


def _held(state: State, table: tuple[float, ...]) -> State:
    # fmt: off
    (aw, at, ad, ah, af, ag, au, ac,
     ww, wt, wd, wh, wf, wg, wu, wc,
     dw, dt, dd, dh, df, dg, du, dc,
     hw, ht, hd, hh, hf, hg, hu, hc,
     tt, tu, ff, fg, gf, gg) = table
    w, t, d, h, f, g, u, c = state[1:]
    return (
        state[0] + aw * w + at * t + ad * d + ah * h + af * f + ag * g + au * u + ac * c,
        ww * w + wt * t + wd * d + wh * h + wf * f + wg * g + wu * u + wc * c,
        tt * t + tu * u,
        dw * w + dt * t + dd * d + dh * h + df * f + dg * g + du * u + dc * c,
        hw * w + ht * t + hd * d + hh * h + hf * f + hg * g + hu * u + hc * c,
        ff * f + fg * g,
        gf * f + gg * g,
        u,
        c,
    )
    # fmt: on
