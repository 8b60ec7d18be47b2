"""The simulated shaft: a period beside one matrix product, each optional part beside the rigid shaft, and sampling."""

import math
from collections.abc import Callable
from functools import partial
from time import perf_counter

import numpy as np
from rows import Row, cost, show

from haptic_fieldbus.drive.rig import Cogging, CompliantCoupling, Mechanics, Stribeck, Weight
from haptic_fieldbus.sim.hand import Grip, Piece
from haptic_fieldbus.sim.mechanics.body import Body
from haptic_fieldbus.sim.mechanics.loaded_plant import Load, LoadedPlant
from haptic_fieldbus.sim.mechanics.motion import Shaft
from haptic_fieldbus.sim.mechanics.plant import Plant
from haptic_fieldbus.sim.mechanics.trajectory import Trajectory

SHAFT = Shaft(inertia=4e-5, damping=1e-4, coulomb=2e-3, lag=1.6e-4)
R = 0.05 / (2 * math.pi)
GRIP = Grip(0.1 * R**2, 4 * R**2, 300 * R**2, pieces=(Piece(0.0, 0.0),))
LOOSE = CompliantCoupling(stiffness=20.0, load_inertia=1e-5, damping=1e-3, backlash=0.01)
COGGING, STRIBECK = Cogging(2e-3, 14), Stribeck(1e-3, 0.5)
PARTS = {
    "coupling": Mechanics(coupling=CompliantCoupling(20.0, 1e-5, 1e-3)),
    "backlash": Mechanics(coupling=LOOSE),
    "weight": Mechanics(gravity=Weight(5e-3)),
    "weight on a lever": Mechanics(gravity=Weight(5e-3)),
    "cogging": Mechanics(cogging=COGGING),
    "Stribeck friction": Mechanics(stribeck=STRIBECK),
    "all of them": Mechanics(LOOSE, Weight(5e-3), COGGING, STRIBECK),
}
PERIOD_NS = 1_000_000
SAMPLES = 320_000


def period(plant: Body, periods: int = 1000) -> float:
    """Of a shaft that is slowly driven forwards [s]: three looks and a new target a period."""
    plant.start_hand()
    begun = perf_counter()
    for number in range(periods):
        begin_ns = plant.t_ns + 400_000 if number else 0
        plant.advance(begin_ns)
        plant.advance(begin_ns + 200_000)
        plant.set_target(3e-3 + 1e-3 * math.sin(0.37 * number))
        plant.advance(begin_ns + 600_000)
    return (perf_counter() - begun) / periods


def best(make: Callable[[], Body], repeat: int) -> float:
    return min(period(make()) for _ in range(repeat))


def sampling_row() -> Row:
    """All that the report asks of 20 s at 1 kHz with a new target in every period, beside as many sines."""
    plant = Plant(SHAFT, GRIP)
    period(plant, 20_000)
    trajectory = Trajectory(plant.recorder, plant.t_ns)
    times = np.arange(SAMPLES) * 62_498
    angles = times * 1e-9
    return Row(
        "320 000 samples, beside as many sines",
        cost(lambda: trajectory.sample(times), 1, 5),
        cost(lambda: np.sin(angles), 1),
    )


def main() -> list[Row]:
    matrix, state = np.eye(9), np.ones(9)
    product = cost(lambda: matrix @ state, 1000)
    held = best(lambda: Plant(SHAFT, GRIP), 10)
    rows = [
        Row("period of the free shaft, beside a product (9, 9) @ (9,)", best(lambda: Plant(SHAFT, None), 10), product),
        Row("period of the held shaft, beside the same", held, product),
    ]
    for name, parts in PARTS.items():
        load = Load(SHAFT, parts, 0.7 if "lever" in name or "all" in name else None)
        rows.append(Row(f"{name}, beside the held rigid shaft", best(partial(LoadedPlant, load, GRIP), 2), held))
    return [*rows, sampling_row()]


if __name__ == "__main__":
    show(main())
