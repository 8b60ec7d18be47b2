"""The torque pulses that test the motor direction (the sign from torque to motion) before the full force is permitted.

A reversed encoder, or a motor that turns the other way, makes a spring push away instead of back. The scene does not
show this before the handle flies: a spring reacts to the position in the same way with either sign, and a hand that
leads the handle makes position and torque agree. A torque that does *not* depend on the motion shows the sign. At
enabling, while the permitted torque is small, pulses of both signs are therefore given, independent of scene and hand.

A *pulse* lasts three times n periods: n without torque, n with the torque s·A, n with −s·A to stop again. The positions
at its begin and at the ends of its first two thirds give the second difference

    e = x(2n) − 2·x(n) + x(0)

A constant speed cancels in e. Two pulses of opposite sign are a *pair*, d = e₊ − e₋. A constant acceleration, such as a
push or a weight, cancels in d too. For a mass alone d = A·T²/m with T = n periods.

Three conditions must agree before a decision, so that noise, a hand or a spring alone cannot cause a wrong one. They
are the same for both decisions:

- *Every pair* shows |d| of at least three counts, all to the same side. Each reading of a pair is wrong by up to half a
  count, and two of them count twice: together at most four counts, with a standard deviation of one.
- *The first pulse* moves the handle to that side. It begins at rest, and a body at rest first moves in the direction of
  the push, whatever mass, spring or damper hold it. Later pulses may fail while the handle still rings.
- *Every pulse* moves the handle in the direction of its torque, after a straight line is subtracted from their e. The
  signs are + − − + − + + − … (Thue and Morse). No regular motion follows them: a hand that leads the handle would have
  to reverse it at nearly every pulse, some 30 times a second on the shipped bench. If pulses are so long that a hand
  could do so, there are twice as many pulses. Their reversals are too irregular for any oscillation.

A pulse is as long as it takes for d to be four counts, but at least 5 ms. The pulses begin small. While nothing moves
they grow step by step to a bound that no description of the bench can raise: 15 % of rated torque, and 5 N or 0.25 N·m
at the handle (`limits.PULSE_SHARE`, `PULSE_EFFORT`). At the bound they become longer. If the handle moved, but the
conditions do not agree, the pulses become longer with the same torque. After that the scene goes on within 5 % of rated
torque, and the test is repeated every second. A handle that did not move in three attempts ends the run.
"""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from haptic_fieldbus.drive.fields import LARGEST_SHARE
from haptic_fieldbus.drive.rig import FULL_SCALE, FULL_SCALE_STEPS, SHARES_OF_RATED
from haptic_fieldbus.errors import PlanError
from haptic_fieldbus.numerals import exactly, in_unit, percent, rounded
from haptic_fieldbus.planning.axis_plan import AxisPlan
from haptic_fieldbus.planning.limits import HOLDING_SHARE, permitted_unseen
from haptic_fieldbus.scenes.element import Element
from haptic_fieldbus.signals import Signal

# Reaction of an element to acceleration, as a virtual mass.

FASTEST_HAND, BLOCK = 30.0, 600.0
"""[rad/s]; changes of torque between these frequencies are too fast for a hand, and visible in blocks of 5 ms."""
FREQUENCIES = np.geomspace(FASTEST_HAND, BLOCK, 16)


def virtual_mass(elements: Iterable[Element]) -> float:
    """Return the largest mass [kg or kg·m²] that the elements add to the handle between these frequencies.

    A force H(jω)·x on a motion x with the frequency ω acts like a mass Re H/ω², because the force of a mass is m·ω²·x.
    """
    total = np.zeros(FREQUENCIES.size)
    for element in elements:
        space = element.linearised()
        answers = []
        for frequency in FREQUENCIES:
            motion = np.array([1.0, 1j * frequency])
            states = np.linalg.solve(1j * frequency * np.eye(space.order) - space.a, space.b @ motion)
            answers.append(np.real((space.c @ states + space.d @ motion)[0]) / frequency**2)
        total += np.maximum(0.0, answers)
    return float(total.max())


FIRST_SHARE = 2.0 / 3.0
"""First torque of the probe, as a share of the holding torque."""
GROWTH = 1.5
"""Factor from one torque of the probe to the next."""
LENGTHS = (2, 4)
"""Lengths of the longer pulses, as multiples of the first length."""
ATTEMPTS = 3
"""Number of attempts without motion that end a run; in the pauses between them a person can let go of the handle."""
SHORTEST_PULSE, LONGEST_PULSE = 0.005, 0.1
"""Range of the length of the part of a pulse with one torque [s]."""
ASKED_COUNTS, SEEN_COUNTS = 4.0, 3.0
"""Counts for which a pair is designed, and smallest number of counts with which it is valid."""
FEWEST_PAIRS, MORE_PAIRS = 3, 6
"""Number of pairs of a stage that is faster than a hand, and of a slower stage."""
HAND_TIME = 0.15
"""Time in which a hand makes at most one movement and back [s]."""
PAUSE = 1.0
"""[s] between two attempts."""
PULSES_OF_A_PAIR, PARTS = 2, 3


