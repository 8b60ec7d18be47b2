"""A body in contact with a spring and a damper by backward difference, from event to event: growth, and limit."""

from collections.abc import Sequence

from haptic_fieldbus.study.oracles.events import LinearBody, Shot, growth, map_of_turn, spring_damper_law
from haptic_fieldbus.study.oracles.polynomials import largest


def growth_of_turn(
    body: LinearBody, turn: float, shots: Sequence[Shot], stiffness: float, damping: float, period: float
) -> float:
    """Return the growth over a turn [s]; the damper divides each way by `period` [s]."""
    return growth(map_of_turn([body], turn, shots, spring_damper_law(stiffness, damping, period), memory=1))


def growth_in_contact(body: LinearBody, period: float, delay: float, stiffness: float, damping: float = 0.0) -> float:
    """Return the growth in a period [s] when each force acts `delay` [s] after its sample."""
    return growth_of_turn(body, period, [Shot(0.0, (delay,))], stiffness, damping, period)


def limit_in_contact(body: LinearBody, period: float, delay: float, damping: float = 0.0) -> float:
    """Return the stiffness [N/m or N·m/rad] up to which nothing grows."""
    return largest(lambda k: growth_in_contact(body, period, delay, k, damping) <= 1.0, 1e-3, 1.4, 1e-9)
