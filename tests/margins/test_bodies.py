"""Devices of several masses against scipy, and against the device that they become when they are coupled stiffly."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg

from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.margins import Plant, stiffness_limit
from haptic_fieldbus.margins.bodies import HAND, HungBody, dynamics, limit_with, sample_with
from haptic_fieldbus.numerics import sampled
from haptic_fieldbus.sim.hand import hand_named
from tests.loops import BENCH, LAG, PERIOD, sprung_mass, wall

LOAD = HungBody(mass=0.4, stiffness=2e4, damping=1.0, drag=0.5)
PLANT = Plant(0.25, 1.1, torque_lag=LAG)


@pytest.mark.parametrize("delay", [0.0, 0.4, 1.0])
def test_the_limit_with_a_compliant_transmission_is_where_the_loop_by_hand_begins_to_grow(delay: float) -> None:
    def radius(stiffness: float) -> float:
        """State: [x, v, load's x, load's v, motor, target, force before]."""
        system = np.zeros((6, 6))
        system[0, 1] = system[2, 3] = 1.0
        system[1] = np.array([-2e4, -1.0 - 1.1, 2e4, 1.0, 1.0, 0.0]) / 0.25
        system[3] = np.array([2e4, 1.0, -2e4, -1.0 - 0.5, 0.0, 0.0]) / 0.4
        system[4, 4:] = -1 / LAG, 1 / LAG

        def period(state: np.ndarray) -> np.ndarray:
            z, forces = state[:6].copy(), [-stiffness * state[0], state[6]]
            whole, rest = divmod(delay, 1.0)
            for force, span in ((forces[1] if delay else forces[0], rest), (forces[int(whole)], 1.0 - rest)):
                z[5] = force
                z = scipy.linalg.expm(system * span * PERIOD) @ z
            return np.array([*z, forces[0]])

        return float(np.abs(np.linalg.eigvals(np.array([period(unit) for unit in np.eye(7)]).T)).max())

    limit = limit_with(PLANT, [LOAD], PERIOD, delay * PERIOD, wall)
    assert radius(limit * (1 - 1e-6)) < 1.0 < radius(limit * (1 + 1e-6))


def test_a_stiff_transmission_is_one_mass() -> None:
    stiff = replace(LOAD, stiffness=1e8, damping=1e3)
    whole = Plant(PLANT.mass + stiff.mass, PLANT.damping + stiff.drag, torque_lag=LAG)
    found = limit_with(PLANT, [stiff], PERIOD, 0.4e-3, wall)
    assert found == pytest.approx(stiffness_limit(whole, PERIOD, 0.4e-3, wall), rel=1e-3)


def test_a_soft_transmission_that_rings_lowers_the_limit() -> None:
    limits = [
        limit_with(PLANT, [replace(LOAD, stiffness=stiffness, damping=0.005)], PERIOD, 0.4e-3, wall)
        for stiffness in (1e7, 1e5, 1e4)
    ]
    assert limits[0] > limits[1] > limits[2] > 0.0


def test_a_hand_hides_an_instability_that_appears_when_it_lets_go() -> None:
    plant = replace(BENCH, torque_lag=LAG)
    released, held = stiffness_limit(plant, PERIOD, 0.33e-3, wall), limit_with(plant, [HAND], PERIOD, 0.33e-3, wall)
    assert held > 2.0 * released


def test_the_hand_is_that_of_the_simulation() -> None:
    hand = hand_named("push")
    assert hand is not None
    assert (HAND.mass, HAND.stiffness, HAND.damping) == (hand.mass, hand.stiffness, hand.damping)


def test_no_body_at_all_is_the_plain_device() -> None:
    found = limit_with(BENCH, [], PERIOD, 0.7e-3, wall)
    assert found == pytest.approx(stiffness_limit(BENCH, PERIOD, 0.7e-3, wall), rel=1e-9)


def test_only_what_nothing_holds_may_be_left_anywhere() -> None:
    environment = sprung_mass(0.5, "exact-foh")(100.0)
    free, held = (sample_with(BENCH, [replace(LOAD, anchor=anchor)], PERIOD, 0.0) for anchor in (0.0, 500.0))
    assert free.shift is not None
    np.testing.assert_allclose(free.shift, [1.0, 0.0, 1.0, 0.0], atol=1e-12)
    assert held.shift is None
    assert sampled.growth(free, environment) < 1.0 - 1e-9
    assert sampled.growth(held, environment) == sampled.spectral_radius(sampled.loop_matrix(held, environment))


@pytest.mark.parametrize("wrong", [{"mass": 0.0}, {"mass": -1.0}, {"stiffness": float("nan")}, {"drag": -0.1}])
def test_a_body_that_cannot_be_is_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(UsageError, match="expected a number"):
        HungBody(**{"mass": 0.1, "stiffness": 1.0, **wrong})


def test_bodies_hang_on_a_mass() -> None:
    with pytest.raises(UsageError, match="above 0"):
        dynamics(Plant(0.0, 1.0), [HAND])
