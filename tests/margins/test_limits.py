"""Limits of stiffness against Schur and Cohn in extended precision, and against the simulator's own period."""

import itertools
import math

import mpmath as mp
import numpy as np
import pytest

from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.margins import Plant, alone, judge, stiffness_limit, weakened
from haptic_fieldbus.numerics.batch import loops, run
from haptic_fieldbus.numerics.linear import StateSpace
from haptic_fieldbus.sim.mechanics.motion import Shaft
from haptic_fieldbus.sim.mechanics.plant import Plant as SimulatedPlant
from tests.cases import every
from tests.loops import BENCH, PERIOD, Array, wall, with_damping
from tests.margins.extended import DIGITS, all_inside, characteristic

MASSES = (1e-5, 1e-3, 0.1, 10.0)
DAMPINGS = (1e-2, 0.1, 1.0, 10.0, 100.0)
DELAYS = (0.0, 0.5, 1.0, 2.0, 10.0)
"""In periods."""


def split(delay: float) -> tuple[int, float]:
    return int(delay), (delay - int(delay)) * PERIOD


@pytest.mark.thorough("60 digits for each of 10 limits", quick=1)
@pytest.mark.parametrize("delay", DELAYS)
@pytest.mark.parametrize("virtual", [0.0, 0.4])
def test_the_limit_is_right_to_a_millionth_in_sixty_digits(delay: float, virtual: float) -> None:
    for mass in MASSES:
        for damping in DAMPINGS:
            limit = stiffness_limit(Plant(mass, damping), PERIOD, delay * PERIOD, with_damping(virtual))
            with mp.workdps(DIGITS):
                if limit == 0.0:
                    smallest = 1e-9 * (mass / PERIOD**2 + damping / PERIOD)
                    assert not all_inside(characteristic(mass, damping, PERIOD, split(delay), smallest, virtual))
                    continue
                inside = [
                    all_inside(characteristic(mass, damping, PERIOD, split(delay), limit * part, virtual))
                    for part in (0.5, 1 - 1e-6, 1 + 1e-6)
                ]
            assert inside == [True, True, False], (mass, damping)


@every("delay", DELAYS)
@every("mass", MASSES)
def test_without_any_damping_the_limit_is_exactly_zero(delay: float, mass: float) -> None:
    assert stiffness_limit(Plant(mass, 0.0), PERIOD, delay * PERIOD, wall) == 0.0


class Simulated:
    """One period of the simulation's plant from each unit state: [x, v, motor, target, x before, forces on the way]."""

    def __init__(self, plant: Plant, delay: float, stiffness: float, damping: float) -> None:
        self.shaft = Shaft(plant.mass, plant.damping, 0.0, plant.torque_lag)
        self.period_ns, self.delay_ns = round(1e9 * PERIOD), round(1e9 * PERIOD * delay)
        self.stiffness, self.damping = stiffness, damping
        self.waiting = self.delay_ns // self.period_ns

    def radius(self) -> float:
        period_map = np.array([self.period(unit) for unit in np.eye(5 + self.waiting)]).T
        return float(np.abs(np.linalg.eigvals(period_map)).max())

    def period(self, state: Array) -> Array:
        x, v, motor, target, before, *forces = state.tolist()
        plant = SimulatedPlant(self.shaft, None, position=x, velocity=v)
        plant.state = (*plant.state[:2], motor, *plant.state[3:7], target, 0.0)
        forces.insert(0, -self.stiffness * x - self.damping * (x - before) / PERIOD)
        plant.advance(self.delay_ns % self.period_ns)
        plant.set_target(forces.pop())
        plant.advance(self.period_ns)
        return np.array([plant.position, plant.velocity, plant.torque, plant.state[7], x, *forces])


def limit_of(mass: float, damping: float, delay: float, virtual: float) -> tuple[Plant, float]:
    """A device with the torque loop that the simulation always has, and the limit of a wall on it."""
    plant = Plant(mass, damping, torque_lag=1.6e-4)
    return plant, stiffness_limit(plant, PERIOD, delay * PERIOD, with_damping(virtual))


