"""Cases of a wall in the sampled loop: at its limit, beyond it, late, slow, and without friction."""

import math
from collections.abc import Callable

import numpy as np

from haptic_fieldbus.margins import Plant, Verdict, alone, judge, passive_limit, stiffness_limit
from haptic_fieldbus.numerals import exactly, rounded
from haptic_fieldbus.numerics import batch
from haptic_fieldbus.numerics.loops import loops
from haptic_fieldbus.study.case import CaseResult, share_used
from haptic_fieldbus.study.measure.problems import spring
from haptic_fieldbus.study.oracles.held import growth_of, sampled_positions
from haptic_fieldbus.study.oracles.polynomials import jury_limit, plain_terms, schur_cohn_limit

PERIOD = 1e-3
BENCH = Plant(0.1, 50.0)
"""Device with strong friction for its mass, so that growth near the limit shows within 1e5 steps."""


def _limit(device: Plant, period: float = PERIOD, delay: float = 0.0) -> float:
    """Return the stiffness limit that the package computes [N/m]; `delay` in periods."""
    return stiffness_limit(device, period, delay * period, spring)


def _law(stiffness: float) -> Callable[[float], float]:
    return lambda position: -stiffness * position


def at_boundary(factor: float, quick: bool) -> CaseResult:
    """Check that at `factor` of its limit a wall's motion fades or grows as slowly as theory predicts.

    The logarithm of the growth over N periods is compared with N·ln ρ, where ρ² = e + K·c0 for complex roots.
    """
    steps = 100_000 if quick else 1_000_000
    limit, exact = _limit(BENCH), jury_limit(BENCH, PERIOD)
    e, _, c0 = plain_terms(BENCH, PERIOD)
    # `growth_of` compares the first with the last tenth of the run, which are 0.9 of it apart.
    expected = 0.9 * steps * 0.5 * math.log(e + factor * exact * c0)
    measured = growth_of(sampled_positions(BENCH, PERIOD, _law(factor * limit), steps))
    return CaseResult(
        f"limit {exact:.6f} N/m; at {exactly(factor)} of it ln of growth {expected:+.4f} in {exactly(0.9 * steps)} "
        "periods",
        f"limit {limit:.6f} N/m (1e-8 allowed); ln of growth {measured:+.4f} (1 % and 0.005 allowed)",
        abs(limit / exact - 1.0) <= 1e-8
        and abs(measured - expected) <= 0.01 * abs(expected) + 0.005
        and measured * (factor - 1.0) > 0.0,
        "Jury's conditions by hand, and a loop of plain floats run at that share of the package's limit",
        tolerance="1e-8 of the limit; 1 % and 0.005 of ln of growth",
        used=share_used((limit / exact - 1.0, 1e-8), (measured - expected, 0.01 * abs(expected) + 0.005)),
    )


