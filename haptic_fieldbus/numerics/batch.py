"""Simulation of many closed loops at once in numpy: the loop of `sampled` with encoder, wall, saturation and friction.

Every loop has its own parameters. One step of all loops is a few dozen operations on whole arrays, in blocks that stay
in the cache. Loops with the same number of whole periods of delay share a block, so that their forces lie in one row.

Without friction a step is the exact linear map of `sampled`. With Coulomb friction the force is constant between the
instants at which it changes, so the handle reverses at most once in between. It slips until it stops at a known time.
Then it sticks, or slips in the other direction. Both cases are exact. A loop with the lag of a torque loop has no
friction, because this solution does not include a lag.

The numbers of each loop are, bit for bit, those of the same additions and multiplications in plain floats; with
friction, up to the rounding of numpy's logarithm and exponential.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.numerals import exactly
from haptic_fieldbus.numerics.linear import StateSpace, expm1
from haptic_fieldbus.numerics.sampled import split_delay

# Parameters of many closed loops for `batch`.

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Numbers = float | Sequence[float] | Array | Flags


@dataclass(frozen=True, eq=False)
class Loops:
    """Parameters of N loops in SI; arrays (N,), the environment's a, b, c, d (N, k, k), (N, k), (N, k), (N,)."""

    mass: Array
    damping: Array
    period: Array
    delay: Array
    a: Array
    b: Array
    c: Array
    d: Array
    lag: Array
    coulomb: Array
    resolution: Array
    """One encoder count; 0 without an encoder."""
    phase: Array
    """Position of the encoder's zero within a count, as a share of a count."""
    unilateral: Flags
    """True for contact at positions above 0 only, without pulling."""
    saturation: Array
    """Largest force; ∞ without saturation."""
    push: Array
    """Constant force of the hand, in addition to the environment's force."""
    position: Array
    velocity: Array

    def __len__(self) -> int:
        return len(self.mass)

    def part(self, rows: NDArray[np.int64]) -> "Loops":
        """Return the loops with these row numbers, (n,)."""
        return replace(self, **{field.name: getattr(self, field.name)[rows] for field in fields(self)})


def loops(
    *,
    mass: Numbers,
    damping: Numbers,
    period: Numbers,
    delay: Numbers = 0.0,
    stiffness: Numbers = 0.0,
    virtual_damping: Numbers = 0.0,
    lag: Numbers = 0.0,
    coulomb: Numbers = 0.0,
    resolution: Numbers = 0.0,
    phase: Numbers = 0.0,
    unilateral: Numbers = False,
    saturation: Numbers = math.inf,
    push: Numbers = 0.0,
    position: Numbers = 0.0,
    velocity: Numbers = 0.0,
    environments: list[StateSpace] | None = None,
) -> Loops:
    """Return loops from numbers or arrays, broadcast to N loops.

    `environments`, discrete systems of equal order, replace the spring and its damper. The damper acts on the backward
    difference. Raises UsageError for impossible numbers, naming the first loop that has them.
    """
    given = {name: value for name, value in locals().items() if name != "environments"}
    _, *arrays = np.broadcast_arrays(np.zeros(1 if environments is None else len(environments)), *given.values())
    rows = {name: np.ravel(row).astype(np.float64) for name, row in zip(given, arrays, strict=True)}
    unilateral, spring, damper = (rows.pop(name) for name in ("unilateral", "stiffness", "virtual_damping"))
    if environments is None:
        # A period that is not above 0 is refused below; until then it must not divide.
        a, b, c, d = _spring_damper(spring, damper, np.where(rows["period"] > 0.0, rows["period"], 1.0))
    else:
        parts = ((each.a, each.b[:, 0], each.c[0], each.d[0, 0]) for each in environments)
        a, b, c, d = map(np.array, zip(*parts, strict=True))
    made = Loops(**rows, unilateral=unilateral != 0.0, a=a, b=b, c=c, d=d)
    _check(made)
    return made


