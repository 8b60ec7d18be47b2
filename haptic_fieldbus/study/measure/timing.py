"""Measurements of time: costs of calls and of optional parts, missed periods, and how quiet the machine is."""

import gc
import math
import os
import platform
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from statistics import median
from time import get_clock_info, perf_counter_ns, thread_time_ns
from typing import cast

import numpy as np

from haptic_fieldbus import Plan, Scene, Signal, Workspace, load_scene
from haptic_fieldbus.assessing import Record
from haptic_fieldbus.cycle import Cycle, Permission, bind_limiter, columns, decoded_columns, law_of
from haptic_fieldbus.numerals import exactly, percent, rounded
from haptic_fieldbus.numerics import estimators, integrators
from haptic_fieldbus.numerics.batch import Array
from haptic_fieldbus.numerics.estimators import ESTIMATORS
from haptic_fieldbus.numerics.integrators import METHODS
from haptic_fieldbus.scenes.element import AnyElement, CouplingElement, Element
from haptic_fieldbus.study.measure.bench import DEFAULT_METHOD, Bench, Tools, library_scenes
from haptic_fieldbus.study.measure.problems import free_puck, sprung_mass

# Timing of calls on this machine: costs with their spread over repeats, and ratios of calls that took turns.
#
# A clock rate that rises, or a neighbour on the same core, makes one minute of a machine faster than the next. So calls
# that are compared take turns: each pass runs all of them, one after another, and a ratio is that of two passes side by
# side.

REPEATS = 25
"""Number of timed passes after one that only warms up."""
Quartiles = tuple[float, float, float]
"""Values below which a quarter, a half and three quarters of the passes lie."""


@dataclass(frozen=True)
class Timed:
    """A call to be timed; `inputs` is asked before each pass, and returns one sequence for each argument."""

    call: Callable[..., object]
    inputs: Callable[[], Sequence[Sequence[object]]]


@dataclass(frozen=True, eq=False)
class Cost:
    """Times of a call, and the time in which the thread had a processor."""

    passes: Array
    """Mean time of a call in each pass [ns], `(n_passes,)`."""
    lasted_ns: int
    """Time that all passes took together."""
    ran_ns: int
    """Part of it in which this thread had a processor."""

    @property
    def ns(self) -> float:
        """Mean time of a call in the median pass [ns]; it lies between the quartiles."""
        return self.quartiles[1]

    @property
    def quartiles(self) -> Quartiles:
        """Quartiles over the passes [ns]."""
        return quartiles(self.passes)

    @property
    def spread(self) -> float:
        """Interquartile range, as a share of the median."""
        low, middle, high = self.quartiles
        return (high - low) / middle

    def ratio(self, other: "Cost") -> Quartiles:
        """Return the quartiles of this cost over another, pass by pass; both must have been timed in turn."""
        return quartiles(self.passes / other.passes)

    def excess(self, other: "Cost") -> Array:
        """Return this cost minus another, pass by pass [ns]; both must have been timed in turn."""
        return self.passes - other.passes


def quartiles(values: Array) -> Quartiles:
    """Return the quartiles of values of shape `(n,)`."""
    low, middle, high = np.percentile(values, [25, 50, 75]).tolist()
    return low, middle, high


def in_turn(calls: Mapping[str, Timed], repeats: int = REPEATS) -> dict[str, Cost]:
    """Return the costs of calls that take turns, pass by pass, with the garbage collector off."""
    spent = {name: np.empty(repeats) for name in calls}
    lasted, ran = dict.fromkeys(calls, 0), dict.fromkeys(calls, 0)
    for number in range(-1, repeats):
        for name, timed in calls.items():
            inputs = timed.inputs()
            wall_ns, thread_ns = _pass(timed.call, inputs)
            if number >= 0:  # the first pass only warms up
                spent[name][number] = wall_ns / len(inputs[0])
                lasted[name] += wall_ns
                ran[name] += thread_ns
    return {name: Cost(spent[name], lasted[name], ran[name]) for name in calls}


