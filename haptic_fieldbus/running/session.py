"""One run at a site: configure, ask for confirmation, render, record, and end with zero torque in any case."""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np

from haptic_fieldbus.assessing.loop_report import LoopReport, Record
from haptic_fieldbus.assessing.passivity import passivities
from haptic_fieldbus.assessing.recording import Truth
from haptic_fieldbus.assessing.result import Proof, Result, Right, Trace, known_before
from haptic_fieldbus.assessing.summary import ROWS_NEEDED, Assessment, Run, notices, recorded_trace
from haptic_fieldbus.buses.bus import Bus, BusGroup, StepwiseBus
from haptic_fieldbus.clock import Clock
from haptic_fieldbus.cycle.cycle import Cycle, columns
from haptic_fieldbus.drive.profile import Identity
from haptic_fieldbus.errors import BusError, HapticFieldbusError, UsageError, wrong_kind
from haptic_fieldbus.numerals import percent, rounded
from haptic_fieldbus.planning.deadlines import unseen_text
from haptic_fieldbus.planning.guards import to_prove
from haptic_fieldbus.planning.known_bench import check_measured_drive
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.planning.sign_probe import sign_probe, sign_text
from haptic_fieldbus.recordings.provenance import COUNTED, Provenance, write_beside
from haptic_fieldbus.running.ending import EndSignals, ended_by_signals
from haptic_fieldbus.running.loop import UNCONFIRMED, Caller, Steps, enabling_time, finished, loop_steps
from haptic_fieldbus.running.rows import ROW_SUFFIXES, Rows, put_back, set_aside

if TYPE_CHECKING:  # a run in which nothing changes does without them
    from haptic_fieldbus.running.changes import Changes
    from haptic_fieldbus.running.leading import Leading
    from haptic_fieldbus.running.live import Live

LONGEST_RECORD = 300_000
"""Largest number of kept rows of a run on real drives; files of rows are written during the run."""


@dataclass(frozen=True)
class Site:
    """The place of a run: a clock, the buses by name and, behind simulated buses, their worlds by the same names."""

    clock: Clock
    buses: Mapping[str, StepwiseBus]
    worlds: Mapping[str, Truth]
    hand: str
    """Name of the simulated hand that moves the handles; empty without one."""
    faults: list[str] = field(default_factory=list)
    """Reasons why a recording of frames ended early; complete after the site has been left."""


