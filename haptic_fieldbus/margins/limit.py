"""The limit: the largest stiffness at which a loop is stable for every open value.

An open value is not known exactly, and has a range (`plant.Ranges`). The limit is the smallest limit of stability over
these ranges.

The search tries the corners of the ranges. For a spring the limit is close to b/(T/2 + td + λ): it grows with the
damping b, and falls with delay td and lag λ. The worst corner of a spring is therefore known except for the mass.
Virtual damping, virtual masses and couplings can reverse this: with much virtual damping a light device is worst.
Therefore all corners are tried, and of a compliant coupling places between its ends too: with virtual damping the load
may swing at the worst frequency between them. So may a virtual mass between the ends of the delay, and it may grow at
one stiffness and not at a larger one: beside virtual masses the middle of the delay is tried too, each corner at a
dense row of stiffnesses. Coupled axes are first all at the same corner. With damping one of them may be worst with a
short lag and the other with a long one. From the worst corner so far, each axis alone is therefore tried at its other
corners, until no limit is smaller. Tests draw benches from inside the ranges, and none has a smaller limit. That of a
damped virtual mass may be smaller there.

Delays that change from period to period, by jitter or by a drive whose control tick is not locked to SYNC, are covered
by the longest delay for springs and for weak virtual damping. With a virtual damping above about half of m/T, delays
that alternate may be worse than each of them; no limit covers that. A spring whose force is older by δ(t) at every
instant acts like a damping −K·δ(t), which is never below −K·δ_max, whatever the pattern. The small-gain condition for
varying delays agrees: with T(s) the closed loop at the shortest delay, |T(jω)|·δ_max·ω < 1 is enough (Kao & Lincoln,
Automatica 40(8), 2004, 1429), and at the resonance of a lightly damped spring this is K·δ_max < b − K·td again.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product

from haptic_fieldbus.margins.closed_loop import ClosedLoop
from haptic_fieldbus.margins.linear import EnvironmentOf
from haptic_fieldbus.margins.plant import Basis, Plant, Ranges
from haptic_fieldbus.numerals import rounded_down
from haptic_fieldbus.numerics.linear import StateSpace
from haptic_fieldbus.scenes.element import AnyElement

# Suggestion of stable values for an unstable scene.


@dataclass(frozen=True)
class Suggestion:
    """Values of a stable scene; None for a value that does not exist or makes no sense."""

    stiffness: float | None
    """Stable stiffness [N/m or N·m/rad], with the damping kept."""
    damping: float | None
    """Stabilising damping [N·s/m or N·m·s/rad], with the stiffness kept."""
    damping_limit: float | None
    """Limit of stability [N/m or N·m/rad] with that damping."""


def suggest(
    loop: ClosedLoop,
    environment_of: Callable[[float, float], StateSpace],
    stiffness: float,
    damping: float | None,
    limit_with: Callable[[float], float] | None = None,
) -> Suggestion:
    """Return round values that make an unstable scene stable; `damping` is None when the scene has none to vary.

    `environment_of` takes (stiffness, damping). `limit_with` returns the limit over all open values for a damping. The
    suggested stiffness is this limit at the present damping. The suggested damping is the smallest at which this limit
    is at least the present stiffness. If `limit_with` is None, the nominal limit of `loop` replaces it: the suggested
    stiffness is 0.7 times this limit, and the suggested damping makes it at least 1.2 times the present stiffness.
    """

    def damped(value: float) -> EnvironmentOf:
        return lambda stiffness: environment_of(stiffness, value)

    def limit_of(value: float) -> float:
        return limit_with(value) if limit_with is not None else loop.limit(damped(value))

    kept, asked = (0.7, 1.2 * stiffness) if limit_with is None else (1.0, stiffness)
    least = kept * limit_of(damping or 0.0)
    softer = rounded_down(least) if 0.0 < least < math.inf else None
    largest = 0.0 if damping is None else loop.largest_damping(damped(damping))
    for candidate in (each for each in _round_values(largest) if each > (damping or 0.0)):
        # One growth is much quicker to compute than a limit, and rules out most candidates.
        stable = loop.growth(environment_of(asked, candidate)) <= 1.0
        if stable and (limit := limit_of(candidate)) >= asked:
            return Suggestion(softer, candidate, limit)
    return Suggestion(softer, None, None)


def _round_values(largest: float) -> list[float]:
    """Return values with one or two digits over four decades, up to `largest`, in rising order."""
    top = math.floor(math.log10(largest)) if largest else 0
    values = [float(f"{digit}e{decade}") for decade in range(top - 4, top + 1) for digit in (1, 1.5, 2, 3, 4, 5, 7)]
    return [value for value in values if value <= largest]


MOST_MIXED = 3
"""Largest number of coupled axes whose masses are varied independently, at the worst corner for a spring."""
WORST = (0, 1, 1)
"""Worst corner for a spring: least friction, longest lag, longest delay."""
FACTOR, PRECISION = 2.0, 1e-6
"""Ratio of neighbouring stiffnesses of the search, and its relative precision: coarser than for the limit itself."""


@dataclass(frozen=True)
class Values:
    """Values of one axis within its ranges: mass, damping and friction in the workspace, torque lag and delay in s."""

    plant: Plant
    delay: float
    coupling: float = 1.0
    """Share of the stiffness of a compliant coupling."""

    def to_json(self) -> dict[str, float]:
        """Return the values that were varied, in the workspace of the axis."""
        told = {name: getattr(self.plant, name) for name in ("mass", "damping", "torque_lag")}
        return {**told, "delay_s": self.delay, "coupling_share": self.coupling}


@dataclass(frozen=True)
class Obstacle:
    """Element that exceeds its own limit even without the stiffer element beside it."""

    element: AnyElement
    limit: float
    """Limit of the element without the stiffer elements [N/m or N·m/rad]."""
    beside: str
    """Name of the element that varies."""


@dataclass(frozen=True)
class Limit:
    """Limit of a loop [N/m or N·m/rad]."""

    value: float
    """Stiffness up to which the loop is stable for every open value, rounded down to three digits; ∞: stable at any
    stiffness. Without a stiffness: ∞ if the loop is stable for every open value, else 0."""
    basis: Basis
    """Origin of the values of the bench; of several axes the least certain origin."""
    quantisation: float | None = None
    """Stiffness up to which the least friction holds the handle between two counts; None without quantisation."""
    judged_at: tuple[Values, ...] = ()
    """Values of each axis at which the loop has this limit; empty without a stiffness."""
    obstacle: Obstacle | None = None
    """Element that exceeds its own limit, so that the varied element can have no stiffness; None otherwise."""


def corners(axes: Sequence[tuple[Plant, Ranges]], delays: Sequence[float]) -> Iterator[tuple[Values, ...]]:
    """Yield the corners of the ranges of all axes; the worst corner for a spring comes first.

    All axes are at the same corner of friction, lag and delay, and at the same place of their compliant couplings. At
    the worst of these corners the masses of the axes are varied independently. `neighbours` varies the rest. Equal
    corners, of a value that is exact, are yielded once. `delays` are places in the range of the delay, of which its
    ends are 0 and 1.
    """
    count = len(axes)
    alike = [(1,) * count, (0,) * count]
    mixed = [each for each in product((1, 0), repeat=count) if each not in alike] if count <= MOST_MIXED else []
    seen = set[tuple[Values, ...]]()
    for friction, lag, delay, spring in product((0, 1), (1, 0), delays, SPRINGS):
        for heavy in alike + (mixed if (friction, lag, delay) == WORST else []):
            corner = tuple(
                _at(plant, ranges, mass, friction, lag, delay, spring)
                for (plant, ranges), mass in zip(axes, heavy, strict=True)
            )
            if corner not in seen:
                seen.add(corner)
                yield corner


def neighbours(axes: Sequence[tuple[Plant, Ranges]], at: tuple[Values, ...]) -> Iterator[tuple[Values, ...]]:
    """Yield the values of all axes where one axis alone is at another of its corners; its coupling stays."""
    for place, (plant, ranges) in enumerate(axes):
        own = dict.fromkeys(
            replace(_at(plant, ranges, mass, friction, lag, delay, 0.0), coupling=at[place].coupling)
            for mass, friction, lag, delay in product((0, 1), repeat=4)
        )
        yield from ((*at[:place], each, *at[place + 1 :]) for each in own if each != at[place])


SPRINGS = (0.0, 1.0, 0.5, 0.25, 0.75, 0.125, 0.375, 0.625, 0.875)
"""Places in the range of a compliant coupling, of which its ends are 0 and 1."""
ENDS, DELAYS = (1.0, 0.0), (1.0, 0.0, 0.5)
"""Places in the range of the delay: without virtual masses, and beside them."""


def _at(plant: Plant, ranges: Ranges, mass: int, friction: int, lag: int, delay: float, spring: float) -> Values:
    changed = replace(
        plant,
        mass=plant.mass * ranges.mass[mass],
        damping=plant.damping * ranges.damping[friction],
        coulomb=plant.coulomb * ranges.coulomb[friction],
        torque_lag=ranges.torque_lag[lag],
    )
    low, high = ranges.delay if ranges.total is None else ranges.total
    time = (1.0 - delay) * low + delay * high
    if ranges.total is not None:
        time = max(time - changed.torque_lag, 0.0)
    soft, stiff = ranges.coupling
    return Values(changed, time, soft * (stiff / soft) ** spring)


def least_friction(axes: Sequence[tuple[Plant, Ranges]]) -> tuple[Values, ...]:
    """Return the values of all axes with the least friction."""
    return tuple(_at(plant, ranges, 0, 0, 0, 0, 0) for plant, ranges in axes)
