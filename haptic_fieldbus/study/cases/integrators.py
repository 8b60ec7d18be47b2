"""Cases of integrators on the oscillator, h = T·√(k/m): tiny and huge steps, limits of stability, ten million steps.

The oracles are closed forms, and recursions written by hand in fifty decimal digits or in fractions.
"""

import math
from decimal import Decimal, localcontext
from fractions import Fraction

import numpy as np

from haptic_fieldbus import plan, response
from haptic_fieldbus.cycle import TripKind
from haptic_fieldbus.numerals import exactly, rounded
from haptic_fieldbus.numerics.integrators import METHODS, bind, discrete, discretise
from haptic_fieldbus.numerics.integrators.method import follow
from haptic_fieldbus.numerics.linear import Matrix, StateSpace
from haptic_fieldbus.numerics.sampled import spectral_radius
from haptic_fieldbus.study.case import CaseResult, greatest, largest_error, refused, relative_error, result_of
from haptic_fieldbus.study.cases.drive import COUNT, PERIOD_NS, Feeder, torque
from haptic_fieldbus.study.explicit import EXPLICIT, bind_rates
from haptic_fieldbus.study.measure import loops
from haptic_fieldbus.study.measure.problems import MASS, STIFFNESS, sprung_mass
from haptic_fieldbus.study.measure.work_precision import oscillator
from haptic_fieldbus.study.oracles.textbook import DIGITS, RADII, RULES, free_motion, puck_moved

# Cases of integrators with extreme masses and numbers: refusals, overflow, vanishing mass, zero input.

LARGEST = 2**1024
"""Smallest power of two that is not a finite double."""
SENTENCE = "expected a number from 1e-12 to 1e9"
"""Part of the message with which a mass is refused."""
COUNTS, PERIODS = 10, 400
"""Counts by which the puck is moved in period 1, and number of periods in the run."""


def _overflow_sample(square: int, scale: Fraction) -> int:
    """Return the first sample at which scale·|p| overflows, by forward Euler in integers from p = 1, q = 0, T = 1."""
    p, q, sample = 1, 0, 0
    while scale * abs(p) < LARGEST:
        p, q, sample = p + q, q - square * p, sample + 1
    return sample


def float_overflow(quick: bool) -> CaseResult:
    """Check that forward Euler with a far too long period is flagged before its first infinity.

    In the cycle, the target torque is zero from that period on.
    """
    found = follow(discretise(sprung_mass(100.0, 1.0), 1.0, "forward-euler"), np.zeros((2_000, 2)), [1.0, 0.0])
    expected = _overflow_sample(100, Fraction(100))
    expected_trip = 1 + _overflow_sample(10_000, Fraction(STIFFNESS * COUNTS * COUNT))
    # The library's scene with a mass of 20 µg at 1 kHz, so that T·ω = 100.
    fast = plan("sprung_mass", settings={"sprung_mass.mass": 2e-8}, method="forward-euler")
    cycle, targets, commands = Feeder(fast), [], []
    for period in range(PERIODS):
        targets.append(torque(cycle, COUNTS if period else 0, t_ns=period * PERIOD_NS))
        commands.append(abs(cycle.value("command")))
    tripped = cycle.trip.t_ns // PERIOD_NS if cycle.trip else PERIODS
    after, largest = targets[tripped:], greatest(commands[:tripped])
    return result_of(
        f"T·ω = 10 diverges at sample {expected}; in the cycle, T·ω = 100, trip at period {expected_trip} ± 1, then 0",
        f"flagged at sample {found.diverged_at}, all {len(found.outputs)} rows before finite; trip at period "
        f"{tripped} ({cycle.tripped.value if cycle.tripped else 'none'}), {len(after)} targets after it all "
        f"{max(map(abs, after), default=-1)} ‰, command before at most {rounded(largest)} N",
        "the same recursion in unbounded integers, against 2¹⁰²⁴",
        tolerance="exact sample; a period of the trip",
        holds=found.diverged_at == expected == len(found.outputs)
        and bool(np.isfinite(found.outputs).all() and np.isfinite(found.states).all())
        and cycle.tripped is TripKind.NOT_FINITE
        and abs(tripped - expected_trip) <= 1
        and not any(after)
        and largest <= cycle.plan.axes[0].limits.effort,
    )


def _asked(mass: float) -> str:
    """Return the message with which `response` refuses a mass; empty when it does not."""
    return refused(lambda: response("sprung_mass", settings={"sprung_mass.mass": mass}, duration=0.01))


