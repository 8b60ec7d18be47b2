"""Measurement of the shaft of a bench: two experiments on its drive, each a run with all guards, and the fit between.

The motor is off before, between and after the experiments. Values are at the motor shaft and SI, as in a rig.
"""

import math
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import KW_ONLY, dataclass, fields, replace
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from haptic_fieldbus.api import Trial, prepare_run, stability
from haptic_fieldbus.defaults import DEFAULT_SEED
from haptic_fieldbus.documents.edits import Value, edit_file, table_text, with_table
from haptic_fieldbus.drive.rig import MECHANICAL, Identified, Rig, RigAxis, RotaryMechanism
from haptic_fieldbus.errors import HapticFieldbusError, SafetyTripError, UsageError
from haptic_fieldbus.identification import Announcement, IdentifiedBench, interval_text
from haptic_fieldbus.identification.experiment import PARTS, Bounds, Experiment, GuidedMotion, Probe
from haptic_fieldbus.identification.fit import Estimate, ShaftFit, ShaftRecord, fit_shaft, prediction_errors
from haptic_fieldbus.identification.scale import ScaleCheck, scale_check
from haptic_fieldbus.identification.shaft import ShaftModel
from haptic_fieldbus.numerals import in_unit, rounded
from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.planning.axis_plan import AxisPlan
from haptic_fieldbus.planning.known_bench import digest_with
from haptic_fieldbus.planning.limits import SPEED_LIMIT
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.planning.request import Task
from haptic_fieldbus.planning.selection import load
from haptic_fieldbus.protocols.catalogue import load_rig
from haptic_fieldbus.running.loop import Caller
from haptic_fieldbus.running.session import Session
from haptic_fieldbus.scenes.element import Law
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
LEADING_SHARE = 1.0
"""Half width of the interval of the first inertia, of its value, up to which it may lead the motion."""


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
    """Largest speed [m/s or rad/s]; None: four travels a second."""
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
    """The law of an experiment as an element of a scene; it gives nothing until it is armed."""

    axis: str
    experiment: Experiment
    armed: list[bool]
    """Empty until the experiment may begin."""
    effort: float
    name: str = NAME

    @property
    def needs(self) -> tuple[Signal, ...]:
        return (Signal.POSITION,)

    @property
    def strongest(self) -> float:
        """Largest effort of this active element [N or N·m]."""
        return self.effort

    def begin(self, period: float) -> Law:
        """Return the law of the position."""
        return lambda position: self.experiment.effort(position) if self.armed else 0.0

    def linearised(self) -> StateSpace:
        return gain([[0.0, 0.0]])


