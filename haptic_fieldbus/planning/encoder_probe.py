"""Pulses that test an encoder whose counts stand still under force: their size, and the axes without this test.

A hand that leans on the handle and an encoder with a broken cable look alike: force, and counts that stand still. A
small torque of both signs distinguishes them. After `STILL` seconds a *pair* of pulses is added to the force: −A for n
periods, then +A for n periods, against the force first. A change of the counts shows a working encoder. The run ends
after `PAIRS` pairs in a row without a change.

Size. An unknown force p, |p| ≤ fc, pulls at a shaft that friction holds at rest. For any p one of the two pulses
exceeds friction by at least A − fc; with p = 0 both exceed it by exactly A − fc. So A is 1.5·fc or more. The excess E =
A − fc moves handle and hand together by

    x(t) = E/k·(1 − (s₁·e^(s₂·t) − s₂·e^(s₁·t))/(s₁ − s₂)),   s = −γ ± √(γ² − k/m),   γ = b/(2m)

up to the first reversal, with the mass m and damping b of both and the stiffness k of the hand. A pair must move the
handle by two counts against the hand `HAND`. One count then changes, wherever within a count the handle rests. The
scene has no effect: its force stays constant until a count changes. Three parts of the n periods do not count: the lag
T of the torque loop, within which the force of the motor follows; T·ln(2A/E) at most, 2A/E ≤ 6, until the force exceeds
friction after −A; and the time of the slew limit from −A to +A.

Bound. People do not notice a difference of forces below about 8 % (`limits.FELT_SHARE`), so pulses need a force of at
least A/0.08. If the force is within A of its limit, it is lowered during half a second, too slowly for a hand to
notice. Then −A and +A both stay within the limit.

The rule of `limits.stall` applies instead below that force, if the necessary pulses would be felt or too long, and if
the rule acts sooner than five pairs.
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
"""Time for which counts must stand still under force before the test [s]."""
PAIRS = 5
"""Number of pairs without a motion that end a run."""
FRICTIONS = 1.5
"""Smallest pulse as a multiple of the friction in the rig: it allows for 50 % more friction."""
ASKED_COUNTS = 2.0
"""Counts that a pair is designed to move."""
LEAD = 0.5
"""Time before each pair in which a force near its limit is lowered by the size of the pulses [s]."""
LONGEST_PULSE = 0.05
"""Longest duration of one of the two pulses [s]."""
EXCESS_RATIO = 6.0
"""Largest 2A/E, as A is at least 1.5 times the friction."""


@dataclass(frozen=True)
class HandOnHandle:
    """Stiffness, damping and mass of a hand at the handle: [N/m or N·m/rad], [N·s/m or N·m·s/rad], [kg or kg·m²]."""

    stiffness: float
    damping: float
    mass: float


HAND = {Workspace.LINEAR: HandOnHandle(1000.0, 10.0, 0.02), Workspace.ROTARY: HandOnHandle(2.5, 0.025, 5e-5)}
"""The stiffest hand against which a pair must move the counts. Chosen here: three times the stiffness of the simulated
hands, and the mass of the fingers; on a rotary handle at a lever of 50 mm."""


@dataclass(frozen=True)
class EncoderProbe:
    """Encoder test of one axis."""

    effort: float
    """Size of a pulse, a whole number of the drive's steps [N or N·m]."""
    periods: int
    """Length of one pulse in periods."""
    least: float
    """Smallest force under which pulses of this size are not felt [N or N·m]."""
    lead: int
    """Periods before the pulses."""
    wait: int
    """Periods after the pulses, until the last motion is visible."""
    period: float
    """[s]"""

    @property
    def pair(self) -> int:
        """Periods from one pair to the next."""
        return self.lead + 2 * self.periods + self.wait

    @property
    def time(self) -> float:
        """Longest time from the last motion until a dead encoder ends the run, gaps not counted [s].

        Rounded up to tenths.
        """
        # The period in which the time ends, and the last period of each pair.
        return math.ceil(10.0 * (STILL + (2 + PAIRS * (self.pair + 1)) * self.period)) / 10.0


def encoder_probe(axis: AxisPlan, period: float) -> EncoderProbe | None:
    """Return the encoder test of the axis; None where it is impossible or not needed."""
    probe = _probe(axis, period) if _needed(axis) else None
    return probe if isinstance(probe, EncoderProbe) else None


def _needed(axis: AxisPlan) -> bool:
    """Return whether the axis may give more than the holding force."""
    return axis.limits.effort > axis.limits.holding * (1.0 + 1e-9)


def _probe(axis: AxisPlan, period: float) -> EncoderProbe | str:
    """Return the encoder test, or the reason why it is impossible."""
    plant, limits, step = axis.plant, axis.limits, axis.effort_unit
    if axis.integrates:
        return f"{axis.profile.title} offers velocity only"
    if plant is None or not plant.mass:
        return "the inertia is unknown"
    longest = math.floor(LONGEST_PULSE / period + 1e-9)
    if not longest:
        return f"a pulse of one period is longer than {exactly(1e3 * LONGEST_PULSE)} ms"
    lost = axis.delay.torque_loop * (1.0 + math.log(EXCESS_RATIO)) + 2.0 * FELT_SHARE * limits.effort / limits.slew
    way, hand = ASKED_COUNTS * axis.resolution, HAND[axis.workspace]
    moved = travel(plant, hand, longest * period - lost)
    needed = max(FRICTIONS * plant.coulomb, plant.coulomb + way / moved) if moved else math.inf
    if needed > FELT_SHARE * limits.effort - step:
        force = axis.workspace.effort_unit
        asked = f"pulses of ±{in_unit(needed, force)}" if moved else "longer pulses"
        felt = f"{percent(FELT_SHARE)} of {in_unit(limits.effort, force)}"
        return f"{asked} are needed, but pulses above {felt} can be felt"
    effort = max(1, math.ceil(needed / step - 1e-9)) * step
    enough = way / (effort - plant.coulomb)
    ways = ((each, travel(plant, hand, each * period - lost)) for each in range(1, longest))
    periods = next((each for each, moved in ways if moved >= enough), longest)
    least, lead = max(limits.holding, effort / FELT_SHARE), max(1, round(LEAD / period))
    probe = EncoderProbe(effort, periods, least, lead, math.ceil(axis.delay.total / period) + 1, period)
    if limits.stall < probe.time:
        return f"the test takes {rounded(probe.time)} s, but limits.stall is {exactly(limits.stall)} s"
    return probe


def travel(plant: Plant, hand: HandOnHandle, time: float) -> float:
    """Return the motion of a handle with a hand, from rest within `time` [s], for one newton above friction.

    [m/N or rad/(N·m)]; up to the first reversal.
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
    """Yield the encoder test of each axis in words, or the rule that applies without it."""
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
    """Return why pulses did not test an encoder whose counts stood still."""
    probe = _probe(axis, period)
    if isinstance(probe, str):
        return probe
    return f"pulses could be felt below {in_unit(probe.least, axis.workspace.effort_unit)}"
