"""What a scene needs of an axis beside its position: velocity, time, torque; worked out once a period."""

from collections.abc import Callable, Sequence

from haptic_fieldbus.cycle.axis_checks import STATUSWORD, T_NS
from haptic_fieldbus.cycle.laws import AxisState, Sensed
from haptic_fieldbus.defaults import DEFAULT_ESTIMATOR
from haptic_fieldbus.planning.axis_plan import AxisPlan
from haptic_fieldbus.signals import Signal

PeriodStep = Callable[[], None]
Feedback = Callable[[], tuple[int, ...]]
"""Returns what was decoded last."""


def in_order(steps: Sequence[PeriodStep]) -> PeriodStep:
    """Return one step that takes all of these."""

    def work() -> None:
        for step in steps:
            step()

    return work


def bind_sense(
    axis: AxisPlan, state: AxisState, sensed: Sensed, feedback: Feedback, period: float
) -> tuple[PeriodStep | None, PeriodStep | None]:
    """Return (all that the scene needs, of it the estimator that takes one position a period); None for nothing.

    Only what is needed is worked out, and an estimator imported only where one is.
    """
    steps: list[PeriodStep] = []
    estimator = None
    if Signal.VELOCITY in axis.needs and not axis.integrates:
        velocity, timed = _bind_velocity(axis, state, sensed, feedback, period)
        estimator = None if timed else velocity
        steps.append(velocity)
    if Signal.ELAPSED_NS in axis.needs:

        def elapsed() -> None:
            sensed.elapsed_ns = feedback()[T_NS] - state.began_ns

        steps.append(elapsed)
    if Signal.TORQUE_ACTUAL in axis.needs:
        steps.append(_bind_torque(axis, sensed, feedback))
    if len(steps) < 2:
        return (steps[0] if steps else None), estimator
    return in_order(steps), estimator


def _bind_velocity(
    axis: AxisPlan, state: AxisState, sensed: Sensed, feedback: Feedback, period: float
) -> tuple[PeriodStep, bool]:
    """Estimate the velocity in periods with new feedback, else the last estimate stays; and: does it take times?"""
    from haptic_fieldbus.numerics.estimators import bind, is_timed

    name = axis.estimator or DEFAULT_ESTIMATOR
    estimate = bind(name, period, axis.resolution)
    if is_timed(name):

        def at_latch() -> None:
            if state.steps:
                sensed.velocity = estimate(state.position, feedback()[T_NS])

        return at_latch, True

    def velocity() -> None:
        if state.steps:
            sensed.velocity = estimate(state.position)

    return velocity, False


def _bind_torque(axis: AxisPlan, sensed: Sensed, feedback: Feedback) -> PeriodStep:
    unit = axis.shown_unit * axis.rig.mechanism.sign
    place = STATUSWORD + [mapped.signal for mapped in axis.incoming].index(Signal.TORQUE_ACTUAL)

    def torque() -> None:
        sensed.torque_actual = feedback()[place] * unit

    return torque