def identify(
    task: BenchTask,
    *,
    confirm: Callable[[str], bool] | None = None,
    instruct: Callable[[str], None] | None = None,
    announce: Callable[[Announcement], None] | None = None,
    progress: Callable[[str], None] | None = None,
    write: bool = True,
) -> IdentifiedBench:
    """Measure an axis, and write its values into the rig file unless `write` is False or the bus is replaced.

    `announce` is called before any bus is opened, `progress` with the name of each stage. Raises DocumentError,
    UsageError, PlanError, and as a run BusError, DriveFaultError or SafetyTripError; the motor is off by then.
    """
    bench = _Bench(task, confirm, instruct, progress or (lambda stage: None))
    if announce is not None:
        announce(bench.announced)
    ratio, first = bench.ratio, Probe(bench.bounds, task.skip)
    probe, _ = bench.conducted(first)
    breakaway = {name: (ratio * low, ratio * high) for name, (low, high) in first.breakaway.items()}
    unseen = ("rest: skipped, so a weight that falls was not looked for",) if "rest" in task.skip else ()
    if "dynamics" in task.skip:
        told = "dynamics: skipped, so nothing is written into the rig, and the limit is as before"
        return IdentifiedBench(
            bench.name, None, bench.announced, 1.0 / bench.bounds.period, None, bench.stated, (probe,),
            (*unseen, told), breakaway,
        )  # fmt: skip
    guess = _first_model(probe)
    motion = GuidedMotion(
        bench.bounds, guess.inertia / ratio**2, guess.coulomb / ratio, guess.load / ratio, guess.delay + guess.lag
    )
    record, stages = bench.conducted(motion)
    used = _part(record, stages, "motion")
    rest = _part(record, stages, "check")
    fit = fit_shaft([probe, used], guess)
    check = float(np.sqrt(np.mean(prediction_errors(fit.model, rest) ** 2)))
    found = IdentifiedBench(
        bench.name, fit, bench.announced, 1.0 / bench.bounds.period, check, bench.stated,
        (probe, used, rest),
        (*unseen, *fit.warnings, *(() if bench.without else _contradictions(fit, bench.stated))), breakaway,
    )  # fmt: skip
    if bench.without is not None:
        return replace(found, scale=bench.scale(bench.without, fit))
    kept = identified_of(
        fit, bench.rig.axis[bench.name], profile=bench.profile, rate=found.rate, serial=bench.serial,
        planned_delay=float(f"{bench.planned_delay:.6g}"),
    )  # fmt: skip
    if write and bench.own_bus:
        found = _written(found, bench, kept)
    if fit.resonance:
        told = "no limit of a rigid shaft holds for an elastic one: without simulation.coupling a run needs --force"
        return replace(found, warnings=(*found.warnings, told))
    try:
        return replace(found, limit=bench.limit(kept))
    except HapticFieldbusError as error:  # what was measured is told all the same
        return replace(found, warnings=(*found.warnings, f"no limit is known: {error}"))


def bounds_of(task: BenchTask) -> Announcement:
    """Return what `identify` would announce; nothing is opened. Raises DocumentError, UsageError or PlanError."""
    return _Bench(task, None, None, lambda stage: None).announced


