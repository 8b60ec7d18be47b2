"""Axes that a coupling ties together: a virtual shaft, a bilateral coupling of two drives.

The loop consists of several axes: each device is under its own delayed hold, and all are closed over one environment
(`numerics.coupled`). All handles are free. The stiffness of the coupling varies; everything else is kept. The axes' own
elements are tried at their `Places`, in all combinations over the axes. A coupling with play or a largest force is also
tried with no force; each axis is then alone.

Passivity is required with any passive hands on all handles. A coupling of springs and dampers that nothing cuts has an
exact condition (at the end of this file). The energy of own elements is bounded as on a single axis (`passivity`).
The damping that this bound needs is subtracted from the device first. Both bounds are sums over the axes of a damping
times ∫v², so they add up.

A spring-damper between x1 and n·x2 with play or a largest force is a law of the twist, and keeps the bounds of
`passivity`. With κ = (1, |n|) the path length of the twist is at most Σ κ_i·∫|v_i|. Let y_i be the mean of |v_i|, and
ρ_i the size of the remainder |v_i| − y_i. By the proof in `passivity` the spring-damper generates at most the quadratic
form of

    [[K·κ_i·κ_j·½(g_i + g_j) + B·κ_i·κ_j, ½·K·κ_i·κ_j·√S_j], [its transpose, 0]]

on (y, ρ). The dampings must cover this form; without B this is the exact condition again. The forces have no potential
if the motors saturate at different twists on the two axes, or saturate the sum of coupling and own elements. Handles
that move around a closed path may then extract energy in every turn, and no verdict is "passive".

Encoder and Coulomb friction are judged at each handle while the others are held. A count D_i changes the force at its
own handle by κ_i·K·D_i, where κ_i is the force there per stiffness of the coupling and position (1 and n² for a spring
between x1 and n·x2). Friction bridges half of this force up to K = 2·fc_i/(κ_i·D_i). The smallest of these limits
counts. For *passive*, the friction of each handle must also absorb what the counts of all other handles give it:
fc_i ≥ Σ_j (½·L_ij·D_j + B_ij·D_j/T), with the slope L_ij and the damping B_ij between them.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from haptic_fieldbus.margins.closed_loop import Axis, ClosedLoop, OneAxis, linearised
from haptic_fieldbus.margins.linear import ROUNDING, EnvironmentOf, crossings
from haptic_fieldbus.margins.passivity import FADED, LOSSLESS, MOST_WEIGHTS, QUIET, spread_of
from haptic_fieldbus.margins.stiffness_map import Places
from haptic_fieldbus.numerics import coupled
from haptic_fieldbus.numerics.linear import Matrix, StateSpace, equilibrium, gain, parallel
from haptic_fieldbus.numerics.passivity import Array, Complex, frequency_responses, hold, worst
from haptic_fieldbus.numerics.sampled import spectral_radius
from haptic_fieldbus.scenes.element import AnyElement, CouplingElement, is_shipped

# Passivity of coupled axes: sampled forces behind delayed holds and torque loops, for any passive hands on them.
# The forces are F_k = H x_k with an n × n matrix H. They are held and filtered axis by axis as in `passivity`; P_i and
# S_i are the P and S of that module for axis i. Devices of damping b_i are passive with these forces when, for all
# motions, Σ b_i·∫v_i² ≥ Σ ∫f_i·v_i. At a frequency θ = ωT let X be the sampled positions. Each v_i is the sum of a
# constant speed (z − 1)·X_i/T, which appears in the samples, and a rest of mean zero, which does not. Completing the
# square in the rest, f̃_i/(2·b_i), and dividing by |z − 1|²/T leaves X*·M·X ≥ 0 with the Hermitian
#
#     M(θ) = diag(b) − ½·(diag(P)·H + H*·diag(P)*) − H*·diag(S/(4·b))·H,    0 < θ ≤ π.
#
# Devices and forces are passive if and only if two conditions hold:
#
# - M ⪰ 0 at every θ.
# - The forces at rest, H(1), are those of a spring that stores energy: symmetric, with −H(1) ⪰ 0. Otherwise a slow
# motion   around a loop, or ever further away, takes energy without end.
#
# Then no passive hands make the system unstable, whether the hands are separate or belong to one body. If a condition
# fails, some motion of all handles together takes energy for ever. This is stricter than necessary for hands that are
# known to be separate, each passive by itself.
#
# The needed share s of the dampings is the smallest s for which M ⪰ 0 with s·b in place of b. By Schur's complement it
# is the largest eigenvalue of [[A, R*], [R, 0]], where A is the Hermitian part ½·(diag(P)·H + H*·diag(P)*) and R =
# ½·diag(√S)·H, with rows and columns divided by √b.
#
# Example: a spring-damper between x1 and n·x2 with equal delays has H = −h·g·gᵀ, g = (1, −n). M ⪰ 0 then means that one
# device of damping 1/(1/b1 + n²/b2) is passive with h. Without delay this is K·T/2 + |B| ≤ 1/(1/b1 + n²/b2) (Colgate &
# Schenkel, J. Robotic Systems 14(1), 1997, 37, for one device). For equal axes, n = 1 and B = 0 it is K ≤ b/T, because
# the difference of the handles meets 2·K.

COUPLED_PASSIVITY_ROUNDING, CANCELLED = 1e-9, 1e-13
"""Shares of the largest force at rest, and of the terms that cancel in it, that may be rounding."""


@dataclass(frozen=True)
class PassivityPort:
    """Device between one force of the environment and the hand: damping [N·s/m or N·m·s/rad], delay [s], lag [s]."""

    damping: float
    delay: float
    lag: float = 0.0
    """Time constant of the torque loop."""


def stores(environment: StateSpace) -> bool:
    """Return True when the forces at rest are those of a spring whose energy is never below 0."""
    states = equilibrium(environment.a - np.eye(environment.order), environment.b)
    stiffness = -(environment.c @ states + environment.d)
    # The force of a soft spring is the small rest of large damper terms that cancel.
    terms = np.abs(environment.c) @ np.abs(states) + np.abs(environment.d)
    largest, cancelled = float(np.abs(stiffness).max(initial=0.0)), float(terms.max(initial=0.0))
    least = -max(COUPLED_PASSIVITY_ROUNDING * largest, CANCELLED * cancelled)
    bent = float(np.abs(stiffness - stiffness.T).max(initial=0.0))
    return bent <= -least and float(np.linalg.eigvalsh(stiffness + stiffness.T).min(initial=0.0)) >= 2.0 * least


def damping_share(environment: StateSpace, ports: Sequence[PassivityPort], period: float) -> float:
    """Return the share of the devices' dampings that passivity with any hands needs; ∞ when no damping is enough.

    The system is passive up to a share of 1. The environment maps positions (n_axes,) to forces (n_axes,); `ports`
    holds one device for each axis, `period` is in s.
    """
    b, c, d = environment.b, environment.c, environment.d
    touched = [b[:, i].any() or c[i].any() or d[i].any() or d[:, i].any() for i in range(len(ports))]
    if spectral_radius(environment.a) > 1.0 - LOSSLESS or not stores(environment):
        return math.inf
    if any(is_touched and not port.damping for port, is_touched in zip(ports, touched, strict=True)):
        return math.inf
    root = np.sqrt([port.damping or 1.0 for port in ports])  # an undamped port is untouched here, its rows are 0

    def needed(angle: Array) -> Array:
        holds = [hold(angle, period, port.delay, port.lag) for port in ports]
        force = frequency_responses(environment, angle) / np.outer(root, root)
        along = np.stack([each.displacement for each in holds], axis=-1)[:, :, None] * force
        spread = 0.5 * np.sqrt(np.stack([each.spread for each in holds], axis=-1))[:, :, None] * force
        form = np.block([[0.5 * (along + _adjoint(along)), _adjoint(spread)], [spread, np.zeros_like(spread)]])
        return np.asarray(np.linalg.eigvalsh(form)[:, -1])

    return worst(needed, environment)


def _adjoint(matrices: Complex) -> Complex:
    return matrices.conj().swapaxes(-1, -2)


SMALLEST, PRECISION = 1e-9, 1e-8
"""Search for the limit of passivity: its first stiffness as a share of m/T² + b/T, and its relative precision."""
MOST_CLOSED = 8
"""Largest number of combinations of places for whose crossings the closed form takes less time than a search."""
MOST_TOGETHER = 64
"""Combinations of places of all axes that are tried."""


@dataclass(frozen=True, eq=False)
class CoupledAxes(ClosedLoop):
    """Axes whose environment is a coupling (x_1 … x_n)_k → (F_1 … F_n)_k; the axes' own elements are added to it."""

    may_slacken: bool = False
    """Whether a coupling has play or a largest force, so that its slope can be 0."""
    is_linear: bool = True
    """Whether no play and no largest force limits the couplings."""
    has_potential: bool = True
    """Whether the forces still have a potential when they are limited; otherwise no verdict is "passive"."""

    @cached_property
    def _own(self) -> list[StateSpace]:
        """Own elements of all axes together, at each combination of their places."""
        varying = sum(isinstance(axis.environment, Places) for axis in self.axes)
        most = round(MOST_TOGETHER ** (1.0 / max(varying, 1)))
        each = []
        for place, own in enumerate(axis.environment for axis in self.axes):
            if own is not None:
                spaces = own.environments(most) if isinstance(own, Places) else [own]
                each.append([coupled.embedded(space, place, len(self.axes)) for space in spaces])
        nothing = gain(np.zeros((len(self.axes),) * 2).tolist())
        return [parallel(list(parts)) if parts else nothing for parts in product(*each)]

    @cached_property
    def _apart(self) -> float:
        """Largest growth of a single axis when the couplings give no force."""
        found = [(axis, axis.environment) for axis in self.axes if axis.environment is not None]
        return max((OneAxis([axis], self.period).growth(own) for axis, own in found), default=0.0)

    def _worst(self, environment: StateSpace) -> tuple[float, StateSpace]:
        """Return the largest growth at the places of the own elements, and the environment there."""
        found = [parallel([environment, own]) for own in self._own]
        return max(((self._growth(each), each) for each in found), key=lambda pair: pair[0])

    def together(self, coupling: StateSpace) -> StateSpace:
        """Return the coupling in parallel with the own elements of all axes, at the worst places."""
        return self._worst(coupling)[1]

    def matrix(self, environment: StateSpace) -> Matrix:
        """Return the matrix of one period at the worst places."""
        return coupled.loop_matrix(self.devices, self.together(environment))

    def growth(self, environment: StateSpace) -> float:
        """Return the largest modulus of the loop's eigenvalues, free shifts left out; below 1 is stable."""
        if any(isinstance(axis.environment, Places) and axis.environment.runs_off for axis in self.axes):
            return math.inf
        found = self._worst(environment)[0]
        return max(found, self._apart) if self.may_slacken else found

    def crossings(self, environment_of: EnvironmentOf) -> list[float] | None:
        if len(self._own) > MOST_CLOSED:
            return None
        step, environments = self._usual(environment_of)
        found = [
            crossings([coupled.loop_matrix(self.devices, parallel([each, own])) for each in environments], step)
            for own in self._own
        ]
        return None if None in found else [stiffness for each in found for stiffness in each or ()]

    def _growth(self, environment: StateSpace) -> float:
        falls = int((_stiffnesses(environment) < 0.0).sum())
        if falls:
            matrix = coupled.loop_matrix(self.devices, environment)
            modes = np.linalg.eigvals(coupled.without_shifts(matrix, self.devices, environment))
            # At a crest the ideal grows too: one real eigenvalue above 1 for each negative stiffness does not count.
            real = np.flatnonzero((np.abs(modes.imag) < 1e-9) & (modes.real > 1.0 - 1e-9))
            fallen = real[np.argsort(modes.real[real])[-falls:]]
            return float(np.abs(np.delete(modes, fallen)).max())
        # Undamped devices can drift together at a constant speed for ever. The eigenvalue 1 of this drift must not
        # count as growth when rounding puts it above 1.
        found = coupled.growth(self.devices, environment)
        drifts = not any(axis.plant.damping for axis in self.axes)
        return 1.0 if drifts and abs(found - 1.0) <= ROUNDING else found

    def damping_share(self, environment: StateSpace) -> float:
        """Return the share of the devices' dampings that passivity needs; ∞ when no damping is enough."""
        if not self.has_potential:
            return math.inf
        left = [self._damping_left(axis) for axis in self.axes]
        if min(left) < 0.0:
            return math.inf
        own = [(place, axis.environment) for place, axis in enumerate(self.axes) if axis.environment is not None]
        linear = [coupled.embedded(each, place, len(self.axes)) for place, each in own if not isinstance(each, Places)]
        whole = parallel([environment, *linear])
        if not self.is_linear:
            return self._share_when_cut(whole, np.array(left))
        pairs = zip(left, self.axes, strict=True)
        ports = [PassivityPort(damping, axis.delay, axis.plant.torque_lag) for damping, axis in pairs]
        return damping_share(whole, ports, self.period)

    def _share_when_cut(self, environment: StateSpace, dampings: Matrix) -> float:
        """Return the share of these dampings that a coupling with a limited force needs."""
        count, slopes, steps = len(self.axes), np.abs(_at_rest(environment)), self._steps(environment)
        ages = np.array([0.5 * self.period + axis.delay + axis.plant.torque_lag for axis in self.axes])
        spreads = [spread_of(self.period, axis.delay, axis.plant.torque_lag) for axis in self.axes]
        form = np.zeros((2 * count, 2 * count))
        form[:count, :count] = 0.5 * slopes * np.add.outer(ages, ages) + steps
        form[:count, count:] = 0.5 * slopes * np.sqrt(spreads)
        form[count:, :count] = form[:count, count:].T
        if not dampings.all():
            return math.inf if form.any() else 0.0
        root = np.sqrt(np.tile(dampings, 2))
        return float(np.linalg.eigvalsh(form / np.outer(root, root)).max())

    def _steps(self, environment: StateSpace) -> Matrix:
        """Return the dampings B·κ_i·κ_j: T times the sum over all periods of |step response − force at rest|."""
        at_rest, state = _at_rest(environment), np.zeros((environment.order, len(self.axes)))
        total, quiet = np.zeros_like(at_rest), 0
        for _ in range(MOST_WEIGHTS):
            part = np.abs(environment.c @ state + environment.d - at_rest)
            total = total + part
            state = environment.a @ state + environment.b
            quiet = quiet + 1 if (part <= FADED * (total + np.abs(at_rest)).max()).all() else 0
            if not environment.order or quiet == QUIET:
                return self.period * total
        return np.full_like(total, math.inf)

    def rounding_is_bridged(self, environment: StateSpace) -> bool:
        """Return whether Coulomb friction absorbs the energy that the rounding of all encoders may give.

        A count of one axis acts on the other ones too, by the slope and the damping between them.
        """
        per_count = 0.5 * np.abs(_at_rest(environment)) + self._steps(environment) / self.period
        needed = per_count @ np.array([axis.plant.resolution for axis in self.axes])
        for place, axis in enumerate(self.axes):
            if isinstance(axis.environment, Places):
                own = axis.environment.increments
                needed[place] += (0.5 * own.slope + own.damping / self.period) * axis.plant.resolution
        return bool((np.array([axis.plant.coulomb for axis in self.axes]) >= needed).all())

    def _damping_left(self, axis: Axis) -> float:
        """Return the device damping minus the need of its own elements [N·s/m or N·m·s/rad]; below 0: too little."""
        # The readings of a tachometer do not show the motion between them, so the damping of its device counts as 0.
        own = 0.0 if axis.plant.tachometer else axis.plant.damping
        return own - axis.damping_needed(axis.environment, self.period) if isinstance(axis.environment, Places) else own

    def passive_limit(self, environment_of: EnvironmentOf, stable: float) -> float:
        """Return the stiffness [N/m or N·m/rad] up to which any passive hands are safe; `stable` bounds it.

        The search assumes that the passive stiffnesses are one interval. This holds when the forces are a fixed part
        plus a part proportional to the stiffness, because the share s of the dampings is then the largest eigenvalue of
        a matrix that is affine in the stiffness, which is convex. With an undamped virtual mode no stiffness is
        passive.
        """
        return self._passive_limit(environment_of, stable, SMALLEST, PRECISION)

    def felt(self, environment_of: EnvironmentOf) -> list[float]:
        """Return the force at each handle per stiffness and position with the others held; 1 and n² for a shaft."""
        one, none = (np.abs(np.diag(_at_rest(environment_of(stiffness)))) for stiffness in (1.0, 0.0))
        return [float(each) for each in np.abs(one - none)]


