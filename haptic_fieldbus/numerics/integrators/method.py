"""Definition of an integrator: a rule that turns a continuous linear system into one step, with its claimed figures."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.numerals import exactly
from haptic_fieldbus.numerics.linear import Matrix, StateSpace


@dataclass(frozen=True, eq=False)
class OneStep:
    """One step of a method on the states w that the method stores, and the true states z that belong to them.

    `increments` holds (E, G, C, D) of w_{n+1} − w_n = E w_n + G u_n and y_n = C w_n + D u_n. `state` holds (J, K) of
    z_n = J w_n + K u_n, shapes (n, n) and (n, n_in). E = Φ − I is kept instead of Φ, because it keeps all its digits
    when the period is tiny.
    """

    increments: StateSpace
    state: tuple[Matrix, Matrix]

    @property
    def system(self) -> StateSpace:
        """The discrete system w_{n+1} = Φ w_n + G u_n, y_n = C w_n + D u_n."""
        step = self.increments
        return StateSpace(step.a + np.eye(step.order), step.b, step.c, step.d)

    def stored(self, states: Matrix, inputs: Matrix) -> Matrix:
        """Return the stored states w (n,) for true states (n,) and inputs (n_in,) at the first sample."""
        by_state, by_input = self.state
        return np.asarray(np.linalg.solve(by_state, states - by_input @ inputs), dtype=np.float64)


@dataclass(frozen=True)
class Integrator:
    """A method: its name, the figures that it claims, and its step."""

    name: str
    order: int
    """Order of the error over a fixed time, ∝ period^order, for a smooth input that is known at the samples."""
    free_order: float
    """Order without input, from states given at the first sample; ∞ for a method without error."""
    inputs: str
    """Input samples that the step to z_n uses."""
    update: str
    """Order of the operations in a step, for people."""
    growth: Callable[[complex], complex] | None
    """Growth factor of a mode of eigenvalue λ in one step, from λ·T; None when it depends on more than λ·T."""
    oscillator_growth: Callable[[float], float]
    """Spectral radius of one step on an undamped oscillator, from h = T·√(k/m)."""
    oscillator_limit: float
    """Largest h at which the spectral radius is at most 1."""
    lag_limit: float
    """Largest T·λ at which a decay ż = −λ z does not grow."""
    discretise: Callable[[StateSpace, float], OneStep]
    """Function from (continuous system, period [s]) to one step; it does not check them."""


def check_system(space: StateSpace, period: float) -> None:
    """Check the period [s] and the entries of a system.

    Raises UsageError for a period that is not a finite number above 0, and for an entry that is not finite.
    """
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
