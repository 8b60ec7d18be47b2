"""Signals of an axis that a scene uses, computed once a period, and the force field of the scene.

The field is made from the elements of the axis: position of the handle → force on it, in the workspace.

Each element receives exactly the signals that it declared. The law of an element that needs the position alone is its
field, without a wrapper. Other signals are derived once a period, before any field is called, and stored in `Sensed`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

from haptic_fieldbus.defaults import DEFAULT_ESTIMATOR, DEFAULT_METHOD
from haptic_fieldbus.drive.profile import PowerState
from haptic_fieldbus.planning.axis_plan import AxisPlan
from haptic_fieldbus.planning.image import T_NS
from haptic_fieldbus.scenes.element import (
    AnyElement,
    DynamicElement,
    Element,
    Law,
    MemoryElement,
    StaticElement,
    abilities,
)
from haptic_fieldbus.signals import Signal

# Memory of one axis of a running plan; the cycle and its couplings read it too.


@dataclass(slots=True)
class AxisState:
    """Values that an axis keeps from one period to the next."""

    feedback: tuple[int, ...] = ()
    """Last decoded feedback, in the order of `planning.image`."""
    power: PowerState = PowerState.UNKNOWN
    controlword: int = 0
    missing: int = 0
    """Consecutive periods without new feedback, including this period."""
    holding: int = 0
    """Largest `missing` of this axis and the axes coupled with it."""
    steps: int = 1
    """Periods between this feedback and the last one; 0 in a period without feedback."""
    gain: float = 1.0
    """Share of the held force in a period without feedback."""
    zero_counts: int | None = None
    """Encoder count at which the position is 0; None before the first rendered period, and without an encoder."""
    begun: bool = False
    """Whether the first rendered period has passed."""
    began_ns: int = 0
    permitted_ns: int | None = None
    """Time at which force began to rise to its limit; None while the motor direction is not confirmed."""
    fresh_ns: int = 0
    """Time of the last new feedback."""
    power_bits: int = -1
    """Bits of the last statusword that state the power state."""
    moved_ns: int = 0
    """Time of the last change of the position."""
    position: float = 0.0
    way: float = 0.0
    """Motion in the last period [m or rad]."""
    drift: float = 0.0
    """Bound on the error of the position [m or rad]; 0 unless the position is integrated from a velocity."""
    force: float = 0.0
    """Force of the scene, before any limit [N or N·m]."""
    remembered: float = 0.0
    """Part of `force` from elements with a memory, if the axis has other elements too [N or N·m]."""
    led_work: float = 0.0
    led_force: float = 0.0
    """Work and last force of the law along the straight line that bridges periods without a sample [J; N or N·m]."""
    target: int = 0
    """Target torque in steps of the drive, without the sign of the mechanism."""


@dataclass(slots=True)
class Sensed:
    """Signals of one axis besides its position, and the force of its couplings."""

    velocity: float = 0.0
    """[m/s or rad/s]"""
    torque_actual: float = 0.0
    """[N or N·m], in the workspace."""
    elapsed_ns: int = 0
    """Time since the first rendered period."""
    coupled: float = 0.0
    """Force of all couplings on this axis [N or N·m]."""
    damped: float = 0.0
    """Force of the passivity controller [N or N·m]."""


Felt = TypeVar("Felt")
Field = Callable[[float], float]
"""Position of the handle [m or rad] → force on it [N or N·m]; of one element or of a sum of elements."""
PairField = Callable[[], tuple[float, float]]
"""Forces of a coupling on its two axes [N or N·m], each in the workspace of its axis."""


def law_of(element: AnyElement, period: float, method: str | None = None) -> Law:
    """Return a fresh law of `element`: the signals in its `needs` → force [N or N·m]; `period` in s.

    Raises TypeError for an element that is neither static, memory nor dynamic, UsageError for an unknown method.
    """
    if isinstance(element, DynamicElement):
        # Imported here, because only virtual states need an integrator.
        from haptic_fieldbus.numerics.integrators import bind

        return bind(element.dynamics, period, method or DEFAULT_METHOD)
    if isinstance(element, MemoryElement):
        return element.begin(period)
    if isinstance(element, StaticElement):
        return element.force
    raise TypeError(f"{element.name} is no static, memory or dynamic element")


def with_signals(law: Law, needs: tuple[Signal, ...], sensed: Sensed) -> Field:
    """Return `law` as a function of the position alone; its other signals are read from `sensed`."""
    # Common combinations are written out: a direct call is faster than the list of the general case.
    if needs == (Signal.POSITION,):
        return law
    if needs == (Signal.POSITION, Signal.VELOCITY):
        return lambda position: law(position, sensed.velocity)
    if needs == (Signal.VELOCITY,):
        return lambda position: law(sensed.velocity)
    if needs == (Signal.ELAPSED_NS,):
        return lambda position: law(sensed.elapsed_ns)
    if not needs:
        return lambda position: law()
    readers = tuple(READERS[signal] for signal in needs)
    return lambda position: law(*[read(position, sensed) for read in readers])


READERS: dict[Signal, Callable[[float, Sensed], float]] = {
    Signal.POSITION: lambda position, sensed: position,
    Signal.VELOCITY: lambda position, sensed: sensed.velocity,
    Signal.TORQUE_ACTUAL: lambda position, sensed: sensed.torque_actual,
    Signal.ELAPSED_NS: lambda position, sensed: sensed.elapsed_ns,
}
"""Signal → function that reads its present value."""


def field_of(element: Element, period: float, method: str | None, sensed: Sensed) -> Field:
    """Return the force field of one element with a fresh law; `period` in s."""
    return with_signals(law_of(element, period, method), element.needs, sensed)


def summed(fields: Sequence[Field]) -> Field:
    """Return the sum of all fields as one field."""
    # One or two fields need no list, which would cost time in every period.
    if len(fields) == 1:
        return fields[0]
    if not fields:
        return lambda position: 0.0
    if len(fields) == 2:
        first, second = fields
        return lambda position: first(position) + second(position)
    every = tuple(fields)
    return lambda position: sum([field(position) for field in every])


def apart(remembering: Sequence[Field], others: Sequence[Field], state: AxisState) -> Field:
    """Return the sum of all fields as one field, which notes the force of the fields with a memory."""
    mine, rest = summed(remembering), summed(others)

    def field(position: float) -> float:
        state.remembered = force = mine(position)
        return force + rest(position)

    return field


def is_placed(element: Element) -> bool:
    """Return whether the position is an input of an element."""
    return Signal.POSITION in element.needs


def is_static(element: Element) -> bool:
    """Return whether the force at rest follows from the position alone, or is constant."""
    if not is_placed(element):
        return True
    # An element with inputs besides position and velocity has no force at rest that follows from the position.
    return isinstance(element, StaticElement) and {*element.needs} <= {Signal.POSITION, Signal.VELOCITY}


def has_say(element: Element) -> bool:
    """Return whether an element depends on the position through a memory; friction without a surface does not count."""
    return not is_static(element) and (abilities(element).reserve is None or abilities(element).penetration is not None)


def has_no_rest(element: Element) -> bool:
    """Return whether the force at rest tells nothing of an element: it has a memory, or moves the handle by itself."""
    return has_say(element) or not (is_placed(element) or Signal.VELOCITY in element.needs)


def at_rest(elements: Sequence[Element], period: float) -> Field:
    """Return the field of the force at rest, of all elements that have one."""
    placed = [each for each in elements if is_placed(each) and is_static(each)]
    return summed([field_of(each, period, None, Sensed()) for each in placed])


class Noted(Generic[Felt]):
    """A law that keeps what it gave last: to call a law with a memory once more would change it."""

    def __init__(self, law: Callable[..., Felt], last: Felt) -> None:
        self.law, self.last = law, last

    def __call__(self, *inputs: float) -> Felt:
        self.last = last = self.law(*inputs)
        return last


Over = Callable[[], bool]
"""Whether a ramp is over. It has calls of its law, which pauses in gaps, and not time."""


def blended(before: Field, after: Field, periods: int) -> tuple[Field, Over]:
    """Return a field that goes from `before` to `after` along a straight ramp of `periods` calls, and its end.

    With the fields f and g, N periods and w_k = k/N the force is F_k = (1 − w_k)·f_k + w_k·g_k, which lies between f_k
    and g_k. It changes by F_{k+1} − F_k = (1 − w_{k+1})·Δf + w_{k+1}·Δg + (g_k − f_k)/N from one period to the next:
    by the changes of both fields under the motion of the handle, and by an N-th of their difference. It does not jump.
    """
    done = 0

    def field(position: float) -> float:
        nonlocal before, done
        if done >= periods:
            before = after  # frees the old field and its memory
            return after(position)
        done += 1
        old = before(position)
        return old + (after(position) - old) * (done / periods)

    return field, lambda: done >= periods


def blended_pair(before: PairField, after: PairField, periods: int) -> tuple[PairField, Over]:
    """Return the same ramp for the two forces of a coupling, and its end."""
    done = 0

    def pair() -> tuple[float, float]:
        nonlocal before, done
        if done >= periods:
            before = after
            return after()
        done += 1
        share, (first, second), (to_first, to_second) = done / periods, before(), after()
        return first + (to_first - first) * share, second + (to_second - second) * share

    return pair, lambda: done >= periods


# Signals that the scene needs besides the position: velocity, time, torque; computed once a period, before any field.

PeriodStep = Callable[[], None]


def in_order(steps: Sequence[PeriodStep]) -> PeriodStep:
    """Return one step that calls all of these steps."""
    if len(steps) == 1:
        return steps[0]

    def work() -> None:
        for step in steps:
            step()

    return work


def bind_sense(
    axis: AxisPlan, state: AxisState, sensed: Sensed, period: float
) -> tuple[PeriodStep | None, PeriodStep | None]:
    """Return (step of all signals, step of the estimator if it takes one position a period); None for nothing to do.

    Only signals that the scene needs are computed, and an estimator is imported only if one is needed.
    """
    steps: list[PeriodStep] = []
    estimator = None
    if Signal.VELOCITY in axis.needs and not axis.integrates:
        velocity, timed = _bind_velocity(axis, state, sensed, period)
        estimator = None if timed else velocity
        steps.append(velocity)
    if Signal.ELAPSED_NS in axis.needs:

        def elapsed() -> None:
            sensed.elapsed_ns = state.feedback[T_NS] - state.began_ns

        steps.append(elapsed)
    if Signal.TORQUE_ACTUAL in axis.needs:
        unit, place = axis.shown_unit * axis.rig.mechanism.sign, axis.place_of(Signal.TORQUE_ACTUAL)

        def torque() -> None:
            sensed.torque_actual = state.feedback[place] * unit

        steps.append(torque)
    return in_order(steps) if steps else None, estimator


def _bind_velocity(axis: AxisPlan, state: AxisState, sensed: Sensed, period: float) -> tuple[PeriodStep, bool]:
    """Return (step, True if it takes times): estimate the velocity from new feedback, else keep the last estimate."""
    from haptic_fieldbus.numerics.estimators import bind, is_timed

    name = axis.estimator or DEFAULT_ESTIMATOR
    estimate = bind(name, period, axis.resolution)
    if is_timed(name):

        def at_latch() -> None:
            if state.steps:
                sensed.velocity = estimate(state.position, state.feedback[T_NS])

        return at_latch, True

    def velocity() -> None:
        if state.steps:
            sensed.velocity = estimate(state.position)

    return velocity, False
