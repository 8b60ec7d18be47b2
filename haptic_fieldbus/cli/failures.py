"""How each error ends the program: exit status, and the word in front of its sentence."""

import sys
from dataclasses import dataclass

from haptic_fieldbus.cli.screen import show
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
class ExitStatus:
    """An exit status, and the key of the line that says why; None where the sentence stands alone."""

    status: int
    key: str | None


OUTCOMES: dict[type[HapticFieldbusError], ExitStatus] = {
    BusError: ExitStatus(1, "failed"),
    DriveFaultError: ExitStatus(1, "failed"),
    UsageError: ExitStatus(2, None),
    DocumentError: ExitStatus(2, None),
    SafetyTripError: ExitStatus(3, "tripped"),
    PlanError: ExitStatus(4, "refused"),
}


def outcome_of(error: type[HapticFieldbusError]) -> ExitStatus:
    """That of the error's class or of its nearest base."""
    return next((OUTCOMES[kind] for kind in error.__mro__ if kind in OUTCOMES), ExitStatus(1, "failed"))


def tell(error: HapticFieldbusError) -> int:
    """Say on standard error what went wrong; returns the exit status."""
    outcome = outcome_of(type(error))
    lines = [*str(error).splitlines(), *getattr(error, "__notes__", ())]
    show([(outcome.key if number == 0 else outcome.key and "", line) for number, line in enumerate(lines)], sys.stderr)
    return outcome.status
