"""Torque limits that are stored in the drive: raised or lowered to the limit of the axis, and put back at the end.

Some drives are delivered with a limit of 0 or 10 % of rated torque (Nanotec C5-E, PD4-C), with which everything would
seem to work, but no force could be felt. Such a limit is raised only when the rig says so. A higher one is lowered, so
that the drive itself holds the limit of the axis whatever the loop asks for.

The values of before are put back when a run ends in order. A run that was killed leaves its own behind. So that the
next one can tell them from the drive's, each change is noted in a file of the user until it is undone. Of a drive
without a serial number nothing is noted, because the note could change the limit of another one. A note that is not as
a run has written it is told, and nothing is restored from it.

A limit that a drive counts below zero bounds the torque downwards; it keeps its sign.
"""

import json
import math
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Generic, Protocol, TypeVar

from haptic_fieldbus.documents.edits import remove_file, write_file
from haptic_fieldbus.documents.safe_read import read_octets
from haptic_fieldbus.drive.profile import DataType, Identity, digest_of
from haptic_fieldbus.drive.rig import RATED_TORQUE_UNITS
from haptic_fieldbus.errors import BusConfigurationError
from haptic_fieldbus.numerals import exactly, in_unit, percent
from haptic_fieldbus.planning.axis_plan import AxisPlan

# Comparison of a drive's rated values with those of the rig: every command is scaled by them.

RATED_TOLERANCE = 0.02
"""Of a rated value in the rig; what a drive holds may differ by its rounding."""


def rated_torque(title: str, name: str, unit: str, held: int) -> float:
    """Return the rated torque [N·m] that the object or register `name` holds in `unit`.

    Raises BusConfigurationError for an unknown unit.
    """
    if unit not in RATED_TORQUE_UNITS:
        wrong = f"unit {unit!r} of {name} is not one of {', '.join(RATED_TORQUE_UNITS)}"
        raise BusConfigurationError(f"{title}: {wrong}")
    return held * RATED_TORQUE_UNITS[unit]


def check_rating(
    label: str, axis: AxisPlan, name: str, what: str, rated: float, expected: float | None, unit: str
) -> None:
    """Raise BusConfigurationError when the rated torque or current of a drive is not that of the rig."""
    if expected is not None and abs(rated - expected) > RATED_TOLERANCE * expected:
        in_thousandths = abs(1e3 * rated - expected) <= RATED_TOLERANCE * expected
        hint = f". Is the value in the rig in m{unit}?" if in_thousandths else ""
        raise BusConfigurationError(
            f"{label}: its rated {what} is {exactly(rated)} {unit} ({name}), the rig has {exactly(expected)} {unit} "
            f"(axis.{axis.name}.rated_{what}); every set-point would be scaled wrong{hint}"
        )


class DriveValue(Protocol):
    """A value of a drive, an object or a register; its text is its name."""

    @property
    def type(self) -> DataType: ...

    @property
    def unit(self) -> str: ...


Entry = TypeVar("Entry", bound=DriveValue)
ServerRequest = TypeVar("ServerRequest", contravariant=True)


class LimitedDrive(Protocol[ServerRequest]):
    """The drive behind the limits; its methods raise BusError."""

    label: str

    def read(self, entry: ServerRequest, /) -> int: ...

    def write(self, entry: ServerRequest, value: int, /) -> None:
        """Write and read back; raises BusConfigurationError when the drive refuses."""


def checked_rated_torque(drive: LimitedDrive[Entry], title: str, axis: AxisPlan, entry: Entry | None) -> float | None:
    """Return the drive's rated torque [N·m], which scales every command; None when its profile names no entry for it.

    Raises BusError, BusConfigurationError when it is not that of the rig.
    """
    if entry is None:
        return None
    rated = rated_torque(title, str(entry), entry.unit, drive.read(entry))
    check_rating(drive.label, axis, str(entry), "torque", rated, axis.rig.rated_torque, "N·m")
    return rated


