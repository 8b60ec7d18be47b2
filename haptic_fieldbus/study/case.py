"""A stability case of the report: a function of `quick` that measures, and what it gives back."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass


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


def listed(values: Iterable[float], form: str) -> str:
    """Numbers in a sentence."""
    return ", ".join(f"{value:{form}}" for value in values)
