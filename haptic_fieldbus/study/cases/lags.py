"""Case of a torque loop with a lag: its limits of stability and passivity, and the damping that a wall then needs."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from haptic_fieldbus.margins import Plant, alone, passive_limit, passive_limit_of, stiffness_limit
from haptic_fieldbus.numerals import exactly, rounded
from haptic_fieldbus.numerics.linear import StateSpace
from haptic_fieldbus.study.case import CaseResult, share_used, values_text
from haptic_fieldbus.study.measure import region
from haptic_fieldbus.study.oracles import energies, events
from haptic_fieldbus.study.oracles.contact import limit_in_contact

PERIOD = 1e-3
BENCHES = ((0.4e-3, 0.3e-3), (0.16e-3, 1.2e-3), (2e-3, 0.5e-3))
"""Lag and delay [s]."""
MASS, DAMPING, VIRTUAL = 0.1, 2.0, 0.5
"""Device [kg, N·s/m], and the damper of a wall [N·s/m]."""
DASHPOT = 20.0
"""Dashpot in series with a spring [N·s/m]; without the spring it would be too large to be passive."""
ASKED = 300.0
"""Stiffness of the wall for which the required damping is computed [N/m]."""
AGREEMENT, CUT = 1e-6, 5e-4
"""Permitted relative difference of limits of stability, and of energies: motions are cut into cells."""


Force = Callable[[complex], complex]
"""Force at the samples per position, as a function of z."""


def _wall(stiffness: float) -> StateSpace:
    return region.wall(stiffness, VIRTUAL, PERIOD, "backward-difference")


def _wall_by_hand(stiffness: float, virtual: float = VIRTUAL) -> Force:
    return lambda z: -stiffness - virtual * (1.0 - 1.0 / z) / PERIOD


def _maxwell(stiffness: float) -> StateSpace:
    """Return a spring in series with the dashpot, by s = (1 − z⁻¹)/T: its pole moves with the stiffness."""
    whole = stiffness * PERIOD + DASHPOT
    pole, step = DASHPOT / whole, -stiffness * DASHPOT / whole
    return StateSpace(*(np.array([[value]]) for value in (pole, 1.0, step * (pole - 1.0), step)))


def _maxwell_by_hand(stiffness: float) -> Force:
    def force(z: complex) -> complex:
        s = (1.0 - 1.0 / z) / PERIOD
        return -stiffness * DASHPOT * s / (stiffness + DASHPOT * s)

    return force


@dataclass(frozen=True)
class _Found:
    """Answers of the package for one lag and delay, and the results of the oracles for them."""

    stable: float
    by_hand: float
    passive: tuple[float, float, float]
    """Limits of spring, wall and Maxwell body [N/m]."""
    needed: tuple[float, float, float, float]
    """Share of the damping that the worst motion needs at these limits; for ASKED, relative to the computed damping."""


def _found(lag: float, delay: float, cells: int) -> _Found:
    plant, drives = Plant(MASS, DAMPING, torque_lag=lag), [energies.LateDrive(DAMPING, delay, lag)]
    limits = (
        passive_limit(plant, PERIOD, delay),
        passive_limit_of(plant, PERIOD, delay, _wall, math.inf),
        passive_limit_of(plant, PERIOD, delay, _maxwell, math.inf),
    )
    forces = [
        _wall_by_hand(limits[0], 0.0),
        _wall_by_hand(limits[1]),
        _maxwell_by_hand(limits[2]),
        _wall_by_hand(ASKED),
    ]
    one, two, three, four = (energies.worst_share(force, drives, PERIOD, cells) for force in forces)
    asked = alone(plant, PERIOD, delay).damping_share(_wall(ASKED))
    stable = stiffness_limit(plant, PERIOD, delay, _wall)
    by_hand = limit_in_contact(events.motor(MASS, DAMPING, lag), PERIOD, delay, VIRTUAL)
    return _Found(stable, by_hand, limits, (one, two, three, four / asked))


def torque_lag(quick: bool) -> CaseResult:
    """Check that the lag of a torque loop counts in stability and, as energy, in each way to passivity.

    The ways are the closed form of a spring, the largest gain of a wall with a damper, the bisection for a Maxwell
    body, and the damping that a wall requires.
    """
    found = [_found(lag, delay, 24 if quick else 48) for lag, delay in BENCHES]
    apart = max(abs(each.stable / each.by_hand - 1.0) for each in found)
    worst = max(abs(share - 1.0) for each in found for share in each.needed)
    return CaseResult(
        f"lags of 0.4, 0.16, 2 ms: stable to {values_text([each.by_hand for each in found], 6)} N/m; where passivity "
        "ends, the worst motion needs all of the device's damping",
        f"stable to {values_text([each.stable for each in found], 6)} N/m, apart by {rounded(apart, 1)}; passive to "
        f"{'; '.join(values_text(each.passive, 4) for each in found)} N/m (spring, wall, Maxwell body); needed share "
        f"of the damping off by {rounded(worst, 1)}",
        apart <= AGREEMENT and worst <= CUT,
        "device and torque loop from event to event; the worst of all motions in cells of constant speed",
        tolerance=f"{exactly(AGREEMENT)} of the limits of stability, {exactly(CUT)} of the energies",
        used=share_used((apart, AGREEMENT), (worst, CUT)),
    )
