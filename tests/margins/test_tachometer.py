"""Loops whose drive reads velocity only, against the same loop written out by hand, and why no hand can be trusted."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.margins import Plant, Verdict, alone, judge, sample, stiffness_limit
from haptic_fieldbus.margins.bodies import HAND, sample_with
from haptic_fieldbus.margins.group import Group, Member
from haptic_fieldbus.numerics import sampled
from haptic_fieldbus.numerics.estimators.tachometer import VelocityIntegrator
from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.numerics.sampled import TACHOMETER, environment
from haptic_fieldbus.scenes.constant import Constant
from haptic_fieldbus.scenes.sprung_mass import SprungMass
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.study.cases.friction import edge_chatter
from tests.cases import every
from tests.loops import BENCH, DELAYS, LAG, PERIOD, Array, ByHand

SEEN = replace(BENCH, tachometer=True)


class Tachometer(ByHand):
    """The position that the environment gets is summed up from velocities; where the handle is does not matter."""

    def period_map(self) -> Array:
        """State: as of `ByHand`, the position before being the summed one, and the velocity before at the end."""
        size = 8 + math.ceil(self.delay / PERIOD)
        return np.array([self._one_period(unit) for unit in np.eye(size)]).T

    def growth(self) -> float:
        modes = np.linalg.eigvals(self.period_map())
        for _ in range(1 if self.mass is None else 2):
            modes = np.delete(modes, np.argmin(np.abs(modes - 1.0)))
        return float(np.abs(modes).max())

    def _one_period(self, state: Array) -> Array:
        velocity, before, p, q = state[1], state[3], state[4], state[5]
        here = before + PERIOD * (state[-1] + velocity) / 2
        if self.mass is None:
            p, q, force = 0.0, 0.0, -self.stiffness * here - self.damping * velocity
        else:
            p, q, force = self._virtual(p, q, before, here)
        forces = [force, *state[6:-1]]
        whole = math.floor(self.delay / PERIOD + 1e-9)
        switch = self.delay - whole * PERIOD
        moved = self._move(state[:3], forces[whole + 1], switch)
        moved = self._move(moved, forces[whole], PERIOD - switch)
        return np.array([*moved, here, p, q, *forces[:-1], velocity])


def wall(damping: float) -> Callable[[float], StateSpace]:
    return lambda stiffness: environment(
        gain([[-stiffness, -damping]]), period=PERIOD, method=None, estimator=TACHOMETER
    )


def sprung(mass: float, method: str) -> Callable[[float], StateSpace]:
    return lambda stiffness: environment(
        SprungMass("handle", stiffness, mass).dynamics, period=PERIOD, method=method, estimator=TACHOMETER
    )


@every("delay", DELAYS)
@every("lag", [0.0, LAG])
@every("damping", [0.0, 2.0])
def test_the_limit_of_a_wall_is_where_the_loop_by_hand_begins_to_grow(delay: float, lag: float, damping: float) -> None:
    plant = replace(SEEN, torque_lag=lag)
    limit = stiffness_limit(plant, PERIOD, delay * PERIOD, wall(damping))
    assert math.isfinite(limit)
    at, above = (Tachometer(plant, delay * PERIOD, part * limit, damping).growth() for part in (1.0, 1.01))
    assert at == pytest.approx(1.0, abs=1e-7)
    assert above > 1.0


@pytest.mark.thorough("12 cases of one rule", quick=4)
@pytest.mark.parametrize("delay", DELAYS)
@pytest.mark.parametrize("method", ["exact-foh", "forward-euler"])
def test_a_sprung_mass_grows_as_it_does_by_hand(delay: float, method: str) -> None:
    device = sample(SEEN, PERIOD, delay * PERIOD)
    found = sampled.growth(device, sprung(0.5, method)(200.0))
    assert found == pytest.approx(Tachometer(SEEN, delay * PERIOD, 200.0, mass=0.5, method=method).growth(), abs=1e-9)


def test_the_trapezoid_is_exact_for_a_free_mass_so_a_tachometer_costs_no_stiffness_without_delay() -> None:
    """Under a force that changes with the samples v is straight between them: without damping the positions agree."""
    light = Plant(mass=0.6, damping=1e-6)
    seen = replace(light, tachometer=True)
    true, summed = sample(light, PERIOD, 0.0), sample(seen, PERIOD, 0.0)
    np.testing.assert_allclose(summed.transition, true.transition, atol=1e-12)
    np.testing.assert_allclose(summed.after, true.after, rtol=1e-6)


def test_a_wall_on_a_tachometer_is_stable_and_never_passive() -> None:
    found = Group((Member("handle", SEEN, 5e-4, (Wall("handle", 600.0),), None, TACHOMETER),), (), PERIOD).stability
    assert (found.verdict, found.stiffness_limit.passive) == (Verdict.STABLE, 0.0)


def test_a_scene_without_a_force_that_follows_the_handle_is_passive_on_a_tachometer_too() -> None:
    found = Group((Member("handle", SEEN, 5e-4, (Constant("handle", 1.0),), None, TACHOMETER),), (), PERIOD).stability
    assert found.verdict is Verdict.PASSIVE
    assert judge(alone(SEEN, PERIOD, 5e-4), wall(2.0), None)[0].verdict is Verdict.STABLE


def test_a_hand_that_is_fast_at_the_readings_gains_from_any_spring() -> None:
    """One short jerk at a reading deflects a soft spring for ever; from then on the hand only moves between readings.

    The force −K·x̂ works on it at a steady speed at which the device takes half of that: the rest is gained.
    """
    stiffness, speed, width, periods = 1.0, 1.0, 1e-9, 10_000
    spring = VelocityIntegrator(PERIOD, 0.0)
    spring.start(0.0)
    for number, reading in enumerate((speed, 0.0, *[0.0] * periods), start=1):
        spring.step(reading, number * PERIOD)
    force = -stiffness * spring.position
    assert force == pytest.approx(-stiffness * speed * PERIOD)
    jerk = BENCH.damping * speed**2 * width
    way = 0.5 * force / BENCH.damping * periods * PERIOD
    taken = BENCH.damping * way**2 / (periods * PERIOD)
    assert force * way > taken + jerk


def test_what_a_tachometer_cannot_tell_is_refused() -> None:
    with pytest.raises(UsageError, match="no velocity for a tachometer"):
        Plant(mass=0.0, damping=1.0, tachometer=True)
    with pytest.raises(UsageError, match="the position of bodies"):
        sample_with(SEEN, [HAND], PERIOD, 0.0)


def test_there_is_no_edge_between_two_counts_to_chatter_over() -> None:
    assert edge_chatter(replace(BENCH, coulomb=0.0), PERIOD, 0.0, gain([[-600.0]])) is not None
    assert edge_chatter(replace(SEEN, coulomb=0.0), PERIOD, 0.0, gain([[-600.0]])) is None


def test_a_period_without_a_reading_leaves_the_environment_as_it_is() -> None:
    device, contact = sample(SEEN, PERIOD, 0.0), wall(2.0)(600.0)
    matrix = sampled.loop_matrix(device, contact, received=False, least_memory=1)
    assert matrix[-1].tolist() == [0.0] * (len(matrix) - 1) + [1.0]
