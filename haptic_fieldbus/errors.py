"""Everything this package raises.

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
│   └── UnstableSceneError
├── BusError                     the bus or a device on it
│   ├── BusTimeoutError (TimeoutError)
│   └── BusConfigurationError
├── DriveFaultError              emergency, fault state, restart: the drive says no
├── SafetyTripError              a limit of ours; the drive is already torque-free
└── UsageError (ValueError)      a wrong name or value in a call or on the command line
"""

from dataclasses import dataclass
from pathlib import Path


class HapticFieldbusError(Exception):
    """Base of all errors of this package."""

    result: object = None
    """What was known of the run by then, a `Result`; None outside of runs."""


@dataclass(frozen=True)
class Fault:
    """One fault of a file: where it is, what stands there, what was expected."""

    key: str
    message: str
    line: int | None = None

    def __str__(self) -> str:
        where = f"line {self.line}: " if self.line is not None else ""
        return f"{where}{self.key}: {self.message}" if self.key else f"{where}{self.message}"


class DocumentError(HapticFieldbusError, ValueError):
    """A profile, rig or scene file that cannot be used; `faults` lists all that is wrong."""

    def __init__(self, source: Path | str, faults: list[Fault]) -> None:
        self.source = str(source)
        self.faults = tuple(faults)
        super().__init__("\n".join(f"{self.source}: {fault}" for fault in faults))


class ProfileError(DocumentError):
    """A drive profile."""


class SceneError(DocumentError):
    """A scene file or a scene parameter."""


class RigError(DocumentError):
    """A rig file."""


class FaultFileError(DocumentError):
    """A file of faults to be simulated."""


class EdsError(DocumentError):
    """An electronic data sheet of a device that holds nothing usable."""


class UsageError(HapticFieldbusError, ValueError):
    """A name or value given by the caller; the sentence says what was expected."""


class PlanError(HapticFieldbusError):
    """The scene cannot be rendered on this rig; refused before anything moves."""


class SignalUnavailableError(PlanError):
    """An element needs a signal that the drive neither offers nor allows to derive."""


class ImageTooLargeError(PlanError):
    """The process image does not fit into the drive's PDOs or registers."""


class BusOverloadError(PlanError):
    """The bus cannot carry the plan at the asked rate."""


class UnstableSceneError(PlanError):
    """The sampled loop is unstable; `limit` is the stiffness at which it would stop being stable."""

    def __init__(self, message: str, *, limit: float | None = None) -> None:
        self.limit = limit
        super().__init__(message)


class BusError(HapticFieldbusError):
    """The bus or a device on it failed."""


class BusTimeoutError(BusError, TimeoutError):
    """Nothing came in time."""


class BusConfigurationError(BusError):
    """A device refused its configuration, or read back something else than was written."""


class DriveFaultError(HapticFieldbusError):
    """The drive left *operation enabled* by itself, or reports an emergency."""


class SafetyTripError(HapticFieldbusError):
    """A limit of ours was passed; torque was set to zero before this was raised."""
