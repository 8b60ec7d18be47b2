"""Cases of stated figures of a loop: the worst case of its ranges, the damping for passivity, the score of a run."""

import math
from collections.abc import Sequence
from itertools import product

import numpy as np

from haptic_fieldbus import Verdict
from haptic_fieldbus.assessing import ErrorSums
from haptic_fieldbus.margins import EVERYWHERE, Group, Member, Places, Plant, Ranges, verdict_at_places
from haptic_fieldbus.numerals import exactly, rounded
from haptic_fieldbus.numerics.estimators import bind
from haptic_fieldbus.numerics.linear import foh
from haptic_fieldbus.scenes.element import Element, Interval
from haptic_fieldbus.scenes.magnet import Magnet
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.study.case import CaseResult, greatest, relative_error, result_of, values_text
from haptic_fieldbus.study.measure.bench import DEFAULT_ESTIMATOR
from haptic_fieldbus.study.oracles import energies, events
from haptic_fieldbus.study.oracles.contact import bisected, limit_in_contact

PERIOD = 1e-3
MASS, DAMPING = 0.1, 2.0
"""Device [kg, N·s/m]."""
DEVICE = Plant(MASS, DAMPING)
LAGS, DELAYS = (0.1e-3, 0.4e-3), (0.2e-3, 0.8e-3)
"""Shortest and longest lag and delay of the ranges [s]."""
SHARES = {"mass": (0.8, 1.25), "damping": (0.5, 2.0)}
"""Ranges that the documentation states for any bench."""
DAMPERS = (0.0, 20.0)
"""Dampers of two walls [N·s/m]: with the second one the lightest device is the worst."""
AGREEMENT, ROUGH, CUT = 1e-6, 1e-5, 5e-4
"""Permitted relative difference of closed forms, of limits over ranges, and of energies: motions are cut into cells."""


def _alone(
    element: Element,
    plant: Plant = DEVICE,
    estimator: str = DEFAULT_ESTIMATOR,
    travel: Interval = EVERYWHERE,
    ranges: Ranges | None = None,
    delay: float = 0.0,
) -> Group:
    """Return an axis with this element."""
    member = Member("handle", plant, delay, (element,), None, estimator, (), ranges, math.inf, travel)
    return Group((member,), (), PERIOD)


def worst_of_ranges(quick: bool) -> CaseResult:
    """Check that the limit is that of the worst device, lag and delay within their ranges.

    For a plain wall the worst case is the largest delay and the least friction; with much virtual damping it is the
    lightest mass.
    """
    ranges = Ranges(LAGS, DELAYS)
    middle = Plant(MASS, DAMPING, torque_lag=LAGS[0])
    found, by_hand, whole = [], [], []
    lags, delays = (LAGS[1:], DELAYS[1:]) if quick else (LAGS, DELAYS)
    for virtual in DAMPERS:
        group = _alone(Wall("handle", 100.0, damping=virtual), middle, ranges=ranges, delay=DELAYS[0])
        found.append(group.limit_over_ranges().value)
        corners = product(SHARES["mass"], SHARES["damping"], lags, delays)
        by_hand.append(
            min(
                limit_in_contact(events.motor(mass * MASS, damping * DAMPING, lag), PERIOD, delay, virtual)
                for mass, damping, lag, delay in corners
            )
        )
        whole.append(limit_in_contact(events.motor(MASS, DAMPING, LAGS[0]), PERIOD, DELAYS[0], virtual))
    apart = relative_error(found, by_hand)
    return result_of(
        f"mass 0.8 to 1.25, damping 0.5 to 2 times, lag to 0.4 ms, delay to 0.8 ms: {values_text(by_hand, 6)} N/m with "
        f"dampers of {exactly(DAMPERS[0])} and {exactly(DAMPERS[1])} N·s/m (in the middle {values_text(whole, 4)})",
        f"{values_text(found, 6)} N/m, apart by {rounded(apart, 1)}",
        "each corner of the ranges by hand, device and torque loop from event to event",
        tolerance=f"{exactly(ROUGH)} of the limits",
        within=[(apart, ROUGH)],
    )


ESTIMATOR, VIRTUAL = "kalman-acceleration", 0.5
"""Estimator whose first response to a move overshoots the move, and a damper that it drives [N·s/m]."""
REMEMBERED = 400
"""Periods after which it has forgotten a move."""