def mass_zero_refused(quick: bool) -> CaseResult:
    """Check that a mass of 0 is refused, and the smallest double too, because k/m overflows."""
    said = [_asked(mass) for mass in (0.0, -0.0)]
    tiny = refused(lambda: discretise(sprung_mass(STIFFNESS, 5e-324), 1e-3))
    return result_of(
        f'm = 0 and -0 kg refused with "{SENTENCE}"; m = 5e-324 kg (k/m = ∞) with "a mass must be above 0"',
        f'"{said[0]}"; "{tiny}"',
        "q̇ = (k/m)·(x − p) has no value at m = 0; 200/5e-324 > 2¹⁰²⁴ (tolerance: none, the words are compared)",
        tolerance="exact words",
        holds=all(SENTENCE in sentence for sentence in said) and "a mass must be above 0" in tiny,
    )


def mass_negative_refused(quick: bool) -> CaseResult:
    """Check that a negative mass is refused, because it would run away as e^{t·√(k/|m|)}."""
    said = [_asked(mass) for mass in (-1e-12, -MASS, -1e12)]
    radius = spectral_radius(discrete(sprung_mass(STIFFNESS, -MASS), 1e-3).a)
    expected = math.exp(1e-3 * math.sqrt(STIFFNESS / MASS))
    return result_of(
        f'm = -1e-12, -0.5, -1e12 kg refused with "{SENTENCE}"; -0.5 kg would grow by {expected:.9f} a step of 1 ms',
        f'"{said[1]}"; grows by {radius:.9f} a step',
        "pole s = +√(k/|m|) = +20 1/s, growth e^{sT} (tolerance 1e-9)",
        tolerance="exact words; 1e-9 of the growth",
        within=[(radius - expected, 1e-9)],
        holds=all(SENTENCE in sentence for sentence in said),
    )


def _falling_force(mass: float, stiffness: float, acceleration: float, period: float, sample: int) -> float:
    """Return the force of a mass behind a puck on straight lines through a·t²/2 [N].

    It is F_n = −m·a·(h/2)·cot(h/2)·(1 − cos nh). The puck's velocity jumps by a·T/2 at first and by a·T at each later
    sample. Each jump starts a sine, and ½·sin(nh) + Σ sin(ih) over i < n is ½·cot(h/2)·(1 − cos nh).
    """
    h = period * math.sqrt(stiffness / mass)
    return -mass * acceleration * 0.5 * h / math.tan(0.5 * h) * (1.0 - math.cos(sample * h))


def mass_to_zero(quick: bool) -> CaseResult:
    """Check that a mass behind an accelerating puck is felt as its inertia, and vanishes as it becomes lighter."""
    stiffness, acceleration, period, steps = 2e3, 3.0, 1e-4, 2_000 if quick else 20_000
    masses = [10.0**-exponent for exponent in range(8)]
    tolerance = 1e-12 * stiffness * 0.5 * acceleration * (steps * period) ** 2
    worst, largest, expected = 0.0, [], []
    for mass in masses:
        step = bind(sprung_mass(stiffness, mass), period, "exact-foh")
        found = [step(0.5 * acceleration * (n * period) ** 2) for n in range(steps)]
        closed = [_falling_force(mass, stiffness, acceleration, period, n) for n in range(steps)]
        worst = greatest((worst, largest_error(found, closed)))
        largest.append(greatest(map(abs, found)))
        expected.append(greatest(map(abs, closed)))
    return result_of(
        f"m from 1 to 1e-7 kg (T·ω to {period * math.sqrt(stiffness / masses[-1]):.1f}): largest force from "
        f"{expected[0]:.4f} N (2·m·a) to {rounded(expected[-1])} N; each sample within {rounded(tolerance, 2)} N",
        f"largest force from {largest[0]:.4f} N to {rounded(largest[-1])} N; error of a sample at most "
        f"{rounded(worst, 2)} N",
        "closed form F = −m·a·(h/2)·cot(h/2)·(1 − cos nh); tolerance 1e-12 of the spring force at the end, k·a·t²/2",
        tolerance=f"{rounded(tolerance, 2)} N a sample",
        within=[(worst, tolerance)],
        holds=largest == sorted(largest, reverse=True) and largest[-1] < 1e-5,
    )


