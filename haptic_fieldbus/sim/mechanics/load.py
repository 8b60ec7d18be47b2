"""What a rig may ask beyond a rigid shaft, as linear systems and as torques that are not linear.

The nine states of `motion` are followed by a constant one, the twist ψ = θ − θ_L of the coupling and the speed ω_L of
the load behind it. Motor J_m and load J_L share the inertia of the axis; hand and weight hold on to the load:

    J_m·ω'   = τ + c − b·ω − T + n_m          ψ' = ω − ω_L
    J_L·ω_L' = T + k_h·δ + d_h·(ν − ω_L) + G + n_L          δ' = ν − ω_L

Coupling, on the flank σ = ±1 of a backlash β: T = k·(ψ − σ·β/2) + d·(ω − ω_L), which never pulls. Contact ends where
σ·T falls to zero; it begins where the flanks meet, or where σ·T rises from zero while they still overlap. In between
T = 0. Without backlash there is one flank, and it also pulls. Without coupling motor and load are one.

Not linear are n_m (cogging, Stribeck) and n_L (a weight on a lever). Everything at the motor shaft, SI.
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
    """Shaft and optional parts; `lever`: handle per motor angle, signed, None of a linear mechanism."""

    shaft: Shaft
    mechanics: Mechanics
    lever: float | None = None

    @property
    def motor_inertia(self) -> float:
        """[kg·m²], of all where nothing gives way."""
        coupling = self.mechanics.coupling
        return self.shaft.inertia - (coupling.load_inertia if coupling is not None else 0.0)

    @property
    def load_inertia(self) -> float:
        """[kg·m²] of what the hand holds."""
        coupling = self.mechanics.coupling
        return self.shaft.inertia if coupling is None else coupling.load_inertia

    @property
    def held(self) -> int:
        """The state that is the speed of what the hand holds."""
        return SPEED if self.mechanics.coupling is None else LOAD_SPEED

    @property
    def half_play(self) -> float:
        """[rad]"""
        coupling = self.mechanics.coupling
        return coupling.backlash / 2 if coupling is not None else 0.0

    @property
    def breakaway(self) -> float:
        """The torque that standing friction can hold [N·m]."""
        stribeck = self.mechanics.stribeck
        return self.shaft.coulomb + (stribeck.torque if stribeck is not None else 0.0)

    def system(self, grip: Grip | None, *, sticking: bool, flank: int) -> Matrix:
        """The linear part, (12, 12) in 1/s; flank ±1 (0: the coupling is open; 1 where there is no backlash)."""
        a = np.zeros((ORDER, ORDER))
        a[TORQUE, TARGET], a[TORQUE, TORQUE] = 1 / self.shaft.lag, -1 / self.shaft.lag
        if not sticking:
            a[ANGLE, SPEED] = 1.0
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
        """T as a form of the states, (12,)."""
        form = np.zeros(ORDER)
        coupling = self.mechanics.coupling
        if coupling is not None and flank:
            form[TWIST], form[ONE] = coupling.stiffness, -flank * coupling.stiffness * self.half_play
            form[SPEED], form[LOAD_SPEED] = coupling.damping, -coupling.damping
        return form

    def pull(self, grip: Grip | None, flank: int) -> Matrix:
        """What acts on the motor at rest, friction and the torques that are not linear apart, (12,)."""
        form = self._acting(grip, flank)
        form[SPEED] = 0.0
        return form

    def _acting(self, grip: Grip | None, flank: int) -> Matrix:
        """What acts on the motor, its own friction and the torques that are not linear apart, (12,)."""
        form = self._on_load(grip) if self.mechanics.coupling is None else -self.coupling_torque(flank)
        form[TORQUE] = 1.0
        return form

    def _on_load(self, grip: Grip | None) -> Matrix:
        """What hand and constant weight do to the load, (12,)."""
        form = np.zeros(ORDER)
        if grip is not None:
            form += _hand(grip, self.held)
        gravity = self.mechanics.gravity
        if gravity is not None and self.lever is None:
            form[ONE] = gravity.torque
        return form


def _hand(grip: Grip, held: int) -> Matrix:
    """What the hand's spring and damper do to what it holds, (12,)."""
    form = np.zeros(ORDER)
    form[STRETCH], form[HAND_SPEED], form[held] = grip.stiffness, grip.damping, -grip.damping
    return form


class Torques:
    """The torques that are not linear, of a shaft that slips in a direction or sticks (0)."""

    def __init__(self, load: Load) -> None:
        self._load = load
        parts = load.mechanics
        on_motor = parts.cogging is not None or parts.stribeck is not None
        on_load = parts.gravity is not None and load.lever is not None
        rows = [SPEED] * on_motor + [load.held] * on_load
        self.rows = tuple(dict.fromkeys(rows))
        """The speeds on which they act, each once."""
        self.inertias = tuple(load.motor_inertia if row == SPEED else load.load_inertia for row in self.rows)
        self.scale = self._scale()
        """Largest torque [N·m]."""
        self.fineness = self._fineness()
        """Largest angular frequency along the shaft's angle."""

    def at(self, angle: Matrix, speed: Matrix, handle: Matrix, direction: int) -> Matrix:
        """On each of `rows` [N·m] at m instants, (rows, m); `handle` is the angle of the load at the motor shaft."""
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
