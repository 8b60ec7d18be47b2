"""Feedback of an axis whose drive offers velocity only: position and velocity of the handle from one reading a period.

The position counts from where the handle was enabled and drifts (`numerics.estimators.tachometer`); it is trusted up to
the drift limit of the axis. A position limit is kept by the place where the handle may be in the worst case.
"""

import math
from collections.abc import Callable

from haptic_fieldbus.cycle.safety import TripKind
from haptic_fieldbus.cycle.state import AxisState, Sensed
from haptic_fieldbus.cycle.watch import TripOff
from haptic_fieldbus.numerics.estimators.tachometer import VelocityIntegrator
from haptic_fieldbus.planning.axis_plan import AxisPlan

Follow = Callable[[int, int], None]
"""(t_ns, reading); without a new reading the one before."""


def bind_follow(axis: AxisPlan, state: AxisState, sensed: Sensed, period: float, trip: TripOff) -> Follow:
    """What follows the handle from now on: the first call, where it is enabled, is zero."""
    unit, limits = axis.velocity_unit, axis.limits
    integrator = VelocityIntegrator(period, abs(unit))
    lowest, highest = limits.position or (-math.inf, math.inf)
    began_ns: int | None = None

    def follow(t_ns: int, reading: int) -> None:
        nonlocal began_ns
        velocity = sensed.velocity = reading * unit
        if began_ns is None:
            began_ns = t_ns
            integrator.start(velocity)
        elif not state.steps:
            integrator.hold((t_ns - began_ns) * 1e-9)
        else:
            integrator.step(velocity, (t_ns - began_ns) * 1e-9)
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