def zero_input_stays_zero(quick: bool) -> CaseResult:
    """Check that zero input gives exactly zero output with every method, linear and by rates."""
    steps = 2_000 if quick else 100_000
    worst = 0.0
    for stiffness, mass in ((STIFFNESS, MASS), (1e9, 1e-6)):
        space = sprung_mass(stiffness, mass)
        for method in METHODS:
            step = bind(space, 1e-3, method)
            worst = greatest((worst, *(abs(step(0.0)) for _ in range(steps))))
        square = stiffness / mass
        for method in EXPLICIT:
            advance = bind_rates(lambda t, z, u, s=square: (z[1], s * (u - z[0])), (0.0, 0.0), 1e-3, method, (0,))
            worst = greatest((worst, *(greatest(map(abs, advance(0.0))) for _ in range(steps))))
    return result_of(
        f"force and states exactly 0 for {steps} steps, also at T·ω = 31623",
        f"largest magnitude {exactly(worst)} over {len(METHODS)} linear and {len(EXPLICIT)} explicit methods",
        "ż = A z from z = 0: the zero solution, exact in floating point (tolerance 0)",
        tolerance="exact",
        holds=worst == 0.0,
    )


PERIOD = 1e-3


def _swing(space: StateSpace, period: float, method: str, start: tuple[float, float], steps: int) -> Matrix:
    """Return position and velocity at the samples of a free motion, `(steps + 1, 2)`."""
    return follow(discretise(space, period, method), np.zeros((steps + 1, 1)), start).states


def tiny_h(quick: bool) -> CaseResult:
    """Check that at h = 1e-6, with a puck that jumps by one unit, no digit is lost over a million steps."""
    h, steps = 1e-6, 50_000 if quick else 1_000_000
    worst, where = 0.0, ""
    for method in RULES:
        step = bind(sprung_mass(h**2, 1.0), 1.0, method)
        step(0.0)
        for _ in range(steps - 1):
            step(1.0)
        error = abs(step(1.0) / h**2 - puck_moved(method, h**2, steps))
        if error >= worst:
            worst, where = error, method
    return result_of(
        f"force over stiffness after {steps} steps of h = 1e-6 within 1e-12 of each method's own recursion",
        f"largest error {rounded(worst, 2)} ({where}), {len(RULES)} methods",
        "the hand-written recursion, raised to its power in 50 decimal digits",
        tolerance="1e-12 of the stiffness",
        within=[(worst, 1e-12)],
    )


def h_sweep(quick: bool) -> CaseResult:
    """Check the spectral radius of each method of RADII over nine decades of h, on three masses."""
    worst, count = 0.0, 13 if quick else 91
    for h in np.geomspace(1e-6, 1e3, count).tolist():
        for mass, period in ((0.5, 1e-3), (1e-5, 1e-4), (10.0, 1.0)):
            space = sprung_mass((h / period) ** 2 * mass, mass)
            for method, radius in RADII.items():
                found, expected = spectral_radius(discrete(space, period, method).a), radius(h)
                worst = greatest((worst, abs(found / expected - 1.0)))
    return result_of(
        "spectral radius by formula, relative error ≤ 1e-9, h = 1e-6 … 1e3",
        f"largest relative error {rounded(worst, 2)} at {count} values of h, 3 masses, {len(RADII)} methods",
        "closed forms: √(1 + h²), its inverse, 1, the roots of λ² − (2 − h²)λ + 1, √(1 − h⁶/72 + h⁸/576)",
        tolerance="1e-9 of the radius",
        within=[(worst, 1e-9)],
    )


def forward_euler_any_t(quick: bool) -> CaseResult:
    """Check that forward Euler gains energy with every period T; T only sets the rate."""
    steps = 2_000 if quick else 10_000
    worst, gains = 0.0, []
    for period in np.geomspace(1e-6, 1e-2, 9).tolist():
        square = STIFFNESS / MASS
        states = _swing(oscillator(square), period, "forward-euler", (0.01, 0.0), steps)
        energy = square * states[:, 0] ** 2 + states[:, 1] ** 2
        gain = math.log(energy[-1] / energy[0])
        worst = greatest((worst, abs(gain / (steps * math.log1p(square * period**2)) - 1.0)))
        gains.append(gain)
    return result_of(
        f"ln(E/E₀) = {steps}·ln(1 + h²) > 0 for T = 1 µs … 10 ms (h = 2e-5 … 0.2), within 1e-5 of itself",
        f"ln(E/E₀) from {rounded(gains[0], 4)} to {rounded(gains[-1], 4)}, relative error at most {rounded(worst, 2)}",
        "closed form: each step multiplies the energy by 1 + h² exactly",
        tolerance="1e-5 of ln of growth",
        within=[(worst, 1e-5)],
        holds=min(gains) > 0.0,
    )


