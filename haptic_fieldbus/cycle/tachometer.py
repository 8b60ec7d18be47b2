"""Feedback of an axis whose drive offers velocity only: position and velocity of the handle from one reading a period.

The position is 0 where the handle was enabled, and drifts (`numerics.estimators.tachometer`). When its error may exceed
the drift limit of the axis, the run trips. Position limits are compared with the worst case: position plus or minus
that error.
"""

import math
from collections.abc import Callable

from haptic_fieldbus.cycle.laws import AxisState, Sensed
from haptic_fieldbus.cycle.safety import TripKind, TripOff
from haptic_fieldbus.numerics.estimators.tachometer import VelocityIntegrator
from haptic_fieldbus.planning.axis_plan import AxisPlan

Follow = Callable[[int, int], None]
"""Function of (t_ns, reading), called once a period; without new feedback the reading is repeated."""


def bind_follow(axis: AxisPlan, state: AxisState, sensed: Sensed, period: float, trip: TripOff) -> Follow:
    """Return a function that updates velocity, position and drift from one reading a period; `period` in s.

    Its first call sets the position to 0. It trips when speed, acceleration, position or drift exceeds its limit. Two
    readings may differ by their rounding, or by a count in each period, from which a drive may compute them.
    """
    unit, limits = axis.velocity_unit, axis.limits
    integrator = VelocityIntegrator(period, abs(unit))
    lowest, highest = limits.position or (-math.inf, math.inf)
    rounding = 2.0 * max(abs(unit), axis.resolution / period)
    began_ns: int | None = None
    read_ns, read = 0, 0.0
    """Time and velocity of the last new reading."""

    def follow(t_ns: int, reading: int) -> None:
        nonlocal began_ns, read_ns, read
        velocity = sensed.velocity = reading * unit
        state.way = velocity * period
        if began_ns is None:
            began_ns = t_ns
            integrator.start(velocity)
        elif not state.steps:
            integrator.hold((t_ns - began_ns) * 1e-9)
        else:
            integrator.step(velocity, (t_ns - began_ns) * 1e-9)
            elapsed, change = max(period, (t_ns - read_ns) * 1e-9), abs(velocity - read)
            if not change <= limits.acceleration * elapsed + rounding:
                trip(TripKind.ACCELERATION, change / elapsed, limits.acceleration)
        if state.steps:
            read_ns, read = t_ns, velocity
        # A period without a new reading ends here too: the position is extrapolated, and the limits still hold.
        here, drift = integrator.position, integrator.drift
        state.position, state.drift = here, drift
        if not -limits.speed <= velocity <= limits.speed:
            trip(TripKind.SPEED, abs(velocity), limits.speed)
        if here - drift < lowest:
            trip(TripKind.POSITION, here - drift, lowest)
        if here + drift > highest:
            trip(TripKind.POSITION, here + drift, highest)
        if drift > limits.drift:
            trip(TripKind.DRIFT, drift, limits.drift)

    return follow