@dataclass
class Session:
    """One run of a plan: its arguments, and the facts known before it renders."""

    plan: Plan
    bus_name: str
    """Name of the bus, or those of all buses."""
    duration: float
    """Time in operation enabled [s]."""
    record: Path | None = None
    """File for the rows of the run; a file for frames (.log, .blf) is written by the buses instead."""
    changes: "Changes | None" = None
    prove: bool = False
    """Test the drive watchdogs, even if they are proved or simulated."""
    confirm: Callable[[str], bool] | None = None
    """Function that gets a question and returns whether torque may be enabled on a real bus; None: never."""
    instruct: Callable[[str], None] | None = None
    """Function that shows a person what to do before a real drive is enabled; None: no person is present."""
    progress: Callable[[int, int], None] | None = None
    """Function that gets the periods done and the periods of the whole run."""
    provenance: Provenance | None = None
    """Texts, conditions and versions of the run; written beside or into its record."""
    drawing: str = ""
    """Module and function with which the result draws its picture."""
    live: "Live | None" = None
    """View of the run while it goes on."""
    led: "Callable[[Mapping[str, Truth]], Leading] | None" = None
    """Leads the handles of a simulation, whose worlds it gets; None: nobody does."""
    _warnings: list[str] = field(default_factory=list, init=False)
    """Warnings about drive watchdogs and motor directions."""
    _proofs: tuple[Proof, ...] = field(default=(), init=False)
    _host: tuple[Right, ...] = field(default=(), init=False)
    _bus: Bus | None = field(default=None, init=False)
    report: LoopReport = field(default_factory=LoopReport, init=False)
    """Counts of the loop, once it runs."""
    cycle: Cycle | None = field(default=None, init=False)
    kept: Record = field(default_factory=lambda: Record((), 1), init=False, repr=False)
    """Rows of the run, once it has begun."""
    looks_back: bool = False
    """Compare the record with the bench after the run, and note in the rig file what contradicts it."""
    _leading: "Leading | None" = field(default=None, init=False)

    def render(self, place: AbstractContextManager[Site]) -> Result:
        """Run the plan at `place` and return the result.

        A signal ends the run early and is no error: the result says `stopped`, and has no cycles before operation
        enabled. Raises UsageError when a real bus is not confirmed, and BusError, DriveFaultError or SafetyTripError of
        the run. Each error carries the facts known by then as `result`; rows are written to the record file in any
        case.
        """
        return finished(self.steps(place))

    def steps(self, place: AbstractContextManager[Site], caller: Caller | None = None) -> Steps[Result]:
        """Run the plan as `render` does; with a `caller`, pause once the run is confirmed, and after each period."""
        with ended_by_signals() as ending:
            if caller is not None and caller.leaving is not None:
                ending.unbroken = caller.leaving
            return (yield from self._steps(place, ending, caller))

    def _steps(self, place: AbstractContextManager[Site], ending: EndSignals, caller: Caller | None) -> Steps[Result]:
        plan, duration = self.plan, self.duration
        cycles = max(1, round(duration * plan.rate))
        cycle, report = Cycle(plan), LoopReport()
        # The record has room for the periods until the drives are enabled.
        enabling = min(LONGEST_RECORD, math.ceil(enabling_time(plan) * plan.rate))
        room = min(cycles, ROWS_NEEDED if plan.simulated else LONGEST_RECORD) + enabling + 1
        record = self.kept = Record(columns(plan), room)
        if self.live is not None:
            self.live.follow(plan, record)
        earlier = set_aside(self.record)
        try:
            self._keep_provenance()
            rows = Rows(record, self.record, simulated=plan.simulated, provenance=self.provenance)
        except (OSError, UsageError) as error:
            put_back(earlier)
            if isinstance(error, UsageError):
                raise
            raise UsageError(f"cannot record to {self.record}: {error.strerror}") from error
        assessment: Assessment | None = None
        faults: list[str] = []
        started = perf_counter()
        try:
            with self._accounted(report, cycle, caller), place as site, _rights(plan) as self._host:
                faults = site.faults
                self._bus = bus = next(iter(site.buses.values())) if len(site.buses) == 1 else BusGroup(site.buses)
                run = Run(plan, self.bus_name, cycle, record, report, site.worlds, site.clock.name, cycles, site.hand)
                assessment = Assessment(run)
                with _freed(bus, ending):
                    leading = self._leading = None if self.led is None else self.led(site.worlds)
                    if self.live is not None:
                        self.live.begin(plan, cycle, report, leading, ending)
                    if leading is not None:
                        record.followers.append(lambda row: leading.act(cycle.axes, plan.period))
                    due = self._confirmed(bus)
                    if caller is not None:
                        yield
                        if caller.stopping:
                            return self._told_with(known_before(plan, self.bus_name, report))
                    self._start(bus, site.clock, due, ending)
                    ending.hold()
                    self.report, self.cycle = report, cycle
                    followed = self._followed(rows, assessment, cycle, cycles)
                    yield from loop_steps(
                        plan, cycle, bus, site.clock, cycles=cycles, record=record, progress=followed, report=report,
                        changes=self.changes, ending=ending, caller=caller,
                    )  # fmt: skip
        except KeyboardInterrupt as early:
            ending.hold()
            report.interrupted = True
            stopped = ending.stopped(report, duration)
            known, traces = known_before(plan, self.bus_name, report), _traces(plan, record, report)
            result = self._told_with(replace(known, stopped=stopped, traces=traces))
            if UNCONFIRMED not in getattr(early, "__notes__", ()):
                return result
            unconfirmed = BusError(UNCONFIRMED)
            unconfirmed.result = result
            raise unconfirmed from early
        except HapticFieldbusError as error:
            # A run that fails has a result too: the command line prints it beside the error.
            known = known_before(plan, self.bus_name, report, cycle.trip, str(error))
            seen = tuple(passivities(plan, cycle, report.cycles))
            traces = _traces(plan, record, report)
            known = replace(known, passivity=seen, stopped=ending.stopped(report, duration), traces=traces)
            try:
                known = replace(known, warnings=tuple(notices(plan, cycle, report)))
                known = known if assessment is None else assessment.with_travel(known)
            except Exception as again:  # of a law that fails here too
                known = replace(known, warnings=(f"the result is incomplete: {type(again).__name__}: {again}",))
            error.result = self._told_with(known)
            raise
        finally:
            rows.close(self.provenance)
            # A recording of frames tells why it ended before the run; else that of rows does.
            faults = [*faults, *([] if rows.fault is None else [rows.fault.strerror or str(rows.fault)])]
            if not faults:
                self._keep_count()
            put_back(earlier, is_replaced=report.enabled_at_ns is not None)
            if report.released:
                ending.freed()
        stopped = ending.stopped(report, duration)
        result = assessment.finish(perf_counter() - started)
        told = [f"the recording {self.record} ended before the run: {fault}" for fault in faults[:1]]
        fault = faults[0] if faults else None
        if self.looks_back and report.enabled_at_ns is not None:
            from haptic_fieldbus.assessing.looking_back import contradictions, noted

            told += noted(plan, contradictions(plan, record, report.enabled_at_ns))
        warnings = (*told, *result.warnings)
        return self._told_with(replace(result, recording_fault=fault, stopped=stopped, warnings=warnings))

    def _told_with(self, result: Result) -> Result:
        """Return a result with the facts known before; its warnings follow those of bus and watchdogs."""
        earlier = () if self._bus is None else self._bus.warnings
        warnings = (*earlier, *self._warnings, *result.warnings)
        known = replace(result, proofs=self._proofs, host=self._host, provenance=self.provenance)
        return replace(known, warnings=warnings, drawing=self.drawing)

    @contextmanager
    def _accounted(self, report: LoopReport, cycle: Cycle, caller: Caller | None) -> Iterator[None]:
        """Complete provenance and warnings after the block, however it ends, before any result is made of them."""
        try:
            yield
        finally:
            if caller is not None:
                self._warnings += caller.slow_on(self.plan, report)
            if self.provenance is not None:
                self._complete(self.provenance, report, cycle, stepped=caller is not None)

    def _complete(self, provenance: Provenance, report: LoopReport, cycle: Cycle, *, stepped: bool) -> None:
        """Add what only the run could tell to its provenance: drives, changes, and its length if it stopped."""
        facts = {} if self._bus is None else self._bus.facts
        drives = {name: {"title": each.title, **vars(each.identity)} for name, each in facts.items()}
        changes = [(each.due, each.change.settings) for each in report.changes]
        early = 0 < report.cycles < max(1, round(self.duration * self.plan.rate)) and cycle.trip is None
        periods = report.cycles if early and (stepped or report.interrupted) else None
        led = () if self._leading is None else self._leading.acted
        self.provenance = replace(provenance.ended(periods, changes, led=led), drives=drives)
        try:
            self._keep_provenance()
        except OSError as error:
            told = "could not be completed; it holds only what was known before the run"
            self._warnings.append(f"the provenance beside {self.record} {told}: {error.strerror or error}")

    def _keep_provenance(self) -> None:
        """Write the provenance beside a record whose format cannot hold it; raises OSError."""
        if self.provenance is not None and self.record is not None and self.record.suffix != ".mcap":
            write_beside(self.record, self.provenance)

    def _keep_count(self) -> None:
        """Write the number of rows or frames beside a record that is complete; without it, it counts as cut off."""
        if self.provenance is None or self.record is None or self.record.suffix not in COUNTED:
            return
        with suppress(OSError), self.record.open("rb") as file:
            lines = sum(chunk.count(b"\n") for chunk in iter(lambda: file.read(1 << 20), b""))
            write_beside(self.record, self.provenance, lines - (self.record.suffix in ROW_SUFFIXES))

    def _confirmed(self, bus: Bus) -> dict[str, str]:
        """Inspect the drives without writing to them, ask, and return the axes whose watchdogs are due.

        Raises UsageError, BusError or DriveFaultError.
        """
        plan = self.plan
        bus.inspect(plan, bytearray(plan.image.input_size))
        for axis in () if plan.simulated else plan.axes:
            check_measured_drive(axis.name, axis.bench, self.identities[axis.name])
        # With --prove the plan knows of no proof, so each guard has a reason.
        recorded = {axis.name: axis.rig.proved for axis in plan.axes}
        due = {} if plan.simulated and not self.prove else to_prove(plan.guards, recorded, self.identities)
        self._ask(bus, due)
        return due

    def _start(self, bus: Bus, clock: Clock, due: dict[str, str], ending: EndSignals) -> None:
        """Test the due watchdogs, confirm the direction, and configure and start the drives, torque-free.

        Raises UsageError, PlanError, RigError, BusError, DriveFaultError or SafetyTripError.
        """
        plan = self.plan
        if due:
            from haptic_fieldbus.running import proofs

            ending.hold()
            self._proofs = proofs.prove(plan, bus, clock, due, ending)
            self._warnings += proofs.keep(plan, bus.facts, self._proofs)
            proofs.check(plan, bus.facts, self._proofs, self._warnings)
        if not plan.simulated:
            from haptic_fieldbus.running.proofs import confirm_direction

            self._warnings += confirm_direction(plan, bus, clock, self.instruct, ending)
        bus.configure(plan)
        bus.start()

    @property
    def identities(self) -> dict[str, Identity]:
        """The drives of the axes, after they were inspected; without numbers for a drive that told none."""
        facts = {} if self._bus is None else self._bus.facts
        return {axis.name: facts[axis.name].identity if axis.name in facts else Identity() for axis in self.plan.axes}

    def _ask(self, bus: Bus, due: Mapping[str, str]) -> None:
        """Ask for confirmation before torque is enabled on a real bus; raises UsageError without it."""
        plan = self.plan
        if plan.simulated:
            return
        heard = dict.fromkeys(facts.listened for facts in bus.facts.values() if facts.listened)
        proved: Iterable[str] = ()
        if due:
            from haptic_fieldbus.running.proofs import questions

            proved = questions(plan, due)
        unseen = [f"Not detected: {text}." for axis in plan.axes if (text := unseen_text(axis, plan.period))]
        question = "\n".join(
            [*heard, *unseen, *proved, *(_warning(plan, name, bus) for name in bus.facts), "Enable torque?"]
        )
        if not agreed(self.confirm, question):
            raise UsageError("not enabled: a real drive needs a confirmation (add --yes in scripts)")

    def _followed(self, rows: Rows, assessment: Assessment, cycle: Cycle, cycles: int) -> Callable[[int], None]:
        """Return the function that the loop calls about ten times a second.

        It records, assesses, and reports progress. It asks a person once to release a handle if its motor direction
        could not be confirmed.
        """
        hidden = {axis.name for axis in self.plan.axes if not axis.sign_known}

        def follow(done: int) -> None:
            rows.flush()
            assessment.advance()
            for name in [name for name in hidden if cycle.axes[name].sign.unseen]:
                hidden.discard(name)
                if self.instruct is not None:
                    self.instruct(f"axis {name}: release the handle for the motor direction check\n")
            if self.progress is not None:
                self.progress(done, cycles)

        return follow