def rk4_at_its_limit(quick: bool) -> CaseResult:
    """Check that RK4 keeps the energy at h = 2·√2, and loses or gains it if h is a ten-thousandth smaller or larger."""
    steps = 1_000 if quick else 20_000
    by_fractions = np.linalg.matrix_power(np.array([[-1, -1], [8, -1]], dtype=object) * Fraction(1, 3), 60)
    swing = _swing(oscillator(8.0), 1.0, "rk4", (1.0, 0.0), steps)
    recursion = abs(swing[60, 0] - float(by_fractions[0, 0]))
    drift = float(np.abs((8.0 * swing[:, 0] ** 2 + swing[:, 1] ** 2) / 8.0 - 1.0).max())
    logs, formulas = [], []
    for factor in (1.0 - 1e-4, 1.0 + 1e-4):
        square = 8.0 * factor**2
        states = _swing(oscillator(square), 1.0, "rk4", (1.0, 0.0), steps)
        logs.append(math.log((square * states[-1, 0] ** 2 + states[-1, 1] ** 2) / square))
        formulas.append(steps * math.log1p(square**3 * (square - 8.0) / 576.0))
    return result_of(
        f"h = 2√2: energy constant to 1e-9; h·(1 ∓ 1e-4): ln(E/E₀) = {formulas[0]:.4f} and {formulas[1]:+.4f} after "
        f"{steps} steps, within 1e-6 of itself",
        f"energy varies by {rounded(drift, 2)}, sample 60 off by {rounded(recursion, 2)}; ln(E/E₀) = {logs[0]:.4f} "
        f"and {logs[1]:+.4f}",
        "|R(ih)|² = 1 + h⁶·(h² − 8)/576, and the step in exact fractions, [[−1, −1], [8, −1]]/3",
        tolerance="1e-9 of the energy, 1e-11 of a sample, 1e-6 of ln of growth",
        within=[(drift, 1e-9), (recursion, 1e-11), (relative_error(logs, formulas), 1e-6)],
    )


def semi_implicit_at_its_limit(quick: bool) -> CaseResult:
    """Check linear growth by the double root −1 at h = 2, no growth just below it, and exponential growth above."""
    steps = 1_000 if quick else 50_000
    linear = _swing(oscillator(4.0), 1.0, "semi-implicit", (0.0, 1.0), steps)[-1, 0]
    expected = -steps * (-1.0) ** steps
    below_square, above_square = 4.0 * (1.0 - 1e-6) ** 2, 4.0 * (1.0 + 1e-6) ** 2
    below = np.abs(_swing(oscillator(below_square), 1.0, "semi-implicit", (0.0, 1.0), steps)[:, 0]).max()
    bound = 1.0 / math.sqrt(below_square * (1.0 - below_square / 4.0))
    above = discrete(oscillator(above_square), 1.0, "semi-implicit")
    radius, formula = spectral_radius(above.a), math.exp(2.0 * math.acosh(1.0 + 1e-6))
    return result_of(
        f"h = 2: |p| = n = {steps} from v₀ = 1; h = 2 − 2e-6: |p| up to {bound:.2f}; h = 2 + 2e-6: radius "
        f"{formula:.9f}",
        f"|p| = {rounded(abs(linear), 9)} after {steps} steps; up to {below:.2f}; radius {radius:.9f}",
        "Mⁿ = (−1)ⁿ(1 − n·(M + 1)) at h = 2, |sin nφ|/(h·√(1 − h²/4)) below, radius "
        "e^{2·acosh(h/2)}; tolerances 1e-9, 1e-4, 1e-9",
        tolerance="1e-9 of n and of the radius, 1e-4 of the bound",
        within=[(linear - expected, 1e-9 * steps), (below / bound - 1.0, 1e-4), (radius - formula, 1e-9)],
    )


