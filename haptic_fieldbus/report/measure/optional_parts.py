"""What each optional part costs: the whole period of a few scenes, and the parts by themselves."""

import math
from collections.abc import Collection, Iterator
from dataclasses import asdict, dataclass

from haptic_fieldbus.cycle import Cycle, columns, decoded_columns
from haptic_fieldbus.laws import law_of
from haptic_fieldbus.numerics import estimators, integrators
from haptic_fieldbus.numerics.estimators import ESTIMATORS
from haptic_fieldbus.numerics.integrators import METHODS
from haptic_fieldbus.planning import Plan
from haptic_fieldbus.record import Record
from haptic_fieldbus.report.measure.bench import Bench, Tools
from haptic_fieldbus.report.measure.problems import free_puck, sprung_mass
from haptic_fieldbus.report.measure.timing import Spread, ns_per_call, spread
from haptic_fieldbus.safety import bind_limiter
from haptic_fieldbus.scenes.catalogue import scene_names
from haptic_fieldbus.scenes.element import CouplingElement, Element
from haptic_fieldbus.signals import Signal, Workspace

ENABLED = 0x0637
"""A statusword: operation enabled."""
IMAGES = 1000
PLACES = {Workspace.LINEAR: (0.025, 0.004), Workspace.ROTARY: (0.5, 0.08)}
"""[m or rad]: where the handle moves and how far, inside the wall, far below the speed that trips."""
POSITION, SWING = PLACES[Workspace.LINEAR]


@dataclass(frozen=True)
class Part:
    """A part and what it adds to a period [ns]; whole periods say how single ones are distributed."""

    part: str
    ns_per_step: float
    spread: Spread | None = None

    def to_json(self) -> dict[str, object]:
        found = asdict(self)
        del found["spread"]
        return found


def images(plan: Plan, count: int = IMAGES) -> list[tuple[bytes]]:
    """Input images of handles that swing about a place away from where they began, the drives in operation enabled."""
    swings = [math.sin(2.0 * math.pi * number / IMAGES) for number in range(count)]
    return [(_image(plan, 1.0, swing, number),) for number, swing in enumerate(swings)]


def _image(plan: Plan, way: float, swing: float, number: int) -> bytes:
    """Each handle so far on its way to its place, and so far from there."""
    known = {"t_ns": number * plan.period_ns}
    for axis in plan.axes:
        middle, amplitude = PLACES[axis.workspace]
        known |= {
            f"{axis.name}.age_ns": 100_000,
            f"{axis.name}.statusword": ENABLED,
            f"{axis.name}.position counts": round((middle * way + amplitude * swing) / axis.position_unit),
        }
    return plan.image.input.pack(*(known.get(name, 0) for name in decoded_columns(plan)))


def running(plan: Plan) -> Cycle:
    """A cycle in operation enabled whose handles have been led to their place, the fade-in behind it."""
    cycle = Cycle(plan)
    for number in range(IMAGES + 1):
        cycle(_image(plan, number / IMAGES, 0.0, number))
    return cycle


def parts(tools: Tools, bench: Bench) -> Iterator[Part]:
    """All of them, the whole periods first."""
    whole: dict[str, float] = {}
    plans = {name: tools.plan(name) for name in ("wall", *(name for name in scene_names() if name != "wall"))}
    for scene, plan in plans.items():
        whole[scene], single = _period(plan)
        yield Part(f"whole period: {scene}", whole[scene], single)
    yield Part("velocity and damping (damped_wall over wall)", whole["damped_wall"] - whole["wall"])
    yield from _elements(plans.values())
    yield Part("record: one row", _record(tools.plan("wall")))
    yield Part("limits: fade-in, effort, slew", _limits(tools.plan("wall")))
    yield from _estimators(bench)
    yield from _integrators(bench)


def _period(plan: Plan) -> tuple[float, Spread]:
    given = images(plan)
    cycle = running(plan)
    cost = ns_per_call(cycle, [image for (image,) in given])
    return cost, spread(cycle, given * 10)


def _elements(plans: Collection[Plan]) -> Iterator[Part]:
    """The law of each kind of element that a shipped scene has, by itself."""
    kinds: dict[str, tuple[Element, Plan, Workspace]] = {}
    for plan in plans:
        for axis in plan.axes:
            for element in axis.elements:
                kinds.setdefault(type(element).__module__.rpartition(".")[2], (element, plan, axis.workspace))
    for kind in sorted(kinds):
        element, plan, workspace = kinds[kind]
        law, signals = law_of(element, plan.period), _signals(plan.period, workspace)
        given = [signals[signal] for signal in element.needs]
        cost = ns_per_call(law, *given) if given else ns_per_call(lambda _, law=law: law(), range(IMAGES))
        yield Part(f"element: {kind}", cost)
    yield from _couplings(plans)


def _couplings(plans: Collection[Plan]) -> Iterator[Part]:
    """The law of each kind that acts on two axes, both moving alike."""
    kinds: dict[str, tuple[CouplingElement, Plan]] = {}
    for plan in plans:
        for coupling in plan.scene.couplings:
            kinds.setdefault(type(coupling).__module__.rpartition(".")[2], (coupling, plan))
    for kind, (coupling, plan) in sorted(kinds.items()):
        spaces = {axis.name: axis.workspace for axis in plan.axes}
        given = [_signals(plan.period, spaces[name])[signal] for name in coupling.axes for signal in coupling.needs]
        yield Part(f"coupling: {kind}", ns_per_call(coupling.begin(plan.period), *given))


def _signals(period: float, workspace: Workspace) -> dict[Signal, list[float]]:
    """What a law is given along the motion of `images`."""
    (middle, amplitude), turn = PLACES[workspace], 2.0 * math.pi / IMAGES
    return {
        Signal.POSITION: [middle + amplitude * math.sin(turn * number) for number in range(IMAGES)],
        Signal.VELOCITY: [amplitude * turn / period * math.cos(turn * number) for number in range(IMAGES)],
        Signal.ELAPSED_NS: [round(number * period * 1e9) for number in range(IMAGES)],
    }


def _record(plan: Plan) -> float:
    names = columns(plan)
    record, row = Record(names, IMAGES), [0.5] * len(names)
    return ns_per_call(record.push, [row] * IMAGES)


def _limits(plan: Plan) -> float:
    limiter = bind_limiter(plan.axes[0].limits, plan.period)
    return ns_per_call(limiter, [math.sin(0.01 * number) for number in range(IMAGES)])


def _estimators(bench: Bench) -> Iterator[Part]:
    positions = [POSITION + SWING * math.sin(0.01 * number) for number in range(IMAGES)]
    step = bench.plant.resolution
    counted = [round(position / step) * step for position in positions]
    for name in ESTIMATORS:
        yield Part(f"estimator: {name}", ns_per_call(estimators.bind(name, bench.period, step), counted))


def _integrators(bench: Bench) -> Iterator[Part]:
    positions = [0.01 * math.sin(0.01 * number) for number in range(IMAGES)]
    for name in METHODS:
        step = integrators.bind(sprung_mass(), bench.period, name)
        yield Part(f"integrator, two states: {name}", ns_per_call(step, positions))
    four = integrators.bind(free_puck(), bench.period)
    yield Part(f"integrator, four states: {integrators.DEFAULT_METHOD}", ns_per_call(four, positions))