def _spring_damper(k: Array, virtual: Array, period: Array) -> tuple[Array, Array, Array, Array]:
    """Return F_k = −K·x_k − B·(x_k − x_{k−1})/T as (a, b, c, d); without any damping it has no state."""
    order = 1 if virtual.any() else 0
    slope = virtual / period
    ones = np.ones((len(k), order))
    return np.zeros((len(k), order, order)), ones, slope[:, None] * ones, -k - slope


def _check(made: Loops) -> None:
    expected = [
        ("mass", "a number above 0", (made.mass > 0.0) & np.isfinite(made.mass)),
        ("period", "a time above 0 s", (made.period > 0.0) & np.isfinite(made.period)),
        ("d", "a number as stiffness", np.isfinite(made.d)),
        *(
            (name, "a number from 0 up", (getattr(made, name) >= 0.0) & np.isfinite(getattr(made, name)))
            for name in ("damping", "delay", "lag", "coulomb", "resolution")
        ),
        ("saturation", "a force above 0", made.saturation > 0.0),
        ("coulomb", "torque loop lag 0 with friction", (made.coulomb == 0.0) | (made.lag == 0.0)),
    ]
    for name, text, good in expected:
        if not good.all():
            at = int(np.argmin(good))
            raise UsageError(f"loop {at}: {name} {exactly(getattr(made, name)[at])}: expected {text}")


# Exact motion of a mass with viscous damping and Coulomb friction under a constant force, for many masses at once.
#
# A mass that slips in the direction s under the force F follows m·v′ = G − b·v with G = F − fc·s. With u = −b·v/G it
# comes to rest after the time t = −m·v/G·ln(1 + u)/u, at the distance m·v²/G·(ln(1 + u) − u)/u². It then sticks when
# |F| ≤ fc. Otherwise it slips in the direction of F and does not stop again. From rest, with w = b·t/m, it gains the
# velocity G·t/m·(1 − e⁻ʷ)/w and moves by G·t²/m·(w − 1 + e⁻ʷ)/w². For small u and w the quotients are computed as
# series.

SMALL = 0.02
"""Largest argument of the series; below it nine terms give all digits."""
TERMS = 9


@dataclass(frozen=True, eq=False)
class SampledMass:
    """Many masses: mass [kg], damping [N·s/m] and Coulomb friction [N], or the rotary counterparts; shape (n,) each."""

    mass: Array
    damping: Array
    coulomb: Array

    def part(self, rows: NDArray[np.bool_]) -> "SampledMass":
        """Return the masses for which `rows`, shape (n,), is true."""
        return SampledMass(self.mass[rows], self.damping[rows], self.coulomb[rows])


def slide(device: SampledMass, position: Array, velocity: Array, force: Array, span: Array) -> tuple[Array, Array]:
    """Return position and velocity after `span` [s] under a constant force; all arrays (n,)."""
    pushes = np.sign(force) * (np.abs(force) > device.coulomb)
    # A mass at rest moves only when the force exceeds friction; direction 0 means that it sticks.
    direction = np.where(velocity != 0.0, np.sign(velocity), pushes)
    net = np.where(direction != 0.0, force - direction * device.coulomb, 0.0)
    x, v = _slip(device, position, velocity, net, span)
    # A mass whose velocity has reversed came to rest within the span, and friction changed its sign there.
    wrong = (velocity != 0.0) & (v * direction < 0.0)
    reverses = wrong & (net * direction < 0.0)
    v[wrong & ~reverses] = 0.0  # by rounding: no force opposes what is left of the velocity
    if reverses.any():
        given = (values[reverses] for values in (position, velocity, force, span))
        x[reverses], v[reverses] = _through_rest(device.part(reverses), *given)
    return x, v