def _pass(call: Callable[..., object], inputs: Sequence[Sequence[object]]) -> tuple[int, int]:
    """Return the duration of calls along all inputs, and the part of it in which this thread ran [ns]."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        thread, begun = thread_time_ns(), perf_counter_ns()
        # The calls are driven in C, without the cost of a Python loop around them.
        deque(map(call, *inputs), maxlen=0)
        return perf_counter_ns() - begun, thread_time_ns() - thread
    finally:
        if was_on:
            gc.enable()


@dataclass(frozen=True)
class TimeDistribution:
    """Distribution of the times of single calls [ns], without the time of reading the clock."""

    p50: float
    p999: float
    largest: float


def spread(call: Callable[..., object], inputs: Sequence[tuple[object, ...]]) -> TimeDistribution:
    """Return the distribution of calls that are timed one by one; `inputs` has the arguments of each."""
    empty = min(-perf_counter_ns() + perf_counter_ns() for _ in range(1000))  # time between two readings of the clock
    p50, p999, largest = np.percentile(np.maximum(ns_of_each(call, inputs) - empty, 0.0), [50, 99.9, 100])
    return TimeDistribution(float(p50), float(p999), float(largest))


def ns_of_each(call: Callable[..., object], inputs: Sequence[tuple[object, ...]]) -> Array:
    """Return the time of each call [ns], reading the clock included, `(n_calls,)`."""
    clock, spent = perf_counter_ns, np.empty(len(inputs))
    for number, arguments in enumerate(inputs):
        begun = clock()
        call(*arguments)
        spent[number] = clock() - begun
    return spent


# Cost of each optional part: whole periods of a few scenes, and the parts by themselves.

ENABLED = 0x0637
"""Statusword of operation enabled."""
IMAGES, SINGLE = 250, 5000
"""Input images in one timed pass, which is one swing of the handle, and periods that are timed one by one."""
APPROACH = 4 * IMAGES
"""Number of periods in which the handle moves to its place; longer than the fade-in."""
PLAIN, DAMPED = "wall", "damped_wall"
"""Scenes whose difference is the cost of velocity and damping."""
PLACES = {Workspace.LINEAR: (0.025, 0.004), Workspace.ROTARY: (0.5, 0.08)}
"""Centre and amplitude of the handle's swing [m or rad]: inside the wall, and far below the speed that trips."""
POSITION, SWING = PLACES[Workspace.LINEAR]


@dataclass(frozen=True)
class OptionalPart:
    """Time that a part adds to a period [ns]; for a whole period also the distribution of single ones."""

    part: str
    ns_per_step: float
    """Median pass."""
    ns_quartiles: Quartiles
    cost: Cost | None = None
    """The part that was timed; None for a difference."""
    spread: TimeDistribution | None = None


class Playback:
    """Input images of a run, made in advance, so that timed cycles contain no other work.

    Handles swing about their places with the drives in operation enabled. Time advances from image to image, and each
    drive shows the set-point sent to it; without either the cycle would trip.
    """

    def __init__(self, plan: Plan) -> None:
        self._plan, self._cycle = plan, Cycle(plan)
        self._number = 0
        self._sent = dict.fromkeys((axis.name for axis in plan.axes), 0)
        # The zero is where the handle is first, and a jump would trip: the handle is led there over many periods.
        self._approach = [self._next(number / APPROACH, 0.0) for number in range(APPROACH + 1)]

    def running_cycle(self) -> Cycle:
        """Return a cycle in operation enabled, after the fade-in, whose handles are at their places."""
        cycle = Cycle(self._plan)
        for image in self._approach:
            cycle(image)
        return cycle

    def images(self, count: int) -> list[bytes]:
        """Return the next `count` images; the first one follows the last image of the running cycle."""
        return [self._next(1.0, math.sin(2.0 * math.pi * (self._number - 1) / IMAGES)) for _ in range(count)]

    def swing(self) -> tuple[list[bytes]]:
        """Return the images of the next swing, as the arguments of a timed pass."""
        return (self.images(IMAGES),)

    def _next(self, travel: float, swing: float) -> bytes:
        """Return the next image: `travel` is the share of the way to the place, `swing` that of the amplitude."""
        plan = self._plan
        known = {"t_ns": self._number * plan.period_ns}
        for axis in plan.axes:
            middle, amplitude = PLACES[axis.workspace]
            known |= {
                f"{axis.name}.age_ns": 100_000,
                f"{axis.name}.statusword": ENABLED,
                f"{axis.name}.position counts": round((middle * travel + amplitude * swing) / axis.position_unit),
                f"{axis.name}.torque demand": self._sent[axis.name],
                f"{axis.name}.torque actual": self._sent[axis.name],
            }
        image = plan.image.input.pack(*(known.get(name, 0) for name in decoded_columns(plan)))
        output = self._cycle(image)
        for axis, places in zip(plan.axes, plan.image.axes, strict=True):
            self._sent[axis.name] = places.output.unpack_from(output, places.outputs[0])[1]
        self._number += 1
        return image