def damper_b_equals_kt(quick: bool) -> CaseResult:
    """Check that a damper b = k·T removes exactly the energy that forward Euler adds, and 1 % more or less does not."""
    square, steps = 250.0 / 0.4 * PERIOD**2, 2_000 if quick else 50_000
    found = _swing(oscillator(square, square), 1.0, "forward-euler", (1.0, 0.0), steps)
    one, s = Decimal(1), Decimal(square)
    with localcontext(prec=DIGITS):
        expected = free_motion(((one, one), (-s, 1 - s)), (one, 0 * one), steps)
    error = abs(found[-1, 0] - expected)
    shares = (0.99, 1.0, 1.01)
    steppers = [discrete(oscillator(square, share * square), 1.0, "forward-euler") for share in shares]
    radii = [spectral_radius(stepper.a) for stepper in steppers]
    worst = greatest(abs(r - math.sqrt(1.0 + (1.0 - f) * square)) for r, f in zip(radii, shares, strict=True))
    return result_of(
        f"k = 250 N/m, m = 0.4 kg, T = 1 ms: radius 1 at b = kT, {1 + 0.005 * square:.9f} at 0.99·kT; position after "
        f"{steps} steps {expected:.12f}",
        f"radius {radii[1]:.12f} at b = kT, {radii[0]:.9f} at 0.99·kT, {radii[2]:.9f} at 1.01·kT; position off by "
        f"{rounded(error, 2)}",
        "determinant 1 − bT/m + kT²/m, and the recursion in 50 decimal digits; tolerances 1e-12 and 1e-9",
        tolerance="1e-12 of the radii, 1e-9 of the position",
        within=[(worst, 1e-12), (error, 1e-9)],
    )


def lecture_constants(quick: bool) -> CaseResult:
    """Check the lecture's held puck moved by one unit: ω_n, f_n, T_n, overshoot, and Euler's eigenvalues."""
    natural = math.sqrt(STIFFNESS / MASS)
    turns = 5 if quick else 100
    step = bind(sprung_mass(), PERIOD, "exact-foh")
    forces = np.array([step(0.0), *(step(1.0) for _ in range(int((turns + 1) * 2.0 * math.pi / natural / PERIOD)))])
    at = np.nonzero((forces[:-1] < 0.0) & (forces[1:] >= 0.0))[0]
    crossings = PERIOD * (at + forces[at] / (forces[at] - forces[at + 1]))
    measured = float((crossings[turns] - crossings[0]) / turns)
    modes = np.linalg.eigvals(discrete(sprung_mass(), PERIOD, "forward-euler").a)
    modes = modes[np.argsort(modes.imag)]
    off = greatest((abs(modes[0] - (1.0 - 0.02j)), abs(modes[1] - (1.0 + 0.02j))))
    peak = float(forces.max()) / STIFFNESS
    return result_of(
        "k = 200 N/m, m = 0.5 kg, T = 1 ms: ω_n = 20 rad/s, f_n = 3.183099 Hz, T_n = 314.1593 ms; Euler 1 ± 0.02j; "
        "the mass overshoots to 2 units",
        f"ω_n = {2.0 * math.pi / measured:.6f} rad/s, f_n = {1.0 / measured:.6f} Hz, T_n = {1e3 * measured:.4f} ms; "
        f"Euler off by {rounded(off, 2)}; overshoot to {1.0 + peak:.4f} units",
        "closed form √(k/m), ω_n/2π, 2π/ω_n, 1 − cos ω_n·t; tolerances 1e-6 relative, 1e-12, 1e-3",
        tolerance="1e-6 of ω_n, 1e-12 of the matrix, 1e-3 of the overshoot",
        within=[(measured * natural / (2.0 * math.pi) - 1.0, 1e-6), (off, 1e-12), (peak - 1.0, 1e-3)],
    )


def energy_drift(quick: bool) -> CaseResult:
    """Check the energy of exact-foh and of Verlet over ten million steps of a mass that swings freely.

    A quick report takes a hundred thousand steps.
    """
    steps = 100_000 if quick else 10_000_000
    h2 = STIFFNESS / MASS * PERIOD**2
    exact, verlet = loops.free_swing("exact-foh", steps).energy, loops.free_swing("verlet", steps).energy
    tolerance = steps * 2.0**-52 + 1e-11
    drift, low, high = greatest(map(abs, exact)), -greatest(-each for each in verlet), greatest(verlet)
    return result_of(
        f"{rounded(steps, 1)} steps at h = 0.02: exact-foh |E/E₀ − 1| ≤ {rounded(tolerance, 2)}; verlet from −h²/4 = "
        f"{rounded(-h2 / 4, 2)} to 0",
        f"exact-foh at most {rounded(drift, 2)}; verlet from {rounded(low, 4)} to {rounded(high, 2)}",
        "the invariants: p² + (v/ω)² of the exact motion, p² + (v/ω)²/(1 − h²/4) of Verlet; one rounding a step",
        tolerance=f"{rounded(tolerance, 2)} of the energy",
        within=[(drift, tolerance)],
        holds=-h2 / 4 - tolerance <= low <= -h2 / 8 and high <= tolerance,
    )
