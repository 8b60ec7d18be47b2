"""Cases of energy and passivity: sums of the work of held forces, here called ledgers.

The force held from sample k to k + 1 does work over x_{k+1} − x_k. For F = −K·x and a motion that returns to its start,
the sum of this work is K/2·Σ(x_{k+1} − x_k)²: the energy that a sampled spring generates, its leak.
"""

import math
from collections.abc import Callable

import numpy as np

from haptic_fieldbus.margins import Plant, sample
from haptic_fieldbus.numerals import exactly, rounded
from haptic_fieldbus.numerics import sampled
from haptic_fieldbus.numerics.linear import gain
from haptic_fieldbus.numerics.loops import Array, loops
from haptic_fieldbus.numerics.passivity import damping_needed
from haptic_fieldbus.scenes.predicted_wall import PredictedWall
from haptic_fieldbus.study.case import CaseResult, share_used, signed, values_text
from haptic_fieldbus.study.cases.friction import recorded
from haptic_fieldbus.study.cases.oracles.held import moved_by_force

PERIOD = 1e-3
STIFFNESS, AMPLITUDE, TURN = 600.0, 0.01, 40
"""Stiffness [N/m], amplitude of the handle's sine [m], and samples in a cycle of it."""
EXACT = 1e-9
"""Permitted relative difference of sums that are equal but for rounding."""


def _handle(times: Array) -> Array:
    """Return the position of a handle that moves in a sine [m], `(n,)`, at times in periods."""
    return np.asarray(AMPLITUDE * np.sin(2.0 * math.pi / TURN * times))


def passivity_observer_timing(quick: bool) -> CaseResult:
    """Check that a ledger shows the leak only when it pairs a force with the displacement during its hold.

    Pairing the force with the displacement before it gives −leak, and the mean of both gives 0.
    """
    cycles = 10 if quick else 1_000
    x = _handle(np.arange(cycles * TURN + 1, dtype=np.float64))
    force, way = -STIFFNESS * x, np.diff(x)
    leak = cycles * TURN * STIFFNESS * AMPLITUDE**2 * math.sin(math.pi / TURN) ** 2
    paired = (force[:-1], force[1:], 0.5 * (force[:-1] + force[1:]))
    ledgers = [float(each @ way) for each in paired]
    fine = _worked(force, cycles, 0.0)
    ratios = [each / leak for each in ledgers]
    apart = max(abs(one - other) for one, other in zip([*ratios, fine / leak], [1.0, -1.0, 0.0, 1.0], strict=True))
    return CaseResult(
        f"f_(k-1), f_k, their mean times x_k - x_(k-1): +leak, -leak, 0; leak {rounded(1e3 * leak, 6)} mJ",
        f"{', '.join(signed(1e3 * each, 6) for each in ledgers)} mJ; finely integrated {signed(1e3 * fine, 6)} mJ",
        apart <= 1e-6,
        "closed form N·K·A²·sin²(π/N) a cycle, and ∫f·v over 50 parts of each period (to 1e-6)",
        tolerance="1e-6 of the leak",
        used=share_used((apart, 1e-6)),
    )


def _worked(force: Array, cycles: int, delay: float, parts: int = 50) -> float:
    """Return ∫f·v over whole cycles [J], with the force of each sample acting `delay` periods later.

    The integral is taken by the midpoint of each of `parts` parts of a period.
    """
    times = (np.arange(cycles * TURN * parts) + 0.5) / parts + TURN
    angular = 2.0 * math.pi / TURN
    speed = AMPLITUDE * angular * np.cos(angular * times)
    acting = np.floor(times - delay).astype(np.int64) % TURN
    # The mean speed of a part is sin(y)/y times the speed at its midpoint, y half of its angle: exact for a sine.
    half = 0.5 * angular / parts
    return float(force[acting] @ speed) / parts * math.sin(half) / half


