"""Benches for the experiments, drawn over decades and moved by the plant of the simulation, without drive or bus."""

import math
import random
from dataclasses import dataclass

from haptic_fieldbus.identification.experiment import Bounds, Experiment, GuidedMotion, Probe
from haptic_fieldbus.identification.fit import ShaftFit, fit_shaft
from haptic_fieldbus.identification.shaft import ShaftModel, ShaftRecord
from haptic_fieldbus.sim.mechanics.body import Body
from haptic_fieldbus.sim.mechanics.motion import Shaft
from haptic_fieldbus.sim.mechanics.plant import Plant


@dataclass(frozen=True)
class Bench:
    """A bench whose handle is its motor shaft, and what an experiment may do with it."""

    model: ShaftModel
    counts: int
    rate: float
    effort: float
    speed: float
    travel: float

    @property
    def bounds(self) -> Bounds:
        half = 0.5 * self.travel
        resolution = 2.0 * math.pi / self.counts
        return Bounds(1.0 / self.rate, resolution, -half, half, self.speed, self.effort, math.inf)


def drawn_bench(seed: int) -> Bench:
    """Draw a bench: inertia, friction, damping, counts, rate, delay and lag over decades."""
    draw = random.Random(seed)
    inertia, acceleration = 10.0 ** draw.uniform(-5.5, -2.5), 10.0 ** draw.uniform(2.7, 4.3)
    effort, speed = 0.25 * inertia * acceleration, 10.0 ** draw.uniform(1.0, 2.0)
    coulomb = effort * 10.0 ** draw.uniform(-1.7, -0.5)
    damping = coulomb / speed * 10.0 ** draw.uniform(-1.3, 0.8)
    counts, rate = round(2.0 ** draw.uniform(8.0, 16.0)), draw.choice([100.0, 200.0, 500.0, 1000.0])
    delay, lag = draw.uniform(0.2, 1.6) / rate, 1.0 / (2.0 * math.pi * 10.0 ** draw.uniform(1.8, 3.3))
    travel = draw.choice([2.0, 6.0, 12.0])
    model = ShaftModel(inertia, damping, coulomb, delay, lag)
    return Bench(model, counts, rate, effort, speed, travel)


@dataclass(frozen=True)
class Course:
    """Record of an experiment, with the stage, true angle and true speed of each period."""

    record: ShaftRecord
    stages: list[str]
    angles: list[float]
    speeds: list[float]

    def part(self, *left_out: str) -> ShaftRecord:
        """Return the record up to the first of these stages."""
        end = min([self.stages.index(stage) for stage in left_out if stage in self.stages], default=len(self.stages))
        record = self.record
        return ShaftRecord(record.period, record.positions[:end], record.torques[:end], record.resolution)


def plant_of_bench(bench: Bench, velocity: float = 0.0) -> Plant:
    model = bench.model
    return Plant(Shaft(model.inertia, model.damping, model.coulomb, model.lag), None, velocity=velocity)


def conducted(
    law: Experiment, bench: Bench, plant: Body, longest: float = 60.0, load: float = 0.0, jitter: float = 0.0
) -> Course:
    """Conduct an experiment on a plant, with an encoder that rounds and set-points of whole steps.

    `jitter` [s] is the largest difference of the delay of a set-point from its mean.
    """
    draw = random.Random("jitter")
    period_ns, delay_ns, step = round(1e9 / bench.rate), round(1e9 * bench.model.delay), 0.004 * bench.effort
    begin_ns, resolution = plant.t_ns, law.bounds.resolution
    waiting, course = list[tuple[int, float]](), Course(ShaftRecord(1.0 / bench.rate, (), (), resolution), [], [], [])
    positions, torques = list[float](), list[float]()
    while not law.done and len(positions) < longest * bench.rate:
        t_ns = begin_ns + len(positions) * period_ns
        while waiting and waiting[0][0] <= t_ns:
            at_ns, target = waiting.pop(0)
            plant.advance(at_ns)
            plant.set_target(target + load)
        plant.advance(t_ns)
        positions.append(math.floor(plant.position / resolution + 0.5) * resolution)
        torques.append(round(law.effort(positions[-1]) / step) * step)
        waiting.append((t_ns + delay_ns + round(1e9 * draw.uniform(-jitter, jitter)), torques[-1]))
        course.stages.append(law.stage)
        course.angles.append(plant.position)
        course.speeds.append(plant.velocity)
    plant.set_target(load)
    plant.advance(plant.t_ns + 10 * period_ns)
    record = ShaftRecord(1.0 / bench.rate, tuple(positions), tuple(torques), resolution)
    return Course(record, course.stages, course.angles, course.speeds)


def identified_bench(bench: Bench, plant: Body | None = None) -> tuple[ShaftFit, Course, Course]:
    """Measure a bench by both experiments, or another plant in its place; return the fit and both courses."""
    plant = plant or plant_of_bench(bench)
    probe = Probe(bench.bounds)
    first = conducted(probe, bench, plant)
    assert probe.failure == "", probe.failure
    led = fit_shaft([first.record])
    guess, damping = led.model, led.values["viscous_damping"].low
    motion = GuidedMotion(bench.bounds, guess.inertia, guess.coulomb, guess.load, guess.delay + guess.lag, damping)
    second = conducted(motion, bench, plant)
    assert motion.failure == "", motion.failure
    return fit_shaft([first.record, second.part("check", "stop")], guess), first, second
