"""Proofs of guards around a run: which are due, what a person is told before, and what is kept in the rig file."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from datetime import datetime
from functools import partial

from haptic_fieldbus.assessing.proof import Proof
from haptic_fieldbus.buses.bus import DriveFacts
from haptic_fieldbus.documents.edits import Value, table_text, with_table
from haptic_fieldbus.documents.replacing import edit_file
from haptic_fieldbus.drive.identity import Identity
from haptic_fieldbus.drive.rig import Proved
from haptic_fieldbus.errors import BusError, UnprovedGuardError
from haptic_fieldbus.numerals import exactly, rounded
from haptic_fieldbus.planning.guards import CAPPED
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.running.proving import ATTEMPTS

KEYS = ("serial", "vendor", "product", "revision", "guard", "guard_ms", "asked_ms", "profile", "digest", "date")
"""Keys of a proof, in the order in which they are written."""


def questions(plan: Plan, due: Mapping[str, str]) -> Iterator[str]:
    """Yield a sentence for each axis whose guard is about to be proved; `due` has the reasons, some empty."""
    guards = {guard.axis: guard.seconds for guard in plan.guards}
    for name, why in due.items():
        yield (
            f"about to prove the guard of axis {name}{f' ({why})' if why else ''}: the drive is enabled with zero "
            f"torque, then left alone until it lets go by itself, asked for within {exactly(1e3 * guards[name])} ms; "
            "it may report a lost master, which is then cleared."
        )


def check(plan: Plan, facts: Mapping[str, DriveFacts], proofs: Sequence[Proof], unkept: Sequence[str]) -> None:
    """Raise UnprovedGuardError when a drive did not let go in time; `unkept` is what `keep` said.

    Raises BusError when this computer was too late to look.
    """
    unknown = [_switched_off(plan, proof) for proof in proofs if proof.early]
    failed = [_failure(plan, facts, proof) for proof in proofs if not (proof.holds or proof.early or proof.missed)]
    if failed or unknown:
        raise UnprovedGuardError("\n".join([*failed, *unknown, *unkept]))
    if any(proof.missed for proof in proofs):
        raise BusError(
            f"this computer was late each of the {ATTEMPTS} times that the guards of the drives were to be proved: "
            "another process takes the processor's time, or the rate is too high for this computer"
        )


def keep(plan: Plan, facts: Mapping[str, DriveFacts], proofs: Sequence[Proof]) -> Iterator[str]:
    """Write each outcome into the rig file of a real bench; yield a sentence for each that could not be written."""
    for proof in proofs if plan.rig.source and not plan.simulated else ():
        if proof.early or proof.missed:
            continue
        values = _values(plan, proof, facts[proof.axis].identity)
        if values is None:
            continue
        path = ("axis", proof.axis, "proved")
        try:
            edit_file(plan.rig.source, partial(with_table, path=path, values=values))
        except (OSError, ValueError) as error:
            why = getattr(error, "strerror", None) or error
            table = table_text(path, values).replace("\n", ", ")
            yield f"the proof of axis {proof.axis} was not kept in {plan.rig.source}: {why}. It would be: {table}"


def _values(plan: Plan, proof: Proof, drive: Identity) -> dict[str, Value] | None:
    """Return the keys of a proof; None when it could never be told to be that of the drive that is there."""
    if proof.holds and drive.serial is None:
        return None
    kept = Proved(
        guard="proved" if proof.holds else "none",
        guard_ms=None if proof.off is None else round(1e3 * proof.off, 3),
        asked_ms=round(1e3 * proof.guard, 3),
        profile=plan.axis(proof.axis).profile.name,
        date=datetime.now().astimezone().isoformat(timespec="seconds"),
        **asdict(drive),
    )
    written = next(guard.set_to.written for guard in plan.guards if guard.axis == proof.axis)
    values = asdict(replace(kept, digest=kept.digest_with(written)))
    return {key: values[key] for key in KEYS if values[key] is not None}


def _failure(plan: Plan, facts: Mapping[str, DriveFacts], proof: Proof) -> str:
    """Return what was measured, and what to do."""
    axis = plan.axis(proof.axis)
    told = facts.get(proof.axis)
    number = None if told is None else told.identity.serial
    serial = "" if number is None else f" (serial {number:#010x})"
    stayed = f"for {rounded(1e3 * proof.enabled)} ms, and was never seen off"
    when = stayed if proof.off is None else f"until {rounded(1e3 * proof.off)} ms after it"
    return (
        f"axis {proof.axis}: the guard of {axis.profile.title}, node {axis.node}{serial}, did not act in time. Nothing "
        f"was sent to it, and it stayed in operation enabled {when}; asked for were {exactly(1e3 * proof.guard)} ms, "
        f"and {rounded(1e3 * proof.allowed)} ms would have passed. No torque was given. A drive like this keeps its "
        f"torque when this computer dies or the cable breaks: check its guard and its reaction with its own tool"
        f"{_instead(plan, proof.axis)}"
    )


def _switched_off(plan: Plan, proof: Proof) -> str:
    """Return the sentence about a drive that something else than its guard switched off."""
    axis, off = plan.axis(proof.axis), rounded(1e3 * (proof.off or 0.0))
    return (
        f"axis {axis.name}: {axis.profile.title}, node {axis.node}, was off {off} ms after it was left alone, each of "
        f"{ATTEMPTS} times, and its guard of {exactly(1e3 * proof.guard)} ms cannot act before "
        f"{rounded(1e3 * proof.earliest)} ms: something else switches it off, such as safe torque off (STO) or an "
        "enable input. Whether its guard acts is not known. No torque was given"
    )


def _instead(plan: Plan, name: str) -> str:
    """Return the way to go on without a guard."""
    if not plan.rig.source:
        return f"; with an emergency stop that cuts its power a rig file can permit it (emergency_stop); {CAPPED} then"
    if plan.axis(name).rig.emergency_stop is None:
        stop = f'axis.{name}.emergency_stop = "power"'
        return f"; with an emergency stop in reach that cuts its power, write {stop} into the rig; {CAPPED} then"
    return f"; it is kept in the rig, so that from the next run on {CAPPED}"
