"""Axes that a coupling ties together: a virtual shaft, a bilateral coupling of two drives.

The loop consists of several axes: each device is under its own delayed hold, and all are closed over one environment
(`numerics.coupled`). Nobody holds a handle. The stiffness of the coupling varies; everything else is kept, including
the axes' own elements. Passivity is required with any passive hands on all handles (`numerics.coupled_passivity`).

Encoder and Coulomb friction are judged at each handle while the others are held. A count D_i changes the force at its
own handle by κ_i·K·D_i, where κ_i is the force there per stiffness of the coupling and position (1 and n² for a spring
between x1 and n·x2). Friction bridges half of this force up to K = 2·fc_i/(κ_i·D_i). The smallest of these limits
counts.
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
"""Search for the limit of passivity: its first stiffness as a share of m/T² + b/T, and its relative precision."""


class CoupledAxes(ClosedLoop):
    """Axes whose environment is a coupling (x_1 … x_n)_k → (F_1 … F_n)_k; the axes' own elements are added to it."""

    def together(self, coupling: StateSpace) -> StateSpace:
        """Return the coupling in parallel with the own elements of all axes."""
        own = [
            coupled.embedded(axis.environment, place, len(self.axes))
            for place, axis in enumerate(self.axes)
            if axis.environment is not None
        ]
        return parallel([coupling, *own])

    def matrix(self, environment: StateSpace) -> Matrix:
        return coupled.loop_matrix(self.devices, self.together(environment))

    def growth(self, environment: StateSpace) -> float:
        """Return the largest modulus of the loop's eigenvalues, free shifts left out; below 1 is stable."""
        # Undamped devices can drift together at a constant speed for ever. The eigenvalue 1 of this drift must not
        # count as growth when rounding puts it above 1.
        found = coupled.growth(self.devices, self.together(environment))
        drifts = not any(axis.plant.damping for axis in self.axes)
        return 1.0 if drifts and abs(found - 1.0) <= ROUNDING else found

    def damping_share(self, environment: StateSpace) -> float:
        """Return the share of the devices' dampings that any passive hands need; ∞ when no damping is enough."""
        # The readings of a tachometer do not show the motion between them, so the damping of its device counts as 0.
        ports = [
            PassivityPort(0.0 if axis.plant.tachometer else axis.plant.damping, axis.delay, axis.plant.torque_lag)
            for axis in self.axes
        ]
        return damping_share(self.together(environment), ports, self.period)

    def passive_limit(self, environment_of: EnvironmentOf, stable: float) -> float:
        """Return the stiffness [N/m or N·m/rad] up to which any passive hands are safe; `stable` bounds it.

        The search assumes that the passive stiffnesses are one interval. This holds when the forces are a fixed part
        plus a part proportional to the stiffness, because the share s of the dampings is then the largest eigenvalue of
        a matrix that is affine in the stiffness, which is convex. An undamped virtual mode is passive at no stiffness.
        """
        return searched(
            lambda stiffness: self.damping_share(environment_of(stiffness)) <= 1.0,
            self.scale(environment_of),
            stable,
            smallest=SMALLEST,
            precision=PRECISION,
        )

    def felt(self, environment_of: EnvironmentOf) -> list[float]:
        """Return the force at each handle per stiffness and position with the others held; 1 and n² for a shaft."""

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
    """Return the couplings as the loop runs them, with `changes` to the coupling `varied`.

    `estimators` maps the name of each axis to its estimator and gives the order of the axes. Raises UsageError for a
    coupling with virtual states, and for an unknown estimator.
    """
    places = list(estimators)
    spaces = [
        coupled.among(
            linearised(each, changes if each is varied else {}), [places.index(name) for name in each.axes], len(places)
        )
        for each in couplings
    ]
    return coupled.environment(parallel(spaces), period=period, method=None, estimators=list(estimators.values()))