@dataclass(frozen=True)
class PulseStage:
    """Pairs of pulses of one torque [N or N·m in the workspace] and length, of the part with one torque [periods]."""

    effort: float
    periods: int
    pairs: int


@dataclass(frozen=True)
class SignProbe:
    """Test of the motor direction of one axis."""

    stages: tuple[PulseStage, ...]
    """Stages in their order, until the direction is confirmed."""
    holding: float
    """Largest effort of the scene until then [N or N·m]."""
    period: float
    """[s]"""
    step: float
    """Smallest measurable motion: one encoder count [m or rad]; for a drive with velocity only, one step of its speed
    [m/s]."""
    speed: bool
    """Whether `step` is a step of speed."""
    mass: float | None
    """[kg or kg·m²]; None: unknown."""
    friction: float
    """[N or N·m]"""

    @property
    def largest(self) -> float:
        """Largest effort of the probe [N or N·m]."""
        return max(stage.effort for stage in self.stages)

    @property
    def time(self) -> float:
        """Shortest time until the direction is confirmed [s]."""
        return self.stages[0].pairs * PULSES_OF_A_PAIR * PARTS * self.stages[0].periods * self.period

    @property
    def travel(self) -> float | None:
        """Motion of a handle without friction in the first pulse [m or rad]; None: the inertia is unknown."""
        return self._moved(self.stages[0])

    @property
    def farthest(self) -> float | None:
        """Largest motion of a handle in any pulse, as when it comes loose [m or rad]; None: the inertia is unknown."""
        ways = [way for stage in self.stages if (way := self._moved(stage)) is not None]
        return max(ways, default=None)

    def _moved(self, stage: PulseStage) -> float | None:
        return stage.effort / self.mass * (stage.periods * self.period) ** 2 if self.mass else None

    def least(self, stage: PulseStage) -> float:
        """Return the smallest d of a valid pair [m or rad]."""
        return SEEN_COUNTS * self.step * (stage.periods * self.period if self.speed else 1.0)


def sign_probe(axis: AxisPlan, period: float) -> SignProbe | None:
    """Return the direction test of the axis; None if the direction is known."""
    return None if axis.sign_known else probe_of(axis, period)


def check_steps(axis: AxisPlan) -> None:
    """Raise PlanError when the torque steps of the drive are too large or too small for the permitted torque.

    A step is too large if it exceeds the torque permitted before the direction is confirmed. It is too small if the
    limit of the axis has more steps than the type of the target torque.
    """
    target, force = axis.profile.offers()[Signal.TARGET_TORQUE], axis.workspace.effort_unit
    step = f"axis {axis.name}: one step of target torque is {in_unit(axis.effort_unit, force)} at the handle"
    scale = "Check the mechanism and the torque scaling in the rig"
    most = min(target.type.limits[1], FULL_SCALE_STEPS if target.unit == FULL_SCALE else math.inf)
    if axis.limits.effort > most * axis.effort_unit:
        less = f"less than the limit of the axis, {in_unit(axis.limits.effort, force)}"
        raise PlanError(f"{step}, and at most {most} steps are possible: {less}. {scale}")
    if axis.limits.unseen <= 0.0 and not axis.sign_known:
        above = "above the torque allowed before the motor direction is confirmed"
        raise PlanError(f"{step}, {above}. {scale}; {raising(axis)}")


def probe_of(axis: AxisPlan, period: float) -> SignProbe:
    """Return the direction test of the axis, even if the direction is known."""
    bound = axis.limits.unseen
    friction = (axis.bench.coulomb_friction or 0.0) / axis.rig.mechanism.ratio
    efforts = tuple(_efforts(axis, bound))
    step = abs(axis.velocity_unit) if axis.integrates else axis.resolution
    mass = axis.plant.mass if axis.plant is not None else None
    # The length of the pulses fits the first torque that is well above friction.
    enough = next((effort for effort in efforts if effort > 1.5 * friction), bound)
    length = _length(step, enough - friction, mass, speed=axis.integrates)
    periods = max(1, math.ceil(length / period - 1e-9))
    stages = [PulseStage(effort, periods, _pairs(periods * period)) for effort in efforts]
    stages += longer(stages[-1], period)
    return SignProbe(tuple(stages), axis.limits.before_sign, period, step, axis.integrates, mass, friction)