@pytest.mark.thorough("50 simulated periods", quick=3)
@pytest.mark.parametrize("delay", DELAYS)
@pytest.mark.parametrize("virtual", [0.0, 0.4])
@pytest.mark.parametrize("mass", [*MASSES, 0.63])
def test_the_simulations_own_period_turns_unstable_at_the_limit(delay: float, virtual: float, mass: float) -> None:
    for damping in DAMPINGS:
        plant, limit = limit_of(mass, damping, delay, virtual)
        if limit:
            below, above = (Simulated(plant, delay, limit * part, virtual).radius() for part in (1 - 1e-4, 1 + 1e-4))
            assert below < 1.0 < above, damping
        else:
            assert Simulated(plant, delay, 1e-6 * mass / PERIOD**2, virtual).radius() > 1.0, damping


@pytest.mark.thorough("30 000 periods of every wall")
def test_let_run_freely_a_wall_fades_below_its_limit_and_grows_above() -> None:
    """Flicked, 1e-4 on both sides; all those in which a motion changes by a factor of three within 30 000 periods."""
    steps, visible = 30_000, []
    for mass, damping, delay, virtual in itertools.product(MASSES, DAMPINGS, DELAYS, (0.0, 0.4)):
        plant, limit = limit_of(mass, damping, delay, virtual)
        growths = [Simulated(plant, delay, limit * part, virtual).radius() for part in (1 - 1e-4, 1 + 1e-4)]
        if limit and min(abs(math.log(growth)) for growth in growths) > math.log(3.0) / steps:
            visible.append((mass, damping, delay, virtual, limit))
    assert len(visible) > 30
    mass, damping, delay, virtual, limit = np.repeat(np.array(visible), 2, axis=0).T
    stiffness = limit * np.tile([1 - 1e-4, 1 + 1e-4], len(visible))
    let_run = run(loops(mass=mass, damping=damping, period=PERIOD, delay=delay * PERIOD, lag=1.6e-4, velocity=1.0,
                        stiffness=stiffness, virtual_damping=virtual), steps)  # fmt: skip
    below, above = (let_run.peaks[-1] / let_run.peaks[4]).reshape(-1, 2).T
    assert (below < 0.7).all()
    assert (above > 1.4).all()


def test_friction_that_is_known_badly_is_looked_at_with_less_of_it() -> None:
    plant = weakened(BENCH)
    assert (plant.damping, plant.coulomb) == (0.7 * BENCH.damping, 0.7 * BENCH.coulomb)
    assert stiffness_limit(plant, PERIOD, 0.0, wall) < 0.72 * stiffness_limit(BENCH, PERIOD, 0.0, wall)


@pytest.mark.parametrize("period", [0.0, -1e-3, math.nan, math.inf])
def test_a_period_that_is_none_is_refused_with_its_limit(period: float) -> None:
    with pytest.raises(UsageError, match="expected a time above 0 s"):
        stiffness_limit(BENCH, period, 0.0, wall)


@pytest.mark.parametrize("delay", [-1e-3, math.nan, math.inf])
def test_a_delay_that_is_none_is_refused_with_its_limit(delay: float) -> None:
    with pytest.raises(UsageError, match="expected a time from 0 s up"):
        judge(alone(BENCH, PERIOD, delay), wall, 100.0)


@pytest.mark.parametrize("stiffness", [math.nan, -1.0, math.inf])
def test_a_stiffness_that_is_none_is_refused_with_the_limit_of_this_loop(stiffness: float) -> None:
    with pytest.raises(UsageError, match=r"expected a number from 0 up; this loop is stable to \d"):
        judge(alone(BENCH, PERIOD, 0.0), wall, stiffness)


def test_the_limit_does_not_depend_on_how_an_environment_is_written() -> None:
    def late(stiffness: float) -> StateSpace:
        """One period of delay inside the environment."""
        return StateSpace(np.zeros((1, 1)), np.ones((1, 1)), np.array([[-stiffness]]), np.zeros((1, 1)))

    inside, outside = stiffness_limit(BENCH, PERIOD, 0.0, late), stiffness_limit(BENCH, PERIOD, PERIOD, wall)
    assert inside == pytest.approx(outside, rel=1e-9)
