"""Measurement of the shaft of a bench: two experiments on its drive, each a run with all guards, and the fit between.

The motor is off before, between and after the experiments. Values are at the motor shaft and SI, as in a rig.
"""

import math
from collections.abc import Callable, Collection, Mapping
from contextlib import AbstractContextManager
from dataclasses import KW_ONLY, dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from haptic_fieldbus.api import Trial, prepare_run, stability
from haptic_fieldbus.assessing.looking_back import shaft_record_of
from haptic_fieldbus.cycle.cycle import Cycle
from haptic_fieldbus.cycle.safety import TripKind
from haptic_fieldbus.defaults import DEFAULT_SEED
from haptic_fieldbus.documents.edits import table_text, table_values, write_table
from haptic_fieldbus.drive.rig import MECHANICAL, Identified, Rig, RigAxis
from haptic_fieldbus.errors import HapticFieldbusError, SafetyTripError, UsageError, raise_all
from haptic_fieldbus.identification import GUARDED, Announcement, IdentifiedBench, interval_text
from haptic_fieldbus.identification.estimates import Estimate, scale_check
from haptic_fieldbus.identification.experiment import FEWEST_COUNTS, PARTS, Bounds, Experiment, GuidedMotion, Probe
from haptic_fieldbus.identification.fit import ENCODER_NOISE, ShaftFit, allowed_error, errors_after, fit_shaft
from haptic_fieldbus.identification.shaft import ShaftRecord
from haptic_fieldbus.identification.twin import RunFit
from haptic_fieldbus.numerals import in_unit, rounded
from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.planning.axis_plan import AxisPlan
from haptic_fieldbus.planning.known_bench import KnownBench, digest_with, known_bench, only_simulated, scaling_of
from haptic_fieldbus.planning.limits import SPEED_LIMIT
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.planning.request import Task, check_request
from haptic_fieldbus.planning.selection import load
from haptic_fieldbus.planning.sign_probe import sign_probe
from haptic_fieldbus.protocols.catalogue import load_rig
from haptic_fieldbus.running.ending import ended_by_signals
from haptic_fieldbus.running.loop import Caller
from haptic_fieldbus.running.session import Session, Site
from haptic_fieldbus.scenes.element import Element, Law
from haptic_fieldbus.scenes.scene import Scene, SceneAxis
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.signals import Signal

NAME = "identify"
"""Name of the scene and of its element."""
EFFORT_SHARE = 0.25
"""Largest effort, as a share of rated effort."""
TRAVELS_PER_SECOND = 4.0
"""Largest speed, in travels a second."""
LONGEST_TRAVEL = 12.0 * math.pi
"""Longest travel at the motor shaft [rad]; a longer one is not needed."""
TURNS_WITHOUT_LIMITS = 1.0
"""Travel of a rig without position limits, in turns of the motor."""
MARGIN = 0.06
"""Part of the travel at each of its ends that an experiment does not plan to use."""
COUNTS_OF_NOISE = 3.0
"""Counts in a period that a coarse encoder may show beyond the motion; the run would trip at such a speed."""
FADE_IN = 0.2
"""[s]"""
LONGEST = 300.0
"""Longest time of one experiment [s]."""
KEPT = ("inertia", "viscous_damping", "coulomb_friction", "delay_and_lag", "torque_lag")
"""Values that a rig keeps."""
CHECK_WORSE = 2.0
"""Prediction error of the unused part of the record, as a multiple of that of the fit, from which on it is told, if it
is more than the intervals of the values allow."""
LEADING_SHARE = 2.0
"""Half width of the interval of the first inertia, of its value, up to which it may lead the motion."""
Question = Callable[[str], bool]
Tell = Callable[[str], None]


