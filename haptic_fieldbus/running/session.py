"""One run at a site: configure, ask for confirmation, render, record, and end torque-free whatever happens."""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING

from haptic_fieldbus.assessing.axis_assessment import Run
from haptic_fieldbus.assessing.loop_report import LoopReport, Record
from haptic_fieldbus.assessing.passivity import passivities
from haptic_fieldbus.assessing.recording import Truth
from haptic_fieldbus.assessing.result import Proof, Result, Right, known_before
from haptic_fieldbus.assessing.summary import ROWS_NEEDED, Assessment, notices
from haptic_fieldbus.buses.bus import Bus, StepwiseBus
from haptic_fieldbus.buses.group import BusGroup
from haptic_fieldbus.clock import Clock
from haptic_fieldbus.cycle.cycle import Cycle, columns
from haptic_fieldbus.drive.objects import Identity
from haptic_fieldbus.errors import BusError, HapticFieldbusError, UsageError
from haptic_fieldbus.numerals import exactly, percent
from haptic_fieldbus.planning.deadlines import unseen_text
from haptic_fieldbus.planning.guards import to_prove
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.planning.selection import Selection
from haptic_fieldbus.planning.sign_probe import sign_probe, sign_text
from haptic_fieldbus.running.ending import EndSignals, ended_by_signals
from haptic_fieldbus.running.loop import UNCONFIRMED, enabling_time, run_loop
from haptic_fieldbus.running.rows import Rows

if TYPE_CHECKING:  # a run in which nothing changes does without them
    from haptic_fieldbus.running.changes import Changes

LONGEST_RECORD = 300_000
"""Largest number of rows that are kept of a run on real drives; files of rows are written while it goes on."""


@dataclass(frozen=True)
class Request:
    """A compiled selection and the conditions of its run."""

    selection: Selection
    duration: float
    """Time in operation enabled [s]."""
    record: Path | None = None
    """File for the rows of the run; a file for frames (.log, .blf) is written by the buses instead."""
    confirm: Callable[[str], bool] | None = None
    """Function that gets a question and returns whether torque may be enabled on a real bus; None: it may not."""
    progress: Callable[[int, int], None] | None = None
    """Function that gets the periods done and the periods of the whole run."""
    changes: "Changes | None" = None
    prove: bool = False
    """Prove the guards of the drives, whether they are proved or simulated."""
    instruct: Callable[[str], None] | None = None
    """Function that shows a person what to do before a real drive is enabled; None: nobody is there to do it."""


@dataclass(frozen=True)
class Site:
    """The place of a run: a clock, the buses by name and, behind simulated buses, their worlds by the same names."""

    clock: Clock
    buses: Mapping[str, StepwiseBus]
    worlds: Mapping[str, Truth]
    hand: str
    """Name of the simulated hand that moves the handles; empty where there is none."""
    faults: list[str] = field(default_factory=list)
    """Reasons for which a recording of frames ended early; complete when the site has been left."""


def render(request: Request, place: AbstractContextManager[Site]) -> Result:
    """Run the selection at `place` and return the result.

    A signal ends the run early and is no error: the result says `stopped`, and has no cycles before operation enabled.
    Raises UsageError when a real bus is not confirmed, and BusError, DriveFaultError or SafetyTripError of the run.
    Each error carries the facts known by then as `result`; rows are written to the record file in any case.
    """
    with ended_by_signals() as ending:
        return _rendered(request, place, ending)


