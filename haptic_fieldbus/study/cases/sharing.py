"""Case of a wall that is computed for the middle of each period: it makes no energy with the true velocity."""

import math
from collections.abc import Callable

import numpy as np

from haptic_fieldbus.margins import (
    HAND,
    Plant,
    damping_needed,
    limit_with,
    passive_limit_of,
    sample,
    sample_with,
    stiffness_limit,
)
from haptic_fieldbus.numerals import exactly, rounded
from haptic_fieldbus.numerics import batch, sampled
from haptic_fieldbus.numerics.batch import Array, loops
from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.scenes.predicted_wall import PredictedWall
from haptic_fieldbus.study.case import CaseResult, greatest, relative_error, result_of, signed, values_text
from haptic_fieldbus.study.measure import region
from haptic_fieldbus.study.measure.problems import spring
from haptic_fieldbus.study.oracles import contact, events

# Cases of energy in contact: entry and exit of a wall, a contact shorter than a sample, and a hand that lets go.

PERIOD = 1e-3
SPEED = 0.2
"""Speed towards the wall [m/s]."""
EXACT, AGREEMENT = 1e-9, 1e-6
"""Permitted relative differences: of sums that differ by rounding alone, and of limits and rates."""


def _bounced(mass: float, stiffness: float, phases: Array, steps: int, saturation: float = math.inf) -> Array:
    """Return the exit speeds of masses that hit the wall [m/s], `(n,)`.

    `phases`, `(n,)`, are the times from the impact to the next sample, as shares of a period.
    """
    many = loops(
        mass=mass, damping=0.0, period=PERIOD, stiffness=stiffness, unilateral=True, saturation=saturation,
        position=-SPEED * PERIOD * (1.0 - phases), velocity=SPEED,
    )  # fmt: skip
    return -batch.run(many, steps).velocity


def bounce_energy(quick: bool) -> CaseResult:
    """Check that a bounce on an undamped wall generates e^{πh/2} − 1 of its energy, on average over the phases.

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
    return result_of(
        f"h = {rounded(h)}: on average {100 * expected:.2f} % more out than in, each phase within ±h² = "
        f"{rounded(100 * h * h, 2)} %",
        f"{count} phases: mean {100 * mean:.2f} %, from {100 * low:.2f} to {100 * high:.2f} %; the positions alone "
        f"say the same to {rounded(apart, 1)}",
        "work summed from positions by another loop (to 1e-9), and e^(πh/2) − 1 to h²/2",
        tolerance=f"{exactly(EXACT)} of a phase, h²/2 of the mean",
        within=[(apart, EXACT), (mean - expected, 0.5 * h * h), (low - expected, h * h), (high - expected, h * h)],
        holds=low < high,
    )


def _leak(mass: float, stiffness: float, phase: float, steps: int) -> float:
    """Return the work of the wall by the identity of `bounce_energy` [J], with the motion simulated by hand."""
    start = -SPEED * PERIOD * (1.0 - phase), SPEED
    x = np.array(
        contact.sampled_positions(Plant(mass, 0.0), PERIOD, lambda x: -stiffness * max(x, 0.0), steps + 1, start=start)
    )
    inside = x[:-1] > 0.0
    squares = float((np.diff(x)[inside] ** 2).sum())
    entered, left = float(x[:-1][inside][0]), float(x[1:][inside][-1])
    return 0.5 * stiffness * (squares + entered**2 - left**2)


def contact_shorter_than_a_sample(quick: bool) -> CaseResult:
    """Check that a contact of less than a period throws the handle out with (h²·φ − 1) times its speed.

    A contact lasts π·√(m/K), and φ is the time from the impact to the next sample, as a share of the period. The handle
    leaves within one period when φ ≥ 1/(h²/2 − 1). A limit of the force limits the speed to F·T/m − v.
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
    return result_of(
        f"contact of {rounded(1e3 * math.pi * math.sqrt(mass / stiffness), 2)} ms: speed times h²·φ − 1, to "
        f"{rounded(expected.max(), 4)}; bounded to {exactly(most)} N, at most {rounded(speed)} m/s",
        f"times {rounded(found.max(), 4)} (apart by {rounded(apart, 1)}), bounded {rounded(bounded)} m/s; limit of "
        f"stability {rounded(limit, 4)} of {rounded(stiffness, 4)} N/m",
        "closed form of one held force (to 1e-9)",
        tolerance=f"{exactly(EXACT)} of the speeds",
        within=[(apart, EXACT), (bounded / speed - 1.0, EXACT)],
        holds=limit < stiffness,
    )


