"""Cases of encoder counts and Coulomb friction: a handle pressed to the edge between two counts, and above the limit.

A hand presses with the force of one and a half counts, so the handle stands on the edge between counts 1 and 2. There
the total force is ±K·D/2 and nothing in between: a relay. The handle rests only if friction bridges that force,
fc ≥ K·D/2, for any period.
"""

import math

import numpy as np

from haptic_fieldbus.margins import Plant
from haptic_fieldbus.numerals import exactly
from haptic_fieldbus.numerics.batch import Running
from haptic_fieldbus.numerics.loops import Array, Loops, loops
from haptic_fieldbus.study.case import CaseResult, share_used, values_text
from haptic_fieldbus.study.cases.oracles.held import moved_by_force

MASS, DAMPING, PERIOD, STEP = 0.63, 1.58, 1e-3, 1e-5
DEVICE = Plant(MASS, DAMPING)
KNOCK = 6e-4
"""Initial speed [m/s]: a handle that is at rest in the end has come to rest, and was not left untouched."""


def recorded(many: Loops, settle: int, samples: int) -> Array:
    """Return positions and velocities of n handles after `settle` periods, `(samples, 2, n)`."""
    running, states = Running(many), np.empty((samples, 2, len(many)))
    running.advance(settle)
    for sample in range(samples):
        states[sample] = running.state[0], running.state[1]
        running.advance(1)
    return states


def _moves(many: Loops, settle: int) -> list[bool]:
    """Return whether each handle still moves after `settle` periods."""
    # Differences of neighbours over 21 samples: the ends alone would miss a cycle of two samples.
    steps = np.diff(recorded(many, settle, 21)[:, 0], axis=0)
    return [bool(each.any()) for each in steps.T]


def _slide(x: float, v: float, force: float, coulomb: float, span: float) -> tuple[float, float]:
    """Return position and velocity of the device with friction after `span` [s] of constant force, by hand.

    While it slides in the direction s, v tends to (F − fc·s)/b with the time constant m/b.
    """
    while span > 0.0:
        if v == 0.0 and abs(force) <= coulomb:
            return x, 0.0
        left = force - math.copysign(coulomb, v or force)
        # Time until the velocity passes 0, where the handle sticks or slides on the other way.
        turn = MASS / DAMPING * math.log(1.0 - v * DAMPING / left) if v * left < 0.0 else math.inf
        x, v = moved_by_force(DEVICE, x, v, left, min(turn, span))
        v = 0.0 if turn <= span else v
        span -= turn
    return x, v


def _moves_by_hand(stiffness: float, step: float, coulomb: float, period: float, settle: int) -> bool:
    """Return whether a handle pressed to the edge between counts 1 and 2 still moves after a knock, by hand."""
    x, v = 1.5 * step, KNOCK
    for _ in range(settle):
        counted = math.floor(x / step + 0.5) * step
        x, v = _slide(x, v, (1.5 * step - counted) * stiffness, coulomb, period)
    return v != 0.0


def _pressed(stiffness: float, step: float | Array, coulomb: float | Array, period: float) -> Loops:
    """Return loops with handles pressed to the edge between counts 1 and 2; arrays have the shape `(n,)`."""
    return loops(
        mass=MASS, damping=DAMPING, period=period, stiffness=stiffness, resolution=step, coulomb=coulomb,
        push=1.5 * stiffness * np.asarray(step), position=1.5 * np.asarray(step), velocity=KNOCK,
    )  # fmt: skip


def coarse_encoder(quick: bool) -> CaseResult:
    """Check that the encoder count from which a pressed wall chatters does not depend on the period."""
    stiffness, coulomb = 600.0, 0.003
    border, settle = 2.0 * coulomb / stiffness, 1500 if quick else 12_000
    steps = np.linspace(0.81, 1.19, 20) * border
    found, agree = [], True
    for period in (0.25e-3, 0.5e-3, 1e-3):
        moves = _moves(_pressed(stiffness, steps, coulomb, period), settle)
        resting = [step for step, moving in zip(steps.tolist(), moves, strict=True) if not moving]
        found.append(max(resting, default=0.0) + 0.5 * float(steps[1] - steps[0]))
        by_hand = [_moves_by_hand(stiffness, part * border, coulomb, period, 1500) for part in (0.95, 1.05)]
        agree &= by_hand == [False, True] and moves == sorted(moves)
    return CaseResult(
        f"rest up to D = 2·fc/K = {border * 1e6:.2f} µm, chatter above, at T = 0.25, 0.5 and 1 ms alike (±2 %)",
        f"border at {values_text([step * 1e6 for step in found], 4)} µm",
        agree and all(abs(step / border - 1.0) <= 0.02 for step in found),
        "balance of forces at the edge of a count (Abbott & Okamura); the loop in plain floats on both sides",
        tolerance="2 % of the border",
        used=share_used(*((step / border - 1.0, 0.02) for step in found)),
    )