@dataclass(frozen=True)
class BenchTask:
    """Request of a caller: the axis of a rig, and bounds for its motion."""

    rig: str | Path | Rig
    _: KW_ONLY
    axis: str | None = None
    """Name of the axis; None: the only one of the rig."""
    bus: str | None = None
    """Bus in the place of that of the rig, such as sim."""
    rate: float | None = None
    """[Hz]"""
    travel: float | None = None
    """Travel of the handle [m or rad]; None: the position limits of the rig, or a turn of the motor."""
    effort: float | None = None
    """Largest effort [N or N·m]; None: a quarter of the rated effort."""
    speed: float | None = None
    """Largest speed [m/s or rad/s], at 0.9 of which a run trips; None: four travels a second and `COUNTS_OF_NOISE`."""
    with_mass: float | None = None
    """Known mass that was fixed to a linear handle after the last measurement [kg]; the rig is then only checked."""
    with_inertia: float | None = None
    """The same for a rotary handle [kg·m²]."""
    skip: Collection[str] = ()
    """Parts that are left out: rest, friction (the breakaway), or dynamics, without which nothing is written."""
    profiles: str | Path | None = None
    seed: int = DEFAULT_SEED


@dataclass(frozen=True)
class MeasuringLaw:
    """The law of an experiment as an element of a scene; it gives nothing until the experiment is armed."""

    axis: str
    experiment: Experiment
    strongest: float
    """Largest effort of this active element [N or N·m]."""
    name: str = NAME

    @property
    def needs(self) -> tuple[Signal, ...]:
        return (Signal.POSITION,)

    def begin(self, period: float) -> Law:
        """Return the law of the position."""
        return lambda position: self.experiment.effort(position) if self.experiment.armed else 0.0

    def linearised(self) -> StateSpace:
        return gain([[0.0, 0.0]])


@dataclass(frozen=True)
class IdentifyingLaw(MeasuringLaw):
    """The law of an experiment of `identify`, whose own options bound the motion."""

    def remedy(self, kind: TripKind) -> str:
        """Return the advice on a trip of this kind; empty where that of every run is right."""
        free, limits = "Keep hands off the handle. If it was free:", f"axis.{self.axis}.limits"
        return {
            TripKind.SPEED: f"{free} lower --effort, or raise --speed, up to {limits}.speed of the rig.",
            TripKind.POWER: f"{free} lower --effort or --speed, or raise {limits}.power in the rig.",
            TripKind.POSITION: f"{free} lower --effort, or raise --travel, up to {limits}.position of the rig.",
        }.get(kind, "")


