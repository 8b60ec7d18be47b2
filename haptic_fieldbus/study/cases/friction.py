"""Cases of encoder counts and Coulomb friction: a handle pressed to the edge between two counts, and above the limit.

A hand presses with the force of one and a half counts, so the handle stands on the edge between counts 1 and 2. There
the total force is +K·D/2 or −K·D/2: a relay. For any period, the handle rests only if friction bridges that force, fc ≥
K·D/2.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from haptic_fieldbus.margins import Increments, Plant, limit_of, sample
from haptic_fieldbus.numerals import exactly, rounded
from haptic_fieldbus.numerics import sampled
from haptic_fieldbus.numerics.batch import Array, Loops, Running, loops
from haptic_fieldbus.numerics.linear import StateSpace
from haptic_fieldbus.study.case import CaseResult, result_of, values_text
from haptic_fieldbus.study.measure.problems import spring
from haptic_fieldbus.study.oracles.contact import Pressed, bisected, jury_limit, largest, relay_speed

MASS, DAMPING, PERIOD, STEP = 0.63, 1.58, 1e-3, 1e-5
DEVICE = Plant(MASS, DAMPING)
CLOSE = 1e-3
"""Permitted relative difference of the border between chatter and rest."""
SHARES = np.array([0.9, 0.99, 1.0 - CLOSE, 1.0 + CLOSE, 1.01, 1.1])
"""Shares of a border at which loops run."""
KNOCK = 6e-4
"""Initial speed [m/s], so that a handle at rest at the end has come to rest from a motion."""


def recorded(many: Loops, settle: int, samples: int) -> Array:
    """Return positions and velocities of n handles after `settle` periods, `(samples, 2, n)`."""
    running, states = Running(many), np.empty((samples, 2, len(many)))
    running.advance(settle)
    for taken in range(samples):
        states[taken] = running.state[0], running.state[1]
        running.advance(1)
    return states


def _moves(many: Loops, settle: int) -> list[bool]:
    """Return a mask of the handles that still move after `settle` periods, `(n,)`."""
    # Differences of neighbours over 21 samples: the ends alone would miss a cycle of two samples.
    steps = np.diff(recorded(many, settle, 21)[:, 0], axis=0)
    return [bool(each.any()) for each in steps.T]


def _rests_by_hand(stiffness: float, step: float, coulomb: float, period: float, settle: int) -> bool:
    """Return whether a handle that is pressed to the edge between counts 1 and 2 comes to rest, by hand."""
    handle = Pressed(MASS, DAMPING, coulomb, stiffness, step, 1.5 * stiffness * step, period)
    return handle.rests(1.5 * step, KNOCK, settle)


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
    found, agree = [], True
    for period in (0.25e-3, 0.5e-3, 1e-3):
        moves = _moves(_pressed(stiffness, SHARES * border, coulomb, period), settle)
        found.append(border * _edge([not each for each in moves]))
        rests = [_rests_by_hand(stiffness, part * border, coulomb, period, 1500) for part in SHARES.tolist()]
        agree &= rests == [not each for each in moves] and moves == sorted(moves)
    return result_of(
        f"rest up to D = 2·fc/K = {border * 1e6:.2f} µm, chatter above, at T = 0.25, 0.5 and 1 ms alike (±0.1 %)",
        f"border at {values_text([step * 1e6 for step in found], 5)} µm",
        "balance of forces at the edge of a count (Abbott & Okamura); the loop in plain floats on both sides",
        tolerance="0.1 % of the border",
        within=[(step / border - 1.0, CLOSE) for step in found],
        holds=agree,
    )


def coulomb_rescue(quick: bool) -> CaseResult:
    """Check that friction of half a count's force ends the chatter of a pressed wall."""
    stiffness, settle = 1000.0, 2000 if quick else 30_000
    needed = 0.5 * stiffness * STEP
    shares = np.append(0.0, SHARES)
    moves = _moves(_pressed(stiffness, STEP, shares * needed, PERIOD), settle)
    found = _edge(moves[1:])
    rests = [_rests_by_hand(stiffness, STEP, part * needed, PERIOD, 2000) for part in shares.tolist()]
    return result_of(
        f"chatter without friction, rest from fc = K·D/2 = {needed * 1e3:.3f} mN (±0.1 %)",
        f"{'chatter' if moves[0] else 'rest'} without friction, rest from {found * needed * 1e3:.3f} mN",
        "balance of forces at the edge of a count; the loop in plain floats on both sides",
        tolerance="0.1 % of the friction",
        within=[(found - 1.0, CLOSE)],
        holds=moves == [not each for each in rests] and moves == sorted(moves, reverse=True),
    )


