"""Stability case of the report: a function that measures, and its result."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from haptic_fieldbus.errors import SceneError, UsageError
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
    """Permitted distance of measured and expected; "exact" when there is none."""


Case = Callable[[bool], CaseResult]
"""Function that measures a case; its argument, `quick`, asks for a shorter measurement."""


def refused(ask: Callable[[], object]) -> str:
    """Call `ask` and return the message with which it is refused by SceneError or UsageError; empty when it is not."""
    try:
        ask()
    except SceneError as error:
        return " ".join(map(str, error.faults))
    except UsageError as error:
        return str(error)
    return ""


def signed(value: float, digits: int) -> str:
    """The number with its sign, also where that is a plus."""
    return f"{'+' if value >= 0.0 else ''}{rounded(value, digits)}"


def values_text(values: Iterable[float], digits: int) -> str:
    """Return numbers in a format specification `form`, separated by commas."""
    return ", ".join(rounded(value, digits) for value in values)
