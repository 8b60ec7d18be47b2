"""Cases of Z-width: how stiff and how damped a wall may be, and the effect of a filter in its damper.

Let p = e^{−b·T/m}, N the polynomial that the stiffness multiplies in a loop without damper (`oracles.polynomials`), and
r the pole of a low-pass in the damper. The loop's characteristic polynomial is

    (z − 1)·(z − p)·(z − r)·zⁿ⁺¹ + N·(K·(z − r) + B·(1 − r)·(z − 1)/T).

The oracle takes its roots. The package takes eigenvalues of matrices, and simulates loops.
"""

import math
from collections.abc import Callable

import numpy as np

from haptic_fieldbus.margins import Plant, passive_limit_of, sample, stiffness_limit
from haptic_fieldbus.numerals import exactly, rounded
from haptic_fieldbus.numerics import batch, sampled
from haptic_fieldbus.numerics.linear import StateSpace
from haptic_fieldbus.numerics.loops import loops
from haptic_fieldbus.numerics.passivity import damping_needed
from haptic_fieldbus.study.case import CaseResult, share_used, values_text
from haptic_fieldbus.study.measure import region
from haptic_fieldbus.study.oracles.polynomials import largest, plain_terms, polynomials

Point = tuple[float, float, float]
"""Virtual damping B [N·s/m], delay [s], pole of the low-pass."""
PERIOD = 1e-3
DEVICE = Plant(mass=0.1, damping=2.0)
AGREEMENT = 1e-6
"""Permitted relative difference of the limits of package and oracle."""
APART = 0.03
"""Distance below and above a limit at which loops are simulated, relative to it."""
ROOTS = "roots of a characteristic polynomial derived by hand (bisected in K, to 1e-6); loops run 3 % either side"


def filtered_wall(stiffness: float, damping: float, pole: float = 0.0) -> StateSpace:
    """Return a wall whose damper acts on a low-passed backward difference, as a discrete environment."""
    return region.wall(stiffness, damping, PERIOD, f"low-pass:pole={pole}")


def oracle_limit(damping: float, delay: float, pole: float) -> float:
    """Return the stiffness at which a root first leaves the unit circle [N/m]; 0 when none is stable."""
    free, force = (np.array(each, dtype=np.float64) for each in polynomials(DEVICE, PERIOD, delay / PERIOD))
    damper = damping * (1.0 - pole) / PERIOD * np.array([1.0, -1.0])

    def is_stable(stiffness: float) -> bool:
        held = np.polymul(force, stiffness * np.array([1.0, -pole]) + damper)
        return bool(np.abs(np.roots(np.polyadd(np.polymul(free, [1.0, -pole]), held))).max() <= 1.0)

    return largest(is_stable, 1.0, 1.1, 1e-9)


def _package_limit(damping: float, delay: float, pole: float) -> float:
    """Return the stiffness limit that the package computes [N/m]."""
    return stiffness_limit(DEVICE, PERIOD, delay, lambda stiffness: filtered_wall(stiffness, damping, pole))


def _right(limit: float, point: Point, quick: bool) -> int:
    """Return how many of two simulated loops behave as the limit says: one below it decays, one above it grows."""
    damping, delay, pole = point
    many = loops(
        mass=DEVICE.mass, damping=DEVICE.damping, period=PERIOD, delay=delay, position=1e-3,
        environments=[filtered_wall(factor * limit, damping, pole) for factor in (1.0 - APART, 1.0 + APART)],
    )  # fmt: skip
    below, above = map(float, batch.run(many, 4_000 if quick else 40_000).growth)
    return (not below > 1.0) + (above > 1.0)


