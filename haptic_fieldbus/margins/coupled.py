"""Axes that a coupling ties together: a virtual shaft, a bilateral coupling of two drives.

The loop is that of one axis, several times over: each device under its own delayed hold, all closed over one
environment (`numerics.coupled`), nobody holding a handle. The coupling's stiffness is varied, all else is kept, the
elements that each axis has of its own included. Passivity is asked with any passive hands on all handles
(`numerics.coupled_passivity`).

Encoder and Coulomb friction are asked of each handle while the others are held: a count of D_i changes its own force by
κ_i·K·D_i, κ_i the coupling's force per stiffness there (1 and n² for a spring between x1 and n·x2), and friction
bridges half of it up to K = 2·fc_i/(κ_i·D_i); the smallest counts.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from haptic_fieldbus.margins.closed_loop import ClosedLoop
from haptic_fieldbus.margins.contact import linearised
from haptic_fieldbus.margins.linear import ROUNDING, EnvironmentOf
from haptic_fieldbus.margins.passivity import searched
from haptic_fieldbus.numerics import coupled
from haptic_fieldbus.numerics.coupled_passivity import PassivityPort, damping_share
from haptic_fieldbus.numerics.linear import Matrix, StateSpace, equilibrium, parallel
from haptic_fieldbus.scenes.element import AnyElement, CouplingElement

SMALLEST, PRECISION = 1e-9, 1e-8
"""Of the limit of passivity: where the search begins, in m/T² + b/T, and how close it comes."""


class CoupledAxes(ClosedLoop):
    """Axes whose environment is a coupling (x_1 … x_n)_k → (F_1 … F_n)_k; what each has of its own is added to it."""

    def together(self, coupling: StateSpace) -> StateSpace:
        """The coupling and all elements of the axes' own."""
        own = [
            coupled.embedded(axis.environment, place, len(self.axes))
            for place, axis in enumerate(self.axes)
            if axis.environment is not None
        ]
        return parallel([coupling, *own])

    def matrix(self, environment: StateSpace) -> Matrix:
        return coupled.loop_matrix(self.devices, self.together(environment))

    def growth(self, environment: StateSpace) -> float:
        """Undamped devices that drift together do so for ever: their eigenvalues of 1 are no growth by rounding."""
        found = coupled.growth(self.devices, self.together(environment))
        drifts = not any(axis.plant.damping for axis in self.axes)
        return 1.0 if drifts and abs(found - 1.0) <= ROUNDING else found

    def damping_share(self, environment: StateSpace) -> float:
        """A tachometer's readings say nothing of the motion between two: what damping there is counts for nothing."""
        ports = [
            PassivityPort(0.0 if axis.plant.tachometer else axis.plant.damping, axis.delay, axis.plant.torque_lag)
            for axis in self.axes
        ]
        return damping_share(self.together(environment), ports, self.period)

    def passive_limit(self, environment_of: EnvironmentOf, stable: float) -> float:
        """Where the forces are proportional to the stiffness, a base aside, the passive stiffnesses are one interval.

        The form of `numerics.coupled_passivity` is affine in them. An undamped virtual mode is passive at no stiffness.
        """
        return searched(
            lambda stiffness: self.damping_share(environment_of(stiffness)) <= 1.0,
            self.scale(environment_of),
            stable,
            smallest=SMALLEST,
            precision=PRECISION,
        )

    def felt(self, environment_of: EnvironmentOf) -> list[float]:
        """1 and n² for a shaft."""

        def at_rest(environment: StateSpace) -> Matrix:
            states = equilibrium(environment.a - np.eye(environment.order), environment.b)
            return np.abs(np.diag(environment.c @ states + environment.d))

        felt: list[float] = np.abs(at_rest(environment_of(1.0)) - at_rest(environment_of(0.0))).tolist()
        return felt


def between(
    couplings: Sequence[CouplingElement],
    varied: AnyElement | None,
    changes: Mapping[str, float],
    estimators: Mapping[str, str],
    period: float,
) -> StateSpace:
    """The couplings as the loop runs them, one of them changed, on the axes that the estimators are named by."""
    places = list(estimators)
    spaces = [
        coupled.among(
            linearised(each, changes if each is varied else {}), [places.index(name) for name in each.axes], len(places)
        )
        for each in couplings
    ]
    return coupled.environment(parallel(spaces), period=period, method=None, estimators=list(estimators.values()))