@dataclass
class TorqueLimits(Generic[Entry]):
    """The torque limits of one drive in its own steps: the former ones and those that the axis needs."""

    node: LimitedDrive[Entry]
    axis: AxisPlan
    warn: Callable[[str], None]
    noted: bool
    """Whether changes are noted in a file; those to simulated drives are not, since nobody finds such a drive again."""
    entries: tuple[Entry, ...]
    """All limits that a drive may have."""
    step: float
    """Effort at the handle of one step [N or N·m]."""
    place: str
    """Bus and number of the drive."""
    notes: "RestoreFile | None" = None
    before: dict[Entry, int] = field(default_factory=dict)
    """The value of each limit that is to be changed, before any run of ours changed it."""
    left: dict[Entry, int] = field(default_factory=dict)
    """Values that a killed run left in these limits, if they are still there."""
    sentences: list[str] = field(default_factory=list)
    """Sentences for people about each change."""

    @property
    def wanted(self) -> int:
        """The limit of the axis [steps]."""
        # The small addend keeps a ratio that is a whole number from being rounded down by its last digit.
        return math.floor(self.axis.limits.effort / self.step + 1e-6)

    def inspect(self, drive: Identity, read: Callable[[Entry], int | None]) -> None:
        """Compare the limits with that of the axis and write nothing.

        `read` returns None for an entry that is not there.

        Raises BusConfigurationError when the drive allows less than the axis may ask for, and the rig does not say
        that this is to be changed, or when an entry cannot hold the limit of the axis.
        """
        name = drive.file_name(self.place)
        self.notes = RestoreFile(name) if self.noted and name is not None else None
        noted = self._read_notes()
        for entry in self.entries:
            held = read(entry)
            if held is None:
                continue
            ours, original = noted.get(str(entry), ([], held))
            if held in ours:
                self.left[entry] = held
            else:
                original = held
            if held == original == self._value(original):
                continue
            if abs(original) < self.wanted and not self.axis.rig.raise_max_torque:
                raise self._too_low(entry, original)
            if self.wanted > entry.type.limits[1]:
                raise BusConfigurationError(
                    f"{self.node.label}: {entry} cannot exceed {entry.type.limits[1]}, but the limit of the axis is "
                    f"{self.wanted} steps. Check the torque scaling in the rig"
                )
            self.before[entry] = original
            self.sentences.append(self._words(entry, original))
        if self.before and self.noted and self.notes is None:
            told = "has no serial number: if a run is killed, its torque limit stays in the drive"
            self.warn(f"{self.node.label} {told}")

    def _value(self, original: int) -> int:
        """Return the limit of the axis with the sign of the drive's own limit [steps]."""
        return -self.wanted if original < 0 else self.wanted

    def _read_notes(self) -> "Changes":
        """Return the notes of the drive; if somebody changed the file, warn and return nothing."""
        if self.notes is None:
            return {}
        try:
            noted = self.notes.read()
            for entry in self.entries:
                ours, original = noted.get(str(entry), ([], 0))
                low, high = entry.type.limits
                if any(not low <= value <= high for value in (*ours, original)):
                    raise ValueError(f"{entry} holds no such value")
        except (OSError, ValueError, TypeError) as error:
            self.warn(
                f"{self.notes.path} is not used ({getattr(error, 'strerror', None) or error}): if a run was killed, "
                f"its torque limit in {self.node.label} is not restored. Check the limit with the drive's tool"
            )
            return {}
        return noted

    def configure(self) -> None:
        """Write the limits and read them back; warn where the drive does not let one be lowered.

        Raises BusError, BusConfigurationError when a limit cannot be raised.
        """
        if self.before and self.notes is not None:
            # Former and new values go to the file first: the run may be killed before it writes to the drive.
            ours = {each: self._value(was) for each, was in self.before.items()}
            noted = {
                str(each): ([ours[each], self.left.get(each, ours[each])], was) for each, was in self.before.items()
            }
            try:
                self.notes.write(noted)
            except OSError as error:
                self.warn(
                    f"{self.notes.path} cannot be written ({error.strerror}): if a run is killed, its torque limit "
                    "stays in the drive"
                )
        for entry, original in list(self.before.items()):
            try:
                self.node.write(entry, self._value(original))
            except BusConfigurationError as error:
                if abs(original) < self.wanted:
                    raise
                if self.node.read(entry) == original:
                    del self.before[entry]
                self.warn(f"{error}: the drive keeps its own limit; only the loop applies the limit of the axis")

    def restored(self) -> None:
        """Forget the changes, since the drive has confirmed that they are undone, or holds values of its own."""
        if self.notes is None:
            return
        try:
            remove_file(self.notes.path)
        except OSError as error:
            self.warn(
                f"{self.notes.path} cannot be removed ({error.strerror}), but its changes are already undone: remove it"
            )

    def _words(self, entry: Entry, original: int) -> str:
        """Return the sentence about a change."""
        change = "lowered" if abs(original) >= self.wanted else "raised, as the rig permits,"
        between = f"from {self._percent(original)} to {self._percent(self._value(original))}"
        words = f"{entry} is {change} {between} of rated torque until the end"
        left = self.left.get(entry)
        return words if left is None else f"{words}; a run that did not end properly left it at {self._percent(left)}"

    def _too_low(self, entry: Entry, held: int) -> BusConfigurationError:
        unit, limit = self.axis.workspace.effort_unit, self.axis.limits.effort
        left = self.left.get(entry)
        told = "" if left is None else f", after a run that did not end properly left it at {self._permille(left)}"
        return BusConfigurationError(
            f"{self.node.label}: {entry} is {self._permille(held)} of rated torque "
            f"({in_unit(held * self.step, unit)}){told}, but the axis may use {self._permille(self._value(held))} "
            f"({in_unit(limit, unit)}): the drive would reduce the force without a message. Write "
            f"axis.{self.axis.name}.raise_max_torque = true into the rig to raise it for each run, or set "
            f"axis.{self.axis.name}.limits.effort"
        )

    def _percent(self, steps: int) -> str:
        return percent(steps * self.step / self.axis.rated_effort)

    def _permille(self, steps: int) -> str:
        return f"{exactly(1e3 * (steps * self.step / self.axis.rated_effort))} ‰"