def passivity_observer_delay(quick: bool) -> CaseResult:
    """Check that a ledger shows (T/2)/(T/2 + td) of the leak without regard to the delay td, and all when shifted."""
    cycles = 10 if quick else 1_000
    delays = (0.0, 0.3, 1.0, 1.7)
    angle = 2.0 * math.pi / TURN
    x = _handle(np.arange((cycles + 1) * TURN + 1, dtype=np.float64))
    count = cycles * TURN
    force = -STIFFNESS * x[:count]
    unshifted = float(force @ np.diff(x[: count + 1]))
    shares, errors, checks = [], [], []
    for delay in delays:
        turn = angle * delay
        true = 0.5 * count * STIFFNESS * AMPLITUDE**2 * (math.cos(turn) - math.cos(angle + turn))
        shares.append(unshifted / true)
        errors.append(_shifted(force, x, delay) / true - 1.0)
        checks.append(_worked(force, cycles, delay) / true - 1.0)
    wanted = [0.5 / (0.5 + delay) for delay in delays]
    near = max(abs(one - other) for one, other in zip(shares, wanted, strict=True))
    worst = max(map(abs, errors))
    return CaseResult(
        f"unshifted sees {values_text(wanted, 3)} of the leak at td = 0, 0.3, 1, 1.7 T; shifted sees all of it",
        f"unshifted {values_text(shares, 3)}; shifted off by at most {rounded(100 * worst, 2)} %",
        near <= angle**2 and worst <= angle**2 and max(map(abs, checks)) <= 1e-6,
        "closed form N/2·K·A²·(cos ψ − cos(θ + ψ)) a cycle, θ = ωT, ψ = ω·td, itself checked by fine integration (to "
        f"1e-6); shares and the shifted ledger to θ² = {rounded(angle**2, 2)}",
        tolerance=f"{rounded(angle**2, 1)} of the leak",
        used=share_used((near, angle**2), (worst, angle**2)),
    )


def _shifted(force: Array, x: Array, delay: float) -> float:
    """Return the ledger of forces and displacements shifted by `delay` periods [J].

    The fraction of a period is shifted by interpolation between samples.
    """
    whole = math.floor(delay)
    rest, count = delay - whole, len(force)
    late = (1.0 - rest) * x[whole : whole + count + 1] + rest * x[whole + 1 : whole + count + 2]
    return float(force @ np.diff(late))


def saturation_ledger(quick: bool) -> CaseResult:
    """Check that the energy of a free mass changes by the work of the force after saturation, not before it."""
    mass, most, steps = 0.5, 2.0, 400 if quick else 40_000
    many = loops(
        mass=mass, damping=0.0, period=PERIOD, stiffness=STIFFNESS, saturation=most, position=-0.002, velocity=0.6
    )
    x, v = recorded(many, 0, steps + 1)[:, :, 0].T
    wanted, way = -STIFFNESS * x[:-1], np.diff(x)
    asked, applied = float(wanted @ way), float(np.clip(wanted, -most, most) @ way)
    saturated = int((np.abs(wanted) > most).sum())
    before, energy = 0.5 * mass * float(v[0]) ** 2, 0.5 * mass * float(v[-1]) ** 2
    change, scale = energy - before, max(energy, before)
    off, wrong = abs(applied - change) / scale, abs(asked - change) / scale
    return CaseResult(
        f"kinetic energy changes by {signed(1e3 * change, 6)} mJ, with {saturated} of {steps} forces saturated at "
        f"{exactly(most)} N",
        f"ledger after saturation {signed(1e3 * applied, 6)} mJ (off by {rounded(off, 1)}), before it "
        f"{signed(1e3 * asked, 6)} mJ",
        off <= EXACT and wrong > 0.1 and saturated > steps // 10,
        "kinetic energy of a mass without friction (to 1e-9); the ledger before saturation is wrong by above 10 %",
        tolerance=f"{exactly(EXACT)} of the energy",
        used=share_used((off, EXACT)),
    )


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
    expected = 0.5 * math.log1p(0.5 * h * h)
    bound = 0.5 * STIFFNESS * PERIOD
    return CaseResult(
        f"log of growth a period: plain {rounded(expected, 4)}, true velocity 0, difference {rounded(h**4 / 8.0)}; "
        f"passive with b = {exactly(bound)} plain, {exactly(2.0 * bound)} N·s/m by difference",
        f"plain {rounded(plain, 4)}, true velocity {rounded(true, 1)}, difference {rounded(left)}; b = "
        f"{rounded(without, 4)} and {rounded(shaken, 4)} N·s/m",
        abs(plain / expected - 1.0) <= 0.01
        and abs(true) * steps <= 0.01
        and abs(left / (h**4 / 8.0) - 1.0) <= 0.01
        and abs(shaken / (2.0 * bound) - 1.0) <= 1e-6
        and abs(without / bound - 1.0) <= 1e-6,
        "determinants by hand, the lag θ³/4 that the difference leaves (growth to 1 %, with the true velocity below "
        "1 % in the whole run); b > K·T/2 + |B| with B = K·T/2 (to 1e-6)",
        tolerance="1 % of the growths, 1e-6 of the dampings",
        used=share_used(
            (plain / expected - 1.0, 0.01),
            (true * steps, 0.01),
            (left / (h**4 / 8.0) - 1.0, 0.01),
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
