"""The parts that a rig may add to a rigid shaft, as linear systems and as nonlinear torques.

The nine states of `motion` are followed by a constant one, the twist ψ = θ − θ_L of the coupling and the speed ω_L of
the load behind it. Motor J_m and load J_L share the inertia of the axis; hand and weight act on the load:

    J_m·ω'   = τ + c − b·ω − T + n_m          ψ' = ω − ω_L
    J_L·ω_L' = T + k_h·δ + d_h·(ν − ω_L) + G + n_L          δ' = ν − ω_L

Coupling, on the flank σ = ±1 of a backlash β: T = k·(ψ − σ·β/2) + d·(ω − ω_L), which never pulls. Contact ends where
σ·T falls to zero. It begins where the flanks meet, or where σ·T rises from zero while they still overlap. In between T
= 0. Without backlash there is one flank, and it also pulls. Without a coupling, motor and load are one body.

The nonlinear torques are n_m (cogging, Stribeck) and n_L (a weight on a lever). All quantities are at the motor shaft,
SI.
"""

import math
from dataclasses import dataclass

import numpy as np

from haptic_fieldbus.drive.mechanics import Mechanics
from haptic_fieldbus.numerics.linear import Matrix
from haptic_fieldbus.sim.hand import Grip
from haptic_fieldbus.sim.mechanics import motion
from haptic_fieldbus.sim.mechanics.motion import (
    ANGLE,
    FORCE,
    FRICTION,
    HAND_SPEED,
    SLOPE,
    SPEED,
    STRETCH,
    TARGET,
    TORQUE,
    Shaft,
)

ONE, TWIST, LOAD_SPEED = range(motion.ORDER, motion.ORDER + 3)
ORDER = motion.ORDER + 3


@dataclass(frozen=True)
class Load:
    """Shaft and optional parts; `lever` is the signed ratio of handle to motor angle, None for a linear mechanism."""

    shaft: Shaft
    mechanics: Mechanics
    lever: float | None = None

    @property
    def motor_inertia(self) -> float:
        """Return the inertia on the motor's side of the coupling [kg·m²]; without a coupling, all of it."""
        coupling = self.mechanics.coupling
        return self.shaft.inertia - (coupling.load_inertia if coupling is not None else 0.0)

    @property
    def load_inertia(self) -> float:
        """Return the inertia of the part that the hand holds [kg·m²]."""
        coupling = self.mechanics.coupling
        return self.shaft.inertia if coupling is None else coupling.load_inertia

    @property
    def held(self) -> int:
        """Return the index of the state that is the speed of the part that the hand holds."""
        return SPEED if self.mechanics.coupling is None else LOAD_SPEED

    @property
    def half_play(self) -> float:
        """Return half of the backlash [rad]; 0 without one."""
        coupling = self.mechanics.coupling
        return coupling.backlash / 2 if coupling is not None else 0.0

    @property
    def breakaway(self) -> float:
        """Return the largest torque that friction can hold at standstill [N·m]."""
        stribeck = self.mechanics.stribeck
        return self.shaft.coulomb + (stribeck.torque if stribeck is not None else 0.0)

    def system(self, grip: Grip | None, *, sticking: bool, flank: int) -> Matrix:
        """Return the linear part, shape (12, 12) in 1/s.

        `flank` is ±1, 0 while the coupling is open, and 1 where there is no backlash.
        """
        a = np.zeros((ORDER, ORDER))
        a[TORQUE, TARGET], a[TORQUE, TORQUE] = 1 / self.shaft.lag, -1 / self.shaft.lag
        if not sticking:
            a[ANGLE, SPEED] = 1.0
            # A sticking shaft does not move; the coupling and the hand still do.
            a[SPEED] = self._acting(grip, flank) / self.motor_inertia
            a[SPEED, SPEED] -= self.shaft.damping / self.motor_inertia
            a[SPEED, FRICTION] = 1 / self.motor_inertia
        if self.mechanics.coupling is not None:
            a[TWIST, SPEED], a[TWIST, LOAD_SPEED] = 1.0, -1.0
            a[LOAD_SPEED] = (self.coupling_torque(flank) + self._on_load(grip)) / self.load_inertia
        if grip is not None:
            a[STRETCH, HAND_SPEED], a[STRETCH, self.held] = 1.0, -1.0
            a[HAND_SPEED] = -_hand(grip, self.held) / grip.inertia
            a[HAND_SPEED, FORCE] = 1 / grip.inertia
            a[FORCE, SLOPE], a[SLOPE, FORCE] = 1.0, -(grip.angular_frequency**2)
        return a

    def coupling_torque(self, flank: int) -> Matrix:
        """Return T as a form of the states, shape (12,)."""
        form = np.zeros(ORDER)
        coupling = self.mechanics.coupling
        if coupling is not None and flank:
            # The constant state carries the offset of the flank.
            form[TWIST], form[ONE] = coupling.stiffness, -flank * coupling.stiffness * self.half_play
            form[SPEED], form[LOAD_SPEED] = coupling.damping, -coupling.damping
        return form

    def pull(self, grip: Grip | None, flank: int) -> Matrix:
        """Return the torque on the motor at rest as a form, shape (12,), without friction and nonlinear torques."""
        form = self._acting(grip, flank)
        form[SPEED] = 0.0
        return form

    def _acting(self, grip: Grip | None, flank: int) -> Matrix:
        """Return the torque on the motor as a form, shape (12,), without its own friction and nonlinear torques."""
        form = self._on_load(grip) if self.mechanics.coupling is None else -self.coupling_torque(flank)
        form[TORQUE] = 1.0
        return form

    def _on_load(self, grip: Grip | None) -> Matrix:
        """Return the torque of hand and constant weight on the load as a form, shape (12,)."""
        form = np.zeros(ORDER)
        if grip is not None:
            form += _hand(grip, self.held)
        gravity = self.mechanics.gravity
        if gravity is not None and self.lever is None:
            form[ONE] = gravity.torque
        return form