def _largest_answer() -> float:
    """Return the largest velocity of the running estimator for moves of one way per period, in ways per period."""
    velocity = bind(ESTIMATOR, PERIOD)
    places = [0.0] * 5 + [1.0] * REMEMBERED
    # After one move: what that move gives in each later period. The hand that moves by these signs gets the sum.
    answers = [velocity(place) for place in places][5:]
    return sum(abs(each) for each in answers) * PERIOD


def estimator_weight(quick: bool) -> CaseResult:
    """Check that passivity counts the overshoot of an estimator that responds to single moves.

    A hand that moves back and forth with the signs of the estimator's weights gets B·Σ|w| per way, and K·T/2 from a
    spring K.
    """
    limit = _alone(Wall("handle", 100.0, damping=VIRTUAL), estimator=ESTIMATOR).stability.stiffness_limit.passive
    found, answer = limit or math.nan, _largest_answer()
    by_hand = (DAMPING - VIRTUAL * answer) / (0.5 * PERIOD)
    off = abs(found / by_hand - 1.0)
    return result_of(
        f"{ESTIMATOR}: moves of one way give up to {rounded(answer, 4)} ways a period; (b - {rounded(answer, 4)}·B)"
        f"/(T/2) = {rounded(by_hand, 6)} N/m (one way would leave {rounded((DAMPING - VIRTUAL) / (0.5 * PERIOD), 4)})",
        f"passive to {rounded(found, 6)} N/m, off by {rounded(off, 1)}",
        "the running estimator after a single move, period by period",
        tolerance=f"{exactly(AGREEMENT)} of the limit",
        within=[(off, AGREEMENT)],
    )


COUNT, STIFFNESS = 1e-5, 1000.0
"""Encoder count [m], and a wall [N/m]."""


def _most_wrong(steps: int) -> float:
    """Return the largest change of the wall's force by the rounding of two neighbouring samples [N]."""
    within = (np.arange(steps) + 0.5) / steps - 0.5  # of a count, from its middle
    now, before = np.meshgrid(within, within)
    off = -COUNT * now, -COUNT * before
    return float(np.abs(STIFFNESS * off[0] + VIRTUAL * (off[0] - off[1]) / PERIOD).max())


def rounding_bridged(quick: bool) -> CaseResult:
    """Check that friction has to bridge the force steps of the counts: half a count of position, one of velocity."""

    def is_active(coulomb: float) -> bool:
        group = _alone(Wall("handle", STIFFNESS, damping=VIRTUAL), Plant(MASS, DAMPING, coulomb, COUNT))
        environment = group.environment()
        return not (isinstance(environment, Places) and verdict_at_places(group.loop, environment) is Verdict.PASSIVE)

    _, high = bisected(is_active, 0.0, 1.0, 1e-10)
    steps = 500 if quick else 2000
    by_hand = _most_wrong(steps) * steps / (steps - 1)
    off = abs(high / by_hand - 1.0)
    return result_of(
        f"the counts of two samples change the force by up to {rounded(by_hand, 5)} N (half a count of position alone: "
        f"{rounded(0.5 * STIFFNESS * COUNT, 2)} N)",
        f"called passive from {rounded(high, 5)} N of Coulomb friction on, off by {rounded(off, 1)}",
        "all places of two samples within their counts, by brute force",
        tolerance=f"{exactly(AGREEMENT)} of the friction",
        within=[(off, AGREEMENT)],
    )


RADIUS = 0.02
OUTER = (0.755 * RADIUS, 0.81 * RADIUS)
"""Travel on the outer slope of a magnet [m], which is steepest at √0.6 of its radius."""


def magnet_outside(quick: bool) -> CaseResult:
    """Check that the outer slope of a magnet is judged by its steepest part, for a handle that moves there alone.

    There the force falls with the way, by 0.8 of the slope in the middle. Slopes of both signs leak alike.
    """
    limit = _alone(Magnet("handle", 1.0, RADIUS), travel=OUTER).stability.stiffness_limit.passive
    u = np.linspace(OUTER[0], OUTER[1], 20_001) / RADIUS
    falls = np.diff(u * (1.0 - u * u) ** 2) / np.diff(u)
    steepest = float(np.abs(falls).max()) * (limit or math.nan)
    drives = [energies.LateDrive(DAMPING, 0.0)]
    share = energies.worst_share(lambda z: complex(-steepest), drives, PERIOD, 24 if quick else 96)
    return result_of(
        f"where passivity ends, {rounded(float(np.abs(falls).max()), 4)} of the stiffness in the middle needs all of "
        "the device's damping",
        f"passive to {rounded(limit or math.nan, 6)} N/m in the middle; needed share off by {rounded(share - 1.0, 1)}",
        "slopes of u·(1 - u²)² by differences; the worst of all motions in cells of constant speed",
        tolerance=f"{exactly(CUT)} of the energy",
        within=[(share - 1.0, CUT)],
    )


