"""What a verdict claims, held against drawn loops that are simulated from event to event.

Each loop has a device, a delay, a motor limit and one or two elements, some of them soft or stiff at other places than
in the middle. "Stable" claims that a small knock dies at every place where the handle may rest, so knocks of 1 µm/s are
given there, for 7000 periods, without friction and counts that would hide a growth of 1.001. "Passive" claims that no
passive hand gets energy from it for ever, so hands without any loss, a mass and a spring, are tuned to the loop, and
small and large knocks are given; with friction and counts large knocks and slow traverses follow.
"""

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from haptic_fieldbus.margins import Plant, Stability, Verdict
from haptic_fieldbus.margins.group import Group, Member
from haptic_fieldbus.scenes.detents import Detents
from haptic_fieldbus.scenes.end_stop import EndStop
from haptic_fieldbus.scenes.friction import Friction
from haptic_fieldbus.scenes.hunt_crossley import HuntCrossley
from haptic_fieldbus.scenes.magnet import Magnet
from haptic_fieldbus.scenes.spring import Spring
from haptic_fieldbus.scenes.wall import Wall
from tests.margins.events import Array, Bench, Law

PERIOD, WINDOWS = 1e-3, 7
TRAVEL = 0.1
"""The handle moves from −0.1 m to 0.1 m."""
GROWN = 1.05
"""A knock that is so many times larger in the end than after 1000 periods has grown, by 1e-5 a period."""
NAMES = ("wall", "end_stop", "hunt_crossley", "magnet", "detents", "spring", "friction")


@dataclass(frozen=True)
class Drawn:
    """A loop: its device, delay [s], motor limit [N], and elements."""

    plant: Plant
    delay: float
    effort: float
    elements: tuple[Any, ...]

    @cached_property
    def stability(self) -> Stability:
        travel = (-TRAVEL, TRAVEL)
        member = Member("a", self.plant, self.delay, self.elements, None, "backward-difference", (), None,
                        self.effort, travel)  # fmt: skip
        return Group((member,), (), PERIOD).stability


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
    return Friction("a", effort * 10.0 ** random.uniform(-2, -0.5), stiffness, damping=damping)


def law_of(loops: list[Drawn]) -> Law:
    """The elements again, as the simulation's own formulas have them; without an element its size is 0."""
    law, n = Law(len(loops)), len(loops)

    def of(kind: type, *values: str, **usual: float) -> list[Array]:
        found = [next((each for each in loop.elements if isinstance(each, kind)), None) for loop in loops]
        return [
            np.array([usual.get(value, 0.0) if each is None else float(getattr(each, value)) for each in found])
            for value in values
        ]

    one = np.ones(n)
    place, stiffness, damping = of(Wall, "position", "stiffness", "damping")
    law.hinges.append((place, one, stiffness, damping))
    lower, upper, stiffness, damping = of(EndStop, "lower", "upper", "stiffness", "damping")
    law.hinges += [(lower, -one, stiffness, damping), (upper, one, stiffness, damping)]
    place, effort, depth, exponent, loss = of(
        HuntCrossley, "position", "effort", "depth", "exponent", "loss", depth=1.0, exponent=1.0
    )
    law.crossleys.append((place, one, effort / depth**exponent, exponent, loss))
    place, pull, radius = of(Magnet, "position", "pull", "radius", radius=1.0)
    law.magnets.append((place, pull / (16.0 * math.sqrt(5.0) / 125.0) / radius, radius))
    place, amplitude, pitch = of(Detents, "position", "amplitude", "pitch", pitch=1.0)
    law.waves.append((place, amplitude, pitch))
    place, stiffness, damping, band, most = of(
        Spring, "position", "stiffness", "damping", "dead_band", "positive_saturation"
    )
    law.springs.append((place, stiffness, damping, band, most))
    stiffness, coulomb, damping = of(Friction, "stiffness", "coulomb", "damping")
    law.frictions.append((stiffness, coulomb, damping))
    return law


def bench_of(loops: list[Drawn], push: Array) -> Bench:
    none = np.zeros(len(loops))
    mass, damping, lag = (
        np.array([getattr(each.plant, name) for each in loops]) for name in ("mass", "damping", "torque_lag")
    )
    delay, effort = np.array([each.delay for each in loops]), np.array([each.effort for each in loops])
    return Bench(mass, damping, PERIOD, delay, lag, effort, none, none, none, none, push)