def _efforts(axis: AxisPlan, bound: float) -> Iterator[float]:
    """Yield the torques of the probe, each a whole number of the drive's steps, from the smallest to the bound."""
    effort, before = min(FIRST_SHARE * HOLDING_SHARE * axis.rated_effort, bound / GROWTH**2), 0.0
    while effort < 0.99 * bound:
        stepped = max(1, round(effort / axis.effort_unit)) * axis.effort_unit
        if before < stepped < bound:
            yield stepped
            before = stepped
        effort *= GROWTH
    yield bound


def longer(stage: PulseStage, period: float) -> tuple[PulseStage, ...]:
    """Return the stages with longer pulses of the same torque that follow this one."""
    longest = max(stage.periods, round(LONGEST_PULSE / period))
    lengths = dict.fromkeys(min(longest, factor * stage.periods) for factor in LENGTHS)
    further = [periods for periods in lengths if periods > stage.periods]
    return tuple(PulseStage(stage.effort, periods, _pairs(periods * period)) for periods in further)


def _pairs(length: float) -> int:
    """Return the number of pairs in a stage with pulses of this length [s]."""
    fast = FEWEST_PAIRS * PULSES_OF_A_PAIR * PARTS * length <= HAND_TIME
    return FEWEST_PAIRS if fast else MORE_PAIRS


def _length(step: float, effort: float, mass: float | None, *, speed: bool) -> float:
    """Return the time for which a torque must act on the free handle until its motion is measurable [s]."""
    if not mass or effort <= 0.0:
        return SHORTEST_PULSE
    least = ASKED_COUNTS * step * mass / effort  # speed times time of the pulse, or its square
    return min(max(least if speed else math.sqrt(least), SHORTEST_PULSE), LONGEST_PULSE)


def is_checked(axis: AxisPlan) -> bool:
    """Return whether the torque of the test is certainly a share of the drive's own rated value."""
    return axis.profile.offers()[Signal.TARGET_TORQUE].unit in SHARES_OF_RATED or axis.profile.rating_told


def raising(axis: AxisPlan) -> str:
    """Return the bound on the torque of the test, and the key that permits more, in words."""
    given, force = axis.rig.permissions, axis.workspace.effort_unit
    share, effort = permitted_unseen(axis.rig, axis.rated_effort, axis.workspace)
    if axis.limits.effort < min(share, effort):
        return f"pulses cannot exceed the limit of the axis, {in_unit(axis.limits.effort, force)}"
    if effort <= share:
        return f"raise axis.{axis.name}.permissions.sign_effort, now {exactly(effort)} {force}"
    if given.sign_pulse == LARGEST_SHARE:
        return f"pulses cannot exceed {percent(LARGEST_SHARE)} of rated torque"
    return (
        f"raise axis.{axis.name}.permissions.sign_pulse, now {exactly(share / axis.rated_effort)} of rated torque, to "
        f"at most {exactly(LARGEST_SHARE)}"
    )


def sign_text(axis: AxisPlan, probe: SignProbe) -> str:
    """Return the direction test in words: torques, times, and motion of the handle."""
    force, first = axis.workspace.effort_unit, probe.stages[0].effort
    pulses = f"motor direction check with pulses of ±{in_unit(first, force)}"
    share = percent(probe.largest / axis.rated_effort)
    grown = f", growing to ±{in_unit(probe.largest, force)} ({share} of rated torque) while nothing moves"
    pulses += grown if probe.largest > first else ""
    time = f"takes at least {rounded(1e3 * probe.time)} ms{_hindered(axis, probe)}"
    return f"{pulses}; {_ways(axis, probe)}; {time}; until then at most {in_unit(probe.holding, force)}"


def _ways(axis: AxisPlan, probe: SignProbe) -> str:
    """Return the motion of the handle in the pulses, from the inertia in the rig."""
    length, first = axis.workspace.length_unit, probe.stages[0]
    if probe.travel is None or probe.farthest is None:
        return "the travel of the handle is unknown, because its inertia is"
    speed = f" at {in_unit(probe.travel / (first.periods * probe.period), f'{length}/s')}" if probe.speed else ""
    return (
        f"the first pulses move a free handle by up to {in_unit(probe.travel, length)}{speed}; the largest pulses move "
        f"a handle that breaks loose by up to {in_unit(probe.farthest, length)}"
    )


def _hindered(axis: AxisPlan, probe: SignProbe) -> str:
    """Return further warnings: friction above the pulses, and a torque scale that cannot be checked."""
    force, told = axis.workspace.effort_unit, ""
    if probe.friction >= probe.largest:
        told = f"; friction in the rig ({in_unit(probe.friction, force)}) is not below the largest pulse, so the test "
        told += f"will probably fail ({raising(axis)})"
    if not is_checked(axis):
        told += f"; the values in {force} follow from the rig alone and cannot be checked: {axis.profile.title} "
        told += "neither uses a share of a rated value nor reports one"
    return told