def hand_lets_go(quick: bool) -> CaseResult:
    """Check that a wall which is stable in a hand can grow when the hand lets go: the free handle sets the limit."""
    plant = Plant(mass=0.1, damping=2.0)
    free, in_hand = stiffness_limit(plant, PERIOD, 0.0, spring), limit_with(plant, (HAND,), PERIOD, 0.0, spring)
    bodies = [events.motor(plant.mass, plant.damping)]
    bodies.append(events.motor_with_load(bodies[0], plant.mass, HAND.mass, HAND.stiffness, HAND.damping))
    by_hand = [contact.limit_in_contact(body, PERIOD, 0.0) for body in bodies]
    stiffness = 1.5 * by_hand[0]
    devices = sample(plant, PERIOD, 0.0), sample_with(plant, (HAND,), PERIOD, 0.0)
    rates = [math.log(sampled.growth(device, spring(stiffness))) / PERIOD for device in devices]
    expected = [math.log(contact.growth_in_contact(body, PERIOD, 0.0, stiffness)) / PERIOD for body in bodies]
    apart = relative_error([free, in_hand, *rates], [*by_hand, *expected])
    return result_of(
        f"limits {rounded(by_hand[0], 6)} free and {rounded(by_hand[1], 6)} N/m held; at K = {rounded(stiffness, 4)} "
        f"N/m {signed(expected[1], 6)} held, {signed(expected[0], 6)} 1/s released",
        f"limits {rounded(free, 6)} and {rounded(in_hand, 6)} N/m; held it {'fades' if rates[1] < 0.0 else 'grows'} "
        f"({signed(rates[1], 6)} 1/s), released {signed(rates[0], 6)} 1/s; apart by {rounded(apart, 1)}",
        "handle and hand from event to event",
        tolerance=f"{exactly(AGREEMENT)} of limits and rates",
        within=[(apart, AGREEMENT)],
        holds=free < stiffness < in_hand and rates[1] < 0.0 < rates[0],
    )


# Cases of Z-width: how stiff and how damped a wall may be, and the effect of a filter in its damper.
#
# Let p = e^{−b·T/m}, N the polynomial that the stiffness multiplies in a loop without damper (`oracles.polynomials`),
# and r the pole of a low-pass in the damper. The loop's characteristic polynomial is
#
#     (z − 1)·(z − p)·(z − r)·zⁿ⁺¹ + N·(K·(z − r) + B·(1 − r)·(z − 1)/T).
#
# The oracle takes its roots. The package takes eigenvalues of matrices, and simulates loops.

Point = tuple[float, float, float]
"""Virtual damping B [N·s/m], delay [s], pole of the low-pass."""
DEVICE = Plant(mass=0.1, damping=2.0)
LIMITS_AGREE = 1e-6
"""Permitted relative difference of the limits of package and oracle."""
APART = 0.03
"""Distance below and above a limit at which loops are simulated, relative to it."""
ROOTS = "roots of a characteristic polynomial derived by hand (bisected in K, to 1e-6); loops run 3 % either side"


def filtered_wall(stiffness: float, damping: float, pole: float = 0.0) -> StateSpace:
    """Return a wall whose damper acts on a low-passed backward difference, as a discrete environment."""
    return region.wall(stiffness, damping, PERIOD, f"low-pass:pole={pole}")