def _rendered(request: Request, place: AbstractContextManager[Site], ending: EndSignals) -> Result:
    plan = request.selection.plan
    cycles = max(1, round(request.duration * plan.rate))
    cycle, report, prepared = Cycle(plan), LoopReport(), Preparation(request)
    record = _record_of(plan, cycles)
    rows = _rows_of(request, record)
    assessment: Assessment | None = None
    started = perf_counter()
    try:
        with place as site, _rights(plan) as prepared.host:
            prepared.bus = bus = next(iter(site.buses.values())) if len(site.buses) == 1 else BusGroup(site.buses)
            run = Run(request.selection, cycle, record, report, site.worlds, site.clock.name, cycles, site.hand)
            assessment = Assessment(run)
            with _freed(bus, ending):
                _open(request, plan, bus, site.clock, prepared, ending)
                ending.hold()
                run_loop(
                    plan,
                    cycle,
                    bus,
                    site.clock,
                    cycles=cycles,
                    record=record,
                    progress=_followed(rows, assessment, request.progress, cycles, _hint(request, cycle)),
                    report=report,
                    changes=request.changes,
                    ending=ending,
                )
    except KeyboardInterrupt as early:
        ending.hold()
        report.interrupted = True
        stopped = ending.stopped(report, request.duration)
        result = prepared.told_with(replace(known_before(request.selection, report), stopped=stopped), [])
        if UNCONFIRMED not in getattr(early, "__notes__", ()):
            return result
        unconfirmed = BusError(UNCONFIRMED)
        unconfirmed.result = result
        raise unconfirmed from early
    except HapticFieldbusError as error:
        # A run that fails has a result too: the command line prints it beside the error.
        known = known_before(request.selection, report, cycle.trip, str(error))
        seen = tuple(passivities(plan, cycle, report.cycles))
        stopped = ending.stopped(report, request.duration)
        known = replace(known, passivity=seen, stopped=stopped, warnings=tuple(notices(plan, cycle, report)))
        known = known if assessment is None else assessment.with_travel(known)
        error.result = prepared.told_with(known, known.warnings)
        raise
    finally:
        rows.close()
        if report.released:
            ending.freed()
    stopped = ending.stopped(report, request.duration)
    result = assessment.finish(perf_counter() - started)
    fault = _recording_fault(rows, site)
    told = [] if fault is None else [f"the recording {request.record} ended before the run: {fault}"]
    return prepared.told_with(replace(result, recording_fault=fault, stopped=stopped), [*told, *result.warnings])


def _record_of(plan: Plan, cycles: int) -> Record:
    """Return the record of a run, with room for the periods until the drives are enabled."""
    kept = ROWS_NEEDED if plan.simulated else LONGEST_RECORD
    enabling = min(LONGEST_RECORD, math.ceil(enabling_time(plan) * plan.rate))
    return Record(columns(plan), min(cycles, kept) + enabling + 1)


def _rows_of(request: Request, record: Record) -> Rows:
    """Open the file of rows; raises UsageError when it cannot be written."""
    try:
        return Rows(record, request.record, simulated=request.selection.plan.simulated)
    except OSError as error:
        raise UsageError(f"cannot record to {request.record}: {error.strerror}") from error


def _recording_fault(rows: Rows, site: Site) -> str | None:
    """Return why a recording ended before the run: that of frames, else that of rows; None when it did not."""
    told = [] if rows.fault is None else [rows.fault.strerror or str(rows.fault)]
    return next(iter([*site.faults, *told]), None)


@contextmanager
def _freed(bus: Bus, ending: EndSignals) -> Iterator[None]:
    """Stop the drives when the block fails, with a note where one did not confirm it, and leave the bus."""
    try:
        yield
    except BaseException as error:
        ending.hold()
        if not bus.stop():
            error.add_note(UNCONFIRMED)
        raise
    finally:
        ending.hold()
        bus.close()


def _rights(plan: Plan) -> AbstractContextManager[tuple[Right, ...]]:
    """Return the rights of a run in real time; virtual time needs none."""
    if plan.simulated:
        return nullcontext(())
    from haptic_fieldbus.running.rights import real_time

    return real_time()


class Preparation:
    """What is known before a run renders: its bus, the rights of the host, proofs of guards, and what is to be told."""

    def __init__(self, request: Request) -> None:
        self.bus: Bus | None = None
        self.host: tuple[Right, ...] = ()
        self.proofs: tuple[Proof, ...] = ()
        self.warnings: list[str] = []
        self._plan, self._asked = request.selection.plan, request.prove

    def told_with(self, result: Result, warnings: Iterable[str]) -> Result:
        """Return a result with what is known from before, and with these warnings after those of bus and guards."""
        earlier = () if self.bus is None else self.bus.warnings
        told = (*earlier, *self.warnings, *warnings)
        return replace(result, warnings=told, proofs=self.proofs, host=self.host)

    def due(self, bus: Bus) -> dict[str, str]:
        """Return the axes of an inspected bus whose guards are to be proved, with the reason of each."""
        plan = self._plan
        if plan.simulated and not self._asked:
            return {}
        drives = {name: facts.identity for name, facts in bus.facts.items()}
        # With --prove the plan knows of no proof, so each guard has a reason.
        recorded = {axis.name: axis.rig.proved for axis in plan.axes}
        return to_prove(plan.guards, recorded, {name: drives.get(name, Identity()) for name in recorded})