class _Bench:
    """The axis of a task, its bounds, and its runs."""

    def __init__(
        self,
        task: BenchTask,
        confirm: Callable[[str], bool] | None,
        instruct: Callable[[str], None] | None,
        progress: Callable[[str], None],
    ) -> None:
        self._task, self._confirm, self._instruct, self._progress = task, confirm, instruct, progress
        _check_skipped(task)
        self.rig, self.name = _one_axis(task)
        self.without, self._added = _without_mass(task, self.name, self.rig.axis[self.name])
        # An earlier measurement leads nothing: the bench may be another one since.
        axis = replace(self.rig.axis[self.name], identified=Identified())
        self.rig = replace(self.rig, axis={self.name: axis})
        self.ratio = axis.mechanism.ratio
        self.stated = {key: getattr(axis, key) for key in MECHANICAL}
        self.own_bus = task.bus is None and bool(self.rig.source)
        plan = self._plan(axis)
        self.profile = plan.axes[0].profile.name
        self.planned_delay = plan.axes[0].delay.transport + plan.axes[0].delay.torque_loop
        self.serial: int | None = None
        self.announced = _announced(task, self.name, axis, plan.axes[0], plan.period)
        told = self.announced
        self._limits = replace(axis.limits, position=(told.low, told.high), speed=told.speed, effort=told.effort)
        margin = MARGIN * (told.high - told.low)
        self.bounds = Bounds(
            plan.period, plan.axes[0].resolution, told.low + margin, told.high - margin,
            0.9 * min(told.speed, TRAVELS_PER_SECOND * (told.high - told.low)), told.effort,
            self._plan(self._bounded()).axes[0].limits.acceleration,
        )  # fmt: skip

    def _bounded(self) -> RigAxis:
        """Return the axis with the bounds of the experiments, which follow from what a person stated and knows."""
        axis = self.rig.axis[self.name]
        return replace(axis, limits=self._limits, i_know=(*axis.i_know, "limits.effort", "limits.speed"))

    def _task_with(self, axis: RigAxis, experiment: Experiment, armed: list[bool], effort: float) -> Task:
        law = MeasuringLaw(self.name, experiment, armed, effort)
        scene = Scene(NAME, "Measures the bench", (SceneAxis(self.name, axis.mechanism.workspace),), (law,))
        rig, task = replace(self.rig, axis={self.name: axis}), self._task
        return Task(scene, rig, rate=task.rate, bus=task.bus, profiles=task.profiles)

    def _plan(self, axis: RigAxis) -> Plan:
        """Return the plan of the axis under a law without force."""
        nothing = Bounds(1e-3, 1e-6, -1.0, 1.0, 1.0, 1.0, math.inf)
        return load(self._task_with(axis, Probe(nothing), [], 0.0)).plan

    def conducted(self, experiment: Experiment) -> tuple[ShaftRecord, list[str]]:
        """Conduct an experiment in a run of its own; return the record at the shaft and the stage of each sample.

        Raises SafetyTripError with the reason when the experiment ended early, KeyboardInterrupt when a signal ended
        it, and the errors of a run.
        """
        armed: list[bool] = []
        task = self._task_with(self._bounded(), experiment, armed, self.announced.effort)
        # Without a stated bench the run is one without a limit, with the cap of such a run.
        unknown = any(each is None for each in self.stated.values())
        trial = Trial(
            duration=LONGEST, hand="none", fade_in=FADE_IN, seed=self._task.seed, force=unknown, confirm=self._confirm,
            instruct=self._instruct,
        )  # fmt: skip
        session, place = prepare_run(task, trial)
        caller, taken = Caller(), _Taken(self, experiment, armed)
        steps = session.steps(place, caller)
        try:
            while True:
                next(steps)
                caller.stopping = taken.period(session)
        except StopIteration as ended:
            if not session.plan.simulated:  # a simulated drive draws its number
                self.serial = session.identities[self.name].serial
            if ended.value.stopped is not None:
                raise KeyboardInterrupt from None
        if experiment.failure:
            raise SafetyTripError(f"{experiment.failure}; torque is off")
        if not experiment.done:
            raise SafetyTripError("the experiment was ended before its last stage; torque is off")
        return taken.record()

    def scale(self, without: Estimate, fit: ShaftFit) -> ScaleCheck:
        """Return the check of torque, gear and counts by the added mass."""
        mechanism = self.rig.axis[self.name].mechanism
        gear = mechanism.gear_ratio if isinstance(mechanism, RotaryMechanism) else None
        return scale_check(without, fit.values["inertia"], self._added * self.ratio**2, gear)

    def limit(self, kept: Identified) -> tuple[float, str, str] | None:
        """Return the limit of a wall on the measured bench, its unit and its basis; None where it has none."""
        axis, task = replace(self.rig.axis[self.name], identified=kept), self._task
        wall = Wall(self.name, 1.0, self.bounds.middle)
        scene = Scene(NAME, "A wall", (SceneAxis(self.name, axis.mechanism.workspace),), (wall,))
        rig = replace(self.rig, axis={self.name: axis})
        judged = stability(scene, rig, rate=task.rate, bus=task.bus, profiles=task.profiles)
        found = judged.limit
        return (found.value, judged.unit, found.basis.value) if math.isfinite(found.value) else None

    def stage(self, name: str) -> None:
        """Tell that a stage has begun."""
        self._progress(name)