def places(loops: list[Drawn], law: Law, random: np.random.Generator) -> Array:
    """A place for each loop within or beside one of its elements; for its first copy the one that is told as the worst.

    A place at an edge is moved by 10 µm towards the stiffer side.
    """
    found, first = [], set()
    for loop in loops:
        told = loop.stability.place
        if id(loop) not in first and told is not None and told.position is not None:
            near = [told.position + step for step in (-1e-5, 0.0, 1e-5)]
            found.append(max(near, key=lambda x: _slope_of(loop, x)))
            first.add(id(loop))
            continue
        each = loop.elements[random.integers(len(loop.elements))]
        if isinstance(each, HuntCrossley):
            force = loop.effort * 10.0 ** random.uniform(-3.0, -0.01)
            found.append(each.position + each.depth * (force / each.effort) ** (1.0 / each.exponent))
        elif isinstance(each, Magnet | Detents):
            found.append(
                each.position + random.uniform(-1.0, 1.0) * getattr(each, "radius", getattr(each, "pitch", 0.0))
            )
        elif isinstance(each, Friction):
            found.append(random.uniform(-0.03, 0.03))
        else:
            way = loop.effort * 10.0 ** random.uniform(-3.0, -0.01) / each.stiffness
            edges = {"end_stop": "upper"}.get(each.name, "position")
            found.append(getattr(each, edges) + getattr(each, "dead_band", 0.0) + way)
    return np.array(found)


def _slope_of(loop: Drawn, x: float) -> float:
    return float(slope(law_of([loop]), np.array([x]))[0])


def slope(law: Law, x: Array, step: float = 1e-7) -> Array:
    """−dF/dx with all frictions sliding along: a friction holds, and only adds to it."""
    return (law.at_rest(x - step) - law.at_rest(x + step)) / (2.0 * step)


def potential_range(law: Law, effort: Array, low: Array, high: Array) -> Array:
    """Largest difference of the potential of the cut force between two positions, (n,)."""
    share = np.linspace(0.0, 1.0, 400)
    grid = [low + part * (high - low) for part in share]
    force = np.array([np.clip(law.at_rest(x), -effort, effort) for x in grid])
    work = np.cumsum(0.5 * (force[1:] + force[:-1]) * (high - low) / (len(share) - 1), axis=0)
    return np.asarray(np.maximum(work.max(axis=0), 0.0) - np.minimum(work.min(axis=0), 0.0))


def grown(windows: Array, least: float) -> Array:
    return np.asarray((windows[-3:].max(axis=0) + least) / (windows[1:4].max(axis=0) + least))


@dataclass(frozen=True)
class Trial:
    """A batch of drawn loops, each in several columns of one simulation."""

    loops: list[Drawn]
    verdicts: NDArray[np.object_]
    copies: int

    @classmethod
    def of(cls, loops: list[Drawn], copies: int) -> "Trial":
        verdicts = np.array([loop.stability.verdict for loop in loops], dtype=object)
        return cls(loops * copies, np.tile(verdicts, copies), copies)

    def called(self, *verdicts: Verdict) -> NDArray[np.bool_]:
        return np.array([each in verdicts for each in self.verdicts])

    def told(self, false: NDArray[np.bool_], **values: NDArray[Any]) -> str:
        at = np.flatnonzero(false)[:3]
        return "\n".join(
            f"{self.loops[n]} {self.verdicts[n]} { {key: each[n] for key, each in values.items()} }" for n in at
        )


BATCH_SIZES = pytest.mark.parametrize(
    ("batch", "size", "periods"),
    [
        pytest.param(0, 30, 2100, id="few"),
        *(pytest.param(each, 200, 7000, id=f"batch-{each}") for each in range(1, 11)),
    ],
)


