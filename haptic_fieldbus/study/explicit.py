"""Explicit methods for nonlinear rates ż = f(t, z, u), for virtual states that no matrix describes.

The steps are those of `one_step` and `staggered`, with the same inputs and starts. A call returns z_n as soon as u_n is
known, and the element computes its force from both. Implicit equations cannot be solved with f alone: for "verlet" the
velocity in a(p, v, u) is predicted by half a kick with the old velocity and corrected once, which keeps second order.

A bristle that is faster than the period makes all these methods explode (LuGre at |v| > 2·g/(σ0·T)). The caller must
choose a small enough period with `lag_limit` and `oscillator_limit` of the method. For "verlet" alone the limit of a
lag λ differs here: with x = λT/2 a step multiplies the state by (1 − x)(1 − x + x²), which is stable up to T·λ = 3.087.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.numerals import exactly

States = tuple[float, ...]
Rates = Callable[..., Sequence[float]]
"""Function f(t [s], states, *inputs) that returns the rates of the states, in their order."""
Advance = Callable[..., States]
"""Function from the inputs of a sample to the states at this sample; it remembers earlier states and inputs."""


EXPLICIT_VERLET_LAG_LIMIT = 3.0873780253841527
"""Largest stable T·λ of "verlet" for a lag: twice the real root of x³ − 2x² + 2x − 2 = 0."""


@dataclass(frozen=True)
class System:
    """Rates, initial states, and the indices of the states that are positions (ṗ = v), for the staggered methods."""

    rates: Rates
    start: States
    positions: tuple[int, ...] = ()

    @property
    def velocities(self) -> tuple[int, ...]:
        return tuple(state for state in range(len(self.start)) if state not in self.positions)


def _moved(states: States, rates: Sequence[float], span: float) -> States:
    return tuple([z + span * rate for z, rate in zip(states, rates, strict=True)])


def _some_moved(states: States, rates: Sequence[float], span: float, which: tuple[int, ...]) -> States:
    moved = list(states)
    for state in which:
        moved[state] += span * rates[state]
    return tuple(moved)


Inputs = tuple[float, ...]
Stepped = tuple[States, States]
"""States at the sample, and the states that the next step begins with."""
Step = Callable[[System, float, int, States, Inputs, Inputs], Stepped]
"""Function (system, period, sample, states, inputs of the sample before, inputs) → states; at sample 0 both inputs are
the same."""


def _forward_euler(system: System, period: float, sample: int, now: States, before: Inputs, inputs: Inputs) -> Stepped:
    return now, _moved(now, system.rates(sample * period, now, *inputs), period)


def _semi_implicit(system: System, period: float, sample: int, now: States, before: Inputs, inputs: Inputs) -> Stepped:
    """Kick, then drift; the velocities belong to half a period earlier."""
    rates, time = system.rates, sample * period
    acceleration = rates(time, now, *inputs)
    if sample == 0:  # half a kick backwards, without which the method is of first order
        now = _some_moved(now, acceleration, -0.5 * period, system.velocities)
    kicked = _some_moved(now, acceleration, period, system.velocities)
    return now, _some_moved(kicked, rates(time, kicked, *inputs), period, system.positions)


def _drift_first(system: System, period: float, sample: int, now: States, before: Inputs, inputs: Inputs) -> Stepped:
    rates, time = system.rates, sample * period
    drifted = _some_moved(now, rates(time, now, *inputs), period, system.positions)
    return now, _some_moved(drifted, rates(time, drifted, *inputs), period, system.velocities)


def _verlet(system: System, period: float, sample: int, now: States, before: Inputs, inputs: Inputs) -> Stepped:
    """Half a kick completes v_n, then half a kick and a drift begin the next step."""
    rates, velocities, half, time = system.rates, system.velocities, 0.5 * period, sample * period
    if sample:
        predicted = _some_moved(now, rates(time, now, *inputs), half, velocities)
        now = _some_moved(now, rates(time, predicted, *inputs), half, velocities)
    kicked = _some_moved(now, rates(time, now, *inputs), half, velocities)
    return now, _some_moved(kicked, rates(time, kicked, *inputs), period, system.positions)


def _runge_kutta(system: System, period: float, sample: int, now: States, before: Inputs, inputs: Inputs) -> Stepped:
    """Make the classic Runge–Kutta step to z_n; the input halfway is the mean of the inputs at both ends."""
    # The step to z_n needs u_n, so it is made when u_n arrives; the first call has nothing to do.
    if sample:
        rates, half, time = system.rates, 0.5 * period, (sample - 1) * period
        middle = [0.5 * (old + new) for old, new in zip(before, inputs, strict=True)]
        first = rates(time, now, *before)
        second = rates(time + half, _moved(now, first, half), *middle)
        third = rates(time + half, _moved(now, second, half), *middle)
        fourth = rates(time + period, _moved(now, third, period), *inputs)
        slopes = zip(first, second, third, fourth, strict=True)
        now = _moved(now, [a + 2.0 * (b + c) + d for a, b, c, d in slopes], period / 6.0)
    return now, now


EXPLICIT: dict[str, Step] = {
    "forward-euler": _forward_euler,
    "semi-implicit": _semi_implicit,
    "semi-implicit-drift-first": _drift_first,
    "verlet": _verlet,
    "rk4": _runge_kutta,
}


def bind_rates(
    rates: Rates, start: Sequence[float], period: float, method: str, positions: Sequence[int] = ()
) -> Advance:
    """Return a fresh step of an explicit method for ż = f(t, z, u); `start` holds the states at the first call.

    `positions` are the indices of the states that are positions. Raises UsageError for a method that is not in
    EXPLICIT, and for a period [s] that is not above 0.
    """
    if method not in EXPLICIT:
        raise UsageError(f'"{method}" is not for nonlinear rates; there are: {", ".join(EXPLICIT)}')
    if not 0.0 < period < math.inf:
        raise UsageError(f"period {exactly(period)} s: expected a finite number above 0")
    step, system = EXPLICIT[method], System(rates, tuple(start), tuple(positions))
    states, sample = system.start, 0
    before: Inputs = ()

    def advance(*inputs: float) -> States:
        nonlocal states, before, sample
        now, states = step(system, period, sample, states, before or inputs, inputs)
        before, sample = inputs, sample + 1
        return now

    return advance
