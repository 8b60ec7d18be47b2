"""The impedance that a hand feels at the handle, Z(jω) = force of the hand over velocity, device included.

The hand shakes the handle with F·e^{jωt}. By itself the device answers with x = G·F, G = 1/(m·s² + b·s); its samples
x_k = X·e^{jωkT} drive the discrete environment H(z), whose force, held and delayed, moves the samples again by the
pulse response P(z): X = G·F + P·H·X. Of the held force the component at ω is h·H·X with

    h = e^{−jω·td}·(1 − e^{−jωT})/(jωT)·1/(1 + jω·λ),

so the handle moves with x = G·(F + h·H·X) at ω (and a little at the aliases, which are left out), and Z = F/(jω·x).
The ideal is the device with the environment in continuous time: Z = m·jω + b − H_c(jω)/(jω).
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
    """Of one scene [N·s/m], shape (n,)."""

    scene: str
    frequency: Array
    """[Hz]"""
    felt: Complex
    ideal: Complex
    device: Complex
    """The device with its motor off."""


def felt_impedance(bench: Bench, environment: StateSpace, frequency: Array) -> Complex:
    """With the discrete environment x_k → F_k of the loop."""
    plant, period = bench.plant, bench.period
    s = _laplace(frequency)
    angle = 2.0 * np.pi * frequency * period
    by_itself = 1.0 / (plant.mass * s**2 + plant.damping * s)
    law = frequency_response(environment, angle)
    samples = by_itself / (1.0 - pulse_response(sample(plant, period, bench.delay), angle) * law)
    hold = np.exp(-s * bench.delay) * -np.expm1(-s * period) / (s * period) / (1.0 + s * plant.torque_lag)
    moved: Complex = by_itself * (1.0 + hold * law * samples)
    return 1.0 / (s * moved)


def pulse_response(plant: SampledPlant, angle: Array) -> Complex:
    """P(e^{jθ}): sampled position per held force, shape (n,)."""
    z = np.exp(1j * angle)
    order = len(plant.transition)
    force = plant.after[None] * (z**-plant.whole)[:, None, None]
    force = force + plant.before[None] * (z ** -(plant.whole + 1))[:, None, None]
    return np.asarray(np.linalg.solve(z[:, None, None] * np.eye(order) - plant.transition, force)[:, 0, 0])


def ideal_impedance(plant: Plant, space: StateSpace, frequency: Array) -> Complex:
    """The same with a continuous (position, velocity) → force environment, without delay."""
    s = _laplace(frequency)
    systems: Complex = s[:, None, None] * np.eye(space.order) - space.a
    by_input = space.c @ np.linalg.solve(systems, space.b[None] + 0j) + space.d
    law = by_input[:, 0, 0] + s * by_input[:, 0, 1]
    return device_impedance(plant, frequency) - law / s


def device_impedance(plant: Plant, frequency: Array) -> Complex:
    return plant.mass * _laplace(frequency) + plant.damping


def _laplace(frequency: Array) -> Complex:
    """s = jω."""
    return (2j * np.pi * frequency).astype(np.complex128)


def impedance(scene: str, bench: Bench, space: StateSpace, environment: StateSpace, points: int = 400) -> Impedance:
    """From 0.1 Hz to just below half the sampling rate."""
    frequency = np.geomspace(0.1, 0.499 / bench.period, points)
    return Impedance(
        scene,
        frequency,
        felt_impedance(bench, environment, frequency),
        ideal_impedance(bench.plant, space, frequency),
        device_impedance(bench.plant, frequency),
    )