def _traces(plan: Plan, record: Record, report: LoopReport) -> tuple[Trace, ...]:
    """Return the traces of a run that ended early; none if no drive was enabled."""
    found = tuple(recorded_trace(axis, record, report) for axis in plan.axes)
    return found if len(found[0].times) else ()


def agreed(confirm: Callable[[str], bool] | None, question: str) -> bool:
    """Ask and return whether the answer is True; raises TypeError for one that is no bool, such as a typed "n"."""
    answer = False if confirm is None else confirm(question)
    if not isinstance(answer, bool | np.bool_):
        raise wrong_kind("answer of confirm()", "True or False", answer)
    return bool(answer)


@contextmanager
def _freed(bus: Bus, ending: EndSignals) -> Iterator[None]:
    """Stop the drives if the block fails, with a note if one did not confirm it, and leave the bus."""
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


def _warning(plan: Plan, name: str, bus: Bus) -> str:
    """Return the sentence about one axis for the confirmation: drive, bus, limits, reaction to a link loss."""
    axis = next(axis for axis in plan.axes if axis.name == name)
    facts = bus.facts[name]
    share, probe = axis.limits.effort / axis.rated_effort, sign_probe(axis, plan.period)
    number = facts.identity.serial
    serial = "" if number is None else f" (serial {number:#010x})"
    return (
        f"about to enable torque on {facts.title}, node {facts.node}, {plan.rig.bus[axis.rig.bus].channel}{serial}: "
        f"at most {percent(share)} of rated torque, {rounded(axis.limits.speed)} {axis.workspace.length_unit}/s; "
        f"{'. '.join((f'{facts.link_loss}, read back from the drive', *facts.changes))}."
        f"{'' if probe is None else f' First, {sign_text(axis, probe)}.'}"
    )