def _through_rest(device: SampledMass, x: Array, v: Array, force: Array, span: Array) -> tuple[Array, Array]:
    """Return position and velocity of masses that come to rest within the span."""
    net = force - np.sign(v) * device.coulomb
    u = -device.damping * v / net
    duration = -device.mass * v / net * _logarithm(u)
    stop = x + device.mass * v**2 / net * _logarithm_rest(u)
    pushes = np.sign(force) * (np.abs(force) > device.coulomb)
    onwards = np.where(pushes != 0.0, force - pushes * device.coulomb, 0.0)
    return _slip(device, stop, np.zeros_like(v), onwards, np.maximum(span - duration, 0.0))


def _slip(device: SampledMass, x: Array, v: Array, net: Array, span: Array) -> tuple[Array, Array]:
    """Return position and velocity under the force `net`, friction included, without a change of direction."""
    w = device.damping * span / device.mass
    first, second = _mean_decay(w), _mean_decay_rest(w)
    rate = net * span / device.mass
    return x + span * (first * v + second * rate), v + first * (rate - w * v)


def _quotient(factors: Array, exact: Callable[[Array], Array], x: Array) -> Array:
    """Return `exact` of x; for small arguments the series with these factors, the constant first."""
    small = np.abs(x) < SMALL
    # Small arguments are replaced before the division, as `np.where` evaluates both branches.
    return np.where(small, np.polyval(factors[::-1], x), exact(np.where(small, 1.0, x)))


_N = np.arange(TERMS)
_SIGNS = np.where(_N % 2, -1.0, 1.0)
_FACTORIALS = np.cumprod(np.concatenate([[1.0], np.arange(1.0, TERMS + 2)]))
_logarithm = partial(_quotient, _SIGNS / (_N + 1), lambda u: np.log1p(u) / u)
"""Function u → ln(1 + u)/u."""
_logarithm_rest = partial(_quotient, -_SIGNS / (_N + 2), lambda u: (np.log1p(u) - u) / u**2)
"""Function u → (ln(1 + u) − u)/u²."""
_mean_decay = partial(_quotient, _SIGNS / _FACTORIALS[1 : TERMS + 1], lambda w: -np.expm1(-w) / w)
"""Function w → (1 − e⁻ʷ)/w."""
_mean_decay_rest = partial(_quotient, _SIGNS / _FACTORIALS[2 : TERMS + 2], lambda w: (w + np.expm1(-w)) / w**2)
"""Function w → (w − 1 + e⁻ʷ)/w²."""

BLOCK = 2048
"""Number of loops whose rows fit into the second-level cache together."""