def _edge(before: list[bool]) -> float:
    """Return the middle between the last of SHARES up to which a condition holds, and the next one."""
    count = sum(before)
    low, high = np.concatenate([[0.0], SHARES, [np.inf]])[count : count + 2].tolist()
    return 0.5 * (float(low) + float(high))


def one_count_wall(quick: bool) -> CaseResult:
    """Check a wall pressed one count deep: its chatter against a loop written by hand, its estimate, and its bound.

    The cycle is symmetric, with the speed K·D/(2·b)·tanh(b·n·T/(2·m)) for n samples in a half. The estimate by a
    describing function has the amplitude 2·D·K/(π·Kmax), with Kmax the limit without counts; the bound is
    ∫v²/∫|v| ≤ (K·D/2)/(b − K·T/2).
    """
    stiffness, settle = 600.0, 5000 if quick else 200_000
    hand = Pressed(MASS, DAMPING, 0.0, stiffness, STEP, 0.5 * stiffness * STEP, PERIOD, one_sided=True)
    many = loops(
        mass=MASS, damping=DAMPING, period=PERIOD, stiffness=stiffness, resolution=STEP, unilateral=True,
        push=hand.push, position=0.6 * STEP,
    )  # fmt: skip
    x, v = recorded(many, settle, 1001)[1:, :, 0].T
    half, highest = _half_cycle(x), float(np.abs(v).max())
    one = _states_by_hand(hand, settle, 1001)[1:]
    apart = float(np.abs(one - np.column_stack([x, v])).max(axis=0) @ [1.0 / STEP, 1.0 / highest])
    expected = relay_speed(hand, _half_cycle(one[:, 0]))
    estimate = edge_chatter(Plant(MASS, DAMPING, 0.0, STEP), PERIOD, 0.0, spring(stiffness))
    size = 2.0 * STEP * stiffness / (math.pi * jury_limit(DEVICE, PERIOD))
    told = 0.0 if estimate is None else estimate.amplitude
    bound = 0.5 * stiffness * STEP / (DAMPING - 0.5 * stiffness * PERIOD)
    most = chatter_speed(Plant(MASS, DAMPING, 0.0, STEP), PERIOD, 0.0, stiffness)
    found = float((one[:, 1] ** 2).sum() / np.abs(one[:, 1]).sum())
    deepest, least = float(x.max()) / STEP, float(x.min()) / STEP
    return result_of(
        f"chatter for ever between 0 and 1 counts, {expected * 1e6:.4f} µm/s at n = {exactly(_half_cycle(one[:, 0]))}; "
        f"estimate {size * 1e6:.4f} µm; bound {bound * 1e3:.4f} mm/s",
        f"n = {exactly(half)} samples, {highest * 1e6:.4f} µm/s, between {least:.2f} and {deepest:.2f} counts, apart "
        f"by {rounded(apart, 1)}; estimate {told * 1e6:.4f} µm; bound {most * 1e3:.4f} mm/s, the loop has "
        f"{found * 1e3:.4f}",
        "the loop in plain floats, and the closed form of its cycle; Jury's limit; the bound by hand",
        tolerance="1e-6 of the cycle and of the estimate, 1e-9 of the bound",
        within=[(apart, 1e-6), (highest / expected - 1.0, 1e-6), (told / size - 1.0, 1e-6), (most / bound - 1.0, 1e-9)],
        holds=least > -0.5 and deepest < 1.5 and found < bound,
    )


