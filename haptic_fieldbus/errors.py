"""All errors that this package raises.

HapticFieldbusError
├── DocumentError (ValueError)   a file: all its faults at once, each with key and line
│   ├── ProfileError
│   ├── SceneError
│   ├── RigError
│   ├── FaultFileError
│   └── EdsError
├── PlanError                    refused before anything moves
│   ├── SignalUnavailableError
│   ├── ImageTooLargeError
│   ├── BusOverloadError
│   ├── UnstableSceneError
│   ├── ForeignMasterError
│   └── UnprovedGuardError
├── BusError                     the bus or a device on it
│   ├── BusTimeoutError (TimeoutError)
│   └── BusConfigurationError
├── DriveFaultError              the drive itself: emergency, fault state, restart
├── SafetyTripError              a limit of this package; the drive is already torque-free
├── VcanError                    no virtual CAN for a command, or no such command
└── UsageError (ValueError)      a wrong name or value in a call or on the command line
"""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path


class HapticFieldbusError(Exception):
    """Base of all errors of this package."""

    result: object = None
    """The `Result` as far as the run got; None outside of runs."""


@dataclass(frozen=True)
class Fault:
    """One error in a file: its key, a message with the value found and the value expected, and its line."""

    key: str
    message: str
    line: int | None = None

    def __str__(self) -> str:
        where = f"line {self.line}: " if self.line is not None else ""
        return f"{where}{self.key}: {self.message}" if self.key else f"{where}{self.message}"


class DocumentError(HapticFieldbusError, ValueError):
    """A file that cannot be used; `faults` lists all its faults."""

    def __init__(self, source: Path | str, faults: list[Fault]) -> None:
        self.source = str(source)
        self.faults = tuple(faults)
        super().__init__("\n".join(f"{self.source}: {fault}" for fault in faults))


class ProfileError(DocumentError):
    """A drive profile that cannot be used."""


class SceneError(DocumentError):
    """A scene file or a parameter of a scene that cannot be used."""


class RigError(DocumentError):
    """A rig file that cannot be used."""


class FaultFileError(DocumentError):
    """A file of simulated faults that cannot be used."""


class EdsError(DocumentError):
    """An electronic data sheet (EDS, DCF) without usable content."""


class VcanError(HapticFieldbusError):
    """A command could not be run beside virtual CAN; `status` is the exit status."""

    def __init__(self, message: str, status: int = 125) -> None:
        self.status = status
        super().__init__(message)


class UsageError(HapticFieldbusError, ValueError):
    """A wrong name or value in a call; the message names what was expected."""


class PlanError(HapticFieldbusError):
    """A scene that cannot be rendered on its rig; refused before anything moves."""


class SignalUnavailableError(PlanError):
    """An element needs a signal that the drive neither offers nor allows to derive."""


class ImageTooLargeError(PlanError):
    """A process image that does not fit into the PDOs or registers of the drive."""


class BusOverloadError(PlanError):
    """A plan that the bus cannot carry at the requested rate."""


class UnstableSceneError(PlanError):
    """A scene above its limit; `limit` is the stiffness up to which it is stable for all uncertain values [N/m or
    N·m/rad], None for a scene without one."""

    def __init__(self, message: str, *, limit: float | None = None) -> None:
        self.limit = limit
        super().__init__(message)


class ForeignMasterError(PlanError):
    """Another master commands on the bus, so that nothing was enabled."""


class UnprovedGuardError(PlanError):
    """A drive whose watchdog did not fire in time in the test at zero torque; no torque was applied."""


class BusError(HapticFieldbusError):
    """A failure of the bus or of a device on it."""


class BusTimeoutError(BusError, TimeoutError):
    """An answer or a frame did not arrive in time."""


class BusConfigurationError(BusError):
    """A device refused its configuration, or returned another value than was written."""


class DriveFaultError(HapticFieldbusError):
    """A drive left *operation enabled* by itself, or reported an emergency."""


class SafetyTripError(HapticFieldbusError):
    """A safety limit was exceeded; torque was set to zero before this error was raised."""


def raise_all(faults: Iterable[str]) -> None:
    """Raise one UsageError with all these faults; nothing happens without any."""
    if told := "\n".join(faults):
        raise UsageError(told)


def require(module: str, extra: str) -> None:
    """Raise UsageError, which names the extra, when an optional package is not installed."""
    from importlib.util import find_spec

    if find_spec(module) is None:
        raise UsageError(f"this needs {module}; in a checkout, run: pip install -e '.[{extra}]'")


def wrong_kind(name: str, expected: str, given: object) -> TypeError:
    """Return the error for an argument of the wrong kind: its name, what was expected, and what was given."""
    try:
        shown = repr(given)
    except Exception:  # of an object of somebody else
        shown = ""
    shown = f"{shown[:60]}… " if len(shown) > 60 else f"{shown} " if shown else ""
    return TypeError(f"{name}: expected {expected}, not {shown}({type(given).__name__})")
