"""Suggestion of stable values for an unstable scene."""

import math
from collections.abc import Callable
from dataclasses import dataclass

from haptic_fieldbus.margins.closed_loop import ClosedLoop
from haptic_fieldbus.margins.linear import EnvironmentOf
from haptic_fieldbus.numerals import rounded_down
from haptic_fieldbus.numerics.linear import StateSpace


@dataclass(frozen=True)
class Suggestion:
    """Values that would be stable; None for a value that does not exist or makes no sense."""

    stiffness: float | None
    """Stable stiffness [N/m or N·m/rad], with the damping kept."""
    damping: float | None
    """Stabilising damping [N·s/m or N·m·s/rad], with the stiffness kept."""
    damping_limit: float | None
    """Limit of stability [N/m or N·m/rad] with that damping."""


def suggest(
    loop: ClosedLoop,
    environment_of: Callable[[float, float], StateSpace],
    stiffness: float,
    damping: float | None,
    cautious: Callable[[float], float] | None = None,
) -> Suggestion:
    """Return round values that make an unstable scene stable; `damping` is None when the scene has none to vary.

    `environment_of` takes (stiffness, damping). `cautious` returns the cautious limit for a damping; the suggested
    stiffness is this limit with the present damping, and the suggested damping the smallest at which it is at least the
    present stiffness. Where it is None, the stiffness is 0.7 of the limit, and the damping has a limit of at least 1.2
    times the present stiffness.
    """

    def damped(value: float) -> EnvironmentOf:
        return lambda stiffness: environment_of(stiffness, value)

    def limit_of(value: float) -> float:
        return cautious(value) if cautious is not None else loop.limit(damped(value))

    kept, asked = (0.7, 1.2 * stiffness) if cautious is None else (1.0, stiffness)
    least = kept * limit_of(damping or 0.0)
    softer = rounded_down(least) if 0.0 < least < math.inf else None
    largest = 0.0 if damping is None else loop.largest_damping(damped(damping))
    for candidate in _round_values(largest):
        if (
            candidate > (damping or 0.0)
            # One growth is much quicker to compute than a limit, and rules out most candidates.
            and loop.growth(environment_of(asked, candidate)) <= 1.0
            and (limit := limit_of(candidate)) >= asked
        ):
            return Suggestion(softer, candidate, limit)
    return Suggestion(softer, None, None)


def _round_values(largest: float) -> list[float]:
    """Return values with one or two digits over four decades, up to `largest`, in rising order."""
    top = math.floor(math.log10(largest)) if largest else 0
    values = [float(f"{digit}e{decade}") for decade in range(top - 4, top + 1) for digit in (1, 1.5, 2, 3, 4, 5, 7)]
    return [value for value in values if value <= largest]
