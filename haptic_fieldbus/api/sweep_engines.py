"""Engines of a sweep: each turns points into rows, in whatever process it is called.

An engine is a pure function of its job and its points, so a row depends neither on the process that computes it nor on
the points that are computed with it. A refusal and a trip are rows: `outcome` and `message` tell of them.

`verdict` judges the loop at the values of rig and profile, as `Stability.nominal`. The points of a lone wall that
differ in its stiffness and damping alone share a plan: the matrix of a period is affine in both, and the eigenvalues of
all matrices are found in one call. Any other point costs a plan. `loop` simulates sampled loops side by side
(`numerics.batch`). `full` renders a whole simulated run.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any, cast, get_type_hints

import numpy as np
from numpy.typing import NDArray

from haptic_fieldbus.api import Trial, run_task
from haptic_fieldbus.api.stability_limits import judge_scene
from haptic_fieldbus.api.sweep_folder import NUMBERS, OUTCOMES, Columns, Rows, Value, is_value
from haptic_fieldbus.assessing.result import Result
from haptic_fieldbus.documents import suggestion
from haptic_fieldbus.documents.quantities import RANGES, Quantity
from haptic_fieldbus.drive.rig import Rig
from haptic_fieldbus.errors import (
    DriveFaultError,
    HapticFieldbusError,
    PlanError,
    SafetyTripError,
    UsageError,
    raise_all,
    wrong_kind,
)
from haptic_fieldbus.margins.closed_loop import environment_of
from haptic_fieldbus.margins.group import Group, Member
from haptic_fieldbus.margins.linear import ROUNDING
from haptic_fieldbus.margins.passivity import spread_of, weight
from haptic_fieldbus.margins.plant import quantisation_limit, sample
from haptic_fieldbus.margins.stiffness_map import ParallelStates, Places
from haptic_fieldbus.margins.verdict import AT_LIMIT, Verdict
from haptic_fieldbus.numerics import batch
from haptic_fieldbus.numerics.linear import StateSpace
from haptic_fieldbus.numerics.sampled import growth, loop_matrix, shift_mode
from haptic_fieldbus.planning.axis_plan import has_shipped_values
from haptic_fieldbus.planning.known_bench import as_stated
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.planning.request import Task, check_request
from haptic_fieldbus.planning.selection import python_value, select
from haptic_fieldbus.scenes.files import named
from haptic_fieldbus.scenes.registry import quantities
from haptic_fieldbus.scenes.scene import Scene, axes_of
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.signals import Workspace

Array = NDArray[np.float64]
Measure = Callable[[Result], Mapping[str, Any]]
"""Function from the result of a run to figures by their name: numbers, texts, True and False."""
Point = Mapping[str, Value]
"""Values of the parameters at a point."""
Row = dict[str, Any]
"""Figures of a point by their name."""

OF_TASK = ("rate", "method", "estimator")
OF_TRIAL = ("hand", "seed", "duration", "fade_in")
"""Parameters without a dot: those of any point, and those of a whole run alone."""
RIG = "rig."
"""In front of a parameter of the rig, such as rig.handle.viscous_damping."""
DONE, REFUSED, TRIPPED = OUTCOMES


@dataclass(frozen=True)
class SweepJob:
    """Common part of all points of a sweep, which goes to each process that computes some of them."""

    engine: str
    task: Task
    scene: Scene
    rig: Rig
    """Scene and rig of the task as values, since their files may change while a sweep goes on."""
    trial: Trial
    steps: int = 0
    """Periods of a simulated loop."""
    measure: Measure | None = None

    # A point: the task with its values.

    def check_names(self, names: Iterable[str]) -> None:
        """Raise one UsageError for all parameters that neither scene, rig nor engine has."""
        kinds, faults = {element.name: type(element) for element in self.scene.elements}, []
        known = OF_TASK + OF_TRIAL if self.engine == "full" else OF_TASK
        for name in names:
            try:
                if name.startswith(RIG):
                    with_rig_value(self.rig, name, None)
                elif "." in name:
                    named(name, kinds, self.scene.name)
                elif name not in known:
                    raise UsageError(
                        f"{name}: the engine {self.engine} has no such parameter; expected {', '.join(known)}, "
                        "element.parameter or rig.axis.key"
                    )
            except UsageError as error:
                faults.append(str(error).removeprefix("--set "))
        raise_all(faults)

    def whole_parameters(self, names: Iterable[str]) -> frozenset[str]:
        """Return the parameters that are whole numbers."""
        elements = {element.name: element for element in self.scene.elements}

        def is_whole(name: str) -> bool:
            first, *path = name.removeprefix(RIG).split(".")
            owner: Any = (self.rig.axis if name.startswith(RIG) else elements).get(first)
            for part in path[:-1]:
                owner = getattr(owner, part, None)
            return bool(path) and get_type_hints(type(owner)).get(path[-1]) in (int, int | None)

        return frozenset(name for name in names if name == "seed" or is_whole(name))

    def units_of_parameters(self, names: Iterable[str]) -> dict[str, str]:
        """Return the SI unit of each parameter that has one; parameters of the rig are at the motor shaft."""
        found = {"rate": "Hz", "duration": "s", "fade_in": "s"}
        spaces = {axis.name: axis.workspace for axis in self.scene.axes}
        for element in self.scene.elements:
            known = quantities(type(element)).items()
            found |= {f"{element.name}.{name}": each.unit(spaces[axes_of(element)[0]]) for name, each in known}
        return {name: found[name] for name in names if found.get(name)} | units_of_figures(spaces.values())

    def is_shipped_bench(self, names: Iterable[str]) -> bool:
        """Return whether all points are on the shipped bench, whose values are exact."""
        varied = any(name.startswith(RIG) for name in names)
        return not varied and all(has_shipped_values(self.rig, axis.name) for axis in self.scene.axes)

    def task_at(self, point: Point) -> Task:
        """Return the task of a point."""
        rig = self.rig
        for name in point:
            if name.startswith(RIG):
                rig = with_rig_value(rig, name, point[name])
        settings = {name: value for name, value in point.items() if "." in name and not name.startswith(RIG)}
        asked: dict[str, Any] = {name: value for name, value in point.items() if name in OF_TASK}
        settings = {**(self.task.settings or {}), **settings}
        return replace(self.task, scene=self.scene, rig=rig, settings=settings, **asked)


def with_rig_value(rig: Rig, name: str, value: Any) -> Rig:
    """Return the rig with another value of rig.AXIS.KEY or rig.AXIS.PART.KEY; with None the names are checked alone.

    Raises UsageError for an axis, a part or a key that the rig does not have.
    """
    axis, *path = name.removeprefix(RIG).split(".")
    if axis not in rig.axis or not path:
        raise UsageError(f"{name}: expected {RIG}AXIS.KEY with an axis of the rig{suggestion(axis, rig.axis)}")
    # What is varied is another bench than the measured one.
    whole = rig.axis[axis] if value is None else as_stated(rig.axis[axis])
    return replace(rig, axis={**rig.axis, axis: _with_value(whole, path, name, value)})


def _with_value(part: Any, path: Sequence[str], name: str, value: Any) -> Any:
    key, *rest = path
    if not is_dataclass(part) or key not in (known := [field.name for field in fields(part)]):
        near = suggestion(key, known) if is_dataclass(part) else ""
        raise UsageError(f'{name}: the rig has no "{key}" there{near}')
    if rest:
        return replace(part, **{key: _with_value(getattr(part, key), rest, name, value)})  # type: ignore[type-var]
    return part if value is None else replace(part, **{key: value})  # type: ignore[type-var]


def units_of_figures(workspaces: Iterable[Workspace]) -> dict[str, str]:
    """Return the units of the figures of `loop` and `full`; errors and excursions have none where axes differ."""
    found = {"energy_generated_j": "J", "trip_time_s": "s"}
    if len(kinds := {*workspaces}) == 1:
        (space,) = kinds
        found |= dict.fromkeys(("error_rms", "error_max"), space.effort_unit)
        found |= dict.fromkeys(("peak", "last"), space.length_unit)
    return found


def evaluate(job: SweepJob, columns: Columns) -> Rows:
    """Return the rows of some points."""
    engine, figures = ENGINES[job.engine]
    rows = engine(job, [dict(zip(columns, values, strict=True)) for values in zip(*columns.values(), strict=True)])
    names = dict.fromkeys(["outcome", "message", *figures, *(name for row in rows for name in row)])
    return {name: [row.get(name) for row in rows] for name in names}


def _refused(error: Exception) -> Row:
    return {"outcome": REFUSED, "message": str(error)}


def _done(places: Sequence[int], **figures: NDArray[Any]) -> dict[int, Row]:
    """Return the rows of points with these figures, each (n,)."""
    rows = zip(*(values.tolist() for values in figures.values()), strict=True)
    return {at: {"outcome": DONE, **dict(zip(figures, row, strict=True))} for at, row in zip(places, rows, strict=True)}


# Engine `verdict`.


def verdict_rows(job: SweepJob, points: Sequence[Point]) -> list[Row]:
    """Return verdict, growth a period, and the share of the damping of the device that passive hands need."""
    rows, shared, alone = _begun(job, points)
    for loop, stiffness, damping, places in shared:
        grown, share = loop.growth(stiffness, damping), loop.damping_share(stiffness, damping)
        verdicts = loop.verdicts(stiffness, damping, grown, share)
        rows |= _done(places, verdict=verdicts, growth=grown, damping_share=share)
    rows |= {at: _judged(job.task_at(points[at])) for at in alone}
    return [rows[at] for at in range(len(points))]


def _judged(task: Task) -> Row:
    """Return the row of a point that has a plan of its own."""
    try:
        judgement = judge_scene(task)
        loop, environment = judgement.group.loop, judgement.group.environment()
        grown, share = loop.growth(environment), loop.damping_share(environment)
        verdict = judgement.stability.nominal.value
    except (HapticFieldbusError, TypeError) as error:
        return _refused(error)
    return {"outcome": DONE, "verdict": verdict, "growth": grown, "damping_share": share}


# Points of a scene that has a wall and nothing else: one plan for all with the same rate, bench and rendering.


def _lone_wall(job: SweepJob) -> Wall | None:
    """Return the wall of a scene that has no other element; None for any other scene."""
    elements = job.scene.elements
    return elements[0] if len(elements) == 1 and type(elements[0]) is Wall and not job.task.settings else None


@dataclass(frozen=True, eq=False)
class WallLoop:
    """Common part of the verdicts of walls on one bench."""

    free: Array
    """Matrix of a period without a wall, (n, n)."""
    spring: Array
    """Its change by a stiffness of 1."""
    damper: Array
    """Its change by a damping of 1."""
    states: ParallelStates
    """The same as systems x_k → F_k."""
    member: Member
    period: float
    weight: float
    """Factor of the damping by the weights of the estimator on the moves of single periods."""
    least: float
    """Growth of the handle outside of a damped wall, which counts as the scalar verdict counts it; otherwise 0."""

    def growth(self, stiffness: Array, damping: Array) -> Array:
        """Return the largest modulus of the eigenvalues, (n,)."""
        moving = damping[:, None, None] * self.damper
        moduli = np.abs(np.linalg.eigvals(self.free + stiffness[:, None, None] * self.spring + moving))
        return np.asarray(np.maximum(moduli.max(axis=1), self.least), dtype=np.float64)

    def damping_share(self, stiffness: Array, damping: Array) -> Array:
        """Return the damping that passive hands need, as a share of that of the device (`margins.passivity`), (n,)."""
        lag = self.member.plant.torque_lag
        along = stiffness * (0.5 * self.period + self.member.delay + lag) + damping * self.weight
        spread = math.sqrt(spread_of(self.period, self.member.delay, lag))
        needed = 0.5 * (along + np.hypot(along, stiffness * spread))
        return needed / self.member.plant.damping if self.member.plant.damping else np.full_like(needed, math.inf)

    def verdicts(self, stiffness: Array, damping: Array, grown: Array, share: Array) -> NDArray[np.str_]:
        """Return the verdict of each wall by the table of `margins.verdict`."""
        held = quantisation_limit(self.member.plant)
        rounding = (0.5 * stiffness + damping * self.weight / self.period) * self.member.plant.resolution
        passive = (share <= 1.0 + ROUNDING) & (self.member.plant.coulomb >= rounding)
        kinds = (Verdict.UNSTABLE, Verdict.LIMIT_CYCLE, Verdict.PASSIVE)
        cases = [grown > 1.0 + AT_LIMIT, stiffness > (math.inf if held is None else held), passive]
        return np.select(cases, [kind.value for kind in kinds], Verdict.STABLE.value)


Shared = tuple[WallLoop, Array, Array, list[int]]
"""Common part of some walls, their stiffness and damping, and their places among the points."""


def _begun(job: SweepJob, points: Sequence[Point]) -> tuple[dict[int, Row], list[Shared], list[int]]:
    """Return the rows of refusals, the walls that share a plan, and the places of points that need their own."""
    wall = _lone_wall(job)
    if wall is None:
        return {}, [], [*range(len(points))]
    own = {f"{wall.name}.{name}": getattr(wall, name) for name in ("stiffness", "damping")}
    stiffness, damping = (_numbers([point.get(name, usual) for point in points]) for name, usual in own.items())
    possible = _usual(Quantity.STIFFNESS, stiffness) & ((damping == 0.0) | _usual(Quantity.DAMPING, damping))
    groups: dict[tuple[str, bool], list[int]] = {}
    for at in np.flatnonzero(possible).tolist():
        # Other parameters than those of the wall as a text, in which 1, 1.0 and True differ.
        others = repr([item for item in points[at].items() if item[0] not in own])
        groups.setdefault((others, bool(damping[at])), []).append(at)
    rows, found, alone = dict[int, Row](), list[Shared](), np.flatnonzero(~possible).tolist()
    for (_, damped), places in groups.items():
        usual = dict(zip(own, (1.0, float(damped)), strict=True))
        try:
            loop = _wall_loop(job.task_at({**points[places[0]], **usual}))
        except PlanError as error:  # of rate, bus or drive, whatever the wall is
            rows |= dict.fromkeys(places, _refused(error))
            continue
        except (HapticFieldbusError, TypeError):
            loop = None
        if loop is None:
            alone += places
        else:
            found.append((loop, stiffness[places], damping[places], places))
    return rows, found, alone


def _usual(quantity: Quantity, values: Array) -> NDArray[np.bool_]:
    """Return where values are above 0 and such as a file may have; false for not-a-number."""
    known = RANGES[quantity]
    return (values >= known.smallest) & (values <= known.largest)


def _numbers(values: Sequence[Value]) -> Array:
    """Return numbers; not-a-number for anything else."""
    return np.array([float(each) if type(each) in (int, float) else math.nan for each in values])


def _wall_loop(task: Task) -> WallLoop | None:
    """Return what the walls on the bench of this task have in common; None where a point needs a plan of its own."""
    check_request(rate=task.rate)
    plan = select(task).plan
    group = _rigid(plan)
    if group is None:
        return None
    (member,), environment = group.members, group.environment()
    wall, (low, high) = cast(Wall, plan.axes[0].elements[0]), member.travel
    if not isinstance(environment, Places) or not low < wall.position < high or len(environment.together) > 1:
        return None  # a wall where the handle may not reach it, or a velocity that is judged in two ways
    (states,), (device,) = environment.together, group.loop.devices
    free = loop_matrix(device, states.free)
    spring, damper = (loop_matrix(device, each) - free for each in (states.spring, states.damper))
    factor = weight(member.estimator, group.period) if states.estimator is not None else 0.0
    leaves = wall.sides == "unilateral" and states.estimator is not None
    least = growth(device, states.free) if leaves else 0.0
    return WallLoop(free, spring, damper, states, member, group.period, factor, least)


def _rigid(plan: Plan) -> Group | None:
    """Return the loop of the only axis if it has a rigid shaft and an encoder."""
    (group, *others) = (axis.group for axis in plan.axes)
    if others or group is None or group.members[0].bodies or group.members[0].plant.tachometer:
        return None
    return group


# Engine `loop`: many simulated loops side by side.
#
# A handle in sustained contact is flicked, and swings. Each loop has the delay, the torque loop and the encoder of its
# plan; Coulomb friction only without a torque loop, because the exact solution with both does not exist
# (`numerics.batch`). It grew when its farthest excursion in the last quarter exceeds that in the second.

FLICK = {Workspace.LINEAR: 1.0, Workspace.ROTARY: 20.0}
"""Velocity at the start [m/s or rad/s], far above an encoder count a period."""


AT_REST, ALIGNED = 1e-9, 1e-7
"""Relative growth of an excursion, and angle of an eigenvalue [rad], that count as rounding."""


def loop_rows(job: SweepJob, points: Sequence[Point]) -> list[Row]:
    """Return whether each loop grew, its growth a period, and its farthest excursions, of all and at the end."""
    rows, shared, alone = _begun(job, points)
    loops = [
        SimulatedLoop(at, loop.member, loop.period, loop.states.at(spring, damper))
        for loop, stiffness, damping, places in shared
        for at, spring, damper in zip(places, stiffness.tolist(), damping.tolist(), strict=True)
    ]
    for at in alone:
        try:
            loops.append(_single_loop(job.task_at(points[at]), at))
        except (HapticFieldbusError, TypeError) as error:
            rows[at] = _refused(error)
    alike: dict[tuple[int, bool], list[SimulatedLoop]] = {}
    for each in loops:
        if (least := 4.0 * each.half_swing(0.25 * job.steps)) > job.steps:
            text = f"expected at least {math.ceil(least)}, as each quarter needs half of a swing of the handle"
            rows[each.at] = _refused(UsageError(f"steps {job.steps}: {text}"))
            continue
        alike.setdefault((each.environment.order, each.member.plant.torque_lag > 0.0), []).append(each)
    for group in alike.values():
        rows |= _simulated(group, job.steps)
    return [rows[at] for at in range(len(points))]


@dataclass(frozen=True, eq=False)
class SimulatedLoop:
    """The loop of the point `at`: its axis, its period [s], and its environment x_k → F_k."""

    at: int
    member: Member
    period: float
    environment: StateSpace

    def half_swing(self, periods: float) -> float:
        """Return half of the slowest swing that does not die within so many periods, in periods; 0: there is none."""
        device = sample(self.member.plant, self.period, self.member.delay)
        modes = np.linalg.eigvals(loop_matrix(device, self.environment))
        moduli, angles = np.abs(modes), np.abs(np.angle(modes))
        # A double real eigenvalue may have an angle by rounding.
        lasts = (moduli >= moduli.max() * AT_REST ** (1.0 / periods)) & (angles > ALIGNED)
        return math.pi / float(angles.min(where=lasts, initial=math.inf))


def _single_loop(task: Task, at: int) -> SimulatedLoop:
    """Return the loop of a point that has a plan of its own."""
    group = _rigid(select(task).plan)
    if group is None:
        raise UsageError(
            "the engine loop simulates one axis with a rigid shaft and an encoder; expected the engine full"
        )
    (member,) = group.members
    space = environment_of(member.elements, group.period, member.method, member.estimator)
    if shift_mode(space) is not None:
        raise UsageError("nothing holds the handle at a place, so its excursions say nothing; expected another engine")
    return SimulatedLoop(at, member, group.period, space)


def _simulated(loops: Sequence[SimulatedLoop], steps: int) -> dict[int, Row]:
    """Run loops whose environments have the same order, and return their rows by their places."""
    plants = [each.member.plant for each in loops]
    spaces = [Workspace.ROTARY if each.member.unit.startswith("N·m") else Workspace.LINEAR for each in loops]
    many = batch.loops(
        mass=[plant.mass for plant in plants],
        damping=[plant.damping for plant in plants],
        period=[each.period for each in loops],
        delay=[each.member.delay for each in loops],
        lag=[plant.torque_lag for plant in plants],
        resolution=[plant.resolution for plant in plants],
        coulomb=[0.0 if plant.torque_lag else plant.coulomb for plant in plants],
        velocity=[FLICK[space] for space in spaces],
        environments=[each.environment for each in loops],
    )
    ended = batch.run(many, steps, parts=4)
    _, second, _, last = ended.peaks
    with np.errstate(divide="ignore", invalid="ignore"):
        growth = np.where(ended.diverged, math.inf, np.nan_to_num((last / second) ** (2.0 / steps)))
    # Within a count nothing pushes back: the handle creeps to its place of rest, outwards too.
    farther = (last > second * (1.0 + AT_REST)) & (last > [plant.resolution for plant in plants])
    grew, peak = ended.diverged | farther, ended.peaks.max(axis=0)
    return _done([each.at for each in loops], grew=grew, growth=growth, peak=peak, last=last)


# Engine `full`.


def full_rows(job: SweepJob, points: Sequence[Point]) -> list[Row]:
    """Return outcome and figures of a simulated run at each point."""
    return [_ran(job, point) for point in points]


def _ran(job: SweepJob, point: Point) -> Row:
    asked: dict[str, Any] = {name: value for name, value in point.items() if name in OF_TRIAL}
    try:
        result = run_task(job.task_at(point), replace(job.trial, **asked))
    except (SafetyTripError, DriveFaultError) as error:
        known = error.result if isinstance(error.result, Result) else None
        return {"outcome": TRIPPED, "message": str(error), **({} if known is None else _figures(job, known, point))}
    except HapticFieldbusError as error:
        return _refused(error)
    if result.stopped is not None:  # a run takes a signal as its end, and the sweep must not take it as its figures
        raise KeyboardInterrupt(result.stopped.message)
    return {"outcome": DONE, **_figures(job, result, point)}


def _figures(job: SweepJob, result: Result, point: Point) -> Row:
    """Return the figures of a run; raises TypeError or UsageError for those of a `measure` that no row can hold."""
    found = (job.measure or run_figures)(result)
    if not isinstance(found, Mapping):
        raise wrong_kind("measure", "a mapping of figures by their names", found)
    for name, value in found.items():
        if not isinstance(name, str) or name in {"outcome", "message", *point}:
            raise UsageError(
                f"measure: figure {name!r}: expected a name that is neither outcome, message nor a parameter"
            )
        fits = value is None or (is_value(python_value(value)) and not (isinstance(value, str) and name in NUMBERS))
        if not fits:
            raise wrong_kind(f"measure: {name}", "a number, a text, True, False or None", value)
    return dict(found)


def run_figures(result: Result) -> dict[str, Any]:
    """Return the figures that `full` keeps of a run when no `measure` is given; SI units."""
    error, stability, trip = result.torque_error, result.stability, next(iter(result.trips), None)
    return {
        "verdict": stability and stability.nominal.value,
        "error_rms": error and error.rms,
        "error_max": error and error.max,
        "error_in_contact": error and error.contact,
        "energy_generated_j": result.energy_generated,
        "trip": trip and trip.name,
        "trip_time_s": trip and trip.time,
    }


ENGINES: Mapping[str, tuple[Callable[[SweepJob, Sequence[Point]], list[Row]], tuple[str, ...]]] = {
    "verdict": (verdict_rows, ("verdict", "growth", "damping_share")),
    "loop": (loop_rows, ("grew", "growth", "peak", "last")),
    "full": (full_rows, ()),
}
"""Engines by their names, and the figures that each gives even where no point has them."""
