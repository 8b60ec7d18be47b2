"""What each optional part costs: the whole period of a few scenes, and the parts by themselves."""

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass

from haptic_fieldbus.axis_cycle import law_of
from haptic_fieldbus.cycle import Cycle, columns, decoded_columns
from haptic_fieldbus.numerics import estimators, integrators
from haptic_fieldbus.numerics.estimators import ESTIMATORS
from haptic_fieldbus.numerics.integrators import METHODS
from haptic_fieldbus.planning import Plan
from haptic_fieldbus.record import Record
from haptic_fieldbus.report.measure.bench import Bench, Tools
from haptic_fieldbus.report.measure.problems import free_puck, sprung_mass
from haptic_fieldbus.report.measure.timing import Spread, ns_per_call, spread
from haptic_fieldbus.safety import bind_limiter

SCENES = ("wall", "damped_wall", "sprung_mass")
ENABLED = 0x0637
"""A statusword: operation enabled."""
IMAGES = 1000
POSITION, SWING = 0.025, 0.004
"""[m]: where the handle moves, inside the wall, far below the speed that trips."""


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
    """Input images of a handle that swings about 25 mm from where it began, the drive in operation enabled."""
    places = [POSITION + SWING * math.sin(2.0 * math.pi * number / IMAGES) for number in range(count)]
    return [(_image(plan, place, number),) for number, place in enumerate(places)]


def _image(plan: Plan, position: float, number: int) -> bytes:
    axis = plan.axes[0]
    known = {
        "t_ns": number * plan.period_ns,
        f"{axis.name}.age_ns": 100_000,
        f"{axis.name}.statusword": ENABLED,
        f"{axis.name}.position counts": round(position / axis.position_unit),
    }
    return plan.image.input.pack(*(known.get(name, 0) for name in decoded_columns(plan)))


def running(plan: Plan) -> Cycle:
    """A cycle in operation enabled whose handle has been led to 25 mm within a second, the fade-in behind it."""
    cycle = Cycle(plan)
    for number in range(IMAGES + 1):
        cycle(_image(plan, POSITION * number / IMAGES, number))
    return cycle


def parts(tools: Tools, bench: Bench) -> Iterator[Part]:
    """All of them, the whole periods first."""
    whole: dict[str, float] = {}
    for scene in SCENES:
        plan = tools.plan(scene)
        whole[scene], single = _period(plan)
        yield Part(f"whole period: {scene}", whole[scene], single)
    yield Part("velocity and damping (damped_wall over wall)", whole["damped_wall"] - whole["wall"])
    yield Part("element: wall", _wall(tools.plan("wall")))
    yield Part("record: one row", _record(tools.plan("wall")))
    yield Part("limits: fade-in, effort, slew", _limits(tools.plan("wall")))
    yield from _estimators(bench)
    yield from _integrators(bench)


def _period(plan: Plan) -> tuple[float, Spread]:
    given = images(plan)
    cycle = running(plan)
    cost = ns_per_call(cycle, [image for (image,) in given])
    return cost, spread(cycle, given * 10)


def _wall(plan: Plan) -> float:
    law = law_of(plan.axes[0].elements[0], plan.period)
    return ns_per_call(law, [POSITION + SWING * math.sin(0.01 * number) for number in range(IMAGES)])


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
