"""Where a scene that begins with too much force could begin instead."""

from collections.abc import Iterator

from haptic_fieldbus.cycle.laws import field_of, summed
from haptic_fieldbus.cycle.state import Sensed
from haptic_fieldbus.planning.axis_plan import AxisPlan

SEARCHED = {"linear": 0.5, "rotary": 6.2832}
"""How far from where the handle is a place is looked for [m or rad]."""
PLACES = 2000
PERIOD = 1e-3
"""[s]; any period will do, for at rest no element depends on it."""


def start_position(axis: AxisPlan, largest: float, here: float = 0.0) -> float | None:
    """Return the nearest place, as a way from `here` [m or rad], at which the scene asks for at most `largest`.

    Each place is tried with elements that begin there, at rest. None when there is no such place nearby.
    """
    for way in _ways(SEARCHED[axis.workspace.value] / PLACES):
        fields = [field_of(element, PERIOD, axis.method, Sensed()) for element in axis.elements]
        if fields and abs(summed(fields)(here + way)) <= largest:
            return way
    return None


def _ways(step: float) -> Iterator[float]:
    """From small to large, to both sides."""
    for place in range(1, PLACES + 1):
        yield place * step
        yield -place * step
