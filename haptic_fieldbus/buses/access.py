"""Opening the buses of one protocol, and the questions to a drive that come before a plan."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext, suppress
from pathlib import Path
from typing import Any, Protocol, TypeVar

from haptic_fieldbus.buses.bus import StepwiseBus
from haptic_fieldbus.buses.release import FAULTS
from haptic_fieldbus.buses.scan_result import Check, DriveReading, Scan
from haptic_fieldbus.clock import Clock
from haptic_fieldbus.drive.profile import DriveProfile, PowerTable
from haptic_fieldbus.drive.rig import BusSection, RigAxis
from haptic_fieldbus.errors import BusConfigurationError, BusError, BusTimeoutError, DocumentError, UsageError
from haptic_fieldbus.protocols.catalogue import known_names, load_profile
from haptic_fieldbus.signals import Signal

SHOWN = (Signal.STATUSWORD, Signal.POSITION, Signal.VELOCITY, Signal.TORQUE_ACTUAL)
"""Signals that a look at a drive reads, where the drive offers them."""
ANSWER_TIMEOUT = 0.1
"""Time for which a look waits for an answer [s]: a drive that is gone must not hold up the look at another."""

Axes = Mapping[str, RigAxis]
"""Axes of a rig by name."""
Logs = AbstractContextManager[Mapping[str, Any]]
"""Traffic logs by the name of their bus, open for as long as the block lasts."""
Entry = TypeVar("Entry")
"""An object or a register."""
Profile = TypeVar("Profile", bound=DriveProfile)


class Observer(Protocol):
    """Reads from drives and writes nothing. While another master commands them, it only listens."""

    listened: str
    """Sentence about what was heard before anything was sent."""
    masters: str
    """Sentence about another master. While there is one, the drives are not asked. Empty without one."""

    def look(self) -> Mapping[str, DriveReading]:
        """Return what each drive says now, by the name of its axis; raises BusError only when the bus is dead."""


class BusAccess(Protocol):
    """The half of a protocol that does I/O.

    Each protocol has its own type of traffic log. Callers only pass a log from `logs` to `open_bus`.
    """

    def logs(self, record: Path | None, buses: Sequence[str], *, simulated: bool) -> Logs:
        """Open a traffic log for each named bus; an empty mapping when `record` is not a file of traffic.

        Unless the buses are `simulated`, the log must not make the loop wait.
        """
        return nullcontext({})

    def open_bus(self, section: BusSection, clock: Clock, log: Any) -> StepwiseBus:
        """Open a real bus; raises UsageError for impossible settings, BusError when it cannot be opened."""

    def rated_torque(self, section: BusSection, name: str, axis: RigAxis) -> float | None:
        """Read the rated torque from the drive [N·m]; None when its profile names no object for it.

        Raises UsageError or BusError, as `open_bus` does, and BusError when the drive does not answer.
        """
        return None

    def fitted(self, section: BusSection, axes: Axes) -> Mapping[str, DriveProfile]:
        """Return, by axis, each general profile fitted to its drive; axes with another profile are left out.

        Nothing is written. Raises UsageError or BusError, as `rated_torque` does.
        """
        return {}

    def scan(self, section: BusSection, axes: Axes, profiles: str | Path | None, nodes: Sequence[int] = ()) -> Scan:
        """Find the devices of a bus by reading alone; `axes` are those that a simulated bus has.

        `profiles` is a folder of own profiles, `nodes` are the numbers that are asked; none given: those that a
        protocol asks without being told. Raises UsageError or BusError.
        """
        raise UsageError(f"{section.protocol} buses cannot be scanned")

    def onlooker(self, section: BusSection, axes: Axes) -> AbstractContextManager[Observer]:
        """Open a bus to look at the drives of these axes; raises UsageError or BusError."""
        raise UsageError(f"drives on {section.protocol} buses cannot be watched")

    def checks(self, section: BusSection, axes: Axes, rate: float) -> tuple[Check, ...]:
        """Check adapter and bus for a loop of this rate [Hz], with the help of the drives of these axes.

        A fault of the bus is a check that fails. Raises UsageError.
        """
        return ()


class OpenBus(Protocol):
    """A bus that is open, with the name that users give it."""

    name: str


Opened = TypeVar("Opened", bound=OpenBus)


def checks_on(
    bus: AbstractContextManager[Opened], adapter: Iterable[Check], further: Callable[[Opened], tuple[Check, ...]]
) -> tuple[Check, ...]:
    """Return the checks of an adapter, and the `further` ones of its bus where it can be opened."""
    told = tuple(adapter)
    try:
        with bus as opened:
            return Check("adapter", True, f"{opened.name} is open"), *told, *further(opened)
    except BusError as error:
        return Check("adapter", False, str(error), "see the other checks of the adapter"), *told


def profiles_of(kind: type[Profile], profiles: str | Path | None) -> list[Profile]:
    """Return all profiles of one protocol that can be read."""
    found: list[DriveProfile] = []
    for name in known_names(profiles):
        with suppress(DocumentError, UsageError):  # `profiles list` tells what is wrong with it
            found.append(load_profile(name, profiles))
    return [profile for profile in found if isinstance(profile, kind)]


def look_at(
    entries: Mapping[Signal, Entry],
    read: Callable[[Entry], int],
    now_ns: Callable[[], int],
    *,
    arrived_ns: Callable[[], int],
    power: PowerTable,
    error: Entry | None,
    silent: str,
    emergency: Callable[[], int | None] = lambda: None,
    refused: Callable[[Entry], str] = lambda entry: "",
) -> DriveReading:
    """Read all values that `watch` shows of a drive; if the first answer does not come, the rest is not read.

    `arrived_ns` is the instant of the last answer. The code of a fault is read from the entry `error`; where it gives
    none, it is that of `emergency`. `silent` and `refused` add to the note about a drive that does not answer, and
    about an entry that it does not give. Raises BusError when the bus is dead.
    """
    began_ns = t_ns = now_ns()
    values: dict[Signal, int] = {}
    notes: list[str] = []
    for signal, entry in entries.items():
        if signal not in SHOWN:
            continue
        try:
            values[signal] = read(entry)
        except BusTimeoutError as silence:
            if not values:
                return DriveReading(t_ns, note=f"{silence}; {silent}")
            return DriveReading(t_ns, values, (now_ns() - began_ns) * 1e-9, note=str(silence))
        except BusConfigurationError as refusal:
            notes.append(f"{refusal}{refused(entry)}")
        if signal is Signal.POSITION:
            t_ns = arrived_ns()
    code = None
    if error is not None and power.state(values.get(Signal.STATUSWORD, 0)) in FAULTS:
        try:
            code = read(error)
        except (BusConfigurationError, BusTimeoutError):
            code = emergency()
    return DriveReading(t_ns, values, (now_ns() - began_ns) * 1e-9, error_code=code, note="; ".join(notes))
