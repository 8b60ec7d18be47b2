"""Velocity from the time between counts: exact for slow motions, where differences see nothing and then a spike.

Between two samples with different positions the handle made a way of whole counts, in the time since the position
changed last: v = Δx/Δt, held until the next change. While no count comes the speed cannot be more than one count over
the time waited, so the estimate falls as D/Δt (D the last way, where the count is not known), which gives zero for a
handle that stands. A count taken back is no way: the handle crossed the same edge twice, so one count is subtracted
where the direction turns.

Times are those of the samples [ns], where they are given, else whole periods: then v is right to the share T/Δt, and a
jittered sample does not look like a speed.
"""

import math

from haptic_fieldbus.numerics.estimators.estimator import Estimate, Estimator, EstimatorSetup, Parameter


def _start(setup: EstimatorSetup) -> Estimate:
    period_ns, count = setup.period * 1e9, setup.number("count")
    before: float | None = None
    changed_ns = clock_ns = velocity = last = 0.0

    def step(position: float, time_ns: float | None = None) -> float:
        nonlocal before, changed_ns, clock_ns, velocity, last
        clock_ns = clock_ns + period_ns if time_ns is None else time_ns
        if before is None:
            before, changed_ns = position, clock_ns
        way, waited = position - before, (clock_ns - changed_ns) * 1e-9
        if way == 0.0:
            highest = (count or abs(last)) / waited if waited > 0.0 else abs(velocity)
            return math.copysign(min(abs(velocity), highest), velocity)
        turned = way * last < 0.0
        before, changed_ns, last = position, clock_ns, way
        travelled = way - math.copysign(min(count, abs(way)), way) if turned else way
        velocity = travelled / waited if waited > 0.0 else velocity
        return velocity

    return step


ESTIMATORS = (
    Estimator(
        "tick-interval",
        "counts over the time between them",
        start=_start,
        parameters=(Parameter("count", None, "one encoder count", "m or rad"),),
        timed=True,
    ),
)