TURN, LATE, POINTS = 2.0 * math.pi * 2.0, 4e-3, 100_000
"""Motion of a hand [rad/s] in a spring, delay of its force [s], and points of one turn."""
SLOWEST = 0.05
"""Share of the fastest speed from which a handle counts as moving."""
CLOSE = 2e-3
"""Permitted relative difference of a score: its threshold of speed is known to 1 %."""


def late_spring_score(quick: bool) -> CaseResult:
    """Check the score of a spring with a late force in a sine motion: error over force, both while the handle moves."""
    points = POINTS if quick else 10 * POINTS
    phase = 2.0 * math.pi * (np.arange(points) + 0.5) / points
    ideal, force = np.sin(phase), np.sin(phase - TURN * LATE)
    sums = ErrorSums()
    sums.add(force - ideal, ideal, {}, np.cos(phase), [force - ideal])
    figures = sums.figures("N", [0.0])
    found = figures.error_rms_contact / figures.ideal_rms_contact
    # ∫sin² from 0 to the phase at which it is too slow; the error is 2·sin(ω·τ/2)·cos(φ − ω·τ/2), over four such parts.
    edge = math.acos(SLOWEST)
    force_square = 0.5 * edge - 0.25 * math.sin(2.0 * edge)
    wave = 0.5 * edge + 0.25 * math.sin(2.0 * edge) * math.cos(TURN * LATE)
    by_hand = 2.0 * math.sin(0.5 * TURN * LATE) * math.sqrt(wave / force_square)
    off = abs(found / by_hand - 1.0)
    moving = abs(figures.scored / points / (2.0 * edge / math.pi) - 1.0)
    return result_of(
        f"a force {rounded(1e3 * LATE, 2)} ms late at 2 Hz: error {rounded(100.0 * by_hand, 5)} % over the "
        f"{rounded(200.0 * edge / math.pi, 4)} % of the time at 5 % of the fastest speed or more",
        f"{rounded(100.0 * found, 5)} %, off by {rounded(off, 1)}; moving time off by {rounded(moving, 1)}",
        "closed form of the integrals of two sines",
        tolerance=f"{exactly(CLOSE)} of the score and of the time",
        within=[(off, CLOSE), (moving, CLOSE)],
    )


RATES: Sequence[float] = (1.0, 30.0, 300.0, 3000.0)
"""Turns of masses on springs [rad/s]."""
RAMP = 7.0
"""Speed of the point that pulls them [m/s]."""


def straight_line_step(quick: bool) -> CaseResult:
    """Check a step with an input on a straight line: a mass that is pulled at constant speed from rest.

    q(t) = r·t − r/ω·sin(ω·t), to the last digits at any rate, even if cancellation leaves little of the result.
    """
    off = 0.0
    for rate in RATES if quick else (*RATES, 1e-2, 1e4):
        a, b = np.array([[0.0, 1.0], [-(rate**2), 0.0]]), np.array([[0.0], [rate**2]])
        _, before, after = foh(a, b, PERIOD)
        start, end = 0.0, RAMP * PERIOD
        found = before[:, 0] * start + after[:, 0] * end
        angle = rate * PERIOD
        # 1 − sin(a)/a and 1 − cos(a) by their series where they would cancel.
        series = angle**2 / 6.0 * (1.0 - angle**2 / 20.0 * (1.0 - angle**2 / 42.0))
        lag = series if angle < 0.1 else 1.0 - math.sin(angle) / angle
        expected = (RAMP * PERIOD * lag, RAMP * 2.0 * math.sin(0.5 * angle) ** 2)
        off = greatest((off, relative_error(found.tolist(), expected)))
    return result_of(
        "q = r·t - r/ω·sin(ω·t), its speed r·(1 - cos(ω·t))",
        f"off by at most {rounded(off, 1)} at ω·T = {values_text([rate * PERIOD for rate in RATES], 2)}",
        "closed form of a mass on a spring whose end moves at constant speed",
        tolerance="1e-9 of position and speed",
        within=[(off, 1e-9)],
    )
