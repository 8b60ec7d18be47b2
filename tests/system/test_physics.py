"""Physics of whole simulated runs against closed forms that know nothing of the simulation."""

import math
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from haptic_fieldbus.api import run
from haptic_fieldbus.assessing.result import Trace
from haptic_fieldbus.numerics.linear import expm
from haptic_fieldbus.scenes.scene import Scene
from haptic_fieldbus.scenes.sprung_mass import SprungMass
from tests.system.test_run import LINEAR, bilateral, fine_bench

MASS = 4.0e-5 / (0.05 / (2 * math.pi)) ** 2
"""Of the shipped bench at the handle [kg]."""
PERIOD, DELAY, LAG = 1e-3, 0.4e-3, 1.0 / (2 * math.pi * 1000.0)

Array = NDArray[np.float64]


def peaks(trace: Trace, values: Array, begin: float) -> Array:
    """Largest magnitude between each two zero crossings after `begin`, the last piece left out."""
    shown = trace.times > begin
    values = values[shown]
    cuts = np.flatnonzero(np.diff(np.sign(values)))
    return np.array([np.abs(values[a : b + 1]).max() for a, b in pairwise(cuts)])


OFFSET = 0.008
"""[m]; of the spring from where the handle starts, so that it asks for less than a quarter of rated torque."""


@pytest.mark.thorough("three long runs", quick=1)
@pytest.mark.parametrize("stiffness", [150.0, 600.0, 1400.0])
def test_a_sampled_wall_gains_the_energy_that_its_hold_leaks(stiffness: float) -> None:
    """Without friction a held force that lags by φ feeds π·K·a²·sin φ a turn into the energy K·a²/2.

    φ = ω·(T/2 + td) + atan(ωτ); the hold and the torque loop also weaken the force a little.
    """
    rig = fine_bench(viscous_damping=0.0)
    trace = run(bilateral(stiffness, OFFSET), rig, bus="sim", hand="none", duration=1.6, force=True).traces[0]
    found = peaks(trace, trace.position - OFFSET, begin=0.6)
    omega = math.sqrt(stiffness / MASS)
    lag = omega * (PERIOD / 2 + DELAY) + math.atan(omega * LAG)
    gain = np.sinc(omega * PERIOD / (2 * math.pi)) / math.hypot(1.0, omega * LAG)
    expected = math.pi / 2 * gain * math.sin(lag)  # of ln(amplitude) in half a turn
    assert np.mean(np.diff(np.log(found))) == pytest.approx(expected, rel=0.02)


def free_puck(mass: float, virtual: float, stiffness: float) -> Array:
    """Puck and virtual mass on a spring, states (x, ẋ, p, ṗ)."""
    pull = np.array([-stiffness, 0.0, stiffness, 0.0])
    return np.array([[0.0, 1.0, 0.0, 0.0], pull / mass, [0.0, 0.0, 0.0, 1.0], -pull / virtual])


@pytest.mark.parametrize("time", [1e-3, 0.1, 1.0, 10.0])
def test_the_free_puck_in_continuous_time_is_its_closed_form(time: float) -> None:
    """The centre of mass goes straight on; the distance swings at √(k·(1/M + 1/m))."""
    mass, virtual, stiffness = 0.632, 0.5, 200.0
    x, v, p, q = expm(free_puck(mass, virtual, stiffness) * time) @ np.array([0.01, 0.3, -0.02, 0.1])
    total = mass + virtual
    centre = (mass * 0.01 - virtual * 0.02 + (mass * 0.3 + virtual * 0.1) * time) / total
    omega = math.sqrt(stiffness * (1 / mass + 1 / virtual))
    distance = 0.03 * math.cos(omega * time) + 0.2 / omega * math.sin(omega * time)
    rate = -0.03 * omega * math.sin(omega * time) + 0.2 * math.cos(omega * time)
    speed = (mass * 0.3 + virtual * 0.1) / total
    expected = (
        centre + virtual / total * distance,
        speed + virtual / total * rate,
        centre - mass / total * distance,
        speed - mass / total * rate,
    )
    assert (x, v, p, q) == pytest.approx(expected, rel=1e-11, abs=5e-12)


@pytest.mark.thorough("a long run")
def test_a_free_puck_rendered_on_the_drive_swings_at_the_frequency_of_its_closed_form() -> None:
    """After the hand has let go, the force swings at √(k·(1/M + 1/m)) on top of a slow decay.

    The frequency is read by Prony's method: three modes make a recurrence over four samples.
    """
    virtual, stiffness = 0.5, 200.0
    scene = Scene("puck", "for tests", LINEAR, (SprungMass("handle", stiffness, virtual),))
    trace = run(scene, fine_bench(rated_torque=0.04), bus="sim", hand="release", duration=5.0).traces[0]
    every = 320  # about 20 ms
    force = trace.force[trace.times > 2.6][::every]
    spacing = every * float(np.median(np.diff(trace.times)))
    past = np.stack([force[2 - k : len(force) - 1 - k] for k in range(3)], axis=-1)
    recurrence = np.linalg.lstsq(past, force[3:], rcond=None)[0]
    modes = np.log(np.roots([1.0, *-recurrence]).astype(complex)) / spacing
    frequency = np.abs(modes.imag).max() / (2 * math.pi)
    expected = math.sqrt(stiffness * (1 / MASS + 1 / virtual)) / (2 * math.pi)
    assert frequency == pytest.approx(expected, rel=0.01)