@dataclass(frozen=True, eq=False)
class FinalState:
    """State of N loops at the end of a run; arrays (N,), and `peaks` (parts, N): greatest |position| in each part."""

    position: Array
    velocity: Array
    peaks: Array
    diverged: Flags
    """True for loops whose position or velocity is not finite."""

    @property
    def growth(self) -> Array:
        """Peak of the last part over that of the first, (N,)."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(self.peaks[-1] / self.peaks[0])


def run(given: Loops, steps: int, parts: int = 10) -> FinalState:
    """Run all loops for `steps` periods, in `parts` parts of about equal length."""
    total = len(given)
    result = FinalState(np.empty(total), np.empty(total), np.zeros((parts, total)), np.empty(total, dtype=np.bool_))
    with np.errstate(over="ignore", invalid="ignore"):  # an unstable loop may overflow: `diverged` reports it
        for rows in _blocks(given):
            block = Running(given.part(rows))
            for part in range(parts):
                result.peaks[part, rows] = block.advance((part + 1) * steps // parts - part * steps // parts)
            result.position[rows], result.velocity[rows] = block.state[0], block.state[1]
    result.diverged[:] = ~(np.isfinite(result.position) & np.isfinite(result.velocity))
    return result


def _blocks(given: Loops) -> Iterator[NDArray[np.int64]]:
    """Yield blocks of row numbers; loops of a block have the same whole delay, and either all or none have friction."""
    whole = np.array([split_delay(*pair)[0] for pair in zip(given.delay.tolist(), given.period.tolist(), strict=True)])
    kinds = np.stack([whole, given.coulomb > 0.0])
    for kind in np.unique(kinds, axis=1).T:
        rows = np.flatnonzero((kinds == kind[:, None]).all(axis=0))
        yield from (rows[at : at + BLOCK] for at in range(0, len(rows), BLOCK))


class Running:
    """Loops of one block while they run: their states, and the forces that do not act yet.

    A step writes into arrays that are there already. A factor that all loops have in common is one number.
    """

    def __init__(self, loops: Loops) -> None:
        self._loops = loops
        splits = [split_delay(*pair) for pair in zip(loops.delay.tolist(), loops.period.tolist(), strict=True)]
        self._whole, self._rest = splits[0][0], np.array([rest for _, rest in splits])
        count, order = len(loops), loops.b.shape[1]
        states = [loops.position, loops.velocity] + ([np.zeros(count)] if loops.lag.any() else [])
        self.state, self._next, self._products = (np.array(states) for _ in range(3))
        self._inner, self._next_inner = np.zeros((order, count)), np.zeros((order, count))
        # Newest first. With n whole periods of delay F_{k−n} and F_{k−n−1} act, hence n + 2.
        self._forces = [np.zeros(count) for _ in range(self._whole + 2)]
        self._terms = None if loops.coulomb.any() else _terms(loops, self._rest)
        self._step = _common(np.where(loops.resolution > 0.0, loops.resolution, 1.0))
        self._offset = _common(loops.phase + 0.5)
        self._ideal = loops.resolution == 0.0
        self._has_encoder, self._has_ideal = not self._ideal.all(), bool(self._ideal.any())
        self._has_stop, self._is_limited = bool(loops.unilateral.any()), bool(np.isfinite(loops.saturation).any())
        self._d, self._c, self._b = (_common(each) for each in (loops.d, loops.c.T, loops.b.T))
        self._a = [(row, at, _common(loops.a[:, row, at])) for row, at in np.argwhere(loops.a.any(axis=0)).tolist()]
        self._measured, self._product = np.empty(count), np.empty(count)

    def advance(self, steps: int) -> Array:
        """Run for `steps` more periods and return the greatest |position| at their samples, (N,)."""
        peak, product = np.zeros(len(self._loops)), self._product
        for _ in range(steps):
            np.fmax(peak, np.abs(self.state[0], out=product), out=peak)
            self._forces.insert(0, self._force(self._measure(), self._forces.pop()))
            after, before = self._forces[self._whole], self._forces[self._whole + 1]
            if self._terms is None:
                self._slide(before, after)
            else:
                self._move(self._terms, (*self.state, before, after, self._loops.push))
        return peak

    def _measure(self) -> Array:
        """Return the position rounded to encoder counts; unchanged for loops without a resolution."""
        position: Array = self.state[0]
        counted = self._measured
        if not self._has_encoder:
            return position
        np.floor(np.add(np.divide(position, self._step, out=counted), self._offset, out=counted), out=counted)
        counted *= self._step
        if self._has_ideal:
            np.copyto(counted, position, where=self._ideal)
        return counted

    def _force(self, position: Array, force: Array) -> Array:
        """Write the new force into `force`, and step the states of the environment."""
        loops, inner, product = self._loops, self._inner, self._product
        np.multiply(self._d, position, out=force)
        for factor, value in zip(self._c, inner, strict=True):
            force += np.multiply(factor, value, out=product)
        np.multiply(self._b, position, out=self._next_inner)
        for row, at, factor in self._a:
            self._next_inner[row] += np.multiply(factor, inner[at], out=product)
        self._inner, self._next_inner = self._next_inner, inner
        if self._has_stop:
            np.copyto(force, 0.0, where=loops.unilateral & ((position <= 0.0) | (force > 0.0)))
        if self._is_limited:
            np.clip(force, -loops.saturation, loops.saturation, out=force)
        return force

    def _move(self, terms: "Terms", known: tuple[Array, ...]) -> None:
        """Step the states of loops without friction."""
        # One product after the other, unlike a dot product of numpy: this keeps the bits of the sum in plain floats.
        new, products = self._next, self._products
        new.fill(-0.0)  # the only number to which a sum can be added without a change of any bit
        for place, (factors, rows) in enumerate(terms):
            new[rows] += np.multiply(factors, known[place], out=products[rows])
        self._next, self.state = self.state, new

    def _slide(self, before: Array, after: Array) -> None:
        loops = self._loops
        device = SampledMass(loops.mass, loops.damping, loops.coulomb)
        x, v = self.state
        if self._rest.any():
            x, v = slide(device, x, v, before + loops.push, self._rest)
        self.state[:] = slide(device, x, v, after + loops.push, loops.period - self._rest)


Terms = list[tuple[Array, slice]]
"""By the number of a known value: its factors in the rows of the map that have one, and these rows."""


def _common(factors: Array) -> Array:
    """Return factors (..., N), or (..., 1) where they are the same in all loops."""
    return factors[..., :1].copy() if (factors == factors[..., :1]).all() else np.ascontiguousarray(factors)


def _terms(loops: Loops, rest: Array) -> Terms:
    """Return the map of a period by columns, each without the rows at its end that it does not act on.

    The columns are the factors of the states, the force before and after its change, and the push. `rest` is the part δ
    of each period [s] in which the earlier force still acts.
    """
    first_transition, first = _held(loops, rest)
    rest_transition, after = _held(loops, loops.period - rest)
    known = [rest_transition @ first_transition, rest_transition @ first, after]
    if loops.push.any():  # which does not pass the torque loop
        pushed = _held(replace(loops, lag=np.zeros(len(loops))), loops.period)[1]
        known.append(np.pad(pushed, ((0, 0), (0, after.shape[1] - 2), (0, 0))))
    columns = np.ascontiguousarray(np.concatenate(known, axis=2).T)
    ends = [max(np.flatnonzero(column.any(axis=1)).tolist(), default=-1) + 1 for column in columns]
    return [(_common(column[:end]), slice(end)) for column, end in zip(columns, ends, strict=True)]


def _held(loops: Loops, span: Array) -> tuple[Array, Array]:
    """Return (Φ, Γ) of each device over its span [s], shapes (N, n, n) and (N, n, 1), for a held force."""
    order = 3 if loops.lag.any() else 2
    system = np.zeros((len(loops), order + 1, order + 1))
    system[:, 0, 1] = 1.0
    system[:, 1, 1], system[:, 1, 2] = -loops.damping / loops.mass, 1.0 / loops.mass
    if order == 3:
        slow = loops.lag > 0.0
        system[:, 2, 2] = np.where(slow, -1.0 / np.where(slow, loops.lag, 1.0), 0.0)
        system[:, 2, 3] = -system[:, 2, 2]
        # A loop without lag among loops with one: its force acts on the mass directly, and its third state is unused.
        system[~slow, 1, 3], system[~slow, 1, 2] = system[~slow, 1, 2], 0.0
    increments = _increments(system * span[:, None, None])[:, :order]
    return increments[:, :, :order] + np.eye(order), increments[:, :, order:]


def _increments(systems: Array) -> Array:
    """Return eˣ − I of each system, shape as given.

    `expm1` takes the number of doublings from the largest norm that it is given. Systems of like norm are therefore
    computed together, so that the digits of a loop do not depend on the other loops.
    """
    doublings = np.frexp(np.abs(systems).sum(axis=-1).max(axis=-1))[1]
    result = np.empty_like(systems)
    for count in np.unique(doublings):
        rows = doublings == count
        result[rows] = expm1(systems[rows])
    return result
