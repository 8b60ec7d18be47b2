"""Limit cycles predicted by describing functions: chatter over the edge of an encoder count, and saturated torque.

The environment's force is multiplied by the gain ν of the nonlinearity. When the loop with ν is on the border of
stability, it oscillates at the frequency of its critical eigenvalue, with the amplitude at which the gain is ν.

- A handle pressed against a wall, between two counts: encoder and wall are a relay with ν(A) = 2·D/(π·A). Without
  Coulomb friction such a cycle always exists. Friction acts as damping 4·fc/(π·ω·A), and ends the cycle for stiffnesses
  up to about K = 2·fc/D.
- Saturated torque: ν falls from 1 as A grows. If the loop becomes stable as ν falls, chatter settles at that amplitude.
  If it becomes unstable, motions larger than that amplitude grow although small motions decay.

The predictions are estimates, as good as the loop is a low-pass filter, and no bounds. Over the edge of a count several
cycles exist beside each other: from rest the one told here is found within 20 % where it lasts 24 samples or more,
after a knock another one. What is proved of chatter, and the largest that is found, is in `chatter`.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from haptic_fieldbus.margins.linear import limit_of
from haptic_fieldbus.margins.plant import Plant, sample
from haptic_fieldbus.numerics import describing, sampled
from haptic_fieldbus.numerics.linear import StateSpace
from haptic_fieldbus.numerics.passivity import frequency_response
from haptic_fieldbus.numerics.sampled import SampledPlant

GAINS = np.geomspace(1.0, 1e-3, 121)
"""Gains ν of the saturation between which a change of stability is searched, in falling order."""
MOST_DAMPING = 1e6
"""Largest damping that friction may act like, as a multiple of the device's own or of m/T; beyond it is no cycle."""


@dataclass(frozen=True)
class LimitCycle:
    """A motion A·sin(ωt) around the position of contact; amplitude [m or rad], angular frequency [rad/s]."""

    amplitude: float
    angular_frequency: float
    attracts: bool
    """True when motions settle to the cycle; False when larger motions grow and smaller motions decay."""


def _critical(plant: Plant, period: float, delay: float, environment: StateSpace) -> tuple[float, float]:
    """Return (ν, ω [rad/s]): the share of the environment's force at which the loop oscillates, and the frequency."""
    device = sample(plant, period, delay)
    scale = (plant.mass / period**2 + plant.damping / period) / abs(float(environment.d[0, 0]))
    gain = limit_of(lambda part: sampled.growth(device, sampled.scaled(environment, part)), scale)
    return gain, _frequency(device, sampled.scaled(environment, gain), period)


def _frequency(device: SampledPlant, environment: StateSpace, period: float) -> float:
    modes = np.linalg.eigvals(sampled.without_shift(sampled.loop_matrix(device, environment), device, environment))
    return float(abs(np.angle(modes[np.abs(modes).argmax()]))) / period


def edge_chatter(plant: Plant, period: float, delay: float, environment: StateSpace) -> LimitCycle | None:
    """Return an estimate of a cycle of a handle pressed to the edge between two counts; None when there is none.

    The environment is that of the contact, x_k → F_k, with a direct force. There is no cycle when friction holds the
    handle, without quantisation, with a tachometer (its velocity has no edges of position), and in an unstable loop,
    whose motions grow beyond a count.
    """
    if not plant.resolution or plant.tachometer or _critical(plant, period, delay, environment)[0] <= 1.0:
        return None

    def cycle(damping: float) -> tuple[float, float]:
        gain, turn = _critical(replace(plant, damping=damping), period, delay, environment)
        return 2.0 * plant.resolution / (math.pi * gain) if gain else math.inf, turn

    def lacking(damping: float) -> float:
        amplitude, turn = cycle(damping)
        return plant.damping + describing.coulomb(amplitude, turn, plant.coulomb) - damping

    # Find the damping that equals the device's own plus that of friction in the cycle which this damping leaves.
    low = high = plant.damping
    if plant.coulomb:
        high = max(plant.damping, 1e-3 * plant.mass / period)  # above 0, to be doubled
        while lacking(high) > 0.0:
            low, high = high, 2.0 * high
            if high > MOST_DAMPING * max(plant.damping, plant.mass / period):
                return None
        while high - low > 1e-9 * high:
            middle = 0.5 * (low + high)
            low, high = (middle, high) if lacking(middle) > 0.0 else (low, middle)
    amplitude, turn = cycle(high)
    return LimitCycle(amplitude, turn, attracts=True) if math.isfinite(amplitude) else None


def saturated_cycles(
    plant: Plant, period: float, delay: float, environment: StateSpace, force: float
) -> tuple[LimitCycle, ...]:
    """Return the cycles of a two-sided contact whose force saturates at `force` [N or N·m], the smallest first."""
    device = sample(plant, period, delay)
    return tuple(_saturated(device, period, environment, force))


def _saturated(device: SampledPlant, period: float, environment: StateSpace, force: float) -> Iterator[LimitCycle]:
    def excess(gain: float) -> float:
        return sampled.growth(device, sampled.scaled(environment, gain)) - 1.0

    values = [excess(gain) for gain in GAINS.tolist()]
    # Each pair of neighbouring gains with a change of stability between them gives a cycle.
    for above, below, before, after in zip(GAINS[:-1], GAINS[1:], values[:-1], values[1:], strict=True):
        if before > 0.0 >= after or before <= 0.0 < after:
            gain = _border(excess, float(above), float(below))
            turn = _frequency(device, sampled.scaled(environment, gain), period)
            stiffness = float(np.abs(frequency_response(environment, np.array([turn * period])))[0])
            amplitude = describing.saturated_amplitude(gain, force) / stiffness
            yield LimitCycle(amplitude, turn, attracts=before > 0.0)


def _border(excess: Callable[[float], float], above: float, below: float) -> float:
    """Return the gain between two gains at which `excess` changes its sign."""
    grows = excess(above) > 0.0
    for _ in range(50):
        middle = 0.5 * (above + below)
        above, below = (middle, below) if (excess(middle) > 0.0) is grows else (above, middle)
    return 0.5 * (above + below)
