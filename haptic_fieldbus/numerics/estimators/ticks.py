"""Velocity from the time between counts: exact for slow motions, for which differences give zeros and single spikes.

When the position changes, it has moved by Δx, a whole number of counts, in the time Δt since its last change. The
estimate is v = Δx/Δt, held until the next change. While no count comes, the speed cannot exceed one count D over the
time waited, so the estimate falls as D/Δt, to zero for a handle that stands. When D is not known, the last Δx is used
for it. When the direction turns, the handle crosses the same edge twice without moving by a count, so one count is
subtracted.

Times are those of the samples [ns] if they are passed, otherwise whole periods. The relative error of v is about T/Δt.
With the times of the samples, a jittered sample does not look like a speed.
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
        if way == 0.0:  # no count: the speed held so far, but no more than one count over the time waited
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
        "counts divided by the time between them",
        start=_start,
        parameters=(Parameter("count", None, "one encoder count", "m or rad"),),
        timed=True,
    ),
)