def oracle_limit(damping: float, delay: float, pole: float) -> float:
    """Return the stiffness at which a root first leaves the unit circle [N/m]; 0 when none is stable."""
    free, force = (np.array(each, dtype=np.float64) for each in contact.polynomials(DEVICE, PERIOD, delay / PERIOD))
    damper = damping * (1.0 - pole) / PERIOD * np.array([1.0, -1.0])

    def is_stable(stiffness: float) -> bool:
        held = np.polymul(force, stiffness * np.array([1.0, -pole]) + damper)
        return bool(np.abs(np.roots(np.polyadd(np.polymul(free, [1.0, -pole]), held))).max() <= 1.0)

    return contact.largest(is_stable, 1.0, 1.1, 1e-9)


def _package_limit(damping: float, delay: float, pole: float) -> float:
    """Return the stiffness limit that the package computes [N/m]."""
    return stiffness_limit(DEVICE, PERIOD, delay, lambda stiffness: filtered_wall(stiffness, damping, pole))


def _right(limit: float, point: Point, quick: bool) -> int:
    """Return the number of two simulated loops that agree with the limit: one below it decays, one above it grows."""
    damping, delay, pole = point
    many = loops(
        mass=DEVICE.mass, damping=DEVICE.damping, period=PERIOD, delay=delay, position=1e-3,
        environments=[filtered_wall(factor * limit, damping, pole) for factor in (1.0 - APART, 1.0 + APART)],
    )  # fmt: skip
    below, above = map(float, batch.run(many, 4_000 if quick else 40_000).growth)
    return (not below > 1.0) + (above > 1.0)


def _judged(points: list[Point], law: str, holds: Callable[[list[float]], bool], quick: bool) -> CaseResult:
    """Return the result on limits by package, oracle and simulated loops.

    `law` describes how the limits vary, and `holds` is True if the oracle's limits vary in this way.
    """
    expected = [oracle_limit(*point) for point in points]
    found = [_package_limit(*point) for point in points]
    apart = greatest(abs(one - each) / (each or 1.0) for one, each in zip(found, expected, strict=True))
    some = [(limit, point) for limit, point in zip(expected, points, strict=True) if limit]
    right = sum(_right(limit, point, quick) for limit, point in some)
    return result_of(
        f"{law}; {values_text(expected, 4)} N/m",
        f"{values_text(found, 4)} N/m, apart by {rounded(apart, 1)}; {right} of {2 * len(some)} loops run 3 % off "
        "decay or grow so",
        ROOTS,
        tolerance=f"{exactly(LIMITS_AGREE)} of each limit; growth and decay 3 % off it",
        within=[(apart, LIMITS_AGREE)],
        holds=holds(expected) and right == 2 * len(some),
    )


def z_width_damping(quick: bool) -> CaseResult:
    """Check that without delay, virtual damping first widens the range of stable stiffness and then closes it."""

    def holds(limits: list[float]) -> bool:
        return 0 < int(np.argmax(limits)) < 4 and abs(limits[0] * PERIOD / (2.0 * DEVICE.damping) - 1.0) < 0.02

    points = [(damping, 0.0, 0.0) for damping in (0.0, 10.0, 40.0, 100.0, 160.0)]
    return _judged(points, "K limit for B = 0, 10, 40, 100, 160 N·s/m rises and falls again", holds, quick)


def z_width_delay(quick: bool) -> CaseResult:
    """Check that delay lowers the stiffness limit with the same damper, further with each part of a period."""
    points = [(10.0, delay * PERIOD, 0.0) for delay in (0.0, 0.5, 1.0, 1.7, 3.0)]
    law = "K limit with B = 10 N·s/m falls with delays of 0, ½, 1, 1.7, 3 T"
    return _judged(points, law, lambda limits: limits == sorted(limits)[::-1], quick)


