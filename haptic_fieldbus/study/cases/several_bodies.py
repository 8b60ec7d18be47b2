"""Cases of loops of more than one body: axes that a coupling ties together, and a load on a compliant transmission."""

import math

import numpy as np

from haptic_fieldbus.margins import Plant
from haptic_fieldbus.margins.bodies import HungBody
from haptic_fieldbus.margins.group import Group, Member
from haptic_fieldbus.numerals import exactly, rounded
from haptic_fieldbus.scenes.coupling import Coupling
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.study.case import CaseResult, share_used, values_text
from haptic_fieldbus.study.oracles import energies, events
from haptic_fieldbus.study.oracles.contact import limit_in_contact
from haptic_fieldbus.study.oracles.polynomials import largest

PERIOD = 1e-3
ESTIMATOR = "backward-difference"
AGREEMENT, CUT, EXACT = 1e-6, 5e-4, 1e-12
"""Permitted relative difference of limits of stability; of energies, for motions are cut into cells; of forces."""
FIRST, SECOND = Plant(0.1, 2.0, 0.02, 1e-5, 0.4e-3), Plant(0.05, 0.8, 0.001, 2e-6)
"""Devices of two axes, with friction and encoder; the motor of the first one lags."""
DELAYS = (0.3e-3, 1.2e-3)
"""From sample to force [s]."""
SHAFTS = ((0.05, -2.5), (0.15, 0.4))
"""Damping B [N·s/m] and ratio n of shafts between the axes."""


def _tied(damping: float, ratio: float) -> Group:
    members = [
        Member(name, plant, delay, (), None, ESTIMATOR)
        for name, plant, delay in zip("ab", (FIRST, SECOND), DELAYS, strict=True)
    ]
    return Group(tuple(members), (Coupling(("a", "b"), 1.0, damping, ratio),), PERIOD)


def _stable_by_hand(damping: float, ratio: float) -> float:
    bodies = [events.motor(each.mass, each.damping, each.torque_lag) for each in (FIRST, SECOND)]
    turn, shots = events.every(PERIOD, *DELAYS)

    def is_stable(stiffness: float) -> bool:
        law = events.shaft(stiffness, damping, ratio, PERIOD)
        # The shaft may be turned as a whole, and nothing turns it back: one eigenvalue is 1.
        return events.growth(events.map_of_turn(bodies, turn, shots, law, memory=1), freely=1) <= 1.0

    return largest(is_stable, 1.0, 1.4, 1e-8)


def _share_by_hand(stiffness: float, damping: float, ratio: float, cells: int) -> float:
    """Return the share of both dampings that the worst motion of both handles needs."""
    ends = np.outer([1.0, -ratio], [1.0, -ratio])
    drives = [
        energies.LateDrive(each.damping, delay, each.torque_lag)
        for each, delay in zip((FIRST, SECOND), DELAYS, strict=True)
    ]
    return energies.worst_share(
        lambda z: -(stiffness + damping * (1.0 - 1.0 / z) / PERIOD) * ends, drives, PERIOD, cells
    )


def _torn(damping: float, ratio: float) -> float:
    """Return how far the forces of a coupling are from those of a spring and damper between x₁ and n·x₂."""
    law = Coupling(("a", "b"), 400.0, damping, ratio).begin(PERIOD)
    places = np.random.default_rng(2).uniform(-0.1, 0.1, (100, 4)).tolist()
    worst = 0.0
    for first, speed, second, turning in places:
        force = -400.0 * (first - ratio * second) - damping * (speed - ratio * turning)
        found = law(first, speed, second, turning) if damping else law(first, second)
        apart = max(abs(one - other) for one, other in zip(found, (force, -ratio * force), strict=True))
        worst = max(worst, apart / (40.0 * max(1.0, ratio**2)))
    return worst


