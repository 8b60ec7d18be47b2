"""How each error ends the program: exit status, and the word in front of its sentence."""

import sys
from dataclasses import dataclass

from haptic_fieldbus.errors import (
    BusError,
    DocumentError,
    DriveFaultError,
    HapticFieldbusError,
    PlanError,
    SafetyTripError,
    UsageError,
)


@dataclass(frozen=True)
class Outcome:
    """An exit status, and the key of the line that says why; None where the sentence stands alone."""

    status: int
    key: str | None


OUTCOMES: dict[type[HapticFieldbusError], Outcome] = {
    BusError: Outcome(1, "failed"),
    DriveFaultError: Outcome(1, "failed"),
    UsageError: Outcome(2, None),
    DocumentError: Outcome(2, None),
    SafetyTripError: Outcome(3, "tripped"),
    PlanError: Outcome(4, "refused"),
}


def outcome_of(error: type[HapticFieldbusError]) -> Outcome:
    """That of the error's class or of its nearest base."""
    return next((OUTCOMES[kind] for kind in error.__mro__ if kind in OUTCOMES), Outcome(1, "failed"))


def tell(error: HapticFieldbusError) -> int:
    """Say on standard error what went wrong; returns the exit status."""
    from haptic_fieldbus.cli.screen import show

    outcome = outcome_of(type(error))
    lines = [*str(error).splitlines(), *getattr(error, "__notes__", ())]
    show([(outcome.key if number == 0 else outcome.key and "", line) for number, line in enumerate(lines)], sys.stderr)
    return outcome.status
