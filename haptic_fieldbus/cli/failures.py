"""Table of errors: the exit status of each, and the word in front of its message."""

import errno
import sys
from dataclasses import dataclass

import typer

from haptic_fieldbus import errors
from haptic_fieldbus.cli.screen import faults_to_json, json_text, plain, show


@dataclass(frozen=True)
class ExitStatus:
    """Exit status, and the key in front of the message; None when the message stands without a key."""

    status: int
    key: str | None


OUTCOMES: dict[type[errors.HapticFieldbusError], ExitStatus] = {
    errors.BusError: ExitStatus(1, "failed"),
    errors.DriveFaultError: ExitStatus(1, "failed"),
    errors.UsageError: ExitStatus(2, None),
    errors.DocumentError: ExitStatus(2, None),
    errors.SafetyTripError: ExitStatus(3, "tripped"),
    errors.PlanError: ExitStatus(4, "refused"),
    errors.VcanError: ExitStatus(125, "failed"),
}
"""Outcome of each class of errors; a subclass without an entry has that of its nearest base."""


def outcome_of(error: type[errors.HapticFieldbusError]) -> ExitStatus:
    """Return the outcome of the error's class or of its nearest base; 1 ("failed") when none is in the table."""
    return next((OUTCOMES[kind] for kind in error.__mro__ if kind in OUTCOMES), ExitStatus(1, "failed"))


DISK_FAILED = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)
"""Causes by which a file that is right cannot be written: a full or broken disk, or a limit of the file size."""


def told_as(error: BaseException) -> type[errors.HapticFieldbusError]:
    """Return the class by which an error is told: a disk that failed is no wrong usage, although its path is named."""
    if not isinstance(error, errors.HapticFieldbusError):
        return errors.UsageError
    cause = error.__cause__
    has_disk_failed = isinstance(cause, OSError) and cause.errno in DISK_FAILED
    return errors.HapticFieldbusError if has_disk_failed and isinstance(error, errors.UsageError) else type(error)


TYPER_ERROR: type[BaseException] = typer.BadParameter.__mro__[2]
"""Base of Typer's errors for a wrong command line: a class of Click, or in later versions a class of Typer."""


def print_object(error: BaseException) -> None:
    """Print a failure as one JSON object in one line: class, exit status, and the faults as `profiles check` does."""
    kind = told_as(error)
    if isinstance(error, errors.DocumentError):
        faults = faults_to_json((error.source, fault) for fault in error.faults)
    else:
        message = "\n".join([getattr(error, "format_message", error.__str__)(), *getattr(error, "__notes__", ())])
        faults = faults_to_json([(None, errors.Fault("", message))])
    print(json_text({"error": kind.__name__, "exit_status": outcome_of(kind).status, "errors": plain(faults)}))


def tell(error: errors.HapticFieldbusError) -> int:
    """Print the error's message and notes to standard error, and return the exit status."""
    outcome = outcome_of(told_as(error))
    # The sentence on a trip begins with the word that is the key.
    message = str(error).removeprefix("Tripped ") if outcome.key == "tripped" else str(error)
    lines = [*message.splitlines(), *getattr(error, "__notes__", ())]
    # Lines after the first go on below it: under the empty key when there is a key column, else without one.
    show([(outcome.key if number == 0 else outcome.key and "", line) for number, line in enumerate(lines)], sys.stderr)
    return outcome.status
