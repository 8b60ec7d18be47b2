"""Case of a wall that is computed for the middle of each period: it makes no energy with the true velocity."""

import math
from collections.abc import Callable

from haptic_fieldbus.margins import Plant, sample
from haptic_fieldbus.numerals import exactly, rounded
from haptic_fieldbus.numerics import sampled
from haptic_fieldbus.numerics.linear import gain
from haptic_fieldbus.numerics.passivity import damping_needed
from haptic_fieldbus.scenes.predicted_wall import PredictedWall
from haptic_fieldbus.study.case import CaseResult, share_used
from haptic_fieldbus.study.oracles import events
from haptic_fieldbus.study.oracles.held import moved_by_force

PERIOD = 1e-3
STIFFNESS = 600.0
"""[N/m]"""


def half_sample_wall(quick: bool) -> CaseResult:
    """Check that F = −K·(x + v·T/2) generates no energy with the true velocity, and little with a backward difference.

    The mass leans on the wall, 1 cm deep, so that it never leaves it. Without damping, the matrix of one period has the
    determinant 1 + h²/2 without the prediction, and exactly 1 with it. With a backward difference a lag of θ³/4 is
    left, compared with θ/2 of the plain wall, and the motion grows by h⁴/8 a period instead of h²/4.
    """
    mass, steps = 0.5, 4_000 if quick else 400_000
    h = PERIOD * math.sqrt(STIFFNESS / mass)
    predicted = PredictedWall("handle", STIFFNESS, position=-0.01, lead=0.5 * PERIOD)
    plain = _growth_a_period(mass, lambda x, v: -STIFFNESS * x, steps)
    true = _growth_a_period(mass, lambda x, v: predicted.force(x, v) + STIFFNESS * 0.01, steps)
    difference = sampled.environment(
        predicted.linearised(), period=PERIOD, method=None, estimator="backward-difference"
    )
    left = math.log(sampled.growth(sample(Plant(mass, 0.0), PERIOD, 0.0), difference))
    shaken = damping_needed(difference, PERIOD, 0.0)
    without = damping_needed(gain([[-STIFFNESS]]), PERIOD, 0.0)
    law = events.spring_damper_law(STIFFNESS, 0.5 * STIFFNESS * PERIOD, PERIOD)
    one = math.log(
        events.growth(events.map_of_turn([events.motor(mass, 0.0)], *events.every(PERIOD, 0.0), law, memory=1))
    )
    expected = 0.5 * math.log1p(0.5 * h * h)
    bound = 0.5 * STIFFNESS * PERIOD
    return CaseResult(
        f"log of growth a period: plain {rounded(expected, 4)}, true velocity 0, difference {rounded(one, 4)} (h⁴/8 = "
        f"{rounded(h**4 / 8.0)}); "
        f"passive with b = {exactly(bound)} plain, {exactly(2.0 * bound)} N·s/m by difference",
        f"plain {rounded(plain, 4)}, true velocity {rounded(true, 1)}, difference {rounded(left, 4)}; b = "
        f"{rounded(without, 4)} and {rounded(shaken, 4)} N·s/m",
        abs(plain / expected - 1.0) <= 0.01
        and abs(true) * steps <= 0.01
        and abs(left / (h**4 / 8.0) - 1.0) <= 0.01
        and abs(left / one - 1.0) <= 1e-4
        and abs(shaken / (2.0 * bound) - 1.0) <= 1e-6
        and abs(without / bound - 1.0) <= 1e-6,
        "determinants by hand, the lag θ³/4 that the difference leaves (growth to 1 %, and to 1e-4 from event to "
        "event, with the true velocity below 1 % in the whole run); b > K·T/2 + |B| with B = K·T/2 (to 1e-6)",
        tolerance="1 % of the growths, 1e-4 of that by difference, 1e-6 of the dampings",
        used=share_used(
            (plain / expected - 1.0, 0.01),
            (true * steps, 0.01),
            (left / (h**4 / 8.0) - 1.0, 0.01),
            (left / one - 1.0, 1e-4),
            (shaken / (2.0 * bound) - 1.0, 1e-6),
            (without / bound - 1.0, 1e-6),
        ),
    )


def _growth_a_period(mass: float, force: Callable[[float, float], float], steps: int) -> float:
    """Return the logarithm of the growth a period of a mass that swings about 0, by simulation.

    `force` takes position and velocity and has the stiffness STIFFNESS.
    """
    device = Plant(mass, 0.0)
    x, v, first, last = 0.001, 0.0, 0.0, 0.0
    window = round(2.0 * math.pi / (PERIOD * math.sqrt(STIFFNESS / mass)))
    for step in range(steps):
        x, v = moved_by_force(device, x, v, force(x, v), PERIOD)
        # Twice the energy, summed over one swing at each end: it varies within a swing, its sum does not.
        size = STIFFNESS * x * x + mass * v * v
        if step < window:
            first += size
        elif step >= steps - window:
            last += size
    return 0.5 * math.log(last / first) / (steps - window)
