"""A stability case of the report: a function of `quick` that measures, and what it gives back."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from haptic_fieldbus.errors import SceneError, UsageError
from haptic_fieldbus.numerals import rounded


@dataclass(frozen=True)
class CaseResult:
    """What theory expects of a stiff or extreme case, what was measured, and by what it was judged."""

    expected: str
    measured: str
    passed: bool
    oracle: str
    """What the expectation comes from: a closed form, extended precision, brute force."""
    tolerance: str
    """How far measured and expected may be apart; "exact" for not at all."""


Case = Callable[[bool], CaseResult]


def refused(ask: Callable[[], object]) -> str:
    """The sentence with which something is refused; empty where it was not."""
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
    return ", ".join(rounded(value, digits) for value in values)
