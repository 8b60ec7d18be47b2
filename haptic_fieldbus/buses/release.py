"""The way to zero torque as far as every bus goes it, and the clearing of the fault that a lost master leaves.

A `DriveRelease` is one drive on its way to zero, a `BusRelease` all drives of one bus. Each bus adds by what frames it
frees a drive, and asks it whether its motor is off.

A drive goes to fault when it has lost its master, as when its guard was proved. Nothing else clears a fault, and this
one only by its error code: a fault that came for another reason in the same time stays, and is told.

Reference: IEC 61800-7-201 (CiA 402-2), 6040h bit 7.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from typing import Any, Generic, Protocol, TypeVar

from haptic_fieldbus.buses.bus import DriveFacts, InSteps
from haptic_fieldbus.buses.torque_limits import TorqueLimits
from haptic_fieldbus.clock import Clock
from haptic_fieldbus.drive.profile import PowerState
from haptic_fieldbus.errors import BusConfigurationError, DriveFaultError
from haptic_fieldbus.numerals import exactly
from haptic_fieldbus.planning.plan import Plan

FAULTS = (PowerState.FAULT, PowerState.FAULT_REACTION_ACTIVE)
POLL_NS = 5_000_000
NO_CODE = 0
"""Error code of a drive that has none for its fault, or no object or register for it."""
FAULT_RESET = 0x80
"""Controlword of CiA 402; its bit 7 acts when it rises."""
CLEARED_WITHIN = 0.5
"""Time that a drive has to leave *fault* [s]."""

Undone = TypeVar("Undone", bound=tuple[object, object], covariant=True)
"""An object or a register, and the value that it held before the run."""


class PolledDrive(Protocol):
    """A drive that is asked again and again."""

    label: str

    def now_ns(self) -> int: ...

    def wait(self, duration_ns: int, /) -> None: ...


def reached_within(drive: PolledDrive, timeout: float, reached: Callable[[], bool]) -> bool:
    """Ask a drive until `reached()` is True; False when it is not within `timeout` [s]. Raises what `reached` does."""
    deadline_ns = drive.now_ns() + round(timeout * 1e9)
    while not reached():
        if drive.now_ns() >= deadline_ns:
            return False
        drive.wait(POLL_NS)
    return True


def poll(drive: PolledDrive, timeout: float, reached: Callable[[], bool], complaint: Callable[[], str]) -> None:
    """Ask a drive until `reached()` is True; raises BusConfigurationError with the complaint after `timeout` [s]."""
    if not reached_within(drive, timeout, reached):
        raise BusConfigurationError(f"{drive.label} {complaint()} (waited {exactly(timeout)} s)")


def standing_fault(label: str, state: PowerState, code: int | None, place: object, way: str) -> DriveFaultError:
    """Return the error for a drive in *fault*, with its error code from a `place` and a `way` to reset it."""
    cause = "" if code is None else f", error code {code:04X}h ({place})"
    return DriveFaultError(
        f"{label} is in the state {state.value}{cause}. Remove the cause, then reset the fault: switch the drive off "
        f"and on, or {way}"
    )


def other_fault(label: str, code: str) -> DriveFaultError:
    """Return the error for a drive whose fault does not come from the loss of its master."""
    return DriveFaultError(
        f"{label} went to fault during the watchdog test, but not because it lost its master: error code {code}. "
        "Nothing was cleared"
    )


def check_cleared(drive: PolledDrive, cleared: Callable[[], bool], how: str = "") -> None:
    """Wait until a drive has left *fault*; raises DriveFaultError when it stays in it."""
    if not reached_within(drive, CLEARED_WITHIN, cleared):
        raise DriveFaultError(
            f"{drive.label} is still in fault {exactly(CLEARED_WITHIN)} s after its lost-master fault was reset{how}: "
            "switch it off and on, and check its link"
        )


class ConfiguredDrive(Protocol[Undone]):
    """The configuration of a drive, as far as a release has to undo it."""

    @property
    def torque_limits(self) -> TorqueLimits[Any]: ...

    def final_writes(self) -> Sequence[Undone]:
        """Return what is written to a drive that is free: it switches the guard off and restores the former limits."""


class DriveRelease(Generic[Undone]):
    """One drive on its way to zero torque."""

    def __init__(self, label: str, setup: ConfiguredDrive[Undone]) -> None:
        self.label, self.setup = label, setup
        self.free = False
        """True when the drive has said that its motor is off."""
        self.refused: list[str] = []
        """Objects or registers that the drive kept as they were."""
        self._undoing: list[Undone] = []

    def begin(self) -> None:
        """Forget an earlier release."""
        self.free, self.refused, self._undoing = False, [], list(self.setup.final_writes())

    @property
    def settled(self) -> bool:
        """True when the motor is off, and all was put back or refused to be."""
        return self.free and not self._undoing

    @property
    def kept(self) -> list[str]:
        """Objects or registers that still have the values of the run."""
        return [*self.refused, *(str(each[0]) for each in self._undoing)]


P = TypeVar("P", bound=DriveRelease[Any])


class BusRelease(ABC, Generic[P]):
    """The release of all drives of one bus; no method raises anything but KeyboardInterrupt and its like."""

    hint = ""
    """End of the sentence about a drive that keeps what the run had written."""

    def __init__(self, clock: Clock, drives: Sequence[P]) -> None:
        self.warnings: list[str] = []
        self._clock, self._drives = clock, tuple(drives)
        self._end_ns = 0
        self._begun = False

    @property
    def _settled(self) -> bool:
        return all(drive.settled for drive in self._drives)

    def look(self) -> bool:
        """Go on for one slice of time; True when all drives are settled, the time is over, or nothing was begun."""
        if not self._begun:
            return True
        self._go_on()
        return self._settled or self._clock.now_ns() >= self._end_ns

    @abstractmethod
    def _go_on(self) -> None:
        """Ask and listen for one slice of time."""

    def leave(self) -> bool:
        """End the release; True when every drive said that its motor is off, or nothing was begun.

        Warns of each drive that did not, and of each that keeps values of the run.
        """
        if not self._begun:
            return True
        self._begun = False
        for drive in self._drives:
            if not drive.free:
                self._warn(f"{drive.label} did not confirm that its motor is off")
            elif drive.kept:
                self._warn(f"{drive.label} keeps {', '.join(drive.kept)}, which could not be put back{self.hint}")
            else:
                drive.setup.torque_limits.restored()
        return all(drive.free for drive in self._drives)

    def _warn(self, sentence: str) -> None:
        if sentence not in self.warnings:
            self.warnings.append(sentence)


R = TypeVar("R", bound=BusRelease[Any])


class ReleasedBus(InSteps, ABC, Generic[R]):
    """A bus whose drives a `BusRelease` frees, which `inspect` prepares."""

    def __init__(self) -> None:
        self.facts: dict[str, DriveFacts] = {}
        self.warnings: list[str] = []
        self._plan: Plan | None = None
        """Plan by which the drives were configured; None while `stop` has nothing to undo."""
        self._release: R | None = None

    def settle(self) -> bool:
        """Free the drives for one more slice of time; True when they are, or the time is over. Raises nothing."""
        return self._release is None or self._release.look()

    def leave(self) -> bool:
        """End the way to zero; True when every drive confirmed that its motor is off, or nothing had been written.

        Raises nothing.
        """
        if self._plan is None or self._release is None:
            return True
        confirmed = self._release.leave()
        told = [*self._release.warnings, *self._observed()]
        self.warnings += [sentence for sentence in told if sentence not in self.warnings]
        self._plan = None
        return confirmed

    @abstractmethod
    def _observed(self) -> Iterator[str]:
        """Yield a sentence for each fault of the link that stopped nothing."""
