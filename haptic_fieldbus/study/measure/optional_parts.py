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
from haptic_fieldbus.study.measure.timing import Spread, ns_per_call, spread

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


def images(plan: Plan, count: int = IMAGES) -> list[tuple[bytes]]:
    """Return input images of handles that swing about their places, with the drives in operation enabled.

    Each image stands in a tuple, as the arguments of one call.
    """
    swings = [math.sin(2.0 * math.pi * number / IMAGES) for number in range(count)]
    return [(_image(plan, 1.0, swing, number),) for number, swing in enumerate(swings)]


def _image(plan: Plan, travel: float, swing: float, number: int) -> bytes:
    """Return the image of period `number`: `way` is the share of the way to the place, `swing` the share of a swing."""
    known = {"t_ns": number * plan.period_ns}
    for axis in plan.axes:
        middle, amplitude = PLACES[axis.workspace]
        known |= {
            f"{axis.name}.age_ns": 100_000,
            f"{axis.name}.statusword": ENABLED,
            f"{axis.name}.position counts": round((middle * travel + amplitude * swing) / axis.position_unit),
        }
    return plan.image.input.pack(*(known.get(name, 0) for name in decoded_columns(plan)))


def running_cycle(plan: Plan) -> Cycle:
    """Return a cycle in operation enabled, after the fade-in, whose handles are at their places."""
    cycle = Cycle(plan)
    # The zero is where the handle is first, and a jump would trip: the handle is led there over many periods.
    for number in range(IMAGES + 1):
        cycle(_image(plan, number / IMAGES, 0.0, number))
    return cycle


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
    given = images(plan)
    cycle = running_cycle(plan)
    cost = ns_per_call(cycle, [image for (image,) in given])
    return cost, spread(cycle, given * 10)


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
    """Return the values of each signal along the motion of `images`."""
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
