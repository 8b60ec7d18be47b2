"""Cases of integrators with extreme masses and numbers: refusals, overflow, vanishing mass, zero input."""

import math
from fractions import Fraction

import numpy as np

from haptic_fieldbus.api.open_loop import response
from haptic_fieldbus.cycle.safety import TripKind
from haptic_fieldbus.numerals import exactly, rounded
from haptic_fieldbus.numerics.integrators import METHODS, bind, discrete, discretise
from haptic_fieldbus.numerics.integrators.explicit import EXPLICIT, bind_rates
from haptic_fieldbus.numerics.integrators.trajectory import follow
from haptic_fieldbus.numerics.sampled import spectral_radius
from haptic_fieldbus.planning.selection import select
from haptic_fieldbus.planning.task import Task
from haptic_fieldbus.study.case import CaseResult, refused, share_used
from haptic_fieldbus.study.cases.drive_bench import COUNT, PERIOD_NS, Feeder, torque
from haptic_fieldbus.study.measure.problems import MASS, STIFFNESS, sprung_mass

LARGEST = 2**1024
"""Smallest power of two that is no finite double."""
SENTENCE = "expected a number above 0"
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
    """Check that forward Euler with much too long a period ends flagged before its first infinity.

    In the cycle, the target torque is zero from there on.
    """
    space = sprung_mass(100.0, 1.0)
    found = follow(discretise(space, 1.0, "forward-euler"), np.zeros((2_000, 2)), [1.0, 0.0])
    expected = _overflow_sample(100, Fraction(100))
    expected_trip = 1 + _overflow_sample(10_000, Fraction(STIFFNESS * COUNTS * COUNT))
    # The library's scene with a mass of 20 µg at 1 kHz, so that T·ω = 100.
    fast = Task("sprung_mass", settings={"sprung_mass.mass": 2e-8}, method="forward-euler")
    cycle, targets, commands = Feeder(select(fast).plan), [], []
    for period in range(PERIODS):
        targets.append(torque(cycle, COUNTS if period else 0, t_ns=period * PERIOD_NS))
        commands.append(abs(cycle.value("command")))
    tripped = cycle.trip.t_ns // PERIOD_NS if cycle.trip else PERIODS
    after, largest = targets[tripped:], max(commands[:tripped])
    return CaseResult(
        f"T·ω = 10 diverges at sample {expected}; in the cycle, T·ω = 100, trip at period {expected_trip} ± 1, then 0",
        f"flagged at sample {found.diverged_at}, all {len(found.outputs)} rows before finite; trip at period "
        f"{tripped} ({cycle.tripped.value if cycle.tripped else 'none'}), {len(after)} targets after it all "
        f"{max(map(abs, after), default=-1)} ‰, command before at most {rounded(largest)} N",
        found.diverged_at == expected == len(found.outputs)
        and bool(np.isfinite(found.outputs).all() and np.isfinite(found.states).all())
        and cycle.tripped is TripKind.NOT_FINITE
        and abs(tripped - expected_trip) <= 1
        and not any(after)
        and largest <= cycle.plan.axes[0].limits.effort,
        "the same recursion in unbounded integers, against 2¹⁰²⁴",
        tolerance="exact sample; a period of the trip",
    )


def _asked(mass: float) -> str:
    """Return the message with which `response` refuses a mass; empty when it does not."""
    return refused(lambda: response("sprung_mass", settings={"sprung_mass.mass": mass}, duration=0.01))


def mass_zero_refused(quick: bool) -> CaseResult:
    """Check that a mass of 0 is refused, and the smallest double too, because k/m overflows."""
    said = [_asked(mass) for mass in (0.0, -0.0)]
    tiny = refused(lambda: discretise(sprung_mass(STIFFNESS, 5e-324), 1e-3))
    return CaseResult(
        f'm = 0 and -0 kg refused with "{SENTENCE}"; m = 5e-324 kg (k/m = ∞) with "a mass must be above 0"',
        f'"{said[0]}"; "{tiny}"',
        all(SENTENCE in sentence for sentence in said) and "a mass must be above 0" in tiny,
        "q̇ = (k/m)·(x − p) has no value at m = 0; 200/5e-324 > 2¹⁰²⁴ (tolerance: none, the words are compared)",
        tolerance="exact words",
    )


def mass_negative_refused(quick: bool) -> CaseResult:
    """Check that a negative mass is refused, because it would run away as e^{t·√(k/|m|)}."""
    said = [_asked(mass) for mass in (-1e-12, -MASS, -1e12)]
    radius = spectral_radius(discrete(sprung_mass(STIFFNESS, -MASS), 1e-3).a)
    expected = math.exp(1e-3 * math.sqrt(STIFFNESS / MASS))
    return CaseResult(
        f'm = -1e-12, -0.5, -1e12 kg refused with "{SENTENCE}"; -0.5 kg would grow by {expected:.9f} a step of 1 ms',
        f'"{said[1]}"; grows by {radius:.9f} a step',
        all(SENTENCE in sentence for sentence in said) and abs(radius - expected) <= 1e-9,
        "pole s = +√(k/|m|) = +20 1/s, growth e^{sT} (tolerance 1e-9)",
        tolerance="exact words; 1e-9 of the growth",
        used=share_used((radius - expected, 1e-9)),
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
        worst = max(worst, max(abs(one - other) for one, other in zip(found, closed, strict=True)))
        largest.append(max(map(abs, found)))
        expected.append(max(map(abs, closed)))
    return CaseResult(
        f"m from 1 to 1e-7 kg (T·ω to {period * math.sqrt(stiffness / masses[-1]):.1f}): largest force from "
        f"{expected[0]:.4f} N (2·m·a) to {rounded(expected[-1])} N; each sample within {rounded(tolerance, 2)} N",
        f"largest force from {largest[0]:.4f} N to {rounded(largest[-1])} N; error of a sample at most "
        f"{rounded(worst, 2)} N",
        worst <= tolerance and largest == sorted(largest, reverse=True) and largest[-1] < 1e-5,
        "closed form F = −m·a·(h/2)·cot(h/2)·(1 − cos nh); tolerance 1e-12 of the spring force at the end, k·a·t²/2",
        tolerance=f"{rounded(tolerance, 2)} N a sample",
        used=share_used((worst, tolerance)),
    )


def zero_input_stays_zero(quick: bool) -> CaseResult:
    """Check that zero input gives exactly zero output with every method, linear and by rates."""
    steps = 2_000 if quick else 100_000
    worst = 0.0
    for stiffness, mass in ((STIFFNESS, MASS), (1e9, 1e-6)):
        space = sprung_mass(stiffness, mass)
        for method in METHODS:
            step = bind(space, 1e-3, method)
            worst = max(worst, *(abs(step(0.0)) for _ in range(steps)))
        square = stiffness / mass
        for method in EXPLICIT:
            advance = bind_rates(lambda t, z, u, s=square: (z[1], s * (u - z[0])), (0.0, 0.0), 1e-3, method, (0,))
            worst = max(worst, *(max(map(abs, advance(0.0))) for _ in range(steps)))
    return CaseResult(
        f"force and states exactly 0 for {steps} steps, also at T·ω = 31623",
        f"largest magnitude {exactly(worst)} over {len(METHODS)} linear and {len(EXPLICIT)} explicit methods",
        worst == 0.0,
        "ż = A z from z = 0: the zero solution, exact in floating point (tolerance 0)",
        tolerance="exact",
    )
