"""Stability case of the report: a function that measures, and its result."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from haptic_fieldbus import SceneError, UsageError
from haptic_fieldbus.numerals import rounded


@dataclass(frozen=True)
class CaseResult:
    """Result of a stiff or extreme case: the expectation of theory, the measurement, and the judgement."""

    expected: str
    measured: str
    passed: bool
    oracle: str
    """Source of the expectation: a closed form, extended precision, or brute force."""
    tolerance: str
    """Permitted difference of measurement and expectation; "exact": no difference is permitted."""
    used: float | None = None
    """Largest deviation over the permitted one (`share_used`); above 1 if the case fails, None without a number."""


Case = Callable[[bool], CaseResult]
"""Function that measures a case; its argument, `quick`, asks for a shorter measurement."""


def share_used(*deviations: tuple[float, float]) -> float:
    """Return the largest of some deviations, each as a share of the permitted deviation; ∞ if one is not a number.

    A deviation is a pair: the value found and the value permitted, in the same unit.
    """
    shares = (float(abs(found) / permitted) for found, permitted in deviations)
    return max(share if share == share else math.inf for share in shares)  # NaN differs from itself


def result_of(
    expected: str,
    measured: str,
    oracle: str,
    *,
    tolerance: str,
    within: Sequence[tuple[float, float]] = (),
    holds: bool = True,
) -> CaseResult:
    """Return the result of a case: it passes when all deviations are permitted, and everything else `holds`.

    The deviations `within` the tolerance are pairs as for `share_used`.
    """
    passed = bool(holds and all(abs(found) <= permitted for found, permitted in within))
    return CaseResult(expected, measured, passed, oracle, tolerance, share_used(*within) if within else None)


def greatest(numbers: Iterable[float]) -> float:
    """Return the largest of numbers; not-a-number if one of them is not a number."""
    return max(numbers, key=lambda each: (each != each, each))  # NaN differs from itself


def relative_error(found: Iterable[float], expected: Iterable[float]) -> float:
    """Return the largest relative difference of numbers from those expected."""
    return greatest(abs(one / other - 1.0) for one, other in zip(found, expected, strict=True))


def largest_error(found: Iterable[float], expected: Iterable[float]) -> float:
    """Return the largest difference of numbers from those expected."""
    return greatest(abs(one - other) for one, other in zip(found, expected, strict=True))


def refused(ask: Callable[[], object]) -> str:
    """Call `ask` and return the message of its SceneError or UsageError; empty if it raises neither."""
    try:
        ask()
    except SceneError as error:
        return " ".join(map(str, error.faults))
    except UsageError as error:
        return str(error)
    return ""


def signed(value: float, digits: int) -> str:
    """Return the number with its sign, a plus included."""
    return f"{'+' if value >= 0.0 else ''}{rounded(value, digits)}"


def values_text(values: Iterable[float], digits: int) -> str:
    """Return numbers in a format specification `form`, separated by commas."""
    return ", ".join(rounded(value, digits) for value in values)
