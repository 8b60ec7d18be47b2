"""The energy balance of a plant, from its trajectory and from physics: powers and energies are written out anew."""

import math
from dataclasses import dataclass

import numpy as np

from haptic_fieldbus.numerics.linear import Matrix
from haptic_fieldbus.sim.hand import Grip
from haptic_fieldbus.sim.mechanics.body import Body
from haptic_fieldbus.sim.mechanics.loaded_plant import Load
from haptic_fieldbus.sim.mechanics.trajectory import Trajectory

CELL_NS = float(1 << 20)
POINTS, WEIGHTS = np.polynomial.legendre.leggauss(12)


@dataclass(frozen=True)
class Balance:
    """[J]; `turned_over` is all that motor and hand gave or took."""

    supplied: float
    lost: float
    stored: float
    turned_over: float

    @property
    def error(self) -> float:
        """Energy that does not add up, as a share of the energy turned over."""
        return abs(self.supplied - self.lost - self.stored) / self.turned_over


def balance(plant: Body, load: Load, grip: Grip | None) -> Balance:
    """From the start of the plant to its present, by Gauss's rule on cells within which the motion is smooth."""
    trajectory = Trajectory(plant.recorder, plant.t_ns)
    begin_ns = trajectory.begins_ns
    length_ns = np.diff(np.append(begin_ns, plant.t_ns))
    cells = np.maximum(1, np.ceil(length_ns / CELL_NS)).astype(np.int64)
    segment = np.repeat(np.arange(len(cells)), cells)
    cell_ns = (length_ns / cells)[segment]
    first = np.arange(len(segment)) - np.repeat(np.cumsum(cells) - cells, cells)
    sums = np.zeros(3)
    for point, weight in zip(POINTS, WEIGHTS, strict=True):
        z = _padded(trajectory.follow(segment, (first + (point + 1) / 2) * cell_ns))
        supplied, lost, turned_over = _powers(z, load, grip)
        sums += weight / 2 * 1e-9 * (np.stack([supplied, lost, turned_over]) @ cell_ns)
    start = _padded(trajectory.follow(np.array([0]), np.array([0.0])))[:, 0]
    end = np.array([*plant.state, 1.0, 0.0, 0.0])[:12]
    stored = _stored(end, load, grip) - _stored(start, load, grip)
    return Balance(float(sums[0]), float(sums[1]), stored, float(sums[2]))


def _padded(states: Matrix) -> Matrix:
    """(12, m): a rigid plant has no coupling."""
    padded = np.zeros((12, len(states)))
    kept = min(12, states.shape[1])
    padded[:kept] = states[:, :kept].T
    return padded


def _powers(z: Matrix, load: Load, grip: Grip | None) -> tuple[Matrix, Matrix, Matrix]:
    """(given by motor and hand, turned to heat, turned over) [W]."""
    _, speed, torque, _, hand_speed, force, _, _, _, _, twist, load_speed = z
    parts, shaft = load.mechanics, load.shaft
    lost = shaft.damping * speed**2 + shaft.coulomb * np.abs(speed)
    if parts.stribeck is not None:
        lost += parts.stribeck.torque * np.exp(-((speed / parts.stribeck.velocity) ** 2)) * np.abs(speed)
    held = speed
    if parts.coupling is not None:
        held = load_speed
        overlap = np.abs(twist) - parts.coupling.backlash / 2
        rate = np.sign(twist) * (speed - load_speed)
        pressing = parts.coupling.stiffness * overlap + parts.coupling.damping * rate
        on = parts.coupling.damping * rate**2
        parting = -parts.coupling.stiffness * overlap * rate
        lost += on if not parts.coupling.backlash else np.where(overlap < 0, 0.0, np.where(pressing > 0, on, parting))
    if grip is not None:
        lost += grip.damping * (hand_speed - held) ** 2
    motor, hand = torque * speed, force * hand_speed
    return motor + hand, lost, np.abs(motor) + np.abs(hand)


def _stored(z: Matrix, load: Load, grip: Grip | None) -> float:
    angle, speed, _, stretch, hand_speed, _, _, _, _, _, twist, load_speed = z.tolist()
    parts = load.mechanics
    inertia = load.shaft.inertia - (parts.coupling.load_inertia if parts.coupling is not None else 0.0)
    energy: float = 0.5 * inertia * speed**2
    if parts.coupling is not None:
        overlap = max(0.0, abs(twist) - parts.coupling.backlash / 2)
        energy += 0.5 * parts.coupling.load_inertia * load_speed**2 + 0.5 * parts.coupling.stiffness * overlap**2
    if grip is not None:
        energy += 0.5 * grip.inertia * hand_speed**2 + 0.5 * grip.stiffness * stretch**2
    if parts.cogging is not None:
        n = parts.cogging.periods_per_revolution
        energy -= parts.cogging.torque / n * math.cos(n * angle)
    if parts.gravity is not None and load.lever is None:
        energy -= parts.gravity.torque * (angle - twist)
    elif parts.gravity is not None and load.lever is not None:
        energy -= (
            parts.gravity.torque / abs(load.lever) * math.cos(load.lever * (angle - twist) - parts.gravity.hanging_at)
        )
    return energy
