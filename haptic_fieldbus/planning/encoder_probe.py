"""The pulses that ask an encoder whose counts stand still under force: their size, and where they cannot be asked.

A hand that leans and an encoder whose cable broke look alike: force, and counts that stand still. What tells them apart
is a small torque of both signs. After `STILL` seconds a *pair* is added to the force: −A for n periods, then +A for n
periods, against the force first. A count that moves shows a live encoder. `PAIRS` pairs in a row without one end the
run.

Size. A shaft that friction holds at rest is pulled by some p, |p| ≤ fc, that nobody knows. One of the two pulses has at
least A − fc left, whatever p is; with p = 0 both have exactly that. So A is 1.5·fc or more. The excess E = A − fc moves
handle and hand together as far as

    x(t) = E/k·(1 − (s₁·e^(s₂·t) − s₂·e^(s₁·t))/(s₁ − s₂)),   s = −γ ± √(γ² − k/m),   γ = b/(2m)

up to the first turn, with the mass m and damping b of both and the stiffness k of the hand. A pair must move two counts
against the hand of `HAND`, so that one count changes wherever in a count the handle rests. The scene does not enter:
until a count changes its force stays as it is. Of the n periods three parts count for nothing: the lag T of the torque
loop, within which the force of the motor follows; T·ln(2A/E) at most, 2A/E ≤ 6, until it exceeds friction after −A; and
the time of the slew limit from −A to +A.

Bound. People cannot tell two forces apart that differ by less than about 8 % (`limits.FELT_SHARE`), so pulses are
asked from A/0.08 of force on. Where the force is within A of its limit it is lowered within half a second, as slowly as
a hand does not notice either, so that −A and +A both stay within the limit.

Below that force, and where the pulses that would be needed are felt or too long, the rule of `limits.stall` stays;
so it does where it acts sooner than five pairs.
"""

import cmath
import math
from collections.abc import Iterator
from dataclasses import dataclass

from haptic_fieldbus.margins import Plant
from haptic_fieldbus.numerals import exactly, in_unit, percent, rounded
from haptic_fieldbus.planning.axis_plan import AxisPlan
from haptic_fieldbus.planning.limits import FELT_SHARE
from haptic_fieldbus.signals import Workspace

STILL = 2.0
"""[s] for which counts must stand still under force before the encoder is asked."""
PAIRS = 5
"""Pairs without a motion that end a run."""
FRICTIONS = 1.5
"""Smallest pulse, in the friction of the rig: it covers half of the friction more than was told."""
ASKED_COUNTS = 2.0
"""Counts that a pair is designed to move."""
LEAD = 0.5
"""[s] before each pair, within which a force at its limit is lowered by as much as the pulses need."""
LONGEST_PULSE = 0.05
"""[s]; of one of the two pulses."""
EXCESS_RATIO = 6.0
"""Largest 2A/E, as A is at least 1.5 times the friction."""


@dataclass(frozen=True)
class HandOnHandle:
    """A hand as it acts on the handle: [N/m or N·m/rad], [N·s/m or N·m·s/rad], [kg or kg·m²]."""

    stiffness: float
    damping: float
    mass: float


HAND = {Workspace.LINEAR: HandOnHandle(1000.0, 10.0, 0.02), Workspace.ROTARY: HandOnHandle(2.5, 0.025, 5e-5)}
"""The stiffest hand against which a pair must move the counts. Chosen here: three times the stiffness of the simulated
hands, and the mass of the fingers; on a handle that turns, at a lever of 50 mm."""


@dataclass(frozen=True)
class EncoderProbe:
    """How the encoder of one axis is asked."""

    effort: float
    """Of a pulse, a whole number of the drive's steps [N or N·m]."""
    periods: int
    """Of one pulse."""
    least: float
    """Smallest force under which pulses of this size are not felt [N or N·m]."""
    lead: int
    """Periods before the pulses."""
    wait: int
    """Periods after them, until the last motion has been seen."""
    period: float
    """[s]"""

    @property
    def pair(self) -> int:
        """Periods from one pair to the next."""
        return self.lead + 2 * self.periods + self.wait

    @property
    def time(self) -> float:
        """Longest time from the last motion until an encoder without any ends the run, gaps not counted [s].

        Rounded up to tenths.
        """
        # The period in which the time is over, and that which ends each pair.
        return math.ceil(10.0 * (STILL + (2 + PAIRS * (self.pair + 1)) * self.period)) / 10.0


def encoder_probe(axis: AxisPlan, period: float) -> EncoderProbe | None:
    """Return how the encoder of the axis is asked; None where it cannot be, or need not be."""
    probe = _probe(axis, period) if _needed(axis) else None
    return probe if isinstance(probe, EncoderProbe) else None