class _Taken:
    """Samples of one experiment, taken after each period of its run."""

    def __init__(self, bench: _Bench, experiment: Experiment, armed: list[bool]) -> None:
        self._bench, self._experiment, self._armed = bench, experiment, armed
        self._stage = ""
        self._times: list[int] = []
        self._places: list[float] = []
        self._efforts: list[float] = []
        self._stages: list[str] = []

    def period(self, session: Session) -> bool:
        """Note one period; return True when the run is to end."""
        if session.cycle is None:  # confirmed, and not yet enabled
            return False
        cycle = session.cycle
        axis, unit = cycle.axes[self._bench.name], session.plan.axes[0].effort_unit
        state = axis.state
        if not self._armed:
            permitted = state.permitted_ns
            if permitted is not None and cycle.t_ns - permitted >= 1e9 * FADE_IN:
                self._armed.append(True)
            return False
        if state.steps:
            self._times.append(cycle.t_ns)
            self._places.append(state.position)
            self._efforts.append(state.target * unit)
            self._stages.append(self._experiment.stage)
        if self._experiment.stage != self._stage:
            self._stage = self._experiment.stage
            self._bench.stage(self._stage)
        return self._experiment.done

    def record(self) -> tuple[ShaftRecord, list[str]]:
        """Return the record at the motor shaft, and its stages; missing samples are drawn as straight lines.

        Raises SafetyTripError when more than one sample in a hundred is missing.
        """
        period = self._bench.bounds.period
        first = self._times[0]
        places = np.rint((np.array(self._times) - first) / (1e9 * period)).astype(int)
        count = int(places[-1]) + 1
        if count - len(places) > 0.01 * count:
            missing = rounded(100.0 * (count - len(places)) / count)
            raise SafetyTripError(f"{missing} % of the samples are missing; torque is off")
        grid, ratio = np.arange(count), self._bench.ratio
        positions = np.interp(grid, places, self._places) / ratio
        held = np.searchsorted(places, grid, side="right") - 1
        torques = np.array(self._efforts)[held] * ratio
        resolution = self._bench.bounds.resolution / ratio
        record = ShaftRecord(period, tuple(positions.tolist()), tuple(torques.tolist()), resolution)
        return record, [self._stages[each] for each in held]


def _one_axis(task: BenchTask) -> tuple[Rig, str]:
    """Return the rig with the axis alone, and its name; raises DocumentError or UsageError."""
    rig = task.rig if isinstance(task.rig, Rig) else load_rig(task.rig, task.profiles)
    names = ", ".join(rig.axis)
    if task.axis is None and len(rig.axis) > 1:
        raise UsageError(f"the rig has several axes; name one with --axis: {names}")
    name = task.axis or next(iter(rig.axis))
    if name not in rig.axis:
        raise UsageError(f'--axis "{name}": expected an axis of the rig: {names}')
    axis = rig.axis[name]
    return replace(rig, bus={axis.bus: rig.bus[axis.bus]}, axis={name: axis}), name


def _check_skipped(task: BenchTask) -> None:
    """Raise UsageError when a part cannot be skipped."""
    wrong = [f"--skip {each}: expected one of {', '.join(PARTS)}" for each in task.skip if each not in PARTS]
    if {"friction", "dynamics"} <= set(task.skip):
        wrong.append("--skip friction and --skip dynamics: nothing would be measured")
    if "dynamics" in task.skip and (task.with_mass, task.with_inertia) != (None, None):
        wrong.append("--skip dynamics: expected without an added mass, whose inertia would not be measured")
    if wrong:
        raise UsageError("\n".join(wrong))