def _chatter(stiffness: float, steps: int, push: float) -> tuple[float, float]:
    """Return the swing in the last tenth of a run against a one-sided wall [m], by the batch engine and by hand."""
    wall = loops(mass=BENCH.mass, damping=BENCH.damping, period=PERIOD, stiffness=stiffness, unilateral=True,
                 push=push, position=1e-3)  # fmt: skip
    peak = float(batch.run(wall, steps).peaks[-1, 0])
    positions = sampled_positions(BENCH, PERIOD, lambda x: -stiffness * x if x > 0.0 else 0.0, steps, push=push)
    return peak - push / stiffness, max(positions[-(steps // 10) :]) - push / stiffness


def wall_over(quick: bool) -> CaseResult:
    """Check that a wall with a hand leaning on it chatters for ever at 1.5 times its limit, and rests at half of it."""
    steps, push = (4000 if quick else 50_000), 5.0
    limit = jury_limit(BENCH, PERIOD)
    chatter, brute = _chatter(1.5 * limit, steps, push)
    calm, _ = _chatter(0.5 * limit, steps, push)
    e, _, c0 = plain_terms(BENCH, PERIOD)
    expected = math.sqrt(e + 1.5 * limit * c0)
    both_sides = batch.run(
        loops(mass=BENCH.mass, damping=BENCH.damping, period=PERIOD, stiffness=1.5 * limit, position=1e-3), 1000
    )
    grown = float(both_sides.growth[0]) ** (1.0 / 900.0)
    return CaseResult(
        f"in contact growth {expected:.4f} a period; leaning with 5 N, overshoot {brute * 1e6:.3f} µm for ever",
        f"growth {grown:.4f} (0.1 %); overshoot {chatter * 1e6:.3f} µm (1e-6), at half the limit "
        f"{rounded(calm * 1e6, 1)} µm",
        abs(grown / expected - 1.0) <= 1e-3
        and abs(chatter / brute - 1.0) <= 1e-6
        and brute > 0.1 * push / limit
        and abs(calm) <= 1e-9 * push / limit,
        "ρ² = e + K·c0 by hand; a one-sided loop of plain floats",
        tolerance="0.1 % of the growth, 1e-6 of the overshoot",
        used=share_used((grown / expected - 1.0, 1e-3), (chatter / brute - 1.0, 1e-6), (calm, 1e-9 * push / limit)),
    )


def delayed(delay: float, quick: bool) -> CaseResult:
    """Check the limits of many devices with delay against Schur and Cohn, and runs below and above one of them."""
    masses = (1e-5, 0.1, 10.0) if quick else (1e-5, 1e-3, 0.1, 1.0, 10.0)
    devices = [Plant(mass, damping) for mass in masses for damping in (1e-2, 1.0, 1e2)]
    worst = max(abs(_limit(each, delay=delay) / schur_cohn_limit(each, PERIOD, delay) - 1.0) for each in devices)
    limit, exact = _limit(BENCH, delay=delay), schur_cohn_limit(BENCH, PERIOD, delay)
    below, above = (
        growth_of(sampled_positions(BENCH, PERIOD, _law(factor * limit), 20_000, delay=delay))
        for factor in (0.99, 1.01)
    )
    return CaseResult(
        f"m = 0.1 kg, b = 50 N·s/m: {exact:.5f} N/m; fades at 0.99 of it, grows at 1.01",
        f"{limit:.5f} N/m; {len(devices)} other devices off by {rounded(worst, 1)} at most (1e-6 allowed); ln of "
        f"growth {below:+.2f}, {above:+.2f}",
        max(worst, abs(limit / exact - 1.0)) <= 1e-6 and below < -0.5 and above > 0.5,
        "characteristic polynomial by hand, Schur–Cohn in 60 digits; a loop of plain floats",
        tolerance="1e-6 of the limit; ln of growth beyond ±0.5",
        used=share_used((worst, 1e-6), (limit / exact - 1.0, 1e-6)),
    )


def slow_loop(quick: bool) -> CaseResult:
    """Check slow loops from 20 Hz to 0.1 Hz: the device stops between samples, and the limit goes to 2b/(T − 2m/b)."""
    device, stiffness = Plant(0.1, 5.0), 600.0
    periods = (0.05, 0.2, 1.0, 10.0)
    worst = max(abs(_limit(device, period) / jury_limit(device, period) - 1.0) for period in periods)
    slowest = _limit(device, periods[-1])
    expected = 2.0 * device.damping / (periods[-1] - 2.0 * device.mass / device.damping)
    verdict = judge(alone(device, periods[0], 0.0), spring, stiffness)[0].verdict
    grown = growth_of(sampled_positions(device, periods[0], _law(stiffness), 50))
    return CaseResult(
        f"limit {expected:.8f} N/m at 0.1 Hz; 600 N/m at 20 Hz grows",
        f"limit {slowest:.8f} N/m, off Jury's by {rounded(worst, 1)} (1e-8 allowed); 600 N/m {verdict.value}, ln of "
        f"growth {grown:+.0f} in 50 periods",
        max(worst, abs(slowest / expected - 1.0)) <= 1e-8 and verdict is Verdict.UNSTABLE and grown > 1.0,
        "Jury's conditions by hand and their limit for bT ≫ m; a loop of plain floats",
        tolerance="1e-8 of the limit",
        used=share_used((worst, 1e-8), (slowest / expected - 1.0, 1e-8)),
    )


def undamped_wall(quick: bool) -> CaseResult:
    """Check that without friction no stiffness is stable: the product of the roots is 1 + K·T²/2m."""
    plants = [Plant(mass, 0.0) for mass in (1e-5, 0.1, 10.0)]
    limits = [_limit(plant, delay=delay) for plant in plants for delay in (0.0, 0.5, 1.0, 2.0, 10.0)]
    limits += [passive_limit(each, PERIOD, 0.0) for each in plants]
    share, steps = (1e-3 if quick else 1e-5), (20_000 if quick else 1_000_000)
    device = Plant(0.1, 0.0)
    measured = growth_of(sampled_positions(device, PERIOD, _law(share * device.mass / PERIOD**2), steps))
    expected = 0.9 * steps * 0.5 * math.log1p(0.5 * share)
    return CaseResult(
        f"limit exactly 0 N/m; at K = {exactly(share)}·m/T² ln of growth {expected:.4f} in {exactly(0.9 * steps)} "
        "periods",
        f"largest limit {exactly(max(limits))} N/m of {len(limits)}; ln of growth {measured:.4f} (1 % allowed)",
        not np.any(limits) and abs(measured / expected - 1.0) <= 0.01,
        "product of the roots 1 + K·T²/2m > 1, by hand; a loop of plain floats",
        tolerance="limit exactly 0; 1 % of ln of growth",
        used=share_used((measured / expected - 1.0, 0.01)),
    )