def identify(
    task: BenchTask,
    *,
    confirm: Question | None = None,
    instruct: Tell | None = None,
    announce: Callable[[Announcement], None] | None = None,
    progress: Tell | None = None,
    write: bool = True,
) -> IdentifiedBench:
    """Measure an axis, and write its values into the rig file unless `write` is False or the bus is replaced.

    `announce` is called before any bus is opened, `progress` with the name of each stage. Raises DocumentError,
    UsageError, PlanError, and as a run BusError, DriveFaultError or SafetyTripError; the motor is off by then.
    """
    bench, tell = _Bench(task, confirm, instruct), progress or (lambda stage: None)
    if announce is not None:
        announce(bench.announced)
    ratio, bounds, first = bench.axis.mechanism.ratio, bench.bounds, Probe(bench.bounds, task.skip)
    probe, _ = bench.conducted(first, tell)
    breakaway = {name: (ratio * low, ratio * high) for name, (low, high) in first.breakaway.items()}
    unseen = ("rest: skipped, so a weight that falls was not looked for",) if "rest" in task.skip else ()
    found = IdentifiedBench(bench.announced, 1.0 / bounds.period, bench.stated, (probe,), breakaway, unseen)
    if "dynamics" in task.skip:
        return found.with_warnings("dynamics: skipped, so nothing is written into the rig, and the limit is as before")
    led = _first_fit(probe)
    guess, damping = led.model, led.values["viscous_damping"].low
    mass, friction, load = guess.inertia / ratio**2, guess.coulomb / ratio, guess.load / ratio
    motion = GuidedMotion(bounds, mass, friction, load, guess.delay + guess.lag, damping / ratio**2)
    record, stages = bench.conducted(motion, tell)
    begins = {stage: stages.index(stage) for stage in ("motion", "check")}
    used, rest = (record.part(begin, begin + stages.count(stage)) for stage, begin in begins.items())
    if (moved := float(np.ptp(used.positions)) / used.resolution) < FEWEST_COUNTS:
        raise SafetyTripError(
            f"the handle stuck in the slow motion: it moved by {rounded(moved)} counts of its encoder, which tells no "
            "values; torque is off. Keep hands off the handle. If it was free, its friction at rest is too large for "
            "this motion: lower the friction"
        )
    tell("fit")
    fit = fit_shaft([probe, used], guess)
    check = float(np.sqrt(np.mean(errors_after(fit.model, used, rest) ** 2)))
    found = replace(found, fit=fit, check=check, records=(probe, used, rest)).with_warnings(*fit.warnings)
    if check > max(CHECK_WORSE * max(fit.residual, ENCODER_NOISE), allowed_error(fit, rest)):
        found = found.with_warnings(
            f"the motion that was fitted is explained to {rounded(fit.residual)} counts, but one with other "
            f"oscillations is predicted to {rounded(check)} counts only: the values may not hold for other motions"
        )
    if bench.without is not None:
        gear = getattr(bench.axis.mechanism, "gear_ratio", None)
        return replace(found, scale=scale_check(bench.without, fit.values["inertia"], bench.added * ratio**2, gear))
    found = found.with_warnings(*(
        f"{name}: the rig states {in_unit(value, each.unit)}, measured {interval_text(each)}"
        for name, value in bench.stated.items()
        if value is not None and not (each := fit.values[name]).low <= value <= each.high
    ))  # fmt: skip
    plan, name, source = bench.planned, bench.announced.axis, bench.rig.source
    kept = identified_of(
        fit, bench.axis, profile=plan.profile.name, rate=found.rate, serial=bench.serial,
        planned_delay=float(f"{plan.delay.transport + plan.delay.torque_loop:.6g}"), axis=name,
        simulated=only_simulated(bench.bus), bus=bench.bus.route, units=scaling_of(plan.profile),
    )  # fmt: skip
    if write and task.bus is None and source:
        path, values = ("axis", name, "identified"), table_values(kept)
        if why := write_table(source, path, values):
            by_hand = f"To add them by hand:\n{table_text(path, values)}"
            found = found.with_warnings(f"the values were not saved in {source}: {why}. {by_hand}")
        else:
            found = replace(found, written=source)
    if fit.resonance:
        return found.with_warnings(
            "no limit of a rigid shaft holds for an elastic one: without simulation.coupling a run needs --force"
        )
    try:
        return replace(found, limit=bench.limit(kept))
    except HapticFieldbusError as error:  # what was measured is told all the same
        return found.with_warnings(f"no limit is known: {error}")


def bounds_of(task: BenchTask) -> Announcement:
    """Return what `identify` would announce; nothing is opened. Raises DocumentError, UsageError or PlanError."""
    return _Bench(task).announced


