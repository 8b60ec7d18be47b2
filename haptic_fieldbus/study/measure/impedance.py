"""Impedance that a hand feels at the handle, Z(jω) = force of the hand over velocity, device included.

The hand shakes the handle with F·e^{jωt}. Without feedback the device moves by x = G·F, G = 1/(m·s² + b·s). The samples
x_k = X·e^{jωkT} drive the discrete environment H(z). Its force, held and delayed, moves the samples by the pulse
response P(z), so that X = G·F + P·H·X. The component of the held force at ω is h·H·X with

    h = e^{−jω·td}·(1 − e^{−jωT})/(jωT)·1/(1 + jω·λ),

so the handle moves by x = G·(F + h·H·X) at ω, and Z = F/(jω·x). The small motion at the aliases of ω is left out. The
ideal is the device with the environment in continuous time: Z = m·jω + b − H_c(jω)/(jω).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from haptic_fieldbus.margins.plant import Plant, sample
from haptic_fieldbus.numerics.linear import StateSpace
from haptic_fieldbus.numerics.loops import Array
from haptic_fieldbus.numerics.passivity import frequency_response
from haptic_fieldbus.numerics.sampled import SampledPlant
from haptic_fieldbus.study.measure.bench import Bench

Complex = NDArray[np.complex128]


@dataclass(frozen=True, eq=False)
class Impedance:
    """Impedances of one scene [N·s/m], each `(n,)`."""

    scene: str
    frequency: Array
    """Frequencies [Hz], `(n,)`."""
    felt: Complex
    """Impedance of the sampled loop."""
    ideal: Complex
    """Impedance with the environment in continuous time."""
    device: Complex
    """Impedance of the device with its motor off."""


def felt_impedance(bench: Bench, environment: StateSpace, frequency: Array) -> Complex:
    """Return the impedance with the discrete environment x_k → F_k of the loop [N·s/m], `(n,)`."""
    plant, period = bench.plant, bench.period
    s = _laplace(frequency)
    angle = 2.0 * np.pi * frequency * period
    by_itself = 1.0 / (plant.mass * s**2 + plant.damping * s)
    law = frequency_response(environment, angle)
    samples = by_itself / (1.0 - pulse_response(sample(plant, period, bench.delay), angle) * law)
    # expm1 keeps the digits of 1 − e^{−sT} at low frequencies, where both are nearly equal.
    hold = np.exp(-s * bench.delay) * -np.expm1(-s * period) / (s * period) / (1.0 + s * plant.torque_lag)
    moved: Complex = by_itself * (1.0 + hold * law * samples)
    return 1.0 / (s * moved)


def pulse_response(plant: SampledPlant, angle: Array) -> Complex:
    """Return P(e^{jθ}), the sampled position per held force [m/N], for angles θ = ωT, `(n,)`."""
    z = np.exp(1j * angle)
    order = len(plant.transition)
    # A delay that is no whole number of periods splits each period: in its first part the force before still acts.
    force = plant.after[None] * (z**-plant.whole)[:, None, None]
    force = force + plant.before[None] * (z ** -(plant.whole + 1))[:, None, None]
    return np.asarray(np.linalg.solve(z[:, None, None] * np.eye(order) - plant.transition, force)[:, 0, 0])


def ideal_impedance(plant: Plant, space: StateSpace, frequency: Array) -> Complex:
    """Return the impedance with an environment (position, velocity) → force in continuous time [N·s/m], `(n,)`."""
    s = _laplace(frequency)
    systems: Complex = s[:, None, None] * np.eye(space.order) - space.a
    by_input = space.c @ np.linalg.solve(systems, space.b[None] + 0j) + space.d
    law = by_input[:, 0, 0] + s * by_input[:, 0, 1]
    return device_impedance(plant, frequency) - law / s


def device_impedance(plant: Plant, frequency: Array) -> Complex:
    """Return the impedance m·jω + b of the device alone [N·s/m], `(n,)`."""
    return plant.mass * _laplace(frequency) + plant.damping


def _laplace(frequency: Array) -> Complex:
    """Return s = jω for frequencies [Hz], `(n,)`."""
    return (2j * np.pi * frequency).astype(np.complex128)


def impedance(scene: str, bench: Bench, space: StateSpace, environment: StateSpace, points: int = 400) -> Impedance:
    """Return the impedances of a scene at `points` frequencies, from 0.1 Hz to just below half the sampling rate."""
    frequency = np.geomspace(0.1, 0.499 / bench.period, points)
    return Impedance(
        scene,
        frequency,
        felt_impedance(bench, environment, frequency),
        ideal_impedance(bench.plant, space, frequency),
        device_impedance(bench.plant, frequency),
    )