def _open(request: Request, plan: Plan, bus: Bus, clock: Clock, prepared: Preparation, ending: EndSignals) -> None:
    """Inspect the drives, ask, and only then write to them; prove the guards that are due, and see the direction.

    Raises UsageError, PlanError, RigError, BusError, DriveFaultError or SafetyTripError.
    """
    bus.inspect(plan, bytearray(plan.image.input_size))
    due = prepared.due(bus)
    _ask(request, plan, bus, due)
    if due:
        from haptic_fieldbus.running import guard_proof
        from haptic_fieldbus.running.guard_proof import prove

        ending.hold()
        prepared.proofs = prove(plan, bus, clock, due, ending)
        prepared.warnings += guard_proof.keep(plan, bus.facts, prepared.proofs)
        guard_proof.check(plan, bus.facts, prepared.proofs, prepared.warnings)
    if not plan.simulated:
        from haptic_fieldbus.running.direction import confirm_direction

        prepared.warnings += confirm_direction(plan, bus, clock, request.instruct, ending)
    bus.configure(plan)
    bus.start()


def _ask(request: Request, plan: Plan, bus: Bus, due: Mapping[str, str]) -> None:
    """Ask for confirmation before torque is enabled on a real bus; raises UsageError without it."""
    if request.selection.bus.simulated:
        return
    heard = dict.fromkeys(facts.listened for facts in bus.facts.values() if facts.listened)
    proved: Iterable[str] = ()
    if due:
        from haptic_fieldbus.running.guard_proof import questions

        proved = questions(plan, due)
    unseen = [f"Not seen: {text}." for axis in plan.axes if (text := unseen_text(axis, plan.period))]
    question = "\n".join([*heard, *unseen, *proved, *(_warning(plan, name, bus) for name in bus.facts)])
    if request.confirm is None or not request.confirm(question):
        raise UsageError("not enabled: on a real bus nothing moves until it is confirmed (--yes for scripts)")


def _warning(plan: Plan, name: str, bus: Bus) -> str:
    """Return the sentence about one axis that is to be confirmed: drive, bus, limits, reaction to a link loss."""
    axis = next(axis for axis in plan.axes if axis.name == name)
    facts = bus.facts[name]
    share, probe = axis.limits.effort / axis.rated_effort, sign_probe(axis, plan.period)
    number = facts.identity.serial
    serial = "" if number is None else f" (serial {number:#06x})"
    return (
        f"about to enable torque on {facts.title}, node {facts.node}, {plan.rig.bus[axis.rig.bus].channel}{serial}: "
        f"at most {percent(share)} of rated torque, {exactly(axis.limits.speed)} {axis.workspace.length_unit}/s; "
        f"{'. '.join((f'{facts.link_loss}, confirmed in the drive', *facts.changes))}."
        f"{'' if probe is None else f' First, {sign_text(axis, probe)}.'}"
    )


def _hint(request: Request, cycle: Cycle) -> Callable[[], None]:
    """Return a function that asks a person once to let go of a handle whose sign was looked for in vain."""
    hidden = {axis.name for axis in request.selection.plan.axes if not axis.sign_known}

    def hint() -> None:
        for name in [name for name in hidden if cycle.axes[name].sign.unseen]:
            hidden.discard(name)
            if request.instruct is not None:
                request.instruct(f"axis {name}: let go of the handle, so that torque is seen to move it\n")

    return hint


def _followed(
    rows: Rows,
    assessment: Assessment,
    progress: Callable[[int, int], None] | None,
    cycles: int,
    hint: Callable[[], None],
) -> Callable[[int], None]:
    """Return the function that the loop calls about ten times a second: it records, assesses, and tells progress."""

    def follow(done: int) -> None:
        rows.flush()
        assessment.advance()
        hint()
        if progress is not None:
            progress(done, cycles)

    return follow