class _Bench:
    """The axis of a task, its bounds, and its runs."""

    def __init__(self, task: BenchTask, confirm: Question | None = None, instruct: Tell | None = None) -> None:
        self._task, self._confirm, self._instruct = task, confirm, instruct
        check_request(rate=task.rate, seed=task.seed)
        _check_skipped(task)
        rig, self._name = _one_axis(task)
        # An earlier measurement leads nothing: the bench may be another one since.
        self.axis = axis = replace(rig.axis[self._name], identified=Identified())
        self.rig = replace(rig, bus={axis.bus: rig.bus[axis.bus]}, axis={self._name: axis})
        self.stated = {key: getattr(axis, key) for key in MECHANICAL}
        plan = self._plan(axis)
        self.planned, self.bus = plan.axes[0], plan.rig.bus[axis.bus]
        earlier = known_bench(replace(rig, bus=rig.bus | {axis.bus: self.bus}), self._name, self.planned.profile)
        self.without, self.added = _without_mass(task, self._name, rig.axis[self._name], earlier)
        self.serial: int | None = None
        self.announced = told = _announced(task, self.planned, plan.period)
        speed, travel = told.guarded_speed, told.high - told.low
        limits = replace(axis.limits, position=(told.low, told.high), speed=speed, effort=told.effort)
        # The bounds of the experiments follow from what a person stated and knows.
        self._bounded = replace(axis, limits=limits, i_know=(*axis.i_know, "limits.effort", "limits.speed"))
        acceleration = self._plan(self._bounded).axes[0].limits.acceleration
        self.bounds = Bounds(
            plan.period, self.planned.resolution, told.low + MARGIN * travel, told.high - MARGIN * travel,
            GUARDED * min(told.speed, TRAVELS_PER_SECOND * travel), told.effort, acceleration,
        )  # fmt: skip

    def _scene(self, title: str, element: Element) -> Scene:
        """Return a scene of the axis with one element."""
        return Scene(NAME, title, (SceneAxis(self._name, self.axis.mechanism.workspace),), (element,))

    def _task_with(self, axis: RigAxis, experiment: Experiment, effort: float) -> Task:
        scene = self._scene("Measures the bench", IdentifyingLaw(self._name, experiment, effort))
        rig, task = replace(self.rig, axis={self._name: axis}), self._task
        return Task(scene, rig, rate=task.rate, bus=task.bus, profiles=task.profiles)

    def _plan(self, axis: RigAxis) -> Plan:
        """Return the plan of the axis under a law without force."""
        nothing = Bounds(1e-3, 1e-6, -1.0, 1.0, 1.0, 1.0, math.inf)
        return load(self._task_with(axis, Probe(nothing), 0.0)).plan

    def conducted(self, experiment: Experiment, tell: Tell) -> tuple[ShaftRecord, list[str]]:
        """Conduct an experiment in a run of its own; return the record at the shaft and the stage of each sample.

        `tell` gets the name of each stage; missing samples are drawn as straight lines. Raises SafetyTripError with the
        reason when the experiment ended early or when more than one sample in a hundred is missing, KeyboardInterrupt
        when a signal ended it, and the errors of a run.
        """
        task = self._task_with(self._bounded, experiment, self.announced.effort)
        # Without a stated bench the run is one without a limit, with the cap of such a run.
        unknown = any(each is None for each in self.stated.values())
        trial = Trial(
            duration=LONGEST, hand="none", fade_in=FADE_IN, seed=self._task.seed, force=unknown, confirm=self._confirm,
            instruct=self._instruct,
        )  # fmt: skip
        rows, told, has_begun = list[tuple[int, float, float, str]](), "", False

        def watch(session: Session) -> bool:
            """Note time [ns], position, effort and stage of a sample; return True when the run is to end."""
            nonlocal told, has_begun
            cycle = session.cycle
            if cycle is None or not (has_begun or has_faded_in(cycle, self._name)):
                return False
            state, stage = cycle.axes[self._name].state, experiment.stage
            if has_begun and state.steps:
                rows.append((cycle.t_ns, state.position, state.target * self.planned.effort_unit, stage))
            if stage != told:
                tell(stage)
            told, has_begun, experiment.armed = stage, True, not experiment.done
            return experiment.done

        session = conduct(*prepare_run(task, trial), watch)
        if not session.plan.simulated:  # a simulated drive draws its number
            self.serial = session.identities[self._name].serial
        if experiment.failure:
            raise SafetyTripError(f"{experiment.failure}; torque is off")
        if not experiment.done:
            raise SafetyTripError("the experiment was ended before its last stage; torque is off")
        *columns, stages = zip(*rows, strict=True)
        period, resolution, ratio = self.bounds.period, self.bounds.resolution, self.axis.mechanism.ratio
        record, held = shaft_record_of(*map(np.array, columns), period=period, resolution=resolution, ratio=ratio)
        if (missing := 1.0 - len(stages) / len(held)) > 0.01:
            lost = f"{rounded(100.0 * missing)} % of the samples are missing; torque is off"
            raise SafetyTripError(f"{lost}. Free computer and bus of other work, or lower --rate")
        return record, [stages[each] for each in held]

    def limit(self, kept: Identified) -> tuple[float, str, str] | None:
        """Return the limit of a wall on the measured bench, its unit and its basis; None where it has none."""
        scene, task = self._scene("A wall", Wall(self._name, 1.0, self.bounds.middle)), self._task
        rig = replace(self.rig, axis={self._name: replace(self.axis, identified=kept)})
        judged = stability(scene, rig, rate=task.rate, bus=task.bus, profiles=task.profiles)
        found = judged.limit
        return (found.value, judged.unit, found.basis.value) if math.isfinite(found.value) else None