def _half_cycle(x: Array) -> float:
    """Return the mean number of samples between two crossings of the edge at half a count."""
    switches = np.flatnonzero(np.diff(x >= 0.5 * STEP))
    return float(switches[-1] - switches[0]) / (len(switches) - 1)


def _states_by_hand(device: Pressed, settle: int, samples: int) -> Array:
    """Return position and velocity of a handle that starts within the first count, `(samples, 2)`."""
    state, states = (0.6 * STEP, 0.0), []
    for number in range(settle + samples):
        if number >= settle:
            states.append(state)
        state = device.moved(*state)
    return np.array(states)


def local_stability(quick: bool) -> CaseResult:
    """Check that above K = 2b/T small motions stick and large ones cycle; the threshold is computed by hand."""
    stiffness, most = 8000.0, 5.0
    coulomb = 1.2 * 0.5 * stiffness * STEP
    hand = Pressed(MASS, DAMPING, coulomb, stiffness, STEP, 0.0, PERIOD, most=most)
    turn = math.sqrt(stiffness / MASS)
    estimate = 4.0 * coulomb / (math.pi * turn * (0.5 * stiffness * PERIOD - DAMPING))
    threshold = largest(lambda start: hand.dies(start), 0.5 * estimate, 1.3, 0.5 * CLOSE)
    running = Running(loops(
        mass=MASS, damping=DAMPING, coulomb=coulomb, resolution=STEP, period=PERIOD, stiffness=stiffness,
        saturation=most, position=SHARES * threshold,
    ))  # fmt: skip
    running.advance(5500 if quick else 40_000)
    peaks = running.advance(500)
    sticks: list[bool] = (running.state[1] == 0.0).tolist()
    found = _edge(sticks) * threshold
    cycles = peaks[[not each for each in sticks]]
    same = len(cycles) > 0 and float(np.ptp(cycles)) <= 0.05 * float(cycles.max()) and cycles.min() > most / stiffness
    return result_of(
        f"starts below {threshold * 1e3:.4f} mm stick (±0.1 %; by a describing function 4·fc/(π·ω·(K·T/2 - b)) = "
        f"{estimate * 1e3:.3f} mm), larger ones end in one cycle beyond saturation",
        f"threshold {found * 1e3:.4f} mm, cycle of {float(cycles.max(initial=0.0)) * 1e3:.2f} mm",
        "the loop in plain floats, bisected in its start; a describing function is an estimate, within 10 % of it",
        tolerance="0.1 % of the threshold",
        within=[(found / threshold - 1.0, CLOSE), (threshold / estimate - 1.0, 0.1)],
        holds=sticks == sorted(sticks, reverse=True) and bool(same),
    )


# Chatter over the edge of an encoder count: its prediction by a describing function, and a proved bound.
# The environment's force is multiplied by the gain ν of the nonlinearity. When the loop with ν is on the border of
# stability, it oscillates at the frequency of its critical eigenvalue, with the amplitude at which the gain is ν.
#
# A handle pressed against a wall, between two counts: encoder and wall are a relay with ν(A) = 2·D/(π·A). Without
# Coulomb friction such a cycle always exists. Friction acts as damping 4·fc/(π·ω·A), and ends the cycle for stiffnesses
# up to about K = 2·fc/D. (Gelb & Vander Velde, Multiple-Input Describing Functions and Nonlinear System Design,
# McGraw-Hill 1968, appendix B.)
#
# The prediction is an estimate, not a bound. It is accurate if the loop is a good low-pass filter. Over the edge of a
# count several cycles exist beside each other: from rest the loop settles to the one predicted here, within 20 % if it
# lasts 24 samples or more; after a knock it may settle to another one.
#
# Proof. The rounding of a step D changes the force of a spring K by at most K·D/2, so the motor gives at most
#
#     ∫f·v ≤ b_K·∫v² + (K·D/2)·∫|v|,   b_K = ½·K·(g + √(g² + S)), g = T/2 + td + λ
#
# (`passivity`; about K·(T/2 + td)). The device takes b·∫v² + fc·∫|v|. In a periodic motion both are equal. If b > b_K,
# therefore
#
#     ∫v²/∫|v| ≤ (K·D/2 − fc)/(b − b_K),
#
# and nothing moves if fc ≥ K·D/2. If b ≤ b_K there is no bound.

