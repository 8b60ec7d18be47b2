"""What would be stable instead of an unstable scene."""

import math
from collections.abc import Callable
from dataclasses import dataclass

from haptic_fieldbus.margins.closed_loop import ClosedLoop
from haptic_fieldbus.margins.linear import EnvironmentOf
from haptic_fieldbus.numerics.linear import StateSpace


@dataclass(frozen=True)
class Suggestion:
    """What would be stable instead; None where nothing sensible is."""

    stiffness: float | None
    """With the damping kept."""
    damping: float | None
    """With the stiffness kept."""
    damping_limit: float | None
    """The limit of stability with that damping."""


def suggest(
    loop: ClosedLoop, environment_of: Callable[[float, float], StateSpace], stiffness: float, damping: float | None
) -> Suggestion:
    """Round values that make an unstable scene stable; `damping` None: the scene has none to vary.

    `environment_of` takes (stiffness, damping). The stiffness is 0.7 of its limit, the damping the smallest whose limit
    is 1.2 of the stiffness asked for.
    """

    def damped(value: float) -> EnvironmentOf:
        return lambda stiffness: environment_of(stiffness, value)

    limit = loop.limit(damped(damping or 0.0))
    softer = _two_digits(0.7 * limit) if 0.0 < limit < math.inf else None
    largest = 0.0 if damping is None else loop.largest_damping(damped(damping))
    for candidate in _round_values(largest):
        if (
            candidate > (damping or 0.0)
            and loop.growth(environment_of(1.2 * stiffness, candidate)) <= 1.0
            and (limit := loop.limit(damped(candidate))) >= 1.2 * stiffness
        ):
            return Suggestion(softer, candidate, limit)
    return Suggestion(softer, None, None)


def _two_digits(value: float) -> float:
    """Rounded down, never up: it is a promise."""
    unit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return float(f"{math.floor(value / unit * (1.0 + 1e-12)) * unit:.2g}")


def _round_values(largest: float) -> list[float]:
    """Four decades of values with one or two digits, up to `largest`."""
    top = math.floor(math.log10(largest)) if largest else 0
    values = [float(f"{digit}e{decade}") for decade in range(top - 4, top + 1) for digit in (1, 1.5, 2, 3, 4, 5, 7)]
    return [value for value in values if value <= largest]