Changes = Mapping[str, tuple[list[int], int]]
"""Name of an entry → (values that runs have set, the drive's own value)."""
_LARGEST = 10_000
"""Octets of a note."""


class RestoreFile:
    """The file that says what was changed in one drive: for each entry the values that we set, and the drive's own."""

    def __init__(self, drive: str) -> None:
        """`drive` is unique to a drive, and a file name."""
        state = os.environ.get("XDG_STATE_HOME") or os.path.expanduser("~/.local/state")
        self.path = Path(state) / "haptic-fieldbus" / "torque-limits" / f"{drive}.json"

    def read(self) -> "Changes":
        """Return the changes that were not undone; nothing when there is no file.

        Raises OSError for a file that cannot be read, ValueError for one that is not as `write` has written it.
        """
        try:
            held = json.loads(read_octets(self.path, _LARGEST))
        except (FileNotFoundError, NotADirectoryError):
            return {}
        except (ValueError, RecursionError):
            held = None
        changes, digest = (held.get("changes"), held.get("digest")) if isinstance(held, dict) else (None, None)
        if not isinstance(changes, dict) or digest != self._digest(changes):
            raise ValueError("it is damaged, was edited, or is from an earlier version")
        return {entry: (ours, original) for entry, (ours, original) in changes.items()}

    def write(self, changes: "Changes") -> None:
        """Write the changes, before they are made; raises OSError, and an earlier note is then as it was."""
        self.path.parent.mkdir(parents=True, exist_ok=True)
        write_file(self.path, json.dumps({"changes": changes, "digest": self._digest(changes)}).encode())

    def _digest(self, changes: Mapping[str, object]) -> str:
        """Return a digest of the changes and the identity of their drive."""
        return digest_of((self.path.name, json.dumps(changes)))