def z_width_filter(quick: bool) -> CaseResult:
    """Check that a low-pass in the damper lowers the stiffness limit, with little and with much virtual damping."""
    points = [(b, 0.0, pole) for b in (10.0, 160.0) for pole in (0.0, 0.5, 0.9)]
    law = "K limit falls with low-passes of pole 0, 0.5, 0.9, with B = 10 and with B = 160 N·s/m"
    return _judged(points, law, lambda k: k[0] > k[1] > k[2] > 0.0 and k[3] > k[4] > k[5] > 0.0, quick)


def pure_damper_limit(quick: bool) -> CaseResult:
    """Check that a damper alone is stable up to B = T/(a·d − p·c), near 2·m/T, and passive up to the device's b."""
    p, c1, c0 = contact.plain_terms(DEVICE, PERIOD)
    expected = min(PERIOD / c0, (1.0 + p) * PERIOD / (c1 - c0))
    device = sample(DEVICE, PERIOD, 0.0)
    most = 4.0 * DEVICE.mass / PERIOD
    low, _ = contact.bisected(lambda b: sampled.growth(device, filtered_wall(0.0, b)) < 1.0, 0.0, most, 1e-10)
    many = loops(
        mass=DEVICE.mass, damping=DEVICE.damping, period=PERIOD, velocity=0.1,
        virtual_damping=[(1.0 - APART) * expected, (1.0 + APART) * expected],
    )  # fmt: skip
    speed = np.abs(batch.run(many, 1_000).velocity)
    needed = damping_needed(filtered_wall(0.0, 5.0), PERIOD, 0.0)
    return result_of(
        f"stable to B = {rounded(expected, 6)} N·s/m (2·m/T = {2 * DEVICE.mass / PERIOD:.0f}); passive needs b = B = "
        "5 N·s/m",
        f"stable to {rounded(low, 6)} N·s/m; 0.1 m/s becomes {rounded(speed[0], 1)} and {rounded(speed[1], 1)} m/s in "
        f"1000 periods 3 % below and above; passive needs b = {rounded(needed, 6)}",
        "Jury's conditions of z² + (B·c/T − p)·z + B·(a·d − p·c)/T in closed form (to 1e-6); b > |B|",
        tolerance=f"{exactly(LIMITS_AGREE)} of the limit, 1e-9 of the damping",
        within=[(low / expected - 1.0, LIMITS_AGREE), (needed / 5.0 - 1.0, 1e-9)],
        holds=speed[0] < 1e-3 < 1.0 < speed[1],
    )


def filtered_damper_passivity(quick: bool) -> CaseResult:
    """Check that with a low-pass of pole r, passivity needs b = K·T/2 + B·(1 − r)/(1 + r), less than without it.

    With the weight of the Colgate–Schenkel condition, the damper becomes −B·Re{e^{−jθ}·(1 − r)/(1 − r·e^{−jθ})}, which
    is largest at θ = π.
    """
    stiffness, virtual = 800.0, 3.0
    poles = (0.0, 0.3, 0.8, 0.95)
    expected = [0.5 * stiffness * PERIOD + virtual * (1.0 - r) / (1.0 + r) for r in poles]
    found = [damping_needed(filtered_wall(stiffness, virtual, r), PERIOD, 0.0) for r in poles]
    given = [_given_at_nyquist(stiffness, virtual, r) for r in poles]
    apart = relative_error([*found, *given], [*expected, *expected])
    limit = passive_limit_of(DEVICE, PERIOD, 0.0, lambda k: filtered_wall(k, virtual, 0.8), math.inf)
    by_hand = 2.0 * (DEVICE.damping - virtual * 0.2 / 1.8) / PERIOD
    return result_of(
        f"b = {values_text(expected, 4)} N·s/m for poles 0, 0.3, 0.8, 0.95; K to {rounded(by_hand, 6)} N/m with 0.8",
        f"b = {values_text(found, 4)} N·s/m by sweep, {values_text(given, 4)} by energy; K to {rounded(limit, 6)} N/m",
        "closed form, and the work of the forces on a handle shaken to and fro each period (to 1e-6)",
        tolerance=f"{exactly(LIMITS_AGREE)} of each damping and limit",
        within=[(apart, LIMITS_AGREE), (limit / by_hand - 1.0, LIMITS_AGREE)],
    )