def _needed(axis: AxisPlan) -> bool:
    """Return whether the axis may give more than what a hand may be left alone with."""
    return axis.limits.effort > axis.limits.holding * (1.0 + 1e-9)


def _probe(axis: AxisPlan, period: float) -> EncoderProbe | str:
    """Return how the encoder is asked, or the reason for which it cannot be."""
    plant, limits, step = axis.plant, axis.limits, axis.effort_unit
    if axis.integrates:
        return f"{axis.profile.title} offers velocity only"
    if plant is None or not plant.mass:
        return "the inertia is unknown"
    longest = math.floor(LONGEST_PULSE / period + 1e-9)
    if not longest:
        return f"a pulse of one period is longer than {exactly(1e3 * LONGEST_PULSE)} ms"
    lost = axis.delay.torque_loop * (1.0 + math.log(EXCESS_RATIO)) + 2.0 * FELT_SHARE * limits.effort / limits.slew
    way = ASKED_COUNTS * axis.resolution
    moved = travel(plant, HAND[axis.workspace], longest * period - lost)
    needed = max(FRICTIONS * plant.coulomb, plant.coulomb + way / moved) if moved else math.inf
    if needed > FELT_SHARE * limits.effort - step:
        force = axis.workspace.effort_unit
        asked = f"pulses of ±{in_unit(needed, force)}" if moved else "longer pulses"
        return (
            f"{asked} are needed, but pulses above {percent(FELT_SHARE)} of {in_unit(limits.effort, force)} can be felt"
        )
    effort = max(1, math.ceil(needed / step - 1e-9)) * step
    enough = way / (effort - plant.coulomb)
    periods = next(
        (each for each in range(1, longest) if travel(plant, HAND[axis.workspace], each * period - lost) >= enough),
        longest,
    )
    least, lead = max(limits.holding, effort / FELT_SHARE), max(1, round(LEAD / period))
    probe = EncoderProbe(effort, periods, least, lead, math.ceil(axis.delay.total / period) + 1, period)
    if limits.stall < probe.time:
        return f"the test takes {rounded(probe.time)} s, but limits.stall is {exactly(limits.stall)} s"
    return probe


def travel(plant: Plant, hand: HandOnHandle, time: float) -> float:
    """Return how far one newton beyond friction moves a handle with a hand on it from rest within `time` [s].

    [m/N or rad/(N·m)]; up to the first turn, from where friction holds the handle.
    """
    if time <= 0.0:
        return 0.0
    mass = plant.mass + hand.mass
    decay, square = 0.5 * (plant.damping + hand.damping) / mass, hand.stiffness / mass
    root = cmath.sqrt(decay**2 - square)
    if abs(root) < 1e-6 * decay:  # equal poles, where the quotient below has no value
        root = complex(1e-6 * decay)
    if root.imag:
        time = min(time, math.pi / root.imag)
    first, second = root - decay, -root - decay
    rest = (first * cmath.exp(second * time) - second * cmath.exp(first * time)) / (first - second)
    return (1.0 - rest.real) / hand.stiffness


def encoder_lines(axis: AxisPlan, period: float) -> Iterator[str]:
    """Yield in words how an encoder is asked whose counts stand still, and the rule where it is not."""
    if not _needed(axis):
        return
    probe, limits, force = _probe(axis, period), axis.limits, axis.workspace.effort_unit
    holding = in_unit(limits.holding, force)
    rule = f"without a count for {exactly(limits.stall)} s the {axis.workspace.effort_name} is limited to {holding}"
    if isinstance(probe, str):
        yield f"encoder not tested by pulses: {probe}; {rule}"
        return
    hand, length = HAND[axis.workspace], axis.workspace.length_unit
    yield (
        f"encoder test by pulses after {exactly(STILL)} s without a count under {in_unit(probe.least, force)} or more: "
        f"pairs of ±{in_unit(probe.effort, force)} for {rounded(1e3 * probe.periods * period)} ms, at most "
        f"{percent(FELT_SHARE)} of the {axis.workspace.effort_name}"
    )
    friction = 0.0 if axis.plant is None else axis.plant.coulomb
    yield (
        f"a pair moves two counts against {in_unit(friction, force)} of friction and a hand of "
        f"{in_unit(hand.stiffness, f'{force}/{length}')}; {PAIRS} pairs without a count trip after "
        f"{rounded(probe.time)} s"
    )
    if probe.least > limits.holding:
        yield f"from {holding} to {in_unit(probe.least, force)} {rule}"


def why_not_asked(axis: AxisPlan, period: float) -> str:
    """Return why an encoder whose counts stood still was not asked by pulses."""
    probe = _probe(axis, period)
    if isinstance(probe, str):
        return probe
    return f"pulses could be felt below {in_unit(probe.least, axis.workspace.effort_unit)}"
