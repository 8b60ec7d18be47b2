"""Cost of each optional part: whole periods of a few scenes, and the parts by themselves."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
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
from haptic_fieldbus.study.measure.bench import Bench
from haptic_fieldbus.study.measure.problems import free_puck, sprung_mass
from haptic_fieldbus.study.measure.timing import Cost, Quartiles, Spread, Timed, in_turn, quartiles, spread

ENABLED = 0x0637
"""Statusword of operation enabled."""
IMAGES, SINGLE = 250, 5000
"""Input images in one timed pass, which is one swing of the handle, and periods that are timed one by one."""
APPROACH = 4 * IMAGES
"""Periods in which the handle is led to its place; longer than the fade-in."""
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
    """What was timed; None for a difference."""
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
        self._approach = [self._next(number / APPROACH, 0.0) for number in range(APPROACH + 1)]

    def running_cycle(self) -> Cycle:
        """Return a cycle in operation enabled, after the fade-in, whose handles are at their places."""
        cycle = Cycle(self._plan)
        for image in self._approach:
            cycle(image)
        return cycle

    def images(self, count: int) -> list[bytes]:
        """Return the next `count` images; the first of all follows the last that a running cycle has had."""
        return [self._next(1.0, math.sin(2.0 * math.pi * (self._number - 1) / IMAGES)) for _ in range(count)]

    def swing(self) -> tuple[list[bytes]]:
        """Return the images of the next swing, as the arguments of a timed pass."""
        return (self.images(IMAGES),)

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


def parts(plans: Mapping[str, Plan], bench: Bench) -> Iterator[OptionalPart]:
    """Yield whole periods of the plans by scene, then each kind of element of the library, then the rest.

    What is compared is timed in turn: whole periods of all scenes, then all parts by themselves.
    """
    yield from _periods(plans)
    single = _elements([load_scene(name) for name in scene_names()], plans[PLAIN].period)
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
    """Return name and law of an element; a law without signals is called with nothing, by a lambda that costs too."""
    spaces = {axis.name: axis.workspace for axis in scene.axes}
    given = [_signals(period, spaces[name])[signal] for name in axes_of(element) for signal in element.needs]
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
    limiter = bind_limiter(wall.axes[0].limits, wall.period, Permission())
    yield "limits: fade-in, effort, slew", timed(limiter, swing)
    counted = [round((POSITION + SWING * each) / count) * count for each in swing]
    for name in ESTIMATORS:
        yield f"estimator: {name}", timed(estimators.bind(name, period, count), counted)
    moved = [0.01 * each for each in swing]
    for name in METHODS:
        yield f"integrator, two states: {name}", timed(integrators.bind(sprung_mass(), period, name), moved)
    yield f"integrator, four states: {DEFAULT_METHOD}", timed(integrators.bind(free_puck(), period), moved)
