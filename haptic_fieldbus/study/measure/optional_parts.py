"""Cost of each optional part: whole periods of a few scenes, and the parts by themselves."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from haptic_fieldbus.assessing.record import Record
from haptic_fieldbus.cycle.cycle import Cycle, columns, decoded_columns
from haptic_fieldbus.cycle.laws import law_of
from haptic_fieldbus.cycle.safety import Permission, bind_limiter
from haptic_fieldbus.defaults import DEFAULT_METHOD
from haptic_fieldbus.numerics import estimators, integrators
from haptic_fieldbus.numerics.estimators import ESTIMATORS
from haptic_fieldbus.numerics.integrators import METHODS
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.scenes.catalogue import load_scene, scene_names
from haptic_fieldbus.scenes.element import AnyElement, CouplingElement
from haptic_fieldbus.scenes.scene import Scene, axes_of
from haptic_fieldbus.signals import Signal, Workspace
from haptic_fieldbus.study.measure.bench import Bench, Tools
from haptic_fieldbus.study.measure.problems import free_puck, sprung_mass
from haptic_fieldbus.study.measure.timing import REPEATS, Spread, ns_in_passes, ns_per_call, spread

ENABLED = 0x0637
"""Statusword of operation enabled."""
IMAGES = 1000
"""Input images in one timed pass, one swing of the handle."""
PLACES = {Workspace.LINEAR: (0.025, 0.004), Workspace.ROTARY: (0.5, 0.08)}
"""Centre and amplitude of the handle's swing [m or rad]: inside the wall, and far below the speed that trips."""
POSITION, SWING = PLACES[Workspace.LINEAR]


@dataclass(frozen=True)
class OptionalPart:
    """Time that a part adds to a period [ns]; for a whole period also the distribution of single ones."""

    part: str
    ns_per_step: float
    spread: Spread | None = None


class Playback:
    """Input images of a run, made once, so that the cycles that are timed later pay for nothing else.

    Handles swing about their places with the drives in operation enabled. Time goes on from image to image, and each
    drive shows the set-point that was sent to it, since a cycle trips where one of the two stands still.
    """

    def __init__(self, plan: Plan) -> None:
        self._plan, self._cycle = plan, Cycle(plan)
        self._number = 0
        self._sent = dict.fromkeys((axis.name for axis in plan.axes), 0)
        # The zero is where the handle is first, and a jump would trip: the handle is led there over many periods.
        self._approach = [self._next(number / IMAGES, 0.0) for number in range(IMAGES + 1)]

    def running_cycle(self) -> Cycle:
        """Return a cycle in operation enabled, after the fade-in, whose handles are at their places."""
        cycle = Cycle(self._plan)
        for image in self._approach:
            cycle(image)
        return cycle

    def images(self, count: int) -> list[bytes]:
        """Return the next `count` images; the first of all follows the last that a running cycle has had."""
        return [self._next(1.0, math.sin(2.0 * math.pi * (self._number - 1) / IMAGES)) for _ in range(count)]

    def _next(self, travel: float, swing: float) -> bytes:
        """Return the next image: `travel` is the share of the way to the place, `swing` the share of a swing."""
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


def parts(tools: Tools, bench: Bench, scenes: Sequence[str]) -> Iterator[OptionalPart]:
    """Yield whole periods of these scenes, the wall first, then each kind of element of the library, then the rest."""
    plans = {name: tools.plan(name) for name in dict.fromkeys(("wall", "damped_wall", *scenes))}
    whole: dict[str, float] = {}
    for scene, plan in plans.items():
        whole[scene], single = _period(plan)
        yield OptionalPart(f"whole period: {scene}", whole[scene], single)
    yield OptionalPart("velocity and damping (damped_wall over wall)", whole["damped_wall"] - whole["wall"])
    yield from _elements([load_scene(name) for name in scene_names()], plans["wall"].period)
    for part, step, inputs in _steps(plans["wall"], bench):
        yield OptionalPart(part, ns_per_call(step, inputs))


def _period(plan: Plan) -> tuple[float, Spread]:
    """Return the shortest mean time of a whole period [ns], and the distribution of single periods."""
    playback = Playback(plan)
    cycle = playback.running_cycle()
    cost = ns_in_passes(cycle, [(playback.images(IMAGES),) for _ in range(REPEATS + 1)])
    return cost, spread(cycle, [(image,) for image in playback.images(10 * IMAGES)])


def _elements(scenes: Sequence[Scene], period: float) -> Iterator[OptionalPart]:
    """Yield the law of each kind of element by itself; both axes of a coupling move alike."""
    kinds: dict[str, tuple[AnyElement, Scene]] = {}
    for scene in scenes:
        for element in scene.elements:
            kinds.setdefault(type(element).__module__.rpartition(".")[2], (element, scene))
    for kind, (element, scene) in sorted(kinds.items()):
        spaces = {axis.name: axis.workspace for axis in scene.axes}
        given = [_signals(period, spaces[name])[signal] for name in axes_of(element) for signal in element.needs]
        law: Callable[..., object]
        if isinstance(element, CouplingElement):
            law, sort = element.begin(period), "coupling"
        else:
            law, sort = law_of(element, period), "element"
        # A law without signals is called with nothing; the lambda around it costs a call of its own.
        cost = ns_per_call(law, *given) if given else ns_per_call(lambda _, law=law: law(), range(IMAGES))
        yield OptionalPart(f"{sort}: {kind}", cost)


def _signals(period: float, workspace: Workspace) -> dict[Signal, list[float]]:
    """Return the values of each signal along the swing of `Playback`."""
    (middle, amplitude), turn = PLACES[workspace], 2.0 * math.pi / IMAGES
    return {
        Signal.POSITION: [middle + amplitude * math.sin(turn * number) for number in range(IMAGES)],
        Signal.VELOCITY: [amplitude * turn / period * math.cos(turn * number) for number in range(IMAGES)],
        Signal.ELAPSED_NS: [round(number * period * 1e9) for number in range(IMAGES)],
    }


def _steps(wall: Plan, bench: Bench) -> Iterator[tuple[str, Callable[..., object], Sequence[object]]]:
    """Yield name, step and inputs of each part that is timed by itself."""
    names, period, count = columns(wall), bench.period, bench.plant.resolution
    swing = [math.sin(0.01 * number) for number in range(IMAGES)]
    yield "record: one row", Record(names, IMAGES).push, [[0.5] * len(names)] * IMAGES
    yield "limits: fade-in, effort, slew", bind_limiter(wall.axes[0].limits, wall.period, Permission()), swing
    counted = [round((POSITION + SWING * each) / count) * count for each in swing]
    for name in ESTIMATORS:
        yield f"estimator: {name}", estimators.bind(name, period, count), counted
    moved = [0.01 * each for each in swing]
    for name in METHODS:
        yield f"integrator, two states: {name}", integrators.bind(sprung_mass(), period, name), moved
    yield f"integrator, four states: {DEFAULT_METHOD}", integrators.bind(free_puck(), period), moved
