"""Integrators of virtual states, ż = A z + B u, y = C z + D u, as the loop runs them.

Each method is an entry of METHODS: data with an order, a stability region and an update order, which tests verify.
Every method is causal: y_n is known as soon as u_n is. The theory is at the beginning of `one_step` (Euler, trapezoid,
Runge–Kutta, exact) and of `staggered` (leapfrog and Verlet). `explicit` has the methods that also take nonlinear rates.

There are two kinds of stability: that of a method on an oscillator of its own (`oscillator_growth`, here), and that of
the sampled loop with a hand (`margins`). A method that preserves energy does not make the loop stable.
"""

import numpy as np

from haptic_fieldbus.defaults import DEFAULT_METHOD
from haptic_fieldbus.documents import nearest
from haptic_fieldbus.documents.own_parts import entry_point_names, foreign_part
from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.numerals import exactly
from haptic_fieldbus.numerics.integrators import one_step, staggered
from haptic_fieldbus.numerics.integrators.method import Integrator, OneStep, Step, bind_general, bind_pair, check_system
from haptic_fieldbus.numerics.linear import Matrix, StateSpace, equilibrium

__all__ = [
    "METHODS", "Integrator", "OneStep", "Step", "bind", "discrete", "discretise", "method_named", "rest",
]  # fmt: skip


METHODS = {
    method.name: method
    for method in (
        one_step.FORWARD_EULER,
        one_step.BACKWARD_EULER,
        one_step.TRAPEZOIDAL,
        staggered.SEMI_IMPLICIT,
        staggered.DRIFT_FIRST,
        staggered.VERLET,
        one_step.RK4,
        one_step.EXACT_ZOH,
        one_step.EXACT_FOH,
    )
}
GROUP = "haptic_fieldbus.methods"
"""Entry points of other packages; each names an `Integrator`."""


def method_named(name: str) -> Integrator:
    """Return the method of this name; raises UsageError for an unknown name."""
    if name in METHODS:
        return METHODS[name]
    own = foreign_part(GROUP, "method", name, Integrator, METHODS)
    if own is None:
        raise UsageError(_unknown(name, [*METHODS, *entry_point_names(GROUP)]))
    return own


def _unknown(name: str, known: list[str]) -> str:
    near = nearest(name, known)
    return f'no method "{name}"; {f"nearest: {near[0]}; " if near else ""}there are: {", ".join(known)}'


def discretise(space: StateSpace, period: float, method: str = DEFAULT_METHOD) -> OneStep:
    """Return one step of a method on a linear system of any order.

    Raises UsageError for an unknown method, for a period [s] or entries of the system that are no valid numbers, and
    for an implicit method whose equation has no solution at this period.
    """
    chosen = method_named(method)
    check_system(space, period)
    try:
        return chosen.discretise(space, period)
    except np.linalg.LinAlgError as error:
        raise UsageError(
            f"{method} has no step of {exactly(period)} s for these virtual states: one mode grows too fast for the "
            "implicit equation; use a shorter period"
        ) from error


def discrete(space: StateSpace, period: float, method: str = DEFAULT_METHOD) -> StateSpace:
    """Return the system that `bind` runs, x_{n+1} = A x_n + B u_n, y_n = C x_n + D u_n; raises as `discretise`."""
    return discretise(space, period, method).system


def rest(space: StateSpace) -> tuple[Matrix, float]:
    """Return (state (n,), force) at rest for unit position; the smallest state when it is not unique."""
    state = equilibrium(space.a, space.b[:, 0])
    return state, float(space.c[0] @ state + space.d[0, 0])


def bind(space: StateSpace, period: float, method: str = DEFAULT_METHOD) -> Step:
    """Return a fresh step in plain floats for a system with inputs (position, velocity) and one output.

    The virtual states start at rest at the position of the first call. Pass the velocity only to a system that
    `uses_velocity`. For another start, bind again; `trajectory.follow` starts anywhere. Raises as `discretise`.
    """
    system = discretise(space, period, method).increments
    stiffness = rest(space)[1]
    if space.order == 2 and not space.uses_velocity:
        return bind_pair(system, stiffness)
    return bind_general(system, stiffness)
