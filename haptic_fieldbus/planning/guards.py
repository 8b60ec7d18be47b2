"""The guard (watchdog) of each drive: without messages of the host the drive takes the torque away by itself.

The guard is set when the drive is configured. A run proves that it acts (`running.proofs`): the run stops sending
at zero torque and measures the time. The outcome is kept in the rig file (`Proved`). A drive without a guard, or with a
guard that failed in the test, may give no more than the holding torque, and only where a person can cut its power.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from haptic_fieldbus.drive.profile import DriveProfile, Identity
from haptic_fieldbus.drive.rig import Proved, RigAxis
from haptic_fieldbus.errors import PlanError
from haptic_fieldbus.numerals import exactly, rounded
from haptic_fieldbus.planning.limits import HOLDING_SHARE
from haptic_fieldbus.protocols.traffic import Json

CAPPED = f"torque is limited to {100 * HOLDING_SHARE:g} % of rated, which a hand can hold"
SAME_GUARD_MS = 0.5
"""Guard times that differ by less are equal; drives count in whole milliseconds."""
BETWEEN_PROOFS = 0.2
"""Longest time between two signs of life of the host, as a share of the guard time; every bus keeps it."""
_ROUNDED_MS = 0.001
"""Resolution of a saved time: whole microseconds."""
LONGEST_QUESTION = 0.02
"""Largest part of the measured time that counts as questions to a drive that has left the exchange [s]."""


def unguarded(profile: DriveProfile, axis: RigAxis) -> str:
    """Return the reason why the drive has no reliable guard; empty if no reason is known."""
    if not profile.guarded:
        return f"{profile.title} has no watchdog that switches the torque off (profile)"
    proved = axis.proved
    if proved is None or proved.guard == "proved" or proved.profile != profile.name:
        return ""
    fired = "did not fire"
    if proved.guard_ms is not None:
        fired = f"fired after {rounded(proved.guard_ms)} ms instead of {exactly(proved.asked_ms)} ms"
    return f"the watchdog of {profile.title} {fired} in the test on {proved.date} (rig file)"


def cap_reason(profile: DriveProfile, axis: RigAxis, unknown: str) -> str:
    """Return the reason why force is capped; empty when it is not. `unknown` says why no limit is known."""
    if unknown:
        return unknown
    if profile.echo is None:
        return f"{profile.title} does not return its set-points (torque.echo of its profile)"
    return unguarded(profile, axis)


def check_guarded(name: str, profile: DriveProfile, axis: RigAxis) -> None:
    """Raise PlanError when neither guard nor emergency stop takes the torque away after the host has failed.

    A drive that cannot be told to brake is refused too where the rig wants that.
    """
    if axis.on_link_loss == "brake" and not profile.brakes:
        raise PlanError(
            f'axis {name}: on_link_loss = "brake" needs a drive that can be told to brake when its master is gone '
            f"(6007h of CANopen); the profile of {profile.title} names no such object. Leave the key out: then the "
            "shaft is free"
        )
    why = unguarded(profile, axis)
    if why and axis.emergency_stop is None:
        raise PlanError(
            f"axis {name}: {why}. The drive could hold its last torque when this computer dies or the cable breaks. If "
            f'an emergency stop within reach cuts the motor power, write axis.{name}.emergency_stop = "power" into the '
            f"rig; then {CAPPED}. To test the watchdog again: run --prove"
        )


@dataclass(frozen=True)
class SetGuard:
    """A guard as the plan sets it, and the times within which a proof must see it act."""

    seconds: float
    """Time to which the guard is set [s]."""
    late: float
    """Time until the last write reaches the drive and its controller acts [s]."""
    period: float
    """Length of a period [s]."""
    written: tuple[str, ...] = ()
    """All writes to the drive for the guard, and the place of the drive."""

    @property
    def between(self) -> float:
        """Longest time between two readings of the drive [s]."""
        # Two readings are a period apart; a reading without feedback ends nearly a period later.
        return 2.0 * self.period

    @property
    def earliest(self) -> float:
        """Earliest time from the last write to the reaction of the guard [s]."""
        return self.seconds - BETWEEN_PROOFS * self.seconds - self.between

    @property
    def allowed(self) -> float:
        """Latest time from the last write to a reading that shows the drive off [s], without the time of questions."""
        return self.seconds + self.late + self.between


@dataclass(frozen=True)
class AxisGuard:
    """The guard of one axis, with its proof as far as it is known before a bus is opened."""

    axis: str
    set_to: SetGuard
    proved: Proved | None
    """Proof that is valid for this profile and guard time; the serial number is not yet checked."""
    why_not: str
    """Reason why no proof is valid; empty with a valid proof, or if the drive is known to have no reliable guard."""
    cap: str
    """Reason why torque is capped; empty when it is not."""
    emergency_stop: str | None
    exists: bool
    """False: the profile offers no guard, so there is nothing to prove."""

    @property
    def seconds(self) -> float:
        """Time to which the guard is set [s]."""
        return self.set_to.seconds

    def to_json(self) -> dict[str, Json]:
        """Return the object of `plan --json`."""
        proof, proved = self.proved, dict[str, Json]()
        if proof is not None:
            proved = {"guard_ms": proof.guard_ms, "date": proof.date, "serial": proof.serial}
        told: dict[str, Json] = {"axis": self.axis, "guard_ms": 1e3 * self.seconds, "proved": proved or None}
        stop = self.emergency_stop
        return {**told, "unproved": self.why_not or None, "capped": self.cap or None, "emergency_stop": stop}

    def text(self, *, simulated: bool) -> str:
        """Return the guard in words, and whether it is proved before force on this bench."""
        if self.cap:
            return f"{self.cap}; {CAPPED}"
        asked = f"{exactly(1e3 * self.seconds)} ms"
        if self.proved is not None:
            measured, serial = self.proved.guard_ms, self.proved.drive.serial
            time = "" if measured is None else f"{rounded(measured)} ms measured "
            drive = "" if serial is None else f", drive with serial number {serial:#010x}"
            return f"{asked}; {time}on {self.proved.date}{drive}"
        if simulated:
            return f"{asked} (not tested; `run --prove` tests it)"
        return f"{asked} (to be tested at zero torque before force is applied: {self.why_not})"


def to_prove(
    guards: Sequence[AxisGuard], recorded: Mapping[str, Proved | None], drives: Mapping[str, Identity]
) -> dict[str, str]:
    """Return the axes whose guards must be proved now, with the reason of each; empty when all proofs are valid.

    If one guard must be proved, all others are proved with it, with an empty reason. Axes without a guard, or with a
    guard that is known not to act, are left out. The keys of all mappings are names of axes.
    """
    reasons = {each.axis: unproved(each, recorded[each.axis], drives[each.axis]) for each in guards}
    if not any(reasons.values()):
        return {}
    return {each.axis: reasons[each.axis] for each in guards if each.exists and (reasons[each.axis] or not each.cap)}


def guard_of(name: str, profile: DriveProfile, axis: RigAxis, set_to: SetGuard, source: str) -> AxisGuard:
    """Return the guard of an axis of the rig file `source`, which is empty for a rig without a file."""
    cap = unguarded(profile, axis)
    why_not = "" if cap else _why_not(profile, axis, set_to, source)
    known = axis.proved if not cap and not why_not else None
    return AxisGuard(name, set_to, known, why_not, cap, axis.emergency_stop, profile.guarded)


def _why_not(profile: DriveProfile, axis: RigAxis, set_to: SetGuard, source: str) -> str:
    proved = axis.proved
    if proved is None:
        return "the rig file has no watchdog proof yet" if source else "without a rig file no proof is saved"
    if proved.profile != profile.name:
        return f"the proof in the rig file is for the profile {proved.profile}"
    if abs(proved.asked_ms - 1e3 * set_to.seconds) > SAME_GUARD_MS:
        return f"the proof in the rig file is for {exactly(proved.asked_ms)} ms"
    if proved.digest is None:
        return "the proof in the rig file was made by an earlier version and has no digest; run --prove makes a new one"
    if proved.digest != proved.digest_with(set_to.written):
        return "profile, reaction, bus, node or proof changed after the proof was saved in the rig file"
    low, high = 1e3 * set_to.earliest, 1e3 * (set_to.allowed + LONGEST_QUESTION)
    if proved.guard_ms is not None and low - _ROUNDED_MS <= proved.guard_ms <= high + _ROUNDED_MS:
        return ""
    measured = "no time" if proved.guard_ms is None else f"{rounded(proved.guard_ms)} ms"
    return f"the proof in the rig file has {measured}; {rounded(low)} to {rounded(high)} ms are accepted at this rate"


def unproved(guard: AxisGuard, recorded: Proved | None, drive: Identity) -> str:
    """Return the reason why a guard must be proved now; empty when its proof is valid for the connected drive.

    `recorded` is the outcome in the rig file, `drive` the connected drive.
    """
    if not guard.exists:
        return ""
    if guard.why_not:
        return guard.why_not
    known = Identity() if recorded is None else recorded.drive
    other = known.difference(drive)
    if other and known.serial is not None and drive.serial is not None:
        numbers = (getattr(each, other) for each in (known, drive))
        before, now = ("unknown" if number is None else f"{number:#010x}" for number in numbers)
        return f"the proof in the rig file is for another drive: {other} {before}, this drive has {now}"
    if guard.cap:
        return ""
    if drive.serial is None:
        return "the drive reports no serial number, so the proof cannot be assigned to it"
    return "the proof in the rig file names no drive" if other else ""


def guard_lines(guards: Sequence[AxisGuard], *, simulated: bool) -> Iterator[str]:
    """Yield one line for each guard, with the name of its axis where there are several."""
    for guard in guards:
        prefix = f"{guard.axis}: " if len(guards) > 1 else ""
        yield prefix + guard.text(simulated=simulated)
