"""Simulation of many closed loops at once in numpy: the loop of `sampled` with encoder, wall, saturation and friction.

Every loop has its own parameters. One step of all loops is a few dozen operations on whole arrays, in blocks that stay
in the cache. Loops with the same number of whole periods of delay share a block, so that their forces lie in one row.

Without friction a step is the exact linear map of `sampled`. With Coulomb friction the force is constant between the
instants at which it changes, so the handle reverses at most once in between. It slips to a standstill at a known time,
and then sticks, or slips in the other direction. Both cases are exact. A loop with the lag of a torque loop has no
friction, because this solution does not include a lag.

The numbers of each loop are, bit for bit, those of the same additions and multiplications in plain floats; with
friction, up to the rounding of numpy's logarithm and exponential.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from haptic_fieldbus.numerics import friction
from haptic_fieldbus.numerics.exact import expm1
from haptic_fieldbus.numerics.loops import Array, Flags, Loops
from haptic_fieldbus.numerics.sampled import split_delay

BLOCK = 2048
"""Number of loops whose rows fit into the second-level cache together."""


@dataclass(frozen=True, eq=False)
class Finished:
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
            found: Array = self.peaks[-1] / self.peaks[0]
        return found


def run(given: Loops, steps: int, parts: int = 10) -> Finished:
    """Run all loops for `steps` periods, in `parts` parts of about equal length."""
    total = len(given)
    result = Finished(np.empty(total), np.empty(total), np.zeros((parts, total)), np.empty(total, dtype=np.bool_))
    with np.errstate(over="ignore", invalid="ignore"):  # an unstable loop may overflow: `diverged` reports it
        for rows in _blocks(given):
            block = Running(given.part(rows))
            for part in range(parts):
                result.peaks[part, rows] = block.advance((part + 1) * steps // parts - part * steps // parts)
            result.position[rows], result.velocity[rows] = block.state[0], block.state[1]
    result.diverged[:] = ~(np.isfinite(result.position) & np.isfinite(result.velocity))
    return result


def _blocks(given: Loops) -> Iterator[NDArray[np.int64]]:
    """Yield blocks of row numbers; loops of a block have the same whole delay, and all have friction or none has."""
    whole = np.array([split_delay(*pair)[0] for pair in zip(given.delay.tolist(), given.period.tolist(), strict=True)])
    kinds = np.stack([whole, given.coulomb > 0.0])
    for kind in np.unique(kinds, axis=1).T:
        rows = np.flatnonzero((kinds == kind[:, None]).all(axis=0))
        yield from (rows[at : at + BLOCK] for at in range(0, len(rows), BLOCK))


class Running:
    """Loops of one block while they run: their states, and the forces that do not act yet."""

    def __init__(self, loops: Loops) -> None:
        self._loops = loops
        splits = [split_delay(*pair) for pair in zip(loops.delay.tolist(), loops.period.tolist(), strict=True)]
        self._whole, self._rest = splits[0][0], np.array([rest for _, rest in splits])
        zero = np.zeros(len(loops))
        self.state = [loops.position.copy(), loops.velocity.copy()] + ([zero.copy()] if loops.lag.any() else [])
        self._inner = [zero.copy() for _ in range(loops.b.shape[1])]
        # Newest first. With n whole periods of delay F_{k−n} and F_{k−n−1} act, hence n + 2.
        self._forces = [zero.copy() for _ in range(self._whole + 2)]
        self._rows = None if loops.coulomb.any() else [_terms(row) for row in _maps(loops, self._rest)]
        self._step = np.where(loops.resolution > 0.0, loops.resolution, 1.0)
        self._is_ideal = loops.resolution == 0.0

    def advance(self, steps: int) -> Array:
        """Run for `steps` more periods and return the greatest |position| at their samples, (N,)."""
        peak = np.zeros(len(self._loops))
        for _ in range(steps):
            np.fmax(peak, np.abs(self.state[0]), out=peak)
            self._forces.insert(0, self._force(self._measured()))
            self._forces.pop()
            after, before = self._forces[self._whole], self._forces[self._whole + 1]
            if self._rows is None:
                self._slide(before, after)
            else:
                known = (*self.state, before, after, self._loops.push)
                self.state = [_sum(terms, known) for terms in self._rows]
        return peak

    def _measured(self) -> Array:
        """Return the position rounded to encoder counts; unchanged for loops without a resolution."""
        position = self.state[0]
        if self._is_ideal.all():
            return position
        counted: Array = np.floor(position / self._step + (self._loops.phase + 0.5)) * self._step
        return np.where(self._is_ideal, position, counted) if self._is_ideal.any() else counted

    def _force(self, position: Array) -> Array:
        loops, inner = self._loops, self._inner
        force: Array = loops.d * position
        for place, value in enumerate(inner):
            force = force + loops.c[:, place] * value
        self._inner = [
            sum((loops.a[:, row, place] * value for place, value in enumerate(inner)), loops.b[:, row] * position)
            for row in range(len(inner))
        ]
        if loops.unilateral.any():
            force = np.where(loops.unilateral & ((position <= 0.0) | (force > 0.0)), 0.0, force)
        if np.isfinite(loops.saturation).any():
            force = np.clip(force, -loops.saturation, loops.saturation)
        return force

    def _slide(self, before: Array, after: Array) -> None:
        loops = self._loops
        device = friction.SampledMass(loops.mass, loops.damping, loops.coulomb)
        x, v = self.state[0], self.state[1]
        if self._rest.any():
            x, v = friction.slide(device, x, v, before + loops.push, self._rest)
        self.state = [*friction.slide(device, x, v, after + loops.push, loops.period - self._rest)]


Terms = list[tuple[int, Array]]


def _terms(row: list[Array]) -> Terms:
    """Return (place, factor) of the factors that are not zero everywhere."""
    return [(place, factor) for place, factor in enumerate(row) if factor.any()]


def _sum(terms: Terms, known: tuple[Array, ...]) -> Array:
    # One product after the other, unlike a dot product of numpy: this keeps the bits of the sum in plain floats.
    (place, factor), *others = terms
    total: Array = factor * known[place]
    for place, factor in others:
        total = total + factor * known[place]
    return total


def _maps(loops: Loops, rest: Array) -> list[list[Array]]:
    """Return the rows of the map of a period: factors of the states, the force before and after its change, the push.

    `rest` is the part δ of each period [s] in which the earlier force still acts.
    """
    first_transition, first = _held(loops, rest)
    rest_transition, after = _held(loops, loops.period - rest)
    before = rest_transition @ first
    known = [rest_transition @ first_transition, before, after]
    if loops.push.any():
        known.append(_pushed(loops))
    whole = np.concatenate(known, axis=2)
    order = whole.shape[1]
    return [[np.ascontiguousarray(whole[:, row, at]) for at in range(whole.shape[2])] for row in range(order)]


def _pushed(loops: Loops) -> Array:
    """Return the effect of a unit push in a period, (N, n, 1); a push of the hand does not pass the torque loop."""
    pushed = _held(replace(loops, lag=np.zeros(len(loops))), loops.period)[1]
    return pushed if not loops.lag.any() else np.concatenate([pushed, np.zeros_like(pushed[:, :1])], axis=1)


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
