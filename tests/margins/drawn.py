"""Loops with one or two drawn elements, their verdicts, and the same forces for the event-exact simulation."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, cast

import numpy as np

from haptic_fieldbus.margins import Plant, Verdict
from haptic_fieldbus.margins.group import Group, Member
from haptic_fieldbus.margins.stiffness_map import Places
from haptic_fieldbus.margins.verdict import verdict_at_places
from haptic_fieldbus.scenes.detents import Detents
from haptic_fieldbus.scenes.end_stop import EndStop
from haptic_fieldbus.scenes.friction import Friction
from haptic_fieldbus.scenes.generalised_maxwell import GeneralisedMaxwell
from haptic_fieldbus.scenes.hunt_crossley import HuntCrossley
from haptic_fieldbus.scenes.kelvin_voigt import KelvinVoigt
from haptic_fieldbus.scenes.magnet import Magnet
from haptic_fieldbus.scenes.needle import Needle
from haptic_fieldbus.scenes.spring import Spring
from haptic_fieldbus.scenes.standard_linear_solid import StandardLinearSolid
from haptic_fieldbus.scenes.texture import Texture
from haptic_fieldbus.scenes.wall import Wall
from tests.margins import laws
from tests.margins.laws import Array, Law, Part, Rows

PERIOD = 1e-3
TRAVEL = 0.1
"""The handle moves from −0.1 m to 0.1 m."""
NAMES = (
    "wall", "end_stop", "hunt_crossley", "magnet", "detents", "spring", "texture", "needle", "kelvin_voigt",
    "standard_linear_solid", "generalised_maxwell", "friction",
)  # fmt: skip
TISSUES = (KelvinVoigt, StandardLinearSolid, GeneralisedMaxwell)


@dataclass(frozen=True)
class Drawn:
    """A loop: its device, delay [s], motor limit [N], and elements."""

    plant: Plant
    delay: float
    effort: float
    elements: tuple[Any, ...]

    @cached_property
    def group(self) -> Group:
        travel = (-TRAVEL, TRAVEL)
        member = Member("a", self.plant, self.delay, self.elements, None, "backward-difference", (), None,
                        self.effort, travel)  # fmt: skip
        return Group((member,), (), PERIOD)

    @cached_property
    def environment(self) -> Places:
        return cast("Places", self.group.environment())

    @cached_property
    def verdict(self) -> Verdict:
        """The verdict alone; the limits beside it take ten times as long."""
        return verdict_at_places(self.group.loop, self.environment)

    @cached_property
    def worst(self) -> float | None:
        """Position of the place that is told as the worst."""
        place, _ = self.group.loop.judged_at(self.environment)
        return None if place is None else place.position


def drawn(random: np.random.Generator) -> Drawn:
    mass, damping = 10.0 ** random.uniform(-1.3, 0.3), 10.0 ** random.uniform(-0.7, 0.7)
    delay, lag = float(random.choice([0.0, 0.4e-3, 1e-3, 1.6e-3])), float(random.choice([0.0, 0.16e-3]))
    effort = 10.0 ** random.uniform(0.7, 2.0)
    limit = damping / (0.5 * PERIOD + delay + lag)
    first = str(random.choice(NAMES[:-1]))
    others = [each for each in NAMES if each != first]
    names = [first] + ([str(random.choice(others))] if random.random() < 0.5 else [])
    elements = tuple(element(name, limit * 10.0 ** random.uniform(-0.9, 0.3), effort, random) for name in names)
    return Drawn(Plant(mass, damping, torque_lag=lag), delay, effort, elements)


def element(name: str, stiffness: float, effort: float, random: np.random.Generator) -> Any:
    place, size = random.uniform(-0.02, 0.02), 10.0 ** random.uniform(-2.5, -1.5)
    damped = random.random() < 0.4
    damping = 2e-3 * stiffness * random.random() if damped else 0.0
    if name == "wall":
        return Wall("a", stiffness, place, damping)
    if name == "end_stop":
        return EndStop("a", stiffness, place - size, place + size, damping)
    if name == "hunt_crossley":
        exponent, force = random.uniform(1.0, 3.0), effort * 10.0 ** random.uniform(-1.5, 0.5)
        return HuntCrossley("a", force, exponent * force / stiffness, place, exponent, random.uniform(0, 1) * damped)
    if name == "magnet":
        return Magnet("a", 0.286217 * stiffness * size, size, place)
    if name == "detents":
        return Detents("a", stiffness * size / (2.0 * math.pi), size, place)
    if name == "spring":
        most = effort * 10.0 ** random.uniform(-1.0, 0.5)
        band = size * random.random() * (random.random() < 0.5)
        return Spring("a", stiffness, place, damping, band, positive_saturation=most, negative_saturation=most)
    if name == "texture":
        if random.random() < 0.5:
            return Texture("a", stiffness * size / (2.0 * math.pi), size)
        rounding = random.uniform(0.1, 1.0)
        return Texture("a", stiffness * size * rounding / 4.0, size, "triangle", rounding)
    if name == "needle":
        return needle(stiffness, effort, damping, place, random)
    if name == "friction":
        return Friction("a", effort * 10.0 ** random.uniform(-2, -0.5), stiffness, damping=damping)
    return tissue(name, stiffness, place, random)


def needle(stiffness: float, effort: float, drag: float, place: float, random: np.random.Generator) -> Needle:
    puncture, curvature = effort * 10.0 ** random.uniform(-1.5, 0.2), random.random()
    friction, cutting = (puncture * random.uniform(0.1, 0.6) * (random.random() < 0.7) for _ in range(2))
    breakaway = friction * random.uniform(1.0, 2.0) * (random.random() < 0.5)
    return Needle(
        "a", puncture, puncture * (1.0 + curvature) / stiffness, stiffness * 10.0 ** random.uniform(-1.0, 0.0),
        friction, breakaway, cutting, drag, curvature=curvature, position=place,
    )  # fmt: skip


def tissue(name: str, stiffness: float, place: float, random: np.random.Generator) -> Any:
    if name == "kelvin_voigt":
        return KelvinVoigt("a", stiffness, 2e-3 * stiffness * 10.0 ** random.uniform(-1.5, 0.0), place)
    rest, time = stiffness * random.uniform(0.1, 0.9), 10.0 ** random.uniform(-4.0, -0.5)
    if name == "standard_linear_solid":
        return StandardLinearSolid("a", rest, stiffness - rest, time, place)
    share = random.random()
    branches = tuple(
        (part * (stiffness - rest), time * 10.0 ** random.uniform(-1.0, 1.0)) for part in (share, 1 - share)
    )
    return GeneralisedMaxwell("a", rest, branches, place)


def law_of(loops: list[Drawn]) -> Law:
    """The elements again, as the simulation's own formulas have them."""
    law = Law(len(loops))

    def of(kind: type, **also: Any) -> tuple[Rows, Any]:
        found = [
            (row, each)
            for row, loop in enumerate(loops)
            for each in loop.elements
            if isinstance(each, kind) and all(getattr(each, name) == value for name, value in also.items())
        ]

        def read(*names: str) -> list[Array]:
            return [np.array([float(getattr(each, name)) for _, each in found]) for name in names]

        return np.array([row for row, _ in found], dtype=np.intp), read

    def add(part: Part) -> None:
        if len(part.rows):
            law.parts.append(part)

    rows, read = of(Wall)
    edge, stiffness, damping = read("position", "stiffness", "damping")
    add(laws.Hinge(rows, edge, np.ones(len(rows)), stiffness, damping))
    rows, read = of(EndStop)
    lower, upper, stiffness, damping = read("lower", "upper", "stiffness", "damping")
    add(laws.Hinge(rows, lower, -np.ones(len(rows)), stiffness, damping))
    add(laws.Hinge(rows, upper, np.ones(len(rows)), stiffness, damping))
    rows, read = of(HuntCrossley)
    edge, effort, depth, exponent, loss = read("position", "effort", "depth", "exponent", "loss")
    add(laws.Crossley(rows, edge, effort / depth**exponent, exponent, loss))
    rows, read = of(Magnet)
    middle, pull, radius = read("position", "pull", "radius")
    add(laws.Well(rows, middle, pull / (16.0 * math.sqrt(5.0) / 125.0) / radius, radius))
    rows, read = of(Detents)
    add(laws.Wave(rows, *read("position", "amplitude", "pitch")))
    rows, read = of(Texture, profile="sine")
    add(laws.Wave(rows, np.zeros(len(rows)), *read("amplitude", "pitch")))
    rows, read = of(Texture, profile="triangle")
    add(laws.Zigzag(rows, *read("amplitude", "pitch", "rounding")))
    rows, read = of(Spring)
    add(laws.Condition(rows, *read("position", "stiffness", "damping", "dead_band", "positive_saturation")))
    rows, read = of(Friction)
    add(laws.Stick(rows, *read("stiffness", "coulomb", "damping")))
    rows, read = of(Needle)
    shaft = read("grip", "friction", "breakaway", "cutting", "drag", "slow")
    add(laws.Puncture(rows, *read("position", "puncture", "depth", "curvature"), *shaft))
    rows, read = of(KelvinVoigt)
    edge, stiffness, damping = read("position", "stiffness", "damping")
    add(laws.Voigt(rows, edge, stiffness, damping, PERIOD))
    rows, read = of(StandardLinearSolid)
    edge, rest, branch, time = read("position", "rest", "branch", "time")
    add(laws.Zener(rows, edge, rest, ((branch, time),), PERIOD))
    rows, read = of(GeneralisedMaxwell)
    many = [each.branches for row in rows for each in loops[row].elements if isinstance(each, GeneralisedMaxwell)]
    pairs = tuple((np.array([each[n][0] for each in many]), np.array([each[n][1] for each in many])) for n in range(2))
    edge, rest = read("position", "rest")
    add(laws.Zener(rows, edge, rest, pairs, PERIOD))
    return law


def place_in(loop: Drawn, random: np.random.Generator) -> float:
    """Return a place within or beside one of the elements."""
    each = loop.elements[random.integers(len(loop.elements))]
    push = loop.effort * 10.0 ** random.uniform(-3.0, -0.01)
    if isinstance(each, HuntCrossley):
        return float(each.position + each.depth * (push / each.effort) ** (1.0 / each.exponent))
    if isinstance(each, Magnet):
        return each.position + each.radius * random.uniform(-1.0, 1.0)
    if isinstance(each, Detents | Texture):
        return float(getattr(each, "position", 0.0) + each.pitch * random.uniform(-1.0, 1.0))
    if isinstance(each, Friction):
        return float(random.uniform(-0.03, 0.03))
    if isinstance(each, Needle):
        return each.position + each.depth * random.uniform(0.0, 2.0)
    edge = each.upper if isinstance(each, EndStop) else each.position
    return float(edge + getattr(each, "dead_band", 0.0) + push / getattr(each, "rest", each.stiffness))


def softness(loops: list[Drawn]) -> Array:
    """1 where a tissue relaxes, and slopes are those of its springs that stay; else 0."""
    return np.array([float(any(isinstance(each, TISSUES) for each in loop.elements)) for loop in loops])
