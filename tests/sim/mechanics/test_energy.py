"""Energy is neither made nor lost: what motor and hand give is heat or still there, after 60 s, with every part."""

import math
from dataclasses import replace

import pytest

from haptic_fieldbus.drive.rig import Cogging, CompliantCoupling, Mechanics, Stribeck, Weight
from haptic_fieldbus.sim.hand import Grip, Piece
from haptic_fieldbus.sim.mechanics.body import Body
from haptic_fieldbus.sim.mechanics.loaded_plant import Load, LoadedPlant
from haptic_fieldbus.sim.mechanics.motion import Shaft
from haptic_fieldbus.sim.mechanics.plant import Plant
from tests.sim.mechanics.energy import balance

SHAFT = Shaft(inertia=4e-5, damping=1e-4, coulomb=2e-3, lag=1 / (2 * math.pi * 1000))
R = 0.05 / (2 * math.pi)
SINE = 2 * math.pi
GRIP = Grip(0.1 * R**2, 4 * R**2, 300 * R**2, angular_frequency=SINE, pieces=(Piece(0.0, 0.0, 0.02 * SINE),))
LOOSE = CompliantCoupling(stiffness=20.0, load_inertia=1e-5, damping=5e-3, backlash=0.01)
COGGING = Cogging(torque=2e-3, periods_per_revolution=6)
STRIBECK = Stribeck(torque=2e-3, velocity=2.0)
PARTS = {
    "nothing": (Mechanics(), None, GRIP),
    "coupling": (Mechanics(coupling=CompliantCoupling(20.0, 1e-5, 1e-3)), None, GRIP),
    "backlash": (Mechanics(coupling=LOOSE), None, GRIP),
    "weight": (Mechanics(gravity=Weight(5e-3)), None, None),
    "weight on a lever": (Mechanics(gravity=Weight(0.01, 0.3)), -0.7, None),
    "cogging": (Mechanics(cogging=COGGING), None, None),
    "Stribeck friction": (Mechanics(stribeck=STRIBECK), None, GRIP),
    "all of them": (Mechanics(LOOSE, Weight(0.01, 0.3), COGGING, STRIBECK), -0.7, GRIP),
}
TARGETS = 250
"""In 60 s."""


@pytest.mark.thorough("simulates 60 s with every part")
@pytest.mark.parametrize("name", PARTS)
def test_the_energy_of_60_seconds_adds_up(name: str) -> None:
    mechanics, lever, grip = PARTS[name]
    load = Load(SHAFT, mechanics, lever)
    plant: Body = Plant(SHAFT, grip) if mechanics.is_rigid else LoadedPlant(load, grip)
    plant.start_hand()
    for k in range(TARGETS):
        plant.set_target(0.02 * math.sin(1.7 * k))
        plant.advance((k + 1) * 60_000_000_000 // TARGETS)
    found = balance(plant, load, grip)
    assert plant.t_ns == 60_000_000_000
    assert found.turned_over > 5.0
    assert found.lost > 0.2 * found.turned_over
    assert found.error < 1e-9


def test_the_balance_would_tell_a_friction_that_is_a_ten_thousandth_off() -> None:
    plant = Plant(SHAFT, GRIP)
    plant.start_hand()
    for k in range(20):
        plant.set_target(0.02 * math.sin(1.7 * k))
        plant.advance((k + 1) * 100_000_000)
    assert balance(plant, Load(SHAFT, Mechanics()), GRIP).error < 1e-9
    wrong = replace(SHAFT, coulomb=SHAFT.coulomb * (1 + 1e-4))
    assert balance(plant, Load(wrong, Mechanics()), GRIP).error > 1e-6
