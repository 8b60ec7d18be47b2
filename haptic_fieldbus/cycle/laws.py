"""From the elements of one axis to its force field: position of the handle → force on it, in the workspace.

Each element gets exactly the signals that it declared. A scene that needs positions alone gets its law directly; what
else is needed is sensed once a period before (`Sensed`), whoever asks.
"""

from collections.abc import Callable, Sequence

from haptic_fieldbus.cycle.state import Sensed
from haptic_fieldbus.defaults import DEFAULT_METHOD
from haptic_fieldbus.scenes.element import AnyElement, DynamicElement, Element, Law, MemoryElement, StaticElement
from haptic_fieldbus.signals import Signal

Field = Callable[[float], float]
"""Position of the handle → force of all elements on it, in the workspace."""
PairField = Callable[[], tuple[float, float]]
"""The forces of a coupling on its two axes, each in its workspace."""


def law_of(element: AnyElement, period: float, method: str | None = None) -> Law:
    """The element as a function of the signals that it needs, fresh; only virtual states import an integrator."""
    if isinstance(element, DynamicElement):
        from haptic_fieldbus.numerics.integrators import bind

        return bind(element.dynamics, period, method or DEFAULT_METHOD)
    if isinstance(element, MemoryElement):
        return element.begin(period)
    if isinstance(element, StaticElement):
        return element.force
    raise TypeError(f"{element.name} is no static, memory or dynamic element")


def with_signals(law: Law, needs: tuple[Signal, ...], sensed: Sensed) -> Field:
    """The law as a function of the position, its other signals taken from `sensed`."""
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


def field_of(element: Element, period: float, method: str | None, sensed: Sensed) -> Field:
    """One element, its law fresh."""
    return with_signals(law_of(element, period, method), element.needs, sensed)


def summed(fields: Sequence[Field]) -> Field:
    """All of them at once."""
    if len(fields) == 1:
        return fields[0]
    if len(fields) == 2:
        first, second = fields
        return lambda position: first(position) + second(position)
    every = tuple(fields)
    return lambda position: sum([field(position) for field in every])


def blended(before: Field, after: Field, periods: int) -> Field:
    """From one field f to another g along a straight ramp of N periods: no jump, and nothing beyond both.

    F_k = (1 − w_k)·f_k + w_k·g_k with w_k = k/N, so F_{k+1} − F_k = (1 − w_{k+1})·Δf + w_{k+1}·Δg + (g_k − f_k)/N: what
    the handle's own motion does to either field, and an N-th of what lies between them.
    """
    done = 0

    def field(position: float) -> float:
        nonlocal before, done
        if done >= periods:
            before = after  # the old one, and what it remembers, is let go
            return after(position)
        done += 1
        old = before(position)
        return old + (after(position) - old) * (done / periods)

    return field


def blended_pair(before: PairField, after: PairField, periods: int) -> PairField:
    """The same for the two forces of a coupling."""
    done = 0

    def pair() -> tuple[float, float]:
        nonlocal before, done
        if done >= periods:
            before = after
            return after()
        done += 1
        share, (first, second), (to_first, to_second) = done / periods, before(), after()
        return first + (to_first - first) * share, second + (to_second - second) * share

    return pair
