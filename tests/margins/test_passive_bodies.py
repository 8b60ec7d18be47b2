"""Passivity of a motor with a load behind a transmission: brute force over frequency, and over many hands."""

import math
from dataclasses import replace

import numpy as np
import pytest

from haptic_fieldbus.margins import Plant, passive_limit
from haptic_fieldbus.margins.bodies import HungBody, dynamics, limit_with, sample_with
from tests.loops import PERIOD, Array, wall

MOTOR = Plant(0.25, 1.1)
TRANSMISSIONS = {
    "soft": HungBody(mass=0.4, stiffness=2e3),
    "stiff": HungBody(mass=0.4, stiffness=2e5),
    "lossy": HungBody(mass=0.4, stiffness=2e4, damping=2.0, drag=0.5),
}
DELAYS = (0.0, 0.4, 1.0)
"""In periods."""


def mobility(load: HungBody, delay: float, stiffness: float, frequency: Array) -> Array:
    """Real part of velocity over force of a hand at the load, of the component at its own frequency.

    The samples see e^{jθk}·(what the hand does to the motor), and the held force acts back with the hold's share at ω.
    """
    a, b = dynamics(MOTOR, [load])
    hand = np.array([[0.0], [0.0], [0.0], [1.0 / load.mass]])
    s = 1j * frequency
    free = np.linalg.solve(s[:, None, None] * np.eye(4) - a, np.broadcast_to(np.hstack([b, hand]), (len(s), 4, 2)))
    device, z = sample_with(MOTOR, [load], PERIOD, delay * PERIOD), np.exp(s * PERIOD)
    held = z[:, None] ** -device.whole * (device.after[:, 0] + device.before[:, 0] / z[:, None])
    looped = np.linalg.solve(z[:, None, None] * np.eye(4) - device.transition, held[:, :, None])[:, 0, 0]
    force = -stiffness * free[:, 0, 1] / (1.0 + stiffness * looped)
    hold = (1.0 - 1.0 / z) / (s * PERIOD) * np.exp(-s * delay * PERIOD)
    return np.asarray((s * (free[:, 2, 1] + free[:, 2, 0] * hold * force)).real, dtype=np.float64)


FREQUENCIES = np.concatenate([np.geomspace(0.3, 3000.0, 4000), np.linspace(3200.0, 20_000.0, 4000)])
"""[rad/s], to six times what the samples can tell."""


@pytest.mark.parametrize("delay", DELAYS)
@pytest.mark.parametrize("name", TRANSMISSIONS)
def test_up_to_the_motors_own_limit_a_hand_at_the_load_is_given_no_energy(name: str, delay: float) -> None:
    limit = passive_limit(MOTOR, PERIOD, delay * PERIOD)
    told = mobility(TRANSMISSIONS[name], delay, limit, FREQUENCIES)
    assert told.min() >= -1e-9 * told.max()


@pytest.mark.parametrize("delay", [0.0, 1.0])
@pytest.mark.parametrize("name", ["soft", "stiff"])
def test_where_nothing_else_loses_energy_no_more_is_passive(name: str, delay: float) -> None:
    limit = passive_limit(MOTOR, PERIOD, delay * PERIOD)
    assert mobility(TRANSMISSIONS[name], delay, 1.01 * limit, FREQUENCIES).min() < 0.0


def test_what_a_transmission_loses_may_allow_more_and_is_not_counted() -> None:
    lossy = replace(TRANSMISSIONS["lossy"], drag=3.0)
    limit = passive_limit(MOTOR, PERIOD, 0.0)
    assert mobility(lossy, 0.0, 1.2 * limit, FREQUENCIES).min() > 0.0


@pytest.mark.thorough("judges many hands", quick=1)
@pytest.mark.parametrize("delay", DELAYS)
def test_no_hand_of_masses_springs_and_dampers_makes_it_unstable(delay: float) -> None:
    limit = passive_limit(MOTOR, PERIOD, delay * PERIOD)
    chance = np.random.default_rng(3)
    for _ in range(40):
        load, hand = (
            HungBody(mass=10 ** chance.uniform(-3, 2), stiffness=10 ** chance.uniform(1, 6),
                 damping=chance.choice([0.0, 10 ** chance.uniform(-3, 1)]), anchor=chance.choice([0.0, 1e3]))
            for _ in range(2)
        )  # fmt: skip
        assert limit_with(MOTOR, [load, hand], PERIOD, delay * PERIOD, wall) >= 0.999 * limit


def test_a_heavy_hand_without_loss_takes_all_of_it() -> None:
    heavy = HungBody(mass=1e3, stiffness=5e4)
    found = limit_with(MOTOR, [heavy], PERIOD, 0.0, wall)
    assert found == pytest.approx(passive_limit(MOTOR, PERIOD, 0.0), rel=0.02)


def test_the_port_of_a_load_that_is_rigid_is_that_of_one_mass() -> None:
    """The mobility above, against the motor and load as a single plant."""
    frequency = np.geomspace(1.0, 2000.0, 50)
    stiff = HungBody(mass=0.4, stiffness=1e9, damping=1e4)
    found = mobility(stiff, 0.4, 500.0, frequency)
    s, mass, damping = 1j * frequency, MOTOR.mass + stiff.mass, MOTOR.damping
    z, rest = np.exp(s * PERIOD), 0.4 * PERIOD
    decay = math.exp(-damping * PERIOD / mass)
    slid = mass / damping * (1.0 - decay)
    after_v = (1.0 - math.exp(-damping * (PERIOD - rest) / mass)) / damping
    after_x = (PERIOD - rest) / damping - mass / damping * after_v
    whole_v, whole_x = (1.0 - decay) / damping, PERIOD / damping - mass / damping * (1.0 - decay) / damping
    force = np.array([after_x + (whole_x - after_x) / z, after_v + (whole_v - after_v) / z])
    looped = ((z - decay) * force[0] + slid * force[1]) / ((z - 1.0) * (z - decay))
    free = 1.0 / (mass * s**2 + damping * s)
    held = -500.0 * free / (1.0 + 500.0 * looped)
    hold = (1.0 - 1.0 / z) / (s * PERIOD) * np.exp(-s * rest)
    np.testing.assert_allclose(found, (s * (free + free * hold * held)).real, rtol=1e-3, atol=1e-6)
