"""Cases of energy in contact: entry and exit of a wall, a contact shorter than a sample, and a hand that lets go."""

import math

import numpy as np

from haptic_fieldbus.margins import Plant, sample, stiffness_limit
from haptic_fieldbus.margins.bodies import HAND, limit_with, sample_with
from haptic_fieldbus.numerals import exactly, rounded
from haptic_fieldbus.numerics import batch, sampled
from haptic_fieldbus.numerics.loops import Array, loops
from haptic_fieldbus.study.case import CaseResult, share_used, signed
from haptic_fieldbus.study.measure.problems import spring
from haptic_fieldbus.study.oracles import events
from haptic_fieldbus.study.oracles.contact import growth_in_contact, limit_in_contact
from haptic_fieldbus.study.oracles.held import sampled_positions

PERIOD = 1e-3
SPEED = 0.2
"""Speed towards the wall [m/s]."""
EXACT, AGREEMENT = 1e-9, 1e-6
"""Permitted relative difference of sums that are equal but for rounding; of limits and rates."""


def _bounced(mass: float, stiffness: float, phases: Array, steps: int, saturation: float = math.inf) -> Array:
    """Return the exit speeds of masses that hit the wall [m/s], `(n,)`.

    `phases`, `(n,)`, are the shares of a period that are left from the impact to the next sample.
    """
    many = loops(
        mass=mass, damping=0.0, period=PERIOD, stiffness=stiffness, unilateral=True, saturation=saturation,
        position=-SPEED * PERIOD * (1.0 - phases), velocity=SPEED,
    )  # fmt: skip
    return -batch.run(many, steps).velocity


def bounce_energy(quick: bool) -> CaseResult:
    """Check that a bounce on an undamped wall generates e^{πh/2} − 1 of its energy on average, more or less by phase.

    With y_0 the first sample inside and y_N the first one outside again, the work of the wall is exactly
    K/2·(Σ(y_{k+1} − y_k)² + y_0² − y_N²): the leak of the hold, and terms of up to one sample at entry and at exit.
    """
    mass, stiffness, count = 0.5, 2000.0, 200 if quick else 5_000
    h = PERIOD * math.sqrt(stiffness / mass)
    phases = (np.arange(count) + 0.5) / count
    steps = 2 * math.ceil(math.pi / h)
    energy = 0.5 * mass * SPEED**2
    gained = 0.5 * mass * _bounced(mass, stiffness, phases, steps) ** 2 / energy - 1.0
    by_positions = np.array([_leak(mass, stiffness, phase, steps) for phase in phases.tolist()]) / energy
    apart = float(np.abs(gained - by_positions).max())
    expected, mean = math.expm1(0.5 * math.pi * h), float(gained.mean())
    low, high = float(gained.min()), float(gained.max())
    return CaseResult(
        f"h = {rounded(h)}: on average {100 * expected:.2f} % more out than in, each phase within ±h² = "
        f"{rounded(100 * h * h, 2)} %",
        f"{count} phases: mean {100 * mean:.2f} %, from {100 * low:.2f} to {100 * high:.2f} %; the positions alone "
        f"say the same to {rounded(apart, 1)}",
        apart <= EXACT and abs(mean - expected) <= 0.5 * h * h and expected - h * h <= low < high <= expected + h * h,
        "work summed from positions by another loop (to 1e-9), and e^(πh/2) − 1 to h²/2",
        tolerance=f"{exactly(EXACT)} of a phase, h²/2 of the mean",
        used=share_used(
            (apart, EXACT), (mean - expected, 0.5 * h * h), (low - expected, h * h), (high - expected, h * h)
        ),
    )


def _leak(mass: float, stiffness: float, phase: float, steps: int) -> float:
    """Return the work of the wall by the identity of `bounce_energy` [J], with the motion simulated by hand."""
    start = -SPEED * PERIOD * (1.0 - phase), SPEED
    x = np.array(
        sampled_positions(Plant(mass, 0.0), PERIOD, lambda x: -stiffness * max(x, 0.0), steps + 1, start=start)
    )
    inside = x[:-1] > 0.0
    squares = float((np.diff(x)[inside] ** 2).sum())
    entered, left = float(x[:-1][inside][0]), float(x[1:][inside][-1])
    return 0.5 * stiffness * (squares + entered**2 - left**2)


