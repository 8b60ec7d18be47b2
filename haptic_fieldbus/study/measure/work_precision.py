"""Error against cost: problem × method × step size.

A point is one run over the problem's horizon with one step size. Its errors are those of the force, against the exact
one; its cost is that of the step the loop runs. A run that leaves the finite numbers has no error, and stays a point.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from haptic_fieldbus.numerics import integrators
from haptic_fieldbus.numerics.integrators import METHODS
from haptic_fieldbus.numerics.integrators.trajectory import follow
from haptic_fieldbus.numerics.sampled import spectral_radius
from haptic_fieldbus.study.measure.problems import Problem, peak
from haptic_fieldbus.study.measure.timing import ns_per_call

GROWS = 1e-6
"""A spectral radius this little above 1 may be the rounding of a double root."""
ROUNDING = 1e-11
"""Of the peak force: errors below it tell nothing of an order."""
TIMED_STEPS = 200


@dataclass(frozen=True)
class Point:
    """One run; errors in N, None where it left the finite numbers; `order` is that of the whole set."""

    problem: str
    method: str
    period_s: float
    error_final: float | None
    error_rms: float | None
    error_max: float | None
    ns_per_step: float
    order: float | None
    """As measured with the smallest steps; None where the error is only rounding."""
    stable: bool
    """No mode of the step (or of the loop) grows, and the run stayed finite."""


@dataclass(frozen=True)
class Set:
    """All step sizes of one method on one problem, the largest first."""

    problem: str
    method: str
    points: tuple[Point, ...]
    claimed: float | None
    """Order; ∞: exact for this input, None: nothing is claimed."""
    peak: float
    """Largest exact force [N]."""

    @property
    def order(self) -> float | None:
        return self.points[0].order


def errors(
    measured: NDArray[np.float64], exact: NDArray[np.float64]
) -> tuple[float | None, float | None, float | None]:
    """(final, rms, max) [N]; None for a run that ended early or whose error overflows."""
    if len(measured) < len(exact):
        return None, None, None
    with np.errstate(over="ignore", invalid="ignore"):
        error = np.abs(measured - exact)
        figures = float(error[-1]), float(np.sqrt(np.mean(error**2))), float(error.max())
    return figures if all(map(math.isfinite, figures)) else (None, None, None)


def measured_order(points: Sequence[Point], peak: float) -> float | None:
    """Slope of log rms error by log period between the two smallest steps whose errors are more than rounding."""
    told = [(p.period_s, p.error_rms) for p in points if p.error_rms is not None and p.error_rms > ROUNDING * peak]
    if len(told) < 2:
        return None
    (wide, large), (narrow, small) = told[-2:]
    return math.log(large / small) / math.log(wide / narrow)


def with_order(points: list[Point], peak: float) -> tuple[Point, ...]:
    order = measured_order(points, peak)
    return tuple(replace(point, order=order) for point in points)


def measure(problem: Problem, method: str, steps: Sequence[int]) -> Set:
    largest = peak(problem)
    points = [_point(problem, method, count) for count in steps]
    return Set(problem.name, method, with_order(points, largest), problem.claimed_order(METHODS[method]), largest)


def _point(problem: Problem, method: str, steps: int) -> Point:
    period = problem.horizon / steps
    inputs = problem.motion.inputs(period, steps)
    one = integrators.discretise(problem.space, period, method)
    run = follow(one, inputs, [0.0] * problem.space.order)
    figures = errors(run.outputs[:, 0], problem.exact(period, steps))
    stable = figures[0] is not None and spectral_radius(one.system.a) <= 1.0 + GROWS
    return Point(problem.name, method, period, *figures, _cost(problem, method, period), None, stable)


def _cost(problem: Problem, method: str, period: float) -> float:
    """Of the step that the loop would run, in plain floats [ns]."""
    step = integrators.bind(problem.space, period, method)
    positions, velocities = problem.motion.inputs(problem.horizon / TIMED_STEPS, TIMED_STEPS).T.tolist()
    return ns_per_call(step, *((positions, velocities) if problem.space.uses_velocity else (positions,)))
