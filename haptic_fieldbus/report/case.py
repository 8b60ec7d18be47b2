"""What a stability case of the report gives back."""

from dataclasses import dataclass


@dataclass(frozen=True)
class CaseResult:
    """A named stiff or extreme case: what theory expects, what was measured, and by what it was judged."""

    name: str
    expected: str
    measured: str
    passed: bool
    oracle: str
    """What the expectation comes from: a closed form, extended precision, brute force."""
    figure: str | None = None
    """An SVG document, shown below the table."""
    tolerance: str = ""
    """How far measured and expected may be apart; "exact" for not at all."""