def _judged(points: list[Point], law: str, holds: Callable[[list[float]], bool], quick: bool) -> CaseResult:
    """Return the result on limits by package, oracle and simulated loops.

    `law` describes how the limits vary, and `holds` tells whether those of the oracle do so.
    """
    expected = [oracle_limit(*point) for point in points]
    found = [_package_limit(*point) for point in points]
    apart = max(abs(one - other) / other if other else abs(one) for one, other in zip(found, expected, strict=True))
    some = [(limit, point) for limit, point in zip(expected, points, strict=True) if limit]
    right = sum(_right(limit, point, quick) for limit, point in some)
    return CaseResult(
        f"{law}; {values_text(expected, 4)} N/m",
        f"{values_text(found, 4)} N/m, apart by {rounded(apart, 1)}; {right} of {2 * len(some)} loops run 3 % off "
        "decay or grow so",
        holds(expected) and apart <= AGREEMENT and right == 2 * len(some),
        ROOTS,
        tolerance=f"{exactly(AGREEMENT)} of each limit; growth and decay 3 % off it",
        used=share_used((apart, AGREEMENT)),
    )


def z_width_damping(quick: bool) -> CaseResult:
    """Check that without delay, virtual damping first widens the range of stable stiffness and then closes it."""

    def holds(limits: list[float]) -> bool:
        low = limits[0] * PERIOD / (2.0 * DEVICE.damping)
        return 0 < int(np.argmax(limits)) < 4 and abs(low - 1) < 0.02

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
    p, c1, c0 = plain_terms(DEVICE, PERIOD)
    expected = min(PERIOD / c0, (1.0 + p) * PERIOD / (c1 - c0))
    device = sample(DEVICE, PERIOD, 0.0)
    low, high = 0.0, 4.0 * DEVICE.mass / PERIOD
    while high - low > 1e-10 * high:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if sampled.growth(device, filtered_wall(0.0, middle)) < 1.0 else (low, middle)
    many = loops(
        mass=DEVICE.mass, damping=DEVICE.damping, period=PERIOD, velocity=0.1,
        virtual_damping=[(1.0 - APART) * expected, (1.0 + APART) * expected],
    )  # fmt: skip
    speed = np.abs(batch.run(many, 1_000).velocity)
    needed = damping_needed(filtered_wall(0.0, 5.0), PERIOD, 0.0)
    return CaseResult(
        f"stable to B = {rounded(expected, 6)} N·s/m (2·m/T = {2 * DEVICE.mass / PERIOD:.0f}); passive needs b = B = "
        "5 N·s/m",
        f"stable to {rounded(low, 6)} N·s/m; 0.1 m/s becomes {rounded(speed[0], 1)} and {rounded(speed[1], 1)} m/s in "
        f"1000 periods 3 % below and above; passive needs b = {rounded(needed, 6)}",
        abs(low / expected - 1.0) <= AGREEMENT and speed[0] < 1e-3 < 1.0 < speed[1] and abs(needed / 5.0 - 1.0) < 1e-9,
        "Jury's conditions of z² + (B·c/T − p)·z + B·(a·d − p·c)/T in closed form (to 1e-6); b > |B|",
        tolerance=f"{exactly(AGREEMENT)} of the limit, 1e-9 of the damping",
        used=share_used((low / expected - 1.0, AGREEMENT), (needed / 5.0 - 1.0, 1e-9)),
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
    apart = max(abs(each / one - 1.0) for one, *others in zip(expected, found, given, strict=True) for each in others)
    limit = passive_limit_of(DEVICE, PERIOD, 0.0, lambda k: filtered_wall(k, virtual, 0.8), math.inf)
    by_hand = 2.0 * (DEVICE.damping - virtual * 0.2 / 1.8) / PERIOD
    return CaseResult(
        f"b = {values_text(expected, 4)} N·s/m for poles 0, 0.3, 0.8, 0.95; K to {rounded(by_hand, 6)} N/m with 0.8",
        f"b = {values_text(found, 4)} N·s/m by sweep, {values_text(given, 4)} by energy; K to {rounded(limit, 6)} N/m",
        apart <= AGREEMENT and abs(limit / by_hand - 1.0) <= AGREEMENT,
        "closed form, and the work of the forces on a handle shaken to and fro each period (to 1e-6)",
        tolerance=f"{exactly(AGREEMENT)} of each damping and limit",
        used=share_used((apart, AGREEMENT), (limit / by_hand - 1.0, AGREEMENT)),
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
