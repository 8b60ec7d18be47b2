"""Integrators of virtual states, ż = A z + B u, y = C z + D u, as the loop runs them.

One method is one entry of METHODS.

Every method here is causal: y_n is known as soon as u_n is. Each is given by the linear system that one of its steps
is, written for the *increment*, z_{n+1} − z_n = E z_n + G u_n, because E = Φ − I keeps its digits when the period is
tiny and Φ does not.

- forward-euler: E = T·A, G = T·B. First order; an undamped oscillator grows by √(1 + h²) a step, h = T·√(k/m), for
  every T > 0.
- exact-foh: the exact solution for an input on straight lines between samples (ramp-invariant). z_n needs u_n, which
  has just been read; the stored state is w_n = z_n − Γ1 u_n, so one step costs what an Euler step costs. Second order,
  the held input of the usual exact step being replaced; growth is exactly that of the continuous system.
  Franklin, Powell, Workman: Digital Control of Dynamic Systems, 3rd ed., 6.3.2.

A step begins at rest where the handle is at its first call, and works with deviations from there: at a handle that
stands still the force is exactly constant, and digits are not spent on how far from zero that is.
"""

import cmath
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.numerics.exact import polynomial_step
from haptic_fieldbus.numerics.linear import Matrix, StateSpace, equilibrium

Step = Callable[..., float]
"""Position[, velocity] of this period → force or torque on the handle [N or N·m]; remembers the virtual states."""

DEFAULT_METHOD = "exact-foh"


@dataclass(frozen=True)
class Integrator:
    """One method: what it is, what it claims, and its step."""

    name: str
    order: int
    """Error over a fixed time ∝ period^order, for a smooth input."""
    inputs: str
    """The input samples that y_n depends on directly."""
    growth: Callable[[complex], complex]
    """λ·T → factor by which a mode of eigenvalue λ grows in one step; stable where its modulus is at most 1."""
    oscillator_limit: float
    """Largest h = T·√(k/m) at which an undamped oscillator does not grow."""
    increments: Callable[[StateSpace, float], StateSpace]
    """(continuous system, period [s]) → z⁺ − z = A z + B u, y = C z + D u."""


def _forward_euler(space: StateSpace, period: float) -> StateSpace:
    return StateSpace(space.a * period, space.b * period, space.c, space.d)


def _exact_foh(space: StateSpace, period: float) -> StateSpace:
    increment, (held, slope) = polynomial_step(space.a, space.b, period, 1)
    return StateSpace(increment, increment @ slope + held, space.c, space.c @ slope + space.d)


METHODS = {
    method.name: method
    for method in (
        Integrator("exact-foh", 2, "u_n, u_{n-1}", cmath.exp, math.inf, _exact_foh),
        Integrator("forward-euler", 1, "u_{n-1}", lambda z: 1.0 + z, 0.0, _forward_euler),
    )
}


def method_named(name: str) -> Integrator:
    """Raises UsageError when there is none of that name."""
    if name not in METHODS:
        raise UsageError(f'no method "{name}"; there are: {", ".join(METHODS)}')
    return METHODS[name]


def discrete(space: StateSpace, period: float, method: str = DEFAULT_METHOD) -> StateSpace:
    """The system that `bind` runs: x_{n+1} = A x_n + B u_n, y_n = C x_n + D u_n."""
    system = method_named(method).increments(space, period)
    return StateSpace(system.a + np.eye(space.order), system.b, system.c, system.d)


def rest(space: StateSpace) -> tuple[Matrix, float]:
    """(state, force) at rest for unit position; where the state is not unique, the smallest."""
    state = equilibrium(space.a, space.b[:, 0])
    return state, float(space.c[0] @ state + space.d[0, 0])


def bind(space: StateSpace, period: float, method: str = DEFAULT_METHOD) -> Step:
    """A fresh step in plain floats for a system with inputs (position, velocity) and one output.

    Takes the velocity only where the system `uses_velocity`. For another start, bind again.
    """
    system = method_named(method).increments(space, period)
    stiffness = rest(space)[1]
    if space.uses_velocity:
        return _bind_general(system, stiffness)
    if space.order == 2:
        return _bind_pair(system, stiffness)
    by_position_and_velocity = _bind_general(system, stiffness)
    return lambda position: by_position_and_velocity(position, 0.0)


def _bind_pair(system: StateSpace, stiffness: float) -> Step:
    """Two states driven by position, in the coordinates (C z, C E z), where by Cayley and Hamilton a step is short."""
    e, g, c = system.a, system.b[:, 0], system.c[0]
    trace, determinant = float(e[0, 0] + e[1, 1]), float(e[0, 0] * e[1, 1] - e[0, 1] * e[1, 0])
    g0, g1, d = float(c @ g), float(c @ e @ g), float(system.d[0, 0])
    origin: float | None = None
    z0 = z1 = base = 0.0

    def step(position: float) -> float:
        nonlocal origin, base, z0, z1
        if origin is None:
            origin, base = position, stiffness * position
        u = position - origin
        force: float = base + (z0 + d * u)
        z0, z1 = z0 + (z1 + g0 * u), z1 + (trace * z1 - determinant * z0 + g1 * u)
        return force

    return step


def _bind_general(system: StateSpace, stiffness: float) -> Step:
    """Any number of states, driven by position and velocity."""
    updates = [(*row, *inputs) for row, inputs in zip(system.a.tolist(), system.b.tolist(), strict=True)]
    output = (*system.c[0].tolist(), *system.d[0].tolist())
    state = [0.0] * system.order
    origin: float | None = None
    base = 0.0

    def step(position: float, velocity: float) -> float:
        nonlocal origin, base, state
        if origin is None:
            origin, base = position, stiffness * position
        known = (*state, position - origin, velocity)
        state = [z + _dot(row, known) for z, row in zip(state, updates, strict=True)]
        return base + _dot(output, known)

    return step


def _dot(left: tuple[float, ...], right: tuple[float, ...]) -> float:
    return sum(map(float.__mul__, left, right))