def _given_at_nyquist(stiffness: float, virtual: float, pole: float) -> float:
    """Return the work of a wall on a handle driven between ±1 mm at constant speed, over ∫v² [N·s/m]."""
    # To and fro each period is the Nyquist frequency. The first half of the run lets the low-pass settle.
    position, velocity, work, square = 1e-3, 0.0, 0.0, 0.0
    for step in range(2_000):
        velocity = pole * velocity + (1.0 - pole) * 2.0 * position / PERIOD
        if step >= 1_000:
            work += (-stiffness * position - virtual * velocity) * -2.0 * position
            square += (2.0 * position) ** 2 / PERIOD
        position = -position
    return work / square


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
    late = sampled.environment(predicted.linearised(), period=PERIOD, method=None, estimator="backward-difference")
    left = math.log(sampled.growth(sample(Plant(mass, 0.0), PERIOD, 0.0), late))
    shaken = damping_needed(late, PERIOD, 0.0)
    without = damping_needed(gain([[-STIFFNESS]]), PERIOD, 0.0)
    one = math.log(contact.growth_in_contact(events.motor(mass, 0.0), PERIOD, 0.0, STIFFNESS, 0.5 * STIFFNESS * PERIOD))
    expected = 0.5 * math.log1p(0.5 * h * h)
    bound = 0.5 * STIFFNESS * PERIOD
    return result_of(
        f"log of growth a period: plain {rounded(expected, 4)}, true velocity 0, difference {rounded(one, 4)} (h⁴/8 = "
        f"{rounded(h**4 / 8.0)}); "
        f"passive with b = {exactly(bound)} plain, {exactly(2.0 * bound)} N·s/m by difference",
        f"plain {rounded(plain, 4)}, true velocity {rounded(true, 1)}, difference {rounded(left, 4)}; b = "
        f"{rounded(without, 4)} and {rounded(shaken, 4)} N·s/m",
        "determinants by hand, the lag θ³/4 that the difference leaves (growth to 1 %, and to 1e-4 from event to "
        "event, with the true velocity below 1 % in the whole run); b > K·T/2 + |B| with B = K·T/2 (to 1e-6)",
        tolerance="1 % of the growths, 1e-4 of that by difference, 1e-6 of the dampings",
        within=[
            (plain / expected - 1.0, 0.01),
            (true * steps, 0.01),
            (left / (h**4 / 8.0) - 1.0, 0.01),
            (left / one - 1.0, 1e-4),
            (shaken / (2.0 * bound) - 1.0, 1e-6),
            (without / bound - 1.0, 1e-6),
        ],
    )


def _growth_a_period(mass: float, force: Callable[[float, float], float], steps: int) -> float:
    """Return the logarithm of the growth a period of a mass that swings about 0, by simulation.

    `force` takes position and velocity and has the stiffness STIFFNESS.
    """
    device = Plant(mass, 0.0)
    x, v, first, last = 0.001, 0.0, 0.0, 0.0
    window = round(2.0 * math.pi / (PERIOD * math.sqrt(STIFFNESS / mass)))
    for step in range(steps):
        x, v = contact.moved_by_force(device, x, v, force(x, v), PERIOD)
        # Twice the energy, summed over one swing at each end: it varies within a swing, its sum does not.
        size = STIFFNESS * x * x + mass * v * v
        if step < window:
            first += size
        elif step >= steps - window:
            last += size
    return 0.5 * math.log(last / first) / (steps - window)