def _hand(grip: Grip, held: int) -> Matrix:
    """Return the torque of the hand's spring and damper on the part that it holds as a form, shape (12,)."""
    form = np.zeros(ORDER)
    form[STRETCH], form[HAND_SPEED], form[held] = grip.stiffness, grip.damping, -grip.damping
    return form


class Torques:
    """The nonlinear torques of a load."""

    def __init__(self, load: Load) -> None:
        self._load = load
        parts = load.mechanics
        on_motor = parts.cogging is not None or parts.stribeck is not None
        on_load = parts.gravity is not None and load.lever is not None
        rows = [SPEED] * on_motor + [load.held] * on_load
        self.rows = tuple(dict.fromkeys(rows))
        """Indices of the speeds on which they act, each once."""
        self.inertias = tuple(load.motor_inertia if row == SPEED else load.load_inertia for row in self.rows)
        self.scale = self._scale()
        """Sum of the largest torques [N·m]."""
        self.fineness = self._fineness()
        """Largest angular frequency of the torques along the shaft's angle [rad/rad]."""

    def at(self, angle: Matrix, speed: Matrix, handle: Matrix, direction: int) -> Matrix:
        """Return the torques on each of `rows` [N·m] at m instants, shape (len(rows), m).

        `angle`, `speed` and `handle` have shape (m,); `handle` is the angle of the load at the motor shaft. `direction`
        is that in which the shaft slips, 0 while it sticks.
        """
        torques = np.zeros((len(self.rows), len(angle)))
        parts, lever = self._load.mechanics, self._load.lever
        if parts.cogging is not None:
            torques[0] -= parts.cogging.torque * np.sin(parts.cogging.periods_per_revolution * angle)
        if parts.stribeck is not None and direction:
            torques[0] -= direction * parts.stribeck.torque * np.exp(-((speed / parts.stribeck.velocity) ** 2))
        if parts.gravity is not None and lever is not None:
            towards = math.copysign(1.0, lever)
            torques[-1] -= towards * parts.gravity.torque * np.sin(lever * handle - parts.gravity.hanging_at)
        return torques

    def _scale(self) -> float:
        parts = self._load.mechanics
        on_lever = abs(parts.gravity.torque) if parts.gravity is not None and self._load.lever is not None else 0.0
        return sum((part.torque for part in (parts.cogging, parts.stribeck) if part is not None), on_lever)

    def _fineness(self) -> float:
        cogging = self._load.mechanics.cogging
        return max(abs(self._load.lever or 0.0), cogging.periods_per_revolution if cogging is not None else 0.0)
