"""Limits and verdict of axes that a coupling ties together: a virtual shaft, a bilateral coupling of two drives.

The loop is that of one axis, several times over: each device under its own delayed hold, all closed over one
environment (`numerics.coupled`), nobody holding a handle. The coupling's stiffness is varied, all else is kept, the
elements that each axis has of its own included. Passivity is asked with any passive hands on all handles
(`numerics.coupled_passivity`).

Encoder and Coulomb friction are asked of each handle while the others are held: a count of D_i changes its own force by
κ_i·K·D_i, κ_i the coupling's force per stiffness there (1 and n² for a spring between x1 and n·x2), and friction
bridges half of it up to K = 2·fc_i/(κ_i·D_i); the smallest counts.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.margins.linear import LARGEST, ROUNDING, SMALLEST, limit_of
from haptic_fieldbus.margins.plant import Plant, sample
from haptic_fieldbus.margins.quantisation import quantisation_limit
from haptic_fieldbus.margins.verdict import Stability, StiffnessLimit, verdict_of
from haptic_fieldbus.numerics import coupled, sampled
from haptic_fieldbus.numerics.coupled_passivity import Port, damping_share
from haptic_fieldbus.numerics.linear import Matrix, StateSpace, equilibrium, parallel

CouplingOf = Callable[[float], StateSpace]
"""Stiffness → the discrete coupling (x_1 … x_n)_k → (F_1 … F_n)_k."""
PRECISION = 1e-8
"""Of the limit of passivity."""


@dataclass(frozen=True, eq=False)
class CoupledAxis:
    """One of the axes that a coupling ties together."""

    plant: Plant
    delay: float
    """From sampling to acting [s]."""
    environment: StateSpace | None = None
    """Of the elements of its own, x_k → F_k; None: it has none."""


def judge_coupled(
    axes: Sequence[CoupledAxis],
    period: float,
    coupling_of: CouplingOf,
    stiffness: float | None,
    damping: float = 0.0,
) -> tuple[Stability, ...]:
    """One judgement of all, told for each axis with its plant and delay; the limits are those of the coupling.

    `stiffness` None: there is none to vary, and `coupling_of` is given 0. Raises UsageError for a stiffness that is
    none, naming the limit, and for times that no loop has.
    """
    plants = [sample(axis.plant, period, axis.delay) for axis in axes]
    stable = None if stiffness is None else coupled_limit(axes, period, coupling_of)
    if stiffness is not None and not 0.0 <= stiffness < math.inf:
        raise UsageError(f"stiffness {stiffness:g}: expected a number from 0 up; this pair is stable to {stable:.6g}")
    asked = together(axes, coupling_of(stiffness or 0.0))
    growth = coupled.growth(plants, asked)
    if stiffness is None or stable is None:
        limit = StiffnessLimit(None, None, None)
        is_stable, is_bridged = growth <= 1.0 + ROUNDING, True
        is_passive = damping_share(asked, _ports(axes), period) <= 1.0 + ROUNDING
    else:
        passive = coupled_passive_limit(axes, period, coupling_of, stable)
        quantisation = coupled_quantisation_limit(axes, coupling_of)
        limit = StiffnessLimit(passive, stable, quantisation)
        is_stable = stiffness <= stable or growth < 1.0 - ROUNDING
        is_passive, is_bridged = stiffness <= passive, quantisation is None or stiffness <= quantisation
    radius = sampled.spectral_radius(coupled.loop_matrix(plants, asked))
    margin = stable / stiffness if stiffness and stable is not None else None
    verdict = verdict_of(is_stable, is_bridged, is_passive)
    return tuple(
        Stability(period, axis.delay, axis.plant, stiffness, damping, limit, radius, margin, verdict) for axis in axes
    )


def together(axes: Sequence[CoupledAxis], coupling: StateSpace) -> StateSpace:
    """The coupling and all elements of the axes' own, (x_1 … x_n)_k → (F_1 … F_n)_k."""
    own = [
        coupled.embedded(axis.environment, place, len(axes))
        for place, axis in enumerate(axes)
        if axis.environment is not None
    ]
    return parallel([coupling, *own])


def coupled_limit(axes: Sequence[CoupledAxis], period: float, coupling_of: CouplingOf) -> float:
    """The coupling's stiffness [N/m or N·m/rad] up to which all loops are stable; 0 or ∞ as for one axis."""
    plants = [sample(axis.plant, period, axis.delay) for axis in axes]
    drifts = not any(axis.plant.damping for axis in axes)

    def growth(stiffness: float) -> float:
        found = coupled.growth(plants, together(axes, coupling_of(stiffness)))
        return 1.0 if drifts and abs(found - 1.0) <= ROUNDING else found

    return limit_of(growth, _scale(axes, period, coupling_of))


def coupled_passive_limit(axes: Sequence[CoupledAxis], period: float, coupling_of: CouplingOf, stable: float) -> float:
    """The coupling's stiffness up to which any passive hands are safe; `stable` bounds it; 0 when the smallest is not.

    Where the forces are proportional to the stiffness, a base aside, the passive stiffnesses are one interval: the form
    of `numerics.coupled_passivity` is affine in them. An undamped virtual mode is passive at no stiffness.
    """
    ports, scale = _ports(axes), _scale(axes, period, coupling_of)

    def passive(stiffness: float) -> bool:
        return damping_share(together(axes, coupling_of(stiffness)), ports, period) <= 1.0

    low, high, largest = 0.0, SMALLEST * min(stable, scale), min(stable, LARGEST * scale)
    while passive(high):
        if high >= largest:
            return stable
        low, high = high, min(4.0 * high, largest)
    while low and high - low > PRECISION * high:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if passive(middle) else (low, middle)
    return low


def coupled_quantisation_limit(axes: Sequence[CoupledAxis], coupling_of: CouplingOf) -> float | None:
    """The stiffness up to which friction holds each handle between two counts; None without quantisation."""
    limits = [
        limit / share
        for axis, share in zip(axes, stiffness_shares(coupling_of), strict=True)
        if (limit := quantisation_limit(axis.plant)) is not None and share
    ]
    return min(limits, default=None)


def stiffness_shares(coupling_of: CouplingOf) -> list[float]:
    """What the coupling gives back at each handle while the others are held, per stiffness; 1 and n² for a shaft."""

    def at_rest(environment: StateSpace) -> Matrix:
        states = equilibrium(environment.a - np.eye(environment.order), environment.b)
        return np.abs(np.diag(environment.c @ states + environment.d))

    base, one = at_rest(coupling_of(0.0)), at_rest(coupling_of(1.0))
    return [float(share) for share in np.abs(one - base)]


def _scale(axes: Sequence[CoupledAxis], period: float, coupling_of: CouplingOf) -> float:
    """The smallest m/T² + b/T as the coupling's stiffness meets it."""
    return min(
        (axis.plant.mass / period**2 + axis.plant.damping / period) / (share or 1.0)
        for axis, share in zip(axes, stiffness_shares(coupling_of), strict=True)
    )


def _ports(axes: Sequence[CoupledAxis]) -> list[Port]:
    """A tachometer's readings say nothing of the motion between two: what damping there is counts for nothing."""
    return [
        Port(0.0 if axis.plant.tachometer else axis.plant.damping, axis.delay, axis.plant.torque_lag) for axis in axes
    ]