def parts(plans: Mapping[str, Plan], bench: Bench) -> Iterator[OptionalPart]:
    """Yield whole periods of the plans by scene, then each kind of element of the library, then the rest.

    Compared calls are timed in turn: whole periods of all scenes, then all single parts.
    """
    yield from _periods(plans)
    single = _elements([load_scene(name) for name in library_scenes()], plans[PLAIN].period)
    single |= _steps(plans[PLAIN], bench)
    for name, cost in in_turn(single).items():
        yield OptionalPart(name, cost.ns, cost.quartiles, cost)


def _periods(plans: Mapping[str, Plan]) -> Iterator[OptionalPart]:
    """Yield whole periods, with the distribution of single ones, and what velocity and damping add to them."""
    playbacks = {scene: Playback(plan) for scene, plan in plans.items()}
    cycles = {scene: playback.running_cycle() for scene, playback in playbacks.items()}
    costs = in_turn({scene: Timed(cycles[scene], playback.swing) for scene, playback in playbacks.items()})
    for scene, cost in costs.items():
        alone = spread(cycles[scene], [(image,) for image in playbacks[scene].images(SINGLE)])
        yield OptionalPart(f"whole period: {scene}", cost.ns, cost.quartiles, cost, alone)
    added = quartiles(costs[DAMPED].excess(costs[PLAIN]))
    yield OptionalPart(f"velocity and damping ({DAMPED} over {PLAIN})", added[1], added)


def _elements(scenes: Sequence[Scene], period: float) -> dict[str, Timed]:
    """Return the law of each kind of element by itself; both axes of a coupling move alike."""
    kinds: dict[str, tuple[AnyElement, Scene]] = {}
    for scene in scenes:
        for element in scene.elements:
            kinds.setdefault(type(element).__module__.rpartition(".")[2], (element, scene))
    return dict(_element(kind, *of, period) for kind, of in sorted(kinds.items()))


def _element(kind: str, element: AnyElement, scene: Scene, period: float) -> tuple[str, Timed]:
    """Return name and law of an element; a law without signals is called through a lambda, whose time is included."""
    spaces = {axis.name: axis.workspace for axis in scene.axes}
    axes = element.axes if isinstance(element, CouplingElement) else (cast(Element, element).axis,)
    given = [_signals(period, spaces[name])[signal] for name in axes for signal in element.needs]
    law: Callable[..., object]
    if isinstance(element, CouplingElement):
        law, sort = element.begin(period), "coupling"
    else:
        law, sort = law_of(element, period), "element"
    name = f"{sort}: {kind}"
    return name, Timed(law, lambda: given) if given else Timed(lambda _: law(), lambda: (range(IMAGES),))


def _signals(period: float, workspace: Workspace) -> dict[Signal, list[float]]:
    """Return the values of each signal along the swing of `Playback`."""
    (middle, amplitude), turn = PLACES[workspace], 2.0 * math.pi / IMAGES
    return {
        Signal.POSITION: [middle + amplitude * math.sin(turn * number) for number in range(IMAGES)],
        Signal.VELOCITY: [amplitude * turn / period * math.cos(turn * number) for number in range(IMAGES)],
        Signal.ELAPSED_NS: [round(number * period * 1e9) for number in range(IMAGES)],
    }


def _steps(wall: Plan, bench: Bench) -> Iterator[tuple[str, Timed]]:
    """Yield name and step of each part that is timed by itself."""
    names, period, count = columns(wall), bench.period, bench.plant.resolution
    swing = [math.sin(2.0 * math.pi * number / IMAGES) for number in range(IMAGES)]

    def timed(call: Callable[..., object], values: Sequence[object]) -> Timed:
        return Timed(call, lambda: (values,))

    yield "record: one row", timed(Record(names, IMAGES).push, [[0.5] * len(names)] * IMAGES)
    yield "limits: fade-in, effort, slew", timed(bind_limiter(wall.axes[0].limits, wall.period, Permission()), swing)
    counted = [round((POSITION + SWING * each) / count) * count for each in swing]
    for name in ESTIMATORS:
        yield f"estimator: {name}", timed(estimators.bind(name, period, count), counted)
    moved = [0.01 * each for each in swing]
    for name in METHODS:
        yield f"integrator, two states: {name}", timed(integrators.bind(sprung_mass(), period, name), moved)
    yield f"integrator, four states: {DEFAULT_METHOD}", timed(integrators.bind(free_puck(), period), moved)


# Share of periods that would be missed at a rate: by computing alone, and with the exchange on the plan's bus.

RATES = (1000.0, 2000.0, 5000.0, 10_000.0)
"""Rates of the loop [Hz]."""
SCENE = "damped_wall"


