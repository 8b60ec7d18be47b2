"""Error against cost: problem × method × step size.

A point is one run over the problem's horizon with one step size. Its errors are those of the force against the exact
force. Its cost is that of the step as the loop runs it. The arithmetic is the same for any step size, so the methods of
a problem are timed in turn, once. A run that overflows has no error, but is kept as a point.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from haptic_fieldbus.numerics import integrators
from haptic_fieldbus.numerics.batch import Array
from haptic_fieldbus.numerics.integrators import METHODS
from haptic_fieldbus.numerics.integrators.method import follow
from haptic_fieldbus.numerics.linear import StateSpace, system_of
from haptic_fieldbus.numerics.sampled import spectral_radius
from haptic_fieldbus.study.measure.problems import Problem, peak
from haptic_fieldbus.study.measure.timing import Cost, Quartiles, Timed, in_turn

# Largest stable step of each method: the claim of the method, and the result of bisection on its own step.

LARGEST = 1e3
"""Step above which a method counts as stable with any step."""
EXCESS = 1e-7
"""Excess of a spectral radius over 1 that may be rounding; a double root loses half of the digits."""


@dataclass(frozen=True)
class StepLimit:
    """Claimed and measured limits; ∞ when any step is stable.

    Steps are in units of √(m/k) for the undamped oscillator, and of the time constant for a decay.
    """

    method: str
    oscillator_claimed: float
    oscillator_measured: float
    lag_claimed: float
    lag_measured: float
    radius: float
    """Spectral radius of the step at T·ω = 0.1 on the undamped oscillator."""


def oscillator(square: float, damping: float = 0.0) -> StateSpace:
    """Return the oscillator p̈ = −square·p − damping·ṗ with the output p."""
    return system_of([[0.0, 1.0], [-square, -damping]], [[0.0], [0.0]], [[1.0, 0.0]], [[0.0]])


def _largest(radius: Callable[[float], float]) -> float:
    """Return the largest stable step between 1e-3 and 1e3; 0 if the smallest step grows, ∞ if no step grows."""
    low, high = 1e-3, LARGEST
    if radius(low) > 1.0 + EXCESS:
        return 0.0
    if radius(high) <= 1.0 + EXCESS:
        return math.inf
    while high - low > 1e-12 * high:
        # The geometric mean halves decades, the arithmetic one digits.
        middle = math.sqrt(low * high) if high > 2.0 * low else 0.5 * (low + high)
        low, high = (middle, high) if radius(middle) <= 1.0 + EXCESS else (low, middle)
    return low


def step_limit(name: str) -> StepLimit:
    """Return claimed and measured limits of a method."""
    method = METHODS[name]

    def radius(space: StateSpace) -> float:
        return spectral_radius(integrators.discrete(space, 1.0, name).a)

    swing = _largest(lambda h: radius(oscillator(h * h)))
    lag = _largest(lambda h: radius(system_of([[-h]], [[h]], [[1.0]], [[0.0]])))
    return StepLimit(name, method.oscillator_limit, swing, method.lag_limit, lag, radius(oscillator(0.1 * 0.1)))


GROWS = 1e-6
"""Excess of a spectral radius over 1 that may be rounding; a double root loses half of the digits."""
ROUNDING = 1e-11
"""Share of the peak force below which errors are rounding, and show no order."""
FAILED = 10.0
"""Error, as a multiple of the largest force, beyond which a run counts as failed."""
FIXED_PERIOD = 1e-3
"""Period at which methods are compared in words and tables [s]."""
TIMED_STEPS = 200
"""Steps in one timed pass."""


@dataclass(frozen=True)
class Point:
    """One run; errors in N, None when it overflowed."""

    problem: str
    method: str
    period_s: float
    error_final: float | None
    error_rms: float | None
    error_max: float | None
    ns_per_step: float
    ns_quartiles: Quartiles
    """Quartiles of the cost over the repeats [ns]."""
    order: float | None
    """Order measured with the smallest steps of the whole set; None when their errors are only rounding."""
    stable: bool
    """True when no mode of the step (or of the loop) grows, and the run stayed finite."""


@dataclass(frozen=True)
class Set:
    """Points of one method on one problem, the largest step first."""

    problem: str
    method: str
    points: tuple[Point, ...]
    claimed: float | None
    """Claimed order; ∞ when the method is exact for this input, None when it claims nothing."""
    peak: float
    """Largest exact force [N]."""
    cost: Cost
    """Cost of a step; the methods of one problem were timed in turn."""

    @property
    def order(self) -> float | None:
        """Measured order, the same in all points."""
        return self.points[0].order


def has_failed(point: Point, peak: float) -> bool:
    """Return whether a run overflowed or has an error beyond `FAILED`; it is drawn in the zone of failures."""
    return point.error_rms is None or point.error_rms > FAILED * peak


def computing(point: Point) -> float:
    """Return the computing time for one second of simulated time [µs]."""
    return 1e-3 * point.ns_per_step / point.period_s


def at_fixed_period(runs: Set) -> Point:
    """Return the run whose period is nearest to `FIXED_PERIOD`, on a logarithmic scale."""
    return min(runs.points, key=lambda point: abs(math.log(point.period_s / FIXED_PERIOD)))


def errors(
    measured: NDArray[np.float64], exact: NDArray[np.float64]
) -> tuple[float | None, float | None, float | None]:
    """Return final, rms and largest error [N]; all None when the run ended early or its error overflows.

    `found` has the shape `(n,)`; `exact` is as long or longer.
    """
    if len(measured) < len(exact):
        return None, None, None
    with np.errstate(over="ignore", invalid="ignore"):
        error = np.abs(measured - exact)
        figures = float(error[-1]), float(np.sqrt(np.mean(error**2))), float(error.max())
    return figures if all(map(math.isfinite, figures)) else (None, None, None)


def with_order(points: list[Point], peak: float) -> tuple[Point, ...]:
    """Return the points, the largest step first, with the order of their set.

    It is the slope of log rms error over log period between the two smallest steps with an error above rounding, and
    None when fewer than two steps have an error above rounding.
    """
    told = [(p.period_s, p.error_rms) for p in points if p.error_rms is not None and p.error_rms > ROUNDING * peak]
    order = None
    if len(told) > 1:
        (wide, large), (narrow, small) = told[-2:]
        order = math.log(large / small) / math.log(wide / narrow)
    return tuple(replace(point, order=order) for point in points)


def measure(problem: Problem, method: str, steps: Sequence[int], cost: Cost | None = None) -> Set:
    """Return the points of one method, one for each number of steps; without a cost it is timed by itself."""
    cost = cost or step_costs(problem, [method])[method]
    largest = peak(problem)
    points = [_point(problem, method, count, cost) for count in steps]
    return Set(problem.name, method, with_order(points, largest), problem.claimed_order(METHODS[method]), largest, cost)


@lru_cache(maxsize=32)
def reference(problem: Problem, steps: int) -> Array:
    """Return the exact force at the samples [N], `(steps + 1,)`; computed once for all methods of a problem."""
    return problem.exact(problem.horizon / steps, steps)


def step_costs(problem: Problem, methods: Iterable[str]) -> dict[str, Cost]:
    """Return the costs of the steps that the loop would run, in plain floats; the methods take turns."""
    period = problem.horizon / TIMED_STEPS
    positions, velocities = problem.motion.inputs(period, TIMED_STEPS).T.tolist()
    given = (positions, velocities) if problem.space.uses_velocity else (positions,)
    steps = {method: integrators.bind(problem.space, period, method) for method in methods}
    return in_turn({method: Timed(step, lambda: given) for method, step in steps.items()})


def _point(problem: Problem, method: str, steps: int, cost: Cost) -> Point:
    period = problem.horizon / steps
    inputs = problem.motion.inputs(period, steps)
    # Accuracy from the matrices of the step, for speed; the cost is that of the step in plain floats (`step_costs`).
    one = integrators.discretise(problem.space, period, method)
    figures = errors(follow(one, inputs, [0.0] * problem.space.order).outputs[:, 0], reference(problem, steps))
    stable = figures[0] is not None and spectral_radius(one.system.a) <= 1.0 + GROWS
    return Point(problem.name, method, period, *figures, cost.ns, cost.quartiles, None, stable)
