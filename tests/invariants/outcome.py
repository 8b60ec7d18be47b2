"""How a run ended, against what happened in it: exit status, result, and recordings."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tests.invariants import causes
from tests.invariants.laws import ending
from tests.invariants.parts import parts_of
from tests.invariants.proofs import let_go_after
from tests.invariants.witness import MASTER, Witness
from tests.invariants.words import MAKES_TORQUE

MARGIN_NS = 1_000_000
"""Frames that were sent that long before the end may still have been answered."""
STATUS = {
    "BusError": 1, "BusTimeoutError": 1, "BusConfigurationError": 1, "DriveFaultError": 1, "SafetyTripError": 3,
    "UsageError": 2, "PlanError": 4, "ForeignMasterError": 4, "UnstableSceneError": 4,
    "UnprovedGuardError": 4,
}  # fmt: skip
"""Exit status of an error by its name, as the command line promises it."""


@dataclass(frozen=True)
class Ended:
    """The end of a run: the name of its error, its message and notes; None for a run without one."""

    error: str | None
    message: str
    cycles: int
    """Periods in *operation enabled* of which the result tells."""
    record: Path | None


def wrong(witnesses: Sequence[Witness], ended: Ended) -> Iterator[tuple[str, str]]:
    """All that is wrong: (name of the law, sentence)."""
    for sentence in _status(witnesses, ended):
        yield "exit status right", sentence
    for sentence in _recording(witnesses, ended):
        yield "recording complete", sentence


def _status(witnesses: Sequence[Witness], ended: Ended) -> Iterator[str]:
    if ended.error is not None and ended.error not in STATUS:
        yield f"a run raised {ended.error}: {ended.message[:300]}"
        return
    runs = [parts_of(witness)[-1] for witness in witnesses]
    yield from _guards(runs, ended)
    for witness in runs:
        faults, stated = witness.faults, witness.stated
        if ended.error is None:
            yield from _in_order(witness)
        if len(faults) != 1:
            continue
        (fault,) = faults
        if ended.error is not None and causes.is_harmless(fault, stated) and len(witnesses) == 1:
            yield f"{fault.kind} alone has ended the run: {ended.message[:200]}"
        if ended.error is not None and fault.kind in causes.STATUS and next(ending(witness), None) is not None:
            status = STATUS[ended.error]
            if status not in causes.STATUS[fault.kind]:
                yield f"{fault.kind} ended with exit status {status}: {ended.message[:200]}"


def _guards(runs: Sequence[Witness], ended: Ended) -> Iterator[str]:
    """Guards that did not act, and nothing else, end a run before it has begun."""
    proofs = [run for run in runs if run.proves]
    if ended.error is None and proofs and ended.cycles:
        yield "a run without an error ended while guards were proved"
    if ended.error != "UnprovedGuardError":
        return
    times = [(axis, let_go_after(run, axis)) for run in proofs for axis in run.stated.axes if axis.node in run.shafts]
    if len(proofs) < len(runs) or not any(took is not None and took > axis.guard for axis, took in times):
        yield f"every guard has acted, and it was said: {ended.message[:200]}"


def _in_order(witness: Witness) -> Iterator[str]:
    """A run without an error: nothing happened that ends one, and every motor is off."""
    oldest = max(axis.age for axis in witness.stated.axes)
    for fault, cause, event_ns in ending(witness):
        over_ns = witness.released_ns if witness.released_ns is not None else witness.seen_ns
        # What happens at the very end may be noticed too late to end anything.
        # Feedback that is missing fades the torque first, and ends the run when it is too old.
        noticed = causes.allowed(cause, witness.faults, witness.stated) + oldest + 3.0 * witness.stated.period
        if (over_ns - event_ns) * 1e-9 > noticed:
            yield f"{getattr(fault, 'kind', fault)} did not end the run"
    cuts = [fault for fault in witness.faults if fault.kind in causes.CUTS]
    for fault in cuts:
        # Of several the one may end the other.
        if len(cuts) == 1 and _is_cut_off(fault, witness):
            yield f"nobody can have confirmed that the motors are off: {fault.kind} at {fault.at:.4f} s"
    for axis in witness.stated.axes:
        shaft = witness.shafts[axis.node]
        if shaft.now in MAKES_TORQUE:
            yield f"{axis.name}: a run without an error left the drive in {shaft.now.value}"


def _is_cut_off(fault: Any, witness: Witness) -> bool:
    """Whether a drive or the master has been off the wire from before the order to let go on, until all was over."""
    enabled_ns, released_ns = witness.faults_ns, witness.released_ns
    if enabled_ns is None or released_ns is None:
        return False
    begins_ns = (witness.counts_from_ns(fault) or enabled_ns) + round(fault.at * 1e9)
    if fault.duration is not None and begins_ns + round(fault.duration * 1e9) < witness.seen_ns:
        return False
    return bool(begins_ns < released_ns - MARGIN_NS)


def _recording(witnesses: Sequence[Witness], ended: Ended) -> Iterator[str]:
    if ended.record is None or not ended.record.exists() or len(witnesses) != 1:
        return
    (witness,) = witnesses
    if not witness.whole:
        return
    if ended.record.suffix == ".csv":
        rows = ended.record.read_text(encoding="utf-8").splitlines()
        whole = [row for row in rows[1:] if row.count(",") == rows[0].count(",")]
        if len(whole) != len(rows) - 1:
            yield "a row is cut off"
        if len(whole) < ended.cycles:
            yield f"{len(whole)} rows of {ended.cycles} periods"
    elif ended.record.suffix == ".log":
        axis = witness.stated.axes[0]
        heard = f" {axis.target.can_id:03X}#"
        kept = sum(heard in line for line in ended.record.read_text(encoding="utf-8").splitlines())
        sent = sum(can_id == axis.target.can_id and by == MASTER for _, can_id, _, by in witness.frames)
        if kept < sent:
            yield f"{kept} set-points in the file, {sent} on the wire"
