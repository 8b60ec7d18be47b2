"""Growth rates of a virtual sprung mass: does it matter in the loop whether the integrator preserves stability?

The handle is *clamped* (the held puck of the lecture: the method alone decides), *in the hand* (a spring and a damper
to the ground) or *free* (the friction of the device alone). The rate is ln(ρ)/T with ρ the largest modulus of the
eigenvalues of one period, so a motion grows by e^(rate) in a second. A free handle stays where it is left, which is an
eigenvalue of exactly 1; it is left out.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from haptic_fieldbus.margins.linear import ROUNDING
from haptic_fieldbus.numerics import integrators, sampled
from haptic_fieldbus.numerics.integrators import METHODS
from haptic_fieldbus.numerics.linear import StateSpace
from haptic_fieldbus.numerics.loops import Array
from haptic_fieldbus.numerics.sampled import SampledPlant, environment
from haptic_fieldbus.study.measure.bench import Bench, free, grounded
from haptic_fieldbus.study.measure.problems import MASS, STIFFNESS, sprung_mass

SOFTEST, BEYOND, LOOKED_AT = 1e-6, 1e3, 120
"""Softest and stiffest spring tried, in units of m/T², and their number; beyond the stiffest, any spring is taken as
stable."""
HANDLES = ("clamped", "in the hand", "free")


@dataclass(frozen=True, eq=False)
class LoopGrowth:
    """Growth rates and stable springs of one method; dictionaries are by the name of the handle."""

    method: str
    stiffness: Array
    """Stiffnesses [N/m], `(n,)`."""
    rate: dict[str, Array]
    """Growth rates [1/s], each `(n,)`."""
    limit: dict[str, float]
    """Stiffest stable spring [N/m]; 0 when none is stable, ∞ when any is."""
    softest: dict[str, float]
    """Softest stable spring below that limit [N/m]; 0 when any below it is stable."""
    at_scene: dict[str, float]
    """Growth rate with the stiffness of the scene [1/s]."""


def _virtual(stiffness: float, method: str, period: float) -> StateSpace:
    return environment(sprung_mass(stiffness), period=period, method=method, estimator=None)


def radius_of(handle: str, bench: Bench, method: str) -> Callable[[float], float]:
    """Return a function from stiffness [N/m] to the largest modulus of the loop's eigenvalues."""
    period = bench.period
    if handle == "clamped":
        return lambda k: sampled.spectral_radius(integrators.discrete(sprung_mass(k), period, method).a)
    if handle == "free":
        device = sampled.sample(*free(bench.plant), period, bench.delay)
        return lambda k: sampled.growth(device, _virtual(k, method, period))
    in_hand = sampled.sample(*grounded(bench.plant), period, bench.delay)
    return lambda k: sampled.spectral_radius(sampled.loop_matrix(in_hand, _virtual(k, method, period)))


def loop_growth(bench: Bench, method: str, points: int) -> LoopGrowth:
    """Measure one method over four decades of stiffness, up to the range that no sampled loop stands."""
    scale = bench.plant.mass / bench.period**2
    stiffness = np.geomspace(2e-5 * scale, 2e-1 * scale, points)
    radii = {handle: radius_of(handle, bench, method) for handle in HANDLES}
    ranges = {handle: stable_range(handle, method, bench, radius) for handle, radius in radii.items()}

    def rate(handle: str, k: float) -> float:
        return math.log(radii[handle](k)) / bench.period

    return LoopGrowth(
        method,
        stiffness,
        {handle: np.array([rate(handle, k) for k in stiffness.tolist()]) for handle in HANDLES},
        {handle: high for handle, (_, high) in ranges.items()},
        {handle: low for handle, (low, _) in ranges.items()},
        {handle: rate(handle, STIFFNESS) for handle in HANDLES},
    )


def stable_range(handle: str, method: str, bench: Bench, radius: Callable[[float], float]) -> tuple[float, float]:
    """Return the softest and the stiffest stable spring [N/m] of the first stable range; (0, 0) when there is none.

    A softest spring of 0 and a stiffest of ∞ stand for no limit. For the clamped handle the limit is m·(h/T)² with the
    method's own limit h, because a double root makes a search imprecise there.
    """
    scale = MASS / bench.period**2
    if handle == "clamped":
        return 0.0, scale * METHODS[method].oscillator_limit ** 2
    grid = np.geomspace(SOFTEST * scale, BEYOND * scale, LOOKED_AT).tolist()
    stable = [radius(k) <= 1.0 + ROUNDING for k in grid]
    if True not in stable:
        return 0.0, 0.0
    first = stable.index(True)
    end = stable.index(False, first) if False in stable[first:] else len(grid)
    low = 0.0 if first == 0 else _edge(radius, grid[first], grid[first - 1])
    return low, math.inf if end == len(grid) else _edge(radius, grid[end - 1], grid[end])


def _edge(radius: Callable[[float], float], stable: float, growing: float) -> float:
    """Return the edge between a stable and a growing stiffness [N/m] by bisection, on its stable side."""
    while abs(growing - stable) > 1e-9 * stable:
        middle = 0.5 * (stable + growing)
        stable, growing = (middle, growing) if radius(middle) <= 1.0 + ROUNDING else (stable, middle)
    return stable


def flicked_free(bench: Bench, method: str, duration: float, stiffness: float = STIFFNESS) -> tuple[Array, Array]:
    """Return times [s] and force on the free handle [N], each `(n,)`, after a flick of 0.1 m/s."""
    period = bench.period
    device = sampled.sample(*free(bench.plant), period, bench.delay)
    force = flicked(device, _virtual(stiffness, method, period), round(duration / period))
    times: Array = np.arange(len(force), dtype=np.float64) * period
    return times, force


def flicked(device: SampledPlant, virtual: StateSpace, steps: int) -> Array:
    """Return the force of the environment on a handle that starts with 0.1 m/s [N], `(steps,)`."""
    matrix, order = sampled.loop_matrix(device, virtual), len(device.transition)
    output, state = np.zeros((2, len(matrix)))
    # Row of the loop's output: force = D·position + C·virtual states, which follow the device's states.
    output[0], output[order : order + virtual.order] = virtual.d[0, 0], virtual.c[0]
    state[1] = 0.1
    forces: Array = np.empty(steps)
    for step in range(steps):
        forces[step] = output @ state
        state = matrix @ state
    return forces