def coulomb_rescue(quick: bool) -> CaseResult:
    """Check that friction of half a count's force ends the chatter of a pressed wall."""
    stiffness, settle = 1000.0, 2000 if quick else 30_000
    needed = 0.5 * stiffness * STEP
    shares = np.append(0.0, 0.025 * np.arange(60) + 0.0125)
    moves = _moves(_pressed(stiffness, STEP, shares * needed, PERIOD), settle)
    found = next((share for share, moving in zip(shares.tolist(), moves, strict=True) if not moving), 9.9) - 0.0125
    by_hand = [_moves_by_hand(stiffness, STEP, part * needed, PERIOD, 2000) for part in (0.95, 1.05)]
    return CaseResult(
        f"chatter without friction, rest from fc = K·D/2 = {needed * 1e3:.2f} mN (±2.5 %)",
        f"{'chatter' if moves[0] else 'rest'} without friction, rest from {found * needed * 1e3:.2f} mN",
        moves[0] and by_hand == [True, False] and moves == sorted(moves, reverse=True) and abs(found - 1.0) <= 0.025,
        "balance of forces at the edge of a count; the loop in plain floats at 0.95 and 1.05 of it",
        tolerance="2.5 % of the friction",
        used=share_used((found - 1.0, 0.025)),
    )


def one_count_wall(quick: bool) -> CaseResult:
    """Check that a wall pressed one count deep chatters in a symmetric cycle of speed K·D/(2·b)·tanh(b·n·T/(2·m))."""
    stiffness, settle = 600.0, 10_000 if quick else 200_000
    many = loops(
        mass=MASS, damping=DAMPING, period=PERIOD, stiffness=stiffness, resolution=STEP, unilateral=True,
        push=0.5 * stiffness * STEP, position=0.6 * STEP,
    )  # fmt: skip
    x, v = recorded(many, settle, 1001)[1:, :, 0].T
    switches = np.flatnonzero(np.diff(x >= 0.5 * STEP))
    half, highest = float(switches[-1] - switches[0]) / (len(switches) - 1), float(np.abs(v).max())
    expected = 0.5 * stiffness * STEP / DAMPING * math.tanh(0.5 * DAMPING * half * PERIOD / MASS)
    longest = math.sqrt(12.0 * MASS / (DAMPING * PERIOD)) + 1.0
    deepest, least = float(x.max()) / STEP, float(x.min()) / STEP
    return CaseResult(
        f"chatter for ever between 0 and 1 counts, n ≤ {longest:.0f} samples a half cycle, {expected * 1e6:.4f} µm/s "
        f"at n = {exactly(half)} (1e-6)",
        f"n = {exactly(half)} samples, {highest * 1e6:.4f} µm/s, between {least:.2f} and {deepest:.2f} counts",
        0.0 < half <= longest and abs(highest / expected - 1.0) <= 1e-6 and least > -0.5 and deepest < 1.5,
        "closed form of the symmetric cycle of a damped mass under a sampled relay",
        tolerance="1e-6 of the speed",
        used=share_used((highest / expected - 1.0, 1e-6)),
    )


def local_stability(quick: bool) -> CaseResult:
    """Check that above K = 2b/T small motions stick and large ones cycle, by the threshold of describing functions."""
    stiffness, most = 8000.0, 5.0
    coulomb = 1.2 * 0.5 * stiffness * STEP
    turn = math.sqrt(stiffness / MASS)
    expected = 4.0 * coulomb / (math.pi * turn * (0.5 * stiffness * PERIOD - DAMPING))
    starts = np.linspace(0.5, 1.5, 41) * expected
    running = Running(loops(
        mass=MASS, damping=DAMPING, coulomb=coulomb, resolution=STEP, period=PERIOD, stiffness=stiffness,
        saturation=most, position=starts,
    ))  # fmt: skip
    running.advance(5500 if quick else 40_000)
    peaks = running.advance(500)
    sticks: list[bool] = (running.state[1] == 0.0).tolist()
    found = 0.5 * float(starts[sticks.count(True) - 1] + starts[min(sticks.count(True), 40)])
    cycles = peaks[[not each for each in sticks]]
    same = len(cycles) > 0 and float(np.ptp(cycles)) <= 0.05 * float(cycles.max()) and cycles.min() > most / stiffness
    return CaseResult(
        f"starts below 4·fc/(π·ω·(K·T/2 − b)) = {expected * 1e3:.3f} mm stick (±10 %), larger ones end in one cycle "
        "beyond saturation",
        f"threshold {found * 1e3:.3f} mm, cycle of {float(cycles.max(initial=0.0)) * 1e3:.2f} mm",
        sticks == sorted(sticks, reverse=True) and bool(same) and abs(found / expected - 1.0) <= 0.1,
        "describing function of Coulomb friction against the sampled spring's energy gain, by hand",
        tolerance="10 % of the amplitude",
        used=share_used((found / expected - 1.0, 0.1)),
    )