def _at_rest(environment: StateSpace) -> Matrix:
    """Return the forces per position at rest."""
    states = equilibrium(environment.a - np.eye(environment.order), environment.b)
    return np.asarray(environment.c @ states + environment.d)


def _stiffnesses(environment: StateSpace) -> NDArray[np.float64]:
    """Return the principal stiffnesses at rest; a value within rounding of 0 is 0."""
    at_rest = _at_rest(environment)
    found = np.linalg.eigvalsh(-0.5 * (at_rest + at_rest.T))
    return np.asarray(np.where(np.abs(found) > ROUNDING * np.abs(found).max(initial=0.0), found, 0.0))


def are_linear(couplings: Sequence[Any], efforts: Mapping[str, float]) -> bool:
    """Return whether no coupling and no motor limits a force; `efforts` are the motors' largest [N or N·m]."""
    return all(map(math.isinf, efforts.values())) and not may_slacken(couplings)


def has_potential(couplings: Sequence[Any], efforts: Mapping[str, float], are_alone: bool) -> bool:
    """Return whether the forces have a potential, with play and largest force of a coupling and the motors' limits.

    `efforts` are the largest forces of the motors [N or N·m]. `are_alone`: the axes have no elements of their own.
    """
    if not all(map(is_shipped, couplings)):  # it is known in one place alone, by its `linearised`
        return False
    if are_linear(couplings, efforts):
        return True
    if len(couplings) != 1:
        return False
    (only,) = couplings
    felt, most = abs(getattr(only, "transmission", math.nan)), getattr(only, "saturation", None) or math.inf
    first, second = (efforts[name] for name in only.axes)
    if math.isinf(first) and math.isinf(second):
        return True
    is_within = most <= first and felt * most <= second
    return are_alone and (is_within or math.isclose(felt * first, second, rel_tol=1e-9))


def may_slacken(couplings: Sequence[Any]) -> bool:
    """Return whether a coupling has play or a largest force, or is of another package and may have them."""
    slack = (getattr(each, "dead_band", 0.0) or getattr(each, "saturation", None) for each in couplings)
    return any(slack) or not all(map(is_shipped, couplings))


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
    places, spaces = list(estimators), []
    for each in couplings:
        own = linearised(each, changes if each is varied else {})
        spaces.append(coupled.among(own, [places.index(name) for name in each.axes], len(places)))
    return coupled.environment(parallel(spaces), period=period, method=None, estimators=list(estimators.values()))