OFF = "; the motor is off"
"""End of the sentence about a signal, which may come in any run of several, or between two of them."""


def conduct(session: Session, place: AbstractContextManager[Site], watch: Callable[[Session], bool]) -> Session:
    """Conduct a run, and return it; after each period `watch` gets it, and returns whether it is to end.

    Raises KeyboardInterrupt when a signal ended it, the errors of a run, and what `watch` raises. By then the motor is
    off.
    """
    caller = Caller()
    steps = session.steps(place, caller)
    try:
        try:
            while True:
                next(steps)
                caller.stopping = watch(session)
        except StopIteration:
            raise
        except BaseException as error:
            steps.throw(error)  # ends a run that has paused; one that has ended raises the error again
            raise
    except StopIteration as ended:
        if ended.value is not None and ended.value.stopped is not None:
            raise KeyboardInterrupt from None
    finally:
        with ended_by_signals() as ending:  # those of the command, which makes several runs
            ending.when = OFF
    ending.resume()  # neither a fit nor another run goes on after a signal that a run has noted
    return session


def has_faded_in(cycle: Cycle, axis: str) -> bool:
    """Return whether the force of an axis has risen to its limit."""
    permitted = cycle.axes[axis].state.permitted_ns
    return permitted is not None and cycle.t_ns - permitted >= 1e9 * FADE_IN


def _one_axis(task: BenchTask) -> tuple[Rig, str]:
    """Return the rig, and the name of the axis; raises DocumentError or UsageError."""
    rig = task.rig if isinstance(task.rig, Rig) else load_rig(task.rig, task.profiles)
    names = ", ".join(rig.axis)
    if task.axis is None and len(rig.axis) > 1:
        raise UsageError(f"the rig has several axes; name one with --axis: {names}")
    name = task.axis or next(iter(rig.axis))
    if name not in rig.axis:
        raise UsageError(f'--axis "{name}": expected an axis of the rig: {names}')
    return rig, name


def _check_skipped(task: BenchTask) -> None:
    """Raise UsageError when a part cannot be skipped."""
    wrong = [f"--skip {each}: expected one of {', '.join(PARTS)}" for each in task.skip if each not in PARTS]
    if {"friction", "dynamics"} <= set(task.skip):
        wrong.append("--skip friction and --skip dynamics: nothing would be measured")
    if "dynamics" in task.skip and (task.with_mass, task.with_inertia) != (None, None):
        wrong.append("--skip dynamics: expected without an added mass, whose inertia would not be measured")
    raise_all(wrong)


def _without_mass(task: BenchTask, name: str, axis: RigAxis, earlier: KnownBench) -> tuple[Estimate | None, float]:
    """Return the inertia that was measured without the added mass, and that mass; None: no mass was added.

    Raises UsageError, also where the values of `earlier` do not count on this bench.
    """
    given = {"--with-mass": task.with_mass, "--with-inertia": task.with_inertia}
    named = {key: each for key, each in given.items() if each is not None}
    if not named:
        return None, 0.0
    wanted, unit = ("--with-mass", "kg") if axis.mechanism.kind == "linear" else ("--with-inertia", "kg·m²")
    if list(named) != [wanted]:
        raise UsageError(
            f"{' and '.join(named)}: expected {wanted} alone, in {unit}: axis {name} is {axis.mechanism.kind}"
        )
    added, before = named[wanted], axis.identified
    if not 0.0 < added < math.inf:
        raise UsageError(f"{wanted} {added}: expected a finite number above 0")
    if earlier.fault or before.digest is None or before.inertia is None or before.inertia_interval is None:
        why = f" ({earlier.fault})" if earlier.fault else ""
        raise UsageError(
            f"{wanted}: the rig has no valid measurement without the mass{why}; run identify without it first"
        )
    return Estimate(before.inertia, *before.inertia_interval, "kg·m²"), added