def _without_mass(task: BenchTask, name: str, axis: RigAxis) -> tuple[Estimate | None, float]:
    """Return the inertia that was measured without the added mass, and that mass; None: no mass was added.

    Raises UsageError.
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
    if not added > 0.0:
        raise UsageError(f"{wanted} {added}: expected a number above 0")
    if before.inertia is None or before.inertia_interval is None or before.digest != digest_with(axis, before):
        raise UsageError(f"{wanted}: the rig has no valid measurement without the mass; run identify without it first")
    return Estimate(before.inertia, *before.inertia_interval, "kg·m²"), added


def _announced(task: BenchTask, name: str, axis: RigAxis, plan: AxisPlan, period: float) -> Announcement:
    """Return the bounds of the experiments: those of the task inside those of the rig; raises UsageError."""
    given = {"travel": task.travel, "effort": task.effort, "speed": task.speed}
    expected = "expected a number above 0"
    wrong = [f"--{key} {each}: {expected}" for key, each in given.items() if each is not None and not each > 0.0]
    if wrong:
        raise UsageError("\n".join(wrong))
    low, high = _travel(task, axis)
    effort = min(task.effort or EFFORT_SHARE * plan.rated_effort, plan.limits.effort)
    highest = axis.limits.speed or SPEED_LIMIT[axis.mechanism.kind]
    noise = COUNTS_OF_NOISE * plan.resolution / period
    speed = min(task.speed or TRAVELS_PER_SECOND * (high - low) + noise, highest)
    space = axis.mechanism.workspace
    return Announcement(
        name, low, high, speed, effort, effort * axis.mechanism.ratio, space.length_unit, space.effort_unit,
        effort / plan.rated_effort, axis.mechanism.zero == "start", task.skip,
    )  # fmt: skip


def _travel(task: BenchTask, axis: RigAxis) -> tuple[float, float]:
    """Return the travel [m or rad], within the position limits of the rig and around their middle."""
    turn = 2.0 * math.pi * axis.mechanism.ratio
    limits = axis.limits.position
    if limits is None and axis.mechanism.zero != "start":
        raise UsageError("the rig has an encoder count as zero and no limits.position; state limits.position")
    low, high = limits or (-0.5 * TURNS_WITHOUT_LIMITS * turn, 0.5 * TURNS_WITHOUT_LIMITS * turn)
    if limits is None and task.travel is not None:
        low, high = -0.5 * task.travel, 0.5 * task.travel
    wanted = min(high - low, task.travel or math.inf, LONGEST_TRAVEL * axis.mechanism.ratio)
    middle = 0.5 * (low + high)
    return middle - 0.5 * wanted, middle + 0.5 * wanted


def _part(record: ShaftRecord, stages: list[str], stage: str) -> ShaftRecord:
    """Return the samples of one stage."""
    here = [number for number, each in enumerate(stages) if each == stage]
    first, last = here[0], here[-1] + 1
    return replace(record, positions=record.positions[first:last], torques=record.torques[first:last])


def _first_model(probe: ShaftRecord) -> ShaftModel:
    """Return the model by which the motion is led; raises SafetyTripError when the probe does not tell one."""
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
    return fit.model


def _contradictions(fit: ShaftFit, stated: Mapping[str, float | None]) -> Iterator[str]:
    """Yield a sentence for each value of the rig that lies outside of its interval."""
    for name, value in stated.items():
        each = fit.values[name]
        if value is None or each.low <= value <= each.high:
            continue
        yield f"{name}: the rig states {in_unit(value, each.unit)}, measured {interval_text(each)}"


# The rig file.


def identified_of(fit: ShaftFit, axis: RigAxis, **conditions: str | float | int | None) -> Identified:
    """Return what a rig keeps of a fit: its values, or its resonance; `conditions` are more keys of `Identified`."""
    values: dict[str, Any] = {"resonance": float(f"{fit.resonance.value:.4g}")} if fit.resonance else {}
    for name in () if fit.resonance else KEPT:
        each = fit.values[name]
        low, value, high = (float(f"{number:.6g}") for number in (each.low, each.value, each.high))
        values |= {name: value, f"{name}_interval": (low, high)}
    kept = Identified(
        **values, **conditions, date=datetime.now().astimezone().isoformat(timespec="seconds"),  # type: ignore[arg-type]
        top_speed=float(f"{fit.top_speed:.4g}"), residual_counts=float(f"{fit.residual:.3g}"),
    )  # fmt: skip
    return replace(kept, digest=digest_with(axis, kept))


def kept_values(kept: Identified) -> dict[str, Value]:
    """Return the keys of `[axis.NAME.identified]`."""
    told = {each.name: getattr(kept, each.name) for each in fields(kept)}
    return {key: list(value) if isinstance(value, tuple) else value for key, value in told.items() if value is not None}


def _written(found: IdentifiedBench, bench: _Bench, kept: Identified) -> IdentifiedBench:
    """Write the values into the rig file; a file that cannot be written is a warning with the table to add by hand."""
    path, values = ("axis", found.axis, "identified"), kept_values(kept)
    try:
        edit_file(bench.rig.source, partial(with_table, path=path, values=values))
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or error
        told = (
            f"the values were not saved in {bench.rig.source}: {why}. To add them by hand:\n{table_text(path, values)}"
        )
        return replace(found, warnings=(*found.warnings, told))
    return replace(found, written=bench.rig.source)
