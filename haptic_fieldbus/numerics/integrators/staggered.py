"""Staggered methods: positions and velocities are advanced one after the other (leapfrog, Störmer, Verlet).

A state is a *position* when its rate is another state and nothing else, ṗ = v. All other states are *velocities*, with
rates a(p, v, u). A kick changes velocities by T·a, a drift changes positions by T·v.

| method                    | stored       | a step                                                  | order |
|---------------------------|--------------|---------------------------------------------------------|-------|
| semi-implicit             | p_n, v_{n−½} | kick with a(p_n, v_{n−½}, u_n), then drift              | 2 *   |
| semi-implicit-drift-first | p_n, v_n     | drift with v_n, then kick with a(p_{n+1}, v_n, u_n)     | 1     |
| verlet                    | p_n, v_{n−½} | v_n by half a kick with u_n, then half a kick and drift | 2     |

(* 1 when a or y depends on v.)

Both the update order and the start matter. The velocity of "semi-implicit" belongs to half a period earlier, so a run
begins with half a kick backwards, v_{−½} = v_0 − T/2·a_0. The classic pseudocode begins with v_0 instead, and is then
of first order whenever a_0 is not zero, as after a step of the handle. "Drift first" combines the new position
with the old input: it is of first order with any start.

Verlet (velocity Verlet, kick–drift–kick) moves positions as semi-implicit does, but it completes
v_n = v_{n−½} + T/2·a(p_n, v_n, u_n), solved for v_n, when u_n is read (Brünger, Brooks, Karplus 1984,
doi:10.1016/0009-2614(84)80098-6). Damping and outputs that depend on velocity are therefore of second order as well. A
state without a position, such as a lag, is integrated by the trapezoid in this way.

On an undamped oscillator with h = T·√(k/m) the growth follows λ² − (2 − h²)·λ + 1 = 0. The modulus is 1 up to h = 2;
then one root leaves along the negative axis (Hairer, Lubich, Wanner: Geometric Numerical Integration, 2nd ed., I.1.4
and VI.3).
"""

import math
from functools import partial

import numpy as np

from haptic_fieldbus.numerics.integrators.method import Integrator, OneStep
from haptic_fieldbus.numerics.linear import Matrix, StateSpace

LIMIT = 2.0
"""Largest stable T·√(k/m)."""


def positions(space: StateSpace) -> list[bool]:
    """Return for each state, (n,), whether it is a position: ṗ = v with another state v, and nothing else."""
    found = [False] * space.order
    for row in range(space.order):
        (of,) = np.nonzero(space.a[row])
        alone = len(of) == 1 and space.a[row, of[0]] == 1.0 and of[0] != row and not space.b[row].any()
        # Of two states that are each the rate of the other only the first can be the position.
        mutual = alone and found[of[0]] and space.a[of[0], row] != 0.0
        found[row] = bool(alone and not mutual)
    return found


def leapfrog_growth(h: float) -> float:
    """Return the spectral radius of all three methods on an undamped oscillator, from h = T·√(k/m)."""
    if h <= LIMIT:
        return 1.0
    return h * h / 2.0 - 1.0 + h / 2.0 * math.sqrt(h * h - 4.0)


def _masks(space: StateSpace) -> tuple[Matrix, Matrix]:
    """Return the masks (velocities, positions) as diagonal matrices, (n, n) each."""
    drifting = np.array(positions(space), dtype=float)
    return np.diag(1.0 - drifting), np.diag(drifting)


def _half_kick(space: StateSpace, period: float, kicked: Matrix) -> tuple[Matrix, Matrix]:
    """Return (J, K) of the half kick κ = J w + K u from v_{n−½} to v_n, which solves κ = T/2·a(w + κ, u)."""
    half = 0.5 * period * kicked
    rates = np.hstack([half @ space.a, half @ space.b])
    solved: Matrix = np.linalg.solve(np.eye(space.order) - half @ space.a @ kicked, rates).astype(np.float64)
    return solved[:, : space.order], solved[:, space.order :]


def _semi_implicit(space: StateSpace, period: float) -> OneStep:
    kicked, drifted = _masks(space)
    by_state, by_input = _half_kick(space, period, kicked)
    kick, kick_by_input = period * kicked @ space.a, period * kicked @ space.b
    drift = period * drifted @ space.a
    moved = StateSpace(kick + drift + drift @ kick, kick_by_input + drift @ kick_by_input, space.c, space.d)
    return OneStep(moved, (np.eye(space.order) + by_state, by_input))


def _drift_first(space: StateSpace, period: float) -> OneStep:
    kicked, drifted = _masks(space)
    kick, drift = period * kicked @ space.a, period * drifted @ space.a
    moved = StateSpace(drift + kick + kick @ drift, period * kicked @ space.b, space.c, space.d)
    return OneStep(moved, (np.eye(space.order), np.zeros_like(space.b)))


def _verlet(space: StateSpace, period: float) -> OneStep:
    kicked, drifted = _masks(space)
    by_state, by_input = _half_kick(space, period, kicked)
    drift = period * drifted @ space.a
    moved = StateSpace(
        a=2.0 * by_state + drift + 2.0 * drift @ by_state,
        b=2.0 * by_input + 2.0 * drift @ by_input,
        c=space.c + space.c @ by_state,
        d=space.d + space.c @ by_input,
    )
    return OneStep(moved, (np.eye(space.order) + by_state, by_input))


_leapfrog = partial(Integrator, growth=None, oscillator_growth=leapfrog_growth, oscillator_limit=LIMIT)

SEMI_IMPLICIT = _leapfrog(
    "semi-implicit", 2, 2, "u_{n-1}", "kick, then drift; begins with half a kick backwards",
    lag_limit=2.0, discretise=_semi_implicit,
)  # fmt: skip
DRIFT_FIRST = _leapfrog(
    "semi-implicit-drift-first", 1, 1, "u_{n-1}", "drift, then kick", lag_limit=2.0, discretise=_drift_first
)
VERLET = _leapfrog(
    "verlet", 2, 2, "u_n, u_{n-1}", "half a kick, half a kick, drift", lag_limit=math.inf, discretise=_verlet
)