def contact_shorter_than_a_sample(quick: bool) -> CaseResult:
    """Check that a contact of less than a period throws the handle out with (h²·φ − 1) times its speed.

    A contact lasts π·√(m/K), and φ is the share of the period that is left after the impact. The handle leaves within
    one period when φ ≥ 1/(h²/2 − 1). A limit of the force limits the speed to F·T/m − v.
    """
    mass, stiffness, count = 0.02, 5e5, 200 if quick else 20_000
    square, most = PERIOD**2 * stiffness / mass, 20.0
    shortest = 1.0 / (0.5 * square - 1.0)
    phases = shortest + (1.0 - shortest) * (np.arange(count) + 0.5) / count
    expected = square * phases - 1.0
    found = _bounced(mass, stiffness, phases, 4) / SPEED
    apart = float(np.abs(found / expected - 1.0).max())
    bounded = float(_bounced(mass, stiffness, phases, 4, most).max())
    speed = most * PERIOD / mass - SPEED
    limit = stiffness_limit(Plant(mass, 0.5), PERIOD, 0.0, spring)
    return CaseResult(
        f"contact of {rounded(1e3 * math.pi * math.sqrt(mass / stiffness), 2)} ms: speed times h²·φ − 1, to "
        f"{rounded(expected.max(), 4)}; bounded to {exactly(most)} N, at most {rounded(speed)} m/s",
        f"times {rounded(found.max(), 4)} (apart by {rounded(apart, 1)}), bounded {rounded(bounded)} m/s; limit of "
        f"stability {rounded(limit, 4)} of {rounded(stiffness, 4)} N/m",
        apart <= EXACT and abs(bounded / speed - 1.0) <= EXACT and limit < stiffness,
        "closed form of one held force (to 1e-9)",
        tolerance=f"{exactly(EXACT)} of the speeds",
        used=share_used((apart, EXACT), (bounded / speed - 1.0, EXACT)),
    )


def hand_lets_go(quick: bool) -> CaseResult:
    """Check that a wall which is stable in a hand can grow when the hand lets go: the free handle sets the limit."""
    plant = Plant(mass=0.1, damping=2.0)
    free, in_hand = stiffness_limit(plant, PERIOD, 0.0, spring), limit_with(plant, (HAND,), PERIOD, 0.0, spring)
    bodies = [events.motor(plant.mass, plant.damping)]
    bodies.append(events.motor_with_load(bodies[0], plant.mass, HAND.mass, HAND.stiffness, HAND.damping))
    by_hand = [limit_in_contact(body, PERIOD, 0.0) for body in bodies]
    stiffness = 1.5 * by_hand[0]
    devices = sample(plant, PERIOD, 0.0), sample_with(plant, (HAND,), PERIOD, 0.0)
    rates = [math.log(sampled.growth(device, spring(stiffness))) / PERIOD for device in devices]
    expected = [math.log(growth_in_contact(body, PERIOD, 0.0, stiffness)) / PERIOD for body in bodies]
    found = [free, in_hand, *rates]
    apart = max(abs(one / other - 1.0) for one, other in zip(found, [*by_hand, *expected], strict=True))
    return CaseResult(
        f"limits {rounded(by_hand[0], 6)} free and {rounded(by_hand[1], 6)} N/m held; at K = {rounded(stiffness, 4)} "
        f"N/m {signed(expected[1], 6)} held, {signed(expected[0], 6)} 1/s released",
        f"limits {rounded(free, 6)} and {rounded(in_hand, 6)} N/m; held it {'fades' if rates[1] < 0.0 else 'grows'} "
        f"({signed(rates[1], 6)} 1/s), released {signed(rates[0], 6)} 1/s; apart by {rounded(apart, 1)}",
        free < stiffness < in_hand and rates[1] < 0.0 < rates[0] and apart <= AGREEMENT,
        "handle and hand from event to event",
        tolerance=f"{exactly(AGREEMENT)} of limits and rates",
        used=share_used((apart, AGREEMENT)),
    )