def _announced(task: BenchTask, plan: AxisPlan, period: float) -> Announcement:
    """Return the bounds of the experiments: those of the task inside those of the rig; raises UsageError."""
    given = {"travel": task.travel, "effort": task.effort, "speed": task.speed}
    raise_all([
        f"--{key} {each}: expected a number above 0"
        for key, each in given.items()
        if each is not None and not each > 0.0
    ])  # fmt: skip
    low, high = _travel(task, plan.rig)
    mechanism, probe = plan.rig.mechanism, sign_probe(plan, period)
    effort = min(task.effort or EFFORT_SHARE * plan.rated_effort, plan.limits.effort)
    usual = TRAVELS_PER_SECOND * (high - low) + COUNTS_OF_NOISE * plan.resolution / period
    speed = min(task.speed or usual, plan.rig.limits.speed or SPEED_LIMIT[mechanism.kind])
    return Announcement(
        plan.name, low, high, speed, effort, effort * mechanism.ratio, mechanism.workspace, effort / plan.rated_effort,
        probe.largest if probe else 0.0, mechanism.zero == "start", task.skip,
    )  # fmt: skip


def _travel(task: BenchTask, axis: RigAxis) -> tuple[float, float]:
    """Return the travel [m or rad] within the position limits of the rig: around the handle, or around their middle."""
    limits, ratio = axis.limits.position, axis.mechanism.ratio
    if limits is None and axis.mechanism.zero != "start":
        raise UsageError("the rig has an encoder count as zero and no limits.position; state limits.position")
    half = 0.5 * (task.travel or TURNS_WITHOUT_LIMITS * 2.0 * math.pi * ratio)
    low, high = limits or (-half, half)
    wanted = min(high - low, task.travel or math.inf, LONGEST_TRAVEL * ratio)
    if axis.mechanism.zero != "start":
        middle = 0.5 * (low + high)
        return middle - 0.5 * wanted, middle + 0.5 * wanted
    first = min(max(-0.5 * wanted, low), high - wanted)
    if not first + MARGIN * wanted < 0.0 < first + (1.0 - MARGIN) * wanted:
        unit = axis.mechanism.workspace.length_unit
        raise UsageError(
            f"limits.position of the rig goes from {in_unit(low, unit)} to {in_unit(high, unit)}, and the handle is at "
            "0 when the drive is enabled; expected room to both sides. State an encoder count as mechanism.zero, or "
            "limits around 0"
        )
    return first, first + wanted


def _first_fit(probe: ShaftRecord) -> ShaftFit:
    """Return the fit by which the motion is led; raises SafetyTripError when the probe does not tell one."""
    try:
        fit = fit_shaft([probe])
    except ValueError as error:
        raise SafetyTripError(f"{error}; torque is off") from error
    inertia = fit.values["inertia"]
    if not inertia.half_width < LEADING_SHARE * inertia.value:
        raise SafetyTripError(
            "the pulses moved the handle by too few counts of its encoder to tell its inertia; torque is off. Raise "
            "--travel, --speed or --effort, or the rate"
        )
    return fit


# The rig file.


def identified_of(fit: ShaftFit, axis: RigAxis, /, **conditions: str | float | int | None) -> Identified:
    """Return what a rig keeps of a fit: its values, or its resonance; `conditions` are more keys of `Identified`."""
    resonance = float(f"{fit.resonance.value:.4g}") if fit.resonance else None
    date = datetime.now().astimezone().isoformat(timespec="seconds")
    names = () if fit.resonance else KEPT
    kept = told_by(fit, dict.fromkeys(names, 1.0), resonance=resonance, date=date, **conditions)
    return replace(kept, digest=digest_with(axis, kept))


def told_by(fit: ShaftFit | RunFit, scales: Mapping[str, float], **conditions: Any) -> Identified:
    """Return values of a fit with six digits, each over its scale; `conditions` are more keys of `Identified`."""
    kept: dict[str, Any] = {}
    for name, scale in scales.items():
        each = fit.values[name]
        low, value, high = (float(f"{number / scale:.6g}") for number in (each.low, each.value, each.high))
        kept |= {name: value, f"{name}_interval": (low, high)}
    top_speed, residual = float(f"{fit.top_speed:.4g}"), float(f"{fit.residual:.3g}")
    return Identified(**kept, **conditions, top_speed=top_speed, residual_counts=residual)