def coupled_axes(quick: bool) -> CaseResult:
    """Check a virtual shaft between two unequal axes: stability, energy with any hands, friction, and its forces."""
    judged = [_tied(*shaft).stability.stiffness_limit for shaft in SHAFTS]
    stable = [limit.stable or 0.0 for limit in judged]
    by_hand = [_stable_by_hand(*shaft) for shaft in SHAFTS]
    passive = [limit.passive or 0.0 for limit in judged]
    cells = 20 if quick else 60
    shares = [_share_by_hand(limit, *shaft, cells) for limit, shaft in zip(passive, SHAFTS, strict=True)]
    held = [2.0 * min(0.02 / 1e-5, 0.001 / 2e-6 / ratio**2) for _, ratio in SHAFTS]
    apart = max(abs(one / other - 1.0) for one, other in zip(stable, by_hand, strict=True))
    worst = max(abs(share - 1.0) for share in shares)
    friction = max(abs((limit.quantisation or 0.0) / one - 1.0) for limit, one in zip(judged, held, strict=True))
    torn = max(_torn(part * damping, ratio) for damping, ratio in SHAFTS for part in (0.0, 1.0))
    return CaseResult(
        f"ratios of -2.5 and 0.4: stable to {values_text(by_hand, 6)} N/m; where passivity ends, the worst motion of "
        f"both handles needs all of both dampings; friction bridges counts to {values_text(held, 4)} N/m",
        f"stable to {values_text(stable, 6)} N/m, apart by {rounded(apart, 1)}; passive to {values_text(passive, 4)} "
        f"N/m, needed share of the dampings off by {rounded(worst, 1)}; counts off by {rounded(friction, 1)}, forces "
        f"by {rounded(torn, 1)}",
        apart <= AGREEMENT and worst <= CUT and friction <= EXACT and torn <= EXACT,
        "both devices from event to event; the worst of all motions in cells of constant speed; F₂ = -n·F₁ and "
        "2·fc/(n²·D) by hand",
        tolerance=f"{exactly(AGREEMENT)} of the limits, {exactly(CUT)} of the energies, {exactly(EXACT)} of the rest",
        used=share_used((apart, AGREEMENT), (worst, CUT), (friction, EXACT), (torn, EXACT)),
    )


MOTOR, DELAY = Plant(0.1, 2.0, torque_lag=0.16e-3), 0.3e-3
LOAD, STIFF = 0.05, 3e3
"""Mass [kg] behind a transmission of a stiffness [N/m]: both swing against each other at 48 Hz."""
LOSSES = (0.0, 1.0, 20.0)
"""Dampings of transmissions [N·s/m]."""
RIGID = 1e9
"""Stiffness of a transmission that is as good as rigid [N/m]."""


def _judged(*bodies: HungBody, plant: Plant = MOTOR) -> float:
    """Return the limit of stability of a wall on a motor with these bodies [N/m]."""
    wall = Wall("handle", stiffness=100.0)
    group = Group((Member("handle", plant, DELAY, (wall,), None, ESTIMATOR, bodies=bodies),), (), PERIOD)
    return group.stability.stiffness_limit.stable or 0.0


def _loaded_by_hand(loss: float) -> float:
    motor = events.motor(MOTOR.mass, MOTOR.damping, MOTOR.torque_lag)
    body = events.motor_with_load(motor, MOTOR.mass, LOAD, STIFF, loss)
    return limit_in_contact(body, PERIOD, DELAY)


def compliant_transmission(quick: bool) -> CaseResult:
    """Check the limit of a motor with a load behind a spring: the swing of both counts, and a rigid one is one mass."""
    found = [_judged(HungBody(LOAD, STIFF, loss)) for loss in LOSSES]
    by_hand = [_loaded_by_hand(loss) for loss in LOSSES]
    whole = _judged(plant=Plant(MOTOR.mass + LOAD, MOTOR.damping, torque_lag=MOTOR.torque_lag))
    rigid = _judged(HungBody(LOAD, RIGID, math.sqrt(RIGID * LOAD)))
    apart = max(abs(one / other - 1.0) for one, other in zip(found, by_hand, strict=True))
    off = abs(rigid / whole - 1.0)
    return CaseResult(
        f"transmissions of {exactly(STIFF)} N/m with 0, 1, 20 N·s/m: stable to {values_text(by_hand, 6)} N/m; one of "
        f"{exactly(RIGID)} N/m as a motor that has the load's mass",
        f"stable to {values_text(found, 6)} N/m, apart by {rounded(apart, 1)}; rigid {rounded(rigid, 6)} of "
        f"{rounded(whole, 6)} N/m, off by {rounded(off, 1)}",
        apart <= AGREEMENT and off <= AGREEMENT,
        "motor, torque loop and load from event to event; a sum of two masses",
        tolerance=f"{exactly(AGREEMENT)} of each limit",
        used=share_used((apart, AGREEMENT), (off, AGREEMENT)),
    )
