"""What an integrator is: a rule that makes a linear system of continuous time into one step, and its claims."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.numerals import exactly
from haptic_fieldbus.numerics.linear import Matrix, StateSpace


@dataclass(frozen=True, eq=False)
class OneStep:
    """What one step does to the states w that a method stores, and what the true states z are meanwhile.

    w_{n+1} − w_n = E w_n + G u_n and y_n = C w_n + D u_n are `increments`; z_n = J w_n + K u_n is `state`. E = Φ − I is
    kept instead of Φ: it has all its digits when the period is tiny.
    """

    increments: StateSpace
    state: tuple[Matrix, Matrix]

    @property
    def system(self) -> StateSpace:
        """w_{n+1} = Φ w_n + G u_n, y_n = C w_n + D u_n."""
        step = self.increments
        return StateSpace(step.a + np.eye(step.order), step.b, step.c, step.d)

    def stored(self, states: Matrix, inputs: Matrix) -> Matrix:
        """The w with which a run begins whose true states and inputs are these at the first sample."""
        by_state, by_input = self.state
        return np.asarray(np.linalg.solve(by_state, states - by_input @ inputs), dtype=np.float64)


@dataclass(frozen=True)
class Integrator:
    """One method: what it is, what it claims, and its step."""

    name: str
    order: int
    """Error over a fixed time ∝ period^order, for a smooth input that is known at the samples."""
    free_order: float
    """The same without input, from states that are given at the first sample; ∞ where there is no error at all."""
    inputs: str
    """The input samples that the step to z_n takes."""
    update: str
    """The order in which a step does things."""
    growth: Callable[[complex], complex] | None
    """λ·T → factor by which a mode of eigenvalue λ grows in one step; None where the factor needs more than λ·T."""
    oscillator_growth: Callable[[float], float]
    """h = T·√(k/m) → spectral radius of one step on an undamped oscillator."""
    oscillator_limit: float
    """Largest h at which that is at most 1."""
    lag_limit: float
    """Largest T·λ at which a decay ż = −λ z does not grow."""
    discretise: Callable[[StateSpace, float], OneStep]
    """(continuous system, period [s]) → one step; neither is checked."""


def check_system(space: StateSpace, period: float) -> None:
    """Raises UsageError for a period that is not above 0, and for a system with an entry that is no finite number."""
    if not 0.0 < period < math.inf:
        raise UsageError(f"period {exactly(period)} s: expected a finite number above 0")
    for name in ("a", "b", "c", "d"):
        matrix: Matrix = getattr(space, name)
        if not np.isfinite(matrix).all():
            at = tuple(np.argwhere(~np.isfinite(matrix))[0].tolist())
            raise UsageError(
                f"{name.upper()}{list(at)} of the virtual states is {matrix[at]}: expected finite numbers; a mass must "
                "be above 0, a stiffness and a damping be numbers"
            )