@pytest.mark.thorough("simulates 2000 drawn loops", quick=("few",))
@BATCH_SIZES
def test_no_loop_is_called_better_than_it_is(batch: int, size: int, periods: int) -> None:
    random = np.random.default_rng(1600 + batch)
    # Three places, and at each a free handle, and one in a hand without loss knocked gently and hard.
    trial = Trial.of([drawn(random) for _ in range(size)], 9)
    law, kind = law_of(trial.loops), np.repeat(np.arange(9) % 3, size)
    x = places(trial.loops, law, random)
    push = -law.at_rest(x)
    bench = bench_of(trial.loops, push)
    rests = (np.abs(push) <= 0.99 * bench.effort) & (np.abs(x) <= TRAVEL) & (slope(law, x) > 1e-3)
    tuned = np.array([loop.elements[0].stiffness for loop in trial.loops]) * 10.0 ** random.uniform(-2.0, 1.0, len(x))
    bench.hand_mass = np.where(kind > 0, bench.mass * 10.0 ** random.uniform(-1.0, 0.5, len(x)), 0.0)
    bench.hand_stiffness = np.where(kind > 0, tuned, 0.0)
    hard = 10.0 ** random.uniform(-4.0, 0.0, len(x))
    knock = np.where(kind == 2, hard, 1e-6)
    reach, energy = bench.run(law, x, knock, periods, WINDOWS)
    # A motion slower than 2 s a turn is not seen to grow or to die in windows of 3 s.
    turning = slope(law, x) + bench.hand_stiffness > 10.0 * (bench.mass + bench.hand_mass)
    rests &= turning
    # One that grows fast is at its limit before the second window: it is then far beyond what the knock alone moves.
    moved = knock * np.sqrt(bench.mass / np.maximum(slope(law, x), 1e-3))
    grows = rests & (kind < 2) & ((grown(reach, 1e-12) > GROWN) | ((kind == 0) & (reach[-1] > 30.0 * moved)))
    false = grows & np.where(kind == 0, trial.called(Verdict.STABLE, Verdict.PASSIVE), trial.called(Verdict.PASSIVE))
    assert not false.any(), trial.told(false, x=x, push=push, end=reach[-1], start=reach[1], hand=kind)
    far = reach.max(axis=0)
    bound = 0.5 * (bench.mass + bench.hand_mass) * knock**2 + potential_range(law, bench.effort, x - far, x + far)
    bound += np.abs(push) * far
    false = (kind == 2) & (energy[-1] > 2.0 * bound) & trial.called(Verdict.PASSIVE)
    assert not false.any(), trial.told(false, x=x, push=push, knock=knock, last=energy[-1], bound=bound)
    dies = ~(grows & (kind == 0)).reshape(9, size).any(axis=0)
    refused = (dies & trial.called(Verdict.UNSTABLE)[:size]).sum()
    quiet = ~grows.reshape(9, size).any(axis=0) & trial.called(Verdict.STABLE)[:size]
    counts = ", ".join(f"{trial.called(each)[:size].sum()} {each.value}" for each in Verdict)
    print(
        f"{batch}: {counts}; {refused} unstable ones died at the places tried, {quiet.sum()} stable ones in every hand"
    )


@pytest.mark.thorough("simulates 2000 drawn loops with friction and counts", quick=("few",))
@BATCH_SIZES
def test_hard_knocks_and_slow_traverses_with_friction_and_counts_give_no_energy(
    batch: int, size: int, periods: int
) -> None:
    random = np.random.default_rng(2600 + batch)
    loops = []
    for _ in range(size):
        loop = drawn(random)
        coulomb, step = loop.effort * 10.0 ** random.uniform(-3.0, -1.5), 10.0 ** random.uniform(-6.0, -4.5)
        plant = replace(loop.plant, coulomb=coulomb, resolution=step, torque_lag=0.0)
        loops.append(replace(loop, plant=plant))
    trial = Trial.of(loops, 2)
    law, traverse = law_of(trial.loops), np.repeat([False, True], size)
    x = places(trial.loops, law, random)
    bench = bench_of(trial.loops, -law.at_rest(x))
    bench.coulomb, bench.resolution = (
        np.array([getattr(loop.plant, name) for loop in trial.loops]) for name in ("coulomb", "resolution")
    )
    bench.hand_mass = bench.mass * 10.0 ** random.uniform(-1.0, 1.0, len(x))
    bench.push += np.where(traverse, bench.coulomb * random.choice([-1.5, 1.5], len(x)), 0.0)
    knock = np.where(traverse, 0.0, 10.0 ** random.uniform(-3.0, 0.0, len(x)))
    reach, energy = bench.run(law, x, knock, periods, WINDOWS)
    far = reach.max(axis=0)
    bound = 0.5 * (bench.mass + bench.hand_mass) * knock**2 + potential_range(law, bench.effort, x - far, x + far)
    bound += np.abs(bench.push) * far
    false = (energy[-1] > 2.0 * bound + 1e-9) & trial.called(Verdict.PASSIVE)
    assert not false.any(), trial.told(false, x=x, push=bench.push, knock=knock, last=energy[-1], bound=bound)