MOST_DAMPING = 1e6
"""Largest damping equivalent to friction, as a multiple of the device's damping or m/T; above it is no cycle."""


@dataclass(frozen=True)
class LimitCycle:
    """A motion A·sin(ωt) around the position of contact; amplitude [m or rad], angular frequency [rad/s]."""

    amplitude: float
    angular_frequency: float


def _critical(plant: Plant, period: float, delay: float, environment: StateSpace) -> tuple[float, float]:
    """Return (ν, ω [rad/s]): the share of the environment's force at which the loop oscillates, and the frequency."""
    device = sample(plant, period, delay)
    scale = (plant.mass / period**2 + plant.damping / period) / abs(float(environment.d[0, 0]))
    gain = limit_of(lambda part: sampled.growth(device, sampled.scaled(environment, part)), scale)
    scaled = sampled.scaled(environment, gain)
    modes = np.linalg.eigvals(sampled.without_shift(sampled.loop_matrix(device, scaled), device, scaled))
    return gain, float(abs(np.angle(modes[np.abs(modes).argmax()]))) / period


def edge_chatter(plant: Plant, period: float, delay: float, environment: StateSpace) -> LimitCycle | None:
    """Return an estimate of a cycle of a handle pressed to the edge between two counts; None when there is none.

    The environment is that of the contact, x_k → F_k, with a direct force. There is no cycle when friction holds the
    handle, without quantisation, with a tachometer (its velocity has no steps of position), and in an unstable loop,
    because its motions grow beyond a count.
    """
    if not plant.resolution or plant.tachometer or _critical(plant, period, delay, environment)[0] <= 1.0:
        return None

    def cycle(damping: float) -> tuple[float, float]:
        gain, turn = _critical(replace(plant, damping=damping), period, delay, environment)
        return 2.0 * plant.resolution / (math.pi * gain) if gain else math.inf, turn

    def lacking(damping: float) -> float:
        amplitude, turn = cycle(damping)
        return plant.damping + 4.0 * plant.coulomb / (math.pi * turn * amplitude) - damping

    # Find the damping that equals the device's own plus that of friction in the cycle which this damping leaves.
    low = high = plant.damping
    if plant.coulomb:
        high = max(plant.damping, 1e-3 * plant.mass / period)  # above 0, to be doubled
        while lacking(high) > 0.0:
            low, high = high, 2.0 * high
            if high > MOST_DAMPING * max(plant.damping, plant.mass / period):
                return None
        _, high = bisected(lambda damping: lacking(damping) > 0.0, low, high, 1e-9)
    amplitude, turn = cycle(high)
    return LimitCycle(amplitude, turn) if math.isfinite(amplitude) else None


def chatter_speed(plant: Plant, period: float, delay: float, stiffness: float) -> float:
    """Return the largest ∫v²/∫|v| of a periodic motion against a spring [m/s or rad/s]; times in s.

    0 if friction bridges half a count and damping suffices, ∞ if no bound is proved.
    """
    needed = Increments(stiffness, 0.0).damping_needed(period, delay, plant.torque_lag)
    if plant.damping <= needed:
        return math.inf
    return max(0.5 * stiffness * plant.resolution - plant.coulomb, 0.0) / (plant.damping - needed)