@dataclass(frozen=True)
class RateDeadline:
    """Shares of all periods that would be missed at one rate [Hz]."""

    rate: float
    missed_computing: float
    """Share in which computing alone takes longer than the period."""
    missed: float
    """Share in which computing and the exchange on the bus, one after the other, take longer than the period."""


@dataclass(frozen=True)
class RateDeadlines:
    """Times of one period [s] over `periods` periods, and the missed shares at each rate."""

    bus: float
    compute_p50: float
    compute_p999: float
    compute_max: float
    periods: int
    rates: tuple[RateDeadline, ...]


def deadlines(tools: Tools, periods: int) -> RateDeadlines:
    """Compute so many periods of the damped wall, each timed by itself, garbage collection included."""
    plan = tools.plan(SCENE)
    playback = Playback(plan)
    spent = 1e-9 * ns_of_each(playback.running_cycle(), [(image,) for image in playback.images(periods)])
    p50, p999, largest = np.percentile(spent, [50, 99.9, 100]).tolist()
    bus = plan.delay.bus
    late = (RateDeadline(f, float((spent > 1.0 / f).mean()), float((spent + bus > 1.0 / f).mean())) for f in RATES)
    return RateDeadlines(bus, p50, p999, largest, periods, tuple(late))


# How quiet the machine was while times were taken: its load, the share of a processor, and the spread of costs.

LOADED, INTERRUPTED, SCATTERED = 0.7, 0.97, 0.1
"""Thresholds of a busy machine: least load of a core, largest share of a processor, least spread of costs."""


def load_average() -> float | None:
    """Return the load average of the last minute; None if the system does not report it."""
    return os.getloadavg()[0] if hasattr(os, "getloadavg") else None


@dataclass(frozen=True)
class MachineNoise:
    """Load of the machine that disturbs its times."""

    load: float | None
    """Load average before the first measurement; None if the system does not report it."""
    cores: int
    running: float
    """Share of the time of all timed calls in which they had a processor."""
    spread: float
    """Median over the timed calls of their interquartile range, as a share of their median."""

    @classmethod
    def of(cls, load: float | None, costs: Sequence[Cost]) -> "MachineNoise":
        """Return the noise at this load, from the costs measured meanwhile; at least one."""
        running = sum(cost.ran_ns for cost in costs) / sum(cost.lasted_ns for cost in costs)
        return cls(load, os.cpu_count() or 1, min(running, 1.0), median(cost.spread for cost in costs))

    @property
    def busy(self) -> bool:
        """True if other programs disturbed the costs."""
        loaded = self.load is not None and self.load > LOADED * self.cores
        return loaded or self.running < INTERRUPTED or self.spread > SCATTERED

    def words(self) -> str:
        """Return the three figures as words."""
        loaded = "" if self.load is None else f"load {rounded(self.load, 2)} on {self.cores} cores, "
        return f"{loaded}{percent(self.running)} of a processor, half of the repeats within {percent(self.spread)}"

    def warning(self) -> str:
        """Return a warning and what to do; empty on a quiet machine."""
        if not self.busy:
            return ""
        return (
            f"This machine was busy ({self.words()}): costs are too high; errors and stability are not affected. "
            "Repeat the report when nothing else runs."
        )


# Description of the machine on which the report is made.

PACKAGES = ("haptic-fieldbus", "numpy", "matplotlib", "python-can", "canopen")


def host_facts() -> dict[str, str]:
    """Return processor, system, clock and versions as texts by stable keys."""
    clock = get_clock_info("perf_counter")
    return {
        "processor": processor(),
        "cores": str(os.cpu_count()),
        "system": f"{platform.system()} {platform.release()} {platform.machine()}",
        "python": f"{platform.python_implementation()} {platform.python_version()}",
        **{name: _version(name) for name in PACKAGES},
        "linear_algebra": _blas(),
        "clock": f"{clock.implementation}, resolution {exactly(clock.resolution * 1e9)} ns",
    }


def processor() -> str:
    """Return the name of the processor that the system gives, or of its architecture when there is none."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    named = (line.split(":", 1)[1].strip() for line in lines if line.startswith("model name"))
    return next(named, platform.processor() or platform.machine())


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"


def _blas() -> str:
    """Return name and version of numpy's linear algebra library."""
    known = np.show_config(mode="dicts")
    blas = known.get("Build Dependencies", {}).get("blas", {}) if isinstance(known, dict) else {}
    return f"{blas.get('name', 'unknown')} {blas.get('version', '')}".strip()
