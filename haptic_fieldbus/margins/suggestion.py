"""Suggestion of stable values for an unstable scene."""

import math
from collections.abc import Callable
from dataclasses import dataclass

from haptic_fieldbus.margins.closed_loop import ClosedLoop
from haptic_fieldbus.margins.linear import EnvironmentOf
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
    cautious: float | None = None,
) -> Suggestion:
    """Return round values that make an unstable scene stable; `damping` is None when the scene has none to vary.

    `environment_of` takes (stiffness, damping). The suggested stiffness is the `cautious` limit; where it is None,
    0.7 of the limit with the present damping. The suggested damping is the smallest with a limit of at least 1.2 times
    the present stiffness.
    """

    def damped(value: float) -> EnvironmentOf:
        return lambda stiffness: environment_of(stiffness, value)

    if cautious is None:
        cautious = 0.7 * loop.limit(damped(damping or 0.0))
    softer = _two_digits(cautious) if 0.0 < cautious < math.inf else None
    largest = 0.0 if damping is None else loop.largest_damping(damped(damping))
    for candidate in _round_values(largest):
        if (
            candidate > (damping or 0.0)
            # One growth is much quicker to compute than a limit, and rules out most candidates.
            and loop.growth(environment_of(1.2 * stiffness, candidate)) <= 1.0
            and (limit := loop.limit(damped(candidate))) >= 1.2 * stiffness
        ):
            return Suggestion(softer, candidate, limit)
    return Suggestion(softer, None, None)


def _two_digits(value: float) -> float:
    """Return a value with two digits, rounded down: a suggested stiffness must not exceed its limit."""
    # The factor just above 1 keeps rounding from lowering a value that already has two digits.
    unit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return float(f"{math.floor(value / unit * (1.0 + 1e-12)) * unit:.2g}")


def _round_values(largest: float) -> list[float]:
    """Return values with one or two digits over four decades, up to `largest`, in rising order."""
    top = math.floor(math.log10(largest)) if largest else 0
    values = [float(f"{digit}e{decade}") for decade in range(top - 4, top + 1) for digit in (1, 1.5, 2, 3, 4, 5, 7)]
    return [value for value in values if value <= largest]
